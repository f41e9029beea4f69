"""Fits of glides with and without speed, and what they predict of other glides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Mask
from auvid.hydro.dynamics.gliding.steady_glide import GliderBody
from auvid.hydro.identification.glide.bins import GlideRows
from auvid.hydro.identification.glide.fit import FileFigure, GlideEstimate, fit_glides


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
