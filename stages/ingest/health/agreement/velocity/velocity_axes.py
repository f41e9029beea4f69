"""Turn, scale and clock of the velocity, by accelerometer and a track of its own."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.answers import PlanarTurn, track_turn
from auvid.hydro.identification.checks.velocity_answer import (
    LARGE_TURN_RAD,
    ArmOffset,
    AxisScales,
    VelocityAnswer,
    axis_scales,
    velocity_answer,
)
from auvid.stages.columns import ATTITUDE, LINEAR_VELOCITY, OF_FIXES, OF_POSES, POSITION, SPEEDS
from auvid.stages.ingest.health.actuation.push_answers import CLEAR
from auvid.stages.ingest.health.agreement.velocity.velocity_arm import clear_arm, inertial_motion
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    finding,
    limit,
    mounting_remedy,
)

LAGS_S = tuple(np.round(np.arange(-15, 31) * 0.1, 1).tolist())
NO_DELAY_S = (-0.1, 0.1)
USUAL_LAGS_S = (-0.2, 0.4)
"""Of a velocity log behind the accelerometer, beyond those of the vehicle file."""
SURE_ODDS = 25.0
"""Logarithm of the likelihood of a lag over all usual ones, from which on it counts."""
LEAST_EXPLAINED = 0.6
SURE_TURN_RAD, TURNED_ROUND = math.radians(4.0), 135.0
"""Largest standard error of a turn, and the angle [deg] beyond which one axis or both
have the wrong sign.
"""
CLEAR_TURN = 3.0
"""Standard deviations beyond the limit at which a turn counts: the worst of 27 sound legs
is 5.4 +- 1.25 degrees.
"""
SURE_AXIS = 0.9
"""Least share of the changes of surge and sway each that tells their scales apart."""
BETTER_MIRRORED = 0.3
"""By how much more of a track a mirrored one must explain."""
NEAR_UNIT = 0.08
OF_UNITS = {
    0.3048: "a position in ft, or a velocity in m/s declared as ft/s",
    0.5144: "a velocity in m/s declared as knots",
    0.01: "a position in cm, or a velocity in m/s declared as cm/s",
    1.9438: "a velocity in knots",
    3.2808: "a velocity in ft/s, or a position in m declared as ft",
    3.6: "a velocity in km/h",
}
"""Scale of the velocity, and what makes it so large or small; logarithm within which."""
MIRRORS = {
    0: "its x and y (north and east) are exchanged",
    90: "its y (east) has the wrong sign",
    -90: "its x (north) has the wrong sign",
    180: "its x and y (north and east) are exchanged and both have the wrong sign",
}
"""Turn [deg] of the track with x and y exchanged, and what was done to it."""


@dataclass(frozen=True)
class VelocityEvidence:
    """What accelerometer and track say of the velocity; None where there is none.

    `mirrored`: the turn of the track with its x and y exchanged. `arm`: by how much that
    of the velocity log is off; `answer` is beyond it where it is clear.
    """

    answer: VelocityAnswer | None = None
    arm: ArmOffset | None = None
    scales: AxisScales | None = None
    track: PlanarTurn | None = None
    mirrored: PlanarTurn | None = None

    @property
    def of_accelerometer(self) -> PlanarTurn | None:
        """Return the turn by the accelerometer where it is sure."""
        return _sure(None if self.answer is None else self.answer.turn)

    @property
    def of_track(self) -> PlanarTurn | None:
        """Return the turn of the track where it is sure."""
        return _sure(self.track)


def _sure(turn: PlanarTurn | None) -> PlanarTurn | None:
    sure = turn is not None and turn.explained >= LEAST_EXPLAINED and turn.sd <= SURE_TURN_RAD
    return turn if sure else None


def velocity_evidence(log: CheckedLog) -> VelocityEvidence:
    """Return what accelerometer and track say of the velocity."""
    if not log.has("velocity", "attitude") or not np.isfinite(log.body_velocity()).all():
        return VelocityEvidence()
    track = mirrored = None
    if log.has("position") and not _of_the_heading(log):
        times, position = log.t_s("position"), log.values("position", POSITION)
        poses = log.t_s("attitude"), log.values("attitude", ATTITUDE)
        velocity = log.t_s("velocity"), log.body_velocity()
        track = track_turn(times, position, *poses, *velocity)
        mirrored = track_turn(times, position[:, [1, 0, 2]], *poses, *velocity)
    return VelocityEvidence(*_accelerometer(log), track, mirrored)


def _accelerometer(
    log: CheckedLog,
) -> tuple[VelocityAnswer | None, ArmOffset | None, AxisScales | None]:
    motion = inertial_motion(log)
    if motion is None:
        return None, None, None
    t_velocity, speed = motion.velocity
    arm = motion.arm()
    if arm is not None and clear_arm(arm).any():
        speed = motion.at_arm(arm.offset * clear_arm(arm))
    answer = velocity_answer(
        motion.imu, motion.attitude, (t_velocity, speed), gravity=STANDARD_GRAVITY, lags_s=LAGS_S
    )
    scales = axis_scales(motion.imu, motion.attitude, (t_velocity, speed), gravity=STANDARD_GRAVITY)
    return answer, arm, scales


def _of_the_heading(log: CheckedLog) -> bool:
    """Return whether position or velocity was made with the heading, so both agree."""
    if log.source("velocity").startswith((OF_FIXES, OF_POSES)):
        return True
    return log.source("position").startswith(OF_POSES) or log.estimated("position")


def mirrored_track(log: CheckedLog, evidence: VelocityEvidence) -> Iterator[Finding]:
    """Yield a track that goes as its mirror image should."""
    turn = _sure(evidence.mirrored)
    own = 0.0 if evidence.track is None else max(evidence.track.explained, 0.0)
    if turn is None or turn.explained - own < BETTER_MIRRORED:
        return
    angle = math.degrees(turn.angle)
    nearest = min(MIRRORS, key=lambda each: abs((angle - each + 180.0) % 360.0 - 180.0))
    yield finding(
        "position_axes",
        f"The track ({log.source('position')}) is the mirror image of the one that heading and"
        f" velocity make ({turn.explained:.2f} of it explained mirrored, {own:.2f} as it stands):"
        f" {MIRRORS[nearest]}.",
        stream="position",
        value=turn.explained,
        fields=POSITION[:2],
    )


def heading_findings(log: CheckedLog, evidence: VelocityEvidence) -> Iterator[Finding]:
    """Yield a heading that is off against the track, or that nothing shows."""
    turn = evidence.of_track
    if turn is None:
        yield finding(
            "heading_unseen",
            "Whether the heading is off by a constant is not observable: no position of its own"
            " moves enough beside the velocity.",
            stream="attitude",
        )
        return
    off = math.degrees(turn.angle)
    if abs(off) < max(limit("heading_offset"), math.degrees(CLEAR * turn.sd)):
        return
    if abs(off) > TURNED_ROUND:
        return  # a matter of signs
    mounted = evidence.of_accelerometer
    text = (
        f"The track ({log.source('position')}) is turned by {off:+.0f} +-"
        f" {math.degrees(2.0 * turn.sd):.0f} degrees against heading and velocity"
        f" ({log.source('velocity')}), clockwise from above: the heading reads so much too"
        f" {'little' if off > 0.0 else 'much'}, or the velocity's axes are turned so much."
    )
    if mounted is not None:
        text += f" By the accelerometer the latter are turned by {_degrees(mounted, -1.0)}."
    yield finding("heading_offset", text, stream="attitude", value=off, fields=(ATTITUDE[2],))


def _degrees(turn: PlanarTurn, sign: float = 1.0) -> str:
    angle, sd = math.degrees(sign * turn.angle), math.degrees(2.0 * turn.sd)
    return f"{angle:+.1f} +- {sd:.1f} degrees"


def _delayed(log: CheckedLog, answer: VelocityAnswer) -> Iterator[Finding]:
    """Yield a velocity that is late as a filter or a mean makes it."""
    lag = answer.lag_s
    if abs(lag) < limit("velocity_delay") or answer.better_than(NO_DELAY_S) < SURE_ODDS:
        return
    late = "late" if lag > 0.0 else "early"
    cause = f", as a delay or a moving mean of {2.0 * lag:.1f} s makes it" if lag > 0.0 else ""
    yield finding(
        "velocity_delay",
        f"The velocity ({log.source('velocity')}) is some {abs(lag):.1f} s {late} against the"
        f" accelerometer{log.beyond_stated}{cause}.",
        stream="velocity",
        value=lag,
        fields=LINEAR_VELOCITY,
    )


def turned_velocity(log: CheckedLog, evidence: VelocityEvidence) -> Iterator[Finding]:
    """Yield a velocity log turned about the vertical, by the accelerometer."""
    turn = evidence.of_accelerometer
    if turn is None:
        return
    off = math.degrees(turn.angle)
    if not limit("velocity_turned") + math.degrees(CLEAR_TURN * turn.sd) < abs(off) < TURNED_ROUND:
        return
    yield finding(
        "velocity_turned",
        f"The axes of surge and sway of the velocity ({log.source('velocity')}) are turned by"
        f" {_degrees(turn, -1.0)} about the vertical, clockwise from above and beside a stated"
        f" mounting, by what the accelerometer adds up to ({turn.explained:.2f} explained).",
        stream="velocity",
        value=-off,
        fields=LINEAR_VELOCITY[:2],
        remedy=f"{mounting_remedy(log)}, or that of the inertial unit.",
    )


def scaled_velocity(log: CheckedLog, evidence: VelocityEvidence) -> Iterator[Finding]:
    """Yield a velocity that is too large or small against accelerometer or track."""
    single = list(_single_scales(log, evidence.scales, evidence.of_accelerometer))
    if single:
        yield from single
        return
    if evidence.of_accelerometer is not None:
        turn = evidence.of_accelerometer
        yield from _scale(log, turn, turn.scale, turn.bounds, "the accelerometer adds up to")
    if evidence.of_track is not None:
        turn = evidence.of_track
        words = f"the track ({log.source('position')}) shows"
        low, high = turn.bounds
        yield from _scale(log, turn, 1.0 / turn.scale, (1.0 / high, 1.0 / low), words)


def _single_scales(
    log: CheckedLog, scales: AxisScales | None, turn: PlanarTurn | None
) -> Iterator[Finding]:
    """Yield surge or sway of another scale than the other one, by the accelerometer."""
    if scales is None or scales.explained.min() < SURE_AXIS:
        return
    if turn is not None and abs(turn.angle) > LARGE_TURN_RAD:
        return  # its axes are not surge and sway
    off = 1.0 - 1.0 / scales.scale
    difference = abs(float(off[0] - off[1])) - CLEAR * float(np.hypot(*scales.sd))
    clear = np.abs(off) - CLEAR * scales.sd - (1.0 - scales.explained) > limit("scale_off")
    if difference < limit("scale_off"):
        return
    for axis in np.flatnonzero(clear).tolist():
        scale = float(scales.scale[axis])
        yield finding(
            "scale_off",
            f"{SPEEDS[axis].capitalize()} of the velocity ({log.source('velocity')}) is"
            f" {scale:.2f} +- {2.0 * scale * float(scales.sd[axis]):.2f} times what the"
            " accelerometer adds up to, and the other axis is not.",
            stream="velocity",
            value=scale - 1.0,
            fields=(LINEAR_VELOCITY[axis],),
        )


def _scale(
    log: CheckedLog, turn: PlanarTurn, scale: float, bounds: tuple[float, float], words: str
) -> Iterator[Finding]:
    """Yield a scale that is off, as fitted and without what noise took off it."""
    low, high = bounds
    least, sd = limit("scale_off"), CLEAR * turn.scale_sd * scale
    if low - sd < 1.0 + least and high + sd > 1.0 - least:
        return
    yield finding(
        "scale_off",
        f"Surge and sway of the velocity ({log.source('velocity')}) are {scale:.2f} +-"
        f" {2.0 * turn.scale_sd * scale:.2f} times what {words}{_unit_of(scale)}.",
        stream="velocity",
        value=scale - 1.0,
        fields=LINEAR_VELOCITY[:2],
    )


def _unit_of(scale: float) -> str:
    """Return the units that make a velocity so much larger than the other record."""
    near = [factor for factor in OF_UNITS if abs(math.log(scale / factor)) < NEAR_UNIT]
    return "".join(f"; {factor:g} would be {OF_UNITS[factor]}" for factor in near)


def late_velocity(log: CheckedLog, evidence: VelocityEvidence) -> Iterator[Finding]:
    """Yield a velocity that is late or early against the accelerometer."""
    answer = evidence.answer
    if answer is None:
        return
    drift = answer.drift
    if abs(drift.change_s) > limit("clock_drift") and drift.better_than_none > SURE_ODDS:
        yield finding(
            "clock_drift",
            f"From the first half of the log to the second the velocity ({log.source('velocity')})"
            f" comes {drift.change_s:+.1f} s later behind the accelerometer: the clock of the"
            " velocity, or that of the inertial unit, drifts.",
            stream="velocity",
            value=drift.change_s,
            fields=("time_us",),
        )
        return
    lag = answer.lag_s
    if abs(lag) < limit("velocity_lag") or answer.better_than(USUAL_LAGS_S) < SURE_ODDS:
        yield from _delayed(log, answer)
        return
    yield finding(
        "velocity_lag",
        f"The velocity ({log.source('velocity')}) comes {abs(lag):.1f} s"
        f" {'after' if lag > 0.0 else 'before'} the accelerometer{log.beyond_stated}.",
        stream="velocity",
        value=abs(lag),
        fields=LINEAR_VELOCITY,
    )
