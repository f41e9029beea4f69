"""Parts of the vehicle document: hull, fins and wings, and what a glider has."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from auvid.data_schemas.documents.model import Faults, Model, Quantity, Unit, fault
from auvid.data_schemas.documents.quantities import Kilograms, Metres, PositiveMetres, PositiveRatio
from auvid.data_schemas.documents.vehicle.quantities import Lengths, PositiveSquareMetres, require

HULL_KEYS = {
    "cylinder": ("length", "diameter"),
    "myring": ("length", "diameter", "nose_length", "nose_exponent", "tail_length", "tail_angle"),
    "stations": ("station_x", "station_radius"),
}
"""What each shape of a hull needs."""


class HullEntry(Model):
    """A hull of revolution."""

    shape: Literal["cylinder", "myring", "stations"]
    """How the radius is given."""
    length: PositiveMetres | None = None
    """Length (cylinder, myring)."""
    diameter: PositiveMetres | None = None
    """Largest diameter (cylinder, myring)."""
    nose_x: Metres | None = None
    """x of the nose (cylinder, myring); default half the length."""
    nose_length: PositiveMetres | None = None
    """Length of the nose (myring)."""
    nose_exponent: PositiveRatio | None = None
    """n of the nose (myring)."""
    tail_length: PositiveMetres | None = None
    """Length of the tail (myring)."""
    tail_angle: Annotated[Quantity, Unit("rad", positive=True)] | None = None
    """Half-angle at the end of the tail (myring)."""
    station_x: Lengths | None = None
    """x of the stations, ascending (stations)."""
    station_radius: Lengths | None = None
    """Radius at the stations, linear between them (stations)."""
    frontal_area: PositiveSquareMetres | None = None
    """A_f of (2.82) where the source gives another than that of the diameter."""
    cross_flow_drag: PositiveRatio | None = None
    """C_dc; default 1.1."""

    @model_validator(mode="after")
    def _complete(self) -> HullEntry:
        require(self, *HULL_KEYS[self.shape])
        if self.station_x is not None and self.station_radius is not None:
            x, r = self.station_x.array, self.station_radius.array
            if (
                len(x) < 2
                or len(x) != len(r)
                or np.any(np.diff(x) <= 0.0)
                or min(r) < 0.0 >= max(r)
            ):
                message = "stations need two or more ascending x with a radius, not negative, each"
                raise Faults(fault(message, "station_x", x.tolist()))
        if self.nose_length and self.tail_length and self.length:
            both = self.nose_length.si + self.tail_length.si
            if both > self.length.si:
                message = "nose and tail are longer than the hull"
                allowed = f"at most {self.length.si:g} m together"
                raise Faults(fault(message, "tail_length", both, allowed=allowed))
        return self


class SurfaceEntry(Model):
    """A pair of equal fins or wings, or two crossed pairs."""

    layout: Literal["cruciform", "horizontal", "vertical"]
    """Two crossed pairs, a lying pair, a standing pair."""
    controlled: bool = False
    """True: these are the control fins; default false."""
    span: PositiveMetres
    """One surface from root to tip."""
    area: PositiveSquareMetres
    """Planform of one surface."""
    tip_height: PositiveMetres
    """Tip from the axis of the hull."""
    x_rear: Metres
    """Trailing edge."""
    x_front: Metres
    """Leading edge."""
    x_force: Metres | None = None
    """Where the force acts; default mid chord."""
    taper: PositiveRatio | None = None
    """Width of the tip over that of the root, t of (2.85); default 1."""

    @model_validator(mode="after")
    def _forward(self) -> SurfaceEntry:
        rear, front = self.x_rear.si, self.x_front.si
        if front <= rear:
            message = "the front of a surface is not ahead of its rear"
            raise Faults(fault(message, "x_front", front, allowed=f"above {rear:g} m"))
        return self


class GeometryEntry(Model):
    """Shape of hull, fins and wings, for strip theory.

    x is measured from the body origin, heights from the hull's axis.
    """

    hull: HullEntry
    """A hull of revolution."""
    surfaces: dict[str, SurfaceEntry] = Field(default_factory=dict)
    """Pairs of equal fins or wings, by name."""


class BuoyancyEngineEntry(Model):
    """Takes water in and out, and moves the centre of gravity along x."""

    mass_empty: Kilograms
    """Mass of the vehicle when empty."""
    mass_neutral: Kilograms
    """Mass at neutral buoyancy."""
    mass_full: Kilograms
    """Mass when full."""
    x_G_per_mass: Annotated[Quantity, Unit("m/kg")]
    """How far x_G moves forward per mass taken in."""

    @model_validator(mode="after")
    def _ascend(self) -> BuoyancyEngineEntry:
        masses = (self.mass_empty.si, self.mass_neutral.si, self.mass_full.si)
        if not 0.0 < masses[0] < masses[1] < masses[2]:
            allowed = "0 < mass_empty < mass_neutral < mass_full"
            message = "the masses of the buoyancy engine do not ascend"
            raise Faults(fault(message, value=masses, allowed=allowed))
        return self


class GliderEntry(Model):
    """What a glide is fitted with: areas, lift and hull of a glider.

    Lift and induced drag are those of the record where speed through the water tells
    them; else they hold as they stand here, with their spread.
    """

    reference_area: PositiveSquareMetres
    """Area S that drag and lift are referred to, mostly that of the wings."""
    lift_slope: Annotated[Quantity, Unit("1/rad", positive=True)]
    """Slope of the lift of hull and wings together, referred to S."""
    lift_slope_sd: Annotated[Quantity, Unit("1/rad", positive=True)] | None = None
    """Its standard deviation; default a tenth."""
    induced_drag: Annotated[Quantity, Unit("1/rad^2", positive=True)]
    """C_D1 in C_D = C_D0 + C_D1 alpha^2, referred to S."""
    induced_drag_sd: Annotated[Quantity, Unit("1/rad^2", positive=True)] | None = None
    """Its standard deviation; default three tenths."""
    zero_lift_sd: Annotated[Quantity, Unit("rad", positive=True)] | None = None
    """Standard deviation of the angle without lift, pitch sensor included; default 2
    degrees.
    """
    trim_sd: Annotated[Quantity, Unit("m^3", positive=True)] | None = None
    """Standard deviation of the ballasting; default a tenth of the drive's stroke."""
    compressibility: Annotated[Quantity, Unit("1/Pa")] | None = None
    """Share of its volume that the hull loses per pressure; default 0."""
    thermal_expansion: Annotated[Quantity, Unit("1/K")] | None = None
    """Share of its volume that the hull gains per temperature; default 0."""
    temperature: Annotated[Quantity, Unit("K")] | None = None
    """Temperature at which it was ballasted; default 283.15 K."""
    drive_stops: Annotated[Quantity, Unit("m^3", (2,))] | None = None
    """Lowest and highest reading of the drive: at a stop the reading tells no volume."""
