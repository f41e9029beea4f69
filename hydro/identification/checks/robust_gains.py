"""Gains of signals in one another by least squares without outliers, many fits at once.

Nothing here decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.constants import NORMAL_SPREAD
from auvid.hydro.kept_results import kept

FEWEST_WINDOWS = 12
ROBUST_ROUNDS = 3
ROBUST_SPREADS = 4.0
"""Windows further off than so many spreads (1.48 times the median) are left out."""
MAIN_PART = 0.3
"""A column moves the target much if it does so by this part of the one that does most."""
LEAST_EIGENVALUE = 1e-10
"""Of the moments of scaled columns: what is below it of the largest counts as none."""


@dataclass(frozen=True)
class AxisGains:
    """Gain of each axis (k,) with its standard deviation (k,).

    `explained`: share of the variance of the windows that the axes explain together;
    `count` of windows. `own`: share of the variance of each axis that neither the others
    nor what stands beside them can stand for; where it is small, so is what its gain says.
    """

    gain: Array
    sd: Array
    explained: float
    count: int
    own: Array


@dataclass(frozen=True)
class RobustFits:
    """Fits y = design g + c of b targets, each by its own design, without outliers.

    gain (b, k + 1), the constant last; count (b,) of the rows used, 0 where they are too
    few; inverse (b, k + 1, k + 1) of their moments; spread (b, k): standard deviation of
    each column; explained (b,): share of the variance of y; left (b,): variance of what
    is left.
    """

    gain: Array
    count: Array
    inverse: Array
    spread: Array
    explained: Array
    left: Array

    def main_gains(self, number: int) -> Array:
        """Return the gains of one fit whose columns move its target much."""
        gain = self.gain[number, :-1]
        part = np.abs(gain) * self.spread[number]
        return np.asarray(gain[part > MAIN_PART * part.max()])

    def gains(self) -> list[AxisGains | None]:
        """Return the gains of each fit; None where its rows are too few."""
        variance = np.diagonal(self.inverse, axis1=1, axis2=2)[:, :-1]
        sd = np.sqrt(self.left[:, None] * np.maximum(variance, 0.0))
        sd = np.where(self.spread > 0.0, sd, np.inf)
        share = variance * self.spread**2 * self.count[:, None]
        own_share = np.divide(1.0, share, out=np.zeros_like(share), where=share > 0.0)
        return [
            AxisGains(self.gain[b, :-1], sd[b], float(self.explained[b]), int(count), own_share[b])
            if count
            else None
            for b, count in enumerate(self.count)
        ]


@kept
def fitted_gains(y: ArrayLike, design: ArrayLike) -> AxisGains | None:
    """Return the least-squares gains of y (n,) on design (n, k), a constant beside.

    y = design g + c, outliers left out; sd from the scatter of windows that do not
    overlap. A column without motion has an infinite sd. None for too few windows.
    """
    target, columns = np.asarray(y, np.float64), np.asarray(design, np.float64)
    return robust_fits(target[None], columns[None]).gains()[0]


def stacked(parts: Sequence[Array]) -> Array:
    """Return arrays (n_i, ...) as one (b, n, ...), short ones filled up with NaN."""
    out = np.full((len(parts), max(len(part) for part in parts), *parts[0].shape[1:]), np.nan)
    for row, part in zip(out, parts, strict=True):
        row[: len(part)] = part
    return out


def robust_fits(y: Array, design: Array) -> RobustFits:
    """Return the fits of y (b, n) by design (b, n, k) and constants.

    Rows that are not finite are left out, and those further off than `ROBUST_SPREADS`.
    """
    good: Mask = np.isfinite(y) & np.isfinite(design).all(axis=2)
    target = y
    if not good.all():
        target, design = np.where(good, y, 0.0), np.where(good[..., None], design, 0.0)
    full = np.concatenate([design, np.ones((*good.shape, 1))], axis=2)
    fewest = FEWEST_WINDOWS + design.shape[2]
    keep, enough = good, good.sum(axis=1) >= fewest
    for _ in range(ROBUST_ROUNDS):
        gain, inverse = _least_squares(full, target, keep)
        off = np.abs(target - (full @ gain[..., None])[..., 0])
        before, spread = keep, NORMAL_SPREAD * _medians(off, keep)
        keep = good & (off <= ROBUST_SPREADS * np.maximum(spread, 1e-12)[:, None])
        enough &= keep.sum(axis=1) >= fewest
        if np.array_equal(keep, before):  # further rounds repeat this one
            break
    else:
        _, inverse = _least_squares(full, target, keep)
    count = np.where(enough, keep.sum(axis=1), 0)
    rows = np.maximum(count, full.shape[2] + 1)
    left = np.einsum("bn,bn,bn->b", keep, off, off) / (rows - full.shape[2])
    variance = _variance(np.concatenate([design, target[..., None]], axis=2), keep, rows)
    own = variance[:, -1]
    explained = 1.0 - np.divide(left, own, out=np.ones_like(left), where=own > 0.0)
    spread = np.sqrt(variance[:, :-1])
    return RobustFits(gain, count, inverse, spread, explained, left)


def solved(full: Array, target: Array, keep: Mask) -> tuple[Array, Array]:
    """Return gains (b, k) of target (b, n) on full (b, n, k), and the fits (b, n).

    By the rows to keep (b, n). Of gains that fit alike, as of two columns that say the
    same, these have the least sum of squares.
    """
    gain, _ = _least_squares(full, target, keep)
    return gain, (full @ gain[..., None])[..., 0]


def _least_squares(full: Array, target: Array, keep: Mask) -> tuple[Array, Array]:
    """Return gains (b, k), and the pseudo-inverse (b, k, k) of the moments.

    That of the moments of scaled columns, scaled back.
    """
    turned = (full if keep.all() else full * keep[..., None]).swapaxes(1, 2)
    moment = turned @ full
    scale = np.sqrt(np.diagonal(moment, axis1=1, axis2=2))
    scale = np.where(scale > 0.0, scale, 1.0)
    size = scale[:, :, None] * scale[:, None, :]
    # V diag(1/w) V' by hand: numpy's own for symmetric matrices takes three times as long here.
    values, vectors = np.linalg.eigh(moment / size)
    kept = values > LEAST_EIGENVALUE * values[:, -1:]
    parts = np.divide(1.0, values, out=np.zeros_like(values), where=kept)
    inverse: Array = (vectors * parts[:, None]) @ vectors.swapaxes(1, 2) / size
    return (inverse @ (turned @ target[..., None]))[..., 0], inverse


def _variance(values: Array, keep: Mask, rows: Array) -> Array:
    """Return the variance (b, k) of the rows to keep of values (b, n, k)."""
    weight = keep[:, None].astype(np.float64)
    off = values - weight @ values / rows[:, None, None]
    return np.asarray((weight @ (off * off))[:, 0] / rows[:, None])


def _medians(values: Array, keep: Mask) -> Array:
    """Return the median (b,) of the values (b, n) to keep; 0 where there are none.

    >>> _medians(np.array([[3.0, 1.0, 2.0, 9.0]]), np.array([[True, True, True, False]]))
    array([2.])
    """
    ordered = np.sort(np.where(keep, values, np.inf), axis=1)
    count = np.maximum(keep.sum(axis=1), 1)
    each = np.arange(len(values))
    middle = 0.5 * (ordered[each, (count - 1) // 2] + ordered[each, count // 2])
    return np.where(np.isfinite(middle), middle, 0.0)
