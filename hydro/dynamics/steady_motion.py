"""Steady motion under a constant force: where it exists, tips over or grows.

Nothing holds the vehicle but its own righting moment: roll and pitch are free.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import AXES, Array, Ints
from auvid.hydro.dynamics.equations_of_motion import restoring_of
from auvid.hydro.dynamics.jacobians import (
    basis_jacobian,
    coriolis_jacobian,
    euler_rate_jacobians,
    restoring_jacobian,
)
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_matrix
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis
from auvid.hydro.dynamics.viscous.models import IdentifiedModel, coefficient_matrix

TIPPED_RAD = np.pi / 3.0
"""Roll or pitch from which on a vehicle that nobody turns has tipped over."""
ITERATIONS, HALVINGS = 30, 5
"""Newton's steps of a balance, which is there after 4 to 13 of them or not at all."""
SETTLED = 1e-9
"""Missing force or moment of a balance, for each 1 + |force|."""
NO_MOTION = "no steady motion"
TILTS = ("roll", "pitch")
TILT = [3, 4]
"""Places of phi and theta in eta."""
TILT_STATES = [9, 10]
"""Places of phi and theta in [nu, eta]."""
STATES = [0, 1, 2, 3, 4, 5, *TILT_STATES]
"""Places in [nu, eta] of what a steady motion keeps: velocities, roll and pitch."""
ROUNDING = 8 * np.finfo(float).eps
"""Slopes with less than this share of the largest count as none."""
R = TypeVar("R")


@dataclass(frozen=True)
class Floating:
    """A vehicle with its model: viscous terms and constant force (6,) [N, N m]."""

    vehicle: Vehicle
    model: IdentifiedModel
    constant: Array

    def moments(self, nu: Array) -> dict[str, Array]:
        """Return coefficient -> its force (6,) at nu, and `C` -> the Coriolis force."""
        values = self.model.regressor(nu, np.ones(()))
        parts = {"C": -coriolis_force(self.vehicle.mass_matrix, nu)}
        for i, axis in enumerate(AXES):
            for j, term in enumerate(self.model.terms):
                if self.model.matrix[i, j] != 0.0:
                    parts[f"{axis}_{term.replace('*', '')}"] = (
                        np.eye(6)[i] * self.model.matrix[i, j] * values[j]
                    )
            parts[f"{axis}_0"] = np.eye(6)[i] * self.constant[i]
        return parts

    def slopes(self, nu: Array, tilt: Array, *, minimum_speed: float = np.inf) -> Array:
        """Return d(balance)/d[nu, phi, theta]: (..., 6), (..., 2) -> (..., 8, 8).

        The propulsion ratio is 1 and, below `minimum_speed`, stays so as U changes.
        """
        return _Together.of([self]).slopes(0, nu, tilt, minimum_speed=minimum_speed)


