"""Whether the drive moves as far between dives and climbs as the log says.

Drag and trim stand for any drive at single depths. How the depth rate follows layers of the
water and pressure does not: it says how large the net buoyancy is, each way by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.gliding.steady_glide import GliderBody
from auvid.hydro.identification.glide.bins import GlideRows
from auvid.hydro.identification.glide.fit import GlideEstimate, fit_glides, fitted_beside
from auvid.hydro.identification.glide.problem import UNKNOWNS, FileFigure

CLEAR_GAP, LEAST_GAP = 3.0, 0.1
"""Standard errors, and share of the stroke, from which on the drive is another than logged."""
MOST_GAP = 0.25
"""Share of the stroke beyond which nothing is said of the drag that a gap would give."""

ALL_FIGURES = ("C_D", "C_L", "alpha", *UNKNOWNS[:5])


@dataclass(frozen=True)
class DriveGap:
    """How much more the drive does on climbs than logged, beside the trim [m^3].

    `error_m3`: standard error, of Student's t. `named`: it is clear and large. `limit_m3`:
    that gap, or the largest that would not be found. `drag_factor`: C_D with it over that
    without, nan where it is too large to say.
    """

    size_m3: float
    error_m3: float
    named: bool
    limit_m3: float
    drag_factor: float


def drive_gap(
    rows: GlideRows,
    estimate: GlideEstimate,
    *,
    body: GliderBody,
    prior: dict[str, FileFigure],
    stroke_m3: float,
    pitch_rad: float,
) -> DriveGap | None:
    """Return the gap of the drive; None for one direction alone."""
    up = rows.state.pitch_rad > 0.0
    if "trim" not in estimate.free:
        return None
    size, error = fitted_beside(rows, estimate, "trim", up, prior=prior)
    if not np.isfinite(error):
        return None
    least = LEAST_GAP * stroke_m3
    named = abs(size) > max(CLEAR_GAP * error, least)
    limit = size if named else -max(NORMAL_95 * error, least)
    if abs(limit) > MOST_GAP * stroke_m3:
        return DriveGap(size, error, named, limit, float("nan"))
    # Half of it each way, as the trim takes what both share.
    state = replace(rows.state, drive_m3=rows.state.drive_m3 + limit * (up - 0.5))
    try:
        other = fit_glides(replace(rows, state=state), body=body, prior=prior)
    except DataError:
        return DriveGap(size, error, named, limit, float("nan"))
    factor = other.at_pitch(pitch_rad)["C_D"][0] / estimate.at_pitch(pitch_rad)["C_D"][0]
    return DriveGap(size, error, named, limit, factor)


def doubted(estimate: GlideEstimate, *names: str) -> GlideEstimate:
    """Return an estimate whose identified figures of these names are weak."""
    verdicts = {
        name: "weak" if name in names and verdict == "identified" else verdict
        for name, verdict in estimate.verdicts.items()
    }
    figures = tuple(dict.fromkeys((*estimate.doubted, *names)))
    return replace(estimate, verdicts=verdicts, doubted=figures)
