"""Fit each axis that the legs measure, and say why the others cannot be fitted."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.axes import AxisWindowsRecord
from auvid.data_schemas.records.models import VelocityRange
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.axis_figures import CONSTANT, FORCE, AxisEquation
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.drive import ForceDrive
from auvid.hydro.identification.axes.held_out import percent_of
from auvid.hydro.identification.axes.pooled_fit import loop_rows, make_pool, motion
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.axes.single_axis import (
    SURGE,
    InertiaPrior,
    SingleAxisFit,
    fit_axis,
    refusal,
    surge_input,
)
from auvid.hydro.identification.axes.windows import (
    MotionWindow,
    depth_measures,
    depth_rate,
    low_passed,
    turn_of,
    windows_of,
)
from auvid.hydro.identification.regression.verdicts import WEAK
from auvid.hydro.partial_model import apparent_inertia
from auvid.stages.fit_axes.fitted import (
    AxisFits,
    AxisMotion,
    FittedAxis,
    HeldOutFit,
    Lacking,
    LackingVerdict,
)
from auvid.stages.page.first_screen import AXIS_WORDS
from auvid.stages.steps import tell

AGAINST = (
    "it does not move the way that its force pushes: check the directions of the thrusters, the"
    " frame, and the signs of commands and motion"
)


@dataclass(frozen=True)
class LegData:
    """The record of a leg, and how it was made."""

    record: AxisRecord
    windows: AxisWindowsRecord


@dataclass(frozen=True)
class FitOptions:
    """What to fit: axes (none: all that the legs give), lag, inertia that is given.

    given_inertia: axes whose apparent inertia is that of the vehicle file, with the
    relative standard deviation inertia_sd; of the others, it is free.
    """

    axes: Collection[str] = ()
    lag_s: float = 0.08
    fit_lag: bool = True
    given_inertia: Collection[str] = ("X", "Y", "Z")
    inertia_sd: float = 0.0
    surge_in_heave: bool = False


def fit_all(legs: Mapping[str, LegData], vehicle: Vehicle, options: FitOptions) -> AxisFits:
    """Return the fits of all axes that the training legs give, with held-out fits.

    Validation legs, where there are any, are flown by a fit that does not use them; then
    windows and legs are left out in turn too.
    """
    first = next(iter(legs.values())).windows
    _check_units(legs)
    ties = first.full_thrust
    if any(leg.windows.full_thrust != ties for leg in legs.values()):
        ties = {}  # what a full command means differs between the legs
    fitted: list[FittedAxis] = []
    lacking: list[Lacking] = []
    for step, axis in enumerate(AXES):
        tell(f"axis {axis}", step, len(AXES))
        using = {
            key: leg
            for key, leg in legs.items()
            if leg.windows.use == "training" and not _idle(leg.record, axis)
        }
        why = _lacking(axis, legs, using, options)
        if why is not None:
            lacking.append(why)
        else:
            fit = _fit(axis, using, legs, vehicle, options)
            if fit.equation.value(FORCE) > 0.0:
                fitted.append(fit)
            else:
                lacking.append(Lacking(axis, "not excited", AGAINST))
    return AxisFits(
        fitted=tuple(fitted),
        lacking=tuple(lacking),
        normalised=first.normalised,
        full_force=dict(first.full_force.items()),
        full_thrust=dict(ties.items()),
        force=first.force,
        legs=tuple(legs),
    )


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


def _idle(record: AxisRecord, axis: str) -> bool:
    """Return whether a record has no window of an axis."""
    return not record.windows.get(axis)


def _lacking(
    axis: str, legs: Mapping[str, LegData], using: Mapping[str, LegData], options: FitOptions
) -> Lacking | None:
    """Return why an axis is not fitted, None where it is."""
    if options.axes and axis not in options.axes:
        return Lacking(axis, "not excited", "the campaign does not ask for it")
    records = [leg.record for leg in legs.values()]
    if not any(axis in leg.windows.measured_by for leg in legs.values()):
        return Lacking(axis, "not observable", "nothing measures its velocity")
    if not _commanded(records, axis):
        return Lacking(axis, "not commanded", "no actuator drives it in these legs")
    reasons = {item.reason for record in records for item in record.left_out if item.axis == axis}
    if not using:
        return Lacking(axis, "not excited", "; ".join(sorted(reasons)) or "no window is left")
    words = refusal([leg.record for leg in using.values()], axis)
    if not words:
        return None
    head, _, rest = words.partition(": ")
    verdict: LackingVerdict = "not observable" if head == "not observable" else "not excited"
    return Lacking(axis, verdict, rest or head)


def _commanded(records: Sequence[AxisRecord], axis: str) -> bool:
    """Return whether the force on an axis ever changes."""
    forces = [record.force[axis] for record in records]
    return any(np.isfinite(force).any() and np.nanmax(np.abs(force)) > 0.0 for force in forces)


def _fit(
    axis: str,
    using: Mapping[str, LegData],
    legs: Mapping[str, LegData],
    vehicle: Vehicle,
    options: FitOptions,
) -> FittedAxis:
    records = [leg.record for leg in using.values()]
    prior = None
    if axis in options.given_inertia and not records[0].normalised:
        prior = InertiaPrior(apparent_inertia(vehicle, axis), options.inertia_sd)
    fit = fit_axis(
        records,
        axis,
        inertia=prior,
        drive=ForceDrive(lag_s=options.lag_s),
        surge=options.surge_in_heave,
        try_lag=options.fit_lag,
    )
    names = list(using)
    checked = {
        key: leg
        for key, leg in legs.items()
        if leg.windows.use == "validation" and not _idle(leg.record, axis)
    }
    motions = _motions(fit, using)
    judged = {key: _flown(fit, key, leg) for key, leg in checked.items()}
    judgements = [
        HeldOutFit(_words(item.what, names), item.percent[fit.velocity], item.windows)
        for item in fit.held_out
    ]
    judgements += [
        HeldOutFit(f"validation leg {key}", motion_percent([part]), len(part.windows))
        for key, part in judged.items()
    ]
    every = [*motions.values(), *judged.values()]
    rates = np.concatenate([_inside(part)[0] for part in motions.values()])
    errors = np.concatenate([np.subtract(*_inside(part)) for part in motions.values()])
    differ = [item for item in fit.legs if item.differ]
    word = AXIS_WORDS[axis].capitalize()
    warnings = [
        f"{word}: the dives differ by more than chance in {item.quantity} (largest over smallest"
        f" {item.ratio:.2g}): this model is their mean."
        for item in differ
    ]
    if fit.sides is not None and fit.sides.differ:
        warnings.append(
            f"{word}: drag ahead is {fit.sides.ratio:.2g} times that back"
            f" ({fit.sides.low:.2g} to {fit.sides.high:.2g}): a tether, or a hull that is not alike"
            " both ways."
        )
    return FittedAxis(
        equation=_equation(fit),
        held_out=tuple(judgements),
        training_percent=motion_percent(motions.values()),
        rate_rms=fit.speed,
        error_rms=float(np.sqrt(np.mean(errors**2))),
        speeds=VelocityRange(rms=fit.speed, low=float(rates.min()), high=float(rates.max())),
        samples=int(rates.size),
        windows=fit.fit.windows,
        seconds=sum(
            float(part.t_s[last - 1] - part.t_s[first])
            for part in motions.values()
            for first, last in part.windows
        ),
        measured_by=next(iter(using.values())).windows.measured_by[axis],  # type: ignore[index]
        lag_s=fit.lag.value_s,
        lag_error_s=fit.lag.standard_error if fit.lag.determined else 0.0,
        lag_verdict="identified" if fit.lag.determined else "assumed",
        dead_band=fit.fit.drive.dead_band,
        curve=fit.fit.drive.curve,
        inertia=fit.inertia.word,
        quantities=fit.without_newtons(),
        warnings=tuple(warnings),
        notes=tuple(f"{word}: {words}." for words in fit.notes),
        per_leg={part.leg: (motion_percent([part]), len(part.windows)) for part in every},
        motion=tuple(every),
        whole_legs={
            key: percent
            for key, leg in checked.items()
            if np.isfinite(percent := _whole_leg(fit, leg.record, judged[key].windows))
        },
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


def _motions(fit: SingleAxisFit, using: Mapping[str, LegData]) -> dict[str, AxisMotion]:
    """Return the axis on each leg, simulated over windows from measured starts."""
    rows = loop_rows(replace(fit.pool, drive=fit.fit.drive, free=()), fit.fit.drive)
    out = {}
    for number, (key, leg) in enumerate(using.items()):
        windows = [(w.first, w.end) for w in fit.pool.windows if w.leg == number]
        if windows:
            out[key] = _simulated(fit, key, leg, number, rows[number], windows)
    return out


def _flown(fit: SingleAxisFit, key: str, leg: LegData) -> AxisMotion:
    """Return the axis on a leg that the fit did not use."""
    windows = windows_of([leg.record], (fit.velocity,))
    pool = make_pool(
        fit.pool.structure,
        [leg.record],
        windows,
        constant_sd=fit.pool.constant_sd,
        drive=fit.fit.drive,
        extra=_extra(fit, leg.record),
    )
    own = replace(fit, pool=pool)
    rows = loop_rows(pool, fit.fit.drive)
    return _simulated(own, key, leg, 0, rows[0], [(w.first, w.end) for w in windows])


def _extra(fit: SingleAxisFit, record: AxisRecord) -> tuple[dict[str, Array], ...]:
    """Return the inputs of a record beside its forces."""
    return ({SURGE: surge_input(record)},) if SURGE in fit.pool.structure.inputs else ()


def _whole_leg(fit: SingleAxisFit, record: AxisRecord, windows: Sequence[tuple[int, int]]) -> float:
    """Return the fit [%] of one free run from the first window to the last."""
    span = MotionWindow(0, windows[0][0], windows[-1][1])
    pool = make_pool(
        fit.pool.structure,
        [record],
        [span],
        constant_sd=fit.pool.constant_sd,
        drive=fit.fit.drive,
        extra=_extra(fit, record),
    )
    start = np.append(pool.prepared[0].start[span.first], 0.0)
    theta = fit.fit.values[: len(pool.structure.terms)]
    rate = motion(pool, loop_rows(pool, fit.fit.drive)[0], theta, span, start)[:, 0, 0]
    if not np.isfinite(rate).all():
        return float("nan")
    if not depth_measures(record, fit.velocity):
        return percent_of(record.rate[fit.velocity][span.nodes], rate)
    step = float(record.t_s[1] - record.t_s[0])
    simulated = low_passed(rate * turn_of(record)[span.nodes], step)
    return percent_of(depth_rate(record)[span.nodes], simulated)


def _simulated(
    fit: SingleAxisFit,
    key: str,
    leg: LegData,
    number: int,
    rows: Array,
    windows: Sequence[tuple[int, int]],
) -> AxisMotion:
    pool = replace(fit.pool, drive=fit.fit.drive, free=())
    record, data = leg.record, pool.prepared[number]
    theta = fit.fit.values[: len(pool.structure.terms)]
    every = [w for w in pool.windows if w.leg == number]
    rate, depth = (np.full(len(record.t_s), np.nan) for _ in range(2))
    for window in every:
        start = np.append(data.start[window.first], 0.0)
        states = motion(pool, rows, theta, window, start)[:, :, 0]
        rate[window.nodes], depth[window.nodes] = states[:, 0], states[:, 1]
    measured = record.rate[fit.velocity]
    if not depth_measures(record, fit.velocity):
        return AxisMotion(fit.axis, key, record.t_s, _only(measured, rate), rate, tuple(windows))
    turn = turn_of(record)
    step = float(record.t_s[1] - record.t_s[0])
    for window in every:
        rate[window.nodes] = low_passed(rate[window.nodes] * turn[window.nodes], step)
    return AxisMotion(
        fit.axis,
        key,
        record.t_s,
        _only(depth_rate(record), rate),
        rate,
        tuple(windows),
        record.depth_m,
        depth,
    )


def _only(measured: Array, simulated: Array) -> Array:
    """Return what was measured where something was simulated, nan elsewhere."""
    return np.where(np.isfinite(simulated), measured, np.nan)


def _inside(part: AxisMotion) -> tuple[Array, Array]:
    """Return measured and simulated rates where both are."""
    both = np.isfinite(part.measured) & np.isfinite(part.simulated)
    return part.measured[both], part.simulated[both]


def motion_percent(parts: Collection[AxisMotion]) -> float:
    """Return the fit [%] of the rate over all windows of some legs."""
    measured, simulated = (np.concatenate(x) for x in zip(*map(_inside, parts), strict=True))
    return percent_of(measured, simulated)


def _words(what: str, names: Sequence[str]) -> str:
    """Return what was held out, a leg by its name: `leg 1` -> `leg dive_2`."""
    kind, _, number = what.partition(" ")
    return f"leg {names[int(number)]}" if kind == "leg" and number.isdigit() else what
