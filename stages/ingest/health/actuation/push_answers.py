"""Checks of the motion against the thrusters' force: axes, signs, order of outputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from auvid.data_schemas.tables import matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import Thrusters, thruster_force, thruster_forces
from auvid.hydro.dynamics.vehicle.logged_directions import with_logged_directions
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.checks.motion_checks import (
    angles_at,
    gains_by_lag,
    gains_by_motion,
    most_explained,
    response_gains,
)
from auvid.hydro.identification.checks.response import Response
from auvid.hydro.identification.checks.robust_gains import AxisGains
from auvid.hydro.long_series.long_arrays import laid_down, let_go
from auvid.stages.columns import ATTITUDE, GYRO, LINEAR_VELOCITY, OF_POSES, RATES, SPEEDS
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    finding,
    limit,
    listed,
    mounting_remedy,
)
from auvid.stages.number_format import significant

LEAST_RESPONSE_HZ = 4.0
ROWS_AT_ONCE = 16_384
USUAL_LAGS_S, OTHER_LAGS_S = (0.0, 0.1, 0.2, 0.3), (-1.2, -0.9, -0.6, -0.3, 0.5, 0.7, 1.0, 1.3)
"""Motion behind its thrusters, and lags of clocks that are off, which turn a sign."""
EARLIER_S, BETTER_EARLIER = (-0.4, -0.3, -0.2, -0.1), 25.0
"""Lags of outputs that are stamped a little late, and by how much more likely one of them
has to be in surge, sway and heave.
"""
SOONEST_YAW_S, YAW_S = 0.1, 0.3
"""Lag of yaw behind the outputs below which no hull turns by them, and its usual one: .23 to
.51 s in sound logs that a pilot or a plan steers.
"""
LEAST_TILTED = 0.1
"""Share of roll or pitch that they must explain then."""
RIGHTED = (3, 4)
"""Axes that gravity and buoyancy turn back: roll and pitch."""
LEAST_ANSWERED, LEAST_RIGHTED = 0.1, 0.5
"""Share of a motion that thrusters must explain to be backward. Roll and pitch follow the moment
of the added mass of a hull that moves ahead and down, which no log without a velocity through
the water tells: .28 and .37 of pitch are explained backward then, .86 where it is told.
"""
SMALLEST_MOTION = 0.01
ANSWER_GAP = 0.3
"""By how much more of the motion other axes must explain than the velocity's own."""
MOSTLY, UNLIKE_SHARE = 0.6, 0.25
"""The same where other axes are joined rightly: all outputs must explain so much."""
DRIVEN, JOINED, UNJOINED = 0.4, 0.5, 0.15
"""Share of a motion that all outputs must explain together, and parts of it that they
explain as the vehicle file joins them where it is right, and where it is not.
"""
TURNED_SHARE = 0.5
"""Least sum of the shares of surge and sway that a turned velocity must explain."""
FEWEST_OF_TURNED = 50
"""Windows of half a second that tell a turn: a sound log cut to 18 s looks turned by 45 degrees."""
TURNS_GAP = 0.2
"""By how much less it may do so where the forces of turns are taken off."""
LEAST_PUSH_RATIO, LARGEST_CORRELATION = 0.2, 0.9
"""Pushes in surge and sway tell a turned velocity if the smaller is so large a part of the
other, and they are no multiples of each other.
"""
CLEAR = 4.0
"""A gain is clear of a number if it is so many standard deviations away."""
SMALLEST_GAIN, NEARLY_ALL = 0.25, 0.9
"""Least gain of forces in a motion that they explain nearly wholly: 0.3 in healthy logs."""
ALL_BUT, SURE_SCALE, CLEAR_SCALE = 0.95, 0.1, 1.2
"""Share of a motion from which on, and deviations within which, its gain is that of force
over mass, and by what factor two speeds have to differ from the vehicle file.
"""
INERTIA_REMEDY = (
    "Measure or fit the moments of inertia, added ones too: published ones of one vehicle differ by"
    " factors of 3 to 10. Then check the unit of the thrust curve."
)
"""Where turns alone are slow: what is known of moments of inertia makes no unit wrong."""
LEAST_FAST = 0.3
"""Share of its changes that the thrusters must explain of a motion that is too fast."""

OWN_PUSH = 0.15
"""Least part of a push that the motion and the tilt that it answers do not explain. A
pilot or autopilot that levels the hull pushes as damping does, and its gain stands for
both: of a true vehicle file 2.6 and 3.9 with parts of .07 and .015.
"""


