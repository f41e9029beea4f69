"""A xacro description for UUV Simulator, Plankton and DAVE (Gazebo classic)."""

from __future__ import annotations

import numpy as np

from auvid.data_schemas.records.model_file import ThrusterFigures
from auvid.data_schemas.units import NEUTRAL_US
from auvid.export.body import (
    STANDING,
    TO_FLU,
    Body,
    Force,
    Term,
    constants_of,
    floated,
    floated_words,
    names_of,
)
from auvid.export.exported import Exported, Request, Target
from auvid.export.losses import Lost
from auvid.export.source_code import flat
from auvid.export.text import number, numbers, xml_comment
from auvid.export.thrusters import (
    THRUSTER_INERTIA,
    THRUSTER_MASS,
    offsets_words,
    placed_thrusters,
    unplaced_note,
    without_thrusters,
)
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import skew

CONVENTION = (
    "Link base_link: axes x forward, y port, z up (FLU) in a world ENU, with its origin at its"
    " centre of gravity, because Gazebo classic applies the plugin's force there. The plugin"
    " itself turns velocities into forward-starboard-down axes, so added_mass (positive) and the"
    " damping matrices (negative, as in auvid) are in those axes, not in FLU; inertia, centre of"
    " buoyancy and thrusters are in FLU."
)
_USAGE = """\
`xacro {name}.xacro namespace:=rov` gives the description to spawn:

```xml
<param name="rov/robot_description"
       command="$(find xacro)/xacro {name}.xacro namespace:=rov"/>
```

Visual and collision shapes are a box of the displaced volume; replace them as you like.
The plugin takes gravity from the world: set {gravity} m/s^2.
The origin of base_link is at ({origin}) m from the body origin of the vehicle
file (forward, starboard, down). {thrusters}"""
_THRUSTERS = """Thruster i takes {takes}
on `/rov/thrusters/i/input`. The {mass} kg of each thruster link are taken off base_link.
"""


def export(request: Request) -> Exported:
    """Return `NAME.xacro`, a description with the argument namespace.

    tau = (DLin + u DFwd + diag(DQuad |nu|)) nu, added mass Ma > 0 in the axes of ToNED:
    uuvsimulator/uuv_simulator uuv_gazebo_plugins/uuv_gazebo_plugins/src/
    HydrodynamicModel.cc:357-485 (bfb40cb1). The velocity is that of the link origin,
    the force acts at the centre of gravity: gazebosim/gazebo-classic
    gazebo/physics/ode/ODELink.cc AddRelativeForce, WorldLinearVel (0127272), as does
    the centre of buoyancy (BuoyantObject.cc:197). With A = [[1, S(r_G)], [0, 1]],
    nu_O = A nu_G and tau_G = A' tau_O. A constant Z, K, M is in the buoyancy.
    """
    body, name = floated(request.body), request.name
    _, centre, _ = without_thrusters(body)
    to_G = np.eye(6)
    to_G[:3, 3:] = skew(centre)
    linear, forward, quadratic = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    for term in body.terms:
        kind, place = _part(term)
        if kind == "linear":
            linear[term.axis, place] += term.value
        elif kind == "forward":
            forward[term.axis, place] += term.value
        elif kind == "quadratic":
            quadratic[term.axis] += term.value
    linear = to_G.T @ linear @ to_G
    added = -to_G.T @ body.added_mass @ to_G
    text = _document(body, request, linear, forward, quadratic, added)
    lost = _losses(body, to_G, linear, forward, quadratic)
    placed = placed_thrusters(body)
    left = constants_of(body)
    notes = [
        *(
            note
            for note in (floated_words(request.body), offsets_words(body, left, first=0))
            if note
        ),
        "Added mass acts on the acceleration of the step before, low-pass filtered: keep steps"
        " short and mind vehicles with more added than own mass.",
        *unplaced_note(body),
    ]
    if body.fins is not None or body.propeller is not None:
        notes.append("Fins and propeller are left out: apply their force.")
    curve = body.curve
    if curve is not None and curve.polynomial is not None:
        notes.append("The polynomial of thrust is left out: thrusters take forces.")
    elif curve is not None:
        notes.append("The voltage of the battery is left out: the curve is that of its voltage.")
    takes = (
        "its pulse width less 1500, in us," if curve and not curve.polynomial else "its force in N"
    )
    return Exported(
        {f"{name}.xacro": text},
        lost,
        CONVENTION,
        _USAGE.format(
            name=name,
            gravity=number(body.gravity),
            origin=numbers(centre, ", "),
            thrusters=_THRUSTERS.format(takes=takes, mass=THRUSTER_MASS) if placed else "",
        ),
        tuple(notes),
    )


