"""Settled glides of all legs; what no glider does is refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import column, has_columns
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.gliding.steady_glide import GlideState
from auvid.hydro.identification.glide.bins import GlideRows, glide_rows, joined
from auvid.hydro.identification.glide.fit import LEAST_GLIDES, drag_asked
from auvid.hydro.identification.glide.settled import (
    GliderRecord,
    SettledGlides,
    SettlingRules,
    bridged_s,
    settled_glides,
)
from auvid.stages.columns import leg_window, span_text
from auvid.stages.glide.glider import Glider
from auvid.stages.glide.refusals import check_one_vehicle, check_speed, unsettled

NEEDED = ("pressure_pa", "buoyancy_drive_m3")
MOST_STROKE = 0.2
"""A drive moves a few hundredths of the hull's volume; beyond this its unit is wrong."""
LEAST_STROKE = 2e-4
"""Of the hull's volume: below this the drive stands still."""
DRAG_OF_BODIES = (0.01, 3.0)
"""Drag referred to wings lies between these; beyond, a unit is wrong."""
LEAST_SAMPLES = 50
WRONG_WAY = 0.9
"""Share of glides against the drive from which on its sign is the fault."""


@dataclass(frozen=True)
class GlideLegs:
    """Rows of all legs, the settled glides by leg, stroke of the drive [m^3].

    `leg_of_glide`: leg of each glide, numbered over all legs. `pitch_zero`: what speaks
    for a zero of the pitch or a wrong speed where speed is known one way only, in words.
    `is_drive_stuck`: glides against their drive were left out; its column may lie elsewhere.
    """

    rows: GlideRows
    settled: Mapping[str, SettledGlides]
    leg_of_glide: tuple[str, ...]
    stroke_m3: float
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = field(default_factory=tuple)
    pitch_zero: str = ""
    is_drive_stuck: bool = False

    @property
    def directions(self) -> list[str]:
        """Return the direction of every glide that is fitted."""
        numbers = np.unique(self.rows.glide)
        up = [bool(np.any(self.rows.state.pitch_rad[self.rows.glide == n] > 0.0)) for n in numbers]
        return ["climb" if item else "dive" for item in up]

    def by_pitch_alone(self) -> GlideLegs:
        """Return the legs without their speed, which does not fit the pitch."""
        words = f"{self.pitch_zero} Lift is that of the vehicle file, without the speed."
        return replace(self, rows=self.rows.without_speed(), pitch_zero=words)


def legs_of(
    legs: Sequence[LegEntry],
    infos: Mapping[str, LogInfo],
    tables: Mapping[str, pa.Table],
    attitudes: Mapping[str, pa.Table] | None,
    *,
    glider: Glider,
    rules: SettlingRules,
    stretch_s: float,
    constant_density: bool,
) -> GlideLegs:
    """Return the settled glides of all legs.

    Raises `DataError` for a stream that lacks what a glide needs, for a drive that never
    moves, glides that never settle, and units that no glider has.
    """
    notes: list[str] = []
    warnings: list[str] = []
    settled, parts = {}, []
    for leg in legs:
        if leg.log not in tables:
            raise DataError(
                f"log '{leg.log}' of leg '{leg.id}' has no stream 'glider'",
                remedy="Map its columns to the stream glider (docs/glide.md).",
            )
        attitude = None if attitudes is None else attitudes.get(leg.log)
        record = _record(
            leg,
            infos[leg.log],
            tables[leg.log],
            attitude,
            glider,
            notes,
            max_gap_s=rules.max_gap_s,
            constant_density=constant_density,
        )
        own = replace(rules, max_gap_s=bridged_s(record.t_s, rules.max_gap_s))
        glides = settled_glides(record, own, gravity=glider.body.gravity)
        settled[leg.id] = glides
        if glides.direction:
            parts.append((leg.id, glide_rows(glides, stretch_s=stretch_s)))
    if not parts:
        raise unsettled("no glide settles", settled, rules)
    rows, owners = joined([part for _, part in parts])
    names = tuple(parts[index][0] for index in owners)
    strokes = [_stroke(item.record.state.drive_m3) for item in settled.values()]
    result = GlideLegs(rows, settled, names, max(strokes), tuple(dict.fromkeys(notes)))
    result = _with_drive(result, glider, warnings)
    count = np.unique(result.rows.glide).size
    if count < LEAST_GLIDES:
        head = f"{count} settled glide{'s' * (count > 1)} of at least {LEAST_GLIDES}"
        raise unsettled(head, settled, rules, warnings)
    pitch_zero = check_speed(result.rows, result.leg_of_glide)
    _check_units(result, glider)
    if pitch_zero and len(set(result.directions)) == 1:
        # Nothing else tells the zero of the pitch: such a speed would run the lift away.
        result = replace(result, pitch_zero=pitch_zero).by_pitch_alone()
        return replace(result, warnings=tuple(warnings))
    return replace(result, warnings=tuple(warnings), pitch_zero=pitch_zero)


