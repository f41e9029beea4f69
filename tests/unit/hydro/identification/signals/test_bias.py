"""Sensor biases and velocity from an accelerometer: a motion known in closed form,
clean and noisy.
"""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError, PipelineError
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.dynamics.mechanics.kinematics import (
    euler_rate_matrix_inverse,
    rotation_body_to_ned,
)
from auvid.hydro.identification.signals.bias import (
    accelerometer_bias,
    fit_bias_linear,
    fit_velocity,
    gyro_bias,
    inertial_acceleration,
    integrate,
    lever_arm_velocity,
)
from auvid.hydro.identification.signals.splines import derivative

ARM = np.array([0.4, -0.1, 0.05])
GYRO_BIAS = np.array([0.004, -0.006, 0.003])
ACCEL_BIAS = np.array([0.15, -0.1, 0.05])


@dataclass(frozen=True)
class Motion:
    t: np.ndarray
    euler: np.ndarray
    omega: np.ndarray
    omega_dot: np.ndarray
    v: np.ndarray
    v_dot: np.ndarray

    @property
    def inertial(self) -> np.ndarray:
        return self.v_dot + np.cross(self.omega, self.v)


@pytest.fixture(scope="module")
def motion() -> Motion:
    t = np.arange(0.0, 60.0, 0.02)
    euler = np.column_stack(
        [0.1 * np.sin(0.9 * t), 0.2 * np.sin(0.5 * t + 1.0), 2.0 * np.sin(0.2 * t)]
    )
    rate = np.column_stack(
        [0.09 * np.cos(0.9 * t), 0.1 * np.cos(0.5 * t + 1.0), 0.4 * np.cos(0.2 * t)]
    )
    omega = np.einsum("nij,nj->ni", euler_rate_matrix_inverse(euler), rate)
    v = np.column_stack([1.5 + 0.3 * np.sin(0.3 * t), 0.2 * np.cos(0.4 * t), 0.1 * np.sin(0.6 * t)])
    v_dot = np.column_stack(
        [0.09 * np.cos(0.3 * t), -0.08 * np.sin(0.4 * t), 0.06 * np.cos(0.6 * t)]
    )
    return Motion(t, euler, omega, derivative(t, omega), v, v_dot)


def accelerometer(m: Motion, convention: str) -> np.ndarray:
    """What an accelerometer at ARM reports, written out from its definition."""
    if convention == "derivative":
        return m.v_dot
    a = m.inertial + np.cross(m.omega_dot, ARM) + np.cross(m.omega, np.cross(m.omega, ARM))
    if convention == "specific_force":
        down = np.einsum("nji,j->ni", rotation_body_to_ned(m.euler), np.array([0.0, 0.0, 1.0]))
        a = a - STANDARD_GRAVITY * down
    return a


@pytest.mark.parametrize("convention", ["specific_force", "inertial", "derivative"])
def test_inertial_acceleration_from_each_convention(motion: Motion, convention: str) -> None:
    arguments = {
        "euler": motion.euler,
        "omega": motion.omega,
        "omega_dot": motion.omega_dot,
        "velocity": motion.v,
        "arm": ARM,
    }
    accel = accelerometer(motion, convention)
    np.testing.assert_allclose(
        motion.inertial, motion.v_dot + np.cross(motion.omega, motion.v), atol=1e-12
    )
    np.testing.assert_allclose(
        inertial_acceleration(accel, convention=convention, **arguments),
        motion.inertial,
        atol=1e-12,
    )


@pytest.mark.parametrize("gravity", [STANDARD_GRAVITY, 9.81, 9.78])
def test_accelerometer_at_rest_reads_minus_gravity_along_down(gravity: float) -> None:
    zero = np.zeros((1, 3))
    rate = inertial_acceleration(
        np.array([[0.0, 0.0, -gravity]]),
        convention="specific_force",
        euler=zero,
        omega=zero,
        omega_dot=zero,
        velocity=zero,
        gravity=gravity,
    )
    np.testing.assert_allclose(rate, 0.0, atol=1e-12)


def test_gravity_is_the_standard_one_unless_given() -> None:
    zero = np.zeros((1, 3))
    rate = inertial_acceleration(
        zero,
        convention="specific_force",
        euler=zero,
        omega=zero,
        omega_dot=zero,
        velocity=zero,
    )
    np.testing.assert_allclose(rate, [[0.0, 0.0, STANDARD_GRAVITY]], rtol=1e-15)


def test_unknown_convention_is_named(motion: Motion) -> None:
    with pytest.raises(PipelineError, match="specific_force, inertial, derivative"):
        inertial_acceleration(
            motion.v,
            convention="raw",
            euler=motion.euler,
            omega=motion.omega,
            omega_dot=motion.omega,
            velocity=motion.v,
        )


def test_integral_is_that_of_a_spline() -> None:
    t = np.linspace(0.0, 3.0, 61)
    np.testing.assert_allclose(
        integrate(t, np.column_stack([3 * t**2, np.cos(t)]), [1.0, 0.0]),
        np.column_stack([1 + t**3, np.sin(t)]),
        atol=1e-8,
    )
    with pytest.raises(DataError, match="strictly increasing"):
        integrate([0.0, 0.0], [1.0, 1.0])
    with pytest.raises(DataError, match="not finite"):
        integrate([0.0, 1.0], [1.0, np.nan])


