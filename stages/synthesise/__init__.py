"""Fit every viscous model to the training legs (McCarter chapter 4).

Each leg is mapped to a triangular factor of its data, and the factors are merged: every
model is solved from the merged one. A second pass over the legs gives the coloured
standard errors. One leg is in memory at a time. The eight published forms are plain
least squares, as in the thesis; structures that follow from symmetry, and those that a
campaign names, are fitted within physical limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.models import FactorRecord, ModelCard
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.records.priors import PriorSourcesRecord
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.vehicle.strip_theory import strip_theory_of
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.coefficients import viscous_terms
from auvid.hydro.dynamics.viscous.models import MODELS, Coefficients, ViscousModel
from auvid.hydro.dynamics.viscous.symmetry import MIRRORS, PORT_STARBOARD
from auvid.hydro.identification.constrained.equations import viscous_equations
from auvid.hydro.identification.constrained.priors import NormalPrior
from auvid.hydro.identification.regression.assumed_figures import UNSTEADY
from auvid.hydro.identification.regression.error_functions import (
    ERROR_FUNCTIONS,
    MINIMISERS,
    OWN,
    SQUARES,
)
from auvid.hydro.identification.regression.normal_changes import NormalChange
from auvid.hydro.long_series.threads import together
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.presentation import remark
from auvid.stages.synthesise.chosen_terms import ChosenTerms, choose_terms, with_capped_verdicts
from auvid.stages.synthesise.error_choice import (
    EQUAL,
    WEIGHTS,
    ErrorChoice,
    FitSamples,
    by_error_function,
    check_choice,
)
from auvid.stages.synthesise.fits import (
    FormFits,
    InertiaData,
    changes_by_lag,
    fit_forms,
    unsteady_changes,
    with_accelerations,
)
from auvid.stages.synthesise.forms import PUBLISHED, Forms, declared_forms, terms_with_coriolis
from auvid.stages.synthesise.legs import (
    DiveConditions,
    TrainingLegs,
    data_of_parts,
    dive_conditions,
    lag_of,
    low_pass_blocks,
    wiring_of,
)
from auvid.stages.synthesise.model_card import Prior, model_card
from auvid.stages.synthesise.presentation import current_blocks, synthesise_section
from auvid.stages.synthesise.training import EXCITATION, FROM_ERRORS, TrainingData, leaning_terms
from auvid.stages.synthesise.within_limits import (
    DAMPING,
    PhysicalLimits,
    normal_priors,
    prior_conflicts,
    refuse_contradicting_priors,
    refuse_pushing_priors,
    refuse_unknown_inertia,
    refuse_without_structure,
    within_limits,
)

PRIORS = ("none", "vehicle", "strip_theory")
MEASURED = "measured"


@dataclass(frozen=True)
class Inputs:
    residual: Collection[pa.Table] = port("residual", many=True)
    segment: Collection[SegmentRecord] = port("segment", many=True)
    vehicle: Vehicle = port("vehicle")
    fused: Collection[pa.Table] | None = port("fused", many=True, optional=True)
    fusion: Collection[FusionRecord] | None = port("fusion", many=True, optional=True)
    controls: Collection[pa.Table] | None = port("controls", many=True, optional=True)
    priors: PriorSourcesRecord | None = port("prior_sources", optional=True)


@dataclass(frozen=True)
class Params:
    models: tuple[str, ...] = param(
        "1",
        ("diagonal", "symmetric", "symmetric_quadratic", *(model.name for model in MODELS)),
        meaning=(
            "models to fit; lift_and_drag too, for a streamlined vehicle that goes ahead;"
            " NAME_reduced: a structure without couplings that the training legs do not carry;"
            " sparse: terms that they carry, of all that the symmetry allows"
        ),
    )
    symmetry: tuple[str, ...] = param(
        "1",
        (PORT_STARBOARD,),
        meaning="planes that the hull is symmetric to, for symmetric, symmetric_quadratic, sparse",
        names=tuple(MIRRORS),
    )
    structures: Mapping[str, Mapping[str, list[str]]] = param(
        "1",
        {},
        meaning="further models: name -> axis -> terms, as `u` or `u|u|`; fitted within limits",
    )
    damping: str = param(
        "1",
        "dissipative",
        meaning=(
            "limits on the damping of structures: none, none above 0 along an axis, or no motion"
            " of the flown range gains energy"
        ),
        allowed=DAMPING,
    )
    inertia: tuple[str, ...] = param(
        "1", (), meaning="added masses fitted beside the damping of structures, as N_rdot"
    )
    actuator_lag: str = param(
        "1",
        MEASURED,
        meaning=(
            "lag of the actuators: of the vehicle file, else that which the training legs show"
            " clearly; or none"
        ),
        allowed=(MEASURED, "none"),
    )
    current_m_s: float = param(
        "m/s",
        0.15,
        meaning=(
            "standard deviation, north and east, of a steady current under a velocity over ground,"
            " before the training legs show it; 0 for still water, as in a tank"
        ),
        low=0.0,
        high=3.0,
    )
    trim: bool = param(
        "1",
        False,
        meaning="fit a constant force per axis beside each model (net buoyancy, asymmetry)",
    )
    excitation: str = param(
        "1",
        FROM_ERRORS,
        meaning=(
            "from where on a linear term counts as excited: three standard deviations of its"
            " velocity's error where these are known, or the fixed 0.03 m/s or rad/s"
        ),
        allowed=EXCITATION,
    )
    error_function: str = param(
        "1",
        SQUARES,
        meaning=(
            "what of the force error is least: sum of squares, sum of moduli (exact, a linear"
            " programme), median of moduli, Huber's function"
        ),
        allowed=ERROR_FUNCTIONS,
    )
    weights: str = param(
        "1",
        EQUAL,
        meaning="weights of samples: equal, or by what velocity deviations do to the force",
        allowed=WEIGHTS,
    )
    minimiser: str = param(
        "1",
        OWN,
        meaning="how: the error function's own way, or the simplex of Nelder and Mead",
        allowed=MINIMISERS,
    )
    prior: str = param(
        "1",
        "none",
        meaning=(
            "prior on coefficients: those published in the vehicle file (on structures), or of"
            " strip theory from its geometry"
        ),
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


@dataclass(frozen=True)
class Settings:
    """What the parameters ask for.

    declared: models to fit; stated: those whose terms are stated, by name. prior: of the
    vehicle or of strip theory; sources: priors of other measurements.
    """

    declared: list[ViscousModel]
    stated: dict[str, ViscousModel]
    prior: Prior
    choice: ErrorChoice
    sources: tuple[NormalPrior, ...]
    trim: bool

    def prior_of(self, model: ViscousModel) -> Prior:
        """Return the prior on a model before limits.

        Published values are one of structures alone: the forms of the thesis stay.
        """
        if model.name in PUBLISHED and self.prior.source == "strip_theory":
            return self.prior
        return Prior("none", self.prior.relative_sd, {})


def checked_settings(
    params: Params, vehicle: Vehicle, priors: PriorSourcesRecord | None
) -> Settings:
    """Return what the parameters ask for; raise `CampaignError` for what cannot be."""
    declared, stated = declared_forms(params.models, params.structures, params.symmetry)
    prior = Prior(params.prior, params.prior_sd, _prior_means(params.prior, vehicle))
    choice = ErrorChoice(params.error_function, params.weights, params.minimiser)
    bound = params.damping != "free" or bool(params.inertia)
    check_choice(
        choice,
        limited=[m.name for m in declared if bound and m.name not in PUBLISHED],
        prior="of a file" if priors is not None else params.prior,
        largest={
            model.name: max(map(len, model.terms.values())) + params.trim for model in declared
        },
    )
    sources = normal_priors(
        priors,
        {m.name: viscous_equations(m) for m in declared if m.name not in PUBLISHED},
    )
    refuse_pushing_priors(params.damping, prior, sources)
    refuse_contradicting_priors(prior, sources)
    refuse_unknown_inertia(params.inertia)
    if all(model.name in PUBLISHED for model in declared):
        refuse_without_structure([m.name for m in declared], params.inertia, params.prior)
    return Settings(declared, stated, prior, choice, sources, params.trim)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return a card per model, and the triangular factor that all are solved from.

    Raises `CampaignError` for unknown models, `DataError` without a training leg.
    """
    settings = checked_settings(params, inputs.vehicle, inputs.priors)
    legs = _training_legs(inputs)
    (lag, lag_blocks), wiring = together(
        partial(lag_of, legs) if params.actuator_lag == MEASURED else lambda: (None, []),
        partial(wiring_of, legs),
    )
    conditions = dive_conditions(legs, lag, usual_m_s=params.current_m_s)
    forms = Forms.of(settings.declared, settings.stated, with_ratio=legs.with_ratio)
    segments = partial(legs.segments, conditions, with_ratio=forms.with_ratio)
    parts, data = data_of_parts(
        legs, segments(), forms.terms, conditions.vehicle, excitation=params.excitation
    )
    chosen = choose_terms(forms.to_choose, parts, data.motion, segments, trim=params.trim)
    forms = forms.with_chosen(chosen)
    fits = fit_forms(forms, parts, data, chosen, segments, trim=params.trim)
    structures = forms.structures if settings.choice.is_plain else ()
    moving = InertiaData((), (), parts, data.factor)
    if params.inertia and structures:
        moving = with_accelerations(params.inertia, structures, fits, legs, conditions.lag_s)
    unsteady = unsteady_changes(forms, fits, data, moving, conditions, segments, trim=params.trim)
    moved = changes_by_lag(forms, fits, conditions, segments)
    cards = _cards(settings, forms, fits, data, chosen, unsteady, moved, conditions)
    for name in chosen:
        full = forms.full.get(name)
        cards[name] = with_capped_verdicts(cards[name], None if full is None else cards[full.name])
    cards = {model.name: cards[model.name] for model in forms.requested}
    conflicts: list[str] = []
    if not settings.choice.is_plain:
        samples = FitSamples.of(segments(), forms.terms, data.factor.n_samples)
        cards = {
            name: by_error_function(card, fits.of_form(name), data.factor, samples, settings.choice)
            for name, card in cards.items()
        }
    elif structures:
        limits = PhysicalLimits(params.damping, params.inertia, settings.prior, settings.sources)
        figures = (
            legs.motion_figures(terms_with_coriolis(structures), conditions)
            if params.inertia
            else {}
        )
        for model in structures:
            squares, leaned = cards[model.name], unsteady[model.name]
            cards[model.name] = within_limits(
                squares,
                model,
                moving.factor,
                limits,
                conditions.vehicle,
                fits.samples_per_one(model.name),
                moving.parts,
                figures | ({UNSTEADY: leaned} if leaned else {}),
                chosen[model.name].without if model.name in chosen else {},
            )
            conflicts += prior_conflicts(squares, cards[model.name], limits)
    factor = FactorRecord(
        terms=list(data.factor.columns),
        samples=data.factor.n_samples,
        factor=data.factor.R.tolist(),
    )
    leaning = leaning_terms(fits.fits, fits.coloured, data.errors.low_pass)
    warnings = [
        *lag_blocks,
        *current_blocks(conditions.currents, conditions.scatter_m_s),
        *low_pass_blocks(legs, {cards[name].title: terms for name, terms in leaning.items()}),
        *wiring,
        *(remark(words, "warning") for words in conflicts),
    ]
    return Outputs(cards, factor, synthesise_section(cards, data.motion, warnings))


