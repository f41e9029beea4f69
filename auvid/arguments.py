"""Arrays as callers give them, checked: numbers, shapes, what is finite."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError, PipelineError
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
