"""The scale of the thrust curve: drag of the powered legs over that of the coasts.

The thrust curve is no part of the drag of a coast, and all of that of a powered leg: a
curve s times too strong makes it s times too large. Both go with the apparent mass of
the vehicle file, so s is that of thrust over mass.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Index
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.identification.coasting.decay import (
    FADING_SD,
    CoastDecay,
    CoastRecord,
    fit_decay,
)
from auvid.hydro.identification.regression.standard_errors import (
    automatic_lags,
    long_run_moment,
)

LAG_STEP_S = 0.02
LAGS_S = np.arange(0.0, 0.41, LAG_STEP_S)
"""Lags of the thrust that are tried; the least error between them is taken."""
CLOCK_SD_S = 0.02
"""Of the outputs against the velocity, by which a lag may be a delay; see decision 0133."""
LEAST_LAG_SD_S = 0.01
"""Below which form of the lag and clock of the outputs move it."""
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
class ThrustLag:
    """By how much thrust is late [s]: a delay, then a first-order lag, and its sd."""

    lag_s: float
    delay_s: float
    sd_s: float

    @property
    def errors(self) -> tuple[ThrustLag, ThrustLag]:
        """Return a lag one deviation longer, and one of which a part is delay."""
        part = CLOCK_SD_S if self.lag_s >= CLOCK_SD_S else -CLOCK_SD_S
        return (
            replace(self, lag_s=self.lag_s + self.sd_s),
            replace(self, lag_s=self.lag_s - part, delay_s=self.delay_s + part),
        )


@dataclass(frozen=True)
class ThrustScale:
    """Thrust of the vehicle file over the thrust there is, on one axis.

    `standard_error` has both drags and that of the lag that fits best; `mass`: apparent mass
    [kg, kg m^2] that both go with.
    """

    scale: float
    standard_error: float
    lag: ThrustLag
    mass: float


def drag_and_scale(
    records: Sequence[CoastRecord],
    legs: Iterable[PoweredLeg],
    *,
    mass: float,
    prior_sd: Sequence[float] = (),
    stated: ThrustLag | None = None,
) -> tuple[CoastDecay, ThrustScale]:
    """Return the drag of the coasts and the scale, each with the other's result.

    The thrust that fades after a stop is that of the vehicle file over its scale, with the
    `stated` lag or that which the powered legs show; what the lag errs by frees its size.
    Legs are gone through several times. Raises `DataError` for too few coasts, and where they
    determine no drag.
    """
    legs = list(legs)
    decay = fit_decay(records, prior_sd=prior_sd)
    if not np.isfinite(decay.drag).all():
        raise DataError("the coasts determine no drag", value=decay.drag.tolist())
    result = thrust_scale(legs, decay, mass=mass, stated=stated)
    for _ in range(MOST_ROUNDS):
        if not result.standard_error < DOUBTFUL * result.scale:
            break
        before, lag = result.scale, result.lag
        late = [record.at_lag(lag.lag_s, lag.delay_s) for record in records]
        decay = fit_decay(
            late, prior_sd=prior_sd, thrust_scale=before, fading_sd=_fading_sd(records, lag)
        )
        result = thrust_scale(legs, decay, mass=mass, stated=stated)
        if abs(result.scale - before) < SETTLED * result.standard_error:
            break
    return decay, result


def _fading_sd(records: Sequence[CoastRecord], lag: ThrustLag) -> float:
    """Return the share by which errors of a lag change what fades in coasts."""

    def faded(changed: ThrustLag) -> float:
        late = [record.at_lag(changed.lag_s, changed.delay_s) for record in records]
        return float(sum(np.sum(np.abs(item.fading)) for item in late))

    usual = faded(lag)
    if usual == 0.0:
        return FADING_SD
    return float(np.linalg.norm([faded(changed) / usual - 1.0 for changed in lag.errors]))


def thrust_scale(
    legs: Iterable[PoweredLeg],
    decay: CoastDecay,
    *,
    mass: float,
    stated: ThrustLag | None = None,
) -> ThrustScale:
    """Return the scale s of thrust = s (force - drag) + constant + shapes.

    drag = -m (d1 x + d2 x|x|) of the coasts, `mass` m the apparent mass of the axis, a
    constant per leg. By instrumental variables with the drag as instrument: it is
    smooth, so that noise of the acceleration in `force` does not pull s to 0. Errors:
    coloured ones of the samples, and the covariance of the coasts.
    """
    legs = list(legs)
    lag, law = stated or thrust_lag(legs, decay.current), decay.law
    fits = _Fits.of(legs, [law], mass, lag)
    scale = float(fits.solutions[0, 0])
    steps = np.diag(STEP * np.maximum(np.abs(law), 0.1))
    moved = _Fits.of(legs, list(law + steps), mass, lag)
    by_drag = (moved.solutions[:, 0] - scale) / steps.max(axis=1)
    noise = fits.variance(legs, law, mass, lag)
    variance = noise + float(by_drag @ decay.joint @ by_drag)
    return ThrustScale(scale, float(np.sqrt(variance)), lag, mass)


def thrust_lag(legs: Sequence[PoweredLeg], current: Array) -> ThrustLag:
    """Return by how much the thrust follows its command late.

    force = thrust, late, over s - D(x) + shapes + a constant of each leg, all but the lag by
    least squares: neither the drag of the coasts nor the curve's scale takes part.
    """
    errors, gains = _LagSums.of(legs, current).errors_and_gains()
    gain = float(gains[np.argmin(errors)])
    best = ThrustLag(_lowest(errors), 0.0, np.inf)
    information, score = 0.0, 0.0
    for leg in legs:
        lags = np.array([max(best.lag_s - LAG_STEP_S, 0.0), best.lag_s, best.lag_s + LAG_STEP_S])
        late, rest, force = _of_lag(leg, current, lags)
        design = np.column_stack([late[:, 1], rest])
        by_lag = gain * (late[:, 2] - late[:, 0]) / (lags[2] - lags[0])
        left_over, slope = (
            part - design @ np.linalg.lstsq(design, part, rcond=None)[0] for part in (force, by_lag)
        )
        information += float(slope @ slope)
        score += float(long_run((slope * left_over)[:, None])[0, 0])
    sd = np.sqrt(score) / information if information > 0.0 else np.inf
    return replace(best, sd_s=float(min(np.hypot(sd, LEAST_LAG_SD_S), LAGS_S[-1])))


def _lowest(errors: Array) -> float:
    """Return the lag [s] of the least error, by a parabola between those of LAGS_S."""
    best = int(np.argmin(errors))
    if 0 < best < errors.size - 1:
        left, middle, right = errors[best - 1 : best + 2]
        return float(LAGS_S[best] + 0.5 * LAG_STEP_S * (left - right) / (left - 2 * middle + right))
    return float(LAGS_S[best])


@dataclass(frozen=True)
class _LagSums:
    """Products of force, drag (k) and thrust at each lag (l) over all legs."""

    rest: Array
    rest_late: Array
    rest_force: Array
    late: Array
    late_force: Array
    force: float

    @classmethod
    def of(cls, legs: Sequence[PoweredLeg], current: Array) -> _LagSums:
        """Return the sums; a leg's late thrust is in memory at a time."""
        parts: list[tuple[Array, ...]] = []
        for leg in legs:
            late, rest, force = _of_lag(leg, current, LAGS_S)
            parts.append(
                (
                    rest.T @ rest,
                    rest.T @ late,
                    rest.T @ force,
                    np.einsum("nl,nl->l", late, late),
                    late.T @ force,
                    force @ force,
                )
            )
        return cls(*(np.sum(part, axis=0) for part in zip(*parts, strict=True)))

    def errors_and_gains(self) -> tuple[Array, Array]:
        """Return sums of squares (l,) and 1 / s (l,) of the fit with each lag."""
        inverse = np.linalg.pinv(self.rest)
        late = self.late - np.einsum("kl,kj,jl->l", self.rest_late, inverse, self.rest_late)
        both = self.late_force - self.rest_late.T @ inverse @ self.rest_force
        force = self.force - float(self.rest_force @ inverse @ self.rest_force)
        late = np.maximum(late, 1e-12 * np.max(self.late))
        return np.asarray(force - both**2 / late), np.asarray(both / late)


