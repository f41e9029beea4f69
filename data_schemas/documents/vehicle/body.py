"""Parts of the vehicle document: water, mass, inertia, added mass and spreads."""

from __future__ import annotations

from typing import Annotated

from auvid.data_schemas.documents.model import Model, Quantity, Unit
from auvid.data_schemas.documents.quantities import Kilograms, PositiveKilograms, PositiveMetres
from auvid.data_schemas.documents.vehicle.quantities import (
    KilogramMetres,
    KilogramSquareMetres,
    Vector,
)

Share = Annotated[Quantity, Unit("1", positive=True)]


class EnvironmentEntry(Model):
    """Water and gravity."""

    water_density: Annotated[Quantity, Unit("kg/m^3")]
    """Density of the water."""
    gravity: Annotated[Quantity, Unit("m/s^2")]
    """Acceleration of gravity."""


class RigidBodyEntry(Model):
    """Mass, buoyancy and inertia."""

    mass: PositiveKilograms
    """Mass of the vehicle with the water it encloses."""
    displaced_mass: PositiveKilograms
    """Mass of the displaced water; buoyancy is this times gravity."""
    centre_of_gravity: Vector
    """r_G, three components."""
    centre_of_buoyancy: Vector
    """r_B, three components."""
    measured_inertia: str | None = None
    """Path, from this file, of a document of measured moments (schema inertia, as
    pipendulum gives it); they replace those axes of `inertia`.
    """
    inertia: Annotated[Quantity, Unit("kg*m^2", (3, 3))]
    """I_0 about the body origin, 3 by 3; off-diagonals are minus the products of
    inertia.
    """


class AddedMassEntry(Model):
    """Upper triangle of M_A = [X_udot ...] <= 0; what is not given is 0."""

    X_udot: Kilograms
    """Surge."""
    X_vdot: Kilograms | None = None
    """Surge force of sway acceleration."""
    X_wdot: Kilograms | None = None
    """Surge force of heave acceleration."""
    X_pdot: KilogramMetres | None = None
    """Surge force of roll acceleration."""
    X_qdot: KilogramMetres | None = None
    """Surge force of pitch acceleration."""
    X_rdot: KilogramMetres | None = None
    """Surge force of yaw acceleration."""
    Y_vdot: Kilograms
    """Sway."""
    Y_wdot: Kilograms | None = None
    """Sway force of heave acceleration."""
    Y_pdot: KilogramMetres | None = None
    """Sway force of roll acceleration."""
    Y_qdot: KilogramMetres | None = None
    """Sway force of pitch acceleration."""
    Y_rdot: KilogramMetres | None = None
    """Sway force of yaw acceleration."""
    Z_wdot: Kilograms
    """Heave."""
    Z_pdot: KilogramMetres | None = None
    """Heave force of roll acceleration."""
    Z_qdot: KilogramMetres | None = None
    """Heave force of pitch acceleration."""
    Z_rdot: KilogramMetres | None = None
    """Heave force of yaw acceleration."""
    K_pdot: KilogramSquareMetres
    """Roll."""
    K_qdot: KilogramSquareMetres | None = None
    """Roll moment of pitch acceleration."""
    K_rdot: KilogramSquareMetres | None = None
    """Roll moment of yaw acceleration."""
    M_qdot: KilogramSquareMetres
    """Pitch."""
    M_rdot: KilogramSquareMetres | None = None
    """Pitch moment of yaw acceleration."""
    N_rdot: KilogramSquareMetres
    """Yaw."""


class SpreadsEntry(Model):
    """Standard deviations of figures that nobody measured on this vehicle.

    Identified coefficients move with them, however long the dive; what is not given
    counts as exact. Shares are of the figure's own value.
    """

    thrust: Share | None = None
    """Scale of the thrust of propeller and thrusters, as a share."""
    thrust_lag: Annotated[Quantity, Unit("s", positive=True)] | None = None
    """How late the thrust follows the command."""
    mass: PositiveKilograms | None = None
    """Mass; weight and buoyancy are trimmed and stay."""
    inertia: Share | None = None
    """Each moment of inertia, as a share."""
    added_mass: Share | None = None
    """Each of the six added masses X_udot to N_rdot, as a share."""
    velocity_arm: PositiveMetres | None = None
    """Each component of the arm of the velocity sensor."""
