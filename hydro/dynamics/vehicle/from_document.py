"""The vehicle that a vehicle document describes, and what it must fulfil as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from auvid.data_schemas.documents.model import Faults, Quantity, Unit, assumed_quantities, parse
from auvid.data_schemas.documents.vehicle.actuators import (
    CommandsEntry,
    PropellerEntry,
    ThrustersEntry,
)
from auvid.data_schemas.documents.vehicle.body import AddedMassEntry
from auvid.data_schemas.documents.vehicle.sensors import MountedEntry
from auvid.data_schemas.documents.vehicle.shape import (
    BuoyancyEngineEntry,
    GeometryEntry,
    HullEntry,
    SurfaceEntry,
)
from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.errors import CampaignError, PipelineError, raise_faults
from auvid.hydro.arrays import AXES, VELOCITIES, Array, read_only
from auvid.hydro.dynamics.actuators.buoyancy_engine import BuoyancyEngine
from auvid.hydro.dynamics.actuators.commands import (
    ARDUSUB_FRAMES,
    COMMANDS,
    UNIT_THRUST,
    FullCommands,
    axis_of,
    unscaled,
)
from auvid.hydro.dynamics.actuators.fins import Fins
from auvid.hydro.dynamics.actuators.propeller import Propeller
from auvid.hydro.dynamics.actuators.thrusters import (
    FULL_COMMAND,
    ThrustCurve,
    Thrusters,
    polynomial_thrust,
    thruster_allocation,
)
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.geometry import (
    NODES,
    Cylinder,
    Geometry,
    Hull,
    Myring,
    Profile,
    Stations,
    Surface,
)
from auvid.hydro.dynamics.vehicle.lift import fins_from_geometry
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor, Vehicle
from auvid.hydro.dynamics.viscous.coefficients import Coefficient, term_of, unit_of

READ_PARTS = ("rigid_body", "added_mass", "environment", "actuators", "sensors")
"""Parts of the document whose assumed numbers shape the vehicle's motion."""


def vehicle_from_document(document: VehicleDocument | Mapping[str, Any]) -> Vehicle:
    """Return the vehicle of a document, all numbers in SI.

    Raises `PipelineError`, all faults together: faults of the document itself, an
    inertia or a mass matrix M = M_RB - M_A that no body has, an added mass on the
    diagonal that is positive, surfaces that do not fit the hull, and published
    coefficients that are none.
    """
    if not isinstance(document, VehicleDocument):
        document = parse(VehicleDocument, document)
    body, sensors, actuators = document.rigid_body, document.sensors, document.actuators
    geometry = None if document.geometry is None else geometry_from_entry(document.geometry)
    density = document.environment.water_density.si
    thrusters = actuators.thrusters
    layout = None if thrusters is None else _thrusters(thrusters)
    fins, engine, propulsion = actuators.fins, document.buoyancy_engine, document.propulsion
    vehicle = Vehicle(
        document=document,
        name=document.name,
        title=document.title,
        mass_kg=body.mass.si,
        displaced_mass_kg=body.displaced_mass.si,
        r_G=body.centre_of_gravity.array,
        r_B=body.centre_of_buoyancy.array,
        inertia=body.inertia.array,
        added_mass=_added_mass(document.added_mass),
        water_density=density,
        gravity=document.environment.gravity.si,
        propeller=None if actuators.propeller is None else _propeller(actuators.propeller),
        fins=(
            None
            if fins is None
            else fins_from_geometry(geometry, water_density=density)
            if fins.from_geometry
            else Fins(_si(fins.reference_length), _array(fins.linear), _array(fins.quadratic))
        ),
        thrusters=None if thrusters is None or thrusters.thrust_curve is None else layout,
        dvl=_mounted(sensors.dvl),
        imu=_mounted(sensors.imu),
        depth_sensor=_mounted(sensors.depth),
        markers=None if sensors.pose is None else _mounted(sensors.pose),
        accelerometer=sensors.imu.accelerometer or "specific_force",
        barometer_instance=sensors.depth.barometer_instance,
        geometry=geometry,
        buoyancy_engine=None if engine is None else _engine(engine),
        propeller_roll_moment_Nm=None if propulsion is None else propulsion.roll_moment.si,
        published=_coefficients(document.published, "published"),
        as_simulated=_coefficients(document.as_simulated, "as_simulated"),
        assumed=tuple(
            f"{'.'.join(place)} = {item.value} {item.unit} ({item.source.strip()})"
            for part in READ_PARTS
            for place, item in assumed_quantities(getattr(document, part), (part,))
        ),
        spreads={
            name: quantity.si
            for name in type(document.spreads).model_fields
            if (quantity := getattr(document.spreads, name)) is not None
        },
        commands=_commands(actuators.commands, layout),
        actuator_lag_s=None if actuators.lag is None else actuators.lag.si,
    )
    raise_faults([*_faults(vehicle)])
    return vehicle


