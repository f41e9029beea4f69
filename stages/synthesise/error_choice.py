"""Models fitted by another error function than the sum of squares (McCarter 4.2).

A sum of squares comes from the triangular factor, whatever the length of the legs. A sum
of moduli, a median and Huber's function need the samples: at most `MOST_SAMPLES` of
them, spread evenly over the training legs. No interval of theirs is known here, so no
coefficient is called identified.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from auvid.data_schemas.errors import CampaignError, DataError, PipelineError
from auvid.data_schemas.records.models import AxisCard, CovarianceCard, ModelCard
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.identification.regression.error_functions import (
    HUBER,
    NELDER_MEAD,
    OWN,
    SIMPLEX_TERMS,
    SQUARES,
    deviation_weights,
    minimise_error,
)
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    AxisFit,
    TriangularFactor,
)
from auvid.hydro.identification.regression.verdicts import strongest
from auvid.stages.synthesise.training import TrainingSegment

EQUAL, DEVIATIONS = "equal", "deviations"
WEIGHTS = (EQUAL, DEVIATIONS)
MOST_SAMPLES = 20_000
"""Samples that other error functions see: 400 s at 50 Hz, or each tenth of 4000 s."""
METHOD = "error function"


@dataclass(frozen=True)
class ErrorChoice:
    """What is minimised and how: of `ERROR_FUNCTIONS`, `WEIGHTS`, `MINIMISERS`."""

    function: str
    weights: str
    minimiser: str

    @property
    def is_plain(self) -> bool:
        """Return whether it is what the triangular factor gives."""
        return (self.function, self.weights, self.minimiser) == (SQUARES, EQUAL, OWN)


def check_choice(
    choice: ErrorChoice, *, limited: Sequence[str], prior: str, largest: Mapping[str, int]
) -> None:
    """Raise `CampaignError` for what cannot go together.

    limited: models fitted within physical limits; largest: model -> most coefficients on
    an axis.
    """
    if choice.is_plain:
        return
    field = "stages.synthesise.error_function"
    if choice.minimiser == NELDER_MEAD and choice.function == HUBER:
        raise CampaignError(
            "the scale of Huber's function moves with the coefficients, so a simplex has no"
            " function to go down",
            field="stages.synthesise.minimiser",
            value=choice.minimiser,
            allowed=(OWN,),
        )
    large = [name for name, count in largest.items() if count > SIMPLEX_TERMS]
    if choice.minimiser == NELDER_MEAD and large:
        raise CampaignError(
            "a simplex crawls with so many coefficients on an axis",
            field="stages.synthesise.minimiser",
            value=f"{large[0]}: {largest[large[0]]}",
            allowed=f"at most {SIMPLEX_TERMS}",
            remedy="Name smaller models, or set minimiser: own.",
        )
    if limited:
        raise CampaignError(
            "physical limits, and inertia beside them, need the sum of squares, equal weights and"
            " their own minimiser",
            field=field,
            value=f"{choice.function}, {choice.weights}, {choice.minimiser} with {limited[0]}",
            remedy="Leave structures out of `models` and `structures`, or set damping: free and"
            " no inertia.",
        )
    if prior != "none":
        raise CampaignError(
            "a prior weighs against squares of normal errors",
            field=field,
            value=f"{choice.function} with prior {prior}",
            remedy="Set prior: none.",
        )


@dataclass(frozen=True)
class FitSamples:
    """Training samples of all legs: rows (k, n) of `terms`, forces (n, 6).

    nu, sd (n, 6) and ratio (n,) as in `TrainingSegment`; sd None where a leg has none.
    """

    terms: tuple[str, ...]
    rows: Array
    force: Array
    nu: Array
    sd: Array | None
    ratio: Array | None

    @classmethod
    def of(cls, legs: Iterable[TrainingSegment], terms: tuple[str, ...], count: int) -> FitSamples:
        """Return every so-many-th of `count` samples."""
        step = -(-count // MOST_SAMPLES)
        return reduce(cls.merge, (cls._of_leg(leg, terms, step) for leg in legs))

    @classmethod
    def _of_leg(cls, leg: TrainingSegment, terms: tuple[str, ...], step: int) -> FitSamples:
        nu = leg.nu[::step]
        ratio = None if leg.ratio is None else leg.ratio[::step]
        sd = None if leg.sd is None else leg.sd[::step]
        return cls(terms, basis_rows(nu.T, ratio, terms), leg.force[::step], nu, sd, ratio)

    def merge(self, other: FitSamples) -> FitSamples:
        """Return the samples of both."""

        def both(one: Array | None, two: Array | None) -> Array | None:
            return None if one is None or two is None else np.concatenate([one, two])

        return FitSamples(
            self.terms,
            np.hstack([self.rows, other.rows]),
            np.concatenate([self.force, other.force]),
            np.concatenate([self.nu, other.nu]),
            both(self.sd, other.sd),
            both(self.ratio, other.ratio),
        )

    def minimum(self, fit: AxisFit, choice: ErrorChoice) -> Array:
        """Return the coefficients (k,) of a fit's terms; 0 where it has no number."""
        names = [fit.terms[i] for i in fit.independent]
        force = self.force[:, AXES.index(fit.axis)]
        ones = np.ones((1, len(force)))
        place = {term: i for i, term in enumerate(self.terms)}
        rows = np.vstack([ones if name == CONSTANT else self.rows[[place[name]]] for name in names])
        weights = None
        if choice.weights == DEVIATIONS:
            if self.sd is None:
                raise DataError(
                    "weights by deviations need standard deviations of the velocities, and fuse"
                    " gave none",
                    field="stages.synthesise.weights",
                    value=choice.weights,
                    allowed=(EQUAL,),
                )
            terms = tuple(name for name in names if name != CONSTANT)
            values = [fit.solution[i] for i in fit.independent if fit.terms[i] != CONSTANT]
            weights = deviation_weights(
                terms, values, self.nu, self.sd, noise=fit.rms, ratio=self.ratio
            )
        solution = np.zeros(len(fit.terms))
        solution[list(fit.independent)] = minimise_error(
            rows, force, choice.function, weights=weights, minimiser=choice.minimiser
        )
        return solution


