"""`auvid stages`, `models`, `vehicles` and `schema`: lists from declarations."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from auvid.data_schemas.documents import MODELS as DOCUMENT_MODELS
from auvid.data_schemas.documents import model_of
from auvid.data_schemas.errors import UsageError, nearest
from auvid.data_schemas.schemas import schema
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.hydro.dynamics.viscous.models import MODELS, ViscousModel
from auvid.pipeline.campaigns.workspace import PARAMS_FILE, Workspace
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.pipeline.execution.generate_dvc import bounds, default_of
from auvid.pipeline.graph import AnyStage
from auvid.pipeline.output import answer
from auvid.pipeline.terminal import table
from auvid.stages.base import ports
from auvid.stages.registry import STAGES

PORT_MEANINGS = {
    "raw_log": "the log's files, memory-mapped",
    "table": "every table of the campaign",
    "provenance": "hashes, parameters, versions",
}
"""Ports whose content has no schema of its own."""
WRITTEN = "documents."
"""Models of this room are those of documents that users write."""


def print_stages(name: str | None = None) -> None:
    """Print every stage, or one. Raises `UsageError` for an unknown name."""
    names = [stage.name for stage in STAGES]
    if name is not None and name not in names:
        raise UsageError("no such stage", value=name, allowed=names, remedy=nearest(name, names))
    chosen = [stage for stage in STAGES if name in (None, stage.name)]
    answer([_stage_document(stage) for stage in chosen])
    for stage in chosen:
        _print_stage(stage)


def _stage_document(stage: AnyStage) -> dict[str, Any]:
    return {
        "name": stage.name,
        "summary": stage.summary,
        "maps_over": stage.maps_over,
        "yields": stage.yields,
        **{
            title: [
                {
                    "name": port,
                    "schema": spec["port"],
                    "many": spec["many"],
                    "optional": bool(spec.get("optional")),
                    "meaning": _meaning(spec["port"]),
                }
                for port, spec in ports(kind).items()
            ]
            for title, kind in (("inputs", stage.inputs), ("outputs", stage.outputs))
        },
        "parameters": [
            {
                "name": item.name,
                "unit": item.metadata["unit"],
                "default": default_of(item),
                "low": item.metadata.get("low"),
                "high": item.metadata.get("high"),
                "allowed": item.metadata.get("allowed"),
                "meaning": item.metadata["meaning"],
            }
            for item in fields(stage.params)
        ],
    }


def _print_stage(stage: AnyStage) -> None:
    item = "the campaign" if stage.maps_over == "campaign" else f"each {stage.maps_over}"
    print(f"{stage.name}  {stage.summary}")
    print(f"  for {item}" + (f", giving {stage.yields}s" if stage.yields else ""))
    for title, kind in (("inputs", stage.inputs), ("outputs", stage.outputs)):
        rows = [(port + _mark(spec), _meaning(spec["port"])) for port, spec in ports(kind).items()]
        table(("name", "meaning"), rows, title=title, indent=2)
    parameters = [
        (
            item.name,
            item.metadata["unit"],
            str(default_of(item)),
            bounds(item.metadata),
            item.metadata["meaning"],
        )
        for item in fields(stage.params)
    ]
    table(
        ("name", "unit", "default", "allowed", "meaning"), parameters, title="parameters", indent=2
    )
    print()


def _mark(spec: Mapping[str, Any]) -> str:
    marks = [word for word in ("many", "optional") if spec.get(word) and not spec.get("every")]
    return f" ({', '.join(marks)})" if marks else ""


def _meaning(port: str) -> str:
    return PORT_MEANINGS[port] if port in PORT_MEANINGS else schema(port).meaning


def print_models(name: str | None = None) -> None:
    """Print every viscous model with its size and source, or the terms of one."""
    names = [model.name for model in MODELS]
    if name is not None and name not in names:
        raise UsageError("no such model", value=name, allowed=names, remedy=nearest(name, names))
    answer([_model_document(model) for model in MODELS if name in (None, model.name)])
    if name is None:
        rows = [(model.name, model.title, model.n_bar, model.source) for model in MODELS]
        table(("name", "title", "terms", "source"), rows)
        return
    model = MODELS[names.index(name)]
    print(f"{model.name}  {model.title}, {model.n_bar} terms. {model.source}")
    for axis, terms in model.terms.items():
        print(f"\n{axis}" + ("" if terms else "  -"))
        units: dict[str, list[str]] = {}
        for term in terms:
            units.setdefault(coefficient_unit(axis, term), []).append(term)
        for unit, in_unit in units.items():
            print(f"  in {unit}: {', '.join(in_unit)}")


def _model_document(model: ViscousModel) -> dict[str, Any]:
    return {
        "name": model.name,
        "title": model.title,
        "source": model.source,
        "terms": {
            axis: [{"term": term, "unit": coefficient_unit(axis, term)} for term in terms]
            for axis, terms in model.terms.items()
        },
    }


def print_vehicles() -> None:
    """Print the vehicles of the workspace here and those that come with auvid."""
    here = Path.cwd()
    root = next((path for path in (here, *here.parents) if (path / PARAMS_FILE).is_file()), here)
    rows = []
    for name, path in Workspace(root).vehicle_files().items():
        document = load_yaml(path).value
        title = document.get("title", "") if isinstance(document, Mapping) else ""
        rows.append((name, title, path))
    answer([{"name": name, "title": title, "file": path} for name, title, path in rows])
    table(("name", "title", "file"), rows)


def print_schema(name: str | None) -> None:
    """Print the JSON schema of a document, or the names of those that users write."""
    written = [name for name, place in DOCUMENT_MODELS.items() if place.startswith(WRITTEN)]
    if name is None:
        rows = [[name, (model_of(name).__doc__ or "").partition(".")[0]] for name in written]
        table(("document", "what it is"), rows)
        return
    if name not in DOCUMENT_MODELS:
        raise UsageError(
            "no such document", value=name, allowed=written, remedy=nearest(name, DOCUMENT_MODELS)
        )
    print(json.dumps(model_of(name).model_json_schema(), indent=2, ensure_ascii=False))
