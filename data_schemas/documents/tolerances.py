"""How far cells of golden tables may move."""

from __future__ import annotations

from typing import Annotated

from auvid.data_schemas.documents.model import Model, Range


class ToleranceEntry(Model):
    """Columns."""

    relative: Annotated[float, Range(0.0, 1.0)] | None = None
    """Share of the old value."""
    absolute: Annotated[float, Range(0.0, 1000000.0)] | None = None
    """In the unit of the column."""
    unit: str
    """Unit of the column."""
    reason: str
    """Why this much and not more or less."""


class TolerancesDocument(Model):
    """How far the cells of golden error tables may move before `auvid regress` fails,
    per column.
    """

    columns: dict[str, ToleranceEntry]
    """Column -> tolerance; a cell may move by the larger of `relative` times its old
    value and `absolute`.
    """
