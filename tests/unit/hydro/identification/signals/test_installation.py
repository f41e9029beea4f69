"""What a wrong installation adds to a known motion is found, fault by fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.identification.signals import installation
from auvid.hydro.identification.signals.installation import (
    FAULTS,
    LegSensors,
    installation_faults,
    installation_sums,
)
from auvid.hydro.identification.signals.smoother import SmootherNoise
from tests.support.motions import Motion, rich_motion

PLACE = FAULTS[:9]
NOISE = {"velocity": 0.005, "accelerometer": 0.02, "depth": 0.003}
LOG_EVERY, DEPTH_EVERY = 10, 5


def sensors(
    motion: Motion,
    seed: int,
    *,
    arm: Array | None = None,
    angles: Array | None = None,
    lag: float = 0.0,
    scale: float = 0.0,
) -> LegSensors:
    """A leg whose velocity log has these faults and whose file says that it has none."""
    rng, t = np.random.default_rng(seed), motion.t_s
    v, omega = motion.nu[:, :3], motion.nu[:, 3:]
    bias = 0.1 * rng.standard_normal(3)
    force = motion.nu_dot[:, :3] + np.cross(omega, v)
    force = force + bias + NOISE["accelerometer"] * rng.standard_normal(force.shape)
    down = rotation_body_to_ned(motion.eta[:, 3:])[:, 2, :]
    at, below = slice(20, -20, LOG_EVERY), slice(None, None, DEPTH_EVERY)
    place = np.zeros(3) if arm is None else arm
    velocity = CubicSpline(t, v + np.cross(omega, place))(t[at] - lag)
    if angles is not None:
        velocity = velocity @ Rotation.from_rotvec(angles).as_matrix()
    velocity = (1.0 + scale) * velocity + NOISE["velocity"] * rng.standard_normal(velocity.shape)
    depth = motion.eta[below, 2] + NOISE["depth"] * rng.standard_normal(len(t[below]))
    return LegSensors(
        t, force, force - 9.80665 * down, motion.eta[:, 3:], omega, motion.nu_dot[:, 3:],
        t[at], velocity, np.zeros(3), t[below], depth,
    )  # fmt: skip


@pytest.fixture(scope="module")
def motion() -> Motion:
    return rich_motion(60.0, seed=3)


@pytest.mark.parametrize(
    ("fault", "name", "size"),
    [
        ({}, "", 0.0),
        ({"arm": np.array([0.5, 0.0, 0.0])}, "arm_x", 0.5),
        ({"arm": np.array([0.0, -0.1, 0.0])}, "arm_y", -0.1),
        ({"arm": np.array([0.0, 0.0, 0.2])}, "arm_z", 0.2),
        ({"angles": np.array([0.02, 0.0, 0.0])}, "angle_x", 0.02),
        ({"angles": np.array([0.0, -0.02, 0.0])}, "angle_y", -0.02),
        ({"angles": np.array([0.0, 0.0, 0.035])}, "angle_z", 0.035),
        ({"lag": 0.05}, "lag", 0.05),
        ({"scale": 0.05}, "velocity_scale", 0.05),
    ],
)
def test_each_fault_is_found_and_no_other(
    motion: Motion, fault: dict[str, Array], name: str, size: float
) -> None:
    estimate = installation_faults(installation_sums(sensors(motion, 1, **fault)), PLACE)
    for fault_name, value, sd in zip(estimate.names, estimate.value, estimate.sd, strict=True):
        truth = size if fault_name == name else 0.0
        # Four standard errors, and what is of second order in the fault.
        assert abs(value - truth) < 4.0 * sd + 0.02 * abs(size), fault_name
        assert not name or fault_name != name or abs(value) > 3.5 * sd


def test_standard_errors_hold_the_truth(motion: Motion) -> None:
    scores = []
    for seed in range(12):
        # The attitude has no error here, so that the bias does not walk.
        sums = installation_sums(sensors(motion, seed), SmootherNoise(tilt_error_rad=1e-6))
        estimate = installation_faults(sums, PLACE)
        scores.append(estimate.value / estimate.sd)
    rms = float(np.sqrt(np.mean(np.square(scores))))
    # 108 figures of 12 legs: an rms of 1 scatters by 7 to 15 %
    assert 0.6 < rms < 1.35, rms


@pytest.mark.parametrize(
    ("taken", "gravity", "transport"),
    [("as it is", 0.0, 0.0), ("without gravity", 1.0, 0.0), ("as derivative", 0.0, -1.0)],
)
def test_what_the_accelerometer_holds_is_found(
    motion: Motion, taken: str, gravity: float, transport: float
) -> None:
    leg = sensors(motion, 2)
    down = rotation_body_to_ned(leg.euler)[:, 2, :]
    excess = {
        "as it is": np.zeros((len(leg.t_s), 3)),
        "without gravity": -9.80665 * down,
        "as derivative": np.cross(leg.omega, motion.nu[:, :3]),
    }[taken]
    sums = installation_sums(replace(leg, acceleration=leg.acceleration + excess))
    estimate = installation_faults(sums, (*PLACE, "gravity", "transport"))
    # The velocity that the filter expects is wrong by the fault itself: a sixth is missing.
    assert estimate.value[-2:] == pytest.approx([gravity, transport], abs=0.25)
    assert np.all(estimate.sd[-2:] < 0.15)


@pytest.mark.compiles("hydro/identification/signals/compiled_filter.py")
def test_legs_add_up(motion: Motion) -> None:
    leg = installation_sums(sensors(motion, 4))
    one, twice = installation_faults(leg, PLACE), installation_faults(leg.merge(leg), PLACE)
    np.testing.assert_allclose(twice.value, one.value, rtol=1e-6)
    # 1/sqrt(2), and the correction for few pieces: 12/11 and 24/23
    np.testing.assert_allclose(twice.sd / one.sd, np.sqrt(0.5), rtol=0.03)


def test_pieces_of_the_filter_do_not_change_its_sums(
    motion: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    leg = sensors(motion, 1)
    one_piece = installation_sums(leg)
    monkeypatch.setattr(installation, "STEPS_AT_ONCE", 97)
    pieces = installation_sums(leg)
    assert np.array_equal(pieces.gram, one_piece.gram)
    assert np.array_equal(pieces.squares, one_piece.squares)


def test_a_straight_run_shows_no_arm() -> None:
    t = np.arange(3000) / 50.0
    rng = np.random.default_rng(1)
    zero = np.zeros((len(t), 3))
    v = np.column_stack([1.0 + 0.2 * np.sin(0.3 * t), zero[:, 1], zero[:, 2]])
    v_dot = np.column_stack([0.06 * np.cos(0.3 * t), zero[:, 1], zero[:, 2]])
    leg = LegSensors(
        t, v_dot + 0.02 * rng.standard_normal((len(t), 3)), v_dot, zero, zero, zero,
        t[::10], v[::10] + 0.005 * rng.standard_normal((300, 3)), np.zeros(3), t[::5],
        5.0 + 0.003 * rng.standard_normal(600),
    )  # fmt: skip
    estimate = installation_faults(installation_sums(leg), PLACE)
    assert np.isinf(estimate.sd[:3]).all()
    assert np.isfinite(estimate.sd[PLACE.index("velocity_scale")])
    # With a prior, what is not seen stays where it was.
    kept = installation_faults(installation_sums(leg), PLACE, np.full(9, 0.1))
    np.testing.assert_array_equal(kept.value[:3], 0.0)
    np.testing.assert_allclose(kept.sd[:3], 0.1)


def test_few_samples_are_refused(motion: Motion) -> None:
    leg = sensors(motion, 1)
    with pytest.raises(DataError, match="too few samples"):
        installation_sums(replace(leg, t_velocity=leg.t_velocity[:3], velocity=leg.velocity[:3]))


def test_a_wrong_place_shows_in_the_innovations(motion: Motion) -> None:
    right = installation_sums(sensors(motion, 6))
    wrong = installation_sums(sensors(motion, 6, arm=np.array([0.5, 0.0, 0.0])))
    ratio = (wrong.squares / wrong.samples) / (right.squares / right.samples)
    assert ratio[1] > 4.0  # sway: r x
