"""Which logs are of one dive: by equal samples, the clock, and depth and heading."""

from __future__ import annotations

import datetime
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from auvid.data_schemas.records.fleet import LogSurvey, MotionTrace
from auvid.hydro.arrays import Array
from auvid.pipeline.commands.check.motion_trace import OVERLAP, agreement, turns
from auvid.pipeline.commands.fleet.surveys.repeated_rows import repeated

PROMISING = 0.75
"""Peak of the plain correlation from which on a pair is looked at in full. Of 720 pairs of
one dive of a minute, a third of it missing and the samples half a step off, all but 1 or 2
exceed it; of half a million pairs of 1013 dives one in a hundred.
"""
STEP_S = 0.5
PADDING = 2
LEAST_ENERGY = 1e-3
"""Share of a log's turning below which nothing turned."""
UTC = "%Y-%m-%dT%H:%M:%SZ"


@dataclass(frozen=True)
class SameDive:
    """Two logs of one dive: the better one, the other, and what shows it."""

    better: str
    other: str
    words: str


@dataclass
class Compared:
    """What comparisons gave: keys of surveys of which every two were compared.

    words: keys of two logs of one dive -> how they agree.
    """

    keys: set[str] = field(default_factory=set)
    words: dict[tuple[str, str], str] = field(default_factory=dict)


def same_dives(surveys: Sequence[LogSurvey], compared: Compared | None = None) -> list[SameDive]:
    """Return the pairs of logs of one dive; a log is `other` in one pair at most.

    `compared`: of an earlier call; it is brought up to date, and only new logs are
    compared. Two logs with a clock are of one dive where half of the shorter one is
    shared, and depth or yaw rate agree. Where a clock is missing, only recorders of
    different formats are compared, at any shift. Whatever the clock, two logs with the same
    samples bit for bit are of one dive.
    """
    compared = Compared() if compared is None else compared
    fit = [item for item in surveys if item.motion is not None and not item.reason]
    by_id = {item.id: item for item in fit}
    fresh = {item.id for item in fit if item.key not in compared.keys}
    for first, second in _candidates(fit, fresh):
        words = _agreement(by_id[first], by_id[second])
        if words:
            compared.words[by_id[first].key, by_id[second].key] = words
    of_key = {item.key: item.id for item in fit}
    compared.keys = set(of_key)
    compared.words = {
        keys: words for keys, words in compared.words.items() if compared.keys.issuperset(keys)
    }
    pairs: list[SameDive] = []
    gone: set[str] = set()
    agreeing = {
        tuple(sorted(of_key[key] for key in keys)): words for keys, words in compared.words.items()
    }
    usable = [item for item in surveys if not item.reason]
    agreeing |= {tuple(sorted(names)): words for *names, words in repeated(usable)}
    by_id |= {item.id: item for item in usable}
    for names, words in sorted(agreeing.items()):
        if gone.isdisjoint(names):
            better, other = sorted(names, key=lambda name: _merit(by_id[name]))[::-1]
            gone.add(other)
            pairs.append(SameDive(better, other, words))
    return pairs


def _merit(log: LogSurvey) -> tuple[bool, bool, int, float, int, bool, str]:
    """Return what makes a log the better one of a dive, the larger the better.

    Of two that are alike the one with a clock has a place among the other dives.
    """
    return (
        log.kind == "identification",
        not log.lacking,
        len(log.streams),
        log.legs_s,
        log.rows,
        log.start_utc is not None,
        log.id,
    )


def with_clocks(
    surveys: Mapping[str, LogSurvey], pairs: Sequence[SameDive]
) -> dict[str, LogSurvey]:
    """Return surveys by id; a dive without a clock has that of its other recorder.

    Its day is that of the dive; the two may have been switched on minutes apart.
    """
    starts = {
        pair.better: surveys[pair.other].start_utc
        for pair in pairs
        if surveys[pair.other].start_utc is not None
    }
    return {
        name: item.model_copy(update={"start_utc": starts[name]})
        if item.start_utc is None and name in starts
        else item
        for name, item in surveys.items()
    }


def _start_s(log: LogSurvey) -> float | None:
    if log.start_utc is None:
        return None
    start = datetime.datetime.strptime(log.start_utc, UTC).replace(tzinfo=datetime.UTC)
    return start.timestamp()


def _by_clock(logs: Sequence[LogSurvey]) -> list[tuple[str, str]]:
    """Return the pairs of logs that share enough of their time in UTC."""
    spans = sorted(
        (start, start + log.duration_s, log.id)
        for log in logs
        if (start := _start_s(log)) is not None
    )
    pairs = []
    for place, (start, end, name) in enumerate(spans):
        for other_start, other_end, other in spans[place + 1 :]:
            if other_start >= end:
                break
            shorter = max(min(end - start, other_end - other_start), 1e-9)
            if (min(end, other_end) - other_start) / shorter >= OVERLAP:
                pairs.append((name, other))
    return pairs


