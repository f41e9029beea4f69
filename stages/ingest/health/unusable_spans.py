"""Stretches that no leg may have: without the vehicle, out of the water, by hand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.hydro.arrays import Array, Mask, runs_of
from auvid.stages.columns import ATTITUDE, GYRO, LINEAR_VELOCITY
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

Span = tuple[float, float]
OF_VEHICLE = ("attitude", "imu", "depth", "velocity", "actuators")
COASTING_S = 2.0
"""A vehicle that was driven comes to rest within this time."""
HAND_RAD_S = 0.5
"""RMS of turning within a second; an idle vehicle in waves of ten degrees stays below 0.3, and
no gyro at rest reads 0.1. What is usual in the log is no bias: a vehicle may circle most of it.
"""
AT_SURFACE_M = 0.1
PAUSE_S = 3
"""A shorter pause does not part two stretches."""
ODD = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], np.uint64)
"""Odd numbers that make one key of the bits of a row."""
HALF = np.uint64(32)
"""Bits by which the upper half of a number comes to the lower."""
AGAIN, SMOOTH = 1.5, 0.2
"""How many times its own length a copy goes on, and how much of a change from row to row the
next one differs by, where a simulation without noise moves to and fro: sensors have 1 and more.
"""
NAMED = 3
LONGEST_S = 1e6
"""A log that seems longer has a clock that leaps."""
WORDS = {
    "without_vehicle": "No sensor of the vehicle is recorded",
    "out_of_water": f"Nothing acts and depth is within {AT_SURFACE_M:g} m of zero",
    "moved_by_hand": "The vehicle turns while nothing acts",
}


def unusable_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield the stretches to keep legs away from, a finding for each cause."""
    for name, spans in unusable_spans(log).items():
        where = [f"{start:.0f} to {end:.0f} s" for start, end in spans[:NAMED]]
        if len(spans) > NAMED:
            where.append(f"{len(spans) - NAMED} more")
        yield finding(
            name,
            f"{WORDS[name]}: {listed(where)}.",
            value=sum(end - start for start, end in spans),
            at_s=spans[0][0],
            remedy=f"Keep legs away from {listed(where)}.",
        )


