"""Checks of a velocity whose columns are speeds along beams, or over ground."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np

from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.identification.checks.motion_checks import angles_at, heave_of_columns
from auvid.hydro.identification.checks.velocity_answer import odds_of_velocities
from auvid.hydro.long_series.long_arrays import laid_down
from auvid.stages.columns import ATTITUDE, LINEAR_VELOCITY
from auvid.stages.ingest.health.agreement.velocity.velocity_arm import inertial_motion
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding
from auvid.stages.number_format import percent

COLUMNS = "uvw"
SINGLE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
SUMS = (
    (1.0, 1.0, 0.0),
    (1.0, -1.0, 0.0),
    (1.0, 0.0, 1.0),
    (1.0, 0.0, -1.0),
    (0.0, 1.0, 1.0),
    (0.0, 1.0, -1.0),
    (1.0, 1.0, 1.0),
    (1.0, 1.0, -1.0),
    (1.0, -1.0, 1.0),
    (1.0, -1.0, -1.0),
)
"""Heave of beams: of two that face each other, or of three all round; a column map may
have turned the sign of each.
"""
LEAST_EXPLAINED, BETTER, AS_GOOD = 0.7, 25.0, 2.0
"""Share of the depth rate that a sum must explain, logarithm of its likelihood over any
single column, and how much more than free gains it may leave.
"""
OF_BEAMS, LARGEST_SD = (0.9, 1.3), 0.1
"""Sum of the gains, 1 / cos of the angle between beams and vertical (1.03 to 1.22 from 15
to 35 degrees) less what noise takes off it; a sensor tilted by 45 degrees has 1.41.
"""

OVER_GROUND = {
    "north, east, down": ((0, 1, 2), (1.0, 1.0, 1.0)),
    "east, north, up": ((1, 0, 2), (1.0, 1.0, -1.0)),
    "east, north, up, declared flu": ((1, 0, 2), (-1.0, 1.0, 1.0)),
    "north, west, up": ((0, 1, 2), (1.0, -1.0, -1.0)),
}
"""Columns that are north, east and down, and their signs."""
LEAST_TURN = 0.3
"""Standard deviation of the heading [rad] below which ground and body axes look alike."""
SURE_GROUND = 50.0
"""Logarithm of the likelihood over body axes, whatever their signs; 44 sound legs of dives
and turns stay below 0.
"""


def ground_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield a velocity over ground that is declared as surge, sway and heave.

    `log` is on one clock, without the lags of the vehicle file.
    """
    motion = inertial_motion(log)
    if motion is None or np.std(np.unwrap(motion.attitude[1][:, 2])) < LEAST_TURN:
        return
    t, body = motion.velocity
    turn = rotation_body_to_ned(angles_at(t, *motion.attitude))
    columns = log.values("velocity", LINEAR_VELOCITY)
    of_arm = np.zeros(3) if motion.arm_m is None else np.cross(motion.rates, motion.arm_m)
    tried = {
        name: laid_down(np.einsum("nji,nj->ni", turn, columns[:, order] * signs) - of_arm)
        for name, (order, signs) in OVER_GROUND.items()
    }
    del turn
    in_body = [
        laid_down(each * signs)
        for each in (body, body[:, [1, 0, 2]])
        for signs in product((1.0, -1.0), repeat=3)
    ]
    odds = odds_of_velocities(
        motion.imu, motion.attitude, t, [*tried.values(), *in_body], gravity=STANDARD_GRAVITY
    )
    if odds is None:
        return
    best = int(np.argmax(odds[: len(tried)]))
    if odds[best] - odds[len(tried) :].max() < SURE_GROUND:
        return
    yield finding(
        "velocity_axes",
        f"The velocity ({log.source('velocity')}) follows the accelerometer as"
        f" {list(OVER_GROUND)[best]} over ground, turned by the attitude, and not as surge, sway"
        " and heave.",
        stream="velocity",
        value=1.0,
        fields=LINEAR_VELOCITY,
        remedy=(
            "Let the velocity log write velocities in its own axes, or turn them into body axes"
            " with the attitude before the export."
        ),
    )


def beam_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield a velocity along beams that is declared as surge, sway and heave."""
    if not log.has("depth", "velocity", "attitude"):
        return
    fits = heave_of_columns(
        log.t_s("depth"),
        log.column("depth", "depth_m"),
        log.t_s("attitude"),
        log.values("attitude", ATTITUDE),
        log.t_s("velocity"),
        log.values("velocity", LINEAR_VELOCITY),
        (*SINGLE, *SUMS),
    )
    if fits is None:
        return
    of_sums, free = fits
    single = max(fit.explained for fit in of_sums[: len(SINGLE)])
    place = max(range(len(SINGLE), len(of_sums)), key=lambda each: of_sums[each].explained)
    fit, signs = of_sums[place], SUMS[place - len(SINGLE)]
    gain, left = float(fit.gain[0]), 1.0 - fit.explained
    if left <= 0.0 or fit.explained < LEAST_EXPLAINED or left > AS_GOOD * (1.0 - free.explained):
        return
    if 0.5 * fit.count * math.log((1.0 - single) / left) < BETTER:
        return
    total = abs(gain) * sum(map(abs, signs))
    if fit.sd[0] > LARGEST_SD or not OF_BEAMS[0] < total < OF_BEAMS[1]:
        return
    terms = [
        f"{gain * sign:+.2f} {name}" for name, sign in zip(COLUMNS, signs, strict=True) if sign
    ]
    yield finding(
        "velocity_axes",
        f"The columns of the velocity ({log.source('velocity')}) look like speeds along beams, not"
        f" surge, sway and heave: the depth rate follows {' '.join(terms)} of them"
        f" ({percent(fit.explained)} explained), no single one ({percent(max(single, 0.0))}).",
        stream="velocity",
        value=fit.explained,
        fields=LINEAR_VELOCITY,
        remedy=(
            "Let the velocity log write its velocities in its own axes x, y, z, or turn the beams"
            " into them before the export: two beams b1 and b2 that face each other, at an angle a"
            " from the vertical, give (b1 - b2) / (2 sin a) across and (b1 + b2) / (2 cos a) along"
            " the vertical."
        ),
    )
