"""Settled glides of a record: where drive, pitch and depth rate are steady.

What is left out is left out with a reason, sample by sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from auvid.hydro.arrays import Array, Index, Mask
from auvid.hydro.dynamics.gliding.steady_glide import GlideState
from auvid.hydro.identification.signals.resampling import gaps
from auvid.hydro.identification.signals.splines import lambda_from_cutoff, smoothing_spline

LOOK_S = 10.0
"""Changes of drive and pitch are counted over this time [s]."""
DEPTH_CUTOFF_HZ = 0.05
"""Depth is smoothed below this: a glide changes over a minute, pressure is noisy."""
LEAST_SAMPLES = 5
PERIODS, SLOWEST_S = 2.5, 60.0
"""Pauses of so many periods of a log are none, of periods up to so many seconds."""
SURFACE = "at the surface"
STOP = "drive at its stop"
MOVING = "drive moving"
TURNING = "pitch moving"
FLAT = "pitch too flat"
AGAINST = "depth goes against the pitch"
SETTLING = "not settled yet"
SHORT = "settled too short"
NOT_LOGGED = "not logged"
REASONS = (NOT_LOGGED, SURFACE, STOP, MOVING, TURNING, FLAT, AGAINST, SETTLING, SHORT)
"""Why samples are left out, in the order in which the first that holds is named."""
Direction = Literal["dive", "climb"]


@dataclass(frozen=True)
class GliderRecord:
    """A record of a glider at n times t_s (n,) [s], ascending.

    `speed_m_s` (n,) through the water, nan where nothing measures it.
    """

    t_s: Array
    state: GlideState
    speed_m_s: Array


@dataclass(frozen=True)
class SettlingRules:
    """When a glide counts as settled.

    Depth below which it is clear of the surface [m]; change of the drive over its stroke
    [1/s] and of pitch [rad/s] that still count as none; least pitch [rad]; time to wait
    after either moved [s]; shortest glide [s]; longest pause of the log [s]; the drive's
    stops [m^3], None where they are not finite.
    """

    surface_m: float = 5.0
    drive_rate_1_s: float = 1e-3
    pitch_rate_rad_s: float = np.radians(0.3)
    least_pitch_rad: float = np.radians(8.0)
    settling_s: float = 30.0
    shortest_s: float = 60.0
    max_gap_s: float = 5.0
    stops_m3: tuple[float, float] | None = None


@dataclass(frozen=True)
class SettledGlides:
    """The record with depth rate [m/s] and the settled glides.

    `glide` (n,): number of the glide, -1 where none; `direction` of each; `reason` (n,):
    index into REASONS, -1 in a glide; `depth_m`, `depth_rate_m_s` (n,).
    """

    record: GliderRecord
    depth_m: Array
    depth_rate_m_s: Array
    glide: Index
    reason: Index
    direction: tuple[Direction, ...]
    spans_s: tuple[tuple[float, float], ...]

    def left_out_s(self) -> dict[str, float]:
        """Return the seconds that are left out, by reason."""
        t = self.record.t_s
        step = np.minimum(np.gradient(t), max(LOOK_S, float(np.median(np.diff(t)))))
        return {
            name: float(step[self.reason == index].sum())
            for index, name in enumerate(REASONS)
            if np.any(self.reason == index)
        }


def bridged_s(t_s: Array, max_gap_s: float) -> float:
    """Return the longest pause at times t_s (n,) [s] that is bridged."""
    period = float(np.median(np.diff(t_s))) if t_s.size > 1 else 0.0
    return max(max_gap_s, PERIODS * period if period <= SLOWEST_S else 0.0)


def depth_of(record: GliderRecord, *, gravity: float, max_gap_s: float) -> tuple[Array, Array]:
    """Return depth (n,) [m] and depth rate (n,) [m/s], positive down.

    dz = dp / (rho g): a smoothing spline of the pressure in each part without a pause;
    nan in parts of fewer than 5 samples.
    """
    state, t = record.state, record.t_s
    weight = state.density_kg_m3 * gravity
    depth, rate = np.full(t.size, np.nan), np.full(t.size, np.nan)
    for first, last in gaps(t, max_gap_s):
        if last - first < LEAST_SAMPLES:
            continue
        part = slice(first, last)
        lam = lambda_from_cutoff(DEPTH_CUTOFF_HZ, float(np.median(np.diff(t[part]))))
        spline = smoothing_spline(t[part], state.pressure_pa[part], lam=lam)
        depth[part] = spline.evaluate(t[part]) / weight[part]
        rate[part] = spline.evaluate(t[part], 1) / weight[part]
    return depth, rate


def settled_glides(record: GliderRecord, rules: SettlingRules, *, gravity: float) -> SettledGlides:
    """Return the settled glides of a record, and why the rest is left out."""
    state, t = record.state, record.t_s
    depth, rate = depth_of(record, gravity=gravity, max_gap_s=rules.max_gap_s)
    stroke = float(np.nanmax(state.drive_m3) - np.nanmin(state.drive_m3))
    reason = np.full(t.size, -1, dtype=np.intp)

    def leave_out(rows: Mask, name: str) -> None:
        reason[rows & (reason < 0)] = REASONS.index(name)

    inputs = (state.pitch_rad, state.drive_m3, state.density_kg_m3, rate)
    leave_out(np.asarray(~np.isfinite(np.stack(inputs)).all(axis=0)), NOT_LOGGED)
    leave_out(np.asarray(depth < rules.surface_m), SURFACE)
    if rules.stops_m3 is not None:
        low, high = rules.stops_m3
        near = 0.005 * (high - low)
        leave_out((state.drive_m3 < low + near) | (state.drive_m3 > high - near), STOP)
    moving = _change(t, state.drive_m3) > rules.drive_rate_1_s * stroke
    turning = _change(t, state.pitch_rad) > rules.pitch_rate_rad_s
    leave_out(moving, MOVING)
    leave_out(turning, TURNING)
    leave_out(np.abs(state.pitch_rad) < rules.least_pitch_rad, FLAT)
    leave_out(np.sign(rate) != -np.sign(state.pitch_rad), AGAINST)
    disturbed = np.isin(reason, [REASONS.index(n) for n in (MOVING, TURNING, FLAT, AGAINST)])
    # Of a slow log the neighbours of a change hold part of it.
    slow = np.diff(t) > LOOK_S / 2
    neighbours = np.append(False, disturbed[:-1] & slow) | np.append(disturbed[1:] & slow, False)
    leave_out(_soon_after(t, disturbed | neighbours, rules.settling_s), SETTLING)
    return _numbered(SettledGlides(record, depth, rate, reason.copy(), reason, (), ()), rules)


def _change(t_s: Array, values: Array) -> Array:
    """Return |change| per second (n,) over LOOK_S about each sample."""
    before = np.maximum(np.searchsorted(t_s, t_s - LOOK_S / 2), 0)
    after = np.minimum(np.searchsorted(t_s, t_s + LOOK_S / 2), t_s.size - 1)
    return np.abs(values[after] - values[before]) / np.maximum(t_s[after] - t_s[before], LOOK_S / 2)


def _soon_after(t_s: Array, disturbed: Mask, settling_s: float) -> Mask:
    """Return which samples (n,) come less than settling_s after a disturbed one."""
    last = np.maximum.accumulate(np.where(disturbed, t_s, -np.inf))
    return np.asarray(t_s - last < settling_s)


def _numbered(settled: SettledGlides, rules: SettlingRules) -> SettledGlides:
    """Return the glides numbered; a pause or a turn of direction starts a new one.

    Parts of one dive (or climb) that a correction of pitch splits keep one number: what
    disturbs one of them disturbs all.
    """
    t, up = settled.record.t_s, settled.record.state.pitch_rad > 0.0
    reason, glide = settled.reason.copy(), np.full(t.size, -1, dtype=np.intp)
    directions: list[Direction] = []
    free = np.flatnonzero(reason < 0)
    if free.size:
        # Between two settled samples: did the vehicle turn, come up, or the log pause?
        turned = np.diff(up[free]) != 0
        surfaced = np.add.reduceat(reason == REASONS.index(SURFACE), free)[:-1] > 0
        paused = np.diff(t[free]) > 10.0 * rules.settling_s
        number = np.concatenate([[0], np.cumsum(turned | surfaced | paused)])
        for each in np.unique(number):
            rows = free[number == each]
            parts = [rows[a:b] for a, b in gaps(t[rows], rules.max_gap_s)]
            kept = [part for part in parts if t[part[-1]] - t[part[0]] >= rules.shortest_s]
            for part in parts:
                reason[part] = REASONS.index(SHORT)
            for part in kept:
                reason[part], glide[part] = -1, len(directions)
            if kept:
                directions.append("climb" if up[rows[0]] else "dive")
    spans = tuple(
        (float(t[glide == index][0]), float(t[glide == index][-1]))
        for index in range(len(directions))
    )
    return replace(settled, reason=reason, glide=glide, direction=tuple(directions), spans_s=spans)
