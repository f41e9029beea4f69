"""Documents (vehicle, campaign, model card ...) checked against their schema.

A field is {type, required, meaning} with type one of string, number, integer, boolean,
list (`items`: a field), mapping (`fields`, or `values`: a field for free keys),
quantity ({value, unit, source, assumed} with the unit convertible to the schema's),
any.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auvid.data_schemas.errors import PipelineError, SchemaError, nearest, raise_faults
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.units import convertible

QUANTITY_KEYS = ("value", "unit", "source", "assumed", "note")
TYPES: dict[str, tuple[type, ...]] = {
    "string": (str,),
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "list": (list, tuple),
    "mapping": (dict,),
    "quantity": (dict,),
}


def check_against_yaml(document: object, name: str, *, file: object = None) -> None:
    """Check a document against schema `name`; raise `SchemaError` (all faults together)
    on disagreement.
    """
    where = file if file is not None else f"document '{name}'"
    faults: list[PipelineError] = []
    spec = schema(name)
    _check_mapping(document, spec.fields, "", where, faults, extra=spec.extra)
    raise_faults(faults, file=where)


def _check_mapping(
    value: object,
    fields: Mapping[str, Any],
    path: str,
    where: object,
    faults: list[PipelineError],
    *,
    extra: bool = False,
) -> None:
    if not isinstance(value, Mapping):
        faults.append(
            SchemaError(
                "not a mapping of keys to values", file=where, field=path or None, value=value
            )
        )
        return
    for key in value:
        if key not in fields and not extra:
            remedy = nearest(key, fields) or f"Known keys: {', '.join(fields)}."
            faults.append(
                SchemaError("unknown key", file=where, field=_join(path, key), remedy=remedy)
            )
    for key, spec in fields.items():
        if key in value:
            _check_field(value[key], spec, _join(path, key), where, faults)
        elif spec.get("required"):
            faults.append(
                SchemaError(
                    "missing key",
                    file=where,
                    field=_join(path, key),
                    remedy=str(spec.get("meaning", "")).strip() or None,
                )
            )


def _check_field(
    value: object, spec: Mapping[str, Any], path: str, where: object, faults: list[PipelineError]
) -> None:
    kind = spec.get("type", "any")
    if kind == "any" or (value is None and spec.get("nullable")):
        return
    wrong = not isinstance(value, TYPES[kind]) or (
        isinstance(value, bool) and kind in ("number", "integer")
    )
    if wrong:
        faults.append(SchemaError("wrong type", file=where, field=path, value=value, allowed=kind))
        return
    allowed = spec.get("allowed")
    if allowed is not None and value not in allowed:
        faults.append(
            SchemaError(
                "unknown value",
                file=where,
                field=path,
                value=value,
                allowed=allowed,
                remedy=nearest(value, map(str, allowed)),
            )
        )
    _check_bounds(value, spec, path, where, faults)
    if kind == "list" and "items" in spec:
        assert isinstance(value, list | tuple)
        for index, item in enumerate(value):
            _check_field(item, spec["items"], f"{path}[{index}]", where, faults)
    elif kind == "mapping" and "values" in spec:
        assert isinstance(value, Mapping)
        for key, item in value.items():
            _check_field(item, spec["values"], _join(path, key), where, faults)
    elif kind == "mapping" and "fields" in spec:
        _check_mapping(value, spec["fields"], path, where, faults)
    elif kind == "quantity":
        _check_quantity(value, spec, path, where, faults)


def _check_bounds(
    value: object, spec: Mapping[str, Any], path: str, where: object, faults: list[PipelineError]
) -> None:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return
    low, high = spec.get("low"), spec.get("high")
    if not (low is None or value >= low) or not (high is None or value <= high):
        allowed = (
            f"at least {low}"
            if high is None
            else f"at most {high}"
            if low is None
            else f"{low} to {high}"
        )
        faults.append(
            SchemaError("out of range", file=where, field=path, value=value, allowed=allowed)
        )


def _check_quantity(
    value: object, spec: Mapping[str, Any], path: str, where: object, faults: list[PipelineError]
) -> None:
    assert isinstance(value, Mapping)
    for key in value:
        if key not in QUANTITY_KEYS:
            faults.append(
                SchemaError(
                    "unknown key",
                    file=where,
                    field=_join(path, key),
                    allowed=QUANTITY_KEYS,
                    remedy=nearest(key, QUANTITY_KEYS),
                )
            )
    for key in ("value", "unit", "source"):
        if key not in value:
            faults.append(
                SchemaError(
                    "missing key",
                    file=where,
                    field=_join(path, key),
                    remedy="Every number needs value, unit and source.",
                )
            )
    unit = value.get("unit")
    if unit is not None and "unit" in spec and not convertible(str(unit), str(spec["unit"])):
        faults.append(
            SchemaError(
                "wrong unit",
                file=where,
                field=_join(path, "unit"),
                value=unit,
                allowed=f"a unit of {spec['unit']}",
            )
        )


def _join(path: str, key: object) -> str:
    return f"{path}.{key}" if path else str(key)
