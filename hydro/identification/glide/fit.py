"""Drag, lift, zero-lift angle and trim of a glider from settled glides.

Gauss-Newton on depth rate and, where measured, speed through the water. What the record
knows worse than the vehicle file is fixed there, and its spread goes into the intervals;
what it knows better is free beside what the file says of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Mask
from auvid.hydro.dynamics.gliding.steady_glide import (
    GliderBody,
    Polar,
    SteadyGlide,
    angle_of_attack,
)
from auvid.hydro.identification.constrained.statuses import PRIOR_SHARE
from auvid.hydro.identification.glide.bins import GlideRows, yos_of
from auvid.hydro.identification.glide.problem import (
    UNKNOWNS,
    FileFigure,
    GlideProblem,
    Pull,
    clustered_covariance,
    glide_of,
    inverse_of,
    polar_of,
    rms_of,
    slopes_of,
)
from auvid.hydro.identification.regression.standard_errors import widened_by
from auvid.hydro.identification.regression.verdicts import clear_of_zero

GlideVerdict = Literal["identified", "weak", "inseparable", "from the prior"]
LOWERINGS = 20
LEAST_GLIDES = 4
LEAST_SPEEDS = 10
"""So many rows with a speed, in two glides or more, free the lift."""
MOST_LIFT = 50.0
"""No hull with wings has that slope of the lift [1/rad]: the search has run away."""
FLATTEST = (0.0, 0.15, 0.3, 0.45)
"""Shares of the rows, the flattest ones, that are left out where no steady glide is so flat."""
FREED = 0.7
"""The record frees an unknown that it alone knows better than this share of the prior."""
OF_RECORD = ("alpha_0", "C_D1")
"""Unknowns that it may free so, in this order."""


@dataclass(frozen=True)
class GlideEstimate:
    """Values and covariance (6, 6) of UNKNOWNS, with verdicts.

    `free`: the unknowns that the record determines; the others are those of the vehicle
    file. `noise_covariance`: without the spread of the fixed ones. `residual_m_s`: RMS of
    depth rate and of speed (nan without). 1.96 standard errors are half of a 95 % interval:
    what the record says counts by Student's t with `degrees`, one less than its yos.
    `doubted`: figures that are weak whatever their interval is.
    """

    values: Array
    covariance: Array
    noise_covariance: Array
    free: tuple[str, ...]
    residual_m_s: tuple[float, float]
    degrees: int
    glides: int
    rows: int
    verdicts: Mapping[str, GlideVerdict]
    body: GliderBody
    doubted: tuple[str, ...] = ()

    @property
    def polar(self) -> Polar:
        """Return drag and lift of the estimate."""
        return polar_of(self.values)

    def value(self, name: str) -> float:
        """Return the value of an unknown in SI."""
        return float(self.values[UNKNOWNS.index(name)])

    def standard_error(self, name: str) -> float:
        """Return the standard error of an unknown, spread of fixed ones included."""
        index = UNKNOWNS.index(name)
        return float(np.sqrt(self.covariance[index, index]))

    def predict(self, rows: GlideRows) -> SteadyGlide:
        """Return the steady glides of the estimate at rows."""
        return glide_of(self.values, rows, self.body)

    def is_steady(self, rows: GlideRows) -> Mask:
        """Return which rows (m,) are steep enough for a steady glide."""
        return np.asarray(np.isfinite(self.predict(rows).depth_rate_m_s))

    def at_pitch(self, pitch_rad: float) -> dict[str, tuple[float, float]]:
        """Return angle of attack [rad], C_D, C_L of a glide, each with standard error.

        The error follows from the covariance to first order.
        """
        values = _glide_figures(self.values, pitch_rad)
        slope = slopes_of(lambda p: _glide_figures(p, pitch_rad), self.values)
        errors = np.sqrt(np.einsum("ij,jk,ik->i", slope, self.covariance, slope))
        names = ("alpha", "C_D", "C_L")
        return {n: (float(v), float(e)) for n, v, e in zip(names, values, errors, strict=True)}


def fit_glides(
    rows: GlideRows, *, body: GliderBody, prior: Mapping[str, FileFigure]
) -> GlideEstimate:
    """Return the estimate of rows of settled glides.

    minimise sum (w - w_hat)^2 / s_w^2 + sum (U - U_hat)^2 / s_U^2 over the free unknowns,
    depth rate w and speed U of `steady_glide`, s_w and s_U from the residuals. With J_f
    and J_h the slopes by free and fixed unknowns, H = J_f' J_f, S = -H^-1 J_f' J_h and the
    spread P of the fixed ones: covariance H^-1 (sum_g s_g s_g') H^-1 + S P S', where
    s_g = J_g' (I - J_g H^-1 J_g')^-1 r_g of yo g (as if it had been left out:
    MacKinnon and White 1985, HC3, by clusters). Free are drag and, with dives and climbs,
    trim; lift where speed was measured; induced drag and zero-lift angle where the
    record alone knows them better than FREED of the prior: then the file pulls at them with
    its spread, as strongly as the residuals are coloured (`_pulls`). Where a search ends at
    the edge of what glides, the flattest rows are left out. Raises `DataError` for too few glides
    and for a record that no balance fits.
    """
    steepness = np.abs(rows.state.pitch_rad)
    for share in FLATTEST:
        kept = rows.where(steepness >= np.quantile(steepness, share)) if share else rows
        count = np.unique(kept.glide).size
        if count < LEAST_GLIDES and share:
            break
        if count < LEAST_GLIDES:
            raise DataError(
                "too few settled glides", value=int(count), allowed=f"at least {LEAST_GLIDES}"
            )
        problem, values, free = _solved(kept, body, prior)
        if np.isfinite(problem.slopes(values)).all() and values[2] < MOST_LIFT:
            return _estimate(problem, values, free, prior)
    raise _no_glide(rows)


def _solved(
    rows: GlideRows, body: GliderBody, prior: Mapping[str, FileFigure]
) -> tuple[GlideProblem, Array, list[str]]:
    """Return the least squares of rows, its values, and what the record frees."""
    measured = np.isfinite(rows.speed_m_s)
    up = rows.state.pitch_rad > 0.0
    free = ["C_D0"]
    if up.any() and not up.all():
        free.append("trim")
    if measured.sum() >= LEAST_SPEEDS and np.unique(rows.glide[measured]).size > 1:
        free.append("C_L_alpha")
    problem = GlideProblem(rows, body, measured, np.array([0.01, 0.01]))
    values = _start(problem, np.array([prior[name].mean for name in UNKNOWNS]))
    values = problem.solve(values, free)
    if "trim" in free:
        values = _freed(problem, values, free, prior)
    if np.isfinite(problem.standard_errors(values, free)).all():
        problem.pulls = _pulls(problem, values, free, prior)
        values = problem.solve(values, free)
    return problem, values, free


def _freed(
    problem: GlideProblem, values: Array, free: list[str], prior: Mapping[str, FileFigure]
) -> Array:
    """Return values with what the record alone knows better freed, and named in `free`.

    The record is asked where it puts the unknown: beside a figure of the file that is off,
    residuals are those of the file, and the unknown looks like one that nothing tells. Once
    more for the first, since the second may have been what was off.
    """
    for name in (*OF_RECORD, OF_RECORD[0]):
        if name in free:
            continue
        noise, trial = problem.noise, problem.solve(values, [*free, name])
        error = problem.standard_errors(trial, [*free, name])[-1]
        if error < FREED * prior[name].sd:
            free.append(name)
            values = trial
        else:
            problem.noise = noise
    return values


def _pulls(
    problem: GlideProblem, values: Array, free: list[str], prior: Mapping[str, FileFigure]
) -> tuple[Pull, ...]:
    """Return the pulls of the file at what the record has freed.

    Residuals of a yo go together: their squares count for more than they know. The weight
    of a pull is raised by the ratio of clustered to white variance of its unknown.
    """
    jacobian = problem.slopes(values)[:, [UNKNOWNS.index(name) for name in free]]
    clustered = np.diag(clustered_covariance(jacobian, problem.residuals(values), problem.yo))
    white = np.diag(inverse_of(jacobian))
    return tuple(
        Pull(name, prior[name], max(float(clustered[place] / white[place]), 1.0))
        for place, name in enumerate(free)
        if name in OF_RECORD
    )


def fitted_beside(
    rows: GlideRows,
    estimate: GlideEstimate,
    name: str,
    part: Mask,
    *,
    prior: Mapping[str, FileFigure],
) -> tuple[float, float]:
    """Return what an unknown is more in a part of the rows, and its standard error.

    To first order beside all unknowns; what the file knows of them pulls at them as in
    `fit_glides`. The error is infinite where nothing tells it.
    """
    measured = np.isfinite(rows.speed_m_s)
    noise = np.where(np.isfinite(estimate.residual_m_s), estimate.residual_m_s, 1.0)
    colour = 1.0
    for _ in range(2):
        pulls = tuple(
            Pull(each, prior[each], colour)
            for each in UNKNOWNS
            if (each not in estimate.free or each in OF_RECORD) and prior[each].sd > 0.0
        )
        problem = GlideProblem(rows, estimate.body, measured, noise, pulls)
        slopes, residual = problem.slopes(estimate.values), problem.residuals(estimate.values)
        inside = np.concatenate([part, part[measured], np.zeros(len(pulls), dtype=bool)])
        names = [each for each in UNKNOWNS if each in estimate.free or prior[each].sd > 0.0]
        columns = [UNKNOWNS.index(each) for each in names]
        design = np.column_stack([slopes[:, columns], slopes[:, UNKNOWNS.index(name)] * inside])
        scale = np.linalg.norm(design, axis=0)
        if not (np.isfinite(scale).all() and scale.all() and np.isfinite(residual).all()):
            return 0.0, float("inf")
        solved, _, rank, _ = np.linalg.lstsq(design / scale, -residual, rcond=1e-10)
        if rank < scale.size:
            return 0.0, float("inf")
        inverse = inverse_of(design)
        covariance = clustered_covariance(design, residual + design / scale @ solved, problem.yo)
        colour = max(float(covariance[-1, -1] / inverse[-1, -1]), 1.0)
    spread = [inverse[-1, names.index(pull.name)] * pull.colour / pull.figure.sd for pull in pulls]
    variance = covariance[-1, -1] * widened_by(estimate.degrees) ** 2 + np.sum(np.square(spread))
    return float(solved[-1] / scale[-1]), float(np.sqrt(variance))


def drag_asked(rows: GlideRows, *, body: GliderBody, prior: Mapping[str, FileFigure]) -> float:
    """Return the drag that the median depth rate asks for."""
    return _first_drag(np.array([prior[name].mean for name in UNKNOWNS]), rows, body)


def _start(problem: GlideProblem, values: Array) -> Array:
    """Return starting values with which every row has a glide.

    The drag is that of the median depth rate. With more induced drag than the flattest
    glide allows there would be none: it is lowered. Raises `DataError` where that does
    not help.
    """
    for _ in range(LOWERINGS):
        values[0] = _first_drag(values, problem.rows, problem.body)
        if np.isfinite(problem.residuals(values)).all():
            return values
        values[1] *= 0.8
    raise _no_glide(problem.rows)


def _no_glide(rows: GlideRows) -> DataError:
    """Return the error of rows that no balance fits."""
    drive = rows.state.drive_m3
    return DataError(
        "no drag makes a glide of these rows: net buoyancy and depth rate go against each other",
        field="buoyancy_drive_m3",
        value=f"{1e6 * drive.min():.3g} to {1e6 * drive.max():.3g} cm^3 while it glides",
        remedy=(
            "Was the drive at its stop, or does its column have another zero or unit than the"
            " vehicle file? Mass and volume there decide at which drive it floats. Or is it pitched"
            " flatter than any glide by the lift_slope there? stages.glide.least_pitch_deg leaves"
            " flat ones out."
        ),
    )


def _first_drag(values: Array, rows: GlideRows, body: GliderBody) -> float:
    """Return the drag that the median depth rate asks for, other unknowns as fixed."""
    low, high = 1e-4, 1e3
    typical = float(np.median(np.abs(rows.depth_rate_m_s)))
    for _ in range(60):
        values[0] = np.sqrt(low * high)
        rate = np.abs(glide_of(values, rows, body).depth_rate_m_s)
        slow = not np.isfinite(rate).any() or np.nanmedian(rate) < typical
        low, high = (low, values[0]) if slow else (values[0], high)
    return float(np.sqrt(low * high))


def _glide_figures(values: Array, pitch_rad: float) -> Array:
    """Return angle of attack, C_D and C_L (3,) of values of UNKNOWNS at a pitch."""
    polar = polar_of(values)
    alpha = angle_of_attack(pitch_rad, polar)
    lift = polar.lift_slope * (alpha - polar.zero_lift_rad)
    return np.array([float(alpha), float(polar.drag_coefficient(alpha)), float(lift)])


def _estimate(
    problem: GlideProblem, values: Array, free: list[str], prior: Mapping[str, FileFigure]
) -> GlideEstimate:
    residual, jacobian = problem.residuals(values), problem.slopes(values)
    inside = [UNKNOWNS.index(name) for name in free]
    fixed = [index for index in range(values.size) if index not in inside]
    spread = np.array([prior[UNKNOWNS[index]].sd for index in fixed])
    noise = np.zeros((values.size, values.size))
    noise[np.ix_(inside, inside)] = clustered_covariance(jacobian[:, inside], residual, problem.yo)
    # The fixed unknowns move the free ones by S, and themselves by their spread.
    moves = np.zeros((values.size, len(fixed)))
    moves[fixed, range(len(fixed))] = spread
    scale = np.linalg.norm(jacobian[:, inside], axis=0)
    answer = np.linalg.lstsq(jacobian[:, inside] / scale, jacobian[:, fixed] * spread, rcond=None)
    moves[inside] = -answer[0] / scale[:, None]
    yos = int(np.unique(yos_of(problem.rows)).size)
    noise *= widened_by(yos - 1) ** 2
    pulled = inverse_of(jacobian[:, inside])[:, [free.index(pull.name) for pull in problem.pulls]]
    spreads = np.array([pull.colour / pull.figure.sd for pull in problem.pulls])
    noise[np.ix_(inside, inside)] += (pulled * spreads**2) @ pulled.T
    covariance = noise + moves @ moves.T
    split = problem.rows.t_s.size
    rms = rms_of(residual[:split]), rms_of(residual[problem.speeds])
    parts = [each * noise for each, noise in zip(rms, problem.noise, strict=True)]
    return GlideEstimate(
        values,
        covariance,
        noise,
        tuple(free),
        (float(parts[0]), float(parts[1]) if problem.measured.any() else float("nan")),
        max(yos - 1, 1),
        int(np.unique(problem.rows.glide).size),
        split,
        _verdicts(values, covariance, noise, free),
        problem.body,
    )


def _verdicts(
    values: Array, covariance: Array, noise: Array, free: list[str]
) -> dict[str, GlideVerdict]:
    """Return the verdict on every unknown.

    Held ones rest on the prior; so does drag without lift where the spread of a held
    induced drag gives `PRIOR_SHARE` of its variance: glides of one pitch tell C_D, their
    sum. Without dives and climbs drag and trim are one figure.
    """
    verdicts: dict[str, GlideVerdict] = {}
    for index, name in enumerate(UNKNOWNS):
        error = float(np.sqrt(covariance[index, index]))
        if name not in free:
            verdicts[name] = "from the prior"
        else:
            clear = clear_of_zero(float(values[index]), error)
            verdicts[name] = "identified" if clear else "weak"
    if "C_D1" not in free and noise[0, 0] <= (1.0 - PRIOR_SHARE) * covariance[0, 0]:
        verdicts["C_D0"] = "from the prior"
    if "trim" not in free:
        verdicts["C_D0"] = verdicts["trim"] = "inseparable"
    return verdicts
