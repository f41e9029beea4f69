"""Poses of a body on a smooth path with known velocity, as trackers see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import (
    euler_rate_matrix_inverse,
    rotation_body_to_ned,
)
from auvid.hydro.identification.signals.pose.frames import (
    quaternion_of_euler,
    quaternion_product,
)

TWO_PI = 2.0 * np.pi


@dataclass(frozen=True)
class PoseRun:
    """A path at t_s (n,): position, attitude, velocity, rate (n, 3), R (n, 3, 3)."""

    t_s: Array
    position: Array
    attitude: Array
    velocity: Array
    rate: Array
    rotation: Array


def pose_run(t_s: Array, seed: int) -> PoseRun:
    """Return a path of four sines on each of x y z phi theta psi, below 0.4 Hz."""
    rng = np.random.default_rng(seed)

    def sines(amplitude: tuple[float, ...], fastest_hz: float) -> tuple[Array, Array]:
        w = TWO_PI * rng.uniform(0.03, fastest_hz, (3, 4, 1))
        a = np.array(amplitude)[:, None, None] * rng.normal(size=(3, 4, 1)) / 2.0
        angle = w * t_s + rng.uniform(0.0, TWO_PI, (3, 4, 1))
        return (a * np.sin(angle)).sum(axis=1).T, (a * w * np.cos(angle)).sum(axis=1).T

    position, velocity = sines((1.0, 1.0, 0.3), 0.25)
    attitude, euler_rate = sines((0.1, 0.1, 1.5), 0.4)
    rotation = rotation_body_to_ned(attitude)
    return PoseRun(
        t_s,
        position,
        attitude,
        np.einsum("nji,nj->ni", rotation, velocity),
        np.einsum("nij,nj->ni", euler_rate_matrix_inverse(attitude), euler_rate),
        rotation,
    )


def tracked(
    run: PoseRun,
    seed: int,
    *,
    noise_m: float,
    noise_rad: float,
    outliers: float = 0.0,
    arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[Array, Array]:
    """Return positions (n, 3) of markers and quaternions (n, 4) of random sign, noisy.

    A share of `outliers` is half a metre off, at any attitude.
    """
    rng, n = np.random.default_rng(seed), len(run.t_s)
    position = run.position + run.rotation @ np.array(arm_m) + rng.normal(0.0, noise_m, (n, 3))
    small = np.column_stack([np.ones(n), rng.normal(0.0, 0.5 * noise_rad, (n, 3))])
    attitude = quaternion_product(quaternion_of_euler(run.attitude), small)
    wrong = rng.random(n) < outliers
    position[wrong] += rng.normal(0.0, 0.5, (int(wrong.sum()), 3))
    attitude[wrong] = rng.normal(size=(int(wrong.sum()), 4))
    return position, attitude * rng.choice([-1.0, 1.0], n)[:, None]
