"""The figures of one dive that a fleet pools and watches, from its records."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from auvid.data_schemas.records.models import AxisCard, ModelCard
from auvid.data_schemas.records.motion import InstallationRecord
from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet.drag import DragAtSpeed, drag_at_speed
from auvid.hydro.identification.regression.least_squares import CONSTANT

Figures = dict[str, tuple[float, float]]
"""Name of a figure -> its value and standard error."""


def figures_of_model(card: ModelCard, speeds: Mapping[str, float]) -> Figures:
    """Return drag at a speed [N, N m] and constant forces of a model card.

    `speeds`: axis -> speed [m/s, rad/s] at which all dives are compared, as
    `common_speed` gives it. `drag X` to `drag N`; `buoyancy`: the constant force upwards
    [N] beyond the vehicle file, from the constant of Z, near level trim.
    """
    figures: Figures = {}
    for axis, part in card.axes.items():
        if axis in speeds and (drag := drag_of_axis(part, axis, speeds[axis])) is not None:
            figures[f"drag {axis}"] = drag.force, drag.standard_error
    for item in card.axes["Z"].terms if "Z" in card.axes else ():
        if item.term == CONSTANT and item.value is not None and item.standard_error is not None:
            figures["buoyancy"] = -item.value, item.standard_error
    return figures


def figures_of_installation(record: InstallationRecord) -> Figures:
    """Return the departures that the legs show: arms, angles, lag, scales.

    What is not observable on a dive is left out. A sensor that drifts or was mounted
    anew shows as a change of these.
    """
    return {
        f"{item.name} [{item.unit}]": (item.departure, item.standard_error)
        for item in record.figures
        if item.standard_error is not None and item.verdict != "not observable"
    }


def drag_of_axis(part: AxisCard, axis: str, speed: float) -> DragAtSpeed | None:
    """Return the drag of one axis of a card, None where it has no damping term."""
    values = {item.term: item.value for item in part.terms}
    numbers = [np.nan if (value := values.get(term)) is None else value
               for term in part.covariance.terms]  # fmt: skip
    return drag_at_speed(
        part.covariance.terms, numbers, covariance_of(part), axis=axis, speed=speed
    )


def covariance_of(part: AxisCard) -> Array:
    """Return the covariance (k, k) of the terms of an axis that have a number."""
    rows = part.covariance.lower
    full = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        full[i, : i + 1] = full[: i + 1, i] = row
    return full
