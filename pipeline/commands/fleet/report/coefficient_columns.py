"""The columns of table `coefficients` as arrays: a thousand dives have 600 000 rows.

pandas is not loaded for it, as Arrow's own conversions would do.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.hydro.arrays import Array, Ints, Mask

TEXTS = ("log", "vehicle", "model", "axis", "term", "unit", "verdict")
NUMBERS = ("value", "standard_error", "correlation")
COLUMNS = (*TEXTS, *NUMBERS)
"""What is read of the table."""


@dataclass(frozen=True)
class Coefficients:
    """Rows of table `coefficients` by column.

    `words`: of each text column the different texts; `codes` (n,): the place of each
    row's text among them. `numbers` (n,): nan where a row has none.
    """

    words: Mapping[str, Sequence[str]]
    codes: Mapping[str, Ints]
    numbers: Mapping[str, Array]

    @classmethod
    def of_table(cls, table: pa.Table) -> Coefficients:
        """Return the columns of a table that has at least `COLUMNS`."""
        texts = {name: table[name].combine_chunks().dictionary_encode() for name in TEXTS}
        return cls(
            {name: item.dictionary.to_pylist() for name, item in texts.items()},
            {name: np.from_dlpack(item.indices).astype(np.int64) for name, item in texts.items()},
            {name: _numbers(table[name].combine_chunks()) for name in NUMBERS},
        )

    def __len__(self) -> int:
        return len(self.codes["log"])

    def among(self, column: str, words: Collection[str]) -> Mask:
        """Return which rows (n,) have one of some words in a text column."""
        chosen = np.array([word in words for word in self.words[column]], dtype=bool)
        return chosen[self.codes[column]] if chosen.size else np.zeros(len(self), dtype=bool)

    def where(self, rows: Mask | Ints) -> Coefficients:
        """Return some rows, by mask (n,) or by place (m,)."""
        return Coefficients(
            self.words,
            {name: codes[rows] for name, codes in self.codes.items()},
            {name: numbers[rows] for name, numbers in self.numbers.items()},
        )

    def texts(self, column: str) -> list[str]:
        """Return the texts of a column (n)."""
        words = self.words[column]
        return [words[code] for code in self.codes[column].tolist()]

    def rows(self) -> list[dict[str, Any]]:
        """Return all rows as mappings, None in place of nan."""
        columns: list[list[Any]] = [self.texts(name) for name in TEXTS]
        columns += [
            [None if number != number else number for number in self.numbers[name].tolist()]
            for name in NUMBERS
        ]
        return [dict(zip(COLUMNS, cells, strict=True)) for cells in zip(*columns, strict=True)]

    def groups(self, *columns: str) -> Iterator[Coefficients]:
        """Yield rows alike in some text columns, in order of the first of each."""
        sizes = [len(self.words[name]) for name in columns]
        alike = np.ravel_multi_index([self.codes[name] for name in columns], sizes)
        _, first, group = np.unique(alike, return_index=True, return_inverse=True)
        order = np.argsort(group, kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(group))[:-1])
        yield from (self.where(parts[place]) for place in np.argsort(first))


def _numbers(column: pa.Array) -> Array:
    """Return the numbers of an Arrow column, nan for null."""
    valid = np.from_dlpack(column.is_valid().cast(pa.uint8()))
    if not len(column):
        return np.empty(0)
    values = np.frombuffer(column.buffers()[1], dtype=np.float64)
    return np.where(valid, values[column.offset :][: len(column)], np.nan)
