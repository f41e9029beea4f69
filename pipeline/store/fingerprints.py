"""Hashes of what a result depends on: files, values, schemas and code."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from auvid.data_schemas.documents import MODELS, model_of
from auvid.data_schemas.schemas import schema_text
from auvid.pipeline.store.file_hashes import hash_bytes, hash_file, hash_value
from auvid.pipeline.store.import_closure import import_closure
from auvid.stages.base import Stage, ports

READERS = {"vehicle": "auvid.hydro.dynamics.vehicle.from_document"}
"""What makes the value that a port delivers, where that is not the document's model."""


def stage_code(stage: Stage[Any, Any, Any], hash_source: Callable[[Path], str] = hash_file) -> str:
    """Return the hash of what a result depends on besides inputs and parameters.

    That is: the stage's module, the modules of auvid that it imports directly or
    through others (found in the source, not by running it), the data files that these
    name or that lie in the stage's own folder, and the schemas of the stage's ports.
    hash_source: one that remembers serves many stages, which share most files.
    """
    closure = import_closure(stage.run.__module__)
    sources = {name: hash_source(path) for name, path in closure.items()}
    return hash_value({"sources": sources, "schemas": stage_schemas(stage)})


def stage_schemas(stage: Stage[Any, Any, Any]) -> dict[str, str]:
    """Return the hash of the schema of every port of a stage."""
    named = {
        spec["port"] for kind in (stage.inputs, stage.outputs) for spec in ports(kind).values()
    }
    return {name: _schema_hash(name) for name in sorted(named - {"table", "raw_log"})}


@cache
def _schema_hash(name: str) -> str:
    """Hash of a schema's text, or of the code that reads a document."""
    if name not in MODELS:
        return hash_bytes(schema_text(name).encode())
    module = READERS.get(name) or model_of(name).__module__
    return hash_value({part: hash_file(path) for part, path in import_closure(module).items()})


def fingerprint_line(
    stage: Stage[Any, Any, Any], hash_source: Callable[[Path], str] = hash_file
) -> str:
    """Return the content of the file on which DVC depends in place of the code."""
    return f"{stage.name} {stage_code(stage, hash_source)}\n"


def as_document(params: object) -> Mapping[str, Any]:
    """Return parameters as a mapping of plain values, tuples as lists."""
    document: dict[str, Any] = json.loads(json.dumps(asdict(params), default=str))  # type: ignore[call-overload]
    return document
