"""Leave one leg out, from the triangular factors of the legs alone."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.regression.least_squares import TriangularFactor


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
