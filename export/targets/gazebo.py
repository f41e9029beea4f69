"""An SDF model for Gazebo Sim with its hydrodynamics, buoyancy and thruster systems."""

from __future__ import annotations

import numpy as np

from auvid.data_schemas.records.model_file import ThrusterFigures
from auvid.export.body import (
    TO_FLU,
    Body,
    Term,
    constants_of,
    floated,
    floated_words,
    names_of,
)
from auvid.export.exported import Exported, Request, Target
from auvid.export.losses import Lost
from auvid.export.text import number, numbers, xml_comment
from auvid.export.thrusters import (
    THRUSTER_INERTIA,
    THRUSTER_MASS,
    offsets_words,
    placed_thrusters,
    unplaced_note,
    without_thrusters,
)
from auvid.hydro.arrays import VELOCITIES, Array

CONVENTION = (
    "Link base_link: axes x forward, y port, z up (FLU) in a world ENU; its origin is the body"
    " origin of the vehicle file, and the plugin takes velocities and applies forces there."
    " Against auvid's forward-starboard-down axes, numbers change sign with each of y, z, q, r in"
    " them. Damping coefficients are negative, as in auvid; fluid_added_mass is positive (minus"
    " the derivatives) and about the link origin; SI."
)
ADDED_MASS_NAMES = "xyzpqr"
_FIELDS = "xyzkmn"
_WORLD = """\
<world name="{name}_world">
  <gravity>0 0 -{gravity}</gravity>
  <plugin filename="gz-sim-physics-system" name="gz::sim::systems::Physics"/>
  <plugin filename="gz-sim-user-commands-system" name="gz::sim::systems::UserCommands"/>
  <plugin filename="gz-sim-scene-broadcaster-system"
          name="gz::sim::systems::SceneBroadcaster"/>
  <plugin filename="gz-sim-buoyancy-system" name="gz::sim::systems::Buoyancy">
    <uniform_fluid_density>{density}</uniform_fluid_density>
  </plugin>
  <light type="directional" name="sun"><direction>0 0 -1</direction></light>
"""
_TORQUE = """\
  <plugin filename="gz-sim-apply-link-wrench-system" name="gz::sim::systems::ApplyLinkWrench">
    <verbose>false</verbose>
    <persistent>
      <entity_name>{name}</entity_name><entity_type>model</entity_type>
      <torque>0 0 {torque}</torque>
    </persistent>
  </plugin>
"""
_USAGE = """\
`gz sim {name}.sdf` opens a world of water with the vehicle in it. For a world of your
own copy the element `model`, and give that world the same gravity and the same density
in its Buoyancy system: weight and buoyancy follow from them.

The physics engine has to be DART (the default): added mass stands in
`<fluid_added_mass>`, which other engines do not read.

The collision box `displaced_volume` is what floats: its volume is the buoyancy, its
middle the centre of buoyancy. Its sides are those of a solid box with the vehicle's
inertia; replace the visual shape as you like, but keep volume and middle of the box.
{thrusters}{products}"""
_THRUSTERS = """
Thruster i takes its force in N on `/model/{name}/joint/thruster_i_joint/cmd_thrust`.
The {mass} kg of each thruster link are taken off base_link.
"""
_PRODUCTS = """
The model has products of plain velocities ({products}). Releases of Gazebo before pull
request gz-sim 1888 read these as products with a modulus: use a later one.
"""


