"""How motion follows the outputs in time, per axis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from auvid.hydro.identification.checks.answers import slow_answer
from auvid.hydro.identification.checks.response import Response, response_lag
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS, motions
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.actuation.push_answers import push_responses
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit
from auvid.stages.number_format import percent

LAGS_S = (-1.5, 2.5)
ANSWER_LAGS_S = np.arange(0.0, 2.6, 0.2)
SLOWEST_S, EQUALLY_WELL = 15.0, 0.05
"""Longest time constant of a hull, and by how much less of the motion it may explain
than commands that are early.
"""
RESPONSE_HZ = 20.0
SMALLEST_MOTION = 0.03
LEAST_EXPLAINED = 0.6
DRIVES_SD = 6.0
"""Gain of the outputs over its standard deviation from which on they drive a motion."""


def responses(log: CheckedLog) -> dict[str, Response]:
    """Return how motion follows the outputs, per axis that they explain."""
    if not log.has("actuators") or log.under_water is False:
        return {}
    names = log.thrusters() + log.commands()
    clock = log.clock("actuators")
    moving = activity(log)
    if (
        not names
        or clock is None
        or clock.rate_hz < limit("low_actuator_rate")
        or moving is None
        or not moving.any()
    ):
        return {}
    commands = np.nan_to_num(log.values("actuators", names))
    answers = {}
    for axis, (at, motion, _) in motions(log).items():
        if float(np.std(motion)) < SMALLEST_MOTION:
            continue
        response = response_lag(
            log.t_s("actuators"), commands, at, motion, lags_s=LAGS_S, rate_hz=RESPONSE_HZ
        )
        if (
            response is not None
            and response.explained >= limit("command_lag")
            and LAGS_S[0] < response.lag_s < LAGS_S[1]
        ):
            answers[axis] = response
    return answers


def command_lead(answers: Mapping[str, Response]) -> tuple[str, Response] | None:
    """Return the axis that answers best, if its motion comes before the outputs."""
    if not answers:
        return None
    axis = max(answers, key=lambda name: answers[name].explained)
    best = answers[axis]
    late = best.explained > LEAST_EXPLAINED and best.lag_s < -limit("command_late")
    return (axis, best) if late else None


def late_outputs(log: CheckedLog, answers: Mapping[str, Response]) -> tuple[str, Response] | None:
    """Return the axis whose motion comes before the outputs, unless they drive it.

    Outputs of an autopilot that holds a vehicle in waves follow the motion, and yet their
    force accelerates it at its own time.
    """
    lead = command_lead(answers)
    if lead is None:
        return None
    return None if drives(log, lead[0]) else lead


def drives(log: CheckedLog, axis: str) -> bool:
    """Return whether the force of the outputs accelerates an axis at its own time."""
    own = dict(push_responses(log)).get(axis)
    return own is not None and bool(own.gain[0] > DRIVES_SD * own.sd[0])


def slow_by_itself(log: CheckedLog, axis: str, less: float = EQUALLY_WELL) -> bool:
    """Return whether drag and inertia explain by themselves how late a motion comes.

    less: by how much less of the motion they may explain than commands that are early.
    """
    at, motion, _ = motions(log)[axis]
    commands = np.nan_to_num(log.values("actuators", log.thrusters() + log.commands()))
    answer = slow_answer(log.t_s("actuators"), commands, at, motion, lags_s=ANSWER_LAGS_S)
    return (
        answer is not None
        and answer.time_constant_s < SLOWEST_S
        and answer.slow > answer.late - less
    )


def response_findings(
    log: CheckedLog, answers: Mapping[str, Response], *, of_axis: bool
) -> Iterator[Finding]:
    """Yield how much later motion follows the outputs, per axis.

    of_axis: one axis of the velocity is out of time by itself, so that the outputs are not.
    """
    lead = None if of_axis else late_outputs(log, answers)
    if lead is not None:
        axis, best = lead
        drifts = -best.lag_s > limit("clock_drift")
        yield finding(
            "command_late",
            f"{MOTION_WORDS[axis].capitalize()} moves {-best.lag_s:.2f} s before the outputs that"
            f" drive it ({percent(round(best.explained, 2))} explained): the outputs are stamped"
            f" late, or the sensors early{', or a clock drifts' if drifts else ''}.",
            stream="actuators",
            value=-best.lag_s,
        )
    far = [axis for axis in answers if answers[axis].lag_s > limit("commands_early")]
    # One axis alone may be slow, or repeat within the shift.
    if len(far) > 1 and len(far) == len(answers):
        axis = max(far, key=lambda name: answers[name].explained)
        best = answers[axis]
        if best.explained > LEAST_EXPLAINED and not all(slow_by_itself(log, name) for name in far):
            yield finding(
                "commands_early",
                f"{MOTION_WORDS[axis].capitalize()} follows the outputs that drive it by"
                f" {best.lag_s:.2f} s ({percent(round(best.explained, 2))} explained), longer than"
                " thruster and hull take: the outputs are stamped early, or the sensors late.",
                stream="actuators",
                value=best.lag_s,
            )
    lags = []
    for axis, response in answers.items():
        how = (
            f"follows by {response.lag_s:.2f} s"
            if response.lag_s > 0.0
            else f"leads by {-response.lag_s:.2f} s (a controller answers it)"
        )
        lags.append(
            (
                response.explained,
                f"{MOTION_WORDS[axis]} {how}, {percent(round(response.explained, 2))} explained",
            )
        )
    if lags:
        text = f"Motion against outputs: {'; '.join(words for _, words in lags)}."
        yield finding("command_lag", text, stream="actuators", value=max(lags)[0])
