"""What dives agree on in one figure, and where a further dive will lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet.scatter import BetweenDives, between_dives, typical_error

FEWEST_DIVES = 3
"""Two dives say nothing of a scatter between dives."""
MOST_OUTSIDE, OUTSIDE_OF_ONE = 3.2, 16.0
"""By how much the weights of scatter are too wide where nothing shows any (decision 0062):
so many times the stated share lies outside, and so many over the number of dives.
"""

Interval = tuple[float, float]


@dataclass(frozen=True)
class PooledFigure:
    """One figure over dives, in its own unit; intervals hold at `level`.

    dives: with a number, since the last change; earlier: with a number before it. mean and
    its interval: of the dives since the last change. tau: scatter between dives (REML) and its
    interval. i2: share of the scatter of estimates that is between dives. q, q_p:
    Cochran's Q and the probability of so large a Q without scatter. next_dive: interval
    of what a further dive shows with the standard error `next_error`. Intervals are None
    for too few dives, and `refusal` says why; mean and tau are then those of the estimates.
    """

    dives: int
    earlier: int
    level: float
    mean: float
    mean_interval: Interval | None
    tau: float
    tau_interval: Interval | None
    i2: float
    q: float
    q_p: float
    next_error: float
    next_dive: Interval | None
    refusal: str


def pool(
    values: ArrayLike,
    errors: ArrayLike,
    *,
    levels: ArrayLike | None = None,
    next_error: float | None = None,
    level: float = 0.95,
) -> PooledFigure:
    """Return what dives with values (k,) and standard errors (k,) agree on.

    levels (k,): number of changes of the figure before each dive, None for no change;
    means are those of the last level, the scatter is that of all dives about theirs.
    next_error: of a further dive; None is the root mean square of these dives, 0 asks for
    the interval of its true figure. A dive without a number has nan and is left out.
    Raises `DataError` for fewer than two dives with a number and for a standard error that
    is not positive.

    >>> print(pool([10.0, 11.0, 9.0], [1.0, 1.0, 1.0]).mean)
    10.0
    >>> pool([10.0, 11.0], [1.0, 1.0]).refusal
    '2 dives: no interval; the scatter between dives needs 3'
    """
    y, s = numbers_of(values, errors)
    if len(y) < 2:
        raise DataError("too few dives with a number", value=len(y), allowed="2 or more")
    there = np.isfinite(np.asarray(values)) & np.isfinite(np.asarray(errors))
    every = np.zeros(len(there), dtype=np.int64) if levels is None else np.asarray(levels)
    _, of = np.unique(every[there], return_inverse=True)
    freedom = len(y) - int(of.max()) - 1
    scatter = between_dives(y, s, levels=of)
    at_0 = 1.0 / s**2
    means = np.bincount(of, at_0 * y) / np.bincount(of, at_0)
    q = float(at_0 @ (y - means[of]) ** 2)
    tau = float(scatter.tau_reml)
    from scipy.special import gammaincc

    last = of == of.max()
    own = last / (s**2 + tau**2)
    tails = (0.5 * (1.0 - level), 0.5 * (1.0 + level))
    error = float(np.sqrt(np.mean(s**2))) if next_error is None else next_error
    changed = not last.all()
    outside = 1.0 - level
    if error and not changed:
        outside = float(outside_share(scatter, s, outside))
    next_tails = (0.5 * outside, 1.0 - 0.5 * outside)
    enough = freedom >= FEWEST_DIVES - 1
    low, high = (
        [(float(scatter.mean_quantile(p)), float(scatter.tau_quantile(p)),
          float(scatter.next_dive_quantile(n, error)))
         for p, n in zip(tails, next_tails, strict=True)]
    )  # fmt: skip
    return PooledFigure(
        dives=int(last.sum()),
        earlier=int((~last).sum()),
        level=level,
        mean=float(own @ y / own.sum()),
        mean_interval=(low[0], high[0]) if enough else None,
        tau=tau,
        tau_interval=(low[1], high[1]) if enough else None,
        i2=tau**2 / (tau**2 + float(typical_error(s)) ** 2),
        q=q,
        q_p=float(gammaincc(0.5 * freedom, 0.5 * q)),
        next_error=error,
        next_dive=(low[2], high[2]) if enough else None,
        refusal="" if enough else _too_few(len(y), int(of.max())),
    )


def _too_few(dives: int, changes: int) -> str:
    """Return in words that so many dives, with so many changes, show no scatter."""
    of_level = f" and {changes} more, one for each change" if changes else ""
    return f"{dives} dives: no interval; the scatter between dives needs {FEWEST_DIVES}{of_level}"


def outside_share(scatter: BetweenDives, errors: ArrayLike, share: float) -> Array:
    """Return the share (...) of the weights to leave out where `share` of dives is.

    errors (..., k): of the dives so far. Dives whose scatter is within their errors cannot
    show that there is none, and weights on all that it may be are too wide: where most of
    the weight is on a tau below the typical error, more of it is left out.
    """
    s = np.asarray(errors, dtype=np.float64)
    small = scatter.tau < typical_error(s)[..., None]
    unseen = np.clip(2.0 * (scatter.weight * small).sum(axis=-1) - 1.0, 0.0, 1.0)
    factor = max(1.0, min(MOST_OUTSIDE, OUTSIDE_OF_ONE / s.shape[-1]))
    return np.asarray(share * (1.0 + (factor - 1.0) * unseen))


def numbers_of(values: ArrayLike, errors: ArrayLike) -> tuple[Array, Array]:
    """Return values and standard errors of the dives that have both.

    Raises `DataError` for a standard error that is not positive.
    """
    y, s = np.asarray(values, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    if y.ndim != 1 or y.shape != s.shape:
        raise DataError("values and errors do not fit", value=(y.shape, s.shape), allowed="(k,)")
    numbers = np.isfinite(y) & np.isfinite(s)
    if (s[numbers] <= 0.0).any():
        raise DataError(
            "a standard error is not positive",
            row=int(np.argmax(numbers & (s <= 0.0))),
            value=float(s[numbers].min()),
        )
    return y[numbers], s[numbers]
