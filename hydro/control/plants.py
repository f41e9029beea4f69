"""Controlled plants: a vehicle with a model, limited inputs, motion and linear motion.

State chi = [nu, eta] (12) as in Al Makdah 2016 (3.1). `HybridPlant` is the H-AUV with
its buoyancy engine; `IdentifiedPlant` is any vehicle with a viscous model from a model
card, on the general equations of motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.arrays import AXES, Array, cross, matrix_product, read_only
from auvid.hydro.dynamics.actuators.fins import fin_derivatives
from auvid.hydro.dynamics.actuators.propeller import (
    level_speed,
    level_speed_slope,
    propeller_derivatives,
)
from auvid.hydro.dynamics.actuators.thrusters import thrust_from_pwm, thruster_force
from auvid.hydro.dynamics.equations_of_motion import Control, forward_dynamics
from auvid.hydro.dynamics.hybrid_vehicle import INPUTS, HybridVehicle, chi_dot
from auvid.hydro.dynamics.jacobians import (
    basis_jacobian,
    coriolis_jacobian,
    kinematics_jacobians,
    restoring_jacobian,
)
from auvid.hydro.dynamics.mechanics.kinematics import eta_dot, rotation_body_to_ned
from auvid.hydro.dynamics.simulation.plant_constants import (
    Members,
    Tables,
    coefficient_rows,
    member_rows,
    term_tables,
)
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis, eta_ratio, needs_propeller_speed
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.regression.least_squares import CONSTANT

GLIDE_SPEED_M_S, THRUST_SPEED_M_S = 0.2, 1.5
GLIDE_BELOW_M_S = 0.5 * (GLIDE_SPEED_M_S + THRUST_SPEED_M_S)
"""Slower paths are glided, faster ones flown by the propeller.

The thesis has `around` 0.2 and 1.5 m/s.
"""


@dataclass(frozen=True)
class InputLimits:
    """Names, units, limits and rate limits [per s] of the inputs U (m,)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: Array
    high: Array
    rate: Array


class ControlledPlant(Protocol):
    """A controlled vehicle.

    Leading dimensions of chi (..., 12) and U (..., m) are the batch.
    """

    @property
    def title(self) -> str: ...

    @property
    def inputs(self) -> InputLimits: ...

    @property
    def neutral_kg(self) -> float: ...

    @property
    def gravity(self) -> float: ...

    @property
    def is_identified(self) -> bool:
        """Return whether the viscous coefficients are those of a model card."""
        ...

    @property
    def terms(self) -> tuple[str, ...]: ...

    @property
    def viscous(self) -> Array:
        """K (..., 6, n) of (3.12) for the terms."""
        ...

    @property
    def is_affine(self) -> bool:
        """Return whether forces are affine in U at a given state, fin drag apart."""
        ...

    def with_viscous(self, viscous: Array) -> ControlledPlant:
        """Return the same plant with other coefficients of its terms."""
        ...

    def glides(self, speed_m_s: float) -> bool:
        """Return whether a path at this speed is flown without thrust (3.11)."""
        ...

    def glide_mass(self, pitch_rad: Array, *, epsilon_rad: float) -> Array:
        """Return the mass (n,) [kg] of a glide along these pitch angles (3.13)."""
        ...

    def level_inputs(self, speed_m_s: Array) -> Array:
        """Return U (n, m) near level running at these speeds, within the limits."""
        ...

    def rate(
        self,
        chi: ArrayLike,
        U: ArrayLike,
        *,
        mass_kg: ArrayLike,
        force_ned_N: ArrayLike | None,
        current_ned_m_s: ArrayLike | None,
    ) -> Array:
        """Return chi_dot (..., 12) at masses (...).

        With a force field at the centre of gravity and a steady current (..., 3).
        """
        ...

    @property
    def tables(self) -> Tables:
        """Constants of the compiled step."""
        ...

    def members(self, mass_kg: ArrayLike) -> Members:
        """Return the rows of vehicles of masses () or (b,), for the compiled step."""
        ...

    def acting(self, U: Array) -> Array:
        """Return what acts (b, 12) under inputs (b, m), for the compiled step."""
        ...

    def linear(self, chi: ArrayLike, U: ArrayLike, *, mass_kg: ArrayLike) -> tuple[Array, Array]:
        """Return A (..., 12, 12) and B (..., 12, m) of (3.19), analytic."""
        ...

    def mass_matrix(self, mass_kg: ArrayLike) -> Array:
        """Return M = M_RB - M_A (..., 6, 6)."""
        ...


