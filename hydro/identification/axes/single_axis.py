"""One axis of motion from the legs that measure it: inertia, damping, force, constant.

    x' = a x + b x|x| + c F(lagged) + d + d_window,   a, b <= 0, c >= 0

by output error over windows of all legs (`pooled_fit`); heave without a velocity log by
z' = w cos theta cos phi against depth. 1 / c is the apparent inertia.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, VELOCITIES, Array, runs_of
from auvid.hydro.axis_figures import AxisEquation
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.axes.drive import LAG, ForceDrive, changed
from auvid.hydro.identification.axes.held_out import (
    HeldOut,
    bent_commands,
    doubting_curves,
    errs_less,
    held_out_blocks,
    legs_flown_better,
    legs_left_out,
)
from auvid.hydro.identification.axes.judgement import (
    FLOORS,
    STRAIGHT,
    AxisVerdict,
    Heterogeneity,
    InertiaPrior,
    InertiaVerdict,
    LagVerdict,
    ShapeVerdict,
    SideDrag,
    beside_force,
    coefficient_block,
    doubts,
    heterogeneity,
    hull_words,
    notes_of,
    rms_of,
    shape_of,
    verdicts_of,
    with_unseen_moment,
)
from auvid.hydro.identification.axes.pooled_fit import (
    Loss,
    Pool,
    PoolFit,
    fit_pool,
    make_pool,
    with_doubts,
)
from auvid.hydro.identification.axes.quantities import (
    WIDEST,
    FitQuantity,
    Scale,
    normalised_quantities,
    physical_quantities,
    quantity,
)
from auvid.hydro.identification.axes.record import (
    LARGEST_SHARE,
    SHARE_WITHIN,
    AxisRecord,
    climb,
    hull_inputs,
    hull_priors,
    unmeasured,
    without_climb,
)
from auvid.hydro.identification.axes.starting_values import starting_values
from auvid.hydro.identification.axes.structure import FORCE, Structure, axis_terms
from auvid.hydro.identification.axes.windows import depth_measures, windows_of
from auvid.hydro.identification.regression.standard_errors import widened_by
from auvid.hydro.identification.regression.verdicts import T_LIMIT

CONSTANT_SD = {"u": 0.02, "v": 0.02, "w": 0.005, "p": 0.02, "q": 0.02, "r": 0.02}
"""Deviation of the constant of a window from that of all [m/s^2, rad/s^2]."""
SURGE = "surge"
"""Input of heave: force ahead behind the lag of the surge speed."""
LAG_SD_S, LAG_FLOOR_S = 0.1, 0.02
"""Deviation of a lag that nothing tells, as thrusters of vehicles have .05 to .3 s, and the
largest error with which the motion counts beside it; and the least deviation, where the lag
that would be fitted is near the assumed one."""
AS_WELL = 2.0
"""Held-out fit [%] that a lag between that of the motion and the assumed one may cost."""
HULL_LAGS_S, LAG_STEP_S, DRAG_STEP = (0.01, 0.5), 0.05, 0.1
"""Ends of the lag of yaw and of the speeds of its hull [s]; steps of that lag and of the logarithm
of the drag of the hull to each side, by which curvature is taken."""
DRAG_SPREAD, LARGEST_DRAG, DRAG_WITHIN = 2.0, 8.0, 0.15
"""Standard factor and largest one of the drag of a hull whose speeds nobody measures, and how
near its logarithm is sought before the lag is sought beside it."""
LAG_KNOWN_S = 0.05
"""Largest deviation of a lag that is not fitted beside which an inertia is determined."""
LAG_SHARE, HULL_LAG_SHARE = 0.1, 0.2
"""Of a lag that is fitted, its deviation where surge and sway are not measured: of 21 twins it
came out up to a seventh short (decision 0073). That of yaw beside speeds by forces: of 20 dives
it came out .04 s short (RMS), by more than its errors (decision 0134)."""
INERTIA_SD = 0.3
"""Relative deviation of the inertia of heave while the speeds of a hull are sought."""
SURGE_LAG_S, SURGE_SHARE = 2.0, 0.3
"""Time constant of that speed; deviation of its term around 0, in parts of c."""
ABSURD = 3.0
"""An apparent inertia so many times more or less than expected is none."""
DETERMINED_WITHIN = 0.5
"""Relative standard error up to which a free inertia is determined."""
LEAST_WINDOWS = 2
"""Intervals come from how windows differ, and one is fitted while the other judges."""
FEWEST_WINDOWS = 4
"""Least windows of a leg for a fit of its own; of the pool for drag ahead and back."""
DECAY_RATE, DECAY_FORCE, DECAY_S = 0.1, 0.02, 3.0
"""A free decay: RMS rate [rad/s], share of the largest moment, and length [s]."""


@dataclass(frozen=True)
class SingleAxisFit:
    """Fit of one axis with verdicts, held-out fits and what differs between legs.

    `values` and `covariance` of a, b, c, d; more in `fit`. `speed`: RMS of x in the
    windows. `width`: standard errors of half a 95 % interval.
    """

    axis: str
    velocity: str
    normalised: bool
    values: Array
    covariance: Array
    pool: Pool
    fit: PoolFit
    verdicts: dict[str, AxisVerdict]
    held_out: tuple[HeldOut, ...]
    legs: tuple[Heterogeneity, ...]
    sides: SideDrag | None
    lag: LagVerdict
    shape: ShapeVerdict
    inertia: InertiaVerdict
    speed: float
    width: float
    notes: tuple[str, ...]

    def beside_force(self, name: str) -> AxisEquation | None:
        """Return c and a term that is not in `values`, None where it has none."""
        return beside_force(self.fit, self.axis, name, self.width)

    def without_newtons(self) -> tuple[FitQuantity, ...]:
        """Return time constants, steady speed and damping over inertia."""
        return normalised_quantities(
            self.axis, self.values, self.covariance, width=self.width, speed=self.speed
        )

    def physical(self, scale: Scale | None = None) -> tuple[FitQuantity, ...]:
        """Return inertia, damping and constant in SI.

        Raises `DataError` for commands without a bollard pull or a mass.
        """
        if self.normalised and scale is None:
            raise DataError(
                "commands have no newtons",
                remedy="Give one bollard pull, or one known inertia.",
            )
        return physical_quantities(
            self.axis, self.values, self.covariance, width=self.width, scale=scale
        )


def refusal(records: Sequence[AxisRecord], axis: str) -> str:
    """Return why an axis cannot be fitted from these records, or an empty text."""
    velocity = VELOCITIES[AXES.index(axis)]
    measured = [
        record
        for record in records
        if np.isfinite(record.rate[velocity]).any()
        or (depth_measures(record, velocity) and np.isfinite(record.depth_m).any())  # type: ignore[arg-type]
    ]
    if not measured:
        if velocity in "uv":
            return "not observable: nothing measures this velocity (velocity log, pose, fixes)"
        return (
            "not observable: neither its velocity nor depth is measured"
            if (velocity == "w")
            else "not observable: no gyro or attitude measures it"
        )
    windows = windows_of(measured, (velocity,))
    if not windows:
        reasons = sorted(
            {item.reason for r in measured for item in r.left_out if item.axis == axis}
        )
        return f"no usable stretch: {'; '.join(reasons)}" if reasons else "no usable stretch"
    if len(windows) < LEAST_WINDOWS:
        return "no usable stretch: one window only, nothing is left to judge its fit by"
    driven = np.concatenate([measured[w.leg].force[axis][w.nodes] for w in windows])
    if velocity in "pq" and not any(free_decays(record, axis) for record in measured):
        return "not excited: the autopilot holds it, and no free decay is in the log"
    if velocity not in "pq" and float(np.ptp(driven)) == 0.0:
        return "not excited: nothing drives it"
    if velocity != "w":
        moved = np.concatenate([measured[w.leg].rate[velocity][w.nodes] for w in windows])
        if float(np.sqrt(np.mean(moved**2))) < FLOORS[velocity]:
            return f"not excited: it moves less than {FLOORS[velocity]:g} (RMS)"
    return ""


def free_decays(record: AxisRecord, axis: str) -> tuple[tuple[int, int], ...]:
    """Return stretches (first, end) of its windows in which an axis swings freely.

    Neither it is driven nor surge, sway or heave: thrust ahead pitches a vehicle too, and
    nothing says by how much.
    """
    rate = record.rate[VELOCITIES[AXES.index(axis)]]
    free = np.zeros(len(rate), dtype=bool)
    for first, end in record.windows.get(axis, ()):
        free[first:end] = np.isfinite(rate[first:end])
    for driver in (axis, "X", "Y", "Z"):
        size = np.abs(np.nan_to_num(record.force[driver]))
        free &= size <= DECAY_FORCE * float(size.max())
    step = float(record.t_s[1] - record.t_s[0])
    return tuple(
        (a, b)
        for a, b in runs_of(free)
        if (b - a) * step >= DECAY_S and float(np.sqrt(np.mean(rate[a:b] ** 2))) >= DECAY_RATE
    )


def fit_axis(
    records: Sequence[AxisRecord],
    axis: str,
    *,
    inertia: InertiaPrior | None = None,
    drive: ForceDrive | None = None,
    surge: bool = False,
    hull: Array | None = None,
    speed_share: float = 1.0,
    doubtful: Sequence[Sequence[AxisRecord]] = (),
    try_lag: bool = True,
    lag_sd_s: float = 0.0,
    try_shape: bool = False,
    creeps: bool = False,
    loss: Loss = "soft_l1",
) -> SingleAxisFit:
    """Fit one axis to the windows of all legs.

    inertia: prior of 1 / c; None leaves it free, and commands have none. surge: a term of
    the force ahead in heave, under a prior around 0. hull (6,): apparent inertia, by which
    yaw and heave in newtons have what a hull does whose speeds nobody measures
    (`record`), by `speed_share` of those that forces give; depth without its climb is
    the caller's. doubtful: the records with one figure that they rest on one deviation off,
    each. try_lag: whether the lag is fitted where the data determine it; lag_sd_s: deviation
    of the assumed one, where it is tried `LAG_SD_S` for 0. try_shape: the same of dead band
    and curve of commands. creeps: its drag is linear alone. Raises
    `DataError` with the reason where an axis is refused.
    """
    reason = refusal(records, axis)
    if reason:
        raise DataError(f"axis {axis}: {reason}", remedy="See the stretches that were left out.")
    velocity = VELOCITIES[AXES.index(axis)]
    by_depth = velocity == "w" and any(depth_measures(record, "w") for record in records)
    acts = (velocity == "r" or by_depth) and not records[0].normalised and unmeasured(records)
    moment, drag_sd = hull if acts else None, 0.0
    fitted = _Setup(
        tuple(records), axis, velocity, inertia, drive or ForceDrive(),
        surge and velocity == "w", loss, moment, speed_share, creeps=creeps,
        lag_sd_s=lag_sd_s or LAG_SD_S,
    )  # fmt: skip
    hull_motion: _HullMotion | None = None
    if fitted.turns_hull:
        hull_motion = _hull_motion(fitted, try_lag=try_lag)
        fitted, drag_sd = replace(fitted, hull_drag=hull_motion.drag), hull_motion.drag_sd
    pool = fitted.pool()
    fit = fit_pool(pool, starting_values(pool))
    blocks = held_out_blocks(pool, fit.values)
    lag = LagVerdict(pool.drive.lag_s, float("nan"), False, lag_sd_s)
    if try_lag:
        fitted, pool, fit, blocks, lag = _with_lag(fitted, pool, fit, blocks, hull_motion)
    by_drag = _moved_by_drag(fitted, fit, drag_sd)
    shape = STRAIGHT
    if try_shape and records[0].normalised:
        bent, terms = bent_commands(pool, fit), len(pool.structure.terms)
        other = bent[1]
        if errs_less(bent[2], blocks):
            legs_apart = (legs_left_out(own, start.values[:terms]) for own, start in (
                (pool, fit), bent[:2]))  # fmt: skip
            if legs_flown_better(*legs_apart):
                other = fit
                pool, fit, blocks = bent
                shape = shape_of(fit)
        fit = doubting_curves(pool, fit, [other])
    fit = _with_change(_with_lag_error(fitted, pool, fit, lag.deviation_s), by_drag)
    fit = with_doubts(pool, fit, doubtful)
    lag_known = lag.determined or (not try_lag and lag_sd_s <= LAG_KNOWN_S)
    names = (velocity, f"{velocity}|{velocity}|", FORCE, "constant")
    values, covariance = coefficient_block(fit, axis, names)
    width = interval_width(fit.windows)
    speed = rms_of(pool)[velocity]
    verdict = _inertia_verdict(values, covariance, inertia, width, records[0].normalised, lag_known)
    verdicts = verdicts_of(pool, fit)
    if velocity == "r" and moment is None:
        verdicts = with_unseen_moment(verdicts, records)
    legs = _by_leg(fitted, pool, fit, speed)
    sides = _sides(fitted, pool, width)
    left_out = legs_left_out(pool, fit.values[: len(pool.structure.terms)])
    return SingleAxisFit(
        axis, velocity, records[0].normalised,
        values, covariance, pool, fit, verdicts, (*blocks, *left_out), legs, sides,
        lag, shape, verdict, speed, width,
        (
            *notes_of(fit, legs, sides, verdict, lag), *doubts(verdict, inertia),
            *hull_words(
                velocity, records, moment,
                [part.with_moment[velocity] for part in blocks if velocity in part.with_moment],
            ),
        ),
    )  # fmt: skip


def interval_width(windows: int) -> float:
    """Return half a 95 % interval in standard errors: t, windows - 1 degrees."""
    return NORMAL_95 * widened_by(windows - 1)


@dataclass(frozen=True)
class _Setup:
    records: tuple[AxisRecord, ...]
    axis: str
    velocity: str
    inertia: InertiaPrior | None
    drive: ForceDrive
    surge: bool
    loss: Loss
    hull: Array | None = None
    speed_share: float = 1.0
    hull_drag: float = 1.0
    creeps: bool = False
    lag_sd_s: float = LAG_SD_S

    def pool(
        self,
        *,
        legs: Sequence[int] | None = None,
        sides: bool = False,
        free: tuple[str, ...] = (),
    ) -> Pool:
        """Return the pool of some legs, with some parameters of the drive free."""
        inverse: tuple[float, float] | None = None
        extra: dict[str, tuple[float, float]] = {}
        if self.inertia is not None and not self.records[0].normalised:
            c = 1.0 / self.inertia.value
            inverse = (c, c * self.inertia.relative_sd)
        columns: tuple[dict[str, Array], ...] = tuple({} for _ in self.records)
        if self.surge:
            extra[SURGE] = (0.0, self.surge_sd)
            columns = tuple({SURGE: surge_input(record)} for record in self.records)
        if self.hull is not None:
            extra |= hull_priors(self.velocity, self.hull, self.speed_share)
            columns = tuple(own | by for own, by in zip(columns, self.hull_columns, strict=True))
        inputs = (self.axis, *extra)
        terms = axis_terms(
            self.axis, inputs=inputs, inverse=inverse, sides=sides,
            restoring=self.velocity in "pq", extra=extra, creeps=self.creeps,
        )  # fmt: skip
        windows = windows_of(self.records, (self.velocity,))
        if legs is not None:
            windows = tuple(window for window in windows if window.leg in legs)
        return make_pool(
            Structure((self.velocity,), terms, inputs), self.records, windows,
            constant_sd=np.array([CONSTANT_SD[self.velocity]]), drive=self.drive, free=free,
            extra=columns, loss=self.loss,
        )  # fmt: skip

    @property
    def turns_hull(self) -> bool:
        """Return whether yaw has the moment of a hull whose speeds forces give."""
        return self.hull is not None and self.velocity == "r"

    def late(self, lag_s: float) -> _Setup:
        """Return it with another lag, of the speeds of the hull too."""
        return replace(self, drive=changed(self.drive, {LAG: lag_s}))

    @cached_property
    def hull_columns(self) -> tuple[dict[str, Array], ...]:
        """Return what the hull does by speeds of its forces (n,), of each record."""
        assert self.hull is not None
        return tuple(
            hull_inputs(
                record,
                self.velocity,
                self.hull,
                drag=self.hull_drag,
                lag_s=self.drive.lag_s if self.turns_hull else 0.0,
            )
            for record in self.records
        )

    @property
    def surge_sd(self) -> float:
        """Return the deviation of the surge term around 0."""
        c = 1.0 / self.inertia.value if self.inertia is not None else 0.05
        return SURGE_SHARE * c


def surge_input(record: AxisRecord) -> Array:
    """Return the force ahead (n,) as the surge speed follows it, in the force's unit.

    y of SURGE_LAG_S y_dot + y = X.
    """
    from auvid.hydro.identification.axes.drive import lagged_columns

    step = float(record.t_s[1] - record.t_s[0])
    return lagged_columns(step, np.nan_to_num(record.force["X"])[:, None], SURGE_LAG_S)[:, 0]


def speed_share(records: Sequence[AxisRecord], inertia: Array, *, lag_s: float) -> float:
    """Return the share of the speeds by forces that the depth of a hull tells.

    inertia (6,): apparent. Heave is fitted for each share; the least error decides.
    """
    from scipy.optimize import minimize_scalar

    travels = [climb(record, inertia) for record in records]

    def error(share: float) -> float:
        setup = _Setup(
            tuple(without_climb(r, x, share) for r, x in zip(records, travels, strict=True)),
            "Z", "w", InertiaPrior(float(inertia[2]), INERTIA_SD), ForceDrive(lag_s=lag_s),
            False, "soft_l1", inertia, share,
        )  # fmt: skip
        pool = setup.pool()
        return float(fit_pool(pool, starting_values(pool)).sigma[1])

    ends = (0.0, LARGEST_SHARE)
    best = minimize_scalar(error, bounds=ends, method="bounded", options={"xatol": SHARE_WITHIN})
    return float(best.x)


class _HullMotion(NamedTuple):
    """Drag of a hull whose speeds nobody measures, and lag.

    drag: in parts of `UNMEASURED_DRAG`. drag_sd: of its logarithm. lag_s,
    lag_error_s: as the motion tells them, inf where not.
    """

    drag: float
    drag_sd: float
    lag_s: float
    lag_error_s: float


def _hull_motion(setup: _Setup, *, try_lag: bool) -> _HullMotion:
    """Return the drag and the lag by which forces turn the hull as measured.

    The least of W ln sigma + (ln drag / ln `DRAG_SPREAD`)^2 / 2 + ((lag - assumed) /
    its deviation)^2 / 2, W: windows. One lag moves yaw and the speeds, and drag and lag
    trade, so that they are sought together; curvature at the least gives errors.
    """
    from scipy.optimize import minimize, minimize_scalar

    start, assumed = starting_values(setup.pool()), setup.drive.lag_s

    def cost(place: Array) -> float:
        logarithm, lag_s = float(place[0]) * DRAG_STEP, float(place[1]) * LAG_STEP_S
        if not HULL_LAGS_S[0] <= lag_s <= HULL_LAGS_S[1]:
            return np.inf
        pool = replace(setup, hull_drag=float(np.exp(logarithm))).late(lag_s).pool()
        size = len(pool.windows) * float(np.log(fit_pool(pool, start).sigma[0]))
        by_prior = (logarithm / float(np.log(DRAG_SPREAD))) ** 2 + (
            (lag_s - assumed) / setup.lag_sd_s
        ) ** 2
        return size + 0.5 * by_prior

    end, late = float(np.log(LARGEST_DRAG)) / DRAG_STEP, assumed / LAG_STEP_S
    first = minimize_scalar(
        lambda x: cost(np.array([x, late])),
        bounds=(-end, end),
        method="bounded",
        options={"xatol": DRAG_WITHIN / DRAG_STEP},
    )
    here, least = np.array([float(first.x), late]), float(first.fun)
    if try_lag:
        corners = here + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        options = {"initial_simplex": corners, "xatol": 0.2, "fatol": 0.1, "maxfev": 24}
        best = minimize(cost, here, method="Nelder-Mead", options=options)
        here, least = np.asarray(best.x), float(best.fun)
    one, other = np.eye(2)
    bend = cost(here + one) - 2.0 * least + cost(here - one)
    drag = float(np.exp(here[0] * DRAG_STEP))
    bend = max(bend, (DRAG_STEP / float(np.log(DRAG_SPREAD))) ** 2)
    if not try_lag:
        return _HullMotion(drag, DRAG_STEP * bend**-0.5, assumed, np.inf)
    step = min(1.0, here[1] - HULL_LAGS_S[0] / LAG_STEP_S)
    lag_bend = (
        (cost(here + step * other) - 2.0 * least + cost(here - step * other)) / step**2
        if step > 0.0
        else 0.0
    )
    prior = (LAG_STEP_S / setup.lag_sd_s) ** 2
    own_bend, lag_s = lag_bend - prior, float(here[1] * LAG_STEP_S)
    if not 0.0 < own_bend < np.inf:
        return _HullMotion(drag, DRAG_STEP * bend**-0.5, assumed, np.inf)
    by_motion = (lag_bend * lag_s - prior * assumed) / own_bend
    return _HullMotion(drag, DRAG_STEP * bend**-0.5, by_motion, LAG_STEP_S * own_bend**-0.5)


def _moved_by_drag(setup: _Setup, fit: PoolFit, deviation: float) -> dict[str, float]:
    """Return by how much unknowns move where the hull has one deviation more drag."""
    if deviation <= 0.0:
        return {}
    pool = replace(setup, hull_drag=setup.hull_drag * float(np.exp(deviation))).pool()
    moved = fit_pool(pool, fit.values)
    return dict(zip(moved.names, (moved.values - fit.values).tolist(), strict=True))


def _with_change(fit: PoolFit, by_name: Mapping[str, float]) -> PoolFit:
    """Return a fit with one deviation in its covariance that moves unknowns so."""
    change = np.array([by_name.get(name, 0.0) for name in fit.names])
    return replace(fit, covariance=fit.covariance + np.outer(change, change))


def _with_lag_error(setup: _Setup, pool: Pool, fit: PoolFit, lag_sd_s: float) -> PoolFit:
    """Return a fit with one deviation of its lag in its covariance.

    It is the change of the estimate where the lag is that much longer.
    """
    if lag_sd_s <= 0.0:
        return fit
    drive = changed(fit.drive, {LAG: fit.drive.lag_s + lag_sd_s})
    own = setup.late(drive.lag_s).pool() if setup.turns_hull else pool
    other = replace(own, drive=drive, free=tuple(name for name in pool.free if name != LAG))
    moved = fit_pool(other, fit.values[: len(pool.structure.terms)])
    kept = [fit.names.index(name) for name in moved.names]
    change = np.zeros(len(fit.values))
    change[kept] = moved.values - fit.values[kept]
    if LAG in fit.names:
        change[fit.names.index(LAG)] = lag_sd_s
    return replace(fit, covariance=fit.covariance + np.outer(change, change))


def _with_lag(
    setup: _Setup,
    pool: Pool,
    fit: PoolFit,
    blocks: tuple[HeldOut, ...],
    motion: _HullMotion | None,
) -> tuple[_Setup, Pool, PoolFit, tuple[HeldOut, ...], LagVerdict]:
    """Return the fit with a free lag where it is clear and better held out.

    Otherwise that with the lag between what is assumed and what the motion tells.
    """
    hull = motion is not None
    of_itself = HULL_LAG_SHARE if hull else LAG_SHARE
    if motion is None:
        late = setup.pool(free=(LAG,))
        other = fit_pool(late, fit.values)
        value, error = float(other.values[-1]), float(np.sqrt(other.covariance[-1, -1]))
        if other.at_bound[-1]:
            error = np.inf
    else:
        value, error = motion.lag_s, motion.lag_error_s
        late = setup.late(value).pool() if np.isfinite(error) else pool
        other = fit_pool(late, fit.values)
    off_s = float(np.hypot(error, value - pool.drive.lag_s))
    fixed = LagVerdict(
        pool.drive.lag_s, float("nan"), False, min(max(off_s, LAG_FLOOR_S), setup.lag_sd_s),
        told_s=(value, error) if 0.0 < error < np.inf else None,
    )  # fmt: skip
    if not 0.0 < error < np.inf:
        return setup, pool, fit, blocks, fixed
    if error * T_LIMIT < value:
        tried = held_out_blocks(late, fit.values)
        if flown_better(setup.velocity, tried, blocks, by=0.0):
            share = of_itself * value if unmeasured(setup.records) else 0.0
            both = float(np.hypot(error, share))
            verdict = LagVerdict(value, both, True, both if hull else share, told_s=(value, error))
            return setup.late(value) if hull else setup, late, other, tried, verdict
    if setup.records[0].normalised:
        return setup, pool, fit, blocks, fixed
    weight = setup.lag_sd_s**2 / (setup.lag_sd_s**2 + error**2)
    lag_s = pool.drive.lag_s + weight * (value - pool.drive.lag_s)
    moved = replace(pool, drive=changed(pool.drive, {LAG: lag_s}))
    if hull:
        setup = setup.late(lag_s)
        moved = setup.pool()
    tried = held_out_blocks(moved, fit.values)
    if error > LAG_SD_S or not flown_better(setup.velocity, tried, blocks, by=-AS_WELL):
        return setup.late(pool.drive.lag_s), pool, fit, blocks, fixed
    deviation = float(np.hypot(np.sqrt(weight) * error, of_itself * lag_s))
    verdict = LagVerdict(lag_s, float("nan"), False, deviation, (value, error), (value, error))
    return setup, moved, fit_pool(moved, fit.values), tried, verdict


def flown_better(
    velocity: str, tried: Sequence[HeldOut], blocks: Sequence[HeldOut], *, by: float
) -> bool:
    """Return whether each part that was held out is flown better by so much [%].

    >>> flown_better("w", (), (), by=0.0)  # nothing was held out
    False
    """
    return len(tried) > 0 and all(
        new.percent[velocity] > old.percent[velocity] + by
        for new, old in zip(tried, blocks, strict=True)
    )


def _inertia_verdict(
    values: Array,
    covariance: Array,
    inertia: InertiaPrior | None,
    width: float,
    commands: bool,
    lag_known: bool,
) -> InertiaVerdict:
    """Return what is known of 1 / c: weak beside an unknown lag, as they trade."""
    nan = float("nan")
    if commands:
        return InertiaVerdict("not determined", nan, nan, nan)
    if inertia is not None and inertia.relative_sd == 0.0:
        return InertiaVerdict("given", inertia.value, inertia.value, inertia.value)
    if values[2] <= 0.0:
        return InertiaVerdict("not determined", nan, nan, nan)
    item = quantity(
        "M", "", lambda v: float(1.0 / v[2]), values, covariance, width=width, positive=True
    )
    relative = item.standard_error / item.value
    absurd = (
        inertia is not None and max(item.value / inertia.value, inertia.value / item.value) > ABSURD
    )
    word = "not determined" if absurd or not relative <= DETERMINED_WITHIN else "determined"
    if word == "determined" and inertia is not None and relative > 0.7 * inertia.relative_sd:
        word = "from the prior"
    if word == "determined" and not lag_known:
        word = "weak"
    return InertiaVerdict(word, item.value, item.low, item.high)


def drag_at(speed: float, values: Array, covariance: Array) -> tuple[float, float]:
    """Return drag over inertia -(a + b speed) [1/s] and its standard error.

    >>> drag_at(0.5, np.array([-1.0, -2.0, 1.0, 0.0]), np.zeros((4, 4)))[0]
    2.0
    """
    by = np.array([-1.0, -speed, 0.0, 0.0])
    return float(by @ values), float(np.sqrt(by @ covariance @ by))


def _by_leg(setup: _Setup, pool: Pool, fit: PoolFit, speed: float) -> tuple[Heterogeneity, ...]:
    """Return whether legs, fitted one by one, agree in drag over inertia and in c."""
    count = np.bincount([window.leg for window in pool.windows], minlength=len(pool.records))
    legs = [int(leg) for leg in np.flatnonzero(count >= FEWEST_WINDOWS)]
    if len(legs) < 2:
        return ()
    names = (setup.velocity, f"{setup.velocity}|{setup.velocity}|", FORCE, "constant")
    drag, gain = [], []
    for leg in legs:
        own = replace(
            pool, windows=tuple(w for w in pool.windows if w.leg == leg), drive=fit.drive, free=()
        )
        values, covariance = coefficient_block(
            fit_pool(own, fit.values[: len(pool.structure.terms)]), setup.axis, names
        )
        drag.append(drag_at(speed, values, covariance))
        gain.append((float(values[2]), float(np.sqrt(covariance[2, 2]))))
    out = []
    for words, rows in ((f"drag over inertia at {speed:.2g}", drag), ("force over inertia", gain)):
        if all(error > 0.0 for _, error in rows):
            out.append(heterogeneity(words, [v for v, _ in rows], [e for _, e in rows], legs))
    return tuple(out)


def _sides(setup: _Setup, pool: Pool, width: float) -> SideDrag | None:
    """Return drag ahead and back at the RMS speed; None where a side tells none."""
    if len(pool.windows) < FEWEST_WINDOWS:
        return None
    v = setup.velocity
    x = np.concatenate([pool.prepared[w.leg].start[w.nodes, 0] for w in pool.windows])
    ahead, back = x[x > 0.0], x[x < 0.0]
    if min(len(ahead), len(back)) < 0.1 * len(x):
        return None
    speeds = [float(np.sqrt(np.mean(part**2))) for part in (ahead, back)]
    speed = min(speeds)
    if speed < FLOORS[v]:
        return None
    split = setup.pool(sides=True)
    fit = fit_pool(split, starting_values(split))
    drag = []
    for side in ("ahead", "back"):
        names = (f"{v} {side}", f"{v}|{v}| {side}", FORCE, "constant")
        drag.append(drag_at(speed, *coefficient_block(fit, setup.axis, names)))
    (one, one_error), (other, other_error) = drag
    if one <= 0.0 or other <= 0.0:
        return None
    half = width * float(np.hypot(one_error / one, other_error / other))
    if half > WIDEST:
        return None
    ratio = one / other
    return SideDrag(
        speed, one, other, ratio, ratio * float(np.exp(-half)), ratio * float(np.exp(half))
    )
