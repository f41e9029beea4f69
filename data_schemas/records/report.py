"""What stages show, and where results come from."""

from __future__ import annotations

from typing import Annotated, Literal

from auvid.data_schemas.documents.model import Model, Range


class Provenance(Model):
    """Where the results come from; the runner makes it."""

    logs: dict[str, list[object]]
    """Log -> its files with name and content hash."""
    vehicle: str
    """Hash of the vehicle document."""
    stages: dict[str, dict[str, object]]
    """Stage -> hash of its code and schemas, and every parameter in force."""
    packages: dict[str, str]
    """Package versions."""


class SubtractedTable(Model):
    """Columns of another table with the same rows, to be subtracted.

    The difference is drawn.
    """

    table: str
    """As above."""
    columns: list[str]
    """One per column."""


class ViewGroup(Model):
    """Groups."""

    entity: str
    """Path in the recording."""
    table: str
    """Artefact of this stage item, or stage/item/port of another."""
    columns: list[str]
    """Columns shown."""
    names: list[str]
    """Names of the series."""
    roles: list[str]
    """Role of each series, which fixes its colour."""
    tab: str
    """Tab of the blueprint."""
    unit: str
    """Unit of the y-axis."""
    filter: dict[str, str] | None = None
    """Column -> value that rows must have (long tables)."""
    spread: list[str] | None = None
    """Standard deviation of each column: drawn are two lines more, twice that below and
    above; for role band these alone.
    """
    less: SubtractedTable | None = None
    """Columns of another table with the same rows that are taken off: drawn is the
    difference.
    """


class ViewsRecord(Model):
    """What a stage shows in the Rerun recording, as references to its tables."""

    groups: list[ViewGroup]
    """One entity per group of series that share a clock."""


class SectionRecord(Model):
    """What a stage shows in the report."""

    title: str
    """Heading."""
    order: int
    """Place in the report."""
    chapter: str | None = None
    """Heading above this section and others of the stage that name the same."""
    look_for: str | None = None
    """What to look for."""
    is_open: bool = False
    """Whether the page shows it before anyone asks for it."""
    blocks: list[dict[str, object]]
    """Text, remark, equation, table, plot (stages/presentation.py)."""


class PublishedErrorRow(Model):
    """Rows."""

    table: str
    """Number of the table."""
    set: Literal["training", "validation"]
    """The set."""
    model: str
    """The model."""
    n_bar_printed: Annotated[int, Range(0)]
    """Number of terms as printed."""
    J: Annotated[float, Range(0)]
    """RMS error as printed, N and N m mixed."""
    J0: Annotated[float, Range(0)]
    """RMS of the force as printed."""
    ratio_printed: Annotated[float, Range(0)]
    """J/J0 as printed."""
    ratio_recomputed: Annotated[float, Range(0)]
    """J/J0 of the printed J and J0."""
    note: str
    """What is wrong with the row."""


class PublishedTables(Model):
    """Published error tables and coefficients to compare a reproduction with."""

    source: str
    """File of the tables."""
    rows: list[PublishedErrorRow]
    """One row per set and model."""
    coefficients: dict[str, dict[str, dict[str, float]]]
    """Model -> axis -> term -> published value in SI."""
