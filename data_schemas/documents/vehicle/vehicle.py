"""The vehicle document: every number with value, unit and source."""

from __future__ import annotations

from pydantic import Field

from auvid.data_schemas.documents.model import Model, Quantity
from auvid.data_schemas.documents.vehicle.actuators import ActuatorsEntry, PropulsionEntry
from auvid.data_schemas.documents.vehicle.body import (
    AddedMassEntry,
    EnvironmentEntry,
    RigidBodyEntry,
    SpreadsEntry,
)
from auvid.data_schemas.documents.vehicle.quantities import KilogramSquareMetres
from auvid.data_schemas.documents.vehicle.sensors import SensorsEntry
from auvid.data_schemas.documents.vehicle.shape import (
    BuoyancyEngineEntry,
    GeometryEntry,
    GliderEntry,
)


class VehicleDocument(Model):
    """A vehicle: mass, inertia, added mass, actuators and sensors.

    Every number has value, unit and source; assumed numbers are marked as such. Body
    axes forward-right-down.
    """

    name: str
    """Short name."""
    title: str
    """Name as printed."""
    source: str
    """Where the numbers come from."""
    origin: str
    """The point of the vehicle that arms and centres count from."""
    notes: str | None = None
    """What a reader of the report should know."""
    licence: str | None = None
    """Under which terms the numbers may be passed on, where they are another's."""
    guessed: str | None = None
    """Why a campaign was given this vehicle where no log names one; whoever has made the
    file that of the vehicle deletes the line.
    """
    environment: EnvironmentEntry
    """Water and gravity."""
    rigid_body: RigidBodyEntry
    """Mass, buoyancy and inertia."""
    added_mass: AddedMassEntry
    """Upper triangle of M_A = [X_udot ...] <= 0; what is not given is 0."""
    actuators: ActuatorsEntry = ActuatorsEntry()
    """Propeller, fins, thrusters; none for a vehicle that glides or is towed."""
    sensors: SensorsEntry = SensorsEntry()
    """Where the sensors sit; what is not given is at the origin, aligned, without lag.
    """
    geometry: GeometryEntry | None = None
    """Shape of hull, fins and wings, for strip theory; x from the body origin, heights
    from the hull's axis.
    """
    buoyancy_engine: BuoyancyEngineEntry | None = None
    """Takes water in and out, and moves the centre of gravity along x."""
    glider: GliderEntry | None = None
    """What a glide is fitted with: reference area, lift and hull of a glider."""
    propulsion: PropulsionEntry | None = None
    """What a propeller known by its thrust alone does besides."""
    spreads: SpreadsEntry = SpreadsEntry()
    """Standard deviations of figures that nobody measured on this vehicle."""
    published: dict[str, Quantity] = Field(default_factory=dict)
    """Hydrodynamic coefficients as the source prints them, by name: Y_vdot, Y_v|v|."""
    as_simulated: dict[str, Quantity] = Field(default_factory=dict)
    """Coefficients that the source's own simulations need, in place of the published
    ones.
    """


class InertiaDocument(Model):
    """Measured moments of inertia of a vehicle about its centre of gravity.

    A vehicle file can name it.
    """

    vehicle: str
    """Vehicle that was swung."""
    source: str
    """How it was measured."""
    I_x: KilogramSquareMetres | None = None
    """About the body x axis."""
    I_y: KilogramSquareMetres | None = None
    """About the body y axis."""
    I_z: KilogramSquareMetres | None = None
    """About the body z axis."""