def _si(quantity: Quantity | None, default: float = 0.0) -> float:
    return default if quantity is None else quantity.si


def _array(quantity: Quantity | None) -> Array:
    return np.zeros(3) if quantity is None else quantity.array


def _faults(vehicle: Vehicle) -> Iterator[PipelineError]:
    if not np.allclose(vehicle.inertia, vehicle.inertia.T):
        yield CampaignError(
            "the inertia matrix is not symmetric",
            field="rigid_body.inertia.value",
            value=vehicle.inertia.tolist(),
        )
    positive = [f"{AXES[i]}_{VELOCITIES[i]}dot" for i in range(6) if vehicle.added_mass[i, i] > 0.0]
    if positive:
        yield CampaignError(
            "an added mass is positive",
            field=f"added_mass.{positive[0]}.value",
            value=", ".join(positive),
            remedy=(
                "These are McCarter's derivatives, X_udot <= 0; turn the sign of figures given as"
                " positive masses."
            ),
        )
    rigid = float(np.linalg.eigvalsh(vehicle.rigid_body_mass)[0])
    smallest = float(np.linalg.eigvalsh(vehicle.mass_matrix)[0])
    if rigid <= 0.0:
        yield CampaignError(
            "the inertia of the rigid body is not positive definite: no mass distribution has it",
            field="rigid_body.inertia.value",
            value=f"smallest eigenvalue of M_RB {rigid:.4g}",
            remedy=(
                "Check units, that the inertia is about the body origin, not about the centre of"
                " gravity, and that the centre of gravity counts from that origin, too."
            ),
        )
    elif smallest <= 0.0:
        yield CampaignError(
            "the mass matrix M = M_RB - M_A is not positive definite",
            field="rigid_body, added_mass",
            value=f"smallest eigenvalue {smallest:.4g}",
            remedy=(
                "Check units and signs; the off-diagonals of the inertia matrix are minus the"
                " products of inertia."
            ),
        )


def _added_mass(entry: AddedMassEntry) -> Array:
    """Return M_A (6, 6) from its upper triangle; what is not given is 0."""
    matrix = np.zeros((6, 6))
    for i in range(6):
        for j in range(i, 6):
            matrix[i, j] = matrix[j, i] = _si(getattr(entry, f"{AXES[i]}_{VELOCITIES[j]}dot"))
    return read_only(matrix)


def _propeller(entry: PropellerEntry) -> Propeller:
    return Propeller(
        diameter_m=entry.diameter.si,
        wake_fraction=entry.wake_fraction.si,
        thrust=entry.thrust_coefficient.array,
        torque=entry.torque_coefficient.array,
        level_speed_rev_s=entry.level_speed.propeller_speed.array,
        level_speed_m_s=entry.level_speed.speed.array,
    )


def _thrusters(entry: ThrustersEntry) -> Thrusters:
    """Return the thrusters, as force and moment of 1 N of each.

    These come from positions and axes, or as given where the geometry is not known.
    """
    if entry.effect is not None:
        allocation = entry.effect.array.T
    else:
        axis = _array(entry.axis)
        axis = axis / np.linalg.norm(axis, axis=1)[:, None]
        allocation = thruster_allocation(_array(entry.position), axis)
    curve = entry.thrust_curve
    outputs = tuple(entry.outputs or range(1, allocation.shape[1] + 1))
    if curve is None:
        return Thrusters(read_only(allocation), entry.direction.array, outputs, UNIT_THRUST)
    if curve.polynomial is None:
        polynomial, force = None, _array(curve.force)
    else:
        polynomial = curve.polynomial.array
        force = polynomial_thrust([-FULL_COMMAND, FULL_COMMAND], polynomial)
    return Thrusters(
        allocation=read_only(allocation),
        direction=entry.direction.array,
        outputs=outputs,
        curve=ThrustCurve(
            curve.pulse_width.array,
            force,
            curve.voltage.si,
            curve.voltage_exponent.si,
            polynomial,
        ),
    )


def _commands(entry: CommandsEntry, layout: Thrusters | None) -> FullCommands:
    """Return what is known in full commands, with the layout of the thrusters."""
    motors = len(ARDUSUB_FRAMES[entry.frame]) if entry.frame else 0
    if entry.direction is not None and len(entry.direction) != motors:
        raise CampaignError(
            "one direction for each motor of the frame is needed",
            field="actuators.commands.direction",
            value=entry.direction,
            allowed=f"{motors} of 1 and -1 for frame {entry.frame}" if motors else "with a frame",
        )
    return FullCommands(
        axes=tuple(axis_of(name) for name in entry.axes or ()),
        frame=entry.frame,
        direction=tuple(entry.direction or ()),
        full_force={
            axis_of(name): force.si
            for name in COMMANDS
            if (force := getattr(entry.full_force, name)) is not None
        },
        thrusters=None if layout is None else unscaled(layout),
    )


