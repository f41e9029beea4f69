"""Fit every viscous model to the training legs (McCarter chapter 4).

Each leg is mapped to a triangular factor of its data, and the factors are merged: every
model is solved from the merged one. A second pass over the legs gives the coloured
standard errors. One leg is in memory at a time. The eight published forms are plain
least squares, as in the thesis; structures that follow from symmetry, and those that a
campaign names, are fitted within physical limits.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, DataError, PipelineError, nearest
from auvid.data_schemas.records.likelihood import LagFit
from auvid.data_schemas.records.models import DiveCurrent, FactorRecord, ModelCard
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.records.priors import PriorSourcesRecord
from auvid.data_schemas.tables import has_columns
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.vehicle.strip_theory import strip_theory_of
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis_term_names
from auvid.hydro.dynamics.viscous.coefficients import viscous_terms
from auvid.hydro.dynamics.viscous.models import (
    MODELS,
    Coefficients,
    ViscousModel,
    without_propeller_terms,
)
from auvid.hydro.dynamics.viscous.structures import (
    diagonal,
    lift_and_drag,
    masked,
    symmetric,
)
from auvid.hydro.dynamics.viscous.symmetry import MIRRORS, PORT_STARBOARD
from auvid.hydro.identification.constrained.actuator_lag import measured_lag
from auvid.hydro.identification.constrained.equations import viscous_equations
from auvid.hydro.identification.constrained.priors import NormalPrior
from auvid.hydro.identification.constrained.steady_current import (
    SteadyCurrent,
    current_scatter,
    measured_currents,
)
from auvid.hydro.identification.regression.assumed_figures import CURRENT, UNSTEADY
from auvid.hydro.identification.regression.error_functions import (
    ERROR_FUNCTIONS,
    MINIMISERS,
    OWN,
    SQUARES,
)
from auvid.hydro.identification.regression.lacking_terms import clear_terms, completed_fit
from auvid.hydro.identification.regression.least_squares import (
    AxisFit,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.normal_changes import NormalChange, TrueEquations
from auvid.hydro.identification.regression.prior import coloured_over_white
from auvid.hydro.identification.regression.verdicts import sign_turns
from auvid.hydro.identification.selection.axis_terms import SPARSE
from auvid.hydro.identification.selection.folds import parts_of
from auvid.hydro.identification.selection.ranking import error_ratios, least_squares_error
from auvid.hydro.long_series.threads import together
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.presentation import Block, remark
from auvid.stages.steps import counted
from auvid.stages.synthesise.chosen_terms import (
    REDUCED,
    base_of,
    choose_terms,
    with_capped_verdicts,
)
from auvid.stages.synthesise.error_choice import (
    EQUAL,
    WEIGHTS,
    ErrorChoice,
    FitSamples,
    by_error_function,
    check_choice,
)
from auvid.stages.synthesise.model_card import HeldOut, Prior, about_the_truth, model_card
from auvid.stages.synthesise.presentation import (
    current_blocks,
    lag_words,
    low_pass_words,
    stated_lag_words,
    synthesise_section,
)
from auvid.stages.synthesise.training import (
    EXCITATION,
    FROM_ERRORS,
    RESIDUAL_COLUMNS,
    STATE_COLUMNS,
    STILL_WATER,
    DataErrors,
    ForceSolution,
    LegTables,
    MovingWater,
    TrainingData,
    TrainingSegment,
    coloured_errors,
    driven_leg,
    leaning_terms,
    leg_factor,
    leg_over_ground,
    merged_figures,
    motion_factor,
    moved_by_lag,
    moved_by_unsteady_force,
    others_of,
)
from auvid.stages.synthesise.wiring import torque_blocks, wiring_blocks
from auvid.stages.synthesise.within_limits import (
    DAMPING,
    PhysicalLimits,
    normal_priors,
    prior_conflicts,
    refuse_contradicting_priors,
    refuse_pushing_priors,
    refuse_unknown_inertia,
    refuse_without_structure,
    with_inertia,
    within_limits,
)

PRIORS = ("none", "vehicle", "strip_theory")
MEASURED = "measured"
COMPLETED = "with more terms: "
"""Before the name of a model whose axes are fitted with what they may lack."""


def structures(mirrors: Sequence[str]) -> list[ViscousModel]:
    """Return the forms that follow from the symmetry of the hull.

    They stand beside the eight published ones; the last one is fitted where a campaign
    names it.
    """
    return [
        diagonal(),
        symmetric(mirrors=mirrors),
        symmetric(quadratic=True, mirrors=mirrors),
        lift_and_drag(),
    ]


VERTICAL_SHARE = 1.0 / 3.0
"""Of the scatter of a current within a dive: a steady vertical one, which no sensor over ground
shows (decision 0107).
"""


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


def checked_settings(
    params: Params, vehicle: Vehicle, priors: PriorSourcesRecord | None
) -> Settings:
    """Return what the parameters ask for; raise `CampaignError` for what cannot be."""
    declared, stated = _declared(params)
    prior = Prior(params.prior, params.prior_sd, _prior_means(params.prior, vehicle))
    choice = ErrorChoice(params.error_function, params.weights, params.minimiser)
    published = {model.name for model in MODELS}
    bound = params.damping != "free" or bool(params.inertia)
    check_choice(
        choice,
        limited=[m.name for m in declared if bound and m.name not in published],
        prior="of a file" if priors is not None else params.prior,
        largest={
            model.name: max(map(len, model.terms.values())) + params.trim for model in declared
        },
    )
    sources = normal_priors(
        priors,
        {m.name: viscous_equations(m) for m in declared if m.name not in published},
    )
    refuse_pushing_priors(params.damping, prior, sources)
    refuse_contradicting_priors(prior, sources)
    refuse_unknown_inertia(params.inertia)
    if all(model.name in published for model in declared):
        refuse_without_structure([m.name for m in declared], params.inertia, params.prior)
    return Settings(declared, stated, prior, choice, sources)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return a card per model, and the triangular factor that all are solved from.

    Raises `CampaignError` for unknown models, `DataError` without a training leg.
    """
    settings = checked_settings(params, inputs.vehicle, inputs.priors)
    declared, stated = settings.declared, settings.stated
    prior, choice, sources = settings.prior, settings.choice, settings.sources
    published = {model.name for model in MODELS}
    training = [key for key, segment in inputs.segment.items() if segment.use == "training"]
    if not training:
        raise DataError(
            "the campaign has no training leg, so there is nothing to fit",
            field="legs",
            remedy="Give a leg `use: training`.",
        )
    (lag, lag_blocks), wiring = together(
        partial(_lag, inputs, training, params), partial(_wiring, inputs, training)
    )
    lag_s, vehicle = 0.0, inputs.vehicle
    if lag is not None:
        lag_s = lag.value_s
        if lag.standard_error_s is not None:
            spreads = {**vehicle.spreads, "thrust_lag": lag.standard_error_s}
            vehicle = replace(vehicle, spreads=spreads)
    currents, scatter_m_s = _currents(inputs, training, lag_s, params.current_m_s)
    in_water = {
        log: DiveCurrent(value_m_s=own.value.tolist(), sd_m_s=own.sd.tolist(), clear=own.clear)
        for log, own in currents.items()
    }
    if currents:
        rms = [own.rms for own in currents.values()]
        spreads = {
            **vehicle.spreads,
            CURRENT: float(np.sqrt(scatter_m_s**2 + np.mean(np.square(rms)))),
        }
        vehicle = replace(vehicle, spreads=spreads)
    with_ratio = all(
        has_columns(inputs.residual.part(key, ("eta_ratio",)), ("eta_ratio",)) for key in training
    )
    models = declared if with_ratio else [without_propeller_terms(model) for model in declared]
    to_choose = [model for model in models if model.name not in stated]
    # A reduced structure is judged beside the whole one, which nobody may have asked for.
    full_forms = {
        model.name: stated[root]
        for model in to_choose
        if (root := model.name.removesuffix(REDUCED)) in stated
    }
    unasked = {model.name: model for model in full_forms.values() if model not in declared}
    used = {term for model in models for terms in model.terms.values() for term in terms}
    terms = tuple(term for term in basis_term_names() if term in used)

    def legs(lag_s: float = lag_s, *, with_state: bool = True) -> Iterator[TrainingSegment]:
        return (
            TrainingSegment.of(
                _tables(inputs, key, with_state=with_state),
                with_ratio=with_ratio,
                lag_s=lag_s,
                water=_water(currents, scatter_m_s, inputs.segment[key].log),
            )
            for key in training
        )

    factors: dict[str, TriangularFactor] = {}
    of_legs: TrainingData | None = None
    names = parts_of([inputs.segment[key].leg for key in training])
    for name, leg in zip(names, legs(), strict=True):
        own = TrainingData.of(leg, terms, vehicle, excitation=params.excitation)
        factors[name] = factors[name].merge(own.factor) if name in factors else own.factor
        of_legs = own if of_legs is None else of_legs.merge(own)
        del leg  # the next pass starts without the samples of the last leg
    assert of_legs is not None
    data = replace(of_legs, factor=reduce(TriangularFactor.merge, factors.values()))
    others = others_of(factors)
    chosen = choose_terms(to_choose, factors, data.motion, legs, trim=params.trim)
    models = [chosen[m.name].model if m.name in chosen else m for m in models]
    declared = [chosen[m.name].model if m.name in chosen else m for m in declared]
    declared = [*declared, *unasked.values()]
    models += unasked.values() if with_ratio else map(without_propeller_terms, unasked.values())
    held_out_terms = {name: item.without for name, item in chosen.items()}
    fits, turns = {}, {}
    held_out: dict[str, HeldOut] = {}
    for model in counted("model", models):
        without = {}
        for axis in AXES:
            fit = partial(solve_axis, axis=axis, terms=model.terms.get(axis, ()), trim=params.trim)
            fits[model.name, axis] = fit(data.factor)
            without[axis] = {name: fit(factor) for name, factor in others.items()}
            turns[model.name, axis] = sign_turns(fits[model.name, axis], without[axis])
        own_terms = held_out_terms.get(model.name, {})
        held_out[model.name] = {
            name: error_ratios(
                factors[name],
                least_squares_error(
                    [without[axis][name] for axis in AXES]
                    if name not in own_terms
                    else fits_of_axes(factor, own_terms[name], trim=params.trim),
                    factors[name],
                ),
            )
            for name, factor in others.items()
        }
    completed = {
        (COMPLETED + name, axis): fuller
        for (name, axis), fit in fits.items()
        if (fuller := completed_fit(data.factor, fit)) is not None
    }
    coloured = coloured_errors({**fits, **completed}, legs(with_state=False), terms)
    lacking: dict[str, dict[str, tuple[str, ...]]] = {model.name: {} for model in models}
    for (name, axis), own_fit in fits.items():
        key = (COMPLETED + name, axis)
        if key in completed:
            first_order = TrueEquations.of(completed[key], ())
            errors = about_the_truth(first_order, coloured[key], data.errors)
            if clear := clear_terms(completed[key], own_fit, errors):
                lacking[name][axis] = clear
    structures = [
        model
        for model in models
        if choice.is_plain and model.name not in published and model.name not in unasked
    ]
    # What a form lacks counts by itself, so it has no part in the unsteady force.
    with_lacking = {model.name: _with_terms(model, lacking[model.name]) for model in models}
    moving = data.factor
    if params.inertia and structures:
        factors = {}
        for name, own_factor in zip(
            names,
            _with_motion(inputs, training, [with_lacking[m.name] for m in structures], lag_s),
            strict=True,
        ):
            factor_kept = factors.get(name)
            factors[name] = own_factor if factor_kept is None else factor_kept.merge(own_factor)
        moving = reduce(TriangularFactor.merge, factors.values())
    solutions = {
        model.name: (
            with_inertia(with_lacking[model.name], moving, params.inertia, trim=params.trim)
            if params.inertia and model in structures
            else ForceSolution.of(
                fits_of_axes(data.factor, with_lacking[model.name], trim=params.trim)
            )
        )
        for model in models
    }
    moving_terms = terms
    if params.inertia and structures:
        moving_terms = _motion_terms(with_lacking.values())
    unsteady = moved_by_unsteady_force(solutions, legs(), moving_terms, vehicle)
    moved: dict[str, dict[str, dict[str, float]]] = {model.name: {} for model in models}
    if lag_s > 0.0:
        without_lag = legs(0.0, with_state=False)
        prompt = reduce(TriangularFactor.merge, (leg_factor(leg, terms) for leg in without_lag))
        for name in moved:
            moved[name] = moved_by_lag({axis: fits[name, axis] for axis in AXES}, prompt)
    # What the vehicle file publishes is a prior of structures: the forms of the thesis stay.
    none = Prior("none", params.prior_sd, {})
    on_published = prior if prior.source == "strip_theory" else none
    cards = {
        model.name: model_card(
            model,
            declared=declared_model,
            data=data,
            fits={axis: (fits[model.name, axis], coloured[model.name, axis]) for axis in AXES},
            lacking=lacking[model.name],
            unsteady=unsteady[model.name],
            turns={axis: turns[model.name, axis] for axis in AXES},
            left_out=list(others),
            vehicle=vehicle,
            prior=on_published if model.name in published else none,
            trim=params.trim,
            held_out=held_out[model.name],
        ).model_copy(
            update={
                "lag": lag,
                "moved_by_lag": moved[model.name],
                "currents": in_water,
                "switched_off": chosen[model.name].reasons if model.name in chosen else {},
            }
        )
        for declared_model, model in zip(declared, models, strict=True)
    }
    for name in chosen:
        full_card = cards[full_forms[name].name] if name in full_forms else None
        cards[name] = with_capped_verdicts(cards[name], full_card)
    models = [model for model in models if model.name not in unasked]
    cards = {model.name: cards[model.name] for model in models}
    conflicts: list[str] = []
    if not choice.is_plain:
        samples = FitSamples.of(legs(), terms, data.factor.n_samples)
        cards = {
            name: by_error_function(
                card, {axis: fits[name, axis] for axis in AXES}, data.factor, samples, choice
            )
            for name, card in cards.items()
        }
    elif structures:
        limits = PhysicalLimits(params.damping, params.inertia, prior, sources)
        figures = (
            _motion_figures(inputs, training, structures, vehicle, lag_s, currents)
            if params.inertia
            else {}
        )
        for model in structures:
            squares = cards[model.name]
            per_one = {
                axis: coloured_over_white(
                    fits[model.name, axis], coloured[model.name, axis].covariance
                )
                for axis in AXES
            }
            cards[model.name] = within_limits(
                squares,
                model,
                moving,
                limits,
                vehicle,
                per_one,
                factors,
                figures | ({UNSTEADY: leaned} if (leaned := unsteady[model.name]) else {}),
                held_out_terms.get(model.name, {}),
            )
            conflicts += prior_conflicts(squares, cards[model.name], limits)
    factor = FactorRecord(
        terms=list(data.factor.columns),
        samples=data.factor.n_samples,
        factor=data.factor.R.tolist(),
    )
    low_pass = _low_pass_blocks(
        inputs,
        training,
        {
            cards[name].title: terms
            for name, terms in leaning_terms(fits, coloured, data.errors.low_pass).items()
        },
    )
    warnings = [
        *lag_blocks,
        *current_blocks(currents, scatter_m_s),
        *low_pass,
        *wiring,
        *(remark(words, "warning") for words in conflicts),
    ]
    return Outputs(cards, factor, synthesise_section(cards, data.motion, warnings))