def _of_lag(leg: PoweredLeg, current: Array, lags_s: Array) -> tuple[Array, Array, Array]:
    """Return thrust at lags (n, l), drag (n, k), force (n,), each about its mean."""
    x = leg.speed - leg.drift @ current
    late = np.column_stack([_late(leg, ThrustLag(lag, 0.0, 0.0)) for lag in lags_s.tolist()])
    rest = np.column_stack([x, x * np.abs(x), leg.shapes])
    return late - late.mean(axis=0), rest - rest.mean(axis=0), leg.force - leg.force.mean()


def _late(leg: PoweredLeg, lag: ThrustLag) -> Array:
    """Return the thrust of a leg (n,) after its delay and its lag."""
    at = np.arange(leg.thrust.size, dtype=np.float64)
    delayed = np.interp(at - lag.delay_s / leg.step_s, at, leg.thrust)
    return first_order_lag(delayed, lag_s=lag.lag_s, step_s=leg.step_s)


@dataclass(frozen=True)
class _Fits:
    """Fits with d drags; a leg is in memory at a time.

    Unknowns: the scale, factors of the shapes, a constant for each leg. bread (d, k, k),
    solutions (d, k).
    """

    bread: Array
    solutions: Array

    @classmethod
    def of(
        cls, legs: Iterable[PoweredLeg], drags: Sequence[Array], mass: float, lag: ThrustLag
    ) -> _Fits:
        """Return the fits of legs with each drag."""
        products = []
        for leg in legs:
            late = _late(leg, lag)
            pairs = [_columns(leg, drag, mass) for drag in drags]
            products.append(
                (
                    np.array([instrument.T @ design for design, instrument in pairs]),
                    np.array([instrument.T @ late for _, instrument in pairs]),
                )
            )
        count, size = len(products), products[0][0].shape[-1]
        unknowns = size - 1 + count
        cross = np.zeros((len(drags), unknowns, unknowns))
        by_instrument = np.zeros((len(drags), unknowns))
        for index, (of_both, z_late) in enumerate(products):
            own = _places(size, index)
            cross[:, own[:, None], own] += of_both
            by_instrument[:, own] += z_late
        bread = np.array([np.linalg.pinv(each) for each in cross])
        return cls(bread, np.einsum("dkj,dj->dk", bread, by_instrument))

    def variance(
        self, legs: Iterable[PoweredLeg], drag: Array, mass: float, lag: ThrustLag
    ) -> float:
        """Return the variance of the scale with the first drag."""
        solution, bread = self.solutions[0], self.bread[0]
        moments = np.zeros_like(bread)
        for index, leg in enumerate(legs):
            design, instrument = _columns(leg, drag, mass)
            own = _places(design.shape[1], index)
            late = _late(leg, lag)
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

    >>> lag = ThrustLag(0.1, 0.0, 0.01)
    >>> axes = [ThrustScale(1.0, 0.03, lag, 20.0), ThrustScale(1.2, 0.03, lag, 20.0)]
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
