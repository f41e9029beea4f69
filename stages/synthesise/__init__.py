"""Fit every viscous model to the training legs (McCarter chapter 4).

Each leg is mapped to a triangular factor of its data, and the factors are merged: every
model is solved from the merged one. A second pass over the legs gives the coloured
standard errors. One leg is in memory at a time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial, reduce

import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, DataError, nearest
from auvid.data_schemas.records.models import FactorRecord, ModelCard
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import has_columns
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.vehicle.strip_theory import strip_theory_of
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis_term_names
from auvid.hydro.dynamics.viscous.coefficients import viscous_terms
from auvid.hydro.dynamics.viscous.models import MODELS, ViscousModel, without_propeller_terms
from auvid.hydro.identification.regression.least_squares import solve_axis
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.synthesise.model_card import Prior, model_card
from auvid.stages.synthesise.presentation import synthesise_section
from auvid.stages.synthesise.training import TrainingData, TrainingSegment, coloured_covariances

PRIORS = ("none", "strip_theory")


@dataclass(frozen=True)
class Inputs:
    residual: Collection[pa.Table] = port("residual", many=True)
    segment: Collection[SegmentRecord] = port("segment", many=True)
    vehicle: Vehicle = port("vehicle")


@dataclass(frozen=True)
class Params:
    models: tuple[str, ...] = param(
        "1", tuple(model.name for model in MODELS), meaning="models to fit"
    )
    trim: bool = param(
        "1",
        False,
        meaning="fit a constant force per axis beside each model (net buoyancy, asymmetry)",
    )
    hac_lags: int | None = param(
        "samples",
        None,
        meaning="lags of the coloured standard errors; null chooses by Andrews's rule",
        low=0,
    )
    prior: str = param(
        "1",
        "none",
        meaning="prior on the terms that strip theory has too, from the vehicle's geometry",
        allowed=PRIORS,
    )
    prior_sd: float = param(
        "1",
        0.5,
        meaning="standard deviation of a prior coefficient as a share of its value",
        low=0.01,
        high=10.0,
    )


@dataclass(frozen=True)
class Outputs:
    model_card: Mapping[str, ModelCard] = port("model_card", many=True)
    triangular_factor: FactorRecord = port("triangular_factor")
    section: Document = port("section")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return a card per model, and the triangular factor that all are solved from.

    Raises `CampaignError` for unknown models, `DataError` without a training leg.
    """
    declared = _chosen(params.models)
    means = viscous_terms(strip_theory_of(inputs.vehicle)) if params.prior == "strip_theory" else {}
    training = [key for key, segment in inputs.segment.items() if segment.use == "training"]
    if not training:
        raise DataError(
            "the campaign has no training leg, so there is nothing to fit",
            field="legs",
            remedy="Give a leg `use: training`.",
        )
    with_ratio = all(has_columns(inputs.residual[key], ("eta_ratio",)) for key in training)
    models = declared if with_ratio else [without_propeller_terms(model) for model in declared]
    used = {term for model in models for terms in model.terms.values() for term in terms}
    terms = tuple(term for term in basis_term_names() if term in used)

    def legs() -> Iterator[TrainingSegment]:
        return (TrainingSegment.of(inputs.residual[key], with_ratio=with_ratio) for key in training)

    data = reduce(TrainingData.merge, map(partial(TrainingData.of, terms=terms), legs()))
    fits = {
        (model.name, axis): solve_axis(
            data.factor, axis, model.terms.get(axis, ()), trim=params.trim
        )
        for model in models
        for axis in AXES
    }
    covariances = coloured_covariances(fits, legs(), terms, lags=params.hac_lags)
    prior = Prior(params.prior, params.prior_sd, means)
    cards = {
        model.name: model_card(
            model,
            declared=whole,
            data=data,
            fits={axis: (fits[model.name, axis], covariances[model.name, axis]) for axis in AXES},
            vehicle=inputs.vehicle,
            prior=prior,
            trim=params.trim,
        )
        for whole, model in zip(declared, models, strict=True)
    }
    factor = FactorRecord(
        terms=list(data.factor.columns),
        samples=data.factor.n_samples,
        factor=data.factor.R.tolist(),
    )
    return Outputs(cards, factor, synthesise_section(cards, data.motion))


def _chosen(names: tuple[str, ...]) -> list[ViscousModel]:
    known = {model.name: model for model in MODELS}
    field = "stages.synthesise.models"
    for name in names:
        if name not in known:
            raise CampaignError(
                "unknown model",
                field=field,
                value=name,
                allowed=tuple(known),
                remedy=nearest(name, known),
            )
    if not names or len(set(names)) < len(names):
        raise CampaignError(
            "name at least one model, and each once",
            field=field,
            value=list(names),
            allowed=tuple(known),
        )
    return [known[name] for name in names]


STAGE = Stage(
    "synthesise",
    "Fit every viscous model to the training legs, from one pass over the data",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
    no_views="coefficients are no signals: they stand in its tables",
)
