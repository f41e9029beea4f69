"""What ArduSub makes of its yaw stick, given the turns that it felt."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from auvid.hydro.arrays import Array, Index

STEP_S = 0.02
LARGEST_ERROR_RAD = float(np.radians(30.0))
"""The heading that is sought stays within this of the hull's (.49 to .56 rad by a dive)."""
BRAKING_RAD_S2 = float(np.radians(120.0))
"""Beyond P error of this, the rate that is sought grows with the root of the error."""
SETTLING_S, FASTEST_RAD_S = 0.15, float(np.radians(60.0))
"""How fast the heading that is sought goes to the one that is held (ATC_INPUT_TC, ATC_SLEW_YAW)."""
STARTING_RAD_S2 = float(np.radians(1100.0))
PAUSE_S = 0.25
"""So long after the stick is let go the hull slows down before its heading is held."""
FULL_STICK_RAD = float(np.radians(45.0))
RANGE_US = 400.0


class HeadingGains(NamedTuple):
    """Gains of the loop; defaults are those of ArduSub for the BlueROV2.

    `dead`: of a full stick; `full_turn_s`: rate of a full stick over 45 degrees.
    """

    angle: float = 6.0
    rate_p: float = 0.18
    rate_i: float = 0.018
    integral: float = 0.222
    target_hz: float = 5.0
    full_turn_s: float = 3.375
    dead: float = 0.1


def logged_gains(parameters: Mapping[str, float | None]) -> HeadingGains:
    """Return the gains that a log names, ArduSub's own where it names none."""
    names = {
        "angle": "ATC_ANG_YAW_P",
        "rate_p": "ATC_RAT_YAW_P",
        "rate_i": "ATC_RAT_YAW_I",
        "integral": "ATC_RAT_YAW_IMAX",
        "target_hz": "ATC_RAT_YAW_FLTT",
        "full_turn_s": "ACRO_YAW_P",
        "dead": "RC4_DZ",
    }
    logged = {key: parameters.get(name) for key, name in names.items()}
    values = {key: value for key, value in logged.items() if value is not None}
    if "dead" in values:
        values["dead"] /= RANGE_US
    return HeadingGains()._replace(**values)


def yaw_command(
    t_s: Array,
    stick: Array,
    heading_rad: Array,
    turn_rad_s: Array,
    mode: Index,
    gains: HeadingGains,
) -> Array:
    """Return the yaw output (n,), -1 to 1, of a uniform clock (n,) [s].

    stick (n,): of full, with the pilot's gain; heading (n,): without leaps; turn (n,): the
    gyro's; mode (n,): number of one that stabilises, 0 where the stick is the output.
    A pushed stick turns the heading that is sought, a free one holds that of `PAUSE_S`
    later, and a new mode that of its start. Output = P (rate sought - r) + I integral, with
    rate sought = P_angle error + the turn of what is sought (AC_AttitudeControl, ArduSub 4).
    """
    step = float(t_s[1] - t_s[0])
    free = np.sign(stick) * np.maximum(np.abs(stick) - gains.dead, 0.0) / (1.0 - gains.dead)
    stick_turn = (free * FULL_STICK_RAD * gains.full_turn_s).tolist()
    psi, rate, out = heading_rad.tolist(), turn_rad_s.tolist(), stick.tolist()
    turns = 2.0 * np.pi * gains.target_hz * step
    smoothing = float(turns / (1.0 + turns)) if turns > 0.0 else 1.0
    straight = BRAKING_RAD_S2 / gains.angle**2
    sought, hold, turning, filtered, total, pushed = psi[0], psi[0], 0.0, 0.0, 0.0, -PAUSE_S
    before = 0
    for i, now in enumerate(mode.tolist()):
        if now != before:
            hold, before = psi[i], now
        if not now:
            continue
        if stick_turn[i]:
            pushed, hold, aim = i * step, psi[i], stick_turn[i]
        elif i * step < pushed + PAUSE_S:
            hold, aim = psi[i], 0.0
        else:
            aim = min(max((hold - sought) / SETTLING_S, -FASTEST_RAD_S), FASTEST_RAD_S)
        turning += min(max(aim - turning, -STARTING_RAD_S2 * step), STARTING_RAD_S2 * step)
        error = min(max(sought - psi[i], -LARGEST_ERROR_RAD), LARGEST_ERROR_RAD)
        sought = psi[i] + error
        size = abs(error)
        goal = gains.angle * size
        if size > straight:
            goal = (2.0 * BRAKING_RAD_S2 * (size - straight / 2.0)) ** 0.5
        goal = (goal if error >= 0.0 else -goal) + turning
        sought += turning * step
        filtered += smoothing * (goal - filtered)
        lacking = filtered - rate[i]
        total = min(max(total + gains.rate_i * lacking * step, -gains.integral), gains.integral)
        out[i] = min(max(gains.rate_p * lacking + total, -1.0), 1.0)
    return np.asarray(out)
