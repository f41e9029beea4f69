"""Results of comparisons that are kept, and returned where the same records come again.

A log is checked again for each mistake that may explain its findings, and most mistakes
change few of its records.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import wraps
from hashlib import sha256
from typing import Any, ParamSpec, TypeGuard, TypeVar

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.long_series.long_arrays import let_go

MOST_RESULTS = 1024
"""Results of each comparison; they are small, the records are not kept."""
ROWS_AT_ONCE = 16_384
Taken = ParamSpec("Taken")
Result = TypeVar("Result")


def kept(
    compare: Callable[Taken, Result], most: int | None = None, longest: int | None = None
) -> Callable[Taken, Result]:
    """Return a comparison that computes once for the same contents of its arguments.

    `most` results are kept, else `MOST_RESULTS`; none where an argument is an array of more
    than `longest` rows. Nobody may change a result that is returned.
    """
    results: OrderedDict[bytes, Result] = OrderedDict()
    missing = object()

    @wraps(compare)
    def once(*args: Taken.args, **named: Taken.kwargs) -> Result:
        if longest is not None and any(len(it) > longest for it in args if _is_array(it)):
            return compare(*args, **named)
        key = contents([*args, *sorted(named.items())])
        let_go()
        result: Any = results.get(key, missing)
        if result is missing:
            result = results[key] = compare(*args, **named)
        with suppress(KeyError):  # another thread dropped it
            results.move_to_end(key)
            if len(results) > (MOST_RESULTS if most is None else most):
                results.popitem(last=False)
        return result  # type: ignore[no-any-return]

    return once


def _is_array(value: object) -> TypeGuard[Array]:
    return isinstance(value, np.ndarray) and value.ndim > 0


def contents(*values: Any) -> bytes:
    """Return a digest of arrays, numbers, words and what holds them.

    >>> contents([1.0, np.zeros(2)]) == contents([1.0, np.zeros(2)])
    True
    >>> contents([1.0, np.zeros(2)]) == contents([1.0, np.ones(2)])
    False
    """
    digest = sha256()  # processors have it built in: twice as fast as blake2b
    for value in values:
        _add(digest, value)
    return digest.digest()


def _add(digest: Any, value: Any) -> None:
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        rows = value if value.ndim else value[None]
        for start in range(0, len(rows), ROWS_AT_ONCE):
            digest.update(np.ascontiguousarray(rows[start : start + ROWS_AT_ONCE]).data)
        if len(rows) > ROWS_AT_ONCE:
            let_go()
    elif isinstance(value, (list, tuple)):
        digest.update(f"{type(value).__name__}{len(value)}".encode())
        for item in value:
            _add(digest, item)
    elif is_dataclass(value):
        for item in fields(value):
            _add(digest, getattr(value, item.name))
    else:
        digest.update(f"{type(value).__name__} {value!r};".encode())


def signs_of(columns: Array) -> Array:
    """Return the sign (k,) of the first value of each column (n, k) that is not zero.

    >>> signs_of(np.array([[0.0, 2.0], [-1.0, -3.0]]))
    array([-1.,  1.])
    """
    if not len(columns):
        return np.ones(columns.shape[1])
    first = columns[0]
    if not first.all():
        there = np.argmax(columns != 0.0, axis=0)
        first = columns[there, np.arange(columns.shape[1])]
    return np.where(first < 0.0, -1.0, 1.0)
