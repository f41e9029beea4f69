"""By what angle commands of surge and sway push poses aside."""

from __future__ import annotations

import math

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.motion_checks import response_gains

PASSES = 4
"""Turns of the velocity by what is left of the angle, until its drag is that of its axes."""
LEAST_EXPLAINED = 0.3
"""Share of surge and of sway that commands explain where they tell an angle."""
CLEAR_GAIN = 6.0
"""Gain of a command over its standard deviation from which on it tells a direction."""


def pushed_turn(
    t_s: Array, commands: Array, t_motion: Array, velocity: Array, coupled: Array
) -> tuple[float, float] | None:
    """Return the angle [rad] by which pushes are turned, and its deviation.

    To the right. G = R(angle) diag(g_u, g_v) of gains of commands (n, k), those of surge and
    sway first, in velocity (m, 2) beside `coupled` (m, l). The deviation is half of what the
    two angles differ by, at least: thrusters that push aside, or a hull, turn each another
    way. None where either command tells no direction.
    """
    angle, deviation = 0.0, math.inf
    for _ in range(PASSES):
        c, s = math.cos(angle), math.sin(angle)
        turned = velocity @ np.array([[c, -s], [s, c]])
        left = _angle_left(t_s, commands, t_motion, turned, coupled)
        if left is None:
            return None
        angle, deviation = angle + left[0], left[1]
    return _within_half_turn(angle), deviation


def _angle_left(
    t_s: Array, commands: Array, t_motion: Array, velocity: Array, coupled: Array
) -> tuple[float, float] | None:
    """Return the mean of the angles that both commands tell, and its deviation."""
    gains = []
    for axis in range(2):
        products = np.hstack([coupled, velocity[:, [1 - axis]]])
        own = np.ascontiguousarray(velocity[:, axis])
        item = response_gains(t_s, commands, t_motion, own, coupled=products)
        if item is None or item.explained < LEAST_EXPLAINED:
            return None
        gains.append(item)
    gain = np.array([item.gain[:2] for item in gains])
    sd = np.array([item.sd[:2] for item in gains])
    size = np.linalg.norm(gain, axis=0)
    if not (size > CLEAR_GAIN * sd.max(axis=0)).all():
        return None
    ahead, aside = math.atan2(gain[1, 0], gain[0, 0]), math.atan2(-gain[0, 1], gain[1, 1])
    weights = (size / np.array([sd[1, 0], sd[0, 1]])) ** 2
    difference = _within_half_turn(aside - ahead)
    deviation = max(float(weights.sum()) ** -0.5, abs(difference) / 2.0)
    return ahead + float(weights[1] / weights.sum()) * difference, deviation


def _within_half_turn(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
