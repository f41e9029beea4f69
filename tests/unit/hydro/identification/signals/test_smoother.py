"""The velocity smoother against a synthetic motion with known truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_matrix, rotation_body_to_ned
from auvid.hydro.identification.signals.bias import integrate
from auvid.hydro.identification.signals.smoother import (
    SmoothedVelocity,
    SmootherNoise,
    process_model,
    smooth_velocity,
)

BIAS = np.array([0.15, -0.10, 0.12])
INNER = slice(50, -50)


@dataclass(frozen=True)
class Motion:
    t: Array
    euler: Array
    omega: Array
    v: Array
    v_dot: Array
    z: Array

    @property
    def f(self) -> Array:
        return self.v_dot + np.cross(self.omega, self.v)


def turning_rates(t: Array | float) -> Array:
    return np.array([0.05 * np.sin(1.1 * t), 0.05 * np.cos(0.9 * t), 0.3 * np.sin(0.4 * t)])


@pytest.fixture(scope="module")
def motion() -> Motion:
    t = np.arange(2000) / 50.0
    euler = solve_ivp(
        lambda s, y: euler_rate_matrix(y) @ turning_rates(s),
        (0, 41),
        np.zeros(3),
        t_eval=t,
        rtol=1e-10,
        atol=1e-12,
    ).y.T
    v = np.column_stack(
        [1.5 + 0.2 * np.sin(0.3 * t), 0.2 * np.sin(0.5 * t), 0.05 * np.sin(0.7 * t)]
    )
    v_dot = np.column_stack(
        [0.06 * np.cos(0.3 * t), 0.1 * np.cos(0.5 * t), 0.035 * np.cos(0.7 * t)]
    )
    down = np.einsum("ni,ni->n", rotation_body_to_ned(euler)[:, 2, :], v)
    return Motion(t, euler, turning_rates(t).T, v, v_dot, integrate(t, down, 5.0))


def smoothed(motion: Motion, noise: float, seed: int = 1) -> SmoothedVelocity:
    rng = np.random.default_rng(seed)
    dvl, depth = np.arange(3, len(motion.t), 13), np.arange(0, len(motion.t), 5)
    return smooth_velocity(
        motion.t,
        motion.f + BIAS + 0.03 * noise * rng.standard_normal(motion.f.shape),
        motion.euler,
        motion.omega,
        t_velocity=motion.t[dvl],
        velocity=motion.v[dvl] + 0.01 * noise * rng.standard_normal((len(dvl), 3)),
        t_depth=motion.t[depth],
        depth=motion.z[depth] + 0.005 * noise * rng.standard_normal(len(depth)),
    )


def test_exact_sensors_give_the_exact_velocity_and_bias(motion: Motion) -> None:
    motion_estimate = smoothed(motion, noise=0.0)
    # The floors of the believed noise (1e-4) leave errors of their own order.
    np.testing.assert_allclose(motion_estimate.velocity[INNER], motion.v[INNER], atol=2e-4)
    np.testing.assert_allclose(motion_estimate.rate[INNER], motion.v_dot[INNER], atol=1e-3)
    np.testing.assert_allclose(motion_estimate.bias[INNER].mean(axis=0), BIAS, atol=1e-3)


def test_noisy_sensors_stay_within_the_bounds_that_a_well_tuned_smoother_reaches(
    motion: Motion,
) -> None:
    motion_estimate = smoothed(motion, noise=1.0)
    assert (
        np.sqrt(np.mean((motion_estimate.velocity - motion.v)[INNER] ** 2)) < 0.005
    )  # m/s, with 0.01 m/s of noise at 4 Hz
    assert (
        np.sqrt(np.mean((motion_estimate.rate - motion.v_dot)[INNER] ** 2)) < 0.01
    )  # m/s^2, with 0.03 m/s^2 of noise
    assert np.abs(motion_estimate.bias[INNER].mean(axis=0) - BIAS).max() < 0.003  # m/s^2


def test_noise_is_estimated_from_the_data(motion: Motion) -> None:
    noise = smoothed(motion, noise=1.0).noise
    np.testing.assert_allclose(noise.accel, 0.03, rtol=0.1)
    np.testing.assert_allclose(noise.velocity, 0.01, rtol=0.2)
    assert noise.depth == pytest.approx(0.005, rel=0.2)


def test_given_noise_is_used(motion: Motion) -> None:
    dvl = np.arange(3, len(motion.t), 13)
    noise = SmootherNoise(
        accel=np.full(3, 0.02), velocity=np.full(3, 0.05), depth=0.01, jerk_density=np.full(3, 1e-3)
    )
    motion_estimate = smooth_velocity(
        motion.t,
        motion.f,
        motion.euler,
        motion.omega,
        t_velocity=motion.t[dvl],
        velocity=motion.v[dvl],
        t_depth=motion.t,
        depth=motion.z,
        noise=noise,
    )
    assert motion_estimate.noise == noise


def test_standard_deviations_match_the_errors(motion: Motion) -> None:
    errors, spreads = [], []
    for seed in range(5):
        motion_estimate = smoothed(motion, noise=1.0, seed=seed)
        errors.append((motion_estimate.velocity - motion.v)[INNER])
        spreads.append(motion_estimate.velocity_sd[INNER])
    ratio = np.sqrt(
        np.mean(np.square(errors), axis=(0, 1)) / np.mean(np.square(spreads), axis=(0, 1))
    )
    assert np.all((ratio > 0.6) & (ratio < 1.5))


def test_a_transport_term_left_in_shows_in_the_rate(motion: Motion) -> None:
    """Negative control: omega x v counted twice puts up to 0.3 rad/s times 1.5 m/s into
    sway; noise as of a real velocity sensor.
    """
    dvl = np.arange(3, len(motion.t), 13)
    noise = SmootherNoise(
        accel=np.full(3, 0.03),
        velocity=np.full(3, 0.01),
        depth=0.005,
        jerk_density=np.full(3, 1e-3),
    )
    wrong = smooth_velocity(
        motion.t,
        motion.f + np.cross(motion.omega, motion.v),
        motion.euler,
        motion.omega,
        t_velocity=motion.t[dvl],
        velocity=motion.v[dvl],
        t_depth=motion.t,
        depth=motion.z,
        noise=noise,
    )
    # Twice the bound that the right accelerometer keeps above; the velocity sensor
    # pulls the rest back.
    assert np.sqrt(np.mean((wrong.rate - motion.v_dot)[INNER, 1] ** 2)) > 0.02


def test_refuses_what_is_not_finite_and_what_is_too_short(motion: Motion) -> None:
    with pytest.raises(DataError, match="not finite"):
        smooth_velocity(
            motion.t,
            motion.f * np.nan,
            motion.euler,
            motion.omega,
            t_velocity=motion.t,
            velocity=motion.v,
            t_depth=motion.t,
            depth=motion.z,
        )
    with pytest.raises(DataError, match="too few"):
        smooth_velocity(
            motion.t,
            motion.f,
            motion.euler,
            motion.omega,
            t_velocity=motion.t[:3],
            velocity=motion.v[:3],
            t_depth=motion.t,
            depth=motion.z,
        )


def with_water_track(
    motion: Motion, current: Array, *, noise: float, walk: float = 0.0, seed: int = 3
) -> SmoothedVelocity:
    """Bottom track, and a second velocity through water that moves with `current` (n,
    3) in NED.
    """
    rng = np.random.default_rng(seed)
    dvl, depth, water = (
        np.arange(3, len(motion.t), 13),
        np.arange(0, len(motion.t), 5),
        np.arange(7, len(motion.t), 13),
    )
    through = motion.v - np.einsum("nji,nj->ni", rotation_body_to_ned(motion.euler), current)
    return smooth_velocity(
        motion.t,
        motion.f + BIAS + 0.03 * noise * rng.standard_normal(motion.f.shape),
        motion.euler,
        motion.omega,
        t_velocity=motion.t[dvl],
        velocity=motion.v[dvl] + 0.01 * noise * rng.standard_normal((len(dvl), 3)),
        t_depth=motion.t[depth],
        depth=motion.z[depth] + 0.005 * noise * rng.standard_normal(len(depth)),
        noise=SmootherNoise(current_walk=walk),
        t_water=motion.t[water],
        water=through[water] + 0.02 * noise * rng.standard_normal((len(water), 3)),
    )


def test_constant_current_is_found_with_its_deviation(motion: Motion) -> None:
    """150 samples of 0.02 m/s at 4 Hz: about 2 mm/s; the standard deviation says so,
    and the velocity over ground stays what it is.
    """
    truth = np.array([0.3, -0.2, 0.02])
    motion_estimate = with_water_track(motion, np.tile(truth, (len(motion.t), 1)), noise=1.0)
    assert motion_estimate.current is not None
    assert motion_estimate.current_sd is not None
    error, spread = (
        motion_estimate.current.mean(axis=0) - truth,
        motion_estimate.current_sd.mean(axis=0),
    )
    assert np.abs(error).max() < 0.006
    assert np.all(np.abs(error) < 4.0 * spread)
    assert spread.max() < 0.004
    assert np.sqrt(np.mean((motion_estimate.velocity - motion.v)[INNER] ** 2)) < 0.005


def test_current_that_walks_is_followed(motion: Motion) -> None:
    """A current that turns within the leg: followed to some cm/s where it may walk, and
    not where it is held constant.
    """
    t = motion.t
    truth = np.column_stack([0.3 * np.cos(0.05 * t), 0.3 * np.sin(0.05 * t), np.zeros_like(t)])
    walking, constant = (
        with_water_track(motion, truth, noise=1.0, walk=walk).current for walk in (0.02, 0.0)
    )
    assert walking is not None
    assert constant is not None
    assert np.sqrt(np.mean((walking - truth)[INNER] ** 2)) < 0.02
    assert np.sqrt(np.mean((constant - truth)[INNER] ** 2)) > 0.05


def test_without_water_track_there_is_no_current(motion: Motion) -> None:
    """Nothing that is measured over ground says anything of the water, so none is
    given.
    """
    motion_estimate = smoothed(motion, noise=1.0)
    assert motion_estimate.current is None
    assert motion_estimate.current_sd is None


def test_water_track_of_too_few_samples_is_refused(motion: Motion) -> None:
    with pytest.raises(DataError, match="too few samples"):
        smooth_velocity(
            motion.t,
            motion.f,
            motion.euler,
            motion.omega,
            t_velocity=motion.t[::10],
            velocity=motion.v[::10],
            t_depth=motion.t[::10],
            depth=motion.z[::10],
            t_water=motion.t[:3],
            water=motion.v[:3],
        )


def process_matrices(euler: Array, omega: Array, noise: SmootherNoise) -> tuple[Array, Array]:
    """Continuous A and noise density (13, 13) of the smoother's state at one attitude."""
    A, density = np.zeros((13, 13)), np.zeros((13, 13))
    A[0, 1:4] = rotation_body_to_ned(euler)[2]
    A[1:4, 1:4] = -np.array(
        [[0, -omega[2], omega[1]], [omega[2], 0, -omega[0]], [-omega[1], omega[0], 0]]
    )
    A[1:4, 4:7] = A[4:7, 7:10] = np.eye(3)
    density[7:10, 7:10] = np.diag(noise.jerk_density)
    density[10:13, 10:13] = noise.bias_density * np.eye(3)
    return A, density


