"""Shifts by assumed figures against fits with another vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import thruster_force
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.identification.regression.assumed_figures import MeasuredLeg, figure_errors
from auvid.hydro.identification.regression.least_squares import (
    AxisFit,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.normal_changes import STRIDE, StridedLeg
from tests.support.motions import rich_motion, shipped_vehicle

TERMS = ("u", "v", "w", "r", "u*|u|")
HEAVY = shipped_vehicle("bluerov2_heavy")


def leg() -> MeasuredLeg:
    motion = rich_motion(60.0, seed=4)
    n = len(motion.nu)
    force = np.random.default_rng(1).normal(0.0, 5.0, (n, 8)).cumsum(axis=0) * 0.05
    eta = np.zeros((n, 6))
    return MeasuredLeg(eta, motion.nu, motion.nu_dot, Control(thruster_force_N=force), 0.02)


def test_every_fifth_sample_does_not_keep_the_others_in_memory() -> None:
    data, every = leg(), leg().every(STRIDE)
    for few, many in ((every.nu, data.nu), (every.eta, data.eta), (every.nu_dot, data.nu_dot)):
        np.testing.assert_array_equal(few, many[::STRIDE])
        assert few.base is None
    assert every.control.thruster_force_N is not None
    assert np.asarray(every.control.thruster_force_N).base is None


def fit_of(vehicle: Vehicle, data: MeasuredLeg, axis: str) -> AxisFit:
    force = residual_force(vehicle, data.eta, data.nu, data.nu_dot, data.control).tau_bar
    factor = TriangularFactor.empty(TERMS).update(basis_rows(data.nu.T, None, TERMS), force)
    return solve_axis(factor, axis, TERMS)


def shift_of(figure: str, sd: float, axis: str) -> tuple[Array, Array]:
    """Return the fit and the shifts (m, k) by each number of a figure."""
    data = leg()
    every = data.every(STRIDE)
    fit = fit_of(HEAVY, every, axis)
    assert HEAVY.thrusters is not None
    thrust = thruster_force(HEAVY.thrusters, every.control.thruster_force_N)
    force = residual_force(HEAVY, data.eta, data.nu, data.nu_dot, data.control).tau_bar
    strided = StridedLeg.of(data.nu, force, TERMS, ratio=None)
    changes = [
        strided.definite(d_force, d_nu)
        for _, d_force, d_nu in figure_errors(
            every, HEAVY, thrust=thrust, actuators=thrust, spreads={figure: sd}
        )
    ]
    # `fit` is of every fifth sample, the sums stand for all.
    return fit.solution, np.array([change.shift(fit) / strided.weight for change in changes])


def test_thrust_scales_the_force() -> None:
    value, (shift,) = shift_of("thrust", 0.2, "X")
    data = leg().every(STRIDE)
    control = Control(thruster_force_N=1.2 * np.asarray(data.control.thruster_force_N))
    other = fit_of(HEAVY, replace(data, control=control), "X")
    np.testing.assert_allclose(shift, other.solution - value, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("axis", "index"), [("X", 0), ("N", 5)])
def test_added_mass_moves_as_another_vehicle_does(axis: str, index: int) -> None:
    value, shifts = shift_of("added_mass", 0.5, axis)
    assert len(shifts) == 6
    more = HEAVY.added_mass.copy()
    more[index, index] *= 1.5
    other = fit_of(replace(HEAVY, added_mass=more), leg().every(STRIDE), axis)
    np.testing.assert_allclose(shifts[index], other.solution - value, rtol=1e-6, atol=1e-9)
    assert np.abs(shifts[index]).max() > 1e-3


def test_mass_keeps_weight_and_buoyancy() -> None:
    value, (shift,) = shift_of("mass", 1.0, "Y")
    heavier = replace(HEAVY, mass_kg=14.5, displaced_mass_kg=14.5)
    other = fit_of(heavier, leg().every(STRIDE), "Y")
    np.testing.assert_allclose(shift, other.solution - value, rtol=1e-6, atol=1e-9)


def test_inertia_turns_with_yaw() -> None:
    value, shifts = shift_of("inertia", 1.0, "N")
    more = HEAVY.inertia.copy()
    more[2, 2] *= 2.0
    other = fit_of(replace(HEAVY, inertia=more), leg().every(STRIDE), "N")
    np.testing.assert_allclose(shifts[2], other.solution - value, rtol=1e-6, atol=1e-9)


def test_an_arm_moves_regressors_and_force() -> None:
    value, shifts = shift_of("velocity_arm", 1e-3, "Y")
    data = leg().every(STRIDE)
    nu, nu_dot = data.nu.copy(), data.nu_dot.copy()
    # 1 mm forward: v = v_sensor - r * 1 mm.
    nu[:, 1] -= 1e-3 * nu[:, 5]
    nu[:, 2] += 1e-3 * nu[:, 4]
    nu_dot[:, 1] -= 1e-3 * nu_dot[:, 5]
    nu_dot[:, 2] += 1e-3 * nu_dot[:, 4]
    other = fit_of(HEAVY, replace(data, nu=nu, nu_dot=nu_dot), "Y")
    np.testing.assert_allclose(shifts[0], other.solution - value, rtol=0.02, atol=1e-3)


def test_a_later_thrust_is_the_rate_of_the_thrust() -> None:
    data = leg()
    thrust = np.zeros_like(data.nu)
    thrust[:, 0] = 2.0 * data.step_s * np.arange(len(thrust))
    ((figure, d_force, d_nu),) = figure_errors(
        data, HEAVY, thrust=np.zeros_like(thrust), actuators=thrust, spreads={"thrust_lag": 0.05}
    )
    # 2 N/s for .05 s: tau_bar misses .1 N less of what was taken off.
    np.testing.assert_allclose(d_force[:, 0], 0.1)
    assert (figure, d_nu) == ("thrust_lag", None)
    assert not d_force[:, 1:].any()
