"""Loader of the schema files of this folder.

There is one YAML file per artefact (table, document or bytes).

A key of `fields` may hold a brace list: `gyro_{x,y,z}_rad_s` stands for three fields,
and `{}` in its texts for the item.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, Literal

from auvid.data_schemas.documents import MODELS, model_of
from auvid.data_schemas.errors import SchemaError, nearest
from auvid.data_schemas.yaml_text import read_yaml

Kind = Literal["table", "document", "bytes"]
BRACES = re.compile(r"\{([^{}]+)\}")


@dataclass(frozen=True)
class Field:
    """One column of a table."""

    name: str
    dtype: str
    unit: str
    frame: str
    meaning: str
    range: tuple[float, float] | None = None
    optional: bool = False
    nullable: bool = False


@dataclass(frozen=True)
class Schema:
    """What an artefact is: its `columns` for tables, the `suffix` of its file."""

    name: str
    kind: Kind
    meaning: str
    columns: Mapping[str, Field] = field(default_factory=dict)
    suffix: str = ""
    clock: str | None = None


def expand_braces(name: str) -> list[tuple[str, tuple[str, ...]]]:
    """All names that a key with brace lists stands for, each with the chosen items."""
    parts = BRACES.split(name)
    choices = [part.split(",") if index % 2 else [part] for index, part in enumerate(parts)]
    return [("".join(pick), tuple(pick[1::2])) for pick in itertools.product(*choices)]


def schema_names() -> tuple[str, ...]:
    """Return the names of all schemas, sorted."""
    return tuple(sorted({*_schema_files(), *MODELS}))


@cache
def _schema_files() -> dict[str, Traversable]:
    """Return name of a schema -> its file, from the rooms of `artefacts`."""
    return {
        entry.name.removesuffix(".yaml"): entry
        for room in (resources.files(__package__) / "artefacts").iterdir()
        for entry in room.iterdir()
        if entry.name.endswith(".yaml")
    }


def schema_text(name: str) -> str:
    """Return the YAML text of a schema."""
    return _schema_files()[name].read_text(encoding="utf-8")


@cache
def schema(name: str) -> Schema:
    """Return the schema of this name. Raises `SchemaError` for an unknown name."""
    if name not in schema_names():
        raise SchemaError(
            "unknown schema",
            value=name,
            allowed=schema_names(),
            remedy=nearest(name, schema_names()),
        )
    if name in MODELS:
        meaning = " ".join((model_of(name).__doc__ or "").split())
        return Schema(name, "document", meaning, suffix=".json")
    raw = read_yaml(schema_text(name))
    columns = _columns(raw["fields"]) if raw["kind"] == "table" else {}
    return Schema(
        name=name,
        kind=raw["kind"],
        meaning=raw["meaning"],
        columns=columns,
        suffix=raw.get("suffix", {"table": ".parquet", "document": ".json"}.get(raw["kind"], "")),
        clock=raw.get("clock"),
    )


def _columns(raw: Mapping[str, Mapping[str, Any]]) -> dict[str, Field]:
    columns = {}
    for key, spec in raw.items():
        for name, picked in expand_braces(key):
            low_high = spec.get("range")
            columns[name] = Field(
                name=name,
                dtype=spec["dtype"],
                unit=str(spec.get("unit", "1")),
                frame=str(spec.get("frame", "-")),
                meaning=str(spec["meaning"]).replace("{}", " ".join(picked)),
                range=(float(low_high[0]), float(low_high[1])) if low_high else None,
                optional=bool(spec.get("optional", False)),
                nullable=bool(spec.get("nullable", False)),
            )
    return columns
