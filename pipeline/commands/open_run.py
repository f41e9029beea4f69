"""What commands share: a campaign opened as a run, and progress in the terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from auvid.data_schemas.errors import DataError
from auvid.pipeline.campaigns.campaign import load_campaign
from auvid.pipeline.campaigns.stage_settings import load_defaults, stage_params
from auvid.pipeline.campaigns.workspace import Workspace, find_workspace, workspace_of
from auvid.pipeline.execution.dvc_inputs import write_inputs
from auvid.pipeline.execution.kept_output import Beginning
from auvid.pipeline.execution.progress import Bars, Progress, ProgressLines, Silent
from auvid.pipeline.execution.runner import Run, write_code_files
from auvid.pipeline.graph import AnyStage, Graph, names_of, stages_of_kind
from auvid.pipeline.output import OUTPUT
from auvid.stages.registry import KINDS, STAGES


def open_run(name: str, workspace: Workspace | None = None) -> Run:
    """Return the run of a campaign given by name or path.

    `workspace`: where it stands; without one that around the current folder, or around
    the path. Raises `PipelineError` for anything wrong with workspace, manifest or parameters.
    """
    workspace = workspace or workspace_of(name)
    folder = workspace.campaign_folder(name)
    campaign = load_campaign(folder, kinds=KINDS, vehicles=workspace.vehicle_files())
    graph = Graph(stages_of_kind(STAGES, KINDS, campaign.document["kind"]))
    defaults = load_defaults(workspace, graph.stages, names_of(STAGES))
    params = {stage.name: stage_params(stage, defaults, campaign) for stage in graph.stages}
    return Run(campaign, graph, params, workspace.runs / campaign.name)


def check_fresh(run: Run, stages: Sequence[AnyStage]) -> None:
    """Raise `DataError` where a stage has not been run, or is not up to date."""
    remedy = f"auvid run {run.campaign.name}"
    for stage in stages:
        for place in run.places(stage.maps_over):
            if place.item not in run.manifests[stage.name].records:
                raise DataError(
                    f"stage {stage.name} has not been run", file=run.folder, remedy=remedy
                )
            if not run.is_fresh(run.task(stage, place)):
                raise DataError(
                    f"the results of stage {stage.name} are not up to date",
                    file=run.folder,
                    remedy=remedy,
                )


@contextmanager
def show_progress(*, quiet: bool = False) -> Iterator[Progress]:
    """Show bars on a terminal, plain lines otherwise; nothing if quiet."""
    if quiet or OUTPUT.quiet:
        yield Silent()
    elif sys.stderr.isatty():
        with Bars() as bars:
            yield bars
    else:
        lines = ProgressLines(verbose=OUTPUT.verbose)
        try:
            yield lines
        finally:
            lines.close()


def write_codes() -> None:
    """Write the files of this workspace on which DVC depends in place of the code."""
    write_code_files(STAGES, find_workspace(Path.cwd()).code)


def write_inputs_of(campaign: str) -> None:
    """Write the hashes of what a campaign's stages read, on which DVC depends."""
    start = Beginning()
    workspace = find_workspace(Path.cwd())
    write_inputs(open_run(campaign, workspace), workspace, start=start)