def _candidates(logs: Sequence[LogSurvey], fresh: Collection[str]) -> list[tuple[str, str]]:
    """Return the pairs with a fresh log that may be of one dive.

    Those by the clock, and those of other formats of which one has no clock; where both
    turn, only those whose yaw rates look alike, and of two without a clock that hold their
    heading those whose depth rates do.
    """
    by_clock = {frozenset(pair) for pair in _by_clock(logs) if pair[0] in fresh or pair[1] in fresh}
    turning = {log.id: rates for log in logs if (rates := _yaw_rates(log)).size}
    steady = {
        log.id: rates
        for log in logs
        if log.id not in turning and (rates := _depth_rates(log)).any()
    }
    pairs = [(a, b) for a, b in sorted(map(sorted, by_clock)) if not {a, b} <= turning.keys()]
    pairs += _alike([log for log in logs if log.id in turning], turning, fresh, by_clock)
    pairs += _alike([log for log in logs if log.id in steady], steady, fresh, set())
    return pairs


def _alike(
    logs: Sequence[LogSurvey],
    uniform: Mapping[str, Array],
    fresh: Collection[str],
    by_clock: Collection[frozenset[str]],
) -> list[tuple[str, str]]:
    """Return the pairs by the clock, or without one, whose signals look alike.

    All are compared at once: correlation at every shift is a product of spectra, over the
    root of the energies of both where they overlap.
    """
    if len(logs) < 2:
        return []
    logs = sorted(logs, key=lambda log: (uniform[log.id].size, log.id))
    signals = [uniform[log.id] for log in logs]
    longest = signals[-1].size
    length = PADDING * longest
    spectra = np.stack([np.fft.rfft(signal, length) for signal in signals])
    # Energy up to each sample, once more round: a shift may wrap.
    energy = np.zeros((len(signals), length + longest + 1))
    for row, signal in zip(energy, signals, strict=True):
        row[1 : signal.size + 1] = row[length + 1 : length + signal.size + 1] = signal**2
    np.cumsum(energy, axis=1, out=energy)
    shifts, sizes = np.arange(length), np.array([signal.size for signal in signals])
    pairs: list[tuple[str, str]] = []
    for place, log in enumerate(logs):
        others = [
            index
            for index in range(place + 1, len(logs))
            if (log.id in fresh or logs[index].id in fresh)
            and (
                frozenset((log.id, logs[index].id)) in by_clock
                or (
                    logs[index].formats != log.formats
                    and (log.start_utc is None or logs[index].start_utc is None)
                )
            )
        ]
        if not others:
            continue
        own = signals[place].size
        within = energy[others, own : own + length] - energy[others, :length]
        product = np.fft.irfft(spectra[place].conj() * spectra[others], length)
        # Of the shorter log, the part that the longer one has at that shift.
        ahead = np.where(shifts > length - own, shifts - length, shifts)
        first, last = np.clip(-ahead, 0, own), np.clip(sizes[others, None] - ahead, 0, own)
        part = energy[place, last] - energy[place, first]
        scores = product / np.sqrt(np.maximum(within * part, LEAST_ENERGY))
        half = own * OVERLAP
        outside = (shifts < length - half) & (shifts > sizes[others, None] - half)
        peaks = np.where(outside, 0.0, scores).max(axis=1)
        pairs += [(log.id, logs[others[index]].id) for index in np.flatnonzero(peaks >= PROMISING)]
    return pairs


def _yaw_rates(log: LogSurvey) -> Array:
    """Return the yaw rate of a log at `STEP_S`, empty where it holds its heading."""
    motion = log.motion
    if motion is None or not motion.yaw_rate_rad_s or not turns(motion):
        return np.empty(0)
    return _uniform(motion, np.array([item or 0.0 for item in motion.yaw_rate_rad_s]))


def _depth_rates(log: LogSurvey) -> Array:
    motion = log.motion
    if motion is None or len(motion.depth_m) < 2:
        return np.empty(0)
    depth = np.array([np.nan if item is None else item for item in motion.depth_m])
    return _uniform(motion, np.nan_to_num(np.diff(depth)))


def _uniform(motion: MotionTrace, values: Array) -> Array:
    """Return rates of a log at `STEP_S`, of unit norm, 0 where there are none."""
    times = motion.step_s * np.arange(values.size)
    signal: Array = np.interp(np.arange(0.0, times[-1] + STEP_S, STEP_S), times, values)
    signal = signal - signal.mean()
    return signal / max(float(np.linalg.norm(signal)), 1e-12)


def _agreement(first: LogSurvey, second: LogSurvey) -> str:
    """Return in words how two logs agree; empty where they do not, or nothing tells."""
    assert first.motion is not None
    assert second.motion is not None
    by_clock = None not in (_start_s(first), _start_s(second))
    shorter = min(first.duration_s, second.duration_s)
    return agreement(first.motion, second.motion, shorter, by_clock=by_clock) or ""


def refusals(pairs: Sequence[SameDive], names: Mapping[str, str]) -> dict[str, str]:
    """Return why the other log of each pair is not used; `names`: log -> its file."""
    return {
        pair.other: f"the same dive as {names[pair.better]}, which serves better: {pair.words}"
        for pair in pairs
    }
