"""Which form output error is worth a try with, by what least squares says of it.

Free runs hold where the form has the truth and nothing unknown pushes. Least squares says
both for nothing: by the evidence of the training force, and by how far an unsteady force
leans its coefficients (decision 0113).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.identification.maximum_likelihood.estimate import LikelihoodEstimate
from auvid.hydro.identification.maximum_likelihood.records import LegRecord
from auvid.hydro.identification.regression.assumed_figures import UNSTEADY
from auvid.hydro.identification.selection.ranking import RankedModel, choose
from auvid.stages.form_evidence import pushing_axes, training_information
from auvid.stages.refine.fitting import CardUnknowns

METHODS = ("least squares", "within limits")
LEANED = 3.0
"""Standard errors that an unsteady force leans a coefficient by, from which on free runs
cannot hold: at most 1.8 where output error holds, 3.9 and more where it does not converge.
"""
MOST_WORK = 3e7
"""Samples times directions of derivatives that one step of some seconds works on."""
DIRECTIONS = 16
"""Of the biases of a leg and the start of a window, beside the unknowns of the model."""


def likely_form(cards: Mapping[str, ModelCard]) -> str | None:
    """Return the simplest model of next to the least BIC of training that loses energy.

    Legs left out cannot tell the truth from a simpler form: both predict as well.
    """
    squares = {
        name: card
        for name, card in cards.items()
        if card.method in METHODS and card.error_function == "squares" and not pushing_axes(card)
    }
    information = training_information(squares)
    choice = choose(
        [
            RankedModel(name, card.rank, np.empty(0), information[name], True)
            for name, card in squares.items()
        ]
    )
    return None if choice is None else choice.name


def pushed(card: ModelCard) -> str:
    """Return what speaks against free runs of a form, empty for nothing."""
    leans = {
        f"{axis}_{item.term}": abs(item.assumed_shifts.get(UNSTEADY, 0.0)) / item.standard_error
        for axis, part in card.axes.items()
        for item in part.terms
        if item.standard_error
    }
    most = max(leans, key=leans.__getitem__, default="")
    if not most or leans[most] <= LEANED:
        return ""
    return (
        f"a force that no term has moves the vehicle (it leans {most} by {leans[most]:.2g} standard"
        " errors), which free runs do not explain"
    )


def too_long(problem: CardUnknowns, legs: Sequence[LegRecord]) -> str:
    """Return that the samples are too many for a fit within a minute, empty for not."""
    samples = sum(
        int(np.isfinite(record.values).sum()) for leg in legs for record in leg.sensors.values()
    )
    unknowns = len(problem.unknowns)
    if samples * (unknowns + DIRECTIONS) <= MOST_WORK:
        return ""
    return f"{samples} samples for {unknowns} unknowns would take more than a minute"


def disagreeing(estimate: LikelihoodEstimate) -> str:
    """Return why a fit is no answer, empty where its windows agree on all unknowns."""
    if estimate.word != "converged":
        return f"the iteration did not converge in {len(estimate.log_likelihood) - 1} steps"
    agreement = estimate.agreement
    if agreement is None or agreement.degrees < len(estimate.theta):
        return "its windows have too little in common to show whether they agree"
    if not agreement.holds:
        return (
            f"its windows differ by {agreement.ratio:.3g} times what noise explains, so that the"
            " form lacks something"
        )
    return ""