def _mounted(entry: MountedEntry) -> MountedSensor:
    return MountedSensor(
        arm_m=read_only(_array(entry.arm)),
        rotation=read_only(rotation_body_to_ned(_array(entry.mounting))),
        lag_s=_si(entry.lag),
    )


def _engine(entry: BuoyancyEngineEntry) -> BuoyancyEngine:
    return BuoyancyEngine(
        entry.mass_empty.si, entry.mass_neutral.si, entry.mass_full.si, entry.x_G_per_mass.si
    )


def _coefficients(entries: Mapping[str, Quantity], key: str) -> dict[str, Coefficient]:
    """Return the coefficients that a document lists under a key, by name."""
    coefficients: dict[str, Coefficient] = {}
    for name, entry in entries.items():
        term, unit = term_of(name), unit_of(name)
        kind = "added_mass" if term.endswith("dot") else "control" if "delta" in term else "drag"
        try:
            value = Unit(unit).read(entry).si
        except Faults as wrong:
            raise_faults([*wrong.under(f"{key}.{name}")])
        coefficients[name] = Coefficient(name, value, unit, kind, "", entry.source)
    return coefficients


def geometry_from_entry(entry: GeometryEntry) -> Geometry:
    """Return hull and surfaces; raise all surfaces that do not fit the hull."""
    hull = _hull(entry.hull)
    surfaces = {name: _surface(name, item) for name, item in entry.surfaces.items()}
    faults = [fault for item in surfaces.values() for fault in _misfits(item, hull)]
    raise_faults(faults)
    return Geometry(hull, tuple(surfaces.values()))


def _hull(entry: HullEntry) -> Hull:
    profile: Profile
    if entry.shape == "stations":
        profile = Stations(_array(entry.station_x), _array(entry.station_radius))
    else:
        length, diameter = _si(entry.length), _si(entry.diameter)
        nose = _si(entry.nose_x, 0.5 * length)
        profile = Cylinder(nose - length, nose, diameter)
        if entry.shape == "myring":
            profile = Myring(
                *(nose - length, nose, diameter),
                nose_m=_si(entry.nose_length),
                exponent=_si(entry.nose_exponent),
                tail_m=_si(entry.tail_length),
                angle_rad=_si(entry.tail_angle),
            )
    diameter = profile.diameter_m
    return Hull(
        radius_m=profile,
        tail_x_m=profile.knots_m[0],
        nose_x_m=profile.knots_m[-1],
        diameter_m=diameter,
        knots_m=profile.knots_m,
        frontal_area_m2=_si(entry.frontal_area, 0.25 * np.pi * diameter**2),
        cross_flow_drag=_si(entry.cross_flow_drag, 1.1),
    )


def _surface(name: str, entry: SurfaceEntry) -> Surface:
    rear, front = entry.x_rear.si, entry.x_front.si
    return Surface(
        name=name,
        layout=entry.layout,
        span_m=entry.span.si,
        area_m2=entry.area.si,
        tip_height_m=entry.tip_height.si,
        rear_x_m=rear,
        front_x_m=front,
        force_x_m=_si(entry.x_force, 0.5 * (rear + front)),
        taper=_si(entry.taper, 1.0),
        controlled=entry.controlled,
    )


def _misfits(surface: Surface, hull: Hull) -> Iterator[PipelineError]:
    """Yield where a surface does not fit the hull."""
    at = f"geometry.surfaces.{surface.name}"
    rear, front, tip = surface.rear_x_m, surface.front_x_m, surface.tip_height_m
    if rear < hull.tail_x_m or front > hull.nose_x_m:
        yield CampaignError(
            "the surface lies outside the hull",
            field=f"{at}.x_rear",
            value=(rear, front),
            allowed=f"{hull.tail_x_m:g} to {hull.nose_x_m:g} m",
            remedy="x counts from the body origin, positive forward.",
        )
        return
    below = float(hull.radius_m(np.linspace(rear, front, NODES)).max())
    if tip <= below:
        yield CampaignError(
            "the surface does not rise above the hull",
            field=f"{at}.tip_height",
            value=tip,
            allowed=f"more than {below:g} m, the radius of the hull there",
        )
    elif tip - surface.span_m > 0.5 * hull.diameter_m * (1.0 + 1e-6):
        needed = tip - 0.5 * hull.diameter_m
        yield CampaignError(
            "the surface does not touch the hull",
            field=f"{at}.span",
            value=surface.span_m,
            allowed=f"at least {needed:g} m, so that its root reaches the hull",
        )