def test_constant_bias_of_a_rate_with_missing_measurements() -> None:
    t = np.linspace(0.0, 20.0, 401)
    path = np.column_stack([np.sin(t), 2.0 + 0.1 * t**2])
    rate = np.column_stack([np.cos(t), 0.2 * t]) + np.array([0.3, -0.2])
    measured = path.copy()
    measured[50:300, 1] = np.nan
    fit = fit_bias_linear(t, rate, measured)
    np.testing.assert_allclose(fit.bias, [0.3, -0.2], atol=1e-8)
    np.testing.assert_allclose(fit.initial, path[0], atol=1e-7)
    np.testing.assert_allclose(fit.residual_rms, 0.0, atol=1e-7)
    rate_fit = fit_bias_linear(t, rate, measured, initial=path[0])
    np.testing.assert_allclose(rate_fit.bias, [0.3, -0.2], atol=1e-8)
    assert np.isnan(rate_fit.initial_std).all()


def test_gyro_bias_clean(motion: Motion) -> None:
    fit = gyro_bias(motion.t, motion.euler, motion.omega + GYRO_BIAS)
    np.testing.assert_allclose(fit.bias, GYRO_BIAS, atol=1e-9)
    np.testing.assert_allclose(fit.initial, motion.euler[0], atol=1e-8)


def test_gyro_bias_noisy_within_what_is_asked_for_and_its_own_errors(motion: Motion) -> None:
    rng = np.random.default_rng(11)
    euler = motion.euler + np.deg2rad(0.05) * rng.standard_normal(motion.euler.shape)
    wrapped = (euler + np.pi) % (2 * np.pi) - np.pi
    fit = gyro_bias(
        motion.t,
        wrapped,
        motion.omega + GYRO_BIAS + 0.002 * rng.standard_normal(motion.euler.shape),
    )
    # 5e-4 rad/s: what a residual force of useful accuracy allows.
    np.testing.assert_allclose(fit.bias, GYRO_BIAS, atol=5e-4)
    assert (np.abs(fit.bias - GYRO_BIAS) < 5 * fit.bias_std).all()
    assert (fit.bias_std < 2e-4).all()


def test_gyro_bias_refuses_vertical_pitch(motion: Motion) -> None:
    steep = motion.euler.copy()
    steep[:, 1] = np.pi / 2 - 0.01
    with pytest.raises(DataError, match="vertical pitch"):
        gyro_bias(motion.t, steep, motion.omega)


def test_velocity_clean(motion: Motion) -> None:
    t_dvl = np.arange(0.1, 59.9, 0.25)
    v_dvl = np.column_stack([np.interp(t_dvl, motion.t, column) for column in motion.v.T])
    fit = fit_velocity(motion.t, motion.inertial + ACCEL_BIAS, motion.euler, t_dvl, v_dvl)
    # 1e-5: linear interpolation of the truth to the DVL's times.
    np.testing.assert_allclose(fit.bias, ACCEL_BIAS, atol=1e-5)
    np.testing.assert_allclose(fit.initial, motion.v[0], atol=1e-4)
    np.testing.assert_allclose(fit.velocity, motion.v, atol=2e-4)


def test_velocity_noisy_with_dvl_dropouts(motion: Motion) -> None:
    rng = np.random.default_rng(12)
    t_dvl = np.arange(-1.0, 62.0, 0.25)
    v_dvl = np.column_stack(
        [np.interp(t_dvl, motion.t, column) for column in motion.v.T]
    ) + 0.01 * rng.standard_normal((len(t_dvl), 3))
    v_dvl[100:140] = np.nan
    v_dvl[180, 1] = np.nan
    f = motion.inertial + ACCEL_BIAS + 0.03 * rng.standard_normal(motion.v.shape)
    fit = fit_velocity(motion.t, f, motion.euler, t_dvl, v_dvl)
    np.testing.assert_allclose(fit.bias, ACCEL_BIAS, atol=0.006)
    assert np.sqrt(np.mean((fit.velocity - motion.v) ** 2)) < 0.015
    assert (np.abs(fit.bias - ACCEL_BIAS) < 5 * fit.bias_std).all()
    assert (fit.bias_std < 0.003).all()
    # Random walk of the integrated noise beside the DVL's own 0.01 m/s.
    assert (fit.residual_rms < 0.03).all()


def test_leaving_the_transport_term_in_spoils_the_sway(motion: Motion) -> None:
    f = motion.inertial + ACCEL_BIAS
    as_published = accelerometer_bias(motion.t, motion.v, f, initial=motion.v[0])
    corrected = accelerometer_bias(motion.t, motion.v, motion.v_dot + ACCEL_BIAS)
    assert as_published.residual_rms[1] > 0.1
    np.testing.assert_allclose(corrected.bias, ACCEL_BIAS, atol=1e-8)
    np.testing.assert_allclose(corrected.residual_rms, 0.0, atol=1e-7)


def test_lever_arm_velocity(motion: Motion) -> None:
    sensor = motion.v + np.cross(motion.omega, ARM)
    np.testing.assert_allclose(lever_arm_velocity(sensor, motion.omega, ARM), motion.v, atol=1e-12)


def test_too_few_measurements_are_refused(motion: Motion) -> None:
    with pytest.raises(DataError, match="too few"):
        fit_velocity(motion.t, motion.inertial, motion.euler, [100.0], np.zeros((1, 3)))
    with pytest.raises(DataError, match="too few"):
        fit_bias_linear([0.0, 1.0, 2.0], [0.0, 0.0, 0.0], [np.nan, 1.0, np.nan])


def test_an_integral_takes_the_memory_of_one_column_beside_its_result() -> None:
    """The spline of one column has five coefficients a sample; all at once, 45 of nine."""
    t = 0.02 * np.arange(20_000)
    rates = np.sin(np.outer(t, np.arange(1.0, 10.0)))
    integrate(t, rates[:, 0])  # imports
    tracemalloc.start()
    path = integrate(t, rates)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert path == pytest.approx(
        (1.0 - np.cos(np.outer(t, np.arange(1.0, 10.0)))) / np.arange(1.0, 10.0), abs=1e-5
    )
    assert peak < 4 * rates.nbytes