def model_names() -> list[str]:
    """Return the names that `models` may have, but for structures of the campaign."""
    stated = [model.name for model in (*structures((PORT_STARBOARD,)), *MODELS)]
    return [*stated, SPARSE, *(f"{name}{REDUCED}" for name in stated)]


def fits_of_axes(factor: TriangularFactor, model: ViscousModel, *, trim: bool) -> list[AxisFit]:
    """Return the fit of each axis of a model to the data of a factor."""
    return [solve_axis(factor, axis, model.terms.get(axis, ()), trim=trim) for axis in AXES]


def _with_terms(model: ViscousModel, more: Mapping[str, Sequence[str]]) -> ViscousModel:
    """Return a model with further terms, by axis."""
    terms = {axis: (*own, *more.get(axis, ())) for axis, own in model.terms.items()}
    return replace(model, terms=terms)


def _tables(inputs: Inputs, key: str, *, with_state: bool = True) -> LegTables:
    """Return the tables of a leg; its state and commands are for some passes only."""
    if not with_state:
        residual = inputs.residual.part(key, RESIDUAL_COLUMNS)
        return LegTables(residual, inputs.segment[key], None, None, None)
    of_fuse = inputs.fused
    residual, fused = together(
        partial(inputs.residual.part, key, RESIDUAL_COLUMNS),
        lambda: None if of_fuse is None else of_fuse.part(key, STATE_COLUMNS),
    )
    return LegTables(
        residual,
        inputs.segment[key],
        fused,
        None if inputs.fusion is None else inputs.fusion[key],
        None if inputs.controls is None else inputs.controls[key],
    )


