"""The figures of one dive that a fleet pools and watches, from its records."""

from __future__ import annotations

import numpy as np

from auvid.data_schemas.records.models import AxisCard
from auvid.data_schemas.records.motion import InstallationRecord
from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet.drag import DragAtSpeed, drag_at_speed

Figures = dict[str, tuple[float, float]]
"""Name of a figure -> its value and standard error."""


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
