"""Normal priors on unknowns, from whatever source.

Published damping, strip theory, a bench result, or the posterior of another campaign
with its covariance. A prior is rows of the least-squares problem: with P = L L',
(x - m)' P^-1 (x - m) = |L^-1 x - L^-1 m|^2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.viscous.models import Coefficients
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.limits import place_of

VEHICLE, BENCH, CAMPAIGN = "vehicle", "bench", "campaign"


@dataclass(frozen=True)
class NormalPrior:
    """Mean (k,) and covariance (k, k) of some unknowns, and where they come from."""

    source: str
    unknowns: tuple[Unknown, ...]
    mean: Array
    covariance: Array

    @classmethod
    def independent(cls, source: str, values: Mapping[Unknown, tuple[float, float]]) -> NormalPrior:
        """Return the prior of independent unknowns, each with (mean, deviation)."""
        mean = np.array([m for m, _ in values.values()])
        deviation = np.array([sd for _, sd in values.values()])
        return cls(source, tuple(values), mean, np.diag(deviation**2))

    @classmethod
    def relative(cls, source: str, means: Coefficients, *, relative_sd: float) -> NormalPrior:
        """Return the prior of coefficients with deviations relative to each.

        means: axis -> term -> mean, as strip theory and vehicle files have them; one of
        0 says nothing and is left out.
        """
        values = {
            Unknown(axis, term): (mean, relative_sd * abs(mean))
            for axis, terms in means.items()
            for term, mean in terms.items()
            if mean != 0.0
        }
        return cls.independent(source, values)

    def mean_and_sd(self, unknown: Unknown) -> tuple[float, float]:
        """Return mean and standard deviation of one of its unknowns."""
        i = self.unknowns.index(unknown)
        return float(self.mean[i]), float(np.sqrt(self.covariance[i, i]))

    def of(self, unknowns: Sequence[Unknown]) -> NormalPrior:
        """Return the prior of those of its unknowns that a model has.

        The rest is integrated out.
        """
        kept = [i for i, unknown in enumerate(self.unknowns) if unknown in unknowns]
        return NormalPrior(
            self.source,
            tuple(self.unknowns[i] for i in kept),
            self.mean[kept],
            self.covariance[np.ix_(kept, kept)],
        )

    def rows(self, unknowns: Sequence[Unknown]) -> Array:
        """Return [L^-1, L^-1 m] (k, p + 1) on the unknowns of a model.

        Raises `PipelineError` for an unknown that the model does not have, and for a
        covariance that is not positive definite.
        """
        from scipy.linalg import solve_triangular

        columns = [place_of(unknowns, unknown) for unknown in self.unknowns]
        deviation = np.sqrt(np.diag(self.covariance))
        if not (np.isfinite(deviation).all() and (deviation > 0.0).all()):
            bad = self.unknowns[int(np.argmin(np.where(np.isfinite(deviation), deviation, 0.0)))]
            raise PipelineError("a prior needs a deviation above 0", field=f"{self.source}: {bad}")
        try:
            L = np.linalg.cholesky(self.covariance / np.outer(deviation, deviation))
        except np.linalg.LinAlgError:
            raise PipelineError(
                "the covariance of a prior is not positive definite", field=self.source
            ) from None
        whitened = solve_triangular(L, np.diag(1.0 / deviation), lower=True)
        out = np.zeros((len(columns), len(unknowns) + 1))
        out[:, columns], out[:, -1] = whitened, whitened @ self.mean
        return out