def _stroke(drive_m3: Array) -> float:
    return float(np.nanmax(drive_m3) - np.nanmin(drive_m3))


def _record(
    leg: LegEntry,
    info: LogInfo,
    table: pa.Table,
    attitude: pa.Table | None,
    glider: Glider,
    notes: list[str],
    *,
    max_gap_s: float,
    constant_density: bool,
) -> GliderRecord:
    """Return the record of a leg on the clock of its pressure."""
    start_us = int(info.start_us)
    first, last = leg_window(leg, start_us, int(info.end_us))
    missing = [name for name in NEEDED if not has_columns(table, (name,))]
    if missing:
        raise DataError(
            f"the stream glider of log '{leg.log}' lacks {' and '.join(missing)}",
            field="columns",
            value=", ".join(name for name in table.column_names if name != "time_us"),
            remedy="Map its column to that field in the column map of the log (docs/glide.md).",
        )
    times = (column(table, "time_us") - start_us) / 1e6
    pressure = column(table, "pressure_pa")
    rows = np.isfinite(pressure) & (times >= first) & (times <= last)
    t = times[rows]
    if t.size < LEAST_SAMPLES:
        raise DataError(
            f"leg '{leg.id}' has too few samples of pressure",
            value=int(t.size),
            allowed=f"at least {LEAST_SAMPLES}",
        )

    weight = glider.body.neutral_kg_m3 * glider.body.gravity
    check_one_vehicle(t, pressure[rows] / weight, leg.id)

    def on_clock(name: str, source: pa.Table = table) -> Array:
        at = (column(source, "time_us") - start_us) / 1e6
        return _interpolated(t, at, column(source, name), max_gap_s)

    def logged(name: str) -> bool:
        return has_columns(table, (name,)) and bool(np.isfinite(column(table, name)).any())

    if logged("pitch_rad"):
        pitch = on_clock("pitch_rad")
    elif attitude is not None:
        pitch = on_clock("theta_rad", attitude)
    else:
        raise DataError(
            f"log '{leg.log}' has no pitch",
            field="columns",
            remedy="Map its column to pitch_rad of stream glider, or an attitude log.",
        )
    body = glider.body
    if logged("density_kg_m3"):
        density = on_clock("density_kg_m3")
    elif constant_density:
        density = np.full(t.size, body.neutral_kg_m3)
        notes.append(
            f"No density is logged: {body.neutral_kg_m3:g} kg/m³ of the vehicle file stands for"
            " every depth. Layers of water then count as drag and trim."
        )
    else:
        raise DataError(
            f"log '{leg.log}' has no density of the water",
            field="columns",
            remedy=(
                "Map its column to density_kg_m3 of stream glider (from conductivity,"
                " temperature and pressure: TEOS-10); in mixed water stages.glide."
                "constant_density: true takes that of the vehicle file at every depth."
            ),
        )
    warm = np.full(t.size, body.temperature_K)
    if logged("temperature_K"):
        warm = on_clock("temperature_K")
    elif body.expansion_1_k:
        notes.append("No temperature is logged: thermal expansion of the hull is left out.")
    drive = on_clock("buoyancy_drive_m3")
    _check_drive(leg, t, drive, body.mass_kg / body.neutral_kg_m3)
    speed = np.full(t.size, np.nan)
    if has_columns(table, ("speed_m_s",)):
        speed = on_clock("speed_m_s")
    return GliderRecord(t, GlideState(pitch, drive, density, pressure[rows], warm), speed)


def _interpolated(t: Array, at: Array, values: Array, max_gap_s: float) -> Array:
    """Return values at times t by straight lines, nan beyond `bridged_s`."""
    finite = np.isfinite(values)
    if not finite.any():
        return np.full(t.size, np.nan)
    at, values = at[finite], values[finite]
    right = np.clip(np.searchsorted(at, t), 0, at.size - 1)
    left = np.maximum(np.searchsorted(at, t, side="right") - 1, 0)
    longest = bridged_s(at, max_gap_s)
    near = (at[right] - at[left] <= longest) & (t >= at[0]) & (t <= at[-1])
    return np.where(near, np.interp(t, at, values), np.nan)


