"""Checks of the file, the clock, the rates and the samples of each stream."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np

from auvid.data_schemas.streams import STREAMS
from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.motion_checks import WINDOW_S
from auvid.hydro.identification.checks.signal_checks import (
    ClockStatistics,
    Repeats,
    flat_top,
    hold_period_s,
    repeats,
    rounding_step,
    slow_speed,
)
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, GYRO, LINEAR_VELOCITY, POSITION
from auvid.stages.ingest.health.agreement.velocity.velocity_depth import log_depth_rates
from auvid.stages.ingest.health.finding import (
    ON_CHANGE,
    CheckedLog,
    Finding,
    counted,
    finding,
    limit,
    listed,
)
from auvid.stages.ingest.rejection import BACKWARD, IMPOSSIBLE, REPEATED, USUAL_UNITS
from auvid.stages.number_format import percent, significant

CLOCK_NOTE = re.compile(r"clock (goes back|leaps|of the log was set)")
SHARED_NOTE = "are subscribed with one number"
LEAPS = re.compile(r"(\d+) times? in all|(\d+) time\(s\) in all")
STRAY_NOTE = re.compile(r"^(\d+) time stamp\(s\) of .* stray")
LEFT_OUT = (
    ": the poses there move other than those before allow, and 0.6 s on either side are left out"
)
GAP_STEPS = 3.0
"""A pause is a gap of a slow sensor only from this many steps on."""
OF_NONE = (
    "A number that stands for none (-999, -32.768) is left out; name its text under missing in the"
    " column map. Else check the unit."
)
OF_REASON: Mapping[tuple[str, ...], str] = {
    (IMPOSSIBLE,): OF_NONE,
    (BACKWARD,): (
        "Rows stand there twice, or in another order than they were measured: sort the table by its"
        " time and leave out what it has twice."
    ),
    (REPEATED,): (
        "Rows stand there twice, or their time is cut off: leave out what the table has twice, or"
        " export the time with all its digits."
    ),
}
MOTION = {
    "imu": GYRO,
    "attitude": ATTITUDE,
    "velocity": LINEAR_VELOCITY,
    "position": POSITION,
    "depth": ("depth_m",),
}
STEADY = (*MOTION, "actuators")
TIMED = ("imu", "attitude", "velocity", "depth", "actuators")
FASTEST_HZ = 3000.0
SLOWEST_HZ = {"imu": 0.05, "attitude": 0.05, "actuators": 0.05}
"""Depth and velocity of gliders come more slowly than that."""
USUAL_HZ = 10.0
FASTEST_DEPTH_HZ = 550.0
"""Rows of a table on one clock may come at 500 Hz; 10 Hz in minutes read as seconds are 600."""
TIME_UNITS = (
    (1e3, "it is in ms, declared as s (or us as ms)", "ms"),
    (1e6, "it is in us, declared as s", "us"),
    (1e9, "it is in ns, declared as s", "ns"),
    (60.0, "it is in seconds, declared as minutes", "s"),
    (1.0 / 60.0, "it is in minutes, declared as s", "min"),
    (1e-3, "it is in s, declared as ms (or ms as us, or hours as s)", "s"),
    (1e-6, "it is in s, declared as us", "s"),
)
"""Factor of the rates under the right unit, what is wrong, and the right unit."""
SAME_STEP, MOSTLY_REGULAR, NEARLY = 0.25, 0.8, 0.96
"""Steps so near the median are one step; a clock of which so much are that has losses, and is
not slow; a sensor of 5 Hz comes a little slower.
"""
MIN_STEP_RATIO = 4.0
"""Median step in smallest steps: below it a signal repeats because it hardly moves by
more than its resolution.
"""
MOST_LEVELS, FEWEST_CHANGES = 3, 3
"""Values of a depth that is rounded to steps as large as it moves, and how often it changes."""
LEAST_OF_SIZE_M_S = 0.03
"""Standard deviation of a surge that moves."""
SINKS_M = 0.2
"""What a velocity must move a depth by that repeats one value: a hull that rests does not."""
DEPTH_FACTOR = 10.0
"""Depth comes in steps of millimetres to centimetres, so the same value for a while is
nothing odd.
"""
ROUNDING = 1e-5
"""Part of the length of a log within which a column is that of the time."""
UNSIGNED_LOW = 0.2
"""Part of its usual size that a motion without signs falls below."""
USUAL_RUNS = 5
"""A run of repeats is none of a column's usual ones if it is so many times as long."""
MOSTLY_AT_REST = 0.7
"""Part of the zeros of an axis in which the others are zero as well, where it rests."""
MIN_LIVE_SAMPLES = 20
MIN_CLIPPED_RAD_S = 1.0
MOST_SPANS = 8
UNIT_WORDS = {"_rad_s": "rad/s", "_m_s2": "m/s^2", "_m_s": "m/s", "_m": "m"}
VELOCITY_STEP = limit("velocity_coarse")
COARSE = {"_rad_s": 0.02, "_m_s2": 0.2, "_m_s": 0.05, "_rad": math.radians(0.45), "_m": 0.09}
"""Steps of values beyond which rounding is most of their noise, by unit."""


