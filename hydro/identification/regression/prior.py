"""A prior on the coefficients of an axis, for example strip theory.

It is rows appended to the triangular factor of the data. Posterior mean of K with
independent normal priors N(mean, sd^2) and a force error of variance s^2: least squares
over the data and one row (s / sd) K = (s / sd) mean per coefficient (Gelman et al.,
Bayesian Data Analysis, 14.8).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.regression.least_squares import (
    AxisFit,
    TriangularFactor,
    solve_axis,
)


def posterior(
    factor: TriangularFactor,
    fit: AxisFit,
    covariance: Array,
    means: Mapping[str, float],
    *,
    relative_sd: float,
    trim: bool = False,
) -> tuple[AxisFit, Array]:
    """Return the fit of one axis with priors, and the covariance (k, k).

    `fit` and `covariance`: from the data alone, the latter for coloured residuals;
    their ratio to the white one says how many independent samples the data are worth,
    and so how much they weigh against the prior. `means`: term -> mean, those that the
    model does not have or that are 0 are left out; the standard deviation is
    `relative_sd` of the mean. `sse`, `rms` and `j0` count the data alone.
    """
    chosen = {term: mean for term, mean in means.items() if term in fit.terms and mean != 0.0}
    if not chosen:
        return fit, covariance
    noise = fit.rms * np.sqrt(coloured_over_white(fit, covariance))
    rows = np.zeros((len(chosen), len(factor.columns)))
    for row, (term, mean) in zip(rows, chosen.items(), strict=True):
        weight = noise / (relative_sd * abs(mean))
        row[factor.columns.index(term)], row[factor.columns.index(fit.axis)] = weight, weight * mean
    names = [term for term in fit.terms if term in factor.terms]
    result = solve_axis(factor.with_rows(rows), fit.axis, names, trim=trim)
    columns = [factor.columns.index(term) for term in result.terms]
    residual = factor.R[:, factor.columns.index(fit.axis)] - factor.R[:, columns] @ result.solution
    result = replace(result, sse=float(residual @ residual), j0=fit.j0)
    return result, _covariance(
        result, fit, covariance, factor.R[:, columns], rows[:, columns], noise
    )


def coloured_over_white(fit: AxisFit, covariance: Array) -> float:
    """Return the median ratio, at least 1, of coloured to white variances.

    It is how many samples count as one independent one.
    """
    white, coloured = np.diag(fit.covariance), np.diag(covariance)
    usable = np.isfinite(white) & np.isfinite(coloured) & (white > 0.0)
    return max(1.0, float(np.median(coloured[usable] / white[usable]))) if usable.any() else 1.0


def _covariance(
    result: AxisFit, fit: AxisFit, covariance: Array, data: Array, rows: Array, noise: float
) -> Array:
    """Return (X'X + P'P)^-1 [S + noise^2 P'P] (X'X + P'P)^-1.

    S is the moment of the scores that gave `covariance`, white where it gave none.
    """
    from scipy.linalg import cho_solve

    kept, own = (
        list(result.independent),
        np.array([i for i in fit.independent if np.isfinite(covariance[i, i])], dtype=int),
    )
    gram, prior = data.T @ data, rows.T @ rows
    middle = noise**2 * gram
    if len(own):
        cell = np.ix_(own, own)
        middle[cell] = gram[cell] @ covariance[cell] @ gram[cell]
    middle = middle + noise**2 * prior
    scale = result.column_norms[kept]
    bread = cho_solve((result.scaled_triangle, False), np.eye(len(kept))) / np.outer(scale, scale)
    full = np.full((len(result.terms), len(result.terms)), np.nan)
    cell = np.ix_(kept, kept)
    full[cell] = bread @ middle[cell] @ bread
    return full
