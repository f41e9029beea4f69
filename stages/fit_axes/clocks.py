"""Commands of a leg on another clock than its motion, against the other legs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.axes.pooled_fit import loop_rows, make_pool, motion
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.axes.windows import windows_of
from auvid.stages.fit_axes.fitted import FittedAxis, FlownAxis
from auvid.stages.fit_axes.flight import LegData, idle

SHIFTS_S = np.arange(-1.0, 1.01, 0.1)
"""Shifts of the commands that are tried."""
LEAST_LATE_S, WORTH = 0.15, 0.9
"""A clock is another one from so much on, where the error falls to this share by it."""


def late_commands(tried: Sequence[FittedAxis], legs: Mapping[str, LegData]) -> dict[str, float]:
    """Return how late [s] commands of legs are stamped, of those on another clock.

    The fits of all legs fly each leg by commands that are moved in time; the lag of the
    actuators moves all legs alike, so that a leg counts against the median of all, or of two
    against the one that is nearer to none. Newtons have checks of their own.
    """
    if len(legs) < 2 or not all(leg.windows.normalised for leg in legs.values()):
        return {}
    curves = {}
    for key, leg in legs.items():
        flown = [i.flown for i in tried if i.flown is not None and not idle(leg.record, i.axis)]
        errors = [_errors(item, leg.record) for item in flown]
        parts = [np.log(part) for part in errors if part is not None]
        if parts:
            curves[key] = np.mean(parts, axis=0)
    best = {key: _least_at(curve) for key, curve in curves.items()}
    if len(best) < 2:
        return {}
    shifts = np.array(list(best.values()))
    middle = float(np.median(shifts)) if len(best) > 2 else float(min(shifts, key=abs))
    out = {}
    for key, shift in best.items():
        here, there = (float(np.interp(at, SHIFTS_S, curves[key])) for at in (shift, middle))
        if abs(shift - middle) >= LEAST_LATE_S and here - there < np.log(WORTH):
            out[key] = shift - middle
    return out


def on_one_clock(legs: Mapping[str, LegData], late_s: Mapping[str, float]) -> Mapping[str, LegData]:
    """Return legs whose commands are moved to the clock of their motion."""
    return {
        key: replace(leg, record=_moved(leg.record, late_s[key])) if key in late_s else leg
        for key, leg in legs.items()
    }


def clock_words(late_s: Mapping[str, float]) -> list[str]:
    """Return a sentence on each leg whose commands are on another clock."""
    return [
        f"Leg {leg}: its commands are stamped {abs(shift):.2f} s too"
        f" {'late' if shift > 0.0 else 'early'} for its motion, as against the other legs (two"
        " clocks); the fits have them moved by that."
        for leg, shift in late_s.items()
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


def _errors(flown: FlownAxis, record: AxisRecord) -> Array | None:
    """Return the mean error of an axis on a leg, by shift; None without windows."""
    structure = flown.pool.structure
    windows = windows_of([record], structure.velocities)
    if not windows or len(structure.velocities) > 1 or set(structure.inputs) - set(record.force):
        return None
    out = []
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
            errors.append(np.abs(states - data.channels[window.nodes]).ravel())
        out.append(float(np.nanmean(np.concatenate(errors))))
    return np.array(out)


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
