"""What ingest says of a log."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from auvid.data_schemas.documents.model import Model

Accelerometer = Literal["specific_force", "inertial", "derivative"]
"""What accelerometer columns measure: gravity inside, gravity taken off, d(velocity)/dt."""


class SkippedInFile(Model):
    """Bytes of a file that gave no record, for one reason."""

    reason: str
    """Why they gave none."""
    bytes: int
    """How many bytes."""
    count: int
    """In how many pieces."""


class FileInfo(Model):
    """One file of a log and what became of its bytes."""

    name: str
    """Name as the manifest writes it."""
    format: str
    """Format as recognised."""
    size_bytes: int
    """Size."""
    record_bytes: int
    """Bytes of records."""
    definition_bytes: int
    """Bytes of definitions."""
    skipped: list[SkippedInFile]
    """Bytes that gave nothing, by reason."""
    status: Literal["complete", "truncated", "damaged"]
    """Whether the file is whole."""
    seconds_lost: float
    """Time that the skipped bytes stand for."""


class SourceRecord(Model):
    """One way in which the log could fill a stream."""

    source: str
    """Message, with the instance of its sensor."""
    columns: str
    """Fields that it fills."""
    status: str
    """Used, or why not."""


class StreamInfo(Model):
    """One stream of a log: source, rows, rate and gaps."""

    source: str
    """Message it was taken from."""
    alternatives: list[SourceRecord]
    """Every way in which the log could fill it, in order of preference."""
    columns: list[str]
    """Fields that it has."""
    rows: int
    """Usable samples."""
    rejected: int
    """Rejected samples."""
    rate_hz: float | None
    """Mean rate without pauses; null for what is logged on change."""
    start_us: int
    """First sample."""
    end_us: int
    """Last sample."""
    duration_s: float
    """From the first to the last sample."""
    longest_gap_s: float
    """Longest step."""
    gaps: int
    """Steps longer than the limit."""
    smoothed_s: float | None = None
    """Time over which a velocity from position fixes is smoothed; null for others."""


class LogInfo(Model):
    """What a log is and what was taken from it."""

    log: str
    """Id of the log in the campaign."""
    files: list[FileInfo]
    """Per file: format, bytes, what was skipped, seconds lost."""
    status: Literal["complete", "truncated", "damaged"]
    """The worst of its files."""
    start_us: int
    """Time of the first time-stamped record; legs count seconds from here."""
    end_us: int
    """Time of the last sample of any stream."""
    utc_offset_us: int | None = None
    """Add to time_us to get UTC microseconds since 1970; null where unknown."""
    vehicle: str | None = None
    """Vehicle and firmware as the log says."""
    parameters: dict[str, float | None]
    """Parameters of the vehicle."""
    accelerometer: Accelerometer | None = None
    """What the accelerometer columns measure."""
    streams: dict[str, StreamInfo]
    """Per stream: source, rows, rate, gaps."""
    counts: dict[str, int]
    """Records per message type."""
    notes: list[str]
    """Sentences a user should read."""


class FindingRecord(Model):
    """Findings."""

    id: str
    """Name of the check (docs/checks.md)."""
    severity: Literal["error", "warning", "note"]
    """How much it matters."""
    stream: str | None
    """The stream it concerns."""
    text: str
    """One sentence with the measured value and its unit."""
    value: float | None
    """The measured value."""
    threshold: float | None
    """The limit of the check."""
    unit: str
    """Unit of value and threshold."""
    remedy: str
    """What to do."""
    at_s: float | None = None
    """When, from the first time-stamped record; null for what concerns the whole log.
    """
    fields: list[str] = Field(default_factory=list)
    """Fields of the stream that are in question, as a column map writes them."""


class ExplainedRecord(FindingRecord):
    """Findings that go away with the mistake that another one names."""

    by: str
    """Check of the finding that explains it; who accepts that one still has this one."""


class StreamRecord(Model):
    """Streams."""

    source: str
    """Message it was taken from."""
    others: list[str]
    """Other sources that the log has."""
    refused: list[str]
    """Sources that the log has and that cannot be used."""
    rows: int
    """Usable samples."""
    rejected: int
    """Rejected samples."""
    rate_hz: float | None
    """Mean rate without pauses."""
    jitter_s: float | None
    """Half the range of the steps from the 5th to the 95th percentile."""
    longest_gap_s: float
    """Longest step."""
    start_s: float
    """First sample, from the first time-stamped record."""
    end_s: float
    """Last sample, likewise."""


class CapabilityRecord(Model):
    """Capabilities."""

    name: str
    """Stage or method."""
    possible: bool
    """Whether it can run."""
    reason: str
    """Why not."""


class AnswerRecord(Model):
    """How one motion follows the outputs."""

    lag_s: float
    """By how much it comes later."""
    explained: float
    """Share of it that the outputs explain."""


class UnseenRecord(Model):
    """A figure that a log cannot show, so that a wrong one passes."""

    name: str
    """What is not observable."""
    reason: str
    """Why not, and what would show it."""


class ExcitationRecord(Model):
    """Excitation."""

    rms: float | None
    """Root mean square; null where nothing measures the axis."""
    low: float | None
    """Smallest value."""
    high: float | None
    """Largest value."""
    threshold: float
    """RMS from which on the axis counts as excited."""
    share_beyond: float | None
    """Share of the samples beyond the threshold."""
    unit: str
    """Unit."""
    source: str
    """What it was taken from."""
    excited: bool
    """Whether the RMS lies above the threshold."""


class HealthRecord(Model):
    """The health of one log, what is wrong with it and what it can be used for."""

    log: str
    """Id of the log."""
    vehicle: str | None = None
    """Vehicle and firmware as the log says."""
    formats: list[str]
    """Formats of its files."""
    bytes: int
    """Size of its files."""
    status: Literal["complete", "truncated", "damaged"]
    """The worst of its files."""
    duration_s: float
    """From the first time-stamped record to the last sample."""
    verdict: str
    """What the log can be used for in one sentence."""
    findings: list[FindingRecord]
    """What was found, the severe first."""
    explained: list[ExplainedRecord] = Field(default_factory=list)
    """What the cause of another finding explains as well."""
    streams: dict[str, StreamRecord]
    """The streams that the log has."""
    shared_spans_s: list[list[float]]
    """From and to of each stretch that all sensors and commands cover without a gap."""
    capabilities: list[CapabilityRecord]
    """What can be done with the log."""
    unseen: list[UnseenRecord]
    """What nothing in the log tells: a wrong figure passes."""
    answers: dict[str, AnswerRecord] = Field(default_factory=dict)
    """How motion follows the outputs, per axis that they explain."""
    excitation: dict[str, ExcitationRecord]
    """Motion per axis: u v w p q r."""
    notes: list[str]
    """What the reader and the mapping say."""
