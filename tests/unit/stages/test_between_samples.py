"""Which way outputs at 2 Hz are had between their samples."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import thruster_force, thruster_forces
from auvid.stages.columns import Samples
from auvid.stages.leg_record.between_samples import STICKS, between_samples
from auvid.stages.leg_streams import Streams
from tests.support.axis_dive import THRUSTERS, VEHICLE

STEP_S, SECONDS = 0.025, 100.0
CLOCK = np.arange(1.0, SECONDS - 1.0, 0.05)
SIGNS = np.sign(THRUSTERS.allocation[5] * THRUSTERS.direction)
PUSHES = np.linspace(-0.6, 0.6, 241)


def turns(hold: float) -> tuple[Array, Array, Array, Array]:
    """Return times, stick, heading, rate and pulses of a hull held against eddies."""
    t = np.arange(0.0, SECONDS, STEP_S)
    rng = np.random.default_rng(3)
    pushed = np.repeat(rng.choice([-1.0, 0.0, 0.0, 1.0], t.size // 60 + 1), 60)[: t.size]
    stream = np.repeat(rng.uniform(-0.3, 0.3, t.size // 90 + 1), 90)[: t.size]
    stick, heading, rate = 0.4 * pushed, np.zeros(t.size), np.zeros(t.size)
    pulses, aim, turn, now = np.zeros((t.size, 6)), 0.0, 0.0, 0.0
    for i in range(t.size):
        aim = now if stick[i] else aim
        push = 0.4 * stick[i] - 0.2 * turn + hold * (aim - now)
        push = min(max(push, -0.6), 0.6)
        pulses[i] = 1500.0 + 400.0 * push * SIGNS
        moment = np.interp(push, PUSHES, MOMENTS)
        turn += STEP_S * (moment + stream[i] - 2.0 * turn * abs(turn) - 0.3 * turn) / 0.6
        now += STEP_S * turn
        heading[i], rate[i] = now, turn
    return t, stick, heading, np.column_stack([rate, pulses])


def moments(pulses: Array) -> Array:
    return thruster_force(THRUSTERS, thruster_forces(THRUSTERS, pulses))[:, 5]


MOMENTS = moments(1500.0 + 400.0 * PUSHES[:, None] * SIGNS)


def streams(t: Array, stick: Array, heading: Array, rate: Array) -> Streams:
    """Return the log of these turns without depth."""
    time_us, still = np.rint(1e6 * t).astype(np.int64), np.zeros(t.size)
    sticks = dict.fromkeys(STICKS, still) | {"stick_yaw": stick}
    angles = {"phi_rad": still, "theta_rad": still, "psi_rad": heading}
    gyro = {"gyro_x_rad_s": still, "gyro_y_rad_s": still, "gyro_z_rad_s": rate}
    tables = {
        name: pa.table({"time_us": time_us, **columns})
        for name, columns in (("sticks", sticks), ("attitude", angles), ("imu", gyro))
    }
    return Streams(tables, 0, (0.0, SECONDS), VEHICLE)


@pytest.mark.parametrize("hold", [1.0, 0.0])
def test_what_the_autopilot_holds_is_a_cause_where_it_turns_the_hull(hold: float) -> None:
    t, stick, heading, rest = turns(hold)
    at = np.arange(0.0, SECONDS - 0.6, 0.5)
    fast = np.stack([np.interp(CLOCK, t, column) for column in rest.T[1:]], axis=1)
    slow = Samples(at, np.stack([np.interp(at, t, column) for column in rest.T[1:]], axis=1))
    lines = np.stack([np.interp(CLOCK, at, column) for column in slow.values.T], axis=1)
    log = streams(t, stick, heading, rest[:, 0])
    way = between_samples(log, THRUSTERS, slow, CLOCK, lines, 1.0)
    errors = [np.std(moments(pulses) - moments(fast)) for pulses in (way.pulses, lines)]
    assert errors[0] < 0.3 * errors[1]
    assert hold == 0.0 or "what the autopilot holds" in way.words
