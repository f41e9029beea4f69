"""Fits of glides with and without speed, and what they predict of other glides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Mask
from auvid.hydro.dynamics.gliding.steady_glide import GliderBody
from auvid.hydro.identification.glide.bins import GlideRows
from auvid.hydro.identification.glide.fit import GlideEstimate, fit_glides
from auvid.hydro.identification.glide.problem import UNKNOWNS, FileFigure
from auvid.hydro.identification.regression.standard_errors import widened_by

CLEAR_STEP, LEAST_STEP = 6.0, 0.03
"""Standard errors, as the largest of many places is looked at, and share of the stroke from which
on a trim that changes under way is one."""
LEAST_BESIDE = 2
"""Glides before and after such a change."""
TRIM_SLOPE_M3 = 1e-6


@dataclass(frozen=True)
class GlideComparison:
    """The estimate, that without the speed (None: not measured), and predictions.

    `held_out_rate_m_s` (m,): depth rate of every row by a fit to the other alternate
    glides; nan where too few are left. `fit_percent`: of all held-out rows;
    `fit_within_percent`: of dives and climbs each about its own mean. `other_way_percent`:
    climbs by a fit to dives alone and the other way round; nan where none.
    """

    estimate: GlideEstimate
    without_speed: GlideEstimate | None
    held_out_rate_m_s: Array
    fit_percent: float
    fit_within_percent: float
    other_way_percent: Mapping[str, float]


def compare(
    rows: GlideRows, *, body: GliderBody, prior: Mapping[str, FileFigure]
) -> GlideComparison:
    """Return the estimate of rows and what it is judged against.

    Raises `DataError` as `fit_glides`.
    """
    estimate = fit_glides(rows, body=body, prior=prior)
    bare = None
    if np.isfinite(rows.speed_m_s).any():
        bare = fit_glides(rows.without_speed(), body=body, prior=prior)
    climbs = rows.state.pitch_rad > 0.0
    # Number the glides of each direction; alternate ones are predicted by the others.
    half = np.zeros(rows.glide.size, dtype=bool)
    for direction in (climbs, ~climbs):
        numbers = np.unique(rows.glide[direction])
        half[direction] = np.searchsorted(numbers, rows.glide[direction]) % 2 == 0
    rate = np.full(rows.glide.size, np.nan)
    for judged in (half, ~half):
        rate[judged] = _predicted(rows, ~judged, judged, body, prior)
    measured = rows.depth_rate_m_s
    centre = np.where(climbs, _mean(measured[climbs]), _mean(measured[~climbs]))
    other = {
        name: _fit_percent(measured[judged], _predicted(rows, ~judged, judged, body, prior), 0.0)
        for name, judged in (("climbs by dives", climbs), ("dives by climbs", ~climbs))
        if judged.any() and not judged.all()
    }
    return GlideComparison(
        estimate,
        bare,
        rate,
        _fit_percent(measured, rate, _mean(measured)),
        _fit_percent(measured, rate, centre),
        other,
    )


@dataclass(frozen=True)
class TrimStep:
    """A trim that changes before a glide: its number, size [m^3], standard error."""

    glide: int
    size_m3: float
    error_m3: float


def trim_step(rows: GlideRows, estimate: GlideEstimate, stroke_m3: float) -> TrimStep | None:
    """Return the clearest change of the trim under way, None where none is clear.

    Ballast that is thrown, or water that is taken. Trim of each glide by its depth rates;
    dives and climbs have a level each, as a zero of the pitch moves them apart.
    """
    other = estimate.values.copy()
    other[UNKNOWNS.index("trim")] += TRIM_SLOPE_M3
    here, there = (item.predict(rows) for item in (estimate, replace(estimate, values=other)))
    slope = (there.depth_rate_m_s - here.depth_rate_m_s) / TRIM_SLOPE_M3
    left = rows.depth_rate_m_s - here.depth_rate_m_s
    numbers = np.unique(rows.glide)
    own = [rows.glide == number for number in numbers]
    trims = np.array([float(slope[i] @ left[i] / (slope[i] @ slope[i])) for i in own])
    up = np.array([float(np.mean(rows.state.pitch_rad[i]) > 0.0) for i in own])
    first, size, error = clearest_step(trims, up)
    if not first or abs(size) < max(CLEAR_STEP * error, LEAST_STEP * stroke_m3):
        return None
    return TrimStep(int(numbers[first]), size, error)


def clearest_step(values: Array, up: Array) -> tuple[int, float, float]:
    """Return where values (n,) step most clearly, the size and its standard error.

    Place 0 for none, and where a straight line explains them as well: what changes bit by
    bit does not step. up (n,): 1 or 0, each with a level of its own. The error is that of
    Student's t for so few values.
    """
    order = np.arange(values.size, dtype=np.float64)
    levels = np.column_stack([way for way in (up, 1.0 - up) if way.any()])
    spare = values.size - levels.shape[1] - 1
    if spare < 2:
        return 0, 0.0, 0.0
    line = np.column_stack([levels, order])
    rest = values - line @ np.linalg.lstsq(line, values, rcond=None)[0]
    best, least = (0, 0.0, 0.0), float(rest @ rest)
    for first in range(LEAST_BESIDE, values.size - LEAST_BESIDE + 1):
        design = np.column_stack([levels, order >= first])
        fitted, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
        rest = values - design @ fitted
        squares = float(rest @ rest)
        if rank < design.shape[1] or squares >= least:
            continue
        error = np.sqrt(squares / spare * np.linalg.inv(design.T @ design)[-1, -1])
        best, least = (first, float(fitted[-1]), float(error) * widened_by(spare)), squares
    return best


def _predicted(
    rows: GlideRows, fitted: Mask, judged: Mask, body: GliderBody, prior: Mapping[str, FileFigure]
) -> Array:
    """Return the depth rate of judged rows by a fit to others, nan where that fails."""
    try:
        estimate = fit_glides(rows.where(fitted), body=body, prior=prior)
    except DataError:
        return np.full(int(judged.sum()), np.nan)
    return estimate.predict(rows.where(judged)).depth_rate_m_s


def _mean(values: Array) -> float:
    return float(values.mean()) if values.size else 0.0


def _fit_percent(measured: Array, predicted: Array, centre: Array | float) -> float:
    """Return 100 (1 - |y - y_hat| / |y - centre|) of rows that have a prediction."""
    finite = np.isfinite(predicted)
    if not finite.any():
        return float("nan")
    error = np.linalg.norm((measured - predicted)[finite])
    spread = np.linalg.norm((measured - centre)[finite])
    return float(100.0 * (1.0 - error / spread))
