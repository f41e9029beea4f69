"""Checks of the accelerometer against gravity: unit, convention, sign, axes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.attitude.rate_agreement import rate_agreement
from auvid.hydro.identification.checks.motion_checks import down_at, tilt_gains
from auvid.hydro.identification.checks.robust_gains import AxisGains
from auvid.hydro.identification.checks.signal_checks import Gravity, gravity
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, GYRO, OF_FIXES, OF_POSES, RATES
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

SURE_TILT_SD, LEAST_TILT_SHARE = 0.1, 0.6
"""Largest standard deviation of a gain of gravity, and the least share that it explains."""
CLEAR, MOST_OF_LEVEL, SAME_TILT = 4.0, 0.5, 0.9
"""Gain of gravity, with four standard deviations, of level axes, where roll and pitch turn as
the gyro does: sound recordings and twins have .5 to 1.3, the same in axes of the earth 0 to .4.
"""
NAMED_UNITS = {
    STANDARD_GRAVITY**-2: "it was turned from m/s^2 to g twice",
    STANDARD_GRAVITY: "it is in m/s^2, declared as g",
    100.0: "it is in cm/s^2",
    1000.0 / STANDARD_GRAVITY: "it is in mg",
}
"""Reading at rest over 9.81 m/s^2, and what makes it so."""
UNITS_PER_MS2 = {"specific_force": STANDARD_GRAVITY, "inertial": 0.0, "derivative": 0.0}

SIDES = str.maketrans("xy", "yx")
"""The gyro's axis about which gravity turns into an axis of the accelerometer."""
OF_SPECIFIC = 1.0 / 3.0
"""Part of the limit for a reading that holds gravity, whose length motion hardly changes."""
LEAST_OF_GRAVITY = 0.3
"""Part of gravity from which on a reading is one of another scale and of no convention."""
SCALED_REMEDY = (
    "No convention reads so at rest: its unit or scale is wrong. Check the unit of its columns,"
    " take another accelerometer, or leave its columns out: stages.fuse.method: kinematic needs"
    " none."
)


def accelerometer_findings(log: CheckedLog) -> Iterator[Finding]:
    """Compare the accelerometer with gravity, or say that there is none."""
    if not log.has("imu"):
        return
    accelerometer = log.accelerometer()
    if accelerometer is None:
        text = f"The inertial stream ({log.source('imu')}) has no accelerometer."
        yield finding("accelerometer_missing", text, stream="imu")
    else:
        yield from _gravity(log, accelerometer)


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
    elif abs(size - expected) > limit("accelerometer_convention") * (
        OF_SPECIFIC if expected else 1.0
    ):
        text = (
            f"The accelerometer reads {size:.2f} m/s^2 (median length);"
            f" {convention or 'specific_force'} at rest is {expected:g}{_cause(size, estimate)}."
        )
        scaled = size > LEAST_OF_GRAVITY * STANDARD_GRAVITY and expected > 0.0
        yield finding(
            "accelerometer_convention",
            text,
            stream="imu",
            value=size,
            remedy=SCALED_REMEDY if scaled else "",
        )
    if size > STANDARD_GRAVITY / 2.0 or abs(size - 1.0) < limit("accelerometer_unit"):
        wrong = list(_direction(log, accelerometer, estimate.angle))
        wrong = wrong or list(_tilt_axes(log, accelerometer))
        yield from wrong or _constant_tilt(log, accelerometer)


def _cause(size: float, estimate: Gravity) -> str:
    """Return what makes the reading so large or small, if it points along gravity."""
    if estimate.angle is None or math.degrees(estimate.angle) > limit("accelerometer_direction"):
        return ""
    factor = size / STANDARD_GRAVITY
    for unit, words in NAMED_UNITS.items():
        if abs(math.log(factor / unit)) < limit("accelerometer_unit"):
            return f": {words}"
    return ""


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
    turned = [
        place
        for place, item in enumerate((x_own, y_own))
        if _is_gravity(item) and item is not None and item.gain[0] < 0.0
    ]
    if turned:
        yield _turned_tilt(turned)
        return
    if _is_level(log, x_own, y_own):
        yield finding(
            "accelerometer_axes",
            "The accelerometer's x and y read no gravity as pitch and roll turn: they are level, in"
            " axes of the earth or turned by the attitude, and not those of the body.",
            stream="imu",
            value=0.0,
            fields=ACCELEROMETER[:2],
            remedy="Map the accelerometer as it is mounted, before it is turned by the attitude.",
        )
        return
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


