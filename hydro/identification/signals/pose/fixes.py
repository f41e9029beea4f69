"""Velocity from position fixes alone: acoustic positioning, sparse, with outliers.

Each horizontal coordinate p moves as a vehicle with drag does,

    p' = v,   v' = -v / tau + white noise,   RMS of v = sigma,   measured p + noise,

with noise, sigma and tau of largest likelihood under wide priors about what underwater
vehicles do: first Student's t, then normal over the fixes that pass a gate. Fixes too
coarse for a velocity so give one whose standard deviation comes up to sigma, and say so.
Nothing is filled across a pause.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Mask, runs_of
from auvid.hydro.constants import NORMAL_SPREAD

USUAL_SPEED, USUAL_LAG_S = 0.4, 3.0
PRIOR_SD = np.log([2.5, 3.0])
"""Standard deviations of the logarithms of sigma and tau."""
STUDENT, GATE = 4.0, 4.5
"""Degrees of freedom; errors over their deviation that are an outlier."""
MEDIAN, FASTEST, NOISIEST = 9, 12.0, 5.0
"""Fixes of a median; what a vehicle moves between two, in usual speeds and in noise."""
PATIENCE = 6
"""So many outliers in a row are another track."""
ROUNDS = 8
FEWEST = 12
LONGEST_PAUSE_S = 15.0
LEAST_NOISE_M = 1e-4
FITTED_FIXES = 3000
COARSE = 0.4
"""Standard deviation of the velocity over its RMS, beyond which nothing is fitted to it."""
EARTH_M = 6371008.8


@dataclass(frozen=True)
class FixTrack:
    """Velocity north, east (n, 2) [m/s] with deviations at the fixes kept, t_s (n,).

    position (n, 2) [m]; `noise_m` of a fix, `speed` (RMS) and `lag_s` of each
    coordinate (2,); `outliers` and `repeats`: fixes left out; `begins` (n,): where a
    pause or a jump ended.
    """

    t_s: Array
    position: Array
    velocity: Array
    velocity_sd: Array
    noise_m: Array
    speed: Array
    lag_s: Array
    outliers: int
    repeats: int
    begins: Mask

    @property
    def coarseness(self) -> float:
        """Return the deviation of the velocity over its RMS, of both coordinates."""
        deviation = float(np.sqrt(np.mean(self.velocity_sd**2)))
        # What is known of v has less scatter than v by what is not.
        rms = float(np.sqrt(np.mean(self.velocity**2) + deviation**2))
        return deviation / max(rms, 1e-12)

    @property
    def smoothed_s(self) -> float:
        """Return the time [s] over which the velocity is smoothed, the longer of two.

        Of noise R each step dt against white acceleration q it is (R dt / q)^(1/4).
        """
        step_s = float(np.median(np.diff(self.t_s)))
        acceleration = 2.0 * self.speed**2 / self.lag_s
        return float(np.max(self.noise_m**2 * step_s / acceleration) ** 0.25)

    @property
    def too_coarse(self) -> bool:
        """Return whether the fixes tell no velocity worth fitting to."""
        return self.coarseness > COARSE


def metres_from_degrees(latitude_rad: Array, longitude_rad: Array) -> Array:
    """Return north and east (n, 2) [m] of the first finite fix, on a sphere.

    Nan without a fix, and where both angles are 0.

    >>> metres_from_degrees(np.radians([63.0, 63.001]), np.radians([10.0, 10.0]))[1].round(1)
    array([111.2,   0. ])
    """
    # Receivers report 0, 0 before their first fix.
    nowhere = (latitude_rad == 0.0) & (longitude_rad == 0.0)
    latitude_rad, longitude_rad = (
        np.where(nowhere, np.nan, angle) for angle in (latitude_rad, longitude_rad)
    )
    first = int(np.argmax(np.isfinite(latitude_rad + longitude_rad)))
    north = EARTH_M * (latitude_rad - latitude_rad[first])
    east = EARTH_M * np.cos(latitude_rad[first]) * (longitude_rad - longitude_rad[first])
    return np.column_stack([north, east])


def fix_track(t_s: Array, position: Array) -> FixTrack:
    """Return the velocity of fixes (n, 2) north, east [m] at increasing times t_s (n,).

    Raises `DataError` for fewer than `FEWEST` fixes, and for fixes that never move.
    """
    good = np.isfinite(position).all(axis=1)
    t, y = t_s[good], position[good]
    fresh = np.append(t.size > 0, (np.diff(y, axis=0) != 0.0).any(axis=1))[: t.size]
    t, y = t[fresh], y[fresh]
    if t.size < FEWEST:
        raise DataError(
            "too few fixes for a velocity", value=int(t.size), allowed=f"{FEWEST} and more"
        )
    used = np.ones(t.size, dtype=np.bool_)
    begins = np.append(True, np.diff(t) > LONGEST_PAUSE_S) | _jumps(t, y)
    sizes = [_fitted(t, y[:, axis], used, begins, STUDENT) for axis in range(2)]
    used, begins = _gate(t, y, begins, sizes)
    sizes = [_fitted(t, y[:, axis], used, begins, 0.0) for axis in range(2)]
    smoothed = [
        _smoothed(t, y[:, axis], used, begins, sizes[axis], robust=False) for axis in range(2)
    ]
    keep = used
    states = np.stack([item[0][keep] for item in smoothed], axis=1)
    variance = np.stack([item[1][keep, 1, 1] for item in smoothed], axis=1)
    return FixTrack(
        t[keep],
        states[:, :, 0],
        states[:, :, 1],
        np.sqrt(np.maximum(variance, 0.0)),
        np.array([size[0] for size in sizes]),
        np.array([size[1] for size in sizes]),
        np.array([size[2] for size in sizes]),
        int(np.count_nonzero(~used)),
        int(np.count_nonzero(~fresh)),
        begins[keep],
    )


def _smoothed(
    t: Array, y: Array, used: Mask, begins: Mask, size: tuple[float, ...], *, robust: bool
) -> tuple[Array, Array]:
    """Return x (n, 2), P (n, 2, 2); robust: fixes far off weigh as Student's t says."""
    # numba: a second to import
    from auvid.hydro.identification.signals.pose.compiled_fixes import filter_and_smooth

    noise, speed, lag = size
    column, weight = np.ascontiguousarray(y), np.ones(t.size)
    for _ in range(ROUNDS if robust else 1):
        x, P = filter_and_smooth(t, column, used, begins, noise**2 * weight, speed, lag)
        ratio = (column - x[:, 0]) ** 2 / noise**2
        weight = np.maximum((STUDENT + ratio) / (STUDENT + 1.0), 1.0)
    return x, P


