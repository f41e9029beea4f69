"""A disk of seeded twins, damaged logs and copies, through `auvid fleet run`, twice.

    python -m benchmarks.fleet_disk FOLDER [--logs N] [--jobs N] [--engine NAME]
        [--disk FOLDER] [--seconds S]

Twins of 60 s as BIN, telemetry, CSV and DataFlash text; every fiftieth log once more with
a damaged middle, every hundredth as a copy; logs of another disk beside them with --disk.
What stands in FOLDER is not made again, and the fleet goes on where it stopped: after
--seconds no further log is simulated, and the next call goes on. While it runs, a line a
minute in memory.jsonl tells how many logs are surveyed and run, and the size of each
worker. With all logs done, one new log is added and the second run is timed. Asked are
12 s for it.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import yaml
from pymavlink import mavutil

from auvid.pipeline.commands.fleet.fleet_folder import open_fleet
from auvid.pipeline.commands.fleet.fleet_run import run_fleet
from auvid.pipeline.commands.fleet.report.fleet_page import write_page
from auvid.pipeline.commands.simulate import write_campaign
from auvid.pipeline.execution.engines import make_engine

ROOT = Path(__file__).resolve().parents[1]
PLAN = ROOT / "campaigns" / "bluerov2_twin" / "plans" / "dives.yaml"
VEHICLE = "bluerov2_heavy"
FORMATS = ("bin", "tlog", "csv", "log")
TEXT = "log"
"""DataFlash text, which is made of a BIN."""
LENGTH_S = 60
SAMPLE_S = 60.0
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
    written = "bin" if kind == TEXT else kind
    write_campaign(VEHICLE, plan, simulated, format=written, seed=number)
    if kind == TEXT:
        for path in list((simulated / "logs").iterdir()):
            path.with_suffix(".log").write_text(as_text(path), encoding="utf-8")
            path.unlink()
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


def as_text(path: Path) -> str:
    """Return a BIN log as ground stations print it: a line a message, in its units."""
    log = mavutil.mavlink_connection(str(path))
    lines = []
    while (message := log.recv_msg()) is not None:
        fields = [getattr(message, name) for name in message.get_fieldnames()]
        lines.append(", ".join([message.get_type(), *map(_cell, fields)]))
    return "\n".join(lines) + "\n"


def _cell(value: object) -> str:
    return value.decode("latin-1").rstrip("\0") if isinstance(value, bytes) else str(value)


@contextmanager
def memory_noted(folder: Path) -> Iterator[None]:
    """Write a line a minute: logs surveyed and run, size and peak of each worker."""
    ended = threading.Event()
    own = psutil.Process()

    def note() -> None:
        with (folder / "memory.jsonl").open("a", encoding="utf-8") as file:
            while True:
                logs = folder / "fleet" / "logs"
                line = {
                    "time": time.strftime("%H:%M:%S"),
                    "surveyed": sum(1 for _ in logs.glob("*/survey.json")),
                    "ran": sum(1 for _ in logs.glob("*/result.json")),
                    "parent_megabytes": own.memory_info().rss / 1e6,
                    "workers": [_sizes(child.pid) for child in own.children(recursive=True)],
                }
                file.write(json.dumps(line) + "\n")
                file.flush()
                if ended.wait(SAMPLE_S):
                    return

    watch = threading.Thread(target=note)
    watch.start()
    try:
        yield
    finally:
        ended.set()
        watch.join()


def _sizes(process: int) -> dict[str, float]:
    """Return resident size and its peak, in MB; nothing of a process that has ended."""
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return {}
    cells = {words[0]: words[1] for words in map(str.split, lines) if len(words) > 1}
    sizes = {"now": cells.get("VmRSS:"), "peak": cells.get("VmHWM:")}
    return {"pid": process} | {
        name: round(float(size) / 1e3, 1) for name, size in sizes.items() if size is not None
    }


def main() -> None:
    """Make the disk, run the fleet, add a log, run it again, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--engine", default="processes")
    parser.add_argument("--disk", type=Path, help="folder of further logs")
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
    if words.disk is not None and not (disk / "recorded").is_dir():
        shutil.copytree(words.disk, disk / "recorded")
    begin = time.perf_counter()
    with memory_noted(words.folder):
        outcome = run_fleet(disk, out, engine=make_engine(words.engine, words.jobs))
    first_s = time.perf_counter() - begin
    add_log(words.folder, words.logs, plan)
    begin, cpu = time.perf_counter(), _cpu_s()
    second = run_fleet(disk, out, engine=make_engine(words.engine, words.jobs))
    second_s, second_cpu_s = time.perf_counter() - begin, _cpu_s() - cpu
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
        "second_run_cpu_s": round(second_cpu_s, 1),
        "second_read": second.surveyed,
        "second_ran": second.ran,
        "page_s": round(time.perf_counter() - begin, 2),
        "page_megabytes": round(fleet.page.stat().st_size / 1e6, 2),
        "limits": LIMITS,
    }
    print(json.dumps(figures, indent=2))


def _cpu_s() -> float:
    """Return the CPU time of this process and of those that it has waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


if __name__ == "__main__":
    main()
