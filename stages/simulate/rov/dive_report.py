"""What was dived, as section of the report and as views of the truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from auvid.data_schemas.tables import column, matrix
from auvid.stages.columns import ATTITUDE, VELOCITY, force_columns
from auvid.stages.presentation import (
    Block,
    panel,
    plot,
    remark,
    section,
    series,
    table,
    text,
)
from auvid.stages.simulate.rov.dives import DivesResult

PARTS = {
    "viscous": "drag of the frame",
    "thrust_loss": "thrust lost to inflow and hull",
    "tether": "tether",
    "buoyancy": "buoyancy beyond the vehicle file",
    "inertia": "inertia beyond the vehicle file",
    "unsteady": "unsteady",
}


def dive_section(result: DivesResult) -> dict[str, Any]:
    """Return plan, truth, what was dived leg by leg, and plots of the true motion."""
    document = result.document
    blocks: list[Block] = [
        text(
            f"Plan: {document['plan']}. Truth: {document['truth']}. Seed {document['seed']}, logs"
            f" as {document['format']}."
        )
    ]
    blocks += [remark(words, "note") for words in result.notes]
    blocks += [
        remark(f"Leg '{leg['id']}': {leg['stopped']}", "warning")
        for leg in document["legs"]
        if leg["stopped"]
    ]
    heads: list[str | tuple[str, str]] = ["leg", "modes"]
    heads += [(f"RMS {axis}", "m/s") for axis in "uvw"]
    heads += [(f"RMS {axis}", "rad/s") for axis in "pqr"]
    heads += [("lowest voltage", "V")]
    rows: list[list[object]] = []
    for name, truth in result.truth.items():
        dive = result.dives[name]
        t_s = column(truth, "t_s")
        inside = (t_s >= dive.start_s) & (t_s <= dive.end_s)
        rms = np.sqrt(np.mean(matrix(truth, VELOCITY)[inside] ** 2, axis=0))
        modes = ", ".join(dict.fromkeys(item.mode for item in dive.leg.modes))
        lowest = float(column(truth, "voltage_v")[inside].min())
        rows.append([name, modes, *map(float, rms), lowest])
    blocks.append(table("What was dived", heads, rows, note="Of the true motion within the leg."))
    blocks.append(_force_table(result))
    for name, truth in result.truth.items():
        t_s = column(truth, "t_s")
        panels = [
            panel(label, "deg", [series("true", t_s, np.degrees(column(truth, key)), "true")])
            for label, key in (("heading", "psi_rad"), ("roll", "phi_rad"), ("pitch", "theta_rad"))
        ]
        panels.append(panel("depth", "m", [series("true", t_s, column(truth, "z_m"), "true")]))
        panels += [
            panel(key[0], "m/s", [series("true", t_s, column(truth, key), "true")])
            for key in VELOCITY[:3]
        ]
        blocks.append(
            plot(
                f"True motion of {name}",
                panels,
                group=f"truth {name}",
                look_for="Which axes move, and how much roll and pitch are held.",
            )
        )
    return section("The twin", blocks, order=5)


def _force_table(result: DivesResult) -> Block:
    """Return the RMS of each part of the force that a model has to explain."""
    heads: list[str | tuple[str, str]] = ["part"]
    heads += [(axis, "N") for axis in "XYZ"] + [(axis, "N m") for axis in "KMN"]
    rows: list[list[object]] = []
    for part, words in (*PARTS.items(), ("tau_bar", "all of them")):
        squares = [
            np.mean(matrix(truth, force_columns(part)) ** 2, axis=0)
            for truth in result.truth.values()
        ]
        rms = np.sqrt(np.mean(squares, axis=0))
        rows.append([words, *map(float, rms)])
    note = "RMS over all logs. The chain sees their sum, by the numbers of the vehicle file."
    return table("What a model has to explain", heads, rows, note=note)


def dive_views(tables: Iterable[str]) -> dict[str, Any]:
    """Return views of the true motion of every leg, its forces and its supply."""
    supply = ("voltage", ("voltage_v",), "V")
    return true_views(tables, (supply, ("tether", force_columns("tether")[:3], "N")))


def true_views(
    tables: Iterable[str], further: Sequence[tuple[str, tuple[str, ...], str]]
) -> dict[str, Any]:
    """Return views of the true motion of every leg; further: name, columns, unit."""
    curves = (
        ("velocity", VELOCITY[:3], "m/s"),
        ("rates", VELOCITY[3:], "rad/s"),
        ("attitude", ATTITUDE, "rad"),
        ("depth", ("z_m",), "m"),
        *further,
    )
    return {
        "groups": [
            {
                "entity": f"twin/{name}",
                "table": f"truth/{leg}",
                "columns": list(columns),
                "names": [f"{item} true" for item in columns],
                "roles": ["true"] * len(columns),
                "tab": "Twin",
                "unit": unit,
            }
            for leg in tables
            for name, columns, unit in curves
        ]
    }
