"""A vehicle class of Fossen's PythonVehicleSimulator."""

from __future__ import annotations

from auvid.export.body import Body
from auvid.export.exported import Exported, Request, Target
from auvid.export.source_code import constants, functions
from auvid.export.text import docstring, number

CONVENTION = (
    "As in PythonVehicleSimulator: body axes x forward, y starboard, z down; world NED; eta = [x y"
    " z phi theta psi]; moments about the body origin (CO); SI and radians, but the constructor"
    " takes the direction of the current in degrees, as its vehicles do. Damping has negative"
    " coefficients on the right-hand side; ADDED_MASS has derivatives, self.MA is positive."
)
_CLASS = '''


class {name}:
    """{title}.

    {name}("stepInput", force, V_current, beta_current): surge force [N] after 5 s;
    current [m/s] towards beta_current [deg].
    """

    def __init__(self, controlSystem="stepInput", r=0.0, V_current=0.0, beta_current=0.0):
        self.controlMode = "stepInput"
        self.controlDescription = "Step inputs"
        self.ref = r
        self.V_c = V_current
        self.beta_c = math.radians(beta_current)
        self.name = "{title} (auvid)"
        self.L = {length}
        self.B = {beam}
        self.g = GRAVITY
        self.rho = WATER_DENSITY
        self.controls = [{controls}]
        self.dimU = len(self.controls)
        self.nu = np.zeros(6)
        self.u_actual = np.zeros(self.dimU)
        self.MRB = np.array(RIGID_BODY)
        self.MA = -np.array(ADDED_MASS)
        self.M = np.array(MASS)
        self.Minv = np.array(MASS_INVERSE)
        self.W = WEIGHT
        self.T_n = ACTUATOR_LAG

    def dynamics(self, eta, nu, u_actual, u_control, sampleTime):
        """Return [nu, u_actual] one step later, by Euler's method."""
        nu, u_actual = np.asarray(nu, float), np.asarray(u_actual, float)
        u_control = np.asarray(u_control, float)
        if self.T_n == 0.0:
            u_actual = u_control
        towards = self.beta_c - eta[5]
        u_c, v_c = self.V_c * math.cos(towards), self.V_c * math.sin(towards)
        nu_r = nu - np.array([u_c, v_c, 0, 0, 0, 0])
        current_rate = np.array([nu[5] * v_c, -nu[5] * u_c, 0, 0, 0, 0])
        nu_dot = current_rate + np.array(derivative(nu_r, eta, u_actual))
        if self.T_n > 0.0:
            u_actual = u_actual + sampleTime * (u_control - u_actual) / self.T_n
        return nu + sampleTime * nu_dot, u_actual

    def stepInput(self, t):
        """Return no force until 5 s, the reference in surge afterwards."""
        return np.array([self.ref if t > 5.0 else 0.0, 0, 0, 0, 0, 0])
'''
_USAGE = """\
Put `{name}.py` beside your script, with PythonVehicleSimulator installed:

```python
from python_vehicle_simulator.lib import simulate
from {name} import {name}

vehicle = {name}("stepInput", 5.0)
simTime, simData = simulate(1000, 0.02, vehicle)
```

The six controls are force and moment [N, N m] of all actuators in body axes.{actuators}
"""
CONTROLS = (
    "Surge force (N)",
    "Sway force (N)",
    "Heave force (N)",
    "Roll moment (N m)",
    "Pitch moment (N m)",
    "Yaw moment (N m)",
)


def export(request: Request) -> Exported:
    """Return `NAME.py` with a class NAME: `dynamics(eta, nu, u_actual, u_control, h)`.

    nu+ = nu + h (D_nu_c + M^-1 (tau_U + tau_viscous(nu_r) + tau_G - C(nu_r) nu_r)) as
    otter.dynamics: cybergalactic/PythonVehicleSimulator
    src/python_vehicle_simulator/vehicles/otter.py (c717e07), `simulate` in
    lib/mainLoop.py. Nothing is lost; the file needs numpy alone.
    """
    body, name = request.body, request.name
    title = body.title.replace('"', "'").replace("\\", "/")
    head = "\n".join([f"Model {name}: {title}.", "", *request.head, "", CONVENTION])
    text = (
        f'"""{docstring(head)}'
        + f'\n"""\n\nimport math\n\nimport numpy as np\n\n{constants(body)}\n\n{functions(body)}'
        + _CLASS.format(
            name=name,
            title=title,
            length=number(body.box[0]),
            beam=number(body.box[1]),
            controls=", ".join(f'"{item}"' for item in CONTROLS),
        )
    )
    return Exported(
        {f"{name}.py": text},
        (),
        CONVENTION,
        _USAGE.format(name=name, actuators=_actuators(body)),
        ("It integrates by Euler's method, as all vehicles of this simulator: keep steps short.",),
    )


def _actuators(body: Body) -> str:
    """Return which functions of the file give the force of actuators."""
    names = []
    if body.thrusters:
        names.append(
            "`thrust` gives the newtons of a thruster, and `thruster_force` takes those of all"
        )
    if body.fins is not None:
        names.append("`fin_force` from fins")
    if body.propeller is not None:
        names.append("`propeller_force` from the propeller")
    return f" In the file, {', '.join(names)}." if names else ""


PVS = Target(
    "pvs",
    "a vehicle class of PythonVehicleSimulator",
    "all",
    "cybergalactic/PythonVehicleSimulator c717e07",
    export,
)
