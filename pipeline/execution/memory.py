"""Whether legs fit into the memory that is left, and giving back what is free."""

from __future__ import annotations

import ctypes
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from auvid.data_schemas.errors import DataError
from auvid.hydro.long_series.heap import give_back_heap
from auvid.pipeline.campaigns.campaign import Campaign

OF_LEGS: Mapping[str, tuple[float, float]] = {
    "resample": (317e6, 1100.0),
    "fuse": (340e6, 800.0),
    "residual": (345e6, 900.0),
}
"""Bytes that a process takes in a stage of single legs, whatever their length, and per sample
of the uniform clock. Measured on legs of 10 min, 1 h and 2 h at 50 Hz (decision 0122).
"""
OF_CAMPAIGN: Mapping[str, tuple[float, float]] = {
    "check_installation": (345e6, 1000.0),
    "synthesise": (420e6, 800.0),
    "validate": (459e6, 610.0),
    "report": (455e6, 720.0),
}
"""The same by the longest leg, in stages of all legs together, with ten models."""
PER_LEG_BYTES = 0.6e6
"""Of each leg of a campaign in any stage: its documents, and what a page draws of it.

Check_installation grows so from 36 legs to 144, other stages by less (decision 0129).
"""
STARTING_BYTES = 150e6
"""Of the process that starts others, which run stages of single legs."""
MARGIN = 1.15
"""Runs scatter by up to a tenth, and compile loops or not."""
MEMORY_INFO = Path("/proc/meminfo")
LIMIT = Path("/sys/fs/cgroup/memory.max")
USED = Path("/sys/fs/cgroup/memory.current")
DETAIL = Path("/sys/fs/cgroup/memory.stat")
OWN_PAGES = Path("/proc/self/statm")
M_ARENA_MAX = -8
"""Number of this option in glibc's malloc.h."""


def use_one_heap() -> None:
    """Let the threads of this process share one heap of glibc, before they begin.

    Each would keep one of its own, with what it has freed: 130 MB for a leg of an hour.
    """
    options = getattr(ctypes.CDLL(None), "mallopt", None) if os.name == "posix" else None
    if options is not None:  # glibc
        options(M_ARENA_MAX, 1)


def give_back() -> None:
    """Give the system what this process has freed and its allocators keep for later.

    glibc keeps freed arrays below 32 MB on its heap, Arrow those of its tables: without
    this, each stage of a run starts on top of what the stages before it had left.
    """
    import pyarrow as pa

    pa.default_memory_pool().release_unused()
    give_back_heap()


def available_bytes() -> float | None:
    """Return the memory left of the machine, its control group or this process.

    What a group holds of files that nobody reads now counts as left: the system gives it
    up on demand. None where the system does not tell (it is no Linux).
    """
    limited = _bytes_to_own_limit()
    try:
        rows = dict(row.split(":", 1) for row in MEMORY_INFO.read_text().splitlines())
        free = min(limited, 1024.0 * int(rows["MemAvailable"].split()[0]))
    except (OSError, KeyError, ValueError):
        return None
    try:
        left = float(LIMIT.read_text()) - float(USED.read_text())
        detail = dict(row.split() for row in DETAIL.read_text().splitlines())
        return min(free, left + float(detail["inactive_file"]))
    except (OSError, ValueError):  # no group, or "max"
        return free


def _bytes_to_own_limit() -> float:
    """Return what the limit of addresses (`ulimit -v`) leaves; inf for none."""
    if os.name != "posix":
        return math.inf
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return math.inf
    try:
        pages = int(OWN_PAGES.read_text().split()[0])
    except (OSError, ValueError):
        pages = 0
    return max(0.0, float(limit) - pages * resource.getpagesize())


def needed_bytes(samples: Sequence[float], legs: int) -> float:
    """Return what legs of so many samples take side by side, the longest of all `legs`.

    Stages of all legs run in one process, and hold one leg at a time.
    """
    side_by_side = sum(
        max(fixed + per_sample * count for fixed, per_sample in OF_LEGS.values())
        for count in samples
    )
    if len(samples) > 1:
        side_by_side += STARTING_BYTES
    together = max(
        fixed + per_sample * max(samples, default=0.0) for fixed, per_sample in OF_CAMPAIGN.values()
    )
    return MARGIN * (max(side_by_side, together) + PER_LEG_BYTES * legs)


def shortage(
    campaign: Campaign,
    log_lengths_s: Mapping[str, float],
    rate_hz: float,
    workers: int,
    available: float | None,
) -> DataError | None:
    """Return why the longest legs do not fit into memory side by side, or None.

    `workers` legs are under way at a time; `available` in bytes.
    """
    lengths = {
        name: min(leg.get("end_s") or float("inf"), log_lengths_s.get(leg["log"], 0.0))
        - (leg.get("start_s") or 0.0)
        for name, leg in campaign.legs.items()
    }
    longest = sorted(lengths, key=lengths.__getitem__, reverse=True)[:workers]
    needed = needed_bytes([rate_hz * lengths[name] for name in longest], len(lengths))
    if available is None or needed <= available:
        return None
    fitting_s = min(
        (available / MARGIN - PER_LEG_BYTES * len(lengths) - fixed) / (per_sample * rate_hz)
        for fixed, per_sample in (*OF_LEGS.values(), *OF_CAMPAIGN.values())
    )
    parts = [
        f"cut it into legs of at most {fitting_s:.0f} s (start_s, end_s)"
        if fitting_s > 10.0
        else "free some memory",
        *(["run with --jobs 1"] if len(longest) > 1 else []),
        "lower rate_hz of stage resample",
    ]
    return DataError(
        f"leg '{longest[0]}' is too long for the memory that is left: {lengths[longest[0]]:.0f} s"
        f" at {rate_hz:g} Hz"
        + (f", with {len(longest) - 1} more beside it," if len(longest) > 1 else "")
        + f" take about {needed / 1e9:.1f} GB",
        file=campaign.file.path,
        field=f"legs.{longest[0]}",
        value=f"{available / 1e9:.1f} GB left",
        remedy=f"{', or '.join(parts).capitalize()}.",
    )
