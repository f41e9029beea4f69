"""Whether windows agree on one set of unknowns, and the spread where they do not.

A model that has the truth is missed by each window as much as its noise says. One that
has not is missed in its own way by each, however well all together are fitted: then the
inverse of the information is no covariance, and what the unknowns move by when a window
is left out tells how far they can be trusted (decision 0090).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.identification.maximum_likelihood.gauss_newton import (
    NormalEquations,
    solve_scaled,
)
from auvid.hydro.identification.maximum_likelihood.likelihood import Likelihood, WindowRun
from auvid.hydro.identification.regression.standard_errors import widened_by

FEWEST_PARTS = 4
"""Fewer windows are cut: what two parts differ by says next to nothing of a spread."""
LIKELY = 1e-3
"""Probability under the model from which on parts agree: of 15 fits to a truth
inside the form the least was .035, of all others the greatest 1e-4 (decision 0090).
"""
OWN_SHARE = 1e-2
"""Share of all information from which on a part tells of a direction by itself."""
LEFT = 1e-9
"""An unknown with less than this share of its information outside a part is of that part."""


@dataclass(frozen=True)
class Agreement:
    """What the parts differ by, and how probable that is under the model.

    ratio: mean square of the differences over what noise makes of it, 1 for a true model.
    degrees: how many differences; 0, with a ratio of 1, where no two parts tell of the same
    direction.
    """

    ratio: float
    degrees: int
    probability: float

    @property
    def holds(self) -> bool:
        """Return whether noise explains the differences."""
        return self.probability >= LIKELY


@dataclass(frozen=True)
class PartEquations:
    """Information (m, n, n) and minus gradients (m, n) of parts by the common unknowns.

    The starts of windows are projected out.
    """

    information: Array
    vectors: Array

    def agreement(self, free: Mask) -> Agreement:
        """Return whether the parts agree on the unknowns that are `free` (n,).

        A part alone would be better by b' A^-1 b / 2 of log-likelihood: the sum of b' A^-1 b
        is chi-squared with as many degrees of freedom as the parts determine directions,
        less those that all determine together (Chow 1960).
        """
        from scipy.special import gammaincc

        cell = np.ix_(free, free)
        total = self.information.sum(axis=0)[cell]
        scale = 1.0 / np.sqrt(np.diag(total))
        sizes, axes = np.linalg.eigh(total * np.outer(scale, scale))
        kept = sizes > 1e-12 * sizes[-1]
        # Directions along which all parts together have the information 1.
        root = scale[:, None] * axes[:, kept] / np.sqrt(sizes[kept])
        square, degrees = 0.0, -int(kept.sum())
        for information, vector in zip(self.information, self.vectors, strict=True):
            shares, own = np.linalg.eigh(root.T @ information[cell] @ root)
            clear = shares > OWN_SHARE
            along = own.T @ (root.T @ vector[free])
            square += float(np.sum(along[clear] ** 2 / shares[clear]))
            degrees += int(clear.sum())
        if degrees <= 0:
            return Agreement(1.0, 0, 1.0)
        probability = float(gammaincc(0.5 * degrees, 0.5 * square))
        return Agreement(square / degrees, degrees, probability)

    def left_out_covariance(self, free: Mask, prior: Array) -> Array:
        """Return the covariance (n, n) by leaving one part after the other out.

        Changes d = -(A - A_i)^-1 b_i of the unknowns; (m - 1) / m sum of d d' (delete-a-group
        jackknife), times (t / 1.96)^2 with m - 1 degrees of freedom, so that 1.96 standard
        errors are the 95 % interval. prior (n, n): its information, in A; nan where not free.
        """
        cell = np.ix_(free, free)
        total = self.information.sum(axis=0)[cell] + prior[cell]
        count, changes = len(self.vectors), np.zeros_like(self.vectors[:, free])
        for change, information, vector in zip(
            changes, self.information, self.vectors, strict=True
        ):
            rest = total - information[cell]
            outside = np.diag(rest) > LEFT * np.diag(total)
            change[outside] = -solve_scaled(rest[np.ix_(outside, outside)], vector[free][outside])
        covariance = changes.T @ changes * ((count - 1) / count * widened_by(count - 1) ** 2)
        out = np.full(prior.shape, np.nan)
        out[cell] = covariance
        return out


def projected_rows(
    likelihood: Likelihood, equations: NormalEquations, runs: Sequence[WindowRun]
) -> list[Array]:
    """Return d(prediction)/d(own common unknowns) (samples, g) of each window.

    What its start takes over is projected out.
    """
    out = []
    for number, (window, run) in enumerate(zip(likelihood.windows, runs, strict=True)):
        place = likelihood.places(window.leg)
        g = len(place)
        block, across = equations.local[number], equations.coupling[number][:, place]
        out.append(run.jacobian[:, :g] - run.jacobian[:, g:] @ solve_scaled(block, across))
    return out


def part_equations(
    likelihood: Likelihood, runs: Sequence[WindowRun], rows: Sequence[Array]
) -> PartEquations:
    """Return the equations of all windows, each in parts where they are few.

    rows: of `projected_rows`.
    """
    n, cuts = likelihood.unknowns, -(-FEWEST_PARTS // len(runs))
    information, vectors = [], []
    for window, run, own in zip(likelihood.windows, runs, rows, strict=True):
        place = likelihood.places(window.leg)
        for part in np.array_split(np.arange(len(own)), cuts):
            weighted = own[part] / run.variances[part, None]
            matrix, vector = np.zeros((n, n)), np.zeros(n)
            matrix[np.ix_(place, place)] = weighted.T @ own[part]
            vector[place] = weighted.T @ run.errors[part]
            information.append(matrix)
            vectors.append(vector)
    return PartEquations(np.array(information), np.array(vectors))
