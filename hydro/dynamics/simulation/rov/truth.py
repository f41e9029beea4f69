"""The truth of an ROV's twin: what acts on the vehicle beside what its file says.

Equations of McCarter 2014.

`physical_truth` is flow physics in no fitted form; `truth_of_model` has a viscous model
for the whole difference, so that a fit of that model can be exact.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError, DataError
from auvid.hydro.arrays import Array, read_only
from auvid.hydro.dynamics.actuators.thrusters import Thrusters, thrust_from_pwm, thruster_force
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.mechanics.restoring import restoring_force
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.simulation.plant_constants import FACTORS
from auvid.hydro.dynamics.simulation.rov.autopilot import frame_factors
from auvid.hydro.dynamics.simulation.rov.motion import (
    FIRST_PULSE_US,
    LAST_PULSE_US,
    RovTables,
    hull_components,
    rov_rate,
    thruster_components,
)
from auvid.hydro.dynamics.simulation.rov.open_frame import PLATE_WIDTH, OpenFrame, heavy_frame
from auvid.hydro.dynamics.simulation.rov.tether import NO_TETHER, Tether, tether_components
from auvid.hydro.dynamics.simulation.rov.thrust import Battery, ThrustLoss
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, needs_propeller_speed
from auvid.hydro.dynamics.viscous.models import IdentifiedModel

NO_LOSS = ThrustLoss(along=1.0, against=1.0, advance=0.0)
"""Thrusters that deliver their bollard thrust after the usual lag."""
ADDED_MASS_SHARE = (1.12, 0.93, 1.07, 1.10, 0.95, 1.06)
"""True added mass over that of the vehicle file, on the diagonal."""
ADDED_MASS_COUPLING = {(0, 4): -0.25, (1, 3): 0.30, (2, 4): 0.12, (1, 5): -0.10, (0, 2): 0.15}
"""Off-diagonal added mass [kg m], of (X, w) [kg]: the frame is not symmetric up and
down, nor ahead and astern."""


@dataclass(frozen=True)
class RovTruth:
    """An ROV as it is: `vehicle` is its file, all else is true.

    `hull`: drag of the frame, or a viscous model. `net_buoyancy_N` lifts;
    `centre_of_buoyancy_m` and `added_mass` (6, 6) replace those of the file.
    `current_m_s`: of the water, NED. `strength` (n,): share of its thrust that each
    thruster gives, a worn or dead one below 1; its current and jet stay.
    """

    vehicle: Vehicle
    hull: OpenFrame | IdentifiedModel
    added_mass: Array
    net_buoyancy_N: float
    centre_of_buoyancy_m: Array
    loss: ThrustLoss = NO_LOSS
    battery: Battery = field(default_factory=Battery)
    tether: Tether | None = None
    current_m_s: Array = field(default_factory=lambda: np.zeros(3))
    strength: Array = field(default_factory=lambda: np.ones(1))

    @property
    def thrusters(self) -> Thrusters:
        """Return the thrusters of the vehicle."""
        assert self.vehicle.thrusters is not None
        return self.vehicle.thrusters

    @property
    def buoyancy(self) -> float:
        """B [N]."""
        return self.vehicle.weight + self.net_buoyancy_N

    @cached_property
    def mass_matrix(self) -> Array:
        """M = M_RB - M_A (6, 6)."""
        return read_only(self.vehicle.rigid_body_mass - self.added_mass)

    @cached_property
    def tables(self) -> RovTables:
        """Return the constants for the loop."""
        vehicle, thrusters = self.vehicle, self.thrusters
        allocation, curve = thrusters.allocation, thrusters.curve
        model = self.hull if isinstance(self.hull, IdentifiedModel) else IdentifiedModel("none", {})
        plates = self.hull.plates if isinstance(self.hull, OpenFrame) else ()
        factors = [
            [FACTORS.index(factor) for factor in (*BASIS_TERMS[term].factors, "one", "one")[:3]]
            for term in model.terms
        ]
        battery = self.battery
        supply = [curve.voltage_v, curve.voltage_exponent, battery.full_V]
        supply += [battery.per_charge_V_Ah, battery.resistance_ohm]
        supply += [battery.idle_A, battery.per_thrust]
        density = vehicle.water_density
        tether = NO_TETHER if self.tether is None else self.tether.row(density)
        return RovTables(
            mass=self.mass_matrix.copy(),
            inverse=np.array(np.linalg.inv(self.mass_matrix), dtype=np.float64),
            restoring=np.array(
                [
                    vehicle.weight - self.buoyancy,
                    *(vehicle.r_G * vehicle.weight - self.centre_of_buoyancy_m * self.buoyancy),
                ]
            ),
            plates=np.array(plates, dtype=np.float64).reshape(-1, PLATE_WIDTH).T.copy(),
            factors=np.array(factors, dtype=np.int64).reshape(-1, 3),
            coefficients=np.array(model.matrix, order="C"),
            tether=tether.copy(),
            loss=self.loss.row(density),
            lag_s=float(self.loss.lag_s),
            position=_positions(allocation),
            allocation=np.array(allocation * self.strength, order="C"),
            mixing=frame_factors(thrusters),
            direction=np.array(thrusters.direction, dtype=np.float64),
            thrust=thrust_from_pwm(
                np.arange(FIRST_PULSE_US, LAST_PULSE_US + 1, dtype=np.float64), None, curve
            ),
            supply=np.array(supply),
            current=np.array(self.current_m_s, dtype=np.float64),
        )

    def rate(
        self, state: ArrayLike, goal: ArrayLike, push: ArrayLike, *, compiled: bool = True
    ) -> tuple[Array, Array]:
        """Return d/dt of states (m, 12 + n) and the force on the hull (m, 6).

        A state is [nu, eta, bollard thrust]. `goal` (m, n): bollard thrust of the
        pulses, `push` (m, 6): unsteady force. `compiled` False takes the numpy path, the reference.
        """
        x, goals, pushes = (np.ascontiguousarray(item, np.float64) for item in (state, goal, push))
        if compiled:
            from auvid.hydro.dynamics.simulation.rov.loop import rates

            out, hull = np.empty_like(x), np.empty((len(x), 6))
            rates(x, goals, pushes, self.tables, out, hull)
            return out, hull
        columns = np.empty(x.shape[::-1])
        rov_rate(x.T, goals.T, tuple(pushes.T), self.tables, columns)
        force = hull_components(self.tables, tuple(x.T[:6]))
        return np.ascontiguousarray(columns.T), np.stack(force, axis=-1)

    def forces(self, eta: Array, nu: Array, nu_dot: Array, bollard: Array) -> dict[str, Array]:
        """Return true forces (m, 6) [N, N m] of motions through the water.

        `tether`, `buoyancy` (true restoring force minus that of the vehicle
        file), `thrust_loss` (delivered minus bollard thrust), `inertia` (mass and added
        mass of the file minus the true ones), and `thrusters` (bollard). With
        the force on the hull and the unsteady one, all but the last add up to tau_bar
        (4.4) of the vehicle file.
        """
        motion, c = tuple(nu.T), self.tables
        attitude, vehicle = eta[:, 3:], self.vehicle
        rotation = rotation_body_to_ned(attitude)
        rows = tuple(tuple(rotation[:, i, j] for j in range(3)) for i in range(3))
        currents = tuple(np.full(len(eta), value) for value in c.current)
        weights = {"weight": np.array(vehicle.weight), "r_G": vehicle.r_G}
        true = restoring_force(
            eta, buoyancy=np.array(self.buoyancy), r_B=self.centre_of_buoyancy_m, **weights
        )
        filed = restoring_force(
            eta, buoyancy=np.array(vehicle.buoyancy), r_B=vehicle.r_B, **weights
        )
        excess = self.added_mass - vehicle.added_mass
        thrust = thruster_force(self.thrusters, bollard)
        delivered = np.stack(thruster_components(c, bollard.T, motion), axis=-1)
        return {
            "tether": np.stack(
                tether_components(c.tether, rows, tuple(eta[:, :3].T), motion, currents), axis=-1
            ),
            "buoyancy": true - filed,
            "thrust_loss": delivered - thrust,
            "inertia": nu_dot @ excess.T + coriolis_force(excess, nu),
            "thrusters": thrust,
        }


def tau_bar_of(vehicle: Vehicle, eta: Array, nu: Array, nu_dot: Array, bollard: Array) -> Array:
    """Return tau_bar (4.4) of a vehicle file for a true motion, lag of thrust known."""
    return residual_force(vehicle, eta, nu, nu_dot, Control(thruster_force_N=bollard)).tau_bar


def _positions(allocation: Array) -> Array:
    """Return where the axes of thrusters pass nearest the origin (n, 3).

    Axis x moment. The inflow along an axis is the same at all of its points.
    """
    return np.ascontiguousarray(np.cross(allocation[:3].T, allocation[3:].T))


def physical_truth(vehicle: Vehicle) -> RovTruth:
    """Return a BlueROV2 Heavy with flow physics, tether, losses and 3 N of buoyancy.

    Raises `CampaignError` for a vehicle without thrusters.
    """
    checked_thrusters(vehicle)
    added = vehicle.added_mass * np.diag(ADDED_MASS_SHARE)
    for (row, column), value in ADDED_MASS_COUPLING.items():
        added[row, column] = added[column, row] = value
    return RovTruth(
        vehicle,
        heavy_frame(vehicle.water_density),
        read_only(added),
        net_buoyancy_N=3.0,
        centre_of_buoyancy_m=read_only(vehicle.r_B + np.array([0.004, -0.002, -0.003])),
        loss=ThrustLoss(),
        tether=Tether(),
    )


def truth_of_model(vehicle: Vehicle, model: IdentifiedModel) -> RovTruth:
    """Return a vehicle just as its file has it, with a viscous model for its hull.

    Thrust lags and the battery sags as ever; nothing else acts. Raises `DataError` for
    terms in the propulsion ratio, which an ROV does not have.
    """
    checked_thrusters(vehicle)
    if any(map(needs_propeller_speed, model.terms)):
        raise DataError(
            "a vehicle with thrusters has no propulsion ratio",
            value=next(term for term in model.terms if needs_propeller_speed(term)),
            remedy="Leave the terms with (eta-1) out.",
        )
    return RovTruth(
        vehicle,
        model,
        vehicle.added_mass,
        net_buoyancy_N=vehicle.buoyancy - vehicle.weight,
        centre_of_buoyancy_m=vehicle.r_B,
    )


def checked_thrusters(vehicle: Vehicle) -> None:
    """Raise `CampaignError` unless the vehicle is driven by thrusters alone."""
    if vehicle.thrusters is None or vehicle.propeller is not None or vehicle.fins is not None:
        raise CampaignError(
            "the twin of an ROV needs a vehicle with thrusters alone", value=vehicle.name
        )
