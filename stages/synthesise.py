"""Fit every viscous model to the training segments, from one triangular factor of the
data (McCarter chapter 4).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, DataError, nearest
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.vehicle.strip_theory import strip_theory_of
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle, vehicle_from_document
from auvid.hydro.dynamics.viscous.basis import basis_rows, basis_term_names, coefficient_unit
from auvid.hydro.dynamics.viscous.coefficients import viscous_terms
from auvid.hydro.dynamics.viscous.models import (
    MODELS,
    Coefficients,
    ViscousModel,
    without_propeller_terms,
)
from auvid.hydro.identification.regression.attenuation import RegressorErrors, attenuation, widened
from auvid.hydro.identification.regression.excitation import VelocityExcitation, axis_excitation
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    AxisFit,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.prior import posterior
from auvid.hydro.identification.regression.separability import breaks_symmetry, judge_with_motion
from auvid.hydro.identification.regression.standard_errors import hac_fit_covariance
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, INSEPARABLE, NOT_EXCITED
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.columns import AXIS_UNITS, VELOCITY, VELOCITY_SD, forces
from auvid.stages.presentation import equation, remark, section, table

VELOCITY_OF_AXIS = dict(zip(AXES, "uvwpqr", strict=True))
PRIORS = ("none", "strip_theory")
UNBROKEN = 32_768
"""The coloured standard errors take correlation within so many samples into account (11
minutes at 50 Hz): it bounds their memory.
"""
ROWS_AT_ONCE = 8192  # the basis rows of a larger chunk leave the processor's cache


@dataclass(frozen=True)
class Inputs:
    residual: Collection[pa.Table] = port("residual", many=True)
    segment: Collection[Document] = port("segment", many=True)
    vehicle: Document = port("vehicle")


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
    model_card: Mapping[str, Document] = port("model_card", many=True)
    triangular_factor: Document = port("triangular_factor")
    section: Document = port("section")


@dataclass(frozen=True)
class Samples:
    """What synthesis needs of one training segment: nu and its deviations (n, 6),
    eta_ratio (n,), tau_bar (n, 6); None: unknown.
    """

    nu: Array
    sd: Array | None
    ratio: Array | None
    force: Array


def run(inputs: Inputs, params: Params) -> Outputs:
    vehicle = vehicle_from_document(inputs.vehicle)
    models = _chosen(params.models)
    prior = viscous_terms(strip_theory_of(inputs.vehicle)) if params.prior == "strip_theory" else {}
    training = [
        _samples(inputs.residual[key])
        for key, segment in inputs.segment.items()
        if segment["use"] == "training"
    ]
    if not training:
        raise DataError(
            "the campaign has no training leg, so there is nothing to fit",
            field="legs",
            remedy="Give a leg `use: training`.",
        )
    with_ratio = all(part.ratio is not None for part in training)
    fitted = models if with_ratio else [without_propeller_terms(model) for model in models]
    factor = _factor(fitted, training)
    errors = _errors(factor, training)
    ratios = [part.ratio for part in training if part.ratio is not None] if with_ratio else None
    motion = axis_excitation([part.nu for part in training], eta_ratio=ratios)
    cards = {
        model.name: _card(declared, model, factor, training, motion, vehicle, prior, params, errors)
        for declared, model in zip(models, fitted, strict=True)
    }
    document = {
        "terms": list(factor.columns),
        "samples": factor.n_samples,
        "factor": [[float(x) for x in row] for row in factor.R],
    }
    return Outputs(model_card=cards, triangular_factor=document, section=_section(cards, motion))


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


def _samples(residual: pa.Table) -> Samples:
    ratio = column(residual, "eta_ratio") if has_columns(residual, ("eta_ratio",)) else None
    sd = matrix(residual, VELOCITY_SD) if has_columns(residual, VELOCITY_SD) else None
    return Samples(matrix(residual, VELOCITY), sd, ratio, forces(residual, "tau_bar"))


def _factor(models: list[ViscousModel], training: list[Samples]) -> TriangularFactor:
    """One pass over the data: every distinct column of every model, and the six forces."""
    wanted = {term for model in models for terms in model.terms.values() for term in terms}
    terms = tuple(term for term in basis_term_names() if term in wanted)
    factor = TriangularFactor.empty(terms)
    for part in training:
        for start in range(0, len(part.force), ROWS_AT_ONCE):
            chosen = slice(start, start + ROWS_AT_ONCE)
            ratio = None if part.ratio is None else part.ratio[chosen]
            factor = factor.update(basis_rows(part.nu[chosen].T, ratio, terms), part.force[chosen])
    return factor


def _errors(factor: TriangularFactor, training: list[Samples]) -> RegressorErrors | None:
    """What errors of the velocities give the basis terms, None where fuse does not know
    them for every segment.
    """
    found = RegressorErrors.empty(factor.terms)
    for part in training:
        if part.sd is None:
            return None
        found = found.update(part.nu, part.sd, ratio=part.ratio)
    return found


def _card(
    declared: ViscousModel,
    model: ViscousModel,
    factor: TriangularFactor,
    training: list[Samples],
    motion: Mapping[str, VelocityExcitation],
    vehicle: Vehicle,
    prior: Coefficients,
    params: Params,
    errors: RegressorErrors | None,
) -> dict[str, Any]:
    axes, solution, used, rank = {}, {}, {}, 0
    for index, axis in enumerate(AXES):
        fit = solve_axis(factor, axis, model.terms.get(axis, ()), trim=params.trim)
        covariance = _covariance(fit, training, index, params)
        if errors is not None:
            covariance = widened(covariance, attenuation(fit, errors))
        means = {term: value for term, value in prior.get(axis, {}).items() if term in fit.terms}
        after, wide = posterior(
            factor, fit, covariance, means, relative_sd=params.prior_sd, trim=params.trim
        )
        axes[axis] = _axis_entry(fit, covariance, after, wide, motion)
        solution[axis] = {
            term: float(value) for term, value in zip(after.terms, after.solution, strict=True)
        }
        if means:
            used[axis] = means
        rank += fit.rank - (CONSTANT in fit.terms and CONSTANT not in fit.zero_terms)
    dropped = [
        f"{axis} {term}"
        for axis, terms in declared.terms.items()
        for term in terms
        if term not in model.terms.get(axis, ())
    ]
    card = {
        "name": model.name,
        "title": model.title,
        "vehicle": vehicle.name,
        "source": model.source,
        "n_bar": model.n_bar,
        "n_bar_declared": declared.n_bar,
        "rank": rank,
        "samples": factor.n_samples,
        "trim": params.trim,
        "velocity_errors": errors is not None,
        "assumed": list(vehicle.assumed),
        "axes": axes,
        "not_applicable": dropped,
        "conditions": {
            name: {"rms": item.rms, "low": item.low, "high": item.high}
            for name, item in motion.items()
        },
        "solution": solution,
    }
    if used:
        card["prior"] = {"source": params.prior, "relative_sd": params.prior_sd, "means": used}
    return card


def _covariance(fit: AxisFit, training: list[Samples], index: int, params: Params) -> Array:
    if fit.n_samples <= len(fit.independent):
        return np.full((len(fit.terms), len(fit.terms)), np.nan)
    return hac_fit_covariance(fit, _pairs(fit, training, index), lags=params.hac_lags)


def _covariance_entry(terms: Sequence[str], covariance: Array) -> dict[str, Any]:
    """The covariance of the terms that carry a number in `solution`: their names and
    the rows of the lower triangle.
    """
    kept = [int(i) for i in np.flatnonzero(np.isfinite(np.diag(covariance)))]
    return {
        "terms": [terms[i] for i in kept],
        "lower": [[float(covariance[i, j]) for j in kept if j <= i] for i in kept],
    }


def _pairs(fit: AxisFit, training: list[Samples], index: int) -> Iterator[tuple[Array, Array]]:
    terms = tuple(term for term in fit.terms if term != CONSTANT)
    for part in training:
        for start in range(0, len(part.force), UNBROKEN):
            chosen = slice(start, start + UNBROKEN)
            force = part.force[chosen, index]
            ratio = None if part.ratio is None else part.ratio[chosen]
            yield (
                (
                    basis_rows(part.nu[chosen].T, ratio, terms)
                    if terms
                    else np.zeros((0, len(force)))
                ),
                force,
            )


def _axis_entry(
    fit: AxisFit,
    covariance: Array,
    after: AxisFit,
    wide: Array,
    motion: Mapping[str, VelocityExcitation],
) -> dict[str, Any]:
    """What the data say of every term, `fit` with `covariance`; numbers and errors are
    those with the prior, `after` with `wide`.
    """
    axis = fit.axis
    verdicts, determined = judge_with_motion(fit, motion, covariance=covariance)
    errors = np.sqrt(np.maximum(np.diag(wide), 0.0))
    summed = {term for item in determined for term in item.weights}
    terms = []
    for index, term in enumerate(fit.terms):
        verdict = verdicts[term]
        alone = (
            verdict.status != NOT_EXCITED
            and term not in summed
            and bool(np.isfinite(fit.coefficients[index]))
        )
        entry: dict[str, Any] = {
            "term": term,
            "unit": coefficient_unit(axis, term),
            "value": float(after.solution[index]) if alone else None,
            "standard_error": (
                float(errors[index]) if alone and np.isfinite(errors[index]) else None
            ),
            "verdict": verdict.status,
        }
        if verdict.status == INSEPARABLE:
            entry["inseparable_from"] = list(verdict.partners)
        terms.append(entry)
    combinations = [
        {
            "weights": dict(item.weights),
            "value": item.value,
            "standard_error": _finite(item.standard_error),
            "reading": str(item),
        }
        for item in determined
    ]
    return {
        "unit": AXIS_UNITS[axis],
        "samples": fit.n_samples,
        "rank": fit.rank,
        "condition": fit.condition if np.isfinite(fit.condition) else None,
        "j0": fit.j0,
        "j": after.rms,
        "excitation": _excitation(motion[VELOCITY_OF_AXIS[axis]]),
        "terms": terms,
        "combinations": combinations,
        "covariance": _covariance_entry(fit.terms, wide),
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _excitation(motion: VelocityExcitation) -> str:
    if not motion.excited:
        return "not excited"
    return "excited" if motion.std >= motion.threshold else "weak"


def _section(
    cards: Mapping[str, Document], motion: Mapping[str, VelocityExcitation]
) -> dict[str, Any]:
    rows = [
        [
            name,
            item.rms,
            item.low,
            item.high,
            item.threshold,
            _excitation(item),
            "yes" if item.changes_sign else "no",
        ]
        for name, item in motion.items()
    ]
    note = (
        "Not excited: RMS below the threshold, which is about three times the sensor noise. Weak:"
        " moves, but hardly varies."
    )
    heads = ["velocity", "RMS", "lowest", "highest", "threshold", "excitation", "both directions"]
    blocks = [table("Excitation in the training legs (SI)", heads, rows, note=note)]
    blocks.append(
        equation(
            r"\bar{\tau} = K \xi(\nu)",
            "Every model is a choice of terms of the viscous basis xi (McCarter 3.12).",
        )
    )
    for card in cards.values():
        blocks += _model_blocks(card)
    return section(
        "Models and coefficients",
        blocks,
        order=50,
        look_for="A coefficient without a number is one that these data do not determine.",
    )


def _model_blocks(card: Document) -> list[dict[str, Any]]:
    rows = []
    for axis, part in card["axes"].items():
        for item in part["terms"]:
            partners = item.get("inseparable_from")
            verdict = f"inseparable from {', '.join(partners)}" if partners else item["verdict"]
            rows.append(
                [axis, item["term"], item["value"], item["standard_error"], item["unit"], verdict]
            )
    heads = ["axis", "term", "value", "standard error", "unit", "verdict"]
    title = f"{card['title']}: {card['n_bar']} terms, rank {card['rank']}" + (
        ", with a prior" if "prior" in card else ""
    )
    note = "Standard errors allow for coloured residuals (Newey-West)"
    if card["velocity_errors"]:
        note += (
            " and for what errors of the velocities, as large as fuse says they are, do to the"
            " coefficients."
        )
    else:
        note += ". They take the velocities as exact, of which fuse gave no standard deviation."
    if card["assumed"]:
        note += f" They take the {len(card['assumed'])} assumed figures of the vehicle as exact."
    blocks = [table(title, heads, rows, note=note)]
    if "prior" in card:
        blocks.append(_prior_remark(card))
    sums = [
        [axis, item["reading"], item["standard_error"]]
        for axis, part in card["axes"].items()
        for item in part["combinations"]
    ]
    if sums:
        heads = ["axis", "combination of coefficients: value", "standard error"]
        blocks.append(
            table(f"{card['title']}: what the data determine of inseparable terms", heads, sums)
        )
    if card["not_applicable"]:
        words = (
            f"{card['title']}: {len(card['not_applicable'])} terms with the propulsion ratio do not"
            " apply without a propeller speed"
        )
        blocks.append(remark(f"{words}: {', '.join(card['not_applicable'])}."))
    lopsided = [
        f"{axis} {item['term']}"
        for axis, part in card["axes"].items()
        for item in part["terms"]
        if item["verdict"] == IDENTIFIED
        and item["term"] != CONSTANT
        and breaks_symmetry(axis, item["term"])
    ]
    if lopsided:
        words = (
            f"{card['title']}: {', '.join(lopsided)} came out identified, though a hull symmetric"
            " to port and starboard has no such terms."
        )
        blocks.append(
            remark(
                f"{words} Look at the thrust model, the mounting of the sensors and the load before"
                " the hull."
            )
        )
    return blocks


def _prior_remark(card: Document) -> dict[str, Any]:
    """Which coefficients carry a prior, and which of them rest on it because the data
    leave them open.
    """
    means, sd = card["prior"]["means"], card["prior"]["relative_sd"]
    told = {
        (axis, item["term"])
        for axis, part in card["axes"].items()
        for item in part["terms"]
        if item["verdict"] == IDENTIFIED
    }
    resting = [
        f"{axis} {term}"
        for axis, terms in means.items()
        for term in terms
        if (axis, term) not in told
    ]
    words = (
        f"{card['title']}: a prior was used, strip theory of the vehicle's geometry with a standard"
        f" deviation of {100.0 * sd:g} % of each value, on {sum(map(len, means.values()))}"
        " coefficients. Verdicts are those of the data alone."
    )
    return remark(words + (f" On the prior rest: {', '.join(resting)}." if resting else ""))


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
