"""The ROV's autopilot: mixing as AP_Motors6DOF, and what its modes hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.simulation.rov.autopilot import (
    ALT_HOLD,
    MANUAL,
    MEMORY,
    STABILIZE,
    AutopilotGains,
    autopilot_step,
    frame_factors,
    mixed_pulses,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document

ROOT = Path(__file__).parents[6]
HEAVY = vehicle_from_document(
    read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text(encoding="utf-8"))
)
REST = (0.0,) * 6


def test_the_factors_are_those_of_the_vectored_frame_with_six_axes() -> None:
    """AP_Motors6DOF, SUB_FRAME_VECTORED_6DOF; its throttle is up, our heave is down."""
    assert HEAVY.thrusters is not None
    roll, pitch, throttle, yaw, forward, lateral = (
        [0, 0, 0, 0, 1, -1, 1, -1],
        [0, 0, 0, 0, -1, -1, 1, 1],
        [0, 0, 0, 0, -1, -1, -1, -1],
        [1, -1, -1, 1, 0, 0, 0, 0],
        [-1, -1, 1, 1, 0, 0, 0, 0],
        [1, -1, 1, -1, 0, 0, 0, 0],
    )
    expected = np.array([roll, pitch, np.negative(throttle), yaw, forward, lateral]).T
    assert np.array_equal(frame_factors(HEAVY.thrusters), expected)


def test_outputs_are_scaled_together_and_stay_within_the_pulses() -> None:
    assert HEAVY.thrusters is not None
    pulses = np.zeros(8, np.int64)
    factors = frame_factors(HEAVY.thrusters)
    mixed_pulses(factors, HEAVY.thrusters.direction, np.array([1, 1, 1, 1, 1, 1.0]), pulses)
    assert pulses.min() >= 1100
    assert pulses.max() <= 1900
    mixed_pulses(factors, HEAVY.thrusters.direction, np.array([0, 0, 0, 0, 0.25, 0]), pulses)
    assert pulses.tolist() == [1600, 1600, 1600, 1600, 1500, 1500, 1500, 1500]


def step(mode: int, *, stick: np.ndarray, pose: tuple[float, ...] = REST) -> np.ndarray:
    """The outputs of a first tick at rest."""
    memory, out, target = np.zeros(MEMORY), np.zeros(6), np.zeros(6)
    memory[11] = -1.0
    autopilot_step(memory, AutopilotGains(), mode, stick, target, pose, REST, 0.02, out)
    return out


def test_manual_hands_the_sticks_through() -> None:
    stick = np.array([0.1, -0.2, 0.3, -0.4, 0.5, -0.6])
    assert np.array_equal(step(MANUAL, stick=stick), stick)


def test_stabilize_turns_back_against_roll_and_pitch() -> None:
    out = step(STABILIZE, stick=np.zeros(6), pose=(0, 0, 5, 0.2, -0.1, 1.0))
    assert out[0] < 0.0 < out[1]
    assert out[2] == out[3] == 0.0


def test_a_changed_mode_holds_the_depth_where_it_is() -> None:
    assert step(ALT_HOLD, stick=np.zeros(6), pose=(0, 0, 7.0, 0, 0, 0))[2] == 0.0
    assert step(ALT_HOLD, stick=np.array([0, 0, 0.5, 0, 0, 0.0]))[2] > 0.0