def pushes(log: CheckedLog) -> tuple[Array, Array] | None:
    """Return times (n,) and the thrusters' force over mass (n, 6), where known."""
    vehicle = log.vehicle
    if vehicle is None or vehicle.thrusters is None or not log.has("actuators"):
        return None
    of = log.tables["actuators"], log.t_s("actuators"), vehicle
    return log.once("pushes", of, partial(_pushes, log, vehicle))


def _pushes(log: CheckedLog, vehicle: Vehicle) -> tuple[Array, Array] | None:
    assert vehicle.thrusters is not None
    names = [f"pwm_{number}_us" for number in vehicle.thrusters.outputs]
    if not set(names) <= set(log.tables["actuators"].column_names):
        return None
    vehicle, _ = with_logged_directions(vehicle, log.info.parameters)
    assert vehicle.thrusters is not None
    t_s = log.t_s("actuators")
    if t_s.size < 100 or (t_s.size - 1) / (t_s[-1] - t_s[0]) < LEAST_RESPONSE_HZ:
        return None
    forces = np.empty((t_s.size, 6))
    for rows, along in _forces_in_parts(log, vehicle.thrusters):
        forces[rows] = thruster_force(vehicle.thrusters, along)
    forces /= np.diag(vehicle.mass_matrix)
    return t_s, laid_down(forces)


def forces_along(log: CheckedLog, thrusters: Thrusters) -> Array:
    """Return the forces (n, k) of the thrusters along their axes."""
    forces = np.empty((log.tables["actuators"].num_rows, len(thrusters.outputs)))
    for rows, along in _forces_in_parts(log, thrusters):
        forces[rows] = along
    return laid_down(forces)


def _forces_in_parts(log: CheckedLog, thrusters: Thrusters) -> Iterator[tuple[slice, Array]]:
    """Yield rows of the outputs, and the forces of the thrusters along their axes."""
    names, outputs = [f"pwm_{number}_us" for number in thrusters.outputs], log.tables["actuators"]
    for start in range(0, outputs.num_rows, ROWS_AT_ONCE):
        pulses = np.nan_to_num(matrix(outputs.slice(start, ROWS_AT_ONCE), names))
        yield slice(start, start + len(pulses)), thruster_forces(thrusters, pulses)


def push_responses(
    log: CheckedLog,
    axes: str = "uvwpqr",
    *,
    lags_s: Sequence[float] = USUAL_LAGS_S,
    turning: bool = True,
) -> Iterator[tuple[str, AxisGains]]:
    """Yield the gain of the thrusters' force in each motion that it can show.

    `turning`: beside it act the forces that turns make of the motion in other axes.
    """
    for axis, by_lag in push_lags(log, axes, lags_s=lags_s, turning=turning):
        gains = most_explained(by_lag)
        if gains is not None:
            yield axis, gains


def push_lags(
    log: CheckedLog, axes: str, *, lags_s: Sequence[float], turning: bool = True
) -> Iterator[tuple[str, list[AxisGains | None]]]:
    """Yield the gains of `push_responses` at each lag behind the outputs."""
    thrust = pushes(log)
    if thrust is None:
        return
    t_s, pushed = thrust
    streams = [("velocity", name) for name in LINEAR_VELOCITY]
    streams += [("imu", name) for name in GYRO]
    for axis, (stream, name) in enumerate(streams):
        if "uvwpqr"[axis] not in axes or not log.has(stream) or not np.ptp(pushed[:, axis]):
            continue
        motion = body_motion(log, stream, name)
        if float(motion.std()) < SMALLEST_MOTION:
            continue
        let_go()
        force = pushed[:, [axis]]
        let_go()
        if axis in RIGHTED and log.has("attitude"):
            # Below its resonance a hull that rights itself goes against a small thrust.
            angle = log.column("attitude", ATTITUDE[axis - 3])
            force = np.column_stack([force, np.sin(np.interp(t_s, log.t_s("attitude"), angle))])
        at = log.t_s(stream)
        turns = coupling(log, axis, at) if turning else None
        let_go()
        yield "uvwpqr"[axis], gains_by_lag(t_s, force, at, motion, lags_s=lags_s, coupled=turns)


