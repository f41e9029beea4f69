"""The hybrid vehicle of Al Makdah 2016, thrust or glide: (2.59)-(2.64), (3.1).

Its equations of motion build on the common ones.

State chi = [nu, eta] (12), input U = [X_thrust, delta_r, delta_s_right, delta_s_left]
in N and rad; the mass of the buoyancy engine and x_G are inputs too. Leading dimensions
are the batch; parameters may differ from member to member.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.hydro.arrays import Array, cross, matrix_product, read_only
from auvid.hydro.dynamics.actuators.buoyancy_engine import BuoyancyEngine
from auvid.hydro.dynamics.mechanics.kinematics import eta_dot, rotation_body_to_ned
from auvid.hydro.dynamics.mechanics.restoring import restoring_force
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force, rigid_body_matrix
from auvid.hydro.dynamics.simulation.plant_constants import (
    Members,
    Tables,
    coefficient_rows,
    member_rows,
    term_tables,
)
from auvid.hydro.dynamics.vehicle.strip_theory import strip_theory_of
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis
from auvid.hydro.dynamics.viscous.coefficients import (
    Coefficient,
    added_mass_matrix,
    control_matrix,
    viscous_terms,
)
from auvid.hydro.dynamics.viscous.models import Coefficients, IdentifiedModel

INPUTS = ("X_thrust", "delta_r", "delta_s_right", "delta_s_left")
PARAMETER_SETS = ("as_printed", "as_simulated", "corrected")
SETTLED_MASSES = 256
"""Rows of a mass that are kept: a flight asks for them at every step."""


@dataclass(frozen=True, eq=False)
class HybridVehicle:
    """Constants of the motion of a hybrid vehicle.

    `added_mass` (..., 6, 6) McCarter's sign; `viscous` (..., 6, n) for the basis terms
    `terms`; `fins` (..., 6, 3): force per u^2 and rad of delta_r, delta_s_right,
    delta_s_left. The leading dimensions, if any, are members.
    """

    vehicle: Vehicle
    engine: BuoyancyEngine
    parameter_set: str
    added_mass: Array
    terms: tuple[str, ...]
    viscous: Array
    fins: Array
    maximum_thrust_N: float
    propeller_roll_moment_Nm: float

    @cached_property
    def buoyancy(self) -> float:
        """B [N]."""
        return self.vehicle.buoyancy

    def r_G(self, x_G_m: ArrayLike) -> Array:
        """Centre of gravity (..., 3) [m] with the engine's x_G (...)."""
        x = np.asarray(x_G_m, dtype=np.float64)
        return np.stack(
            [x, np.full(x.shape, self.vehicle.r_G[1]), np.full(x.shape, self.vehicle.r_G[2])],
            axis=-1,
        )

    def rigid_body(self, mass_kg: ArrayLike, x_G_m: ArrayLike) -> Array:
        """Return M_RB (..., 6, 6) at this mass.

        The moments of inertia stay those of Table 2.5, as in the thesis.
        """
        return rigid_body_matrix(mass_kg, self.r_G(x_G_m), self.vehicle.inertia)

    def mass_matrix(self, mass_kg: ArrayLike, x_G_m: ArrayLike) -> Array:
        """M = M_RB - M_A (..., 6, 6) at this mass."""
        return np.asarray(self.rigid_body(mass_kg, x_G_m) - self.added_mass)

    def with_viscous(self, coefficients: Coefficients, *, name: str) -> HybridVehicle:
        """Return the same vehicle with another viscous model.

        The model is axis -> term -> coefficient, for example an identified one.
        """
        model = IdentifiedModel(name, coefficients)
        return replace(self, terms=model.terms, viscous=model.matrix, parameter_set=name)

    @cached_property
    def tables(self) -> Tables:
        """Constants for the compiled step."""
        fins = np.zeros((6, 8))
        fins[:, :3] = self.fins
        return term_tables(self.vehicle, self.terms, minimum_speed=0.0)._replace(
            fins=fins.flatten(), propeller=np.zeros(6)
        )

    @cached_property
    def coefficient_rows(self) -> Array:
        """K, a row a member, for the compiled step."""
        return coefficient_rows(self.viscous)

    def members(self, mass_kg: ArrayLike) -> Members:
        """Return the rows of vehicles of masses () or (b,), for the compiled step."""
        mass = np.asarray(mass_kg, dtype=np.float64)
        return _members_at(self, float(mass)) if mass.ndim == 0 else _members(self, mass)

    def acting(self, U: ArrayLike) -> Array:
        """Return what acts (b, 12) under inputs (b, 4), for the compiled step."""
        U = np.asarray(U, dtype=np.float64)
        acting = np.zeros((len(U), 12))
        acting[:, 2:5], acting[:, 6] = U[:, 1:], U[:, 0]
        acting[:, 9] = np.where(U[:, 0] > 0.0, self.propeller_roll_moment_Nm, 0.0)
        return acting


