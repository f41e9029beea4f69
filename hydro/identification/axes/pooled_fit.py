"""Output error over windows of several legs, each window with its own start.

Least sum over windows of rho(e) / colour + priors, e = (simulated - measured) / sigma,
by damped Gauss-Newton. rho(e) = sqrt(1 + e^2) - 1 (soft L1) or e^2 / 2. sigma: robust
size of the errors of a channel; colour: how many samples count as one. A window's own
unknowns are x(0), s(0) and a constant with a prior around 0.

Covariance: windows are left out in turn (jackknife of clusters, CR3: Bell and McCaffrey
2002), by one step from the optimum each. What the records rest on and has an error itself
(a clock, an arm) adds the change that one deviation of it makes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Literal

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import VELOCITIES, Array, Index, Mask
from auvid.hydro.identification.axes.drive import (
    ForceDrive,
    bounds_of,
    changed,
    input_derivatives,
    inputs_of,
    prior_of,
    values_of,
)
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.axes.structure import Structure
from auvid.hydro.identification.axes.windows import (
    MotionWindow,
    depth_measures,
    measured_rate,
    smooth_depth,
    turn_of,
)
from auvid.hydro.identification.maximum_likelihood.gauss_newton import (
    Evaluation,
    NormalEquations,
    Optimum,
    maximise,
    solve_scaled,
)
from auvid.hydro.identification.regression.standard_errors import widened_by

LONGEST_STEP_S = 0.05
"""Longest step of the simulation: RK4 is then within 1e-4 of the state for time constants
from 0.2 s on."""
MOST_STEPS, ROUNDS = 60, 3
"""Steps of a search; rounds of sizes of errors."""
SETTLED = 0.02
"""Change of sigma by which rounds end."""
QUANTILE, NORMAL_AT_QUANTILE = 0.9, 1.644854
"""Share of |e| by which sigma is set, and its place in standard errors of a normal: by
the median, quiet windows would make outliers of all that move."""
LARGEST_COLOUR = 400.0
Loss = Literal["soft_l1", "squares"]


@dataclass(frozen=True)
class LoopArrays:
    """Arrays of one record for the loop: inputs, turn, velocities, channels (n, 2k)."""

    step_s: float
    nu: Array
    turn: Array
    channels: Array
    start: Array


@dataclass(frozen=True)
class Pool:
    """Records, windows and structure of a fit, and what does not change with a step.

    `free`: parameters of the drive that are fitted. `constant_sd` (k,): prior of the
    constant of a window [m/s^2, rad/s^2], 0 for none.
    """

    structure: Structure
    records: tuple[AxisRecord, ...]
    prepared: tuple[LoopArrays, ...]
    windows: tuple[MotionWindow, ...]
    constant_sd: Array
    drive: ForceDrive
    free: tuple[str, ...]
    extra: tuple[Mapping[str, Array], ...]
    loss: Loss

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the common unknowns (g,)."""
        return (*self.structure.names, *self.free)

    def without(self, *names: str) -> Pool:
        """Return the pool with extra inputs that do not act."""
        extra = tuple(
            {key: np.zeros_like(own) if key in names else own for key, own in columns.items()}
            for columns in self.extra
        )
        return replace(self, extra=extra)


