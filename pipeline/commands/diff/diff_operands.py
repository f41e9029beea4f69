"""Operands of `auvid diff`: runs, golden tables or history entries as run data."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from auvid.data_schemas.errors import DataError, PipelineError, nearest
from auvid.pipeline.commands.history import run_history as history
from auvid.pipeline.commands.open_run import open_run, show_progress
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.commands.regress.golden_tables import Tables
from auvid.pipeline.execution import engines
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.store import artefacts
from auvid.stages import STAGES
from auvid.stages.base import make_params, ports
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
        raise DataError(
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
    """Read the artefacts in the folder of a run."""
    table = next(iter(_artefacts(folder, "*/error_table.parquet", "error_table").values()), None)
    segments = _artefacts(folder, "*/*/segment.json", "segment")
    side = Side(
        name,
        segments=segments,
        logs=_artefacts(folder, "ingest/*/log_info.json", "log_info"),
        cards=_artefacts(folder, "*/model_card/*.json", "model_card"),
        results={document["title"]: document for document in _documents(folder, "results")},
        fused=_artefacts(folder, "fuse/*/fused.parquet", "fused"),
        residual=_artefacts(folder, "residual/*/residual.parquet", "residual"),
        predictions=_artefacts(folder, "*/predictions/*.parquet", "predictions"),
        viewed={} if segments else _viewed(folder),
    )
    if table is None and not (side.cards or side.results or side.fused):
        remedy = (
            f"auvid run {name}"
            if not Path(name).is_dir()
            else "It is no folder of a run, and holds no golden tables (training.csv)."
        )
        raise PipelineError("there is nothing to compare", file=folder, remedy=remedy)
    return RunData(side, golden.tables_of(table.to_pylist()) if table is not None else {})


def _documents(folder: Path, schema: str) -> Iterator[Any]:
    """Yield all documents of a schema in the folder of a run."""
    for stage in STAGES:
        for name, spec in ports(stage.outputs).items():
            if spec["port"] == schema:
                for path in sorted(folder.glob(f"{stage.name}/**/{name}.json")):
                    yield artefacts.load(path, schema)


def _viewed(folder: Path) -> dict[tuple[str, str], Signals]:
    """Return the signals that stages show, for runs without segments (bench, control).

    Raw streams are not results and stay out.
    """
    viewed: dict[tuple[str, str], Signals] = {}
    for stage in (item for item in STAGES if item.name != "ingest"):
        schemas = {name: spec["port"] for name, spec in ports(stage.outputs).items()}
        for path in sorted(
            [*folder.glob(f"{stage.name}/views.json"), *folder.glob(f"{stage.name}/*/views.json")]
        ):
            tables: dict[str, Any] = {}
            for group in artefacts.load(path, "views")["groups"]:
                name = str(group["table"])
                file = path.parent / f"{name}.parquet"
                if name not in tables and file.is_file():
                    tables[name] = artefacts.load(file, schemas[name.partition("/")[0]])
                signals = signals_of_view(group, tables[name]) if name in tables else None
                if signals is not None:
                    viewed[place_of_view(group)] = signals
    return viewed


def _artefacts(folder: Path, pattern: str, schema: str) -> dict[str, Any]:
    """Return artefacts by item: the name of their folder, or of the file."""
    own = pattern.endswith(("*.json", "*.parquet"))
    return {
        path.stem if own else path.parent.name: artefacts.load(path, schema)
        for path in sorted(folder.glob(pattern))
    }


def _variant(run: Run, stage_name: str, parameter: str, value: str) -> Path:
    """Run a campaign with one parameter changed and return the folder of that run.

    It stands beside the runs; what is up to date there does not run again.
    """
    stage = run.graph.stage(stage_name)
    given = {
        name: getattr(run.params[stage_name], name) for name in stage.params.__dataclass_fields__
    }
    params = make_params(
        stage.params, {**given, parameter: _scalar(value)}, stage=stage_name, file="command line"
    )
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
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return text
