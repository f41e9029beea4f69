"""Damage the small log of every reader in every way, and hold what is read against the
whole log.

    make fuzz [READER=NAME] [SECONDS=300]
    python -m tests.faults.fuzz [--reader NAME]... [--mutations 6000] [--every 1] [--jobs 2]
        [--whole] [--seconds N]

Binary formats: every single bit flip and every cut point of a log of 4 kB that has a few
records of every type (with `--whole` of one of 20 kB). All readers: seeded damage of
each class of `mutate.KINDS`, and mixtures of them, to a log of 20 kB. No crash, hang,
wrong account, invented record or wrong value; at least 99.9 % of the whole records on
average, and at worst 99 % or all but two. Workers may use no more than 100 MB over what
the readers need, and each reader is tried on larger damaged logs: ten times their size
is the most that reading may take. A failing case is written to tests/data/fuzz.

What was tried stands in build/fuzz, so that a campaign that was stopped goes on; it
begins anew when the code of the readers or the damage changes. One that ends before all
was tried leaves out the check of memory, and its last line begins with PARTIAL.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import multiprocessing
import os
import signal
import sys
import time
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
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
from tests.support.mutate import KINDS as CLASSES
from tests.support.mutate import mutations
from tests.support.recovery import judge
from tests.support.small_logs import BINARY, DATA, NAMES, ROOT, SmallLog, short_log, small_log

KINDS = ("flip", "cut", *CLASSES, "mutation")
CHUNK = 200
SINGLE = ("flip", "cut")
MUTATIONS = 6000
INGEST_EVERY = 10
HANG_S = 10
EXTRA_BYTES = 100_000_000
INPUT_FACTOR = 10
CODE = ("stages/ingest", "data_schemas/formats", "tests/support", "tests/data/bluerov2_ugps_small")
CRASHES = ("crash:", "ingest:", "ignored exception:")
KEPT_FILES = 20
COLUMNS = (
    "reader",
    "damage",
    "tried",
    "crashed",
    "hung",
    "invented",
    "wrong values",
    "refused",
    "recovered, mean %",
    "worst %",
)
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
    read: int = 0
    share_sum: float = 0.0
    share_worst: float = 0.0
    invented: int = 0
    wrong: int = 0
    refused: int = 0
    crashed: int = 0
    hung: int = 0
    failed: list[tuple[int, list[str]]] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        worst = max(self.share_worst, other.share_worst)
        for name, value in asdict(other).items():
            setattr(self, name, getattr(self, name) + value)
        self.share_worst = worst

    @property
    def share_mean(self) -> float:
        """Mean share of the whole records that a case costs."""
        return self.share_sum / max(self.read, 1)


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


def _note_unraisable(unraisable: Any) -> None:
    _unraisable.append(f"ignored exception: {unraisable.exc_value!r}")


def source_of(name: str, kind: str, full_length: bool) -> SmallLog:
    """The log that a kind of damage is tried on."""
    short = kind in SINGLE and name in BINARY and not full_length
    return short_log(name) if short else small_log(name)


def try_cases(work: tuple[str, str, bool, list[int]]) -> tuple[str, str, int, Tally]:
    """Judge the cases of one chunk; failing ones are written to files."""
    name, kind, full_length, numbers = work
    source, tally = source_of(name, kind, full_length), Tally()
    for number in numbers:
        data, kept = damaged(source, kind, number)
        signal.alarm(HANG_S)
        result = judge(source, data, kept)
        faults = failures(source, result)
        if number % INGEST_EVERY == 0 and (fault := ingest_fault(source, data)):
            faults.append(fault)
        signal.alarm(0)
        faults += _unraisable
        _unraisable.clear()
        tally.cases += 1
        tally.invented += result.invented
        if result.refused:
            tally.refused += 1
        elif result.expected:
            share = result.lost / result.expected
            tally.expected += result.expected
            tally.lost += result.lost
            tally.read += 1
            tally.share_sum += share
            tally.share_worst = max(tally.share_worst, share)
        text = " ".join(faults)
        hung = "TimeoutError" in text
        tally.hung += hung
        tally.crashed += not hung and any(word in text for word in CRASHES)
        tally.wrong += "values of" in text
        if faults:
            tally.failed.append((number, faults))
            if len(tally.failed) <= KEPT_FILES:
                keep(source, kind, number, data, kept, faults)
    return name, kind, numbers[0], tally


def chunks(
    names: list[str], mutated: int, every: int, full_length: bool
) -> Iterator[tuple[str, str, list[int]]]:
    """Yield reader, kind and numbers of chunks that spread over the whole of a kind.

    All kinds advance together, so that a campaign cut short is an even sample of each.
    """
    spread: list[tuple[float, str, str, list[int]]] = []
    for name in names:
        for kind in KINDS:
            numbers = range(0, count(source_of(name, kind, full_length), kind, mutated), every)
            parts = -(-len(numbers) // CHUNK)
            for part in range(parts):
                spread.append((part / parts, name, kind, list(numbers[part::parts])))
    for _, name, kind, chunk in sorted(spread, key=lambda entry: entry[:3]):
        yield name, kind, chunk


def record_file(full_length: bool) -> Path:
    """Return the file of the chunks that were tried with the code that stands here."""
    digest = hashlib.sha256()
    for folder in CODE:
        for path in sorted((ROOT / folder).rglob("*.*")):
            if "__pycache__" not in path.parts:
                digest.update(path.read_bytes())
    return ROOT / "build" / "fuzz" / f"{digest.hexdigest()[:12]}{'_whole' * full_length}.jsonl"


def tried(path: Path) -> Iterator[tuple[str, str, list[int], Tally]]:
    """Yield reader, kind, numbers and tally of every chunk in the file."""
    for line in path.read_text().splitlines() if path.is_file() else ():
        name, kind, numbers, sums = json.loads(line)
        yield name, kind, numbers, Tally(**sums)


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
    parser.add_argument("--mutations", type=int, default=MUTATIONS)
    parser.add_argument("--every", type=int, default=1, help="try each N-th case only")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--whole", action="store_true", help="each bit and cut of 20 kB")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after these")
    arguments = parser.parse_args()
    names = arguments.reader or list(NAMES)
    work = list(chunks(names, arguments.mutations, arguments.every, arguments.whole))
    tallies = {(name, kind): Tally() for name in names for kind in KINDS}
    path, console = (
        record_file(arguments.whole),
        Console(width=None if sys.stdout.isatty() else TABLE_WIDTH),
    )
    for name, kind, numbers, tally in tried(path):
        if (name, kind, numbers) in work:
            work.remove((name, kind, numbers))
            tallies[name, kind].add(tally)
    path.parent.mkdir(parents=True, exist_ok=True)
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = (
        "system"  # the others reserve address space that would count as used
    )
    end = time.monotonic() + arguments.seconds
    with (
        multiprocessing.get_context("spawn").Pool(arguments.jobs, _start_worker) as pool,
        Progress(console=console) as progress,
        path.open("a") as record,
    ):
        bar = progress.add_task("cases", total=sum(len(part[2]) for part in work))
        left = {(name, kind, numbers[0]): numbers for name, kind, numbers in work}
        parts = [(name, kind, arguments.whole, numbers) for name, kind, numbers in work]
        for name, kind, first, tally in pool.imap_unordered(try_cases, parts):
            numbers = left.pop((name, kind, first))
            tallies[name, kind].add(tally)
            record.write(json.dumps([name, kind, numbers, asdict(tally)]) + "\n")
            record.flush()
            progress.advance(bar, tally.cases)
            if time.monotonic() > end:
                break
        peaks = [] if left else list(pool.imap(memory_without_limit, names))
    console.print(damage_table(tallies))
    bad = report(console, tallies, peaks)
    tried_cases = sum(tally.cases for tally in tallies.values())
    console.print(closing_words(tried_cases, sum(map(len, left.values()))))
    return int(bad)


def closing_words(tried_cases: int, left: int) -> str:
    """What was tried and what was not; `PARTIAL` first where something was not."""
    if not left:
        return f"all {tried_cases} cases tried, memory checked"
    return (
        f"PARTIAL: {tried_cases} of {tried_cases + left} cases tried, {left} left;"
        " memory was not checked. The same command goes on from here."
    )


def memory_without_limit(name: str) -> tuple[str, float, float, float]:
    """`memory` in a worker whose limit is lifted, as the logs are large."""
    with contextlib.suppress(ImportError):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    return memory(name)


def damage_table(tallies: dict[tuple[str, str], Tally]) -> Table:
    """One row per reader and kind of damage."""
    table = Table(*COLUMNS)
    for (name, kind), tally in tallies.items():
        if tally.cases:
            counts = (tally.cases, tally.crashed, tally.hung, tally.invented, tally.wrong)
            shares = f"{100 * (1 - tally.share_mean):.4f}", f"{100 * (1 - tally.share_worst):.2f}"
            table.add_row(name, kind, *map(str, counts), str(tally.refused), *shares)
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
        if tally.share_mean > MEAN_SHARE:
            console.print(
                f"[red]{name} {kind}[/red]: {100 * tally.share_mean:.3f} % lost on average"
            )
            bad = True
    for name, size, clean, worst in peaks:
        console.print(
            f"memory, {name}: log {size:.1f} MB, clean peak {clean:.1f} MB, worst damaged"
            f" {worst:.1f} MB: {worst / size:.1f} times the log (allowed {INPUT_FACTOR})"
        )
        bad |= worst > INPUT_FACTOR * size
    return bad


if __name__ == "__main__":
    sys.exit(main())
