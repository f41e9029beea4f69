"""Clocks of velocity and outputs, by how late velocity and gyro answer the outputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.relation import LAGS_S, relation
from auvid.hydro.identification.checks.response import Response
from auvid.stages.ingest.health.actuation.motions import motions
from auvid.stages.ingest.health.actuation.unrelated_commands import actuator_commands
from auvid.stages.ingest.health.agreement.velocity.velocity_clock import felt_elsewhen
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit

GROUPS = {"velocity": "uvw", "gyro": "pqr"}
CLEAR_EXCESS = 4.0
"""Excess over chance of a lag that counts."""
ANSWER_S = {"velocity": (-0.5, 3.0), "gyro": (-0.5, 1.5)}
"""Lags behind the outputs that thruster and hull explain."""
USUAL_LAG_S = 0.6
"""Of a velocity in healthy logs: 0.1 to 1.5 s."""
SAME = 0.7
"""Part of the largest odds that a lag beyond those of hulls must leave behind."""
STEADY_S = 0.3
"""Change of a lag from half to half of a log that is none."""


def clock_lag_findings(log: CheckedLog, answers: Mapping[str, Response]) -> Iterator[Finding]:
    """Yield a velocity that answers seconds late, and clocks that drift apart."""
    if not answers or not log.has("velocity", "imu"):
        return
    t_s, commands = log.t_s("actuators"), actuator_commands(log)
    measured = {axis: (at, values) for axis, (at, values, _) in motions(log).items()}
    lags = {
        group: _lag(t_s, commands, [measured[axis] for axis in axes if axis in measured])
        for group, axes in GROUPS.items()
    }
    velocity, gyro = lags["velocity"], lags["gyro"]
    if velocity is None or gyro is None or not _inside("gyro", gyro):
        return
    drift = list(_drift(log, t_s, commands, measured))
    if drift:
        yield from drift
    elif not _inside("velocity", velocity):
        off = velocity - USUAL_LAG_S
        if felt_elsewhen(log, GROUPS["velocity"], off) is False:
            return  # a controller that answers waves
        late, early = ("velocity", "gyro") if off > 0.0 else ("gyro", "velocity")
        yield finding(
            "velocity_lag",
            f"The {late} comes some {abs(off):.1f} s after the {early}: the velocity answers the"
            f" outputs {velocity:+.1f} s later, the gyro {gyro:+.1f} s.",
            stream="velocity",
            value=abs(off),
            remedy=(
                f"State a lag of {off:.1f} s for sensors.dvl, or mend its time column"
                " (time shift_s); a moving mean comes late by half its length."
            ),
        )


def _drift(
    log: CheckedLog, t_s: Array, commands: Array, measured: Mapping[str, tuple[Array, Array]]
) -> Iterator[Finding]:
    """Yield a lag that changes from the first half of a log to the second."""
    at = log.t_s("velocity")
    start, end = max(t_s[0], at[0]), min(t_s[-1], at[-1])
    middle = 0.5 * (start + end)
    changes = {}
    for group, axes in GROUPS.items():
        halves = []
        for first, last in ((start, middle), (middle, end)):
            inside = (t_s >= first) & (t_s <= last)
            own = [
                (t[(t >= first) & (t <= last)], values[(t >= first) & (t <= last)])
                for t, values in (measured[axis] for axis in axes if axis in measured)
            ]
            long = bool(inside.any()) and all(t.size for t, _ in own)
            halves.append(_lag(t_s[inside], commands[inside], own) if long else None)
        if halves[0] is None or halves[1] is None:
            return
        changes[group] = halves[1] - halves[0]
    velocity, gyro = changes["velocity"], changes["gyro"]
    if abs(velocity) < limit("clock_drift"):
        return
    outputs = abs(gyro - velocity) < STEADY_S
    if not outputs and abs(gyro) > STEADY_S:
        return  # nothing says whose clock it is
    rate = velocity / (middle - start)
    whose = "outputs" if outputs else "velocity"
    answer = "velocity and gyro answer" if outputs else "the velocity answers"
    yield finding(
        "clock_drift",
        f"From the first half of the log to the second {answer} the outputs {velocity:+.1f} s"
        f" later{'' if outputs else f', the gyro {gyro:+.1f} s'}: the clock of the {whose} drifts"
        f" by {100.0 * abs(rate):.1f} %.",
        stream="actuators" if outputs else "velocity",
        value=velocity,
        remedy=(
            f"Multiply the times of the {whose}, from the start of the log, by"
            f" {1.0 + rate if outputs else 1.0 - rate:.4f} before the export, or log all with one"
            " clock."
        ),
    )


def _lag(t_s: Array, commands: Array, measured: list[tuple[Array, Array]]) -> float | None:
    """Return how late motions are behind commands [s]; None where it is not clear."""
    related = relation(t_s, commands, measured) if measured else None
    if related is None or related.excess_of(related.odds_there) < CLEAR_EXCESS:
        return None
    if not LAGS_S[0] <= related.shift_s <= LAGS_S[1] and related.odds > SAME * related.odds_there:
        return None  # slow waves fit nearly as well where they are stamped
    return related.shift_s


def _inside(group: str, lag: float) -> bool:
    return bool(np.clip(lag, *ANSWER_S[group]) == lag)
