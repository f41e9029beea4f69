"""Report sections as documents that `report` only arranges and renders.

A section is {title, order, blocks}; a block is one of the dictionaries made here. Long
signals are thinned by minimum and maximum per bin, so that peaks stay visible.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.documents.published_values import Evidence
from auvid.data_schemas.schemas import schema
from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.regression.assumed_figures import FIGURES, total_error
from auvid.stages.number_format import part_of

Block = dict[str, Any]
Figure = dict[str, Any]
SHOWN_POINTS = 800
DIGITS = 6
SMALLEST_SCALED = 1e-15
"""Numbers of this size to its inverse take exact powers of ten to so many digits."""
NEAR_HALF = 1e-6
"""A product this near to a half may have been tipped over by its rounding."""
NOISE_95 = "± 95 % by noise"
"""Head of a column with half of the 95 % interval."""


def half_95(standard_error: float | None) -> float | None:
    """Return half of the normal 95 % interval of a standard error; None for none."""
    return None if standard_error is None else NORMAL_95 * standard_error


def shift_words(shifts: Mapping[str, float], standard_error: float) -> str:
    """Return what assumed figures add to half of a 95 % interval, largest first.

    To the figures of the half width by noise and assumed figures; those below a tenth of
    the standard error by noise and of the largest are left out.

    >>> shift_words({"mass": 0.01, "thrust": 11.7}, 0.7)
    'scale of the thrust curve ± 23'
    """
    half = NORMAL_95 * total_error(standard_error, shifts)
    least = 0.1 * max((standard_error, *shifts.values()))
    return ", ".join(
        f"{FIGURES[name]} {part_of(half, NORMAL_95 * shift)}"
        for name, shift in sorted(shifts.items(), key=lambda pair: -pair[1])
        if shift >= least
    )


def section(
    title: str,
    blocks: Sequence[Block],
    *,
    order: int,
    look_for: str = "",
    chapter: str = "",
    is_open: bool = False,
) -> dict[str, Any]:
    """Return a report section; sections are sorted by `order`, then stage and item.

    `chapter`: a heading that several of a stage share. `is_open`: the page shows the
    section before anyone asks for it.
    """
    document = {"title": title, "order": order, "look_for": look_for, "blocks": list(blocks)}
    chapters = {"chapter": chapter} if chapter else {}
    return document | chapters | ({"is_open": True} if is_open else {})


def fold(title: str, blocks: Sequence[Block]) -> list[Block]:
    """Return blocks that the page shows under their title once it is opened."""
    return [block | {"fold": title} for block in blocks]


def degrees(unit: str) -> tuple[float, str]:
    """Return factor and unit in which people read an angle or a rate; SI of others.

    >>> degrees("rad/s")[1], degrees("N")
    ('deg/s', (1.0, 'N'))
    """
    if unit in ("rad", "rad/s"):
        return 180.0 / pi, unit.replace("rad", "deg")
    return 1.0, unit


def text(words: str) -> Block:
    """Return a paragraph of plain text (rendered escaped)."""
    return {"kind": "text", "text": words}


def paste(words: str) -> Block:
    """Return paragraphs, one per line, that the reader can copy as a whole."""
    return {"kind": "paste", "text": words}


def remark(words: str, level: Literal["finding", "note", "warning"] = "note") -> Block:
    """Return a sentence set apart: a finding, a note, or a warning."""
    return {"kind": "remark", "level": level, "text": words}


def equation(latex: str, meaning: str = "") -> Block:
    """Return a displayed equation in LaTeX notation, with a plain reading."""
    return {"kind": "equation", "latex": latex, "meaning": meaning}


def table(
    title: str,
    columns: Sequence[str | tuple[str, str]],
    rows: Sequence[Sequence[Any]],
    *,
    note: str = "",
    kept: Sequence[bool] | None = None,
) -> Block:
    """Return a sortable table; a column is a name or (name, unit).

    Cells are text, numbers or None. kept: whether each row shows before all are asked
    for; None keeps them all.
    """
    heads = [
        {"name": item, "unit": ""} if isinstance(item, str) else {"name": item[0], "unit": item[1]}
        for item in columns
    ]
    return {
        **({} if kept is None else {"kept": list(kept)}),
        "kind": "table",
        "title": title,
        "columns": heads,
        "rows": [[_plain(cell) for cell in row] for row in rows],
        "note": note,
    }


def series(name: str, x: npt.ArrayLike, y: npt.ArrayLike, role: str) -> dict[str, Any]:
    """Return one line of a plot.

    `role` fixes its colour everywhere: raw, fused, measured, true, band, or a model's
    name.
    """
    x_kept, y_kept = thin(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    return {"name": name, "role": role, "x": rounded(x_kept), "y": rounded(y_kept)}


def panel(label: str, unit: str, lines: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """One y-axis of a plot with its lines."""
    return {"label": label, "unit": unit, "series": list(lines)}


def plot(
    title: str,
    panels: Sequence[Mapping[str, Any]],
    *,
    x_label: str = "time",
    x_unit: str = "s",
    group: str = "",
    look_for: str = "",
) -> Block:
    """Return panels above one another on a shared x-axis.

    Plots of one `group` zoom together.
    """
    return {
        "kind": "plot",
        "title": title,
        "x": {"label": x_label, "unit": x_unit},
        "panels": list(panels),
        "group": group,
        "look_for": look_for,
    }


def figure(
    quantity: str,
    value: float | None,
    unit: str,
    error: float | None = None,
    *,
    interval: tuple[float, float] | None = None,
    verdict: str | None = None,
    note: str | None = None,
    headline: bool = False,
    evidence: Evidence | None = None,
    reference: str | None = None,
) -> Figure:
    """Return one row of a `results` document; None replaces a number not finite.

    interval: 95 %, else from the error. evidence: what meeting counted bounds shows;
    reference: what they hold ours against.
    """
    number = float(value) if value is not None and np.isfinite(value) else None
    spread = (
        float(error) if number is not None and error is not None and np.isfinite(error) else None
    )
    low, high = (None, None)
    if number is not None and spread is not None:
        low, high = (
            interval
            if interval is not None
            else (number - NORMAL_95 * spread, number + NORMAL_95 * spread)
        )
    return {
        "quantity": quantity,
        "value": number,
        "unit": unit,
        "standard_error": spread,
        "low": None if low is None else float(low),
        "high": None if high is None else float(high),
        "verdict": verdict,
        "note": note,
        "headline": headline,
    } | {
        name: words
        for name, words in (("evidence", evidence), ("reference", reference))
        if words is not None
    }


def view(
    entity: str,
    table: str,
    columns: Sequence[str],
    roles: Sequence[str],
    *,
    tab: str,
    names: Sequence[str] | None = None,
    unit: str | None = None,
    **more: Any,
) -> dict[str, Any]:
    """Return a group of a `views` document: columns of a table on one y-axis.

    table: `port`, `port/key`, or `stage/item/port` of another stage. names: those of the
    series, the symbols of the columns if None. unit: the schema's if None. more:
    `filter`, `spread`, `less`.
    """
    parts = table.split("/")
    return {
        "entity": entity,
        "table": table,
        "columns": list(columns),
        "names": list(names or map(symbol, columns)),
        "roles": list(roles),
        "tab": tab,
        "unit": unit or unit_of(parts[-1] if len(parts) > 2 else parts[0], columns[0]),
        **more,
    }


def unit_of(name: str, column: str) -> str:
    """Return the unit of a column of schema `name`."""
    return schema(name).columns[column].unit


def symbol(column: str) -> str:
    """Return the symbol that a column's name starts with: `u` of `u_m_s`."""
    return column.partition("_")[0]