@dataclass(frozen=True)
class HybridPlant:
    """The H-AUV: U = [X_thrust, delta_r, delta_s_right, delta_s_left].

    Its mass follows the glide; it is no input of the regulator.
    """

    hybrid: HybridVehicle
    inputs: InputLimits

    is_identified = False
    is_affine = True

    @property
    def title(self) -> str:
        return f"{self.hybrid.vehicle.name}, {self.hybrid.parameter_set}"

    @property
    def neutral_kg(self) -> float:
        return self.hybrid.engine.neutral_kg

    @property
    def gravity(self) -> float:
        return self.hybrid.vehicle.gravity

    @property
    def terms(self) -> tuple[str, ...]:
        return self.hybrid.terms

    @property
    def viscous(self) -> Array:
        return self.hybrid.viscous

    def with_viscous(self, viscous: Array) -> HybridPlant:
        return replace(self, hybrid=replace(self.hybrid, viscous=viscous))

    def glides(self, speed_m_s: float) -> bool:
        return speed_m_s < GLIDE_BELOW_M_S

    def glide_mass(self, pitch_rad: Array, *, epsilon_rad: float) -> Array:
        return self.hybrid.engine.glide_mass(pitch_rad, epsilon_rad=epsilon_rad)

    def level_inputs(self, speed_m_s: Array) -> Array:
        return _nearest_to_zero(self.inputs, len(speed_m_s))

    def rate(
        self,
        chi: ArrayLike,
        U: ArrayLike,
        *,
        mass_kg: ArrayLike,
        force_ned_N: ArrayLike | None,
        current_ned_m_s: ArrayLike | None,
    ) -> Array:
        return chi_dot(
            self.hybrid,
            chi,
            U,
            mass_kg=mass_kg,
            force_ned_N=force_ned_N,
            current_ned_m_s=current_ned_m_s,
        )

    @property
    def tables(self) -> Tables:
        return self.hybrid.tables

    def members(self, mass_kg: ArrayLike) -> Members:
        return self.hybrid.members(mass_kg)

    def acting(self, U: Array) -> Array:
        return self.hybrid.acting(U)

    def mass_matrix(self, mass_kg: ArrayLike) -> Array:
        return self.hybrid.mass_matrix(mass_kg, self.hybrid.engine.x_G(mass_kg))

    def linear(self, chi: ArrayLike, U: ArrayLike, *, mass_kg: ArrayLike) -> tuple[Array, Array]:
        h = self.hybrid
        chi, U, mass = (np.asarray(item, dtype=np.float64) for item in (chi, U, mass_kg))
        nu, eta = chi[..., :6], chi[..., 6:]
        M, r_G = self.mass_matrix(mass), h.r_G(h.engine.x_G(mass))
        by_nu = h.viscous @ basis_jacobian(nu, h.terms) - coriolis_jacobian(M, nu)
        by_nu[..., :, 0] += 2.0 * nu[..., :1] * matrix_product(h.fins, U[..., 1:])
        weight = mass * h.vehicle.gravity
        by_eta = restoring_jacobian(
            eta, weight=weight, buoyancy=h.buoyancy, r_G=r_G, r_B=h.vehicle.r_B
        )
        by_U = np.zeros((*chi.shape[:-1], 6, 4))
        by_U[..., 0, 0] = 1.0
        by_U[..., 1:] = np.square(nu[..., 0])[..., None, None] * h.fins
        return _assemble(M, eta, nu, by_nu, by_eta, by_U)


