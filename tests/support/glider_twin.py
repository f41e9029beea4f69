"""A glider with known truth, in memory: its flight, and what its sensors record."""

from __future__ import annotations

from functools import cache

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.gliding.flight import (
    FlightPlan,
    FlyingBody,
    GliderFlight,
    Water,
    Yo,
    fly_yos,
)
from auvid.hydro.dynamics.gliding.steady_glide import GliderBody, GlideState, Polar
from auvid.hydro.identification.glide.bins import GlideRows, glide_rows
from auvid.hydro.identification.glide.problem import FileFigure
from auvid.hydro.identification.glide.settled import GliderRecord, SettlingRules, settled_glides

BODY = GliderBody(60.0, 0.1, 9.81, 1025.0, 3.0, 5e-10, 5e-5, 283.15)
POLAR = Polar(drag=0.16, induced=9.0, lift_slope=7.0)
TRIM_M3 = 1e-5
WATER = Water(
    np.array([0.0, 20.0, 40.0, 100.0]),
    np.array([1023.5, 1023.6, 1025.0, 1026.0]),
    np.array([291.0, 290.5, 286.0, 283.0]),
)
DIVES_DEG = (22.0, 28.0, 18.0, 25.0, 32.0)
CLIMBS_DEG = (25.0, 20.0, 30.0, 22.0, 27.0)


@cache
def flight(yos: int = 5, bottom_m: float = 90.0) -> GliderFlight:
    """Return a flight of the true glider."""
    plan = FlightPlan(
        tuple(
            Yo(
                -float(np.radians(DIVES_DEG[n % 5])),
                float(np.radians(CLIMBS_DEG[n % 5])),
                -2.3e-4,
                2.3e-4,
            )
            for n in range(yos)
        ),
        top_m=4.0,
        bottom_m=bottom_m,
        drive_m3_s=2e-5,
        pitch_lag_s=5.0,
    )
    return fly_yos(FlyingBody(BODY, POLAR, TRIM_M3, -3.0, -55.0), WATER, plan)


def record(
    flown: GliderFlight,
    seed: int | None,
    *,
    every: int = 8,
    wave_m_s: float = 0.003,
    speed: str = "both",
) -> GliderRecord:
    """Return what sensors record: noise, and water that moves up and down.

    seed None: neither. `speed`: on both, dives, or none.
    """
    rng = np.random.default_rng(seed)
    at, state = slice(None, None, every), flown.state
    t = flown.t_s[at]

    def noise(sd: float) -> Array:
        return np.zeros(t.size) if seed is None else sd * rng.normal(size=t.size)

    periods = np.exp(rng.uniform(np.log(200.0), np.log(2400.0), 12))
    turns = 2.0 * np.pi / periods
    amplitude = 0.0 if seed is None else wave_m_s * np.sqrt(2.0 / 12.0) / turns
    lift = (amplitude * np.sin(turns * t[:, None] + rng.uniform(0.0, 6.3, 12))).sum(axis=1)
    density = state.density_kg_m3[at]
    measured = GlideState(
        state.pitch_rad[at] + noise(np.radians(0.2)),
        state.drive_m3[at] + noise(2e-7),
        density + noise(0.005),
        state.pressure_pa[at] + density * BODY.gravity * lift + noise(100.0),
        state.temperature_K[at] + noise(0.002),
    )
    through = flown.speed_m_s[at] + noise(0.01)
    if speed == "none":
        through = np.full(t.size, np.nan)
    if speed == "dives":
        through = np.where(state.pitch_rad[at] > 0.0, np.nan, through)
    return GliderRecord(t, measured, through)


def rows_of(recorded: GliderRecord) -> GlideRows:
    """Return the rows of the settled glides of a record."""
    rules = SettlingRules(surface_m=10.0, settling_s=60.0)
    return glide_rows(settled_glides(recorded, rules, gravity=BODY.gravity), stretch_s=20.0)


def file_figures() -> dict[str, FileFigure]:
    """Return what a vehicle file with the true figures says."""
    return {
        "C_D0": FileFigure(0.2, 10.0),
        "C_D1": FileFigure(POLAR.induced, 2.0),
        "C_L_alpha": FileFigure(POLAR.lift_slope, 0.7),
        "alpha_0": FileFigure(0.0, float(np.radians(2.0))),
        "trim": FileFigure(0.0, 4.6e-5),
        "mass": FileFigure(BODY.mass_kg, 0.0),
    }