@dataclass(frozen=True)
class _Together:
    """Floating vehicles as one batch; they may differ in model and inertia alone.

    matrices (k, 6, m) of all `terms` (m,); constants (k, 6); masses (k, 6, 6). Of their
    methods the first argument says of which vehicle each row is: one for all, or (n,).
    """

    vehicle: Vehicle
    terms: tuple[str, ...]
    matrices: Array
    constants: Array
    masses: Array

    @classmethod
    def of(cls, floatings: Sequence[Floating]) -> _Together:
        """Return the batch of these vehicles."""
        terms = tuple(dict.fromkeys(term for item in floatings for term in item.model.terms))
        return cls(
            floatings[0].vehicle,
            terms,
            np.array([coefficient_matrix(item.model.coefficients, terms) for item in floatings]),
            np.array([item.constant for item in floatings]),
            np.array([item.vehicle.mass_matrix for item in floatings]),
        )

    def balance(self, of: Ints | int, nu: Array, tilt: Array) -> Array:
        """Return all forces but the drive, and the rates of roll and pitch.

        nu (..., 6), tilt (..., 2) -> (..., 8).
        """
        eta = _eta(tilt)
        force = self.constants[of] + restoring_of(self.vehicle, eta)
        values = basis(nu, np.ones(nu.shape[:-1]), self.terms)
        force = force + (self.matrices[of] @ values[..., None])[..., 0]
        force = force - coriolis_force(self.masses[of], nu)
        rates = np.einsum("...ij,...j->...i", euler_rate_matrix(eta[..., 3:]), nu[..., 3:])
        return np.concatenate([force, rates[..., :2]], axis=-1)

    def slopes(
        self, of: Ints | int, nu: Array, tilt: Array, *, minimum_speed: float = np.inf
    ) -> Array:
        """Return d(balance)/d[nu, phi, theta]: (..., 6), (..., 2) -> (..., 8, 8)."""
        vehicle, eta = self.vehicle, _eta(tilt)
        slope = basis_jacobian(
            nu, self.terms, ratio=np.ones(nu.shape[:-1]), minimum_speed=minimum_speed
        )
        out = np.zeros((*nu.shape[:-1], 8, 8))
        out[..., :6, :6] = self.matrices[of] @ slope - coriolis_jacobian(self.masses[of], nu)
        out[..., :6, 6:] = restoring_jacobian(
            eta, weight=vehicle.weight, buoyancy=vehicle.buoyancy, r_G=vehicle.r_G, r_B=vehicle.r_B
        )[..., TILT]
        by_omega, by_attitude = euler_rate_jacobians(eta[..., 3:], nu[..., 3:])
        out[..., 6:, 3:6], out[..., 6:, 6:] = by_omega[..., :2, :], by_attitude[..., :2, :2]
        return out

    def growths(
        self, of: Ints | int, nu: Array, tilt: Array, *, minimum_speed: float
    ) -> tuple[list[float], list[str]]:
        """Return the fastest growth [1/s] about steady motions, and where each shows.

        nu (n, 6), tilt (n, 2). Of the eigenvalues of d[nu, phi, theta]/dt under a constant
        force. The axis is that of the largest part of kinetic energy, by the diagonal of M.
        """
        slope, mass = self.slopes(of, nu, tilt, minimum_speed=minimum_speed), self.masses
        slope[:, :6] = np.linalg.inv(mass)[of] @ slope[:, :6]
        values, vectors = np.linalg.eig(slope)
        fastest = np.argmax(values.real, axis=1)
        each = np.arange(len(fastest))
        own = np.diagonal(mass, axis1=1, axis2=2)[of]
        energy = np.abs(vectors[each, :6, fastest]) ** 2 * own
        growth = values.real[each, fastest]
        return growth.tolist(), [AXES[place] for place in np.argmax(energy, axis=1)]


def _eta(tilt: Array) -> Array:
    eta = np.zeros((*tilt.shape[:-1], 6))
    eta[..., TILT] = tilt
    return eta


@dataclass(frozen=True)
class SteadyMotion:
    """A motion that keeps its velocities and its tilt.

    speed along the axis [m/s, rad/s]; force: of the drive [N, N m of its axis]; nu (6,);
    tilt (2,): phi, theta [rad]; growth [1/s]: of the fastest growing disturbance, not
    above 0 for a stable motion; grows_on: the axis that it shows on most.
    """

    speed: float
    force: float
    nu: Array
    tilt: Array
    growth: float
    grows_on: str


class Guess(NamedTuple):
    """Where a search for a balance stands: nu (6,), tilt (2,), force of its drive (8,).

    place: of the velocity in nu that is given, in whose stead the force is sought; None
    where nothing drives it.
    """

    nu: Array
    tilt: Array
    force: float
    drive: Array
    place: int | None


Search = Generator[Guess, tuple[Array, Array] | None, R]
"""Newton's steps: yields a guess; is sent what is missing in its balance and the step
(8,) that would mend it, None where they are no numbers."""


