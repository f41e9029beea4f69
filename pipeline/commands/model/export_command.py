"""`auvid export`: a model in the form of a simulator, with what it loses there."""

from __future__ import annotations

from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.export import ExportLosses, check_target, prepare
from auvid.export.body import full_title
from auvid.export.readme import percent, three_digits
from auvid.export.text import sanitised
from auvid.export.writing import write_files
from auvid.hydro.arrays import AXES
from auvid.pipeline.campaigns.workspace import find_workspace, workspace_of
from auvid.pipeline.commands.model.named_model import NamedModel, named_model
from auvid.pipeline.commands.run.staleness import stale_words
from auvid.pipeline.output import answer, note
from auvid.pipeline.terminal import path_from_here, plain, table

EXPORTED = "exported"
"""Folder of exports where the user names none."""


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
    check_target(target)
    named = named_model(name)
    model = named.model
    if named.campaign is not None and (stale := stale_words(named.campaign, until="model_file")):
        note(f"WARNING: the exported model is of an earlier run: {stale}")
    file_name = file_name or _name_of_campaign(named)
    prepared = prepare(model, target, lossy=lossy, force=force, name=file_name, draws=draws)
    into = folder or default_folder() / f"{prepared.name}_{target}"
    paths = write_files(prepared, into, force=force)
    print(plain(f"{full_title(model)}: {model.use.sentence}"))
    if model.use.axes is None:
        print("no validation leg judges this model: all axes count as usable")
    print_losses(prepared.losses)
    print(f"\nwritten into {path_from_here(into.resolve())}:")
    for path in paths:
        print(f"  {path.name}")
    print("Begin with the README.")
    losses = prepared.losses
    answer(
        {
            "model": model.name,
            "vehicle": model.vehicle.title,
            "sentence": model.use.sentence,
            "target": target,
            "written": paths,
            "lost": [
                {"what": row.what, "why": row.why, "rms": dict(zip(AXES, row.rms, strict=True))}
                for row in losses.rows
            ],
            "lost_share": losses.shares,
            "remarks": losses.notes,
        }
    )


def _name_of_campaign(named: NamedModel) -> str | None:
    """Return CAMPAIGN_MODEL where the vehicle is a guess: its name is another's."""
    if named.campaign is None or named.model.vehicle.guessed is None:
        return None
    folder = workspace_of(named.campaign).campaign_folder(named.campaign).name
    return sanitised(f"{folder}_{named.model.name}")


def default_folder() -> Path:
    """Return the folder of exports, in the workspace or else in the current folder."""
    try:
        return find_workspace(Path.cwd()).root / EXPORTED
    except PipelineError:
        return Path(EXPORTED)


def print_losses(losses: ExportLosses) -> None:
    """Print lost parts as RMS force per axis within the flown range, and notes."""
    print()
    if not losses.rows:
        print(f"{losses.target} holds every force of the model")
    rows = [(row.what, *map(three_digits, row.rms)) for row in losses.rows]
    if rows:
        shares = losses.shares.values()
        rows.append(("all together", *map(three_digits, losses.total_rms)))
        rows.append(
            (
                "share of the viscous force",
                *map(percent, shares),
            )
        )
        rows.append(("viscous force of the model", *map(three_digits, losses.viscous_rms)))
        table(
            ("lost, RMS force in N and N m", *AXES),
            rows,
            title=f"What {losses.target} cannot hold, {losses.within}",
        )
        for row in losses.rows:
            print(plain(f"- {row.what}: {row.why}"))
    for remark in losses.notes:
        print(plain(f"- {remark}"))
