"""`auvid export`: a model in the form of a simulator, with what it loses there."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from auvid.data_schemas.errors import CampaignError, DataError, PipelineError, nearest
from auvid.hydro.arrays import AXES
from auvid.pipeline.campaigns.workspace import workspace_of
from auvid.pipeline.commands.open_run import check_fresh, open_run
from auvid.pipeline.graph import select
from auvid.pipeline.store.model_files import read_model
from auvid.pipeline.terminal import path_from_here, plain, table
from auvid.stages.number_format import significant

if TYPE_CHECKING:
    from auvid.data_schemas.records.model_file import ModelFile
    from auvid.export import ExportLosses


def export(
    name: str,
    target: str,
    *,
    folder: Path | None,
    file_name: str | None,
    lossy: bool,
    force: bool,
    draws: int,
) -> None:
    """Write a model for a target, and print what is lost and the files."""
    from auvid.export import prepare
    from auvid.export.writing import write_files

    path = model_path(name)
    if not Path(name).expanduser().is_file():
        warn_of_stale(name.removesuffix(f"/{path.stem}"))
    model = read_model(path)
    prepared = prepare(model, target, lossy=lossy, force=force, name=file_name, draws=draws)
    stem = next(iter(prepared.files)).partition(".")[0].removesuffix(f"_{target}")
    paths = write_files(prepared, folder or Path(f"{stem}_{target}"), force=force)
    print(plain(f"{model.title} of {model.vehicle.title}: {model.use.sentence}"))
    if model.use.axes is None:
        print("no validation leg judges this model: all axes count as usable")
    print_losses(prepared.losses)
    print("\nwritten:")
    for path in paths:
        print(f"  {path_from_here(path.resolve())}")


def warn_of_stale(campaign: str) -> None:
    """Print a warning where the models of a campaign are not up to date."""
    try:
        run = open_run(campaign)
        check_fresh(run, select(run.graph, until="model_file"))
    except PipelineError as fault:
        print(
            f"WARNING: the exported model may be out of date: {plain(str(fault))}", file=sys.stderr
        )


def print_losses(losses: ExportLosses) -> None:
    """Print lost parts as RMS force per axis within the flown range, and notes."""
    print()
    if not losses.rows:
        print(f"{losses.target} holds every force of the model")
    rows = [(row.what, *map(significant, row.rms)) for row in losses.rows]
    if rows:
        shares = losses.shares.values()
        rows.append(("all together", *map(significant, losses.total_rms)))
        rows.append(
            (
                "share of the viscous force",
                *("-" if share == float("inf") else _percent(share) for share in shares),
            )
        )
        rows.append(("viscous force of the model", *map(significant, losses.viscous_rms)))
        table(
            ("lost, RMS force in N and N m", *AXES),
            rows,
            title=f"What {losses.target} cannot hold, within the flown range",
        )
        for row in losses.rows:
            print(plain(f"- {row.what}: {row.why}"))
    for note in losses.notes:
        print(plain(f"- {note}"))


def model_path(name: str) -> Path:
    """Return the model file of a path, of CAMPAIGN or of CAMPAIGN/MODEL.

    Of a campaign alone it is the recommended model.

    Raises `CampaignError` for an unknown file, campaign or model, and `DataError` where
    a campaign has no model files yet or recommends none.
    """
    path = Path(name).expanduser()
    if path.is_file() and path.name != "campaign.yaml":
        return path
    if path.suffix == ".json":
        raise CampaignError("no such model file", value=name, remedy="Check the path.")
    try:
        files, campaign, model = _files(name), name, None
    except PipelineError:
        campaign, slash, model = name.rpartition("/")
        if not slash:
            raise
        files = _files(campaign)
    if model is not None:
        if model not in files:
            raise CampaignError(
                "the campaign has no such model",
                value=model,
                allowed=list(files),
                remedy=nearest(model, files),
            )
        return files[model]
    chosen = [path for path in files.values() if _recommended(read_model(path))]
    if not chosen:
        raise DataError(
            "the run recommends no model",
            value=campaign,
            allowed=list(files),
            remedy=f"Name one: {campaign}/{next(iter(files))}.",
        )
    return chosen[0]


def _files(campaign: str) -> dict[str, Path]:
    """Return the model files of a campaign's run by name."""
    workspace = workspace_of(campaign)
    folder = workspace.campaign_folder(campaign)
    files = workspace.runs / folder.name / "model_file" / "model_file"
    there = {path.stem: path for path in sorted(files.glob("*.json"))}
    if not there:
        raise NoModels(
            "the campaign has no model files yet",
            value=campaign,
            remedy=f"auvid run {campaign}",
        )
    return there


class NoModels(DataError):
    """A campaign without a run that has written models."""


def _percent(share: float) -> str:
    return f"{significant(100.0 * share)} %"


def _recommended(model: ModelFile) -> bool:
    return model.use.recommended
