"""Verdicts on the coefficients of a fit, and whether legs agree.

Words of `regression.verdicts` and `constrained.statuses`: `not excited` where the
velocity or the input hardly moves; `at its bound`; `from the prior` where the prior gives
half of what is known; `inseparable` where two coefficients are known together only;
`identified` from `T_LIMIT` standard errors on; otherwise `weak`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import VELOCITIES, Array
from auvid.hydro.axis_figures import AxisEquation
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.axes.pooled_fit import Pool, PoolFit
from auvid.hydro.identification.axes.structure import CONSTANT, FORCE, INPUT, AxisTerm
from auvid.hydro.identification.constrained.statuses import AT_BOUND, FROM_PRIOR, PRIOR_SHARE
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    INSEPARABLE,
    NOT_EXCITED,
    T_LIMIT,
    WEAK,
)

FLOORS = {"u": 0.03, "v": 0.03, "w": 0.01, "p": 0.02, "q": 0.02, "r": 0.02}
"""RMS from which on a velocity counts as excited [m/s, rad/s]: ten times the noise of
gyro or depth rate at 1 Hz, or of a velocity log."""
INSEPARABLE_CORRELATION = 0.98
"""Correlation from which on two coefficients are not told apart: standard errors five
times as large as with the other one known."""
LIKELY, ALIKE_WITHIN = 0.05, 1.2
"""Legs differ where chance alone is less probable than this, and the largest is more than
so many times the smallest."""


@dataclass(frozen=True)
class AxisVerdict:
    """Verdict on one coefficient; `partners`: what it is inseparable from."""

    word: str
    partners: tuple[str, ...] = ()


@dataclass(frozen=True)
class Heterogeneity:
    """Whether legs agree in a quantity: Q = sum (x_l - mean)^2 / se_l^2 (Cochran 1954).

    `values` and `standard_errors` by leg number; `probability` of so large a Q by
    chance, chi-squared with legs - 1 degrees; `ratio`: largest over smallest modulus.
    """

    quantity: str
    values: Mapping[int, float]
    standard_errors: Mapping[int, float]
    q: float
    probability: float
    ratio: float

    @property
    def differ(self) -> bool:
        """Return whether the legs differ by more than chance, and by what matters."""
        return self.probability < LIKELY and self.ratio > ALIKE_WITHIN


def verdicts_of(pool: Pool, fit: PoolFit) -> dict[str, AxisVerdict]:
    """Return the verdict on every coefficient, by name `axis term`."""
    moving = _movement(pool)
    size = np.sqrt(np.diag(fit.information))
    out = {}
    for i, term in enumerate(pool.structure.terms):
        error = float(np.sqrt(fit.covariance[i, i]))
        share = 1.0 - fit.information[i, i] / max(fit.data_variances[i], 1e-300)
        with np.errstate(all="ignore"):
            near = np.abs(fit.information[i]) / (size[i] * size)
        partners = tuple(
            name
            for j, name in enumerate(fit.names)
            if j != i and np.isfinite(near[j]) and near[j] >= INSEPARABLE_CORRELATION
        )
        if not _excited(term, moving):
            word = AxisVerdict(NOT_EXCITED)
        elif term.sd == 0.0 or (0.0 < term.sd < np.inf and share >= PRIOR_SHARE):
            word = AxisVerdict(FROM_PRIOR)
        elif fit.at_bound[i]:
            word = AxisVerdict(AT_BOUND)
        elif error > 0.0 and abs(fit.values[i]) >= T_LIMIT * error:
            word = AxisVerdict(IDENTIFIED)
        elif partners:
            word = AxisVerdict(INSEPARABLE, partners)
        else:
            word = AxisVerdict(WEAK)
        out[fit.names[i]] = word
    return out


def rms_of(pool: Pool) -> dict[str, float]:
    """Return the RMS of every velocity, and by input its spread, over the windows."""
    out = {}
    nu = np.vstack([pool.prepared[w.leg].nu[w.nodes] for w in pool.windows])
    start = np.vstack([pool.prepared[w.leg].start[w.nodes] for w in pool.windows])
    for j, place in enumerate(pool.structure.places):
        nu[:, place] = start[:, j]
    for j, name in enumerate(VELOCITIES):
        out[name] = float(np.sqrt(np.mean(nu[:, j] ** 2)))
    return out


def _movement(pool: Pool) -> dict[str, float]:
    out = rms_of(pool)
    for name in pool.structure.inputs:
        parts = [
            (pool.records[w.leg].force if name in pool.records[w.leg].force
             else pool.extra[w.leg])[name][w.nodes]
            for w in pool.windows
        ]  # fmt: skip
        out[name] = float(np.ptp(np.concatenate(parts)))
    return out


def _excited(term: AxisTerm, moving: Mapping[str, float]) -> bool:
    if term.kind == CONSTANT:
        return True
    if term.kind == INPUT:
        return moving[term.axis if term.name == "force" else term.name] > 0.0
    name = VELOCITIES[term.of]
    return moving[name] >= FLOORS[name]


def heterogeneity(
    quantity: str, values: Sequence[float], errors: Sequence[float], legs: Sequence[int]
) -> Heterogeneity:
    """Return Cochran's Q of one quantity over legs.

    >>> heterogeneity("drag", [1.0, 3.0], [0.5, 0.5], [0, 1]).q
    8.0
    """
    from scipy.stats import chi2

    x, se = np.asarray(values), np.asarray(errors)
    weight = se**-2.0
    mean = float(weight @ x / weight.sum())
    q = float(weight @ (x - mean) ** 2)
    size = np.abs(x)
    return Heterogeneity(
        quantity,
        dict(zip(legs, x.tolist(), strict=True)),
        dict(zip(legs, se.tolist(), strict=True)),
        q,
        float(chi2.sf(q, len(x) - 1)),
        float(size.max() / size.min()) if size.min() > 0.0 else float("inf"),
    )


def coefficient_block(fit: PoolFit, axis: str, names: Sequence[str]) -> tuple[Array, Array]:
    """Return named values of one axis with their covariance; 0 for absent ones."""
    places = [fit.names.index(f"{axis} {name}") if f"{axis} {name}" in fit.names else -1
              for name in names]  # fmt: skip
    kept = [i for i, place in enumerate(places) if place >= 0]
    index = [places[i] for i in kept]
    values, covariance = np.zeros(len(names)), np.zeros((len(names), len(names)))
    values[kept] = fit.values[index]
    covariance[np.ix_(kept, kept)] = fit.covariance[np.ix_(index, index)]
    return values, covariance


def beside_force(fit: PoolFit, axis: str, name: str, width: float) -> AxisEquation | None:
    """Return c and a term of an axis, for the term as a force; None where it has none.

    1.96 of their standard errors are half of the 95 % interval (`width` errors of the fit).
    """
    if f"{axis} {name}" not in fit.names:
        return None
    names = (FORCE, name)
    values, covariance = coefficient_block(fit, axis, names)
    return AxisEquation(axis, names, values, covariance * (width / NORMAL_95) ** 2, {})
