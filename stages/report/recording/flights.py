"""Closed-loop flights in 3D: desired paths, flown paths and the vehicle on them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
import rerun as rr

from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import Array
from auvid.stages.number_format import in_words, visible
from auvid.stages.page.colours import ROLES, Ink, inks_of, key
from auvid.stages.report.recording.rerun_stream import TIMELINE, Recording

PLACE = ("x_m", "y_m", "z_m")
TOGETHER, NAMED = 0.15, 2
DESIRED_WIDTH, FLOWN_WIDTH, END_SIZE = -1.0, -1.8, -4.5
"""Negative radii are points of the screen, not metres."""
DESIRED = tuple(f"desired_{name}" for name in PLACE)


def send_flights(
    out: Recording, tables: Mapping[str, pa.Table], inks: Mapping[str, Ink]
) -> dict[str, Array]:
    """Send all tables of port `flights` (keys hold `trajectory-flight`).

    Returns the corners (2, 3) of the box around each trajectory.

    A flight is a line with its name at the end, and a point that moves along it;
    `inks`: colours of the flights, as on the page. Empty where there are no flights.
    """
    flights: dict[str, dict[str, pa.Table]] = {}
    for name, table in tables.items():
        parts = name.split("/")
        if "flights" in parts and has_columns(table, (*PLACE, *DESIRED, "t_s")):
            trajectory, _, flight = next(
                part for part in reversed(parts) if part != "flights"
            ).partition("-")
            flights.setdefault(trajectory, {})[flight] = table
    all_inks = {**inks_of([flight for group in flights.values() for flight in group]), **inks}
    return {
        trajectory: _trajectory(out, trajectory, group, all_inks)
        for trajectory, group in flights.items()
    }


def _trajectory(
    out: Recording, trajectory: str, flights: Mapping[str, pa.Table], inks: Mapping[str, Ink]
) -> Array:
    above = f"path/{rr.escape_entity_path_part(trajectory)}"
    desired = max((matrix(table, DESIRED) for table in flights.values()), key=_length)
    words = [str(visible(f"{trajectory}, desired"))]
    out.static(
        f"{above}/desired",
        rr.LineStrips3D(
            [desired],
            colors=[ROLES["desired"].rgb],
            radii=DESIRED_WIDTH,
            labels=words,
            show_labels=False,
        ),
    )
    places, ends = [desired], {}
    for flight, table in flights.items():
        flown = matrix(table, PLACE)
        good = np.isfinite(flown).all(axis=1)
        if not good.any():
            continue
        flown, times = flown[good], column(table, "t_s")[good]
        entity, ink = f"{above}/{rr.escape_entity_path_part(flight)}", inks[key(flight)].rgb
        out.static(
            entity,
            rr.LineStrips3D(
                [flown],
                colors=[ink],
                radii=FLOWN_WIDTH,
                labels=[str(visible(in_words(flight)))],
                show_labels=False,
            ),
        )
        out.static(f"{entity}/end", rr.Points3D(flown[-1:], colors=[ink], radii=END_SIZE))
        ends[flight] = flown[-1]
        out.static(f"{entity}/vehicle", rr.Points3D.from_fields(colors=[ink], radii=[0.25]))
        out.stream.send_columns(
            f"{entity}/vehicle",
            [rr.TimeColumn(TIMELINE, duration=times)],
            rr.Points3D.columns(positions=flown),
        )
        places.append(flown)
    points = np.vstack(places)
    box = np.array([np.nanmin(points, axis=0), np.nanmax(points, axis=0)])
    for near in _near(ends, TOGETHER * float(np.ptp(box, axis=0).max())):
        more = f" and {len(near) - NAMED} more" if len(near) > NAMED else ""
        named = ", ".join(map(in_words, near[:NAMED])) + more
        label = rr.Points3D.from_fields(labels=[str(visible(named))], show_labels=True)
        out.static(f"{above}/{rr.escape_entity_path_part(near[0])}/end", label)
    return box


def _near(ends: Mapping[str, Array], distance: float) -> list[list[str]]:
    """Group the flights whose ends lie together, so that one label names them all."""
    groups: list[list[str]] = []
    for name, end in ends.items():
        own = next(
            (group for group in groups if float(np.linalg.norm(ends[group[0]] - end)) < distance),
            None,
        )
        groups.append([name]) if own is None else own.append(name)
    return groups


def _length(path: Array) -> float:
    return float(np.nansum(np.sqrt(np.sum(np.diff(path, axis=0) ** 2, axis=1))))
