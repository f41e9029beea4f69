"""The hybrid vehicle of Al Makdah 2016, thrust or glide: (2.59)-(2.64), (3.1).

Its equations of motion build on the common ones.

State chi = [nu, eta] (12), input U = [X_thrust, delta_r, delta_s_right, delta_s_left]
in N and rad; the mass of the buoyancy engine and x_G are inputs too. Leading dimensions
are the batch; parameters may differ from member to member.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.hydro.arrays import Array, cross, cross_components, matrix_product, read_only
from auvid.hydro.dynamics.actuators.buoyancy_engine import BuoyancyEngine
from auvid.hydro.dynamics.mechanics.kinematics import (
    SINGULAR_COSINE,
    eta_dot,
    euler_rate_entries,
    rotation_body_to_ned,
    rotation_entries,
)
from auvid.hydro.dynamics.mechanics.restoring import restoring_components, restoring_force
from auvid.hydro.dynamics.mechanics.rigid_body import (
    coriolis_components,
    coriolis_force,
    rigid_body_matrix,
)
from auvid.hydro.dynamics.vehicle.strip_theory import strip_theory_of
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis, basis_numbers
from auvid.hydro.dynamics.viscous.coefficients import (
    Coefficient,
    added_mass_matrix,
    control_matrix,
    viscous_terms,
)
from auvid.hydro.dynamics.viscous.models import Coefficients, IdentifiedModel

INPUTS = ("X_thrust", "delta_r", "delta_s_right", "delta_s_left")
PARAMETER_SETS = ("as_printed", "as_simulated", "corrected")
SMALL_BATCH = 3
"""So few states of one vehicle are moved in plain numbers, faster than arrays: open-loop
flights, a flight with and without its observer.
"""


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
    if mass.ndim == x_G.ndim == 0:
        r_G, M, inverse = _inertia(hybrid, float(mass), float(x_G))
    else:
        r_G, M, inverse = hybrid.r_G(x_G), hybrid.mass_matrix(mass, x_G), None
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
    rate = np.linalg.solve(M, tau[..., None])[..., 0] if inverse is None else tau @ inverse.T
    if drift is not None:
        # In a steady current the body components of the water's velocity turn with the
        # vehicle: d/dt = -omega x v_c.
        rate[..., :3] -= cross(nu[..., 3:], drift)
    return np.asarray(rate)


@lru_cache(maxsize=256)
def _inertia(
    hybrid: HybridVehicle, mass_kg: float, x_G_m: float
) -> tuple[Array, Array, Array | None]:
    """Return r_G, M and the inverse (None for members): a flight asks at every step."""
    M = hybrid.mass_matrix(mass_kg, x_G_m)
    inverse = np.asarray(np.linalg.inv(M), dtype=np.float64) if M.ndim == 2 else None
    return hybrid.r_G(x_G_m), M, inverse


def chi_dot(
    hybrid: HybridVehicle,
    chi: ArrayLike,
    U: ArrayLike,
    *,
    mass_kg: ArrayLike | None = None,
    x_G_m: ArrayLike | None = None,
    force_ned_N: ArrayLike | None = None,
    current_ned_m_s: ArrayLike | None = None,
) -> Array:
    """Return F(chi, U, m) + Delta d of (3.1): (..., 12), arguments as `nu_dot`.

    nan at singular pitch.
    """
    chi, U = np.asarray(chi, dtype=np.float64), np.asarray(U, dtype=np.float64)
    mass = np.asarray(hybrid.engine.neutral_kg if mass_kg is None else mass_kg, dtype=np.float64)
    if chi.size <= SMALL_BATCH * chi.shape[-1] and chi.ndim <= 2 and x_G_m is None:
        parts = (U, force_ned_N, current_ned_m_s)
        leading = (mass.shape, *(np.shape(part)[:-1] for part in parts if part is not None))
        if _is_one_vehicle(hybrid) and all(shape in ((), chi.shape[:-1]) for shape in leading):
            return _few_rates(hybrid, chi, mass, *parts)
    rate = nu_dot(
        hybrid,
        chi,
        U,
        mass_kg=mass,
        x_G_m=x_G_m,
        force_ned_N=force_ned_N,
        current_ned_m_s=current_ned_m_s,
    )
    return np.concatenate([rate, eta_dot(chi[..., 6:], chi[..., :6])], axis=-1)


def _is_one_vehicle(hybrid: HybridVehicle) -> bool:
    return hybrid.viscous.ndim == hybrid.added_mass.ndim == hybrid.fins.ndim == 2


def _few_rates(
    hybrid: HybridVehicle,
    chi: Array,
    mass_kg: Array,
    U: Array,
    force_ned_N: ArrayLike | None,
    current_ned_m_s: ArrayLike | None,
) -> Array:
    """Return chi_dot (..., 12) of a few states, one after another."""
    if chi.ndim == 1:
        return _one_rate(hybrid, chi, float(mass_kg), U, force_ned_N, current_ned_m_s)
    out = np.empty(chi.shape)
    for i, state in enumerate(chi):
        row = [
            part if part is None or np.ndim(part) == 1 else np.asarray(part)[i]
            for part in (U, force_ned_N, current_ned_m_s)
        ]
        mass = float(mass_kg if mass_kg.ndim == 0 else mass_kg[i])
        out[i] = _one_rate(hybrid, state, mass, *row)
    return out


def _one_rate(
    hybrid: HybridVehicle,
    chi: Array,
    mass_kg: float,
    U: Any,
    force_ned_N: Any,
    current_ned_m_s: Any,
) -> Array:
    """Return chi_dot (12,): the equations of `nu_dot` in plain numbers."""
    nu, ground = chi[:6], chi[:6].tolist()
    (sf, st, sp), (cf, ct, cp) = np.sin(chi[9:]).tolist(), np.cos(chi[9:]).tolist()
    to_ned = rotation_entries(sf, cf, st, ct, sp, cp)
    omega: Any = tuple(ground[3:])
    drift: Any = (0.0, 0.0, 0.0)
    if current_ned_m_s is not None:
        drift = _transposed_product(to_ned, np.asarray(current_ned_m_s, dtype=np.float64).tolist())
        nu = nu - (*drift, 0.0, 0.0, 0.0)
    water = nu.tolist()
    r_G, M, inverse = _inertia(hybrid, mass_kg, float(hybrid.engine.x_G(mass_kg)))
    # Gravity and buoyancy, viscous force, fins: (2.44), (3.12), (2.61).
    vehicle, arm = hybrid.vehicle, r_G.tolist()
    weight: Any = mass_kg * vehicle.gravity
    x, y, z = (
        weight * heavy - hybrid.buoyancy * light
        for heavy, light in zip(arm, vehicle.r_B.tolist(), strict=True)
    )
    thrust, *fins = U.tolist()
    tau = (
        restoring_components(sf, cf, st, ct, weight - hybrid.buoyancy, x, y, z)
        - np.array(coriolis_components(water, (M @ nu).tolist()))
        + hybrid.viscous @ basis_numbers(water, hybrid.terms)
        + water[0] * water[0] * (hybrid.fins @ fins)
    )
    tau[0] += thrust
    tau[3] += hybrid.propeller_roll_moment_Nm if thrust > 0.0 else 0.0
    if force_ned_N is not None:
        push = _transposed_product(to_ned, np.asarray(force_ned_N, dtype=np.float64).tolist())
        tau += (*push, *cross_components(tuple(arm), push))
    assert inverse is not None
    out = np.empty(12)
    out[:6] = inverse @ tau
    if current_ned_m_s is not None:
        out[:3] -= cross_components(omega, drift)
    # The pose moves over ground (2.11).
    cosine: Any = math.nan if abs(ct) < SINGULAR_COSINE else ct
    out[6:9] = [_dot(row, ground[:3]) for row in to_ned]
    out[9:] = [_dot(row, omega) for row in euler_rate_entries(sf, cf, st, cosine)]
    return out


def _dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _transposed_product(rows: Any, vector: Any) -> tuple[Any, Any, Any]:
    first, second, third = zip(*rows, strict=True)
    return _dot(first, vector), _dot(second, vector), _dot(third, vector)


def _to_body(eta: Array, vector_ned: ArrayLike) -> Array:
    """J_1^-1 times a vector of the inertial frame (2.56)."""
    rotation = rotation_body_to_ned(eta[..., 3:])
    return np.asarray(
        np.einsum("...ji,...j->...i", rotation, np.asarray(vector_ned, dtype=np.float64))
    )