def _wiring(inputs: Inputs, training: Sequence[str]) -> list[Block]:
    """Return warnings on thrusters and propellers that the vehicle file has wrong."""
    return [
        *wiring_blocks((_tables(inputs, key) for key in training), inputs.vehicle),
        *torque_blocks((inputs.residual[key] for key in training), inputs.vehicle),
    ]


def _lag(
    inputs: Inputs, training: Sequence[str], params: Params
) -> tuple[LagFit | None, list[Block]]:
    """Return the lag of the actuators that all models go with, and words on it.

    One that the vehicle file states counts; where the legs show another, words warn.
    """
    if params.actuator_lag != MEASURED:
        return None, []
    legs = (driven_leg(_tables(inputs, key)) for key in training)
    lag = measured_lag([leg for leg in legs if leg is not None])
    stated, spread = inputs.vehicle.actuator_lag_s, inputs.vehicle.spreads.get("thrust_lag")
    if stated is not None:
        departs = lag is not None and lag.of_thrusters and lag.departs_from(stated, spread or 0.0)
        words = stated_lag_words(stated, spread, lag)
        return (
            LagFit(value_s=stated, standard_error_s=spread, verdict="stated"),
            [remark(words, "warning" if departs else "note")],
        )
    if lag is None or not (lag.clear and lag.of_thrusters):
        return None, []
    fit = LagFit(
        value_s=lag.value_s,
        standard_error_s=lag.sd_s,
        verdict="identified" if lag.by_gyro else "inseparable",
    )
    return fit, [remark(lag_words(lag, spread), "note" if lag.by_gyro else "warning")]


