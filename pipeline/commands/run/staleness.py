"""Whether results are those of the manifest, logs and code that are there."""

from __future__ import annotations

from collections.abc import Sequence

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.execution.kept_output import is_as_last_run
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.graph import AnyStage, select
from auvid.pipeline.terminal import plain


def stale_stage(run: Run, stages: Sequence[AnyStage]) -> str | None:
    """Return the first of these stages with results that are not up to date."""
    for stage in stages:
        manifest = run.manifests[stage.name]
        records = manifest.records
        try:
            places = run.places(stage.maps_over) if records else []
            fresh = {*records} <= {place.item for place in places} and all(
                run.is_fresh(run.task(stage, place)) for place in places if place.item in records
            )
        except PipelineError:  # an input is gone, or a leg has another name
            fresh = False
        if manifest.damaged or not fresh:
            return stage.name
    return None


def stale_words(campaign: str, *, until: str | None = None) -> str:
    """Return which results of a campaign are not up to date; empty where all are.

    until: the last stage that counts; None for all.
    """
    if is_as_last_run(campaign):
        return ""
    try:
        run = open_run(campaign)
        name = stale_stage(run, select(run.graph, until=until))
    except PipelineError as fault:
        return plain(str(fault))
    if name is None:
        return ""
    return (
        f"results of {run.campaign.name} from stage {name} on are not up to date; auvid run"
        f" {run.campaign.name} brings them up to date"
    )
