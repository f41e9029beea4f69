"""Outputs of a slow log between their samples: from what made them, or along lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.dynamics.actuators.slow_outputs import (
    LEAST_SAMPLES,
    RebuiltOutputs,
    rebuild_outputs,
)
from auvid.hydro.dynamics.actuators.thrusters import Thrusters, thruster_force, thruster_forces
from auvid.hydro.identification.checks.motion_checks import response_gains
from auvid.hydro.identification.signals.resampling import linear
from auvid.stages.columns import ATTITUDE, Samples
from auvid.stages.leg_record.motion import enough, pause_s, step_s
from auvid.stages.leg_streams import Streams

PULSE_RANGE_US = (1100.0, 1900.0)
STICK_LAGS_S = (0.0, 0.05, 0.1, 0.15, 0.2)
"""How late sticks of the ground station act; the best of these is taken."""
STICKS = ("stick_surge", "stick_sway", "stick_heave", "stick_yaw")
PUSHED = 0.03
"""Of its range, from which on a stick is pushed: the autopilot then holds nothing."""
BETTER = 0.05
"""Share of the yaw rate by which what is held has to explain more."""
YAW = 5


@dataclass(frozen=True)
class Way:
    """Pulses (n, k) on the clock by one way, and words on it."""

    pulses: Array
    words: str


def between_samples(
    streams: Streams,
    thrusters: Thrusters,
    outputs: Samples,
    t_s: Array,
    width: Array,
    max_gap_s: float,
) -> Way:
    """Return outputs between their samples by the way whose moment turns the hull best.

    width (n, k): along straight lines. Causes alone are sticks, gyro and attitude; with what
    the autopilot holds beside them, what remains at the samples is added: taken where that
    explains `BETTER` more of the yaw rate.
    """
    ways = [
        way
        for aims in (False, True)
        if (way := _best_lag(streams, outputs, t_s, width, max_gap_s, aims=aims)) is not None
    ]
    if not ways:
        return Way(width, "")
    shares = [_turns_explained(streams, thrusters, t_s, way.pulses) for way in ways]
    return ways[1 if shares[-1] > shares[0] + BETTER else 0]


def _turns_explained(streams: Streams, thrusters: Thrusters, t_s: Array, pulses: Array) -> float:
    """Return the share of the yaw rate that the moment of pulses explains."""
    gyro, good = enough(streams.gyro()), np.isfinite(pulses).all(axis=1)
    if gyro is None or not good.any():
        return 0.0
    moment = thruster_force(thrusters, thruster_forces(thrusters, pulses[good]))[:, [YAW]]
    if not np.ptp(moment):
        return 0.0
    gains = response_gains(t_s[good], moment, gyro.t_s, gyro.values[:, 2])
    return 0.0 if gains is None or gains.gain[0] <= 0.0 else float(gains.explained)


def _best_lag(
    streams: Streams, outputs: Samples, t_s: Array, width: Array, max_gap_s: float, *, aims: bool
) -> Way | None:
    """Return outputs rebuilt with the stick lag that gives samples left out best."""
    tries = (
        _rebuilt(streams, outputs, t_s, width, lag_s, max_gap_s, aims=aims)
        for lag_s in STICK_LAGS_S
    )
    results = [result for result in tries if result is not None]
    if not results:
        return None
    result, good = max(
        results, key=lambda item: float(np.maximum(item[0].rebuilt, item[0].interpolated).mean())
    )
    pulses = width.copy()
    pulses[good] = np.clip(result.values, *PULSE_RANGE_US)
    last = ", attitude and what the autopilot holds" if aims else " and attitude"
    return Way(
        pulses,
        f"Outputs come at {1.0 / step_s(outputs):.1f} Hz: {np.count_nonzero(result.used)} of"
        f" {result.used.size} are rebuilt between their samples from sticks, gyro{last}, mode by"
        f" mode; of every other sample, left out, that explains {_percent(result.rebuilt)} %,"
        f" interpolation over twice the pause {_percent(result.interpolated)} %.",
    )


def _percent(shares: Array) -> str:
    return f"{100.0 * shares.min():.0f} to {100.0 * shares.max():.0f}"


def _rebuilt(
    streams: Streams,
    outputs: Samples,
    t_s: Array,
    width: Array,
    lag_s: float,
    max_gap_s: float,
    *,
    aims: bool,
) -> tuple[RebuiltOutputs, Mask] | None:
    """Return outputs rebuilt with sticks `lag_s` late, and where on the clock."""
    both = np.concatenate([outputs.t_s, t_s])
    causes = np.column_stack(list(_causes(streams, both, lag_s, max_gap_s, aims=aims)))
    if not causes.shape[1]:
        return None
    mode, n = _modes_at(streams, both), outputs.t_s.size
    there, good = np.isfinite(causes[:n]).all(axis=1), np.isfinite(causes[n:]).all(axis=1)
    good = good & np.asarray(np.isfinite(width).all(axis=1))
    if np.count_nonzero(there) < 2 * LEAST_SAMPLES:
        return None
    result = rebuild_outputs(
        outputs.t_s[there],
        outputs.values[there],
        causes[:n][there],
        mode[:n][there],
        clock_s=t_s[good],
        clock_causes=causes[n:][good],
        clock_mode=mode[n:][good],
        remainders=aims,
    )
    return result, good


def _causes(
    streams: Streams, t_s: Array, lag_s: float, max_gap_s: float, *, aims: bool
) -> Iterator[Array]:
    """Yield sticks, gyro, attitude: what an autopilot makes outputs of, (n, c) each.

    lag_s: how late sticks act; nan where one pauses; an empty one without sticks or a gyro.
    aims: also heading and depth since the stick was let go, and the rate of the depth.
    """
    sticks = enough(streams.samples("sticks", STICKS, -lag_s))
    gyro = enough(streams.gyro())
    if sticks is None or gyro is None:
        yield np.zeros((t_s.size, 0))
        return
    for item in (sticks, gyro):
        yield linear(item.t_s, item.values, t_s, max_gap_s=pause_s(item, max_gap_s))
    euler = enough(streams.samples("attitude", ATTITUDE))
    if euler is not None:
        gap = pause_s(euler, max_gap_s)
        yield linear(euler.t_s, euler.values[:, :2], t_s, max_gap_s=gap)
        if aims:
            heading = np.unwrap(euler.values[:, 2])
            since = _since_push(sticks, STICKS.index("stick_yaw"), euler.t_s, heading)
            yield linear(euler.t_s, since[:, None], t_s, max_gap_s=gap)
    depth = enough(streams.samples("depth", ("depth_m",))) if aims else None
    if depth is not None:
        z = depth.values[:, 0]
        since = _since_push(sticks, STICKS.index("stick_heave"), depth.t_s, z)
        columns = np.column_stack([since, np.gradient(z, depth.t_s)])
        yield linear(depth.t_s, columns, t_s, max_gap_s=pause_s(depth, max_gap_s))


def _since_push(sticks: Samples, number: int, t_s: Array, value: Array) -> Array:
    """Return a value (n,) less that of the last time at which its stick was pushed."""
    stick = sticks.values[:, number]
    away = np.abs(np.interp(t_s, sticks.t_s, stick) - np.median(stick))
    pushed = away > PUSHED * max(float(np.ptp(stick)), 1e-9)
    last = np.maximum.accumulate(np.where(pushed, np.arange(t_s.size), 0))
    return np.asarray(value - value[last])


def _modes_at(streams: Streams, t_s: Array) -> npt.NDArray[np.intp]:
    """Return a number for the autopilot's mode at times (n,); 0 without any."""
    table = streams.tables.get("mode")
    if table is None or not table.num_rows:
        return np.zeros(t_s.size, dtype=np.intp)
    names = [str(name) for name in table["mode"].to_pylist()]
    number = np.array([names.index(name) for name in names], dtype=np.intp)
    at = np.searchsorted(streams.times("mode"), t_s, side="right") - 1
    return number[np.maximum(at, 0)]
