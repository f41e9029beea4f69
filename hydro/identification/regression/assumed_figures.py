"""How far assumed figures of the vehicle move the force that is to be explained.

A coefficient is found with a thrust curve, a mass and an arm that nobody measured. Each
figure is moved by one standard deviation, the residual force of McCarter (4.4) is worked
out again, and its difference goes through `normal_changes` to every coefficient: apart
from noise, since no longer dive makes it smaller.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.arrays import Array, cross
from auvid.hydro.dynamics.equations_of_motion import Control, inertia_force, residual_force
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force, rigid_body_matrix
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle

SLOPE_STEP = 1e-4
"""Step [m/s, rad/s] of central differences by the velocities; forces are quadratic."""
CURRENT = "current"
FORM = "form"
INERTIA_RATIO = "inertia_ratio"
UNSTEADY = "unsteady"
FIGURES = {
    "thrust": "scale of the thrust curve",
    "thrust_lag": "thrust lag",
    "mass": "mass",
    "inertia": "moments of inertia",
    "added_mass": "added mass",
    "velocity_arm": "arm of the velocity sensor",
    CURRENT: "steady current",
    FORM: "what the form lacks",
    INERTIA_RATIO: "ratio of inertias",
    UNSTEADY: "unsteady force",
}
"""Assumed figures by their key in the vehicle file; the current is the dive's, what a form
lacks the model's, a ratio of inertias that of a model without newtons, and an unsteady
force what the model leaves of the measured one.
"""


def total_error(standard_error: float, shifts: Mapping[str, float]) -> float:
    """Return the standard error by noise and assumed figures together.

    sqrt(s^2 + sum of shifts^2): assumed figures err independently of each other.

    >>> total_error(3.0, {"thrust": 4.0})
    5.0
    """
    return float(np.sqrt(standard_error**2 + sum(shift**2 for shift in shifts.values())))


@dataclass(frozen=True)
class MeasuredLeg:
    """What the residual force of a leg is made of, on a clock of `step_s`.

    eta, nu, nu_dot (n, 6); control: series (n, ...).
    """

    eta: Array
    nu: Array
    nu_dot: Array
    control: Control
    step_s: float

    def every(self, stride: int, copied: Callable[[Array], Array] = np.array) -> MeasuredLeg:
        """Return every so-many-th sample, `copied` without the memory of the others."""
        chosen = self.rows(slice(None, None, stride))
        parts = {
            name: None if part is None else copied(np.asarray(part))
            for name, part in vars(chosen.control).items()
        }
        return MeasuredLeg(
            copied(chosen.eta),
            copied(chosen.nu),
            copied(chosen.nu_dot),
            Control(**parts),
            self.step_s * stride,
        )

    def rows(self, place: slice) -> MeasuredLeg:
        """Return the samples at a place, on the same clock."""
        parts = {
            name: None if part is None else np.asarray(part)[place]
            for name, part in vars(self.control).items()
        }
        return MeasuredLeg(
            self.eta[place], self.nu[place], self.nu_dot[place], Control(**parts), self.step_s
        )

    def force_slopes(self, vehicle: Vehicle) -> Array:
        """Return d(tau_bar)/d(nu) (n, 6, 6): axis by velocity."""
        slopes = np.zeros((len(self.nu), 6, 6))
        for i in range(6):
            step = np.zeros(6)
            step[i] = SLOPE_STEP
            above, below = (
                residual_force(vehicle, self.eta, nu, self.nu_dot, self.control).tau_bar
                for nu in (self.nu + step, self.nu - step)
            )
            slopes[:, :, i] = (above - below) / (2.0 * SLOPE_STEP)
        return slopes


def figure_errors(
    leg: MeasuredLeg,
    vehicle: Vehicle,
    *,
    thrust: Array,
    actuators: Array,
    spreads: Mapping[str, float],
) -> Iterator[tuple[str, Array, Array | None]]:
    """Yield figure, change of tau_bar (n, 6), change of nu (n, 6) or None.

    By one standard deviation of each of `spreads` (keys of `FIGURES`; thrust, inertia
    and added mass as shares). thrust (n, 6): of propeller and thrusters in tau_bar at
    these samples; actuators (n, 6): with that of fins, since a lag delays them all. A
    figure of several numbers (three moments, six added masses, three components of the
    arm) comes once for each, as they are independent. The mass keeps weight and
    buoyancy, which are trimmed.
    """
    for figure, sd in spreads.items():
        if figure == "thrust":
            yield figure, -sd * thrust, None
        elif figure == "thrust_lag":
            yield figure, sd * np.gradient(actuators, leg.step_s, axis=0), None
        elif figure == "velocity_arm":
            for unit in np.eye(3):
                yield figure, *_arm_errors(leg, vehicle, sd * unit)
        else:
            for change in inertia_changes(figure, vehicle, sd):
                force = inertia_force(change, leg.nu_dot) + coriolis_force(change, leg.nu)
                yield figure, force, None


def _arm_errors(leg: MeasuredLeg, vehicle: Vehicle, arm_m: Array) -> tuple[Array, Array]:
    """Return the changes of tau_bar and nu by more arm (3,): v = v_sensor - w x arm."""
    d_nu, d_nu_dot = np.zeros_like(leg.nu), np.zeros_like(leg.nu)
    d_nu[:, :3] = -cross(leg.nu[:, 3:], np.broadcast_to(arm_m, leg.nu[:, 3:].shape))
    d_nu_dot[:, :3] = -cross(leg.nu_dot[:, 3:], np.broadcast_to(arm_m, leg.nu[:, 3:].shape))
    after, before = (
        residual_force(vehicle, leg.eta, nu, nu_dot, leg.control).tau_bar
        for nu, nu_dot in ((leg.nu + d_nu, leg.nu_dot + d_nu_dot), (leg.nu, leg.nu_dot))
    )
    return after - before, d_nu


def through_water(leg: MeasuredLeg, current_m_s: Array) -> MeasuredLeg:
    """Return a leg with its motion through water that moves by (3,) or (n, 3) [m/s].

    NED of the water. nu_r = nu - R' c, nu_r_dot = nu_dot + w x R' c: forces see these alone.
    """
    drift = np.einsum(
        "nji,nj->ni",
        rotation_body_to_ned(leg.eta[:, 3:]),
        np.broadcast_to(current_m_s, (len(leg.nu), 3)),
    )
    nu, nu_dot = leg.nu.copy(), leg.nu_dot.copy()
    nu[:, :3] -= drift
    nu_dot[:, :3] += cross(leg.nu[:, 3:], drift)
    return replace(leg, nu=nu, nu_dot=nu_dot)


def current_errors(
    leg: MeasuredLeg, vehicle: Vehicle, currents_m_s: Array
) -> Iterator[tuple[str, Array, Array]]:
    """Yield what each of currents (k, 3), NED, does, as `figure_errors` does."""
    before = residual_force(vehicle, leg.eta, leg.nu, leg.nu_dot, leg.control).tau_bar
    for current in currents_m_s:
        moved = through_water(leg, current)
        force = residual_force(vehicle, leg.eta, moved.nu, moved.nu_dot, leg.control).tau_bar
        yield CURRENT, force - before, moved.nu - leg.nu


def inertia_changes(figure: str, vehicle: Vehicle, sd: float) -> Iterator[Array]:
    """Yield changes (6, 6) of M_RB - M_A, one for each number of a figure."""
    if figure == "mass":
        yield rigid_body_matrix(sd, vehicle.r_G, np.zeros((3, 3)))
    for i in range(3, 6) if figure == "inertia" else ():
        change = np.zeros((6, 6))
        change[i, i] = sd * vehicle.inertia[i - 3, i - 3]
        yield change
    for i in range(6) if figure == "added_mass" else ():
        change = np.zeros((6, 6))
        change[i, i] = -sd * vehicle.added_mass[i, i]
        yield change
