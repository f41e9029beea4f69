"""Values for ArduSub's built-in simulator, SIM_Submarine."""

from __future__ import annotations

import math

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.export.body import Body, names_of
from auvid.export.exported import Exported, Request, Target
from auvid.export.losses import Lost, sample_envelope
from auvid.export.text import commented, number, numbers
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force

WATER_DENSITY = 1023.6
"""`water_density` of SIM_Submarine.h [kg/m^3]."""
ANGULAR_DENSITY = 1000.0
"""The density in calculate_angular_drag_torque [kg/m^3]."""
FULL_PULSE_US = 400.0
LEAST_ARM_M = 1e-6
FOAM_FORCE = 40.0
"""`force_up` of calculate_buoyancy_torque [N]."""
CONVENTION = (
    "ArduPilot's body axes: x forward, y starboard, z down; world NED; SI. Drag coefficients are"
    " positive; SIM_BUOYANCY is the net buoyancy in N, positive up."
)
_USAGE = """\
Change the constants that {name}.md lists in `libraries/SITL/SIM_Submarine.h` (and one in
`SIM_Submarine.cpp`), build ArduSub, and start it with the parameters:

```
sim_vehicle.py -v ArduSub {frame}--add-param-file={name}.parm
```

To fly the whole model under ArduSub, let ArduPilot's JSON interface (`--model=JSON`)
talk to a program that integrates the export `python`.
"""
_PAGE = """\
# Constants of SIM_Submarine for {name}

{title}.

{head}

In `libraries/SITL/SIM_Submarine.h`, struct `frame_property`, replace these lines:

```cpp
{rows}
```

`volume`, `mass`, `moment_of_inertia` and `equivalent_sphere_area` follow from them by the
formulas that stand there: {volume} m^3, {mass} kg, {moment} kg m^2, {area} m^2.

In `libraries/SITL/SIM_Submarine.cpp`, `calculate_buoyancy_torque`, the upward force of
{foam:g} N acts at a height over the centre: put {arm} m there, for a righting moment of
{stiffness} N m/rad.

{convention}
"""