def file_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield damage and truncation of the files, and clocks that jump."""
    for item in log.info.files:
        lost = [part for part in item.skipped if part.bytes]
        count = sum(part.bytes for part in lost)
        if item.status == "complete":
            continue
        reasons = "; ".join(
            f"{part.reason}: {part.bytes} bytes in {counted(part.count, 'place')}" for part in lost
        )
        seconds = (
            f", about {item.seconds_lost:.1f} s of recording lost" if item.seconds_lost else ""
        )
        text = (
            f"{item.name} is {item.status}: {count} of {item.size_bytes} bytes gave no"
            f" record{seconds} ({reasons or 'no end'})."
        )
        yield finding(
            "file_damaged" if item.status == "damaged" else "file_truncated", text, value=count
        )
    leaps = [note for note in log.info.notes if CLOCK_NOTE.search(note)]
    if leaps:
        matches = [LEAPS.search(note) for note in leaps]
        yield finding(
            "clock_leap",
            leaps[0],
            value=max(int(item[1] or item[2]) if item else 1 for item in matches),
        )
    for note in log.info.notes:
        if SHARED_NOTE in note:
            yield finding("shared_number", note)
        stray = STRAY_NOTE.match(note)
        if stray:
            yield finding("stray_stamps", note, value=int(stray[1]))


def rejected_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield rejected samples with the reasons, those of one table together."""
    rows = log.dropped.to_pylist()
    alike: dict[tuple[str, tuple[str, ...], str], list[tuple[int, float, str, str]]] = {}
    for stream in STREAMS:
        lost = [row for row in rows if row["stream"] == stream]
        count = sum(row["count"] for row in lost)
        total = count + (log.tables[stream].num_rows if stream in log.tables else 0)
        share = count / total if total else 0.0
        if share > limit("rejected_samples"):
            name = "most_rejected" if share > limit("most_rejected") else "rejected_samples"
            source = log.source(stream) if stream in log.info.streams else stream
            words = ", ".join(f"{row['reason']}: {row['count']}" for row in lost)
            key = name, tuple(sorted({row["reason"] for row in lost})), source
            alike.setdefault(key, []).append((count, share, words, stream))
    for (name, reasons, _), streams in alike.items():
        _, share, words, _ = max(streams)
        yield finding(
            name,
            f"{percent(share)} of the samples of {listed([item[-1] for item in streams])}"
            f" cannot be used ({words}).",
            stream=streams[0][-1] if len(streams) == 1 else None,
            value=share,
            remedy=OF_REASON.get(reasons, ""),
        )


