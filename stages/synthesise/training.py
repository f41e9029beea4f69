"""The training legs, one at a time: what synthesis keeps of each, and its errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TypeVar

import numpy as np
import pyarrow as pa

from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.identification.constrained.equations import (
    ACCELERATIONS,
    ACTUATOR_RATES,
    extra_rows,
)
from auvid.hydro.identification.regression.attenuation import RegressorErrors
from auvid.hydro.identification.regression.excitation import VelocityExcitation, axis_excitation
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    AxisFit,
    TriangularFactor,
)
from auvid.hydro.identification.regression.standard_errors import CoefficientScores
from auvid.stages.columns import (
    ACCELERATION,
    VELOCITY,
    VELOCITY_SD,
    clock,
    force_columns,
    forces,
)

HAC_BLOCK_SAMPLES = 32_768
"""The coloured standard errors take correlation within so many samples into account (11
minutes at 50 Hz): it bounds their memory.
"""
MOST_PARTS = 8
"""Legs are left out one by one up to this number of legs, in so many groups beyond it."""
ROWS_AT_ONCE = 8192  # the basis rows of a larger chunk leave the processor's cache
ACTUATORS = ("fins", "propeller", "thrusters")
"""Components of the residual force that a lag of the actuators delays."""
Fits = Mapping[tuple[str, str], AxisFit]
"""Least-squares fits by model and axis."""
T = TypeVar("T")


@dataclass(frozen=True)
class TrainingSegment:
    """One training segment; None where unknown.

    nu and its standard deviations (n, 6), eta_ratio (n,), tau_bar (n, 6).
    """

    nu: Array
    sd: Array | None
    ratio: Array | None
    force: Array

    @classmethod
    def of(cls, residual: pa.Table, *, with_ratio: bool) -> TrainingSegment:
        """Return the samples of a residual table."""
        return cls(
            matrix(residual, VELOCITY),
            matrix(residual, VELOCITY_SD) if has_columns(residual, VELOCITY_SD) else None,
            column(residual, "eta_ratio") if with_ratio else None,
            forces(residual, "tau_bar"),
        )

    def blocks(self, size: int, terms: Sequence[str]) -> Iterator[tuple[Array, Array]]:
        """Return basis rows (k, m) and forces (m, 6) of `size` samples at a time."""
        for start in range(0, len(self.force), size):
            rows = slice(start, start + size)
            ratio = None if self.ratio is None else self.ratio[rows]
            yield basis_rows(self.nu[rows].T, ratio, terms), self.force[rows]


@dataclass(frozen=True)
class TrainingData:
    """Sums that fits need of the training legs; merging keeps the memory constant.

    `errors`: None where a leg has no standard deviations of its velocities.
    """

    factor: TriangularFactor
    errors: RegressorErrors | None
    motion: Mapping[str, VelocityExcitation]

    @classmethod
    def of(cls, leg: TrainingSegment, terms: Sequence[str]) -> TrainingData:
        """Return the data of one leg."""
        factor = TriangularFactor.empty(terms)
        for rows, force in leg.blocks(ROWS_AT_ONCE, terms):
            factor = factor.update(rows, force)
        errors = None
        if leg.sd is not None:
            errors = RegressorErrors.empty(terms).update(leg.nu, leg.sd, ratio=leg.ratio)
        return cls(factor, errors, axis_excitation(leg.nu, eta_ratio=leg.ratio))

    def merge(self, other: TrainingData) -> TrainingData:
        """Return the data of both."""
        errors = None
        if self.errors is not None and other.errors is not None:
            errors = self.errors.merge(other.errors)
        motion = {name: item.merge(other.motion[name]) for name, item in self.motion.items()}
        return TrainingData(self.factor.merge(other.factor), errors, motion)


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


def others_of(parts: Mapping[str, TriangularFactor]) -> dict[str, TriangularFactor]:
    """Return for each part the factor of all others; empty for a single part."""
    if len(parts) < 2:
        return {}
    return {
        name: reduce(
            TriangularFactor.merge, (part for other, part in parts.items() if other != name)
        )
        for name in parts
    }


def motion_factor(residual: pa.Table, fused: pa.Table, terms: Sequence[str]) -> TriangularFactor:
    """Return the factor of a leg with accelerations and actuator force rates."""
    t_s, force = clock(residual), forces(residual, "tau_bar")
    actuators = np.zeros_like(force)
    for name in ACTUATORS:
        if has_columns(residual, force_columns(name)):
            actuators += forces(residual, name)
    ratio = column(residual, "eta_ratio") if has_columns(residual, ("eta_ratio",)) else None
    extra = extra_rows(matrix(fused, ACCELERATION), actuators, step_s=float(np.mean(np.diff(t_s))))
    rows = basis_rows(matrix(residual, VELOCITY).T, ratio, terms)
    empty = TriangularFactor.empty((*terms, *ACCELERATIONS, *ACTUATOR_RATES))
    return empty.update(np.vstack([rows, extra]), force)


def coloured_covariances(
    fits: Fits, legs: Iterable[TrainingSegment], terms: Sequence[str], *, lags: int | None
) -> dict[tuple[str, str], Array]:
    """Return the covariance (k, k) of every fit for autocorrelated residuals.

    One more pass over the legs. nan where there are no more samples than coefficients.
    """
    row_of = {term: row for row, term in enumerate(terms)}
    scores = {
        key: CoefficientScores.empty(fit, lags=lags)
        for key, fit in fits.items()
        if fit.n_samples > len(fit.independent)
    }
    for leg in legs:
        for rows, force in leg.blocks(HAC_BLOCK_SAMPLES, terms):
            for (model, axis), score in scores.items():
                own = [row_of[term] for term in score.fit.terms if term != CONSTANT]
                scores[model, axis] = score.update(rows[own], force[:, AXES.index(axis)])
    return {
        key: (
            scores[key].covariance()
            if key in scores
            else np.full((len(fit.terms), len(fit.terms)), np.nan)
        )
        for key, fit in fits.items()
    }