def export(request: Request) -> Exported:
    """Return `NAME.sdf`.

    tau_i = sum_j (c_ij + sum_k (a_ijk |nu_k| + b_ijk nu_k)) nu_j: buildDampingMatrix in
    gazebosim/gz-sim src/systems/hydrodynamics/HydrodynamicsUtils.hh:88 (93bbf3ed1), its
    signs in Hydrodynamics.cc:684-713, applied at the link origin by Link.cc
    AddWorldWrench. Added mass about the link origin, positive: gazebosim/sdformat
    sdf/1.11/inertial.sdf (2ace5362). Buoyancy: src/systems/buoyancy/Buoyancy.cc:540;
    thrusters along the joint's axis: src/systems/thruster/Thruster.cc. A constant Z, K, M
    is in the buoyancy, N a persistent torque about the vertical of the world:
    src/systems/apply_link_wrench/ApplyLinkWrench.cc:150-187, 262-276 (31afa945).
    """
    name, own = request.name, request.body
    body = floated(own)
    kept = body.keep(_holds)
    lost = body.keep(lambda term: not (_holds(term) or _vertical(term)))
    yaw = constants_of(body)[5]
    products = [term for term in kept.terms if _plain_product(term)]
    placed = placed_thrusters(body)
    text = [
        '<?xml version="1.0"?>\n',
        xml_comment([f"Model {name}: {body.title}.", *request.head, CONVENTION]),
        '<sdf version="1.11">\n',
        _WORLD.format(name=name, gravity=number(body.gravity), density=number(body.water_density)),
        _TORQUE.format(name=name, torque=number(-yaw)) if yaw else "",
        f'  <model name="{name}">\n    <pose>0 0 -2 0 0 0</pose>\n',
        _link(body),
        *(_thruster(i + 1, item) for i, item in enumerate(placed)),
        _hydrodynamics(kept),
        *(_thruster_plugin(i + 1, body, name) for i in range(len(placed))),
        "  </model>\n</world>\n</sdf>\n",
    ]
    losses = []
    if lost.terms:
        losses.append(
            Lost(
                names_of(lost.terms),
                "the plugin has x, x|y| and x y of the velocities, and no constant force along x"
                " or y of the vehicle",
                lost.viscous,
            )
        )
    return Exported(
        {f"{name}.sdf": "".join(text)},
        tuple(losses),
        CONVENTION,
        _USAGE.format(
            name=name,
            thrusters=_THRUSTERS.format(name=name, mass=THRUSTER_MASS) if placed else "",
            products=_PRODUCTS.format(products=names_of(products)) if products else "",
        ),
        (*_constant_notes(own, constants_of(lost)), *_notes(body, len(placed))),
    )


def _constant_notes(own: Body, lost: Array) -> tuple[str, ...]:
    notes = [floated_words(own), offsets_words(own, lost)]
    if constants_of(own)[5]:
        notes.append(
            f"The constant yaw moment, {constants_of(own)[5]:.3g} N m, is the torque of the"
            " ApplyLinkWrench system about the vertical: the model's where the vehicle is level."
            " Copy that plugin with the model."
        )
    return tuple(note for note in notes if note)


def _vertical(term: Term) -> bool:
    """Return whether a term is the constant yaw moment."""
    return term.constant and term.axis == 5


def _holds(term: Term) -> bool:
    plain = term.velocities
    return term.velocity_modulus is not None or (plain is not None and len(plain) in (1, 2))


def _plain_product(term: Term) -> bool:
    return term.velocities is not None and len(term.velocities) == 2


def _notes(body: Body, placed: int) -> tuple[str, ...]:
    notes = [*unplaced_note(body)]
    if placed:
        notes.append(
            "Thrusters take forces: the curve of force over pulse width and the voltage are not"
            " in the file; python has them."
        )
    if body.fins is not None or body.propeller is not None:
        notes.append("Fins and propeller are left out: apply their force.")
    if body.lag_s:
        notes.append(f"The lag of the actuators, {body.lag_s:.3g} s, is left out.")
    return tuple(notes)


def _link(body: Body) -> str:
    """Return base_link: inertia, added mass, and the box that floats."""
    flip = TO_FLU[:3]
    mass, centre, inertia = without_thrusters(body)
    inertia = inertia * np.outer(flip, flip)
    added = -body.added_mass * np.outer(TO_FLU, TO_FLU)
    moments = "".join(
        f"          <i{'xyz'[i]}{'xyz'[j]}>{number(inertia[i, j])}</i{'xyz'[i]}{'xyz'[j]}>\n"
        for i in range(3)
        for j in range(i, 3)
    )
    fluid = "".join(
        f"          <{tag}>{number(added[i, j])}</{tag}>\n"
        for i in range(6)
        for j in range(i, 6)
        for tag in [ADDED_MASS_NAMES[i] + ADDED_MASS_NAMES[j]]
    )
    box = f"<geometry><box><size>{numbers(body.box)}</size></box></geometry>"
    at = f"<pose>{numbers(flip * body.r_B)} 0 0 0</pose>"
    return (
        '    <link name="base_link">\n      <inertial>\n'
        f"        <pose>{numbers(flip * centre)} 0 0 0</pose>\n"
        f"        <mass>{number(mass)}</mass>\n"
        f"        <inertia>\n{moments}        </inertia>\n"
        f"        <fluid_added_mass>\n{fluid}        </fluid_added_mass>\n"
        "      </inertial>\n"
        f'      <collision name="displaced_volume">{at}{box}</collision>\n'
        f'      <visual name="visual">{at}{box}</visual>\n    </link>\n'
    )


