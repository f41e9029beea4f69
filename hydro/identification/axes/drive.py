"""The force of a record behind dead band, curve and lag of what gives it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.arrays import AXES, Array
from auvid.hydro.identification.axes.record import AxisRecord

LAG, DEAD_BAND, CURVE, DELAY = "lag", "dead_band", "curve", "delay"
SKEW, HEAVE_SKEW = "skew", "heave_skew"
BOUNDS = {
    LAG: (0.01, 2.0), DEAD_BAND: (0.0, 0.3), CURVE: (0.5, 2.5), DELAY: (-0.6, 0.6),
    SKEW: (-0.5, 0.5), HEAVE_SKEW: (-0.5, 0.5),
}  # fmt: skip
"""Lag [s]; dead band in full commands; exponent of the curve; delay [s]; skews."""
STEPS = {LAG: 0.1, DEAD_BAND: 0.1, CURVE: 0.05, DELAY: 0.05, SKEW: 0.1, HEAVE_SKEW: 0.1}
"""Half widths of differences, relative; of lag and curve to the value, else to `BOUNDS`."""
MIXED = "XYN"
"""Axes that four thrusters at the corners give together, as those of most vehicles do."""
SIGNS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""Signs of the other two commands in each, against that of one of them."""
GAIN, GAIN_BOUNDS, GAIN_SD, GAIN_STEP = "gain of thruster", (-1.0, 3.0), 0.3, 0.1
"""Name before the number of a thruster, bounds of the share of its force that it gives,
deviation of that from 1 as thrusters of one vehicle have it, and half width of differences."""


@dataclass(frozen=True)
class ForceDrive:
    """How force follows its command.

    y = sign(f) (max(|f| - dead_band, 0) / (1 - dead_band))^curve, then lag_s F_dot + F = y.
    Dead band and curve are for commands of -1 .. 1; a force in newtons has neither. f is that
    of `delay_s` before: below 0 of commands that are stamped after they acted. `gains`
    (m,): what share of its force each thruster of the record gives; none: all of it.
    mixed: dead band and curve are those of the four thrusters that give surge, sway and yaw
    together, each with the sum of the three commands in signs of its own, up to a full one:

        y_X = sum over a, b of +-1 of (1 - skew a b sgn f) g(f) / 4,  f = f_X + a f_Y + b f_N

    and alike for Y and N. `skew`: by how much a thruster gives more one way than both ways on
    average. `heave_skew`: the same of those of heave, down.
    """

    lag_s: float = 0.08
    dead_band: float = 0.0
    curve: float = 1.0
    gains: tuple[float, ...] = ()
    delay_s: float = 0.0
    mixed: bool = False
    skew: float = 0.0
    heave_skew: float = 0.0


def lagged_columns(step_s: float, force: Array, lag_s: float) -> Array:
    """Return F (n, m) of lag_s F_dot + F = f, f linear between nodes, steady at first.

    >>> lagged_columns(0.1, np.array([[0.0], [1.0], [1.0]]), 0.1).round(3)[:, 0].tolist()
    [0.0, 0.368, 0.767]
    """
    from auvid.hydro.identification.bench.compiled_loops import filter_first_order

    rate = 1.0 / lag_s
    f = np.ascontiguousarray(force)
    steps = np.full(len(f) - 1, step_s)
    return np.asarray(rate * filter_first_order(steps, rate, f[:-1], f[1:], f[0] / rate))


def shaped(force: Array, drive: ForceDrive) -> Array:
    """Return commands behind dead band and curve."""
    if drive.dead_band == 0.0 and drive.curve == 1.0:
        return force
    size = np.maximum(np.abs(force) - drive.dead_band, 0.0) / (1.0 - drive.dead_band)
    return np.asarray(np.sign(force) * size**drive.curve)


def acting(record: AxisRecord, axis: str, drive: ForceDrive) -> Array:
    """Return what the commands of an axis (n,) give, before any lag."""
    own = np.nan_to_num(force_of(record, axis, drive))
    if not drive.mixed or axis not in MIXED:
        if axis != "Z" or drive.heave_skew == 0.0:
            return shaped(own, drive)
        return np.asarray((1.0 + drive.heave_skew * np.sign(own)) * shaped(own, drive))
    others = [np.nan_to_num(force_of(record, name, drive)) for name in MIXED if name != axis]
    total = np.zeros_like(own)
    for a, b in SIGNS:
        full = np.clip(own + a * others[0] + b * others[1], -1.0, 1.0)
        total += (1.0 - drive.skew * a * b * np.sign(full)) * shaped(full, drive)
    return np.asarray(total / len(SIGNS))