@dataclass(frozen=True)
class PoolFit:
    """Common unknowns (g,) with covariance (g, g), clustered by window.

    `information` (g, g): covariance if errors were as the loss takes them, from data and
    priors; `data_variances` (g,) without priors. `local` (w, 3k): x(0), s(0), constant.
    `sigma`, `colour` (2k,) by channel. `at_bound` (g,): at a bound, or fixed there.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    information: Array
    data_variances: Array
    at_bound: Mask
    local: Array
    sigma: Array
    colour: Array
    objective: float
    word: str
    drive: ForceDrive
    windows: int


def prepare(record: AxisRecord, structure: Structure) -> LoopArrays:
    """Return the arrays of one record for the loop."""
    places = structure.places
    nu = np.column_stack([record.rate[item] for item in VELOCITIES])
    k = len(places)
    channels = np.full((len(record.t_s), 2 * k), np.nan)
    start = np.zeros((len(record.t_s), 2 * k))
    turn = np.ones((len(record.t_s), k))
    for i, velocity in enumerate(structure.velocities):
        rate = measured_rate(record, velocity)
        start[:, i] = np.nan_to_num(rate)
        if velocity == "w":
            turn[:, i] = np.nan_to_num(turn_of(record), nan=1.0)
        if velocity in "pq":
            start[:, k + i] = record.attitude_rad[:, "pq".index(velocity)]
        if depth_measures(record, velocity):
            assert record.depth_m is not None
            channels[:, k + i] = record.depth_m
            start[:, k + i] = np.nan_to_num(smooth_depth(record))
        else:
            channels[:, i] = rate
    return LoopArrays(
        float(record.t_s[1] - record.t_s[0]),
        np.ascontiguousarray(np.nan_to_num(nu)),
        turn,
        channels,
        start,
    )


def make_pool(
    structure: Structure,
    records: Sequence[AxisRecord],
    windows: Sequence[MotionWindow],
    *,
    constant_sd: Array,
    drive: ForceDrive,
    free: Sequence[str] = (),
    extra: Sequence[Mapping[str, Array]] = (),
    loss: Loss = "soft_l1",
) -> Pool:
    """Return the pool of a fit. Raises `DataError` without a window."""
    if not windows:
        raise DataError("no window is left for the fit", remedy="See the stretches left out.")
    return Pool(
        structure,
        tuple(records),
        tuple(prepare(record, structure) for record in records),
        tuple(windows),
        constant_sd,
        drive,
        tuple(free),
        tuple(extra) or tuple({} for _ in records),
        loss,
    )


def motion(pool: Pool, rows: Array, theta: Array, window: MotionWindow, start: Array) -> Array:
    """Return states and sensitivities (n, 2k, 1 + P) over a window.

    rows: of `loop_rows` for its record; start (3k,): x(0), s(0), constants.
    """
    from auvid.hydro.identification.axes.compiled_motion import simulate_axes

    step = pool.prepared[window.leg].step_s
    parts = parts_of(step)
    products, weights = pool.structure.coriolis
    out = np.empty(
        (window.end - window.first, 2 * len(pool.structure.velocities),
         1 + len(theta) + len(pool.free) + len(start))
    )  # fmt: skip
    simulate_axes(
        step,
        parts,
        rows[2 * parts * window.first : 2 * parts * (window.end - 1) + 1],
        pool.structure.places,
        pool.structure.table,
        products,
        weights,
        theta,
        start,
        out,
    )
    return out


def parts_of(step_s: float) -> int:
    """Return how many steps of the simulation a step of the grid has."""
    return max(1, int(np.ceil(step_s / LONGEST_STEP_S - 1e-9)))


def loop_rows(pool: Pool, drive: ForceDrive, last: Sequence[Array] | None = None) -> list[Array]:
    """Return what drives the loop at every half step, record by record.

    Columns: measured velocities (6), turn (k), inputs (m), their derivatives by the
    free parameters of the drive (m e). last: rows of this pool at another drive, whose
    velocities and turn are taken.
    """
    out = []
    at = 6 + len(pool.structure.velocities)
    for leg, (record, data) in enumerate(zip(pool.records, pool.prepared, strict=True)):
        node = np.arange(len(record.t_s), dtype=np.float64)
        fine = np.linspace(0.0, node[-1], 2 * parts_of(data.step_s) * (len(node) - 1) + 1)
        more = {name: np.interp(fine, node, values) for name, values in pool.extra[leg].items()}
        inputs = inputs_of(record, pool.structure.inputs, drive, fine, extra=more)
        slopes = input_derivatives(record, pool.structure.inputs, drive, fine, pool.free)
        if last is None:
            columns = (*data.nu.T, *data.turn.T)
            fixed = np.column_stack([np.interp(fine, node, column) for column in columns])
        else:
            fixed = last[leg][:, :at]
        out.append(np.ascontiguousarray(np.hstack([fixed, inputs, slopes.reshape(len(fine), -1)])))
    return out


def fit_pool(pool: Pool, first: Array) -> PoolFit:
    """Fit the common unknowns from coefficients `first` (t,)."""
    count, k = len(pool.structure.terms), len(pool.structure.velocities)
    lower = np.array([t.mean if t.sd == 0.0 else t.lower for t in pool.structure.terms])
    upper = np.array([t.mean if t.sd == 0.0 else t.upper for t in pool.structure.terms])
    lower = np.append(lower, [bounds_of(name)[0] for name in pool.free])
    upper = np.append(upper, [bounds_of(name)[1] for name in pool.free])
    begin = values_of(pool.drive)
    common = np.clip(np.append(first, [begin[name] for name in pool.free]), lower, upper)
    local = np.array(
        [
            np.append(pool.prepared[window.leg].start[window.first], np.zeros(k))
            for window in pool.windows
        ]
    )
    sigma, colour = _first_sizes(pool), np.ones(2 * k)
    work = PoolWork(pool, count)
    for _ in range(ROUNDS):

        def evaluate(
            common: Array,
            local: Array,
            with_equations: bool,
            sigma: Array = sigma,
            colour: Array = colour,
        ) -> Evaluation:
            return work.evaluate(common, local, sigma, colour)

        best = maximise(evaluate, common, local, lower=lower, upper=upper, most_steps=MOST_STEPS)
        common, local = best.common, best.local
        used = sigma, colour
        sigma, colour = work.sizes(common, local, sigma)
        if np.all(np.abs(sigma / used[0] - 1.0) < SETTLED):
            break
    at_bound = (common <= lower) | (common >= upper)
    covariance, information, data_variances = _covariances(work, best, *used, at_bound)
    return PoolFit(
        pool.names,
        common,
        covariance,
        information,
        data_variances,
        at_bound,
        local,
        used[0],
        used[1],
        best.objectives[-1],
        best.word,
        changed(pool.drive, dict(zip(pool.free, common[count:].tolist(), strict=True))),
        len(pool.windows),
    )


MOST_STATES = 200_000
"""States and sensitivities of windows that are worked on at once."""


@dataclass(frozen=True)
class WindowGroup:
    """Windows by number, and their measured values one after another (m,).

    `places`: of the measured ones among the states (n 2k,) of each window; `channel` (m,);
    `parts`: slices of the windows.
    """

    numbers: tuple[int, ...]
    places: tuple[Index, ...]
    channel: Index
    measured: Array
    parts: tuple[slice, ...]


@dataclass
class PoolWork:
    """Evaluation of a pool; the rows of the last drive are kept."""

    pool: Pool
    count: int
    at: bytes = b""
    rows: tuple[Array, ...] = ()
    last: tuple[bytes, Evaluation | None] = (b"", None)
    kept_groups: tuple[WindowGroup, ...] = ()

    def prior(self, common: Array) -> tuple[float, Array, Array]:
        """Return cost, precision (g,) and pull (g,) of the priors."""
        precision, mean = np.zeros(len(common)), np.zeros(len(common))
        for i, term in enumerate(self.pool.structure.terms):
            if 0.0 < term.sd < np.inf:
                precision[i], mean[i] = term.sd**-2, term.mean
        for i, name in enumerate(self.pool.free, self.count):
            own = prior_of(name)
            if own is not None:
                mean[i], precision[i] = own[0], own[1] ** -2
        away = mean - common
        return 0.5 * float(precision @ away**2), precision, precision * away

    def run(self, common: Array, local: Array, number: int) -> Array:
        """Return states and sensitivities of one window."""
        drive_values = common[self.count :]
        if not self.rows or drive_values.tobytes() != self.at:
            pool = self.pool
            drive = changed(pool.drive, dict(zip(pool.free, drive_values.tolist(), strict=True)))
            self.rows = tuple(loop_rows(pool, drive, self.rows or None))
            self.at = drive_values.tobytes()
        window = self.pool.windows[number]
        return motion(self.pool, self.rows[window.leg], common[: self.count], window, local[number])

    def group(self, *numbers: int) -> WindowGroup:
        """Return windows with what is measured in them."""
        places, channels, measured = [], [], []
        for number in numbers:
            window = self.pool.windows[number]
            values = self.pool.prepared[window.leg].channels[window.nodes]
            present = np.isfinite(values)
            places.append(np.flatnonzero(present))
            channels.append(np.nonzero(present)[1])
            measured.append(values[present])
        ends = np.cumsum([len(part) for part in places]).tolist()
        parts = tuple(map(slice, [0, *ends], ends))
        return WindowGroup(
            numbers, tuple(places), np.concatenate(channels), np.concatenate(measured), parts
        )

    @property
    def groups(self) -> tuple[WindowGroup, ...]:
        """Return all windows, in groups as large as the memory for them allows."""
        if not self.kept_groups:
            k = len(self.pool.structure.velocities)
            width = 1 + self.count + len(self.pool.free) + 3 * k
            sizes = [2 * k * width * (window.end - window.first) for window in self.pool.windows]
            groups: list[list[int]] = [[]]
            for number, size in enumerate(sizes):
                if groups[-1] and size + sum(sizes[i] for i in groups[-1]) > MOST_STATES:
                    groups.append([])
                groups[-1].append(number)
            self.kept_groups = tuple(self.group(*numbers) for numbers in groups)
        return self.kept_groups

    def errors(
        self, common: Array, local: Array, group: WindowGroup, sigma: Array
    ) -> tuple[Array, Array]:
        """Return errors (m,) of some windows in sigma and their Jacobian (m, P)."""
        states = [self.run(common, local, number) for number in group.numbers]
        predicted = np.concatenate(
            [
                item.reshape(-1, item.shape[2])[places]
                for item, places in zip(states, group.places, strict=True)
            ]
        )
        scale = sigma[group.channel]
        error = (predicted[:, 0] - group.measured) / scale
        jacobian = predicted[:, 1:] / scale[:, None]
        k = len(self.pool.structure.velocities)
        jacobian[:, jacobian.shape[1] - k + np.flatnonzero(self.pool.constant_sd == 0.0)] = 0.0
        return error, jacobian

    def loss(self, error: Array) -> tuple[Array, Array, Array]:
        """Return rho(e), rho'(e) / e and rho''(e)."""
        if self.pool.loss == "squares":
            return 0.5 * error**2, np.ones_like(error), np.ones_like(error)
        root = np.sqrt(1.0 + error**2)
        return root - 1.0, 1.0 / root, root**-3.0

    def evaluate(self, common: Array, local: Array, sigma: Array, colour: Array) -> Evaluation:
        """Return the objective at some unknowns, and its normal equations.

        The last is kept: a search asks for the equations where it tried the objective.
        """
        key = b"".join(item.tobytes() for item in (common, local, sigma, colour))
        if key == self.last[0] and self.last[1] is not None:
            return self.last[1]
        g = len(common)
        objective, precision, pull = self.prior(common)
        matrix, vector = np.diag(precision), pull
        blocks, couplings, rights = [], [], []
        for group in self.groups:
            for cost, normal, right in self.windows(common, local, group, sigma, colour):
                objective += cost
                matrix = matrix + normal[:g, :g]
                vector = vector + right[:g]
                blocks.append(normal[g:, g:])
                couplings.append(normal[g:, :g])
                rights.append(right[g:])
        equations = NormalEquations(matrix, vector, tuple(blocks), tuple(couplings), tuple(rights))
        evaluation = Evaluation(objective if np.isfinite(objective) else np.inf, equations)
        self.last = key, evaluation
        return evaluation

    def windows(
        self,
        common: Array,
        local: Array,
        group: WindowGroup,
        sigma: Array,
        colour: Array,
        *,
        curvature: bool = False,
    ) -> Iterator[tuple[float, Array, Array]]:
        """Yield cost, normal matrix (P, P) and minus gradient (P,) of each window.

        The matrix of a search has weights rho'(e) / e, and is never too flat; with
        `curvature` it has rho''(e), as the covariance needs it.
        """
        pool, k = self.pool, len(self.pool.structure.velocities)
        error, jacobian = self.errors(common, local, group, sigma)
        cost, weight, bend = self.loss(error)
        by_channel = colour[group.channel]
        scaled, cost, pull = jacobian / by_channel[:, None], cost / by_channel, weight * error
        bent = jacobian * (bend if curvature else weight)[:, None]
        at = jacobian.shape[1] - k + np.arange(k)
        own = np.where(pool.constant_sd > 0.0, np.maximum(pool.constant_sd, 1e-9) ** -2.0, 0.0)
        for number, part in zip(group.numbers, group.parts, strict=True):
            right = -(scaled[part].T @ pull[part])
            normal = scaled[part].T @ bent[part]
            constant = local[number, 2 * k :]
            normal[at, at] += own
            right[at] -= own * constant
            yield float(np.sum(cost[part]) + 0.5 * own @ constant**2), normal, right

    def sizes(self, common: Array, local: Array, sigma: Array) -> tuple[Array, Array]:
        """Return sigma and colour (2k,) of the errors that a fit leaves.

        sigma: 90 % quantile of |e| over 1.64. colour: (1 + rho) / (1 - rho), rho the correlation of
        neighbours, from errors clipped at 3 sigma.
        """
        parts: dict[int, list[Array]] = {}
        for group in self.groups:
            errors, _ = self.errors(common, local, group, sigma)
            for part in group.parts:
                error, channel = errors[part], group.channel[part]
                for item in np.unique(channel):
                    parts.setdefault(int(item), []).append(error[channel == item] * sigma[item])
        size, colour = sigma.copy(), np.ones(len(sigma))
        for item, series in parts.items():
            size[item] = max(
                float(np.quantile(np.abs(np.concatenate(series)), QUANTILE)) / NORMAL_AT_QUANTILE,
                1e-5,
            )
            cut = [np.clip(part, -3.0 * size[item], 3.0 * size[item]) for part in series]
            power = sum(float(part @ part) for part in cut)
            product = sum(float(part[1:] @ part[:-1]) for part in cut)
            rho = min(max(product / power, 0.0), 1.0 - 2.0 / LARGEST_COLOUR)
            colour[item] = (1.0 + rho) / (1.0 - rho)
        return size, colour


