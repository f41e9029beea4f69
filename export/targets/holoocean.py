"""An agent of HoloOcean with Fossen's dynamics of a torpedo, fitted to the model."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from auvid.export.body import Body
from auvid.export.exported import Exported, Request, Target
from auvid.export.losses import Lost, judged_axes, sample_envelope
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.mechanics.kinematics import skew
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force, rigid_body_matrix
from auvid.hydro.dynamics.vehicle.from_document import geometry_from_entry

GRAVITY = 9.81
"""Gravity in torpedo.py [m/s^2]."""
DENSITY = 1026.0
"""Density in crossFlowDrag and forceLiftDrag, whatever `rho` says [kg/m^3]."""
STRIPS = 20
AREA_FRACTION = 0.7
HOERNER = (0.4933, 1.2108), (0.5585, 1.0836)
"""Points (B / 2T, C_D) of helper_functions.py on both sides of a round body's 0.5."""
ROLL_FACTOR = 0.3
NEVER_S = 1e9
"""Time constant in place of no damping [s]."""
LEAST = 1e-9
CONVENTION = (
    "r_bg and r_bb are in auvid's axes, x forward, y starboard, z down, from the body origin (CO);"
    " HoloOcean turns its own north-west-up world over by itself. Time constants in s, damping"
    " ratios and drag coefficients without unit."
)
_USAGE = """\
Put the agent of `{name}.json` into the list `agents` of a scenario, and let the Fossen
interface give its accelerations:

```python
import json
import holoocean
from holoocean.fossen_dynamics.fossen_interface import FossenInterface

agent = json.load(open("{name}.json"))
scenario = {{"name": "{name}", "package_name": "Ocean", "world": "OpenWater",
            "main_agent": agent["agent_name"], "ticks_per_sec": 50, "agents": [agent]}}
vehicle = FossenInterface([agent["agent_name"]], scenario)
```

HoloOcean has no class of dynamics for open frames: this is the nearest torpedo. For the
whole model use its custom dynamics (control scheme 1) with the export `python`.
"""


