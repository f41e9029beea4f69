"""The body of a glider as its vehicle file has it."""

from __future__ import annotations

from auvid.data_schemas.documents.vehicle.shape import GliderEntry
from auvid.data_schemas.errors import CampaignError
from auvid.hydro.dynamics.gliding.steady_glide import GliderBody
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle


def glider_part(vehicle: Vehicle) -> GliderEntry:
    """Return part `glider` of a vehicle file; raise `CampaignError` without one."""
    part = vehicle.document.glider
    if part is None:
        raise CampaignError(
            "the vehicle file has no part 'glider'",
            field="glider",
            value=vehicle.name,
            remedy=(
                "Give reference_area, lift_slope and induced_drag under `glider`"
                " (docs/glide.md has values of a Slocum)."
            ),
        )
    return part


def glider_body(vehicle: Vehicle) -> GliderBody:
    """Return mass, area and hull of a glider; raise without part glider."""
    part = glider_part(vehicle)
    return GliderBody(
        mass_kg=vehicle.mass_kg,
        area_m2=part.reference_area.si,
        gravity=vehicle.gravity,
        neutral_kg_m3=vehicle.water_density,
        added_kg=-float(vehicle.added_mass[0, 0]),
        compressibility_1_pa=part.compressibility.si if part.compressibility else 0.0,
        expansion_1_k=part.thermal_expansion.si if part.thermal_expansion else 0.0,
        temperature_K=part.temperature.si if part.temperature else 283.15,
    )