def _first_sizes(pool: Pool) -> Array:
    values = np.concatenate(
        [pool.prepared[w.leg].channels[w.nodes] - pool.prepared[w.leg].channels[w.first]
         for w in pool.windows]
    )  # fmt: skip
    present = np.isfinite(values).any(axis=0)
    size = np.ones(values.shape[1])
    size[present] = 0.3 * np.nanstd(values[:, present], axis=0) + 1e-5
    return size


def _covariances(
    work: PoolWork, best: Optimum, sigma: Array, colour: Array, at_bound: Mask
) -> tuple[Array, Array, Array]:
    """Return covariance by windows left out, by information, variances without priors.

    CR3: (W - 1) / W sum over windows of d d', d = -(H - H_w)^-1 s_w: H, H_w information
    of all and of one window, its own unknowns taken out, s_w its score. As few windows tell
    most of a coefficient, its errors are those of so few (`wider`).
    """
    g, count = len(best.common), len(work.pool.windows)
    free = np.flatnonzero(~at_bound)
    parts, scores = [], []
    for _, normal, right in chain.from_iterable(
        work.windows(best.common, best.local, group, sigma, colour, curvature=True)
        for group in work.groups
    ):
        solved = solve_scaled(normal[g:, g:], np.column_stack([normal[g:, :g], right[g:]]))
        parts.append((normal[:g, :g] - normal[:g, g:] @ solved[:, :-1])[np.ix_(free, free)])
        scores.append((right[:g] - normal[:g, g:] @ solved[:, -1])[free])
    data = np.sum(parts, axis=0)
    full = data + np.diag(work.prior(best.common)[1][free])
    moves = np.array(
        [solve_scaled(full - part, score) for part, score in zip(parts, scores, strict=True)]
    )
    out = np.zeros((3, g, g))
    cell = np.ix_(free, free)
    moves *= wider(full, parts)
    out[0][cell] = (count - 1) / count * moves.T @ moves
    out[1][cell] = solve_scaled(full, np.eye(free.size))
    out[2][cell] = solve_scaled(data, np.eye(free.size))
    return out[0], out[1], np.diag(out[2])