def force_of(record: AxisRecord, axis: str, drive: ForceDrive) -> Array:
    """Return the force (n,) on an axis by thrusters that give their shares of it."""
    if not drive.gains:
        return record.force[axis]
    assert record.thrusters is not None
    effect = record.thrusters.effect[AXES.index(axis)] * np.array(drive.gains)
    return np.asarray(record.thrusters.force @ effect)


def inputs_of(
    record: AxisRecord,
    names: Sequence[str],
    drive: ForceDrive,
    fine: Array,
    *,
    extra: Mapping[str, Array] | None = None,
) -> Array:
    """Return inputs (n, m) by name: lagged forces of axes, `extra` columns as is.

    fine (n,): places among the nodes of the record. What acts is linear between nodes, its
    lagged value is not; a command between two nodes acted at neither, so that dead band
    and curve are those of the nodes.
    """
    node_s = float(record.t_s[1] - record.t_s[0])
    step = node_s * float(fine[1] - fine[0])
    node = np.arange(len(record.t_s), dtype=np.float64) + drive.delay_s / node_s
    forces = [
        np.interp(fine, node, acting(record, name, drive)) for name in names if name in record.force
    ]
    late = iter(lagged_columns(step, np.column_stack(forces), drive.lag_s).T)
    columns = [next(late) if name in record.force else (extra or {})[name] for name in names]
    return np.ascontiguousarray(np.column_stack(columns))


def input_derivatives(
    record: AxisRecord,
    names: Sequence[str],
    drive: ForceDrive,
    fine: Array,
    free: Sequence[str],
) -> Array:
    """Return derivatives (n, m, e) of `inputs_of` by free parameters of the drive."""
    out = np.zeros((len(fine), len(names), len(free)))
    driven = [i for i, name in enumerate(names) if name in record.force]
    for e, parameter in enumerate(free):
        value = values_of(drive)[parameter]
        low, high = bounds_of(parameter)
        half = GAIN_STEP
        if parameter in STEPS:
            half = STEPS[parameter] * (value if parameter in (LAG, CURVE) else high)
        ends = (max(value - half, low), min(value + half, high))
        here, there = (
            inputs_of(record, [names[i] for i in driven], changed(drive, {parameter: end}), fine)
            for end in ends
        )
        out[:, driven, e] = (there - here) / (ends[1] - ends[0])
    return out


def gain_name(number: int) -> str:
    """Return the name of the gain of a thruster of the record, counted from 0."""
    return f"{GAIN} {number}"


def bounds_of(parameter: str) -> tuple[float, float]:
    """Return the bounds of a parameter of a drive."""
    return GAIN_BOUNDS if parameter.startswith(GAIN) else BOUNDS[parameter]


def prior_of(parameter: str) -> tuple[float, float] | None:
    """Return mean and deviation of a parameter of a drive; None without a prior."""
    return (1.0, GAIN_SD) if parameter.startswith(GAIN) else None


def values_of(drive: ForceDrive) -> dict[str, float]:
    """Return the parameters of a drive by name."""
    gains = {gain_name(number): gain for number, gain in enumerate(drive.gains)}
    own = {
        LAG: drive.lag_s, DEAD_BAND: drive.dead_band, CURVE: drive.curve, DELAY: drive.delay_s,
        SKEW: drive.skew, HEAVE_SKEW: drive.heave_skew,
    }  # fmt: skip
    return own | gains


def changed(drive: ForceDrive, values: Mapping[str, float]) -> ForceDrive:
    """Return a drive with some parameters changed."""
    every = values_of(drive) | dict(values)
    gains = tuple(every[gain_name(number)] for number in range(len(drive.gains)))
    return replace(
        drive, lag_s=every[LAG], dead_band=every[DEAD_BAND], curve=every[CURVE], gains=gains,
        delay_s=every[DELAY], skew=every[SKEW], heave_skew=every[HEAVE_SKEW],
    )  # fmt: skip
