"""Draws from a normal posterior within limits, for what a spread of models would do.

A draw outside the limits moves to the nearest point within, in the metric of the
posterior (projected posterior, Dunson and Neelon 2003). That is how the estimate within
limits scatters over repeated data (a parametric bootstrap): each draw is an estimate
without limits, and the nearest point is what limits make of it. A normal cut off at the
limits is no alternative: where a limit holds the estimate itself back, the covariance
is that of a plane that touches the limits, and next to nothing of it lies within.

Nearest points within one limit on a matrix come from all draws at once, by the method of
factors (Burer, Monteiro 2003); what that leaves, from the exact method, one by one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from auvid.hydro.arrays import VELOCITIES, Array, Mask
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS
from auvid.hydro.identification.constrained.active_set import Cuts, InequalityRows
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.estimates import each_nearest_within
from auvid.hydro.identification.constrained.limits import (
    NEGATIVE,
    Semidefinite,
    damping_limits,
    flown_box,
)

SEMIDEFINITE = 1e-10
"""A matrix counts as positive semidefinite with scaled eigenvalues above minus this."""
NEWTON_STEPS = 40
SETTLED = 1e-9
"""Last step of Newton's method, as a share of the largest element."""


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
    matrices = [cut for cut in cuts if isinstance(cut, Semidefinite)]
    left = np.arange(count)
    for limit in matrices:
        nearest = _nearest_definite(limit, drawn[left], covariance)
        within = _are_within(nearest, limits, matrices)
        drawn[left[within]] = nearest[within]
        outside[limit.title] += int(np.sum(within))
        left = left[~within]
    moved = count - len(left)
    each = each_nearest_within(unknowns, values, drawn[left], metric, limits, cuts)
    for number, best in zip(left, each, strict=True):
        drawn[number] = best.values
        moved += bool(best.active)
        outside.update({item.name for item in best.active})
    return PosteriorDraws(drawn, moved, {name: draws for name, draws in outside.items() if draws})


def _nearest_definite(limit: Semidefinite, points: Array, covariance: Array) -> Array:
    """Return the x (n, p) nearest to points v with S(x) positive semidefinite.

    x = v + C A(W W'), A(Y)_k = <parts_k, Y>, where S(x) W = 0: with S(x) positive
    semidefinite these are the conditions of the optimum, since the problem is convex. W (m, r)
    by Newton's method, all points at once; r is the number of negative eigenvalues of S(v).
    nan where S(v) has none, or the method ends elsewhere.
    """
    nearest = np.full(points.shape, np.nan)
    S, _, values, _ = limit.eigen(points)
    move = limit.parts.T @ covariance[limit.places]  # C A(Y) of Y (m m,)
    T = move[:, limit.places] @ limit.parts
    ranks = np.sum(values < -NEGATIVE, axis=1)
    for rank in set(ranks.tolist()) - {0}:
        chosen = np.flatnonzero(ranks == rank)
        W = _factors(S[chosen], T, rank)
        x = points[chosen] + (W @ W.swapaxes(1, 2)).reshape(len(chosen), -1) @ move
        good = np.asarray(np.isfinite(x).all(axis=1))
        good[good] = limit.eigen(x[good])[2][:, 0] > -SEMIDEFINITE
        nearest[chosen[good]] = x[good]
    return nearest


