"""How much of each velocity a campaign excites, and from which size on a term of the basis counts as excited."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_schemas.errors import DataError
from hydro.dynamics.arrays import VELOCITIES
from hydro.dynamics.viscous_basis import BASIS_TERMS, PROPULSION

THRESHOLDS: Mapping[str, float] = {"u": 0.1, "v": 0.03, "w": 0.03, "p": 0.03, "q": 0.03, "r": 0.03}
"""Velocities [m/s, rad/s] below which motion is not told from sensor noise: about three times a DVL's 0.01 m/s, and a gyro's rate noise and
residual bias together with the slow sway of a moored or drifting vehicle. For u: below it drag on a vehicle of ours is under 1 N."""
PROPULSION_THRESHOLD = 0.05
"""Deviation of the propulsion ratio from 1 that counts as excited."""


@dataclass(frozen=True)
class VelocityExcitation:
    """RMS, standard deviation and range of one velocity [m/s or rad/s], and the share of samples beyond `threshold` in absolute value.

    `changes_sign`: beyond the threshold on both sides; otherwise x and |x|, x*x and x*|x| cannot be told apart.
    """

    name: str
    rms: float
    std: float
    low: float
    high: float
    threshold: float
    share_beyond: float

    @property
    def excited(self) -> bool:
        """Whether its RMS lies above the threshold."""
        return self.rms >= self.threshold

    @property
    def changes_sign(self) -> bool:
        """Whether it went beyond the threshold in both directions."""
        return self.low <= -self.threshold and self.high >= self.threshold


def axis_excitation(nu: ArrayLike | Sequence[ArrayLike], *, thresholds: Mapping[str, float] = THRESHOLDS) -> dict[str, VelocityExcitation]:
    """Excitation of u v w p q r from body velocities (n, 6), or a list of such arrays (legs, counted together).

    Raises `DataError` for no samples or values that are not finite.
    """
    values = (
        np.concatenate([np.asarray(leg, dtype=np.float64) for leg in nu])
        if isinstance(nu, (list, tuple))
        else np.asarray(nu, dtype=np.float64)
    )
    if values.ndim != 2 or values.shape[1] != 6 or not len(values):
        raise DataError("excitation needs body velocities (n, 6)", value=values.shape)
    if not np.isfinite(values).all():
        raise DataError("a velocity is not finite")
    return {
        name: VelocityExcitation(
            name=name,
            rms=float(np.sqrt(np.mean(column**2))),
            std=float(np.std(column)),
            low=float(column.min()),
            high=float(column.max()),
            threshold=float(thresholds[name]),
            share_beyond=float(np.mean(np.abs(column) > thresholds[name])),
        )
        for name, column in zip(VELOCITIES, values.T, strict=True)
    }


def term_floors(terms: Sequence[str], *, thresholds: Mapping[str, float] = THRESHOLDS) -> dict[str, float]:
    """RMS from which on each basis term counts as excited: the product of the thresholds of its factors.

    For V, V_v and V_w the smaller of the thresholds of v and w; a name that is no basis term (the constant) has the floor 0.
    """
    cross = min(thresholds["v"], thresholds["w"])
    floor_of = {**thresholds, **{f"|{name}|": value for name, value in thresholds.items()}, "V": cross, "Vv": cross, "Vw": cross}
    floor_of[PROPULSION] = PROPULSION_THRESHOLD
    return {
        term: float(np.prod([floor_of[factor] for factor in BASIS_TERMS[term].factors])) if term in BASIS_TERMS else 0.0 for term in terms
    }