def impossible_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield streams with so many impossible values that their unit must be wrong."""
    lost = {
        row["stream"]: row["count"]
        for row in log.dropped.to_pylist()
        if row["reason"] == IMPOSSIBLE and row["stream"] in USUAL_UNITS
    }
    for stream, count in lost.items():
        total = count + (log.tables[stream].num_rows if stream in log.tables else 0)
        if count / total > limit("impossible_values"):
            yield finding(
                "impossible_values",
                f"{percent(count / total)} of the samples of {stream} are impossible:"
                f" {USUAL_UNITS[stream]}.",
                stream=stream,
                value=count / total,
                fields=MOTION.get(stream, ()),
            )


def clock_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield time columns in a wrong unit, and streams that share no time."""
    wrong = []
    for stream in TIMED:
        clock = log.clock(stream) if log.has(stream) else None
        if clock is None:
            continue
        rate = 1.0 / clock.step_s
        fastest = FASTEST_DEPTH_HZ if stream == "depth" else FASTEST_HZ
        if rate > fastest or rate < SLOWEST_HZ.get(stream, 0.0):
            wrong.append((stream, rate))
    if wrong:
        stream, rate = wrong[0]
        factor, words, unit = min(
            TIME_UNITS, key=lambda item: abs(math.log(rate * item[0] / USUAL_HZ))
        )
        names = listed([stream for stream, _ in wrong])
        length = (int(log.info.end_us) - int(log.info.start_us)) / 1e6
        yield finding(
            "time_unit",
            f"{names} come{'s' if len(wrong) == 1 else ''} at {significant(rate)} Hz in a log of"
            f" {significant(length)} s: {words}, which gives {significant(rate * factor)} Hz.",
            stream=wrong[0][0] if len(wrong) == 1 else None,
            value=rate,
            fields=("time_us",),
            remedy=f"Set unit: {unit} for the time column.",
        )
        return
    spans = {
        stream: (float(log.t_s(stream)[0]), float(log.t_s(stream)[-1]))
        for stream in TIMED
        if log.has(stream) and log.tables[stream].num_rows >= MIN_LIVE_SAMPLES
    }
    disjoint = [
        f"{stream} {start:.6g} to {end:.6g} s"
        for stream, (start, end) in spans.items()
        if any(min(end, b) <= max(start, a) for other, (a, b) in spans.items() if other != stream)
    ]
    if disjoint:
        yield finding(
            "streams_apart",
            f"Streams share no time: {'; '.join(disjoint)}.",
            fields=("time_us",),
        )


def gap_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield pauses of the sensors; those that several sensors share are one finding."""
    gaps: list[tuple[str, int, float, float]] = []
    for stream in log.tables:
        clock = None if stream in ON_CHANGE else log.clock(stream)
        if clock is None:
            continue
        least = max(limit("gap"), GAP_STEPS / clock.rate_hz)
        if clock.longest_s > least:
            gaps.append(
                (
                    stream,
                    int(np.count_nonzero(np.diff(log.t_s(stream)) > least)),
                    clock.longest_s,
                    clock.longest_at_s,
                )
            )
    if not gaps:
        return
    _, _, longest, at = max(gaps, key=lambda item: item[2])
    shared = [
        item for item in gaps if abs(item[3] - at) < 1.0 + 0.1 * longest and item[2] > 0.5 * longest
    ]
    names = [item[0] for item in shared]
    each = {item[1] for item in shared}
    where = (
        f"{counted(each.pop(), 'gap')} in {listed(names)}"
        if len(each) == 1
        else f"Gaps in {listed([f'{a} ({n})' for a, n, *_ in shared])}"
    )
    text = f"{where}, the longest of {longest:.1f} s at {at:.1f} s from the start"
    text += f"{LEFT_OUT if _is_cut(log, at, at + longest) else ''}."
    yield finding("gap", text, stream=names[0] if len(names) == 1 else None, value=longest, at_s=at)
    rest = [item for item in gaps if item not in shared]
    if rest:
        parts = [f"{name} ({number}, up to {longest:.1f} s)" for name, number, longest, _ in rest]
        largest = max(rest, key=lambda item: item[2])
        only = rest[0][0] if len(rest) == 1 else None
        yield finding(
            "gap", f"Gaps in {listed(parts)}.", stream=only, value=largest[2], at_s=largest[3]
        )


def _is_cut(log: CheckedLog, start_s: float, end_s: float) -> bool:
    """Return whether poses are there, and a jump of their track cuts them out."""
    if log.track is None:
        return False
    begin = float(log.t_s("pose")[0])
    return any(
        item.kind == "jump" and start_s <= begin + item.end_s <= end_s for item in log.track.faults
    )


def rate_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield slow and irregular clocks."""
    for stream in log.tables:
        clock = None if stream in ON_CHANGE else log.clock(stream)
        if clock is None:
            continue
        rate = f"{stream} ({log.source(stream)}) comes at {significant(clock.rate_hz)} Hz"
        if stream == "actuators" and clock.rate_hz < limit("low_actuator_rate"):
            yield finding("low_actuator_rate", f"{rate}.", stream=stream, value=clock.rate_hz)
        elif stream == "actuators" and (outputs := log.thrusters() + log.commands()):
            period = hold_period_s(log.t_s(stream), log.values(stream, outputs))
            if period is not None and LONGEST_HOLD_S > period > 1.0 / limit("low_actuator_rate"):
                text = f"{rate}, and its values change every {period:g} s only: they are held."
                yield finding("low_actuator_rate", text, stream=stream, value=1.0 / period)
        sampled_hz = _sampled_hz(log.t_s(stream), clock)
        if stream in ("imu", "attitude", "velocity") and sampled_hz < NEARLY * limit("low_rate"):
            yield finding("low_rate", f"{rate}.", stream=stream, value=clock.rate_hz)
        if stream in STEADY and clock.relative_jitter > limit("irregular_rate"):
            text = (
                f"The steps of {stream} ({log.source(stream)}) scatter by"
                f" {significant(clock.relative_jitter)} times their median."
            )
            yield finding("irregular_rate", text, stream=stream, value=clock.relative_jitter)


