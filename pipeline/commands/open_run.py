"""What the commands share: a campaign opened as a run, the progress for this terminal,
and the closing summary.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from auvid.pipeline.campaigns.campaign import load_campaign
from auvid.pipeline.campaigns.workspace import (
    Workspace,
    find_workspace,
    load_defaults,
    stage_params,
    workspace_of,
)
from auvid.pipeline.commands.run_summary import (
    bounds,
    comparison_rows,
    error_rows,
    losses,
    places,
    shortened,
    truth_rows,
    warnings,
)
from auvid.pipeline.execution.progress import Bars, Lines, Progress
from auvid.pipeline.execution.runner import Run, write_code_files
from auvid.pipeline.graph import AnyStage, Graph, select, stages_of_kind
from auvid.pipeline.terminal import plain
from auvid.stages import KINDS, STAGES

__all__ = [
    "losses",
    "missed",
    "open_run",
    "places",
    "print_summary",
    "progress",
    "select",
    "write_codes",
]


def open_run(name: str) -> Run:
    """The run of a campaign given by name or path. Raises `PipelineError` for anything
    wrong with workspace, manifest or parameters.
    """
    workspace = workspace_of(name)
    folder = workspace.campaign_folder(name)
    campaign = load_campaign(folder, kinds=KINDS, vehicles=workspace.vehicle_files())
    graph = Graph(stages_of_kind(STAGES, KINDS, campaign.document["kind"]))
    defaults = load_defaults(workspace, STAGES)
    params = {stage.name: stage_params(stage, defaults, campaign) for stage in graph.stages}
    write_code_files(STAGES, workspace.code)
    return Run(campaign, graph, params, workspace.runs / campaign.name)


def write_codes() -> None:
    """Write the small files of the current workspace on which DVC depends in place of
    the code.
    """
    write_code_files(STAGES, find_workspace(Path.cwd()).code)


@contextmanager
def progress() -> Iterator[Progress]:
    """Bars on a terminal, plain lines otherwise."""
    if sys.stderr.isatty():
        with Bars() as bars:
            yield bars
    else:
        yield Lines()


def print_summary(run: Run) -> None:
    """Print warnings, losses, the errors in short, and where the results are."""
    for title, lines in (("lost", losses(run)), ("warnings", warnings(run))):
        if lines:
            print(f"\n{title} ({len(lines)}):")
            print("\n".join(f"  {plain(line)}" for line in shortened(lines)))
    rows = error_rows(run)
    if rows:
        print(
            f"\n{'model':<16}{'rank':>6}{'training':>12}{'validation':>12}   (J/J0; 1 explains"
            " nothing)"
        )
        for model, rank, training, validation in rows:
            print(f"{model:<16}{rank:>6}{_ratio(training):>12}{_ratio(validation):>12}")
    _print_truth(run)
    asked = [row["met"] for row in comparison_rows(run) if row["met"] is not None]
    if asked:
        print(
            f"\nprinted values: {sum(asked)} of {len(asked)} bounds met (auvid reproduce"
            f" {run.campaign.name} prints them)"
        )
    found = places(run)
    if found:
        print()
    for words, path in found.items():
        print(f"{words + ':':<16}{shown(path)}")


def _print_truth(run: Run) -> None:
    rows, held = truth_rows(run), bounds(run)
    if rows:
        print("\nestimate against truth (RMS error over all legs)")
    for quantity, unit, parts in rows:
        print(f"  {quantity:<19}{'  '.join(f'{axis} {value:.2g}' for axis, value in parts)} {unit}")
    if held:
        print(f"\nbounds: {sum(row['met'] for row in held)} of {len(held)} met")
    for row in held:
        print(
            f"  {row['figure']:<42}{row['value']:>10.3g}  at most"
            f" {row['bound']:<8.3g}{'' if row['met'] else 'MISSED'}".rstrip()
        )


def missed(run: Run, stages: Sequence[AnyStage]) -> bool:
    """Whether a bound that the campaign sets is missed, if the stage that holds it is
    among those that were run.
    """
    holders = {port.stage.name for port in run.graph.producers("trust_checks")}
    return bool(holders & {stage.name for stage in stages}) and not all(
        row["met"] for row in bounds(run)
    )


def shown(path: Path) -> str:
    """A path from here if it lies below, else in full."""
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def workspace_here() -> Workspace | None:
    """The workspace around the current folder, if there is one."""
    return next(
        (
            Workspace(folder)
            for folder in (Path.cwd(), *Path.cwd().parents)
            if (folder / "params.yaml").is_file()
        ),
        None,
    )
