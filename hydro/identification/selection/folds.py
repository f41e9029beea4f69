"""Leave one leg out: the parts of legs, and the triangular factors of the others."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.regression.least_squares import TriangularFactor

MOST_PARTS = 8
"""Legs are left out one by one up to this number of legs, in so many groups beyond it."""


def parts_of(legs: Sequence[str]) -> list[str]:
    """Return the name of the part that each leg is left out with.

    >>> parts_of(["a", "a", "b"])
    ['a', 'a', 'b']
    """
    names = list(dict.fromkeys(legs))
    if len(names) <= MOST_PARTS:
        return list(legs)
    groups = [names[i * len(names) // MOST_PARTS] for i in range(MOST_PARTS)]
    ends = [*map(names.index, groups[1:]), len(names)]
    titles = [f"{first} to {names[end - 1]}" for first, end in zip(groups, ends, strict=True)]
    of = {name: titles[sum(end <= i for end in ends)] for i, name in enumerate(names)}
    return [of[leg] for leg in legs]


def without_each(legs: Sequence[TriangularFactor]) -> list[TriangularFactor]:
    """Return, for each leg, the factor of all the others.

    By merging from both ends: 3 L merges for L legs. Raises `DataError` for fewer than
    two legs: blocks of one leg are no legs, they share its slow disturbances and its
    one manoeuvre.
    """
    if len(legs) < 2:
        raise DataError("leaving a leg out needs two legs or more", value=len(legs))
    before = list(accumulate(legs[:-1], TriangularFactor.merge))
    after = list(accumulate(legs[:0:-1], lambda tail, leg: leg.merge(tail)))[::-1]
    inner = [a.merge(b) for a, b in zip(before[:-1], after[1:], strict=True)]
    return [after[0], *inner, before[-1]]
