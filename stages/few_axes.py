"""Card and ranking of a model of some axes, whatever it was fitted by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from auvid.data_schemas.records.models import (
    AxisCard,
    AxisMerit,
    CovarianceCard,
    MeritRecord,
    ModelCard,
    RankingRecord,
    TermCard,
    UsableFor,
    VelocityRange,
)
from auvid.data_schemas.records.partial import AT_SPEED
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.identification.regression.verdicts import IDENTIFIED
from auvid.stages.model_use import TILTS
from auvid.stages.number_format import CONTROL_PERCENT, SIMULATED_PERCENT
from auvid.stages.page.first_screen import ALL


def axis_card(
    unit: str,
    terms: Sequence[TermCard],
    covariance: Array,
    *,
    samples: int,
    rms: tuple[float, float],
    shifts: Mapping[str, Array] | None = None,
) -> AxisCard:
    """Return the card of an axis; covariance (k, k), RMS of signal and of error.

    shifts: assumed figure -> what it moves the values (k,) by.
    """
    return AxisCard(
        unit=unit,
        samples=samples,
        rank=len(terms),
        condition=None,
        j0=rms[0],
        j=rms[1],
        excitation="excited",
        terms=list(terms),
        covariance=CovarianceCard(
            terms=[item.term for item in terms],
            lower=[covariance[row, : row + 1].tolist() for row in range(len(terms))],
            shifts={figure: [row.tolist()] for figure, row in (shifts or {}).items()},
        ),
        combinations=[],
    )


def empty_axis_card(unit: str, terms: Sequence[TermCard] = ()) -> AxisCard:
    """Return the card of an axis that is not fitted, with terms from elsewhere."""
    return AxisCard(
        unit=unit,
        samples=0,
        rank=0,
        condition=None,
        j0=None,
        j=None,
        excitation="not excited",
        terms=list(terms),
        covariance=CovarianceCard(terms=[], lower=[]),
        combinations=[],
    )


def predictor_of(axes: Mapping[str, AxisCard]) -> dict[str, dict[str, float]]:
    """Return the numbers that predict the force: those of all terms that have one."""
    return {
        axis: {item.term: item.value for item in part.terms if item.value is not None}
        for axis, part in axes.items()
    }


def ranking(card: ModelCard, trained: Mapping[str, float], *, rule: str) -> RankingRecord:
    """Return the record of the one model, by its fit on what was held out.

    trained: axis -> fit in training [%]; rule: what was held out.
    """
    usable = usable_for(card)
    merit = MeritRecord(
        name=card.name,
        title=card.title,
        published=False,
        terms=card.n_bar,
        rank=card.rank,
        j=None,
        axes=_merits(card, trained),
        runs=0,
        lost=0,
        faults=[],
    )
    chosen = card.name if usable.simulation else None
    if chosen is None:
        rule = f"no axis reaches a fit of {SIMULATED_PERCENT:g} % on what was held out"
    return RankingRecord(
        models=[merit],
        choice=chosen,
        rule=rule,
        legs_left_out=0,
        horizon_s=None,
        usable=usable if usable.simulation else None,
    )


def usable_for(card: ModelCard) -> UsableFor:
    """Return which axes simulate, and which are good enough for a controller.

    Roll and pitch only with a righting moment that was fitted, not that of the vehicle file.
    A glider is controlled by its pitch, which its file takes as it comes.
    """
    assert card.partial is not None
    righting = card.partial.righting
    fit = {
        axis: item.held_out_percent
        for axis, item in card.partial.axes.items()
        if axis not in TILTS or (righting is not None and axis in righting.axes)
    }

    def above(limit: float) -> list[str]:
        return [axis for axis, value in fit.items() if value is not None and value >= limit]

    damped = {
        axis
        for axis, part in card.axes.items()
        if any(
            item.verdict == IDENTIFIED and VELOCITIES[AXES.index(axis)] in item.term
            for item in part.terms
        )
    } | {
        item.axis
        for item in card.partial.without_newtons
        if item.verdict == IDENTIFIED and item.quantity.startswith(AT_SPEED)
    }
    return UsableFor(
        forces=[],
        simulation=above(SIMULATED_PERCENT),
        control=(
            []
            if card.method == "glides"
            else [axis for axis in above(CONTROL_PERCENT) if axis in damped]
        ),
        speeds=card.conditions,
    )


def _merits(card: ModelCard, trained: Mapping[str, float]) -> dict[str, AxisMerit]:
    """Return errors of the rate over its departure from the mean, axis by axis."""
    assert card.partial is not None
    sources = {str(axis): item for axis, item in card.partial.axes.items()}
    merits = {}
    for axis, part in card.axes.items():
        source = sources.get(axis)
        fitted = axis in trained and source is not None
        fit = source.held_out_percent if fitted and source is not None else None
        error = None if fit is None else 1.0 - fit / 100.0
        merits[axis] = AxisMerit(
            validation=error,
            training=1.0 - trained[axis] / 100.0 if fitted else None,
            left_out=None,
            bic=None,
            free_run=error,
            identified=sum(term.verdict == IDENTIFIED for term in part.terms),
            coefficients=len(part.terms),
        )
    errors = [m.validation for m in merits.values() if m.validation is not None]
    training = [m.training for m in merits.values() if m.training is not None]
    return merits | {
        ALL: AxisMerit(
            validation=float(np.mean(errors)) if errors else None,
            training=float(np.mean(training)) if training else None,
            left_out=None,
            bic=None,
            free_run=None,
            identified=sum(m.identified for m in merits.values()),
            coefficients=sum(m.coefficients for m in merits.values()),
        )
    }


def speed_range(values: Any) -> VelocityRange:
    """Return RMS and ends of measured velocities, nan left out."""
    finite = np.asarray(values)[np.isfinite(values)]
    return VelocityRange(
        rms=float(np.sqrt(np.mean(finite**2))),
        low=float(finite.min()),
        high=float(finite.max()),
    )


def mean_by_errors(figures: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Return the mean by errors; its error is that of the scatter where that is larger.

    >>> [round(x, 3) for x in mean_by_errors([[1.0, 0.1], [2.0, 0.1]])]
    [1.5, 0.5]
    """
    values, errors = np.array(figures).T
    weights = np.maximum(errors, 1e-12) ** -2.0
    mean = float(weights @ values / weights.sum())
    scatter = float(weights @ (values - mean) ** 2) / max(len(values) - 1, 1)
    return mean, float((max(scatter, 1.0) / weights.sum()) ** 0.5)
