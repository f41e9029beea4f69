"""Printed values that the results of a campaign are compared with."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from auvid.data_schemas.documents.model import Faults, Model, Range, fault
from auvid.data_schemas.errors import nearest


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
    factor: float = 1.0
    """Ours is offset + factor times that figure."""
    offset: float = 0.0
    """Added to it."""
    most_relative_error: Annotated[float, Range(0)] | None = None
    """Bound on the relative error of ours against the truth."""
    least: float | None = None
    """What ours must be at least, in the unit of the row."""
    most: float | None = None
    """What ours must be at most, in the unit of the row."""
    verdict: str | None = None
    """Verdict that the figure must have."""
    note: str = ""
    """What is to be said of the row."""

    @model_validator(mode="after")
    def _bounds_are_of_a_figure(self) -> PublishedRowEntry:
        bounds = (self.most_relative_error, self.least, self.most, self.verdict)
        if self.ours is None and any(bound is not None for bound in bounds):
            raise Faults(fault("a bound needs a figure", "ours", self.quantity))
        return self

    @property
    def to_be_found(self) -> float | None:
        """The first in the document of truth, corrected and printed value."""
        names = ("truth", "corrected", "printed")
        value: float | None = getattr(
            self, next(name for name in names if name in self.model_fields_set)
        )
        return value


class PublishedTableEntry(Model):
    """Tables."""

    id: str
    """Number of the table as printed (Table 4, (58))."""
    title: str
    """What it holds."""
    note: str = ""
    """How ours come about."""
    errata: list[str] = Field(default_factory=list)
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
    shown: str = ""
    """Where it shows in the tables or in the tests."""


class PublishedValuesDocument(Model):
    """Printed tables of a source, with its errata.

    The results of a campaign are compared with them.
    """

    title: str
    """One line for the report."""
    source: str
    """Where the tables are printed."""
    tables: list[PublishedTableEntry]
    """The tables, in the order of the source."""
    errata: list[ErratumEntry] = Field(default_factory=list)
    """Print errors of the source."""

    @model_validator(mode="after")
    def _errata_are_listed(self) -> PublishedValuesDocument:
        known = {entry.id for entry in self.errata}
        Faults(
            *(
                fault("no such erratum", f"tables[{t}].errata", name, remedy=nearest(name, known))
                for t, entry in enumerate(self.tables)
                for name in entry.errata
                if name not in known
            )
        ).raise_any()
        return self
