"""Level thrusters of a log at 2 Hz, by the law of the heading."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.heading_loop import HeadingGains, logged_gains, yaw_command
from auvid.hydro.dynamics.simulation.rov.autopilot import (
    MANUAL,
    MEMORY,
    STABILIZE,
    AutopilotGains,
    autopilot_step,
    frame_factors,
)
from auvid.stages.columns import Samples
from auvid.stages.leg_record.heading_law import LevelPulses, level_by_law
from auvid.stages.leg_streams import Streams
from tests.support.axis_dive import THRUSTERS, VEHICLE

STEP_S, SECONDS, PILOT_GAIN = 0.02, 90.0, 0.5
CLOCK = np.arange(2.0, SECONDS - 2.0, 0.05)
SLOW = np.arange(0.0, SECONDS - 0.6, 0.5)
MANUAL_FROM_S = 60.0
GAIN, DRAG = 12.0, 2.0
"""Yaw acceleration of a full output [rad/s^2], and linear drag over inertia [1/s]."""


def flown(gain_by_hand: float = PILOT_GAIN) -> tuple[Streams, Array, Array]:
    """Return the log of an autopilot of another origin, times and its outputs (n, 6).

    It steers a hull against a moment that comes and goes, stabilised and then by hand.
    """
    t = np.arange(0.0, SECONDS, STEP_S)
    rng = np.random.default_rng(4)
    yaw = np.repeat(rng.choice([-1.0, 0.0, 0.0, 0.8], t.size // 73 + 1), 73)[: t.size]
    ahead = np.repeat(rng.choice([-0.6, 0.0, 0.9], t.size // 113 + 1), 113)[: t.size]
    stream = np.repeat(rng.uniform(-1.5, 1.5, t.size // 61 + 1), 61)[: t.size]
    free = np.sign(yaw) * np.maximum(np.abs(PILOT_GAIN * yaw) - 0.1, 0.0) / 0.9
    turn = free * np.pi / 4.0 * 3.375
    gains, memory, out = AutopilotGains(turn_rad_s=1.0), np.zeros(MEMORY), np.zeros(6)
    memory[11] = -1.0
    heading, rate = np.zeros(t.size + 1), np.zeros(t.size + 1)
    shares = np.zeros((t.size, 6))
    for i, now in enumerate(t):
        hand = now >= MANUAL_FROM_S
        stick = np.array([0.0, 0.0, 0.0, gain_by_hand * yaw[i] if hand else turn[i], 0.0, 0.0])
        stick[4] = (gain_by_hand if hand else PILOT_GAIN) * ahead[i]
        autopilot_step(
            memory, gains, MANUAL if hand else STABILIZE, stick, np.zeros(6),
            (0.0, 0.0, 5.0, 0.0, 0.0, heading[i]), (0.0, 0.0, 0.0, 0.0, 0.0, rate[i]),
            STEP_S, out,
        )  # fmt: skip
        shares[i] = out
        rate[i + 1] = rate[i] + STEP_S * (GAIN * out[3] + stream[i] - DRAG * rate[i])
        heading[i + 1] = heading[i] + STEP_S * rate[i + 1]
    time_us, still = np.rint(1e6 * t).astype(np.int64), np.zeros(t.size)
    columns = {
        "sticks": {"stick_surge": ahead, "stick_sway": still, "stick_yaw": yaw},
        "attitude": {"phi_rad": still, "theta_rad": still, "psi_rad": heading[:-1]},
        "imu": {"gyro_x_rad_s": still, "gyro_y_rad_s": still, "gyro_z_rad_s": rate[:-1]},
    }
    tables = {name: pa.table({"time_us": time_us, **own}) for name, own in columns.items()}
    at_us = [0, round(1e6 * MANUAL_FROM_S)]
    modes = {"time_us": at_us, "mode": ["STABILIZE", "MANUAL"], "armed": [True, True]}
    tables["mode"] = pa.table(modes)
    pulses = 1500.0 + 400.0 * THRUSTERS.direction * (shares @ frame_factors(THRUSTERS).T)
    return Streams(tables, 0, (0.0, SECONDS), VEHICLE), t, np.rint(pulses)


def by_law(
    streams: Streams, t: Array, pulses: Array, **parameters: float
) -> tuple[LevelPulses | None, Array, Array]:
    """Return what the law makes of outputs at 2 Hz, lines, and the outputs on the clock."""
    slow = np.stack([np.interp(SLOW, t, own) for own in pulses.T], axis=1)
    lines = np.stack([np.interp(CLOCK, SLOW, own) for own in slow.T], axis=1)
    true = np.stack([np.interp(CLOCK, t, own) for own in pulses.T], axis=1)
    law = level_by_law(streams, THRUSTERS, Samples(SLOW, slow), CLOCK, lines, parameters)
    return law, lines, true


def test_outputs_are_those_of_another_autopilot_of_the_same_law() -> None:
    law, lines, true = by_law(*flown())
    assert law is not None
    assert "yaw and surge" in law.words
    errors = [np.sqrt(np.mean((pulses - true) ** 2)) for pulses in (law.pulses, lines)]
    assert errors[0] < 0.5 * errors[1]


def test_a_pilot_who_changes_the_gain_leaves_no_sample_wrong() -> None:
    law, _, true = by_law(*flown(gain_by_hand=0.4))
    assert law is not None
    at = np.isin(np.round(CLOCK, 3), SLOW)
    assert np.abs(law.pulses - true)[at].max() < 1.0


def test_what_another_law_made_is_left_as_it_is() -> None:
    streams, t, pulses = flown()
    assert by_law(streams, t, pulses, ATC_RAT_YAW_P=0.9)[0] is None
    assert by_law(streams, t, pulses, ATC_ANG_YAW_P=0.0)[0] is None
    assert by_law(streams, t, pulses, RC4_DZ=400.0)[0] is None
    without = dict(streams.tables) | {"mode": None}
    assert by_law(Streams(without, 0, (0.0, SECONDS), VEHICLE), t, pulses)[0] is None
    pulses[:, 0] = 1500.0  # a mixer that drives one thruster of four less
    assert by_law(streams, t, pulses)[0] is None


def test_a_hull_that_is_turned_away_is_turned_back() -> None:
    t = np.arange(0.0, 4.0, STEP_S)
    turned = np.where(t < 2.0, 0.0, 0.02)
    mode, still = np.ones(t.size, dtype=np.intp), np.zeros(t.size)
    gains = HeadingGains(rate_i=0.0)
    out = yaw_command(t, still, turned, still, mode, gains=gains)
    assert out[t < 2.0] == pytest.approx(0.0)
    assert out[-1] == pytest.approx(-0.18 * 6.0 * 0.02, rel=1e-3)
    anew = yaw_command(t, still, turned, still, np.where(t < 3.0, 1, 2), gains=gains)
    assert abs(anew[-1]) < 0.1 * abs(out[-1])  # a new mode holds the heading that it found


def test_gains_of_the_log_stand_before_those_of_the_autopilot() -> None:
    gains = logged_gains({"ATC_ANG_YAW_P": 4.5, "RC4_DZ": 20.0, "ATC_RAT_YAW_I": None})
    assert gains == HeadingGains(angle=4.5, dead=0.05)
