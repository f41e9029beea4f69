"""Equations of motion, forward and inverse: McCarter 2014 (2.60)-(2.66) and (4.4).

M nu_dot + C(nu) nu = tau_G(eta) + tau_U(nu, control) + tau_nu(nu),
M = M_RB - M_A,   C = C_RB - C_A
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.fins import fin_force
from auvid.hydro.dynamics.actuators.propeller import propeller_force
from auvid.hydro.dynamics.actuators.thrusters import thruster_force, thruster_forces
from auvid.hydro.dynamics.mechanics.kinematics import eta_dot
from auvid.hydro.dynamics.mechanics.restoring import restoring_force
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle

ViscousForce = Callable[[Array], Array]
"""nu (..., 6) -> tau_nu (..., 6)."""


@dataclass(frozen=True)
class Control:
    """State of the actuators; leading dimensions are the batch.

    What the vehicle does not have is None.

    Thrusters: either the pulses `thruster_pwm_us` (..., n), with `voltage_v` (...) or
    None for the voltage of the thrust curve, or the forces along the axes
    `thruster_force_N` (..., n), for example filtered ones; the forces count where both
    are given.
    """

    propeller_rev_s: ArrayLike | None = None
    fins_rad: ArrayLike | None = None
    thruster_pwm_us: ArrayLike | None = None
    thruster_force_N: ArrayLike | None = None
    voltage_v: ArrayLike | None = None


@dataclass(frozen=True)
class ForceComponents:
    """The parts of (4.4), each (..., 6) [N, N m].

    None for an actuator that the vehicle does not have.

    tau_bar = rigid_body_inertia + added_mass_inertia + rigid_body_coriolis +
    added_mass_coriolis
              - restoring - fins - propeller - thrusters,
    with added_mass_inertia = -M_A nu_dot and added_mass_coriolis = -C_A(nu) nu (M_A <=
    0).
    """

    rigid_body_inertia: Array
    added_mass_inertia: Array
    rigid_body_coriolis: Array
    added_mass_coriolis: Array
    restoring: Array
    fins: Array | None
    propeller: Array | None
    thrusters: Array | None
    tau_bar: Array

    def components(self) -> dict[str, Array]:
        """Return the components that exist, by name, tau_bar last."""
        return {name: value for name, value in vars(self).items() if value is not None}


def inertia_force(M: ArrayLike, nu_dot: ArrayLike) -> Array:
    """M nu_dot: (6, 6) and (..., 6) -> (..., 6) [N, N m]."""
    return np.asarray(np.asarray(nu_dot, dtype=np.float64) @ np.asarray(M, dtype=np.float64).T)


def actuator_force(vehicle: Vehicle, nu: ArrayLike, control: Control) -> dict[str, Array]:
    """Return tau_U by actuator (2.57), for those that the vehicle has.

    `fins`, `propeller`, `thrusters`, each (..., 6).

    Raises `DataError` when the vehicle has an actuator whose command is missing.
    """
    forces: dict[str, Array] = {}
    if vehicle.fins is not None:
        deflection = _required(control.fins_rad, "fin deflections")
        forces["fins"] = fin_force(
            vehicle.fins, nu, deflection, water_density=vehicle.water_density
        )
    if vehicle.propeller is not None:
        n = _required(control.propeller_rev_s, "propeller speed")
        forces["propeller"] = propeller_force(
            vehicle.propeller, nu, n, water_density=vehicle.water_density
        )
    if vehicle.thrusters is not None:
        along_axis = control.thruster_force_N
        if along_axis is None:
            along_axis = thruster_forces(
                vehicle.thrusters,
                _required(control.thruster_pwm_us, "thruster pulses"),
                control.voltage_v,
            )
        forces["thrusters"] = thruster_force(vehicle.thrusters, along_axis)
    return forces


def residual_force(
    vehicle: Vehicle, eta: ArrayLike, nu: ArrayLike, nu_dot: ArrayLike, control: Control
) -> ForceComponents:
    """Return the residual force (4.4) with all its components.

    tau_bar = M nu_dot + C(nu) nu - tau_G - tau_U.

    eta, nu, nu_dot (..., 6); it is the force that a viscous model has to explain.
    Errors as `actuator_force`.
    """
    nu, nu_dot = np.asarray(nu, dtype=np.float64), np.asarray(nu_dot, dtype=np.float64)
    motion = {
        "rigid_body_inertia": inertia_force(vehicle.rigid_body_mass, nu_dot),
        "added_mass_inertia": -inertia_force(vehicle.added_mass, nu_dot),
        "rigid_body_coriolis": coriolis_force(vehicle.rigid_body_mass, nu),
        "added_mass_coriolis": -coriolis_force(vehicle.added_mass, nu),
    }
    restoring = restoring_of(vehicle, eta)
    actuators = actuator_force(vehicle, nu, control)
    tau_bar = sum(motion.values()) - restoring - sum(actuators.values())
    return ForceComponents(
        **motion,
        restoring=restoring,
        fins=actuators.get("fins"),
        propeller=actuators.get("propeller"),
        thrusters=actuators.get("thrusters"),
        tau_bar=np.asarray(tau_bar),
    )


def forward_dynamics(
    vehicle: Vehicle, eta: ArrayLike, nu: ArrayLike, control: Control, viscous_force: ArrayLike
) -> Array:
    """Return nu_dot (..., 6) of (2.60): M^-1 (-C(nu) nu + tau_G + tau_U + tau_nu).

    `viscous_force` is tau_nu (..., 6) at this nu [N, N m].

    Errors as `actuator_force`.
    """
    total = (
        np.asarray(viscous_force, dtype=np.float64)
        + restoring_of(vehicle, eta)
        - coriolis_force(vehicle.mass_matrix, nu)
    )
    for force in actuator_force(vehicle, nu, control).values():
        total = total + force
    return np.asarray(total @ vehicle.mass_matrix_inverse.T)


def state_derivative(
    vehicle: Vehicle, state: ArrayLike, control: Control, viscous_force: ViscousForce
) -> Array:
    """Return the rate of the state [nu, eta] (..., 12) under `control`.

    tau_nu = viscous_force(nu). nan at singular pitch.
    """
    state = np.asarray(state, dtype=np.float64)
    nu, eta = state[..., :6], state[..., 6:]
    return np.concatenate(
        [forward_dynamics(vehicle, eta, nu, control, viscous_force(nu)), eta_dot(eta, nu)], axis=-1
    )


def restoring_of(vehicle: Vehicle, eta: ArrayLike) -> Array:
    """tau_G (2.44) of the vehicle: (..., 6) -> (..., 6) [N, N m]."""
    return restoring_force(
        eta, weight=vehicle.weight, buoyancy=vehicle.buoyancy, r_G=vehicle.r_G, r_B=vehicle.r_B
    )


def _required(command: ArrayLike | None, what: str) -> ArrayLike:
    if command is None:
        raise DataError(
            f"the vehicle needs {what}, but the data have none",
            remedy="Name the columns in the log, or correct the vehicle file.",
        )
    return command
