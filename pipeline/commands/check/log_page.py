"""The health of one log, as the commands `check` and `inspect` use it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from auvid.data_schemas.checks import checks
from auvid.data_schemas.documents import check_document
from auvid.data_schemas.errors import PipelineError
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.campaign import Campaign, LogFile, load_campaign
from auvid.pipeline.campaigns.stage_settings import load_defaults, stage_params
from auvid.pipeline.campaigns.workspace import workspace_of
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.pipeline.commands.check.run_gate import refusal
from auvid.pipeline.execution.task_inputs import log_files, log_source
from auvid.pipeline.graph import names_of, stages_of_kind
from auvid.stages import ingest
from auvid.stages.base import Document
from auvid.stages.ingest.health.finding import CheckedLog
from auvid.stages.ingest.health.usability import legs
from auvid.stages.registry import KINDS, STAGES


@dataclass(frozen=True)
class LogPage:
    """The health of one log and the legs in it, or the reason of its refusal."""

    name: str
    health: Mapping[str, Any] | None = None
    refused: str | None = None
    legs: tuple[Mapping[str, Any], ...] = ()
    outputs: ingest.Outputs | None = field(default=None, repr=False)
    vehicle: Vehicle | None = field(default=None, repr=False)

    @property
    def losses(self) -> bool:
        """Return whether bytes were lost or an error was found."""
        return self.health is not None and (
            self.health["status"] != "complete"
            or any(item["severity"] == "error" for item in self.health["findings"])
        )

    @property
    def stops(self) -> bool:
        """Return whether a finding stops a run that does not accept it."""
        return self.health is not None and any(
            checks()[item["id"]].stops for item in self.health["findings"]
        )

    @property
    def streams(self) -> dict[str, Any]:
        """Return the tables of the log by name of stream."""
        names = () if self.health is None else self.health["streams"]
        return {name: getattr(self.outputs, name) for name in names}

    @property
    def document(self) -> dict[str, Any]:
        """Return the page as JSON."""
        if self.health is None:
            return {"name": self.name, "refused": self.refused}
        legs = {"legs": list(self.legs)} if self.legs else {}
        return {"name": self.name, "health": self.health, **legs}


def names_campaign(target: str) -> bool:
    """Return whether a target is a campaign (name, folder, manifest) and not a file."""
    path = Path(target).expanduser()
    return (
        path.name == "campaign.yaml"
        or (path / "campaign.yaml").is_file()
        or not (path.exists() or path.suffix or os.sep in target)
    )


def log_pages(target: str, columns: Path | None) -> list[LogPage]:
    """Return the page of a log file, or of every log of a campaign."""
    if not names_campaign(target):
        path, mapping = Path(target).expanduser(), None
        if columns is not None:
            file = load_yaml(columns, what="column map")
            file.check("column_map")
            mapping = file.value
        # bytes of a name that are no text become a replacement character
        own = Path(os.fsencode(path).decode(errors="replace"))
        return [page_of_log(str(own), own.stem, (LogFile(own.name, path, mapping),))]
    workspace = workspace_of(target)
    campaign = load_campaign(
        workspace.campaign_folder(target), kinds=KINDS, vehicles=workspace.vehicle_files()
    )
    simulated = workspace.runs / campaign.name / "simulate" / "logs"
    pages = []
    for log in campaign.logs:
        name = f"{campaign.name}: {log}"
        try:
            files = log_files(campaign, log, simulated)
        except PipelineError as fault:
            pages.append(LogPage(name, refused=str(fault)))
        else:
            pages.append(page_of_log(name, log, files, campaign))
    return pages


def campaign_refusal(target: str, pages: Sequence[LogPage]) -> PipelineError | None:
    """Return why a run of a campaign would stop at what these pages of it hold."""
    workspace = workspace_of(target)
    campaign = load_campaign(
        workspace.campaign_folder(target), kinds=KINDS, vehicles=workspace.vehicle_files()
    )
    stages = stages_of_kind(STAGES, KINDS, campaign.document["kind"])
    defaults = load_defaults(workspace, stages, names_of(STAGES))
    params = {stage.name: stage_params(stage, defaults, campaign) for stage in stages}
    health = {page.health["log"]: page.health for page in pages if page.health is not None}
    return refusal(campaign, health, [stage.name for stage in stages], params)


def page_of_log(
    name: str,
    log: str,
    files: Sequence[LogFile],
    campaign: Campaign | None = None,
    vehicle: Vehicle | None = None,
) -> LogPage:
    """Decode one log and check it; a log that cannot be read gives a page with why.

    `vehicle`: the one of a log that is in no campaign.
    """
    leg_entries: list[Document] = []
    reader = view = None
    if campaign is not None:
        reader, view = campaign.logs[log].get("reader"), campaign.seen_by(log)
        vehicle = campaign.vehicle
        leg_entries = [leg for leg in campaign.legs.values() if leg["log"] == log]
    try:
        source = log_source(log, files, reader=reader)
        outputs = ingest.run(
            ingest.Inputs(source.load(), view, vehicle), ingest.Params(max_dropped_share=1.0)
        )
        source.check_unchanged()
    except PipelineError as fault:
        return LogPage(name, refused=str(fault))
    check_document(outputs.health, "health")
    page = LogPage(name, outputs.health, outputs=outputs)
    recorded = CheckedLog(page.streams, outputs.log_info, outputs.dropped, vehicle)
    in_it = tuple(legs(recorded, leg_entries))
    return LogPage(name, outputs.health, legs=in_it, outputs=outputs, vehicle=vehicle)