def _sampled_hz(t_s: Array, clock: ClockStatistics) -> float:
    """Return the rate of a clock: of its usual step where the others are losses."""
    regular = np.abs(np.diff(t_s) / clock.step_s - 1.0) < SAME_STEP
    return max(clock.rate_hz, 1.0 / clock.step_s if np.mean(regular) > MOSTLY_REGULAR else 0.0)


def _between_levels(depth: Array) -> float | None:
    """Return the step of a depth (n,) of two or three values between which it goes."""
    levels = np.unique(depth[np.isfinite(depth)])
    changes = int(np.count_nonzero(np.diff(depth)))
    if not 1 < levels.size <= MOST_LEVELS or changes < FEWEST_CHANGES:
        return None
    return float(np.diff(levels).min())


def sample_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield constant, stuck and held samples, and a gyro at the end of its range."""
    for stream, names in MOTION.items():
        if stream in log.tables and log.tables[stream].num_rows >= MIN_LIVE_SAMPLES:
            yield from _live(log, stream, names)
    accelerometer = log.accelerometer()
    if accelerometer is not None:
        still = _constant(ACCELEROMETER, accelerometer)
        yield from _constant_findings("imu", ACCELEROMETER, accelerometer, still)
        if len(still) < len(ACCELEROMETER):
            yield from _stuck_accelerometer(log, accelerometer)
    if log.has("imu"):
        rates = log.values("imu", GYRO)
        clipped = [
            flat_top(axis) if np.abs(axis).max() > MIN_CLIPPED_RAD_S else 0 for axis in rates.T
        ]
        worst = int(np.argmax(clipped))
        if clipped[worst] > limit("gyro_saturated") and repeats(rates).share < limit(
            "held_samples"
        ):
            top = float(np.abs(rates[:, worst]).max())
            text = (
                f"Gyro {'xyz'[worst]} stands at its extreme of {significant(top)} rad/s in"
                f" {clipped[worst]} samples."
            )
            yield finding("gyro_saturated", text, stream="imu", value=clipped[worst])


LONGEST_HOLD_S = 1.2
"""Of a slow record; a pilot or a plan that steps holds its outputs for longer."""


def coarse_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield streams whose values are rounded to steps that hide what they measure."""
    for stream, names in {**MOTION, "imu": (*GYRO, *ACCELEROMETER)}.items():
        if not log.has(stream) or stream == "position":
            continue
        there = [name for name in names if name in log.tables[stream].column_names]
        steps = {name: rounding_step(log.column(stream, name)) for name in there}
        if stream == "depth" and steps["depth_m"] is None:
            steps["depth_m"] = _between_levels(log.column("depth", "depth_m"))
        coarse = {
            name: step
            for name, step in steps.items()
            if step is not None and step > _of_unit(COARSE, name)
        }
        if not coarse or (stream == "velocity" and max(coarse.values()) >= VELOCITY_STEP):
            continue  # which is velocity_coarse
        parts = [f"{name} in steps of {_in_words(step, name)}" for name, step in coarse.items()]
        yield finding(
            "values_coarse",
            f"{stream} ({log.source(stream)}) is rounded: {listed(parts)}.",
            stream=stream,
            value=max(coarse.values()),
            fields=tuple(coarse),
        )


