"""The document of measured moments of inertia, as pipendulum writes it."""

from __future__ import annotations

from typing import Annotated

from auvid.data_schemas.documents.model import Model, Quantity, Unit

Moment = Annotated[Quantity, Unit("kg*m^2")]


class InertiaDocument(Model):
    """Measured moments of inertia of a vehicle about its centre of gravity; a vehicle
    file can name it.
    """

    vehicle: str
    """Vehicle that was swung."""
    source: str
    """How it was measured."""
    I_x: Moment | None = None
    """About the body x axis."""
    I_y: Moment | None = None
    """About the body y axis."""
    I_z: Moment | None = None
    """About the body z axis."""