def with_doubts(pool: Pool, fit: PoolFit, doubtful: Sequence[Sequence[AxisRecord]]) -> PoolFit:
    """Return a fit whose covariance has the errors of what its records rest on.

    doubtful: for each such figure, the records with it one deviation off. Errors e' of
    these move the estimate by -H^-1 J' rho'' (e' - e).
    """
    g, count = len(fit.values), len(pool.structure.terms)
    works = [PoolWork(with_records(pool, own), count) for own in (pool.records, *doubtful)]
    sizes = fit.values, fit.local
    free, pulls = np.flatnonzero(~fit.at_bound), np.zeros((g, len(doubtful)))
    full = np.diag(works[0].prior(fit.values)[1])
    for number in range(len(pool.windows) if doubtful else 0):
        own = works[0].group(number)
        ((_, normal, _),) = works[0].windows(*sizes, own, fit.sigma, fit.colour, curvature=True)
        error, jacobian = works[0].errors(*sizes, own, fit.sigma)
        moved = [
            work.errors(*sizes, work.group(number), fit.sigma)[0] - error for work in works[1:]
        ]
        bend = works[0].loss(error)[2] / fit.colour[own.channel]
        right = -(jacobian.T @ (bend[:, None] * np.column_stack(moved)))
        solved = solve_scaled(normal[g:, g:], np.column_stack([normal[g:, :g], right[g:]]))
        full = full + normal[:g, :g] - normal[:g, g:] @ solved[:, :g]
        pulls = pulls + right[:g] - normal[:g, g:] @ solved[:, g:]
    cell, changes = np.ix_(free, free), np.zeros((g, len(doubtful)))
    changes[free] = solve_scaled(full[cell], pulls[free])
    return replace(fit, covariance=fit.covariance + changes @ changes.T)


