"""`auvid run`: bring a campaign up to date; `auvid report`: where its report is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.commands.history import history_page, run_history
from auvid.pipeline.commands.open_run import open_run, show_progress
from auvid.pipeline.commands.run.run_summary import (
    bound_missed,
    losses,
    print_summary,
    result_files,
)
from auvid.pipeline.execution.engines import make_engine
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.graph import AnyStage, select

FINE, FAILED, LOSSES = 0, 1, 3


def run_campaign(
    campaign: str,
    *,
    only: str | None = None,
    until: str | None = None,
    strict: bool = False,
    engine: str | None = None,
    jobs: int | None = None,
    force: bool = False,
) -> int:
    """Run what is stale, print the results in short, and return the exit code.

    The code is 0 for fine, 1 for a bound that is missed, 3 for losses under `strict`.
    """
    run = open_run(campaign)
    stages = select(run.graph, only=only, until=until)
    count = execute(run, stages, engine=engine, jobs=jobs, force=force)
    items = f"{count} item{'s' * (count != 1)} run"
    print(items if count else "nothing to do: everything is up to date")
    if only is None:
        print_summary(run)
        if bound_missed(run, stages):
            return FAILED
    return LOSSES if strict and losses(run) else FINE


def execute(
    run: Run,
    stages: Sequence[AnyStage],
    *,
    engine: str | None = None,
    jobs: int | None = None,
    force: bool = False,
) -> int:
    """Bring stages of a run up to date and return how many items had to run.

    A run that makes its report again is entered into the history of the campaign.
    """
    reported = any(stage.name == "report" for stage in stages)
    with show_progress() as progress:
        return run.execute(
            stages,
            make_engine(engine, jobs),
            progress,
            force=force,
            after=run_history.add_entry if reported else None,
        )


def report_file(
    campaign: str, *, rebuild: bool = False, compare: bool = False, against: int | None = None
) -> Path:
    """Return the report of a campaign, made again or compared with an earlier run."""
    run = open_run(campaign)
    if rebuild:
        execute(run, select(run.graph, only="report"), force=True)
    page = result_files(run).get("report")
    if page is None or not page.is_file():
        name = run.campaign.name
        raise PipelineError("there is no report yet", value=name, remedy=f"auvid run {name}")
    if compare or against is not None:
        return history_page.write_compared(run, against)
    return page