def export(request: Request) -> Exported:
    """Return `NAME.parm` and `NAME.md`.

    F_i = -rho A / 2 Cd_i v_i |v_i|, T_i = -1000 A / 2 Ca_i w_i |w_i| r with A = pi / 4 (3
    V / 4)^(2/3), V = 4 pi r^3 / 3: ArduPilot/ardupilot libraries/SITL/SIM_Submarine.cpp,
    calculate_drag_force and calculate_angular_drag_torque, SIM_Submarine.h
    frame_property (stored copies of 2024; the comment there says that the angular units
    are wrong). One mass, one moment of inertia and no added mass: those of the vehicle
    with added mass, in the mean over the axes. Drag is fitted over the flown range.
    """
    body, name = request.body, request.name
    mass = float(np.mean(np.diag(body.mass)[:3]))
    moment = float(np.mean(np.diag(body.mass)[3:]))
    radius = math.sqrt(2.5 * moment / mass)
    volume = 4.0 * math.pi * radius**3 / 3.0
    area = math.pi / 4.0 * (0.75 * volume) ** (2.0 / 3.0)
    drag = _quadratic_drag(body, *sample_envelope(request.model.validity))
    linear = 2.0 * drag[:3] / (WATER_DENSITY * area)
    angular = 2.0 * drag[3:] / (ANGULAR_DENSITY * area * radius)
    heave = sum(term.value for term in body.terms if term.constant and term.axis == 2)
    net = body.buoyancy - body.weight - heave
    stiffness = body.r_G[2] * body.weight - body.r_B[2] * body.buoyancy
    rows = [
        f"float weight = {number(mass)}; // kg, mean of mass + added mass over x, y, z",
        *_thruster_rows(body),
        f"float equivalent_sphere_radius = {number(radius)}; // m, gives the moment of inertia",
        f"float density = {number(mass / volume)}; // kg/m^3, gives the mass",
        f"const Vector3f linear_drag_coefficient = {_vector(linear)}; // fit",
        f"const Vector3f angular_drag_coefficient = {_vector(angular)}; // fit, 1/m",
    ]

    def missing(nu: Array, excess: Array) -> Array:
        constant = np.zeros(6)
        constant[2] = heave  # SIM_BUOYANCY has it
        return body.viscous(nu, excess) + drag * np.abs(nu) * nu - constant

    target_mass = np.diag([mass] * 3 + [moment] * 3)
    turning = np.diag([mass] * 3 + [0.0] * 3)
    lost = (
        Lost(
            f"all but a drag x|x| of each axis ({names_of(body.terms)})",
            "the simulator has one drag coefficient per axis",
            missing,
        ),
        Lost(
            "one mass and one moment of inertia for all axes",
            "the simulator has no added mass and no inertia matrix",
            lambda nu, _: coriolis_force(turning, nu) - coriolis_force(body.mass, nu),
            body.mass - target_mass,
        ),
    )
    parm = commented([f"{name}: {body.title}", *request.head], "#") + (
        f"SIM_BUOYANCY,{number(net)}\n"
    )
    page = _PAGE.format(
        name=name,
        title=body.title,
        head="\n".join(f"- {line}" for line in request.head if line),
        rows="\n".join(rows),
        volume=number(volume),
        mass=number(mass),
        moment=number(moment),
        area=number(area),
        arm=number(stiffness / FOAM_FORCE),
        stiffness=number(stiffness),
        foam=FOAM_FORCE,
        convention=CONVENTION,
    )
    frame = "--model=vectored_6dof " if len(body.thrusters) == 8 else ""
    return Exported(
        {f"{name}.parm": parm, f"{name}.md": page},
        lost,
        CONVENTION,
        _USAGE.format(name=name, frame=frame),
        (
            "Thrusters are those of the frame that ArduSub is started with, with the factor 1 for"
            " every direction (45 degrees give 1 there, not 0.71), one quadratic curve, no"
            " voltage and no lag.",
            "Roll and pitch right themselves with one stiffness.",
        ),
    )


def _quadratic_drag(body: Body, nu: Array, excess: Array) -> Array:
    """Return c (6,) >= 0 so that -c x|x| is nearest to the viscous force."""
    shape = np.abs(nu) * nu
    below = np.sum(shape**2, axis=0)
    fitted = -np.sum(body.viscous(nu, excess) * shape, axis=0)
    factors = np.divide(fitted, below, out=np.zeros(6), where=below > 0.0)
    return np.asarray(np.maximum(factors, 0.0))


def _thruster_rows(body: Body) -> list[str]:
    """Return full thrust, by a fit of f o|o| to the curve, and the mean arm."""
    curve = body.curve
    if curve is None or not body.thrusters:
        return []
    output = (np.array(curve.pulse_us) - NEUTRAL_US) / FULL_PULSE_US
    shape = output * np.abs(output)
    thrust = (
        float(np.sum(np.array(curve.force_N) * shape) / np.sum(shape**2))
        if curve.polynomial is None
        else float(np.polyval(curve.polynomial, 100.0))
    )
    arms = np.abs(np.array([item.effect[3:] for item in body.thrusters]))
    rows = [f"float thrust = {number(thrust)}; // N, full thrust of one thruster, fit to its curve"]
    if np.any(arms > LEAST_ARM_M):
        radius = number(float(arms[arms > LEAST_ARM_M].mean()))
        rows.append(f"float thruster_mount_radius = {radius}; // m, mean moment of 1 N")
    return rows


def _vector(values: Array) -> str:
    return f"Vector3f({numbers(values, ', ')})"


SITL = Target(
    "sitl",
    "ArduSub's built-in simulator: parameters and constants",
    "x|x| of each axis, one mass, one inertia, net buoyancy",
    "ArduPilot/ardupilot libraries/SITL/SIM_Submarine.h and .cpp",
    export,
)
