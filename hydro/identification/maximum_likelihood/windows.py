"""Windows of legs as arrays for the compiled loop: steps, inputs, samples, a start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NoReturn

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.maximum_likelihood.records import CHANNELS, SENSORS, LegRecord

LONGEST_STEP_S = 0.04
FEWEST_SAMPLES = 30
"""Scalar samples of a window, three for each free number of its start."""
SHORTEST_WINDOW_S = 5.0
"""Shortest window of a leg that is shorter than the length asked for [s]; shorter parts of
a leg are left out from the start."""
MOST_NAMED = 5


@dataclass(frozen=True)
class Window:
    """A stretch of a leg between two of its moments `t_s` (N + 1,).

    `steps` (N,) [s]; `measured` (N + 1, 13), nan without a sample; `leg`: its number.
    """

    leg: int
    t_s: Array
    measured: Array

    @property
    def steps(self) -> Array:
        """Return the lengths (N,) of the steps [s]."""
        return np.diff(self.t_s)

    @property
    def samples(self) -> int:
        """Return how many scalar samples the window has."""
        return int(np.isfinite(self.measured).sum())

    @property
    def stations(self) -> Array:
        """Return the ends and middles (2N + 1,) of all steps [s]."""
        middle = 0.5 * (self.t_s[1:] + self.t_s[:-1])
        return np.insert(self.t_s, np.arange(1, len(self.t_s)), middle)


@dataclass(frozen=True)
class DroppedWindow:
    """A stretch of a leg that takes no part, and why."""

    leg: str
    start_s: float
    end_s: float
    reason: str

    def __str__(self) -> str:
        return f"'{self.leg}' from {self.start_s:.1f} to {self.end_s:.1f} s: {self.reason}"


def cut_windows(
    legs: Sequence[LegRecord], *, length_s: float | None
) -> tuple[list[Window], list[DroppedWindow]]:
    """Return windows of `length_s` and more that cover every leg, or legs as they are.

    A leg is cut into equal windows, as many as make them no shorter than `length_s`; a
    shorter leg is one window, down to `SHORTEST_WINDOW_S`. Windows with fewer than
    `FEWEST_SAMPLES` are dropped. Raises `DataError` where no window is left.
    """
    shortest_s = 0.0 if length_s is None else min(length_s, SHORTEST_WINDOW_S)
    windows, dropped = [], []
    for number, leg in enumerate(legs):
        start, end = leg.span_s()
        if end - start < shortest_s * (1.0 - 1e-9):
            reason = f"{end - start:.3g} s, shorter than the shortest window of {shortest_s:g} s"
            dropped.append(DroppedWindow(leg.name, start, end, reason))
            continue
        count = 1 if length_s is None else max(int((end - start) / length_s + 1e-9), 1)
        edges = np.linspace(start, end, count + 1)
        for low, high in pairwise(edges.tolist()):
            window = _window(number, leg, float(low), float(high), high == end)
            if window.samples < FEWEST_SAMPLES:
                reason = f"{window.samples} samples, fewer than {FEWEST_SAMPLES}"
                dropped.append(DroppedWindow(leg.name, low, high, reason))
            else:
                windows.append(window)
    if not windows:
        _refuse(dropped, shortest_s)
    return windows, dropped


def _refuse(dropped: Sequence[DroppedWindow], shortest_s: float) -> NoReturn:
    """Raise `DataError` that says of each leg why it gives no window."""
    raise DataError(
        "no leg gives a window",
        value="; ".join(str(item) for item in dropped[:MOST_NAMED]),
        allowed=f"windows of {shortest_s:g} s and more with {FEWEST_SAMPLES} samples and more",
        remedy="Take longer legs, or sensors with more samples.",
    )


def _window(number: int, leg: LegRecord, start: float, end: float, last: bool) -> Window:
    moments, parts = [], []
    for name, record in leg.sensors.items():
        inside = (record.t_s >= start) & ((record.t_s <= end) if last else (record.t_s < end))
        moments.append(record.t_s[inside])
        parts.append((SENSORS[name], record.t_s[inside], record.values[inside]))
    # Moments closer than a microsecond are one.
    t = np.unique(np.round(np.concatenate([[start, end], *moments]), 6))
    extra = [
        np.linspace(a, b, int(np.ceil((b - a) / LONGEST_STEP_S)) + 1)[1:-1]
        for a, b in pairwise(t.tolist())
        if b - a > LONGEST_STEP_S
    ]
    t = np.sort(np.concatenate([t, *extra]))
    measured = np.full((len(t), len(CHANNELS)), np.nan)
    for channels, times, values in parts:
        measured[np.searchsorted(t, np.round(times, 6) - 5e-7), channels] = values
    return Window(number, t, measured)


def actuator_inputs(
    leg: LegRecord, window: Window, vehicle: Vehicle, lag_s: float
) -> tuple[Array, Array]:
    """Return inputs and their derivative by the lag at a window's stations (s, 12).

    Propeller speed, level speed u_c(n), fins, force; T y_dot = u - y for the lagged
    inputs y, exact for inputs u linear between their samples, and dy/dT = -y_dot * (T /
    T) ... filtered once more: T d(y')  = -y_dot - y', y' = dy/dT.
    """
    record, stations = leg.actuators, window.stations
    t, values = record.t_s, record.columns()
    if lag_s > 0.0:
        # Imported here, since numba takes a second.
        from auvid.hydro.identification.bench.compiled_loops import filter_first_order

        lagged = filter_first_order(
            np.diff(t), 1.0 / lag_s, values[:-1] / lag_s, values[1:] / lag_s, values[0]
        )
        slope = (values - lagged) / lag_s
        tangent = filter_first_order(
            np.diff(t), 1.0 / lag_s, -slope[:-1] / lag_s, -slope[1:] / lag_s, np.zeros(11)
        )
    else:
        lagged, tangent = values, -np.gradient(values, t, axis=0)
    inputs, along = np.zeros((len(stations), 12)), np.zeros((len(stations), 12))
    for source, out in ((lagged, inputs), (tangent, along)):
        for column, place in enumerate([0, *range(2, 12)]):
            out[:, place] = np.interp(stations, t, source[:, column])
    if vehicle.propeller is not None:
        inputs[:, 1] = np.nan_to_num(level_speed(vehicle.propeller, inputs[:, 0]))
    return inputs, along
