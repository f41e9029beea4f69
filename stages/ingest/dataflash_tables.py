"""What the decoded tables of a DataFlash log say about the log itself: units, parameters and texts (binary and text logs alike)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from data_schemas.formats import dataflash as layout

from .dataflash_columns import Column

Ints = npt.NDArray[np.int64]
Table = tuple[dict[str, Column], Ints]  # columns, byte offset of each record
NEEDED = frozenset({"FMTU", "UNIT", "MULT", "PARM", "MSG"})
UNTIMED = layout.DEFINITION_NAMES | {"PARM", "MSG"}


def decode_text(raw: bytes) -> str:
    """Text as the firmware wrote it; bytes that are not UTF-8 are read as Latin-1, as other log tools do."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


@dataclass(frozen=True)
class Units:
    """The unit declarations of a log: FMTU letters by type id, in file order, and what UNIT and MULT say the letters mean."""

    letters: Mapping[int, list[tuple[int, bytes, bytes]]]
    units: Mapping[str, str]
    multipliers: Mapping[str, float]

    @classmethod
    def of(cls, tables: Mapping[str, Table]) -> Units:
        columns, offset = tables.get("FMTU", ({}, np.zeros(0, np.int64)))
        letters: dict[int, list[tuple[int, bytes, bytes]]] = {}
        if {"FmtType", "UnitIds", "MultIds"} <= set(columns):
            rows = (offset.tolist(), columns["FmtType"].tolist(), columns["UnitIds"].tolist(), columns["MultIds"].tolist())
            for place, id, unit_ids, mult_ids in zip(*rows, strict=True):
                letters.setdefault(int(id), []).append((place, unit_ids, mult_ids))
        units = {letter: decode_text(label) for letter, label in _by_letter(tables.get("UNIT"), "Label").items()}
        # Multipliers are single precision cast to double: seven digits name them.
        multipliers = {letter: float(f"{factor:.7g}") for letter, factor in _by_letter(tables.get("MULT"), "Mult").items()}
        return cls(letters, units, multipliers)

    def texts(self, definition: layout.Definition, until: int | None = None) -> dict[str, str]:
        """The unit of each field, from the last FMTU record of the type before offset `until`; `#` marks the instance of a sensor.

        The multiplier stands before the unit (`cm`, `µs`), unless the format character already scales the field.
        """
        usable = [row for row in self.letters.get(definition.id, ()) if until is None or row[0] < until]
        if not usable:
            return {}
        unit_ids, mult_ids = (letters.split(b"\0", 1)[0].decode("latin-1") for letters in usable[-1][1:])
        texts: dict[str, str] = {}
        for i, (name, char) in enumerate(zip(definition.columns, definition.formats, strict=False)):
            unit = self.units.get(unit_ids[i : i + 1], "")
            if unit_ids[i : i + 1] == layout.INSTANCE_UNIT:
                unit = layout.INSTANCE_UNIT
            elif unit and layout.FIELD_FORMATS[char].factor is None:
                factor = self.multipliers.get(mult_ids[i : i + 1], 1.0)
                unit = layout.PREFIXES[factor] + unit if factor in layout.PREFIXES else f"{factor:.4g} {unit}"
            if unit:
                texts[name] = unit
        return texts


def _by_letter(table: Table | None, value: str) -> dict[str, Any]:
    columns = table[0] if table else {}
    if not {"Id", value} <= set(columns):
        return {}
    return {chr(int(id) & 0xFF): item for id, item in zip(columns["Id"].tolist(), columns[value].tolist(), strict=True)}


def parameters_of(table: Table | None) -> dict[str, float]:
    """The last value of each parameter in PARM."""
    columns = table[0] if table else {}
    if not {"Name", "Value"} <= set(columns):
        return {}
    return {decode_text(name): float(value) for name, value in zip(columns["Name"].tolist(), columns["Value"].tolist(), strict=True)}


def texts_of(table: Table | None) -> tuple[tuple[int, str], ...]:
    """The texts of MSG with their TimeUS (0 without one). Firmware 4.7 splits a long text: equal ID and ascending Seq are joined."""
    columns = table[0] if table else {}
    if "Message" not in columns:
        return ()
    zeros = [0] * columns["Message"].size
    times, ids, parts = (columns[name].tolist() if name in columns else zeros for name in ("TimeUS", "ID", "Seq"))
    texts: list[tuple[int, str]] = []
    for i, raw in enumerate(columns["Message"].tolist()):
        if i and parts[i] == parts[i - 1] + 1 and ids[i] == ids[i - 1]:
            texts[-1] = (texts[-1][0], texts[-1][1] + decode_text(raw))
        else:
            texts.append((int(times[i]), decode_text(raw)))
    return tuple(texts)