def coupling(log: CheckedLog, axis: int, at: Array) -> Array | None:
    """Return products (n, k) of velocities and rates that accelerate an axis.

    Those of surge and sway are the same, so that a turned velocity has them too. Of a hull
    that moves ahead and down, the moment of its added mass pitches it against its thrusters.
    """
    if not log.has("velocity", "imu"):
        return None
    of: list[object] = [at, log.vehicle and log.vehicle.dvl]
    of += [part for name in ("velocity", "imu") for part in (log.tables[name], log.t_s(name))]
    return log.once(("coupling", max(axis, 1)), of, lambda: _coupling(log, axis, at))


def _coupling(log: CheckedLog, axis: int, at: Array) -> Array:
    t_velocity, t_imu, velocity = log.t_s("velocity"), log.t_s("imu"), log.body_velocity()
    parts = dict(zip("uvw", velocity.T, strict=True))
    parts |= dict(zip("pqr", log.values("imu", GYRO).T, strict=True))
    of_axis = {2: "uq vp", 3: "vw qr", 4: "uw pr", 5: "uv pq"}
    products = of_axis.get(axis, "ur vr wq wp").split()
    terms = np.empty((at.size, len(products)))
    for column, names in enumerate(products):
        first, second = (
            np.interp(at, t_velocity if name in "uvw" else t_imu, parts[name])
            for name in list(names)
        )
        np.multiply(first, second, out=terms[:, column])
    return laid_down(terms)


def body_motion(log: CheckedLog, stream: str, name: str) -> Array:
    """Return one motion (n,) in body axes."""
    if stream == "velocity":
        return log.body_velocity()[:, LINEAR_VELOCITY.index(name)]
    return log.column(stream, name)


def answers_backward(log: CheckedLog, other: Thrusters) -> bool:
    """Return whether an axis answers other thrusters the wrong way round."""
    if log.vehicle is None:
        return False
    turned = replace(log, vehicle=replace(log.vehicle, thrusters=other))
    return any(_goes_against(turned, *answer) for answer in push_responses(turned))


def _goes_against(log: CheckedLog, axis: str, gains: AxisGains) -> bool:
    """Return whether a motion goes against its thrusters, with and without turns."""
    least = LEAST_RIGHTED if axis in "pq" else LEAST_ANSWERED
    return (
        _clear(gains) < limit("response_sign")
        and gains.explained > least
        and not any(_clear(own) > 0.0 for _, own in push_responses(log, axis, turning=False))
    )


def weak_forces(response: Mapping[str, AxisGains]) -> Iterator[Finding]:
    """Yield motions that change faster than the thrusters could make them."""
    most = limit("response_scale")
    unit = limit("response_unit")
    fast = {
        axis: float(gains.gain[0])
        for axis, gains in response.items()
        if gains.gain[0] - CLEAR * gains.sd[0] > most
        and gains.explained > LEAST_FAST
        and gains.own[0] > OWN_PUSH
    }
    slow = {
        axis: float(gains.gain[0])
        for axis, gains in response.items()
        if 0.0 < gains.gain[0] + CLEAR * gains.sd[0] < SMALLEST_GAIN
        and gains.gain[0] > CLEAR * gains.sd[0]
        and gains.explained > NEARLY_ALL
    }
    if len(slow) > 1:
        words = dict(zip("uvwpqr", (*SPEEDS, *RATES), strict=True))
        parts = [f"{words[axis]} changes {gain:.2f} times as fast" for axis, gain in slow.items()]
        turns = set(slow) <= set("pqr")
        yield finding(
            "response_scale" if turns else "response_unit",
            f"Force over mass of the thrusters makes too much of the motion: {listed(parts)}.",
            stream="actuators",
            value=max(slow.values()),
            remedy=INERTIA_REMEDY if turns else "",
        )
    if len(fast) < 2:
        yield from _off_scale(response)
        return
    names = dict(zip("uvwpqr", (*SPEEDS, *RATES), strict=True))
    parts = [f"{names[axis]} changes {gain:.1f} times as fast" for axis, gain in fast.items()]
    far = [gain for gain in fast.values() if gain > unit]
    yield finding(
        "response_unit" if len(far) > 1 else "response_scale",
        f"Force over mass of the thrusters makes too little of the motion: {listed(parts)}.",
        stream="actuators",
        value=min(far if len(far) > 1 else fast.values()),
    )


def clear_scales(response: Mapping[str, AxisGains]) -> dict[str, float]:
    """Return the gains of speeds that thrust and drag explain all but wholly.

    What lags, losses or noise take off a gain they take off the share as well.
    """
    return {
        axis: float(gains.gain[0])
        for axis, gains in response.items()
        if axis in "uvw" and gains.explained > ALL_BUT and CLEAR * gains.sd[0] < SURE_SCALE
    }


