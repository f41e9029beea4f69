"""What the decoded tables of a DataFlash log say about the log itself: units,
parameters and texts (binary and text logs alike).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Ints
from auvid.stages.ingest.formats.dataflash.columns import Column

Table = tuple[dict[str, Column], Ints]  # columns, byte offset of each record
NEEDED = frozenset({"FMTU", "UNIT", "MULT", "PARM", "MSG"})
LARGEST = 1 << 62
UNTIMED = layout.DEFINITION_NAMES | {"PARM", "MSG"}


def decode_text(raw: bytes) -> str:
    """Text as the firmware wrote it; bytes that are not UTF-8 are read as Latin-1, as
    other log tools do.
    """
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def sound_columns(
    table: Table | None, *, numbers: Sequence[str] = (), texts: Sequence[str] = ()
) -> Mapping[str, Column]:
    """The columns of a table if these are there with values of their kind, else none: a
    damaged definition makes text of numbers.
    """
    columns = table[0] if table else {}
    kinds = [(name, "iuf") for name in numbers] + [(name, "S") for name in texts]
    sound = all(
        name in columns and columns[name].ndim == 1 and columns[name].dtype.kind in kind
        for name, kind in kinds
    )
    return columns if sound else {}


def whole(column: Column) -> list[int]:
    """Numbers as integers; -1 for those that are none."""
    numbers = np.asarray(column)
    if numbers.dtype.kind == "f":
        numbers = np.where(np.abs(numbers) < LARGEST, numbers, -1.0).astype(np.int64)
    return [int(number) for number in numbers.tolist()]


@dataclass(frozen=True)
class Units:
    """The unit declarations of a log: FMTU letters by type id, in file order, and what
    UNIT and MULT say the letters mean.
    """

    letters: Mapping[int, list[tuple[int, bytes, bytes]]]
    units: Mapping[str, str]
    multipliers: Mapping[str, float]

    @classmethod
    def of(cls, tables: Mapping[str, Table]) -> Units:
        letters: dict[int, list[tuple[int, bytes, bytes]]] = {}
        columns = sound_columns(
            tables.get("FMTU"), numbers=("FmtType",), texts=("UnitIds", "MultIds")
        )
        if columns:
            rows = (
                tables["FMTU"][1].tolist(),
                whole(columns["FmtType"]),
                columns["UnitIds"].tolist(),
                columns["MultIds"].tolist(),
            )
            for place, id, unit_ids, mult_ids in zip(*rows, strict=True):
                letters.setdefault(id, []).append((place, unit_ids, mult_ids))
        labels = sound_columns(tables.get("UNIT"), numbers=("Id",), texts=("Label",))
        factors = sound_columns(tables.get("MULT"), numbers=("Id", "Mult"))
        units = {
            letter: decode_text(label) for letter, label in _by_letter(labels, "Label").items()
        }
        # Multipliers are single precision cast to double: seven digits name them.
        multipliers = {
            letter: float(f"{factor:.7g}") for letter, factor in _by_letter(factors, "Mult").items()
        }
        return cls(letters, units, multipliers)

    def texts(self, definition: layout.Definition, until: int | None = None) -> dict[str, str]:
        """The unit of each field, from the last FMTU record of the type before offset
        `until`; `#` marks the instance of a sensor.

        The multiplier stands before the unit (`cm`, `µs`), unless the format character
        already scales the field.
        """
        usable = [
            row for row in self.letters.get(definition.id, ()) if until is None or row[0] < until
        ]
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
    return (
        {
            chr(id & 0xFF): item
            for id, item in zip(whole(columns["Id"]), columns[value].tolist(), strict=True)
        }
        if columns
        else {}
    )


def parameters_of(table: Table | None) -> dict[str, float]:
    """The last value of each parameter in PARM."""
    columns = sound_columns(table, numbers=("Value",), texts=("Name",))
    if not columns:
        return {}
    return {
        decode_text(name): float(value)
        for name, value in zip(columns["Name"].tolist(), columns["Value"].tolist(), strict=True)
    }


def texts_of(table: Table | None) -> tuple[tuple[int, str], ...]:
    """The texts of MSG with their TimeUS (0 without one). Firmware 4.7 splits a long
    text: equal ID and ascending Seq are joined.
    """
    columns = sound_columns(table, texts=("Message",))
    if not columns:
        return ()
    zeros = [0] * columns["Message"].size
    times, ids, parts = (
        whole(columns[name]) if sound_columns(table, numbers=(name,)) else zeros
        for name in ("TimeUS", "ID", "Seq")
    )
    texts: list[tuple[int, str]] = []
    for i, raw in enumerate(columns["Message"].tolist()):
        if i and parts[i] == parts[i - 1] + 1 and ids[i] == ids[i - 1]:
            texts[-1] = (texts[-1][0], texts[-1][1] + decode_text(raw))
        else:
            texts.append((times[i], decode_text(raw)))
    return tuple(texts)
