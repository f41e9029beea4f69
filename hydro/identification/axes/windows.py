"""Windows of several records, their starting values, and how they are held out."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array, runs_of
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.signals.filters import zero_phase_lowpass

WINDOW_S, SHORTEST_S = 10.0, 3.0
"""Length to which stretches are cut, and the least that is kept."""
SMOOTHING_HZ = 1.0
"""Low-pass of depth before it is differentiated, for scores and starting values."""
SMOOTHING_SHARE = 0.4
"""Of the sample rate: a slow log is low-passed no higher than that."""
IDLE_SHARE = 0.02
"""A leg that moves a force by less than this share of the largest does not drive it."""


@dataclass(frozen=True)
class MotionWindow:
    """Nodes first .. end - 1 of record `leg`."""

    leg: int
    first: int
    end: int

    @property
    def nodes(self) -> slice:
        """Return its nodes."""
        return slice(self.first, self.end)


def depth_measures(record: AxisRecord, velocity: str) -> bool:
    """Return whether an axis is fitted to depth: heave without its velocity."""
    return (
        velocity == "w" and record.depth_m is not None and not np.isfinite(record.rate["w"]).any()
    )


def measured_rate(record: AxisRecord, velocity: str) -> Array:
    """Return a velocity (n,) as measured; of heave by depth where depth measures it.

    w = z_dot / (cos theta cos phi), z low-passed at `SMOOTHING_HZ`.
    """
    if not depth_measures(record, velocity):
        return record.rate[velocity]
    return depth_rate(record) / turn_of(record)


def depth_rate(record: AxisRecord) -> Array:
    """Return z_dot (n,) [m/s] of depth low-passed at `SMOOTHING_HZ`."""
    return np.asarray(np.gradient(smooth_depth(record), float(record.t_s[1] - record.t_s[0])))


def smooth_depth(record: AxisRecord) -> Array:
    """Return depth (n,) [m] low-passed at `SMOOTHING_HZ`, nan where there is none."""
    assert record.depth_m is not None
    out = np.full(len(record.t_s), np.nan)
    step = float(record.t_s[1] - record.t_s[0])
    for first, end in runs_of(np.isfinite(record.depth_m)):
        if end - first > 8:
            out[first:end] = low_passed(record.depth_m[first:end], step)
    return out


def low_passed(values: Array, step_s: float) -> Array:
    """Return values (n,) low-passed at `SMOOTHING_HZ` without delay.

    At `SMOOTHING_SHARE` of the sample rate where that is lower.
    """
    cutoff_hz = min(SMOOTHING_HZ, SMOOTHING_SHARE / step_s)
    return zero_phase_lowpass(np.arange(len(values)) * step_s, values, cutoff_hz=cutoff_hz)


def turn_of(record: AxisRecord) -> Array:
    """Return cos theta cos phi (n,), how much of w is z_dot."""
    phi, theta = record.attitude_rad[:, 0], record.attitude_rad[:, 1]
    return np.asarray(np.cos(theta) * np.cos(phi))


def _largest_force(record: AxisRecord, velocity: str) -> float:
    """Return the largest change of the force on an axis, against its median."""
    force = record.force[AXES[VELOCITIES.index(velocity)]]
    return float(np.nanmax(np.abs(force - np.nanmedian(force)), initial=0.0))


def drives(records: Sequence[AxisRecord], leg: int, velocity: str) -> bool:
    """Return whether a leg drives an axis, against the largest force of all legs."""
    largest = [_largest_force(record, velocity) for record in records]
    return largest[leg] > IDLE_SHARE * max(largest)


def windows_of(
    records: Sequence[AxisRecord], velocities: Sequence[str]
) -> tuple[MotionWindow, ...]:
    """Return the windows that all axes share, cut to equal parts of about `WINDOW_S`.

    Every axis has to be measured in them. An axis that a leg does not drive has no windows
    there, and does not limit those of the others. Parts below `SHORTEST_S` are left out.
    """
    out = []
    for leg, record in enumerate(records):
        step = float(record.t_s[1] - record.t_s[0])
        number = np.zeros((len(record.t_s), len(velocities)), dtype=np.int64)
        keep = np.isfinite(record.attitude_rad).all(axis=1)
        for i, velocity in enumerate(velocities):
            axis = AXES[VELOCITIES.index(velocity)]
            own = record.windows.get(axis, ())
            for count, (first, end) in enumerate(own, start=1):
                number[first:end, i] = count
            signal = record.depth_m if depth_measures(record, velocity) else record.rate[velocity]
            assert signal is not None
            keep &= np.isfinite(signal) & np.isfinite(record.force[axis])
            if own or drives(records, leg, velocity):
                keep &= number[:, i] > 0
        keep &= (number > 0).any(axis=1)
        changes = np.any(np.diff(number, axis=0) != 0, axis=1)
        for first, end in runs_of(np.asarray(keep)):
            edges = [first, *(first + 1 + np.flatnonzero(changes[first : end - 1])), end]
            for a, b in itertools.pairwise(edges):
                parts = max(1, round((b - a) * step / WINDOW_S))
                cuts = np.linspace(a, b, parts + 1).round().astype(int)
                out += [
                    MotionWindow(leg, int(c), int(d))
                    for c, d in itertools.pairwise(cuts)
                    if (d - c - 1) * step >= SHORTEST_S
                ]
    return tuple(out)
