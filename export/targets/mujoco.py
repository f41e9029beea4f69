"""An MJCF model for MuJoCo, with a callback for what MJCF cannot hold."""

from __future__ import annotations

import numpy as np

from auvid.export.body import TO_FLU
from auvid.export.exported import Exported, Request, Target
from auvid.export.source_code import constants, functions
from auvid.export.text import docstring, number, numbers, xml_comment

CONVENTION = (
    "Body `{name}`: axes x forward, y port, z up (FLU) in a world with z up; its origin is the"
    " body origin of the vehicle file. Against auvid's forward-starboard-down axes y, z, q, r"
    " change sign: the callback turns them over and back, its coefficients are auvid's own."
    " qvel[0:3] is the velocity of the origin in world axes, qvel[3:6] the angular velocity in"
    " body axes, as MuJoCo has them for a free joint; SI and radians."
)
_CALLBACK = '''\
BODY = "{name}"
FLU = (1.0, -1.0, -1.0, 1.0, -1.0, -1.0)


def install():
    """Let MuJoCo apply the forces of the water in every step (for all its models)."""
    mujoco.set_mjcb_passive(apply)


def motion(model, data):
    """Return nu and eta of the vehicle in forward-starboard-down axes and NED."""
    place = model.joint(BODY).dofadr[0]
    rotation = [data.xmat[model.body(BODY).id][3 * i : 3 * i + 3] for i in range(3)]
    world = data.qvel[place : place + 3]
    linear = [sum(rotation[j][i] * world[j] for j in range(3)) for i in range(3)]
    nu = [s * float(x) for s, x in zip(FLU, [*linear, *data.qvel[place + 3 : place + 6]])]
    phi = math.atan2(rotation[2][1], rotation[2][2])
    theta = math.asin(max(-1.0, min(1.0, float(rotation[2][0]))))
    psi = -math.atan2(rotation[1][0], rotation[0][0])
    position = data.xpos[model.body(BODY).id]
    return nu, [position[0], -position[1], -position[2], phi, theta, psi], rotation


def apply(model, data):
    """Add the forces of the water to data.qfrc_passive.

    The water has added mass, so that its force depends on the acceleration: with M = M_RB -
    M_A, nu_dot = M^-1 (force + tau) is what the vehicle does, and M_RB nu_dot +
    C_RB(nu) nu less gravity and less tau what MuJoCo has to be told. tau is what actuators,
    xfrc_applied and qfrc_applied give; contacts are not in it, they meet the dry mass.
    """
    nu, eta, rotation = motion(model, data)
    tau = external_force(model, data, rotation)
    nu_dot = derivative(nu, eta, tau)
    needed = [a + b for a, b in zip(product(RIGID_BODY, nu_dot), coriolis(nu, RIGID_BODY))]
    pull = [FLU[i] * MASS_KG * model.opt.gravity[2] * rotation[2][i] for i in range(3)]
    x, y, z = CENTRE_OF_GRAVITY
    pull += [y * pull[2] - z * pull[1], z * pull[0] - x * pull[2], x * pull[1] - y * pull[0]]
    water = [a - b - c for a, b, c in zip(needed, pull, tau)]
    add(model, data, [s * value for s, value in zip(FLU, water)], rotation)


def add(model, data, flu, rotation):
    """Add a force at the body origin, in FLU, to data.qfrc_passive."""
    place = model.joint(BODY).dofadr[0]
    for i in range(3):
        data.qfrc_passive[place + i] += sum(rotation[i][j] * flu[j] for j in range(3))
        data.qfrc_passive[place + 3 + i] += flu[3 + i]


def external_force(model, data, rotation):
    """Return the force of actuators and of applied forces, forward-starboard-down."""
    tau = [0.0] * 6
    for number, effect in enumerate(THRUSTER_EFFECTS):
        actuator = model.actuator("%s_thruster_%d" % (BODY, number + 1)).id
        low, high = model.actuator_ctrlrange[actuator]
        f = min(max(float(data.ctrl[actuator]), low), high)
        tau = [a + f * b for a, b in zip(tau, effect)]
    place, body = model.joint(BODY).dofadr[0], model.body(BODY).id
    world = [data.qfrc_applied[place + i] + data.xfrc_applied[body][i] for i in range(3)]
    flu = [sum(rotation[j][i] * world[j] for j in range(3)) for i in range(3)]
    turn = data.xfrc_applied[body][3:6]
    push = data.xfrc_applied[body][:3]
    moment = [sum(rotation[j][i] * turn[j] for j in range(3)) for i in range(3)]
    force = [sum(rotation[j][i] * push[j] for j in range(3)) for i in range(3)]
    x, y, z = CENTRE_OF_GRAVITY[0], -CENTRE_OF_GRAVITY[1], -CENTRE_OF_GRAVITY[2]
    moment[0] += y * force[2] - z * force[1]
    moment[1] += z * force[0] - x * force[2]
    moment[2] += x * force[1] - y * force[0]
    flu += [data.qfrc_applied[place + 3 + i] + moment[i] for i in range(3)]
    return [a + s * float(b) for a, s, b in zip(tau, FLU, flu)]
'''
_USAGE = """\
```python
import mujoco
import {name}_forces

model = mujoco.MjModel.from_xml_path("{name}.xml")
data = mujoco.MjData(model)
{name}_forces.install()
{control}mujoco.mj_step(model, data)
```

Load the model first: MuJoCo cannot call Python while it compiles one. Its own fluid
forces stay off (density and viscosity 0). Without the callback the vehicle falls:
weight, buoyancy, added mass and damping come from it.
"""


