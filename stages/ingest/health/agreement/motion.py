"""Checks of the velocity, axis by axis, against depth, position and accelerometer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.motion_checks import (
    WINDOW_S,
    accelerometer_changes,
    depth_by_axes,
    depth_gains,
    heave_zero,
    own_and_cross,
    position_gains,
    velocity_lag,
)
from auvid.hydro.identification.checks.response import Response, tone_share
from auvid.hydro.identification.checks.robust_gains import AxisGains
from auvid.stages.columns import (
    ATTITUDE,
    GYRO,
    LINEAR_VELOCITY,
    POSITION,
    SPEEDS,
)
from auvid.stages.ingest.health.actuation.frame_outputs import frame_outputs
from auvid.stages.ingest.health.actuation.mixed_commands import mixed_commands
from auvid.stages.ingest.health.actuation.output_order import joined_otherwise
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.actuation.push_answers import (
    CLEAR,
    answers_out_of_order,
    exchanged_answers,
    push_responses,
    response_signs,
    turned_answers,
    weak_forces,
)
from auvid.stages.ingest.health.actuation.responses import late_outputs
from auvid.stages.ingest.health.agreement.tilt import tilt_findings
from auvid.stages.ingest.health.agreement.velocity.velocity_arm import wrong_arm
from auvid.stages.ingest.health.agreement.velocity.velocity_axes import (
    VelocityEvidence,
    heading_findings,
    late_velocity,
    mirrored_track,
    scaled_velocity,
    turned_velocity,
)
from auvid.stages.ingest.health.agreement.velocity.velocity_depth import (
    is_rounded_away,
    level_velocity,
    unrelated_depth,
)
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    finding,
    limit,
    listed,
)
from auvid.stages.number_format import percent, significant

LEAST_EXPLAINED = 0.6
SURE_GAIN_SD = 0.25
LEAST_GAIN, LARGEST_GAIN = -0.3, -3.0
"""Gains of a velocity with a wrong sign; beyond, the part of an axis is so small in the
whole that its gain takes up what others leave.
"""
LAGS_S = np.round(np.arange(-30, 31) * 0.1, 1)
SURE_SCALE, SURE_SHARE = 1.25, 0.95
"""Limit of the scale, and the share of the depth rate that must be explained for it: what
noise takes off a gain it takes off the share as well.
"""
LARGEST_SD, FAR_BELOW = 0.1, 0.6
"""Standard deviation of a gain that tells a scale, and a gain that noise does not lower an
axis to that moves the depth less than another.
"""
LAG_GAIN, SURE_ODDS = 0.1, 25.0
"""A lag must explain so much more of the depth rate than none does, or be so much more
likely (logarithm).
"""
NEAR_LAGS_S, ENOUGH = LAGS_S[np.abs(LAGS_S) < 1.05], 0.99
"""Lags that are tried unless none explains so much, where it explains nearly all."""
ROUNDING = 1e-6
LARGEST_TONE, SURE_OF_TONE = 0.8, 0.98
"""Share of the power of a depth rate that one frequency may have, or else the part of it
that a lag must explain.
"""
UNITS: Mapping[str, float] = {
    "cm/s": 0.01,
    "mm/s": 0.001,
    "km/h": 0.2778,
    "ft/s": 0.3048,
    "knots": 0.5144,
}
"""Units of a velocity that may be declared as m/s, with its axes exchanged."""
BY_TRACK = "the position follows it"
ABSENT_GAIN = 0.3
LEAST_TILT = 0.02
"""Standard deviation of the sine of roll or pitch that tells a frame from an offset."""
OTHER_AXES, OWN_AXES, LESS_LEFT = 0.7, 0.8, 3.0
"""Part of the depth rate that other axes must explain, and the velocity's own must not,
and how much less they must leave.
"""
NAMED_SCALES: Mapping[float, str] = {
    1000.0: "depth in mm, or a velocity in m/s declared as mm/s",
    100.0: "depth in cm, or a velocity in m/s declared as cm/s",
    10.0: "depth in dm, or pressure in bar or kPa taken for metres",
    3.6: "a velocity in m/s declared as km/h",
    3.2808: "depth in ft, or a velocity in m/s declared as ft/s",
    1.4504: "depth in psi of pressure",
    2.0: "a depth that counts twice, or a velocity that counts half",
    1.9438: "a velocity in m/s declared as knots",
    0.5468: "depth in fathoms declared as m",
    0.5144: "a velocity in knots declared as m/s",
    0.5: "a depth that counts half, or a velocity that counts twice",
    0.3048: "a velocity in ft/s declared as m/s, or depth in m declared as ft",
    0.2778: "a velocity in km/h declared as m/s",
    0.1: "depth in m declared as dm, or a pressure in bar taken for metres",
    0.01: "a velocity in cm/s declared as m/s, or depth in m declared as cm",
    0.001: "a velocity in mm/s declared as m/s, or depth in m declared as mm",
}
"""Depth rate over vertical velocity, and what makes it so large."""
LEAST_OF_SMALL, SMALL = 0.25, 0.5
"""Share of the depth rate from which on a gain far below one counts, and how far."""
NEAR_SCALE = 0.12
"""Logarithm within which a scale may be a named one."""


@dataclass
class Evidence:
    """What the other sensors say against each axis of the velocity."""

    against: dict[int, list[str]] = field(default_factory=dict)

    def take(self, gains: AxisGains | None, axes: range, what: str) -> None:
        """Take the gains of some axes, where they are sure."""
        if gains is None or gains.explained < LEAST_EXPLAINED:
            return
        for axis, gain, sd in zip(axes, gains.gain, gains.sd, strict=True):
            if sd > SURE_GAIN_SD * max(1.0, abs(gain)):
                continue
            if gain + CLEAR * sd < 0.0 and LARGEST_GAIN < gain < LEAST_GAIN:
                words = f"{what} with a gain of {gain:.2f}"
                self.against.setdefault(axis, []).append(words)


def motion_findings(
    log: CheckedLog, answers: Mapping[str, Response], evidence: VelocityEvidence
) -> Iterator[Finding]:
    """Yield wrong signs, scales, axes and clocks of velocity, depth and outputs."""
    response = {} if late_outputs(log, answers) else dict(push_responses(log))
    coarse = list(_coarse(log))
    if coarse:
        yield from coarse
        return
    yield from weak_forces(response)
    of_outputs = list(joined_otherwise(log, signs=bool(response))) or list(frame_outputs(log))
    joined = any(item["id"] == "response_order" for item in of_outputs)
    exchanged = [] if joined else list(exchanged_answers(log, response))
    if not joined and not exchanged:
        exchanged = list(turned_answers(log))
    yield from of_outputs
    if exchanged:
        yield from exchanged
    elif joined:
        yield from response_signs(log, response, answers)
    else:
        yield from list(answers_out_of_order(log, response)) or response_signs(
            log, response, answers
        )
    yield from mixed_commands(log)
    if not log.has("velocity", "attitude"):
        return
    depth = depth_answers(log)
    others = list(_other_axes(log, depth))
    yield from others
    if others:
        return
    yield from level_velocity(log)
    turned = Evidence()
    found_depth = list(_depth(log, depth, response))
    yield from found_depth
    if not any(item["id"] in ("depth_sign", "velocity_scale") for item in found_depth):
        yield from _heave_zero(log)
    if depth is not None and not any(item["id"] == "depth_sign" for item in found_depth):
        turned.take(depth, range(3), "the depth rate follows it")
    mirrored = list(mirrored_track(log, evidence))
    yield from mirrored
    if not mirrored:
        turned.take(_position_gains(log), range(2), BY_TRACK)
        yield from heading_findings(log, evidence)
    changes = _changes(log)
    if changes is not None:
        correlation = own_and_cross(changes[0], changes[1] + changes[2])
        for axis in range(3):
            if correlation[axis, axis] < limit("velocity_sign"):
                turned.against.setdefault(axis, []).append(
                    f"the accelerometer (correlation {correlation[axis, axis]:.2f})"
                )
        if not exchanged:
            yield from _exchanged(correlation)
    if _only_track_tells(turned):
        yield finding(
            "heading_offset",
            f"The track ({log.source('position')}) goes where heading and velocity point away from,"
            " and nothing else turns surge and sway round: the heading is off by 180 degrees, or x"
            " and y of the track both have the wrong sign.",
            stream="attitude",
            value=180.0,
            fields=(ATTITUDE[2],),
        )
        return
    for axis, reasons in sorted(turned.against.items()):
        yield finding(
            "velocity_sign",
            f"{SPEEDS[axis].capitalize()} of the velocity ({log.source('velocity')}) has the wrong"
            f" sign: {'; '.join(reasons)}.",
            stream="velocity",
            value=-1.0,
            fields=(LINEAR_VELOCITY[axis],),
        )
    if turned.against:
        return
    late = list(_late(log.in_time()))
    yield from late
    if not any(item["stream"] == "velocity" for item in late):
        yield from late_velocity(log, evidence)
    if not exchanged and not any(item["id"] == "velocity_scale" for item in found_depth):
        if not late:
            yield from wrong_arm(log, evidence.arm)
        yield from turned_velocity(log, evidence)
        yield from scaled_velocity(log, evidence)


def _only_track_tells(turned: Evidence) -> bool:
    """Return whether a track alone turns surge and sway, and both of them."""
    reasons = [turned.against.get(axis, []) for axis in range(3)]
    of_track = [len(each) == 1 and each[0].startswith(BY_TRACK) for each in reasons]
    return of_track[0] and of_track[1] and not reasons[2]


def _coarse(log: CheckedLog) -> Iterator[Finding]:
    """Yield a velocity in steps as large as the motion, or rounded to nothing."""
    if not log.has("velocity"):
        return
    values = np.abs(log.values("velocity", LINEAR_VELOCITY))
    sizes = np.unique(values[np.isfinite(values)])
    sizes = sizes[sizes > 0.0]
    if sizes.size:
        step = float(sizes[0])
        multiples = np.abs(sizes / step - np.round(sizes / step)).max() < ROUNDING
        if step < limit("velocity_coarse") or not multiples or not np.ptp(values):
            return
        text = f"comes in steps of {significant(step)} m/s"
    elif log.has("actuators") and _driven(log):
        step, text = 0.0, "is 0 in all axes from the first to the last sample, under way"
    else:
        return
    yield finding(
        "velocity_coarse",
        f"The velocity ({log.source('velocity')}) {text}: it is rounded, or not measured.",
        stream="velocity",
        value=step,
        fields=LINEAR_VELOCITY,
    )


def _driven(log: CheckedLog) -> bool:
    """Return whether outputs act in a tenth of the samples or more."""
    moving = activity(log)
    return moving is not None and float(np.mean(moving)) > limit("little_actuation")


def _poses(log: CheckedLog) -> tuple[Array, Array, Array, Array]:
    return (
        log.t_s("attitude"),
        log.values("attitude", ATTITUDE),
        log.t_s("velocity"),
        log.body_velocity(),
    )


def depth_answers(log: CheckedLog) -> AxisGains | None:
    """Return the gains of the velocity in the depth rate, where it shows them."""
    if not log.has("depth", "velocity", "attitude"):
        return None
    return depth_gains(*log.depth_of_velocity(), *_poses(log))


def _heave_zero(log: CheckedLog) -> Iterator[Finding]:
    """Yield a heave that reads something at rest, by the depth."""
    if not log.has("depth"):
        return
    answer = heave_zero(*log.depth_of_velocity(), *_poses(log))
    if answer is None or abs(answer[0]) - CLEAR * answer[1] < limit("velocity_zero"):
        return
    zero, sd = answer
    yield finding(
        "velocity_zero",
        f"Heave of the velocity ({log.source('velocity')}) reads {zero:+.3f} +- {2.0 * sd:.3f} m/s"
        " where the depth does not change.",
        stream="velocity",
        value=zero,
        fields=(LINEAR_VELOCITY[2],),
        remedy=f"Take {zero:+.3f} m/s off the column before the export, once it is clear that the"
        " depth does not drift so.",
    )


def _other_axes(log: CheckedLog, gains: AxisGains | None) -> Iterator[Finding]:
    """Yield a velocity that explains the depth in other axes than those of the body.

    Gains of the body's axes that explain as much are a matter of sign and scale.
    """
    if gains is None:
        return
    poses = _poses(log)
    shares = depth_by_axes(*log.depth_of_velocity(), *poses)
    best = max(shares, key=lambda name: shares[name], default="body")
    in_unit = ""
    if shares and gains.explained < LEAST_EXPLAINED and shares[best] < OTHER_AXES:
        best, shares, in_unit = _in_other_units(log, poses)
    if not shares or shares[best] < OTHER_AXES or shares["body"] > OWN_AXES:
        return
    if 1.0 - shares["body"] < LESS_LEFT * (1.0 - shares[best]):
        return
    absent = (np.abs(gains.gain) < ABSENT_GAIN) & (gains.sd < SURE_GAIN_SD)
    if 1.0 - gains.explained < LESS_LEFT * (1.0 - shares[best]) and not absent.any():
        return
    over_ground = "exchanged" not in best
    tilts = np.sin(log.values("attitude", ATTITUDE)[:, :2])
    if over_ground and float(np.max(np.nanstd(tilts, axis=0))) < LEAST_TILT:
        return  # an offset of the mounting looks the same
    yield finding(
        "velocity_axes",
        f"The depth rate follows the velocity ({log.source('velocity')})"
        f" {'as ' if over_ground else 'with '}{best}{in_unit} ({percent(shares[best])} explained),"
        f" and not as it is declared ({percent(max(shares['body'], 0.0))}).",
        stream="velocity",
        value=shares[best],
        fields=LINEAR_VELOCITY,
        remedy=(
            "This is a velocity over ground: turn it into body axes with the attitude before the"
            " export, or map the log's body velocity."
            if over_ground
            else "Exchange the two columns in the column map, or check how the sensor is mounted."
        ),
    )


def _in_other_units(
    log: CheckedLog, poses: tuple[Array, Array, Array, Array]
) -> tuple[str, dict[str, float], str]:
    """Return the axes and unit in which a velocity explains the depth best.

    As name, shares of all axes, and unit in words.
    """
    t_attitude, euler, t_s, speed = poses
    depth = log.depth_of_velocity()
    tried = []
    for unit, factor in UNITS.items():
        shares = depth_by_axes(*depth, t_attitude, euler, t_s, factor * speed)
        best = max(shares, key=lambda name: shares[name], default="body")
        tried.append((shares.get(best, 0.0), best, shares, f" and in {unit}"))
    _, best, shares, words = max(tried, key=lambda each: each[0])
    return best, shares, words


def _position_gains(log: CheckedLog) -> AxisGains | None:
    if not log.has("position"):
        return None
    return position_gains(log.t_s("position"), log.values("position", POSITION), *_poses(log))


def _changes(log: CheckedLog) -> tuple[Array, Array, Array] | None:
    accelerometer = log.accelerometer()
    if accelerometer is None or log.info.accelerometer not in (None, "specific_force"):
        return None
    t_s, gyro, good = log.t_s("imu"), log.values("imu", GYRO), np.isfinite(accelerometer)
    if not good.all():  # else copies, each as large as the record
        rows = good.all(axis=1)
        t_s, gyro, accelerometer = t_s[rows], gyro[rows], accelerometer[rows]
    changes = accelerometer_changes(
        t_s,
        gyro,
        accelerometer,
        *_poses(log),
        gravity=STANDARD_GRAVITY,
    )
    return None if changes is None or len(changes[0]) < 30 else changes


def _depth(
    log: CheckedLog, gains: AxisGains | None, response: Mapping[str, AxisGains]
) -> Iterator[Finding]:
    """Yield a depth that is turned, or that differs from the velocity in scale."""
    if gains is None:
        return
    if gains.explained < LEAST_EXPLAINED:
        tilted = list(tilt_findings(log, least=LEAST_EXPLAINED))
        yield from tilted or list(_far_too_small(log, gains)) or unrelated_depth(log)
        return
    sure = np.flatnonzero(gains.sd < SURE_GAIN_SD * np.maximum(1.0, np.abs(gains.gain)))
    clear = [axis for axis in sure if abs(gains.gain[axis]) > CLEAR * gains.sd[axis]]
    if not clear:
        return
    turned = [axis for axis in clear if gains.gain[axis] < 0.0]
    if len(turned) == len(clear) and (
        len(turned) > 1
        or float(np.median(log.column("depth", "depth_m"))) < 0.0
        or ("w" in response and response["w"].gain[0] > 0.0)
    ):
        text = (
            f"Depth goes up where the velocity ({log.source('velocity')}) goes down (gain"
            f" {significant(float(gains.gain[turned[-1]]))} in"
            f" {listed([SPEEDS[axis] for axis in turned])})."
        )
        yield finding("depth_sign", text, stream="depth", value=-1.0, fields=("depth_m",))
    best = int(min(clear, key=lambda axis: gains.sd[axis] / abs(gains.gain[axis])))
    size = abs(float(gains.gain[best]))
    factor = 1.0 + limit("velocity_scale")
    most = SURE_SCALE if gains.explained > SURE_SHARE else factor
    freed = _without_arm(log) or gains
    if _is_scaled(gains, best, most) and _is_scaled(freed, best, most):
        yield finding(
            "velocity_scale",
            f"Depth moves {significant(size)} times as much as the velocity in"
            f" {SPEEDS[best]} says{_cause(size)}.",
            stream="velocity",
            value=size,
            fields=(*LINEAR_VELOCITY, "depth_m"),
        )
    else:
        yield from list(tilt_findings(log)) or _scale_off(log, freed, best)


def _is_scaled(gains: AxisGains, axis: int, most: float) -> bool:
    """Return whether a gain is clear of 1 by a factor of `most`."""
    size, room = abs(float(gains.gain[axis])), CLEAR * float(gains.sd[axis])
    return size - room > most or size + room < 1.0 / most


def _without_arm(log: CheckedLog) -> AxisGains | None:
    """Return the gains with free arms, where no vehicle file states them."""
    if log.vehicle is not None:
        return None
    return depth_gains(*log.depth_of_velocity(), *_poses(log), arm_unknown=True)


def _far_too_small(log: CheckedLog, gains: AxisGains) -> Iterator[Finding]:
    """Yield a depth that moves by less than half, whatever noise takes off its gain."""
    best = int(np.argmin(gains.sd))
    size, sd = float(gains.gain[best]), float(gains.sd[best])
    if gains.explained < LEAST_OF_SMALL or size < CLEAR * sd:
        return
    most = size / gains.explained
    if most + CLEAR * sd < SMALL:
        yield finding(
            "velocity_scale",
            f"Depth moves {significant(size)} times as much as the velocity in {SPEEDS[best]} says,"
            f" and {significant(most)} at most{_cause(size, most)}.",
            stream="velocity",
            value=size,
            fields=(*LINEAR_VELOCITY, "depth_m"),
        )


def _scale_off(log: CheckedLog, gains: AxisGains, best: int) -> Iterator[Finding]:
    """Yield axes whose gain in the depth rate is off, clear of what noise takes off it.

    A gain g that noise lowers lies between g and g / R^2 of the axis that explains most.
    """
    least = limit("scale_off")
    for axis in range(3):
        gain, sd = float(gains.gain[axis]), float(gains.sd[axis])
        if gain <= 0.0 or sd > LARGEST_SD:
            continue
        high = gain / gains.explained + CLEAR * sd < 1.0 - least
        lower = high if axis == best else gain + CLEAR * sd < FAR_BELOW
        if gain - CLEAR * sd < 1.0 + least and not lower:
            continue
        yield finding(
            "scale_off",
            f"Depth moves {gain:.2f} +- {2.0 * sd:.2f} times as much as {SPEEDS[axis]} of the"
            f" velocity ({log.source('velocity')}) says.",
            stream="velocity",
            value=gain - 1.0,
            fields=(LINEAR_VELOCITY[axis], "depth_m"),
        )


def _cause(size: float, most: float | None = None) -> str:
    """Return what makes a depth rate so large, or up to a most; all that is as near."""
    far = {
        factor: abs(float(np.log(np.clip(factor, size, most or size) / factor)))
        for factor in NAMED_SCALES
    }
    near = sorted((each for each in far if far[each] < NEAR_SCALE), key=lambda each: far[each])
    parts = [f"{factor:g} would be {NAMED_SCALES[factor]}" for factor in near]
    return f"; {', or '.join(parts)}" if parts else ""


def _exchanged(correlation: Array) -> Iterator[Finding]:
    """Yield surge and sway that follow the accelerometer's other axis."""
    own, cross = np.diag(correlation)[:2], (correlation[0, 1], correlation[1, 0])
    if max(np.abs(own)) < 0.4 and min(np.abs(cross)) > limit("velocity_axes"):
        yield finding(
            "velocity_axes",
            "Surge of the velocity follows the accelerometer's y, and sway its x (correlations"
            f" {cross[0]:.2f} and {cross[1]:.2f}).",
            stream="velocity",
            value=float(min(np.abs(cross))),
            fields=LINEAR_VELOCITY[:2],
        )


