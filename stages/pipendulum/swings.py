"""Moments of inertia from the swings of a quadrifilar pendulum.

Equations of Alberti 2015.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.data_schemas.documents.apparatus import (
    CylinderEntry,
    QuadrifilarEntry,
    SwingEntry,
    TimedEntry,
)
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
from auvid.stages.pipendulum.recordings import Logs, SwingRecording, naming
from auvid.stages.presentation import Figure, figure


@dataclass(frozen=True)
class SwingResult:
    """One swing of the apparatus: mass [kg], period and inertia of the object.

    `cylinder`: the calculated inertia (58), None where it is no cylinder.
    `amplitude_deg` of the largest swing.
    """

    entry: SwingEntry
    mass: float
    period: Estimate
    inertia: Estimate
    recordings: tuple[tuple[SwingRecording, SwingFit], ...]
    cylinder: float | None
    amplitude_deg: float


def swings_of(part: QuadrifilarEntry, logs: Logs, vehicle: Vehicle) -> list[SwingResult]:
    """Return all swings of part `quadrifilar`, the empty tray first.

    Raises `CampaignError` and `DataError` as their recordings do.
    """
    geometry = QuadrifilarGeometry(
        radius_ceiling=part.radius_ceiling.si,
        radius_tray=part.radius_tray.si,
        line=part.line_length.si,
        tray_mass=part.tray_mass.si,
        gravity=vehicle.gravity,
        length_sd=part.length_sd.si,
        mass_sd=part.mass_sd.si,
    )
    order = sorted(enumerate(part.swings), key=lambda item: item[1].role != "empty_tray")
    results: list[SwingResult] = []
    for index, entry in order:
        empty = results[0].period if results else None
        results.append(_swing(entry, f"quadrifilar.swings[{index}]", geometry, logs, empty))
    return results


def _swing(
    entry: SwingEntry, field: str, geometry: QuadrifilarGeometry, logs: Logs, empty: Estimate | None
) -> SwingResult:
    mass = 0.0 if empty is None or entry.mass is None else entry.mass.si
    total = geometry.tray_mass + mass
    soft = SIMPLE
    recordings = [logs.recording(leg, f"{field}.legs", upright=True) for leg in entry.legs]
    periods: list[Estimate] = []
    fits: list[SwingFit] = []
    timed = [_timed(item) for item in entry.timed]
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
        _cylinder(entry.cylinder, mass),
        float(amplitude),
    )


def _fit(recording: SwingRecording, slowed: tuple[float, float]) -> SwingFit:
    with naming(recording.leg):
        return fit_swing(recording.t_s, recording.rate, slowing=slowed, usable=recording.usable)


def _timed(item: TimedEntry) -> tuple[Estimate, float]:
    """Return the period of counted oscillations, and their amplitude [rad]."""
    period = counted_period(item.oscillations, item.duration_s, item.duration_sd_s)
    return period, float(np.radians(item.amplitude_deg))


def _cylinder(tube: CylinderEntry | None, mass: float) -> float | None:
    if tube is None:
        return None
    return hollow_cylinder(mass, tube.length.si, tube.outer_radius.si, tube.inner_radius.si)


def swing_figures(swings: Sequence[SwingResult]) -> list[Figure]:
    """Return periods, inertias, and the check against a calculated cylinder.

    Names: `T of tray`, `I of tube`, `I_x` ...
    """
    rows = []
    for item in swings:
        name, axis = item.entry.id, item.entry.axis
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
        f"I_{item.entry.axis}": {
            "value": float(item.inertia.value),
            "unit": "kg*m^2",
            "source": (
                f"quadrifilar pendulum, swing {item.entry.id}, standard error"
                f" {item.inertia.standard_error:.2g} kg m^2"
            ),
        }
        for item in swings
        if item.entry.axis
    }
    return {"vehicle": vehicle, "source": source, **axes} if axes else None
