"""Operands of `auvid diff`: runs, golden tables or history entries as run data."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from auvid.data_schemas.errors import PipelineError, UsageError, nearest
from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline.commands.history import run_history as history
from auvid.pipeline.commands.open_run import open_run, show_progress
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.commands.regress.golden_tables import Tables
from auvid.pipeline.execution import engines
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.execution.task_inputs import Artefact, artefacts_of
from auvid.pipeline.graph import Port
from auvid.pipeline.store.manifest import Manifest
from auvid.stages.base import make_params, ports
from auvid.stages.registry import STAGES
from auvid.stages.report.difference.signals import Side, Signals, place_of_view, signals_of_view

VARIANT = re.compile(r"([A-Za-z_]\w*)\.([A-Za-z_]\w*)=(.+)")
VARIANTS = ".variants"


@dataclass(frozen=True)
class RunData:
    """Results of a run, its error tables in golden layout, and its tolerances.

    `partial`: golden tables or a history entry, which hold tables and figures but no
    signals.
    """

    side: Side
    tables: Tables
    tolerances: Path | None = None
    partial: bool = False


def read_operand(word: str) -> RunData:
    """Read an operand: campaign, run folder or folder of golden tables.

    Behind it may stand `@MODEL`, `@RUN` of the history or `@STAGE.PARAMETER=VALUE`.
    Raises `PipelineError` for what is none of these, has not been run, or has no such
    model or parameter.
    """
    what, _, narrow = (word, "", "") if Path(word).expanduser().is_dir() else word.partition("@")
    path = Path(what).expanduser()
    if path.is_dir() and not (path / "campaign.yaml").is_file():
        tables = golden.read_tables(path) if list(path.glob("*.csv")) else {}
        data = (
            RunData(Side(what), tables, path, partial=True) if tables else _from_folder(what, path)
        )
    else:
        run = open_run(what)
        variant = VARIANT.fullmatch(narrow)
        if variant is not None:
            return _from_folder(word, _variant(run, *variant.groups()))
        if narrow.isdigit():
            entry = history.entry_of(run, int(narrow))
            return RunData(
                Side(word, results=history.results_of(entry)), entry.error_tables, partial=True
            )
        data = _from_folder(what, run.folder)
    if not narrow:
        return data
    models = list(data.side.cards) or list(
        dict.fromkeys(model for table in data.tables.values() for model in table)
    )
    if narrow not in models:
        remedy = (
            nearest(narrow, models)
            or "Behind @ stands a model, the number of a run in the history, or"
            " STAGE.PARAMETER=VALUE."
        )
        raise UsageError(
            "no such model",
            file=what,
            value=narrow,
            allowed=models or "none: no model is fitted here",
            remedy=remedy,
        )
    return replace(data, side=replace(data.side, name=word, model=narrow))


def common(one: RunData, two: RunData) -> tuple[RunData, RunData]:
    """Return both without what partial data cannot hold: signals, models, figures."""
    figures = bool(one.side.results) and bool(two.side.results)
    first, second = (
        replace(
            data,
            side=Side(
                data.side.name, data.side.model, results=data.side.results if figures else {}
            ),
        )
        for data in (one, two)
    )
    return first, second


def _from_folder(name: str, folder: Path) -> RunData:
    """Read the artefacts in the folder of a run, as its manifests name them."""
    recorded = _recorded(name, folder)

    def by_item(schema: str) -> dict[str, Any]:
        return {item: artefact.load() for item, artefact in recorded.get(schema, [])}

    table = next(iter(by_item("error_table").values()), None)
    segments = by_item("segment")
    side = Side(
        name,
        segments=segments,
        logs=by_item("log_info"),
        cards=by_item("model_card"),
        results={
            document["title"]: document
            for document in (artefact.load() for _, artefact in recorded.get("results", []))
        },
        fused=by_item("fused"),
        residual=by_item("residual"),
        predictions=by_item("predictions"),
        viewed={} if segments else _viewed(recorded),
    )
    if table is None and not (side.cards or side.results or side.fused):
        remedy = (
            f"auvid run {name}"
            if not Path(name).is_dir()
            else "It is no folder of a run, and holds no golden tables (training.csv)."
        )
        raise PipelineError("there is nothing to compare", file=folder, remedy=remedy)
    return RunData(side, golden.tables_of(table.to_pylist()) if table is not None else {})


def _recorded(name: str, folder: Path) -> dict[str, list[tuple[str, Artefact]]]:
    """Return the artefacts of a run by schema, each with its key or item.

    Raises `PipelineError` for a manifest that is not as it was written: what it does not
    vouch for is not compared.
    """
    by_port: dict[str, list[tuple[str, Artefact]]] = {}
    for stage in STAGES:
        manifest = Manifest(folder / stage.name)
        if manifest.damaged:
            raise PipelineError(
                "the manifest is damaged", file=manifest.path, remedy=f"auvid run {name}"
            )
        for port_name, spec in ports(stage.outputs).items():
            port = Port(stage, port_name, spec["port"], bool(spec["many"]))
            for item in manifest.records:
                for key, artefact in artefacts_of(manifest, port, item).items():
                    by_port.setdefault(port.schema, []).append(
                        (item if key is None else key, artefact)
                    )
    return {
        schema: sorted(items, key=lambda item: item[1].path) for schema, items in by_port.items()
    }


def _viewed(recorded: Mapping[str, list[tuple[str, Artefact]]]) -> dict[tuple[str, str], Signals]:
    """Return the signals that stages show, for runs without segments (bench, control).

    Raw streams are not results and stay out.
    """
    by_path = {artefact.path: artefact for items in recorded.values() for _, artefact in items}
    viewed: dict[tuple[str, str], Signals] = {}
    for _, views in recorded.get("views", []):
        folder = views.path.parent
        if "ingest" in (folder.name, folder.parent.name):
            continue
        tables: dict[str, Any] = {}
        for group in views.load()["groups"]:
            name = str(group["table"])
            artefact = by_path.get(folder / f"{name}.parquet")
            if name not in tables and artefact is not None:
                tables[name] = artefact.load()
            signals = signals_of_view(group, tables[name]) if name in tables else None
            if signals is not None:
                viewed[place_of_view(group)] = signals
    return viewed


def _variant(run: Run, stage_name: str, parameter: str, value: str) -> Path:
    """Run a campaign with one parameter changed and return the folder of that run.

    It stands beside the runs; what is up to date there does not run again.
    """
    try:
        stage = run.graph.stage(stage_name)
        options = {
            name: getattr(run.params[stage_name], name)
            for name in stage.params.__dataclass_fields__
        }
        params = make_params(stage.params, {**options, parameter: _scalar(value)}, stage=stage_name)
    except PipelineError as fault:
        raise UsageError.of(fault) from None
    folder = (
        run.folder.parent
        / VARIANTS
        / re.sub(r"[^\w.=-]", "_", f"{run.campaign.name}@{stage_name}.{parameter}={value}")
    )
    other = Run(run.campaign, run.graph, {**run.params, stage_name: params}, folder)
    chosen = [item for item in run.graph.stages if item.name != "report"]
    with show_progress() as progress:
        other.execute(chosen, engines.make_engine(None, None), progress)
    return folder


def _scalar(text: str) -> Any:
    """Return a value as params.yaml would hold it; text that is no YAML stays text."""
    try:
        return read_yaml(text)
    except yaml.YAMLError:
        return text
