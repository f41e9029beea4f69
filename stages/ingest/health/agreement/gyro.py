"""Checks of the gyro against the attitude, and of the unit of the attitude."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from auvid.hydro.arrays import Array, median
from auvid.hydro.identification.checks.attitude.angle_turns import angle_turns
from auvid.hydro.identification.checks.attitude.rate_agreement import (
    RateAgreement,
    attitude_jumps,
    axis_lag,
    deviation,
    in_order,
    other_order,
    rate_agreement,
)
from auvid.hydro.identification.checks.motion_checks import angles_at
from auvid.hydro.identification.signals.pose.frames import (
    euler_of_quaternion,
    quaternion_of_euler,
)
from auvid.stages.columns import ATTITUDE, GYRO, OF_YAW, RATES
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    finding,
    how_often,
    limit,
    listed,
)
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
LONGER_S = 0.4
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
LARGEST_GRADIANS = 2.1 * math.pi * GRADIANS
"""A whole circle of gradians that are taken for degrees; a yaw in degrees is far beyond."""
WRAP_PART, SCALE_PART, SURE_TURN = 0.04, 0.05, 0.97
"""How near a wrap and a scale must be to that of gradians, and the least correlation;
healthy logs that correlate so well have scales from 0.96 to 1.03.
"""
XYZ = "xyz"
QUATERNION_ORDERS = {
    "x, y, z, w and not w, x, y, z": (3, 0, 1, 2),
    "w, x, y, z and not x, y, z, w": (1, 2, 3, 0),
}
"""Order of the file, and the place in the quaternion w, x, y, z as it is read of the right
w, x, y, z.
"""
ANGLE_COLUMNS = {
    (1, 0, 2): "roll and pitch",
    (2, 1, 0): "roll and yaw",
    (0, 2, 1): "pitch and yaw",
    (1, 2, 0): "columns of roll, pitch and yaw",
    (2, 0, 1): "columns of roll, pitch and yaw",
}
"""Places of roll, pitch and yaw among the columns, and what is exchanged."""
SMALLEST_TILT_RAD = math.radians(2.0)
LEFT_BY_ORDER, SURE_ORDER = 0.8, 40.0
"""What another order of turns may leave of what ZYX leaves, and its least log likelihood:
clean logs with 2 degrees of roll and pitch have at most 20.
"""
SURE_LAG = 30.0
"""Least log likelihood of a lag over none, by an axis in which both agree: 22 at most on 340
slow swings in noise without one, from 58 on where .15 s are laid on any of 266 sound logs.
"""
LEAST_TURNED = 4.0
"""Range of headings [rad] from which on waves of once and twice a turn are told from each
other and from the scale of the gyro: over 2.9 rad 15 degrees are found of .9.
"""
LEAST_OF_DEVIATION, LARGEST_DEVIATION_DEG, CLEAR = 0.8, 40.0, 4.0
"""Share of what heading and gyro differ by that a deviation explains, how large one is, and in
how many of its standard deviations it is clear: a gyro of 2 Hz makes one of 74 degrees.
"""
ORDER_WORDS = {"X": "roll", "Y": "pitch", "Z": "yaw"}
GYRO_WRONG = ("gyro_sign", "gyro_axes", "gyro_scale")
"""Where the gyro itself is wrong, turns that it does not show are no jumps of the
attitude.
"""


def gyro_findings(log: CheckedLog) -> Iterator[Finding]:
    """Compare the gyro with the attitude: unit, sign, axes, scale, lag, jumps."""
    if not log.has("imu", "attitude"):
        return
    t_s, angles = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    gyro = log.t_s("imu"), log.values("imu", GYRO)
    agreement = rate_agreement(t_s, angles, *gyro)
    if agreement is None:
        return
    only_yaw_rate = log.source("imu").startswith(OF_YAW)
    if only_yaw_rate:  # roll and pitch would be compared with themselves
        agreement = replace(agreement, std=agreement.std * [0.0, 0.0, 1.0])
    gradians = list(_gradians(log, agreement, angles))
    if gradians:
        yield from gradians
        return
    if not only_yaw_rate:
        of_angles = [
            *_other_order(log, t_s, angles, gyro),
            *_late_angles(agreement, t_s, angles, gyro),
        ]
        if of_angles:
            yield from of_angles
            return
    if not (only_yaw_rate or agrees(agreement)):
        for other, item in _turned(log, angles):
            again = rate_agreement(t_s, other, *gyro)
            if again is not None and agrees(again):
                yield item
                return
    unit = list(_unit(log, agreement))
    wrong = unit or list(_axes(agreement, lambda: _over_longer_times(t_s, angles, gyro)))
    if not wrong and not only_yaw_rate and not {0, 1} & set(moved_axes(agreement)):
        wrong = list(_quiet_axes(t_s, angles, gyro))
    yield from wrong
    if not wrong:
        yield from _deviation(t_s, angles, gyro)
    if agreement.jumps and not any(item["id"] in GYRO_WRONG for item in wrong):
        text = (
            f"The attitude ({log.source('attitude')}) jumps {how_often(agreement.jumps)}"
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


def _other_order(
    log: CheckedLog, t_s: Array, angles: Array, gyro: tuple[Array, Array]
) -> Iterator[Finding]:
    """Yield angles of turns in another order than yaw, pitch, roll."""
    if float(np.std(angles[:, :2], axis=0).min()) < SMALLEST_TILT_RAD:
        return
    other = other_order(t_s, angles, *gyro)
    if other is None or other[1] > LEFT_BY_ORDER or other[2] < SURE_ORDER:
        return
    again = rate_agreement(t_s, in_order(angles, other[0]), *gyro)
    if again is None or not agrees(again):
        return
    words = ", ".join(ORDER_WORDS[axis] for axis in other[0])
    yield finding(
        "attitude_order",
        f"The attitude ({log.source('attitude')}) turns as the gyro does if its angles are turns in"
        f" the order {words} ({other[0]}), and leaves {1.0 / other[1]:.1f} times as much in the"
        " order yaw, pitch, roll (ZYX) that they are read in.",
        stream="attitude",
        value=1.0 / other[1],
        fields=ATTITUDE,
    )


def _late_angles(
    agreement: RateAgreement, t_s: Array, angles: Array, gyro: tuple[Array, Array]
) -> Iterator[Finding]:
    """Yield angles that are late, or early, while others are in time."""
    moved, least = moved_axes(agreement), limit("gyro_lag")
    if not any(abs(agreement.lags_s[axis]) > least for axis in moved):
        return
    for axes in ((2,), (0, 1), (0,), (1,)):
        fastest = max(axes, key=lambda axis: agreement.std[axis])
        lag = axis_lag(t_s, angles, *gyro, axis=fastest) if fastest in moved else None
        if lag is None or abs(lag) < least:
            continue
        other = angles.copy()
        other[:, axes] = angles_at(t_s - lag, t_s, angles)[:, axes]
        again = rate_agreement(t_s, other, *gyro)
        if again is None or not agrees(again) or np.abs(again.lags_s[moved]).max() > 0.5 * least:
            continue
        names = listed([RATES[axis] for axis in axes])
        others = [RATES[axis] for axis in range(3) if axis not in axes]
        several = len(axes) > 1
        yield finding(
            "gyro_lag",
            f"{names.capitalize()} of the attitude come{'s' * (not several)} {abs(lag):.2f} s"
            f" {'before' if lag > 0.0 else 'after'} the gyro; {listed(others)}"
            f" {'is' if several else 'are'} in time: {names} alone pass{'es' * (not several)} a"
            f" filter, or come{'s' * (not several)} by another clock.",
            stream="attitude",
            value=abs(lag),
            fields=tuple(ATTITUDE[axis] for axis in axes),
            remedy="Write it to a file of its own, whose column map has the time shift_s that takes"
            " it back, or take an angle that is not filtered.",
        )
        return


def _deviation(t_s: Array, angles: Array, gyro: tuple[Array, Array]) -> Iterator[Finding]:
    """Yield a heading that deviates with itself, as of a compass beside iron."""
    swing = deviation(t_s, angles, *gyro)
    if swing is None or swing.turned < LEAST_TURNED or swing.explained < LEAST_OF_DEVIATION:
        return
    size, sd = math.degrees(swing.angle), math.degrees(swing.sd)
    if size - CLEAR * sd < limit("heading_deviation") or size > LARGEST_DEVIATION_DEG:
        return
    yield finding(
        "heading_deviation",
        f"The heading swings by {size:.0f} +- {2.0 * sd:.0f} degrees to either side as it turns"
        " round, by the gyro, as that of a compass beside iron or a magnet does.",
        stream="attitude",
        value=size,
        fields=(ATTITUDE[2],),
    )


def _gradians(log: CheckedLog, agreement: RateAgreement, angles: Array) -> Iterator[Finding]:
    """Yield an attitude in gradians declared as degrees, or the reverse.

    Yaw leaps by 400 at its wrap, or gyro and attitude differ by 0.9 about every axis
    that moves.
    """
    if np.abs(angles).max() > LARGEST_GRADIANS:
        return
    moved = moved_axes(agreement)
    leaps = np.abs(np.diff(angles[:, 2])) / (2.0 * math.pi)
    for turn, words, unit in (
        (GRADIANS, "gradians, declared as degrees", "grad"),
        (1.0 / GRADIANS, "degrees, declared as gradians", "deg"),
    ):
        wraps = np.abs(leaps / turn - 1.0) < WRAP_PART
        wrapped = turn > 1.0 and bool(wraps.any()) and not (np.abs(leaps - 1.0) < WRAP_PART).any()
        scale = agreement.scale[moved] * turn
        in_time = abs(agreement.lag_s) < limit("gyro_lag")  # a filtered gyro is late and smaller
        turned = (
            bool(moved)
            and in_time
            and bool(
                (np.abs(scale - 1.0) < SCALE_PART).all()
                and all(agreement.correlation[axis, axis] > SURE_TURN for axis in moved)
            )
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


def moved_axes(agreement: RateAgreement) -> list[int]:
    """Return the axes about which attitude or gyro turns enough to be compared."""
    gyro = np.abs(np.nan_to_num(agreement.scale)) * agreement.std
    size = np.maximum(agreement.std, gyro)
    return [axis for axis in range(3) if size[axis] >= SMALLEST_TURN_RAD_S]


def agrees(agreement: RateAgreement) -> bool:
    """Return whether the gyro turns as the attitude in every axis that moves."""
    moved = moved_axes(agreement)
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
    for axes in ((0, 1, 2), (2,), (0, 1)):
        part = angles[:, axes]
        turn = np.abs(np.diff(part, axis=0)).max(axis=1) / np.diff(log.t_s("attitude"))
        if np.abs(part).max() > SMALLEST_CIRCLE_RAD or np.median(turn) > SLOWEST_TURN_RAD_S:
            continue
        other = angles.copy()
        other[:, axes] = np.degrees(part)
        words = "" if len(axes) == 3 else f", its {listed([RATES[i] for i in axes])},"
        yield (
            other,
            _attitude_unit(
                f"{used}{words} hardly turns and is in rad, declared as degrees: taken for rad it"
                " turns as the gyro does.",
                "rad",
                tuple(ATTITUDE[i] for i in axes),
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
    parts = quaternion_of_euler(angles) * [1.0, -1.0, -1.0, -1.0]
    yield (
        euler_of_quaternion(parts),
        finding(
            "gyro_axes",
            f"{used} is that of the earth in axes of the body: the other way round (the"
            " quaternion's x, y and z with the other sign) it turns as the gyro does.",
            stream="attitude",
            value=1.0,
            fields=ATTITUDE,
            remedy="Turn the sign of the columns of qx, qy and qz, or transpose the rotation.",
        ),
    )
    for words, order in QUATERNION_ORDERS.items():
        parts = quaternion_of_euler(angles)[:, order]
        yield (
            euler_of_quaternion(parts),
            finding(
                "gyro_axes",
                f"{used} comes from a quaternion whose parts are in another order: taken for"
                f" {words}, it turns as the gyro does.",
                stream="attitude",
                value=1.0,
                fields=ATTITUDE,
                remedy="Correct the columns of the quaternion: w is its scalar part.",
            ),
        )
    for places, words in ANGLE_COLUMNS.items():
        yield (
            angles[:, places],
            finding(
                "gyro_axes",
                f"{words[0].upper()}{words[1:]} of the attitude ({log.source('attitude')}) are"
                " exchanged: the other way round they turn as the gyro does.",
                stream="attitude",
                value=1.0,
                fields=ATTITUDE[:2] if places[2] == 2 else ATTITUDE,
                remedy="Correct the columns of roll, pitch and yaw in the column map.",
            ),
        )


def _attitude_unit(text: str, unit: str, fields: tuple[str, ...] = ATTITUDE) -> Finding:
    remedy = f"Set unit: {unit} for the column{'s' * (len(fields) > 1)} of {listed(fields)}."
    return finding("attitude_unit", text, stream="attitude", fields=fields, remedy=remedy)


def _unit(log: CheckedLog, agreement: RateAgreement) -> Iterator[Finding]:
    """Yield one finding where gyro and attitude differ by the scale of a known unit."""
    moved = moved_axes(agreement)
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


def _quiet_axes(t_s: Array, angles: Array, gyro: tuple[Array, Array]) -> Iterator[Finding]:
    """Yield gyro x and y that are exchanged or turned, where both hardly move."""
    left: dict[tuple[tuple[int, int], tuple[int, int]], float] = {}
    explained: dict[tuple[tuple[int, int], tuple[int, int]], bool] = {}
    count = 0
    for order in ((0, 1), (1, 0)):
        turns = angle_turns(t_s, angles, gyro[0], gyro[1][:, [*order, 2]])
        if turns is None:
            return
        turned = _spread(turns.by_angle[:, :2])
        for signs in product((1, -1), (1, -1)):
            rest = (turns.by_angle - turns.by_gyro @ [*signs, 1.0])[:, :2]
            off = _spread(rest)
            count, left[order, signs] = len(rest), float(np.log(np.maximum(off, 1e-9)).sum())
            explained[order, signs] = bool((off < LEFT_BY_ORDER * turned).all())
    order, signs = min(left, key=lambda each: left[each])
    gained = left[(0, 1), (1, 1)] - left[order, signs]
    if not explained[order, signs] or count * gained < SURE_ORDER:
        return
    taken = [
        f"{'-' if sign < 0 else ''}gyro {XYZ[place]}"
        for place, sign in zip(order, signs, strict=True)
    ]
    yield finding(
        "gyro_axes" if order == (1, 0) else "gyro_sign",
        f"Roll and pitch of the attitude, which hardly move, turn as {listed(taken)} do, and not as"
        " gyro x and y.",
        stream="imu",
        value=-1.0 if order == (0, 1) else 1.0,
        fields=GYRO[:2],
    )


def _spread(values: Array) -> Array:
    """Return the median (k,) of the departures of values (n, k) from their median."""
    return median(np.abs(values - median(values)))


def _over_longer_times(t_s: Array, angles: Array, gyro: tuple[Array, Array]) -> Array:
    """Return the correlations (3,) of turns over .4 s.

    The noise of an angle decides the turns of a quiet vehicle from sample to sample, and
    a twentieth of them over a second.
    """
    step_s = float(np.median(np.diff(t_s)))
    rows = slice(None, None, max(1, round(LONGER_S / max(step_s, 1e-3))))
    agreement = rate_agreement(t_s[rows], angles[rows], *gyro)
    return np.zeros(3) if agreement is None else np.diag(agreement.correlation)


def _axes(agreement: RateAgreement, slowly: Callable[[], Array]) -> Iterator[Finding]:
    """Yield bias, sign, axes, scale and lag of the gyro against the attitude.

    slowly: returns the correlations (3,) of turns over .4 s.
    """
    in_gyro = moved_axes(agreement)  # an attitude in rad taken for degrees hardly moves
    moved = [
        axis
        for axis in range(3)
        if agreement.std[axis] >= SMALLEST_COMPARED_RAD_S
        or (axis in in_gyro and agreement.correlation[axis, axis] > SAME_TURN)
    ]
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
        elif axis not in in_gyro:
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
        elif own < limit("gyro_disagrees") and (
            agreement.usual[axis] < SMALLEST_COMPARED_RAD_S
            or slowly()[axis] > limit("gyro_disagrees")
        ):
            continue  # quiet, and the angle is noisy, or settles once
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
                factor = next((s for s in UNIT_SCALES if abs(np.log((1.0 + off) / s)) < 0.15), None)
                cause = {
                    180.0 / math.pi: ": the angle is in rad, declared as deg, or the gyro in deg/s",
                    math.pi / 180.0: ": the angle is in deg, declared as rad, or the gyro in rad/s",
                }
                text = (
                    f"Gyro {XYZ[axis]} turns {significant(1.0 + off)} times as much as"
                    f" {RATES[axis]} of the attitude{cause.get(factor or 0.0, '')}."
                )
                yield finding(
                    "gyro_scale",
                    text,
                    stream="imu",
                    value=off,
                    fields=(GYRO[axis], ATTITUDE[axis]),
                )
    sure = any(agreement.lag_odds[axis] > SURE_LAG for axis in agreeing)
    if sure and abs(agreement.lag_s) > limit("gyro_lag"):
        late, early = ("gyro", "attitude") if agreement.lag_s > 0.0 else ("attitude", "gyro")
        yield finding(
            "gyro_lag",
            f"The {late} comes {abs(agreement.lag_s):.2f} s after the {early}.",
            stream="imu",
            value=abs(agreement.lag_s),
        )
