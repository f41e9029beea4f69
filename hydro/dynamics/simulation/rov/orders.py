"""What the autopilot of an ROV is told at each tick: modes, pilot's sticks, goals."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.documents.plans.dive_plan import (
    DiveLegEntry,
    DivePlanDocument,
    RouteEntry,
    StickEntry,
)
from auvid.hydro.arrays import Array, Ints
from auvid.hydro.dynamics.simulation.rov.autopilot import MODES, STICKS

PILOT, PUSH, FILTER, IMU, VELOCITY, DEPTH, BATTERY, SCATTER = range(8)
"""Numbers of the streams of random numbers of a leg."""
RAMP_S = 0.3
"""Time in which a pilot moves a stick from one held value to the next."""


@dataclass(frozen=True)
class Orders:
    """Orders at the ticks of the autopilot.

    `t_s` (k,) from the start of the leg, `modes` (k,), `sticks` (k, 6) in the order of
    STICKS, `targets` (k, 6): north, east [m], their rates [m/s], heading [rad], depth
    [m].
    """

    t_s: Array
    modes: Ints
    sticks: Array
    targets: Array


def random_numbers(seed: int, leg: str, stream: int) -> np.random.Generator:
    """Return the random numbers of one stream of a leg, independent of all others."""
    return np.random.default_rng([seed, zlib.crc32(leg.encode()), stream])


def orders_of(plan: DivePlanDocument, leg: DiveLegEntry, *, seed: int) -> Orders:
    """Return the orders of a leg from its settling to the end of its log."""
    tick_s = 1.0 / plan.control_hz
    ticks = round((plan.settle_s + leg.duration_s + plan.margin_s) * plan.control_hz) + 1
    t_s = np.arange(ticks, dtype=np.float64) * tick_s - plan.settle_s
    starts = np.array([item.at_s for item in leg.modes])
    codes = np.array([MODES[item.mode] for item in leg.modes], dtype=np.int64)
    which = np.searchsorted(starts, t_s + 1e-9, side="right") - 1
    random = random_numbers(seed, leg.id, PILOT)
    sticks = np.zeros((ticks, 6))
    for index, axis in enumerate(STICKS):
        child = random.spawn(1)[0]  # so that one stick's draws do not move another's
        entry: StickEntry | None = getattr(leg.sticks, axis)
        if entry is not None:
            sticks[:, index] = _stick(entry, t_s, child)
    sticks[t_s < 0.0] = 0.0
    return Orders(t_s, codes[np.maximum(which, 0)], sticks, _targets(plan, leg.route, t_s, tick_s))


def _stick(entry: StickEntry, t_s: Array, random: np.random.Generator) -> Array:
    """Return the values of one stick (k,), clipped to -1 to 1."""
    if entry.kind == "steps":
        values = np.concatenate([[0.0], entry.values])
        steps = values[np.searchsorted(entry.times_s, t_s + 1e-9, side="right")]
        return np.asarray(np.clip(steps + entry.mean, -1.0, 1.0))
    if entry.kind == "multisine":
        tones = np.geomspace(entry.lowest_hz, entry.highest_hz, entry.tones)
        phases = random.uniform(0.0, 2.0 * np.pi, entry.tones)
        wave = np.sin(2.0 * np.pi * tones * t_s[:, None] + phases).sum(axis=1)
        return np.asarray(
            np.clip(entry.mean + entry.amplitude * wave / np.abs(wave).max(), -1.0, 1.0)
        )
    changes = [0.0]
    while changes[-1] < t_s[-1]:
        changes.append(changes[-1] + entry.hold_s * random.uniform(0.4, 1.6))
    values = random.uniform(-entry.amplitude, entry.amplitude, len(changes))
    times = np.array(changes)
    # A ramp from each value to the next, then held.
    points = np.column_stack([times, times + min(RAMP_S, 0.3 * entry.hold_s)]).ravel()
    levels = np.column_stack([np.concatenate([[0.0], values[:-1]]), values]).ravel()
    return np.asarray(np.clip(np.interp(t_s, points, levels) + entry.mean, -1.0, 1.0))


def _targets(plan: DivePlanDocument, route: RouteEntry | None, t_s: Array, tick_s: float) -> Array:
    """Return the goals at the ticks (k, 6): a point that moves to the next one."""
    targets = np.zeros((t_s.size, 6))
    targets[:, 4], targets[:, 5] = np.radians(plan.heading_deg), plan.depth_m
    if route is None:
        return targets
    zeros = [0.0] * len(route.times_s)
    goals = np.column_stack(
        [
            route.north_m,
            route.east_m,
            plan.depth_m + np.array(route.deeper_m or zeros),
            np.radians(plan.heading_deg + np.array(route.heading_deg or zeros)),
        ]
    )
    goals = np.vstack([[0.0, 0.0, plan.depth_m, np.radians(plan.heading_deg)], goals])
    which = np.searchsorted(route.times_s, t_s + 1e-9, side="right")
    step, turn = route.speed_m_s * tick_s, np.radians(route.turn_deg_s) * tick_s
    point, heading = goals[0, :3].copy(), float(goals[0, 3])
    for row, goal in zip(targets, goals[which], strict=True):
        away = goal[:3] - point
        distance = float(np.sqrt(away @ away))
        moved = away * min(step / distance, 1.0) if distance > 0.0 else away
        point = point + moved
        heading += float(np.clip(goal[3] - heading, -turn, turn))
        row[:2], row[2:4], row[4], row[5] = point[:2], moved[:2] / tick_s, heading, point[2]
    return targets
