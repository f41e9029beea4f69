"""Level thrusters of a slow log between their samples, by ArduSub's own control law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array, Index, Mask
from auvid.hydro.dynamics.actuators.heading_loop import (
    RANGE_US,
    STEP_S,
    HeadingGains,
    logged_gains,
    yaw_command,
)
from auvid.hydro.dynamics.actuators.thrusters import Thrusters
from auvid.hydro.dynamics.simulation.rov.autopilot import frame_factors
from auvid.stages.columns import ATTITUDE, Samples
from auvid.stages.leg_record.motion import enough
from auvid.stages.leg_streams import Streams, disarmed_between

LEVEL = ("yaw", "surge", "sway")
"""What level thrusters are mixed of, in the order of the factors of a frame."""
MODES = ("MANUAL", "STABILIZE", "ALT_HOLD", "SURFTRAK")
"""Modes in which sticks alone move the hull ahead, aside and in yaw; the first has no law."""
LARGEST_MISFIT = 0.02
"""Of full outputs: level outputs that no mix of yaw, surge and sway gives are not ArduSub's."""
TRUSTED = 0.5
"""Of the error of straight lines at samples left out, up to which the law is taken."""
LAGS_S = (0.0, 0.02, 0.04, 0.06, 0.1)
FEWEST = 40
PUSHED = 0.05


@dataclass(frozen=True)
class LevelPulses:
    """Pulses (n, k) with those of level thrusters by the law, and words on it."""

    pulses: Array
    words: str


@dataclass(frozen=True)
class _Cause:
    """What the law has to go by: motion and sticks on a clock of its own, and modes."""

    t_s: Array
    heading_rad: Array
    turn_rad_s: Array
    sticks: Samples
    mode: Index
    there: Mask


def level_by_law(
    streams: Streams,
    thrusters: Thrusters,
    outputs: Samples,
    t_s: Array,
    pulses: Array,
    parameters: Mapping[str, float | None],
) -> LevelPulses | None:
    """Return pulses (n, k) on a clock, of level thrusters by the law; None without it.

    outputs: samples of the thrusters; pulses: by another way. What is left at the samples
    is added along lines. None where sticks, gyro, heading or modes lack, where the mixer
    is another one or the loop is off, or where every other sample, left out, is not hit twice
    as well as by lines.
    """
    cause = _cause(streams)
    factors = frame_factors(thrusters)[:, 3:]
    level = np.any(factors != 0.0, axis=1)
    if cause is None or np.linalg.matrix_rank(factors[level]) < len(LEVEL):
        return None
    factors, turned = factors[level], thrusters.direction[level]
    shares = turned * (outputs.values[:, level] - NEUTRAL_US) / RANGE_US
    mixed = shares @ np.linalg.pinv(factors).T
    if np.sqrt(np.mean((shares - mixed @ factors.T) ** 2)) > LARGEST_MISFIT:
        return None
    gains = logged_gains(parameters)
    if not (gains.angle > 0.0 and gains.dead < 1.0):
        return None  # of a loop that is switched off
    tries = [
        tried
        for lag_s in LAGS_S
        if (tried := _tried(cause, gains, outputs.t_s, mixed, t_s, lag_s)) is not None
    ]
    if not tries:
        return None
    best = min(tries, key=lambda item: float(item[1][0]))
    values, errors, lines = best
    if not errors[0] < TRUSTED * lines[0]:
        return None
    along = np.stack([np.interp(t_s, outputs.t_s, column) for column in mixed.T], axis=1)
    taken = errors < lines
    there = _near(cause.t_s, cause.there, t_s) & np.isfinite(pulses).all(axis=1)
    out = pulses.copy()
    better = NEUTRAL_US + RANGE_US * turned * (np.where(taken, values, along) @ factors.T)
    out[np.ix_(there, level)] = np.clip(better[there], NEUTRAL_US - RANGE_US, NEUTRAL_US + RANGE_US)
    names = " and ".join(name for name, own in zip(LEVEL, taken, strict=True) if own)
    return LevelPulses(
        out,
        f" Those of level thrusters are rebuilt for {names} from sticks, gyro and heading by"
        f" ArduSub's control law: yaw at samples left out errs {100.0 * errors[0]:.1f} % of full"
        f" (lines {100.0 * lines[0]:.1f} %).",
    )


