"""The model card of a fit to the sensors, with the figures of a likelihood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from auvid.data_schemas.records.likelihood import ChannelNoise, LagFit, LegFit, LikelihoodFit
from auvid.data_schemas.records.models import (
    AxisCard,
    CovarianceCard,
    InertiaCard,
    LimitCard,
    ModelCard,
    TermCard,
    TermCombination,
)
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS
from auvid.hydro.identification.constrained.equations import ALL_AXES, LAG, Unknown
from auvid.hydro.identification.constrained.estimates import EstimateStatus, estimate_statuses
from auvid.hydro.identification.constrained.statuses import AT_BOUND, FROM_PRIOR, moved_far
from auvid.hydro.identification.maximum_likelihood.estimate import LikelihoodEstimate
from auvid.hydro.identification.maximum_likelihood.records import CHANNELS, SENSORS, LegRecord
from auvid.hydro.identification.regression.assumed_figures import FORM, UNSTEADY, total_error
from auvid.hydro.identification.regression.excitation import THRESHOLDS
from auvid.hydro.identification.regression.least_squares import Combination
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    INSEPARABLE,
    NOT_EXCITED,
    VIF_LIMIT,
    WEAK,
    TermStatus,
    clear_of_zero,
    stands_clear,
    strongest,
)
from auvid.stages.refine.fitting import SensorFit

UNITS = ("rad",) * 3 + ("rad/s",) * 3 + ("m/s^2",) * 3 + ("m/s",) * 3 + ("m",)
CHANGED = 0.1
"""Share of the standard error from which on limits changed a value."""

COVERAGE_ON_TWINS: Mapping[str, Mapping[str, float]] = {
    "filter_error": {"linear": 0.90},
    "output_error": {"linear": 0.95, "gertler_hagen": 0.92},
}
"""Share of the 95 % intervals of coefficients called identified that hold the truth, by the
true model: fits to twins of the VT 690 of 33 seeds (plan matched, with an unsteady force), and
60 and 16 (plan default); their binomial intervals are .87 to .93, .94 to .96 and .86 to .92
(benchmarks/coverage.py).
"""


def refined_card(
    fit: SensorFit,
    name: str,
    estimator: str,
    legs: Sequence[LegRecord],
    force_errors: Mapping[str, float],
    held_out: Mapping[str, Mapping[str, float | None]],
    left_out: Sequence[str],
) -> ModelCard:
    """Return the card of a fit: that which it started from, with its own numbers.

    force_errors: axis -> RMS error of the residual force on training. held_out: part of
    the legs -> axis or all -> J/J0 on it from the others. left_out: legs without sensors.
    """
    card, words = fit.problem.card, estimator.replace("_", " ")
    status = _statuses(fit, words)
    return card.model_copy(
        update={
            "name": name,
            "title": f"{card.title} ({words})",
            "method": words,
            "velocity_errors": None,
            # Those of twins are of forms that have the truth, whose windows agree.
            "coverage_on_twins": (
                dict(COVERAGE_ON_TWINS[estimator]) if fit.estimate.windows_agree else {}
            ),
            # What least squares says of signs without a leg is not said of this fit.
            "left_out": [],
            "held_out": {part: dict(row) for part, row in held_out.items()},
            "axes": {
                axis: _axis(axis, part, fit, status, force_errors[axis])
                for axis, part in card.axes.items()
            },
            "predictor": fit.predictor,
            "limits": [
                LimitCard(name=item.name, unknowns=[str(u) for u in item.unknowns])
                for item in fit.limited.active
            ],
            "limits_cost": 0.0,
            "inertia": [_inertia(item, fit, status, words) for item in card.inertia],
            "lag": _lag(fit),
            "likelihood": _likelihood(fit, estimator, legs, left_out),
        }
    )


def _statuses(fit: SensorFit, method: str) -> dict[Unknown, EstimateStatus]:
    """Return the status of every unknown; what the motion rules out stays so.

    Identified only where the method may say it.
    """
    unknowns, estimate, signs = fit.problem.unknowns, fit.estimate, fit.problem.signs
    card = fit.problem.card
    beforehand = {
        Unknown(axis, item.term): _of_motion(item, card)
        for axis, part in card.axes.items()
        for item in part.terms
    }
    prior = fit.problem.prior
    bounded = {item.unknowns[0] for item in fit.limited.active if len(item.unknowns) == 1}
    statuses = estimate_statuses(
        fit.limited.values,
        estimate.standard_errors,
        estimate.information_covariance * np.outer(signs, signs),
        np.zeros((len(unknowns),) * 2) if prior is None else prior.precision,
        estimate.at_bound | np.array([unknown in bounded for unknown in unknowns]),
        {i: word for i, unknown in enumerate(unknowns) if (word := beforehand.get(unknown))},
    )
    may_say = (replace(item, status=strongest(item.status, method)) for item in statuses)
    return dict(zip(unknowns, may_say, strict=True))


def _of_motion(item: TermCard, card: ModelCard) -> str:
    """Return the verdict that no estimator changes; empty for none."""
    exact = item.verdict == INSEPARABLE and item.value is None
    if item.verdict in (AT_BOUND, FROM_PRIOR) and item.term in BASIS_TERMS:
        # They stand in place of what the motion says.
        names = [factor.strip("|") for factor in BASIS_TERMS[item.term].factors]
        ranges = [(card.conditions[name], THRESHOLDS[name]) for name in names if name in VELOCITIES]
        still = (
            v.rms < (v.threshold if len(names) == 1 else max(v.threshold, fixed))
            for v, fixed in ranges
        )
        return NOT_EXCITED if any(still) else ""
    return item.verdict if item.verdict in (NOT_EXCITED, "not applicable") or exact else ""


def _axis(
    axis: str,
    part: AxisCard,
    fit: SensorFit,
    status: Mapping[Unknown, EstimateStatus],
    force_error: float,
) -> AxisCard:
    unknowns = fit.problem.unknowns
    own = [u for u in unknowns if u.axis == axis and u.term in {item.term for item in part.terms}]
    places = [unknowns.index(u) for u in own]
    kept = [i for i in places if np.isfinite(fit.covariance[i, i])]
    return part.model_copy(
        update={
            "j": force_error,
            "lacking": [] if complete(fit.estimate) else part.lacking,
            "terms": [_term(axis, item, fit, status) for item in part.terms],
            "covariance": CovarianceCard(
                terms=[unknowns[i].term for i in kept],
                lower=[[float(fit.covariance[i, j]) for j in kept if j <= i] for i in kept],
                shifts=part.covariance.shifts_of([_free_term(unknowns[i], status) for i in kept]),
            ),
            "combinations": [_combination(axis, item, fit) for item in part.combinations],
        }
    )


def _free_term(unknown: Unknown, status: Mapping[Unknown, EstimateStatus]) -> str:
    """Return the term of an unknown, '' for one that a bound or a prior holds."""
    return "" if status[unknown].status in (AT_BOUND, FROM_PRIOR) else unknown.term


def _term(
    axis: str, item: TermCard, fit: SensorFit, status: Mapping[Unknown, EstimateStatus]
) -> TermCard:
    """Return a term; one that was not fitted keeps its verdict and has no number."""
    unknown = Unknown(axis, item.term)
    bare = dict.fromkeys(
        ("value", "standard_error", "free_value", "inseparable_from", "turns_without")
    )
    if unknown not in status:
        return item.model_copy(update={**bare, "inseparable_from": item.inseparable_from})
    i = fit.problem.unknowns.index(unknown)
    word = status[unknown].status
    update: dict[str, Any] = {**bare, "verdict": word}
    if word in (AT_BOUND, FROM_PRIOR):
        # Shifts are those of the data alone, which a bound or a prior holds back.
        update["assumed_shifts"] = {}
    if word == INSEPARABLE:
        others = [fit.problem.unknowns[j] for j in status[unknown].partners]
        partners = [other.term if other.axis == axis else str(other) for other in others]
        update["inseparable_from"] = partners or item.inseparable_from
    exact = word == INSEPARABLE and not status[unknown].partners
    if word != NOT_EXCITED and not exact:
        value, error = float(fit.limited.values[i]), float(fit.estimate.standard_errors[i])
        fixed = word == AT_BOUND or not np.isfinite(error)
        update |= {"value": value, "standard_error": None if fixed else error}
        free = float(fit.problem.physical(fit.estimate.theta)[i])
        if not fixed and abs(value - free) > CHANGED * error:
            update["free_value"] = free
        shifts = _shifts(item, value, fit.estimate)
        if word not in (AT_BOUND, FROM_PRIOR):
            update["assumed_shifts"] = shifts
        if word == IDENTIFIED and (
            not stands_clear(value, error, shifts)
            or moved_far(value, free, total_error(error, shifts))
        ):
            update["verdict"] = WEAK
    return item.model_copy(update=update)


def complete(estimate: LikelihoodEstimate) -> bool:
    """Return whether windows agree, compared on as many directions as unknowns."""
    agreement = estimate.agreement
    return agreement is not None and agreement.holds and agreement.degrees >= len(estimate.theta)


def _shifts(item: TermCard, value: float, estimate: LikelihoodEstimate) -> dict[str, float]:
    """Return what assumed figures move a coefficient by, and what its form lacks.

    Velocities are not taken from sensors here, so a force that moves the vehicle does not go
    with them. Where windows agree, the form lacks nothing that the sensors show, whatever terms
    least squares finds beside it. Where they do not, the form lacks something, and two
    estimators that weigh the motion differently take it up differently: how far this one is
    from least squares counts as well.
    """
    shifts = _of_figures(item.assumed_shifts, estimate)
    if not estimate.windows_agree:
        away = abs(value - item.value) if item.value is not None else abs(value)
        shifts[FORM] = float(np.hypot(shifts.get(FORM, 0.0), away))
    return shifts


def _combination(axis: str, item: TermCombination, fit: SensorFit) -> TermCombination:
    """Return a sum of inseparable terms with the values of this fit."""
    weights = np.array(
        [item.weights.get(u.term, 0.0) * (u.axis == axis) for u in fit.problem.unknowns]
    )
    used = weights != 0.0
    value = float(weights[used] @ fit.limited.values[used])
    variance = float(weights[used] @ fit.covariance[np.ix_(used, used)] @ weights[used])
    error = float(np.sqrt(variance)) if variance >= 0.0 else None
    reading = str(Combination(item.weights, value, error or 0.0))
    return item.model_copy(
        update={
            "value": value,
            "standard_error": error,
            "reading": reading,
            "assumed_shifts": _of_figures(item.assumed_shifts, fit.estimate),
        }
    )


def _of_figures(shifts: Mapping[str, float], estimate: LikelihoodEstimate) -> dict[str, float]:
    """Return shifts without those of least squares alone.

    An unsteady force leans it; and where windows agree its form lacks nothing.
    """
    other = {UNSTEADY, FORM} if complete(estimate) else {UNSTEADY}
    return {name: shift for name, shift in shifts.items() if name not in other}


def _inertia(
    item: InertiaCard, fit: SensorFit, status: Mapping[Unknown, EstimateStatus], method: str
) -> InertiaCard:
    """Return a fitted inertia, and how far the lag fitted beside it takes its place."""
    unknowns = fit.problem.unknowns
    places = dict(zip((i.name for i in fit.problem.card.inertia), fit.problem.inertia, strict=True))
    i = unknowns.index(places[item.name])
    change, error = float(fit.limited.values[i]), float(fit.estimate.standard_errors[i])
    away = 0.0 if fit.estimate.windows_agree else item.in_vehicle_file - change - item.value
    update: dict[str, Any] = {
        "value": item.in_vehicle_file - change,
        "standard_error": error if np.isfinite(error) else None,
        "free_value": None,
        "change": change,
        "verdict": _clear(change, error, away),
        "assumed_shifts": _of_figures(item.assumed_shifts, fit.estimate),
    }
    if status[unknowns[i]].status == AT_BOUND:
        update |= {"standard_error": None, "verdict": AT_BOUND, "assumed_shifts": {}}
        return item.model_copy(update=update)
    if fit.problem.lag:
        j = unknowns.index(Unknown(ALL_AXES, LAG))
        lag, lag_error = float(fit.limited.values[j]), float(fit.estimate.standard_errors[j])
        correlation = _correlation(fit.covariance, i, j)
        # What the change would be without a lag, from the joint covariance.
        without = change - correlation * error / lag_error * lag
        without_error = error * np.sqrt(1.0 - correlation**2)
        if 1.0 - correlation**2 < 1.0 / VIF_LIMIT or (
            update["verdict"] == WEAK and _clear(without, without_error, away) == IDENTIFIED
        ):
            update["verdict"] = INSEPARABLE
        update |= {
            "beside_lag": change,
            "beside_lag_error": update["standard_error"] or 0.0,
            "lag_s": lag,
            "lag_error_s": lag_error if np.isfinite(lag_error) else 0.0,
            "correlation": correlation,
        }
    return item.model_copy(update={**update, "verdict": strongest(update["verdict"], method)})


def _clear(value: float, error: float, away: float = 0.0) -> TermStatus:
    return IDENTIFIED if clear_of_zero(value, error, [away]) else WEAK


def _correlation(covariance: Array, i: int, j: int) -> float:
    """Return the correlation of two estimates, 0 where one is at its bound."""
    size = float(np.sqrt(covariance[i, i] * covariance[j, j]))
    return float(covariance[i, j]) / size if size > 0.0 else 0.0


def _likelihood(
    fit: SensorFit, estimator: str, legs: Sequence[LegRecord], left_out: Sequence[str]
) -> LikelihoodFit:
    estimate, noise = fit.estimate, fit.estimate.noise
    agreement = estimate.agreement
    counts = np.zeros(len(CHANNELS), dtype=int)
    for leg in legs:
        for sensor, record in leg.sensors.items():
            counts[SENSORS[sensor]] += np.isfinite(record.values).sum(axis=0)
    channels = [
        ChannelNoise(
            channel=name.replace("_", " "),
            unit=unit,
            samples=int(count),
            noise_sd=float(sd),
            normalised_rms=float(rms),
        )
        for name, unit, count, sd, rms in zip(
            CHANNELS, UNITS, counts, noise.sensor_sd, estimate.channel_residuals, strict=True
        )
        if count and np.isfinite(rms)
    ]
    is_open = agreement is None or agreement.holds
    agree = complete(estimate) or (None if is_open else False)
    return LikelihoodFit.model_validate(
        {
            "estimator": estimator,
            "started_from": fit.problem.card.name,
            "word": estimate.word,
            "steps": len(estimate.log_likelihood) - 1,
            "log_likelihood_gain": estimate.log_likelihood[-1] - estimate.log_likelihood[0],
            "samples": int(counts.sum()),
            "windows": estimate.windows,
            "weighted_residual": estimate.weighted_residual,
            "windows_differ": None if agreement is None else agreement.ratio,
            "windows_agree": agree,
            "channels": channels,
            "legs": [_leg(number, leg, fit) for number, leg in enumerate(legs)],
            "force_time_s": None if noise.time_s is None else _by_axis(noise.time_s),
            "limits_cost": fit.limited.cost,
            "left_out": [
                *left_out,
                *map(str, estimate.dropped),
            ],
        }
    )


def _leg(number: int, leg: LegRecord, fit: SensorFit) -> LegFit:
    values, errors = fit.estimate.biases[number], fit.estimate.bias_sd[number]
    accelerometer, force = "accel" in leg.sensors, fit.estimate.noise.force_sd
    return LegFit(
        leg=leg.name,
        accel_bias_m_s2=values[:3].tolist() if accelerometer else None,
        accel_bias_sd_m_s2=errors[:3].tolist() if accelerometer else None,
        gyro_bias_rad_s=values[3:].tolist(),
        gyro_bias_sd_rad_s=errors[3:].tolist(),
        force_sd=None if force is None else _by_axis(force[number]),
    )


def _by_axis(values: Array) -> dict[str, float]:
    return dict(zip(AXES, values.tolist(), strict=True))


def _lag(fit: SensorFit) -> LagFit | None:
    """Return the lag that was fitted, else that of the card, which was held."""
    if not fit.problem.lag:
        return fit.problem.card.lag
    unknowns = fit.problem.unknowns
    j = unknowns.index(Unknown(ALL_AXES, LAG))
    value, error = float(fit.limited.values[j]), float(fit.estimate.standard_errors[j])
    correlations = {
        item.name: _correlation(fit.covariance, unknowns.index(unknown), j)
        for item, unknown in zip(fit.problem.card.inertia, fit.problem.inertia, strict=True)
    }
    tied = any(1.0 - value**2 < 1.0 / VIF_LIMIT for value in correlations.values())
    first = fit.problem.card.lag
    if first is not None and first.verdict == INSEPARABLE:
        tied = True  # the motion leaves it open whether the velocity log is late
    fixed = bool(fit.estimate.at_bound[j]) or not np.isfinite(error)
    word = AT_BOUND if fixed else INSEPARABLE if tied else _clear(value, error)
    return LagFit.model_validate(
        {
            "value_s": value,
            "standard_error_s": None if fixed else error,
            "verdict": word,
            "correlations": correlations,
        }
    )
