"""Closed-loop flights in 3D: the desired path of each trajectory, and every flight along it, with the vehicle on the flown path."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
import rerun as rr

from data_schemas.tables import has_columns, matrix
from stages.report.colours import ROLES, distinct
from stages.report.html import visible
from stages.report.sending import TIMELINE, Array, Recording

PLACE = ("x_m", "y_m", "z_m")
DESIRED = tuple(f"desired_{name}" for name in PLACE)


def send_flights(out: Recording, tables: Mapping[str, pa.Table]) -> Array | None:
    """Send all tables of port `flights` (keys hold `trajectory-flight`); returns the corners (2, 3) of the box around all in m NED.

    A flight is a line and a point that moves along it. None where there are no flights.
    """
    flights = {}
    for name, table in tables.items():
        parts = name.split("/")
        if "flights" in parts and has_columns(table, (*PLACE, *DESIRED, "t_s")):
            key = next(part for part in reversed(parts) if part != "flights")
            flights[key] = table
    if not flights:
        return None
    inks = distinct([key.partition("-")[2] for key in flights])
    desired: dict[str, Array] = {}
    places = []
    for key, table in flights.items():
        trajectory, _, flight = key.partition("-")
        flown = matrix(table, PLACE)
        good = np.isfinite(flown).all(axis=1)
        path = matrix(table, DESIRED)
        if len(path) and (trajectory not in desired or _length(path) > _length(desired[trajectory])):
            desired[trajectory] = path
        if not good.any():
            continue
        entity = f"path/{rr.escape_entity_path_part(trajectory)}/{rr.escape_entity_path_part(flight)}"
        ink = inks[flight].rgb
        out.static(entity, rr.LineStrips3D([flown[good]], colors=[ink], labels=[str(visible(flight))], show_labels=False))
        times = matrix(table, ("t_s",))[good, 0]
        out.static(f"{entity}/vehicle", rr.Points3D.from_fields(colors=[ink], radii=[0.25]))
        out.stream.send_columns(f"{entity}/vehicle", [rr.TimeColumn(TIMELINE, duration=times)], rr.Points3D.columns(positions=flown[good]))
        places.append(flown[good])
    for trajectory, path in desired.items():
        entity = f"path/{rr.escape_entity_path_part(trajectory)}/desired"
        label = str(visible(f"{trajectory}, desired"))
        out.static(entity, rr.LineStrips3D([path], colors=[ROLES["desired"].rgb], radii=[0.05], labels=[label]))
        places.append(path)
    whole = np.vstack(places)
    return np.array([whole.min(axis=0), whole.max(axis=0)])


def _length(path: Array) -> float:
    return float(np.sum(np.sqrt(np.sum(np.diff(path, axis=0) ** 2, axis=1))))
