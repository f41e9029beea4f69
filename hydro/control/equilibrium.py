"""Equilibrium along a trajectory. Algorithm 1 of Al Makdah 2016, corrected.

Mode, mass, states and inputs that satisfy it (3.5)-(3.17).

`algorithm_1` takes the states from the path's frame and the inputs by least squares:
with four inputs a turning vehicle keeps a residual force, because sideslip and angle of
attack are not among the unknowns. `trimmed` lets pitch and heading of the vehicle
differ from those of its path until the residual is gone; it also finds the glide's
angle of attack, and the crab angle under a known force field.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.control.paths.trajectories import Trajectory
from auvid.hydro.control.plants import GLIDE_SPEED_M_S, ControlledPlant
from auvid.hydro.dynamics.mechanics.kinematics import (
    euler_rate_matrix_inverse,
    rotation_body_to_ned,
)

GLIDE_PITCH_RAD, GLIDE_HEAVE_M_S = 0.2796, 0.0402
METHODS = ("algorithm_1", "trimmed")
ITERATIONS = 40
UNMET = 0.01
"""Share of the weight that may be missing at a trimmed instant."""
UNMET_TIME = 0.05
"""Share of the time in which more may be missing."""
SETTLED = 1e-6
"""Relative gain of a step below which a trim with an input at its limit is settled."""
LARGEST_OFFSET_RAD = 1.2


@dataclass(frozen=True)
class Equilibrium:
    """States and inputs of an equilibrium along a uniform clock.

    `chi` (n, 12), `U` (n, m), `mass_kg` (n,), the acceleration `nu_dot` (n, 6) of the
    trajectory, and `residual` (n, 6) [N, N m]: the force that is missing for it.
    `glides`: whether the buoyancy engine drives the vehicle.
    """

    t_s: Array
    chi: Array
    U: Array
    mass_kg: Array
    nu_dot: Array
    residual: Array
    glides: bool

    @property
    def step_s(self) -> float:
        """Time between samples."""
        return float(self.t_s[1] - self.t_s[0])


def equilibrium(
    plant: ControlledPlant,
    trajectory: Trajectory,
    *,
    method: str = "trimmed",
    epsilon_rad: float = 0.05,
    force_ned_N: ArrayLike | None = None,
) -> Equilibrium:
    """Return equilibrium states and inputs by one of METHODS.

    `epsilon_rad`: how fast the mass changes over between dive and rise (3.11), (3.13).

    `force_ned_N` (n, 3) or (3,): a known force field that the trim shall meet. Raises
    `CampaignError` for an unknown method.
    """
    if method not in METHODS:
        raise CampaignError(
            "unknown way to the equilibrium", field="equilibrium", value=method, allowed=METHODS
        )
    glides = plant.glides(float(np.median(trajectory.speed)))
    pitch = trajectory.attitude[:, 1]
    mass = np.full(len(pitch), plant.neutral_kg)
    if glides:
        mass = plant.glide_mass(pitch, epsilon_rad=epsilon_rad)
    offset, U = np.zeros((len(pitch), 2)), plant.level_inputs(trajectory.speed)
    force = (
        None
        if force_ned_N is None
        else np.broadcast_to(np.asarray(force_ned_N, dtype=np.float64), (len(pitch), 3))
    )
    if method == "algorithm_1":
        chi = _states(trajectory, offset)
        if glides:
            share = np.tanh(pitch / epsilon_rad)
            chi[:, 0], chi[:, 2] = GLIDE_SPEED_M_S, -GLIDE_HEAVE_M_S * share
            chi[:, 10] = GLIDE_PITCH_RAD * share
        nu_dot = np.gradient(chi[:, :6], trajectory.t_s, axis=0)
        for _ in range(1 if plant.is_affine else ITERATIONS):
            B = plant.linear(chi, U, mass_kg=mass)[1][:, :6]
            U = U + _solved(B, nu_dot - _acceleration(plant, chi, U, mass, force))
        return _result(plant, trajectory, chi, U, mass, nu_dot, force, glides)
    # The offsets change slowly: their rates are left out, so that every instant is a
    # problem of its own.
    nu_dot = np.gradient(_states(trajectory, offset)[:, :6], trajectory.t_s, axis=0)
    offset, U = _trim(plant, trajectory, offset, U, mass, nu_dot, force)
    return _result(plant, trajectory, _states(trajectory, offset), U, mass, nu_dot, force, glides)


def _states(trajectory: Trajectory, offset: Array) -> Array:
    """Return chi (n, 12) on the trajectory (3.10, corrected).

    The vehicle is turned from its path by `offset` (n, 2): pitch, heading [rad].
    """
    attitude = trajectory.attitude.copy()
    attitude[:, 1:] += offset
    velocity = np.einsum("nji,nj->ni", rotation_body_to_ned(attitude), trajectory.velocity)
    turning = np.einsum("nij,nj->ni", euler_rate_matrix_inverse(attitude), trajectory.attitude_rate)
    return np.concatenate([velocity, turning, trajectory.position, attitude], axis=1)


def _acceleration(
    plant: ControlledPlant, chi: Array, U: Array, mass: Array, force: Array | None
) -> Array:
    return plant.rate(chi, U, mass_kg=mass, force_ned_N=force, current_ned_m_s=None)[:, :6]


def _solved(system: Array, right: Array) -> Array:
    """Least squares, batched: (n, 6, m), (n, 6) -> (n, m)."""
    return np.asarray((np.linalg.pinv(system) @ right[..., None])[..., 0])


def _trim(
    plant: ControlledPlant,
    trajectory: Trajectory,
    offset: Array,
    U: Array,
    mass: Array,
    nu_dot: Array,
    force: Array | None,
) -> tuple[Array, Array]:
    """Return pitch and heading offsets and inputs that meet the equations of motion.

    Gauss-Newton, damped where a step does not help.

    Inputs stay within their limits; one that stands at its limit leaves the problem,
    and what is missing then is the residual.
    """
    reach = np.full(2, LARGEST_OFFSET_RAD)
    low, high = (
        np.concatenate([-reach, plant.inputs.low]),
        np.concatenate([reach, plant.inputs.high]),
    )
    y = np.clip(np.concatenate([offset, U], axis=1), low, high)
    damping, rows = np.ones(len(y)), np.arange(len(y))
    for _ in range(ITERATIONS):
        at = Trajectory(*(value[rows] for value in vars(trajectory).values()))
        goal, weight, push = nu_dot[rows], mass[rows], None if force is None else force[rows]

        def miss(
            y: Array,
            at: Trajectory = at,
            goal: Array = goal,
            weight: Array = weight,
            push: Array | None = push,
        ) -> Array:
            return goal - _acceleration(plant, _states(at, y[:, :2]), y[:, 2:], weight, push)

        here = y[rows]
        error = miss(here)
        slope = np.empty((len(here), 6, y.shape[1]))
        slope[..., 2:] = plant.linear(_states(at, here[:, :2]), here[:, 2:], mass_kg=weight)[1][
            :, :6
        ]
        for column in range(2):  # kinematics and dynamics together, central difference
            ahead = np.zeros(y.shape[1])
            ahead[column] = 1e-6
            slope[..., column] = -(miss(here + ahead) - miss(here - ahead)) / 2e-6
        step = _solved(slope, error)
        for _ in range(2):
            outward = ((here <= low) & (step < 0.0)) | ((here >= high) & (step > 0.0))
            if outward.any():
                step = _solved(np.where(outward[:, None, :], 0.0, slope), error)
        step[:, :2] = np.clip(step[:, :2], -0.2, 0.2)
        tried = np.clip(here + damping[rows, None] * step, low, high)
        before, after = np.sum(error**2, axis=1), np.sum(miss(tried) ** 2, axis=1)
        better = after <= before
        y[rows[better]] = tried[better]
        damping[rows] = np.where(better, np.minimum(1.0, 2.0 * damping[rows]), 0.5 * damping[rows])
        # Done: solved, or (where an input is at its limit) no better for a whole step.
        done = (
            (np.minimum(before, after) < 1e-24)
            | (better & (after > (1.0 - SETTLED) * before))
            | (damping[rows] < 1e-4)
        )
        rows = rows[~done]
        if not len(rows):
            break
    return y[:, :2], y[:, 2:]


def _result(
    plant: ControlledPlant,
    trajectory: Trajectory,
    chi: Array,
    U: Array,
    mass: Array,
    nu_dot: Array,
    force: Array | None,
    glides: bool,
) -> Equilibrium:
    missing = nu_dot - _acceleration(plant, chi, U, mass, force)
    residual = np.einsum("nij,nj->ni", plant.mass_matrix(mass), missing)
    return Equilibrium(trajectory.t_s, chi, U, mass, nu_dot, residual, glides)


def at_every(equilibrium: Equilibrium, stride: int) -> Equilibrium:
    """Return every `stride`-th sample of an equilibrium, from its first on."""
    names = ("t_s", "chi", "U", "mass_kg", "nu_dot", "residual")
    return replace(equilibrium, **{name: getattr(equilibrium, name)[::stride] for name in names})


def require_reachable(
    plant: ControlledPlant,
    equilibrium: Equilibrium,
    *,
    largest_pitch_rad: float,
) -> None:
    """Raise `CampaignError` where a trimmed trajectory is beyond the vehicle.

    Steeper than `largest_pitch_rad`, or where an input stands at its limit and more
    than `UNMET` of the weight is missing for more than `UNMET_TIME` of the time; the input,
    value and limit are named.

    A glide may miss more at its tips, where the buoyancy engine changes over and the
    fins have little effect: there the time is not held.
    """
    steepest = float(np.abs(equilibrium.chi[:, 10]).max())
    if steepest > largest_pitch_rad:
        raise CampaignError(
            "the trajectory asks for more pitch than allowed",
            field="pitch",
            value=steepest,
            allowed=f"+-{largest_pitch_rad:.4g} rad",
        )
    limits = plant.inputs
    missing = np.sqrt(np.sum(equilibrium.residual[:, :3] ** 2, axis=1)) + np.sqrt(
        np.sum(equilibrium.residual[:, 3:] ** 2, axis=1)
    )
    unmet = missing > UNMET * plant.neutral_kg * plant.gravity
    if equilibrium.glides or unmet.mean() <= UNMET_TIME:
        return
    span = 1e-9 * (limits.high - limits.low)
    at_limit = (
        (limits.low + span >= equilibrium.U) | (limits.high - span <= equilibrium.U)
    ) & unmet[:, None]
    worst = int(np.argmax(at_limit.mean(axis=0)))
    raise CampaignError(
        "the trajectory asks for more than the actuators have",
        field=limits.names[worst] if at_limit.any() else "trajectory",
        value=f"{missing.max():.4g} N missing over {100.0 * unmet.mean():.0f} % of the time",
        allowed=f"{limits.low[worst]:.4g} to {limits.high[worst]:.4g} {limits.units[worst]}",
        remedy=_tightest(plant, equilibrium),
    )


def _tightest(plant: ControlledPlant, equilibrium: Equilibrium) -> str:
    speed = float(np.median(np.sqrt(np.sum(equilibrium.chi[:, :3] ** 2, axis=1))))
    try:
        radius = minimum_turning_radius(plant, speed)
    except CampaignError:
        return f"The vehicle cannot hold {speed:.3g} m/s: lower the speed."
    return (
        f"At {speed:.3g} m/s the tightest level turn that the actuators can hold has a radius of"
        f" {radius:.3g} m."
    )


def minimum_turning_radius(plant: ControlledPlant, speed_m_s: float) -> float:
    """Return the radius [m] of the tightest level turn to starboard at a speed.

    The inputs must hold it; by bisection to 1 %.

    Raises `CampaignError` where even a turn of 2 km asks for more than the actuators
    have.
    """
    low, high = 0.3, 2000.0
    if not _turns(plant, speed_m_s, high):
        raise CampaignError(
            "the actuators cannot hold this speed", field="speed_m_s", value=speed_m_s
        )
    while high / low > 1.01:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if _turns(plant, speed_m_s, middle) else (middle, high)
    return high


def _turns(plant: ControlledPlant, speed: float, radius: float) -> bool:
    t = np.linspace(0.0, 0.2, 5)
    psi = speed * t / radius
    zero = np.zeros_like(t)
    along = np.stack([np.cos(psi), np.sin(psi), zero], axis=-1)
    place = radius * np.stack([np.sin(psi), 1.0 - np.cos(psi), zero], axis=-1)
    rate = np.stack([zero, zero, np.full_like(t, speed / radius)], axis=-1)
    turn = Trajectory(
        t, place, speed * along, np.stack([zero, zero, psi], axis=-1), rate, speed * t
    )
    result = equilibrium(plant, turn)
    limits = plant.inputs
    inside = (result.U[2] >= limits.low - 1e-9) & (result.U[2] <= limits.high + 1e-9)
    return bool(inside.all() and np.abs(result.residual[2]).max() < 1e-3)