def _constant_tilt(log: CheckedLog, accelerometer: Array) -> Iterator[Finding]:
    """Yield a constant tilt between the accelerometer and the attitude."""
    good = np.isfinite(accelerometer).all(axis=1)
    if not log.has("attitude") or not good.any():
        return
    attitude = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    size = np.maximum(np.linalg.norm(accelerometer[good], axis=1), 1e-9)
    up = accelerometer[good] / size[:, None]
    turns = np.cross(down_at(log.t_s("imu")[good], *attitude), up)
    turns = turns[np.isfinite(turns).all(axis=1)]
    if not turns.size:
        return
    turn = np.median(turns, axis=0)
    tilt = math.degrees(math.asin(min(float(np.linalg.norm(turn)), 1.0)))
    if tilt <= limit("accelerometer_tilt"):
        return
    by_axis = np.degrees(turn)
    parts = [
        f"{RATES[axis]} {by_axis[axis]:+.0f} degrees"
        for axis in (0, 1)
        if abs(by_axis[axis]) > tilt / 3.0
    ]
    yield finding(
        "accelerometer_tilt",
        f"The accelerometer is tilted by {tilt:.0f} degrees against the attitude ({listed(parts)}),"
        " which no acceleration does all along.",
        stream="imu",
        value=tilt,
        fields=ACCELEROMETER,
    )


def _turned_tilt(turned: list[int]) -> Finding:
    """Return the finding of tilts that gravity goes against; places of x and y."""
    axes = listed(["xy"[place] for place in turned])
    angles = listed([("pitch", "roll")[place] for place in turned])
    several = len(turned) > 1
    return finding(
        "accelerometer_axes",
        f"The accelerometer's {axes} read{'s' * (not several)} gravity the wrong way round as"
        f" {angles} turn{'s' * (not several)}: {axes} of the accelerometer, or {angles} together"
        f" with the gyro's {axes.translate(SIDES)}, ha{'ve' if several else 's'} the wrong sign.",
        stream="imu",
        value=-1.0,
        fields=[ACCELEROMETER[place] for place in turned],
        remedy=(
            "Set sign: -1 for these columns of the accelerometer, or for the angle and its rate"
            " (frame: flu where the body axes are forward, left, up)."
        ),
    )


def _is_gravity(item: AxisGains | None) -> bool:
    """Return whether a reading holds gravity, of either sign."""
    return (
        item is not None
        and item.sd[0] < SURE_TILT_SD
        and item.explained > LEAST_TILT_SHARE
        and abs(abs(item.gain[0]) - 1.0) < limit("accelerometer_axes")
    )


def _is_level(log: CheckedLog, *own: AxisGains | None) -> bool:
    """Return whether no tilt that the gyro shows as well is in x and y.

    A hull in waves, or one that swings on a rope, is accelerated against its tilt and reads
    none of it either: a measured velocity has to show that it is not.
    """
    velocity = "velocity" if log.has("velocity") else ""
    if not velocity or log.source("velocity").startswith((OF_FIXES, OF_POSES)) or _tilts(own):
        return False
    t_s, gyro = log.t_s("imu"), log.values("imu", GYRO)
    t_velocity, t_attitude = log.t_s("velocity"), log.t_s("attitude")
    attitude = log.values("attitude", ATTITUDE)
    speed = np.column_stack([np.interp(t_s, t_velocity, part) for part in log.body_velocity().T])
    force = log.values("imu", ACCELEROMETER) - np.gradient(speed, t_s, axis=0)
    force -= np.cross(gyro, speed)
    good = np.isfinite(force).all(axis=1) & (t_s >= t_velocity[0]) & (t_s <= t_velocity[-1])
    if not good.any():
        return False
    gains = tilt_gains(t_s[good], force[good], t_attitude, attitude, gravity=STANDARD_GRAVITY)
    if gains is None or _tilts((gains[0][0], gains[1][1])):
        return False
    agreement = rate_agreement(t_attitude, attitude, t_s, gyro)
    return agreement is not None and bool(
        min(agreement.correlation[axis, axis] for axis in (0, 1)) > SAME_TILT
    )


def _tilts(own: Iterable[AxisGains | None]) -> bool:
    """Return whether x or y may read gravity as the hull tilts."""
    return any(
        item is None or abs(item.gain[0]) + CLEAR * item.sd[0] > MOST_OF_LEVEL for item in own
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
