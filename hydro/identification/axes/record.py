"""What one leg hands to the fits of single and coupled axes: motion, force, windows.

Motion ahead and aside that nothing measures follows from the forces that push a hull:

    m_1 u' = X - drag + m_2 v r,   m_2 v' = Y - drag - m_1 u r

Yaw has its moment (m_1 - m_2) u v (Munk) and N_v v, heave its force m_1 u q - m_2 v p, and the
depth of a tilted hull its climb, -u sin theta + v cos theta sin phi.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from auvid.hydro.arrays import AXES, Array
from auvid.hydro.identification.axes.structure import ASIDE, HULL

UNMEASURED_DRAG = (0.5, 3.0)
"""Linear and quadratic drag over mass [1/s, 1/m] of a hull whose speeds forces give: those of
small vehicles. What they are off by, `speed_share` and the coefficient of a term take up."""
LARGEST_SHARE, SHARE_WITHIN, SHARE_SD = 1.5, 0.03, 0.2
"""Ends of what such speeds may be off by, how near it is sought, and its deviation: of twins
whose speeds were .70 and 1.12 of those that forces give, it comes out as .40 and 1.13."""
LEAST_EFFECT = 1e-3
"""Of the largest effect on any axis: thrusters that do less do not act along one."""
HULL_SHARE, HULL_STEP_S = 0.3, 0.02
"""Least deviation of that coefficient, in parts of mass over inertia; step of the speeds."""


class LeftOut(NamedTuple):
    """A stretch of the leg that no window of an axis may use, and why.

    `axis`: letter of the axis (X .. N); `start_s`, `end_s` as `AxisRecord.t_s`.
    """

    axis: str
    start_s: float
    end_s: float
    reason: str


class ThrusterForces(NamedTuple):
    """Force of each thruster, and what it does to the axes.

    The force on the axes (n, 6) is `force` @ `effect`.T.
    `outputs` (m,): channels of the autopilot. `force` (n, m): newtons, or full commands of
    one thruster where the record is normalised. `effect` (6, m): by a force of 1.
    """

    outputs: tuple[int, ...]
    force: Array
    effect: Array


@dataclass(frozen=True)
class AxisRecord:
    """Measured motion of one leg on a uniform grid, what drives it, and windows.

    `t_s` (n,): times [s] from the start of the log. `rate`: body velocity (u v w p q r)
    -> (n,) [m/s, rad/s], nan where nothing measures it. `depth_m` (n,), positive down,
    or None. `attitude_rad` (n, 3): phi, theta, psi. `force`: axis (X Y Z K M N) -> (n,)
    of the actuators before any lag, in N and N m, or in full commands where
    `normalised`. `windows`: axis -> (first, last + 1) on the grid. `left_out`:
    stretches without windows. `measured_by`: axis -> what measures it, in words.
    `thrusters`: what makes the force up, None where nothing says how outputs mix.

    Without a velocity log rate["w"] is nan, and heave is fitted to `depth_m`.
    """

    t_s: Array
    rate: Mapping[str, Array]
    depth_m: Array | None
    attitude_rad: Array
    force: Mapping[str, Array]
    normalised: bool
    windows: Mapping[str, tuple[tuple[int, int], ...]]
    left_out: tuple[LeftOut, ...]
    measured_by: Mapping[str, str]
    thrusters: ThrusterForces | None = None


def is_idle(thrusters: ThrusterForces, axis: str) -> bool:
    """Return whether no thruster acts along an axis, as against others."""
    effect = np.abs(thrusters.effect)
    own = float(effect[AXES.index(axis)].max(initial=0.0))
    return own <= LEAST_EFFECT * float(effect.max(initial=0.0))


def unmeasured(records: Sequence[AxisRecord]) -> bool:
    """Return whether forces move surge and sway, and nothing measures either."""
    silent = not any(np.isfinite(record.rate[name]).any() for record in records for name in "uv")
    return silent and any(np.nanmax(np.abs(r.force[axis])) > 0.0 for r in records for axis in "XY")


def speeds_by_forces(
    record: AxisRecord, inertia: Array, *, drag: float = 1.0, lag_s: float = 0.0
) -> Array:
    """Return u and v (n, 2) [m/s] that forces give, with the measured turning.

    inertia (6,): apparent. drag: in parts of `UNMEASURED_DRAG`. lag_s: of the forces. Where
    outputs are not logged nothing drives, as in all inputs.
    """
    m_1, m_2 = inertia[:2].tolist()
    linear, squared = (drag * item for item in UNMEASURED_DRAG)
    step = float(record.t_s[1] - record.t_s[0])
    parts = max(1, round(step / HULL_STEP_S))
    h, u, v, out = step / parts, 0.0, 0.0, []
    pace, push, side = float(-np.expm1(-h / max(lag_s, 1e-9))), 0.0, 0.0
    columns = np.nan_to_num([record.force["X"] / m_1, record.force["Y"] / m_2, record.rate["r"]])
    for ahead, aside, r in zip(*(column.tolist() for column in columns), strict=True):
        out.append((u, v))
        for _ in range(parts):
            push += pace * (ahead - push)
            side += pace * (aside - side)
            slope = push - u * (linear + squared * abs(u)) + m_2 / m_1 * v * r
            v += h * (side - v * (linear + squared * abs(v)) - m_1 / m_2 * u * r)
            u += h * slope
    return np.array(out)


def hull_inputs(
    record: AxisRecord, velocity: str, inertia: Array, *, drag: float = 1.0, lag_s: float = 0.0
) -> dict[str, Array]:
    """Return what the hull does, (n,) each, by name of its term.

    Yaw: u v [m^2/s^2] and v [m/s]; heave: (m_1 u q - m_2 v p) / m_3 [m/s^2].
    """
    u, v = speeds_by_forces(record, inertia, drag=drag, lag_s=lag_s).T
    if velocity == "r":
        return {HULL: np.asarray(u * v), ASIDE: v}
    p, q = (np.nan_to_num(record.rate[name]) for name in "pq")
    return {HULL: np.asarray((inertia[0] * u * q - inertia[1] * v * p) / inertia[2])}


def hull_priors(
    velocity: str, inertia: Array, share: float = 1.0
) -> dict[str, tuple[float, float]]:
    """Return mean and deviation of the coefficients of `hull_inputs`.

    Of yaw (m_1 - m_2) / m_6, and N_v / m_6 of a drag aside that acts within the radius of
    gyration; of heave the `share` that speeds are of those forces give.
    """
    if velocity == "w":
        return {HULL: (share, HULL_SHARE)}
    m_1, m_2, m_6 = inertia[[0, 1, 5]].tolist()
    mean = (m_1 - m_2) / m_6
    return {
        HULL: (mean, max(abs(mean), HULL_SHARE * max(m_1, m_2) / m_6)),
        ASIDE: (0.0, UNMEASURED_DRAG[0] * float(np.sqrt(m_2 / m_6))),
    }


def climb(record: AxisRecord, inertia: Array) -> Array:
    """Return how much deeper (n,) [m] a tilted hull gets by speeds of its forces."""
    u, v = speeds_by_forces(record, inertia).T
    phi, theta = record.attitude_rad[:, 0], record.attitude_rad[:, 1]
    down = np.nan_to_num(v * np.cos(theta) * np.sin(phi) - u * np.sin(theta))
    step = float(record.t_s[1] - record.t_s[0])
    return np.asarray(step * np.append(0.0, np.cumsum((down[1:] + down[:-1]) / 2.0)))


def without_climb(record: AxisRecord, travel: Array, share: float) -> AxisRecord:
    """Return a record whose depth [m] lacks a share of a `climb` (n,)."""
    if record.depth_m is None:
        return record
    return replace(record, depth_m=record.depth_m - share * travel)
