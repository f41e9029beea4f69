"""The manifest of a campaign."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, model_validator

from auvid.data_schemas.checks import checks
from auvid.data_schemas.documents.model import Faults, Model, Range, fault
from auvid.data_schemas.errors import nearest


def _finding(name: str) -> str:
    """Return the name of a finding; raise `Faults` for one that there is not."""
    if name not in checks():
        remedy = nearest(name, checks()) or "docs/checks.md lists all findings."
        raise Faults(fault("no such finding", value=name, remedy=remedy))
    return name


Motion = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]
FindingName = Annotated[str, AfterValidator(_finding)]


class SimulateEntry(Model):
    """Twin campaigns: logs and legs come from a plan that is flown."""

    plan: str
    """Path of the plan."""
    truth: str | None = None
    """Physics (default), the name of a model with published coefficients, refit:MODEL,
    or the path of a model card (.json).
    """
    seed: Annotated[int, Range(0)] | None = None
    """Seed of all noise; default 0."""
    format: Literal["bin", "tlog", "csv"] | None = None
    """Kind of log files; default bin."""
    accelerometer: Literal["specific_force", "inertial"] | None = None
    """What CSV logs hold; default specific_force."""


class FileEntry(Model):
    """Files."""

    file: str
    """Path."""
    columns: str | None = None
    """Column map."""
    reader: str | None = None
    """Force this reader."""


class LogEntry(Model):
    """Logs."""

    id: str
    """Short name."""
    file: str | None = None
    """Path of the log in the campaign folder."""
    columns: str | None = None
    """Column map of a CSV log."""
    reader: str | None = None
    """Force this reader."""
    sources: dict[str, str] | None = None
    """Stream -> source that replaces the preferred one."""
    files: list[FileEntry] | None = None
    """Several files of one log on one clock."""
    accept: list[FindingName] | None = None
    """Findings of docs/checks.md that shall not stop a run, in this log."""


class LegEntry(Model):
    """A stretch of a log, for training or validation."""

    id: str
    """Short name."""
    log: str
    """Id of its log."""
    start_s: Annotated[float, Range(0)] | None = None
    """Seconds from the first time-stamped record."""
    end_s: Annotated[float, Range(0)] | None = None
    """Seconds from the first time-stamped record."""
    use: Literal["training", "validation"] = "training"
    """Fit or judge."""
    role: str | None = None
    """Role in a bench campaign; of kind passive: tow, coast, decay or drift."""
    channel: Motion | None = None
    """Excited channel."""
    mass_kg: Annotated[float, Range(0)] | None = None
    """Mass [kg] of the vehicle on this leg, where it is ballasted otherwise than the
    vehicle file says.
    """
    inertia_kg_m2: Annotated[float, Range(0)] | None = None
    """Moment of inertia [kg m^2] about the axis of the channel on this leg, likewise.
    """


class PriorEntry(Model):
    """What others know of coefficients: `bench`, `campaign` or `shelf`."""

    bench: str | None = None
    """Path of the `results.json` of a bench stage."""
    campaign: str | None = None
    """Path of a model card (.json) of another campaign: its posterior."""
    shelf: str | None = None
    """A published set: its name, as bluerov2_wu_2018, or the path of a vehicle file."""
    prior_sd: Annotated[float, Range(0.01, 10.0)] | None = None
    """With `shelf`: standard deviation of each coefficient as a share of its value; .5
    without.
    """
    terms: list[str] | None = None
    """Coefficients to take, as `Y_v` or `X_u|u|`; all of the file without."""
    widen: Annotated[float, Range(1.0)] = 1.0
    """Factor on standard deviations: bench, load and day differ."""

    @model_validator(mode="after")
    def _one_of_two(self) -> PriorEntry:
        if sum(item is not None for item in (self.bench, self.campaign, self.shelf)) != 1:
            raise Faults(fault("name one source: `bench`, `campaign` or `shelf`"))
        if self.prior_sd is not None and self.shelf is None:
            raise Faults(fault("only a published set (`shelf`) takes it", "prior_sd"))
        return self


class CampaignDocument(Model):
    """The manifest of a campaign."""

    kind: Literal[
        "identification",
        "axes",
        "twin",
        "bench",
        "bench_twin",
        "glide",
        "glide_twin",
        "passive",
        "control",
    ]
    """Selects the graph of stages."""
    title: str | None = None
    """One line for the report."""
    notes: str | None = None
    """What a reader of the report should know of the data."""
    vehicle: str
    """Name of a vehicle file or a path to one."""
    simulate: SimulateEntry | None = None
    """Twin campaigns: logs and legs come from a plan that is flown."""
    apparatus: str | None = None
    """Bench campaigns: path of the document of pendulums and timed oscillations."""
    published: str | None = None
    """Path of the document of published values to compare the results with."""
    shelf: list[str] | None = None
    """Published vehicles to judge on this dive: names in vehicles/shelf, with * for any
    letters, or paths.
    """
    priors: list[PriorEntry] | None = None
    """Priors on coefficients of structures: from a bench, another campaign or the shelf."""
    fill: dict[Motion, str] | None = None
    """Axes campaigns: axes that the logs do not give, from a published set (its name, as
    bluerov2_wu_2018, or the path of a vehicle file) or from the results.json of a bench.
    """
    cases: str | None = None
    """Control campaigns: path of the document of trajectories, weights, limits and
    disturbances.
    """
    model: str | None = None
    """Control campaigns: path of a model card (.json)."""
    logs: list[LogEntry]
    """The logs; a twin has none in its manifest."""
    legs: list[LegEntry]
    """The legs; a twin has those of its plan."""
    accept: list[FindingName] | None = None
    """Findings of docs/checks.md that shall not stop a run, in any log."""
    stages: dict[str, dict[str, object]] | None = None
    """Parameters per stage that differ from params.yaml."""
