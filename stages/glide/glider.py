"""The glider of a vehicle file: what is weighed, and what is taken until measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvid.hydro.dynamics.gliding.steady_glide import GliderBody
from auvid.hydro.dynamics.vehicle.glider_body import glider_body, glider_part
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.glide.problem import FileFigure

LIFT_SHARE, INDUCED_SHARE = 0.1, 0.3
"""Standard deviations of lift slope and induced drag as shares, where none is given."""
ZERO_LIFT_SD_RAD = float(np.radians(2.0))
"""How well a pitch sensor sits along the line without lift, where nothing is given."""
TRIM_SHARE = 0.1
"""Standard deviation of the ballasting as a share of the drive's stroke."""


@dataclass(frozen=True)
class Glider:
    """A glider: body, stops of its drive [m^3], and figures with their spread."""

    body: GliderBody
    stops_m3: tuple[float, float] | None
    lift_slope: FileFigure
    induced: FileFigure
    zero_lift: FileFigure
    trim_m3: float
    trim_sd_m3: float | None
    mass_sd_kg: float

    def prior(self, stroke_m3: float) -> dict[str, FileFigure]:
        """Return what the vehicle file says of the unknowns; nothing of drag."""
        trim_sd = TRIM_SHARE * stroke_m3 if self.trim_sd_m3 is None else self.trim_sd_m3
        return {
            "C_D0": FileFigure(0.2, 10.0),
            "C_D1": self.induced,
            "C_L_alpha": self.lift_slope,
            "alpha_0": self.zero_lift,
            "trim": FileFigure(self.trim_m3, trim_sd),
            "mass": FileFigure(self.body.mass_kg, self.mass_sd_kg),
        }


def glider_of(vehicle: Vehicle) -> Glider:
    """Return the glider of a vehicle; raise `CampaignError` without part `glider`."""
    part = glider_part(vehicle)
    slope, induced = part.lift_slope.si, part.induced_drag.si
    stops = None
    if part.drive_stops is not None:
        low, high = (float(value) for value in part.drive_stops.array)
        stops = (low, high)
    return Glider(
        glider_body(vehicle),
        stops,
        FileFigure(slope, part.lift_slope_sd.si if part.lift_slope_sd else LIFT_SHARE * slope),
        FileFigure(
            induced, part.induced_drag_sd.si if part.induced_drag_sd else INDUCED_SHARE * induced
        ),
        FileFigure(0.0, part.zero_lift_sd.si if part.zero_lift_sd else ZERO_LIFT_SD_RAD),
        (vehicle.displaced_mass_kg - vehicle.mass_kg) / vehicle.water_density,
        None if part.trim_sd is None else part.trim_sd.si,
        float(vehicle.spreads.get("mass", 0.0)),
    )
