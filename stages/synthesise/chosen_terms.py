"""Models of which training legs choose the terms: reduced forms, and a sparse one.

A reduced structure loses the couplings that the legs do not carry. `sparse` takes in, one
by one, terms of the whole basis that the symmetry of the hull allows, by the BIC over
independent samples, and loses again what does not hold over the legs. Damping along each
axis stays in both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous.models import ViscousModel
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY, masked
from auvid.hydro.dynamics.viscous.symmetry import allowed_terms
from auvid.hydro.identification.regression.excitation import VelocityExcitation, term_floors
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, WEAK
from auvid.hydro.identification.selection.axis_terms import (
    SPARSE,
    is_own_damping,
    pursue,
    switch_off,
)
from auvid.stages.synthesise.training import TrainingSegment, coloured_errors

REDUCED = "_reduced"
MOST_COUPLINGS = 12
"""Terms of an axis that `sparse` takes in before the BIC judges them."""
NOT_EXCITED = "not excited"
SamplesPerOne = Mapping[str, float]
"""Axis -> how many samples of its residual count as one."""


@dataclass(frozen=True)
class ChosenTerms:
    """A model whose terms the training legs chose.

    without: part of the legs -> the model that the others choose, to be held out. reasons:
    axis and term, as `X u*w` -> why a reduced structure lacks it.
    """

    model: ViscousModel
    without: Mapping[str, ViscousModel]
    reasons: Mapping[str, str]


def base_of(
    name: str, stated: Mapping[str, ViscousModel], mirrors: Sequence[str]
) -> ViscousModel | None:
    """Return all terms that a model may have whose terms the legs choose.

    `stated`: structures by name, of which `NAME_reduced` is one; None for another name.
    """
    if name == SPARSE:
        base = masked(allowed_terms(mirrors, with_propeller=True), name=SPARSE)
        return replace(base, source="terms that the training legs chose of all 132")
    root = name.removesuffix(REDUCED)
    if root == name or root not in stated:
        return None
    base = stated[root]
    source = f"{base.source}, those terms that the training legs carry"
    return replace(base, name=name, title=f"{base.title}, reduced", source=source)


def choose_terms(
    bases: Sequence[ViscousModel],
    parts: Mapping[str, TriangularFactor],
    motion: Mapping[str, VelocityExcitation],
    legs: Callable[[], Iterable[TrainingSegment]],
    *,
    trim: bool,
) -> dict[str, ChosenTerms]:
    """Return name -> the model with the terms that the parts of the legs carry.

    bases: of `base_of`. legs: goes through the samples of all legs, once for all bases.
    """
    if not bases:
        return {}
    total = reduce(TriangularFactor.merge, parts.values())
    first = {base.name: _excited(base, total, motion) for base in bases}
    widest = {
        base.name: _pursued(first[base.name], total, {}, trim) if base.name == SPARSE
        else first[base.name]
        for base in bases
    }  # fmt: skip
    fits = {
        (name, axis): solve_axis(total, axis, model.terms.get(axis, ()), trim=trim)
        for name, model in widest.items()
        for axis in AXES
    }
    coloured = coloured_errors(fits, legs(), total.terms)
    chosen = {}
    for base in bases:
        per_one = {axis: coloured[base.name, axis].samples_per_one for axis in AXES}

        def choice(
            some: Sequence[TriangularFactor],
            model: ViscousModel = first[base.name],
            per_one: SamplesPerOne = per_one,
        ) -> tuple[ViscousModel, dict[str, str]]:
            return _choice(model, some, per_one, trim)

        model, reasons = choice(list(parts.values()))
        if base.name != SPARSE:
            reasons |= {
                f"{axis} {term}": NOT_EXCITED
                for axis, terms in base.terms.items()
                for term in terms
                if term not in first[base.name].terms[axis]
            }
        without = {
            name: choice([part for other, part in parts.items() if other != name])[0]
            for name in (parts if len(parts) > 1 else ())
        }
        chosen[base.name] = ChosenTerms(model, without, reasons)
    return chosen


def with_capped_verdicts(card: ModelCard, full: ModelCard | None) -> ModelCard:
    """Return the card of a model whose terms were chosen on the data that it fits.

    An interval does not know of that choice. So a coefficient is identified only where the
    `full` structure says so as well, and none is without one.
    """
    firm = {
        (axis, item.term)
        for axis, part in ({} if full is None else full.axes).items()
        for item in part.terms
        if item.verdict == IDENTIFIED
    }
    axes = {
        axis: part.model_copy(
            update={
                "terms": [
                    item.model_copy(update={"verdict": WEAK})
                    if item.verdict == IDENTIFIED and (axis, item.term) not in firm
                    else item
                    for item in part.terms
                ]
            }
        )
        for axis, part in card.axes.items()
    }
    return card.model_copy(update={"axes": axes, "coverage_on_twins": {}})


def _choice(
    model: ViscousModel, parts: Sequence[TriangularFactor], per_one: SamplesPerOne, trim: bool
) -> tuple[ViscousModel, dict[str, str]]:
    """Return the model that some parts of the legs choose, and why terms went."""
    if model.name == SPARSE:
        model = _pursued(model, reduce(TriangularFactor.merge, parts), per_one, trim)
    switched = switch_off(parts, model, samples_per_one=per_one, trim=trim)
    reasons = {f"{axis} {term}": words for (axis, term), words in switched.reasons.items()}
    return replace(model, terms=switched.model.terms), {} if model.name == SPARSE else reasons


def _excited(
    base: ViscousModel, factor: TriangularFactor, motion: Mapping[str, VelocityExcitation]
) -> ViscousModel:
    """Return the model without couplings whose motion is not excited."""
    floors = term_floors(base.distinct_terms, motion)
    size = dict(
        zip(
            factor.columns,
            np.linalg.norm(factor.R, axis=0) / np.sqrt(factor.n_samples),
            strict=True,
        )
    )
    terms = {
        axis: tuple(
            term
            for term in row
            if is_own_damping(axis, term) or (size[term] > 0.0 and size[term] >= floors[term])
        )
        for axis, row in base.terms.items()
    }
    return replace(base, terms=terms)


def _pursued(
    model: ViscousModel, factor: TriangularFactor, per_one: SamplesPerOne, trim: bool
) -> ViscousModel:
    """Return the terms that pursuit takes; all of them without samples per one."""
    terms = {}
    for axis, row in model.terms.items():
        always = (OWN_VELOCITY[axis], *((CONSTANT,) if trim else ()))
        pursuit = pursue(
            factor,
            axis,
            row,
            always=always,
            most=MOST_COUPLINGS,
            samples_per_one=per_one.get(axis, 1.0),
        )
        took = pursuit.terms if per_one else pursuit.order
        terms[axis] = tuple(term for term in row if term == OWN_VELOCITY[axis] or term in took)
    return replace(model, terms=terms)