def _training_legs(inputs: Inputs) -> TrainingLegs:
    """Return the training legs; raise `DataError` without one."""
    keys = tuple(key for key, segment in inputs.segment.items() if segment.use == "training")
    if not keys:
        raise DataError(
            "the campaign has no training leg, so there is nothing to fit",
            field="legs",
            remedy="Give a leg `use: training`.",
        )
    return TrainingLegs(
        keys,
        inputs.vehicle,
        inputs.residual,
        inputs.segment,
        inputs.fused,
        inputs.fusion,
        inputs.controls,
    )


def _cards(
    settings: Settings,
    forms: Forms,
    fits: FormFits,
    data: TrainingData,
    chosen: Mapping[str, ChosenTerms],
    unsteady: Mapping[str, tuple[NormalChange, ...]],
    moved: Mapping[str, Mapping[str, Mapping[str, float]]],
    conditions: DiveConditions,
) -> dict[str, ModelCard]:
    """Return the card of each form by least squares."""
    return {
        model.name: model_card(
            model,
            declared=declared,
            data=data,
            fits={
                axis: (fit, fits.coloured[model.name, axis])
                for axis, fit in fits.of_form(model.name).items()
            },
            lacking=fits.lacking[model.name],
            unsteady=unsteady[model.name],
            turns={axis: fits.turns[model.name, axis] for axis in AXES},
            left_out=list(fits.held_out[model.name]),
            vehicle=conditions.vehicle,
            prior=settings.prior_of(model),
            trim=settings.trim,
            held_out=fits.held_out[model.name],
        ).model_copy(
            update={
                "lag": conditions.lag,
                "moved_by_lag": moved[model.name],
                "currents": conditions.current_records,
                "switched_off": chosen[model.name].reasons if model.name in chosen else {},
            }
        )
        for declared, model in zip(forms.declared, forms.fitted, strict=True)
    }


def _prior_means(source: str, vehicle: Vehicle) -> Coefficients:
    if source == "strip_theory":
        return viscous_terms(strip_theory_of(vehicle))
    return viscous_terms(vehicle.published.values()) if source == "vehicle" else {}


STAGE = Stage(
    "synthesise",
    "Fit every viscous model to the training legs, from one pass over the data",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
    check=checked_settings,
    no_views="coefficients are no signals: they stand in its tables",
)