def _currents(
    inputs: Inputs, training: Sequence[str], lag_s: float, usual_m_s: float
) -> tuple[dict[str, SteadyCurrent], float]:
    """Return log -> its current, where velocity is over ground, and its scatter."""
    if not usual_m_s:
        return {}, 0.0
    legs = (leg_over_ground(_tables(inputs, key), lag_s) for key in training)
    over_ground = [leg for leg in legs if leg is not None]
    if not over_ground:
        return {}, 0.0
    currents = measured_currents(over_ground, inputs.vehicle, usual_m_s=usual_m_s)
    scatter_m_s = current_scatter(over_ground, inputs.vehicle, currents, usual_m_s=usual_m_s)
    return currents, scatter_m_s


def _water(currents: Mapping[str, SteadyCurrent], scatter_m_s: float, log: str) -> MovingWater:
    """Return what moves the water under a leg of a log."""
    if not currents:
        return STILL_WATER
    own = {name: float(name == log) for name in currents}
    vertical = np.array([0.0, 0.0, VERTICAL_SHARE * scatter_m_s])
    errors = {name: np.vstack([item.errors, vertical]) for name, item in currents.items()}
    return MovingWater(
        np.array([own[name] * current.established for name, current in currents.items()]),
        np.vstack([own[name] * row for name, row in errors.items()]),
        scatter_m_s,
    )


