"""The steady glide by its defining balance, and as what the motion comes to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.dynamics.gliding.flight import FlightPlan, FlyingBody, Water, Yo, fly_yos
from auvid.hydro.dynamics.gliding.steady_glide import (
    GlideState,
    Polar,
    angle_of_attack,
    net_buoyancy,
    slow_change,
    steady_glide,
)
from tests.support.glider_twin import BODY, POLAR, TRIM_M3

PITCH = np.radians([-35.0, -22.0, -14.0, 14.0, 22.0, 35.0])


def state(pitch: np.ndarray) -> GlideState:
    n = pitch.size
    drive = np.where(pitch > 0.0, 2.3e-4, -2.3e-4)
    return GlideState(pitch, drive, np.full(n, 1025.3), np.full(n, 3e5), np.full(n, 284.0))


@pytest.mark.compiles("hydro/dynamics/gliding/compiled_balance.py")
@pytest.mark.parametrize("zero_lift_deg", [0.0, 1.5])
def test_forces_along_and_across_the_path_balance(zero_lift_deg: float) -> None:
    polar = replace(POLAR, zero_lift_rad=float(np.radians(zero_lift_deg)))
    at = state(PITCH)
    glide = steady_glide(at, body=BODY, polar=polar, trim_m3=TRIM_M3)
    force = net_buoyancy(at, BODY, TRIM_M3)
    dynamic = 0.5 * at.density_kg_m3 * BODY.area_m2 * glide.speed_m_s**2
    lift = dynamic * polar.lift_slope * (glide.alpha_rad - polar.zero_lift_rad)
    drag = dynamic * polar.drag_coefficient(glide.alpha_rad)
    np.testing.assert_allclose(force * np.sin(glide.path_rad), drag, rtol=1e-10)
    np.testing.assert_allclose(force * np.cos(glide.path_rad), -lift, rtol=1e-10)
    np.testing.assert_allclose(glide.depth_rate_m_s, -glide.speed_m_s * np.sin(glide.path_rad))


def test_no_glide_is_flatter_than_the_polar_allows() -> None:
    assert np.isnan(angle_of_attack(np.radians(-5.0), Polar(0.2, 10.0, 7.0)))


def test_motion_in_still_uniform_water_comes_to_the_steady_glide() -> None:
    water = Water(np.array([0.0, 500.0]), np.full(2, 1025.0), np.full(2, 283.15))
    body = replace(BODY, compressibility_1_pa=0.0)
    pitch = float(np.radians(25.0))
    plan = FlightPlan((Yo(-pitch, pitch, -2.3e-4, 2.3e-4),), 5.0, 90.0, 2e-5, 5.0)
    flown = fly_yos(FlyingBody(body, POLAR, 0.0, -3.0, -55.0), water, plan)
    end = np.flatnonzero(flown.state.pitch_rad < np.radians(-24.99))[-30]
    at = GlideState(*(getattr(flown.state, name)[[end]] for name in GlideState.__annotations__))
    steady = steady_glide(at, body=body, polar=POLAR, trim_m3=0.0)
    assert flown.speed_m_s[end] == pytest.approx(steady.speed_m_s[0], rel=1e-4)
    assert flown.alpha_rad[end] == pytest.approx(steady.alpha_rad[0], abs=1e-4)


def test_a_glider_that_never_turns_is_refused() -> None:
    water = Water(np.array([0.0, 50.0]), np.array([1020.0, 1060.0]), np.full(2, 283.15))
    plan = FlightPlan((Yo(-0.4, 0.4, -2.3e-4, 2.3e-4),), 5.0, 90.0, 2e-5, 5.0)
    with pytest.raises(ValueError, match="does not reach 90 m"):
        fly_yos(FlyingBody(BODY, POLAR, 0.0, -3.0, -55.0), water, plan)


def test_the_speed_lags_behind_a_jittering_pitch_as_the_motion_does() -> None:
    """Means over 20 s against the balance along the path, integrated finely."""
    t = np.arange(0.0, 1200.0, 0.1)
    pitch = np.radians(-22.0 + 1.5 * np.sin(t / 20.0) + np.sin(t / 47.0))
    fine = GlideState(
        pitch,
        np.full(t.size, -2.3e-4),
        np.full(t.size, 1025.0),
        np.full(t.size, 3e5),
        np.full(t.size, 283.15),
    )
    steady = steady_glide(fine, body=BODY, polar=POLAR, trim_m3=0.0)
    force = net_buoyancy(fine, BODY, 0.0) * np.sin(steady.path_rad)
    speed = np.empty(t.size)
    speed[0] = steady.speed_m_s[0]
    for i in range(t.size - 1):
        pull = force[i] * (1.0 - (speed[i] / steady.speed_m_s[i]) ** 2)
        speed[i + 1] = speed[i] + 0.1 * pull / (BODY.mass_kg + BODY.added_kg)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.asarray(values.reshape(-1, 200).mean(axis=1))

    rows = GlideState(
        *(mean(each) for each in (pitch, fine.drive_m3, fine.density_kg_m3)),
        mean(fine.pressure_pa),
        mean(fine.temperature_K),
    )
    at_rows = steady_glide(rows, body=BODY, polar=POLAR, trim_m3=0.0)
    one = np.zeros(60, dtype=np.intp)
    lagging = slow_change(at_rows, rows, body=BODY, trim_m3=0.0, t_s=mean(t), part=one)
    off = lagging.speed_m_s - mean(speed)
    without = at_rows.speed_m_s - mean(speed)
    assert np.std(off[2:]) < 0.25 * np.std(without[2:])