def _late(log: CheckedLog) -> Iterator[Finding]:
    if not log.has("depth"):
        return
    records = (*log.depth_of_velocity(), *_poses(log))
    lag = velocity_lag(*records, lags_s=NEAR_LAGS_S, enough=ENOUGH)
    if lag is not None and lag[2] < 1.0 - LAG_GAIN:
        lag = velocity_lag(*records, lags_s=LAGS_S)
    if lag is None or is_rounded_away(log):
        return
    at, there, zero = lag
    count = (min(records[0][-1], records[4][-1]) - max(records[0][0], records[4][0])) / WINDOW_S
    odds = 0.5 * count * float(np.log((1.0 - zero) / max(1.0 - there, 1e-9)))
    rate = np.gradient(log.column("depth", "depth_m"), log.t_s("depth"))
    tonal = at and tone_share(log.t_s("depth"), rate[:, None])[1] > LARGEST_TONE
    if tonal and there < SURE_OF_TONE:
        return  # lags repeat with the period
    slowest = max(float(np.median(np.diff(log.t_s(name)))) for name in ("depth", "velocity"))
    sure = there - zero > LAG_GAIN or odds > SURE_ODDS
    if abs(at) > max(limit("velocity_lag"), slowest) and there > 0.8 and sure:
        late, early = ("velocity", "depth") if at > 0.0 else ("depth", "velocity")
        text = (
            f"The {late} comes {abs(at):.1f} s after the {early}{log.beyond_stated}: read so much"
            f" earlier it explains {there:.2f} of the depth rate, as it stands {zero:.2f}."
        )
        yield finding("velocity_lag", text, stream=late, value=abs(at))
