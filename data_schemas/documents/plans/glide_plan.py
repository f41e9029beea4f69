"""What the twin of a glider flies, its truth, and what its sensors measure."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from auvid.data_schemas.documents.model import Faults, Model, Range, fault
from auvid.data_schemas.documents.plans.plan import Name, NotNegative

Positive = Annotated[float, Range(1e-9, 1e9)]
Pitch = Annotated[float, Range(5, 60)]


class LayersEntry(Model):
    """Layers of water, straight lines between depths."""

    depth_m: list[NotNegative]
    """Depths, ascending."""
    density_kg_m3: list[Annotated[float, Range(950, 1100)]]
    """Density at each."""
    temperature_K: list[Annotated[float, Range(265, 320)]]
    """Temperature at each."""

    @model_validator(mode="after")
    def _lengths(self) -> LayersEntry:
        lengths = {len(self.depth_m), len(self.density_kg_m3), len(self.temperature_K)}
        if len(lengths) > 1 or self.depth_m != sorted(set(self.depth_m)) or len(self.depth_m) < 2:
            allowed = "two or more ascending depths, with a density and a temperature each"
            raise Faults(fault("layers that do not fit", "depth_m", self.depth_m, allowed=allowed))
        return self


class GliderTruthEntry(Model):
    """Drag, lift and trim to be found, referred to the area of the vehicle file."""

    C_D0: Positive
    """Drag without lift."""
    C_D1: NotNegative
    """Induced drag per square of the angle."""
    C_L_alpha: Positive
    """Slope of the lift."""
    zero_lift_deg: Annotated[float, Range(-10, 10)] = 0.0
    """Angle without lift."""
    trim_cm3: Annotated[float, Range(-1e4, 1e4)] = 0.0
    """Volume beyond that of the neutral glider."""


class GliderSensorsEntry(Model):
    """Standard deviations of white noise, and the clock."""

    period_s: Annotated[float, Range(0.5, 60)] = 2.0
    """Time between samples."""
    pressure_pa: NotNegative = 100.0
    """Of the pressure."""
    pitch_deg: NotNegative = 0.2
    """Of the pitch."""
    drive_cm3: NotNegative = 0.2
    """Of the drive."""
    density_kg_m3: NotNegative = 0.005
    """Of the density."""
    speed_m_s: NotNegative = 0.01
    """Of the speed through the water."""
    speed_on: Literal["both", "dives", "none"] = "dives"
    """Where the speed through the water is measured."""


class GlideLegEntry(Model):
    """Yos of one log."""

    id: Name
    """Short name."""
    dive_pitch_deg: list[Pitch]
    """Steepness of each dive."""
    climb_pitch_deg: list[Pitch]
    """Steepness of each climb."""

    @model_validator(mode="after")
    def _as_many(self) -> GlideLegEntry:
        if len(self.dive_pitch_deg) != len(self.climb_pitch_deg) or not self.dive_pitch_deg:
            message = "a yo is a dive and a climb"
            raise Faults(fault(message, "climb_pitch_deg", self.climb_pitch_deg))
        return self


class GlidePlanDocument(Model):
    """Glides of a twin: yos between two depths, in layered water that moves."""

    kind: Literal["glides"]
    """Glides of a glider."""
    title: str
    """One line for the report."""
    truth: GliderTruthEntry
    """Drag, lift and trim to be found."""
    layers: LayersEntry
    """Layers of water."""
    legs: list[GlideLegEntry]
    """Legs, each one log."""
    top_m: Positive = 4.0
    """Depth at which it turns down."""
    bottom_m: Positive = 90.0
    """Depth at which it turns up."""
    drive_cm3: Positive = 230.0
    """Volume of the drive to both sides."""
    drive_cm3_s: Positive = 20.0
    """Speed of the drive."""
    pitch_lag_s: Positive = 5.0
    """How slowly the pitch follows."""
    wave_m_s: NotNegative = 0.003
    """RMS of the vertical motion of the water (internal waves of 200 to 2400 s)."""
    sensors: GliderSensorsEntry = GliderSensorsEntry()
    """What the sensors measure."""

    @model_validator(mode="after")
    def _order(self) -> GlidePlanDocument:
        if self.bottom_m <= self.top_m:
            allowed = f"more than top_m, {self.top_m:g} m"
            raise Faults(fault("not below top_m", "bottom_m", self.bottom_m, allowed=allowed))
        return self
