"""One disk through `auvid fleet run` by each engine: equal bytes, and time on two workers.

    python -m benchmarks.fleet_engines FOLDER [--logs 30]

Twins of 60 s in four formats, every tenth one damaged. Each engine works in a process of its
own into a fleet of its own; the four tables and the page must be equal byte by byte. The
efficiency of two workers is the time of one over twice that of two, each with one thread; asked
are .85 on a machine with nothing else to do. What stands in FOLDER is not simulated again.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from auvid.pipeline.commands.fleet.fleet_folder import TABLES, FleetFolder
from auvid.pipeline.store.file_hashes import hash_file
from benchmarks.fleet_disk import add_log, short_plan

DAMAGED_EVERY, DAMAGED = 10, 3
ENGINES = {
    "serial": ("--engine", "serial"),
    "processes": ("--engine", "processes", "--jobs", "2"),
    "dask": ("--engine", "dask", "--jobs", "2"),
}
LEAST_EFFICIENCY = 0.85


def damage(path: Path) -> None:
    """Overwrite a sixth of a log with zeros."""
    content = bytearray(path.read_bytes())
    content[len(content) // 3 : len(content) // 2] = bytes(len(content) // 6)
    path.write_bytes(content)


def make_disk(folder: Path, logs: int) -> Path:
    """Simulate the logs that are not there yet, and damage some of them."""
    folder.mkdir(parents=True, exist_ok=True)
    plan = short_plan(folder / "plan.yaml")
    for number in range(1, logs + 1):
        place = folder / "disk" / f"{number // 100:02d}" / f"{number:04d}"
        if place.is_dir():
            continue
        add_log(folder, number, plan)
        if number % DAMAGED_EVERY == DAMAGED:
            damage(min(place.iterdir()))
    return folder / "disk"


def seconds_of(*command: str | Path) -> float:
    """Return how long a command of auvid takes. It has to end, not to find all logs good."""
    begin = time.perf_counter()
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
    environment = os.environ | dict.fromkeys(threads, "1")
    done = subprocess.run(
        [sys.executable, "-m", "auvid", *command],
        env=environment,
        check=False,
        capture_output=True,
        text=True,
    )
    if done.returncode not in (0, 3):
        raise SystemExit(done.stdout + done.stderr)
    return time.perf_counter() - begin


def main() -> None:
    """Run the disk by each engine, compare bytes, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", type=int, default=30)
    options = parser.parse_args()
    folder = options.folder.resolve()
    disk = make_disk(folder, options.logs)
    seconds, hashes = {}, {}
    for engine, words in ENGINES.items():
        fleet = FleetFolder(folder / engine)
        shutil.rmtree(fleet.root, ignore_errors=True)
        seconds[engine] = seconds_of("fleet", "run", disk, "--out", fleet.root, "--quiet", *words)
        seconds_of("fleet", "report", fleet.root, "--quiet")
        hashes[engine] = {name: hash_file(fleet.table(name)) for name in TABLES}
        hashes[engine]["page"] = hash_file(fleet.page)
    efficiency = {
        engine: round(seconds["serial"] / (2.0 * seconds[engine]), 3)
        for engine in ENGINES
        if engine != "serial"
    }
    figures = {
        "logs": options.logs,
        "seconds": {engine: round(value, 1) for engine, value in seconds.items()},
        "efficiency_of_two_workers": efficiency,
        "asked": LEAST_EFFICIENCY,
        "equal_bytes": {
            engine: hashes[engine] == hashes["serial"] for engine in ENGINES if engine != "serial"
        },
        "load": os.getloadavg()[0],
    }
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
