"""Checks of gyro, accelerometer, attitude, depth and velocity against each other."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.motion_checks import AxisGains, tilt_gains
from auvid.hydro.identification.checks.rate_agreement import (
    RateAgreement,
    attitude_jumps,
    rate_agreement,
)
from auvid.hydro.identification.checks.signal_checks import (
    Following,
    attitude_difference,
    following,
    gravity,
)
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, GYRO, LINEAR_VELOCITY
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    counted,
    finding,
    limit,
    listed,
)
from auvid.stages.ingest.streams.mapping import OtherSource
from auvid.stages.number_format import significant

MOST_JUMPS = 20
SMALLEST_TURN_RAD_S = 0.03
"""Standard deviation of a body rate below which the rounding of the attitude decides
and nothing is compared.
"""
SMALLEST_COMPARED_RAD_S = 0.01
"""The same for the sign, which rounding does not turn."""
SLOWEST_TURN_RAD_S = 0.02
SMALLEST_CIRCLE_RAD = 1.05 * math.radians(2.0 * math.pi)
"""A whole circle in rad that is taken for degrees."""
SAME_TURN = 0.9
UNIT_SCALES = {
    180.0 / math.pi: ("it is in deg/s, declared as rad/s", "deg/s"),
    math.pi / 180.0: ("it is in rad/s, declared as deg/s", "rad/s"),
    1000.0: ("it is in mrad/s, declared as rad/s", "mrad/s"),
    0.001: ("it is in rad/s, declared as mrad/s", "rad/s"),
    0.5 / math.pi: ("it is in turns per second, declared as rad/s", "revolution/s"),
    2.0 * math.pi: ("it is in rad/s, declared as turns per second", "rad/s"),
    30.0 / math.pi: ("it is in turns per minute, declared as rad/s", "rpm"),
}
"""Gyro over rate of the attitude, which unit makes it so large, and the right one."""
GRADIANS = 400.0 / 360.0
WRAP_PART, SCALE_PART, SURE_TURN = 0.04, 0.05, 0.97
"""How near a wrap and a scale must be to that of gradians, and the least correlation;
healthy logs that correlate so well have scales from 0.96 to 1.03.
"""
SURE_TILT_SD, LEAST_TILT_SHARE = 0.1, 0.6
"""Largest standard deviation of a gain of gravity, and the least share that it explains."""
SMALLEST_MOVE_M_S = 0.03
UNITS_PER_MS2 = {"specific_force": STANDARD_GRAVITY, "inertial": 0.0, "derivative": 0.0}
OF_FIXES, OF_POSES = "fixes of ", "pose of "
"""How the sources of streams begin that are made from the poses."""
BAROMETER = re.compile(r"^(BARO|BAR2|BAR3|sensor_baro|vehicle_air_data|SCALED_PRESSURE)")
ESTIMATED = re.compile(
    r"estimate of the navigation filter|relative altitude of the navigation filter"
)
XYZ = "xyz"
GYRO_WRONG = ("gyro_sign", "gyro_axes", "gyro_scale")
"""Where the gyro itself is wrong, turns that it does not show are no jumps of the
attitude.
"""
RATES = ("roll", "pitch", "yaw")
SPEEDS = ("surge", "sway", "heave")


def inertial_findings(log: CheckedLog) -> Iterator[Finding]:
    """Compare the gyro with the attitude, and the accelerometer with gravity."""
    if not log.has("imu"):
        return
    if log.has("attitude"):
        yield from _gyro(log)
    accelerometer = log.accelerometer()
    if accelerometer is None:
        text = f"The inertial stream ({log.source('imu')}) has no accelerometer."
        yield finding("accelerometer_missing", text, stream="imu")
    else:
        yield from _gravity(log, accelerometer)


def _gyro(log: CheckedLog) -> Iterator[Finding]:
    t_s, angles = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    gyro = log.t_s("imu"), log.values("imu", GYRO)
    agreement = rate_agreement(t_s, angles, *gyro)
    if agreement is None:
        return
    gradians = list(_gradians(log, agreement, angles))
    if gradians:
        yield from gradians
        return
    if not _agrees(agreement):
        for other, item in _turned(log, angles):
            again = rate_agreement(t_s, other, *gyro)
            if again is not None and _agrees(again):
                yield item
                return
    unit = list(_unit(log, agreement))
    wrong = unit or list(_axes(agreement))
    yield from wrong
    if agreement.jumps and not any(item["id"] in GYRO_WRONG for item in wrong):
        text = (
            f"The attitude ({log.source('attitude')}) jumps {counted(agreement.jumps, 'time')}"
            f" without the gyro, by up to {math.degrees(agreement.largest_jump):.0f} degrees (at"
            f" {agreement.jump_at_s:.1f} s).{_all_jumps(attitude_jumps(t_s, angles, *gyro)[0])}"
        )
        yield finding(
            "attitude_jumps",
            text,
            stream="attitude",
            value=math.degrees(agreement.largest_jump),
            at_s=agreement.jump_at_s,
        )


def _gradians(log: CheckedLog, agreement: RateAgreement, angles: Array) -> Iterator[Finding]:
    """Yield an attitude in gradians declared as degrees, or the reverse.

    Yaw leaps by 400 at its wrap, or gyro and attitude differ by 0.9 about every axis
    that moves.
    """
    moved = _moved(agreement)
    leaps = np.abs(np.diff(angles[:, 2])) / (2.0 * math.pi)
    for turn, words, unit in (
        (GRADIANS, "gradians, declared as degrees", "grad"),
        (1.0 / GRADIANS, "degrees, declared as gradians", "deg"),
    ):
        wraps = np.abs(leaps / turn - 1.0) < WRAP_PART
        wrapped = turn > 1.0 and bool(wraps.any()) and not (np.abs(leaps - 1.0) < WRAP_PART).any()
        scale = agreement.scale[moved] * turn
        turned = bool(moved) and bool(
            (np.abs(scale - 1.0) < SCALE_PART).all()
            and all(agreement.correlation[axis, axis] > SURE_TURN for axis in moved)
        )
        if turned or wrapped:
            how = (
                f"the gyro turns {significant(float(np.median(agreement.scale[moved])))} times as"
                " much about every axis that moves"
                if turned
                else f"yaw leaps by {360.0 * turn:.0f} degrees at its wrap"
            )
            yield _attitude_unit(
                f"The attitude ({log.source('attitude')}) is in {words}: {how}.", unit
            )
            return


def _all_jumps(begins: Array) -> str:
    """Return a sentence with the times [s] to keep legs away from, if several."""
    if begins.size < 2:
        return ""
    times = ", ".join(f"{begin:.1f}" for begin in begins[:MOST_JUMPS])
    more = f" and {begins.size - MOST_JUMPS} more" if begins.size > MOST_JUMPS else ""
    return f" Jumps at {times}{more} s."


def _moved(agreement: RateAgreement) -> list[int]:
    """Return the axes about which attitude or gyro turns enough to be compared."""
    gyro = np.abs(np.nan_to_num(agreement.scale)) * agreement.std
    size = np.maximum(agreement.std, gyro)
    return [axis for axis in range(3) if size[axis] >= SMALLEST_TURN_RAD_S]


def _agrees(agreement: RateAgreement) -> bool:
    """Return whether the gyro turns as the attitude in every axis that moves."""
    moved = _moved(agreement)
    return bool(moved) and all(
        agreement.correlation[axis, axis] > SAME_TURN
        and abs(agreement.scale[axis] - 1.0) < limit("gyro_scale")
        for axis in moved
    )


def _turned(log: CheckedLog, angles: Array) -> Iterator[tuple[Array, Finding]]:
    """Yield attitudes (n, 3) behind which a wrong map may stand, and the finding."""
    used = f"The attitude ({log.source('attitude')})"
    for axes in ((0, 1, 2), (2,), (0, 1)):
        part = angles[:, axes]
        if np.abs(part).max() > 2.0 * math.pi:
            other = angles.copy()
            other[:, axes] = np.radians(part)
            yield (
                other,
                _attitude_unit(
                    f"{used} is in degrees, declared as rad: {listed([RATES[i] for i in axes])}"
                    f" reach {np.abs(part).max():.0f}, and taken for degrees they turn as the gyro"
                    " does.",
                    "deg",
                    tuple(ATTITUDE[i] for i in axes),
                ),
            )
    turn = np.abs(np.diff(angles, axis=0)).max(axis=1) / np.diff(log.t_s("attitude"))
    if np.abs(angles).max() < SMALLEST_CIRCLE_RAD and np.median(turn) < SLOWEST_TURN_RAD_S:
        yield (
            np.degrees(angles),
            _attitude_unit(
                f"{used} hardly turns and is in rad, declared as degrees: taken for rad it turns as"
                " the gyro does.",
                "rad",
            ),
        )
    for axes in ((1, 2), (2,), (1,), (0,)):
        other = angles.copy()
        other[:, axes] = -other[:, axes]
        names, letters = listed([RATES[i] for i in axes]), listed([XYZ[i] for i in axes])
        yield (
            other,
            finding(
                "gyro_sign",
                f"Gyro {letters} turn{'s' * (len(axes) == 1)} against {names} of the attitude; with"
                " the other sign of either they agree.",
                stream="imu",
                value=-1.0,
                fields=tuple(name for i in axes for name in (GYRO[i], ATTITUDE[i])),
            ),
        )
    yield (
        angles[:, (1, 0, 2)],
        finding(
            "gyro_axes",
            f"Roll and pitch of the attitude ({log.source('attitude')}) are exchanged: the other"
            " way round they turn as the gyro does.",
            stream="attitude",
            value=1.0,
            fields=ATTITUDE[:2],
        ),
    )


def _attitude_unit(text: str, unit: str, fields: tuple[str, ...] = ATTITUDE) -> Finding:
    remedy = f"Set unit: {unit} for the column{'s' * (len(fields) > 1)} of {listed(fields)}."
    return finding("attitude_unit", text, stream="attitude", fields=fields, remedy=remedy)


def _unit(log: CheckedLog, agreement: RateAgreement) -> Iterator[Finding]:
    """Yield one finding where gyro and attitude differ by the scale of a known unit."""
    moved = _moved(agreement)
    if not moved or any(agreement.correlation[axis, axis] < SAME_TURN for axis in moved):
        return
    scale = float(np.median(agreement.scale[moved]))
    factor = next((size for size in UNIT_SCALES if abs(np.log(scale / size)) < 0.15), None)
    if factor is None or np.ptp(np.log(agreement.scale[moved])) > 0.4:
        return
    cause, unit = UNIT_SCALES[factor]
    yield finding(
        "gyro_scale",
        f"The gyro ({log.source('imu')}) turns {significant(scale)} times as much as the attitude"
        f" about every axis that moves: {cause}.",
        stream="imu",
        value=scale - 1.0,
        fields=GYRO,
        remedy=f"Set unit: {unit} for the columns of the gyro.",
    )


def _axes(agreement: RateAgreement) -> Iterator[Finding]:
    """Yield bias, sign, axes, scale and lag of the gyro against the attitude."""
    moved = [axis for axis in range(3) if agreement.std[axis] >= SMALLEST_COMPARED_RAD_S]
    largest = int(np.argmax(np.abs(agreement.bias)))
    if abs(agreement.bias[largest]) > limit("gyro_bias"):
        text = (
            f"Gyro {XYZ[largest]} reads {agreement.bias[largest]:+.3f} rad/s more than the attitude"
            " turns (median)."
        )
        yield finding("gyro_bias", text, stream="imu", value=float(abs(agreement.bias[largest])))
    agreeing = []
    for axis in moved:
        own = float(agreement.correlation[axis, axis])
        best = int(np.argmax(np.abs(agreement.correlation[axis])))
        if own < limit("gyro_sign"):
            text = (
                f"Gyro {XYZ[axis]} turns against {RATES[axis]} of the attitude (correlation"
                f" {own:.2f})."
            )
            yield finding("gyro_sign", text, stream="imu", value=own, fields=(GYRO[axis],))
        elif agreement.std[axis] < SMALLEST_TURN_RAD_S:
            continue
        elif best != axis and abs(agreement.correlation[axis, best]) > max(
            limit("gyro_axes"), abs(own) + 0.3
        ):
            text = (
                f"{RATES[axis].capitalize()} of the attitude is followed by gyro {XYZ[best]} and"
                f" not by gyro {XYZ[axis]}."
            )
            yield finding(
                "gyro_axes", text, stream="imu", value=float(abs(agreement.correlation[axis, best]))
            )
        elif own < limit("gyro_disagrees"):
            text = (
                f"Gyro {XYZ[axis]} and {RATES[axis]} of the attitude hardly agree (correlation"
                f" {own:.2f})."
            )
            yield finding("gyro_disagrees", text, stream="imu", value=own)
        else:
            agreeing.append(axis)
            off = float(agreement.scale[axis]) - 1.0
            if abs(off) > limit("gyro_scale"):
                text = (
                    f"Gyro {XYZ[axis]} turns {significant(1.0 + off)} times as much as"
                    f" {RATES[axis]} of the attitude."
                )
                yield finding("gyro_scale", text, stream="imu", value=off)
    if agreeing and abs(agreement.lag_s) > limit("gyro_lag"):
        late, early = ("gyro", "attitude") if agreement.lag_s > 0.0 else ("attitude", "gyro")
        yield finding(
            "gyro_lag",
            f"The {late} comes {abs(agreement.lag_s):.2f} s after the {early}.",
            stream="imu",
            value=abs(agreement.lag_s),
        )


def _gravity(log: CheckedLog, accelerometer: Array) -> Iterator[Finding]:
    attitude = (
        (log.t_s("attitude"), log.values("attitude", ATTITUDE))
        if log.has("attitude")
        else (None, None)
    )
    estimate = gravity(log.t_s("imu"), accelerometer, *attitude)
    if estimate is None:
        return
    size = estimate.magnitude
    convention = log.info.accelerometer or (
        log.vehicle and log.vehicle.document.sensors.imu.accelerometer
    )
    expected = UNITS_PER_MS2.get(str(convention), STANDARD_GRAVITY)
    if abs(size - 1.0) < limit("accelerometer_unit"):
        text = (
            f"The accelerometer reads {size:.3f} (median length) and not {STANDARD_GRAVITY:.2f}:"
            " it is in g."
        )
        yield finding("accelerometer_unit", text, stream="imu", value=size)
    elif abs(size - expected) > limit("accelerometer_convention"):
        text = (
            f"The accelerometer reads {size:.2f} m/s^2 (median length);"
            f" {convention or 'specific_force'} at rest is {expected:g}."
        )
        yield finding("accelerometer_convention", text, stream="imu", value=size)
    if size > STANDARD_GRAVITY / 2.0 or abs(size - 1.0) < limit("accelerometer_unit"):
        wrong = list(_direction(log, accelerometer, estimate.angle))
        yield from wrong or _tilt_axes(log, accelerometer)


def _tilt_axes(log: CheckedLog, accelerometer: Array) -> Iterator[Finding]:
    """Yield an accelerometer whose x follows the roll, and its y the pitch."""
    good = np.isfinite(accelerometer).all(axis=1)
    if not log.has("attitude") or not good.any():
        return
    gains = tilt_gains(
        log.t_s("imu")[good],
        accelerometer[good],
        log.t_s("attitude"),
        log.values("attitude", ATTITUDE),
        gravity=STANDARD_GRAVITY,
    )
    if gains is None:
        return
    (x_own, x_other), (y_other, y_own) = gains
    crossed = all(_is_gravity(item) for item in (x_other, y_other))
    if not crossed or _is_gravity(x_own) or _is_gravity(y_own):
        return
    assert x_other is not None
    assert y_other is not None
    signs = "" if x_other.gain[0] > 0.0 < y_other.gain[0] else ", with another sign"
    yield finding(
        "accelerometer_axes",
        f"The accelerometer's x reads gravity as the roll turns it, and its y as the pitch does"
        f"{signs} (gains {x_other.gain[0]:.2f} and {y_other.gain[0]:.2f}).",
        stream="imu",
        value=float(min(abs(x_other.gain[0]), abs(y_other.gain[0]))),
        fields=ACCELEROMETER[:2],
    )


def _is_gravity(item: AxisGains | None) -> bool:
    """Return whether a reading holds gravity, of either sign."""
    return (
        item is not None
        and item.sd[0] < SURE_TILT_SD
        and item.explained > LEAST_TILT_SHARE
        and abs(abs(item.gain[0]) - 1.0) < limit("accelerometer_axes")
    )


def _direction(log: CheckedLog, accelerometer: Array, angle: float | None) -> Iterator[Finding]:
    if angle is not None and math.degrees(angle) > limit("accelerometer_direction"):
        degrees = math.degrees(angle)
        text = (
            f"The accelerometer points {degrees:.0f} degrees (median) away from where the attitude"
            " has gravity."
        )
        yield finding("accelerometer_direction", text, stream="imu", value=degrees)
    elif (
        angle is None
        and float(np.nanmedian(accelerometer[:, 2]))
        > np.nanmedian(np.linalg.norm(accelerometer, axis=1)) / 2.0
    ):
        text = (
            "The accelerometer's z is positive: an upright vehicle shows -9.81 m/s^2 in z, which"
            " points down."
        )
        yield finding("accelerometer_direction", text, stream="imu", value=180.0)


def attitude_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield other attitudes of the log that disagree with the one that is used."""
    if not log.has("attitude"):
        return
    used = log.source("attitude")
    off = []
    for other in _comparable(log, "attitude"):
        assert other.columns is not None
        angles = np.stack([other.columns[name] for name in ATTITUDE], axis=1)
        difference = attitude_difference(
            log.t_s("attitude"),
            log.values("attitude", ATTITUDE),
            log.seconds(other.columns["time_us"]),
            angles,
        )
        if difference is not None and math.degrees(difference.angle) > limit("attitude_disagrees"):
            off.append(
                (
                    math.degrees(difference.angle),
                    other.source,
                    math.degrees(difference.heading),
                    math.degrees(difference.tilt),
                )
            )
    if off:
        sources = [f"{name} by {angle:.0f} degrees" for angle, name, _, _ in off]
        angle, _, heading, tilt = max(off)
        where = f"heading {heading:.0f}, tilt {tilt:.0f} degrees"
        text = (
            f"Attitudes disagree: {used}, which is used, and {listed(sources)} (median; {where})."
        )
        yield finding("attitude_disagrees", text, stream="attitude", value=angle)