def _nearest_to_zero(inputs: InputLimits, samples: int) -> Array:
    return np.clip(np.zeros((samples, len(inputs.names))), inputs.low, inputs.high)


def _assemble(
    M: Array, eta: Array, nu: Array, by_nu: Array, by_eta: Array, by_U: Array
) -> tuple[Array, Array]:
    A = np.empty((*nu.shape[:-1], 12, 12))
    B = np.zeros((*nu.shape[:-1], 12, by_U.shape[-1]))
    A[..., :6, :6], A[..., :6, 6:] = np.linalg.solve(M, by_nu), np.linalg.solve(M, by_eta)
    A[..., 6:, :6], A[..., 6:, 6:] = kinematics_jacobians(eta, nu)
    B[..., :6, :] = np.linalg.solve(M, by_U)
    return A, B


def hybrid_plant(
    hybrid: HybridVehicle, *, fin_limit_rad: float, thrust_rate_N_s: float, fin_rate_rad_s: float
) -> HybridPlant:
    """Return the plant with the limits of its inputs and of their rates.

    Thrust from 0 to the vehicle's maximum, fins within +-`fin_limit_rad`.
    """
    inputs = InputLimits(
        names=INPUTS,
        units=("N", "rad", "rad", "rad"),
        low=read_only([0.0, -fin_limit_rad, -fin_limit_rad, -fin_limit_rad]),
        high=read_only([hybrid.maximum_thrust_N, fin_limit_rad, fin_limit_rad, fin_limit_rad]),
        rate=read_only([thrust_rate_N_s, fin_rate_rad_s, fin_rate_rad_s, fin_rate_rad_s]),
    )
    return HybridPlant(hybrid, inputs)


