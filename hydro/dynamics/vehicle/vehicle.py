"""A vehicle as a value: inertia, buoyancy, added mass, actuators and sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.hydro.arrays import Array, read_only
from auvid.hydro.dynamics.actuators.buoyancy_engine import BuoyancyEngine
from auvid.hydro.dynamics.actuators.commands import FullCommands
from auvid.hydro.dynamics.actuators.fins import Fins
from auvid.hydro.dynamics.actuators.propeller import Propeller
from auvid.hydro.dynamics.actuators.thrusters import Thrusters
from auvid.hydro.dynamics.mechanics.rigid_body import rigid_body_matrix
from auvid.hydro.dynamics.vehicle.geometry import Geometry
from auvid.hydro.dynamics.viscous.coefficients import Coefficient


@dataclass(frozen=True)
class MountedSensor:
    """Position, rotation and delay of a sensor.

    `arm_m` (3,) from the body origin, `rotation` (3, 3) sensor axes -> body axes, and
    how late it reports.
    """

    arm_m: Array
    rotation: Array
    lag_s: float


@dataclass(frozen=True)
class Vehicle:
    """A rigid vehicle in water, all in SI, body FRD.

    `added_mass` follows McCarter: M_A = [X_udot ...] <= 0.

    `accelerometer`: what the vehicle's accelerometer measures, where the log does not
    say: `specific_force` (gravity inside), `inertial` (gravity removed), `derivative`
    (rate of change of body velocity). `assumed` names every assumed number that shapes
    the motion. `published` and `as_simulated` are coefficients by name, those of the
    source and those that its own simulations need in their place. `spreads`:
    standard deviations of assumed figures in SI, by their key. `thrusters` have a thrust
    in newtons; those without one are in `commands`. `actuator_lag_s`: of all actuators,
    None where the file states none. `document` is what all this was read from, for what
    is printed of it.
    """

    document: VehicleDocument
    name: str
    title: str
    mass_kg: float
    displaced_mass_kg: float
    r_G: Array
    r_B: Array
    inertia: Array
    added_mass: Array
    water_density: float
    gravity: float
    propeller: Propeller | None
    fins: Fins | None
    thrusters: Thrusters | None
    dvl: MountedSensor
    imu: MountedSensor
    depth_sensor: MountedSensor
    accelerometer: str
    barometer_instance: int | None
    geometry: Geometry | None = None
    buoyancy_engine: BuoyancyEngine | None = None
    propeller_roll_moment_Nm: float | None = None
    published: Mapping[str, Coefficient] = field(default_factory=dict)
    as_simulated: Mapping[str, Coefficient] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    spreads: Mapping[str, float] = field(default_factory=dict)
    markers: MountedSensor | None = None
    commands: FullCommands = field(default_factory=FullCommands)
    actuator_lag_s: float | None = None

    @property
    def is_driven(self) -> bool:
        """Return whether thrusters, a propeller, fins or commands drive it."""
        parts = (self.thrusters, self.propeller, self.fins, self.commands.thrusters)
        return any(part is not None for part in parts) or bool(
            self.commands.axes or self.commands.frame or self.buoyancy_engine is not None
        )

    @property
    def weight(self) -> float:
        """W = m g [N]."""
        return self.mass_kg * self.gravity

    @property
    def sensor_lags_s(self) -> dict[str, float]:
        """How late the samples of each stream are [s], of those that have a lag."""
        return {
            "imu": self.imu.lag_s,
            "attitude": self.imu.lag_s,
            "depth": self.depth_sensor.lag_s,
            "velocity": self.dvl.lag_s,
            "water_velocity": self.dvl.lag_s,
        }

    @property
    def buoyancy(self) -> float:
        """B [N]: the weight of the displaced water."""
        return self.displaced_mass_kg * self.gravity

    @cached_property
    def rigid_body_mass(self) -> Array:
        """M_RB (6, 6), McCarter (2.20)."""
        return read_only(rigid_body_matrix(self.mass_kg, self.r_G, self.inertia))

    @cached_property
    def mass_matrix(self) -> Array:
        """M = M_RB - M_A (6, 6), McCarter (2.62)."""
        return read_only(self.rigid_body_mass - self.added_mass)

    @cached_property
    def mass_matrix_inverse(self) -> Array:
        """M^-1 (6, 6)."""
        return read_only(np.linalg.inv(self.mass_matrix))