def _of_unit(limits: Mapping[str, float], name: str) -> float:
    return next(
        limits[unit] for unit in sorted(limits, key=len, reverse=True) if name.endswith(unit)
    )


def _in_words(step: float, name: str) -> str:
    if name.endswith("_rad"):
        return f"{significant(math.degrees(step))} degrees"
    unit = next(words for end, words in UNIT_WORDS.items() if name.endswith(end))
    return f"{significant(step)} {unit}"


def _is_time(t_s: Array, values: Array) -> bool:
    """Return whether a column rises or falls by one a second, to rounding."""
    rising = np.sign(values[-1] - values[0]) * values - t_s
    return bool(np.ptp(rising) < ROUNDING * np.ptp(t_s))


def _live(log: CheckedLog, stream: str, names: tuple[str, ...]) -> Iterator[Finding]:
    values, t_s = log.values(stream, names), log.t_s(stream)
    still = _constant(names, values)
    for first, second in combinations([n for n in range(len(names)) if n not in still], 2):
        alike = np.array_equal(values[:, first], values[:, second], equal_nan=True)
        if alike and np.isfinite(values[:, first]).any():
            yield finding(
                "columns_alike",
                f"{names[first]} and {names[second]} of {stream} ({log.source(stream)}) are the"
                " same in every sample.",
                stream=stream,
                fields=(names[first], names[second]),
            )
    for number, name in enumerate(names):
        if number not in still and _is_time(t_s, values[:, number]):
            yield finding(
                "columns_alike",
                f"{name} of {stream} ({log.source(stream)}) counts the seconds of its own time"
                " stamps: the column of the time is mapped to it.",
                stream=stream,
                fields=(name,),
                remedy="Correct the columns of the column map.",
            )
    if stream == "velocity" and (values[:, 1:].min() >= 0.0 or values[:, 1:].max() <= 0.0):
        low, high = np.percentile(np.abs(values[:, 1:]), (5.0, 95.0), axis=0)
        if (high > limit("velocity_unsigned")).all() and (low < UNSIGNED_LOW * high).all():
            yield finding(
                "velocity_unsigned",
                f"Sway and heave of the velocity ({log.source(stream)}) have one sign in all"
                f" {len(values)} samples and come near zero again and again.",
                stream=stream,
                value=float(high.min()),
                fields=names[1:],
            )
    frozen = [index for index in still if stream == "velocity" and values[0, index] != 0.0]
    if frozen and len(still) < len(names):
        index = frozen[0]
        yield finding(
            "velocity_frozen",
            f"{listed([names[i] for i in frozen])} of the velocity ({log.source(stream)})"
            f" {'is' if len(frozen) == 1 else 'are'} constant ({significant(values[0, index])} m/s)"
            " from the first to the last sample, while the rest of it changes.",
            stream=stream,
            value=float(values[0, index]),
            fields=tuple(names[i] for i in frozen),
        )
        still = [index for index in still if index not in frozen]
    yield from _constant_findings(stream, names, values, still)
    if len(still) == len(names):
        return
    same = repeats(values)
    last = same.run_start + same.run_count - 1
    run_s = float(t_s[last] - t_s[same.run_start])
    longest = limit("stuck_sensor")
    if stream == "depth" and not _sinks_in(log, float(t_s[same.run_start]), float(t_s[last])):
        longest *= DEPTH_FACTOR
    stuck = run_s > longest and same.run_count >= MIN_LIVE_SAMPLES and same.leap > MIN_STEP_RATIO
    stuck = stuck and not (stream == "velocity" and _rests(values, same.run_start, last))
    if stuck:
        text = (
            f"{stream} ({log.source(stream)}) repeats one value for {run_s:.1f} s from"
            f" {t_s[same.run_start]:.1f} s on{_other_runs(t_s, values, same.run_start, longest)}."
        )
        yield finding("stuck_sensor", text, stream=stream, value=run_s)
    elif len(names) > 1:
        yield from _stuck_columns(log, stream, names, still)
    if stream != "depth":
        moving = np.delete(values, slice(same.run_start, last), axis=0) if stuck else values
        if stream == "velocity":
            moving = moving[moving.any(axis=1)]  # zeros may be a rest
        share = repeats(moving).share
        if share > limit("held_samples") and same.leap > MIN_STEP_RATIO:
            rate = float(1.0 / np.median(np.diff(t_s)))
            text = (
                f"{percent(share)} of the samples of {stream} ({log.source(stream)}) repeat the one"
                f" before: written at {significant(rate)} Hz, new values come at"
                f" {significant(rate * (1.0 - share))} Hz."
            )
            yield finding("held_samples", text, stream=stream, value=share)
        elif stream == "velocity":
            yield from _held_columns(log, names, moving)


