"""Outputs of which one acts backward, or that come in another order."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.data_schemas.tables import matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import thruster_forces
from auvid.hydro.dynamics.vehicle.logged_directions import with_logged_directions
from auvid.hydro.identification.checks.joined_outputs import OtherOrder, WindowMotion, other_order
from auvid.hydro.identification.checks.motion_checks import integrals, windows
from auvid.stages.columns import GYRO, RATES, SPEEDS
from auvid.stages.ingest.health.actuation.push_answers import SMALLEST_MOTION, coupling
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding
from auvid.stages.number_format import percent

YAW_LAST = (0, 1, 2, 5)
"""Rows of an allocation: surge, sway, heave, yaw."""
ORDER_WINDOW_S, LEAST_ORDER_WINDOWS, ANSWERS_S = 0.5, 100, (0.0, 0.1, 0.2, 0.3)
LEAST_ALLOCATION = 1e-6


def joined_otherwise(log: CheckedLog) -> Iterator[Finding]:
    """Yield outputs of which one acts backward, or that come in another order."""
    vehicle, streams = log.vehicle, ("actuators", "velocity", "imu")
    if vehicle is None or vehicle.thrusters is None or not log.has(*streams):
        return
    vehicle, _ = with_logged_directions(vehicle, log.info.parameters)
    thrusters = vehicle.thrusters
    assert thrusters is not None
    names = [f"pwm_{number}_us" for number in thrusters.outputs]
    if not set(names) <= set(log.tables["actuators"].column_names):
        return
    t_s, t_velocity, t_imu = (log.t_s(name) for name in streams)
    forces = thruster_forces(thrusters, np.nan_to_num(matrix(log.tables["actuators"], names)))
    motions = [(t_velocity, axis) for axis in log.body_velocity().T]
    motions.append((t_imu, log.column("imu", GYRO[2])))
    driven = [
        place
        for place, row in enumerate(YAW_LAST)
        if np.abs(thrusters.allocation[row]).max() > LEAST_ALLOCATION
        and float(motions[place][1].std()) > SMALLEST_MOTION
    ]
    start, end = max(t_s[0], t_velocity[0], t_imu[0]), min(t_s[-1], t_velocity[-1], t_imu[-1])
    clocks = t_s, t_velocity, t_imu
    at = windows(start, end - max(ANSWERS_S), *clocks, width_s=ORDER_WINDOW_S)
    if not driven or at.size < LEAST_ORDER_WINDOWS:
        return
    own = [motions[place] for place in driven]
    turns = [coupling(log, YAW_LAST[place], motions[place][0]) for place in driven]
    order = other_order(
        [_motion_windows(own, turns, at + lag) for lag in ANSWERS_S],
        integrals(t_s, forces, at, ORDER_WINDOW_S),
        thrusters.allocation[[YAW_LAST[place] for place in driven]],
        thrusters.direction,
        horizontal=driven[:2] == [0, 1],
        yaw=driven[-1] == len(YAW_LAST) - 1,
    )
    if order is None:
        return
    axis = int(np.argmax(order.share - order.own))
    otherwise, as_it_is = (
        percent(round(float(part[axis]), 2)) for part in (order.share, order.own)
    )
    words = (*SPEEDS, RATES[2])[driven[axis]]
    yield finding(
        "response_order",
        f"{_order_words(order, thrusters.outputs)} {words} answers the thrusters of the vehicle"
        f" file ({otherwise} of what drag leaves of its changes), as it is joined it hardly"
        f" does ({as_it_is}).",
        stream="actuators",
        value=order.log_ratio,
        fields=tuple(names),
    )


def _motion_windows(
    motions: list[tuple[Array, Array]], turns: list[Array | None], at: Array
) -> WindowMotion:
    """Return changes of motions (times, values) over windows, and drag and turns."""
    changes, drag = [], []
    for (t, motion), coupled in zip(motions, turns, strict=True):
        first, last = (np.interp(side, t, motion) for side in (at, at + ORDER_WINDOW_S))
        changes.append(last - first)
        terms = np.column_stack([motion, motion * np.abs(motion)])
        terms = terms if coupled is None else np.hstack([terms, coupled])
        drag.append(integrals(t, terms, at, ORDER_WINDOW_S))
    return WindowMotion(np.column_stack(changes), drag)


def _order_words(order: OtherOrder, outputs: tuple[int, ...]) -> str:
    if order.backward is not None:
        return f"Output {outputs[order.backward]} acts backward: with its force the other way round"
    moved = [place for place, source in enumerate(order.source) if source != place]
    if len(moved) == 2:
        first, second = (outputs[place] for place in moved)
        return f"Outputs {first} and {second} look exchanged: the other way round"
    listing = ", ".join(str(outputs[source]) for source in order.source)
    return f"The outputs come in another order: with {listing} for {outputs[0]} to {outputs[-1]}"
