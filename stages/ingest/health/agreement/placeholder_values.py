"""Checks for numbers that a recorder writes where a sensor gave none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.tables import column
from auvid.hydro.arrays import Array, Mask, runs_of
from auvid.hydro.identification.checks.placeholders import FEWEST_ROWS, placeholder
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, GYRO, LINEAR_VELOCITY
from auvid.stages.ingest.health.agreement.velocity.velocity_samples import lost_zeros, short_zeros
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed
from auvid.stages.number_format import percent, significant

SIGNALS: Mapping[str, tuple[str, ...]] = {
    "attitude": ATTITUDE,
    "imu": (*GYRO, *ACCELEROMETER),
    "velocity": LINEAR_VELOCITY,
    "depth": ("depth_m",),
}
LEAST = {"_rad": 0.02, "_rad_s": 0.02, "_m_s2": 0.5, "_m_s": 0.02, "_m": 0.05}
"""What a number leaps by at least, by the unit of its column: finer steps are rounding."""


LONG_S, MOST_SPANS = 2.0, 8
"""Stretches of such numbers that are named by their times, at most so many."""


@dataclass(frozen=True)
class Placeholders:
    """Numbers that stand for none, by column of a stream, and their rows (n,)."""

    numbers: Mapping[str, float]
    rows: Mask


def placeholders(log: CheckedLog) -> dict[str, Placeholders]:
    """Return the numbers that stand for none, by stream."""
    by_stream = {}
    for stream, names in SIGNALS.items():
        if not log.has(stream) or log.tables[stream].num_rows < FEWEST_ROWS:
            continue
        t_s, numbers = log.t_s(stream), {}
        rows = np.zeros(t_s.size, dtype=np.bool_)
        for name in set(names) & set(log.tables[stream].column_names):
            values = column(log.tables[stream], name)
            spotted = placeholder(t_s, values, _least(name), angle=name.endswith("_rad"))
            if spotted is not None:
                numbers[name], rows = spotted[0], rows | spotted[1]
        if stream == "velocity" and not numbers:
            rows = lost_zeros(t_s, log.values("velocity", LINEAR_VELOCITY))
            if rows.any():
                numbers = dict.fromkeys(LINEAR_VELOCITY, 0.0)
        if stream == "imu" and not numbers:
            rows = short_zeros(t_s, log.values("imu", GYRO), LEAST["_rad_s"])
            if float(rows.mean()) > limit("placeholder_values"):
                numbers = dict.fromkeys(GYRO, 0.0)
        if numbers:
            ordered = {name: numbers[name] for name in names if name in numbers}
            by_stream[stream] = Placeholders(ordered, rows)
    return by_stream


def _least(name: str) -> float:
    return next(LEAST[unit] for unit in sorted(LEAST, key=len, reverse=True) if name.endswith(unit))


def placeholder_findings(
    log: CheckedLog, by_stream: Mapping[str, Placeholders]
) -> Iterator[Finding]:
    """Yield the numbers that stand for none in each stream."""
    for stream, spotted in by_stream.items():
        share = float(spotted.rows.mean())
        numbers = [f"{name} = {significant(number)}" for name, number in spotted.numbers.items()]
        yield finding(
            "placeholder_values",
            f"{percent(share)} of the samples of {stream} ({log.source(stream)}) leap to one"
            f" number and come back{_stretches(log.t_s(stream), spotted.rows)}: {listed(numbers)}"
            " stands for no value.",
            stream=stream,
            value=share,
            at_s=float(log.t_s(stream)[np.flatnonzero(spotted.rows)[0]]),
            fields=tuple(spotted.numbers),
        )


def _stretches(t_s: Array, rows: Mask) -> str:
    """Return when the long ones begin, and how long they last, in words."""
    spans = [(t_s[first], t_s[end - 1]) for first, end in runs_of(rows)]
    longer = [f"{start:.1f} to {end:.1f}" for start, end in spans if end - start > LONG_S]
    if not longer:
        return ""
    more = f" and {len(longer) - MOST_SPANS} more" if len(longer) > MOST_SPANS else ""
    return f" (from {', '.join(longer[:MOST_SPANS])} s{more})"


def without_placeholders(log: CheckedLog, by_stream: Mapping[str, Placeholders]) -> CheckedLog:
    """Return the log without these rows, so that no second cause is named for them."""
    if not by_stream:
        return log
    kept = {name: log.tables[name].filter(~spotted.rows) for name, spotted in by_stream.items()}
    return replace(log, tables={**log.tables, **kept}, _times={})
