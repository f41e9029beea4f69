"""How motion follows the outputs in time, per axis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from auvid.hydro.identification.checks.answers import slow_answer
from auvid.hydro.identification.checks.response import Response, response_lag, tone_share
from auvid.stages.columns import LINEAR_VELOCITY
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS, motions
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.actuation.push_answers import push_responses
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed
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
EARLY_S, LATER_S, LATEST_S = 0.15, 0.5, 0.9
"""Lead over the outputs, and lag over all other axes of the velocity, from which on an axis
is out of time by itself; and lag of the others that hulls and thrusters make at most.
"""
LARGEST_TONE = 0.7
"""Part of the power of a motion that one frequency may have where its lag tells."""
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
    return None if _drives(log, lead[0]) else lead


def _drives(log: CheckedLog, axis: str) -> bool:
    """Return whether the force of the outputs accelerates an axis at its own time."""
    own = dict(push_responses(log)).get(axis)
    return own is not None and bool(own.gain[0] > DRIVES_SD * own.sd[0])


def _slow(log: CheckedLog, axis: str) -> bool:
    """Return whether drag and inertia explain by themselves how late a motion comes."""
    at, motion, _ = motions(log)[axis]
    commands = np.nan_to_num(log.values("actuators", log.thrusters() + log.commands()))
    answer = slow_answer(log.t_s("actuators"), commands, at, motion, lags_s=ANSWER_LAGS_S)
    return (
        answer is not None
        and answer.time_constant_s < SLOWEST_S
        and answer.slow > answer.late - EQUALLY_WELL
    )


def axis_out_of_time(answers: Mapping[str, Response]) -> tuple[str, float] | None:
    """Return the axis of the velocity that is late by itself, and by how much [s].

    It follows the outputs much later than the other axes do, or comes before them while
    the others follow: negative. Heave that is late is told by the depth: where a hull holds
    its depth it is slow (1.18 s for .57 s on a recorded dive).
    """
    lags = {axis: answers[axis].lag_s for axis in "uvw" if axis in answers}
    if len(lags) < 2:
        return None
    for axis, lag in lags.items():
        others = [each for name, each in lags.items() if name != axis]
        usual = float(np.mean(others))
        if lag < -EARLY_S and min(others) > EARLY_S:
            return axis, lag - usual
        if axis != "w" and max(others) < LATEST_S and lag > max(others) + LATER_S:
            return axis, lag - usual
    return None


def _axis_findings(log: CheckedLog, answers: Mapping[str, Response]) -> Iterator[Finding]:
    """Yield an axis of the velocity with another clock, or filter, than the others."""
    single = axis_out_of_time(answers)
    if single is None or log.estimated("velocity"):
        return
    axis, off_s = single
    at, motion, _ = motions(log)[axis]
    if tone_share(at, motion[:, None])[1] > LARGEST_TONE:
        return  # lags repeat with the period
    if off_s < 0.0 and _drives(log, axis):
        return  # a controller answers the motion
    others = [
        f"{MOTION_WORDS[name]} by {answers[name].lag_s:.2f} s"
        for name in "uvw"
        if name in answers and name != axis
    ]
    late = "late" if off_s > 0.0 else "early"
    yield finding(
        "velocity_lag",
        f"{MOTION_WORDS[axis].capitalize()} of the velocity ({log.source('velocity')}) follows the"
        f" outputs by {answers[axis].lag_s:.2f} s, {listed(others)}: {MOTION_WORDS[axis]} alone is"
        f" some {abs(off_s):.1f} s {late}"
        f"{', by a filter or another clock' if off_s > 0.0 else ': a setpoint, or another clock'}.",
        stream="velocity",
        value=abs(off_s),
        fields=(LINEAR_VELOCITY["uvw".index(axis)],),
        remedy=f"Map the measured {MOTION_WORDS[axis]} as it is, no setpoint and no filtered one,"
        " or mend the time of this column before the export.",
    )


def response_findings(log: CheckedLog, answers: Mapping[str, Response]) -> Iterator[Finding]:
    """Yield how much later motion follows the outputs, per axis."""
    single = list(_axis_findings(log, answers))
    yield from single
    lead = None if single else late_outputs(log, answers)
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
        if best.explained > LEAST_EXPLAINED and not all(_slow(log, name) for name in far):
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