def _gate(t: Array, y: Array, begins: Mask, sizes: list[tuple[float, ...]]) -> tuple[Mask, Mask]:
    """Return which fixes are used, and where a track begins.

    An outlier is off the place that its neighbours lead to; many in a row are a jump.
    """
    everything = np.ones(t.size, dtype=np.bool_)
    odd = np.zeros(t.size, dtype=np.bool_)
    for axis, size in enumerate(sizes):
        x, P = _smoothed(t, y[:, axis], everything, begins, size, robust=True)
        odd |= np.abs(y[:, axis] - x[:, 0]) > GATE * np.sqrt(P[:, 0, 0] + size[0] ** 2)
    used = ~odd
    for first, last in runs_of(odd):
        if last - first >= PATIENCE:
            used[first:last] = True
            begins[first] = True
            if last < t.size:
                begins[last] = True
    return used, begins


def _jumps(t: Array, y: Array) -> Mask:
    """Return where the medians of the place leap further than a vehicle swims."""
    result = np.zeros(t.size, dtype=np.bool_)
    at = np.arange(MEDIAN, t.size - MEDIAN)
    if not at.size:
        return result
    middle = np.median(np.lib.stride_tricks.sliding_window_view(y, MEDIAN, axis=0), axis=2)
    times = np.median(np.lib.stride_tricks.sliding_window_view(t, MEDIAN), axis=1)
    swims = FASTEST * USUAL_SPEED * (times[at] - times[at - MEDIAN])
    allowed = swims[:, None] + NOISIEST * np.array([_scatter(column) for column in y.T])
    leaps = np.zeros(t.size)
    leaps[at] = np.max(np.abs(middle[at] - middle[at - MEDIAN]) / allowed, axis=1)
    while leaps.max(initial=0.0) > 1.0:
        worst = int(np.argmax(leaps))
        near = np.arange(max(worst - MEDIAN, 3), min(worst + MEDIAN, t.size - 3))
        steps = [
            np.abs(np.median(y[i : i + 3], axis=0) - np.median(y[i - 3 : i], axis=0)).max()
            for i in near
        ]
        result[near[int(np.argmax(steps))]] = True
        leaps[max(worst - 2 * MEDIAN, 0) : worst + 2 * MEDIAN + 1] = 0.0
    return result


def _scatter(y: Array) -> float:
    """Return the noise of a coordinate [m] by its second differences."""
    second = np.abs(np.diff(y, 2))
    return max(NORMAL_SPREAD * float(np.median(second)) / float(np.sqrt(6.0)), LEAST_NOISE_M)


def _fitted(t: Array, y: Array, used: Mask, begins: Mask, dof: float) -> tuple[float, ...]:
    """Return noise [m], sigma [m/s] and tau [s] of one coordinate."""
    from scipy.optimize import minimize

    from auvid.hydro.identification.signals.pose.compiled_fixes import misfit

    # The stretch that moves most: a vehicle may wait at the start for as long.
    firsts = range(0, t.size, FITTED_FIXES)
    first_row = max(firsts, key=lambda i: float(np.std(y[i : i + FITTED_FIXES])))
    rows = slice(first_row, first_row + FITTED_FIXES)
    anew = begins[rows].copy()
    anew[0] = True
    at, values = t[rows], np.ascontiguousarray(y[rows])
    usual = np.log([USUAL_SPEED, USUAL_LAG_S])
    scatter = _scatter(values)

    def cost(logs: Array) -> float:
        logs = np.clip(logs, [np.log(LEAST_NOISE_M), -7.0, -2.0], [7.0, 3.0, 6.0])
        prior = float(np.sum(((logs[1:] - usual) / PRIOR_SD) ** 2))
        noise, speed, lag = np.exp(logs)
        value = misfit(at, values, used[rows], anew, noise, speed, lag, dof)
        return float(value) + 0.5 * prior

    starts = [np.array([np.log(scatter * share), *usual]) for share in (1.0, 0.2)]
    first = min(starts, key=cost)
    simplex = first + np.array([[0, 0, 0], [-0.7, 0, 0], [0, 0.7, 0], [0, 0, 0.7]])
    options = {"xatol": 0.01, "fatol": 0.01, "maxfev": 300, "initial_simplex": simplex}
    best = minimize(cost, first, method="Nelder-Mead", options=options).x
    best = np.clip(best, [np.log(LEAST_NOISE_M), -7.0, -2.0], [7.0, 3.0, 6.0])
    return tuple(float(value) for value in np.exp(best))