def by_error_function(
    card: ModelCard,
    fits: Mapping[str, AxisFit],
    factor: TriangularFactor,
    samples: FitSamples,
    choice: ErrorChoice,
) -> ModelCard:
    """Return the card of least squares with the coefficients of another error function.

    fits: by axis, of least squares. J is that of all samples. Raises `DataError` that
    names model and axis where a minimum is not found.
    """
    axes: dict[str, AxisCard] = {}
    predictor: dict[str, dict[str, float]] = {}
    for axis, fit in fits.items():
        try:
            solution = samples.minimum(fit, choice) if fit.independent else fit.solution
        except PipelineError as wrong:
            raise DataError(
                wrong.message,
                field=wrong.field or f"{card.name}, axis {axis}, {choice.function}",
                value=wrong.value,
                allowed=wrong.allowed,
                remedy="Name another error_function, or leave the model out of `models`.",
            ) from wrong
        index = [factor.columns.index(term) for term in fit.terms]
        error = factor.R[:, factor.columns.index(axis)] - factor.R[:, index] @ solution
        axes[axis] = _axis(card.axes[axis], dict(zip(fit.terms, solution.tolist(), strict=True)))
        j = float(np.linalg.norm(error) / np.sqrt(factor.n_samples))
        axes[axis] = axes[axis].model_copy(update={"j": j})
        predictor[axis] = dict(zip(fit.terms, solution.tolist(), strict=True))
    return card.model_copy(
        update={
            "method": METHOD,
            "error_function": choice.function,
            "weights": choice.weights,
            "minimiser": choice.minimiser,
            "coverage_on_twins": {},
            "velocity_errors": None,
            "left_out": [],
            "held_out": {},
            "axes": axes,
            "predictor": predictor,
        }
    )


def _axis(part: AxisCard, values: Mapping[str, float]) -> AxisCard:
    """Return the axis with other values, of which no error is known."""
    terms = [
        item.model_copy(
            update={
                "value": None if item.value is None else values[item.term],
                "standard_error": None,
                "verdict": strongest(item.verdict, METHOD),
                "turns_without": None,
                "assumed_shifts": {},
            }
        )
        for item in part.terms
    ]
    return part.model_copy(
        update={
            "terms": terms,
            "covariance": CovarianceCard(terms=[], lower=[]),
            "combinations": [],
        }
    )
