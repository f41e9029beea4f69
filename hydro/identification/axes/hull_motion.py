"""Motion ahead and aside that nothing measures, by the forces that push a hull.

    m_1 u' = X - drag + m_2 v r,   m_2 v' = Y - drag - m_1 u r

Yaw has its moment (m_1 - m_2) u v (Munk), heave its force m_1 u q - m_2 v p, and the depth
of a tilted hull its climb, -u sin theta + v cos theta sin phi.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.axes.windows import depth_measures

UNMEASURED_DRAG = (0.5, 3.0)
"""Linear and quadratic drag over mass [1/s, 1/m] of a hull whose speeds forces give: those of
small vehicles. What they are off by, `speed_share` and the coefficient of a term take up."""
LARGEST_SHARE, SHARE_WITHIN, SHARE_SD = 1.5, 0.03, 0.15
"""Ends of what such speeds may be off by, how near it is sought, and its deviation: of twins
whose speeds were .70 and 1.12 of those that forces give, it comes out as .56 and 1.2."""
HULL_SHARE, HULL_STEP_S = 0.3, 0.02
"""Least deviation of that coefficient, in parts of mass over inertia; step of the speeds."""


def unmeasured(records: Sequence[AxisRecord]) -> bool:
    """Return whether forces move surge and sway, and nothing measures either."""
    silent = not any(np.isfinite(record.rate[name]).any() for record in records for name in "uv")
    return silent and any(np.nanmax(np.abs(r.force[axis])) > 0.0 for r in records for axis in "XY")


def speeds_by_forces(record: AxisRecord, inertia: Array) -> Array:
    """Return u and v (n, 2) [m/s] that forces give, with the measured turning.

    inertia (6,): apparent. Where outputs are not logged nothing drives, as in all inputs.
    """
    (m_1, m_2), (linear, squared) = inertia[:2].tolist(), UNMEASURED_DRAG
    step = float(record.t_s[1] - record.t_s[0])
    parts = max(1, round(step / HULL_STEP_S))
    h, u, v, out = step / parts, 0.0, 0.0, []
    columns = np.nan_to_num([record.force["X"] / m_1, record.force["Y"] / m_2, record.rate["r"]])
    for ahead, aside, r in zip(*(column.tolist() for column in columns), strict=True):
        out.append((u, v))
        for _ in range(parts):
            slope = ahead - u * (linear + squared * abs(u)) + m_2 / m_1 * v * r
            v += h * (aside - v * (linear + squared * abs(v)) - m_1 / m_2 * u * r)
            u += h * slope
    return np.array(out)


def hull_input(record: AxisRecord, velocity: str, inertia: Array) -> Array:
    """Return u v (n,) [m^2/s^2] of yaw, (m_1 u q - m_2 v p) / m_3 [m/s^2] of heave."""
    u, v = speeds_by_forces(record, inertia).T
    if velocity == "r":
        return np.asarray(u * v)
    p, q = (np.nan_to_num(record.rate[name]) for name in "pq")
    return np.asarray((inertia[0] * u * q - inertia[1] * v * p) / inertia[2])


def hull_prior(velocity: str, inertia: Array, share: float = 1.0) -> tuple[float, float]:
    """Return mean and deviation of the coefficient of `hull_input`.

    Of yaw (m_1 - m_2) / m_6, of heave the `share` that speeds are of those forces give.
    """
    if velocity == "w":
        return share, HULL_SHARE
    m_1, m_2, m_6 = inertia[[0, 1, 5]].tolist()
    mean = (m_1 - m_2) / m_6
    return mean, max(abs(mean), HULL_SHARE * max(m_1, m_2) / m_6)


def climb(record: AxisRecord, inertia: Array) -> Array:
    """Return how much deeper (n,) [m] a tilted hull gets by the speeds that forces give."""
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


def hull_words(
    velocity: str, records: Sequence[AxisRecord], inertia: Array | None
) -> tuple[str, ...]:
    """Return a sentence where motion of the hull may count as inertia of yaw or heave.

    inertia (6,): what the fit has its motion by; None where it has none.
    """
    by_depth = velocity == "w" and any(depth_measures(record, "w") for record in records)
    if not (velocity == "r" or by_depth) or not unmeasured(records):
        return ()
    what = "the moment of a hull that moves ahead and aside ((m_1 - m_2) u v, Munk)"
    axis, when = "yaw", "turns"
    if by_depth:
        what = "the climb of a hull that is tilted while it moves ahead and aside (u sin theta)"
        axis, when = "heave", "tilts"
    if inertia is None:
        return (
            f"surge and sway are not measured: {what} counts as inertia and damping of {axis},"
            f" which may be off by tens of percent where it {when} under way",
        )
    if by_depth:
        return (
            f"surge and sway are not measured: {what}, by speeds that its forces give, is taken"
            " off the depth; what these speeds are off by counts as heave",
        )
    return (
        f"surge and sway are not measured: {what} is in the fit by speeds that its forces give,"
        " give or take all of it; the model has it where it has both speeds",
    )