@lru_cache(maxsize=SETTLED_MASSES)
def _members_at(hybrid: HybridVehicle, mass_kg: float) -> Members:
    return _members(hybrid, np.asarray(mass_kg))


def _members(hybrid: HybridVehicle, mass: Array) -> Members:
    x_G, vehicle = hybrid.engine.x_G(mass), hybrid.vehicle
    return member_rows(
        hybrid.mass_matrix(mass, x_G),
        mass * vehicle.gravity,
        hybrid.buoyancy,
        hybrid.r_G(x_G),
        vehicle.r_B,
        hybrid.coefficient_rows,
    )


def hybrid_vehicle(vehicle: Vehicle, parameter_set: str = "as_simulated") -> HybridVehicle:
    """Return the hybrid vehicle under one of the PARAMETER_SETS.

    `as_printed`: published coefficients, lift by the printed formulas. `as_simulated`:
    the same with the values that the source's own simulations need. `corrected`: strip
    theory with the errata applied. Raises `CampaignError` for other names, for a
    vehicle without geometry, buoyancy engine, propulsion or thruster, and for a mass of
    the vehicle that its engine cannot hold.
    """
    chosen = parameter_coefficients(vehicle, parameter_set)
    model = IdentifiedModel(parameter_set, viscous_terms(chosen))
    engine, roll_moment_Nm = vehicle.buoyancy_engine, vehicle.propeller_roll_moment_Nm
    if vehicle.thrusters is None or vehicle.thrusters.curve.force_N[-1] <= 0.0:
        raise CampaignError(
            "a hybrid vehicle needs a thruster", field="actuators.thrusters", value=vehicle.name
        )
    if engine is None or roll_moment_Nm is None:
        missing = "buoyancy_engine" if engine is None else "propulsion"
        raise CampaignError(f"a hybrid vehicle needs {missing}", field=missing)
    engine.check(vehicle.mass_kg, field="rigid_body.mass")
    return HybridVehicle(
        vehicle=vehicle,
        engine=engine,
        parameter_set=parameter_set,
        added_mass=read_only(added_mass_matrix(chosen)),
        terms=model.terms,
        viscous=read_only(model.matrix),
        fins=read_only(control_matrix(chosen)),
        maximum_thrust_N=float(vehicle.thrusters.curve.force_N[-1]),
        propeller_roll_moment_Nm=roll_moment_Nm,
    )


def parameter_coefficients(vehicle: Vehicle, parameter_set: str) -> tuple[Coefficient, ...]:
    """Return all coefficients of a vehicle under a parameter set.

    Published ones replace those of strip theory where the set demands it.

    Raises `CampaignError` for an unknown set and for a vehicle without geometry or
    without coefficients of the set.
    """
    if parameter_set not in PARAMETER_SETS:
        raise CampaignError(
            "unknown parameter set",
            field="parameter_set",
            value=parameter_set,
            allowed=PARAMETER_SETS,
            remedy=nearest(parameter_set, PARAMETER_SETS),
        )
    computed = strip_theory_of(vehicle, corrected=parameter_set == "corrected")
    if parameter_set == "corrected":
        return computed
    key = "as_simulated" if parameter_set == "as_simulated" else "published"
    listed = dict(vehicle.published)
    if not getattr(vehicle, key):
        raise CampaignError(
            "the vehicle file lists no coefficients for this parameter set",
            field=key,
            value=parameter_set,
            remedy="Take `corrected`, which needs the geometry alone.",
        )
    if parameter_set == "as_simulated":
        listed |= vehicle.as_simulated
    kept = tuple(
        item
        for item in computed
        if item.name not in listed or item.kind in ("body_lift", "surface_lift")
    )
    return (*kept, *listed.values())


