"""Parts of the vehicle document: where the sensors sit."""

from __future__ import annotations

from typing import Annotated, Literal

from auvid.data_schemas.documents.model import Model, Range
from auvid.data_schemas.documents.quantities import Seconds
from auvid.data_schemas.documents.vehicle.quantities import Angles, Vector


class MountedEntry(Model):
    """Where a sensor sits."""

    arm: Vector | None = None
    """Position from the origin."""
    mounting: Angles | None = None
    """Roll, pitch, yaw that turn the body axes into the sensor's."""
    lag: Seconds | None = None
    """How late a measurement is reported."""


class ImuEntry(MountedEntry):
    """Gyro and accelerometer."""

    accelerometer: Literal["specific_force", "inertial", "derivative"] | None = None
    """What the accelerometer measures where the log does not say: gravity inside,
    gravity removed, rate of change of body velocity.
    """


class DepthSensorEntry(MountedEntry):
    """Pressure sensor; its mounting is of no effect."""

    barometer_instance: Annotated[int, Range(0, 15)] | None = None
    """Instance of the barometer in the water."""


class SensorsEntry(Model):
    """Places of the sensors; default: at the origin, aligned, without lag."""

    dvl: MountedEntry = MountedEntry()
    """Velocity sensor."""
    imu: ImuEntry = ImuEntry()
    """Gyro and accelerometer."""
    depth: DepthSensorEntry = DepthSensorEntry()
    """Pressure sensor."""
    pose: MountedEntry | None = None
    """Markers of a motion capture or tracking system."""