def with_records(pool: Pool, records: Sequence[AxisRecord]) -> Pool:
    """Return a pool with other records, of the same windows."""
    return make_pool(
        pool.structure, records, pool.windows, constant_sd=pool.constant_sd, drive=pool.drive,
        free=pool.free, extra=pool.extra, loss=pool.loss,
    )  # fmt: skip


def wider(full: Array, parts: Sequence[Array]) -> Array:
    """Return by how much an error (f,) is larger than W - 1 degrees of freedom say.

    full (f, f), parts (W of them): information of all windows, with priors, and of each.
    Degrees of freedom by the windows' expected shares p_w of the variance, the diagonal of
    (H - H_w)^-1 H_w (H - H_w)^-1: (sum p)^2 / sum p^2 (Satterthwaite; Bell and McCaffrey
    2002), less one of W. Student's t at 95 % over that of W - 1.
    """
    count, shares = len(parts), []
    for part in parts:
        once = solve_scaled(full - part, part)
        shares.append(np.maximum(np.diag(solve_scaled(full - part, once.T)), 1e-300))
    p = np.array(shares) / np.sum(shares, axis=0)
    degrees = (count - 1) / count / np.sum(p**2, axis=0)
    usual = widened_by(count - 1)
    return np.array([widened_by(float(item)) / usual for item in degrees])
