"""What a log cannot show, by name and reason."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Mask
from auvid.hydro.dynamics.actuators.thrusters import Thrusters
from auvid.hydro.identification.checks.answers import PlanarTurn
from auvid.hydro.identification.checks.response import Response
from auvid.stages.columns import ATTITUDE, GYRO, OF_FIXES, OF_POSES
from auvid.stages.ingest.health.actuation.plausible_forces import borne_weight, tells_shape
from auvid.stages.ingest.health.actuation.push_answers import (
    clear_scales,
    push_responses,
    pushes,
)
from auvid.stages.ingest.health.actuation.single_outputs import rest_of
from auvid.stages.ingest.health.agreement.motion import depth_answers
from auvid.stages.ingest.health.agreement.velocity.velocity_axes import SURE_ODDS, VelocityEvidence
from auvid.stages.ingest.health.finding import CheckedLog, finite, limit, listed
from auvid.stages.number_format import percent

Unseen = tuple[str, str]
"""What is not observable, and why."""
SURE_TURN_DEG, SURE_SCALE, LARGEST_SCALE, SURE_SHARE = 8.0, 0.05, 0.3, 0.8
"""Turn and scale of a velocity that would be seen for certain (four standard deviations),
the scale up to which one is named, and the share of a depth rate or an answer from which on
its clock would be seen.
"""
SLOW_TURN = 0.03
"""Standard deviation of a rate [rad/s] below which noise of the attitude decides."""
SURE_WEIGHT = 0.04
"""Part of the weight that the thrusters must show (three standard deviations)."""
SURE_TILT = 0.05
"""Standard deviation of roll or pitch [rad] by which a lag of .1 s is certain."""
CLEAR, CLEAR_WEIGHT, CLEAR_SHAPE = 4.0, 3.0, 25.0
SURE_ANSWER, RESTING_US, LEAST_REST = 0.95, 15.0, 0.02
"""Share of a motion that outputs explain whose clock shows to a tenth of a second; and
within what of neutral, and for what share of a log, outputs rest where it shows.
"""


def unseen(
    log: CheckedLog, evidence: VelocityEvidence, answers: Mapping[str, Response]
) -> list[dict[str, str]]:
    """Return what the log cannot show: {name, reason}."""
    if log.under_water is False:
        return []
    rows = [
        *_attitude(log),
        *_forces(log),
        *_velocity(log, evidence),
        *_clocks(log, evidence, answers),
    ]
    return [{"name": name, "reason": reason} for name, reason in rows]


def _attitude(log: CheckedLog) -> Iterator[Unseen]:
    if log.has("imu") and not log.has("attitude"):
        yield "unit, signs and axes of the gyro", "there is no attitude that turns with it"
    elif log.has("attitude") and not log.has("imu"):
        yield "unit and signs of the attitude", "there is no gyro that turns with it"
    if log.has("imu", "attitude") and np.all(
        np.std(log.values("imu", GYRO[:2]), axis=0) < SLOW_TURN
    ):
        yield (
            "smoothing of roll and pitch (means of a second)",
            "the vehicle hardly rolls or pitches",
        )
    if log.has("imu", "attitude"):
        yield (
            f"a heading that drifts by less than {math.degrees(limit('gyro_bias')):.1f} degrees/s",
            "the bias of a gyro looks the same; the heading at one place, or a track, tells it",
        )
    if log.has("depth", "velocity"):
        yield (
            f"a depth that drifts by less than {limit('velocity_zero'):g} m/s",
            "heave of the velocity log may read so much at rest",
        )
    if log.has("depth"):
        yield (
            "zero of the depth",
            "a constant of the depth moves no force; look at it at the surface",
        )
    if log.accelerometer() is None and log.has("attitude"):
        yield "zero and signs of roll and pitch", "there is no accelerometer that shows gravity"
    elif log.has("attitude"):
        yield (
            "zero of roll and pitch (to 5 degrees)",
            "units of sound logs are mounted up to 3 degrees askew, by gravity; level the vehicle"
            " in still water and read them",
        )


def _forces(log: CheckedLog) -> Iterator[Unseen]:
    if not log.has("actuators") or log.vehicle is None or log.vehicle.thrusters is None:
        return
    if pushes(log) is None:
        reason = "the outputs are recorded too slowly or not all, so that no force is made of them"
    elif not log.has("velocity"):
        reason = "nothing measures the velocity in body axes"
    elif len(clear_scales(dict(push_responses(log, "uvw")))) > 1:
        reason = ""
    else:
        reason = (
            "thrust and drag explain too little of surge, sway and heave to tell them from losses,"
            " and drag is known no better; coasts (docs/coasting.md) or drag with a stated spread"
            " (docs/howto/priors.md) tell it"
        )
    if reason:
        yield "scale of the thrust", reason
        yield (
            "mass and added mass",
            "a motion shows force over mass alone, and the scale of the thrust is not observable;"
            " what no body has is tested by the vehicle file (body_size, added_mass_size), and"
            " water in the hull belongs to both masses",
        )
    else:
        yield (
            "thrust and mass by themselves",
            "the motion shows their ratio, which agrees or is named above",
        )
    yield (
        "angles of the thrusters, moments of inertia by themselves",
        "each axis shows its force over its inertia alone, places that are all too far out too;"
        " pulls on the bench in surge, sway and yaw (docs/bench.md), or a pendulum, tell them",
    )
    if not log.has("velocity"):
        yield (
            "order and directions of the outputs, but for what is named above",
            "attitude and depth answer several orders alike where nothing measures surge and sway;"
            " turn one thruster after the other on land",
        )
    if not tells_shape(log, CLEAR_SHAPE):
        yield (
            "shape of the thrust curve, and a limit to how fast outputs change",
            "a curve turned about neutral, a root or a square of the command, or a limiter explain"
            " the motion nearly as well; pulls on the bench over all outputs tell them",
        )
    yield (
        "righting moment (centre of buoyancy)",
        "in sound logs roll and pitch answer tilts by .2 to 1.2 of what the vehicle file says; a"
        " heel under a weight at rest tells it",
    )
    borne = borne_weight(log)
    weight = log.vehicle.mass_kg * log.vehicle.gravity
    if borne is None:
        yield "weight in water (displaced mass)", "no minute of level motion shows what is held"
    elif CLEAR_WEIGHT * borne.sd > SURE_WEIGHT * weight:
        yield (
            "weight in water (displaced mass)",
            f"the thrusters show it to +- {CLEAR_WEIGHT * borne.sd:.0f} N only",
        )
    else:
        least = limit("weight_held") * weight + CLEAR_WEIGHT * borne.sd
        yield (
            f"weight in water (displaced mass) off by less than {least:.0f} N",
            "the scale of the thrust curve moves what the thrusters hold by as much; weigh the"
            " vehicle in water",
        )
    if not log.has("battery"):
        yield (
            "a thrust that sags, or outputs of another scale, in the course of the log",
            "it looks like a drag that grows; a voltage in the log and voltage_exponent in the"
            " vehicle file tell it",
        )
    if _rests_seldom(log, log.vehicle.thrusters):
        yield "neutral pulse of the outputs", "they never rest all together"


def _rests_seldom(log: CheckedLog, thrusters: Thrusters) -> bool:
    """Return whether the outputs hardly ever rest all together."""
    resting: Mask = np.ones(log.tables["actuators"].num_rows, np.bool_)
    for name in log.thrusters():
        pulses = np.nan_to_num(log.column("actuators", name), nan=NEUTRAL_US)
        resting &= np.abs(pulses - NEUTRAL_US) < RESTING_US
    if float(resting.mean()) >= LEAST_REST:
        return False
    values = log.values("actuators", log.thrusters())
    return rest_of(finite(values, nan=NEUTRAL_US), thrusters) is None


def _velocity(log: CheckedLog, evidence: VelocityEvidence) -> Iterator[Unseen]:
    if not log.has("velocity"):
        return
    if not log.has("water_velocity"):
        yield (
            "steady current",
            "one velocity alone does not tell the ground from the water; stage synthesise of a run"
            " measures it in the forces of legs that turn",
        )
    arm = evidence.arm
    unsure = [
        axis for axis in range(3) if arm is None or CLEAR * arm.sd[axis] > 2.0 * limit("arm_off")
    ]
    if unsure and not log.source("velocity").startswith((OF_FIXES, OF_POSES)):
        axes = "" if len(unsure) > 2 else f" along {listed(['xyz'[axis] for axis in unsure])}"
        yield (
            f"arm of the velocity log{axes}",
            "stage check_installation of a run measures it, over all legs together",
        )
    turns = [turn for turn in (evidence.of_accelerometer, evidence.of_track) if turn is not None]
    if not any(math.degrees(CLEAR * turn.sd) < SURE_TURN_DEG for turn in turns):
        yield (
            "turn of the velocity log about the vertical (below 45 degrees)",
            _why(log, evidence),
        )
    if evidence.of_accelerometer is None and log.has("imu"):
        yield (
            "turn of the inertial unit about the vertical (below 45 degrees)",
            f"{_why(log, evidence)}; gyro and attitude of one unit turn alike",
        )
    least = min((_least_scale(turn) for turn in turns), default=1.0)
    if least > SURE_SCALE:
        near = f" (below {percent(least)})" if least < LARGEST_SCALE else ""
        yield f"scale of surge and sway of the velocity{near}", _why(log, evidence)
    yield (
        "a constant of surge and sway of the velocity",
        "it looks like a current that turns with the vehicle; look at it at rest in still water",
    )
    if not log.has("depth"):
        yield "zero of heave of the velocity", "there is no depth"
        return
    depth = depth_answers(log)
    if depth is not None and depth.explained >= SURE_SHARE:
        least = limit("scale_off") + 1.0 - depth.explained + CLEAR * float(depth.sd.min())
        yield (
            f"scale of heave against depth below {percent(least)}",
            "water_density behind a pressure (sea for fresh water is 2.6 %) and the speed of sound"
            " of the velocity log are no larger; a length of line, or the log's own density, tells"
            " it",
        )
    if depth is None or depth.explained < SURE_SHARE:
        share = "" if depth is None else f", {percent(max(depth.explained, 0.0))} explained"
        yield (
            "scale and clock of depth against velocity, and whether it is another sensor's",
            f"the depth changes too little by what the velocity says{share}",
        )


def _least_scale(turn: PlanarTurn) -> float:
    """Return the least departure of a scale that is a finding for certain."""
    return limit("scale_off") + 1.0 - turn.explained + CLEAR * turn.sd


def _why(log: CheckedLog, evidence: VelocityEvidence) -> str:
    answer = evidence.answer
    if answer is None:
        reason = "no accelerometer with gravity in it beside a velocity log"
    else:
        share = 0.0 if answer.turn is None else max(answer.turn.explained, 0.0)
        reason = f"the accelerometer explains {percent(share)} of the changes of surge and sway"
    track = "" if log.has("position") else ", and there is no position"
    return f"{reason}{track}; stage check_installation joins all legs"


def _shows_inertial_lag(log: CheckedLog) -> bool:
    """Return whether gravity and a velocity show a lag that attitude and gyro share."""
    if not log.has("velocity") or log.accelerometer() is None:
        return False
    return bool(np.max(np.std(log.values("attitude", ATTITUDE[:2]), axis=0)) > SURE_TILT)


def _clocks(
    log: CheckedLog, evidence: VelocityEvidence, answers: Mapping[str, Response]
) -> Iterator[Unseen]:
    yield "rate of a clock that all sensors share", "a log has no second clock"
    if log.has("imu", "attitude") and not _shows_inertial_lag(log):
        yield (
            "a lag that attitude and gyro share (the filter of a unit that gives both)",
            "they agree with each other; a lag of velocity or outputs against them that is named"
            " may be theirs",
        )
    answer = evidence.answer
    odds = 0.0 if answer is None else float(answer.odds.max())
    if log.has("velocity") and odds < SURE_ODDS:
        yield "clock of the velocity against the inertial unit", "nothing shows it clearly"
    elif log.has("velocity"):
        yield (
            f"a velocity that is late by less than {limit('velocity_delay'):g} s",
            "velocity logs of sound vehicles are; a moving mean comes late by half its length",
        )
    best = max((item.explained for item in answers.values()), default=0.0)
    if log.has("actuators") and best < SURE_ANSWER:
        yield (
            "clock of the outputs to some tenths of a second",
            f"the outputs explain {percent(best)} of a motion at most",
        )
