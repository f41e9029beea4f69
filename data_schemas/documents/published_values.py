"""Printed values that the results of a campaign are compared with."""

from __future__ import annotations

from typing import Annotated

from auvid.data_schemas.documents.model import Model, Range


class PublishedRowEntry(Model):
    """Rows."""

    quantity: str
    """Name as printed."""
    unit: str
    """Unit of the row."""
    printed: float | None
    """Value as printed; null where none is."""
    corrected: float | None = None
    """Value with the errata applied."""
    truth: float | None = None
    """Value that printed and ours are both meant to find, null where they differ by
    nature; default corrected, else printed.
    """
    ours: str | None = None
    """Figure of the results, STAGE/ITEM:QUANTITY or STAGE:QUANTITY; left out where none
    is recomputed.
    """
    factor: float | None = None
    """Ours is offset + factor times that figure; default 1."""
    offset: float | None = None
    """Default 0."""
    most_relative_error: Annotated[float, Range(0)] | None = None
    """Bound on the relative error of ours against the truth."""
    least: float | None = None
    """What ours must be at least, in the unit of the row."""
    most: float | None = None
    """What ours must be at most, in the unit of the row."""
    verdict: str | None = None
    """Verdict that the figure must have."""
    note: str | None = None
    """What is to be said of the row."""


class PublishedTableEntry(Model):
    """Tables."""

    id: str
    """Number of the table as printed (Table 4, (58))."""
    title: str
    """What it holds."""
    note: str | None = None
    """How ours come about."""
    errata: list[str] | None = None
    """Ids of errata that concern it."""
    rows: list[PublishedRowEntry]
    """One figure each."""


class ErratumEntry(Model):
    """Errata."""

    id: str
    """Short name."""
    where: str
    """Equation or table."""
    printed: str
    """What is printed."""
    corrected: str
    """What it should be."""
    confidence: str
    """How sure that is."""
    shown: str | None = None
    """Where it shows in the tables or in the tests."""


class PublishedValuesDocument(Model):
    """Printed tables of a source that the results of a campaign are held against, and
    the errata of that source.
    """

    title: str
    """One line for the report."""
    source: str
    """Where the tables are printed."""
    tables: list[PublishedTableEntry]
    """The tables, in the order of the source."""
    errata: list[ErratumEntry] | None = None
    """Print errors of the source."""