def _factors(S: Array, T: Array, rank: int) -> Array:
    """Return W (n, m, rank) with (S + T : W W') W = 0; nan where there is none.

    S (n, m, m), T (m m, m m).

    It starts from the eigenvectors of S that are negative, each as long as it would be alone.
    """
    count, size = S.shape[:2]
    values, vectors = np.linalg.eigh(S)
    W = vectors[:, :, :rank]
    dyads = (W[:, :, None, :] * W[:, None, :, :]).reshape(count, size * size, rank)
    curvature = np.einsum("nir,ij,njr->nr", dyads, T, dyads, optimize=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        W = W * np.sqrt(-np.minimum(values[:, :rank], 0.0) / curvature)[:, None, :]
    W[~np.isfinite(W).all(axis=(1, 2))] = 0.0
    moving = np.ones(count, dtype=np.bool_)
    for _ in range(NEWTON_STEPS):
        at = S + ((W @ W.swapaxes(1, 2)).reshape(count, -1) @ T).reshape(S.shape)
        # d(S W) = S dW + 2 (T : W dW') W, since T takes only the symmetric part.
        turned = np.einsum("ijkl,nlb->nijkb", T.reshape((size,) * 4), W, optimize=True)
        slope = 2.0 * np.einsum("nijkb,nja->niakb", turned, W, optimize=True)
        slope += np.einsum("nik,ab->niakb", at, np.eye(rank))
        # Turns of W among its columns change nothing: of the steps the least.
        inverse = np.linalg.pinv(slope.reshape(count, size * rank, -1), rcond=1e-11, hermitian=True)
        step = (inverse @ (at @ W).reshape(count, -1, 1)).reshape(W.shape)
        W = W - step
        moving = np.abs(step).max(axis=(1, 2)) > SETTLED * np.abs(W).max(axis=(1, 2))
        if not moving.any():
            break
    W[moving] = np.nan
    return np.asarray(W)


def _are_within(
    x: Array, limits: Sequence[InequalityRows], matrices: Sequence[Semidefinite]
) -> Mask:
    """Return whether values (n, p) are within all limits (n,); nan are not."""
    within = np.asarray(np.isfinite(x).all(axis=1))
    for limit in limits:
        within[within] = np.all(x[within] @ limit.rows.T <= limit.bounds, axis=1)
    for matrix in matrices:
        within[within] = matrix.eigen(x[within])[2][:, 0] > -SEMIDEFINITE
    return within


class AxisErrors(NamedTuple):
    """Errors of the k coefficients of an axis.

    places: of them among all unknowns; lower: triangle of their noise; errors: printed
    standard errors by noise, None for that of the triangle; shifts: assumed figure -> rows
    of what its numbers move them by.
    """

    places: Sequence[int]
    lower: Sequence[Sequence[float]]
    errors: Sequence[float | None]
    shifts: Mapping[str, Sequence[Sequence[float]]]


def joint_covariance(parts: Sequence[AxisErrors], count: int) -> Array:
    """Return the covariance (count, count) of printed intervals of several axes.

    Noise of one axis has no part in another's. A number of an assumed figure, as the scale
    of the thrust curve, is one for all of them: axes err together by it.

    >>> one = AxisErrors([0], [[1.0]], [1.0], {"thrust": [[2.0]]})
    >>> other = AxisErrors([1], [[4.0]], [2.0], {"thrust": [[-3.0]]})
    >>> joint_covariance([one, other], 2).tolist()
    [[5.0, -6.0], [-6.0, 13.0]]
    """
    covariance = np.zeros((count, count))
    moved: dict[tuple[str, int], Array] = {}
    for part in parts:
        places = list(part.places)
        covariance[np.ix_(places, places)] = printed_noise(part.lower, part.errors)
        for figure, rows in part.shifts.items():
            for number, row in enumerate(rows):
                moved.setdefault((figure, number), np.zeros(count))[places] = row
    return covariance + sum((np.outer(row, row) for row in moved.values()), np.zeros(1))


def printed_noise(lower: Sequence[Sequence[float]], errors: Sequence[float | None]) -> Array:
    """Return the covariance (p, p) of a triangle, in the size of printed errors.

    None keeps that of the triangle.

    >>> printed_noise([[4.0], [1.0, 1.0]], [1.0, None]).tolist()
    [[1.0, 0.5], [0.5, 1.0]]
    """
    block = np.zeros((len(lower), len(lower)))
    for i, row in enumerate(lower):
        block[i, : i + 1] = block[: i + 1, i] = row[: i + 1]
    own = np.sqrt(np.maximum(np.diag(block), 0.0))
    printed = np.array([error or sd for error, sd in zip(errors, own, strict=True)])
    scale = np.divide(printed, own, out=np.ones_like(own), where=own > 0.0)
    return np.asarray(block * np.outer(scale, scale))


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
