"""Print what there is, from the declarations: stages with ports and parameters, viscous
models, vehicles.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from auvid.data_schemas.errors import PipelineError, nearest
from auvid.data_schemas.schemas import schema
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.hydro.dynamics.viscous.models import MODELS, model_named
from auvid.pipeline.campaigns.workspace import Workspace
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.pipeline.commands.open_run import workspace_here
from auvid.pipeline.execution.generate_dvc import bounds, default_of
from auvid.pipeline.graph import AnyStage
from auvid.stages import STAGES
from auvid.stages.base import ports

NOT_SCHEMAS = {
    "raw_log": "the log's files, memory-mapped",
    "table": "every table of the campaign",
    "provenance": "hashes, parameters, versions",
}


def print_stages(name: str | None = None) -> None:
    """Every stage, or one of them. Raises `PipelineError` for an unknown name."""
    known = [stage.name for stage in STAGES]
    if name is not None and name not in known:
        raise PipelineError("no such stage", value=name, allowed=known, remedy=nearest(name, known))
    console = Console(highlight=False)
    for stage in STAGES:
        if name in (None, stage.name):
            _print_stage(stage, console)


def _print_stage(stage: AnyStage, console: Console) -> None:
    each = f"each {stage.maps_over}" if stage.maps_over != "campaign" else "the campaign"
    console.print(f"[bold]{stage.name}[/bold]  {escape(stage.summary)}")
    console.print(f"  for {each}" + (f", giving {stage.yields}s" if stage.yields else ""))
    for title, kind in (("inputs", stage.inputs), ("outputs", stage.outputs)):
        table = Table(
            "name", "meaning", title=title, title_justify="left", box=None, padding=(0, 2)
        )
        for port, spec in ports(kind).items():
            table.add_row(port + _mark(spec), escape(_meaning(spec["port"])))
        console.print(table)
    parameters = fields(stage.params)
    if parameters:
        table = Table(
            "name",
            "unit",
            "default",
            "allowed",
            "meaning",
            title="parameters",
            title_justify="left",
            box=None,
            padding=(0, 2),
        )
        for item in parameters:
            meta = item.metadata
            table.add_row(
                item.name,
                meta["unit"],
                escape(str(default_of(item))),
                escape(bounds(meta)),
                escape(meta["meaning"]),
            )
        console.print(table)
    console.print()


def _mark(spec: Mapping[str, Any]) -> str:
    marks = [word for word in ("many", "optional") if spec.get(word) and not spec.get("every")]
    return f" ({', '.join(marks)})" if marks else ""


def _meaning(port: str) -> str:
    return NOT_SCHEMAS[port] if port in NOT_SCHEMAS else schema(port).meaning


def print_models(name: str | None = None) -> None:
    """Every viscous model with its size and source, or the terms of one."""
    console = Console(highlight=False)
    if name is None:
        table = Table("name", "title", "terms", "source", box=None, padding=(0, 2))
        for model in MODELS:
            table.add_row(model.name, escape(model.title), str(model.n_bar), escape(model.source))
        console.print(table)
        return
    model = model_named(name)
    console.print(
        f"[bold]{model.name}[/bold]  {escape(model.title)}, {model.n_bar} terms."
        f" {escape(model.source)}"
    )
    for axis, terms in model.terms.items():
        console.print(f"\n[bold]{axis}[/bold]" + ("" if terms else "  -"))
        of_unit: dict[str, list[str]] = {}
        for term in terms:
            of_unit.setdefault(coefficient_unit(axis, term), []).append(term)
        for unit, found in of_unit.items():
            console.print(f"  in {unit}: {escape(', '.join(found))}")


def print_vehicles() -> None:
    """The vehicles of the workspace around the current folder and those that come with
    auvid.
    """
    workspace = workspace_here() or Workspace(Path.cwd())
    table = Table("name", "title", "file", box=None, padding=(0, 2))
    for name, path in workspace.vehicle_files().items():
        document = load_yaml(path).value
        title = document.get("title", "") if isinstance(document, Mapping) else ""
        table.add_row(name, escape(str(title)), str(path))
    Console(highlight=False, soft_wrap=True).print(table)