def _comparable(log: CheckedLog, stream: str) -> list[OtherSource]:
    used = log.source(stream)
    return [
        other
        for other in log.others
        if other.stream == stream and other.source != used and other.columns is not None
    ]


def depth_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield wrong signs of depth, a barometer in the housing, depths that disagree."""
    if not log.has("depth"):
        return
    depth, t_s = log.column("depth", "depth_m"), log.t_s("depth")
    level = float(np.median(depth))
    if level < limit("depth_above_water") and not _of_a_pose(log):
        yield finding(
            "depth_above_water", f"The median depth is {level:.2f} m.", stream="depth", value=level
        )
    least = float(depth.min())
    if least > limit("depth_zero_unseen") and _of_csv(log):
        yield finding(
            "depth_zero_unseen",
            f"Whether the depth ({log.source('depth')}) has the pressure of the air in it, 10 m of"
            f" water, is not observable: it is never less than {least:.1f} m.",
            stream="depth",
            value=least,
            fields=("depth_m",),
        )
    if any(note.startswith("depth") and ESTIMATED.search(note) for note in log.info.notes):
        text = f"Depth is taken from {log.source('depth')}, an estimate of the navigation filter."
        yield finding("depth_estimated", text, stream="depth")
    yield from _other_depths(log, t_s, depth)


def _of_csv(log: CheckedLog) -> bool:
    return all(str(item.format).startswith("CSV") for item in log.info.files)


def _of_a_pose(log: CheckedLog) -> bool:
    """Return whether depth is made from a pose, whose zero need not be the surface.

    A column that is mapped to depth says that it is one, whatever else it is mapped to.
    """
    return log.source("depth").startswith(OF_POSES)


def _other_depths(log: CheckedLog, t_s: Array, depth: Array) -> Iterator[Finding]:
    used, moved = log.source("depth"), _spread(depth)
    others = _comparable(log, "depth")
    for other in others:
        assert other.columns is not None
        values, at = other.columns["depth_m"], log.seconds(other.columns["time_us"])
        relation = following(t_s, depth, at, values)
        if relation is None:
            continue
        own = _spread(values)
        pressures = BAROMETER.match(other.source) and (BAROMETER.match(used) or used == "CTUN")
        if pressures and log.under_water is not False and _in_housing(relation, own, moved):
            named = log.vehicle is not None and log.vehicle.barometer_instance is not None
            reason = _choice(named, any(item.source == "CTUN" for item in others))
            text = (
                f"{other.source} reads {_range(values)} while {used} reads {_range(depth)}: it sits"
                f" in the housing. {used} is used{reason}."
            )
            yield finding("housing_barometer", text, stream="depth", value=own)
        elif (
            moved > limit("housing_barometer")
            and relation.correlation > 0.9
            and _wrong_unit(relation.scale)
        ):
            text = (
                f"{other.source} moves {significant(relation.scale)} times as much as {used}: the"
                " log declares a wrong unit for it."
            )
            yield finding("depth_unit", text, stream="depth", value=relation.scale)
        elif moved > limit("housing_barometer") and (
            abs(relation.scale - 1.0) > limit("depth_disagrees") or relation.correlation < 0.5
        ):
            text = (
                f"{other.source} moves {significant(relation.scale)} times as much as {used}"
                f" (correlation {relation.correlation:.2f})."
            )
            yield finding("depth_disagrees", text, stream="depth", value=abs(relation.scale - 1.0))


def _range(values: Array) -> str:
    # Adding zero keeps a rounded -0.004 from being shown as -0.00.
    low, high = (round(float(value), 2) + 0.0 for value in (np.min(values), np.max(values)))
    return f"{low:.2f} to {high:.2f} m"


def _in_housing(relation: Following, own: float, moved: float) -> bool:
    """Return whether a second barometer moves on its own.

    It does if it moves much more than a depth that hardly moves, or unlike one that
    does.
    """
    if moved < limit("housing_barometer"):
        return own > moved + limit("housing_barometer")
    return abs(relation.scale - 1.0) > 0.5 or relation.correlation < 0.5


def _wrong_unit(scale: float) -> bool:
    return any(
        abs(scale / factor - 1.0) < 0.1 for factor in (0.001, 0.01, 0.1, 10.0, 100.0, 1000.0)
    )


def _choice(named: bool, controller: bool) -> str:
    if named:
        return ", because the vehicle file names it"
    return (
        ", because it agrees with the vehicle's own depth (CTUN)"
        if controller
        else ", because it saw the larger pressures"
    )


def _spread(values: Array) -> float:
    low, high = np.percentile(values, (5.0, 95.0))
    return float(high - low)


def velocity_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield velocities that are unaided or estimates, or that contradict each other."""
    refused = [
        other for other in log.others if other.stream == "velocity" and other.refused is not None
    ]
    unaided = [other for other in refused if "navigation filter" in str(other.refused)]
    if unaided:
        text = (
            f"The velocity of {listed([item.source for item in unaided])} is not offered:"
            f" {unaided[0].refused}."
        )
        yield finding("unaided_velocity", text, stream="velocity")
    if log.has("velocity") and any(
        note.startswith("velocity") and ESTIMATED.search(note) for note in log.info.notes
    ):
        text = f"Velocity is the estimate of the navigation filter ({log.source('velocity')})."
        yield finding("estimated_velocity", text, stream="velocity")
    if log.has("velocity"):
        yield from _other_velocities(log)


def _other_velocities(log: CheckedLog) -> Iterator[Finding]:
    used, t_s, own = (
        log.source("velocity"),
        log.t_s("velocity"),
        log.values("velocity", LINEAR_VELOCITY),
    )
    for other in _comparable(log, "velocity"):
        assert other.columns is not None
        at = log.seconds(other.columns["time_us"])
        against = []
        for axis, name in enumerate(LINEAR_VELOCITY):
            values = other.columns[name]
            if min(_spread(own[:, axis]), _spread(values)) < SMALLEST_MOVE_M_S:
                continue
            relation = following(t_s, own[:, axis], at, values)
            if relation is not None and relation.correlation < limit("velocity_disagrees"):
                against.append((relation.correlation, SPEEDS[axis]))
        if against:
            text = (
                f"{other.source} moves against {used} in {listed([name for _, name in against])}"
                f" (correlation {min(against)[0]:.2f})."
            )
            yield finding("velocity_disagrees", text, stream="velocity", value=min(against)[0])
