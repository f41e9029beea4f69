"""Bands that hold as often as they say, from how far each leg left its band."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array

LEAST_LEGS = 10
"""Nine other legs are the fewest from which a band of 90 % follows."""


def conformal_scale(scores: ArrayLike, level: float) -> Array:
    """Return by how much to widen a band, from scores (L, ...) of L legs: (...).

    The k-th smallest score, k = ceil((L + 1) level): a further leg that is like these
    has a smaller one with at least that probability (split conformal; Vovk et al. 2005).
    inf where L is too small.

    >>> float(conformal_scale(np.arange(1.0, 10.0), 0.9))
    9.0
    >>> float(conformal_scale([1.0, 2.0], 0.9))
    inf
    """
    ordered = np.sort(np.asarray(scores, dtype=np.float64), axis=0)
    k = math.ceil((len(ordered) + 1) * level - 1e-9)
    return ordered[k - 1] if k <= len(ordered) else np.full(ordered.shape[1:], np.inf)
