"""The model that a command's user names: a file, a published set, or one of a run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from auvid import __version__
from auvid.data_schemas.errors import CampaignError, DataError, PipelineError, UsageError, nearest
from auvid.data_schemas.records.model_file import ModelFile
from auvid.pipeline.campaigns.workspace import Workspace, find_workspace, workspace_of
from auvid.pipeline.store.model_files import read_model


@dataclass(frozen=True)
class NamedModel:
    """A model, and the campaign that made it: None for a file and a published set."""

    model: ModelFile
    campaign: str | None = None


def named_model(name: str) -> NamedModel:
    """Return the model of a path, a published set, CAMPAIGN or CAMPAIGN/MODEL.

    Of a campaign alone it is the recommended model; a vehicle file (.yaml) gives its
    published damping. Raises `UsageError` for an unknown set, campaign or model,
    `CampaignError` for an unknown file, and `DataError` where a campaign has no model
    files yet or recommends none.
    """
    path = Path(name).expanduser()
    if path.suffix == ".yaml" and path.name != "campaign.yaml":
        return NamedModel(published(path))
    if path.is_file() and path.name != "campaign.yaml":
        return NamedModel(read_model(path))
    if path.suffix == ".json":
        raise CampaignError("no such model file", value=name, remedy="Check the path.")
    if "/" not in name and not _is_campaign(name):
        shelf = _shelf()
        if name in shelf:
            return NamedModel(published(shelf[name]))
        campaigns = _campaign_names()
        raise UsageError(
            "no such model",
            value=name,
            allowed="a model file (.json), a campaign, CAMPAIGN/MODEL, or a published set",
            remedy=nearest(name, [*campaigns, *shelf])
            or f"Campaigns here: {', '.join(campaigns) or 'none'}."
            f" Published sets: {', '.join(shelf)}.",
        )
    return _of_campaign(name)


def published(path: Path) -> ModelFile:
    """Return the model of a file that `load_published` reads."""
    from auvid.hydro.published_model import published_model
    from auvid.pipeline.campaigns.vehicle_files import load_published
    from auvid.pipeline.store.file_hashes import hash_value

    vehicle = load_published(path)
    written = vehicle.document.model_dump(exclude_unset=True)
    return published_model(vehicle, vehicle_hash=hash_value(written), version=__version__)


def _shelf() -> dict[str, Path]:
    from auvid.pipeline.campaigns.vehicle_files import shelf_files

    return shelf_files()


def _workspace() -> Workspace | None:
    try:
        return find_workspace(Path.cwd())
    except PipelineError:
        return None


def _campaign_names() -> list[str]:
    workspace = _workspace()
    return [] if workspace is None else workspace.campaign_names()


def _is_campaign(name: str) -> bool:
    path = Path(name).expanduser()
    folder = path.parent if path.name == "campaign.yaml" else path
    return (folder / "campaign.yaml").is_file() or name in _campaign_names()


def _of_campaign(name: str) -> NamedModel:
    try:
        files, campaign, model = _files(name), name, None
    except PipelineError:
        campaign, slash, model = name.rpartition("/")
        if not slash:
            raise
        files = _files(campaign)
    if model is not None:
        if model not in files:
            raise UsageError(
                "the campaign has no such model",
                value=model,
                allowed=list(files),
                remedy=nearest(model, files),
            )
        return NamedModel(read_model(files[model]), campaign)
    chosen = [path for path in files.values() if _recommended(path)]
    if not chosen:
        raise DataError(
            "the run recommends no model",
            value=campaign,
            allowed=list(files),
            remedy=f"Name one: {campaign}/{next(iter(files))}.",
        )
    return NamedModel(read_model(chosen[0]), campaign)


def _recommended(path: Path) -> bool:
    """Return whether a model file is the one to take, without checking it all."""
    try:
        return bool(json.loads(path.read_bytes())["use"]["recommended"])
    except (ValueError, KeyError, TypeError):
        return read_model(path).use.recommended


def _files(campaign: str) -> dict[str, Path]:
    """Return the model files of a campaign's run by name."""
    workspace = workspace_of(campaign)
    folder = workspace.campaign_folder(campaign)
    files = workspace.runs / folder.name / "model_file" / "model_file"
    there = {path.stem: path for path in sorted(files.glob("*.json"))}
    if not there:
        raise DataError(
            "the campaign has no model files yet",
            value=campaign,
            remedy=f"auvid run {campaign}",
        )
    return there
