"""A vehicle as a value: inertia, buoyancy, added mass, actuators and sensors, read from
a vehicle document (schema `vehicle`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import AXES, VELOCITIES, Array, read_only
from auvid.hydro.dynamics.actuators.fins import Fins
from auvid.hydro.dynamics.actuators.propeller import Propeller
from auvid.hydro.dynamics.actuators.thrusters import (
    FULL_COMMAND,
    NEUTRAL_US,
    ThrustCurve,
    Thrusters,
    polynomial_thrust,
    thruster_allocation,
)
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.mechanics.rigid_body import rigid_body_matrix
from auvid.hydro.dynamics.quantities import Quantities
from auvid.hydro.dynamics.vehicle.geometry import geometry_from_document
from auvid.hydro.dynamics.vehicle.lift import fins_from_geometry

ACCELEROMETER_MEANINGS = ("specific_force", "inertial", "derivative")
UNIT_LENGTH_TOLERANCE = 1e-3


@dataclass(frozen=True)
class MountedSensor:
    """Where a sensor sits: `arm_m` (3,) from the body origin, `rotation` (3, 3) sensor
    axes -> body axes, and how late it reports.
    """

    arm_m: Array
    rotation: Array
    lag_s: float


@dataclass(frozen=True)
class Vehicle:
    """A rigid vehicle in water, all in SI, body FRD. `added_mass` follows McCarter: M_A
    = [X_udot ...] <= 0.

    `accelerometer`: what the vehicle's accelerometer measures, where the log does not
    say: `specific_force` (gravity inside), `inertial` (gravity removed), `derivative`
    (rate of change of body velocity). `assumed` names every assumed number, for the
    report.
    """

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
    assumed: tuple[str, ...] = ()

    @property
    def weight(self) -> float:
        """W = m g [N]."""
        return self.mass_kg * self.gravity

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

    @property
    def has_propeller_speed(self) -> bool:
        """Whether the propulsion ratio u_c(n)/U, and so the terms with eta, exist."""
        return self.propeller is not None


def vehicle_from_document(document: Mapping[str, Any]) -> Vehicle:
    """The vehicle of a document that agrees with schema `vehicle`.

    Raises `CampaignError` when a number is missing, has a wrong unit or shape, when M =
    M_RB - M_A is not positive definite, when an added mass on the diagonal is positive,
    a mass is not, or when the vehicle has no actuator.
    """
    read = Quantities(document)
    body, sensors, actuators = read.part("rigid_body"), read.part("sensors"), read.part("actuators")
    environment = read.part("environment")
    depth = sensors.part("depth")
    instance = depth.plain("barometer_instance")
    vehicle = Vehicle(
        name=str(document.get("name", "")),
        title=str(document.get("title", document.get("name", ""))),
        mass_kg=body.number("mass", "kg"),
        displaced_mass_kg=body.number("displaced_mass", "kg"),
        r_G=body.array("centre_of_gravity", "m", shape=(3,)),
        r_B=body.array("centre_of_buoyancy", "m", shape=(3,)),
        inertia=body.array("inertia", "kg*m^2", shape=(3, 3)),
        added_mass=_added_mass(read.part("added_mass")),
        water_density=environment.number("water_density", "kg/m^3"),
        gravity=environment.number("gravity", "m/s^2"),
        propeller=_propeller(actuators.part("propeller")) if "propeller" in actuators else None,
        fins=_fins(actuators.part("fins"), document) if "fins" in actuators else None,
        thrusters=_thrusters(actuators.part("thrusters")) if "thrusters" in actuators else None,
        dvl=_mounted(sensors.part("dvl")),
        imu=_mounted(sensors.part("imu")),
        depth_sensor=_mounted(depth),
        accelerometer=_accelerometer(sensors.part("imu")),
        barometer_instance=None if instance is None else int(instance),
    )
    _check(vehicle)
    return replace(vehicle, assumed=tuple(read.assumed))


def _check(vehicle: Vehicle) -> None:
    if vehicle.mass_kg <= 0.0 or vehicle.displaced_mass_kg <= 0.0:
        raise CampaignError(
            "a mass must be positive",
            field="rigid_body",
            value=(vehicle.mass_kg, vehicle.displaced_mass_kg),
        )
    if not np.allclose(vehicle.inertia, vehicle.inertia.T):
        raise CampaignError(
            "the inertia matrix is not symmetric",
            field="rigid_body.inertia.value",
            value=vehicle.inertia.tolist(),
        )
    positive = [f"{AXES[i]}_{VELOCITIES[i]}dot" for i in range(6) if vehicle.added_mass[i, i] > 0.0]
    if positive:
        raise CampaignError(
            "an added mass is positive",
            field=f"added_mass.{positive[0]}.value",
            value=", ".join(positive),
            remedy=(
                "These are McCarter's derivatives, X_udot <= 0; turn the sign of figures given as"
                " positive masses."
            ),
        )
    rigid = float(np.linalg.eigvalsh(vehicle.rigid_body_mass)[0])
    if rigid <= 0.0:
        raise CampaignError(
            "the inertia of the rigid body is not positive definite: no mass distribution has it",
            field="rigid_body.inertia.value",
            value=f"smallest eigenvalue of M_RB {rigid:.4g}",
            remedy=(
                "Check units, and that the inertia is about the body origin, not about the centre"
                " of gravity."
            ),
        )
    smallest = float(np.linalg.eigvalsh(vehicle.mass_matrix)[0])
    if smallest <= 0.0:
        raise CampaignError(
            "the mass matrix M = M_RB - M_A is not positive definite",
            field="rigid_body, added_mass",
            value=f"smallest eigenvalue {smallest:.4g}",
            remedy=(
                "Check units and signs; the off-diagonals of the inertia matrix are minus the"
                " products of inertia."
            ),
        )
    if vehicle.propeller is None and vehicle.fins is None and vehicle.thrusters is None:
        raise CampaignError(
            "the vehicle has no actuator",
            field="actuators",
            remedy="Give a propeller, fins or thrusters.",
        )


def _added_mass(read: Quantities) -> Array:
    """M_A from its upper triangle; a derivative that is not given is 0, the diagonal
    must be given.
    """
    matrix = np.zeros((6, 6))
    for i in range(6):
        for j in range(i, 6):
            unit = ("kg", "kg*m", "kg*m^2")[(i > 2) + (j > 2)]
            entry = read.number(
                f"{AXES[i]}_{VELOCITIES[j]}dot", unit, default=None if i == j else 0.0
            )
            matrix[i, j] = matrix[j, i] = entry
    return read_only(matrix)


def _propeller(read: Quantities) -> Propeller:
    table = read.part("level_speed")
    rev_s = table.array("propeller_speed", "1/s", shape=(-1,))
    speed = table.array("speed", "m/s", shape=(-1,))
    _ascending(table, "propeller_speed", rev_s, same_length=speed)
    return Propeller(
        diameter_m=read.number("diameter", "m"),
        wake_fraction=read.number("wake_fraction", "1"),
        thrust=read.array("thrust_coefficient", "1", shape=(3,)),
        torque=read.array("torque_coefficient", "1", shape=(3,)),
        level_speed_rev_s=rev_s,
        level_speed_m_s=speed,
    )


def _fins(read: Quantities, document: Mapping[str, Any]) -> Fins:
    if read.plain("from_geometry", False):
        density = Quantities(document).part("environment").number("water_density", "kg/m^3")
        return fins_from_geometry(geometry_from_document(document), water_density=density)
    return Fins(
        length_m=read.number("reference_length", "m"),
        linear=read.array("linear", "1", shape=(6, 4)),
        quadratic=read.array("quadratic", "1", shape=(6, 4)),
    )


def _thrusters(read: Quantities) -> Thrusters:
    allocation = _allocation(read)
    n = allocation.shape[1]
    direction = read.array("direction", "1", shape=(n,))
    if np.any(np.abs(direction) != 1.0):
        raise CampaignError(
            "a thruster direction is neither 1 nor -1",
            field=read.where("direction"),
            value=direction.tolist(),
        )
    outputs = read.plain("outputs", list(range(1, n + 1)))
    if len(outputs) != n or len(set(outputs)) != n:
        raise CampaignError(
            "one output channel for each thruster is needed",
            field=read.where("outputs"),
            value=outputs,
        )
    return Thrusters(
        allocation=allocation,
        direction=direction,
        outputs=tuple(int(channel) for channel in outputs),
        curve=_thrust_curve(read.part("thrust_curve")),
    )


def _allocation(read: Quantities) -> Array:
    """Force and moment of 1 N of each thruster (6, n): from positions and axes, or as
    given where the geometry is not known.
    """
    if "effect" in read:
        if "position" in read or "axis" in read:
            raise CampaignError(
                "either effect, or position and axis, describe the thrusters",
                field=read.where("effect"),
            )
        return read_only(read.array("effect", "1", shape=(-1, 6)).T)
    position = read.array("position", "m", shape=(-1, 3))
    axis = read.array("axis", "1", shape=(len(position), 3))
    length = np.linalg.norm(axis, axis=1)
    if np.any(np.abs(length - 1.0) > UNIT_LENGTH_TOLERANCE):
        raise CampaignError(
            "a thruster axis is not of unit length", field=read.where("axis"), value=length.tolist()
        )
    return read_only(thruster_allocation(position, axis / length[:, None]))


def _thrust_curve(read: Quantities) -> ThrustCurve:
    pwm = read.array("pulse_width", "us", shape=(-1,))
    if "polynomial" in read:
        if "force" in read or len(pwm) != 2 or not pwm[0] < NEUTRAL_US < pwm[1]:
            limits = (
                "no table of forces, and the pulses of the commands -100 and 100, on both sides of"
                f" {NEUTRAL_US:g} us"
            )
            raise CampaignError(
                "a thrust polynomial has other pulses",
                field=read.where("pulse_width"),
                value=pwm.tolist(),
                allowed=limits,
            )
        polynomial = read.array("polynomial", "N", shape=(-1,))
        force = polynomial_thrust([-FULL_COMMAND, FULL_COMMAND], polynomial)
    else:
        polynomial, force = None, read.array("force", "N", shape=(-1,))
    _ascending(read, "pulse_width", pwm, same_length=force)
    return ThrustCurve(
        pwm, force, read.number("voltage", "V"), read.number("voltage_exponent", "1"), polynomial
    )


def _ascending(read: Quantities, key: str, values: Array, *, same_length: Array) -> None:
    if len(values) < 2 or len(values) != len(same_length) or np.any(np.diff(values) <= 0.0):
        raise CampaignError(
            "a table needs two or more ascending points with one value each",
            field=read.where(key),
            value=values.tolist(),
        )


def _mounted(read: Quantities) -> MountedSensor:
    return MountedSensor(
        arm_m=read.array("arm", "m", shape=(3,), default=np.zeros(3)),
        rotation=read_only(
            rotation_body_to_ned(read.array("mounting", "rad", shape=(3,), default=np.zeros(3)))
        ),
        lag_s=read.number("lag", "s", default=0.0),
    )


def _accelerometer(read: Quantities) -> str:
    meaning = str(read.plain("accelerometer", "specific_force"))
    if meaning not in ACCELEROMETER_MEANINGS:
        raise CampaignError(
            "unknown accelerometer convention",
            field=read.where("accelerometer"),
            value=meaning,
            allowed=ACCELEROMETER_MEANINGS,
        )
    return meaning