def _thruster(place: int, thruster: ThrusterFigures) -> str:
    """Return link and joint of one thruster."""
    position = numbers(TO_FLU[:3] * np.array(thruster.position_m))
    axis = numbers(TO_FLU[:3] * np.array(thruster.axis))
    name = f"thruster_{place}"
    small = "".join(f"<{tag}>{THRUSTER_INERTIA}</{tag}>" for tag in ("ixx", "iyy", "izz"))
    return (
        f'    <link name="{name}">\n      <pose relative_to="base_link">{position} 0 0 0</pose>\n'
        f"      <inertial><mass>{THRUSTER_MASS}</mass><inertia>{small}</inertia></inertial>\n"
        f'    </link>\n    <joint name="{name}_joint" type="revolute">\n'
        f"      <parent>base_link</parent><child>{name}</child>\n"
        f"      <axis><xyz>{axis}</xyz></axis>\n    </joint>\n"
    )


def _hydrodynamics(body: Body) -> str:
    """Return the plugin with every coefficient, in FLU."""
    sums: dict[str, float] = {}
    for term in body.terms:
        tag, sign = _tag(term)
        sums[tag] = sums.get(tag, 0.0) + sign * term.value
    lines = "".join(f"      <{tag}>{number(value)}</{tag}>\n" for tag, value in sums.items())
    return (
        '    <plugin filename="gz-sim-hydrodynamics-system"'
        ' name="gz::sim::systems::Hydrodynamics">\n'
        f"      <link_name>base_link</link_name>\n{lines}    </plugin>\n"
    )


def _tag(term: Term) -> tuple[str, float]:
    """Return the name of a term in the plugin and its change of sign to FLU.

    >>> _tag(Term(1, ("v", "|r|"), 1.0, "")), _tag(Term(4, ("u", "w"), 1.0, ""))
    (('yVabsR', np.float64(1.0)), ('mUW', np.float64(1.0)))
    """
    force, upper = _FIELDS[term.axis], [name.upper() for name in VELOCITIES]
    if term.velocity_modulus is not None:
        i, j = term.velocity_modulus
        return f"{force}{upper[i]}abs{upper[j]}", TO_FLU[term.axis] * TO_FLU[i]
    places = term.velocities or ()
    sign = TO_FLU[term.axis] * np.prod(TO_FLU[list(places)])
    return force + "".join(upper[i] for i in places), sign


def _thruster_plugin(place: int, body: Body, name: str) -> str:
    low, high = body.force_limits or (-1000.0, 1000.0)
    return (
        '    <plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">\n'
        f"      <namespace>{name}</namespace>\n"
        f"      <joint_name>thruster_{place}_joint</joint_name>\n"
        f"      <fluid_density>{number(body.water_density)}</fluid_density>\n"
        "      <velocity_control>true</velocity_control>\n"
        f"      <max_thrust_cmd>{number(high)}</max_thrust_cmd>\n"
        f"      <min_thrust_cmd>{number(low)}</min_thrust_cmd>\n    </plugin>\n"
    )


GAZEBO = Target(
    "gazebo",
    "Gazebo Sim: SDF with hydrodynamics, buoyancy, thrusters",
    "x, x|y| and x y of all velocities, full added mass",
    "gazebosim/gz-sim 93bbf3ed1, gazebosim/sdformat 2ace5362",
    export,
)
