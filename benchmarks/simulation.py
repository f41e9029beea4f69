"""Simulated steps per second: one vehicle and a batch, compiled and numpy, against an Euler step of PythonVehicleSimulator if installed.

    python benchmarks/simulation.py

One RK4 step has four evaluations of the right-hand side (twelve states, propeller, four fins, physical viscous force), an Euler step of
the peer one. Best of three; the first call, which compiles, is not counted.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from hydro.dynamics.physical_viscous import physical_viscous
from hydro.dynamics.simulation import Plant, constant_inputs, integrate_open_loop
from hydro.dynamics.vehicle import vehicle_from_document

STEP_S = 0.01
PEER_MEASURED_US = 524.0
"""PythonVehicleSimulator, one Euler step of its REMUS 100, as measured once on the same kind of machine."""


def best(job: Callable[[], object], repeats: int = 3) -> float:
    """Shortest wall time [s] of a job."""
    job()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        job()
        times.append(time.perf_counter() - start)
    return min(times)


def per_step_us(plant: Plant, batch: int, steps: int, *, compiled: bool) -> float:
    """Microseconds per vehicle and step."""
    start = np.tile(plant.start([0.0, 0.0, 5.0, 0.0, 0.0, 0.0], [1.5, 0.05, 0.0, 0.0, 0.0, 0.1]), (batch, 1))
    start[:, 6] += np.linspace(0.0, 0.5, batch)
    inputs = constant_inputs(np.full(batch, 35.0), np.tile([0.02, -0.02, 0.05, -0.05], (batch, 1)), knots=steps + 1)
    return best(lambda: integrate_open_loop(plant, start, inputs, step_s=STEP_S, compiled=compiled)) / (batch * steps) * 1e6


def peer_us() -> float | None:
    """One Euler step of PythonVehicleSimulator's REMUS 100 [us], or None where it is not installed."""
    try:
        from python_vehicle_simulator.lib.gnc import attitudeEuler
        from python_vehicle_simulator.vehicles import remus100
    except ImportError:
        return None
    vehicle = remus100("depthHeadingAutopilot", 30, 50, 1525, 0.5, 170)
    eta, nu, u = np.zeros(6), vehicle.nu, vehicle.u_actual

    def run() -> None:
        state, velocity, actual = eta.copy(), nu.copy(), u.copy()
        for _ in range(500):
            velocity, actual = vehicle.dynamics(state, velocity, actual, np.array([0.0, 0.0, 1200.0]), STEP_S)
            state = attitudeEuler(state, velocity, STEP_S)

    return best(run) / 500 * 1e6


def main() -> None:
    document = yaml.safe_load((Path(__file__).parents[1] / "vehicles/vt690.yaml").read_text(encoding="utf-8"))
    vehicle = vehicle_from_document(document)
    plant = Plant(vehicle, physical_viscous(vehicle))
    measured = peer_us()
    result = {
        "one_vehicle_us_per_step": per_step_us(plant, 1, 20_000, compiled=True),
        "batch_of_1000_us_per_vehicle_step": per_step_us(plant, 1000, 50, compiled=True),
        "numpy_batch_of_1000_us_per_vehicle_step": per_step_us(plant, 1000, 5, compiled=False),
        "numpy_one_vehicle_us_per_step": per_step_us(plant, 1, 100, compiled=False),
        "peer_us_per_euler_step": measured if measured is not None else PEER_MEASURED_US,
        "peer": "measured here" if measured is not None else "not installed; figure measured elsewhere",
    }
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
