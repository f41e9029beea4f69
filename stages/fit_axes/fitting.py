"""Fit each axis that the legs measure, and say why the others cannot be fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES
from auvid.hydro.axis_figures import CONSTANT, FORCE, AxisEquation
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.drive import ForceDrive
from auvid.hydro.identification.axes.judgement import (
    STRAIGHT,
    InertiaPrior,
    LagVerdict,
    ShapeVerdict,
)
from auvid.hydro.identification.axes.record import AxisRecord, is_idle
from auvid.hydro.identification.axes.single_axis import (
    LAG_FLOOR_S,
    LAG_SD_S,
    SURGE,
    SingleAxisFit,
    fit_axis,
    flown_better,
    refusal,
)
from auvid.hydro.identification.axes.structure import RIGHTING
from auvid.hydro.identification.axes.windows import depth_measures
from auvid.hydro.identification.fleet.thruster_ratios import ThrusterRatio
from auvid.hydro.identification.regression.verdicts import WEAK
from auvid.hydro.partial_model import apparent_inertia
from auvid.stages.columns import TOO_COARSE
from auvid.stages.fit_axes.clocks import (
    MOST_PASSES,
    clock_doubts,
    clock_of_all,
    corrected,
    late_commands,
    on_one_clock,
)
from auvid.stages.fit_axes.coupling import fitted_together
from auvid.stages.fit_axes.fitted import (
    DIVES_DIFFER,
    DRAG_AHEAD,
    AxisFits,
    CommandForces,
    FittedAxis,
    FlownAxis,
    Lacking,
    LackingVerdict,
    LegClock,
    Markers,
)
from auvid.stages.fit_axes.flight import (
    FitOptions,
    LegData,
    doubts_of,
    idle,
    judged,
    pushed,
)
from auvid.stages.fit_axes.hull_speeds import HullSpeeds, hull_speeds
from auvid.stages.fit_axes.markers import (
    arm_doubts,
    at_origin,
    by_poses,
    by_smoothed,
    doubted,
    markers_of,
)
from auvid.stages.fit_axes.thrusters import as_strong, ratios_of
from auvid.stages.model_use import TILTS, axes_listed
from auvid.stages.number_format import SIMULATED_PERCENT, fit_in_percent
from auvid.stages.page.first_screen import AXIS_WORDS
from auvid.stages.steps import tell

DEPTH_LAG_SD_S = 0.1
"""How late a depth may be beside the motion: filters of barometers take 0 to .2 s."""
AS_WELL = 2.0
"""Held-out fit [%] that a lag of other axes may cost."""
SURGE_WORTH = 1.0
"""Held-out fit [%] that a force ahead in heave has to gain in each part (decision 0127)."""
WINDOWS = "windows"
UNLIKE = 0.5
"""A validation leg flown to less than this share of what windows left out are moves unlike them."""
BY_SURGE = (
    "a force follows surge (part of the force ahead, behind the lag of its speed), which flies"
    " what was held out better; surge_in_heave: false leaves it out"
)
AGAINST = (
    "it does not move the way that its force pushes: the commands are on another clock than the"
    " motion, or the sign of the command or of the actuator is wrong"
)


def fit_all(
    legs: Mapping[str, LegData],
    vehicle: Vehicle,
    options: FitOptions,
    *,
    strengths: tuple[ThrusterRatio, ...] | None = None,
    clocks: Mapping[str, LegClock] | None = None,
    common: LegClock | None = None,
    passes: int = 1,
) -> AxisFits:
    """Return the fits of all axes that the training legs give, with held-out fits.

    Validation legs, where there are any, are flown by a fit that does not use them; then
    windows and legs are left out in turn too. strengths: of thrusters, where forces have
    them already; None to find them, and to fit once more where one is weak. clocks: of
    commands that are moved; None to find those on another clock. common: of all legs, beside
    their own. passes: fits so far.
    """
    as_logged, first = legs, next(iter(legs.values())).windows
    _check_units(legs)
    legs = on_one_clock(legs, clocks or {}, common)
    markers = markers_of(legs, vehicle, place=options.marker_arm)
    if markers is not None and markers.used and markers.departs:
        legs = at_origin(legs, markers.sensor, markers.departure)
    hull, moved = hull_speeds(legs, vehicle, lag_s=options.lag_s), legs
    legs = _with_doubts(hull.levelled(moved), hull, markers, clocks, common)
    ties = first.full_thrust
    if any(leg.windows.full_thrust != ties for leg in legs.values()):
        ties = {}  # what a full command means differs between the legs
    fitted: list[FittedAxis] = []
    lacking: list[Lacking] = []
    doubtful: dict[str, Lacking] = {}
    tried: list[FittedAxis] = []
    for step, axis in enumerate(AXES):
        tell(f"axis {axis}", step, len(AXES))
        using = _using(legs, axis)
        why = _lacking(axis, legs, using, options)
        if why is not None:
            lacking.append(why)
        else:
            fit = _fit(axis, using, legs, vehicle, options, hull)
            tried.append(fit)
            refused = _refused(fit, using, vehicle, options)
            if refused is None or refused.verdict == "not predicted":
                fitted.append(fit)
                doubtful |= {} if refused is None else {axis: refused}
            else:
                lacking.append(refused)
    if clocks is None:
        clocks = late_commands(tried, legs)
        if clocks:
            return fit_all(as_logged, vehicle, options, clocks=clocks, passes=2)
    elif clocks and strengths is None and passes < MOST_PASSES:
        better = corrected(clocks, tried, legs)
        if better:
            return fit_all(
                as_logged, vehicle, options, clocks=better, common=common, passes=passes + 1
            )
    if common is None:
        common = clock_of_all(tried, legs)
        if common is not None:
            return fit_all(
                as_logged, vehicle, options,
                strengths=strengths, clocks=clocks, common=common, passes=passes,
            )  # fmt: skip
    if strengths is None:
        strengths = ratios_of(tried, legs, vehicle, options)
        if any(item.is_weak for item in strengths):
            return fit_all(
                as_strong(as_logged, strengths), vehicle, options,
                strengths=strengths, clocks=clocks, common=common, passes=passes,
            )  # fmt: skip
    shared = shared_lag(fitted, options.lag_s)
    if options.fit_lag and shared is not None:
        depth_only = not first.normalised and by_depth(telling_lag(fitted))
        late = replace(options, lag_s=shared[0], lag_sd_s=shared[1], fit_lag=depth_only)
        hull = hull_speeds(moved, vehicle, lag_s=late.lag_s)
        levelled = _with_doubts(hull.levelled(moved), hull, markers, clocks, common)
        fitted, legs = _with_shared_lag(fitted, legs, levelled, vehicle, late, hull)
    commands = CommandForces(first.normalised, dict(first.full_force.items()), dict(ties.items()))
    every, together = fitted_together(fitted, legs, vehicle, options, commands)
    lacking += [doubtful[i.axis] for i in every if i.axis in doubtful and not i.predicts]
    kept = tuple(
        replace(item, warnings=(*item.warnings, *unlike_validation(item)))
        for item in every
        if item.predicts or item.axis not in doubtful
    )
    if together is not None and together.chosen:
        there = {item.axis for item in kept}
        together = replace(together, axes=tuple(a for a in together.axes if a in there))
    return AxisFits(
        fitted=tuple(by_smoothed(by_poses(doubted(item, markers), legs), legs) for item in kept),
        markers=markers,
        lacking=tuple(sorted(lacking, key=lambda item: AXES.index(item.axis))),
        normalised=first.normalised,
        full_force=commands.full_force,
        full_thrust=commands.full_thrust,
        force=first.force,
        legs=tuple(legs),
        together=together,
        thrusters=strengths,
        clocks=clocks,
        common_clock=common,
    )


def _with_doubts(
    legs: Mapping[str, LegData],
    hull: HullSpeeds,
    markers: Markers | None,
    clocks: Mapping[str, LegClock] | None,
    common: LegClock | None,
) -> dict[str, LegData]:
    """Return legs with what their records rest on one deviation off."""
    late = clock_doubts(legs, clocks or {}, common)
    doubts = {**hull.doubts(legs), **arm_doubts(legs, markers), **late}
    return {
        key: replace(leg, doubts={name: own[key] for name, own in doubts.items() if key in own})
        for key, leg in legs.items()
    }


def _using(legs: Mapping[str, LegData], axis: str) -> dict[str, LegData]:
    """Return the training legs that have windows of an axis."""
    return {
        key: leg
        for key, leg in legs.items()
        if leg.windows.use == "training" and not idle(leg.record, axis)
    }


def telling_lag(fitted: Sequence[FittedAxis]) -> list[FittedAxis]:
    """Return the axes that show how late thrusters are.

    Depth shows it worst, since what a tilted hull climbs is in it: beside a rate that shows
    a lag, that of depth counts for nothing. Where none does, depth counts for what it tells.
    """
    telling = [item for item in fitted if item.lag_verdict == "identified"]
    rates = [item for item in telling if item.measured_by != "depth"]
    return rates or [
        item
        for item in fitted
        if item.measured_by == "depth" and (item in telling or item.lag_told_s is not None)
    ]


def shared_lag(fitted: Sequence[FittedAxis], assumed_s: float) -> tuple[float, float] | None:
    """Return the lag [s] that some axes show, and its deviation; None where none does.

    Nor where all do. Thrusters of one vehicle are late alike. A depth is late itself: where
    no rate shows a lag clearly, it lies between that and `assumed_s`, by their weights.
    """
    telling = telling_lag(fitted)
    if not telling or all(item in telling or item.axis in TILTS for item in fitted):
        return None
    pairs = [
        (item.lag_s, item.lag_error_s)
        if item.lag_verdict == "identified" or item.lag_told_s is None
        else item.lag_told_s
        for item in telling
    ]
    lags, errors = np.array(pairs).T
    lag_s = float(np.average(lags, weights=errors**-2.0))
    error = max(float(np.hypot(errors.min(), lags.std())), LAG_FLOOR_S)
    if not by_depth(telling):
        return lag_s, error
    late = DEPTH_LAG_SD_S**2 + error**2
    weight = LAG_SD_S**2 / (LAG_SD_S**2 + late)
    return assumed_s + weight * (lag_s - assumed_s), float(np.sqrt(weight * late))


def by_depth(telling: Sequence[FittedAxis]) -> bool:
    """Return whether only depth shows how late thrusters are."""
    return all(item.measured_by == "depth" for item in telling)


def _with_shared_lag(
    fitted: Sequence[FittedAxis],
    legs: Mapping[str, LegData],
    levelled: Mapping[str, LegData],
    vehicle: Vehicle,
    options: FitOptions,
    hull: HullSpeeds,
) -> tuple[list[FittedAxis], Mapping[str, LegData]]:
    """Return axes that tell no lag, or a worse one, with that of others, and legs.

    Where that flies what is held out as well, within `AS_WELL`. levelled: legs whose depth
    goes with that lag.
    """
    telling = [item.axis for item in telling_lag(fitted)]
    late = by_depth(telling_lag(fitted))
    whose = f"that of {axes_listed(telling)}"
    if late:
        whose = f"between {whose}, whose depth is late itself, and the assumed one"
    out, used = [], legs
    for item in fitted:
        if item.axis in telling or item.axis in TILTS:
            out.append(item)
            continue
        other = _fit(item.axis, _using(levelled, item.axis), levelled, vehicle, options, hull)
        if (other.held_out_percent or 0.0) >= (item.held_out_percent or 0.0) - AS_WELL:
            word = AXIS_WORDS[item.axis].capitalize()
            of = "the assumed lag" if options.fit_lag else "the lag"
            note = f"{word}: {of} is {whose}, {options.lag_s:.2g} s."
            item = replace(other, notes=(*other.notes, note))
            used = levelled if item.axis == "Z" else used
        out.append(item)
    return out, used


def _check_units(legs: Mapping[str, LegData]) -> None:
    """Raise `DataError` where some legs have newtons and others full commands."""
    commands = [key for key, leg in legs.items() if leg.windows.normalised]
    if commands and len(commands) < len(legs):
        raise DataError(
            "some legs have forces in newtons, others in full commands",
            field="legs",
            value=f"full commands in {', '.join(commands)}",
            remedy=(
                "Put them in two campaigns; or set stages.axis_record.use_commands: true, where"
                " all logs have normalised commands."
            ),
        )


def _lacking(
    axis: str, legs: Mapping[str, LegData], using: Mapping[str, LegData], options: FitOptions
) -> Lacking | None:
    """Return why an axis is not fitted, None where it is."""
    if options.axes and axis not in options.axes:
        words = "stages.fit_axes.axes of the campaign does not name it"
        return Lacking(axis, "left out", words)
    records = [leg.record for leg in legs.values()]
    if not any(axis in leg.windows.measured_by for leg in legs.values()):
        notes = [note for leg in legs.values() for note in leg.windows.notes]
        coarse = next((words for words in notes if TOO_COARSE in words), "").partition(". ")[0]
        words = "nothing measures its velocity" + (f"; {coarse}" if coarse and axis in "XY" else "")
        return Lacking(axis, "not observable", words)
    reasons = {item.reason for record in records for item in record.left_out if item.axis == axis}
    if not pushed(records, axis) or (not using and reasons == {"not commanded"}):
        return _not_commanded(axis, records)
    if not using:
        return Lacking(axis, "not excited", "; ".join(sorted(reasons)) or "no window is left")
    words = refusal([leg.record for leg in using.values()], axis)
    if not words:
        return None
    head, _, rest = words.partition(": ")
    verdict: LackingVerdict = "not observable" if head == "not observable" else "not excited"
    return Lacking(axis, verdict, rest or head)


def _not_commanded(axis: str, records: Sequence[AxisRecord]) -> Lacking:
    """Return why nothing drives an axis: no thruster, or no command."""
    layouts = [record.thrusters for record in records if record.thrusters is not None]
    if not layouts:
        return Lacking(axis, "not commanded", "no actuator drives it in these legs")
    if any(not is_idle(thrusters, axis) for thrusters in layouts):
        return Lacking(axis, "not commanded", "no actuator drives it in these legs", False)
    return Lacking(axis, "not commanded", "no thruster of the vehicle acts along it", True)


def _refused(
    fit: FittedAxis, using: Mapping[str, LegData], vehicle: Vehicle, options: FitOptions
) -> Lacking | None:
    """Return why a fitted axis is no part of the model, None where it is.

    What is not predicted is fitted once more with its force the other way round.
    """
    against = fit.equation.value(FORCE) <= 0.0
    percent = fit.held_out_percent
    if fit.predicts or percent is None:
        return Lacking(fit.axis, "wrong sign", AGAINST) if against else None
    turned = -np.inf if against else turned_round(fit.axis, using, vehicle, options)
    if turned >= SIMULATED_PERCENT and turned > percent:
        words = (
            f"{AGAINST} (turned round it is flown to {fit_in_percent(turned)}, as it is to"
            f" {fit_in_percent(percent)})"
        )
        return Lacking(fit.axis, "wrong sign", words)
    for key in using if len(using) > 1 else ():
        turned = turned_round(fit.axis, using, vehicle, options, (key,))
        if turned >= SIMULATED_PERCENT and turned > percent:
            words = (
                f"in leg {key} it moves against its force, unlike in the others: the sign of its"
                f" command there is wrong (turned round all are flown to {fit_in_percent(turned)},"
                f" as they are to {fit_in_percent(percent)})"
            )
            return Lacking(fit.axis, "wrong sign", words)
    if against:
        return Lacking(fit.axis, "wrong sign", AGAINST)
    if percent < 0.0:
        words = f"on what was held out its mean is the better guess ({fit_in_percent(percent)})"
        return Lacking(fit.axis, "not predicted", words + dives_apart(fit))
    return None


def dives_apart(fit: FittedAxis) -> str:
    """Return words where windows left out are flown, and whole legs are not."""
    windows = [i.percent for i in fit.held_out if i.what.endswith(WINDOWS)]
    if not windows or min(windows) < 0.0:
        return ""
    differ = [words.partition(": ")[2] for words in fit.warnings if DIVES_DIFFER in words]
    why = differ[0].rpartition(": ")[0] if differ else "one dive does not tell the other"
    return (
        f", though windows left out in turn are flown to {fit_in_percent(min(windows))} and more:"
        f" {why}. Give each dive a campaign of its own"
    )


def unlike_validation(fit: FittedAxis) -> tuple[str, ...]:
    """Return a sentence where legs for validation move unlike the training legs."""
    windows = [i.percent for i in fit.held_out if i.what.endswith(WINDOWS)]
    least = min(windows, default=0.0)
    return tuple(
        f"{AXIS_WORDS[fit.axis].capitalize()}: {i.what} is flown to {fit_in_percent(i.percent)},"
        f" windows of the training legs that were left out to {fit_in_percent(least)} and more:"
        " that dive moves unlike these (tether, ballast, a snag). A campaign of its own tells how."
        for i in fit.held_out
        if i.validates and least >= SIMULATED_PERCENT and i.percent < UNLIKE * least
    )


def turned_round(
    axis: str,
    using: Mapping[str, LegData],
    vehicle: Vehicle,
    options: FitOptions,
    only: Sequence[str] = (),
) -> float:
    """Return the held-out fit [%] of an axis with its force the other way round.

    In `only` these legs, where there are any; -inf where it then pushes against the motion.
    """
    turned = {
        key: replace(leg, record=replace(
            leg.record, force={**leg.record.force, axis: -leg.record.force[axis]}
        ), doubts={}) if key in (only or using) else leg
        for key, leg in using.items()
    }  # fmt: skip
    fit = _single(axis, turned, vehicle, replace(options, fit_lag=False), HullSpeeds())
    percent = [i.percent[fit.velocity] for i in fit.held_out if fit.velocity in i.percent]
    return min(percent, default=-np.inf) if fit.values[2] > 0.0 else -np.inf


def _single(
    axis: str,
    using: Mapping[str, LegData],
    vehicle: Vehicle,
    options: FitOptions,
    hull: HullSpeeds,
) -> SingleAxisFit:
    records = [leg.record for leg in using.values()]
    prior = None
    if axis in options.given_inertia and not records[0].normalised:
        prior = InertiaPrior(apparent_inertia(vehicle, axis), options.inertia_sd)
    return fit_axis(
        records,
        axis,
        inertia=prior,
        hull=np.array([apparent_inertia(vehicle, name) for name in AXES]),
        drive=ForceDrive(lag_s=options.lag_s),
        speed_share=hull.share,
        doubtful=doubts_of(using),
        surge=bool(options.surge_in_heave),
        try_lag=options.fit_lag,
        lag_sd_s=options.lag_sd_s,
        try_shape=options.fit_curve,
        creeps=axis in options.linear_drag,
    )


def _fit(
    axis: str,
    using: Mapping[str, LegData],
    legs: Mapping[str, LegData],
    vehicle: Vehicle,
    options: FitOptions,
    hull: HullSpeeds,
) -> FittedAxis:
    fit = _single(axis, using, vehicle, options, hull)
    surge_words: tuple[str, ...] = ()
    if _may_follow_surge(axis, using, options):
        other = _single(axis, using, vehicle, replace(options, surge_in_heave=True), hull)
        if flown_better("w", other.held_out, fit.held_out, by=SURGE_WORTH):
            fit, surge_words = other, (BY_SURGE,)
    differ = [item for item in fit.legs if item.differ]
    word = AXIS_WORDS[axis].capitalize()
    warnings = [
        f"{word}: {DIVES_DIFFER} in {item.quantity} (largest over smallest"
        f" {item.ratio:.2g}): this model is their mean."
        for item in differ
    ]
    if fit.sides is not None and fit.sides.differ:
        warnings.append(
            f"{word}: {DRAG_AHEAD} {fit.sides.ratio:.2g} times that back"
            f" ({fit.sides.low:.2g} to {fit.sides.high:.2g}): a tether, or a hull that is not alike"
            " both ways."
        )
    return FittedAxis(
        equation=_equation(fit),
        rate_rms=fit.speed,
        measured_by=next(iter(using.values())).windows.measured_by[axis],  # type: ignore[index]
        lag_s=fit.lag.value_s,
        lag_error_s=0.0
        if fit.lag.by_motion_s is None and not fit.lag.determined
        else float(np.nan_to_num(fit.lag.standard_error, nan=fit.lag.deviation_s)),
        lag_verdict=_lag_word(fit.lag),
        lag_told_s=fit.lag.told_s,
        shape=fit.shape,
        inertia=fit.inertia.word,
        quantities=fit.without_newtons(),
        warnings=tuple(warnings),
        notes=tuple(f"{word}: {words}." for words in (*fit.notes, *_bend(fit.shape), *surge_words)),
        surge=fit.beside_force(SURGE),
        righting=fit.beside_force(RIGHTING),
        **judged(
            FlownAxis(fit.velocity, fit.pool, fit.fit), fit.held_out, using, legs, rms=fit.speed
        ),
    )


def _may_follow_surge(axis: str, using: Mapping[str, LegData], options: FitOptions) -> bool:
    """Return whether a force that follows surge is tried in heave.

    Where nobody decides it, depth measures heave, and X is pushed.
    """
    records = [leg.record for leg in using.values()]
    by_depth = any(depth_measures(record, "w") for record in records)
    return options.surge_in_heave is None and axis == "Z" and by_depth and pushed(records, "X")


def _lag_word(lag: LagVerdict) -> Literal["identified", "weak", "assumed"]:
    if lag.determined:
        return "identified"
    return "assumed" if lag.by_motion_s is None else "weak"


def _bend(shape: ShapeVerdict) -> tuple[str, ...]:
    """Return a sentence on commands that do not act along a straight line."""
    if shape.word == STRAIGHT.word:
        return ()
    return (
        f"commands act beyond {shape.dead_band:.2g} of full (standard error"
        f" {shape.dead_band_error:.1g}), with exponent {shape.curve:.3g} ({shape.curve_error:.1g}):"
        f" {shape.word}",
    )


def _equation(fit: SingleAxisFit) -> AxisEquation:
    """Return a, b, c, d; 1.96 of their errors are half of the interval by windows."""
    own = fit.velocity
    names = (own, f"{own}*|{own}|", FORCE, CONSTANT)
    keys = (own, f"{own}|{own}|", FORCE, CONSTANT)
    verdicts = {
        name: fit.verdicts[f"{fit.axis} {key}"].word
        if f"{fit.axis} {key}" in fit.verdicts
        else WEAK
        for name, key in zip(names, keys, strict=True)
    }
    covariance = fit.covariance * (fit.width / NORMAL_95) ** 2
    return AxisEquation(fit.axis, names, fit.values, covariance, verdicts)
