"""Checks of fins by pitch and yaw (clock, sign, size), of the propeller by surge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.fins import fin_force
from auvid.hydro.identification.checks.motion_checks import gains_by_lag
from auvid.hydro.identification.checks.robust_gains import AxisGains
from auvid.stages.columns import ATTITUDE, FINS, GYRO, RATES
from auvid.stages.ingest.health.actuation.push_answers import coupling
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit
from auvid.stages.number_format import significant

LAGS_S = np.round(np.arange(-10, 21) * 0.2, 1)
USUAL_S = (-0.2, 0.5)
SURE_ODDS, LEAST_LAG_S = 40.0, 0.5
"""Logarithm of the likelihood of a lag over the usual ones: at most 20 in sound runs, where
it is 0.4 s at most.
"""
DRIVEN = 0.8
"""Share of its changes that fins and drag must explain of an axis that fins drive."""
ANSWERED, SOON_S = 0.6, 0.3
"""The same for a sign that is wrong at every lag that fins have: 26 sound axes that are so much
explained have a gain above 0 at each.
"""
SIZES, CLEAR = (0.35, 1.6), 4.0
"""Gain of the fins' moment over inertia: 0.82 to 0.89 in sound runs of a twin, 0.45 to 0.73 of
a torpedo that an autopilot steers, where the lift of the hull takes part of a turn.
"""
SAME_GAIN = 1e-6
"""Of a fin without a moment in this axis, which either way round makes the same gain."""
LEAST_GAIN_SD, AS_GOOD = 10.0, 0.02
"""Gain over its standard deviation that tells a size, and a share that is no less than another."""
LEAST_TURNS, FEWEST = 0.1, 100
"""Part of its highest speed from which on a propeller drives, and samples of it."""
PROPELLER = "propeller_rev_s"
PITCH, YAW = 4, 5
NAMES = ("starboard", "port", "bottom", "top")


def propeller_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield a propeller that turns far faster or slower than the vehicle goes ahead."""
    propeller = log.vehicle and log.vehicle.propeller
    if not propeller or not log.has("velocity", "actuators"):
        return
    if PROPELLER not in log.tables["actuators"].column_names:
        return
    turns, t_s = log.column("actuators", PROPELLER), log.t_s("actuators")
    ahead = np.interp(t_s, log.t_s("velocity"), log.body_velocity()[:, 0])
    tabled = np.asarray(propeller.level_speed_rev_s), np.asarray(propeller.level_speed_m_s)
    most = tabled[0][-1]
    level = np.interp(turns, *tabled) * np.maximum(turns / most, 1.0)
    driven = (turns > LEAST_TURNS * np.nanmax(turns)) & (level > 0.0) & np.isfinite(ahead)
    if np.count_nonzero(driven) < FEWEST:
        return
    factor = float(np.median(ahead[driven] / level[driven]))
    if 1.0 / limit("propeller_speed") < factor < limit("propeller_speed") or factor <= 0.0:
        return
    yield finding(
        "propeller_speed",
        f"The vehicle goes {factor:.2f} times as fast as in level running at the speed of its"
        " propeller (median; level_speed of the vehicle file).",
        stream="actuators",
        value=factor,
        fields=(PROPELLER,),
    )


