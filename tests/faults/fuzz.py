"""Damage the small log of every reader in every way, and hold what is read against the
whole log.

    make fuzz [READER=NAME]
    python -m tests.faults.fuzz [--reader NAME]... [--mutations 20000] [--every 1] [--jobs 2]

Binary formats: every single bit flip and every cut point of a 20 kB log. All readers:
seeded mutations (flips, overwritten bytes, cuts, zeros, repeats, splices, hostile
values). No crash, hang, wrong account, invented record or wrong value; at least 99.9 %
of the whole records on average, and at worst 99 % or all but two. Workers may use no
more than 100 MB over what the readers need, and each reader is tried on larger damaged
logs against three times the memory of the clean one plus 100 MB. A failing case is
written to tests/data/fuzz.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import signal
import sys
import time
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from auvid.stages.base import RawFile
from tests.support.damage_cases import (
    MEAN_SHARE,
    count,
    damaged,
    failures,
    ingest_fault,
    keep,
    kind_of_fault,
)
from tests.support.mutate import mutations
from tests.support.recovery import judge
from tests.support.small_logs import DATA, NAMES, SmallLog, small_log

KINDS = ("flip", "cut", "mutation")
CHUNK = 400
INGEST_EVERY = 10
HANG_S = 30
EXTRA_BYTES = 100_000_000
CLEAN_FACTOR = 3
KEPT_FILES = 20
LARGE_SEEDS = 12
LARGE_BYTES = 2_000_000
TABLE_WIDTH = 150
LARGE = {
    "dataflash": DATA / "bluerov2_ugps_small" / "small.BIN",
    "tlog": DATA / "bluerov2_ugps_small" / "small.tlog",
    "ulog": DATA / "px4_ulog" / "sample_log_small.ulg",
}


@dataclass
class Tally:
    """Sums over the cases of one reader and kind."""

    cases: int = 0
    expected: int = 0
    lost: int = 0
    shares: list[float] = field(default_factory=list)
    invented: int = 0
    refused: int = 0
    failed: list[tuple[int, list[str]]] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        self.cases += other.cases
        self.expected += other.expected
        self.lost += other.lost
        self.shares += other.shares
        self.invented += other.invented
        self.refused += other.refused
        self.failed += other.failed


def limit_memory() -> None:
    """Let this process use no more than the allowance over what it uses after every
    reader has read its clean log.
    """
    for name in NAMES:
        small_log(name)
        ingest_fault(small_log(name), small_log(name).data)
    with contextlib.suppress(ImportError, OSError):
        import resource

        used = int(
            next(
                line
                for line in Path("/proc/self/status").read_text().splitlines()
                if line.startswith("VmData")
            ).split()[1]
        )
        resource.setrlimit(
            resource.RLIMIT_DATA, (used * 1024 + EXTRA_BYTES, resource.RLIM_INFINITY)
        )


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, _hangs)
    sys.unraisablehook = _note_unraisable
    limit_memory()


def _hangs(number: int, frame: FrameType | None) -> None:
    raise TimeoutError(f"no answer after {HANG_S} s")


_unraisable: list[str] = []


def _note_unraisable(found: Any) -> None:
    _unraisable.append(f"ignored exception: {found.exc_value!r}")


def try_cases(work: tuple[str, str, list[int]]) -> tuple[str, str, Tally]:
    """Judge the cases of one chunk; failing ones are written to files."""
    name, kind, numbers = work
    source, tally = small_log(name), Tally()
    for number in numbers:
        data, kept = damaged(source, kind, number)
        signal.alarm(HANG_S)
        result = judge(source, data, kept)
        found = failures(source, result)
        if number % INGEST_EVERY == 0 and (fault := ingest_fault(source, data)):
            found.append(fault)
        signal.alarm(0)
        found += _unraisable
        _unraisable.clear()
        tally.cases += 1
        tally.invented += result.invented
        if result.refused:
            tally.refused += 1
        elif result.expected:
            tally.expected += result.expected
            tally.lost += result.lost
            tally.shares.append(result.lost / result.expected)
        if found:
            tally.failed.append((number, found))
            if len(tally.failed) <= KEPT_FILES:
                keep(source, kind, number, data, kept, found)
    return name, kind, tally


def chunks(names: list[str], mutated: int, every: int) -> Iterator[tuple[str, str, list[int]]]:
    for name in names:
        for kind in KINDS:
            numbers = list(range(0, count(small_log(name), kind, mutated), every))
            for start in range(0, len(numbers), CHUNK):
                yield name, kind, numbers[start : start + CHUNK]


def large_log(source: SmallLog) -> bytes:
    """Some megabytes of the format."""
    if source.name in LARGE:
        data = LARGE[source.name].read_bytes()
        return data if source.name == "ulog" else data * (LARGE_BYTES // len(data) + 1)
    first, rest = source.data.split(b"\n", 1) if source.name == "csv" else (b"", source.data)
    return (first + b"\n" if first else b"") + rest * (LARGE_BYTES // len(rest) + 1)


def peak_bytes(source: SmallLog, data: bytes) -> int:
    """Peak of what reading allocates."""
    file = RawFile(source.name, np.frombuffer(data, np.uint8), source.columns)
    tracemalloc.start()
    with contextlib.suppress(Exception):
        source.reader.read(file)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def memory(name: str) -> tuple[str, float, float, float]:
    """Megabytes of a large log, its clean peak and its worst peak under damage."""
    source = small_log(name)
    data = large_log(source)
    clean = peak_bytes(source, data)
    worst = max(peak_bytes(source, mutations(data, seed)[0]) for seed in range(LARGE_SEEDS))
    return name, len(data) / 1e6, clean / 1e6, worst / 1e6


def main() -> int:
    """Run all cases; print the table; 1 if any failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--reader", action="append", choices=NAMES)
    parser.add_argument("--mutations", type=int, default=20_000)
    parser.add_argument("--every", type=int, default=1, help="try each N-th case only")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1))
    arguments = parser.parse_args()
    names = arguments.reader or list(NAMES)
    work = list(chunks(names, arguments.mutations, arguments.every))
    tallies = {(name, kind): Tally() for name in names for kind in KINDS}
    seconds = dict.fromkeys(names, 0.0)
    console, begin = (
        Console(width=None if sys.stdout.isatty() else TABLE_WIDTH),
        time.perf_counter(),
    )
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = (
        "system"  # the others reserve address space that would count as used
    )
    with (
        multiprocessing.get_context("spawn").Pool(arguments.jobs, _start_worker) as pool,
        Progress(console=console) as progress,
    ):
        bars = {
            name: progress.add_task(
                name, total=sum(len(part[2]) for part in work if part[0] == name)
            )
            for name in names
        }
        for name, kind, tally in pool.imap_unordered(try_cases, work):
            tallies[name, kind].add(tally)
            seconds[name] = time.perf_counter() - begin
            progress.advance(bars[name], tally.cases)
        console.print(damage_table(tallies))
        peaks = list(pool.imap(memory_without_limit, names))
    bad = report(console, tallies, peaks)
    console.print(
        f"{sum(tally.cases for tally in tallies.values())} cases in"
        f" {time.perf_counter() - begin:.0f} s on {arguments.jobs} processes"
    )
    return int(bad)


