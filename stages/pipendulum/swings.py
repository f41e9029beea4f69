"""Moments of inertia from the swings of a quadrifilar pendulum.

Equations of Alberti 2015.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.dynamics.quantities import Quantities
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.bench.quadrifilar import (
    Estimate,
    QuadrifilarGeometry,
    combined,
    counted_period,
    equivalent_inertia,
    hollow_cylinder,
    object_inertia,
    slowing,
    small_swing_period,
    tray_inertia,
)
from auvid.hydro.identification.bench.swing import SIMPLE, SwingFit, fit_swing
from auvid.stages.base import Document
from auvid.stages.pipendulum.recordings import Logs, Recording, naming, not_negative
from auvid.stages.presentation import Figure, figure

STOP_WATCH_SD_S = 0.2


@dataclass(frozen=True)
class SwingResult:
    """One swing of the apparatus: mass [kg], period and inertia of the object on the tray.

    `cylinder`: the calculated inertia (58), None where it is no cylinder.
    `amplitude_deg` of the largest swing.
    """

    entry: Document
    mass: float
    period: Estimate
    inertia: Estimate
    recordings: tuple[tuple[Recording, SwingFit], ...]
    cylinder: float | None
    amplitude_deg: float


def swings_of(part: Document, logs: Logs, vehicle: Vehicle) -> list[SwingResult]:
    """Return all swings of part `quadrifilar`, the empty tray first.

    Raises `CampaignError` for a faulty apparatus, `DataError` for bad recordings.
    """
    read = Quantities(part, "quadrifilar")
    geometry = QuadrifilarGeometry(
        radius_ceiling=read.number("radius_ceiling", "m"),
        radius_tray=read.number("radius_tray", "m"),
        line=read.number("line_length", "m"),
        tray_mass=read.number("tray_mass", "kg"),
        gravity=vehicle.gravity,
        length_sd=read.number("length_sd", "m", default=0.0),
        mass_sd=read.number("mass_sd", "kg", default=0.0),
    )
    if min(geometry.radius_ceiling, geometry.radius_tray, geometry.line, geometry.tray_mass) <= 0.0:
        raise CampaignError(
            "a length or mass of the pendulum is not positive", field="quadrifilar", value=geometry
        )
    if geometry.line <= abs(geometry.radius_ceiling - geometry.radius_tray):
        words = "the lines are shorter than the difference of the radii"
        remedy = "Check that all three are in the unit that they say, and that the radii are radii."
        raise CampaignError(
            words, field="quadrifilar.line_length", value=geometry.line, remedy=remedy
        )
    trays = [index for index, entry in enumerate(part["swings"]) if entry["role"] == "empty_tray"]
    if len(trays) != 1:
        raise CampaignError(
            "one swing of the empty tray is needed",
            field="quadrifilar.swings",
            value=len(trays),
            allowed=1,
        )
    order = [*trays, *(index for index in range(len(part["swings"])) if index not in trays)]
    results: list[SwingResult] = []
    for index in order:
        results.append(
            _swing(
                part["swings"][index],
                f"quadrifilar.swings[{index}]",
                geometry,
                logs,
                results[0].period if results else None,
            )
        )
    return results


def _swing(
    entry: Document, field: str, geometry: QuadrifilarGeometry, logs: Logs, empty: Estimate | None
) -> SwingResult:
    read = Quantities(entry, field)
    mass = 0.0
    if empty is not None:
        if "mass" not in read:
            raise CampaignError(
                "an object on the tray needs its mass",
                field=f"{field}.mass",
                remedy="Weigh it, without the tray.",
            )
        mass = read.number("mass", "kg")
        not_negative(field, mass=mass)
    total = geometry.tray_mass + mass
    soft = SIMPLE
    recordings = [
        logs.recording(leg, f"{field}.legs", upright=True) for leg in entry.get("legs") or ()
    ]
    periods: list[Estimate] = []
    fits: list[SwingFit] = []
    timed = [_timed(item) for item in entry.get("timed") or ()]
    if not recordings and not timed:
        raise CampaignError(
            "a swing needs legs that recorded it, or timed oscillations",
            field=field,
            value=entry["id"],
        )
    for _ in range(
        2
    ):  # how much a large swing is slowed depends a little on the inertia that comes out
        fits = [_fit(item, soft) for item in recordings]
        periods = [Estimate(fit.period_s, fit.standard_error_s) for fit in fits]
        periods += [
            Estimate(small_swing_period(geometry, total, one.value, size), one.standard_error)
            for one, size in timed
        ]
        period = combined(periods)
        soft = slowing(geometry, total, equivalent_inertia(geometry, total, period.value))
    inertia = (
        tray_inertia(geometry, period)
        if empty is None
        else object_inertia(geometry, mass, period, empty)
    )
    amplitude = max(
        [np.degrees(fit.amplitude_rad) for fit in fits] + [np.degrees(size) for _, size in timed]
    )
    return SwingResult(
        entry,
        mass,
        period,
        inertia,
        tuple(zip(recordings, fits, strict=True)),
        _cylinder(read, mass),
        float(amplitude),
    )


def _fit(recording: Recording, slowed: tuple[float, float]) -> SwingFit:
    with naming(recording.leg):
        return fit_swing(recording.t_s, recording.rate, slowing=slowed, usable=recording.usable)


def _timed(item: Document) -> tuple[Estimate, float]:
    """Return the period of counted oscillations, and their amplitude [rad]."""
    period = counted_period(
        int(item["oscillations"]),
        float(item["duration_s"]),
        float(item.get("duration_sd_s", STOP_WATCH_SD_S)),
    )
    return period, float(np.radians(item.get("amplitude_deg", 0.0)))


def _cylinder(read: Quantities, mass: float) -> float | None:
    if "cylinder" not in read:
        return None
    tube = read.part("cylinder")
    return hollow_cylinder(
        mass,
        tube.number("length", "m"),
        tube.number("outer_radius", "m"),
        tube.number("inner_radius", "m"),
    )


def swing_figures(swings: Sequence[SwingResult]) -> list[Figure]:
    """Return periods, inertias, and the check against a calculated cylinder.

    Names: `T of tray`, `I of tube`, `I_x` ...
    """
    rows = []
    for item in swings:
        name, axis = str(item.entry["id"]), item.entry.get("axis")
        rows.append(figure(f"T of {name}", item.period.value, "s", item.period.standard_error))
        note = f"swings of {item.amplitude_deg:.1f} degrees, corrected to small ones"
        quantity = f"I_{axis}" if axis else f"I of {name}"
        verdict = "identified" if item.inertia.value > 2.0 * item.inertia.standard_error else "weak"
        empty = item is swings[0]
        rows.append(
            figure(
                quantity,
                item.inertia.value,
                "kg*m^2",
                item.inertia.standard_error,
                verdict=verdict,
                note=note,
                headline=not empty,
            )
        )
        if item.cylinder is not None:
            rows.append(
                figure(
                    f"I of {name} by (58)",
                    item.cylinder,
                    "kg*m^2",
                    note="hollow cylinder, calculated",
                )
            )
            share = 100.0 * (item.inertia.value / item.cylinder - 1.0)
            rows.append(
                figure(
                    f"I of {name} against (58)",
                    share,
                    "%",
                    100.0 * item.inertia.standard_error / item.cylinder,
                )
            )
    return rows


def inertia_document(
    swings: Sequence[SwingResult], vehicle: str, source: str
) -> dict[str, Any] | None:
    """Return document `inertia` with the axes that were swung, None for none."""
    axes = {
        f"I_{item.entry['axis']}": {
            "value": float(item.inertia.value),
            "unit": "kg*m^2",
            "source": (
                f"quadrifilar pendulum, swing {item.entry['id']}, standard error"
                f" {item.inertia.standard_error:.2g} kg m^2"
            ),
        }
        for item in swings
        if item.entry.get("axis")
    }
    return {"vehicle": vehicle, "source": source, **axes} if axes else None
