"""Named figures of bench, control and simulation."""

from __future__ import annotations

from auvid.data_schemas.documents.model import Model
from auvid.data_schemas.documents.published_values import Evidence


class ResultRow(Model):
    """Rows."""

    quantity: str
    """Name of the figure, unique in this document (m - X_udot, I_x, rms cross-track
    ...).
    """
    value: float | None
    """Null where the data determine none."""
    unit: str
    """Unit of the figure."""
    standard_error: float | None = None
    """Standard error."""
    low: float | None = None
    """Lower end of the 95 % interval."""
    high: float | None = None
    """Upper end of the 95 % interval."""
    verdict: str | None = None
    """What the data say: identified, weak, not persistently exciting ..."""
    note: str | None = None
    """Condition or reason in one sentence."""
    evidence: Evidence | None = None
    """What meeting a bound shows, of a figure that counts met bounds."""
    reference: str | None = None
    """What such bounds hold ours against: printed values, or true values of a twin."""
    headline: bool | None = None
    """Whether the first screen of the report shows it."""


class ResultsRecord(Model):
    """Results of a bench or control stage as named figures.

    The first page shows them, and published values are compared with them.
    """

    title: str
    """What the figures belong to."""
    rows: list[ResultRow]
    """One figure each."""


class SimulationRecord(Model):
    """What a twin flew, leg by leg."""

    plan: str
    """Title of the plan."""
    truth: str
    """The viscous truth and its source."""
    coefficients: dict[str, dict[str, object]] | None = None
    """Coefficients of a truth that has them: axis, term, value in SI."""
    seed: int
    """Seed of all noise."""
    format: str
    """Kind of log files."""
    legs: list[dict[str, object]]
    """Per leg: id, rpm and level_speed_m_s (of an ROV its modes), start_s, end_s (null if
    it was never reached), stopped (null or why), biases.
    """
