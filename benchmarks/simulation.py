"""Simulated steps per second: one vehicle and a batch, compiled and numpy, beside an Euler step of PythonVehicleSimulator.

    python -m benchmarks.simulation --peer FOLDER

FOLDER is a copy of PythonVehicleSimulator (github.com/cybergalactic/PythonVehicleSimulator, MIT); without it, or an installed one, there
are no ratios. One RK4 step has four evaluations of the right-hand side (twelve states, propeller, four fins, physical viscous force), an
Euler step of the peer's REMUS 100 has one. The peer is timed twice: its own `simulate` as its main program calls it (10000 samples of
20 ms, autopilot and table included), and its bare Euler step. Best of five; the first call, which compiles, is not counted.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from hydro.dynamics.physical_viscous import physical_viscous
from hydro.dynamics.simulation import Plant, constant_inputs, integrate_open_loop
from hydro.dynamics.vehicle import vehicle_from_document

STEP_S = 0.01
PEER_SAMPLES, PEER_STEP_S = 10_000, 0.02


def best(job: Callable[[], object], repeats: int = 5) -> float:
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


def peer_us() -> tuple[float, float] | None:
    """Microseconds per step of PythonVehicleSimulator's `simulate` and of its bare Euler step, or None where it cannot be imported."""
    try:
        from python_vehicle_simulator.lib import attitudeEuler, simulate
        from python_vehicle_simulator.vehicles import remus100
    except ImportError:
        return None

    def whole() -> None:
        simulate(PEER_SAMPLES, PEER_STEP_S, remus100("depthHeadingAutopilot", 30, 50, 1525, 0.5, 170))

    vehicle = remus100("depthHeadingAutopilot", 30, 50, 1525, 0.5, 170)

    def bare() -> None:
        eta, nu, actual = np.zeros(6), vehicle.nu.copy(), vehicle.u_actual.copy()
        for _ in range(500):
            nu, actual = vehicle.dynamics(eta, nu, actual, np.array([0.0, 0.0, 1200.0]), STEP_S)
            eta = attitudeEuler(eta, nu, STEP_S)

    return best(whole) / PEER_SAMPLES * 1e6, best(bare) / 500 * 1e6


def main() -> None:
    """Measure and print as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--peer", type=Path, help="folder of PythonVehicleSimulator")
    folder = parser.parse_args().peer
    if folder is not None:
        sys.path[:0] = [str(folder / "src"), str(folder)]
    peer = peer_us()
    if folder is not None and peer is None:
        sys.exit(f"no package python_vehicle_simulator can be imported from {folder}")
    document = yaml.safe_load((Path(__file__).parents[1] / "vehicles/vt690.yaml").read_text(encoding="utf-8"))
    vehicle = vehicle_from_document(document)
    plant = Plant(vehicle, physical_viscous(vehicle))
    one, many = per_step_us(plant, 1, 20_000, compiled=True), per_step_us(plant, 1000, 50, compiled=True)
    result = {
        "one_vehicle_us_per_rk4_step": round(one, 3),
        "batch_of_1000_us_per_vehicle_rk4_step": round(many, 3),
        "numpy_one_vehicle_us_per_rk4_step": round(per_step_us(plant, 1, 100, compiled=False), 1),
        "numpy_batch_of_1000_us_per_vehicle_rk4_step": round(per_step_us(plant, 1000, 5, compiled=False), 2),
    }
    for name, time_us in zip(("peer_simulate", "peer_euler_step"), peer or (), strict=False):
        result |= {f"{name}_us": round(time_us, 1), f"{name}_ratio_one": round(time_us / one), f"{name}_ratio_batch": round(time_us / many)}
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
