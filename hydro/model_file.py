"""A model file as arrays: inertia, forces, vehicle. Equations of McCarter 2014."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.documents.vehicle.actuators import ThrustersEntry
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.model_file import (
    DynamicsFigures,
    FinFigures,
    FramesEntry,
    ModelFile,
    PropellerFigures,
    ThrustCurveFigures,
    ThrusterFigures,
)
from auvid.data_schemas.records.models import InertiaCard
from auvid.data_schemas.records.partial import PartialFigures
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.actuators.propeller import Propeller
from auvid.hydro.dynamics.actuators.thrusters import Thrusters
from auvid.hydro.dynamics.mechanics.restoring import restoring_force
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import eta_ratio
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.constrained.equations import added_mass_change, added_mass_unknown
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.partial_model import figures_in_unit, in_unit_of_mass, with_inertia_shares


@dataclass(frozen=True)
class ModelForces:
    """M nu_dot + coriolis = viscous + restoring + tau, each (n, 6) [N, N m].

    In the unit of force of the file where its model is normalised; nan on axes that it lacks.
    """

    coriolis: Array
    viscous: Array
    restoring: Array


def inertia(model: ModelFile) -> Array:
    """Return M = M_RB - M_A (6, 6) (2.62), with the inertia that was fitted."""
    return np.array(model.dynamics.mass)


def forces(
    model: ModelFile, nu: ArrayLike, eta: ArrayLike, propeller_rev_s: ArrayLike | None = None
) -> ModelForces:
    """Return Coriolis, viscous and restoring force of a model file.

    C(nu) nu (2.23), tau_nu = K xi(nu) (3.12) with the constant force, and tau_G (2.44).

    nu (n, 6) [m/s, rad/s], eta (n, 6) [m, rad], propeller_rev_s (n,) for coefficients
    with the propulsion ratio. Raises `DataError` where these need it and it is None.
    """
    nu, dynamics = np.asarray(nu, dtype=np.float64), model.dynamics
    identified, constant = viscous_model(model)
    ratio = None
    if propeller_rev_s is not None and dynamics.propeller is not None:
        screw = dynamics.propeller
        level = np.interp(
            np.asarray(propeller_rev_s, dtype=np.float64),
            screw.level_speed_rev_s,
            screw.level_speed_m_s,
            left=np.nan,
            right=np.nan,
        )
        ratio = eta_ratio(level, nu, screw.minimum_speed_m_s)
    viscous = np.broadcast_to(constant, nu.shape)
    restoring = restoring_force(
        eta,
        weight=dynamics.weight_N,
        buoyancy=dynamics.buoyancy_N,
        r_G=dynamics.centre_of_gravity_m,
        r_B=dynamics.centre_of_buoyancy_m,
    )
    gap = np.array([0.0 if axis in axes_of(model) else np.nan for axis in AXES])
    return ModelForces(
        coriolis_acts(model) * coriolis_force(dynamics.mass, nu) + gap,
        (viscous + identified.force(nu, ratio) if identified.terms else viscous) + gap,
        restoring + gap,
    )


def axes_of(model: ModelFile) -> tuple[str, ...]:
    """Return the axes that a model has, X to N."""
    return AXES if model.partial is None else tuple(a for a in AXES if a in model.partial.axes)


def coriolis_acts(model: ModelFile) -> bool:
    """Return whether Coriolis force acts: not on axes that fly better one by one."""
    together = None if model.partial is None else model.partial.together
    return together is None or together.chosen


def unit_of_mass(model: ModelFile) -> str | None:
    """Return the axis whose apparent inertia is the unit of mass; None for kg."""
    return None if model.partial is None else model.partial.unit_of_mass


def viscous_model(model: ModelFile) -> tuple[IdentifiedModel, Array]:
    """Return the viscous terms and the constant force (6,) of a model file."""
    terms: dict[str, dict[str, float]] = {axis: {} for axis in AXES}
    constant = np.zeros(6)
    for item in model.coefficients:
        if item.term == CONSTANT:
            constant[AXES.index(item.axis)] = item.predictor
        else:
            terms[item.axis][item.term] = item.predictor
    return IdentifiedModel(model.name, terms), constant


def fitted_change(cards: Sequence[InertiaCard]) -> Array:
    """Return what fitted inertia adds to M_A (6, 6) of the vehicle file."""
    return added_mass_change({added_mass_unknown(item.name): item.change for item in cards})


def vehicle_of(model: ModelFile) -> Vehicle:
    """Return the vehicle of a model file, with the inertia that was fitted.

    In the unit of mass of the file. Raises `DataError` where `dynamics` is not what
    follows from it.
    """
    vehicle = with_fitted_shares(vehicle_from_document(model.vehicle), model.partial)
    change, screw = fitted_change(model.fitted_inertia), model.dynamics.propeller
    dynamics = dynamics_of(
        vehicle,
        change,
        lag_s=model.dynamics.actuator_lag_s,
        minimum_speed_m_s=0.0 if screw is None else screw.minimum_speed_m_s,
    )
    unit = unit_of_mass(model)
    dynamics = dynamics if unit is None else figures_in_unit(dynamics, unit)
    filed = model.dynamics.model_dump()
    for name, value in dynamics.model_dump().items():
        if not _same(value, filed[name]):
            raise DataError(
                "the dynamics of the model file do not follow from its vehicle and fitted inertia",
                field=f"dynamics.{name}",
                remedy="Change the vehicle file and run the campaign again.",
            )
    vehicle = replace(vehicle, added_mass=vehicle.added_mass + change)
    return vehicle if unit is None else in_unit_of_mass(vehicle, unit)


def with_fitted_shares(vehicle: Vehicle, partial: PartialFigures | None) -> Vehicle:
    """Return the vehicle with the ratios of inertia that a partial model has fitted."""
    shares = {} if partial is None else partial.inertia_shares
    return with_inertia_shares(vehicle, {axis: item.value for axis, item in shares.items()})


def frames(origin: str) -> FramesEntry:
    """Return axes, angles and signs, which are the same in every model file."""
    return FramesEntry(
        body="forward, starboard, down",
        world="north, east, down",
        origin=origin,
        velocity="nu = [u, v, w, p, q, r]",
        pose="eta = [x, y, z, phi, theta, psi]",
        force="tau = [X, Y, Z, K, M, N]",
        equation="mass nu_dot + C(nu) nu = tau_viscous + tau_restoring + tau_actuators",
    )


def dynamics_of(
    vehicle: Vehicle, added_mass_change: Array, *, lag_s: float, minimum_speed_m_s: float
) -> DynamicsFigures:
    """Return inertia, buoyancy and actuators of a vehicle as figures of a model file.

    added_mass_change (6, 6): what fitted inertia adds to M_A.
    """
    added = vehicle.added_mass + added_mass_change
    thrusters, screw, fins = vehicle.thrusters, vehicle.propeller, vehicle.fins
    return DynamicsFigures(
        mass_kg=vehicle.mass_kg,
        centre_of_gravity_m=vehicle.r_G.tolist(),
        inertia_kg_m2=vehicle.inertia.tolist(),
        rigid_body=_rows(vehicle.rigid_body_mass),
        added_mass=_rows(added),
        mass=_rows(vehicle.rigid_body_mass - added),
        weight_N=vehicle.weight,
        buoyancy_N=vehicle.buoyancy,
        centre_of_buoyancy_m=vehicle.r_B.tolist(),
        water_density_kg_m3=vehicle.water_density,
        gravity_m_s2=vehicle.gravity,
        thrusters=_thrusters(thrusters, vehicle.document.actuators.thrusters),
        thrust_curve=None if thrusters is None else _curve(thrusters),
        fins=None if fins is None else _fins(fins.coefficients(vehicle.water_density)),
        propeller=None if screw is None else _propeller(screw, vehicle, minimum_speed_m_s),
        actuator_lag_s=lag_s,
    )


def _thrusters(thrusters: Thrusters | None, entry: ThrustersEntry | None) -> list[ThrusterFigures]:
    if thrusters is None or entry is None:
        return []
    n = len(thrusters.outputs)
    positions = entry.position.array.tolist() if entry.position is not None else [None] * n
    return [
        ThrusterFigures.model_validate(
            {
                "output": output,
                "position_m": position,
                "axis": None if entry.axis is None else effect[:3],
                "effect": effect,
                "direction": int(direction),
            }
        )
        for output, position, effect, direction in zip(
            thrusters.outputs,
            positions,
            _rows(thrusters.allocation.T),
            thrusters.direction.tolist(),
            strict=True,
        )
    ]


def _curve(thrusters: Thrusters) -> ThrustCurveFigures:
    curve = thrusters.curve
    return ThrustCurveFigures(
        pulse_us=curve.pwm_us.tolist(),
        force_N=curve.force_N.tolist(),
        polynomial=None if curve.polynomial is None else curve.polynomial.tolist(),
        voltage_V=curve.voltage_v,
        voltage_exponent=curve.voltage_exponent,
    )


def _fins(table: Array) -> FinFigures:
    return FinFigures(linear=table[:, :4].tolist(), quadratic=table[:, 4:].tolist())


def _propeller(screw: Propeller, vehicle: Vehicle, minimum_speed_m_s: float) -> PropellerFigures:
    thrust, torque = screw.coefficients(vehicle.water_density).tolist()
    return PropellerFigures(
        inflow_per_u=screw.inflow_per_u,
        thrust=thrust,
        torque=torque,
        level_speed_rev_s=screw.level_speed_rev_s.tolist(),
        level_speed_m_s=screw.level_speed_m_s.tolist(),
        minimum_speed_m_s=minimum_speed_m_s,
    )


def _rows(matrix: Array) -> list[list[float]]:
    """Return the rows of a matrix; a zero has no sign."""
    rows: list[list[float]] = (matrix + 0.0).tolist()
    return rows


def _same(one: object, other: object) -> bool:
    """Return whether two figures agree to rounding."""
    if isinstance(one, dict) and isinstance(other, dict):
        return all(_same(value, other[key]) for key, value in one.items())
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)
    return one == other
