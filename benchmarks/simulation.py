"""Cost of a simulated step: one vehicle and a batch, beside PythonVehicleSimulator.

    python -m benchmarks.simulation --peer FOLDER

FOLDER is a copy of PythonVehicleSimulator
(github.com/cybergalactic/PythonVehicleSimulator, MIT); without it, or an installed one,
there are no ratios. One RK4 step has four evaluations of the right-hand side (twelve
states, propeller, four fins, viscous force), an Euler step of the peer's REMUS 100 has
one. Two truths: the physical viscous force, and a published model (Gertler and Hagen,
88 coefficients). A batch uses the threads that numba may start. The peer is timed
twice: its own `simulate` as its main program calls it (10000 samples of 20 ms,
autopilot and table included), and its bare Euler step. Shortest of many runs, ours and
the peer's in turn, so that another program on the machine disturbs both alike; the
first call, which compiles, is not counted.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import csv
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.simulation.physical_viscous import physical_viscous
from auvid.hydro.dynamics.simulation.simulation import (
    SimulatedVehicle,
    constant_actuation,
    integrate_open_loop,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.models import IdentifiedModel

ROOT = Path(__file__).parents[1]
STEP_S = 0.01
REPEATS = 100
PEER_SAMPLES, PEER_STEP_S, PEER_STEPS = 10_000, 0.02, 200


def shortest(jobs: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Shortest wall time [s] of each job, all of them in turn."""
    times = dict.fromkeys(jobs, np.inf)
    for job in jobs.values():
        job()
    for _ in range(repeats):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            times[name] = min(times[name], time.perf_counter() - start)
    return times


def simulation(plant: SimulatedVehicle, batch: int, steps: int) -> Callable[[], object]:
    """A job of `batch * steps` vehicle-steps."""
    start = np.tile(
        plant.start([0.0, 0.0, 5.0, 0.0, 0.0, 0.0], [1.5, 0.05, 0.0, 0.0, 0.0, 0.1]), (batch, 1)
    )
    start[:, 0] += np.linspace(0.0, 0.5, batch)
    inputs = constant_actuation(
        np.full(batch, 35.0), np.tile([0.02, -0.02, 0.05, -0.05], (batch, 1)), knots=steps + 1
    )
    return lambda: integrate_open_loop(plant, start, inputs, step_s=STEP_S)


def peer_jobs() -> tuple[Callable[[], object], Callable[[], object]] | None:
    """PythonVehicleSimulator's `simulate`, and its bare Euler step; None where it
    cannot be imported.
    """
    try:
        from python_vehicle_simulator.lib import attitudeEuler, simulate
        from python_vehicle_simulator.vehicles import remus100
    except ImportError:
        return None

    def with_autopilot() -> None:
        simulate(
            PEER_SAMPLES, PEER_STEP_S, remus100("depthHeadingAutopilot", 30, 50, 1525, 0.5, 170)
        )

    vehicle = remus100("depthHeadingAutopilot", 30, 50, 1525, 0.5, 170)

    def bare() -> None:
        eta, nu, actual = np.zeros(6), vehicle.nu.copy(), vehicle.u_actual.copy()
        for _ in range(PEER_STEPS):
            nu, actual = vehicle.dynamics(eta, nu, actual, np.array([0.0, 0.0, 1200.0]), STEP_S)
            eta = attitudeEuler(eta, nu, STEP_S)

    return with_autopilot, bare


def published(name: str) -> IdentifiedModel:
    """A model of McCarter 2014, Appendix E."""
    coefficients: dict[str, dict[str, float]] = {}
    with (ROOT / f"vehicles/vt690/coefficients/{name}.csv").open(
        newline="", encoding="utf-8"
    ) as file:
        for row in csv.DictReader(file):
            coefficients.setdefault(row["axis"], {})[row["term"]] = float(row["value"])
    return IdentifiedModel(name, coefficients)


def main() -> None:
    """Measure and print as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--peer", type=Path, help="folder of PythonVehicleSimulator")
    folder = parser.parse_args().peer
    if folder is not None:
        sys.path[:0] = [str(folder / "src"), str(folder)]
    peer = peer_jobs()
    if folder is not None and peer is None:
        sys.exit(f"no package python_vehicle_simulator can be imported from {folder}")
    vehicle = vehicle_from_document(
        read_yaml((ROOT / "vehicles/vt690.yaml").read_text(encoding="utf-8"))
    )
    truths = {
        "physical": SimulatedVehicle(vehicle, physical_viscous(vehicle)),
        "gertler_hagen": SimulatedVehicle(vehicle, published("gertler_hagen")),
    }
    jobs: dict[str, Callable[[], object]] = {}
    steps: dict[str, int] = {}
    for name, plant in truths.items():
        for batch, count in ((1, 2000), (1000, 20)):
            key = f"{name}_{'one' if batch == 1 else f'batch_of_{batch}'}"
            jobs[key], steps[key] = simulation(plant, batch, count), batch * count
    if peer is not None:
        jobs["peer_euler_step"], steps["peer_euler_step"] = peer[1], PEER_STEPS
    times = shortest(jobs, REPEATS)
    slow: dict[str, Callable[[], object]] = {}
    if peer is not None:
        slow["peer_simulate"], steps["peer_simulate"] = peer[0], PEER_SAMPLES
    times |= shortest(slow, 5)
    cost = {name: seconds / steps[name] * 1e6 for name, seconds in times.items()}
    peers = {name: value for name, value in cost.items() if name.startswith("peer")}
    ratios = {
        f"{name}_over_{key}": round(value / cost[key])
        for name, value in peers.items()
        for key in jobs
        if key not in peers
    }
    print(
        json.dumps(
            {
                "us_per_vehicle_and_step": {name: round(value, 3) for name, value in cost.items()},
                "ratios": ratios,
            },
            indent=1,
        )
    )


if __name__ == "__main__":
    main()
