"""A disk of seeded twins, damaged logs and copies, through `auvid fleet run`, twice.

    python -m benchmarks.fleet_disk FOLDER [--logs N] [--jobs N] [--seconds S]

Twins of 60 s as BIN, telemetry and CSV; every fiftieth log once more with a damaged
middle, every hundredth as a copy. What stands in FOLDER is not made again, and the fleet
goes on where it stopped: after --seconds the call ends, and the next goes on. With all
logs done, one new log is added and the second run is timed. Asked are 12 s for it.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import time
from pathlib import Path

import yaml

from auvid.pipeline.commands.fleet.fleet_folder import open_fleet
from auvid.pipeline.commands.fleet.fleet_run import run_fleet
from auvid.pipeline.commands.fleet.report.fleet_page import write_page
from auvid.pipeline.commands.simulate import write_campaign
from auvid.pipeline.execution.engines import make_engine

ROOT = Path(__file__).resolve().parents[1]
PLAN = ROOT / "campaigns" / "bluerov2_twin" / "plans" / "dives.yaml"
VEHICLE = "bluerov2_heavy"
FORMATS = ("bin", "tlog", "csv")
LENGTH_S = 60
DAMAGED_EVERY, COPY_EVERY = 50, 100
LIMITS = {"second_run_s": 12.0, "page_megabytes": 5.0, "worker_megabytes": 1200.0}


def short_plan(path: Path) -> Path:
    """Write the plan of one dive of a minute."""
    plan = yaml.safe_load(PLAN.read_text(encoding="utf-8"))
    leg = plan["legs"][0]
    leg |= {"duration_s": LENGTH_S, "modes": [{"at_s": 0, "mode": "alt_hold"}]}
    path.write_text(yaml.safe_dump(plan | {"legs": [leg]}), encoding="utf-8")
    return path


def add_log(folder: Path, number: int, plan: Path) -> None:
    """Simulate one dive and put its log on the disk, unless it is there."""
    disk, kind = folder / "disk", FORMATS[number % len(FORMATS)]
    place = disk / f"{number // 100:02d}" / f"{number:04d}"
    if place.is_dir():
        return
    simulated = folder / "simulated"
    shutil.rmtree(simulated, ignore_errors=True)
    write_campaign(VEHICLE, plan, simulated, format=kind, seed=number)
    logs = sorted((simulated / "logs").iterdir())
    if number % DAMAGED_EVERY == 0:
        damaged = disk / "damaged" / f"{number:04d}{logs[0].suffix}"
        damaged.parent.mkdir(parents=True, exist_ok=True)
        content = bytearray(logs[0].read_bytes())
        content[len(content) // 3 : len(content) // 2] = bytes(len(content) // 6)
        damaged.write_bytes(content)
    if number % COPY_EVERY == 0:
        (disk / "copies").mkdir(parents=True, exist_ok=True)
        shutil.copy(logs[0], disk / "copies" / f"{number:04d}{logs[0].suffix}")
    place.parent.mkdir(parents=True, exist_ok=True)
    (simulated / "logs").rename(place)


def main() -> None:
    """Make the disk, run the fleet, add a log, run it again, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    words = parser.parse_args()
    words.folder.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    plan = short_plan(words.folder / "plan.yaml")
    for number in range(words.logs):
        if time.perf_counter() - start > words.seconds:
            print(json.dumps({"simulated": number, "of": words.logs}))
            return
        add_log(words.folder, number, plan)
    disk, out = words.folder / "disk", words.folder / "fleet"
    begin = time.perf_counter()
    outcome = run_fleet(disk, out, engine=make_engine("processes", words.jobs))
    first_s = time.perf_counter() - begin
    add_log(words.folder, words.logs, plan)
    begin = time.perf_counter()
    second = run_fleet(disk, out, engine=make_engine("processes", words.jobs))
    second_s = time.perf_counter() - begin
    begin = time.perf_counter()
    fleet = open_fleet(out)
    write_page(fleet)
    states = [row.state for row in outcome.rows]
    figures = {
        "logs": len(states),
        "states": {state: states.count(state) for state in sorted(set(states))},
        "first_run_s": round(first_s, 1),
        "ran": outcome.ran,
        "second_run_s": round(second_s, 1),
        "second_read": second.surveyed,
        "second_ran": second.ran,
        "page_s": round(time.perf_counter() - begin, 2),
        "page_megabytes": round(fleet.page.stat().st_size / 1e6, 2),
        "worker_megabytes": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3,
        "limits": LIMITS,
    }
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
