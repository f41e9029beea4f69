"""Where the markers of a pose sit beyond the vehicle file, found from motion and force.

A velocity that poses gave with an arm short by e, v = v_o + omega x e, has the changes of
the turning in it: with M the mass matrix, in surge, sway and heave,

    v' + M_ii^-1 M_ij omega_j' = omega' x e + a v + b v|v| + c F + c_1 F' + d + ...

e is common to the three, and only omega' carries it: the terms left open hold what goes
with omega itself (couplings by damping) and with products (Coriolis force of any inertia,
and the turning of the arm). Each equation is multiplied by a bump of a few seconds and
integrated, which puts derivatives on the bump (Shinbrot 1957: modulating functions), and
all are solved by one regression over all legs. The point that is found is that about which
the apparent mass of the file turns; a hull whose added mass lies elsewhere moves it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from auvid.hydro.arrays import Array, Mask, cross
from auvid.hydro.identification.regression.standard_errors import widened_by

BUMP_S = 2.0
"""Length of a bump: accelerations of about half a hertz count."""
BLOCK_S = 10.0
"""Stretches that are left out in turn for the standard error."""
FEWEST_BLOCKS = 4
PASSES = 3
"""The first is off by what the arm does to drag."""
LEAST_SQUARE = 1e-12
"""Of an error [m^2/s^4]: the weight of a row that fits to rounding."""
LEVERS = ((0, 4, 2, 1.0), (0, 5, 1, -1.0), (1, 5, 0, 1.0), (1, 3, 2, -1.0), (2, 3, 1, 1.0),
          (2, 4, 0, -1.0))  # fmt: skip
"""Row of omega' x e, the rate, the component of e, and its sign."""
PRODUCTS = (((1, 5), (2, 4)), ((0, 5), (2, 3)), ((0, 4), (1, 3)))
SQUARES = (((4, 4), (5, 5)), ((3, 4),), ((3, 5),))
"""Products of velocities beside each row: Coriolis force, and what the arm makes of it."""


Rows = tuple[Array, Array, Array]
"""Of surge, sway and heave: columns, then the target, of one block."""


@dataclass(frozen=True)
class TurningLeg:
    """Motion nu (n, 6) without a gap, at steps step_s [s]; force (n, 3) on u, v, w."""

    step_s: float
    nu: Array
    force: Array


@dataclass(frozen=True)
class MarkerArm:
    """Departure (3,) [m] of the arm from the vehicle file, forward, right, down.

    1.96 of `standard_error` (3,) are half of the 95 % interval; inf where nothing turns.
    """

    departure: Array
    standard_error: Array


def marker_arm(legs: Sequence[TurningLeg], mass_matrix: Array) -> MarkerArm:
    """Return how far the arm departs from that of the vehicle file, by all legs.

    mass_matrix (6, 6): of the vehicle file; only ratios matter. Standard errors leave
    blocks of `BLOCK_S` out in turn, with Student's t.
    """
    departure, blocks = np.zeros(3), _all_blocks(legs, mass_matrix)
    if len(blocks) < FEWEST_BLOCKS:
        return MarkerArm(departure, np.full(3, np.inf))
    for _ in range(PASSES):
        step, error = _estimate(blocks)
        departure = departure + step
        # Products of velocities and drag are those of the corrected motion.
        blocks = _all_blocks([at_origin(leg, departure) for leg in legs], mass_matrix)
    return MarkerArm(departure, error)


def at_origin(leg: TurningLeg, departure: Array) -> TurningLeg:
    """Return a leg with its velocities corrected: v - omega x departure."""
    nu = leg.nu.copy()
    nu[:, :3] -= cross(nu[:, 3:], np.broadcast_to(departure, nu[:, 3:].shape))
    return replace(leg, nu=nu)