@dataclass(frozen=True)
class Torpedo:
    """Fossen's torpedo as HoloOcean computes it, but for its damping."""

    length: float
    diameter: float
    mass_kg: float
    r_bg: Array
    r_bb: Array

    @property
    def area(self) -> float:
        """Return S [m^2]."""
        return AREA_FRACTION * self.length * self.diameter

    @property
    def rigid_body(self) -> Array:
        """Return M_RB (6, 6) of a spheroid about the origin."""
        a, b, m = self.length / 2.0, self.diameter / 2.0, self.mass_kg
        turning = m * (a * a + b * b) / 5.0
        across = skew(self.r_bg)
        about_G = np.diag([0.4 * m * b * b, turning, turning])
        return rigid_body_matrix(m, self.r_bg, about_G - m * across @ across)

    @property
    def added_mass(self) -> Array:
        """Return M_A > 0 (6, 6) by Lamb's factors."""
        a, b, m = self.length / 2.0, self.diameter / 2.0, self.mass_kg
        e = math.sqrt(1.0 - (b / a) ** 2)
        log = math.log((1.0 + e) / (1.0 - e))
        alpha = 2.0 * (1.0 - e**2) / e**3 * (0.5 * log - e)
        beta = 1.0 / e**2 - (1.0 - e**2) / (2.0 * e**3) * log
        k1, k2 = alpha / (2.0 - alpha), beta / (2.0 - beta)
        below = (2.0 - e**2) * (2.0 * e**2 - (2.0 - e**2) * (beta - alpha))
        yaw = e**4 * (beta - alpha) / below * m * (a * a + b * b) / 5.0
        return np.diag([m * k1, m * k2, m * k2, ROLL_FACTOR * 0.4 * m * b * b, yaw, yaw])

    @property
    def natural_frequencies(self) -> tuple[float, float]:
        """Return w_roll and w_pitch [rad/s]."""
        M = self.rigid_body + self.added_mass
        stiffness = self.mass_kg * GRAVITY * max(self.r_bg[2] - self.r_bb[2], LEAST)
        return math.sqrt(stiffness / M[3, 3]), math.sqrt(stiffness / M[4, 4])

    def coriolis(self, nu: Array) -> Array:
        """Return C nu (n, 6) [N, N m], without what the class sets to 0.

        C_A = [[0, -S(a)], [-S(a), -S(b)]] less its entries (4, 0), (0, 4), (4, 2), (2, 4),
        (5, 0), (0, 5), (5, 1), (1, 5), counted from 0.
        """
        a, b = np.hsplit(np.diag(self.added_mass) * nu, 2)
        v, w, p, q, r = nu[:, 1:].T
        added = [
            np.zeros(len(nu)),
            -a[:, 2] * p,
            a[:, 1] * p,
            a[:, 2] * v - a[:, 1] * w + b[:, 2] * q - b[:, 1] * r,
            b[:, 0] * r - b[:, 2] * p,
            b[:, 1] * p - b[:, 0] * q,
        ]
        return np.asarray(coriolis_force(self.rigid_body, nu) + np.stack(added, axis=-1))

    def fixed_force(self, nu: Array) -> Array:
        """Return cross-flow drag and lift (n, 6), which geometry alone gives."""
        v, r = nu[:, 1], nu[:, 5]
        (x0, y0), (x1, y1) = HOERNER
        drag = 0.5 * DENSITY * self.diameter * (y0 + (0.5 - x0) / (x1 - x0) * (y1 - y0))
        tau, step = np.zeros(nu.shape), self.length / STRIPS
        for place in range(STRIPS + 1):
            x = place * step - self.length / 2.0
            flow = np.abs(v + x * r) * (v + x * r) * step
            tau[:, 1] -= drag * flow
            tau[:, 5] -= drag * x * flow
        alpha, pressure, slope = self._attack(nu)
        lift = pressure * slope * alpha
        tau[:, 0] += np.sin(alpha) * lift
        tau[:, 2] -= np.cos(alpha) * lift
        return tau

    def columns(self, nu: Array) -> Array:
        """Return the damping (n, 6, 7) per free factor.

        1/T_surge, 1/T_sway, zeta_roll, zeta_pitch, 1/T_yaw, CD_0, 1/e.
        """
        M = np.diag(self.rigid_body + self.added_mass)
        roll, pitch = self.natural_frequencies
        fading = np.exp(-3.0 * np.linalg.norm(nu[:, :3], axis=1))
        alpha, pressure, slope = self._attack(nu)
        out = np.zeros((*nu.shape, 7))
        out[:, 0, 0] = -M[0] * fading * nu[:, 0]
        out[:, 1, 1] = -M[1] * fading * nu[:, 1]
        out[:, 2, 1] = -M[2] * nu[:, 2]
        out[:, 3, 2] = -2.0 * M[3] * roll * nu[:, 3]
        out[:, 4, 3] = -2.0 * M[4] * pitch * nu[:, 4]
        out[:, 5, 4] = -M[5] * nu[:, 5]
        induced = (slope * alpha) ** 2 / (math.pi * self.diameter**2 / self.area)
        for place, size in ((5, pressure), (6, pressure * induced)):
            out[:, 0, place] = -np.cos(alpha) * size
            out[:, 2, place] = -np.sin(alpha) * size
        return out

    def _attack(self, nu: Array) -> tuple[Array, Array, float]:
        """Return angle of attack, rho U^2 S / 2 and the slope of lift."""
        alpha = np.arctan2(nu[:, 2], nu[:, 0])
        pressure = 0.5 * DENSITY * np.sum(nu[:, :3] ** 2, axis=1) * self.area
        ratio = self.diameter**2 / self.area
        return alpha, pressure, math.pi * ratio / (1.0 + math.sqrt(1.0 + (ratio / 2.0) ** 2))


