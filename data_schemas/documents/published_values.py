"""Printed values that the results of a campaign are compared with."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from auvid.data_schemas.documents.model import Faults, Model, Range, fault
from auvid.data_schemas.errors import CampaignError, nearest

Evidence = Literal["method", "construction", "tuned", "unprinted"]
"""What a met bound shows: the method finds the print again and could have missed it; or
it holds because twin and chain are inverse to one another, because a value was set for
it, or the source prints nothing to hold ours against.
"""


PRINTED_VALUES, TRUE_VALUES = "printed values", "true values"


def reference_words(unprinted: Iterable[bool]) -> str:
    """Return what rows are compared with, from whether each has no printed value."""
    return TRUE_VALUES if all(unprinted) else PRINTED_VALUES


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
    evidence: Evidence | None = None
    """What meeting the bounds shows; that of the table unless said. method: it could be
    missed; construction: twin and chain are inverse; tuned: a value was set for it;
    unprinted: the source prints no number.
    """
    reason: str = ""
    """Why it shows that."""
    note: str = ""
    """What is to be said of the row."""

    @model_validator(mode="after")
    def _bounds_are_of_a_figure(self) -> PublishedRowEntry:
        if self.ours is None and self.bounded:
            raise Faults(fault("a bound needs a figure", "ours", self.quantity))
        if self.evidence is not None and not self.reason:
            raise Faults(fault("evidence needs a reason", "reason", self.quantity))
        return self

    @property
    def bounded(self) -> bool:
        """Return whether anything is required of ours."""
        bounds = (self.most_relative_error, self.least, self.most, self.verdict)
        return any(bound is not None for bound in bounds)

    @property
    def to_be_found(self) -> float | None:
        """Return the first in the document of truth, corrected and printed value."""
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
    evidence: Evidence | None = None
    """What meeting the bounds of its rows shows, unless a row says otherwise."""
    reason: str = ""
    """Why it shows that."""
    rows: list[PublishedRowEntry]
    """One figure each."""

    @model_validator(mode="after")
    def _every_bound_says_what_it_shows(self) -> PublishedTableEntry:
        Faults(
            *(each for each in map(self._evidence_fault, range(len(self.rows))) if each)
        ).raise_any()
        return self

    def _evidence_fault(self, index: int) -> CampaignError | None:
        row, at = self.rows[index], f"rows[{index}].evidence"
        if not row.bounded:
            return None
        evidence, reason = self.evidence_of(row)
        if evidence is None or not reason:
            return fault(
                "a bound must say what meeting it shows, and why",
                at,
                row.quantity,
                allowed=get_args(Evidence),
                remedy="Give evidence and reason to the row or to its table.",
            )
        is_stated = row.printed is not None or row.truth is not None
        if row.printed is not None if evidence == "unprinted" else not is_stated:
            return fault(
                "evidence is 'unprinted' where nothing is printed (or method, if a truth is"
                " stated), and only there",
                at,
                evidence,
            )
        return None

    def evidence_of(self, row: PublishedRowEntry) -> tuple[Evidence | None, str]:
        """Return what meeting a row's bounds shows and why; None without bounds."""
        if not row.bounded:
            return None, ""
        if row.evidence is not None:
            return row.evidence, row.reason
        return self.evidence, self.reason


class PublishedLineEntry(Model):
    """Lines."""

    name: str
    """What the line is."""
    table: str
    """Table of the results, STAGE/PORT or STAGE/PORT/KEY."""
    column: str
    """Column that is drawn over t_s."""
    recording: str | None = None
    """Only the rows of this recording."""
    factor: float = 1.0
    """The line is this times the column: unit and sign of the source."""


class PublishedFigureEntry(Model):
    """Figures."""

    id: str
    """Number of the figure as printed (Figure 21)."""
    title: str
    """What it shows."""
    label: str
    """Name of the vertical axis as printed; the horizontal one is time in s."""
    unit: str
    """Unit of the vertical axis as printed."""
    note: str
    """Caption: what is ours, and what the source says of its own curve."""
    printed: dict[str, float] = Field(default_factory=dict)
    """Values that the source states of the curve (largest speed), drawn as level lines."""
    lines: list[PublishedLineEntry]
    """Curves of ours."""


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
    figures: list[PublishedFigureEntry] = Field(default_factory=list)
    """Figures of the source that the results can draw."""
    errata: list[ErratumEntry] = Field(default_factory=list)
    """Print errors of the source."""

    @property
    def reference(self) -> str:
        """What ours are compared with: "printed values", or "true values" of a twin."""
        rows = [row for table in self.tables for row in table.rows]
        return reference_words(row.printed is None and row.corrected is None for row in rows)

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