def _estimate(blocks: Sequence[Rows]) -> tuple[Array, Array]:
    """Return the departure (3,) that blocks show, and its standard error (3,)."""
    weights = np.ones(3)
    for _ in range(2):
        parts = [_normal(block, weights) for block in blocks]
        value, moving = _solved(np.sum(parts, axis=0))
        by = np.append(-value, 1.0)
        squares = [
            float(np.mean(np.concatenate([block[row] @ by for block in blocks]) ** 2))
            for row in range(3)
        ]
        weights = 1.0 / np.maximum(squares, LEAST_SQUARE)
    count, total = len(blocks), np.sum(parts, axis=0)
    moved = np.array([_solved(total - part)[0] - value for part in parts])[:, :3]
    spread = (count - 1) / count * np.sum(moved**2, axis=0)
    wide = widened_by(count - 1)
    return value[:3], np.where(moving[:3], wide * np.sqrt(spread), np.inf)


def _normal(block: Rows, weights: Array) -> Array:
    """Return products (k + 1, k + 1) of columns and target, rows weighted."""
    return np.asarray(
        np.sum([w * rows.T @ rows for w, rows in zip(weights, block, strict=True)], axis=0)
    )


def _solved(products: Array) -> tuple[Array, Mask]:
    """Return the solution (k,) of normal equations, and which columns move at all."""
    size = np.sqrt(np.diag(products)[:-1])
    moving = size > 0.0
    size = np.where(moving, size, 1.0)
    matrix = products[:-1, :-1] / np.outer(size, size)
    inverse = np.linalg.pinv(matrix, rcond=1e-10, hermitian=True)
    return inverse @ (products[:-1, -1] / size) / size, moving


def _all_blocks(legs: Sequence[TurningLeg], mass_matrix: Array) -> list[Rows]:
    return [block for leg in legs for block in _blocks(leg, mass_matrix)]


def _blocks(leg: TurningLeg, mass_matrix: Array) -> list[Rows]:
    """Return rows of surge, sway and heave, block by block."""
    half = max(2, round(0.5 * BUMP_S / leg.step_s))
    if len(leg.nu) < 2 * half + 2:
        return []
    phase = np.pi * np.arange(-half, half + 1) / (2.0 * half)
    bump = np.cos(phase) ** 4
    slope = -4.0 * np.cos(phase) ** 3 * np.sin(phase) * np.pi / (2.0 * half * leg.step_s)
    stride = max(1, half // 4)

    def by(kernel: Array, values: Array) -> Array:
        return np.asarray(np.convolve(values, kernel[::-1], "valid")[::stride])

    def rate(values: Array) -> Array:
        # Integral of bump times x' is minus that of its slope times x.
        return -by(slope, values)

    nu, counts = leg.nu, [8 + len(PRODUCTS[row]) + len(SQUARES[row]) for row in range(3)]
    begins = np.append(3, 3 + np.cumsum(counts))
    turning = [rate(nu[:, j]) for j in (3, 4, 5)]
    rows = []
    for row in range(3):
        out = np.zeros((len(turning[0]), begins[-1] + 1))
        for at, j, component, sign in LEVERS:
            if at == row:
                out[:, component] = sign * turning[j - 3]
        x, force = nu[:, row], leg.force[:, row]
        open_terms = [by(bump, x), by(bump, x * np.abs(x)), by(bump, force), rate(force)]
        open_terms += [by(bump, np.ones(len(nu)))] + [by(bump, nu[:, j]) for j in (3, 4, 5)]
        open_terms += [by(bump, nu[:, i] * nu[:, j]) for i, j in PRODUCTS[row] + SQUARES[row]]
        out[:, begins[row] : begins[row + 1]] = np.column_stack(open_terms)
        coupled = mass_matrix[row, 3:] / mass_matrix[row, row]
        out[:, -1] = rate(x) + np.sum(
            [c * w for c, w in zip(coupled, turning, strict=True)], axis=0
        )
        rows.append(out)
    number = max(1, round(len(nu) * leg.step_s / BLOCK_S))
    edges = np.linspace(0, len(rows[0]), number + 1).astype(int)
    return [(rows[0][a:b], rows[1][a:b], rows[2][a:b]) for a, b in pairwise(edges)]
