"""Directions of thrusters that explain a motion best, where nobody wrote them down.

By axis, the change of a body velocity over windows, less what drag and a constant explain,
is compared with the impulse of all thrusters through an allocation, with a gain >= 0 each:
every set of directions is tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.outputs.joined_outputs import WindowMotion

SURE = 10.0
"""Log likelihood by which a set has to be better than every other: windows of half a second
count as independent."""
MOST_THRUSTERS = 8
LEAST_EXPLAINED = 0.1
"""Share of some axis that the thrusters have to explain, to be believed."""


def motor_directions(
    motions: Sequence[WindowMotion], impulses: tuple[Array, Array], allocation: Array
) -> Array | None:
    """Return the direction (m,) of each thruster, None where motion does not tell all.

    motions: at several lags. impulses (n, m): by direction 1 and by -1. allocation (k, m).
    """
    number = allocation.shape[1]
    if number > MOST_THRUSTERS:
        return None
    signs = np.array(list(product((1.0, -1.0), repeat=number)))
    chosen = np.hstack([signs > 0.0, signs < 0.0]).astype(np.float64)
    odds, shares = max(
        (_odds(motion, np.hstack(impulses), allocation, chosen) for motion in motions),
        key=lambda pair: float(pair[0].max()),
    )
    best = int(np.argmax(odds))
    second = float(np.max(np.delete(odds, best)))
    clear = odds[best] - second > SURE and shares[best] > LEAST_EXPLAINED
    return signs[best] if clear else None


def _odds(
    motion: WindowMotion, impulses: Array, allocation: Array, chosen: Array
) -> tuple[Array, Array]:
    """Return log likelihood (s,) of sets of directions, and share of the best axis."""
    total, best = np.zeros(len(chosen)), np.zeros(len(chosen))
    for change, drag, effect in zip(motion.changes.T, motion.drag, allocation, strict=True):
        drags = np.column_stack([drag, np.ones(len(drag))])
        basis, _ = np.linalg.qr(drags / np.maximum(np.linalg.norm(drags, axis=0), 1e-12))
        left = change - basis @ (basis.T @ change)
        pushes = impulses * np.tile(effect, 2)
        pushes = pushes - basis @ (basis.T @ pushes)
        along = np.maximum(chosen @ (pushes.T @ left), 0.0)
        size = np.einsum("si,ij,sj->s", chosen, pushes.T @ pushes, chosen) * float(left @ left)
        share = np.divide(along**2, size, out=np.zeros_like(along), where=size > 0.0)
        share = np.minimum(share, 1.0 - 1e-9)
        total -= 0.5 * len(left) * np.log1p(-share)
        best = np.maximum(best, share)
    return total, best
