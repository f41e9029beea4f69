"""What a fleet of logs is: each log as surveyed, and what its run came to."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from auvid.data_schemas.documents.model import Model
from auvid.data_schemas.records.logs import FindingRecord


class MotionTrace(Model):
    """Motion of a log in steps of one clock, by which two recorders of a dive agree."""

    step_s: float
    """Step of the clock."""
    start_s: float
    """First step, in seconds of the log's own clock."""
    depth_m: list[float | None]
    """Mean depth in each step; empty where the log has none."""
    yaw_rate_rad_s: list[float | None]
    """Mean yaw rate in each step; empty where the log has none."""


class LogSurvey(Model):
    """One log of a fleet: what it is, what is wrong with it, what it can feed."""

    key: str
    """Hash of all that this survey depends on."""
    id: str
    """Id of the log, and of its campaign."""
    files: list[str]
    """Paths of its files."""
    hash: str
    """Hash of their content."""
    reason: str
    """Why nothing can be run on it; empty for a log that feeds a campaign."""
    routes: list[str] = Field(default_factory=list)
    """Why each kind of campaign does not take it; empty for a log that feeds one."""
    kind: str = ""
    """Kind of the campaign that it feeds; empty for none."""
    vehicle: str = ""
    """Vehicle, by name of its file, or as the log says."""
    vehicle_why: str = ""
    """What tells the vehicle."""
    lacking: str = ""
    """What must be filled in before any run; empty for nothing."""
    formats: list[str] = Field(default_factory=list)
    """Formats of its files."""
    bytes: int = 0
    """Size of its files."""
    status: Literal["complete", "truncated", "damaged", "refused"] = "refused"
    """The worst of its files; refused: it cannot be read."""
    duration_s: float = 0.0
    """From the first time-stamped record to the last sample."""
    start_utc: str | None = None
    """Start in UTC; null where the log has no clock, or one that was never set."""
    rows: int = 0
    """Usable samples of all streams."""
    streams: list[str] = Field(default_factory=list)
    """Streams that the log has."""
    legs: int = 0
    """Legs that are proposed."""
    legs_s: float = 0.0
    """Their length."""
    excited: list[str] = Field(default_factory=list)
    """Axes in which it moves."""
    findings: list[FindingRecord] = Field(default_factory=list)
    """What was found, the severe first."""
    conditions: dict[str, float | str] = Field(default_factory=dict)
    """What may make one dive differ from another: firmware, battery_v, mean_depth_m; and
    board, which tells one autopilot from another."""
    motion: MotionTrace | None = None
    """Its motion; null for a log that is refused."""
    row_hashes: list[int] = Field(default_factory=list)
    """Smallest hashes of its samples, by which copies that were cut or damaged show."""


class FleetCoefficient(Model):
    """A coefficient or a figure that one run gave."""

    model: str
    """Name of the model, or title of the bench."""
    recommended: bool
    """Whether it is the model to take."""
    axis: str
    """Axis X Y Z K M N; empty for a figure of a bench."""
    term: str
    """Basis term, or name of the figure."""
    unit: str
    """SI unit."""
    value: float | None
    """Value; null where the data determine none."""
    standard_error: float | None
    """Standard error by noise."""
    verdict: str
    """What the data say of it."""
    correlation: float | None = None
    """With the other damping term, linear or quadratic, of the axis; null for none."""


class FleetVerdict(Model):
    """How good one model of one run is on one axis, or on all."""

    model: str
    """Name of the model."""
    recommended: bool
    """Whether it is the model to take."""
    axis: str
    """Axis X Y Z K M N, or all."""
    validation: float | None
    """J/J0 on the validation legs."""
    training: float | None
    """J/J0 on the training legs."""
    free_run: float | None
    """RMS error of free runs over that of the better of no change and no motion."""
    identified: int
    """Coefficients that the data identify."""
    coefficients: int
    """Coefficients that apply to the vehicle."""
    damping: str
    """Verdict on the damping of the axis, of its best determined term; empty for all."""
    use: str
    """The most that the model is good for there: control, simulation, forces, or empty."""


class FleetRun(Model):
    """What the run of one log of a fleet came to."""

    key: str
    """Hash of all that this run depends on."""
    id: str
    """Id of the log, and of its campaign."""
    state: Literal["done", "partly", "refused"]
    """Done: a model or figures to take; partly: it ended before; refused: nothing ran."""
    reason: str
    """What it lacks, in one line; empty for done."""
    reached: str
    """Last stage that finished; empty for none."""
    headline: str
    """What the run says, in one sentence."""
    model: str
    """The recommended model; empty for none."""
    verdicts: list[FleetVerdict]
    """Models by axis."""
    coefficients: list[FleetCoefficient]
    """Coefficients of all models."""
    speeds: dict[str, float]
    """Velocity u v w p q r -> its RMS on the training legs, in SI."""
    report: str
    """Path of the report, from the folder of the fleet, once it is drawn; empty for none."""
    recording: str
    """Path of the recording, likewise."""
