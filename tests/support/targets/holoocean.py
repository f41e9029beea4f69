"""Evaluator of a HoloOcean agent: the torpedo of fossen_dynamics from its dynamics dictionary.

Read from the client of HoloOcean 2.2.0 as DPRIcky/holoocean-multiagent-control ee6cdf1 holds
it, client/src/holoocean/fossen_dynamics: torpedo.py (class Torpedo, 189 inertia, 249
dynamics, 674 dictionary) and helper_functions.py (crossFlowDrag, forceLiftDrag, gvect).
Frames FRD and NED; fins and propeller at rest. Release 2.0.0 differed: half the span, six
entries of C_A.
"""

import json
from pathlib import Path

import numpy as np

from tests.support.targets.frames import Array, Body, coriolis, down, push, rigid_body, skew

GRAVITY = 9.81
"""torpedo.py:682."""

DEFAULTS = {
    "rho": 1026.0,
    "mass": 31.03,
    "length": 1.6,
    "diam": 0.19,
    "r_bg": [0.0, 0.0, 0.02],
    "r_bb": [0.0, 0.0, 0.0],
    "area_fraction": 0.7,
    "T_surge": 20.0,
    "T_sway": 20.0,
    "zeta_roll": 0.3,
    "zeta_pitch": 0.8,
    "T_yaw": 1.0,
    "r44": 0.3,
    "Cd": 0.42,
    "e": 0.7,
}
"""configure_torpedo_from_scenario, dynamics_parameters: REMUS 100."""

OWN_DENSITY, STRIPS = 1026.0, 20
"""crossFlowDrag and forceLiftDrag have a density of their own; strips of the former."""

HOERNER = (
    [0.0109, 0.1766, 0.3530, 0.4519, 0.4728, 0.4929, 0.4933, 0.5585, 0.6464, 0.8336],
    [1.9661, 1.9657, 1.8976, 1.7872, 1.5837, 1.2786, 1.2108, 1.0836, 0.9986, 0.8796],
)
"""Hoerner: cross-flow coefficient over beam to twice the draught, up to 0.83; here at 0.5."""


def load(folder: Path, name: str) -> Body:
    """Return the body of the agent with a dynamics dictionary in folder/NAME.json."""
    return parse(json.loads((folder / f"{name}.json").read_text()))


def parse(document: dict[str, object]) -> Body:
    """Return the body of an agent, or of a scenario's first agent."""
    agents = document.get("agents")
    agent = agents[0] if isinstance(agents, list) else document
    p = {**DEFAULTS, **agent.get("dynamics", {})}
    mass, a, b = p["mass"], p["length"] / 2, p["diam"] / 2
    centre, buoy = np.array(p["r_bg"], float), np.array(p["r_bb"], float)

    # inertia of a spheroid, added mass by Lamb's factors: calculate_additional_parameters
    roll, pitch = 0.4 * mass * b**2, 0.2 * mass * (a**2 + b**2)
    body = rigid_body(mass, centre, np.diag([roll, pitch, pitch]))
    e = np.sqrt(1 - (b / a) ** 2)
    log = np.log((1 + e) / (1 - e))
    alpha = 2 * (1 - e**2) / e**3 * (log / 2 - e)
    beta = 1 / e**2 - (1 - e**2) / (2 * e**3) * log
    k1, k2 = alpha / (2 - alpha), beta / (2 - beta)
    gap = beta - alpha
    k3 = e**4 * gap / ((2 - e**2) * (2 * e**2 - (2 - e**2) * gap))
    added = np.array([mass * k1, mass * k2, mass * k2, p["r44"] * roll, k3 * pitch, k3 * pitch])
    inertia = body + np.diag(added)

    weight = mass * GRAVITY  # buoyancy is set equal to it
    stiff = weight * (centre[2] - buoy[2])
    if stiff < 0:
        raise ValueError("math domain error")  # that of math.sqrt in torpedo.py:229
    swing = np.sqrt(stiff / np.diag(inertia)[3:5])
    area = p["area_fraction"] * p["length"] * p["diam"]
    drag0 = p["Cd"] * np.pi * b**2 / area
    aspect = p["diam"] ** 2 / area
    slope = np.pi * aspect / (1 + np.sqrt(1 + (aspect / 2) ** 2))
    strip = 0.5 * OWN_DENSITY * p["diam"] * np.interp(0.5, *HOERNER) * p["length"] / STRIPS
    places = np.linspace(-a, a, STRIPS + 1)

    def force(nu: Array, eta: Array) -> Array:
        u, v, w, r = nu[:, 0], nu[:, 1], nu[:, 2], nu[:, 5]
        speed = np.linalg.norm(nu[:, :3], axis=1)

        # C_A without eight of its entries, rows and columns counted from 0: torpedo.py:272
        momentum = skew(nu[:, :3] * added[:3]), skew(nu[:, 3:] * added[3:])
        c = np.zeros((len(nu), 6, 6))
        c[:, :3, 3:] = c[:, 3:, :3] = -momentum[0]
        c[:, 3:, 3:] = -momentum[1]
        for row, column in ((4, 0), (4, 2), (5, 0), (5, 1)):
            c[:, row, column] = c[:, column, row] = 0.0
        wrench = -np.einsum("nij,nj->ni", c, nu) - coriolis(body, nu)

        fade = np.exp(-3 * speed)
        damping = np.diag(inertia) / np.array(
            [p["T_surge"], p["T_sway"], p["T_sway"], 1.0, 1.0, p["T_yaw"]]
        )
        damping[3:5] *= 2 * np.array([p["zeta_roll"], p["zeta_pitch"]]) * swing
        wrench -= damping * nu * np.stack([fade, fade, *np.ones((4, len(nu)))], 1)

        # lift and drag along the flow: forceLiftDrag
        attack = np.arctan2(w, u)
        lift = slope * attack
        drag = drag0 + lift**2 / (np.pi * p["e"] * aspect)
        scale = 0.5 * OWN_DENSITY * speed**2 * area
        wrench[:, 0] += scale * (-drag * np.cos(attack) + lift * np.sin(attack))
        wrench[:, 2] += scale * (-drag * np.sin(attack) - lift * np.cos(attack))

        # cross flow in sway and yaw: crossFlowDrag
        across = v[:, None] + places * r[:, None]
        loads = -strip * across * np.abs(across)
        wrench[:, 1] += loads.sum(1)
        wrench[:, 5] += loads @ places

        lower = weight * down(eta)
        return wrench + push(centre, lower) - push(buoy, lower)

    return Body(inertia, force)
