"""The column of a CSV file that is its time, with its unit and epoch."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import LogError
from auvid.hydro.arrays import Array
from auvid.stages.ingest.formats.csv.clock_digits import (
    CLOCK_DIGITS,
    DAY_S,
    clock_seconds,
    counts_like_a_clock,
)
from auvid.stages.ingest.formats.csv.column_map import TEXT_TIMES
from auvid.stages.ingest.formats.csv.column_names import (
    NamedColumn,
)
from auvid.stages.ingest.formats.csv.draft.cell_faults import time_fault
from auvid.stages.ingest.formats.csv.reader import TIME_OF_DAY, iso_microseconds

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Length of a unit of time [s]."""
UNIX_TIMES = ((9e17, "ns"), (9e14, "us"), (9e11, "ms"), (9e8, "s"))
"""Unix time of this century in the unit is beyond this number."""
NANOSECONDS = re.compile(r" ?\b(?:secs?|seconds|n(?:ano)?secs?|nanoseconds|ns)$")
"""How stamps in two columns call them."""
SPREADSHEET_DAYS = (2e4, 8e5)
"""Days since 1900 of spreadsheets, and since the year 0, in this century."""
POSSIBLE_STEPS = (5e-4, 10.0)
"""Steps [s] between rows of a log."""
FEW_SECONDS = 2.0
"""Rows this many seconds apart, and more, may be rows as many ms apart."""
SHORTEST_LOG_S = 20.0
"""A log of hundreds of rows a second is no shorter."""
UNEVEN = 0.1
"""A share of the step: what logs hundreds of rows a second is more even, fixes are not."""


def time_column(
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
    texts: Mapping[str, Sequence[str]],
    file: str,
) -> tuple[dict[str, str], str]:
    """Return the entry `time` of the map, and what of it was assumed."""
    named = sorted(
        (item for item in columns if item.may_be_time), key=lambda item: not item.is_time
    )
    unnamed = [item for item in columns if item not in named]
    for item in named:
        _check_days(item, values[item.name], file)
        entry = _clock(item, values[item.name], texts[item.name])
        if entry is not None:
            return entry[0] | _nanoseconds(item, entry[0], columns, values), entry[1]
    for item in unnamed:
        steps = np.diff(values[item.name])
        if item.place is None and steps.size > 10 and (steps > 0.0).all():
            _check_days(item, values[item.name], file)
            entry = _clock(item, values[item.name], texts[item.name])
            if entry is not None:
                return entry[0], f"no name says time; this column rises in every row; {entry[1]}"
    faults = [time_fault(item, values[item.name], texts[item.name]) for item in named]
    what = next(filter(None, faults), "no column rises")
    raise LogError(
        f"no column is the time of the rows: {what}",
        file=file,
        row=1,
        value=", ".join(item.name for item in named or columns[:6]) or "no column",
        allowed="seconds, ms, us or ns that rise, Unix time, ISO 8601 text, or hh:mm:ss",
        remedy="Export the log with such a column, named time_s.",
    )


def _check_days(item: NamedColumn, values: Array, file: str) -> None:
    """Raise `LogError` for a time that counts days, as those of spreadsheets do."""
    finite = values[np.isfinite(values)]
    if finite.size < 3 or not SPREADSHEET_DAYS[0] < np.median(finite) < SPREADSHEET_DAYS[1]:
        return
    step_s = DAY_S * float(finite[-1] - finite[0]) / (finite.size - 1)
    if POSSIBLE_STEPS[0] <= step_s <= POSSIBLE_STEPS[1]:
        raise LogError(
            f"the time counts days, as spreadsheets do: one row every {step_s:.3g} s",
            file=file,
            row=2,
            field=item.name,
            value=float(finite[0]),
            allowed="seconds, ms, us or ns that rise, Unix time, ISO 8601 text, or hh:mm:ss",
            remedy=f"Multiply it by {DAY_S:.0f} for seconds, with all its digits.",
        )


