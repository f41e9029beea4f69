"""Forces of the thrusters against what any body of this size needs under water."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.hydro.arrays import Array
from auvid.stages.columns import ATTITUDE
from auvid.stages.ingest.health.actuation.push_answers import pushes
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit
from auvid.stages.number_format import significant

SLOWEST_M_S, LEAST_CORRELATION = 0.1, 0.5
"""Speed that 5 % of the samples exceed, and correlation of force and speed, from which on
the work of the thrusters is that against drag.
"""
LINEAR_M_S = 0.2
"""Speed at which linear drag is as large as the largest quadratic one."""
SHORTEST_S, SLICE_S = 50.0, 3.0
LEVEL_RAD, STILL_M_S, FAST_M_S = 0.35, 0.03, 0.5
CLEAR = 4.0


def force_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield drag that no body has, and a weight that the thrusters do not hold."""
    thrust = pushes(log)
    if thrust is None or not log.has("velocity") or log.vehicle is None:
        return
    t_s, pushed = thrust
    at, velocity = log.t_s("velocity"), log.body_velocity()
    inside = (t_s >= at[0]) & (t_s <= at[-1])
    if np.count_nonzero(inside) < 2 or not np.isfinite(velocity).all():
        return
    t_s, force = t_s[inside], (pushed * np.diag(log.vehicle.mass_matrix))[inside]
    moved = np.column_stack([np.interp(t_s, at, part) for part in velocity.T])
    yield from _drag(log, force, moved)
    yield from _weight(log, t_s, force, moved)


def _drag(log: CheckedLog, force: Array, moved: Array) -> Iterator[Finding]:
    """Yield a drag coefficient of surge and sway beyond that of bodies.

    C = 2 cov(F, u) / (rho V^(2/3) <|u|^3>), V the displaced volume: what the thrusters
    work is what drag takes.
    """
    assert log.vehicle is not None
    density = log.vehicle.water_density
    area = np.cbrt(log.vehicle.displaced_mass_kg / density) ** 2
    work = spent = 0.0
    top = 0.0
    for own, speed in zip(force.T[:2], moved.T[:2], strict=True):
        fast = float(np.percentile(np.abs(speed), 95.0))
        if fast < SLOWEST_M_S or not np.ptp(own) or not np.ptp(speed):
            continue
        if float(np.corrcoef(own, speed)[0, 1]) < LEAST_CORRELATION:
            continue
        work += float(np.mean((own - own.mean()) * (speed - speed.mean())))
        spent += 0.5 * density * float(area) * float(np.mean(np.abs(speed) ** 3))
        top = max(top, fast)
    if not spent:
        return
    coefficient, most = work / spent, limit("drag_size") * (1.0 + LINEAR_M_S / top)
    if coefficient < most:
        return
    yield finding(
        "drag_size",
        f"By the thrust curve the thrusters work against a drag coefficient of"
        f" {significant(coefficient)} (on the displaced volume to the power 2/3, at speeds to"
        f" {significant(top)} m/s); bodies have at most {significant(most)}: the"
        " forces are too large.",
        stream="actuators",
        value=coefficient,
    )


def _weight(log: CheckedLog, t_s: Array, force: Array, moved: Array) -> Iterator[Finding]:
    """Yield a weight in water that is not what the thrusters hold."""
    vehicle = log.vehicle
    assert vehicle is not None
    down = force[:, 2]
    if not np.ptp(down) or t_s[-1] - t_s[0] < SHORTEST_S or not log.has("attitude"):
        return
    tilt = np.abs(log.values("attitude", ATTITUDE)[:, :2])
    slow = abs(float(moved[:, 2].mean())) < STILL_M_S
    if float(np.percentile(tilt, 95.0)) > LEVEL_RAD or not slow:
        return
    if float(np.percentile(np.abs(moved[:, 0]), 95.0)) > FAST_M_S:
        return  # lift
    borne = -float(down.mean())
    sd = float(down.std()) / np.sqrt((t_s[-1] - t_s[0]) / SLICE_S)
    weight = vehicle.mass_kg * vehicle.gravity
    net = weight - vehicle.displaced_mass_kg * vehicle.gravity
    if abs(borne - net) - CLEAR * sd < limit("weight_held") * weight:
        return
    yield finding(
        "weight_held",
        f"The vehicle keeps its depth while its thrusters hold {borne:+.1f} +- {2.0 * sd:.1f} N"
        f" downward weight on average; the vehicle file gives {net:+.1f} N (mass less displaced"
        f" mass, times gravity).",
        stream="actuators",
        value=borne - net,
    )
