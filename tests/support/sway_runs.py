"""Sway of a vehicle with thrusters alone: a linear system with a solution by matrices.

m v_dot = Y v + F + f, F linear between samples, f first-order Gauss-Markov. Independent
of the product: transitions by `scipy.linalg.expm`, likelihood as one joint normal.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor
from auvid.hydro.identification.maximum_likelihood.records import (
    ActuatorRecord,
    LegRecord,
    SensorGeometry,
    SensorRecord,
)

Array = npt.NDArray[np.float64]
ROOT = Path(__file__).parents[2]
VEHICLE = vehicle_from_document(
    read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text(encoding="utf-8"))
)
MASS = float(VEHICLE.mass_matrix[1, 1])
ORIGIN = MountedSensor(np.zeros(3), np.eye(3), 0.0)
GEOMETRY = SensorGeometry(ORIGIN, ORIGIN, ORIGIN, VEHICLE.gravity)
STEP_S = 0.02


def square_wave(n: int, size: float = 10.0) -> Array:
    """A thrust in sway [N] that changes sign every 1.5 s, with ramps of one step."""
    return size * np.sign(np.sin(np.pi * np.arange(n) * STEP_S / 1.5 + 0.1))


def simulate(damping: float, thrust: Array, start: float, unsteady: Array | None = None) -> Array:
    """Exact sway velocity (n,) of the linear system."""
    a = damping / MASS
    # Augmented with the force and its slope, which is constant within a step.
    step = expm(np.array([[a, 1 / MASS, 0], [0, 0, 1], [0, 0, 0]]) * STEP_S)
    total = thrust if unsteady is None else thrust + unsteady
    v = np.empty(len(thrust))
    v[0] = start
    for i in range(len(thrust) - 1):
        slope = (total[i + 1] - total[i]) / STEP_S
        v[i + 1] = (step @ [v[i], total[i], slope])[0]
    return v


def sway_leg(velocity: Array, thrust: Array, *, every: int = 1, name: str = "run") -> LegRecord:
    """A leg whose only sensor measures sway at every `every`-th step."""
    n = len(thrust)
    t = np.arange(n) * STEP_S
    values = np.full((n, 3), np.nan)
    values[:, 1] = velocity
    force = np.zeros((n, 6))
    force[:, 1] = thrust
    record = SensorRecord(t[::every], values[::every], np.array([np.nan, 0.01, np.nan]))
    return LegRecord(name, {"velocity": record}, ActuatorRecord(t, force=force), GEOMETRY)


def joint_log_likelihood(
    damping: float, thrust: Array, measured: Array, *, start: float, start_sd: float,
    sensor_sd: float, force_sd: float, time_s: float,
) -> float:  # fmt: skip
    """Log-density of all samples (n,) of a run as one normal vector."""
    n = len(thrust)
    mean = simulate(damping, thrust, start)
    fade = np.exp(-STEP_S / time_s)
    phi = expm(np.array([[damping / MASS, 1 / MASS], [0.0, -1 / time_s]]) * STEP_S)
    new = np.array([0.5 * STEP_S / MASS, 1.0])  # what is new of the force acts half a step
    # Samples as a linear map of start, first force and the news of each step.
    blocks = np.zeros((n, n + 1))
    state = np.zeros((2, n + 1))
    state[0, 0], state[1, 1] = start_sd, force_sd
    for i in range(n):
        blocks[i] = state[0]
        state = phi @ state
        if i + 2 < n + 1:
            state[:, i + 2] += new * force_sd * np.sqrt(1.0 - fade**2)
    covariance = blocks @ blocks.T + sensor_sd**2 * np.eye(n)
    return float(multivariate_normal(mean, covariance).logpdf(measured))