@dataclass(frozen=True)
class SteadyDrive:
    """Speeds along an axis, and the force (6,) of the actuators at f = 1."""

    axis: str
    direction: Array
    speeds: Array


def steady_motions(
    tracks: Sequence[tuple[Floating, SteadyDrive]], *, minimum_speed: float
) -> list[tuple[list[SteadyMotion], str]]:
    """Return the upright steady motions of each vehicle and drive, and what ends them.

    0 = f drive + constant + tau_nu(nu) + tau_G(phi, theta) - C(nu) nu, phi_dot =
    theta_dot = 0, for f, phi, theta and the other five velocities, from one speed to the
    next. Before a speed without upright motion the step is halved, `HALVINGS` times. The
    end: `roll` or `pitch` beyond `TIPPED_RAD`, `NO_MOTION` where none was found, empty
    where all speeds have one. Vehicles may differ in model and inertia alone.
    """
    outcomes = _solved([(floating, _along(floating, drive)) for floating, drive in tracks])
    steady = [motion for motions, _ in outcomes for motion in motions]
    if steady:
        together, of_track = _batch([floating for floating, _ in tracks])
        of = np.repeat(of_track, [len(motions) for motions, _ in outcomes])
        nu, tilt = (np.array([getattr(item, name) for item in steady]) for name in ("nu", "tilt"))
        growths = zip(*together.growths(of, nu, tilt, minimum_speed=minimum_speed), strict=True)
        grown = iter(
            [
                replace(item, growth=g, grows_on=on)
                for item, (g, on) in zip(steady, growths, strict=True)
            ]
        )
        outcomes = [([next(grown) for _ in motions], end) for motions, end in outcomes]
    return outcomes


def _batch(floatings: Sequence[Floating]) -> tuple[_Together, Ints]:
    """Return different vehicles as one batch, and the place (n,) of each in it."""
    different = {id(item): item for item in floatings}
    place = {key: number for number, key in enumerate(different)}
    return _Together.of(list(different.values())), np.array([place[id(f)] for f in floatings])


def _solved(searches: Sequence[tuple[Floating, Search[R]]]) -> list[R]:
    """Return the results of searches that take their steps together, as one batch."""
    if not searches:
        return []
    results: dict[int, R] = {}
    guesses: dict[int, Guess] = {}
    together, of = _batch([floating for floating, _ in searches])

    def go_on(number: int, answer: tuple[Array, Array] | None) -> None:
        try:
            guesses[number] = searches[number][1].send(answer)
        except StopIteration as end:
            guesses.pop(number, None)
            results[number] = end.value

    for number in range(len(searches)):
        go_on(number, None)
    while guesses:
        waiting = list(guesses)
        answers = _newton_steps(together, of[waiting], list(guesses.values()))
        for number, answer in zip(waiting, answers, strict=True):
            go_on(number, answer)
    return [results[number] for number in range(len(searches))]


def _newton_steps(
    together: _Together, of: Ints, guesses: Sequence[Guess]
) -> list[tuple[Array, Array] | None]:
    """Return what is missing in the balance (8,) of each guess, and Newton's step (8,).

    of (n,): which vehicle each is of. Of the velocity that is given the step is that of
    the force. The slope of each velocity is lowered by sqrt(|missing force| M_jj):
    quadratic damping has no slope at rest.
    """
    nu, tilt, force, drives = (
        np.array([getattr(guess, name) for guess in guesses])
        for name in ("nu", "tilt", "force", "drive")
    )
    missing = together.balance(of, nu, tilt) + force[:, None] * drives
    slope = together.slopes(of, nu, tilt)
    good = np.isfinite(missing).all(axis=1) & np.isfinite(slope).all(axis=(1, 2))
    missing[~good], slope[~good] = 0.0, 0.0
    slope[:, range(6), range(6)] -= np.sqrt(
        np.abs(missing[:, :6]) * np.diagonal(together.masses, axis1=1, axis2=2)[of]
    )
    for number, guess in enumerate(guesses):
        if guess.place is not None:
            slope[number, :, guess.place] = guess.drive
    steps = -(np.linalg.pinv(slope, ROUNDING) @ missing[:, :, None])[:, :, 0]
    return [
        (lack, step) if there else None
        for there, lack, step in zip(good.tolist(), missing, steps, strict=True)
    ]


