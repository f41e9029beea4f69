"""What all documents share: a strict model, quantities with units, faults with rows.

pydantic finds the faults of a document; `parse` reports them as ours: file, row and
field, what was found, what is allowed, and the remedy.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import re
import textwrap
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np
import numpy.typing as npt
from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PrivateAttr,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, ErrorDetails
from pydantic_core.core_schema import no_info_after_validator_function

from auvid.data_schemas.errors import (
    CampaignError,
    PipelineError,
    SchemaError,
    nearest,
    raise_faults,
)
from auvid.data_schemas.units import convertible, factor_and_offset

NEARLY_A_NUMBER = re.compile(r"[+-]?\d+(\.\d*)?[eE][+-]?\d+")
OPEN = "fill in"
"""Begins the words in place of a number that no log tells."""
QUANTITY_REMEDY = "Every number needs value, unit and source."
TYPE_NAMES = {
    "string_type": "string",
    "float_type": "number",
    "int_type": "integer",
    "int_from_float": "integer",
    "bool_type": "boolean",
    "list_type": "list",
    "dict_type": "mapping",
}
"""Type of a pydantic error -> what the field takes, as a user calls it."""
Path = tuple[str | int, ...]


class Model(BaseModel):
    """A document, or a mapping in one; unknown keys are faults, nothing is coerced."""

    model_config = ConfigDict(
        defer_build=True,
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
    )

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        result = handler(schema)
        properties = handler.resolve_ref_schema(result).get("properties", {})
        for name, words in meanings(cls).items():
            key = cls.model_fields[name].alias or name
            if key in properties:
                properties[key].setdefault("description", words)
        return result


M = TypeVar("M", bound=Model)


@cache
def meanings(kind: type[Model]) -> Mapping[str, str]:
    """Return what each field of a model is, as the text below it says.

    Read from the source when somebody asks: pydantic's own `use_attribute_docstrings`
    reads that of every model at every start.
    """
    words: dict[str, str] = {}
    for owner in reversed(kind.__mro__):
        if not issubclass(owner, Model) or owner is Model:
            continue
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
        assert isinstance(body, ast.ClassDef)
        for item, below in itertools.pairwise(body.body):
            if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
                text = below.value if isinstance(below, ast.Expr) else None
                if isinstance(text, ast.Constant) and isinstance(text.value, str):
                    words[item.target.id] = inspect.cleandoc(text.value)
    own = {
        name: item.description or words.get(name, "") for name, item in kind.model_fields.items()
    }
    return {name: text for name, text in own.items() if text}


class Faults(ValueError):
    """Faults that a validator raises; their fields count from the checked value."""

    def __init__(self, *faults: PipelineError) -> None:
        self.faults = faults
        super().__init__(*map(str, faults))

    def raise_any(self) -> None:
        """Raise these faults if there are any."""
        if self.faults:
            raise self

    def under(self, at: str) -> Iterator[PipelineError]:
        """Yield the faults with fields that count from further outside."""
        for each in self.faults:
            inner = each.field or ""
            each.field = at + ("." if at and inner and inner[0] != "[" else "") + inner or None
            yield each


def fault(message: str, at: str = "", value: object = None, **more: Any) -> CampaignError:
    """Return a fault of a document at a field that counts from the checked value."""
    return CampaignError(message, field=at, value=value, **more)


@dataclass(frozen=True)
class Range:
    """Bounds of a number, ends included; None where there is none."""

    low: float | None = None
    high: float | None = None

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return no_info_after_validator_function(self._checked, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        bounds = {"minimum": self.low, "maximum": self.high}
        return handler(schema) | {key: end for key, end in bounds.items() if end is not None}

    def _checked(self, value: float) -> float:
        low, high = self.low, self.high
        if (low is None or value >= low) and (high is None or value <= high):
            return value
        ends = f"at least {low}" if high is None else f"{low} to {high}"
        raise Faults(
            SchemaError(
                "out of range", value=value, allowed=ends if low is not None else f"at most {high}"
            )
        )


class Quantity(Model):
    """A number, or an array of them, with its unit and where it comes from."""

    value: float | list[Any]
    """One number, or lists of numbers."""
    unit: str
    """Unit text, as pint reads it."""
    source: str
    """Where the number comes from."""
    assumed: bool = False
    """Whether the number is assumed; the report lists those."""
    note: str | None = None
    """What is to be said of the number."""
    _si: npt.NDArray[np.float64] = PrivateAttr(default_factory=lambda: np.zeros(()))
    _si_unit: str = PrivateAttr(default="")

    @model_validator(mode="wrap")
    @classmethod
    def _numbers(cls, value: Any, handler: Callable[[Any], Quantity]) -> Quantity:
        if not isinstance(value, Mapping | Quantity):
            raise Faults(
                SchemaError("not a quantity", value=value, remedy="Give {value, unit, source}.")
            )
        if isinstance(value, Mapping) and "value" in value:
            _array(value["value"])
        return handler(value)

    @property
    def si(self) -> float:
        """Return the number in the unit of the schema."""
        return float(self._si)

    @property
    def array(self) -> npt.NDArray[np.float64]:
        """Return the numbers in the unit of the schema, read-only."""
        return self._si


def _array(value: object) -> npt.NDArray[np.float64]:
    try:
        array = np.array(value)
    except ValueError:  # rows of different lengths
        array = np.array(None)
    if array.dtype.kind not in "iuf":
        remedy = None
        if isinstance(value, str):
            if value.startswith(OPEN):
                remedy = "No log tells it: write the numbers in place of these words."
            elif "," in value:
                remedy = "Write a decimal point, without quotes: 14.0."
            elif NEARLY_A_NUMBER.fullmatch(value):
                remedy = "YAML takes an exponent after a point and with a sign: 1.0e+3."
        raise Faults(SchemaError("not numbers", field="value", value=value, remedy=remedy))
    array = array.astype(np.float64)
    if not np.all(np.isfinite(array)):
        raise Faults(SchemaError("not finite", field="value", value=value))
    return array


def _shape_in_words(shape: tuple[int, ...]) -> str:
    """Return `one number`, `a list of 3 numbers`, `a list of lists of 3 numbers`."""
    counts = [f"{count} " if count > 0 else "" for count in shape]
    if not counts:
        return "one number"
    rows = "".join(f"{count}lists of " for count in counts[:-1])
    return f"a list of {rows}{counts[-1]}numbers"


@dataclass(frozen=True)
class Unit:
    """The unit that a quantity is read in, and its shape; -1 is any length."""

    unit: str
    shape: tuple[int, ...] = ()
    positive: bool = False
    may_be_negative: bool = True

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return no_info_after_validator_function(self.read, handler(source))

    def read(self, quantity: Quantity) -> Quantity:
        """Return the quantity with its numbers in the unit of the schema."""
        value = _array(quantity.value)
        if value.ndim != len(self.shape) or any(
            want not in (-1, have) for want, have in zip(self.shape, value.shape, strict=True)
        ):
            raise Faults(
                SchemaError(
                    "wrong shape",
                    field="value",
                    value=quantity.value,
                    allowed=_shape_in_words(self.shape),
                )
            )
        if not convertible(quantity.unit, self.unit):
            raise Faults(
                SchemaError(
                    "wrong unit",
                    field="unit",
                    value=quantity.unit,
                    allowed=f"a unit of {self.unit}",
                )
            )
        factor, offset = factor_and_offset(quantity.unit, self.unit)
        quantity._si = np.asarray(value * factor + offset)
        quantity._si.flags.writeable = False
        quantity._si_unit = self.unit
        if self.positive and not np.all(quantity._si > 0.0):
            allowed = f"more than 0 {self.unit}"
            raise Faults(fault("must be positive", "value", quantity.value, allowed=allowed))
        if not self.may_be_negative and np.any(quantity._si < 0.0):
            raise Faults(fault("below zero", "value", quantity.value, allowed="0 or more"))
        return quantity


def default(value: float | list[float], unit: str) -> Any:
    """Return the quantity of a field that a user may leave out."""
    quantity = Quantity(value=value, unit=unit, source="default")
    return Unit(unit, np.shape(value)).read(quantity)


def assumed_quantities(
    part: object, place: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Quantity]]:
    """Yield each assumed number of a part of a document, with its place."""
    if isinstance(part, Quantity):
        if part.assumed:
            yield place, part
    elif isinstance(part, Model | dict):
        for key, value in part.items() if isinstance(part, dict) else part:
            yield from assumed_quantities(value, (*place, key))


def in_schema_units(part: M) -> M:
    """Return a checked document with each number in the unit of the schema."""
    if isinstance(part, Quantity):
        return part.model_copy(update={"value": part.array.tolist(), "unit": part._si_unit})
    return part.model_copy(
        update={key: _in_schema_units(getattr(part, key)) for key in part.model_fields_set}
    )


def _in_schema_units(value: object) -> object:
    if isinstance(value, Model):
        return in_schema_units(value)
    if isinstance(value, dict):
        return {key: _in_schema_units(item) for key, item in value.items()}
    return value


def parse(
    kind: type[M],
    document: object,
    *,
    file: object = None,
    row: Callable[[str], int | None] = lambda field: None,
) -> M:
    """Return the document as a checked model, or raise all of its faults together.

    `row`: dotted path of a field -> its row in the file.
    """
    try:
        return kind.model_validate(document)
    except ValidationError as found:
        faults = [each for error in found.errors() for each in _faults(kind, error)]
        rows = {id(each): row(each.field) if each.field else None for each in faults}
        for each in faults:
            each.file, each.row = file, rows[id(each)]
            each.args = (str(each),)
        # pydantic reports in the order of the model; a user reads by row
        raise_faults(sorted(faults, key=lambda each: rows[id(each)] or 0), file=file)
        raise  # pydantic found faults, so there are some


def part_of_kind(kind: type[M], value: object) -> M:
    """Return a part of a document whose model follows from another key."""
    try:
        return kind.model_validate(value)
    except ValidationError as found:
        raise Faults(*(each for error in found.errors() for each in _faults(kind, error))) from None


def _faults(kind: type[Model], error: ErrorDetails) -> Iterator[PipelineError]:
    """Yield what one error of pydantic is to a user."""
    place, code, value = error["loc"], error["type"], error["input"]
    field = dotted(place) or None
    if code == "value_error":
        cause = error["ctx"]["error"]
        if not isinstance(cause, Faults):
            raise cause
        yield from cause.under(field or "")
    elif code in ("extra_forbidden", "invalid_key"):
        known = _model(_annotation(kind, place[:-1]), Model).model_fields
        remedy = nearest(str(place[-1]), known) or f"Known keys: {', '.join(known)}."
        if isinstance(place[-1], int):
            remedy = "A number is no key: write a decimal point, 14.0 and not 14,0."
        yield SchemaError("unknown key", field=field, remedy=remedy)
    elif code == "missing":
        owner = _model(_annotation(kind, place[:-1]), Model)
        meaning = meanings(owner).get(str(place[-1]))
        needed = QUANTITY_REMEDY if owner is Quantity else meaning
        yield SchemaError("missing key", field=field, remedy=needed)
    elif code == "literal_error":
        allowed = get_args(_member(_annotation(kind, place), Literal))
        close = nearest(str(value), map(str, allowed))
        yield SchemaError("unknown value", field=field, value=value, allowed=allowed, remedy=close)
    elif code in ("model_type", "model_attributes_type"):
        yield SchemaError("not a mapping of keys to values", field=field, value=value)
    elif code == "finite_number":
        yield SchemaError("not finite", field=field, value=value)
    else:
        allowed_type = TYPE_NAMES.get(code, error["msg"])
        quotes = code == "string_type" and isinstance(value, bool | int | float)
        text = "YAML reads it as no text: write it in quotes." if quotes else None
        yield SchemaError("wrong type", field=field, value=value, allowed=allowed_type, remedy=text)


def dotted(place: Path) -> str:
    """Return the dotted path of a place: ("logs", 0, "id") -> logs[0].id."""
    text = ""
    for step in place:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def _annotation(kind: Any, place: Path) -> Any:
    """Return the annotation of what stands at a place of a model."""
    for step in place:
        model = _member(kind, Model)
        if model is not None:
            kind = model.model_fields[str(step)].annotation
        else:
            kind = get_args(_member(kind, list) or _member(kind, dict))[-1]
    return kind


def _member(kind: Any, wanted: Any) -> Any:
    """Return the part of an annotation that is of a kind, or None."""
    origin = get_origin(kind)
    if origin is Annotated:
        return _member(get_args(kind)[0], wanted)
    if origin in (Union, types.UnionType):
        parts = (_member(part, wanted) for part in get_args(kind))
        return next((part for part in parts if part is not None), None)
    if wanted is Model:
        return kind if isinstance(kind, type) and issubclass(kind, Model) else None
    return kind if origin is wanted else None


def _model(kind: Any, wanted: type[Model]) -> type[Model]:
    model: type[Model] = _member(kind, wanted)
    return model