def export(request: Request) -> Exported:
    """Return `NAME.xml` and `NAME_forces.py`.

    MJCF's fluid model has one box or ellipsoid per body with five coefficients:
    google-deepmind/mujoco doc/computation/fluid.rst (a7255075b), so all forces of the
    water come from mjcb_passive (doc/APIreference/APIglobals.rst); nothing is lost but
    added mass in contacts.
    """
    body, name = request.body, request.name
    convention = CONVENTION.format(name=name)
    flip = TO_FLU[:3]
    inertia = body.inertia_about_G * np.outer(flip, flip)
    full = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    low, high = body.force_limits or (0.0, 0.0)
    motors = "".join(
        f'    <motor name="{name}_thruster_{i + 1}" site="{name}_origin"'
        f' gear="{numbers(TO_FLU * np.array(item.effect))}" ctrllimited="true"'
        f' ctrlrange="{number(low)} {number(high)}"/>\n'
        for i, item in enumerate(body.thrusters)
    )
    xml = (
        xml_comment([f"Model {name}: {body.title}.", *request.head, convention])
        + f'<mujoco model="{name}">\n'
        '  <compiler angle="radian" inertiafromgeom="false"/>\n'
        f'  <option timestep="0.01" integrator="RK4" gravity="0 0 -{number(body.gravity)}"/>\n'
        "  <worldbody>\n"
        f'    <body name="{name}">\n      <freejoint name="{name}"/>\n'
        f'      <inertial pos="{numbers(flip * body.r_G)}" mass="{number(body.mass_kg)}"'
        f' fullinertia="{numbers(full)}"/>\n'
        f'      <site name="{name}_origin"/>\n'
        f'      <geom type="box" pos="{numbers(flip * body.r_B)}" size="{numbers(body.box / 2)}"'
        ' mass="0" contype="0" conaffinity="0"/>\n'
        "    </body>\n  </worldbody>\n"
        + (f"  <actuator>\n{motors}  </actuator>\n" if motors else "")
        + "</mujoco>\n"
    )
    head = "\n".join([f"Forces of the water on {name}: {body.title}.", "", *request.head])
    python = (
        f'"""{docstring(f"{head}{chr(10) * 2}{convention}")}'
        + f'\n"""\n\nimport math\n\nimport mujoco\n\n{constants(body)}'
        + f"{_CALLBACK.format(name=name)}\n\n{functions(body)}"
    )
    notes = ["Contacts and constraints meet the dry mass: added mass is not in them."]
    if body.thrusters:
        notes.append(
            "Thrusters take forces: the curve of force over pulse width and the voltage are"
            f" functions of {name}_forces.py."
        )
    if body.fins is not None or body.propeller is not None:
        notes.append(
            f"Fins and propeller have functions in {name}_forces.py; apply their force by"
            " qfrc_applied."
        )
    if body.lag_s:
        notes.append(f"The lag of the actuators, {body.lag_s:.3g} s, is left out.")
    control = "data.ctrl[:] = 1.0  # force of every thruster [N]\n" if motors else ""
    return Exported(
        {f"{name}.xml": xml, f"{name}_forces.py": python},
        (),
        convention,
        _USAGE.format(name=name, control=control),
        tuple(notes),
    )


MUJOCO = Target(
    "mujoco",
    "MuJoCo: MJCF and a callback",
    "all but added mass in contacts",
    "google-deepmind/mujoco a7255075b",
    export,
)
