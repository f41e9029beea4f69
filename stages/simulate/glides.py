"""Fly the yos of a glider's plan, and record them as its sensors would."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.data_schemas.documents.plans.glide_plan import GlideLegEntry, GlidePlanDocument
from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.gliding.flight import (
    FlightPlan,
    FlyingBody,
    GliderFlight,
    Water,
    Yo,
    fly_yos,
)
from auvid.hydro.dynamics.gliding.steady_glide import GliderBody, Polar
from auvid.hydro.dynamics.simulation.rov.sensors import START_US
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.columns import span_text
from auvid.stages.presentation import panel, plot, section, series, table, text
from auvid.stages.simulate.csv_writer import csv_text
from auvid.stages.simulate.plans import Entries, csv_name, log_entry

WAVES = 12
WAVE_PERIODS_S = (200.0, 2400.0)
PART = "glider"


@dataclass(frozen=True)
class FlownGlides:
    """Files by name, the document of the simulation, and its section."""

    logs: dict[str, bytes]
    document: dict[str, Any]
    section: dict[str, Any]


def glide_entries(plan: GlidePlanDocument) -> Entries:
    """Return the logs and legs of a plan, as a manifest has them."""
    logs = [log_entry(leg.id, "csv", (PART,)) for leg in plan.legs]
    return logs, [{"id": leg.id, "log": leg.id} for leg in plan.legs]


def fly_glides(vehicle: Vehicle, twin: TwinDocument, body: GliderBody) -> FlownGlides:
    """Return the logs of all legs.

    Raises `CampaignError` for another format than CSV and for a glider that never turns.
    """
    plan = twin.plan
    assert isinstance(plan, GlidePlanDocument)
    if twin.format != "csv":
        raise CampaignError(
            "a glider's log is CSV", field="simulate.format", value=twin.format, allowed="csv"
        )
    truth = plan.truth
    polar = Polar(truth.C_D0, truth.C_D1, truth.C_L_alpha, float(np.radians(truth.zero_lift_deg)))
    added = vehicle.added_mass
    glider = FlyingBody(body, polar, 1e-6 * truth.trim_cm3, float(added[0, 0]), float(added[2, 2]))
    logs, flown = {}, {}
    for number, leg in enumerate(plan.legs):
        flown[leg.id] = _flight(glider, plan, leg)
        rng = np.random.default_rng([twin.seed, number])
        logs[csv_name(leg.id, PART)] = csv_text(_recorded(flown[leg.id], plan, body, rng))
    legs: list[dict[str, Any]] = [
        {"id": name, "start_s": 0.0, "end_s": float(flight.t_s[-1]), "stopped": None, "biases": {}}
        for name, flight in flown.items()
    ]
    document = {
        "plan": plan.title,
        "truth": f"drag, lift and trim of the plan ({truth.model_dump_json()})",
        "seed": twin.seed,
        "format": twin.format,
        "legs": legs,
    }
    return FlownGlides(logs, document, _section(plan, flown))


def _flight(glider: FlyingBody, plan: GlidePlanDocument, leg: GlideLegEntry) -> GliderFlight:
    drive = 1e-6 * plan.drive_cm3
    yos = tuple(
        Yo(-float(np.radians(down)), float(np.radians(up)), -drive, drive)
        for down, up in zip(leg.dive_pitch_deg, leg.climb_pitch_deg, strict=True)
    )
    layers = plan.layers
    water = Water(
        np.array(layers.depth_m), np.array(layers.density_kg_m3), np.array(layers.temperature_K)
    )
    flown = FlightPlan(yos, plan.top_m, plan.bottom_m, 1e-6 * plan.drive_cm3_s, plan.pitch_lag_s)
    try:
        return fly_yos(glider, water, flown)
    except ValueError as refused:
        raise CampaignError(
            f"leg '{leg.id}' of the plan cannot be flown: {refused}", field="legs"
        ) from None


def _recorded(
    flight: GliderFlight, plan: GlidePlanDocument, body: GliderBody, rng: np.random.Generator
) -> dict[str, Array]:
    """Return the columns of a log: white noise, and water that moves up and down."""
    sensors = plan.sensors
    every = max(round(sensors.period_s / float(flight.t_s[1] - flight.t_s[0])), 1)
    at, state = slice(None, None, every), flight.state
    t = flight.t_s[at]
    shortest, longest = np.log(WAVE_PERIODS_S)
    periods = np.exp(rng.uniform(shortest, longest, WAVES))
    turns = 2.0 * np.pi / periods
    phases = rng.uniform(0.0, 2.0 * np.pi, WAVES)
    # Each wave has the same share of the vertical velocity; layers move with the water.
    amplitude = plan.wave_m_s * np.sqrt(2.0 / WAVES) / turns
    lift = (amplitude * np.sin(turns * t[:, None] + phases)).sum(axis=1)

    def noisy(values: Array, sd: float) -> Array:
        return np.asarray(values + sd * rng.normal(size=t.size))

    density = state.density_kg_m3[at]
    pressure = state.pressure_pa[at] + density * body.gravity * lift
    columns = {
        "time_s": START_US / 1e6 + t,
        "pressure_pa": noisy(pressure, sensors.pressure_pa),
        "pitch_rad": noisy(state.pitch_rad[at], float(np.radians(sensors.pitch_deg))),
        "buoyancy_drive_m3": noisy(state.drive_m3[at], 1e-6 * sensors.drive_cm3),
        "density_kg_m3": noisy(density, sensors.density_kg_m3),
        "temperature_K": np.array(state.temperature_K[at]),
    }
    speed = np.maximum(noisy(flight.speed_m_s[at], sensors.speed_m_s), 0.0)
    if sensors.speed_on == "dives":
        speed = np.where(state.pitch_rad[at] > 0.0, np.nan, speed)
    return columns if sensors.speed_on == "none" else {**columns, "speed_m_s": speed}


def _section(plan: GlidePlanDocument, flown: dict[str, GliderFlight]) -> dict[str, Any]:
    rows = [[name, value] for name, value in plan.truth.model_dump().items()]
    panels = [
        panel(f"depth of {name}", "m", [series("true", flight.t_s, flight.depth_m, "true")])
        for name, flight in flown.items()
    ]
    spans = ", ".join(
        f"{name} {span_text((0.0, float(flight.t_s[-1])))}" for name, flight in flown.items()
    )
    blocks = [
        text(f"Plan: {plan.title}. Flown: {spans}. Water moves by {plan.wave_m_s:g} m/s RMS."),
        table("Truth", ["figure", "value"], rows),
        plot("True depth", panels, look_for="Every yo turns at both depths."),
    ]
    return section("The twin", blocks, order=5)
