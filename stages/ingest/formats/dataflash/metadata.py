"""Units, parameters, texts and notes from the decoded tables of a DataFlash log.

Binary and text logs alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.data_schemas.formats import dataflash as layout
from auvid.stages.ingest.decoded_log import Column
from auvid.stages.ingest.formats.accounting import LATEST_US
from auvid.stages.ingest.formats.dataflash.columns import Table

METADATA = frozenset({"FMTU", "UNIT", "MULT", "PARM", "MSG"})
UNTIMED = layout.DEFINITION_NAMES | {"PARM", "MSG"}


def decode_text(raw: bytes) -> str:
    """Return text as the firmware wrote it.

    Buffer that are not UTF-8 are read as Latin-1, as other log tools do.
    """
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def sound_columns(
    table: Table | None, *, numbers: Sequence[str] = (), texts: Sequence[str] = ()
) -> Mapping[str, Column]:
    """Return the columns of a table if these are there with values of their kind.

    Else none: a damaged definition makes text of numbers.
    """
    columns = table[0] if table else {}
    kinds = {**dict.fromkeys(numbers, "iuf"), **dict.fromkeys(texts, "S")}
    sound = all(
        name in columns and columns[name].ndim == 1 and columns[name].dtype.kind in kind
        for name, kind in kinds.items()
    )
    return columns if sound else {}


def integers(column: Column) -> list[int]:
    """Return the values as integers; -1 where a value is not a number."""
    numbers = np.asarray(column)
    if numbers.dtype.kind == "f":
        numbers = np.where(np.abs(numbers) < LATEST_US, numbers, -1.0).astype(np.int64)
    return [int(number) for number in numbers.tolist()]


@dataclass(frozen=True)
class Units:
    """Unit declarations of a log.

    FMTU letters by type id, in file order, and what UNIT and MULT say the letters mean.
    """

    letters: Mapping[int, list[tuple[int, bytes, bytes]]]
    units: Mapping[str, str]
    multipliers: Mapping[str, float]

    @classmethod
    def of(cls, tables: Mapping[str, Table]) -> Units:
        """Return the declarations in the tables FMTU, UNIT and MULT."""
        letters: dict[int, list[tuple[int, bytes, bytes]]] = {}
        texts = ("UnitIds", "MultIds")
        columns = sound_columns(tables.get("FMTU"), numbers=("FmtType",), texts=texts)
        if columns:
            places = tables["FMTU"][1].tolist()
            ids = [columns[name].tolist() for name in texts]
            for place, id, *pair in zip(places, integers(columns["FmtType"]), *ids, strict=True):
                letters.setdefault(id, []).append((place, *pair))
        labels = sound_columns(tables.get("UNIT"), numbers=("Id",), texts=("Label",))
        factors = sound_columns(tables.get("MULT"), numbers=("Id", "Mult"))
        units = {letter: decode_text(text) for letter, text in _by_letter(labels, "Label").items()}
        # Multipliers are single precision cast to double: seven digits name them.
        multipliers = {
            letter: float(f"{factor:.7g}") for letter, factor in _by_letter(factors, "Mult").items()
        }
        return cls(letters, units, multipliers)

    def texts(self, definition: layout.Definition, until: int | None = None) -> dict[str, str]:
        """Return the unit of each field, from the last FMTU record before `until`.

        `#` marks the instance of a sensor. The multiplier stands before the unit (`cm`,
        `µs`), unless the format character already scales the field.
        """
        rows = self.letters.get(definition.id, ())
        usable = [row for row in rows if until is None or row[0] < until]
        if not usable:
            return {}
        unit_ids, mult_ids = (
            letters.split(b"\0", 1)[0].decode("latin-1") for letters in usable[-1][1:]
        )
        texts: dict[str, str] = {}
        for i, (name, char) in enumerate(zip(definition.columns, definition.formats, strict=False)):
            unit = self.units.get(unit_ids[i : i + 1], "")
            if unit_ids[i : i + 1] == layout.INSTANCE_UNIT:
                unit = layout.INSTANCE_UNIT
            elif unit and layout.FIELD_FORMATS[char].factor is None:
                factor = self.multipliers.get(mult_ids[i : i + 1], 1.0)
                unit = (
                    layout.PREFIXES[factor] + unit
                    if factor in layout.PREFIXES
                    else f"{factor:.4g} {unit}"
                )
            if unit:
                texts[name] = unit
        return texts


def _by_letter(columns: Mapping[str, Column], value: str) -> dict[str, Any]:
    if not columns:
        return {}
    letters = (chr(id & 0xFF) for id in integers(columns["Id"]))
    return dict(zip(letters, columns[value].tolist(), strict=True))


def parameters_of(table: Table | None) -> dict[str, float]:
    """Return the last value of each parameter in PARM."""
    columns = sound_columns(table, numbers=("Value",), texts=("Name",))
    if not columns:
        return {}
    names = map(decode_text, columns["Name"].tolist())
    return dict(zip(names, map(float, columns["Value"].tolist()), strict=True))


def texts_of(table: Table | None) -> tuple[tuple[int, str], ...]:
    """Return the texts of MSG with their TimeUS (0 without one).

    Firmware 4.7 splits a long text: equal ID and ascending Seq are joined.
    """
    columns = sound_columns(table, texts=("Message",))
    if not columns:
        return ()
    raw = columns["Message"].tolist()
    times, ids, parts = (
        integers(columns[name]) if sound_columns(table, numbers=(name,)) else [0] * len(raw)
        for name in ("TimeUS", "ID", "Seq")
    )
    texts: list[tuple[int, str]] = []
    for i, text in enumerate(map(decode_text, raw)):
        if i and parts[i] == parts[i - 1] + 1 and ids[i] == ids[i - 1]:
            texts[-1] = (texts[-1][0], texts[-1][1] + text)
        else:
            texts.append((times[i], text))
    return tuple(texts)


def layout_notes(
    layouts: Mapping[str, Sequence[tuple[layout.Definition, int]]], clock_notes: Sequence[str] = ()
) -> tuple[str, ...]:
    """Return sentences about the clock and the layouts of the message types.

    `layouts` has the definitions of each type with records, each with its kind of time
    stamp: 1 TimeUS, 2 TimeMS, 0 none.
    """
    notes = list(clock_notes)
    if any(kind == 2 for parts in layouts.values() for _, kind in parts):
        notes.insert(
            0, "Times are milliseconds since boot (TimeMS), as firmware before 2015 writes them."
        )
    if set(layouts) <= layout.DEFINITION_NAMES:
        notes.append("The log holds definitions only, no recorded data.")
    several = [name for name, parts in layouts.items() if len(parts) > 1]
    if several:
        notes.append(f"Declared with several layouts, joined by field name: {', '.join(several)}.")
    timeless = [
        name
        for name, parts in layouts.items()
        if name not in UNTIMED
        # GPS records of old firmware have the clock as T.
        and not any(kind or "T" in definition.columns for definition, kind in parts)
    ]
    if timeless:
        notes.append(f"Without a time field of the vehicle's clock: {', '.join(timeless)}.")
    return tuple(notes)