def _tried(
    cause: _Cause, gains: HeadingGains, at_s: Array, mixed: Array, t_s: Array, lag_s: float
) -> tuple[Array, Array, Array] | None:
    """Return mixed commands (n, 3) on a clock, and errors (3,) of law and of lines.

    None where no stick says what the pilot's gain is.
    """
    there = _near(cause.t_s, cause.there, at_s)
    if np.count_nonzero(there) < FEWEST:
        return None
    sticks = _latest(cause.sticks, at_s[there] - lag_s)
    pushed, driven = sticks[:, :2], mixed[there, 1:]
    if np.count_nonzero(np.abs(pushed) > PUSHED) < FEWEST // 4:
        return None
    gain = float(np.sum(pushed * driven) / np.sum(pushed**2))
    stick = gain * _latest(cause.sticks, cause.t_s - lag_s)[:, 2]
    yaw = yaw_command(
        cause.t_s, stick, cause.heading_rad, cause.turn_rad_s, cause.mode, gains=gains
    )
    at = at_s[there]
    remains = mixed[there] - np.column_stack([np.interp(at, cause.t_s, yaw), gain * pushed])
    values = np.column_stack(
        [np.interp(t_s, cause.t_s, yaw), gain * _latest(cause.sticks, t_s - lag_s)[:, :2]]
    )
    values += np.stack([np.interp(t_s, at, own) for own in remains.T], axis=1)
    errors, lines = (_left_out(at, own) for own in (remains, mixed[there]))
    return values, errors, lines


def _left_out(t_s: Array, values: Array) -> Array:
    """Return by how much lines miss every other of samples (n, c), RMS (c,)."""
    left, kept = slice(1, None, 2), slice(0, None, 2)
    lines = [np.interp(t_s[left], t_s[kept], own[kept]) for own in values.T]
    return np.asarray(np.sqrt(np.mean((values[left] - np.stack(lines, axis=1)) ** 2, axis=0)))


def _cause(streams: Streams) -> _Cause | None:
    sticks = enough(streams.samples("sticks", ("stick_surge", "stick_sway", "stick_yaw")))
    gyro, euler = enough(streams.gyro()), enough(streams.samples("attitude", ATTITUDE))
    modes = streams.tables.get("mode")
    if sticks is None or gyro is None or euler is None or modes is None or not modes.num_rows:
        return None
    first, last = max(gyro.t_s[0], euler.t_s[0]), min(gyro.t_s[-1], euler.t_s[-1])
    t_s = np.arange(first, last, STEP_S)
    names = np.array([str(name) for name in modes["mode"].to_pylist()])
    at = np.searchsorted(streams.times("mode"), t_s, side="right") - 1
    now = names[np.maximum(at, 0)]
    number = np.array([MODES.index(name) if name in MODES else 0 for name in names])
    number = number[np.maximum(at, 0)]
    armed = np.ones(t_s.size, dtype=bool)
    for begin, end in disarmed_between(modes, streams.start_us, float(t_s[-1]) + 1.0):
        armed &= (t_s < begin) | (t_s > end)
    return _Cause(
        t_s,
        np.interp(t_s, euler.t_s, np.unwrap(euler.values[:, 2])),
        np.interp(t_s, gyro.t_s, gyro.values[:, 2]),
        sticks,
        np.where(armed, number, 0),
        armed & np.isin(now, MODES),
    )


def _latest(samples: Samples, t_s: Array) -> Array:
    """Return the last values (n, c) before times (n,): a stick acts until the next."""
    at = np.searchsorted(samples.t_s, t_s, side="right") - 1
    return np.asarray(samples.values[np.maximum(at, 0)])


def _near(clock_s: Array, mask: Mask, t_s: Array) -> Mask:
    """Return a mask of a uniform clock at times (n,), false outside of it."""
    at = np.rint((t_s - clock_s[0]) / (clock_s[1] - clock_s[0])).astype(int)
    inside = (at >= 0) & (at < mask.size)
    return np.asarray(inside & mask[np.clip(at, 0, mask.size - 1)])
