"""Why cells, rows and times of a CSV file cannot be what their names say."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from auvid.data_schemas.errors import LogError
from auvid.hydro.arrays import Array
from auvid.stages.ingest.formats.csv.column_names import NamedColumn

THOUSANDS = re.compile(r"[-+]?\d{1,3}(?:(?P<mark>[ '.,\u00a0\u202f\u2019])\d{3})+(?:[.,]\d+)?")
WITH_UNIT = re.compile(r"[-+]?\d+(?:[.,]\d+)?\s*(?P<unit>[^\d\s.,:/'\"-].{0,9})")
DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
IN_QUOTES = re.compile(r"(?P<mark>['`\u2019\"]).*\d.*(?P=mark)")
FORMS = (
    (
        DECIMAL_COMMA,
        "a decimal comma between commas",
        "Export it with a decimal point, or with semicolons.",
    ),
    (THOUSANDS, "a separator of thousands", "Export the numbers without separators of thousands."),
    (IN_QUOTES, "quotation marks", "Take the marks off the numbers."),
    (
        WITH_UNIT,
        "a unit in the cell",
        "Take the unit out of the cells, and put it in the name: depth_m.",
    ),
)
"""How numbers are written that are read as text, what that is, and the remedy."""
MOST_TEXTS = 0.5
"""Share of the filled cells that may be text in a column of numbers."""
FEW_FALLS = 0.02


def check_cells(
    columns: Sequence[NamedColumn],
    names: Sequence[str],
    texts: Mapping[str, Sequence[str]],
    values: Mapping[str, Array],
    file: str,
) -> None:
    """Raise `LogError` for columns with a meaning that cannot be read.

    Those are two of one name, and one whose numbers are written so that they are text.
    """
    for item in columns:
        if item.place is None and not item.is_time:
            continue
        places = [place + 1 for place, name in enumerate(names) if name == item.name]
        if len(places) > 1:
            raise LogError(
                f"the file has {len(places)} columns of this name",
                file=file,
                row=1,
                field=item.name,
                value=f"columns {' and '.join(map(str, places))}",
                remedy="Rename or delete all but the one that was measured.",
            )
        fault = None if item.is_time else number_fault(texts[item.name], values[item.name])
        if fault is not None:
            row, text, what, remedy = fault
            raise LogError(
                f"the numbers of this column are text: they have {what}",
                file=file,
                row=row,
                field=item.name,
                value=text,
                remedy=remedy,
            )


def number_fault(texts: Sequence[str], values: Array) -> tuple[int, str, str, str] | None:
    """Return row, cell, fault and remedy of a column of numbers that are text.

    >>> number_fault(["1'534", "1'536"], np.full(2, np.nan))[1:3]
    ("1'534", 'a separator of thousands')
    """
    filled = [place for place, text in enumerate(texts) if text]
    bad = [place for place in filled if not np.isfinite(values[place])]
    if len(bad) <= MOST_TEXTS * len(filled):
        return None
    for form, what, remedy in FORMS:
        fits = [bool(form.fullmatch(texts[place])) for place in bad]
        if np.mean(fits) > MOST_TEXTS and not (
            form is DECIMAL_COMMA and _are_thousands(texts, bad)
        ):
            place = bad[fits.index(True)]
            return place + 2, texts[place], what, remedy
    return None


def _are_thousands(texts: Sequence[str], places: Iterable[int]) -> bool:
    return all(THOUSANDS.fullmatch(texts[place]) for place in places)


def time_fault(item: NamedColumn, values: Array, texts: Sequence[str]) -> str:
    """Return why a column that is called a time is none, '' where that is unknown."""
    finite = np.flatnonzero(np.isfinite(values))
    filled = sum(bool(text) for text in texts)
    fault = number_fault(texts, values)
    if fault is not None and fault[2] != FORMS[-1][1]:
        return f"the numbers of {item.name} have {fault[2]} ({fault[1]!r}). {fault[3]}"
    if finite.size < 0.9 * filled:
        sample = next(texts[place] for place in range(len(texts)) if texts[place])
        kinds = "neither numbers, nor a time of day, nor ISO 8601"
        return f"texts of {item.name} as {sample!r} are {kinds}"
    if finite.size < 0.9 * len(texts):
        return f"{len(texts) - finite.size} of {len(texts)} cells of {item.name} are empty"
    steps = np.diff(values[finite])
    falls = np.flatnonzero(steps < 0.0)
    if falls.size and falls.size == np.count_nonzero(steps):
        return f"{item.name} falls from row to row: the rows run backwards. Sort them by time"
    if falls.size:
        row = int(finite[falls[0] + 1]) + 2
        return (
            f"{item.name} falls in {falls.size} rows, first in row {row}"
            f" ({texts[row - 2]!r}): rows that are not in order, a second log below the first, or"
            " a row that is none. Sort the rows by time, or delete those that do not belong"
        )
    if finite.size > 1 and not steps.any():
        lacks = "it lacks the digits that tell the rows apart"
        return f"{item.name} stays at {texts[finite[0]]!r}: {lacks}"
    return ""