def _held_columns(log: CheckedLog, names: tuple[str, ...], moving: Array) -> Iterator[Finding]:
    """Yield single axes of the velocity that repeat while the others do not."""
    shares = {
        name: same.share
        for name, same in zip(names, map(repeats, moving.T[..., None]), strict=True)
        if limit("held_samples") < same.share < 1.0 and same.leap > MIN_STEP_RATIO
    }
    if 0 < len(shares) < len(names):
        parts = [f"{name} in {percent(share)} of the samples" for name, share in shares.items()]
        yield finding(
            "held_samples",
            f"Single axes of the velocity ({log.source('velocity')}) repeat the value before:"
            f" {listed(parts)}; the others bring new ones.",
            stream="velocity",
            value=max(shares.values()),
            fields=tuple(shares),
        )


def _other_runs(t_s: Array, values: Array, but: int, longest_s: float) -> str:
    """Return when other long runs of one value begin, in words."""
    starts = np.flatnonzero(np.append(True, (np.diff(values, axis=0) != 0.0).any(axis=1)))
    ends = np.append(starts[1:], len(values)) - 1
    long = (t_s[ends] - t_s[starts] > longest_s) & (ends - starts + 1 >= MIN_LIVE_SAMPLES)
    others = [f"{t_s[start]:.1f}" for start in starts[long] if start != but]
    if not others:
        return ""
    more = f" and {len(others) - MOST_SPANS} more" if len(others) > MOST_SPANS else ""
    return f", and others from {', '.join(others[:MOST_SPANS])}{more} s on"


def _rests(velocity: Array, first: int, last: int) -> bool:
    """Return whether samples of a velocity (n, 3) are zeros between slow ones."""
    ends = velocity[[max(first - 1, 0), min(last + 1, len(velocity) - 1)]]
    zero = not velocity[first : last + 1].any()
    return zero and bool(np.abs(ends).max() <= slow_speed(velocity))


def _rests_in(velocity: Array, index: int, same: Repeats) -> bool:
    """Return whether an axis is zero while all of the velocity (n, 3) mostly rests."""
    run = slice(same.run_start, same.run_start + same.run_count)
    at_rest = np.flatnonzero(~velocity[run].any(axis=1)) + same.run_start
    if velocity[run, index].any() or at_rest.size < MOSTLY_AT_REST * same.run_count:
        return False
    return _rests(velocity, int(at_rest[0]), int(at_rest[-1]))


