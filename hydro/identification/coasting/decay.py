"""Drag over apparent mass from coasts, pooled: no thrust model takes part.

x' = -(d1 x + d2 x|x|) + a(t) + c(t) + sum_k b_k g_k(t)

x: one velocity [m/s, rad/s] through the water; d1 [1/s] and d2 [1/m, 1/rad]: drag over
apparent mass; a: the acceleration that the equation of motion has (Coriolis, weight and
buoyancy, the other axes), over that mass; c: what the water and the tether do, a constant
of each coast and an unsteady part, both with sizes by likelihood; b_k: shapes whose size is
pooled under a prior around 0 (net buoyancy that nobody measured, thrust that lags). What is
measured is x and the steady current along the axis, pooled under a prior around 0, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Ints
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.identification.regression.standard_errors import widened_by

LEAST_COASTS = 3
"""With fewer nothing says how coasts differ."""
LEAST_SAMPLES = 6
"""Samples of a coast; most are thinned to `MOST_SAMPLES` means, as x changes slowly."""
MOST_SAMPLES = 50
UNSTEADY_S = 1.0
"""Correlation time of the unsteady force; see decision 0034."""
LONGEST_STEP_S = 0.02
STEPS = 40
SMALLEST_LARGEST = -12.0, 3.0
"""Of the logarithms of sizes."""
SETTLED = 1e-5
FIRST = (0.5, 3.0)
"""d1 and d2 from which the fit starts; 0.5 to 3 of them are those of small vehicles."""
FADING_SD, OWN_FADING_SD = 0.5, 0.3
"""Spreads of the thrust that acts after the stop, as shares of what is expected: of all
coasts together (a lag that nothing tells) and of each (when between two samples it stopped)."""
ODD_COAST = 5.0
"""Mean squared error of a coast over the median of all, beyond which it is another
matter: the bottom, a taut tether."""
ODD_PUSH = 8.0
"""Constant of a coast over the median of all, beyond which something holds it."""
PULLED_BACK = 0.4
"""Speed backwards, as a share of that at the start, which no drag makes."""
USUAL_CURRENT_M_S = 0.15
"""Standard deviation of a steady current, north and east, before the coasts are looked at."""
ODD_SHARE = 1 / 3
"""Of coasts, at most so many are left out as odd."""


@dataclass(frozen=True)
class CoastRecord:
    """Samples of one coast: x (n,) at t_s (n,), the modelled acceleration a (n,).

    `shapes` (n, k): g_k of the module; `fading` (n,): acceleration of thrust that lags
    after the stop, as the vehicle file has it; `drive` (k, 2): times and acceleration of
    the thrust without its lag, on a uniform clock that begins before the stop. `drift`
    (q,): share of each component of the currents that lies along the axis, none where x is
    through the water.
    """

    t_s: Array
    speed: Array
    modelled: Array
    shapes: Array
    fading: Array
    drift: Array = field(default_factory=lambda: np.zeros(0))
    drive: Array | None = None

    def at_lag(self, lag_s: float, delay_s: float) -> CoastRecord:
        """Return the record with what fades of `drive` after a delay and at a lag."""
        if self.drive is None:
            return self
        t_s, thrust = self.drive.T
        late = first_order_lag(thrust, lag_s=lag_s, step_s=float(t_s[1] - t_s[0]))
        return replace(self, fading=np.interp(self.t_s - delay_s, t_s, late))

    def with_fading(self, thrust_scale: float) -> CoastRecord:
        """Return the record with what fades over the scale, as the last shape, too."""
        fading = self.fading / thrust_scale
        shapes = np.column_stack([self.shapes, fading])
        return replace(self, shapes=shapes, fading=fading)

    def thinned(self) -> CoastRecord:
        """Return means of neighbours, at most `MOST_SAMPLES` of them."""
        size = -(-self.t_s.size // MOST_SAMPLES)
        if size == 1:
            return self
        count = self.t_s.size // size * size

        def means(values: Array) -> Array:
            parts = values[:count].reshape(count // size, size, *values.shape[1:])
            return np.asarray(parts.mean(axis=1))

        return CoastRecord(
            means(self.t_s),
            means(self.speed),
            means(self.modelled),
            means(self.shapes),
            means(self.fading),
            self.drift,
        )


@dataclass(frozen=True)
class CoastDecay:
    """Drag over mass `drag` (2,), d1 and d2, with covariance `covariance` (2, 2).

    `current` (q,) [m/s]: components of the currents; `joint` (2 + q, 2 + q): covariance of
    drag and currents. It is that of how coasts differ, in no direction less than noise
    makes; 1.96 of its standard errors are half of the 95 % interval, by Student's t of so
    few coasts.

    `start_speed` (m,): speed through the water at the start of each coast; `sizes` (k,) of
    the shapes; `noise`: standard deviations of a sample, of the constant of a coast and of
    the unsteady acceleration; `used` and `odd`: which records were taken and which were left
    out. `simulated`: x of each record taken, at its samples.
    """

    drag: Array
    current: Array
    joint: Array
    start_speed: Array
    sizes: Array
    noise: tuple[float, float, float]
    used: Ints
    odd: Ints
    simulated: tuple[Array, ...]

    @property
    def law(self) -> Array:
        """Return drag and currents (2 + q,)."""
        return np.append(self.drag, self.current)

    @property
    def covariance(self) -> Array:
        """Return the covariance (2, 2) of the drag."""
        return self.joint[:2, :2]

    @property
    def coasts(self) -> int:
        """Return how many coasts were taken."""
        return self.used.size

    @property
    def reference_speed(self) -> float:
        """Return the speed at which the coasts tell most: half of their RMS start."""
        return float(0.5 * np.sqrt(np.mean(self.start_speed**2)))

    def rate(self, speed: float) -> tuple[float, float]:
        """Return (d1 + d2 x) at a speed [1/s] and its standard error."""
        by = np.array([1.0, speed])
        return float(by @ self.drag), float(np.sqrt(by @ self.covariance @ by))


def fit_decay(
    records: Sequence[CoastRecord],
    *,
    prior_sd: Sequence[float] = (),
    thrust_scale: float = 1.0,
    fading_sd: float = FADING_SD,
) -> CoastDecay:
    """Fit the drag over mass of one axis to coasts; `prior_sd` (k,) of the shapes.

    What fades after the stop counts over `thrust_scale`, give or take a share `fading_sd`.

    Generalised least squares: a coast's error is noise of its samples and what the
    constant and the unsteady force of that coast do to x. Coasts whose error is
    `ODD_COAST` times that of the others are left out. Raises `DataError` for fewer than
    `LEAST_COASTS` coasts.
    """
    thin = [record.thinned() for record in records]
    long = [record.t_s.size >= LEAST_SAMPLES for record in thin]
    odd = [index for index, record in enumerate(thin) if long[index] and _pulled_back(record)]
    used = np.array([index for index in np.flatnonzero(long) if index not in odd], dtype=np.int64)
    while True:
        if used.size < LEAST_COASTS:
            raise DataError("too few coasts", value=used.size, allowed=f"{LEAST_COASTS} and more")
        problem = _Problem(
            [thin[index].with_fading(thrust_scale) for index in used],
            np.concatenate([prior_sd, [fading_sd], np.full(thin[0].drift.size, USUAL_CURRENT_M_S)]),
        )
        fitted, misfit = problem.fit()
        push = np.abs(fitted.constants)
        usual = max(float(np.median(push)), fitted.noise[2])
        oddness = np.maximum(
            misfit / (ODD_COAST * max(float(np.median(misfit)), 1.0)), push / (ODD_PUSH * usual)
        )
        worst, most = int(np.argmax(oddness)), int(ODD_SHARE * len(thin))
        if oddness[worst] < 1.0 or len(odd) >= most or used.size <= LEAST_COASTS:
            break
        odd.append(int(used[worst]))
        used = np.delete(used, worst)
    return CoastDecay(
        fitted.drag,
        fitted.current,
        fitted.covariance * widened_by(used.size - 1) ** 2,
        fitted.start_speed,
        fitted.sizes,
        fitted.noise,
        used,
        np.array(odd, dtype=np.int64),
        fitted.simulated,
    )


def _pulled_back(record: CoastRecord) -> bool:
    ahead = record.speed * np.sign(record.speed[0])
    drift = USUAL_CURRENT_M_S * float(np.linalg.norm(record.drift))
    return bool(np.min(ahead) < -PULLED_BACK * ahead[0] - drift)


@dataclass(frozen=True)
class _Solution:
    drag: Array
    current: Array
    covariance: Array
    start_speed: Array
    constants: Array
    sizes: Array
    noise: tuple[float, float, float]
    simulated: tuple[Array, ...]


@dataclass(frozen=True)
class _Errors:
    """Errors (n,), Jacobians (n, p) and responses (n, n) to accelerations, by coast."""

    error: list[Array]
    jacobian: list[Array]
    response: list[Array]

    @property
    def finite(self) -> bool:
        """Tell whether every coast stays finite, with all its derivatives."""
        return all(
            np.isfinite(part).all() for part in (*self.error, *self.jacobian, *self.response)
        )


class _Problem:
    """The coasts of an axis with unknowns: d1, d2, b_k, currents, x(0) and c of each.

    Constants stand among the unknowns, under a prior whose size is fitted: the speed to
    which a push of its own brings a coast is far from linear in it.
    """

    def __init__(self, records: Sequence[CoastRecord], prior_sd: Array) -> None:
        self.records, self.prior_sd = records, prior_sd
        self.shared = 2 + prior_sd.size
        self.currents = self.shared - records[0].drift.size
        self.constants = self.shared + len(records)
        self.unsteady = [
            np.exp(-np.abs(item.t_s[:, None] - item.t_s) / UNSTEADY_S) for item in records
        ]
        share = OWN_FADING_SD**2
        self.fading = [share * np.outer(item.fading, item.fading) for item in records]

    def fit(self) -> tuple[_Solution, Array]:
        """Return the solution, and whitened mean squared errors (m,) of the coasts."""
        shared = self.shared
        unknown = np.concatenate(
            [
                FIRST,
                np.zeros(shared - 2),
                [record.speed[0] for record in self.records],
                np.zeros(len(self.records)),
            ]
        )
        sizes = np.log([0.01, 0.02, 0.02])
        moved = self._errors(unknown)
        for step in range(STEPS):
            parts = moved
            if step in (0, 3, 6):
                sizes = self._noise(parts, sizes, unknown)
            normal, score, scores, misfit = self._normal(parts, sizes, unknown)
            change = np.linalg.solve(normal, score)
            change /= max(1.0, float(np.max(np.abs(change[:2]) / FIRST)))
            moved = self._errors(unknown - change)
            while not moved.finite:  # drag that pushes makes a speed run away
                change /= 2.0
                moved = self._errors(unknown - change)
            unknown = unknown - change
            if step > 6 and float(np.max(np.abs(change))) < SETTLED:
                break
        inverse: Array = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        count = len(self.records)
        middle = np.sum([np.outer(item, item) for item in scores], axis=0)
        clustered = inverse @ middle @ inverse * count / (count - 1)
        law = np.r_[0:2, self.currents : shared]
        covariance = _not_below(clustered[np.ix_(law, law)], inverse[np.ix_(law, law)])
        noise, constant, unsteady = np.exp(sizes).tolist()
        simulated = tuple(
            record.speed + error for record, error in zip(self.records, parts.error, strict=True)
        )
        current = unknown[self.currents : shared]
        drift = np.array([record.drift for record in self.records])
        return _Solution(
            unknown[:2],
            current,
            covariance,
            unknown[shared : self.constants] - drift @ current,
            unknown[self.constants :],
            unknown[2 : self.currents],
            (noise, constant, unsteady),
            simulated,
        ), misfit

    def _errors(self, unknown: Array) -> _Errors:
        """Return simulated minus measured x with derivatives.

        A change of acceleration at s moves x(t) by S(t) / S(s), S the derivative of x by
        x(0); trapezoids over the samples. A current moves x and takes its part from x(0).
        """
        from auvid.hydro.identification.bench.compiled_loops import simulate_single

        shared, out = self.shared, _Errors([], [], [])
        for index, record in enumerate(self.records):
            drift = float(record.drift @ unknown[self.currents : shared])
            own = record.shapes @ unknown[2 : self.currents]
            force = record.modelled + record.fading + own
            states = simulate_single(
                np.diff(record.t_s),
                np.ascontiguousarray(force[:-1]),
                np.ascontiguousarray(force[1:]),
                np.array([-unknown[0], -unknown[1], 1.0, 0.0, unknown[self.constants + index]]),
                np.array([unknown[shared + index] - drift, 0.0]),
                LONGEST_STEP_S,
            )
            x, by_start = states[:, 0], states[:, 12]
            half = 0.5 * np.diff(record.t_s)
            weights = np.tril(np.tile(np.append(half, 0.0) + np.append(0.0, half), (x.size, 1)))
            weights[np.diag_indices(x.size)] = np.append(0.0, half)
            with np.errstate(all="ignore"):
                response = by_start[:, None] * weights / by_start
            jacobian = np.zeros((x.size, unknown.size))
            jacobian[:, 0], jacobian[:, 1] = -states[:, 2], -states[:, 4]
            jacobian[:, 2 : self.currents] = response @ record.shapes
            jacobian[:, self.currents : shared] = np.outer(1.0 - by_start, record.drift)
            jacobian[:, shared + index] = by_start
            jacobian[:, self.constants + index] = states[:, 10]
            out.error.append(x + drift - record.speed)
            out.jacobian.append(jacobian)
            out.response.append(response)
        return out

    def _covariances(self, parts: _Errors, sizes: Array) -> list[Array]:
        noise, _, unsteady = np.exp(2.0 * sizes)
        return [
            noise * np.eye(len(response)) + response @ (unsteady * colour + fading) @ response.T
            for response, colour, fading in zip(
                parts.response, self.unsteady, self.fading, strict=True
            )
        ]

    def _noise(self, parts: _Errors, first: Array, unknown: Array) -> Array:
        """Return logarithms of the three sizes of restricted maximum likelihood."""
        from scipy.optimize import minimize

        # In the axes of the unsteady force each coast has noise and one direction: fading.
        axes = [
            np.linalg.eigh(response @ colour @ response.T)
            for response, colour in zip(parts.response, self.unsteady, strict=True)
        ]
        spread = np.concatenate([values for values, _ in axes])
        J, error, faded = (
            np.concatenate(
                [vectors.T @ part for (_, vectors), part in zip(axes, each, strict=True)]
            )
            for each in (
                parts.jacobian,
                parts.error,
                [
                    OWN_FADING_SD * (response @ record.fading)
                    for response, record in zip(parts.response, self.records, strict=True)
                ],
            )
        )
        first_row = np.cumsum([0, *(values.size for values, _ in axes[:-1])])

        def unlikely(sizes: Array) -> float:
            sizes = np.clip(sizes, *SMALLEST_LARGEST)
            noise, _, unsteady = np.exp(2.0 * sizes)
            prior = self._prior(sizes)
            variance = noise + unsteady * np.maximum(spread, 0.0)
            weighted = faded / variance
            # (D + b b')^-1 of each coast, Sherman and Morrison 1950.
            own = 1.0 + np.add.reduceat(weighted * faded, first_row)
            by_coast = np.add.reduceat(weighted[:, None] * J, first_row)
            off = np.add.reduceat(weighted * error, first_row)
            normal = np.diag(prior) + J.T @ (J / variance[:, None])
            normal -= by_coast.T @ (by_coast / own[:, None])
            score = prior * unknown + J.T @ (error / variance) - by_coast.T @ (off / own)
            value = float(prior @ unknown**2 + error @ (error / variance) - off @ (off / own))
            value += float(np.log(variance).sum() + np.log(own).sum())
            value += float(np.linalg.slogdet(normal)[1] - score @ np.linalg.solve(normal, score))
            return 0.5 * value + len(self.records) * float(sizes[1])

        options = {"maxiter": 80, "xatol": 0.02, "fatol": 0.01}
        best = minimize(unlikely, first, method="Nelder-Mead", options=options)
        return np.asarray(np.clip(best.x, *SMALLEST_LARGEST))

    def _prior(self, sizes: Array) -> Array:
        """Return the weights of the unknowns around 0."""
        weights = np.zeros(self.constants + len(self.records))
        weights[2 : self.shared] = self.prior_sd**-2.0
        weights[self.constants :] = np.exp(-2.0 * sizes[1])
        return weights

    def _normal(
        self, parts: _Errors, sizes: Array, unknown: Array
    ) -> tuple[Array, Array, list[Array], Array]:
        """Return normal matrix, score, its part of each coast, and misfits (m,).

        A constant's prior belongs to its coast.
        """
        prior = self._prior(sizes)
        normal, scores, misfit = np.diag(prior), [], []
        for index, (covariance, error, jacobian) in enumerate(
            zip(self._covariances(parts, sizes), parts.error, parts.jacobian, strict=True)
        ):
            white = np.linalg.solve(covariance, np.column_stack([jacobian, error]))
            normal = normal + jacobian.T @ white[:, :-1]
            own = jacobian.T @ white[:, -1]
            own[self.constants + index] += (
                prior[self.constants + index] * (unknown[self.constants + index])
            )
            scores.append(own)
            misfit.append(float(error @ white[:, -1]) / error.size)
        shapes = np.where(np.arange(unknown.size) < self.shared, prior * unknown, 0.0)
        return normal, shapes + np.sum(scores, axis=0), scores, np.array(misfit)


def _not_below(covariance: Array, least: Array) -> Array:
    """Return a covariance that is in no direction smaller than another.

    Few coasts scatter less than they might: the sizes of the noise, which all of them
    share, then say more than how coasts differ.
    """
    root = np.linalg.cholesky(least)
    ratio = np.linalg.solve(root, np.linalg.solve(root, covariance).T)
    size, vectors = np.linalg.eigh(0.5 * (ratio + ratio.T))
    larger = root @ vectors
    return np.asarray((larger * np.maximum(size, 1.0)) @ larger.T)