def fin_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield fins at a wrong time, of a wrong sign or size, or one that is backward."""
    vehicle = log.vehicle
    if vehicle is None or vehicle.fins is None or not log.has("velocity", "imu", "attitude"):
        return
    if not log.has("actuators") or not set(FINS) <= set(log.tables["actuators"].column_names):
        return
    deflection = np.nan_to_num(log.values("actuators", FINS))
    for axis in (PITCH, YAW):
        by_lag = _gains(log, deflection, axis, LAGS_S)
        odds = np.array([_odds(gains) for gains in by_lag])
        best = int(np.argmax(odds))
        usual = np.flatnonzero((USUAL_S[0] - 0.01 < LAGS_S) & (USUAL_S[1] > LAGS_S))
        own = max((by_lag[place] for place in usual), key=_explained)
        lag, at_best = float(LAGS_S[best]), by_lag[best]
        if own is None:
            continue
        if _backward([by_lag[place] for place in usual if LAGS_S[place] < SOON_S]):
            yield from _turned(log, deflection, axis, own)
            continue
        if max(_explained(own), _explained(at_best)) < DRIVEN:
            continue
        late = odds[best] - odds[usual].max() > SURE_ODDS and abs(lag) > LEAST_LAG_S
        turned = own.gain[0] + CLEAR * own.sd[0] < 0.0 and _explained(own) > DRIVEN
        if turned and _explained(own) > _explained(at_best) - AS_GOOD:
            yield from _turned(log, deflection, axis, own)
        elif late:
            yield _off(lag, axis)
        elif _explained(own) > DRIVEN:
            nearest = _nearest_to_one([by_lag[place] for place in usual])
            if _wrong_size(nearest):
                yield from _turned(log, deflection, axis, nearest)


def _backward(by_lag: Sequence[AxisGains | None]) -> bool:
    """Return whether fins turn an axis the wrong way, however soon they act."""
    there = [gains for gains in by_lag if gains is not None]
    wrong = [gains.gain[0] < -LEAST_GAIN_SD * gains.sd[0] for gains in there]
    return len(there) == len(by_lag) and all(wrong) and max(map(_explained, there)) > ANSWERED


def _turned(log: CheckedLog, deflection: Array, axis: int, own: AxisGains) -> Iterator[Finding]:
    """Yield one fin that is backward, all of them, or fins of a wrong size."""
    gain, words = float(own.gain[0]), RATES[axis - 3]
    (now,) = _gains(log, deflection, axis, np.zeros(1))
    plain = 0.0 if now is None else now.gain[0]
    for place, name in enumerate(NAMES):
        flipped = deflection.copy()
        flipped[:, place] *= -1.0
        (again,) = _gains(log, flipped, axis, np.zeros(1))
        acts = again is not None and not np.isclose(again.gain[0], plain, rtol=SAME_GAIN)
        as_good = acts and _explained(again) > _explained(own) - AS_GOOD
        if again is not None and as_good and SIZES[0] < again.gain[0] < SIZES[1]:
            yield finding(
                "response_order",
                f"The {name} fin acts backward: with its angle the other way round {words} answers"
                f" the fins of the vehicle file ({again.gain[0]:.2f} of the turning that they"
                f" make), as it stands {gain:.2f}.",
                stream="actuators",
                value=gain,
                fields=(FINS[place],),
                remedy="Set sign: -1 for the column of this fin, or correct its row in the vehicle"
                " file (actuators.fins).",
            )
            return
    if gain < 0.0:
        yield finding(
            "response_sign",
            f"{words.capitalize()} answers the fins the wrong way round"
            f" ({significant(gain / float(own.sd[0]))} standard deviations).",
            stream="imu",
            value=gain / float(own.sd[0]),
            fields=(GYRO[axis - 3],),
            remedy="Check the signs of the fin angles and of the gyro, then actuators.fins of the"
            " vehicle file.",
        )
        return
    yield finding(
        "response_scale",
        f"{words.capitalize()} turns {significant(gain)} times as fast as the moment of the fins"
        " over the inertia of the vehicle file makes it.",
        stream="actuators",
        value=gain,
        remedy="Check the unit of the fin angles (deg?), then inertia, added mass and the"
        " coefficients and reference_length of the fins in the vehicle file.",
    )


def _off(lag: float, axis: int) -> Finding:
    words = RATES[axis - 3]
    name = "command_late" if lag < 0.0 else "commands_early"
    return finding(
        name,
        f"The moment of the fins turns the vehicle ({words}) best if it acts {abs(lag):.1f} s"
        f" {'before' if lag < 0.0 else 'after'} its stamp, drag beside it: the fins are stamped"
        f" {'late' if lag < 0.0 else 'early'}, or the gyro {'early' if lag < 0.0 else 'late'}.",
        stream="actuators",
        value=max(abs(lag), limit(name)),
    )


def _gains(log: CheckedLog, deflection: Array, axis: int, lags_s: Array) -> list[AxisGains | None]:
    """Return the gains of the fins' moment over inertia in one rate, at each lag."""
    vehicle, t_s, at = log.vehicle, log.t_s("actuators"), log.t_s("imu")
    assert vehicle is not None
    assert vehicle.fins is not None
    ahead = np.interp(t_s, log.t_s("velocity"), log.body_velocity()[:, 0])
    moving = np.column_stack([ahead, np.zeros((t_s.size, 5))])
    force = fin_force(vehicle.fins, moving, deflection, water_density=vehicle.water_density)
    push = force[:, [axis]] / vehicle.mass_matrix[axis, axis]
    coupled = coupling(log, axis, at)
    if axis == PITCH:
        angle = np.interp(t_s, log.t_s("attitude"), log.column("attitude", ATTITUDE[1]))
        push = np.column_stack([push, np.sin(angle)])
    motion = log.column("imu", GYRO[axis - 3])
    if not np.ptp(push[:, 0]):
        return [None] * len(lags_s)
    return gains_by_lag(t_s, push, at, motion, lags_s=lags_s, coupled=coupled)


def _explained(gains: AxisGains | None) -> float:
    return -np.inf if gains is None else gains.explained


def _odds(gains: AxisGains | None) -> float:
    """Return the logarithm of the likelihood over no moment; 0 for a turned one."""
    if gains is None or gains.gain[0] <= 0.0:
        return 0.0
    return -0.5 * gains.count * float(np.log1p(-min(max(gains.explained, 0.0), 1.0 - 1e-9)))


def _nearest_to_one(by_lag: Sequence[AxisGains | None]) -> AxisGains:
    """Return the gains nearest to 1 of the lags at which fins and drag explain an axis.

    An autopilot that follows the rate makes fins of the next moment fit as well, with a
    gain of its own.
    """
    driven = [gains for gains in by_lag if gains is not None and gains.explained > DRIVEN]
    return min(driven, key=lambda gains: abs(float(gains.gain[0]) - 1.0))


def _wrong_size(gains: AxisGains) -> bool:
    gain, sd = float(gains.gain[0]), float(gains.sd[0])
    far = gain - CLEAR * sd > SIZES[1] or gain + CLEAR * sd < SIZES[0]
    return far and abs(gain) > LEAST_GAIN_SD * sd
