"""Drag in newtons from a body that is towed, steadily or not.

The equation of motion along the tow, integrated over windows of a few seconds, so that
no speed is differentiated:

    int T dt = m (x_end - x_begin) + D_1 int x dt + D_2 int x|x| dt

T: tow force on the body [N]; x: speed through the water [m/s]; m: apparent mass [kg];
D_1 [N s/m], D_2 [N s^2/m^2]: drag, positive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Index
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.regression.standard_errors import widened_by

WINDOW_S = 4.0
ENDS_S = 0.4
"""The speed at either end of a window is the mean over so long."""
LEAST_WINDOWS = 6
CLUSTER, SAME_SPEED = 2, 0.1
"""Windows in a row whose errors count as one, at least; more at one speed, within this part of
it: there they share what the form of the drag misses."""
LEAST_RATIO = 1.6
"""Fastest over slowest window; below it linear and quadratic drag are one figure."""
LEAST_SPEED = 0.05
SLACK, CLEAR = 1e-3, 2.0
"""Mean force as a share of the weight, below which a line may be slack; it is where the
force is no more than so many of its standard errors."""
LATEST_S, LATE_STEP_S, LEAST_LATE_S = 4.0, 0.25, 0.5
"""How late a force is looked for, and what is told at least."""
BEFORE_S, AFTER_S = 2.0 * LATEST_S, LATEST_S
"""What a record for `force_delay` has around its tow."""
LATE, LATE_BY_ITSELF = 2.0, 4.0
"""Error of the force as it is logged over that at the best delay, in squares, from which on it
is late: 1.8 and less in 160 sound tows. By themselves, without what is around them, steady
ones have nothing but noise to tell it by."""
FASTEST_CURRENT_M_S, LARGEST_ASTERN, BOTH_WAYS, DISAGREE, AS_LIKELY = 0.6, 0.96, 3, 4.0, 1.5
"""Currents and shares of the drag that are tried, windows each way that tell one, and the
same ratio of errors: 1.0 in 20 of 20 tows both ways in still water, 31 and more in 3 cm/s;
and that to the best explanation, within which another is one as well."""
EXPONENTS = np.linspace(0.8, 2.8, 81)
"""Of drag by a power of the speed, c x^n: what linear and quadratic drag may miss."""


@dataclass(frozen=True)
class TowRecord:
    """One tow: speed (n,) [m/s] and tow force (n,) [N] at uniform t_s (n,)."""

    t_s: Array
    speed: Array
    force_N: Array


@dataclass(frozen=True)
class BothWays:
    """What tows ahead and astern may differ by, each by itself; 0 where it does not.

    A current along them [m/s], an offset of their force [N], and by what share drag is
    larger astern than ahead.
    """

    current_m_s: float = 0.0
    offset_N: float = 0.0
    astern: float = 0.0

    @property
    def causes(self) -> int:
        """Return how many explanations there are."""
        return sum(value != 0.0 for value in (self.current_m_s, self.offset_N, self.astern))


@dataclass(frozen=True)
class TowFit:
    """Apparent mass, D_1, D_2 `values` (3,), covariance (3, 3), speeds of the windows.

    1.96 standard errors are half of the 95 % interval, of Student's t by clusters of windows.
    `free`: which of the three the tows tell; a mass that is not free is the prior's.
    `power`: c and n of c x^n, where drag by a power leaves less; no form of the file.
    `held_out`: share of the force's scatter about its mean that a fit to the other half of
    the windows predicts.
    """

    values: Array
    covariance: Array
    free: tuple[bool, bool, bool]
    speeds: Array
    forces_N: Array
    residual_N: float
    held_out: float
    power: tuple[float, float] | None = None

    def drag(self, speed: float) -> tuple[float, float]:
        """Return the drag at a speed [N] and its error, by noise and by form."""
        by = np.array([0.0, speed, speed * abs(speed)])
        drag, form = float(by @ self.values), 0.0
        if self.power is not None:
            form = float(self.power[0] * np.sign(speed) * abs(speed) ** self.power[1]) - drag
        return drag, float(np.hypot(np.sqrt(by @ self.covariance @ by), form))


def fit_tow(tows: Sequence[TowRecord], *, mass_kg: float, mass_sd_kg: float) -> TowFit:
    """Fit drag and apparent mass; the mass under a prior, drag never negative.

    Covariance clustered by pairs of windows, and by steady speeds. Raises `DataError` for
    fewer than `LEAST_WINDOWS` windows that move, for a line that is slack, and for a force
    against the motion.
    """
    rows, target = _windows(tows)
    _check_taut(tows, rows, target, SLACK * STANDARD_GRAVITY * mass_kg)
    if target.size < LEAST_WINDOWS:
        raise DataError(
            "too short a tow",
            value=f"{target.size} windows of {WINDOW_S:g} s that move",
            allowed=f"{LEAST_WINDOWS} and more",
        )
    sign = float(np.mean(np.sign(target) == np.sign(rows[:, 1])))
    if sign < 0.5:
        raise DataError(
            "the tow force acts against the motion",
            value=f"in {1 - sign:.0%} of the windows",
            remedy="Turn its sign in the column map: tow_force_N pulls forward where positive.",
        )
    speed = np.abs(rows[:, 1])
    wide = float(np.max(speed) / np.min(speed)) >= LEAST_RATIO
    candidates = [(0, 1, 2), (0, 2), (0, 1)] if wide else [(0, 2)]
    for columns in candidates:
        values, covariance, error = _solve(rows, target, columns, mass_kg, mass_sd_kg)
        if np.all(values[1:] >= 0.0):
            break
    used = len(columns)
    halves = [np.arange(target.size) % 2 == which for which in (0, 1)]
    missed = np.concatenate(
        [
            target[half] - rows[half] @ _solve(rows[~half], target[~half], columns, mass_kg,
                                               mass_sd_kg)[0]
            for half in halves
        ]
    )  # fmt: skip
    about = float(np.sum((target - target.mean()) ** 2))
    mass_is_free = bool(np.sqrt(covariance[0, 0]) < 0.7 * mass_sd_kg)
    return TowFit(
        values,
        covariance * widened_by(len(clusters(rows[:, 1], used)) - used) ** 2,
        (mass_is_free, 1 in columns, 2 in columns),
        rows[:, 1],
        target,
        float(np.sqrt(np.mean(error**2))),
        1.0 - float(np.sum(missed**2)) / about if about > 0.0 else float("nan"),
        _power(rows, target, error) if wide else None,
    )


def force_delay(tows: Sequence[TowRecord]) -> float:
    """Return how late the force is logged [s], 0 where no delay is clear.

    Negative where it is early. Only speed that changes tells it: `BEFORE_S` before a tow and
    `AFTER_S` after it belong to its record, as the body is set in motion and let go there.
    """
    delays, lates, errors = np.arange(-LATEST_S, LATEST_S + 0.1, LATE_STEP_S), [], []
    for delay in delays:
        moved = []
        for tow in tows:
            step = float(tow.t_s[1] - tow.t_s[0])
            margin, late = round(LATEST_S / step), round(float(delay) / step)
            last = tow.t_s.size - margin
            if last <= margin:
                continue
            # The same windows at each delay: those that have a force at all of them.
            gaps = np.convolve(~np.isfinite(tow.force_N), np.ones(2 * margin + 1), "valid") > 0.5
            inner, own = slice(margin, last), slice(margin + late, last + late)
            speed = np.where(gaps, np.nan, tow.speed[inner])
            moved.append(TowRecord(tow.t_s[inner], speed, tow.force_N[own]))
        rows, target = _windows(moved)
        if target.size < LEAST_WINDOWS:
            return 0.0
        errors.append(_mean_square(rows, target))
        lates.append(late * step)
    best = int(np.argmin(errors))
    surrounded = any(np.isfinite(tow.force_N[[0, -1]]).all() for tow in tows)
    limit = LATE if surrounded else LATE_BY_ITSELF
    is_late = errors[delays.size // 2] > limit * errors[best]
    return lates[best] if is_late and abs(delays[best]) >= LEAST_LATE_S else 0.0


def both_ways(tows: Sequence[TowRecord]) -> BothWays:
    """Return what tows ahead and astern differ by, nothing where they agree.

    Tows one way tell none of it from drag. A current is one along the tows, drag by the
    speed through the water; a hull whose drag is another astern has all of it larger by a
    share. An explanation that leaves `AS_LIKELY` times as much as the best one is none.
    """
    rows, target = _windows(tows)
    back = rows[:, 1] < 0.0
    if min(back.sum(), (~back).sum()) < BOTH_WAYS or target.size < LEAST_WINDOWS:
        return BothWays()

    def with_current(current: float) -> float:
        own = [replace(tow, speed=tow.speed - current) for tow in tows]
        moved, force = _windows(own)
        return _mean_square(moved, force) if 2 * force.size > target.size else np.inf

    def with_astern(share: float) -> float:
        drag = np.where(back, 1.0 + share, 1.0)[:, None]
        return _mean_square(np.column_stack([rows[:, :1], rows[:, 1:] * drag]), target)

    current = _lowest_at(with_current, FASTEST_CURRENT_M_S)
    astern = _lowest_at(with_astern, LARGEST_ASTERN)
    with_constant = np.column_stack([rows, np.ones(target.size)])
    offset = float(np.linalg.lstsq(with_constant, target, rcond=None)[0][3])
    errors = np.array(
        [with_current(current), _mean_square(with_constant, target), with_astern(astern)]
    )
    if _mean_square(rows, target) <= DISAGREE * errors.min():
        return BothWays()
    likely = errors < AS_LIKELY * errors.min()
    return BothWays(*np.where(likely, [current, offset, astern], 0.0).tolist())


def _lowest_at(error: Callable[[float], float], largest: float) -> float:
    """Return where an error is least between -largest and largest."""
    at, step = 0.0, largest / 12.0
    tried = np.arange(-largest, largest + 0.5 * step, step)
    for _ in range(3):
        at = float(min(tried, key=error))
        step /= 5.0
        tried = at + step * np.arange(-5, 6)
    return at


def _mean_square(rows: Array, target: Array) -> float:
    solution = np.linalg.lstsq(rows, target, rcond=None)[0]
    return float(np.mean((target - rows @ solution) ** 2))


def _check_taut(tows: Sequence[TowRecord], rows: Array, target: Array, least_N: float) -> None:
    """Raise `DataError` for a slack line, or a body that stays in place."""
    pull = target * np.sign(rows[:, 1])
    if 0 < pull.size < LEAST_WINDOWS:
        return
    if pull.size:
        mean, error = float(pull.mean()), float(pull.std()) / np.sqrt(pull.size)
        if abs(mean) > min(least_N, CLEAR * error):
            return
        how = f"while the body moves at {np.median(np.abs(rows[:, 1])):.2g} m/s"
    else:
        good = [np.isfinite(tow.speed) & np.isfinite(tow.force_N) for tow in tows]
        force = np.concatenate([tow.force_N[own] for tow, own in zip(tows, good, strict=True)])
        speed = np.concatenate([tow.speed[own] for tow, own in zip(tows, good, strict=True)])
        if not force.size:
            return
        mean, fastest = float(force.mean()), float(np.percentile(np.abs(speed), 99.0))
        if fastest > 2.0 * LEAST_SPEED:
            return  # it moves, for less than a window
        how = f"and the body does not move (up to {fastest:.2g} m/s)"
    slack = abs(mean) <= least_N
    raise DataError(
        "the line is slack" if slack else "the line pulls a body that does not move",
        field="tow_force_n",
        value=f"a mean force of {mean:.2g} N {how}",
        remedy=(
            "Take legs in which the line is taut, and look whether the load cell is joined; a body"
            " that moves by itself is a leg of role coast or drift."
            if slack
            else "Is the body moored, or the speed of another sensor or unit?"
        ),
    )


def _power(rows: Array, target: Array, error: Array) -> tuple[float, float] | None:
    """Return c and n of drag c x^n beside a mass, None where `error` (k,) is less."""
    best: tuple[float, float] | None = None
    least = float(error @ error)
    for exponent in EXPONENTS:
        x = rows[:, 1]
        part = np.column_stack([rows[:, 0], np.sign(x) * np.abs(x) ** exponent])
        solution = np.linalg.lstsq(part, target, rcond=None)[0]
        left = float(np.sum((target - part @ solution) ** 2))
        if left < least:
            best, least = (float(solution[1]), float(exponent)), left
    return best


def clusters(speed: Array, used: int) -> Index:
    """Return where clusters of windows in a row begin, by their speeds (k,).

    Pairs, where the speeds are too few to judge `used` unknowns.

    >>> clusters(np.repeat([0.5, 1.0, 0.5, 0.7, 1.2], 4), 2).tolist()
    [0, 4, 8, 12, 16]
    """
    starts = [0]
    for at, x in enumerate(speed):
        mean = float(np.mean(speed[starts[-1] : at])) if at > starts[-1] else float(x)
        if at - starts[-1] >= CLUSTER and abs(x - mean) > SAME_SPEED * abs(mean):
            starts.append(at)
    by_speed = len(starts) >= used + 2
    return np.array(starts if by_speed else range(0, speed.size, CLUSTER), dtype=np.intp)


def _windows(tows: Sequence[TowRecord]) -> tuple[Array, Array]:
    """Return rows (k, 3) of change of speed, speed and its square, and force (k,)."""
    rows, target = [], []
    for tow in tows:
        step = float(tow.t_s[1] - tow.t_s[0])
        size, end = max(round(WINDOW_S / step), 4), max(round(ENDS_S / step), 1)
        good = np.isfinite(tow.speed) & np.isfinite(tow.force_N)
        for first in range(0, tow.t_s.size - size + 1, size):
            part = slice(first, first + size)
            if not good[part].all():
                continue
            x = tow.speed[part]
            length = (size - end) * step
            change = float(x[-end:].mean() - x[:end].mean())
            # Means over the ends are half their length inside the window.
            inner = slice(first + end // 2, first + size - end // 2)
            x = tow.speed[inner]
            if abs(float(x.mean())) < LEAST_SPEED:
                continue
            rows.append([change / length, float(x.mean()), float(np.mean(x * np.abs(x)))])
            target.append(float(tow.force_N[inner].mean()))
    return np.array(rows).reshape(-1, 3), np.array(target)


def _solve(
    rows: Array, target: Array, columns: Sequence[int], mass_kg: float, mass_sd_kg: float
) -> tuple[Array, Array, Array]:
    """Return mass, D_1, D_2 (3,), covariance (3, 3) and errors (k,)."""
    used = list(columns)
    part = rows[:, used]
    noise = 1.0
    for _ in range(4):  # the prior's weight follows the size of the residual
        weight = np.zeros(len(used))
        weight[0] = (noise / mass_sd_kg) ** 2
        normal = part.T @ part + np.diag(weight)
        inverse = np.linalg.inv(normal)
        solution = inverse @ (part.T @ target + weight * mass_kg)
        error = target - part @ solution
        noise = float(np.sqrt(np.sum(error**2) / max(target.size - len(used), 1)))
        noise = max(noise, 1e-9 * float(np.max(np.abs(target))))
    # Neighbours share what the water does, and at one speed what the form misses; each
    # cluster counts by the error it would have in a fit without it.
    leverage = np.minimum(np.einsum("ij,jk,ik->i", part, inverse, part), 0.9)
    scores = part * (error / (1.0 - leverage))[:, None]
    sums = np.add.reduceat(scores, clusters(rows[:, 1], len(used)), axis=0)
    middle = sums.T @ sums + np.diag(weight * noise**2)
    values, covariance = np.zeros(3), np.zeros((3, 3))
    values[used] = solution
    covariance[np.ix_(used, used)] = inverse @ middle @ inverse
    return values, covariance, error
