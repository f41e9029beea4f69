"""Commands on another clock than the motion: of a leg, or of all legs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.axis_figures import FORCE
from auvid.hydro.identification.axes.drive import DELAY, LAG
from auvid.hydro.identification.axes.pooled_fit import (
    PoolFit,
    fit_pool,
    loop_rows,
    make_pool,
    motion,
)
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.axes.windows import windows_of
from auvid.hydro.identification.regression.verdicts import T_LIMIT
from auvid.stages.fit_axes.fitted import FittedAxis, FlownAxis, LegClock
from auvid.stages.fit_axes.flight import LegData, idle

SHIFTS_S = np.arange(-1.0, 1.01, 0.1)
"""Shifts of the commands that are tried."""
LEAST_LATE_S, WORTH = 0.15, 0.9
"""A clock is another one from so much on, where the error falls to this share by it."""
OF_A_MEDIAN = 1.25
"""Error of a median over that of a mean, of normal errors."""
PARABOLA_S = 0.01
"""Deviation of the least error between shifts: of made-up legs it was .012 s off (rms)."""
MOST_PASSES = 3
"""Fits that moved commands give tell the rest of a shift better."""
AXIS_DELAY_S = 0.03
"""What delays of axes differ by beside their errors: thrusters of one vehicle, one frame."""


class ShiftErrors(NamedTuple):
    """Errors of an axis on a leg, by shift.

    Sums of sizes (shifts,), of squares by window (w, shifts), and samples (w,).
    """

    size: Array
    squares: Array
    samples: Array


@dataclass(frozen=True)
class LegShift:
    """Shift of least error of a leg, its standard error, log of the error by shift."""

    best_s: float
    error_s: float
    curve: Array


def late_commands(tried: Sequence[FittedAxis], legs: Mapping[str, LegData]) -> dict[str, LegClock]:
    """Return how late commands of legs are stamped, of those on another clock.

    The fits of all legs fly each leg by commands that are moved in time; the lag of the
    actuators moves all legs alike, so that a leg counts against the median of all, or of two
    against the one that is nearer to none. Newtons have checks of their own.
    """
    shifts = _shifts(tried, legs)
    out = {}
    for key, clock in _against_others(shifts).items():
        own = shifts[key]
        here, there = (
            float(np.interp(at, SHIFTS_S, own.curve))
            for at in (own.best_s, own.best_s - clock.late_s)
        )
        if abs(clock.late_s) >= LEAST_LATE_S and here - there < np.log(WORTH):
            out[key] = clock
    return out


def corrected(
    clocks: Mapping[str, LegClock], tried: Sequence[FittedAxis], legs: Mapping[str, LegData]
) -> dict[str, LegClock]:
    """Return clocks with the rest of their shifts, as fits of moved commands show it.

    legs: moved by `clocks`. None where what is left lies within its error.
    """
    rest = _against_others(_shifts(tried, legs))
    if all(abs(rest[key].late_s) <= rest[key].error_s for key in clocks if key in rest):
        return {}
    return {
        key: LegClock(clock.late_s + rest[key].late_s, rest[key].error_s) if key in rest else clock
        for key, clock in clocks.items()
    }


def clock_of_all(tried: Sequence[FittedAxis], legs: Mapping[str, LegData]) -> LegClock | None:
    """Return how late commands of all legs are stamped, None where they are not.

    A delay beside a free lag: below 0 of a clock, above 0 (late_s below 0) also of a link.
    It counts from `LEAST_LATE_S` on, where axes agree and the errors fall to `WORTH` of those
    by the free lag alone. Newtons have checks of their own, and a depth is late itself.
    """
    if not all(leg.windows.normalised for leg in legs.values()):
        return None
    delays, errors, fits = [], [], []
    for item in tried:
        flown = item.flown
        if flown is None or item.measured_by == "depth" or item.equation.value(FORCE) <= 0.0:
            continue
        late = _lagged(flown, LAG, DELAY)
        error = float(np.sqrt(late.covariance[-1, -1]))
        if late.at_bound[-1] or not 0.0 < error < np.inf:
            continue
        delays.append(float(late.values[-1]))
        errors.append(float(np.hypot(error, AXIS_DELAY_S)))
        fits.append((flown, late))
    if not delays:
        return None
    weights = np.array(errors) ** -2.0
    delay_s = float(np.average(delays, weights=weights))
    off = np.abs(np.array(delays) - delay_s) / np.array(errors)
    if abs(delay_s) < LEAST_LATE_S or np.any(off > T_LIMIT):
        return None
    ratios = [_logarithm_of_errors(flown, late, _lagged(flown, LAG)) for flown, late in fits]
    if np.mean(ratios) > np.log(WORTH):
        return None
    return LegClock(-delay_s, float(weights.sum() ** -0.5))


def _lagged(flown: FlownAxis, *parameters: str) -> PoolFit:
    """Return the fit of an axis with parameters of its drive free beside its own."""
    begin = flown.fit.values[: len(flown.pool.structure.terms)]
    free = tuple(name for name in flown.pool.free if name != LAG)
    return fit_pool(replace(flown.pool, free=(*free, *parameters)), begin)


def _logarithm_of_errors(flown: FlownAxis, one: PoolFit, other: PoolFit) -> float:
    """Return the mean logarithm of the errors of a fit over those of another."""
    measured = np.isfinite(flown.pool.prepared[0].channels).any(axis=0)
    return float(np.mean(np.log(one.sigma[measured] / other.sigma[measured])))


def _shifts(tried: Sequence[FittedAxis], legs: Mapping[str, LegData]) -> dict[str, LegShift]:
    """Return where each leg is flown best; none in newtons, or of one leg."""
    if len(legs) < 2 or not all(leg.windows.normalised for leg in legs.values()):
        return {}
    out = {}
    for key, leg in legs.items():
        flown = [i.flown for i in tried if i.flown is not None and not idle(leg.record, i.axis)]
        axes = [part for item in flown if (part := _errors(item, leg.record)) is not None]
        if axes:
            out[key] = _least(axes)
    return out


def _against_others(shifts: Mapping[str, LegShift]) -> dict[str, LegClock]:
    """Return the shift of each leg against the others; none of a single leg.

    >>> legs = {str(n): LegShift(late, 0.02, SHIFTS_S) for n, late in enumerate([0.0, 0.0, 0.4])}
    >>> _against_others(legs)["2"].error_s.__round__(3)
    0.025
    """
    if len(shifts) < 2:
        return {}
    every = list(shifts.values())
    if len(every) > 2:
        middle = float(np.median([item.best_s for item in every]))
        mean = float(np.linalg.norm([item.error_s for item in every])) / len(every)
        error = OF_A_MEDIAN * mean
    else:
        nearer = min(every, key=lambda item: abs(item.best_s))
        middle, error = nearer.best_s, nearer.error_s
    return {
        key: LegClock(item.best_s - middle, float(np.hypot(item.error_s, error)))
        for key, item in shifts.items()
    }


def _least(axes: Sequence[ShiftErrors]) -> LegShift:
    """Return where the squares of the errors are least, of each axis over its least.

    The error of the shift leaves windows out in turn.
    """
    curve = np.mean([np.log(own.size / own.samples.sum()) for own in axes], axis=0)
    squares = [own.squares.sum(axis=0) for own in axes]
    least = [float(total.min()) for total in squares]

    def best(totals: Sequence[Array]) -> float:
        shares = [own / of for own, of in zip(totals, least, strict=True)]
        return _least_at(np.sum(shares, axis=0))

    moved = [
        best([*squares[:place], squares[place] - window, *squares[place + 1 :]])
        for place, own in enumerate(axes)
        for window in own.squares
    ]
    spread = float(np.sqrt((len(moved) - 1) * np.var(moved))) if len(moved) > 1 else np.inf
    error_s = float(np.hypot(spread, PARABOLA_S))
    return LegShift(best(squares), error_s, np.asarray(curve))


def on_one_clock(
    legs: Mapping[str, LegData], clocks: Mapping[str, LegClock], common: LegClock | None
) -> Mapping[str, LegData]:
    """Return legs whose commands are moved to the clock of their motion."""
    late = {key: clock.late_s for key, clock in clocks.items()}
    if common is not None:
        late = {key: late.get(key, 0.0) + common.late_s for key in legs}
    return {
        key: replace(leg, record=_moved(leg.record, late[key])) if key in late else leg
        for key, leg in legs.items()
    }


def clock_doubts(
    legs: Mapping[str, LegData], clocks: Mapping[str, LegClock], common: LegClock | None
) -> dict[str, dict[str, AxisRecord]]:
    """Return legs with the clock of each, and of all, moved by one deviation."""
    every = {}
    if common is not None:
        moved = {key: _moved(leg.record, common.error_s) for key, leg in legs.items()}
        every = {"clock of all legs": moved}
    return every | {
        f"clock of {key}": {key: _moved(legs[key].record, clock.error_s)}
        for key, clock in clocks.items()
        if np.isfinite(clock.error_s)
    }


def clock_words(clocks: Mapping[str, LegClock], common: LegClock | None = None) -> list[str]:
    """Return a sentence on each leg whose commands are on another clock, and on all."""
    every = []
    if common is not None:
        early = common.late_s < 0.0
        every = [
            f"The motion answers the commands {abs(common.late_s):.2f} s (standard error"
            f" {common.error_s:.2g}) {'late' if early else 'early'} in all legs, beside the lag of"
            f" the actuators: two clocks{', or a link that delays' if early else ''}. The fits have"
            " the commands moved by that, and its error is in the intervals; the model is without"
            " it."
        ]
    return every + [
        f"Leg {leg}: its commands are stamped {abs(clock.late_s):.2f} s"
        + (f" (standard error {clock.error_s:.2g})" if np.isfinite(clock.error_s) else "")
        + f" too {'late' if clock.late_s > 0.0 else 'early'} for its motion, as against the other"
        " legs (two clocks); the fits have them moved by that, and its error is in the intervals."
        for leg, clock in clocks.items()
    ]


def _moved(record: AxisRecord, late_s: float) -> AxisRecord:
    """Return a record whose forces act so much earlier."""
    at = record.t_s + late_s
    force = {axis: np.interp(at, record.t_s, own) for axis, own in record.force.items()}
    thrusters = record.thrusters
    if thrusters is not None:
        columns = [np.interp(at, record.t_s, column) for column in thrusters.force.T]
        thrusters = thrusters._replace(force=np.column_stack(columns))
    return replace(record, force=force, thrusters=thrusters)


def _errors(flown: FlownAxis, record: AxisRecord) -> ShiftErrors | None:
    """Return errors of an axis on a leg, by shift; None without windows."""
    structure = flown.pool.structure
    windows = windows_of([record], structure.velocities)
    if not windows or len(structure.velocities) > 1 or set(structure.inputs) - set(record.force):
        return None
    sizes, squares = [], []
    for shift in SHIFTS_S:
        pool = make_pool(
            structure, [_moved(record, float(shift))], windows,
            constant_sd=flown.pool.constant_sd, drive=flown.fit.drive,
        )  # fmt: skip
        rows, data = loop_rows(pool, flown.fit.drive)[0], pool.prepared[0]
        errors = []
        for window in windows:
            start = np.append(data.start[window.first], np.zeros(1))
            states = motion(pool, rows, flown.theta, window, start)[:, :, 0]
            errors.append(states - data.channels[window.nodes])
        sizes.append(np.nansum([np.nansum(np.abs(item)) for item in errors]))
        squares.append([np.nansum(item**2) for item in errors])
    count = np.array([np.isfinite(item).sum() for item in errors])
    return ShiftErrors(np.array(sizes), np.array(squares).T, count)


def _least_at(curve: Array) -> float:
    """Return where a curve over the shifts is least, by a parabola.

    >>> round(_least_at((SHIFTS_S - 0.43) ** 2), 3)
    0.43
    """
    at = int(np.clip(np.argmin(curve), 1, len(curve) - 2))
    left, middle, right = curve[at - 1 : at + 2]
    bend = left - 2.0 * middle + right
    step = 0.5 * (left - right) / bend if bend > 0.0 else 0.0
    return float(SHIFTS_S[at] + np.clip(step, -1.0, 1.0) * (SHIFTS_S[1] - SHIFTS_S[0]))