def test_process_model_is_that_of_van_loan() -> None:
    """Transition and process noise over a step from one matrix exponential (Van Loan 1978)."""
    noise = SmootherNoise(jerk_density=np.array([0.3, 0.5, 0.7]), tilt_error_rad=0.02)
    step, euler, omega = 0.1, np.array([0.1, -0.2, 0.5]), np.zeros(3)
    A, density = process_matrices(euler, omega, noise)
    block = expm(step * np.block([[-A, density], [np.zeros((13, 13)), A.T]]))
    expected_F = block[13:, 13:].T
    expected_Q = expected_F @ block[:13, 13:]
    t = np.array([0.0, step])
    F, Q = process_model(t, np.tile(euler, (2, 1)), np.tile(omega, (2, 1)), noise, 13)
    np.testing.assert_allclose(F[0], np.eye(13), atol=0.0)
    np.testing.assert_allclose(Q[0], 0.0, atol=0.0)
    np.testing.assert_allclose(F[1], expected_F, atol=1e-12)
    # What reaches depth through velocity is left out of the process noise.
    np.testing.assert_allclose(Q[1][1:, 1:], expected_Q[1:, 1:], rtol=1e-9, atol=1e-18)


def test_transition_turns_the_velocity_with_the_body() -> None:
    noise = SmootherNoise(jerk_density=np.ones(3))
    step, euler, omega = 0.02, np.array([0.1, -0.2, 0.5]), np.array([0.2, -0.3, 0.4])
    A, _ = process_matrices(euler, omega, noise)
    F, _ = process_model(
        np.array([0.0, step]), np.tile(euler, (2, 1)), np.tile(omega, (2, 1)), noise, 13
    )
    # The series ends with (A h)^4; what follows is (A h)^5 / 120.
    np.testing.assert_allclose(F[1], expm(step * A), rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("share", [-0.4, 0.4])
def test_a_velocity_between_steps_is_carried_to_its_step(share: float) -> None:
    """A straight run that gains 1 m/s^2, sampled off the grid by 0.4 of a step of 0.1 s.

    Taken as of the step itself, the sample would be wrong by 0.04 m/s.
    """
    step = 0.1
    t = np.arange(200) * step
    a = np.tile([1.0, 0.0, 0.0], (len(t), 1))
    times = t[5:-5:5] + share * step
    zero = np.zeros_like(a)
    result = smooth_velocity(
        t,
        a,
        zero,
        zero,
        t_velocity=times,
        velocity=np.outer(times, [1.0, 0.0, 0.0]),
        t_depth=t,
        depth=np.zeros_like(t),
        noise=SmootherNoise(
            accel=np.full(3, 1e-3),
            velocity=np.full(3, 1e-3),
            depth=1e-3,
            jerk_density=np.full(3, 1e-6),
        ),
    )
    np.testing.assert_allclose(result.velocity[20:-20, 0], t[20:-20], atol=1e-3)