def _off_scale(response: Mapping[str, AxisGains]) -> Iterator[Finding]:
    """Yield force over mass that is off by a fifth where nothing blurs it."""
    scales = clear_scales(response)
    if len(scales) < 2 or min(scales.values()) < SMALLEST_GAIN:
        return
    small = all(gain > CLEAR_SCALE for gain in scales.values())
    if not small and any(gain > 1.0 / CLEAR_SCALE for gain in scales.values()):
        return
    words = dict(zip("uvw", SPEEDS, strict=True))
    parts = [f"{words[axis]} changes {gain:.2f} times as fast" for axis, gain in scales.items()]
    yield finding(
        "response_scale",
        f"Force over mass of the thrusters makes too {'little' if small else 'much'} of the"
        f" motion: {listed(parts)}.",
        stream="actuators",
        value=min(scales.values()),
    )


def exchanged_answers(log: CheckedLog, response: Mapping[str, AxisGains]) -> Iterator[Finding]:
    """Yield surge and sway that answer each other's thrusters."""
    thrust = pushes(log)
    if thrust is None or not {"u", "v"} <= set(response):
        return
    t_s, pushed = thrust
    at = log.t_s("velocity")
    speed, turns = log.body_velocity()[:, :2], coupling(log, 0, at)
    own, other, *with_turns = (
        sum(item.explained for item in _turned_gains(t_s, force, at, speed, [0.0], coupled)[0])
        for coupled in (None, turns)
        for force in (pushed, pushed[:, [1, 0]])
    )
    if other - own > ANSWER_GAP and with_turns[0] - with_turns[1] < TURNS_GAP:
        yield finding(
            "velocity_axes",
            "Surge of the velocity answers the thrusters of sway, and sway those of surge"
            f" (explained {other / 2.0:.2f}; their own {max(own, 0.0) / 2.0:.2f}, means).",
            stream="velocity",
            value=other / 2.0,
            fields=LINEAR_VELOCITY[:2],
            remedy=(
                "The velocity is that of the poses: check outputs, position and axis of the"
                " thrusters in the vehicle file, or the frame of the pose in the column map."
                if log.source("velocity").startswith(OF_POSES)
                else ""
            ),
        )


def turned_answers(log: CheckedLog) -> Iterator[Finding]:
    """Yield a velocity that answers the thrusters once it is turned about the vertical.

    By one angle all log long, or by the heading, as a velocity over ground is.
    """
    thrust = pushes(log)
    if thrust is None or not log.has("velocity", "attitude"):
        return
    t_s, pushed = thrust
    if not pushes_apart(pushed[:, 0], pushed[:, 1]):
        return
    at, speed = log.t_s("velocity"), log.body_velocity()[:, :2]
    heading = angles_at(at, log.t_s("attitude"), log.values("attitude", ATTITUDE))[:, 2]
    turns = {f"turned by {angle} degrees": np.radians(-angle) for angle in range(-150, 180, 30)}
    turns |= {f"turned by {sign * 45} degrees": np.radians(-sign * 45) for sign in (-1, 1)}
    candidates = {**turns, "over ground": -heading}
    answers = _turned_gains(t_s, pushed, at, speed, list(candidates.values()))
    if min((item.count for gains in answers for item in gains), default=0) < FEWEST_OF_TURNED:
        return
    shares = {
        words: sum(item.explained for item in gains if item.gain[0] > 0.0)
        for words, gains in zip(candidates, answers, strict=True)
    }
    # A wrong sign is another finding.
    unturned = answers[list(candidates).index("turned by 0 degrees")]
    own = sum(max(item.explained, 0.0) for item in unturned)
    best = max(shares, key=lambda words: shares[words])
    if best == "turned by 0 degrees" or shares[best] - own < ANSWER_GAP:
        return
    if shares[best] < TURNED_SHARE:
        return
    coupled = coupling(log, 0, at)
    with_turns, as_it_is = (
        sum(item.explained for item in gains)
        for gains in _turned_gains(t_s, pushed, at, speed, [candidates[best], 0.0], coupled)
    )
    if as_it_is - with_turns > TURNS_GAP:
        return
    yield finding(
        "velocity_axes",
        f"The velocity ({log.source('velocity')}) answers the thrusters of surge and sway if it is"
        f" {best if 'turned' in best else 'one over ground, north and east'} (sum of the shares"
        f" explained {shares[best]:.2f}; as it is declared {own:.2f}).",
        stream="velocity",
        value=shares[best],
        fields=LINEAR_VELOCITY[:2],
        remedy=(
            "Turn it into body axes with the attitude before the export, or map the log's body"
            " velocity."
            if best == "over ground"
            else f"{mounting_remedy(log)}, or correct the columns."
        ),
    )