def export(request: Request) -> Exported:
    """Return `NAME.json`, an agent with `fossen_model` torpedo and its `dynamics`.

    M nu_dot = tau_liftdrag + tau_crossflow - (C + D) nu - g: HoloOcean 2.3
    holoocean/fossen_dynamics/torpedo.py `dynamics` and `set_torpedo_parameters`,
    helper_functions.py `forceLiftDrag`, `crossFlowDrag` (stored copies of
    byu-holoocean/HoloOcean), keys as in `configure_torpedo_from_scenario`. Length and
    diameter are the hull's, else those of the spheroid with the inertia of the vehicle;
    time constants, damping ratios, Cd and e are fitted over the flown range.
    """
    body, model, name = request.body, request.model, request.name
    torpedo = _torpedo(request)
    nu, excess = sample_envelope(model.validity)
    factors = _fit(torpedo, body, nu, excess, judged_axes(model.use.axes))
    roll_pitch = factors[2:4]
    dynamics = {
        "rho": body.water_density,
        "mass": torpedo.mass_kg,
        "length": torpedo.length,
        "diam": torpedo.diameter,
        "r_bg": torpedo.r_bg.tolist(),
        "r_bb": torpedo.r_bb.tolist(),
        "area_fraction": AREA_FRACTION,
        "T_surge": _time_constant(factors[0]),
        "T_sway": _time_constant(factors[1]),
        "zeta_roll": float(roll_pitch[0]),
        "zeta_pitch": float(roll_pitch[1]),
        "T_yaw": _time_constant(factors[4]),
        "K_nomoto": 0.25,
        "r44": ROLL_FACTOR,
        "Cd": float(factors[5] * torpedo.area / (math.pi * (torpedo.diameter / 2.0) ** 2)),
        "e": float(1.0 / max(factors[6], LEAST)),
    }
    agent = {
        "agent_name": name,
        "agent_type": "TorpedoAUV",
        "sensors": [
            {
                "sensor_type": "DynamicsSensor",
                "configuration": {"UseCOM": True, "UseRPY": False},
            }
        ],
        "control_scheme": 1,
        "fossen_model": "torpedo",
        "control_mode": "manualControl",
        "location": [0, 0, -10],
        "rotation": [0, 0, 0],
        "dynamics": dynamics,
    }
    target_mass = torpedo.rigid_body + torpedo.added_mass
    lost = (
        Lost(
            "viscous force against the fit of a torpedo's damping",
            "cross-flow drag and lift follow from length and diameter, 7 factors are free",
            lambda nu, excess: (
                body.viscous(nu, excess) - torpedo.fixed_force(nu) - torpedo.columns(nu) @ factors
            ),
        ),
        Lost(
            "inertia and added mass against a spheroid's",
            "the class has those of a spheroid, and drops the Munk moment",
            lambda nu, _: torpedo.coriolis(nu) - coriolis_force(body.mass, nu),
            body.mass - target_mass,
        ),
    )
    text = json.dumps({"auvid": list(request.head), **agent}, indent=2)
    notes = [
        "Weight and buoyancy are equal there: a net buoyancy is left out.",
        "Thrusters, fins and propeller are HoloOcean's own (key `actuator`).",
    ]
    return Exported(
        {f"{name}.json": text + "\n"}, lost, CONVENTION, _USAGE.format(name=name), tuple(notes)
    )


def _torpedo(request: Request) -> Torpedo:
    """Return the torpedo with the hull of the vehicle, or with its inertia."""
    body, geometry = request.body, request.model.vehicle.geometry
    if geometry is not None:
        hull = geometry_from_entry(geometry).hull
        length, diameter = hull.nose_x_m - hull.tail_x_m, hull.diameter_m
    else:
        moments = np.diag(body.inertia_about_G) / body.mass_kg
        half = math.sqrt(2.5 * moments[0])
        square = 2.5 * (moments[1] + moments[2]) - half**2
        length, diameter = 2.0 * math.sqrt(max(square, (1.001 * half) ** 2)), 2.0 * half
    return Torpedo(length, diameter, body.mass_kg, body.r_G, body.r_B)


def _fit(torpedo: Torpedo, body: Body, nu: Array, excess: Array, judged: tuple[str, ...]) -> Array:
    """Return the free factors (7,) >= 0 nearest to the viscous force on judged axes."""
    viscous = body.viscous(nu, excess)
    size = np.sqrt(np.mean(viscous**2, axis=0))
    axes = [i for i in range(6) if AXES[i] in judged and size[i] > 0.0]
    if not axes:
        return np.zeros(7)
    columns = torpedo.columns(nu)[:, axes, :] / size[axes][:, None]
    rest = (viscous - torpedo.fixed_force(nu))[:, axes] / size[axes]
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=(0, 1))), LEAST)
    solution, _ = nnls((columns / scale).reshape(-1, 7), rest.ravel())
    return np.asarray(solution / scale)


def _time_constant(rate: float) -> float:
    return float(min(1.0 / rate, NEVER_S)) if rate > 0.0 else NEVER_S


HOLOOCEAN = Target(
    "holoocean",
    "an agent of HoloOcean with Fossen's torpedo, fitted",
    "seven damping factors of a spheroid",
    "HoloOcean 2.3 holoocean/fossen_dynamics",
    export,
)
