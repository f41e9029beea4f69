"""Byte layout of ArduPilot DataFlash logs (.BIN), shared by the reader and the writers.

A log is a chain of records without length or checksum: two magic bytes, the type id,
then the fields of that type, packed and little-endian. FMT records (id 128, the only
layout known beforehand) declare id, length, name, field formats and field names of the
other types; FMTU, UNIT and MULT records, declared by FMT like any other, name the
units. Source: ArduPilot, libraries/AP_Logger/LogStructure.h.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

MAGIC = b"\xa3\x95"
HEADER_BYTES = 3
FMT_ID = 128
FMT_BYTES = 89
MAX_RECORD_BYTES = 255
DEFINITION_NAMES = frozenset({"FMT", "FMTU", "UNIT", "MULT"})


@dataclass(frozen=True)
class FieldFormat:
    """One format character of a record.

    It gives the packed little-endian type, and the factor from stored integer to
    declared unit (None: as stored).
    """

    dtype: str
    factor: float | None = None

    @property
    def is_text(self) -> bool:
        return self.dtype.startswith("S")

    @property
    def bytes(self) -> int:
        return field_dtype(self.dtype).itemsize


@lru_cache(maxsize=64)
def field_dtype(text: str) -> np.dtype[np.generic]:
    return np.dtype((np.int16, 32)) if text == "int16[32]" else np.dtype(text)


FIELD_FORMATS: dict[str, FieldFormat] = {
    "a": FieldFormat("int16[32]"),
    "b": FieldFormat("<i1"),
    "B": FieldFormat("<u1"),
    "h": FieldFormat("<i2"),
    "H": FieldFormat("<u2"),
    "i": FieldFormat("<i4"),
    "I": FieldFormat("<u4"),
    "q": FieldFormat("<i8"),
    "Q": FieldFormat("<u8"),
    "g": FieldFormat("<f2"),
    "f": FieldFormat("<f4"),
    "d": FieldFormat("<f8"),
    "n": FieldFormat("S4"),
    "N": FieldFormat("S16"),
    "Z": FieldFormat("S64"),
    "c": FieldFormat("<i2", 0.01),
    "C": FieldFormat("<u2", 0.01),
    "e": FieldFormat("<i4", 0.01),
    "E": FieldFormat("<u4", 0.01),
    "L": FieldFormat("<i4", 1.0e-7),  # latitude and longitude, degrees
    "M": FieldFormat("<i1"),  # flight mode number
}

# Unit prefix for the multipliers that MULT records declare; any other multiplier is
# written out before the unit.
PREFIXES: dict[float, str] = {
    0.0: "",
    1.0: "",
    1e-1: "d",
    1e-2: "c",
    1e-3: "m",
    1e-6: "µ",
    1e-9: "n",
}
INSTANCE_UNIT = "#"

_sizes = np.zeros(256, np.int64)
for _char, _format in FIELD_FORMATS.items():
    _sizes[ord(_char)] = _format.bytes
FIELD_BYTES: npt.NDArray[np.int64] = _sizes
FIELD_BYTES.flags.writeable = False


@lru_cache(maxsize=1024)
def record_dtype(formats: str) -> np.dtype[np.void]:
    """Return the packed dtype of a whole record, header included.

    Its fields are `f0`, `f1`, ... in the order of the format characters.
    """
    offsets, position = [], HEADER_BYTES
    for char in formats:
        offsets.append(position)
        position += FIELD_FORMATS[char].bytes
    return np.dtype(
        {
            "names": [f"f{i}" for i in range(len(formats))],
            "formats": [field_dtype(FIELD_FORMATS[char].dtype) for char in formats],
            "offsets": offsets,
            "itemsize": position,
        }
    )


@dataclass(frozen=True)
class Definition:
    """Content of a FMT record.

    Records of type `id` are `length` bytes long (header included) and hold `columns` in
    `formats`.
    """

    id: int
    length: int
    name: str
    formats: str
    columns: tuple[str, ...]

    @property
    def record(self) -> np.dtype[np.void]:
        return record_dtype(self.formats)

    def pack(self) -> bytes:
        """Return the FMT record that declares this type.

        Raises:
            ValueError: a name, the formats or the column names do not fit their 4, 16
            and 64 bytes.
        """
        texts = (
            self.name.encode("ascii"),
            self.formats.encode("ascii"),
            ",".join(self.columns).encode("ascii"),
        )
        for text, limit in zip(texts, (4, 16, 64), strict=True):
            if len(text) > limit:
                raise ValueError(f"{text!r} is longer than {limit} bytes")
        head = MAGIC + bytes([FMT_ID, self.id, self.length])
        return (
            head + texts[0].ljust(4, b"\0") + texts[1].ljust(16, b"\0") + texts[2].ljust(64, b"\0")
        )


def define(id: int, name: str, formats: str, columns: str) -> Definition:
    """Return a definition from its name, format characters and column names.

    The column names are separated by commas; the length follows from the formats.
    """
    names = tuple(columns.split(",")) if columns else ()
    return Definition(id, record_dtype(formats).itemsize, name, formats, names)


FMT = define(FMT_ID, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
