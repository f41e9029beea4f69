"""A model file flown by an integrator that knows nothing but the file."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp

from auvid.hydro.arrays import Array

AXES, VELOCITIES = "XYZKMN", "uvwpqr"


def flown_by_file(text: str, t_s: Array, commands: Mapping[str, Array], nu: Array) -> Array:
    """Return velocities (n, 6) by the equation that a model file (JSON) states.

    commands: axis -> full commands (n,), linear between; forces start where they call for.
    """
    file = json.loads(text)
    figures, part = file["dynamics"], file["partial"]
    places = [AXES.index(axis) for axis in AXES if axis in part["axes"]]
    mass = np.array(figures["mass"])
    own = np.linalg.inv(mass[np.ix_(places, places)])
    lag = np.array([part["axes"][AXES[place]]["lag_s"] for place in places])
    turning = "together" not in part or part["together"]["chosen"]
    gains = {item["axis"]: item for item in part["gains"]}

    def force(place: int, at: float) -> float:
        item = gains.get(AXES[place])
        if item is None or AXES[place] not in commands:
            return 0.0
        x = float(np.interp(at, t_s, commands[AXES[place]]))
        beyond = max(abs(x) - item["dead_band"], 0.0) / (1.0 - item["dead_band"])
        return float(item["value"] * np.sign(x) * beyond ** item["curve"])

    def rate(at: float, state: Array) -> Array:
        nu, late = state[:6], state[6:]
        factors = dict(zip(VELOCITIES, nu, strict=True))
        factors |= {f"|{name}|": abs(value) for name, value in factors.items()}
        tau = np.zeros(6)
        for item in file["coefficients"]:
            product = np.prod([factors[name] for name in item["factors"]])
            tau[AXES.index(item["axis"])] += item["predictor"] * product
        tau[2] += figures["weight_N"] - figures["buoyancy_N"]  # level
        tau[places] += late
        if turning:
            momentum, omega = mass @ nu, nu[3:]
            tau[:3] -= np.cross(omega, momentum[:3])
            tau[3:] -= np.cross(nu[:3], momentum[:3]) + np.cross(omega, momentum[3:])
        change = np.zeros(6)
        change[places] = own @ tau[places]
        target = np.array([force(place, at) for place in places])
        return np.concatenate([change, (target - late) / lag])

    start = np.concatenate([nu, [force(place, t_s[0]) for place in places]])
    span, options = (float(t_s[0]), float(t_s[-1])), {"rtol": 1e-6, "atol": 1e-8}
    flown = solve_ivp(rate, span, start, t_eval=t_s, max_step=0.1, **options)
    return np.asarray(flown.y[:6].T)
