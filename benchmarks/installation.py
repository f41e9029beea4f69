"""Are wrong installations of the sensors named, and right ones left alone? Seeds of a twin.

    python -m benchmarks.installation --plan default --seeds 100

Each seed flies the legs of a plan of campaigns/vt690_twin (turns and dives), records
them once as the vehicle file says and once with one fault drawn by the seed, and runs
resample and check_installation in memory. A row per figure is appended to
build/installation.csv; seeds that stand there are not done again. Printed: how many
faults were named, by kind, with a binomial interval of 95 %; false findings on the
clean flights; and how often the 95 % interval of a figure holds the truth.

Faults: arm forward or to the side off by .1 to .5 m; pitch or yaw of the velocity log
by 1 to 3 degrees; a lag of 50 to 100 ms; the other convention of the accelerometer.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import csv
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import beta

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.documents.twin import TruthEntry
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import InstallationRecord
from auvid.data_schemas.tables import make_table
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.simulation.rov.sensors import START_US
from auvid.hydro.dynamics.simulation.simulation import SimulatedVehicle
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages import check_installation, resample
from auvid.stages.base import collection
from auvid.stages.simulate.flights import FlownLeg, fly_leg, truth_force
from auvid.stages.simulate.plans import Plan
from auvid.stages.simulate.sensing import record
from benchmarks.coverage import BUILD, twin

KINDS = ("arm x", "arm y", "angle y", "angle z", "lag", "convention")
COLUMNS = ("plan", "seed", "fault", "size", "figure", "departure", "standard_error", "verdict")
PORTS = ("resampled", "segment", "samples_imu", "samples_velocity", "samples_depth")


def fault_of(seed: int) -> tuple[str, float]:
    """Return kind and size [m, rad, s, 1] of the fault of a seed; kinds take turns."""
    kind, rng = KINDS[seed % len(KINDS)], np.random.default_rng(seed)
    low, high = {
        "arm x": (0.1, 0.5),
        "arm y": (0.1, 0.5),
        "angle y": (np.radians(1.0), np.radians(3.0)),
        "angle z": (np.radians(1.0), np.radians(3.0)),
        "lag": (0.05, 0.1),
        "convention": (1.0, 1.0),
    }[kind]
    sign = -1.0 if kind not in ("lag", "convention") and rng.integers(2) else 1.0
    return kind, float(sign * rng.uniform(low, high))


def checked(
    flights: Sequence[FlownLeg], plan: Plan, vehicle: Vehicle, seed: int, kind: str, size: float
) -> InstallationRecord:
    """Return the installation that the legs of a seed show, with one fault."""
    unit = np.eye(3)
    if kind.startswith("arm"):
        plan = replace(plan, dvl_arm_error_m=size * unit["xyz".index(kind[-1])])
    if kind.startswith("angle"):
        plan = replace(plan, dvl_mounting_error_rad=size * unit["xyz".index(kind[-1])])
    ports: dict[str, dict[str, object]] = {port: {} for port in PORTS}
    infos = {}
    for flown in flights:
        leg = flown.leg.id
        log = record(flown, plan, seed=seed, text="")
        if kind == "lag":
            log.streams["velocity"]["time_us"] = log.streams["velocity"]["time_us"] + round(
                size * 1e6
            )
        infos[leg] = LogInfo(
            log=leg,
            files=[],
            status="complete",
            start_us=START_US,
            end_us=START_US + round(flown.log_end_s * 1e6),
            parameters={},
            accelerometer="inertial" if kind == "convention" else "specific_force",
            streams={},
            counts={},
            notes=[],
        )
        span = {"start_s": flown.start_s, "end_s": flown.end_s}
        entry = {"id": leg, "log": leg, "use": "training", **span}
        streams = {name: make_table(name, values) for name, values in log.streams.items()}
        cut = resample.run(
            resample.Inputs(LegEntry(**entry), infos[leg], vehicle, **streams),  # type: ignore[arg-type]
            resample.Params(),
        )
        for port, tables in ports.items():
            tables.update(getattr(cut, port))
    inputs = check_installation.Inputs(
        log_info=collection(infos),
        vehicle=vehicle,
        **{port: collection(tables) for port, tables in ports.items()},  # type: ignore[arg-type]
    )
    return check_installation.run(inputs, check_installation.Params()).installation


def rows_of(
    plan_name: str, plan: Plan, simulated: SimulatedVehicle, seed: int
) -> Iterator[dict[str, object]]:
    """Fly one seed; yield a row per figure, clean and with the seed's fault."""
    flights = [fly_leg(plan, leg, simulated, seed=seed) for leg in plan.legs]
    for kind, size in (("none", 0.0), fault_of(seed)):
        report = checked(flights, plan, simulated.vehicle, seed, kind, size)
        place: tuple[object, ...] = (plan_name, seed, kind, size)
        other = "departs" if report.convention_found else "agrees"
        figures: list[tuple[object, ...]] = [("convention", None, None, other)]
        figures += [
            (item.name, item.departure, item.standard_error, item.verdict)
            for item in report.figures
        ]
        for figure in figures:
            yield dict(zip(COLUMNS, (*place, *figure), strict=True))