def _check_drive(leg: LegEntry, t: Array, drive: Array, volume_m3: float) -> None:
    """Raise `DataError` for a drive that never moves or moves more than a hull can."""
    finite = np.isfinite(drive)
    if not finite.any():
        raise DataError(f"the buoyancy drive is empty in leg '{leg.id}'", field="buoyancy_drive_m3")
    stroke = _stroke(drive)
    if stroke < LEAST_STROKE * volume_m3:
        raise DataError(
            f"the buoyancy drive never moves in leg '{leg.id}'",
            field="buoyancy_drive_m3",
            value=(
                f"{1e6 * float(np.nanmean(drive)):.1f} cm^3 within {1e6 * stroke:.2g} cm^3,"
                f" {span_text((float(t[0]), float(t[-1])))}"
            ),
            allowed=f"a stroke above {1e6 * LEAST_STROKE * volume_m3:.2g} cm^3",
            remedy=(
                "Is the drive at its stop, or its column another one or in another unit? A"
                " dive and a climb need both sides of it."
            ),
        )
    if stroke > MOST_STROKE * volume_m3:
        raise DataError(
            f"the buoyancy drive of leg '{leg.id}' moves more than a hull can",
            field="buoyancy_drive_m3",
            value=f"a stroke of {stroke:.3g} m^3",
            allowed=f"up to {MOST_STROKE * volume_m3:.2g} m^3 of {volume_m3:.2g} m^3",
            remedy="Is the column in cm^3 (cc) or in litres? Give its unit in the column map.",
        )


def _with_drive(glides: GlideLegs, glider: Glider, warnings: list[str]) -> GlideLegs:
    """Return the glides whose drive stands on the side of their direction.

    A dive needs less volume than a climb. Raises `DataError` where most go against it.
    """
    rows = glides.rows
    drive, up = rows.state.drive_m3, rows.state.pitch_rad > 0.0
    everywhere = [item.record.state.drive_m3 for item in glides.settled.values()]
    middle = 0.5 * (
        min(float(np.nanmin(item)) for item in everywhere)
        + max(float(np.nanmax(item)) for item in everywhere)
    )
    against = (drive > middle) != up
    numbers = np.unique(rows.glide[against])
    if not numbers.size:
        return glides
    if against.mean() >= WRONG_WAY:
        raise DataError(
            "the glider dives where its drive makes it light, and climbs where it makes it heavy",
            field="buoyancy_drive_m3",
            value=f"{against.mean():.0%} of all settled glides",
            remedy="Turn the sign of the drive, or of the pitch, in the column map (sign: -1).",
        )
    spans = [
        f"{glides.leg_of_glide[n]} {span_text(_span(rows.t_s[rows.glide == n]))}"
        for n in numbers[:3]
    ]
    more = f" and {numbers.size - 3} more" if numbers.size > 3 else ""
    warnings.append(
        f"In {numbers.size} settled glide{'s' * (numbers.size > 1)} the drive stands on the side"
        f" of the other direction, as one at its stop does: {', '.join(spans)}{more}. They are"
        " left out."
    )
    kept = ~np.isin(rows.glide, numbers)
    if not kept.any():
        raise DataError(
            "the drive stands on the wrong side in every settled glide",
            field="buoyancy_drive_m3",
            remedy="Is the drive at its stop, or its column another one?",
        )
    return replace(glides, rows=rows.where(kept), is_drive_stuck=True)


def _span(t_s: Array) -> tuple[float, float]:
    return float(t_s[0]), float(t_s[-1])


def _check_units(glides: GlideLegs, glider: Glider) -> None:
    """Raise `DataError` where no body has the drag that the depth rate asks for."""
    rows, at = glides.rows, int(np.argmax(np.abs(glides.rows.depth_rate_m_s)))
    drag = drag_asked(rows, body=glider.body, prior=glider.prior(glides.stroke_m3))
    low, high = DRAG_OF_BODIES
    if low <= drag <= high:
        return
    fast = drag < low
    units = "dbar where the map says bar" if fast else "bar where the map says dbar"
    raise DataError(
        f"the glides are {'faster' if fast else 'slower'} than any body's drag makes them",
        field="pressure_pa",
        value=(
            f"C_D {drag:.2g} from depth rates up to {np.abs(rows.depth_rate_m_s[at]):.3g} m/s"
            f" (leg '{glides.leg_of_glide[rows.glide[at]]}' at {rows.t_s[at]:.0f} s)"
        ),
        allowed=f"C_D of {low:g} to {high:g}",
        remedy=(
            f"Is the pressure in {units}? Else check the unit of the drive, reference_area and"
            " mass of the vehicle file."
        ),
    )
