"""Rows of the tables of a fleet, for tests of its page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import make_table
from auvid.pipeline.commands.fleet.fleet_folder import TABLES
from auvid.pipeline.commands.fleet.report.coefficient_columns import Coefficients

Row = dict[str, Any]


def empty_row(table: str) -> Row:
    """Return a row of a table in which nothing stands yet."""
    fillings = {"string": "", "int64": 0, "float64": None, "bool": False}
    columns = schema(TABLES[table]).columns
    return {name: fillings[str(item.dtype)] for name, item in columns.items()}


def as_columns(rows: Sequence[Row]) -> Coefficients:
    """Return rows of table `coefficients` as the page reads them."""
    columns = schema(TABLES["coefficients"]).columns
    cells = {name: [row[name] for row in rows] for name in columns}
    return Coefficients.of_table(make_table(TABLES["coefficients"], cells))
