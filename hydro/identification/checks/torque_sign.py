"""Whether a propeller's torque rolls the hull the way that its vehicle file says.

The residual force on roll has the torque Q of the file taken off. Where the hull feels s Q,

    K_bar = (s - 1) Q + Phi(nu) kappa + constant + noise,

Phi the terms that hull, fins and a cant of them can have on roll. Going straight ahead
Q goes with u^2, as a cant does: speeds that change part the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.viscous.basis import basis_rows

TERMS = ("p", "p*|p|", "u*p", "u*v", "u*r", "u*u")
BLOCK_S = 10.0
"""Pieces of a dive that count as independent for the standard error."""
FEWEST_BLOCKS = 8
CLEAR = 3.0
"""Standard errors that the share is away from none, and not from minus one."""
LEAST_SWING = 1e-6
"""Scatter of the torque [N m] from which on there is any."""
RIDGE = 1e-10


@dataclass(frozen=True)
class RollLeg:
    """Velocities (n, 6), residual roll moment (n,) and torque of the file (n,)."""

    nu: Array
    moment: Array
    torque: Array
    step_s: float


@dataclass(frozen=True)
class TorqueShare:
    """What the hull feels of the torque of the file, 1 where that is right."""

    value: float
    standard_error: float

    @property
    def backward(self) -> bool:
        """Return whether it acts the other way round, as large as the file says."""
        near = max(CLEAR * self.standard_error, 0.5)
        return self.value < -CLEAR * self.standard_error and abs(self.value + 1.0) < near


def torque_share(legs: Sequence[RollLeg]) -> TorqueShare | None:
    """Return the share, None where legs are short or the torque hardly changes."""
    if not legs or max(float(np.ptp(leg.torque)) for leg in legs) < LEAST_SWING:
        return None
    blocks = [
        (rows[start : start + size], leg.moment[start : start + size])
        for leg in legs
        for rows, size in ((_columns(leg), max(1, round(BLOCK_S / leg.step_s))),)
        for start in range(0, len(leg.nu), size)
    ]
    if len(blocks) < FEWEST_BLOCKS:
        return None
    scale = np.sqrt(sum(np.sum(rows**2, axis=0) for rows, _ in blocks))
    scale[scale == 0.0] = 1.0
    grams = np.array([(rows / scale).T @ (rows / scale) for rows, _ in blocks])
    products = np.array([(rows / scale).T @ moment for rows, moment in blocks])
    ridge = RIDGE * np.eye(len(scale))
    gram, product = grams.sum(axis=0) + ridge, products.sum(axis=0)
    value = np.linalg.solve(gram, product)[0] / scale[0]
    without = np.linalg.solve(gram - grams, (product - products)[..., None])[:, 0, 0] / scale[0]
    count = len(blocks)
    variance = (count - 1) / count * np.sum((without - without.mean()) ** 2)
    return TorqueShare(float(1.0 + value), float(np.sqrt(variance)))


def _columns(leg: RollLeg) -> Array:
    rows = basis_rows(leg.nu.T, terms=TERMS)
    return np.column_stack([leg.torque, rows.T, np.ones(len(leg.nu))])
