"""Moments of inertia from a pendulum in the place of those of a vehicle document."""

from __future__ import annotations

from auvid.data_schemas.documents.model import Quantity, Unit
from auvid.data_schemas.documents.vehicle.vehicle import InertiaDocument, VehicleDocument

INERTIAS = ("I_x", "I_y", "I_z")


def with_measured_inertia(vehicle: VehicleDocument, measured: InertiaDocument) -> VehicleDocument:
    """Return the vehicle document with the moments that were measured, in kg m^2.

    Measured is about the centre of gravity, the vehicle's matrix is about the body
    origin (Steiner): I_0,ii = I_G,ii + m (|r_G|^2 - r_G,i^2). Products of inertia, and
    axes that were not swung, stay.
    """
    body = vehicle.rigid_body
    arm, matrix, old = body.centre_of_gravity.array, body.inertia.array.copy(), body.inertia
    moments = {name: getattr(measured, name) for name in INERTIAS}
    for i, moment in enumerate(moments.values()):
        if moment is not None:
            matrix[i, i] = moment.si + body.mass.si * float(arm @ arm - arm[i] ** 2)
    names = [name for name, moment in moments.items() if moment is not None]
    source = f"{', '.join(names)}: {measured.source}"
    if len(names) < len(INERTIAS):
        source += f"; the rest: {old.source}"
    inertia = Quantity(
        value=matrix.tolist(),
        unit="kg*m^2",
        source=source,
        assumed=old.assumed and len(names) < len(INERTIAS),
        note=old.note,
    )
    changed = {"inertia": Unit("kg*m^2", (3, 3)).read(inertia)}
    return vehicle.model_copy(update={"rigid_body": body.model_copy(update=changed)})
