"""Arrays as callers give them, checked: numbers, shapes, what is finite."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError, PipelineError, UsageError
from auvid.hydro.arrays import Array


def as_numbers(values: ArrayLike, name: str) -> Array:
    """Return an array of numbers; `DataError` for what is none."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as fault:
        value = values if isinstance(values, str) else type(values).__name__
        raise DataError(
            f"not an array of numbers: {fault}", field=name, value=value, allowed="numbers"
        ) from None


def finite(array: Array, name: str) -> Array:
    """Return an array; `DataError` with the first row that is not finite."""
    wrong = ~np.isfinite(array)
    if wrong.any():
        place = np.argwhere(wrong)[0]
        raise DataError(
            "not finite",
            field=name,
            row=int(place[0]) if len(place) else None,
            value=f"{float(array[tuple(place)])}, {int(wrong.sum())} of {array.size}",
            remedy="Leave out the rows that are not known.",
        )
    return array


PLAIN = (
    (r"\b(leg|segment) 'train(\.\d+)?'", "the data to fit"),
    (r"\b(leg|segment) 'check(\.\d+)?'", "the data from validate_from on"),
    (r"stages\.synthesise\.models(\[0\])?", "model"),
    (r"stages\.synthesise\.structures\.own\.None", "model"),
    (r"stages\.synthesise\.structures\.own(\.(\w+))?", r"model\1"),
    (r"stages\.(\w+)\.(\w+)", r'settings["\1"]["\2"]'),
    (r", choose another source, or leave the stream out \(sources: [^)]*\)", ""),
    ("Choose a leg in which", "Give data in which"),
    (r"\b(log|leg) 'arrays'", "the arrays"),
)
"""Words of a campaign, as patterns, and what stands for them where arrays are fitted."""


@contextmanager
def worded_for_arrays() -> Iterator[None]:
    """Raise faults of the stages in words of `fit`: no campaign has legs and segments here."""
    try:
        yield
    except PipelineError as fault:
        for name in ("message", "field", "remedy", "allowed"):
            text = getattr(fault, name)
            if isinstance(text, str):
                for pattern, plain in PLAIN:
                    text = re.sub(pattern, plain, text)
                setattr(fault, name, text)
        fault.file = None
        raise


def six_columns(values: ArrayLike, name: str) -> Array:
    """Return an array (6,) or (n, 6) of finite numbers."""
    array = as_numbers(values, name)
    if array.ndim not in (1, 2) or array.shape[-1] != 6:
        raise DataError("wrong shape", field=name, value=array.shape, allowed="(6,) or (n, 6)")
    return finite(array, name)


def rows_or_one(values: ArrayLike, count: int, name: str) -> Array:
    """Return an array (count, 6) of finite numbers, from as many rows or from one."""
    array = six_columns(values, name)
    if array.ndim == 2 and len(array) not in (1, count):
        raise DataError(
            "wrong shape", field=name, value=array.shape, allowed=f"(6,) or ({count}, 6)"
        )
    return np.broadcast_to(array, (count, 6))


def row_of_six(values: ArrayLike, name: str) -> Array:
    """Return an array (6,) of finite numbers."""
    array = six_columns(values, name)
    if array.ndim != 1:
        raise DataError("wrong shape", field=name, value=array.shape, allowed="(6,)")
    return array


def time_series(values: ArrayLike | None, count: int, width: int, name: str) -> Array | None:
    """Return finite numbers (count, width); (count,), also from a scalar, for width 0."""
    if values is None:
        return None
    array, shape = as_numbers(values, name), (count, width) if width else (count,)
    if array.ndim == 0 and not width:
        array = np.full(count, array)
    if array.shape != shape:
        raise DataError(
            "one row for each time is needed", field=name, value=array.shape, allowed=str(shape)
        )
    return finite(array, name)


def uniform_clock(time: ArrayLike) -> Array:
    """Return times (n,) [s] in equal steps; `DataError` for others."""
    t_s = finite(as_numbers(time, "time"), "time")
    steps = np.diff(t_s) if t_s.ndim == 1 else np.zeros(0)
    if len(steps) < 1 or not np.allclose(steps, np.mean(steps), rtol=1e-6) or steps[0] <= 0.0:
        raise DataError(
            "the clock is not uniform and ascending",
            field="time",
            value=t_s.shape if t_s.ndim != 1 or not len(steps) else (steps.min(), steps.max()),
            remedy="Resample the commands on equal steps.",
        )
    return t_s


def refuse_missing(commands: Mapping[str, tuple[object, object]]) -> None:
    """Raise `UsageError` for actuators without a command; name, shape -> both."""
    missing = [name for name, (part, values) in commands.items() if part and values is None]
    if missing or not any(part for part, _ in commands.values()):
        raise UsageError(
            "what moves the vehicle is missing",
            field=missing[0].partition(" ")[0] if missing else "tau",
            remedy=f"Give {', '.join([*missing, 'or '] if missing else [])}tau (n, 6) or (6,),"
            " the force of all actuators; zeros let it drift.",
        )