def thin(x: Array, y: Array, points: int = SHOWN_POINTS) -> tuple[Array, Array]:
    """Return at most `points` samples (n,) in time order, with each bin's extremes.

    The smallest and the largest of every bin are kept; NaN marks a gap and stays one.
    """
    if x.size <= points:
        return x, y
    bins = points // 2
    edges = np.linspace(0, x.size, bins + 1).astype(int)[:-1]
    width = np.diff(np.append(edges, x.size))
    finite = np.isfinite(y)
    position = np.arange(x.size) - np.repeat(edges, width)
    bin_of = np.repeat(np.arange(bins), width)
    low = _first_equal(
        np.where(finite, y, np.inf),
        np.minimum.reduceat(np.where(finite, y, np.inf), edges),
        bin_of,
        position,
        edges,
    )
    high = _first_equal(
        np.where(finite, y, -np.inf),
        np.maximum.reduceat(np.where(finite, y, -np.inf), edges),
        bin_of,
        position,
        edges,
    )
    kept = np.unique(np.concatenate([low, high]))
    return x[kept], y[kept]


def _first_equal(
    values: Array,
    extreme: Array,
    bin_of: npt.NDArray[np.intp],
    position: npt.NDArray[np.intp],
    edges: npt.NDArray[np.intp],
) -> npt.NDArray[np.intp]:
    hit = np.where(values == extreme[bin_of], position, values.size)
    return edges + np.minimum.reduceat(hit, edges)


def rounded(values: Array) -> list[float | None]:
    """Return values (n,) to six digits, as `float(f"{value:.6g}")`; None if not finite.

    All at once: a plot has thousands. Halves, which the product with a power of ten may
    tip over, and numbers beyond exact powers of ten are rounded by their digits.

    >>> rounded(np.array([0.12345678, -1234567.8, np.nan]))
    [0.123457, -1234570.0, None]
    """
    finite = np.isfinite(values)
    size = np.abs(values)
    plain = finite & (size > SMALLEST_SCALED) & (size < 1.0 / SMALLEST_SCALED)
    places = DIGITS - 1 - np.floor(np.log10(np.where(plain, size, 1.0)))
    up, down = 10.0 ** np.maximum(places, 0.0), 10.0 ** np.maximum(-places, 0.0)
    scaled = np.where(plain, values, 0.0) * up / down
    counts = np.rint(scaled)
    plain &= np.abs(np.abs(scaled - counts) - 0.5) > NEAR_HALF
    listed: list[float | None] = (counts / up * down).tolist()
    for at in np.flatnonzero(~plain).tolist():
        listed[at] = float(f"{values[at]:.{DIGITS}g}") if finite[at] else None
    return listed


def _plain(cell: Any) -> Any:
    if isinstance(cell, np.generic):
        cell = cell.item()
    if isinstance(cell, float) and not np.isfinite(cell):
        return None
    return cell
