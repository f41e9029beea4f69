"""Draws from a normal posterior within limits, for what a spread of models would do.

A draw outside the limits moves to the nearest point within, in the metric of the
posterior (projected posterior, Dunson and Neelon 2003). That is how the estimate within
limits scatters over repeated data (a parametric bootstrap): each draw is an estimate
without limits, and the nearest point is what limits make of it. A normal cut off at the
limits is no alternative: where a limit holds the estimate itself back, the covariance
is that of a plane that touches the limits, and next to nothing of it lies within.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import VELOCITIES, Array
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS
from auvid.hydro.identification.constrained.active_set import Cuts, InequalityRows
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.estimates import each_nearest_within
from auvid.hydro.identification.constrained.limits import damping_limits, flown_box


@dataclass(frozen=True)
class PosteriorDraws:
    """Draws (n, p) within limits, and how many of them lay outside.

    outside: by limit; a draw counts for each that held it.
    """

    values: Array
    moved: int
    outside: Mapping[str, int]


def draw_within(
    unknowns: Sequence[Unknown],
    values: Array,
    covariance: Array,
    limits: Sequence[InequalityRows],
    cuts: Sequence[Cuts],
    *,
    count: int,
    seed: int,
) -> PosteriorDraws:
    """Return draws of values (p,) with a covariance (p, p), all within the limits.

    A value with the variance 0 stays as it is. The same at each call with one seed.

    >>> from auvid.hydro.identification.constrained.limits import damping
    >>> roll = (Unknown("K", "p"),)
    >>> drawn = draw_within(
    ...     roll, np.zeros(1), np.eye(1), [damping(roll)], [], count=1000, seed=1
    ... )
    >>> bool(drawn.values.max() <= 0.0), 450 < drawn.moved < 550, list(drawn.outside)
    (True, True, ['K_p <= 0'])
    """
    drawn = normal_draws(values, covariance, count=count, seed=seed)
    metric = covariance.copy()
    metric[np.diag_indices_from(metric)] = np.where(
        np.diag(covariance) > 0.0, np.diag(covariance), np.nan
    )
    outside: Counter[str] = Counter()
    moved = 0
    each = each_nearest_within(unknowns, values, drawn.copy(), metric, limits, cuts)
    for number, nearest in enumerate(each):
        drawn[number] = nearest.values
        moved += bool(nearest.active)
        outside.update({item.name for item in nearest.active})
    return PosteriorDraws(drawn, moved, dict(outside))


def printed_covariance(
    lower: Sequence[Sequence[float]],
    errors: Sequence[float | None],
    assumed: Sequence[Sequence[float]] = (),
) -> Array:
    """Return the covariance (p, p) of printed intervals, by noise and assumed figures.

    lower: triangle of noise, taken to the size of the printed standard errors; None keeps
    its own. assumed: triangle of what assumed figures move the values by, where known.

    >>> printed_covariance([[4.0], [1.0, 1.0]], [1.0, None]).tolist()
    [[1.0, 0.5], [0.5, 1.0]]
    >>> printed_covariance([[1.0], [0.0, 1.0]], [1.0, 1.0], [[3.0], [2.0, 3.0]]).tolist()
    [[4.0, 2.0], [2.0, 4.0]]
    """
    block = _symmetric(lower)
    own = np.sqrt(np.maximum(np.diag(block), 0.0))
    printed = np.array([error or sd for error, sd in zip(errors, own, strict=True)])
    scale = np.divide(printed, own, out=np.ones_like(own), where=own > 0.0)
    noise = block * np.outer(scale, scale)
    return np.asarray(noise + _symmetric(assumed) if len(assumed) else noise)


def _symmetric(lower: Sequence[Sequence[float]]) -> Array:
    block = np.zeros((len(lower), len(lower)))
    for i, row in enumerate(lower):
        block[i, : i + 1] = block[: i + 1, i] = row[: i + 1]
    return block


def flown_limits(
    unknowns: Sequence[Unknown], kind: str, flown: Mapping[str, tuple[float, float]]
) -> tuple[list[InequalityRows], list[Cuts]]:
    """Return the limits on damping of draws over the flown range.

    kind: as `damping_limits`. flown: velocity -> lowest, highest [m/s, rad/s]; no range is
    narrower than the threshold of excitation.
    """
    rows, cuts = damping_limits(unknowns, kind, flown_box(flown))
    if any(unknown.term not in VELOCITIES for unknown in unknowns if unknown.term in BASIS_TERMS):
        # Of other than linear terms the rows hold the power at many velocities already.
        cuts = []
    return rows, cuts


def normal_draws(values: Array, covariance: Array, *, count: int, seed: int) -> Array:
    """Return draws (count, p) of a normal distribution; its covariance may be singular.

    The same at each call with one seed.
    """
    share, vectors = np.linalg.eigh(covariance)
    half = vectors * np.sqrt(np.maximum(share, 0.0))
    random = np.random.default_rng(seed)
    return np.asarray(values + random.standard_normal((count, len(values))) @ half.T)
