"""What hangs on the bench of a campaign."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from auvid.data_schemas.documents.model import (
    Faults,
    Model,
    Quantity,
    Range,
    Unit,
    default,
    fault,
)
from auvid.data_schemas.documents.quantities import Metres, PositiveKilograms, PositiveMetres

Mass = Annotated[Quantity, Unit("kg", may_be_negative=False)]
Inertia = Annotated[Quantity, Unit("kg*m^2", may_be_negative=False)]
Direction = Literal["surge", "sway", "heave"]


class TimedEntry(Model):
    """Timed."""

    oscillations: Annotated[int, Range(1)]
    """Complete oscillations counted."""
    duration_s: Annotated[float, Range(0)]
    """Time they took."""
    duration_sd_s: Annotated[float, Range(0)] = 0.2
    """Standard error of the stop watch."""
    amplitude_deg: Annotated[float, Range(0, 90)] = 0.0
    """Amplitude half way, for the correction of large swings."""


class CylinderEntry(Model):
    """Object that is a hollow cylinder lying down: the pendulum's check (58)."""

    length: Metres
    """L."""
    outer_radius: Metres
    """R, a radius (errata A14)."""
    inner_radius: Metres
    """r, a radius (errata A14)."""


class SwingEntry(Model):
    """Swings."""

    id: str
    """Short name of the swing in the results."""
    role: Literal["empty_tray", "object"]
    """The tray alone or something on it."""
    mass: Mass | None = None
    """Object: its mass without the tray."""
    axis: Literal["x", "y", "z"] | None = None
    """Object that is the vehicle: body axis that stands upright, so I_x, I_y or I_z is
    measured about its centre of gravity.
    """
    legs: list[str] = Field(default_factory=list)
    """Legs that recorded it."""
    timed: list[TimedEntry] = Field(default_factory=list)
    """Counted oscillations, instead of legs."""
    cylinder: CylinderEntry | None = None
    """Object that is a hollow cylinder lying down: (58) is the check of the pendulum.
    """

    @model_validator(mode="after")
    def _is_measured(self) -> SwingEntry:
        faults = []
        if self.role == "object" and self.mass is None:
            remedy = "Weigh it, without the tray."
            faults.append(fault("an object on the tray needs its mass", "mass", remedy=remedy))
        if not self.legs and not self.timed:
            words = "a swing needs legs that recorded it, or timed oscillations"
            faults.append(fault(words, value=self.id))
        Faults(*faults).raise_any()
        return self


class QuadrifilarEntry(Model):
    """a tray on four lines, (54)-(58) of Alberti 2015; it swings about the vertical."""

    radius_ceiling: PositiveMetres
    """R_1, radius of the circle through the supports of the ceiling."""
    radius_tray: PositiveMetres
    """R_2, radius of the circle through the supports of the tray."""
    line_length: PositiveMetres
    """h, length of the lines."""
    tray_mass: PositiveKilograms
    """Mass of the tray with its wires."""
    length_sd: Metres = default(0.0, "m")
    """Standard error of a measured length."""
    mass_sd: Mass = default(0.0, "kg")
    """Standard error of a weighed mass."""
    swings: list[SwingEntry]
    """What was hung; one entry of role empty_tray, which is taken off the others."""

    @model_validator(mode="after")
    def _hangs(self) -> QuadrifilarEntry:
        faults, line = [], self.line_length.si
        if line <= abs(self.radius_ceiling.si - self.radius_tray.si):
            words = "the lines are shorter than the difference of the radii"
            remedy = (
                "Check that all three are in the unit that they say, and that the radii are radii."
            )
            faults.append(fault(words, "line_length", line, remedy=remedy))
        trays = sum(swing.role == "empty_tray" for swing in self.swings)
        if trays != 1:
            faults.append(
                fault("one swing of the empty tray is needed", "swings", trays, allowed=1)
            )
        Faults(*faults).raise_any()
        return self


class PartEntry(Model):
    """Parts."""

    name: str
    """What it is."""
    mass: Mass
    """Its mass."""
    arm: Metres
    """From the pivot to its centre of gravity."""
    displaced_mass: Mass = default(0.0, "kg")
    """Mass of the water that it displaces."""
    displaced_arm: Metres | None = None
    """From the pivot to its centre of buoyancy; default its arm."""
    inertia: Inertia = default(0.0, "kg*m^2")
    """About its own centre of gravity."""


class DecayEntry(Model):
    """Decays."""

    id: str
    """Short name of the decay in the results."""
    role: Literal["empty_pendulum", "vehicle"]
    """The pendulum alone or with the vehicle."""
    dof: Direction | None = None
    """Vehicle: which of its axes points along the swing."""
    legs: list[str]
    """Legs that recorded it."""

    @model_validator(mode="after")
    def _has_direction(self) -> DecayEntry:
        if self.role == "vehicle" and self.dof is None:
            words, allowed = "a decay of the vehicle needs its direction", get_args(Direction)
            raise Faults(fault(words, "dof", allowed=allowed))
        return self

    @property
    def loaded_dof(self) -> Direction | None:
        """The axis of the vehicle along the swing, None for the empty pendulum."""
        return self.dof if self.role == "vehicle" else None


class FreeDecayEntry(Model):
    """a pendulum in water that carries the vehicle, (66)-(71) of Alberti 2015."""

    arm: PositiveMetres
    """L, from the pivot to the centre of the vehicle."""
    parts: list[PartEntry]
    """The pendulum without the vehicle (pole, added weight), each part at its own arm.
    """
    vehicle_mass: Mass | None = None
    """Mass of the vehicle as hung; default that of the vehicle file."""
    vehicle_displaced_mass: Mass | None = None
    """Mass of the water that it displaces; default that of the vehicle file."""
    decays: list[DecayEntry]
    """What was hung; of role empty_pendulum the added mass and damping (per unit of
    speed at the arm) are taken off the others.
    """

    @model_validator(mode="after")
    def _one_is_empty(self) -> FreeDecayEntry:
        empty = sum(decay.role == "empty_pendulum" for decay in self.decays)
        if empty > 1:
            raise Faults(fault("at most one decay of the empty pendulum", "decays", empty))
        return self


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

    @model_validator(mode="after")
    def _has_a_pendulum(self) -> ApparatusDocument:
        if self.quadrifilar is None and self.free_decay is None:
            allowed = "quadrifilar, free_decay"
            raise Faults(fault("the apparatus holds no pendulum", allowed=allowed))
        return self
