"""`auvid run`: bring a campaign up to date; `auvid report`: where its report is."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.commands.check.run_gate import refusal
from auvid.pipeline.commands.history import history_page, run_history
from auvid.pipeline.commands.open_run import open_run, show_progress
from auvid.pipeline.commands.run.run_summary import (
    bound_missed,
    health_of,
    losses,
    print_summary,
    summary_document,
)
from auvid.pipeline.commands.run.staleness import stale_stage
from auvid.pipeline.execution.engines import Engine, make_engine
from auvid.pipeline.execution.kept_output import Beginning, Printed, Recorder, keep_printed
from auvid.pipeline.execution.memory import available_bytes, shortage
from auvid.pipeline.execution.runner import Place, Run
from auvid.pipeline.graph import ONCE, AnyStage, Graph, select
from auvid.pipeline.output import FAILED, FINE, LOSSES, OUTPUT, answer
from auvid.pipeline.store.atomic_files import remove_stale_files

NOTHING = "nothing to do: everything is up to date"


def run_campaign(
    campaign: str,
    *,
    only: str | None = None,
    until: str | None = None,
    strict: bool = False,
    engine: Engine | None = None,
    force: bool = False,
) -> int:
    """Run what is stale, print the results in short, and return the exit code.

    The code is 0 for fine, 1 for a bound that is missed, 3 for losses under `strict`;
    findings that stop the run raise `DataError`, which ends with 1.
    """
    start = Beginning()
    run = open_run(campaign)
    stages = select(run.graph, only=only, until=until)
    count = execute(run, stages, engine=engine, force=force)
    items = f"{count} item{'s' * (count != 1)} run"
    if not OUTPUT.quiet:
        print(items if count else NOTHING)
    document = {"items_run": count}
    with redirect_stdout(Recorder(sys.stdout)) as results:  # type: ignore[type-var]
        if only is None:
            printed, rest = _up_to_date(run, stages)
            print_summary(printed)
            document = {**document, **summary_document(printed)}
            if rest:
                print(f"\nnot printed: results from stage {rest} on, of an earlier run")
    answer(document)
    missed = only is None and bound_missed(run, stages)
    status = FAILED if missed else LOSSES if strict and losses(run) else FINE
    if only is None and until is None and not (OUTPUT.quiet or OUTPUT.verbose):
        text = "".join([f"{NOTHING}\n", *results.parts])
        kept = Printed(text, status, {**document, "items_run": 0})
        keep_printed(kept, run, start=start, strict=strict)
    return status


def _up_to_date(run: Run, stages: Sequence[AnyStage]) -> tuple[Run, str | None]:
    """Return the run as far as it is up to date, and the first stage that is not.

    Where one is not, that is the run of the stages that were selected.
    """
    rest = [stage for stage in run.graph.stages if stage not in stages]
    stale = stale_stage(run, rest)
    return (run if stale is None else replace(run, graph=Graph(tuple(stages)))), stale


def execute(
    run: Run,
    stages: Sequence[AnyStage],
    *,
    engine: Engine | None = None,
    force: bool = False,
    quiet: bool = False,
) -> int:
    """Bring stages of a run up to date and return how many items had to run.

    Stages behind ingest run only if the findings of the logs let them: `DataError`.
    A run with a report is entered into the history of the campaign, unless it is there.
    `engine`: closed at the end; None works here, one item after another. `quiet`: no
    progress is printed.
    """
    engine = engine or make_engine()
    try:
        return _execute(run, stages, engine, force=force, quiet=quiet)
    finally:
        engine.close()


def _execute(
    run: Run, stages: Sequence[AnyStage], engine: Engine, *, force: bool, quiet: bool
) -> int:
    names = [stage.name for stage in stages]
    decoding = stages[: names.index("ingest") + 1] if "ingest" in names else ()
    count = 0
    if decoding:
        with show_progress(quiet=quiet) as progress:
            count = run.execute(decoding, engine, progress, force=force, close_engine=False)
    rest = stages[len(decoding) :]
    if rest:
        if names != ["report"]:
            _stop_at_findings(run, [stage.name for stage in rest])
            _stop_at_shortage(run, rest, engine.workers, force=force)
        with show_progress(quiet=quiet) as progress:
            count += run.execute(
                rest,
                engine,
                progress,
                force=force,
                close_engine=False,
                after=run_history.add_entry if "report" in names else None,
            )
    return count


def _stop_at_findings(run: Run, stages: Sequence[str]) -> None:
    """Raise `DataError` where findings of the logs stop these stages."""
    fault = refusal(run.campaign, health_of(run), stages, run.params)
    if fault is not None:
        raise fault


def _stop_at_shortage(run: Run, stages: Sequence[AnyStage], workers: int, *, force: bool) -> None:
    """Raise `DataError` where legs have to run that would not fit into memory."""
    if "resample" in run.params:
        lengths_s = {log: float(document["duration_s"]) for log, document in health_of(run).items()}
        rate_hz = run.params["resample"].rate_hz
        fault = shortage(run.campaign, lengths_s, rate_hz, workers, available_bytes())
        if fault is not None and (force or _any_stale(run, stages)):
            raise fault


def _any_stale(run: Run, stages: Sequence[AnyStage]) -> bool:
    """Return whether an item of these stages has to run."""
    try:
        return not all(
            run.is_fresh(run.task(stage, place))
            for stage in stages
            for place in run.places(stage.maps_over)
        )
    except PipelineError:  # an input has not been made yet
        return True


def report_file(
    campaign: str, *, rebuild: bool = False, compare: bool = False, against: int | None = None
) -> Path:
    """Return the report of a campaign, made again or compared with an earlier run."""
    run = open_run(campaign)
    if rebuild:
        execute(run, select(run.graph, only="report"), force=True)
    else:
        write_deferred_report(run)
    pages = [
        artefact
        for port in run.graph.producers("report_html")
        for artefact in run.artefacts_of(port, ONCE).values()
    ]
    if not pages or not pages[0].path.is_file():
        name = run.campaign.name
        done = [stage.name for stage in run.graph.stages if run.manifests[stage.name].records]
        words = f": its run has ended behind stage {done[-1]}" if done else ""
        remedy = f"auvid run {name}" + (
            f" says why, auvid check {name} has all findings" if done else ""
        )
        raise PipelineError(f"there is no report yet{words}", value=name, remedy=remedy)
    page = pages[0]
    page.load()  # refuses one that is not as it was written
    if compare or against is not None:
        return history_page.write_compared(run, against)
    return page.path


def discard_stale_report(run: Run) -> None:
    """Remove page and recording of a run that show other results than it has."""
    manifest = run.manifests["report"]
    try:
        fresh = run.is_fresh(run.task(run.graph.stage("report"), Place(ONCE)))
    except PipelineError:
        fresh = False
    if manifest.records and not fresh:
        names = {name for record in manifest.records.values() for name in record.outputs}
        manifest.write({}, [])
        remove_stale_files(manifest.folder, {manifest.path}, names)


def write_deferred_report(run: Run, *, quiet: bool = False) -> None:
    """Write page and recording of a run that was left without: a dive of a fleet.

    Nothing is done where it has a report, or where a stage before it has not been run.
    """
    if "report" in run.manifests and not run.manifests["report"].records:
        try:
            run.task(run.graph.stage("report"), Place(ONCE))
        except PipelineError:
            return
        execute(run, select(run.graph, only="report"), quiet=quiet)
