"""Quadrifilar pendulum and free decay: printed figures of Alberti, known truth with and
without noise, and what is refused.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from auvid.data_schemas.errors import DataError
from auvid.hydro.dynamics.simulation.bench_motion import (
    PhysicalPendulum,
    Quadrifilar,
    free_decay,
    swing,
)
from auvid.hydro.identification.bench.channel_records import DAMPING
from auvid.hydro.identification.bench.free_decay import (
    Decay,
    DecayEstimate,
    Derivatives,
    HungPart,
    derivatives,
    estimate_decay,
    pendulum_moments,
    prediction_error,
)
from auvid.hydro.identification.bench.output_error import SingleRun
from auvid.hydro.identification.bench.quadrifilar import (
    Estimate,
    QuadrifilarGeometry,
    combined,
    counted_period,
    equivalent_inertia,
    hollow_cylinder,
    object_inertia,
    slowing,
    small_swing_period,
    softening,
    tray_inertia,
)
from auvid.hydro.identification.bench.swing import (
    angle_about,
    angle_per_rate,
    fit_swing,
    outside_range,
    release_index,
    spectral_period,
    swing_axis,
)
from tests.support.quadrifilar import swing_period

Array = npt.NDArray[np.float64]
G = 9.80665
TRAY = QuadrifilarGeometry(0.47, 0.47, 4.23, 9.8, G)
I_TRAY, I_BOTH, TUBE_MASS = 2.1970, 2.8590, 2.38
ARM = 3.66
POLE = [HungPart(5.93, ARM / 2.0), HungPart(4.62, ARM)]
VEHICLE = HungPart(38.10, ARM, 38.10, ARM)
TRUTH = np.array([-87.0553, -45.7734, -40.0])
"""Added mass and linear damping of Table 12; its quadratic damping, -0.68 kg/m, is too
small to be found in any recording.
"""
POLE_TRUTH = np.array([-4.1996, -1.0, -1.0])


def test_printed_figures() -> None:
    assert swing_period(TRAY, 9.8, I_TRAY) == pytest.approx(4.157, abs=5e-4)
    assert swing_period(TRAY, 9.8 + TUBE_MASS, I_BOTH) == pytest.approx(4.254, abs=5e-4)
    assert hollow_cylinder(TUBE_MASS, 1.82, 0.0254, 0.0219) == pytest.approx(0.6576, abs=5e-5)
    inertia = object_inertia(
        TRAY,
        TUBE_MASS,
        Estimate(swing_period(TRAY, 12.18, I_BOTH), 0.0),
        Estimate(swing_period(TRAY, 9.8, I_TRAY), 0.0),
    )
    assert inertia.value == pytest.approx(0.6620, abs=1e-9)
    assert tray_inertia(TRAY, Estimate(4.1571, 0.0)).value == pytest.approx(2.1970, abs=1e-4)


def test_counted_oscillations() -> None:
    one = counted_period(20, 83.142, 0.2)
    assert one.value == pytest.approx(4.1571)
    assert one.standard_error == pytest.approx(0.01)
    both = combined([Estimate(1.0, 0.1), Estimate(3.0, 0.1)])
    assert both.value == pytest.approx(2.0)
    assert both.standard_error == pytest.approx(1.0)  # they scatter far more than they say
    assert combined([Estimate(1.0, 0.1), Estimate(1.0, 0.1)]).standard_error == pytest.approx(
        0.1 / np.sqrt(2.0)
    )


def test_uncertainty_is_propagated() -> None:
    geometry = QuadrifilarGeometry(0.47, 0.47, 4.23, 9.8, G, length_sd=0.001, mass_sd=0.01)
    rng = np.random.default_rng(2)
    loaded, empty = swing_period(TRAY, 12.18, I_BOTH), swing_period(TRAY, 9.8, I_TRAY)
    draws = []
    for _ in range(2000):
        r1, r2, h = np.array([0.47, 0.47, 4.23]) + 0.001 * rng.standard_normal(3)
        tray, tube = np.array([9.8, TUBE_MASS]) + 0.01 * rng.standard_normal(2)
        a, b = loaded + 2e-3 * rng.standard_normal(), empty + 2e-3 * rng.standard_normal()
        one = QuadrifilarGeometry(r1, r2, h, tray, G)
        draws.append(equivalent_inertia(one, tray + tube, a) - equivalent_inertia(one, tray, b))
    inertia = object_inertia(
        geometry, TUBE_MASS, Estimate(loaded, 2e-3), Estimate(empty, 2e-3)
    ).standard_error
    assert inertia == pytest.approx(
        np.std(draws), rel=0.08
    )  # 2000 draws know a standard deviation to 1.6 %


def test_softening_agrees_with_the_energy_integral() -> None:
    amplitude, product, drop = 0.3, 0.47**2, 4.23
    mass, inertia = 12.18, I_BOTH

    def depth(psi: float) -> float:
        return float(np.sqrt(drop**2 - 2.0 * product * (1.0 - np.cos(psi))))

    def slowness(x: float) -> float:
        psi = amplitude * np.sin(x)
        slope = -product * np.sin(psi) / depth(psi)
        energy = mass * G * (depth(psi) - depth(amplitude))
        return float(amplitude * np.cos(x) * np.sqrt((inertia + mass * slope**2) / (2.0 * energy)))

    period = 4.0 * quad(slowness, 0.0, np.pi / 2.0 - 1e-9)[0]
    loss = 1.0 - swing_period(TRAY, mass, inertia) / period
    # The next term of the series is A^4 / 3000.
    assert loss == pytest.approx(softening(TRAY, mass, inertia) * amplitude**2, abs=1e-5)


@cache
def tray_swing(
    angle_deg: float, inertia: float, mass: float, damping: float
) -> tuple[Array, Array]:
    t = np.arange(-3.0, 60.0, 0.04)
    states, _ = swing(
        Quadrifilar(inertia, mass, 0.47, 0.47, 4.23, damping, G), np.radians(angle_deg), 60.0
    )(t)
    return t, states[:, 1]


@pytest.mark.parametrize("angle_deg", [5.0, 20.0, 45.0])
def test_period_of_a_recording(angle_deg: float) -> None:
    t, rate = tray_swing(angle_deg, I_TRAY, 9.8, 0.02)
    fit = fit_swing(t, rate + 0.01 + 1e-4 * t, slowing=slowing(TRAY, 9.8, I_TRAY))
    assert fit.period_s == pytest.approx(swing_period(TRAY, 9.8, I_TRAY), rel=1e-4)
    assert np.degrees(fit.amplitude_rad) == pytest.approx(angle_deg, rel=0.05)
    assert fit.decay_rate == pytest.approx(0.02 / I_TRAY / 2.0, rel=0.05)
    assert fit.bias == pytest.approx(0.01, abs=1e-3)
    assert spectral_period(t, rate) == pytest.approx(
        fit.period_s * (1.0 + np.radians(angle_deg) ** 2 / 16.0), rel=0.01
    )


def test_inertia_from_noisy_recordings_and_its_interval() -> None:
    rng = np.random.default_rng(0)
    seeds, hits, worst = 40, 0, 0.0
    truth = I_BOTH - I_TRAY
    for _ in range(seeds):
        periods = []
        for inertia, mass in ((I_BOTH, 12.18), (I_TRAY, 9.8)):
            t, rate = tray_swing(8.0, inertia, mass, 0.02)
            fit = fit_swing(
                t, rate + 0.005 * rng.standard_normal(t.size), slowing=slowing(TRAY, mass, inertia)
            )
            periods.append(Estimate(fit.period_s, fit.standard_error_s))
        measured = object_inertia(TRAY, TUBE_MASS, *periods)
        hits += measured.interval[0] < truth < measured.interval[1]
        worst = max(worst, abs(measured.value / truth - 1.0))
    # The thesis's own figure is 0.7 %. 95 % nominal coverage; its binomial standard
    # deviation over 40 seeds is 3.4 %.
    assert worst < 0.007
    assert hits / seeds > 0.84


def test_wrong_geometry_gives_no_negative_inertia() -> None:
    with pytest.raises(DataError, match="negative after the tray"):
        object_inertia(TRAY, TUBE_MASS, Estimate(3.0, 0.01), Estimate(4.157, 0.01))


def test_axis_of_a_turned_recorder() -> None:
    t, rate = tray_swing(8.0, I_TRAY, 9.8, 0.02)
    turned = Rotation.from_euler("ZYX", [10.0, 5.0, 0.0], degrees=True)
    gyro = turned.inv().apply(np.outer(rate, [0.0, 0.0, 1.0])) + 0.02
    axis = swing_axis(gyro)
    assert axis.nearest == "z"
    assert np.degrees(axis.misalignment_rad) == pytest.approx(5.0, abs=0.01)
    assert axis.share > 0.999
    np.testing.assert_allclose((gyro - 0.02) @ axis.axis, rate, atol=1e-3)
    euler = (Rotation.from_rotvec(np.outer(0.2 * np.sin(t), [0.0, 0.0, 1.0])) * turned).as_euler(
        "ZYX"
    )[:, ::-1]
    angle = angle_about(euler, axis.axis)
    np.testing.assert_allclose(
        angle - angle.mean(), 0.2 * np.sin(t) - np.mean(0.2 * np.sin(t)), atol=1e-3
    )
    with pytest.raises(DataError, match="no rotation"):
        swing_axis(np.ones((10, 3)))


def test_clipped_samples_can_be_left_out() -> None:
    t, rate = tray_swing(20.0, I_TRAY, 9.8, 0.02)
    clipped = np.clip(rate, -0.4, 0.4)
    fit = fit_swing(t, clipped, slowing=slowing(TRAY, 9.8, I_TRAY), usable=np.abs(clipped) < 0.4)
    assert fit.period_s == pytest.approx(swing_period(TRAY, 9.8, I_TRAY), rel=2e-4)


def test_large_swing_with_a_load() -> None:
    """The tray's rise slows a loaded tray more than a simple pendulum: the series of
    the swing itself, not that of a pendulum.
    """
    t, rate = tray_swing(45.0, 4.1, 47.9, 0.004)
    fit = fit_swing(t, rate, slowing=slowing(TRAY, 47.9, 4.1))
    small = swing_period(TRAY, 47.9, 4.1)
    assert fit.period_s == pytest.approx(small, rel=5e-5)
    assert np.degrees(fit.amplitude_rad) == pytest.approx(45.0, rel=0.05)
    slow = small / (1.0 - softening(TRAY, 47.9, 4.1) * 0.5**2)
    assert small_swing_period(TRAY, 47.9, slow, 0.5) == pytest.approx(small, rel=2e-4)
    assert small_swing_period(TRAY, 47.9, slow, 0.0) == slow


def test_range_of_a_turned_gyro() -> None:
    t, rate = tray_swing(20.0, I_TRAY, 9.8, 0.02)
    noise = 0.002 * np.random.default_rng(0).standard_normal((t.size, 3))
    gyro = np.outer(rate, [0.3, 0.6, 0.74]) + noise + [0.01, -0.02, 0.0]
    clipped = np.clip(gyro, -0.3, 0.3)
    limits = outside_range(clipped)
    np.testing.assert_array_equal(limits, np.abs(clipped).max(axis=1) >= 0.3)
    assert 0.05 < limits.mean() < 0.5
    assert not outside_range(gyro).any()
    # Whole milliradians per second stand still at the top of a slow swing: no clip.
    assert not outside_range(np.round(gyro, 2)).any()


def test_release_after_a_pull() -> None:
    t = np.arange(-20.0, 40.0, 0.04)
    states, _ = swing(Quadrifilar(I_TRAY, 9.8, 0.47, 0.47, 4.23, 0.02, G), np.radians(10.0), 60.0)(
        t
    )
    pull = np.where((t > -15.0) & (t < -12.0), np.radians(10.0) / 3.0, 0.0)
    rate = np.where(t < 0.0, pull, states[:, 1])
    assert t[release_index(rate)] == pytest.approx(0.15, abs=0.1)
    fit = fit_swing(t, rate, slowing=slowing(TRAY, 9.8, I_TRAY))
    assert fit.period_s == pytest.approx(swing_period(TRAY, 9.8, I_TRAY), rel=1e-4)


def test_two_swings_in_one_leg() -> None:
    t, rate = tray_swing(8.0, I_TRAY, 9.8, 0.2)
    both_t, both = np.concatenate([t, t + t[-1] - t[0] + 0.04]), np.concatenate([rate, rate])
    with pytest.raises(DataError, match="grows again"):
        fit_swing(both_t, both)


def test_share_of_a_swing_that_an_attitude_shows() -> None:
    t, rate = tray_swing(8.0, I_TRAY, 9.8, 0.02)
    at = t[5:-5:2]
    angle = np.interp(
        at, t, np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    )
    share = angle_per_rate(t, rate + 0.02 + 1e-4 * t, at, 0.93 * angle + 0.3)
    assert share == pytest.approx(0.93, abs=1e-3)


def test_too_few_swings_and_no_swing() -> None:
    t, rate = tray_swing(8.0, I_TRAY, 9.8, 0.02)
    short = t < 8.0
    with pytest.raises(DataError, match="too few swings"):
        fit_swing(t[short], rate[short])
    with pytest.raises(DataError, match="no oscillation"):
        fit_swing(t, np.exp(-0.1 * np.maximum(t, 0.0)))
    with pytest.raises(DataError, match="too slow"):
        fit_swing(t[::30], rate[::30])


def decay_of(
    parts: list[HungPart],
    values: Array,
    *,
    noise: float = 0.0,
    seed: int = 0,
    attitude: bool = True,
    gyro: bool = True,
    end_s: float = 40.0,
) -> Decay:
    hung = pendulum_moments(parts, G)
    inertia = hung.inertia - values[0] * ARM**2
    pendulum = PhysicalPendulum(inertia, hung.stiffness, values[1] * ARM**2, values[2] * ARM**3)
    t = np.arange(0.0, end_s, 0.02)
    states, _ = free_decay(pendulum, np.radians(22.0), end_s)(t)
    rng = np.random.default_rng(seed)
    rate = states[:, 1] + noise * (0.002 * rng.standard_normal(t.size) + 0.01 + 1e-4 * t)
    angle = states[:, 0] + noise * (0.001 * rng.standard_normal(t.size) + 0.03)
    still = np.zeros(t.size - 1)
    i, none, empty = np.arange(t.size), np.zeros(0, dtype=np.intp), np.zeros(0)
    run = SingleRun(
        t,
        still,
        still,
        i if gyro else none,
        rate if gyro else empty,
        i if attitude else none,
        angle if attitude else empty,
    )
    return Decay(run, np.array([rate[0], angle[0]]), float(np.sqrt(hung.stiffness / inertia)))


def empty_pendulum() -> Derivatives:
    estimate = estimate_decay(decay_of(POLE, POLE_TRUTH))
    return derivatives(
        estimate.output_error["linear and quadratic"], pendulum_moments(POLE, G), arm=ARM
    )


def best(estimate: DecayEstimate, method: str = "output_error") -> tuple[Array, Array]:
    hung = pendulum_moments([*POLE, VEHICLE], G)
    out = derivatives(
        getattr(estimate, method)["linear and quadratic"], hung, arm=ARM, empty=empty_pendulum()
    )
    return out.values, out.standard_errors


def test_damping_models_are_those_of_the_vehicle() -> None:
    """Linear damping of the vehicle on a pole whose own damping is linear and
    quadratic.
    """
    hung, empty = pendulum_moments([*POLE, VEHICLE], G), empty_pendulum()
    truth = TRUTH * [1.0, 1.0, 0.0]
    decay = decay_of([*POLE, VEHICLE], truth + POLE_TRUTH)
    pole = (empty.values[1] * ARM**2 / hung.stiffness, empty.values[2] * ARM**3 / hung.stiffness)
    estimate = estimate_decay(replace(decay, pole=pole))
    assert estimate.chosen == "linear"
    for method, tolerance in (("output_error", 1e-6), ("recursive", 0.02), ("batch", 0.02)):
        values = derivatives(getattr(estimate, method)["linear"], hung, arm=ARM, empty=empty).values
        np.testing.assert_allclose(values, truth, rtol=tolerance, atol=1e-9)
    other = decay_of([*POLE, VEHICLE], truth + POLE_TRUTH, noise=1.0, seed=4)
    # 1 mrad of noise per sample of the angle.
    assert prediction_error(other, estimate.output_error["linear"]) == pytest.approx(1e-3, rel=0.1)
    assert prediction_error(other, estimate.output_error["quadratic"]) > 2e-3


def test_decay_gives_the_truth_and_prefers_the_true_damping() -> None:
    estimate = estimate_decay(decay_of([*POLE, VEHICLE], TRUTH + POLE_TRUTH))
    values, _ = best(estimate)
    np.testing.assert_allclose(values, TRUTH, rtol=1e-4)
    assert estimate.chosen == "linear and quadratic"
    errors = {name: item.held_out_rad for name, item in estimate.output_error.items()}
    assert errors["linear and quadratic"] < 1e-6 < min(errors["linear"], errors["quadratic"])
    for method in ("recursive", "batch"):
        # Straight lines between samples of 50 Hz cost a thousandth of the added mass;
        # the quadratic term is the most sensitive.
        assert np.all(np.abs(best(estimate, method)[0] / TRUTH - 1.0) < [0.005, 0.03, 0.1])


@pytest.mark.parametrize(("attitude", "gyro"), [(True, True), (False, True), (True, False)])
def test_noisy_decay_with_drifting_zero(attitude: bool, gyro: bool) -> None:
    estimate = estimate_decay(
        decay_of([*POLE, VEHICLE], TRUTH + POLE_TRUTH, noise=1.0, attitude=attitude, gyro=gyro)
    )
    values, errors = best(estimate)
    assert np.all(np.abs(values - TRUTH) < 4.0 * errors)
    assert abs(values[0] / TRUTH[0] - 1.0) < 0.02


@pytest.mark.parametrize("name", DAMPING)
def test_simplest_damping_that_holds_is_chosen(name: str) -> None:
    linear, quadratic = DAMPING[name]
    truth = (TRUTH + POLE_TRUTH) * [1.0, linear, 5.0 * quadratic]
    assert estimate_decay(decay_of([*POLE, VEHICLE], truth, noise=0.3)).chosen == name


def test_point_mass_and_physical_pendulum() -> None:
    physical, point = pendulum_moments(POLE, G), pendulum_moments(POLE, G, arm=ARM)
    assert point.inertia == pytest.approx((5.93 + 4.62) * ARM**2)
    assert point.stiffness == pytest.approx((5.93 + 4.62) * G * ARM)
    assert physical.inertia == pytest.approx(5.93 * (ARM / 2.0) ** 2 + 4.62 * ARM**2)
    with pytest.raises(DataError, match="buoyancy is above"):
        pendulum_moments([*POLE, HungPart(38.1, ARM, 60.0, ARM)], G)


def test_release_is_found() -> None:
    t, rate = tray_swing(8.0, I_TRAY, 9.8, 0.02)
    assert 0.0 < t[release_index(rate)] < 0.3
