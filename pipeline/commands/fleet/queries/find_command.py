"""`auvid fleet find`: the logs of a fleet of which something holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from auvid.data_schemas.schemas import schema
from auvid.pipeline.commands.fleet.fleet_folder import TABLES, FleetFolder, open_fleet
from auvid.pipeline.commands.fleet.fleet_tables import read_table
from auvid.pipeline.commands.fleet.queries.expression import parse
from auvid.pipeline.output import FAILED, FINE, answer
from auvid.pipeline.terminal import table
from auvid.stages.number_format import fixed

SOUGHT = ("log", "recommended", "axis", "term", "value", "verdict")
"""Columns of table `coefficients` that an expression may be about."""


def find(fleet: FleetFolder, expression: str) -> list[dict[str, Any]]:
    """Return the rows of table `runs` of which an expression holds.

    Raises `UsageError` for what the language of `expression` has not.
    """
    fields = list(schema(TABLES["runs"]).columns)
    rows: dict[str, dict[str, Any]] = {
        row["log"]: row for row in read_table(fleet, "runs").to_pylist()
    }
    cells: dict[str, dict[str, Any]] = {log: dict(row) for log, row in rows.items()}
    coefficients: dict[str, None] = {}
    every = read_table(fleet, "coefficients", SOUGHT)
    for item in every.filter(every["recommended"]).to_pylist():
        if item["axis"]:
            name = f"{item['axis']}_{item['term'].replace('*', '')}"
            coefficients[name] = None
            cells[item["log"]] |= {name: item["value"], f"{name} verdict": item["verdict"]}
    test = parse(expression, fields, list(coefficients))
    return [rows[log] for log, cell in cells.items() if test(cell)]


def print_matches(folder: Path, expression: str) -> int:
    """Print the logs of which an expression holds; the exit code is 1 for none."""
    rows = find(open_fleet(folder), expression)
    answer({"expression": expression, "logs": rows})
    lines = [
        (
            row["log"],
            row["state"],
            row["vehicle"],
            row["start_utc"] or "",
            row["model"],
            fixed(row["ratio"], 3),
            Path(row["file"]).name,
        )
        for row in rows
    ]
    table(("log", "state", "vehicle", "start (UTC)", "model", "J/J0", "file"), lines)
    print(f"{len(rows)} log{'s' * (len(rows) != 1)}")
    return FINE if rows else FAILED
