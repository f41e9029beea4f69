"""What hangs on the bench of a campaign."""

from __future__ import annotations

from typing import Annotated, Literal

from auvid.data_schemas.documents.model import Model, Quantity, Range, Unit


class TimedEntry(Model):
    """Timed."""

    oscillations: Annotated[int, Range(1)]
    """Complete oscillations counted."""
    duration_s: Annotated[float, Range(0)]
    """Time they took."""
    duration_sd_s: Annotated[float, Range(0)] | None = None
    """Standard error of the stop watch; default 0.2."""
    amplitude_deg: Annotated[float, Range(0, 90)] | None = None
    """Amplitude half way, for the correction of large swings; default 0."""


class CylinderEntry(Model):
    """Object that is a hollow cylinder lying down: the pendulum's check (58)."""

    length: Annotated[Quantity, Unit("m")]
    """L."""
    outer_radius: Annotated[Quantity, Unit("m")]
    """R, a radius (errata A14)."""
    inner_radius: Annotated[Quantity, Unit("m")]
    """r, a radius (errata A14)."""


class SwingEntry(Model):
    """Swings."""

    id: str
    """Short name of the swing in the results."""
    role: Literal["empty_tray", "object"]
    """The tray alone or something on it."""
    mass: Annotated[Quantity, Unit("kg")] | None = None
    """Object: its mass without the tray."""
    axis: Literal["x", "y", "z"] | None = None
    """Object that is the vehicle: body axis that stands upright, so I_x, I_y or I_z is
    measured about its centre of gravity.
    """
    legs: list[str] | None = None
    """Legs that recorded it."""
    timed: list[TimedEntry] | None = None
    """Counted oscillations, instead of legs."""
    cylinder: CylinderEntry | None = None
    """Object that is a hollow cylinder lying down: (58) is the check of the pendulum.
    """


class QuadrifilarEntry(Model):
    """a tray on four lines, (54)-(58) of Alberti 2015; it swings about the vertical."""

    radius_ceiling: Annotated[Quantity, Unit("m")]
    """R_1, radius of the circle through the supports of the ceiling."""
    radius_tray: Annotated[Quantity, Unit("m")]
    """R_2, radius of the circle through the supports of the tray."""
    line_length: Annotated[Quantity, Unit("m")]
    """h, length of the lines."""
    tray_mass: Annotated[Quantity, Unit("kg")]
    """Mass of the tray with its wires."""
    length_sd: Annotated[Quantity, Unit("m")] | None = None
    """Standard error of a measured length; default 0."""
    mass_sd: Annotated[Quantity, Unit("kg")] | None = None
    """Standard error of a weighed mass; default 0."""
    swings: list[SwingEntry]
    """What was hung; one entry of role empty_tray, which is taken off the others."""


class PartEntry(Model):
    """Parts."""

    name: str
    """What it is."""
    mass: Annotated[Quantity, Unit("kg")]
    """Its mass."""
    arm: Annotated[Quantity, Unit("m")]
    """From the pivot to its centre of gravity."""
    displaced_mass: Annotated[Quantity, Unit("kg")] | None = None
    """Mass of the water that it displaces; default 0."""
    displaced_arm: Annotated[Quantity, Unit("m")] | None = None
    """From the pivot to its centre of buoyancy; default its arm."""
    inertia: Annotated[Quantity, Unit("kg*m^2")] | None = None
    """About its own centre of gravity; default 0."""


class DecayEntry(Model):
    """Decays."""

    id: str
    """Short name of the decay in the results."""
    role: Literal["empty_pendulum", "vehicle"]
    """The pendulum alone or with the vehicle."""
    dof: Literal["surge", "sway", "heave"] | None = None
    """Vehicle: which of its axes points along the swing."""
    legs: list[str]
    """Legs that recorded it."""


class FreeDecayEntry(Model):
    """a pendulum in water that carries the vehicle, (66)-(71) of Alberti 2015."""

    arm: Annotated[Quantity, Unit("m")]
    """L, from the pivot to the centre of the vehicle."""
    parts: list[PartEntry]
    """The pendulum without the vehicle (pole, added weight), each part at its own arm.
    """
    vehicle_mass: Annotated[Quantity, Unit("kg")] | None = None
    """Mass of the vehicle as hung; default that of the vehicle file."""
    vehicle_displaced_mass: Annotated[Quantity, Unit("kg")] | None = None
    """Mass of the water that it displaces; default that of the vehicle file."""
    decays: list[DecayEntry]
    """What was hung; of role empty_pendulum the added mass and damping (per unit of
    speed at the arm) are taken off the others.
    """


class ApparatusDocument(Model):
    """Pendulums on the bench of a campaign, and the legs that recorded them.

    Geometry of the pendulums, the bodies hung on them, and the legs (or timed
    oscillations) of each.
    """

    title: str
    """One line for the report."""
    source: str
    """Where the numbers come from."""
    notes: str | None = None
    """What a reader of the report should know."""
    quadrifilar: QuadrifilarEntry | None = None
    """a tray on four lines, (54)-(58) of Alberti 2015; it swings about the vertical."""
    free_decay: FreeDecayEntry | None = None
    """a pendulum in water that carries the vehicle, (66)-(71) of Alberti 2015."""