def _clock(
    item: NamedColumn, values: Array, texts: Sequence[str]
) -> tuple[dict[str, str], str] | None:
    """Return the entry of a time column, and what was assumed; None for no clock."""
    finite = values[np.isfinite(values)]
    if finite.size < 0.9 * len(texts) or finite.size < 3:
        filled = [text for text in texts[:200] if text]
        if len(filled) > 2 and iso_microseconds(pa.array(filled)) is not None:
            if TIME_OF_DAY.match(filled[0]):
                entry = {"column": item.name, "unit": "time_of_day", "epoch": "arbitrary"}
                return entry, "a time of day, without a date"
            return {"column": item.name, "unit": "iso8601", "epoch": "unix"}, ""
        return None
    steps = np.diff(finite)
    if np.count_nonzero(steps < 0.0) > 0.02 * steps.size or finite[-1] <= finite[0]:
        return None
    if counts_like_a_clock(finite):
        entry = {"column": item.name, "unit": CLOCK_DIGITS, "epoch": "arbitrary"}
        return entry, "the digits of a clock, without a date"
    size = float(np.median(finite))
    # A coarse clock repeats its stamps: rows over the whole time tell the rate.
    step = float(finite[-1] - finite[0]) / steps.size
    possible = [
        unit
        for unit, factor in SECONDS.items()
        if POSSIBLE_STEPS[0] <= step * factor <= POSSIBLE_STEPS[1]
    ]
    unix = next((unit for least, unit in UNIX_TIMES if size > least), None)
    if unix in possible and (item.unit in ("", unix) or item.unit not in possible):
        check = f"its name says {item.unit}" if item.unit not in ("", unix) else ""
        return {"column": item.name, "unit": unix, "epoch": "unix"}, check
    if item.unit in SECONDS:
        check = f"one row every {step * SECONDS[item.unit]:.3g} s in this unit"
        entry = {"column": item.name, "unit": item.unit, "epoch": "boot"}
        return entry, "" if item.unit in possible else check
    unit = next((unit for unit in possible if step * SECONDS[unit] <= FEW_SECONDS), "s")
    coarser = next((other for other in possible if other != unit), unit)
    if step * SECONDS[coarser] > FEW_SECONDS and _comes_seldom(finite, steps, SECONDS[unit]):
        unit = coarser
    return {
        "column": item.name,
        "unit": unit,
        "epoch": "boot",
    }, f"unit {unit} by the rate of the rows"


def _comes_seldom(times: Array, steps: Array, unit_s: float) -> bool:
    """Tell whether a unit is too short: its log ends at once, or is uneven as fixes."""
    if (times[-1] - times[0]) * unit_s < SHORTEST_LOG_S:
        return True
    middle = float(np.median(steps))
    uneven = float(np.median(np.abs(steps - middle))) > UNEVEN * middle
    return uneven and bool((times != np.rint(times)).any())


def _nanoseconds(
    item: NamedColumn,
    entry: Mapping[str, str],
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
) -> dict[str, str]:
    """Return the entry of the nanoseconds that stand beside whole seconds."""
    seconds = values[item.name][np.isfinite(values[item.name])]
    if entry["unit"] != "s" or (seconds != np.rint(seconds)).any():
        return {}
    stem = NANOSECONDS.sub("", item.words)
    for other in columns:
        within = values.get(other.name, np.empty(0))
        within = within[np.isfinite(within)]
        same_stem = NANOSECONDS.sub("", other.words) == stem
        if (
            other.name != item.name
            and same_stem
            and (other.unit == "ns" or NANOSECONDS.search(other.words))
            and within.size
            and within.min() >= 0.0
            and 1e6 < within.max() < 1e9
        ):
            return {"nanoseconds": other.name}
    return {}


def seconds_of(time: Mapping[str, str], values: Mapping[str, Array], texts: Sequence[str]) -> Array:
    """Return the time of every row (n,) [s]; texts: cells of the time column."""
    numbers = values[time["column"]]
    if time["unit"] == CLOCK_DIGITS:
        return clock_seconds(numbers)
    if "nanoseconds" in time:
        return numbers + 1e-9 * values[time["nanoseconds"]]
    if time["unit"] not in TEXT_TIMES:
        return numbers * SECONDS[time["unit"]]
    stamps = iso_microseconds(pa.array([text for text in texts if text]))
    return np.zeros(1) if stamps is None else np.asarray(stamps.to_numpy()) / 1e6
