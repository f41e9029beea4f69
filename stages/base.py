"""The stage interface: a name, typed inputs, parameters and outputs, a pure `run`.

What flows between stages is named by schema: the input port of a schema is fed by the
one stage that outputs it; artefacts by key, as cards by model, by all stages that do.
What a stage maps over is declared. Work items and what a port then delivers:

    log       one log of the campaign (ingest)
    leg       one leg of the manifest (rlse, resample)
    segment   one part of a leg, between gaps; made by resample (fuse, residual)
    campaign  the whole campaign, once (synthesise, validate, pipendulum, control,
              report)

A port delivers the artefact of the same item, or of the log or leg that the item
belongs to, or of the campaign. A campaign stage gets a `Collection` over all items
where the producer maps over something smaller. Documents `vehicle`, `campaign` and
`leg` come from the manifest; `raw_log` is the log itself. An optional port that no
stage of the graph feeds gets the document of its schema that the manifest names
(apparatus, published values, control cases, a model card), or None.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from functools import partial
from typing import Any, Generic, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.data_schemas.records.priors import PriorSourcesRecord
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle

Item = Literal["log", "leg", "segment", "campaign"]
Document = Mapping[str, Any]
FileWriter = Callable[[str], None]
"""What a stage gives in place of the bytes of a large file: saves it where it is told."""
I = TypeVar("I")
P = TypeVar("P")
O = TypeVar("O")
T = TypeVar("T")


@dataclass(frozen=True)
class Stage(Generic[I, P, O]):
    """One stage of the chain.

    `run` is pure: no file, clock, network or global state; seeds are parameters.
    """

    name: str
    summary: str
    maps_over: Item
    inputs: type[I]
    params: type[P]
    outputs: type[O]
    run: Callable[[I, P], O]
    yields: Item | None = None
    """What one work item gives. `segment` for a leg stage whose outputs are keyed by
    segment; else the item itself.
    """
    check: Callable[[P, Vehicle, PriorSourcesRecord | None], object] | None = None
    """Raises `CampaignError` for parameters that cannot be with this vehicle and these
    priors of the campaign: a campaign is refused by it before any stage runs.
    """
    no_views: str = ""
    """Why the stage shows nothing of its own in the recording, where it has no port
    `views`.
    """


@dataclass(frozen=True)
class RawFile:
    """One file of a log: name, content, and its column map if it has one.

    The content is bytes, read-only, or a function that reads them, as the runner's: they
    take as much memory as the file, and go once it is decoded.
    """

    name: str
    content: npt.NDArray[np.uint8] | Callable[[], npt.NDArray[np.uint8]]
    columns: Mapping[str, object] | None = None

    @property
    def buffer(self) -> npt.NDArray[np.uint8]:
        """The bytes; of a file that is not `loaded` they are read again each time."""
        return self.content() if callable(self.content) else self.content

    def loaded(self) -> RawFile:
        """Return the file with its bytes in memory."""
        return replace(self, content=self.buffer)


@dataclass(frozen=True)
class RawLog:
    """A log as the campaign names it: its id, its files, and a forced reader.

    `reader` is set if the manifest forces one.
    """

    id: str
    files: tuple[RawFile, ...]
    reader: str | None = None


class Collection(Mapping[str, T]):
    """Artefacts of many items in manifest order, loaded one at a time when needed.

    `part_of(key, columns)` loads some columns of a table without the others.
    """

    def __init__(
        self,
        loaders: Mapping[str, Callable[[], T]],
        part_of: Callable[[str, Sequence[str]], T] | None = None,
    ) -> None:
        self._loaders, self._part_of = dict(loaders), part_of

    def __getitem__(self, key: str) -> T:
        return self._loaders[key]()

    def part(self, key: str, columns: Sequence[str]) -> T:
        """Return a table with at least those of `columns` that it has."""
        return self[key] if self._part_of is None else self._part_of(key, columns)

    def __iter__(self) -> Iterator[str]:
        return iter(self._loaders)

    def __contains__(self, key: object) -> bool:
        return key in self._loaders  # without loading it

    def __len__(self) -> int:
        return len(self._loaders)


def collection(items: Mapping[str, T]) -> Collection[T]:
    """Return a collection of artefacts that are in memory already.

    For tests and for callers without a store.
    """
    return Collection({key: partial(items.__getitem__, key) for key in items})


def part_of(tables: Mapping[str, T], key: str, columns: Sequence[str]) -> T:
    """Return a table of a mapping, of a collection with those of `columns` alone."""
    return tables.part(key, columns) if isinstance(tables, Collection) else tables[key]


def port(
    schema: str,
    *,
    many: bool = False,
    optional: bool = False,
    by_rows: bool = False,
    columns: tuple[str, ...] = (),
    keys: tuple[str, ...] = (),
) -> Any:
    """An input or output artefact of this schema.

    `many` output: a mapping key -> artefact (model cards by model). `optional`: None
    when the producer gave none. `by_rows`: the runner gives `Rows`, and the stage loads
    those that it needs. `columns`: of a table only those, with its clock. `keys`: of the
    manifest only those, so that a change of another one does not rerun the stage.
    """
    default = None if optional else MISSING
    metadata = {
        "port": schema,
        "many": many,
        "optional": optional,
        "by_rows": by_rows,
        "columns": columns,
        "keys": keys,
    }
    return field(default=default, metadata=metadata)


def every(schema: str) -> Any:
    """Declare a port that collects a schema's artefacts from all stages.

    Keys are `stage/item`.

    `every('table')` collects all tables, keyed `stage/item/port`.
    """
    return field(metadata={"port": schema, "every": True, "many": True, "optional": False})


def from_runs(schema: str) -> Any:
    """Declare an input port that collects a schema from several runs.

    Keyed `RUN/ITEM`, or `RUN` where a run gives one artefact or document of it.
    """
    return field(metadata={"port": schema, "runs": True, "many": True, "optional": False})


def param(
    unit: str,
    default: Any,
    *,
    meaning: str,
    low: float | None = None,
    high: float | None = None,
    allowed: tuple[Any, ...] | None = None,
    names: tuple[str, ...] | None = None,
    replaces: tuple[str, ...] = (),
    instead: str = "",
) -> Any:
    """Declare a stage parameter: unit, default, bounds or choices, one-line meaning.

    `names`: the keys that a mapping may have, or the items that a list may. `replaces`:
    parameters that are no more, and `instead` what says the same (`installation:
    estimate`).
    """
    metadata = {"unit": unit, "low": low, "high": high, "allowed": allowed, "meaning": meaning}
    metadata |= {"names": names, "replaces": replaces, "instead": instead}
    if isinstance(default, dict | list):
        return field(default_factory=lambda: default.copy(), metadata=metadata)
    return field(default=default, metadata=metadata)


def ports(kind: type[Any]) -> dict[str, Mapping[str, Any]]:
    """Return the ports of an Inputs or Outputs class.

    Field name -> {port, many, optional, every}.
    """
    return {item.name: item.metadata for item in fields(kind) if "port" in item.metadata}


def make_params(kind: type[P], values: Mapping[str, Any], *, stage: str, file: object = None) -> P:
    """Return the parameters of a stage from the user's values.

    Unknown keys, wrong types and values out of bounds are errors.
    """
    declared = {item.name: item for item in fields(kind)}  # type: ignore[arg-type]
    types = get_type_hints(kind)
    faults: list[PipelineError] = []
    checked: dict[str, Any] = {}
    for key, value in values.items():
        path = f"stages.{stage}.{key}"
        if key not in declared:
            remedy = (
                _replaced(key, declared.values())
                or nearest(key, declared)
                or f"Known parameters: {', '.join(declared)}. If the file is of another version of"
                " auvid, remove the row."
            )
            faults.append(CampaignError("unknown parameter", file=file, field=path, remedy=remedy))
            continue
        try:
            checked[key] = _check_param(declared[key], value, path, file)
            faults += _nested_faults(types[key], value, path, file, declared[key].metadata["names"])
        except PipelineError as fault:
            faults.append(fault)
    raise_faults(faults, file=file)
    return kind(**checked)


def _replaced(key: str, declared: Iterable[Field[Any]]) -> str | None:
    """Return what says the same as a parameter that is no more."""
    return next(
        (
            f"It is no more; write '{item.metadata['instead']}'."
            for item in declared
            if key in item.metadata["replaces"]
        ),
        None,
    )


KINDS_IN_WORDS = {
    "float": "a number",
    "int": "an integer",
    "str": "text",
    "bool": "true or false",
    "tuple": "a list",
    "Mapping": "a mapping",
    "None": "null",
}
TYPES = {float: "a number", int: "an integer", str: "text", list: "a list", Mapping: "a mapping"}


def _nested_faults(
    kind: Any, value: Any, at: str, file: object, names: tuple[str, ...] | None = None
) -> Iterator[PipelineError]:
    """Yield what in a mapping or list does not fit its type or is none of `names`."""
    outer, inner = get_origin(kind), get_args(kind)
    entries: list[tuple[str, Any, Any]] = []
    if outer is Mapping and isinstance(value, Mapping):
        entries = [(f"{at}.{key}", key, item) for key, item in value.items()]
    elif outer in (tuple, list) and isinstance(value, list | tuple):
        entries = [(f"{at}[{index}]", item, item) for index, item in enumerate(value)]
    for where, word, item in entries:
        item_kind = inner[1 if outer is Mapping else 0]
        plain = get_origin(item_kind) or item_kind
        fits = _finite(item) if plain is float else isinstance(item, plain)
        if not fits:
            allowed = TYPES[plain]
            yield CampaignError("wrong type", file=file, field=where, value=item, allowed=allowed)
        elif not isinstance(word, str) and outer is Mapping:
            yield CampaignError("a key that is no text", file=file, field=at, value=word)
        elif names is not None and word not in names:
            close = nearest(word, names)
            yield CampaignError(
                "unknown name", file=file, field=where, value=word, allowed=names, remedy=close
            )
        yield from _nested_faults(item_kind, item, where, file)


def _finite(value: object) -> bool:
    """Return whether a value is a number that a float holds."""
    if isinstance(value, int) and not isinstance(value, bool):
        return value.bit_length() < 1024
    return isinstance(value, float) and math.isfinite(value)


def _in_words(annotation: str) -> str:
    """Return what a parameter takes, as a user calls it."""
    kinds = [part.partition("[")[0].strip() for part in annotation.split(" | ")]
    return " or ".join(KINDS_IN_WORDS.get(kind, kind) for kind in kinds)


def _check_param(item: Field[Any], value: Any, path: str, file: object) -> Any:
    meta = item.metadata
    annotation = str(item.type)
    if value is None:
        if "None" in annotation:
            return None
        raise CampaignError("needs a value", file=file, field=path, allowed=_in_words(annotation))
    if "bool" in annotation or isinstance(value, bool):
        fits = "bool" in annotation and isinstance(value, bool)
    elif isinstance(value, int | float):
        if isinstance(value, int) and not _finite(value):
            raise CampaignError("out of range", file=file, field=path, value=value)
        fits = "float" in annotation or ("int" in annotation and isinstance(value, int))
        value = float(value) if fits and "float" in annotation else value
    elif isinstance(value, str):
        fits = "str" in annotation
    else:
        fits = ("Mapping" in annotation and isinstance(value, Mapping)) or (
            "tuple" in annotation and isinstance(value, list | tuple)
        )
        value = tuple(value) if fits and isinstance(value, list) else value
    if not fits:
        text_for_number = isinstance(value, str) and annotation.startswith(("float", "int"))
        remedy = f"Write the number alone, its unit is {meta['unit']}." if text_for_number else None
        raise CampaignError(
            "wrong type",
            file=file,
            field=path,
            value=value,
            allowed=_in_words(annotation),
            remedy=remedy,
        )
    if meta.get("allowed") is not None and value not in meta["allowed"]:
        remedy = nearest(value, map(str, meta["allowed"]))
        raise CampaignError(
            "unknown value",
            file=file,
            field=path,
            value=value,
            allowed=meta["allowed"],
            remedy=remedy,
        )
    low, high = meta.get("low"), meta.get("high")
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if number and (
        value != value or (low is not None and value < low) or (high is not None and value > high)
    ):
        raise CampaignError(
            "out of range",
            file=file,
            field=path,
            value=value,
            allowed=f"{low} to {high} {meta['unit']}",
        )
    return value