def _low_pass_blocks(
    inputs: Inputs, training: Sequence[str], leaning: Mapping[str, Sequence[str]]
) -> list[Block]:
    """Return a warning on a low-pass that leans coefficients, by title of the model."""
    if not leaning or inputs.fusion is None:
        return []
    used = [inputs.fusion[key].cutoff_hz for key in training if key in inputs.fusion]
    cutoffs = [cutoff for cutoff in used if cutoff is not None]
    return [remark(low_pass_words(min(cutoffs), leaning), "warning")]


def _declared(params: Params) -> tuple[list[ViscousModel], dict[str, ViscousModel]]:
    """Return the models to fit: the campaign's own, structures, published forms.

    And all whose terms are stated, by name; a model that is none of them has all terms
    that the training legs may choose.
    """
    field = "stages.synthesise.models"
    own = {name: _own_structure(name, terms) for name, terms in params.structures.items()}
    stated = {model.name: model for model in (*structures(params.symmetry), *MODELS)}
    for name in own:
        if name in stated or name == SPARSE:
            raise CampaignError(
                "a structure has the name of a known model",
                field="stages.synthesise.structures",
                value=name,
                remedy="Give it another name.",
            )
    stated |= own
    by_name = dict(stated)
    for name in params.models:
        base = None if name in by_name else base_of(name, stated, params.symmetry)
        if base is not None:
            by_name[name] = base
        if name not in by_name or name in own:
            allowed = (*(form for form in stated if form not in own), SPARSE)
            raise CampaignError(
                "unknown model",
                field=field,
                value=name,
                allowed=(*allowed, f"one of them with {REDUCED} behind its name"),
                remedy=nearest(name, [*model_names(), *(f"{form}{REDUCED}" for form in own)]),
            )
    if not (params.models or own) or len(set(params.models)) < len(params.models):
        raise CampaignError(
            "name at least one model, and each once",
            field=field,
            value=list(params.models),
            allowed=(*stated, SPARSE),
        )
    return [*own.values(), *(by_name[name] for name in params.models)], stated