def _part(term: Term) -> tuple[str, int]:
    """Return the matrix that holds a term and its column; "" for none.

    >>> _part(Term(1, ("u", "r"), 1.0, "")), _part(Term(1, ("v", "|r|"), 1.0, ""))
    (('forward', 5), ('', 0))
    """
    plain = term.velocities
    if plain is not None and len(plain) == 1:
        return "linear", plain[0]
    if plain is not None and len(plain) == 2 and 0 in plain:
        return "forward", max(plain)
    if term.velocity_modulus == (term.axis, term.axis):
        return "quadratic", term.axis
    return "", 0


def _losses(
    body: Body, to_G: Array, linear: Array, forward: Array, quadratic: Array
) -> tuple[Lost, ...]:
    missing = body.keep(lambda term: not _part(term)[0])
    losses = []
    if missing.terms:
        losses.append(
            Lost(
                names_of(missing.terms),
                "the plugin has x, u x, and x|x| on its own axis, and no constant force along x"
                " or y nor moment about z of the vehicle",
                missing.viscous,
            )
        )
    if np.abs(to_G[:3, 3:]).max() > STANDING:
        moved = [term for term in body.terms if _part(term)[0] in ("forward", "quadratic")]
        if moved:
            kept = body.keep(lambda term: bool(_part(term)[0]))
            losses.append(
                Lost(
                    f"the arm of {names_of(moved)}",
                    "they act about the centre of gravity there",
                    _about_G(kept, to_G, linear, forward, quadratic),
                )
            )
    return tuple(losses)


def _about_G(kept: Body, to_G: Array, linear: Array, forward: Array, quadratic: Array) -> Force:
    """Return the error, seen at the body origin, of terms taken about G."""
    back = np.linalg.inv(to_G)

    def error(nu: Array, excess: Array) -> Array:
        at_G = nu @ back.T
        tau = at_G @ linear.T + at_G[:, :1] * (at_G @ forward.T)
        tau += quadratic * np.abs(at_G) * at_G
        return kept.viscous(nu, excess) - tau @ back

    return error


def _document(
    body: Body, request: Request, linear: Array, forward: Array, quadratic: Array, added: Array
) -> str:
    name = request.name
    flip = TO_FLU[:3]
    mass, centre, inertia = without_thrusters(body)
    inertia = inertia * np.outer(flip, flip)
    moments = " ".join(
        f'i{"xyz"[i]}{"xyz"[j]}="{number(inertia[i, j])}"' for i in range(3) for j in range(i, 3)
    )
    length, width, height = body.box
    buoyant = flip * (body.r_B - centre)
    origin = f'<origin xyz="{numbers(buoyant)}" rpy="0 0 0"/>'
    box = f'<geometry><box size="{numbers(body.box)}"/></geometry>'
    space = " " * 12
    return "".join(
        [
            '<?xml version="1.0"?>\n',
            xml_comment([f"Model {name}: {body.title}.", *request.head, CONVENTION]),
            f'<robot name="{name}" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
            '  <xacro:arg name="namespace" default="rov"/>\n'
            '  <xacro:property name="namespace" value="$(arg namespace)"/>\n'
            '    <link name="${namespace}/base_link">\n      <inertial>\n'
            f'        <mass value="{number(mass)}"/>\n'
            '        <origin xyz="0 0 0" rpy="0 0 0"/>\n'
            f"        <inertia {moments}/>\n      </inertial>\n"
            f"      <visual>{origin}{box}</visual>\n"
            f"      <collision>{origin}{box}</collision>\n    </link>\n"
            '    <gazebo reference="${namespace}/base_link">\n'
            "      <selfCollide>false</selfCollide>\n    </gazebo>\n"
            '    <gazebo>\n      <plugin name="uuv_plugin"'
            ' filename="libuuv_underwater_object_ros_plugin.so">\n'
            f"        <fluid_density>{number(body.water_density)}</fluid_density>\n"
            "        <flow_velocity_topic>hydrodynamics/current_velocity</flow_velocity_topic>\n"
            "        <debug>0</debug>\n"
            '        <link name="${namespace}/base_link">\n'
            "          <neutrally_buoyant>0</neutrally_buoyant>\n"
            f"          <volume>{number(body.volume)}</volume>\n"
            f"          <box><width>{number(width)}</width><length>{number(length)}</length>"
            f"<height>{number(height)}</height></box>\n"
            f"          <center_of_buoyancy>{numbers(buoyant)}</center_of_buoyancy>\n"
            "          <hydrodynamic_model>\n            <type>fossen</type>\n"
            f"            <added_mass>\n{flat(added, space + '  ')}{space}</added_mass>\n"
            f"            <linear_damping>\n{flat(linear, space + '  ')}{space}</linear_damping>\n"
            f"            <linear_damping_forward_speed>\n{flat(forward, space + '  ')}{space}"
            "</linear_damping_forward_speed>\n"
            f"            <quadratic_damping>{numbers(quadratic)}</quadratic_damping>\n"
            "          </hydrodynamic_model>\n        </link>\n      </plugin>\n    </gazebo>\n",
            *(_thruster(place, item, body, centre) for place, item in enumerate(body.thrusters)),
            "</robot>\n",
        ]
    )