def nu_dot(
    hybrid: HybridVehicle,
    chi: ArrayLike,
    U: ArrayLike,
    *,
    mass_kg: ArrayLike | None = None,
    x_G_m: ArrayLike | None = None,
    force_ned_N: ArrayLike | None = None,
    current_ned_m_s: ArrayLike | None = None,
) -> Array:
    """Return the acceleration (..., 6) of (2.59)-(2.64).

    Shapes: chi (..., 12), U (..., 4), mass (...) [kg], x_G (...) [m].

    Default mass: neutral; default x_G: (3.12) of the mass. `force_ned_N` (..., 3):
    force field at the centre of gravity (2.55)-(2.58). `current_ned_m_s` (..., 3):
    steady water current; forces then follow the velocity through the water, and chi
    keeps that over ground. The propeller's roll moment acts while X_thrust > 0 (section
    2.4.5). Fins work ahead only: the lift goes with u^2.
    """
    chi, U = np.asarray(chi, dtype=np.float64), np.asarray(U, dtype=np.float64)
    nu, eta = chi[..., :6], chi[..., 6:]
    mass = np.asarray(hybrid.engine.neutral_kg if mass_kg is None else mass_kg, dtype=np.float64)
    x_G = hybrid.engine.x_G(mass) if x_G_m is None else np.asarray(x_G_m, dtype=np.float64)
    drift = None
    if current_ned_m_s is not None:
        drift = _to_body(eta, current_ned_m_s)
        nu = np.concatenate([nu[..., :3] - drift, nu[..., 3:]], axis=-1)
    r_G, M = hybrid.r_G(x_G), hybrid.mass_matrix(mass, x_G)
    weight = mass * hybrid.vehicle.gravity
    tau = restoring_force(
        eta, weight=weight, buoyancy=hybrid.buoyancy, r_G=r_G, r_B=hybrid.vehicle.r_B
    )
    tau = (
        tau - coriolis_force(M, nu) + matrix_product(hybrid.viscous, basis(nu, None, hybrid.terms))
    )
    tau = tau + np.square(nu[..., :1]) * matrix_product(hybrid.fins, U[..., 1:])
    tau[..., 0] += U[..., 0]
    tau[..., 3] += np.where(U[..., 0] > 0.0, hybrid.propeller_roll_moment_Nm, 0.0)
    if force_ned_N is not None:
        push = _to_body(eta, force_ned_N)
        tau[..., :3] += push
        tau[..., 3:] += cross(np.broadcast_to(r_G, push.shape), push)
    rate = np.linalg.solve(M, tau[..., None])[..., 0]
    if drift is not None:
        # In a steady current the body components of the water's velocity turn with the
        # vehicle: d/dt = -omega x v_c.
        rate[..., :3] -= cross(nu[..., 3:], drift)
    return np.asarray(rate)


def chi_dot(
    hybrid: HybridVehicle,
    chi: ArrayLike,
    U: ArrayLike,
    *,
    mass_kg: ArrayLike | None = None,
    force_ned_N: ArrayLike | None = None,
    current_ned_m_s: ArrayLike | None = None,
) -> Array:
    """Return F(chi, U, m) + Delta d of (3.1): (..., 12), arguments as `nu_dot`.

    nan at singular pitch.
    """
    chi, U = np.asarray(chi, dtype=np.float64), np.asarray(U, dtype=np.float64)
    rate = nu_dot(
        hybrid,
        chi,
        U,
        mass_kg=mass_kg,
        force_ned_N=force_ned_N,
        current_ned_m_s=current_ned_m_s,
    )
    return np.concatenate([rate, eta_dot(chi[..., 6:], chi[..., :6])], axis=-1)


def _to_body(eta: Array, vector_ned: ArrayLike) -> Array:
    """J_1^-1 times a vector of the inertial frame (2.56)."""
    rotation = rotation_body_to_ned(eta[..., 3:])
    return np.asarray(
        np.einsum("...ji,...j->...i", rotation, np.asarray(vector_ned, dtype=np.float64))
    )
