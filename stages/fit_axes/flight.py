"""A fitted axis flown over windows and legs, with the axes fitted with it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from auvid.data_schemas.records.axes import AxisWindowsRecord
from auvid.data_schemas.records.models import VelocityRange
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.identification.axes.held_out import (
    HeldOut,
    free_run,
    percent_of,
    signals,
    span_of,
)
from auvid.hydro.identification.axes.pooled_fit import loop_rows, make_pool, motion
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.axes.single_axis import SURGE, surge_input
from auvid.hydro.identification.axes.structure import ASIDE, HULL
from auvid.hydro.identification.axes.windows import (
    depth_measures,
    depth_rate,
    low_passed,
    turn_of,
    windows_of,
)
from auvid.stages.fit_axes.fitted import (
    ArmChoice,
    AxisMotion,
    FlownAxis,
    HeldOutFit,
    JudgedMotion,
)
from auvid.stages.page.first_screen import AXIS_WORDS


@dataclass(frozen=True)
class LegData:
    """The record of a leg, and how it was made.

    doubts: figure that the record rests on -> the record with it one deviation off.
    """

    record: AxisRecord
    windows: AxisWindowsRecord
    doubts: Mapping[str, AxisRecord] = field(default_factory=dict)


@dataclass(frozen=True)
class FitOptions:
    """What to fit: axes (none: all that the legs give), lag, inertia that is given.

    given_inertia: axes whose apparent inertia is that of the vehicle file, with the
    relative standard deviation inertia_sd; of the others, it is free. together: whether
    axes are fitted together, `better`: where that moves better on what was held out.
    lag_sd_s: deviation of a lag that is not fitted. surge_in_heave: None decides by what is
    held out, of heave by depth.
    linear_drag: axes without quadratic drag, which are fitted one by one.
    newtons_from: what turns full commands into newtons, as `scaling.scaled` takes it.
    marker_arm: whether velocities have the arm of the file or the one that the legs show.
    """

    axes: Collection[str] = ()
    lag_s: float = 0.05
    fit_lag: bool = True
    lag_sd_s: float = 0.0
    fit_curve: bool = False
    given_inertia: Collection[str] = ("X", "Y", "Z")
    inertia_sd: float = 0.3
    surge_in_heave: bool | None = None
    linear_drag: Collection[str] = ()
    together: str = "better"
    newtons_from: Literal["pull", "mass"] = "pull"
    marker_arm: ArmChoice = "where_assumed"


def doubts_of(using: Mapping[str, LegData]) -> list[list[AxisRecord]]:
    """Return the records with a figure that they rest on one deviation off, each."""
    figures = dict.fromkeys(name for leg in using.values() for name in leg.doubts)
    return [[leg.doubts.get(name, leg.record) for leg in using.values()] for name in figures]


def motions_of(flown: FlownAxis, using: Mapping[str, LegData]) -> dict[str, AxisMotion]:
    """Return the axis on each training leg, window by window from measured starts."""
    pool = replace(flown.pool.without(HULL, ASIDE), drive=flown.fit.drive, free=())
    rows = loop_rows(pool, flown.fit.drive)
    out = {}
    for number, (key, leg) in enumerate(using.items()):
        if any(w.leg == number for w in flown.pool.windows):
            out[key] = _simulated(flown, key, leg, number, rows[number])
    return out


def flown_leg(flown: FlownAxis, key: str, leg: LegData) -> tuple[AxisMotion, float]:
    """Return the axis on a leg not used, and the fit [%] of one free run over it.

    The free run goes from the first window to the last; nan where it diverges.
    """
    structure = flown.pool.structure
    extra = {SURGE: surge_input(leg.record)} if SURGE in structure.inputs else {}
    for name in {HULL, ASIDE}.intersection(structure.inputs):
        extra[name] = np.zeros(len(leg.record.t_s))
    pool = make_pool(
        structure,
        [leg.record],
        windows_of([leg.record], structure.velocities),
        constant_sd=flown.pool.constant_sd,
        drive=flown.fit.drive,
        extra=(extra,),
    )
    own = replace(flown, pool=pool)
    span = span_of(pool, 0)
    states = free_run(pool, flown.fit, span)
    one_run = np.nan
    if np.isfinite(states).all():
        one_run = percent_of(*signals(pool, span, states)[own.place])
    return _simulated(own, key, leg, 0, loop_rows(pool, flown.fit.drive)[0]), one_run


def _simulated(flown: FlownAxis, key: str, leg: LegData, number: int, rows: Array) -> AxisMotion:
    pool = replace(flown.pool, drive=flown.fit.drive, free=())
    record, data = leg.record, pool.prepared[number]
    k, place = len(pool.structure.velocities), flown.place
    every = [w for w in pool.windows if w.leg == number]
    windows = tuple((w.first, w.end) for w in every)
    rate, depth = (np.full(len(record.t_s), np.nan) for _ in range(2))
    for window in every:
        start = np.append(data.start[window.first], np.zeros(k))
        states = motion(pool, rows, flown.theta, window, start)[:, :, 0]
        rate[window.nodes], depth[window.nodes] = states[:, place], states[:, k + place]
    measured = record.rate[flown.velocity]
    if not depth_measures(record, flown.velocity):
        return AxisMotion(flown.axis, key, record.t_s, _only(measured, rate), rate, windows)
    turn = turn_of(record)
    step = float(record.t_s[1] - record.t_s[0])
    for window in every:
        rate[window.nodes] = low_passed(rate[window.nodes] * turn[window.nodes], step)
    return AxisMotion(
        flown.axis,
        key,
        record.t_s,
        _only(depth_rate(record), rate),
        rate,
        windows,
        record.depth_m,
        depth,
    )


def _only(measured: Array, simulated: Array) -> Array:
    """Return what was measured where something was simulated, nan elsewhere."""
    return np.where(np.isfinite(simulated), measured, np.nan)


def inside(part: AxisMotion) -> tuple[Array, Array]:
    """Return measured and simulated rates where both are."""
    both = np.isfinite(part.measured) & np.isfinite(part.simulated)
    return part.measured[both], part.simulated[both]


def motion_percent(parts: Collection[AxisMotion]) -> float:
    """Return the fit [%] of the rate over all windows of some legs."""
    measured, simulated = (np.concatenate(x) for x in zip(*map(inside, parts), strict=True))
    return percent_of(measured, simulated)


def pushed(records: Sequence[AxisRecord], axis: str) -> bool:
    """Return whether the force on an axis ever acts."""
    forces = [record.force[axis] for record in records]
    return any(np.isfinite(force).any() and np.nanmax(np.abs(force)) > 0.0 for force in forces)


def idle(record: AxisRecord, axis: str) -> bool:
    """Return whether a record has no window of an axis."""
    return not record.windows.get(axis)


def judged(
    flown: FlownAxis,
    held_out: Sequence[HeldOut],
    using: Mapping[str, LegData],
    legs: Mapping[str, LegData],
    *,
    rms: float,
) -> JudgedMotion:
    """Return how a fitted axis moves on training, held-out and validation legs.

    rms: of its velocity over the windows.
    """
    names, velocity, axis = list(using), flown.velocity, flown.axis
    motions = motions_of(flown, using)
    checks = {
        key: flown_leg(flown, key, leg)
        for key, leg in legs.items()
        if leg.windows.use == "validation"
        and not idle(leg.record, axis)
        and windows_of([leg.record], flown.pool.structure.velocities)
    }
    judgements = held_out_fits(held_out, velocity, names)
    judgements += [
        HeldOutFit(f"validation leg {key}", motion_percent([part]), len(part.windows), one_run)
        for key, (part, one_run) in checks.items()
    ]
    every = [*motions.values(), *(part for part, _ in checks.values())]
    rates = np.concatenate([inside(part)[0] for part in motions.values()])
    errors = np.concatenate([np.subtract(*inside(part)) for part in motions.values()])
    return {
        "held_out": tuple(judgements),
        "training_percent": motion_percent(motions.values()),
        "error_rms": float(np.sqrt(np.mean(errors**2))),
        "speeds": VelocityRange(rms=rms, low=float(rates.min()), high=float(rates.max())),
        "samples": int(rates.size),
        "windows": flown.fit.windows,
        "seconds": sum(
            float(part.t_s[last - 1] - part.t_s[first])
            for part in motions.values()
            for first, last in part.windows
        ),
        "per_leg": {part.leg: (motion_percent([part]), len(part.windows)) for part in every},
        "motion": tuple(every),
        "flown": flown,
        "whole_legs": {
            key: one_run for key, (_, one_run) in checks.items() if np.isfinite(one_run)
        },
        "unused_legs": {
            key: _why_unused(leg, axis, flown.pool.structure.velocities)
            for key, leg in legs.items()
            if idle(leg.record, axis) or (key not in motions and key not in checks)
        },
    }


def _why_unused(leg: LegData, axis: str, velocities: Sequence[str]) -> str:
    """Return why a leg neither fits nor judges an axis.

    velocities: of the fit; a common one needs windows that they share.
    """
    record = leg.record
    lacking = [AXES[VELOCITIES.index(v)] for v in velocities if not _measures(record, v)]
    if axis in lacking:
        return "not measured"
    if not pushed([record], axis):
        return "not commanded"
    if idle(record, axis):
        reasons = {item.reason for item in record.left_out if item.axis == axis}
        return "; ".join(sorted(reasons)) or "no window"
    if lacking:
        words = ", ".join(AXIS_WORDS[item] for item in lacking)
        return f"{words} not measured, which the common fit needs"
    return "no window that the axes fitted together share"


def _measures(record: AxisRecord, velocity: str) -> bool:
    depth = record.depth_m is not None and bool(np.isfinite(record.depth_m).any())
    return bool(np.isfinite(record.rate[velocity]).any()) or (velocity == "w" and depth)


def held_out_fits(
    held_out: Sequence[HeldOut], velocity: str, names: Sequence[str]
) -> list[HeldOutFit]:
    """Return what was held out of one velocity, legs by their names."""
    return [
        HeldOutFit(
            _words(item.what, names),
            item.percent[velocity],
            item.windows,
            item.one_run.get(velocity),
        )
        for item in held_out
        if velocity in item.percent
    ]


def _words(what: str, names: Sequence[str]) -> str:
    """Return what was held out, a leg by its name: `leg 1` -> `leg dive_2`."""
    kind, _, number = what.partition(" ")
    return f"leg {names[int(number)]}" if kind == "leg" and number.isdigit() else what