def copied_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield a stretch of the log that is there twice, to the last digit."""
    for stream, names in {"imu": GYRO, "attitude": ATTITUDE, "velocity": LINEAR_VELOCITY}.items():
        if not log.has(stream):
            continue
        first, count, back = longest_copy(log.values(stream, names))
        if count <= limit("span_copied"):
            continue
        t_s = log.t_s(stream)
        from_s, until_s = float(t_s[first]), float(t_s[first + count - 1])
        yield finding(
            "span_copied",
            f"The {stream} ({log.source(stream)}) from {from_s:.1f} to {until_s:.1f} s repeats"
            f" that from {t_s[first - back]:.1f} s on to the last digit: the log, or a part of it,"
            " is there twice.",
            stream=stream,
            value=count,
            at_s=from_s,
        )
        return


def longest_copy(values: Array) -> tuple[int, int, int]:
    """Return where the longest copy of earlier rows (n, k) begins, and how long it is.

    And how many rows before it they are. A row that repeats the one before it is no copy.

    >>> longest_copy(np.array([[1.0], [2.0], [2.0], [1.0], [2.0], [4.0]]))
    (3, 2, 3)
    """
    fresh = np.flatnonzero(np.append(True, (np.diff(values, axis=0) != 0.0).any(axis=1)))
    if fresh.size < 2:
        return 0, 0, 0
    bits = np.ascontiguousarray(values[fresh] + 0.0).view(np.uint64)
    with np.errstate(over="ignore"):
        mixed = bits * ODD[: bits.shape[1]]
        mixed ^= mixed >> HALF  # two signs that change would cancel
        keys = (mixed * ODD[: bits.shape[1]]).sum(axis=1, dtype=np.uint64)
    order = np.argsort(keys, kind="stable")
    same = keys[order[1:]] == keys[order[:-1]]
    back = np.zeros(fresh.size, np.int64)
    back[order[1:][same]] = (order[1:] - order[:-1])[same]
    best = (0, 0, 0)
    for start, end in runs_of(back > 1):
        cuts = np.flatnonzero(np.diff(back[start:end])) + start + 1
        for first, last in zip([start, *cuts], [*cuts, end], strict=True):
            rows = np.unique(keys[first:last]).size
            if rows > best[1] and not _moves_to_and_fro(values[fresh[first:last]], back[first]):
                best = int(first), int(rows), int(back[first])
    first, rows, shift = best
    begin = int(fresh[first])
    return begin, rows, begin - int(fresh[first - shift])


def _moves_to_and_fro(values: Array, period: int) -> bool:
    """Return whether rows (n, k) that repeat are those of a simulation without noise.

    >>> angle = 2.0 * np.pi * np.arange(200)[:, None] / 50
    >>> _moves_to_and_fro(np.sin(angle), 50), _moves_to_and_fro(np.sin(angle[:50]), 50)
    (True, False)
    """
    if len(values) <= AGAIN * period:
        return False
    change = np.diff(values, axis=0)
    return float(np.linalg.norm(np.diff(change, axis=0))) < SMOOTH * float(np.linalg.norm(change))


def unusable_spans(log: CheckedLog) -> dict[str, list[Span]]:
    """Return the stretches by their finding, in seconds of the log.

    Seconds are judged one by one. Out of the water, or floating, and by hand are judged
    where actuators are logged alone.
    """
    length = (int(log.info.end_us) - int(log.info.start_us)) / 1e6
    streams = [name for name in OF_VEHICLE if log.has(name)]
    if not streams or not 1.0 <= length <= LONGEST_S:
        return {}
    seconds = int(np.ceil(length))
    absent = np.ones(seconds, dtype=bool)
    for name in streams:
        absent[_second(log.t_s(name), seconds)] = False
    masks = {"without_vehicle": absent}
    idle = _idle(log, seconds)
    if idle is not None and log.under_water is not False:
        if log.has("depth"):
            deepest = _largest(log.t_s("depth"), log.column("depth", "depth_m"), seconds)
            masks["out_of_water"] = idle & (deepest <= AT_SURFACE_M)
        if log.has("imu"):
            squares = np.sum(log.values("imu", GYRO) ** 2, axis=1)
            at = _second(log.t_s("imu"), seconds)
            count = np.bincount(at, minlength=seconds)
            mean = np.bincount(at, np.nan_to_num(squares), seconds) / np.maximum(count, 1)
            masks["moved_by_hand"] = idle & (mean > HAND_RAD_S**2)
    spans = {name: _spans(mask, limit(name), length) for name, mask in masks.items()}
    return {name: own for name, own in spans.items() if own}


def _second(t_s: Array, seconds: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    return np.clip(np.floor(t_s), 0, seconds - 1).astype(np.intp)


def _largest(t_s: Array, values: Array, seconds: int) -> Array:
    """Return the largest value of each second (seconds,); infinite without a sample."""
    largest = np.full(seconds, -np.inf)
    np.maximum.at(largest, _second(t_s, seconds), np.where(np.isfinite(values), values, np.inf))
    return np.where(np.isfinite(largest), largest, np.inf)


def _idle(log: CheckedLog, seconds: int) -> Mask | None:
    """Return the seconds in which nothing acts, nor shortly before; outputs hold."""
    acting = activity(log) if log.has("actuators") else None
    if acting is None:
        return None
    t_s, start = log.t_s("actuators"), np.arange(seconds, dtype=np.float64)
    first = np.maximum(np.searchsorted(t_s, start - COASTING_S, side="right") - 1, 0)
    last = np.searchsorted(t_s, start + 1.0, side="left")
    before = np.concatenate([[0], np.cumsum(acting)])
    inside = (start >= t_s[0]) & (start <= t_s[-1])
    return np.asarray(inside & (before[np.maximum(last, first)] == before[first]))


def _spans(mask: Mask, least_s: float, length: float) -> list[Span]:
    """Return the stretches of a mask over seconds that last longer than `least_s`."""
    at = np.flatnonzero(mask)
    if not at.size:
        return []
    parts = np.split(at, np.flatnonzero(np.diff(at) > PAUSE_S) + 1)
    spans = [(float(part[0]), min(float(part[-1]) + 1.0, length)) for part in parts]
    return [(start, end) for start, end in spans if end - start > least_s]