def study(plan_name: str, seeds: range) -> list[dict[str, str]]:
    """Return the rows of the seeds; what is missing is flown and appended."""
    file = BUILD / "installation.csv"
    BUILD.mkdir(exist_ok=True)
    plan, simulated = twin(plan_name, "linear")
    truth = TruthEntry(name="physics", kind="physics", source="flow physics")
    simulated = truth_force(truth, plan, simulated.vehicle)[0]
    done = {row["seed"] for row in _rows(plan_name)}
    for seed in seeds:
        if str(seed) in done:
            continue
        start = time.perf_counter()
        rows = list(rows_of(plan_name, plan, simulated, seed))
        new = not file.exists()
        with file.open("a", newline="", encoding="utf-8") as out:
            writer = csv.DictWriter(out, COLUMNS)
            if new:
                writer.writeheader()
            writer.writerows(rows)
        print(f"seed {seed}: {time.perf_counter() - start:.1f} s", flush=True)
    return [row for row in _rows(plan_name) if int(row["seed"]) in seeds]


def _rows(plan_name: str) -> list[dict[str, str]]:
    file = BUILD / "installation.csv"
    if not file.exists():
        return []
    with file.open(newline="", encoding="utf-8") as lines:
        return [row for row in csv.DictReader(lines) if row["plan"] == plan_name]


def summary(rows: Sequence[dict[str, str]]) -> list[str]:
    """Return the printed lines."""
    clean = [row for row in rows if row["fault"] == "none"]
    false = [row for row in clean if row["verdict"] == "departs"]
    lines = [f"clean flights {len({row['seed'] for row in clean})}, false findings {len(false)}"]
    lines += [
        f"  seed {row['seed']}: {row['figure']} {row['departure']} +- {row['standard_error']}"
        for row in false
    ]
    named, tried, others = Counter[str](), Counter[str](), 0
    for row in rows:
        if row["fault"] == "none":
            continue
        if row["figure"] == row["fault"]:
            tried[row["fault"]] += 1
            named[row["fault"]] += row["verdict"] == "departs"
        else:
            others += row["verdict"] == "departs"
    lines += [f"{kind}: named {share(named[kind], tried[kind])}" for kind in KINDS if tried[kind]]
    lines.append(f"all: named {share(sum(named.values()), sum(tried.values()))}")
    lines.append(f"faulty flights: findings on other figures {others}")
    for figure in dict.fromkeys(row["figure"] for row in clean):
        own = [row for row in clean if row["figure"] == figure and row["standard_error"]]
        if own:
            error = np.array([float(row["standard_error"]) for row in own])
            score = np.array([float(row["departure"]) for row in own]) / error
            unseen = sum(row["verdict"] == "not observable" for row in own)
            lines.append(
                f"{figure}: standard error {np.median(error):.2g}, rms z"
                f" {np.sqrt(np.mean(score**2)):.2f}, 95 % intervals hold"
                f" {share(int(np.sum(np.abs(score) < NORMAL_95)), len(own))}, not observable in"
                f" {unseen}"
            )
    return lines


def share(hits: int, of: int) -> str:
    """Return a share with its binomial interval of 95 %."""
    low = float(beta.ppf(0.025, hits, of - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.975, hits + 1, of - hits)) if hits < of else 1.0
    return f"{hits} of {of} [{low:.2f}, {high:.2f}]"


def main() -> None:
    """Run the study and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plan", default="default")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=100, help="one behind the last")
    arguments = parser.parse_args()
    print("\n".join(summary(study(arguments.plan, range(arguments.first, arguments.seeds)))))


if __name__ == "__main__":
    main()
