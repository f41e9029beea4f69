"""Drag, lift and trim of a glider with known truth, and the same least squares by scipy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from auvid.data_schemas.errors import DataError
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.gliding.flight import FlightPlan, FlyingBody, Yo, fly_yos
from auvid.hydro.dynamics.gliding.steady_glide import Polar, angle_of_attack, steady_glide
from auvid.hydro.identification.glide.comparison import clearest_step, compare
from auvid.hydro.identification.glide.fit import fit_glides
from auvid.hydro.identification.glide.problem import FileFigure
from tests.support.glider_twin import (
    BODY,
    POLAR,
    TRIM_M3,
    WATER,
    file_figures,
    flight,
    record,
    rows_of,
)

TRUE_AT_22 = float(POLAR.drag_coefficient(angle_of_attack(-np.radians(22.0), POLAR)))


def test_a_clean_record_gives_the_truth() -> None:
    """Within 1 %: what the balance leaves out is the inertia across the path."""
    estimate = fit_glides(rows_of(record(flight(), None)), body=BODY, prior=file_figures())
    assert estimate.value("C_D0") == pytest.approx(POLAR.drag, rel=0.01)
    assert estimate.value("C_L_alpha") == pytest.approx(POLAR.lift_slope, rel=0.01)
    assert estimate.value("C_D1") == pytest.approx(POLAR.induced, rel=0.02)
    assert estimate.value("trim") == pytest.approx(TRIM_M3, abs=1e-6)
    assert estimate.verdicts["C_L_alpha"] == "identified"


@pytest.mark.parametrize("speed", ["both", "dives", "none"])
def test_intervals_reach_the_truth_under_waves_and_noise(speed: str) -> None:
    estimate = fit_glides(
        rows_of(record(flight(), 4, speed=speed)), body=BODY, prior=file_figures()
    )
    drag, error = estimate.at_pitch(-float(np.radians(22.0)))["C_D"]
    assert abs(drag - TRUE_AT_22) < 1.5 * NORMAL_95 * error
    assert error < 0.1 * drag
    expected = "from the prior" if speed == "none" else "identified"
    assert estimate.verdicts["C_L_alpha"] == expected


def test_figures_of_the_file_that_are_two_spreads_off_do_not_bind_the_record() -> None:
    """Residuals beside them are wide: what the record knows is seen where it is freed."""
    far = file_figures()
    for name in ("alpha_0", "C_D1"):
        far[name] = replace(far[name], mean=far[name].mean + 2.0 * far[name].sd)
    estimate = fit_glides(rows_of(record(flight(), 2)), body=BODY, prior=far)
    assert {"alpha_0", "C_D1"} <= set(estimate.free)
    lift, error = estimate.at_pitch(-np.radians(17.0))["C_L"]
    truth = POLAR.lift_slope * float(angle_of_attack(-np.radians(17.0), POLAR))
    assert lift == pytest.approx(truth, rel=0.03)
    assert abs(lift - truth) < 2.5 * error


def test_glides_too_flat_to_be_steady_are_left_out_of_the_search() -> None:
    """Climbs at 13 to 16 degrees fly on their momentum; the rest gives the truth."""
    plan = FlightPlan(
        tuple(
            Yo(-float(np.radians(dive)), float(np.radians(climb)), -3.6e-4, 2.6e-4)
            for dive, climb in ((27, 22), (34, 13), (24, 28), (20, 16), (30, 25))
        ),
        top_m=4.0,
        bottom_m=90.0,
        drive_m3_s=2e-5,
        pitch_lag_s=5.0,
    )
    polar = Polar(drag=0.19, induced=14.0, lift_slope=7.5, zero_lift_rad=-0.02)
    flown = fly_yos(FlyingBody(BODY, polar, TRIM_M3, -3.0, -55.0), WATER, plan)
    rows = rows_of(record(flown, 2, speed="dives"))
    estimate = fit_glides(rows, body=BODY, prior=file_figures())
    pitch = -float(np.radians(26.0))
    truth = float(polar.drag_coefficient(angle_of_attack(pitch, polar)))
    assert estimate.at_pitch(pitch)["C_D"][0] == pytest.approx(truth, rel=0.03)
    four = rows.where(np.isin(rows.glide, (0, 1, 3, 6)))
    with pytest.raises(DataError, match="no drag makes a glide"):  # settled they are
        fit_glides(four, body=BODY, prior=file_figures())


def test_scipy_finds_the_same_minimum() -> None:
    """The full nonlinear balance in other words, without the lag of slow changes."""
    body = replace(BODY, mass_kg=BODY.mass_kg)
    rows = rows_of(record(flight(), 2))
    steady = replace(body, added_kg=-body.mass_kg)  # no inertia: steady at every row
    silent = {"alpha_0": FileFigure(0.0, 1e3), "C_D1": FileFigure(POLAR.induced, 1e5)}
    estimate = fit_glides(rows, body=steady, prior={**file_figures(), **silent})
    spread = estimate.residual_m_s

    def residuals(p: np.ndarray) -> np.ndarray:
        glide = steady_glide(
            rows.state, body=body, polar=Polar(p[0], p[1], p[2], p[3]), trim_m3=p[4] * 1e-5
        )
        return np.concatenate(
            [
                (rows.depth_rate_m_s - glide.depth_rate_m_s) / spread[0],
                (rows.speed_m_s - glide.speed_m_s) / spread[1],
            ]
        )

    assert estimate.free == ("C_D0", "trim", "C_L_alpha", "alpha_0", "C_D1")
    oracle = least_squares(
        residuals, [0.15, 8.0, 6.5, 0.0, 0.0], x_scale=[0.1, 5.0, 5.0, 0.05, 1.0], xtol=1e-14,
        ftol=1e-14, gtol=1e-14,
    ).x  # fmt: skip
    mine = [estimate.value(name) for name in ("C_D0", "C_D1", "C_L_alpha", "alpha_0")]
    np.testing.assert_allclose(mine, oracle[:4], rtol=1e-4, atol=1e-6)
    assert 1e5 * estimate.value("trim") == pytest.approx(oracle[4], rel=1e-3)


def test_one_direction_leaves_drag_and_trim_inseparable() -> None:
    rows = rows_of(record(flight(), 3))
    estimate = fit_glides(rows.where(rows.state.pitch_rad < 0.0), body=BODY, prior=file_figures())
    assert estimate.verdicts["C_D0"] == estimate.verdicts["trim"] == "inseparable"
    assert estimate.value("trim") == file_figures()["trim"].mean


def test_fewer_glides_than_their_spread_needs_are_refused() -> None:
    rows = rows_of(record(flight(), 3))
    with pytest.raises(DataError, match="too few settled glides"):
        fit_glides(rows.where(rows.glide < 3), body=BODY, prior=file_figures())
    with pytest.raises(DataError, match="too few settled glides; found 0"):
        fit_glides(rows.where(rows.glide < 0), body=BODY, prior=file_figures())


def test_glides_held_out_are_predicted() -> None:
    comparison = compare(rows_of(record(flight(), 5)), body=BODY, prior=file_figures())
    assert comparison.fit_percent > 95.0
    assert comparison.fit_within_percent > 70.0
    assert comparison.without_speed is not None
    assert "C_L_alpha" not in comparison.without_speed.free


def test_a_trim_that_drifts_or_scatters_does_not_step() -> None:
    noise = np.random.default_rng(3).normal(size=(200, 20))
    up = np.arange(20.0) % 2.0
    first, size, error = clearest_step(0.1 * noise[0] + 3.0 * up - 2.0 * (np.arange(20) >= 8), up)
    assert (first, size) == (8, pytest.approx(-2.0, abs=0.2))
    assert abs(size) > 6.0 * error
    first, size, error = clearest_step(0.1 * noise[1] + np.linspace(0.0, 2.0, 20), up)
    assert (first, size, error) == (0, 0.0, 0.0)
    few = [clearest_step(values[:5], up[:5]) for values in noise]
    assert np.mean([bool(at) and abs(step) > 6.0 * own for at, step, own in few]) < 0.02


def test_the_file_speaks_beside_the_record_in_what_the_record_frees() -> None:
    """Inverse variances weigh the two, whatever the colour of the residuals."""
    rows = rows_of(record(flight(), 4, speed="none"))
    no_file = {**file_figures(), "alpha_0": FileFigure(0.0, 1e3)}
    record_only = fit_glides(rows, body=BODY, prior=no_file)
    value, error = record_only.value("alpha_0"), record_only.standard_error("alpha_0")
    sd = 2.0 * error
    mean = value + sd
    both = fit_glides(rows, body=BODY, prior={**file_figures(), "alpha_0": FileFigure(mean, sd)})
    assert "alpha_0" in both.free
    # Student's t makes the record's own error a little larger than the weights take it.
    assert both.value("alpha_0") - value == pytest.approx((mean - value) / 5.0, rel=0.5)
    assert both.standard_error("alpha_0") < error