def _along(floating: Floating, drive: SteadyDrive) -> Search[tuple[list[SteadyMotion], str]]:
    """Search the steady motions along a drive; their growth is not sought yet."""
    i = AXES.index(drive.axis)
    push = np.append(np.asarray(drive.direction, dtype=np.float64), [0.0, 0.0])
    nu, tilt, force = np.zeros(6), np.zeros(2), 0.0
    motions: list[SteadyMotion] = []
    ahead = np.asarray(drive.speeds, dtype=np.float64).tolist()[::-1]
    halvings = 0
    while ahead:
        nu = nu.copy()
        nu[i] = ahead[-1]
        balanced = yield from _balanced(Guess(nu, tilt, force, push, i))
        if balanced is not None and np.max(np.abs(balanced.tilt)) < TIPPED_RAD:
            nu, tilt, force = balanced[:3]
            motions.append(SteadyMotion(ahead.pop(), force, nu, tilt, 0.0, ""))
            continue
        if not motions or halvings == HALVINGS:
            over = NO_MOTION if balanced is None else TILTS[np.argmax(np.abs(balanced.tilt))]
            return motions, over
        ahead.append((motions[-1].speed + ahead[-1]) / 2.0)
        halvings += 1
    return motions, ""


def rest_tilts(floatings: Sequence[Floating]) -> list[Array | None]:
    """Return roll and pitch (2,) [rad] without any drive; None where not upright.

    Vehicles may differ in model and inertia alone.
    """
    start = Guess(np.zeros(6), np.zeros(2), 0.0, np.zeros(8), None)
    return [
        None if balanced is None or np.max(np.abs(balanced.tilt)) >= TIPPED_RAD else balanced.tilt
        for balanced in _solved([(floating, _balanced(start)) for floating in floatings])
    ]


def _balanced(guess: Guess) -> Search[Guess | None]:
    """Return nu, tilt and force of a balance, by Newton's steps; None without one."""
    for _ in range(ITERATIONS):
        answer = yield guess
        if answer is None:
            return None  # a step led to a pitch of 90 degrees, where roll has no rate
        missing, step = answer
        if np.max(np.abs(missing)) < SETTLED * (1.0 + abs(guess.force)):
            return guess
        step = step * min(1.0, 0.3 / max(np.max(np.abs(step[6:])), 1e-12))
        nu, force = guess.nu + step[:6], guess.force
        if guess.place is not None:
            nu[guess.place] = guess.nu[guess.place]
            force += float(step[guess.place])
        guess = guess._replace(nu=nu, tilt=guess.tilt + step[6:], force=force)
    return None


def overturning(
    floating: Floating, axis: str, motion: SteadyMotion, drive: ArrayLike
) -> dict[str, float]:
    """Return what pushes a vehicle over at the tilt of a steady motion [N m], by name.

    Largest first: coefficients, `C` for the Coriolis force of M, `actuators` for the
    drive; those that act against it are negative. axis: K or M, what it tips over in.
    """
    i = AXES.index(axis)
    parts = {name: float(part[i]) for name, part in floating.moments(motion.nu).items()}
    parts["actuators"] = motion.force * float(np.asarray(drive, dtype=np.float64)[i])
    sign = np.sign(sum(parts.values()))
    shares = {name: float(sign * value) for name, value in parts.items() if value != 0.0}
    return dict(sorted(shares.items(), key=lambda item: -item[1]))