def _turned_gains(
    t_s: Array,
    pushed: Array,
    at: Array,
    speed: Array,
    angles: Sequence[float | Array],
    coupled: Array | None = None,
) -> list[list[AxisGains]]:
    """Return gains of surge and sway of a velocity (m, 2) turned by each angle."""
    turns = [(np.cos(angle), np.sin(angle)) for angle in angles]
    turned = (
        np.column_stack([cosine * speed[:, 0] - sine * speed[:, 1] for cosine, sine in turns]),
        np.column_stack([sine * speed[:, 0] + cosine * speed[:, 1] for cosine, sine in turns]),
    )
    by_axis = [
        gains_by_motion(t_s, pushed[:, [axis]], at, motions, lags_s=USUAL_LAGS_S, coupled=coupled)
        for axis, motions in enumerate(turned)
    ]
    return [
        [gains for by_lag in axes if (gains := most_explained(by_lag)) is not None]
        for axes in zip(*by_axis, strict=True)
    ]


def pushes_apart(first: Array, second: Array) -> bool:
    """Return whether two pushes (n,) are of comparable size and no multiples."""
    sizes = sorted((float(first.std()), float(second.std())))
    if sizes[0] <= LEAST_PUSH_RATIO * sizes[1]:
        return False
    return abs(float(np.corrcoef(first, second)[0, 1])) < LARGEST_CORRELATION


def _moving_forces(log: CheckedLog, thrusters: Thrusters) -> Array:
    """Return the forces (n, k) of the thrusters that change theirs."""
    forces = forces_along(log, thrusters)
    moves = np.ptp(forces, axis=0) > 0.0
    let_go()
    return laid_down(forces if moves.all() else forces[:, moves])


def answers_out_of_order(log: CheckedLog, response: Mapping[str, AxisGains]) -> Iterator[Finding]:
    """Yield outputs that drive the vehicle, but not as the vehicle file joins them."""
    if log.vehicle is None or log.vehicle.thrusters is None or not log.has("actuators"):
        return
    thrusters, t_s = log.vehicle.thrusters, log.t_s("actuators")
    streams = dict.fromkeys("uvw", "velocity") | {"r": "imu"}
    streams = {axis: stream for axis, stream in streams.items() if axis in response}
    names = dict(zip("uvwr", (*LINEAR_VELOCITY, GYRO[2]), strict=True))
    right: list[str] = []
    wrong: list[str] = []
    unlike: list[str] = []
    moving = _moving_forces(log, thrusters) if streams else np.zeros((0, 0))
    for axis, stream in streams.items():
        at, motion = log.t_s(stream), body_motion(log, stream, names[axis])
        coupled = coupling(log, "uvwpqr".index(axis), at)
        gains = response_gains(t_s, moving, at, motion, coupled=coupled)
        if gains is None or gains.explained < DRIVEN:
            continue
        share = response[axis].explained / gains.explained
        if share < UNLIKE_SHARE and gains.explained > MOSTLY:
            unlike.append(axis)
        if share > JOINED:
            right.append(axis)
        elif share < UNJOINED:
            wrong.append(axis)
    wrong = unlike if right else wrong
    if len(wrong) < 2:
        return
    words = dict(zip("uvwr", (*SPEEDS, RATES[2]), strict=True))
    yield finding(
        "response_order",
        f"The outputs drive {listed([words[axis] for axis in wrong])}, but not as the vehicle file"
        " joins them.",
        stream="actuators",
        value=float(len(wrong)),
    )