@dataclass(frozen=True)
class IdentifiedPlant:
    """A vehicle with a fitted viscous model: `viscous` (..., 6, n) of `terms`.

    `trim` (..., 6) [N, N m]: a constant force.
    Inputs, as far as the vehicle has them: propeller [rev/s], four fins [rad], thruster
    forces [N].
    """

    vehicle: Vehicle
    model: str
    terms: tuple[str, ...]
    viscous: Array
    trim: Array
    inputs: InputLimits
    minimum_speed: float = 0.05

    is_identified = True

    @property
    def title(self) -> str:
        return f"{self.vehicle.name}, {self.model}"

    @property
    def neutral_kg(self) -> float:
        return self.vehicle.mass_kg

    @property
    def gravity(self) -> float:
        return self.vehicle.gravity

    @property
    def is_affine(self) -> bool:
        return self.vehicle.propeller is None

    def with_viscous(self, viscous: Array) -> IdentifiedPlant:
        return replace(self, viscous=viscous)

    def glides(self, speed_m_s: float) -> bool:
        return False

    def glide_mass(self, pitch_rad: Array, *, epsilon_rad: float) -> Array:
        return np.full(len(pitch_rad), self.neutral_kg)

    def level_inputs(self, speed_m_s: Array) -> Array:
        U, propeller = _nearest_to_zero(self.inputs, len(speed_m_s)), self.vehicle.propeller
        if propeller is not None:
            table = propeller.level_speed_m_s, propeller.level_speed_rev_s
            U[:, 0] = np.interp(speed_m_s, *table)
        return U

    @cached_property
    def _needs_ratio(self) -> bool:
        return any(map(needs_propeller_speed, self.terms))

    def _control(self, U: Array) -> Control:
        at, parts = 0, {}
        if self.vehicle.propeller is not None:
            parts["propeller_rev_s"], at = U[..., 0], 1
        if self.vehicle.fins is not None:
            parts["fins_rad"], at = U[..., at : at + 4], at + 4
        if self.vehicle.thrusters is not None:
            parts["thruster_force_N"] = U[..., at:]
        return Control(**parts)

    def _ratio(self, nu: Array, U: Array) -> Array | None:
        if not self._needs_ratio or self.vehicle.propeller is None:
            return None
        return eta_ratio(level_speed(self.vehicle.propeller, U[..., 0]), nu, self.minimum_speed)

    def rate(
        self,
        chi: ArrayLike,
        U: ArrayLike,
        *,
        mass_kg: ArrayLike,
        force_ned_N: ArrayLike | None,
        current_ned_m_s: ArrayLike | None,
    ) -> Array:
        chi, U = np.asarray(chi, dtype=np.float64), np.asarray(U, dtype=np.float64)
        nu, eta = chi[..., :6], chi[..., 6:]
        to_body = np.swapaxes(rotation_body_to_ned(eta[..., 3:]), -1, -2)
        water, drift = nu, None
        if current_ned_m_s is not None:
            drift = matrix_product(to_body, current_ned_m_s)
            water = np.concatenate([nu[..., :3] - drift, nu[..., 3:]], axis=-1)
        force = (
            matrix_product(self.viscous, basis(water, self._ratio(water, U), self.terms))
            + self.trim
        )
        if force_ned_N is not None:
            push = matrix_product(to_body, force_ned_N)
            force = force + np.concatenate(
                [push, cross(np.broadcast_to(self.vehicle.r_G, push.shape), push)], axis=-1
            )
        acceleration = forward_dynamics(self.vehicle, eta, water, self._control(U), force)
        if drift is not None:
            acceleration[..., :3] -= cross(nu[..., 3:], drift)
        return np.concatenate([acceleration, eta_dot(eta, nu)], axis=-1)

    @cached_property
    def tables(self) -> Tables:
        return term_tables(self.vehicle, self.terms, minimum_speed=self.minimum_speed)

    def members(self, mass_kg: ArrayLike) -> Members:
        return self._members

    @cached_property
    def _members(self) -> Members:
        v = self.vehicle
        rows = coefficient_rows(self.viscous)
        return member_rows(v.mass_matrix, v.weight, v.buoyancy, v.r_G, v.r_B, rows)

    def acting(self, U: Array) -> Array:
        control, v, acting = self._control(U), self.vehicle, np.zeros((len(U), 12))
        acting[:, 6:] = self.trim
        if v.propeller is not None:
            acting[:, 0] = control.propeller_rev_s
            if self._needs_ratio:
                acting[:, 1] = level_speed(v.propeller, U[:, 0])
        if v.fins is not None:
            acting[:, 2:6] = control.fins_rad
        if v.thrusters is not None and control.thruster_force_N is not None:
            acting[:, 6:] += thruster_force(v.thrusters, control.thruster_force_N)
        return acting

    def mass_matrix(self, mass_kg: ArrayLike) -> Array:
        return np.broadcast_to(self.vehicle.mass_matrix, (*np.shape(mass_kg), 6, 6))

    def linear(self, chi: ArrayLike, U: ArrayLike, *, mass_kg: ArrayLike) -> tuple[Array, Array]:
        v = self.vehicle
        chi, U = np.asarray(chi, dtype=np.float64), np.asarray(U, dtype=np.float64)
        nu, eta = chi[..., :6], chi[..., 6:]
        ratio = self._ratio(nu, U)
        by_nu = self.viscous @ basis_jacobian(
            nu, self.terms, ratio=ratio, minimum_speed=self.minimum_speed
        )
        by_nu = by_nu - coriolis_jacobian(v.mass_matrix, nu)
        by_eta = restoring_jacobian(eta, weight=v.weight, buoyancy=v.buoyancy, r_G=v.r_G, r_B=v.r_B)
        by_U = np.zeros((*chi.shape[:-1], 6, len(self.inputs.names)))
        at, rho = 0, v.water_density
        if v.propeller is not None:
            by_speed, by_spin = propeller_derivatives(v.propeller, nu, U[..., 0], water_density=rho)
            by_nu[..., :, 0] += by_speed
            by_U[..., 0] += by_spin
            if ratio is not None:
                by_U[..., 0] += self._by_level_speed(nu, U)
            at = 1
        if v.fins is not None:
            fins = slice(at, at + 4)
            by_speed, by_U[..., fins] = fin_derivatives(v.fins, nu, U[..., fins], water_density=rho)
            by_nu[..., :, 0] += by_speed
            at += 4
        if v.thrusters is not None:
            by_U[..., at:] = v.thrusters.allocation
        return _assemble(self.mass_matrix(np.zeros(chi.shape[:-1])), eta, nu, by_nu, by_eta, by_U)

    def _by_level_speed(self, nu: Array, U: Array) -> Array:
        """Return d(tau_nu)/d(n) through u_c(n): terms with (eta - 1), slope of eta."""
        propeller = self.vehicle.propeller
        assert propeller is not None
        slope = level_speed_slope(propeller, U[..., 0])
        columns = [i for i, term in enumerate(self.terms) if needs_propeller_speed(term)]
        # eta - 1 = 1 leaves the other factors.
        with_one = basis(nu, np.full(nu.shape[:-1], 2.0), [self.terms[i] for i in columns])
        total = matrix_product(self.viscous[..., columns], with_one)
        return np.asarray(total * eta_ratio(slope, nu, self.minimum_speed)[..., None])


