"""Excitation of each velocity by a campaign, and floors for basis terms.

A term counts as excited from its floor on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import VELOCITIES, Array
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, PROPULSION

THRESHOLDS: Mapping[str, float] = {
    "u": 0.03,
    "v": 0.03,
    "w": 0.03,
    "p": 0.03,
    "q": 0.03,
    "r": 0.03,
    PROPULSION: 0.05,
}
"""RMS [m/s, rad/s, 1] below which motion is hardly told from error where that is not known:
about three times what a velocity sensor (0.01 m/s) and a gyro with its residual bias
leave. A slow ROV's whole drag lies between 0.03 and 0.3 m/s, so surge has no higher one.
"""
LEAST_ERRORS: Mapping[str, float] = {
    **dict.fromkeys(VELOCITIES[:3], 0.001),
    **dict.fromkeys(VELOCITIES[3:], 0.003),
}
"""Standard deviation [m/s, rad/s] of what no filter takes away: the long-term accuracy
that makers of Doppler logs state, and a MEMS gyro's bias of 0.2 deg/s in an autopilot.
"""
ERRORS_TO_MOVE = 3.0
"""Motion from so many standard deviations of its error on (RMS) counts as excited."""


@dataclass(frozen=True)
class VelocityExcitation:
    """RMS, standard deviation and range of one velocity [m/s or rad/s].

    threshold: RMS from which on a term linear in it counts as excited; `share_beyond`:
    share of the samples beyond it in absolute value. `changes_sign`: beyond the threshold
    of products on both sides; otherwise x and |x|, x*x and x*|x| cannot be told apart.
    """

    name: str
    n: int
    mean: float
    rms: float
    std: float
    low: float
    high: float
    threshold: float
    share_beyond: float

    @property
    def excited(self) -> bool:
        """Return whether its RMS reaches the threshold."""
        return self.rms >= self.threshold

    @property
    def product_threshold(self) -> float:
        """Return the RMS from which on products with it count as excited.

        At least the fixed one: a product of two small velocities is smaller than what
        any linear term leaves, and its coefficient extrapolates to where it matters.
        """
        return max(self.threshold, THRESHOLDS[self.name])

    @property
    def excited_in_products(self) -> bool:
        """Return whether its RMS reaches the threshold of products."""
        return self.rms >= self.product_threshold

    @property
    def changes_sign(self) -> bool:
        """Return whether it went beyond the threshold of products both ways."""
        return self.low <= -self.product_threshold and self.high >= self.product_threshold

    def merge(self, other: VelocityExcitation) -> VelocityExcitation:
        """Return the excitation over the samples of both, errors added as squares."""
        n = self.n + other.n
        a, b = self.n / n, other.n / n
        between = a * b * (self.mean - other.mean) ** 2
        threshold = self.threshold
        if other.threshold != threshold:
            threshold = math.sqrt(a * threshold**2 + b * other.threshold**2)
        return replace(
            self,
            n=n,
            mean=a * self.mean + b * other.mean,
            rms=math.sqrt(a * self.rms**2 + b * other.rms**2),
            std=math.sqrt(a * self.std**2 + b * other.std**2 + between),
            low=min(self.low, other.low),
            high=max(self.high, other.high),
            threshold=threshold,
            share_beyond=a * self.share_beyond + b * other.share_beyond,
        )


def axis_excitation(
    nu: ArrayLike | Sequence[ArrayLike],
    *,
    eta_ratio: ArrayLike | Sequence[ArrayLike] | None = None,
    thresholds: Mapping[str, float] = THRESHOLDS,
) -> dict[str, VelocityExcitation]:
    """Return the excitation of u v w p q r from body velocities (n, 6).

    A list or tuple of such arrays (legs) counts as one. eta_ratio: the propulsion ratio
    u_c(n) / U (n,), in the same form; adds the entry `eta-1`. Raises `DataError` for no
    samples or values that are not finite.
    """
    columns = dict(zip(VELOCITIES, _joined(nu, 6).T, strict=True))
    if eta_ratio is not None:
        columns[PROPULSION] = _joined(eta_ratio, None) - 1.0
    return {name: velocity_excitation(name, own, thresholds[name]) for name, own in columns.items()}


def velocity_excitation(name: str, values: Array, threshold: float) -> VelocityExcitation:
    """Return the excitation of one velocity (n,), as `axis_excitation` does of all."""
    if not np.isfinite(values).all():
        raise DataError("a velocity is not finite")
    return VelocityExcitation(
        name=name,
        n=len(values),
        mean=float(np.mean(values)),
        rms=float(np.sqrt(np.mean(values**2))),
        std=float(np.std(values)),
        low=float(values.min()),
        high=float(values.max()),
        threshold=float(threshold),
        share_beyond=float(np.mean(np.abs(values) > threshold)),
    )


def error_thresholds(sd: Array | None) -> dict[str, float]:
    """Return the RMS from which on each velocity of a leg counts as excited.

    sd (n, 6) [m/s, rad/s]: standard deviations of the leg's velocities by noise, None for
    unknown. threshold = 3 sqrt(mean sd^2 + least^2), `THRESHOLDS` for unknown.

    >>> error_thresholds(np.full((9, 6), 0.002))["v"]
    0.006708203932499369
    """
    thresholds = dict(THRESHOLDS)
    if sd is not None:
        size = np.sqrt(np.mean(sd**2, axis=0) + np.array(list(LEAST_ERRORS.values())) ** 2)
        thresholds |= dict(zip(VELOCITIES, (ERRORS_TO_MOVE * size).tolist(), strict=True))
    return thresholds


def term_floors(
    terms: Sequence[str], excitation: Mapping[str, VelocityExcitation]
) -> dict[str, float]:
    """Return the RMS from which on each basis term counts as excited.

    A product is excited only if each of its factors is: the floor is the largest of
    (threshold of one factor) times (RMS of the others). So u*v at 2 m/s is not excited
    by 0.01 m/s of sway. V counts as the length of (v, w), with the smaller of their
    thresholds. A name that is no basis term (the constant) has the floor 0.
    """
    sizes = {name: (item.product_threshold, item.rms) for name, item in excitation.items()}
    linear = {name: item.threshold for name, item in excitation.items()}
    sizes.update({f"|{name}|": sizes[name] for name in VELOCITIES})
    cross = (min(sizes["v"][0], sizes["w"][0]), float(np.hypot(sizes["v"][1], sizes["w"][1])))
    sizes.update({"V": cross, "Vv": cross, "Vw": cross})
    sizes.setdefault(PROPULSION, (THRESHOLDS[PROPULSION], 0.0))
    return {
        term: (
            linear[term]
            if term in linear
            else _floor([sizes[name] for name in BASIS_TERMS[term].factors])
            if term in BASIS_TERMS
            else 0.0
        )
        for term in terms
    }


def _floor(sizes: list[tuple[float, float]]) -> float:
    return max(
        threshold * math.prod(rms for j, (_, rms) in enumerate(sizes) if j != i)
        for i, (threshold, _) in enumerate(sizes)
    )


def _joined(parts: ArrayLike | Sequence[ArrayLike], width: int | None) -> Array:
    legs = parts if isinstance(parts, (list, tuple)) else [parts]
    values = np.concatenate([np.asarray(leg, dtype=np.float64) for leg in legs])
    if values.shape[1:] != (() if width is None else (width,)) or not len(values):
        raise DataError("excitation needs body velocities (n, 6)", value=values.shape)
    return values
