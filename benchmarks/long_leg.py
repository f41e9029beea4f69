"""One long leg from log to report: CPU time and peak memory, stage by stage and in one process.

    python -m benchmarks.long_leg FOLDER [--minutes 60]

The twin of a BlueROV2 Heavy: a training leg of so many minutes with gyro, attitude, depth
and outputs at 50 Hz in a DataFlash log, a check of 55 s, all models by least squares. What
stands in FOLDER is not simulated again. Asked of an hour are 30 s on two cores and 600 MB.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import yaml

from auvid.pipeline.campaigns.workspace import Workspace
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.simulate import write_campaign

ROOT = Path(__file__).resolve().parents[1]
PLAN = ROOT / "campaigns" / "bluerov2_twin" / "plans" / "dives.yaml"
VEHICLE = "bluerov2_heavy"
FAST = ("imu", "attitude", "depth", "outputs")
"""Sensors with a rate of `FAST_HZ`."""
FAST_HZ, CHECK_S = 50, 55
LIMITS = {"cpu_s": 60.0, "megabytes": 600.0}
"""Of an hour: 30 s on two cores."""


def add_campaign(folder: Path, minutes: float) -> str:
    """Simulate the campaign, unless it is there, and return its name."""
    name = f"minutes_{minutes:g}"
    place = folder / "campaigns" / name
    if place.is_dir():
        return name
    plan = yaml.safe_load(PLAN.read_text(encoding="utf-8"))
    training, check = plan["legs"][:2]
    training |= {"duration_s": 60.0 * minutes, "modes": [{"at_s": 0, "mode": "alt_hold"}]}
    plan["legs"] = [training, check | {"duration_s": CHECK_S}]
    for sensor in FAST:
        plan["sensors"][sensor]["rate_hz"] = FAST_HZ
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "plan.yaml"
    file.write_text(yaml.safe_dump(plan), encoding="utf-8")
    (folder / "params.yaml").write_text("{}\n", encoding="utf-8")
    write_campaign(VEHICLE, file, place, format="bin", seed=1)
    return name


def run(folder: Path, name: str, *options: str) -> dict[str, float]:
    """Run a campaign in a process of its own; return its CPU time and peak memory."""
    command = [sys.executable, "-m", "auvid", "run", name, "--quiet", *options]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 3):
        raise SystemExit(process.returncode)
    cpu_s, megabytes = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
    return {"cpu_s": round(cpu_s, 1), "megabytes": round(megabytes, 1)}


def main() -> None:
    """Simulate, run stage by stage and at once, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--minutes", type=float, default=60.0)
    options = parser.parse_args()
    folder = options.folder.resolve()
    # In a process of its own: Linux counts the peak of the parent as one of what it starts.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        name = pool.submit(add_campaign, folder, options.minutes).result()
    stages = open_run(str(folder / "campaigns" / name), Workspace(folder)).graph.stages
    figures: dict[str, object] = {
        stage.name: run(folder, name, "--only", stage.name, "--force") for stage in stages
    }
    begin = time.perf_counter()
    figures["log to report"] = run(folder, name, "--force")
    figures["log to report, s"] = round(time.perf_counter() - begin, 1)
    print(json.dumps(figures | {"limits": LIMITS}, indent=2))


if __name__ == "__main__":
    main()
