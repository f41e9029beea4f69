"""The scale of the thrust curve: drag of the powered legs over that of the coasts.

The thrust curve is no part of the drag of a coast, and all of that of a powered leg: a
curve s times too strong makes it s times too large. Both go with the apparent mass of
the vehicle file, so s is that of thrust over mass.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Index
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.identification.coasting.decay import CoastDecay, CoastRecord, fit_decay
from auvid.hydro.identification.regression.standard_errors import (
    automatic_lags,
    long_run_moment,
)

LAGS_S = np.arange(0.0, 0.31, 0.02)
"""Lags of the thrust that are tried; the one with the least error is taken."""
CERTAIN = 3.0
"""Standard errors beyond which a scale departs from 1 ..."""
MATTERS = 0.05
"""... if it departs by more than this, too."""
MOST_ROUNDS = 4
SETTLED = 0.1
"""Change of the scale, in standard errors, at which no further round is made."""
DOUBTFUL = 0.2
"""A scale with a larger standard error, as a share, says nothing of what fades."""
STEP = 1e-3
"""Relative step of the derivatives by the drag of the coasts."""


@dataclass(frozen=True)
class PoweredLeg:
    """A leg on one axis on a uniform clock (n,): the whole of it, coasts too.

    `force` [N, N m]: the equation of motion without drag and thrust, what thrust and
    drag add up to; `thrust` by the vehicle file, without lag; `speed` [m/s, rad/s];
    `shapes` (n, k): forces of unknown size; `drift` (n, q): share of each component of the
    currents along the axis.
    """

    force: Array
    thrust: Array
    speed: Array
    shapes: Array
    step_s: float
    drift: Array = field(default_factory=lambda: np.zeros((1, 0)))


@dataclass(frozen=True)
class ThrustScale:
    """Thrust of the vehicle file over the thrust there is, on one axis.

    `standard_error` has both drags; `lag_s`: lag of the thrust that fits best; `mass`:
    apparent mass [kg, kg m^2] that both go with.
    """

    scale: float
    standard_error: float
    lag_s: float
    mass: float


def drag_and_scale(
    records: Sequence[CoastRecord],
    legs: Iterable[PoweredLeg],
    *,
    mass: float,
    prior_sd: Sequence[float] = (),
) -> tuple[CoastDecay, ThrustScale]:
    """Return the drag of the coasts and the scale, each with the other's result.

    The thrust that fades after a stop is that of the vehicle file over its scale.
    Legs are gone through several times, one after the other. Raises `DataError` for too
    few coasts, and where they determine no drag.
    """
    decay = fit_decay(records, prior_sd=prior_sd)
    if not np.isfinite(decay.drag).all():
        raise DataError("the coasts determine no drag", value=decay.drag.tolist())
    result = thrust_scale(legs, decay, mass=mass)
    for _ in range(MOST_ROUNDS):
        if not result.standard_error < DOUBTFUL * result.scale:
            break
        before = result.scale
        decay = fit_decay(records, prior_sd=prior_sd, thrust_scale=before)
        result = thrust_scale(legs, decay, mass=mass)
        if abs(result.scale - before) < SETTLED * result.standard_error:
            break
    return decay, result


def thrust_scale(legs: Iterable[PoweredLeg], decay: CoastDecay, *, mass: float) -> ThrustScale:
    """Return the scale s of thrust = s (force - drag) + constant + shapes.

    drag = -m (d1 x + d2 x|x|) of the coasts, `mass` m the apparent mass of the axis, a
    constant per leg. By instrumental variables with the drag as instrument: it is
    smooth, so that noise of the acceleration in `force` does not pull s to 0. Errors:
    coloured ones of the samples, and the covariance of the coasts.
    """
    law = np.append(decay.drag, decay.current)
    fits = _Fits.of(legs, [law], mass, LAGS_S)
    best = int(np.argmin(fits.errors[0]))
    lag, scale = float(LAGS_S[best]), float(fits.solutions[0, best, 0])
    steps = np.diag(STEP * np.maximum(np.abs(law), 0.1))
    moved = _Fits.of(legs, list(law + steps), mass, LAGS_S[[best]])
    by_drag = (moved.solutions[:, 0, 0] - scale) / steps.max(axis=1)
    noise = fits.variance(legs, law, mass, best)
    variance = noise + float(by_drag @ decay.joint @ by_drag)
    return ThrustScale(scale, float(np.sqrt(variance)), lag, mass)


@dataclass(frozen=True)
class _Fits:
    """Fits with d drags and l lags of the thrust; a leg is in memory at a time.

    Unknowns: the scale, factors of the shapes, a constant for each leg. bread (d, k, k),
    solutions (d, l, k), errors (d, l): sums of squares.
    """

    bread: Array
    solutions: Array
    errors: Array

    @classmethod
    def of(
        cls, legs: Iterable[PoweredLeg], drags: Sequence[Array], mass: float, lags_s: Array
    ) -> _Fits:
        """Return the fits of legs with each drag and each lag."""
        products = []
        for leg in legs:
            late = np.column_stack(
                [first_order_lag(leg.thrust, lag_s=lag, step_s=leg.step_s) for lag in lags_s]
            )
            pairs = [_columns(leg, drag, mass) for drag in drags]
            products.append(
                (
                    np.array([instrument.T @ design for design, instrument in pairs]),
                    np.array([design.T @ design for design, _ in pairs]),
                    np.array([instrument.T @ late for _, instrument in pairs]),
                    np.array([design.T @ late for design, _ in pairs]),
                    np.einsum("nl,nl->l", late, late),
                )
            )
        count, size = len(products), products[0][0].shape[-1]
        unknowns = size - 1 + count
        cross, square = np.zeros((2, len(drags), unknowns, unknowns))
        by_instrument, by_design = np.zeros((2, len(drags), unknowns, len(lags_s)))
        for index, (of_both, of_design, z_late, d_late, _) in enumerate(products):
            own = _places(size, index)
            cross[:, own[:, None], own] += of_both
            square[:, own[:, None], own] += of_design
            by_instrument[:, own] += z_late
            by_design[:, own] += d_late
        bread = np.array([np.linalg.pinv(each) for each in cross])
        solutions = (bread @ by_instrument).transpose(0, 2, 1)
        errors = (
            sum(late for *_, late in products)
            - 2.0 * np.einsum("dlk,dkl->dl", solutions, by_design)
            + np.einsum("dlk,dkj,dlj->dl", solutions, square, solutions)
        )
        return cls(bread, solutions, errors)

    def variance(self, legs: Iterable[PoweredLeg], drag: Array, mass: float, place: int) -> float:
        """Return the variance of the scale with the first drag and one of the lags."""
        solution, bread = self.solutions[0, place], self.bread[0]
        moments = np.zeros_like(bread)
        for index, leg in enumerate(legs):
            design, instrument = _columns(leg, drag, mass)
            own = _places(design.shape[1], index)
            lag_s = float(LAGS_S[place])
            late = first_order_lag(leg.thrust, lag_s=lag_s, step_s=leg.step_s)
            left = late - design @ solution[own]
            moments[np.ix_(own, own)] += long_run(instrument * left[:, None])
        return float((bread @ moments @ bread.T)[0, 0])


def _columns(leg: PoweredLeg, drag: Array, mass: float) -> tuple[Array, Array]:
    """Return the design and the instruments (n, k) of a leg, its constant last.

    drag (2 + q,): d1, d2 and the currents.
    """
    x = leg.speed - leg.drift @ drag[2:]
    model = -mass * (drag[0] * x + drag[1] * x * np.abs(x))
    rest = [leg.shapes, np.ones(x.size)]
    return np.column_stack([leg.force - model, *rest]), np.column_stack([-model, *rest])


def _places(size: int, leg: int) -> Index:
    """Return where the unknowns of a leg stand among those of all."""
    return np.append(np.arange(size - 1), size - 1 + leg)


def long_run(scores: Array) -> Array:
    """Return the long-run moment of the scores of a leg."""
    return long_run_moment(scores, lags=automatic_lags(scores))


@dataclass(frozen=True)
class CommonScale:
    """The scale of all axes together.

    `noise`: its standard error; `total`: that with what nobody knows of the masses.
    """

    scale: float
    noise: float
    total: float

    @property
    def departs(self) -> bool:
        """Return whether it is off from 1 beyond noise and by more than matters."""
        return abs(self.scale - 1.0) > max(CERTAIN * self.noise, MATTERS)

    @property
    def by_mass(self) -> bool:
        """Return whether it departs, and the masses that nobody measured may be why.

        >>> CommonScale(1.08, 0.025, 0.08).by_mass, CommonScale(1.25, 0.02, 0.08).by_mass
        (True, False)
        """
        return self.departs and abs(self.scale - 1.0) <= NORMAL_95 * self.total

    @property
    def alarming(self) -> bool:
        """Return whether it departs by more than one deviation, masses included."""
        return self.departs and abs(self.scale - 1.0) > self.total


def common_scale(scales: Sequence[ThrustScale], mass_share: Sequence[float]) -> CommonScale:
    """Return the weighted mean of the scales of axes.

    `mass_share`: standard deviation of each apparent mass as a share, which weighs a
    doubtful mass down. Both errors count as independent among the axes.

    >>> axes = [ThrustScale(1.0, 0.03, 0.1, 20.0), ThrustScale(1.2, 0.03, 0.1, 20.0)]
    >>> mean = common_scale(axes, [0.04, 0.0])
    >>> round(mean.scale, 3), round(mean.noise, 3), mean.departs
    (1.147, 0.023, True)
    """
    value = np.array([item.scale for item in scales])
    noise = np.array([item.standard_error for item in scales])
    variance = noise**2 + (value * np.asarray(mass_share)) ** 2
    weights = variance**-1.0 / np.sum(variance**-1.0)
    return CommonScale(
        float(weights @ value),
        float(np.sqrt(weights**2 @ noise**2)),
        float(np.sqrt(np.sum(variance**-1.0) ** -1.0)),
    )