def response_signs(
    log: CheckedLog,
    response: Mapping[str, AxisGains],
    answers: Mapping[str, Response] | None = None,
) -> Iterator[Finding]:
    """Yield motions that go against their thrusters.

    answers: how late each motion follows the outputs, whatever their signs.
    """
    turned = {axis: gains for axis, gains in response.items() if _goes_against(log, axis, gains)}
    late = _late_by_tilts(log, turned) or _late_by_yaw(log, turned, answers or {})
    if late:
        yield from late
        return
    names = dict(zip("uvwpqr", (*SPEEDS, *RATES), strict=True))
    fields = dict(zip("uvwpqr", (*LINEAR_VELOCITY, *GYRO), strict=True))
    for axis, gains in turned.items():
        clear = _clear(gains)
        text = (
            f"{names[axis].capitalize()} answers the thrusters the wrong way round: force"
            f" forward accelerates it backward ({significant(clear)} standard deviations)."
        )
        if _right_lag(log, axis, gains.explained, OTHER_LAGS_S) is not None:
            text += (
                " With a second more or less between them it answers the right way round: the"
                " clock of the outputs or of the motion may be off instead."
            )
        yield finding(
            "response_sign",
            text,
            stream="velocity" if axis in "uvw" else "imu",
            value=clear,
            fields=(fields[axis],),
        )


def _right_lag(log: CheckedLog, axis: str, least: float, lags_s: Sequence[float]) -> float | None:
    """Return the lag at which the thrusters explain an axis best, the right way.

    None where they explain no more than a share.
    """
    ((_, by_lag),) = push_lags(log, axis, lags_s=lags_s)
    right = {
        lag: other.explained
        for lag, other in zip(lags_s, by_lag, strict=True)
        if other is not None and _clear(other) > -limit("response_sign") and other.explained > least
    }
    return max(right, key=lambda lag: right[lag]) if right else None


def _late_by_tilts(log: CheckedLog, turned: Mapping[str, AxisGains]) -> list[Finding]:
    """Return that outputs are late, where turns alone go the wrong way and say so.

    A hull that rights itself turns within tenths of a second; surge, sway and heave have
    to follow the outputs better if those act so much earlier, too.
    """
    if not {"p", "q"} & set(turned) or not set(turned) <= {"p", "q", "r"}:
        return []
    lags = [_right_lag(log, axis, LEAST_TILTED, EARLIER_S) for axis in turned]
    lags_there = [lag for lag in lags if lag is not None]
    speeds = [
        [force_odds(gains) for gains in by_lag]
        for _, by_lag in push_lags(log, "uvw", lags_s=(*EARLIER_S, *USUAL_LAGS_S))
    ]
    if len(lags_there) < len(lags) or len(speeds) < 2:
        return []
    total = np.sum(speeds, axis=0)
    if total[: len(EARLIER_S)].max() - total[len(EARLIER_S) :].max() < BETTER_EARLIER:
        return []
    words = listed([RATES["pqr".index(axis)] for axis in turned])
    early = -float(np.mean(lags_there))
    return [
        finding(
            "command_late",
            f"The force of the outputs turns {words} the right way if it acts {early:.1f} s before"
            " its stamp, and moves surge, sway and heave better: the outputs are stamped late, or"
            f" the sensors early. (As the stamps stand {words} would be turned.)",
            stream="actuators",
            value=early,
        )
    ]


def _late_by_yaw(
    log: CheckedLog, turned: Mapping[str, AxisGains], answers: Mapping[str, Response]
) -> list[Finding]:
    """Return that outputs are late, where yaw alone goes against them, and too soon."""
    if set(turned) != {"r"} or "r" not in answers or answers["r"].lag_s > SOONEST_YAW_S:
        return []
    if _right_lag(log, "r", turned["r"].explained, EARLIER_S) is None:
        return []
    lag_s = answers["r"].lag_s
    early = YAW_S - lag_s
    return [
        finding(
            "command_late",
            f"Yaw follows the outputs by {lag_s:.2f} s, sooner than thruster and hull let it, and"
            " against their force; with the force earlier it turns the right way: the outputs are"
            f" some {early:.1f} s late, by their stamps, a limit to how fast they change, or held"
            " samples.",
            stream="actuators",
            value=early,
        )
    ]


def force_odds(gains: AxisGains | None) -> float:
    """Return the logarithm of the likelihood over no force; 0 for a gain against it."""
    if gains is None or gains.gain[0] <= 0.0:
        return 0.0
    share = min(max(gains.explained, 0.0), 1.0 - 1e-9)
    return -0.5 * gains.count * float(np.log1p(-share))


def _clear(gains: AxisGains) -> float:
    """Return the first gain in standard deviations; 0 without a spread."""
    return float(gains.gain[0] / gains.sd[0]) if gains.sd[0] > 0.0 else 0.0