def memory_without_limit(name: str) -> tuple[str, float, float, float]:
    """`memory` in a worker whose limit is lifted, as the logs are large."""
    with contextlib.suppress(ImportError):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    return memory(name)


def damage_table(tallies: dict[tuple[str, str], Tally]) -> Table:
    """One row per reader and kind of damage."""
    table = Table(
        "reader",
        "damage",
        "cases",
        "whole records",
        "lost",
        "recovered, mean %",
        "worst %",
        "invented",
        "refused",
        "failed",
    )
    for (name, kind), tally in tallies.items():
        if tally.cases:
            shares = np.array(tally.shares or [0.0])
            numbers = (
                tally.cases,
                tally.expected,
                tally.lost,
                f"{100 * (1 - shares.mean()):.4f}",
                f"{100 * (1 - shares.max()):.2f}",
            )
            table.add_row(
                name,
                kind,
                *map(str, numbers),
                str(tally.invented),
                str(tally.refused),
                str(len(tally.failed)),
            )
    return table


def report(
    console: Console,
    tallies: dict[tuple[str, str], Tally],
    peaks: list[tuple[str, float, float, float]],
) -> bool:
    """Print memory and what failed; whether anything did."""
    bad = False
    for (name, kind), tally in tallies.items():
        kinds = Counter(kind_of_fault(fault) for _, faults in tally.failed for fault in faults)
        for fault, times in kinds.most_common(10):
            example = next(
                number
                for number, faults in tally.failed
                if any(kind_of_fault(each) == fault for each in faults)
            )
            console.print(
                f"[red]{name} {kind} {example}[/red] and {times - 1} more: {fault}",
                markup=True,
                highlight=False,
            )
            bad = True
        if tally.shares and np.mean(tally.shares) > MEAN_SHARE:
            console.print(
                f"[red]{name} {kind}[/red]: {100 * np.mean(tally.shares):.3f} % lost on average"
            )
            bad = True
    for name, size, clean, worst in peaks:
        allowed = CLEAN_FACTOR * clean + EXTRA_BYTES / 1e6
        console.print(
            f"memory, {name}: log {size:.1f} MB, clean peak {clean:.1f} MB, worst damaged"
            f" {worst:.1f} MB (allowed {allowed:.0f})"
        )
        bad |= worst > allowed
    return bad


if __name__ == "__main__":
    sys.exit(main())