def _stuck_accelerometer(log: CheckedLog, values: Array) -> Iterator[Finding]:
    """Yield an accelerometer that repeats one value for long while the gyro goes on."""
    t_s, same = log.t_s("imu"), repeats(values)
    run = slice(same.run_start, same.run_start + same.run_count)
    run_s = float(np.ptp(t_s[run]))
    if run_s <= limit("stuck_sensor") or same.run_count < MIN_LIVE_SAMPLES:
        return
    if same.leap <= MIN_STEP_RATIO or not np.ptp(log.values("imu", GYRO)[run], axis=0).any():
        return
    yield finding(
        "stuck_sensor",
        f"The accelerometer ({log.source('imu')}) repeats one value for {run_s:.1f} s from"
        f" {t_s[same.run_start]:.1f} s on, while the gyro goes on.",
        stream="imu",
        value=run_s,
        at_s=float(t_s[same.run_start]),
        fields=ACCELEROMETER,
    )


def _sinks_in(log: CheckedLog, start_s: float, end_s: float) -> bool:
    """Return whether the velocity moves the depth between two times."""
    rates = log_depth_rates(log) if log.has("depth", "velocity", "attitude") else None
    if rates is None:
        return False
    inside = (rates.at >= start_s) & (rates.at < end_s - WINDOW_S)
    return bool(inside.any()) and float(np.ptp(np.cumsum(rates.expected[inside]))) > SINKS_M


def _stuck_columns(
    log: CheckedLog, stream: str, names: tuple[str, ...], still: list[int]
) -> Iterator[Finding]:
    """Yield columns that repeat one value for long while the others go on."""
    t_s = log.t_s(stream)
    for index, name in enumerate(names):
        column = log.column(stream, name)[:, None]
        same = repeats(column)
        last = same.run_start + same.run_count - 1
        run_s = float(t_s[last] - t_s[same.run_start])
        if (
            index in still
            or run_s <= limit("stuck_sensor")
            or same.run_count < MIN_LIVE_SAMPLES
            or same.leap <= MIN_STEP_RATIO
        ):
            continue
        if stream == "velocity" and _rests_in(log.values(stream, names), index, same):
            continue
        # A column that is held again and again, or cut off at zero, repeats by design.
        rest = repeats(np.delete(column, slice(same.run_start, last), axis=0))
        if USUAL_RUNS * max(rest.run_count, 2) < same.run_count:
            yield finding(
                "stuck_sensor",
                f"{name} of {stream} ({log.source(stream)}) repeats one value for {run_s:.1f} s"
                f" from {t_s[same.run_start]:.1f} s on, while the rest of the stream changes.",
                stream=stream,
                value=run_s,
                at_s=float(t_s[same.run_start]),
                fields=(name,),
            )


def _constant(names: tuple[str, ...], values: Array) -> list[int]:
    """Return the indices of the columns that never change."""
    live = [values[np.isfinite(values[:, index]), index] for index in range(len(names))]
    return [
        index
        for index, column in enumerate(live)
        if column.size >= MIN_LIVE_SAMPLES and np.ptp(column) == 0.0
    ]


def _constant_findings(
    stream: str, names: tuple[str, ...], values: Array, still: list[int]
) -> Iterator[Finding]:
    if still:
        level = float(np.nanmax(values[:, still[0]]))
        parts = [
            f"{names[index]} = {significant(float(np.nanmax(values[:, index])))}" for index in still
        ]
        text = f"Constant in all {len(values)} samples of {stream}: {listed(parts)}."
        if stream == "velocity" and still == [1] and _is_size(values[:, 0]):
            text += (
                " Surge is never negative: it is the size of the velocity, as receivers of"
                " satellites give it, and no velocity in axes of the body."
            )
        yield finding("constant_signal", text, stream=stream, value=level)


def _is_size(surge: Array) -> bool:
    """Return whether a surge moves and is never negative."""
    return bool(np.nanmin(surge) >= 0.0 and np.nanstd(surge) > LEAST_OF_SIZE_M_S)
