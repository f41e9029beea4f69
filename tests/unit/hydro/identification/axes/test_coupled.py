"""Several axes: known truth with Coriolis force, legs left out, sensitivities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.identification.axes.coupled import (
    CoupledFit,
    coupled_pool,
    fit_coupled,
    with_other_curves,
)
from auvid.hydro.identification.axes.drive import CURVE, DEAD_BAND, ForceDrive
from auvid.hydro.identification.axes.pooled_fit import Pool, PoolWork, loop_rows, motion
from auvid.hydro.identification.axes.quantities import Scale
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.axes.windows import MotionWindow
from tests.support.axis_legs import axis_leg

INERTIA = np.array([20.0, 26.0, 32.0, 0.5, 0.5, 3.0])
TRUTH = {
    "u": (-0.25, -1.2, 2.0, 0.02),
    "v": (-0.3, -1.6, 2.0, -0.02),
    "r": (-1.0, -0.8, 3.0, 0.03),
}


def legs() -> list[AxisRecord]:
    """Return two legs; the second does not command yaw."""
    return [
        axis_leg(seed, TRUTH, seconds=80.0, step_s=0.1, inertia=INERTIA, normalised=True, idle=idle)
        for seed, idle in ((1, ()), (2, ("r",)))
    ]


@pytest.mark.compiles("hydro/identification/axes/compiled_motion.py", "tests/support/axis_legs.py")
def test_truth_comes_back_and_legs_left_out_run_free() -> None:
    fit = fit_coupled(legs(), ("u", "v", "r"), inertia=INERTIA, free=())
    for velocity, truth in TRUTH.items():
        values, covariance = fit.block(velocity)
        assert np.all(np.abs(values - truth) < 5.0 * np.sqrt(np.diag(covariance)) + 1e-3)
        assert values[2] == pytest.approx(truth[2], rel=0.02)
    # Only the first leg commands yaw: the other cannot tell how it flies.
    assert [item.what for item in fit.held_out] == ["even windows", "odd windows", "leg 1"]
    second = fit.held_out[-1]
    assert set(second.one_run) == set(second.percent) == {"u", "v"}
    assert min(second.one_run.values()) > 90.0
    # One pull in surge, 40 N: M_u = 20 kg, and yaw by the ratio of inertia: 3 kg m^2.
    inertia = fit.physical("r", Scale(pull_N=40.0, standard_error=2.0))[0]
    assert inertia.value == pytest.approx(3.0, rel=0.02)
    assert inertia.standard_error == pytest.approx(0.05 * inertia.value, rel=0.1)


def test_ratios_of_inertia_come_back_where_those_of_the_file_are_wrong() -> None:
    """With the ratios of the file held, forces over inertia are up to 13 % off."""
    wrong, speeds = INERTIA * [1.0, 1.25, 1.0, 1.0, 1.0, 0.7], ("u", "v", "r")
    fit = fit_coupled(
        legs(), speeds, inertia=wrong, share_sd={"v": 0.3, "r": 0.3}, free=(), leave_out=False
    )
    shares = dict(zip(fit.fit.names, fit.fit.values, strict=True))
    assert shares["Y inertia"] == pytest.approx(1.0 / 1.25, rel=0.02)
    assert shares["N inertia"] == pytest.approx(1.0 / 0.7, rel=0.03)
    for velocity, truth in TRUTH.items():
        assert fit.block(velocity)[0][2] == pytest.approx(truth[2], rel=0.01)
    # One pull in surge gives the others by the ratios that were fitted.
    inertia = fit.physical("r", Scale(pull_N=40.0))[0]
    assert inertia.value == pytest.approx(3.0, rel=0.03)


def test_a_hull_that_nothing_drives_aside_tells_its_inertia_of_sway() -> None:
    """It drifts when it turns, and u v turns it: by (m_1 - m_2) / m_6, of a file 35 % off."""
    record = axis_leg(
        5, TRUTH, seconds=60.0, inertia=INERTIA, normalised=True, idle=("v",)
    )  # fmt: skip
    wrong = INERTIA * [1.0, 0.65, 1.0, 1.0, 1.0, 1.0]
    c = {
        tuple(shares): fit_coupled(
            [record], ("u", "r"), inertia=wrong, share_sd=shares, free=(), leave_out=False
        ).block("r")[0][2]
        for shares in ({"r": 0.3}, {"v": 0.3, "r": 0.3})
    }
    truth = TRUTH["r"][2]
    assert c["v", "r"] == pytest.approx(truth, rel=0.02)
    assert abs(c[("r",)] / truth - 1.0) > 0.05


def test_intervals_hold_what_another_curve_of_commands_would_change() -> None:
    """A straight line through bent commands has two thirds of their force and too little drag."""
    power = 1.6
    bent = [
        replace(item, force={key: np.sign(x) * np.abs(x) ** (1.0 / power)
                             for key, x in item.force.items()})
        for item in (
            axis_leg(seed, {"u": TRUTH["u"]}, seconds=80.0, step_s=0.1, normalised=True)
            for seed in (1, 2)
        )
    ]  # fmt: skip
    straight = fit_coupled(bent, ("u",), free=(), leave_out=False)
    curved = fit_coupled(
        bent, ("u",), drive=ForceDrive(curve=1.3), free=(DEAD_BAND, CURVE), leave_out=False
    )
    truth = np.array(TRUTH["u"][:3])

    def departs(fit: CoupledFit) -> Array:
        values, covariance = fit.block("u")
        half = fit.width * np.sqrt(np.diag(covariance))[:3]
        return np.asarray(np.abs(values[:3] - truth) / half)

    assert departs(straight).max() > 5.0
    assert departs(with_other_curves(straight, [curved])).max() < 1.0
    # What is left of the bent fit is noise: the straight one doubts nothing.
    sure = with_other_curves(curved, [straight])
    assert sure.fit.covariance == pytest.approx(curved.fit.covariance, rel=0.1, abs=1e-12)
    assert departs(sure).max() < 1.5


def test_sensitivities_are_differences() -> None:
    records = legs()
    pool = coupled_pool(
        records, ("u", "v", "r"), inertia=INERTIA, relative_sd=0.0, couplings=True,
        drive=ForceDrive(0.1), free=("lag",), restoring=False,
        loss="squares",
    )  # fmt: skip
    rng = np.random.default_rng(3)
    count, k = len(pool.structure.terms), 3
    common = np.append(rng.normal(size=count) * 0.3 - 0.5, 0.1)
    local = np.append(pool.prepared[0].start[0], 0.01 * np.ones(k))[None, :]
    work = PoolWork(pool, count)

    def states(common: Array, local: Array) -> Array:
        return work.run(common, local, 0)

    here = states(common, local)
    for i in range(count):
        step = np.zeros_like(common)
        step[i] = 1e-5
        difference = (states(common + step, local) - states(common - step, local))[:, :, 0] / 2e-5
        assert difference == pytest.approx(here[:, :, 1 + i], abs=1e-6)
    for i in range(3 * k):
        move = np.zeros_like(local)
        move[0, i] = 1e-5
        difference = (states(common, local + move) - states(common, local - move))[:, :, 0] / 2e-5
        assert difference == pytest.approx(here[:, :, 2 + count + i], abs=1e-6)


def test_coriolis_force_by_the_coefficients_has_their_sensitivities() -> None:
    """m_u = 40 / c_u and m_r = 9 / c_r: slopes by c against central differences."""
    (leg, _), sizes = legs(), {"u": (40.0, "u"), "r": (9.0, "r")}
    pool = coupled_pool(
        [leg], ("u", "v", "r"), inertia=INERTIA, numerators=sizes, relative_sd=0.0, couplings=False,
        drive=ForceDrive(), free=(), restoring=False,
    )  # fmt: skip
    theta = np.concatenate([TRUTH[velocity] for velocity in ("u", "v", "r")])
    window = pool.windows[1]
    start = np.append(pool.prepared[0].start[window.first], np.zeros(3))
    assert_slopes(pool, theta, window, start, places=(2, 10))  # the force of u, and of r


def test_factors_of_inertia_have_their_sensitivities() -> None:
    (leg, _) = legs()
    pool = coupled_pool(
        [leg], ("u", "v", "r"), inertia=INERTIA, share_sd={"v": 0.3, "r": 0.3}, relative_sd=0.0,
        couplings=False, drive=ForceDrive(), free=(), restoring=False,
    )  # fmt: skip
    u, v, r = (TRUTH[velocity] for velocity in ("u", "v", "r"))
    theta, window = np.array([*u, *v, 0.8, *r, 1.3]), pool.windows[1]
    start = np.append(pool.prepared[0].start[window.first], np.zeros(3))
    assert_slopes(pool, theta, window, start, places=(8, 13))


def assert_slopes(
    pool: Pool, theta: Array, window: MotionWindow, start: Array, *, places: tuple[int, ...]
) -> None:
    """Compare sensitivities to coefficients with central differences."""
    (rows,) = loop_rows(pool, pool.drive)
    out = motion(pool, rows, theta, window, start)
    for place in places:
        step = np.zeros(len(theta))
        step[place] = 1e-5
        ends = [motion(pool, rows, theta + s * step, window, start)[:, :, 0] for s in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / 2e-5
        np.testing.assert_allclose(out[:, :, 1 + place], slope, atol=1e-6)
