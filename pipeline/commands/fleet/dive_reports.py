"""Pages and recordings of a fleet's dives, drawn when they are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder
from auvid.pipeline.commands.fleet.fleet_tables import read_table
from auvid.pipeline.commands.open_run import open_run, show_progress
from auvid.pipeline.commands.run.run_command import write_deferred_report
from auvid.pipeline.execution.engines import Engine
from auvid.pipeline.execution.task import Task
from auvid.pipeline.execution.task_inputs import Value
from auvid.stages.base import Stage


@dataclass(frozen=True)
class Inputs:
    """One dive of a fleet."""

    log: str
    fleet: FleetFolder


@dataclass(frozen=True)
class Params:
    """Nothing: what can be set stands in the campaigns."""


@dataclass(frozen=True)
class Outputs:
    """Nothing: the files are those of stage report of the dive's run."""


def draw_reports(fleet: FleetFolder, logs: Sequence[str] | None, engine: Engine) -> list[str]:
    """Draw what is not there of these dives (None: of all), and return what went wrong.

    A line for each dive without a page at the end; `engine` stays open.
    """
    rows = [row for row in read_table(fleet, "runs").to_pylist() if row["report"]]
    lacking = [
        row["log"]
        for row in rows
        if (logs is None or row["log"] in logs) and not (fleet.root / row["report"]).is_file()
    ]
    faults = []
    if lacking:
        with show_progress() as progress:
            progress.stage("report", todo=len(lacking), total=len(rows), level="log")
            for outcome in engine.map([_task(log, fleet) for log in lacking]):
                progress.item(outcome.item)
                if outcome.record is None:
                    faults.append(f"{outcome.item}: {outcome.fault or outcome.crash}")
            progress.finish(failed=len(faults))
    return faults


def _task(log: str, fleet: FleetFolder) -> Task:
    sources = {"log": Value(log), "fleet": Value(fleet, str(fleet))}
    return Task(REPORT, log, Params(), sources, (), fleet.logs, log, "")


def _draw(inputs: Inputs, _: Params) -> Outputs:
    run = open_run(str(inputs.fleet.campaign(inputs.log)), inputs.fleet.workspace)
    write_deferred_report(run, quiet=True)
    if not run.manifests["report"].records:
        raise PipelineError(
            "the results of this dive have changed since the fleet was run",
            value=inputs.log,
            remedy="auvid fleet run",
        )
    return Outputs()


REPORT = Stage("report", "draw page and recording", "log", Inputs, Params, Outputs, _draw)