def _thruster(place: int, item: ThrusterFigures, body: Body, centre: Array) -> str:
    """Return link, joint and plugin of a thruster; "" where its place is not known."""
    curve = body.curve
    if item.position_m is None or item.axis is None or curve is None:
        return ""
    flip = TO_FLU[:3]
    name = "${namespace}/thruster_" + str(place)
    if curve.polynomial is None:
        # From 1500 us, so that the command 0 before the first message gives no force;
        # direction -1 mirrors the pulse: the table is mirrored instead.
        pulses, forces = np.array(curve.pulse_us) - NEUTRAL_US, np.array(curve.force_N)
        if item.direction < 0:
            pulses, forces = -pulses[::-1], forces[::-1]
        conversion = (
            f"<conversion><type>LinearInterp</type><inputValues>{numbers(pulses)}</inputValues>"
            f"<outputValues>{numbers(forces)}</outputValues></conversion>"
        )
    else:
        steady = numbers([*(body.force_limits or ())])
        conversion = (
            f"<conversion><type>LinearInterp</type><inputValues>{steady}</inputValues>"
            f"<outputValues>{steady}</outputValues></conversion>"
        )
    dynamics = (
        f"<dynamics><type>FirstOrder</type><timeConstant>{number(body.lag_s)}</timeConstant>"
        "</dynamics>"
        if body.lag_s
        else "<dynamics><type>ZeroOrder</type></dynamics>"
    )
    small = " ".join(f'{tag}="{THRUSTER_INERTIA}"' for tag in ("ixx", "iyy", "izz"))
    return (
        f'    <link name="{name}">\n      <inertial><mass value="{THRUSTER_MASS}"/>'
        f'<inertia {small} ixy="0" ixz="0" iyz="0"/></inertial>\n'
        '      <collision><geometry><sphere radius="1e-06"/></geometry></collision>\n'
        "    </link>\n"
        f'    <joint name="{name}_joint" type="continuous">\n'
        f'      <origin xyz="{numbers(flip * (np.array(item.position_m) - centre))}"/>\n'
        f'      <parent link="${{namespace}}/base_link"/><child link="{name}"/>\n'
        f'      <axis xyz="{numbers(flip * np.array(item.axis))}"/>\n    </joint>\n'
        f'    <gazebo>\n      <plugin name="thruster_{place}"'
        ' filename="libuuv_thruster_ros_plugin.so">\n'
        f"        <linkName>{name}</linkName><jointName>{name}_joint</jointName>\n"
        f"        <thrusterID>{place}</thrusterID>\n        {dynamics}\n        {conversion}\n"
        "      </plugin>\n    </gazebo>\n"
    )


UUV = Target(
    "uuv",
    "UUV Simulator, Plankton, DAVE: xacro",
    "x, u x of all velocities, x|x| on its own axis, full added mass",
    "uuvsimulator/uuv_simulator bfb40cb1, gazebosim/gazebo-classic 0127272",
    export,
)
