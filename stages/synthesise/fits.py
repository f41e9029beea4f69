"""Least-squares fits of all forms to the training legs, and what they lack."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce

from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous.models import ViscousModel
from auvid.hydro.identification.regression.lacking_terms import clear_terms, completed_fit
from auvid.hydro.identification.regression.least_squares import (
    AxisFit,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.normal_changes import NormalChange, TrueEquations
from auvid.hydro.identification.regression.prior import coloured_over_white
from auvid.hydro.identification.regression.verdicts import sign_turns
from auvid.hydro.identification.selection.ranking import error_ratios, least_squares_error
from auvid.stages.steps import counted
from auvid.stages.synthesise.chosen_terms import ChosenTerms
from auvid.stages.synthesise.forms import Forms, terms_with_coriolis, with_terms
from auvid.stages.synthesise.legs import DiveConditions, TrainingLegs
from auvid.stages.synthesise.model_card import HeldOut, about_the_truth
from auvid.stages.synthesise.training import (
    Coloured,
    DataErrors,
    Fits,
    ForceSolution,
    TrainingData,
    TrainingSegment,
    coloured_errors,
    leg_factor,
    moved_by_lag,
    moved_by_unsteady_force,
    others_of,
)
from auvid.stages.synthesise.within_limits import with_inertia

COMPLETED = "with more terms: "
"""Before the name of a model whose axes are fitted with what they may lack."""

Segments = Callable[..., Iterator[TrainingSegment]]
"""Yields the samples of all legs: `TrainingLegs.segments` behind the conditions."""


@dataclass(frozen=True)
class FormFits:
    """The fit of each axis of each form, keys (form, axis), and how it may be wrong.

    coloured: errors for residuals that hang together. turns: terms that change their sign
    where a part of the legs is left out, by part. held_out: form -> J/J0 of each axis on
    each part that was left out. lacking: form -> axis -> terms that it clearly lacks.
    """

    fits: Fits
    coloured: Mapping[tuple[str, str], Coloured]
    turns: Mapping[tuple[str, str], Mapping[str, tuple[str, ...]]]
    held_out: Mapping[str, HeldOut]
    lacking: Mapping[str, Mapping[str, tuple[str, ...]]]

    def of_form(self, name: str) -> dict[str, AxisFit]:
        """Return the fits of one form by axis."""
        return {axis: self.fits[name, axis] for axis in AXES}

    def samples_per_one(self, name: str) -> dict[str, float]:
        """Return how many samples of the residual of each axis count as one."""
        return {
            axis: coloured_over_white(fit, self.coloured[name, axis].covariance)
            for axis, fit in self.of_form(name).items()
        }


def fit_forms(
    forms: Forms,
    parts: Mapping[str, TriangularFactor],
    data: TrainingData,
    chosen: Mapping[str, ChosenTerms],
    segments: Segments,
    *,
    trim: bool,
) -> FormFits:
    """Return the fits of all forms to all parts of the legs, and to all but one."""
    others = others_of(parts)
    fits: dict[tuple[str, str], AxisFit] = {}
    turns, held_out = {}, {}
    for model in counted("model", forms.fitted):
        without: dict[str, list[AxisFit]] = {name: [] for name in others}
        for axis in AXES:
            fit = partial(solve_axis, axis=axis, terms=model.terms.get(axis, ()), trim=trim)
            fits[model.name, axis] = fit(data.factor)
            by_part = {name: fit(factor) for name, factor in others.items()}
            turns[model.name, axis] = sign_turns(fits[model.name, axis], by_part)
            for name, other in by_part.items():
                without[name].append(other)
        if model.name in chosen:  # without a part, legs may choose other terms
            for name, own in chosen[model.name].without.items():
                without[name] = fits_of_axes(others[name], own, trim=trim)
        held_out[model.name] = {
            name: error_ratios(parts[name], least_squares_error(without[name], parts[name]))
            for name in others
        }
    completed = {
        (COMPLETED + name, axis): fuller
        for (name, axis), own_fit in fits.items()
        if (fuller := completed_fit(data.factor, own_fit)) is not None
    }
    coloured = coloured_errors({**fits, **completed}, segments(with_state=False), forms.terms)
    lacking = _lacking(fits, completed, coloured, data.errors)
    return FormFits(fits, coloured, turns, held_out, lacking)


def fits_of_axes(factor: TriangularFactor, model: ViscousModel, *, trim: bool) -> list[AxisFit]:
    """Return the fit of each axis of a model to the data of a factor."""
    return [solve_axis(factor, axis, model.terms.get(axis, ()), trim=trim) for axis in AXES]


def _lacking(
    fits: Fits,
    completed: Fits,
    coloured: Mapping[tuple[str, str], Coloured],
    errors: DataErrors,
) -> dict[str, dict[str, tuple[str, ...]]]:
    """Return the terms that each form clearly lacks, by axis."""
    lacking: dict[str, dict[str, tuple[str, ...]]] = {name: {} for name, _ in fits}
    for (name, axis), own_fit in fits.items():
        key = (COMPLETED + name, axis)
        if key in completed:
            first_order = TrueEquations.of(completed[key], ())
            covariance = about_the_truth(first_order, coloured[key], errors)
            if clear := clear_terms(completed[key], own_fit, covariance):
                lacking[name][axis] = clear
    return lacking


@dataclass(frozen=True)
class InertiaData:
    """What fits of added mass beside damping go by.

    names: of the added masses, as `N_rdot`; none where none is asked for. structures: to
    which they belong. parts: the factor of each part of the legs,
    with accelerations; factor: of all of them.
    """

    names: tuple[str, ...]
    structures: tuple[ViscousModel, ...]
    parts: Mapping[str, TriangularFactor]
    factor: TriangularFactor


def with_accelerations(
    names: tuple[str, ...],
    structures: Sequence[ViscousModel],
    fits: FormFits,
    legs: TrainingLegs,
    lag_s: float,
) -> InertiaData:
    """Return the data of the legs for added masses beside the terms of structures."""
    fuller = [with_terms(model, fits.lacking[model.name]) for model in structures]
    parts = legs.motion_factors(terms_with_coriolis(fuller), lag_s)
    factor = reduce(TriangularFactor.merge, parts.values())
    return InertiaData(names, tuple(structures), parts, factor)


def unsteady_changes(
    forms: Forms,
    fits: FormFits,
    data: TrainingData,
    moving: InertiaData,
    conditions: DiveConditions,
    segments: Segments,
    *,
    trim: bool,
) -> dict[str, tuple[NormalChange, ...]]:
    """Return what the force errors of each form do by the motion that they cause.

    What a form lacks counts by itself, so it has no part in the unsteady force.
    """
    fuller = {model.name: with_terms(model, fits.lacking[model.name]) for model in forms.fitted}
    with_added = {model.name for model in moving.structures}
    solutions = {
        name: (
            with_inertia(model, moving.factor, moving.names, trim=trim)
            if name in with_added
            else ForceSolution.of(fits_of_axes(data.factor, model, trim=trim))
        )
        for name, model in fuller.items()
    }
    terms = terms_with_coriolis(fuller.values()) if with_added else forms.terms
    return moved_by_unsteady_force(solutions, segments(), terms, conditions.vehicle)


def changes_by_lag(
    forms: Forms, fits: FormFits, conditions: DiveConditions, segments: Segments
) -> dict[str, dict[str, dict[str, float]]]:
    """Return how far the actuator lag moved the damping of each form, by axis."""
    if conditions.lag_s <= 0.0:
        return {model.name: {} for model in forms.fitted}
    legs = segments(0.0, with_state=False)
    prompt = reduce(TriangularFactor.merge, (leg_factor(leg, forms.terms) for leg in legs))
    return {model.name: moved_by_lag(fits.of_form(model.name), prompt) for model in forms.fitted}
