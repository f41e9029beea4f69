"""Estimates with a covariance: moved within limits, and what each number rests on.

For estimators other than least squares. Near its maximum a log-likelihood is a parabola
with the inverse covariance as its curvature: the constrained maximum is the nearest
point within the limits in that metric.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.identification.constrained.active_set import (
    Cuts,
    InequalityRows,
    LimitedProblem,
)
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.fit import ActiveLimit
from auvid.hydro.identification.constrained.statuses import AT_BOUND, FROM_PRIOR, PRIOR_SHARE
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    INSEPARABLE,
    PARTNER_SHARE,
    VIF_LIMIT,
    WEAK,
    clear_of_zero,
)

STILL = 1e-9
"""Deviation of a value that does not move, in parts of its size."""
LEAST_SHARE = 1e-12
"""Directions with less of the information than this count as having so much."""


@dataclass(frozen=True)
class LimitedEstimate:
    """Values (p,) within limits, the limits that hold them, and what they cost.

    cost: by how much the log-likelihood falls.
    """

    values: Array
    active: tuple[ActiveLimit, ...]
    cost: float


def nearest_within(
    unknowns: Sequence[Unknown],
    values: Array,
    covariance: Array,
    limits: Sequence[InequalityRows],
    cuts: Sequence[Cuts],
) -> LimitedEstimate:
    """Return the x (p,) that minimises (x - values)' C^-1 (x - values) within limits.

    covariance (p, p): nan rows for values that do not move, those at a bound. Raises
    `DataError` for limits that contradict each other.

    >>> from auvid.hydro.identification.constrained.limits import damping
    >>> pair = (Unknown("X", "u"), Unknown("X", "w"))
    >>> C = np.array([[4.0, 1.0], [1.0, 1.0]])
    >>> moved = nearest_within(pair, np.array([1.0, 2.0]), C, [damping(pair)], [])
    >>> moved.active[0].name, round(float(moved.values[1]), 9), round(moved.cost, 9)
    ('X_u <= 0', 1.75, 0.125)
    """
    return next(each_nearest_within(unknowns, values, [values], covariance, limits, cuts))


def each_nearest_within(
    unknowns: Sequence[Unknown],
    centre: Array,
    points: Iterable[Array],
    covariance: Array,
    limits: Sequence[InequalityRows],
    cuts: Sequence[Cuts],
) -> Iterator[LimitedEstimate]:
    """Yield `nearest_within` of each point (p,), in one metric.

    centre (p,): in parts of its size a value that does not move may err.
    """
    moving = np.isfinite(np.diag(covariance))
    C = np.diag((STILL * np.maximum(np.abs(centre), 1.0)) ** 2)
    C[np.ix_(moving, moving)] = covariance[np.ix_(moving, moving)]
    scale = np.sqrt(np.diag(C))
    share, vectors = np.linalg.eigh(C / np.outer(scale, scale))
    R = (vectors / np.sqrt(np.maximum(share, LEAST_SHARE))).T / scale
    problem = LimitedProblem(R, limits, cuts=cuts)
    for values in points:
        best = problem.nearest(values)
        if not best.active:
            yield LimitedEstimate(values, (), 0.0)
            continue
        away = R @ (best.x - values)
        limits_met = (
            ActiveLimit(name, tuple(unknowns[int(j)] for j in np.flatnonzero(row)), float(force))
            for name, row, force in zip(best.active, best.rows, best.multipliers, strict=True)
        )
        yield LimitedEstimate(best.x, tuple(limits_met), 0.5 * float(away @ away))


@dataclass(frozen=True)
class EstimateStatus:
    """Status of one number, and the unknowns (by place) it is inseparable from."""

    status: str
    partners: tuple[int, ...] = ()


def estimate_statuses(
    values: Array,
    errors: Array,
    information_covariance: Array,
    prior_precision: Array,
    at_bound: Mask,
    verdicts: Mapping[int, str],
) -> list[EstimateStatus]:
    """Return the status of every number of an estimate by maximum likelihood.

    errors (p,): standard errors; information_covariance (p, p): for white errors,
    prior_precision (p, p): the prior's part of its inverse. verdicts: by place, those
    that the motion decides beforehand (not excited). In this order: at its bound; from
    the prior, which gives half of the information or more; the motion's verdict;
    identified, from four standard errors on; inseparable, where the other unknowns leave
    less than a tenth of its own (variance inflation above 100); weak.

    >>> C = np.linalg.inv(np.array([[1.0, 0.999], [0.999, 1.0]]))
    >>> both = estimate_statuses(
    ...     np.ones(2), np.sqrt(np.diag(C)), C, np.zeros((2, 2)), np.zeros(2, bool), {}
    ... )
    >>> both[0]
    EstimateStatus(status='inseparable', partners=(1,))
    """
    moving = np.flatnonzero(np.isfinite(np.diag(information_covariance)))
    cell = np.ix_(moving, moving)
    after = information_covariance[cell]
    data = np.linalg.inv(after) - prior_precision[cell]
    scale = np.sqrt(np.maximum(np.diag(data), np.finfo(float).tiny))
    strength, vectors = np.linalg.eigh(data / np.outer(scale, scale))
    unit = (vectors / np.maximum(strength, LEAST_SHARE)) @ vectors.T
    size = len(values)
    inflation, prior_share = np.ones(size), np.zeros(size)
    inflation[moving] = np.diag(unit)
    prior_share[moving] = 1.0 - np.diag(after) * scale**2 / np.diag(unit)
    out = []
    for i in range(size):
        if at_bound[i]:
            out.append(EstimateStatus(AT_BOUND))
        elif prior_share[i] >= PRIOR_SHARE:
            out.append(EstimateStatus(FROM_PRIOR))
        elif i in verdicts:
            out.append(EstimateStatus(verdicts[i]))
        elif clear_of_zero(float(values[i]), float(errors[i])):
            out.append(EstimateStatus(IDENTIFIED))
        elif inflation[i] > VIF_LIMIT:
            weights = np.where(moving == i, 0.0, np.abs(unit[moving == i][0]))
            near = moving[weights >= PARTNER_SHARE * weights.max()]
            out.append(EstimateStatus(INSEPARABLE, tuple(near.tolist())))
        else:
            out.append(EstimateStatus(WEAK))
    return out