def _own_structure(name: str, terms: Mapping[str, list[str]]) -> ViscousModel:
    field = f"stages.synthesise.structures.{name}"
    if not isinstance(terms, Mapping) or not all(isinstance(row, list) for row in terms.values()):
        raise CampaignError(
            "a structure maps axes to lists of terms",
            field=field,
            value=terms,
            remedy='Write {X: [u, "u|u|"], N: [r]}.',
        )
    try:
        model = masked(terms, name=name)
    except PipelineError as wrong:
        raise CampaignError(
            wrong.message, field=f"{field}.{wrong.field}", value=wrong.value, remedy=wrong.remedy
        ) from wrong
    if not model.n_bar:
        raise CampaignError("a structure without a term", field=field)
    return model


def _prior_means(source: str, vehicle: Vehicle) -> Coefficients:
    if source == "strip_theory":
        return viscous_terms(strip_theory_of(vehicle))
    return viscous_terms(vehicle.published.values()) if source == "vehicle" else {}


def _with_motion(
    inputs: Inputs, training: Sequence[str], structures: Sequence[ViscousModel], lag_s: float
) -> list[TriangularFactor]:
    """Return each segment's factor with accelerations and rates of the actuator force.

    Raises `DataError` without the fused state.
    """
    if inputs.fused is None:
        raise DataError(
            "fitting inertia needs the acceleration, and there is no fused state",
            field="stages.synthesise.inertia",
        )
    terms, fused = _motion_terms(structures), inputs.fused
    return [
        motion_factor(
            inputs.residual.part(key, RESIDUAL_COLUMNS),
            fused.part(key, STATE_COLUMNS),
            terms,
            lag_s,
        )
        for key in training
    ]


def _motion_terms(structures: Iterable[ViscousModel]) -> tuple[str, ...]:
    """Return the terms of structures, and the products of the Coriolis force."""
    used = {term for model in structures for row in model.terms.values() for term in row}
    used |= {f"{a}*{b}" for a in VELOCITIES for b in VELOCITIES}
    return tuple(term for term in basis_term_names() if term in used)


def _motion_figures(
    inputs: Inputs,
    training: Sequence[str],
    structures: Sequence[ViscousModel],
    vehicle: Vehicle,
    lag_s: float,
    currents: Mapping[str, SteadyCurrent],
) -> dict[str, tuple[NormalChange, ...]]:
    """Return what assumed figures do to the normal equations with accelerations."""
    terms = _motion_terms(structures)
    legs = (
        TrainingSegment.of(
            _tables(inputs, key),
            with_ratio=False,
            lag_s=lag_s,
            water=_water(currents, 0.0, inputs.segment[key].log),
        )
        for key in training
    )
    return reduce(merged_figures, (DataErrors.of_motion(leg, terms, vehicle) for leg in legs))


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
