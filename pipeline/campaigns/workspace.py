"""The folder of params.yaml, campaigns/, vehicles/ and runs/, and its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import CampaignError, ManyFaults, PipelineError, nearest
from auvid.pipeline.campaigns.campaign import Campaign
from auvid.pipeline.campaigns.vehicle_files import SHIPPED_VEHICLES
from auvid.pipeline.campaigns.yaml_files import YamlFile, load_yaml
from auvid.stages.base import Stage, make_params

PARAMS_FILE = "params.yaml"


@dataclass(frozen=True)
class Workspace:
    """A workspace by its root folder."""

    root: Path

    @property
    def campaigns(self) -> Path:
        return self.root / "campaigns"

    @property
    def runs(self) -> Path:
        return self.root / "runs"

    @property
    def code(self) -> Path:
        """Folder of the small files on which DVC depends in place of the code."""
        return self.runs / ".code"

    def campaign_folder(self, name: str) -> Path:
        """Return the folder of a campaign, given by name, folder or manifest."""
        path = Path(name).expanduser()
        if path.name == "campaign.yaml":
            return path.resolve().parent
        if (path / "campaign.yaml").is_file():
            return path.resolve()
        names = self.campaign_names()
        if name in names:
            return self.campaigns / name
        raise CampaignError(
            "no such campaign",
            value=name,
            allowed=names or "none yet",
            remedy=nearest(name, names)
            or f"Campaigns live in {self.campaigns}, one folder with a campaign.yaml each.",
        )

    def campaign_names(self) -> list[str]:
        """Names of the campaigns of this workspace."""
        return sorted(path.parent.name for path in self.campaigns.glob("*/campaign.yaml"))

    def vehicle_files(self) -> dict[str, Path]:
        """Vehicles by name: those of the workspace, then those that come with auvid."""
        files: dict[str, Path] = {}
        for folder in (SHIPPED_VEHICLES, self.root / "vehicles"):
            files |= {path.stem: path for path in folder.glob("*.yaml")}
        return dict(sorted(files.items()))


def find_workspace(start: Path) -> Workspace:
    """The nearest folder at or above `start` that holds params.yaml."""
    for folder in (start.resolve(), *start.resolve().parents):
        if (folder / PARAMS_FILE).is_file():
            return Workspace(folder)
    raise PipelineError(
        f"no {PARAMS_FILE} here or above",
        value=str(start),
        remedy="Go to a workspace, or make one: auvid new DIR.",
    )


def workspace_of(campaign: str) -> Workspace:
    """The workspace around the current folder, or around a campaign given by path.

    A campaign folder outside any workspace is its own: every stage parameter has its
    default, and runs/ stands in that folder.
    """
    start = Path(campaign).expanduser()
    try:
        return find_workspace(Path.cwd())
    except PipelineError:
        if not start.exists():
            raise
    folder = start.resolve().parent if start.is_file() else start.resolve()
    try:
        return find_workspace(folder)
    except PipelineError:
        if not (folder / "campaign.yaml").is_file():
            raise
    return Workspace(folder)


def vehicle_file_of(name: str) -> Path:
    """Return the file of a vehicle, given by name or by its path.

    Names are those of the workspace here and of the vehicles that come with auvid.
    """
    if name.endswith(".yaml"):
        return Path(name).expanduser()
    try:
        files = find_workspace(Path.cwd()).vehicle_files()
    except PipelineError:
        files = {path.stem: path for path in sorted(SHIPPED_VEHICLES.glob("*.yaml"))}
    if name not in files:
        raise CampaignError(
            "no such vehicle", value=name, allowed=files, remedy=nearest(name, files)
        )
    return files[name]


def load_defaults(workspace: Workspace, stages: Sequence[Stage[Any, Any, Any]]) -> YamlFile:
    """Read params.yaml, checked against the stages; empty outside any workspace.

    Raises `CampaignError` for unknown sections or parameters.
    """
    if not (workspace.root / PARAMS_FILE).exists() and (workspace.root / "campaign.yaml").is_file():
        return YamlFile(workspace.root / PARAMS_FILE, {})
    file = load_yaml(workspace.root / PARAMS_FILE)
    if not isinstance(file.value, Mapping):
        raise CampaignError("needs one section per stage", file=file.path)
    names = [stage.name for stage in stages]
    for name, section in file.value.items():
        if name == "campaigns":
            continue
        if name not in names:
            raise file.located(
                CampaignError(
                    "unknown stage", file=file.path, field=str(name), remedy=nearest(name, names)
                )
            )
        if not isinstance(section, Mapping):
            raise file.located(
                CampaignError(
                    "not a mapping of parameters", file=file.path, field=str(name), value=section
                )
            )
    for stage in stages:
        try:
            make_params(stage.params, file.value.get(stage.name) or {}, stage=stage.name)
        except PipelineError as fault:
            raise _located(file, fault) from None
    return file


def _located(file: YamlFile, fault: PipelineError) -> PipelineError:
    """Return a fault of a parameter with its row in params.yaml."""
    if isinstance(fault, ManyFaults):
        return ManyFaults([_located(file, each) for each in fault.faults], file=file.path)
    fault.row = file.line((fault.field or "").removeprefix("stages."))
    return file.located(fault)


def stage_params(stage: Stage[Any, Any, Any], defaults: YamlFile, campaign: Campaign) -> Any:
    """The parameters of a stage: params.yaml, and what the campaign sets on top."""
    own = (campaign.document.get("stages") or {}).get(stage.name) or {}
    try:
        return make_params(
            stage.params,
            {**(defaults.value.get(stage.name) or {}), **own},
            stage=stage.name,
            file=campaign.file.path,
        )
    except PipelineError as fault:
        raise campaign.file.located(fault) from None