def identified_plant(
    vehicle: Vehicle, card: ModelCard, *, fin_limit_rad: float, fin_rate_rad_s: float
) -> IdentifiedPlant:
    """Return the plant of a vehicle and the `predictor` of a model card.

    A constant force acts where one was fitted. The propeller's speed is limited to the
    table of level speeds, thruster forces to their curve. Raises `CampaignError` where
    the card belongs to another vehicle.
    """
    if card.vehicle != vehicle.name:
        raise CampaignError(
            "the model card belongs to another vehicle",
            field="model",
            value=card.vehicle,
            allowed=vehicle.name,
            remedy="Name its card.",
        )
    coefficients, trim = card_coefficients(card)
    model = IdentifiedModel(str(card.name), coefficients)
    return IdentifiedPlant(
        vehicle,
        model.name,
        model.terms,
        model.matrix,
        trim,
        inputs_of(vehicle, fin_limit_rad, fin_rate_rad_s),
    )


def card_coefficients(card: ModelCard) -> tuple[dict[str, dict[str, float]], Array]:
    """Return axis -> term -> value and the constant force (6,) of a model card."""
    solution = {axis: dict(card.predictor.get(axis, {})) for axis in AXES}
    trim = read_only([solution[axis].pop(CONSTANT, 0.0) for axis in AXES])
    return solution, trim


def inputs_of(vehicle: Vehicle, fin_limit_rad: float, fin_rate_rad_s: float) -> InputLimits:
    """Return inputs and limits of a vehicle's own actuators.

    A propeller takes 2 s and a thruster 0.5 s from end to end of its range.
    """
    names: list[str] = []
    units: list[str] = []
    limits: list[tuple[float, float, float]] = []
    if vehicle.propeller is not None:
        low, high = (
            float(vehicle.propeller.level_speed_rev_s[0]),
            float(vehicle.propeller.level_speed_rev_s[-1]),
        )
        names, units, limits = ["propeller"], ["rev/s"], [(low, high, 0.5 * (high - low))]
    if vehicle.fins is not None:
        names += [f"fin_{letter}" for letter in "spbt"]
        units += ["rad"] * 4
        limits += [(-fin_limit_rad, fin_limit_rad, fin_rate_rad_s)] * 4
    if vehicle.thrusters is not None:
        curve = vehicle.thrusters.curve
        force = thrust_from_pwm(curve.pwm_us[[0, -1]], None, curve)
        names += [f"thruster_{channel}" for channel in vehicle.thrusters.outputs]
        units += ["N"] * len(vehicle.thrusters.outputs)
        limits += [(float(force[0]), float(force[-1]), 2.0 * float(force[-1] - force[0]))] * len(
            vehicle.thrusters.outputs
        )
    columns = read_only(limits).T
    return InputLimits(tuple(names), tuple(units), columns[0], columns[1], columns[2])
