"""How late a motion follows commands, and what share of it they explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, moving_mean
from auvid.hydro.kept_results import kept

DRIFT_S, LONGEST_RESPONSE_S = 10.0, 600.0
TONE_HZ, TONE_BINS, SHORTEST_TONE_S = 10.0, 2, 20.0
"""Clock of spectra; bins of the spectrum on either side that belong to a tone."""


def peak_of_parabola(x: Array, y: Array) -> float:
    """Return the place of the largest y (n,) at evenly spaced x (n,), by a parabola.

    At an end, the sample itself.
    """
    top = int(np.argmax(y))
    if top in (0, x.size - 1):
        return float(x[top])
    low, middle, high = y[top - 1 : top + 2]
    bend = low - 2.0 * middle + high
    return float(x[top] + (0.5 * (low - high) / bend if bend < 0.0 else 0.0) * (x[1] - x[0]))


@dataclass(frozen=True)
class Response:
    """Lag [s] of a motion behind commands, and the share of variance they explain.

    The share is adjusted for the number of commands.
    """

    lag_s: float
    explained: float


@kept
def response_lag(
    t_command: ArrayLike,
    command: ArrayLike,
    t_motion: ArrayLike,
    motion: ArrayLike,
    *,
    lags_s: tuple[float, float],
    rate_hz: float,
) -> Response | None:
    """Return the lag of motion (m,) behind commands (n, k).

    It is the lag whose least-squares fit of the motion by all commands is best. Both
    are interpolated to a uniform clock of `rate_hz` (commands too: held ones would seem
    half a step of the log early), and a moving mean over 10 s is taken off both,
    because slow drifts always look alike. Lags between the two of `lags_s` are tried in
    steps of the clock. The lag holds the delay and the inertia of the vehicle together.
    At most ten minutes in the middle of the common span are used. None for fewer than
    100 samples, less than 20 s, or commands that stand still.
    """
    at, inputs = np.asarray(t_command, dtype=np.float64), np.asarray(command, dtype=np.float64)
    t, output = np.asarray(t_motion, dtype=np.float64), np.asarray(motion, dtype=np.float64)
    moves = np.ptp(inputs, axis=0) > 0.0 if len(inputs) else np.ones(1, np.bool_)
    inputs = inputs if moves.all() else inputs[:, moves]
    if not inputs.size or not t.size:
        return None
    early, late = round(lags_s[0] * rate_hz), round(lags_s[1] * rate_hz)
    start, end = max(at[0] + late / rate_hz, t[0]), min(at[-1] + early / rate_hz, t[-1])
    middle, half = 0.5 * (start + end), min(0.5 * (end - start), LONGEST_RESPONSE_S / 2.0)
    count, width = int(2.0 * half * rate_hz), round(DRIFT_S * rate_hz)
    if end - start < 2.0 * DRIFT_S or count < 100:
        return None
    clock = middle - half + np.arange(-late, count - early) / rate_hz
    commands = _without_drift(
        np.stack([np.interp(clock, at, column) for column in inputs.T], axis=1), width
    )
    response = _without_drift(np.interp(clock[late : late + count], t, output), width)
    total = float(response @ response)
    if total == 0.0:
        return None
    lags = np.arange(early, late + 1)
    shares = _explained(
        [commands[late - lag : late - lag + count] for lag in lags], response, total
    )
    return Response(peak_of_parabola(lags / rate_hz, shares), float(shares.max()))


@kept
def tone_share(t_command: ArrayLike, command: ArrayLike) -> tuple[float, float]:
    """Return the strongest frequency of commands (n, k) [Hz] and its share of power.

    Of the spectra of all commands together, a moving mean over 10 s taken off, by a Hann
    window. Two numbers, amplitude and phase, describe a linear answer to one frequency:
    any order and lag that are free fit it. (0, 0) for less than 20 s or commands
    that stand still.
    """
    t, inputs = np.asarray(t_command, dtype=np.float64), np.asarray(command, dtype=np.float64)
    if t.size < 2 or t[-1] - t[0] < SHORTEST_TONE_S:
        return 0.0, 0.0
    middle, half = 0.5 * (t[0] + t[-1]), min(0.5 * (t[-1] - t[0]), LONGEST_RESPONSE_S / 2.0)
    clock = np.arange(middle - half, middle + half, 1.0 / TONE_HZ)
    values = np.column_stack([np.interp(clock, t, column) for column in inputs.T])
    swing = _without_drift(values, round(DRIFT_S * TONE_HZ)) * np.hanning(len(clock))[:, None]
    power = (np.abs(np.fft.rfft(swing, axis=0)) ** 2).sum(axis=1)
    top, total = int(np.argmax(power)), float(power.sum())
    if total == 0.0:
        return 0.0, 0.0
    near = power[max(top - TONE_BINS, 0) : top + TONE_BINS + 1]
    return top * TONE_HZ / len(clock), float(near.sum()) / total


def without_drift(motion: ArrayLike, t_s: ArrayLike) -> Array:
    """Return a signal (n,) at t_s (n,) [s] less its moving mean over 10 s."""
    step = float(np.median(np.diff(np.asarray(t_s, dtype=np.float64))))
    width = max(1, round(DRIFT_S / step)) if step > 0.0 else 1
    return _without_drift(np.asarray(motion, dtype=np.float64), width)


def _without_drift(values: Array, width: int) -> Array:
    """Return values (n,) or (n, k) less their moving mean over `width` samples."""
    return np.asarray(values - moving_mean(values, width))


def _explained(designs: list[Array], response: Array, total: float) -> Array:
    """Return the adjusted share of variance of (n,) explained by each design (n, k)."""
    moment = np.stack([design.T @ design for design in designs])
    cross = np.stack([design.T @ response for design in designs])
    count, width = designs[0].shape
    # A little ridge: outputs of a mixer are often linear combinations of each other.
    ridge = 1e-9 * np.maximum(np.trace(moment, axis1=1, axis2=2), 1e-30)
    moment += np.eye(width) * ridge[:, None, None]
    share = np.sum(cross * np.linalg.solve(moment, cross[..., None])[..., 0], axis=1) / total
    return np.asarray(1.0 - (1.0 - share) * (count - 1) / (count - width - 1))


def limited(t: Array, values: Array, rate: float) -> Array:
    """Return values (n, k) at times t (n,) behind a limiter of their rate [1/s].

    >>> limited(np.arange(4.0), np.array([[0.0], [3.0], [3.0], [0.0]]), 1.0).ravel()
    array([0., 1., 2., 1.])
    """
    steps = (rate * np.diff(t)).tolist()
    columns = []
    for column in values.T.tolist():
        last = column[0]
        kept = [last]
        for value, step in zip(column[1:], steps, strict=True):
            change = value - last
            last += step if change > step else -step if change < -step else change
            kept.append(last)
        columns.append(kept)
    return np.array(columns).T
