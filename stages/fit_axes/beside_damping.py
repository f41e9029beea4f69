"""Righting moment, and a force that follows another: what is beside damping."""

from __future__ import annotations

import numpy as np

from auvid.hydro.axis_figures import CONSTANT, FORCE, AxisEquation, Inertia, as_forces
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.hydro.identification.axes.single_axis import SURGE_LAG_S
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, WEAK
from auvid.hydro.partial_model import unit_in
from auvid.stages.columns import AXIS_UNITS
from auvid.stages.few_axes import mean_by_errors
from auvid.stages.fit_axes.fitted import AxisFits
from auvid.stages.fit_axes.scaling import ScaledAxes


def righting_and_surge(fits: AxisFits, scaled: ScaledAxes) -> dict[str, object]:
    """Return the righting moment and the force of surge on heave, where they are.

    k = -e m of roll or pitch, m its inertia, x' = ... + e sin(angle); of two the mean by
    their errors. Heave: F = (e m) X behind its lag, where X counts in newtons or in the
    shares of the file. The error of m, 1 / c or a pull's, is in both intervals.
    """
    out: dict[str, object] = {}
    moments = []
    for item in fits.fitted:
        if item.righting is not None:
            value, error = _as_force(item.righting, scaled.inertias[item.axis])
            if value + NORMAL_95 * error < 0.0:
                moments.append((item.axis, -value, error))
    if moments:
        value, error = mean_by_errors([item[1:] for item in moments])
        unit = unit_of(moments[0][0], CONSTANT, scaled)
        out["righting"] = {
            "axes": [axis for axis, _, _ in moments],
            "value": value,
            "unit": unit,
            "interval_95": interval_95(value, error),
        }
    for item in fits.fitted:
        if item.surge is not None:
            # The force ahead counts as X of the file; a command of surge is its gain less.
            ahead = scaled.forces.get("X")
            gain, gain_error = 1.0, 0.0
            if fits.normalised:
                if ahead is None:
                    continue  # nothing in the file turns a command of surge into a force
                place = ahead.names.index(FORCE)
                gain = float(ahead.values[place])
                gain_error = float(np.sqrt(max(ahead.covariance[place, place], 0.0)))
            force, error = _as_force(item.surge, scaled.inertias[item.axis])
            value = force / gain
            low, high = interval_95(value, float(np.hypot(error, value * gain_error)) / gain)
            out["cross_forces"] = [
                {
                    "axis": item.axis,
                    "of": "X",
                    "value": value,
                    "lag_s": SURGE_LAG_S,
                    "interval_95": [low, high],
                    "verdict": IDENTIFIED if item.predicts and low * high > 0.0 else WEAK,
                }
            ]
    return out


def _as_force(pair: AxisEquation, inertia: Inertia) -> tuple[float, float]:
    """Return the term beside c as a force, and its standard error."""
    forces = as_forces(pair, inertia)
    place = 1 - forces.names.index(FORCE)
    return float(forces.values[place]), float(np.sqrt(forces.covariance[place, place]))


def unit_of(axis: str, term: str, scaled: ScaledAxes) -> str:
    """Return the unit of a term of an axis as a force."""
    if scaled.unit_of_mass is not None:
        return unit_in(axis, term, scaled.unit_of_mass)
    return AXIS_UNITS[axis] if term == CONSTANT else coefficient_unit(axis, term)


def interval_95(value: float, error: float) -> list[float]:
    """Return the ends of the 95 % interval of a value with a standard error."""
    return [value - NORMAL_95 * error, value + NORMAL_95 * error]
