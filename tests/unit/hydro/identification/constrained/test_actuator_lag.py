"""The lag of the actuators, measured on made motion whose lag is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.identification.constrained.actuator_lag import DrivenLeg, measured_lag

STEP_S, SECONDS, SMOOTH = 0.05, 120.0, 7


def driven_leg(
    lag_s: float, seed: int = 1, *, loss: float = 0.0, axes: tuple[int, ...] = (0, 1, 5)
) -> DrivenLeg:
    """Return a leg of surge, sway and yaw under steps of force that act late.

    loss [s/m]: share of the force that each m/s takes.
    """
    rng = np.random.default_rng(seed)
    n = int(SECONDS / STEP_S)
    acting = np.zeros((n, 6))
    for axis in axes:
        steps = np.repeat(rng.uniform(-20.0, 20.0, n // 80 + 1), 80)[:n]
        acting[:, axis] = np.convolve(steps, np.ones(SMOOTH) / SMOOTH, "same")
    late = first_order_lag(acting, lag_s=lag_s, step_s=STEP_S)
    nu, mass, drag = np.zeros((n, 6)), 30.0, (15.0, 25.0)
    nu_dot = np.zeros((n, 6))
    for k in range(n):
        left = late[k] - loss * np.abs(late[k]) * nu[k]
        nu_dot[k] = (left - drag[0] * nu[k] - drag[1] * nu[k] * np.abs(nu[k])) / mass
        if k + 1 < n:
            nu[k + 1] = nu[k] + STEP_S * nu_dot[k]
    tau_bar = mass * nu_dot - acting + 0.5 * rng.standard_normal((n, 6))
    return DrivenLeg(nu, nu_dot, tau_bar, acting, STEP_S)


@pytest.mark.parametrize("lag_s", [0.08, 0.2])
def test_a_lag_of_thrusters_is_measured(lag_s: float) -> None:
    lag = measured_lag([driven_leg(lag_s)])
    assert lag is not None
    assert lag.clear
    assert lag.of_thrusters
    assert abs(lag.value_s - lag_s) < 2.0 * lag.sd_s + 0.002
    assert set(lag.by_axis) == {"X", "Y", "N"}


@pytest.mark.parametrize("lag_s", [0.0, 0.15])
def test_thrust_that_inflow_takes_is_no_lag(lag_s: float) -> None:
    """Without a term for the loss .02 s more come out than are there."""
    lag = measured_lag([driven_leg(lag_s, loss=0.6)])
    assert lag is not None
    assert abs(lag.value_s - lag_s) < 0.003
    assert lag.sd_s > 0.005, "what the loss changes stands in the deviation"


def test_a_wrong_mass_is_no_lag() -> None:
    leg = driven_leg(0.1)
    heavy = replace(leg, tau_bar=leg.tau_bar + 3.0 * leg.nu_dot)  # a tenth too much
    right, wrong = measured_lag([leg]), measured_lag([heavy])
    assert right is not None
    assert wrong is not None
    assert abs(wrong.value_s - right.value_s) < 0.005


def test_the_order_of_legs_does_not_count() -> None:
    """A leg that says .14 s, one of half its length that says .05: whichever comes first."""
    long, short = driven_leg(0.14, seed=2), driven_leg(0.05, seed=3)
    rows = slice(None, len(short.nu) // 2)
    short = replace(
        short,
        **{name: getattr(short, name)[rows] for name in ("nu", "nu_dot", "tau_bar", "actuators")},
    )
    one, other = measured_lag([long, short]), measured_lag([short, long])
    assert one is not None
    assert other is not None
    assert other.value_s == pytest.approx(one.value_s, rel=1e-9)
    assert other.sd_s == pytest.approx(one.sd_s, rel=1e-6)


def test_one_driven_axis_determines_no_lag() -> None:
    """A propeller alone: an error of its curve would pass for a lag."""
    lag = measured_lag([driven_leg(0.2, axes=(0,))])
    assert lag is not None
    assert set(lag.by_axis) == {"X"}
    assert not lag.clear


def late_velocity(leg: DrivenLeg, samples: int) -> DrivenLeg:
    """Return a leg whose velocity log, no gyro, is late by so many samples."""
    nu, nu_dot = leg.nu.copy(), leg.nu_dot.copy()
    for part, exact in ((nu, leg.nu), (nu_dot, leg.nu_dot)):
        part[samples:, :3] = exact[:-samples, :3]
    return replace(leg, nu=nu, nu_dot=nu_dot, tau_bar=leg.tau_bar + 30.0 * (nu_dot - leg.nu_dot))


def test_a_late_velocity_log_is_told_by_an_axis_that_turns() -> None:
    """Without yaw it passes for a lag of the thrusters, and the lag says so."""
    still = measured_lag([late_velocity(driven_leg(0.0, axes=(0, 1, 2)), 3)])
    assert still is not None
    assert still.clear
    assert not still.by_gyro
    turning = measured_lag([late_velocity(driven_leg(0.0, axes=(0, 1, 5)), 3)])
    assert turning is not None
    assert not turning.clear
    thrusters = measured_lag([driven_leg(0.1)])
    assert thrusters is not None
    assert thrusters.by_gyro


def test_no_lag_is_taken_where_there_is_none() -> None:
    lag = measured_lag([driven_leg(0.0)])
    assert lag is not None
    assert not (lag.clear and lag.of_thrusters)


def test_commands_that_are_early_are_no_thrusters() -> None:
    lag = measured_lag([driven_leg(0.8)])
    assert lag is not None
    assert lag.clear
    assert not lag.of_thrusters


def test_axes_that_differ_determine_no_lag() -> None:
    one, other = driven_leg(0.05), driven_leg(0.35)
    mixed: Array = one.tau_bar.copy()
    mixed[:, 1:] = other.tau_bar[:, 1:]
    nu, nu_dot = one.nu.copy(), one.nu_dot.copy()
    nu[:, 1:], nu_dot[:, 1:] = other.nu[:, 1:], other.nu_dot[:, 1:]
    lag = measured_lag([replace(one, nu=nu, nu_dot=nu_dot, tau_bar=mixed)])
    assert lag is not None
    assert not lag.clear


def test_no_leg_and_a_short_one_tell_no_lag() -> None:
    assert measured_lag([]) is None
    leg = driven_leg(0.2)
    rows = slice(0, 400)
    parts = (leg.nu, leg.nu_dot, leg.tau_bar, leg.actuators)
    assert measured_lag([DrivenLeg(*(part[rows] for part in parts), STEP_S)]) is None
