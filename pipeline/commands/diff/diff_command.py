"""`auvid diff`: two runs, a run and its golden tables, two variants of a stage, or two
models, in figures and in one recording.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES
from auvid.hydro.constants import NORMAL_95
from auvid.pipeline.commands.diff.diff_operands import Loaded, common, load
from auvid.pipeline.commands.inspect import inspect_command as inspection
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.commands.regress.golden_tables import Departure, Tables
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.pipeline.terminal import path_from_here, plain
from auvid.stages.report.difference.signals import (
    FigureChange,
    Pair,
    Side,
    SignalChange,
    coefficient_changes,
    differs,
    pairs,
    signal_changes,
)
from auvid.stages.report.recording.text import table_lines

SHOWN = 20
RELATIVE = 1e-6
ROUNDING = 1e-9
"""Differences below this share of the largest signal of the same kind and unit are
rounding: a roll of 1e-16 rad is none.
"""


@dataclass(frozen=True)
class Difference:
    """What changed from the first to the second: cells of the error tables, figures,
    signals; and what has no partner.
    """

    names: tuple[str, str]
    held: int
    departures: list[Departure]
    figures: list[FigureChange]
    signals: list[SignalChange]
    alone: list[str]
    compared: Mapping[str, int]

    @property
    def equal(self) -> bool:
        """Whether everything that has a partner holds, and everything has one."""
        return not (self.departures or self.figures or self.signals or self.alone)

    @property
    def document(self) -> dict[str, Any]:
        """The difference as JSON."""
        return {
            "first": self.names[0],
            "second": self.names[1],
            "equal": self.equal,
            "compared": dict(self.compared),
            "error_tables": [
                {**asdict(item), "axis": item.axis, "figure": item.figure}
                for item in self.departures
            ],
            "figures": [{**asdict(item), "sigmas": item.sigmas} for item in self.figures],
            "signals": [asdict(item) for item in self.signals],
            "no_partner": self.alone,
        }


def diff(
    first: str,
    second: str,
    *,
    save: Path | None = None,
    picture: Path | None = None,
    as_json: bool = False,
    relative: float = RELATIVE,
) -> bool:
    """Print what changed and write the recording or its picture if wanted; True if all
    is equal within tolerance.
    """
    one, two = load(first), load(second)
    partial = [item.side.name for item in (one, two) if item.partial]
    if partial:
        one, two = common(one, two)
    found, alone = pairs(one.side, two.side)
    changed = difference(one, two, found, alone, relative)
    if not any(changed.compared.values()) and changed.equal:
        raise DataError(
            "the two hold nothing that could be compared",
            value=f"{first}, {second}",
            remedy="Compare two whole runs.",
        )
    if partial and not as_json:
        print(
            f"{'error tables and figures' if one.side.results else 'error tables'} alone are"
            f" compared: {partial[0]} holds nothing else"
        )
    if as_json:
        print(json.dumps(changed.document, indent=1, ensure_ascii=False, allow_nan=False))
    else:
        print("\n".join(plain(line) for line in lines(changed)))
    if save is not None or picture is not None:
        _draw(one.side, two.side, found, changed, save, picture, quiet=as_json)
    return changed.equal


def difference(
    one: Loaded, two: Loaded, found: Sequence[Pair], alone: Sequence[str], relative: float
) -> Difference:
    """All changes between two sides, the largest first."""
    figures, lonely = coefficient_changes(one.side, two.side)
    signals = list(signal_changes(list(found)))
    old, new = (_narrowed(item) for item in (one, two))
    held, departures = (
        golden.compare(old, new, _tolerances(one, two, old, new)) if old and new else (0, [])
    )
    if bool(old) != bool(new):
        lonely = [*lonely, f"error tables only in {(one if old else two).side.name}"]
    cells = sum(len(row) for table in old.values() for row in table.values())
    moved = [
        item
        for item in figures
        if differs(item.old, item.new, relative) or item.old_verdict != item.new_verdict
    ]
    sizes: dict[tuple[str, str, str], float] = {}
    for item in signals:
        key = (item.segment, item.kind, item.unit)
        sizes[key] = max(sizes.get(key, 0.0), item.rms, item.rms_difference)
    apart = [
        item
        for item in signals
        if item.rms_difference
        > max(relative * item.rms, ROUNDING * sizes[item.segment, item.kind, item.unit])
    ]
    return Difference(
        (one.side.name, two.side.name),
        held,
        departures,
        sorted(moved, key=lambda item: -(math.inf if item.sigmas is None else item.sigmas)),
        sorted(apart, key=lambda item: -item.rms_difference / max(item.rms, 1e-300)),
        [*alone, *lonely],
        {"cells": cells, "figures": len(figures), "signals": len(signals)},
    )


def _narrowed(loaded: Loaded) -> Tables:
    """The error tables of a side; those of one model stand under the name `model`, so
    that two different ones are partners.
    """
    model = loaded.side.model
    if model is None:
        return loaded.tables
    return {use: {"model": table[model]} for use, table in loaded.tables.items() if model in table}


def _tolerances(one: Loaded, two: Loaded, old: Tables, new: Tables) -> dict[str, golden.Tolerance]:
    """Those of the golden folder, if one of the sides is one; else the default ones."""
    for item in (one, two):
        if item.tolerances is not None and (item.tolerances / golden.TOLERANCES).is_file():
            return golden.read_tolerances(
                item.tolerances / golden.TOLERANCES, golden.columns_of(old, new)
            )
    with resources.as_file(
        resources.files("auvid.pipeline.commands.regress") / "default_tolerances.yaml"
    ) as path:
        known = golden.read_tolerances(path, (*golden.FIXED[1:], *AXES))
    return {name: known.get(name, known["ratio"]) for name in golden.columns_of(old, new)}


def lines(changed: Difference) -> list[str]:
    """The difference as a page of text: first what has no partner, then error tables,
    figures and signals, the largest change first.
    """
    first, second = changed.names
    found = [f"no partner: {line}" for line in _short(changed.alone)]
    found += [
        f"no partner: {item.use}{f', {item.model}' if item.model else ''}"
        for item in changed.departures
        if item.kind != "changed"
    ]
    for title, heads, rows in _tables(changed):
        if rows:
            found += ["", title, *_aligned([heads, *_cut(rows)])]
            found += [f"... and {len(rows) - SHOWN} more"] if len(rows) > SHOWN else []
    compared = ", ".join(f"{count} {name}" for name, count in changed.compared.items())
    verdict = "equal within tolerance" if changed.equal else "different"
    return [*found, "", f"{first} against {second}: {verdict} ({compared} compared)"]


def _tables(changed: Difference) -> list[tuple[str, Sequence[str], Sequence[Sequence[str]]]]:
    cells = [item for item in changed.departures if item.kind == "changed"]
    errors = [
        (
            item.use,
            str(item.model),
            item.axis,
            item.figure,
            _n(item.old),
            _n(item.new),
            _percent(item.old, item.new),
        )
        for item in cells
    ]
    figures = [
        (
            item.of,
            item.name,
            _pm(item.old, item.old_error),
            _pm(item.new, item.new_error),
            _n(item.sigmas, ".1f"),
            _verdicts(item),
            item.unit,
        )
        for item in changed.figures
    ]
    signals = [
        (
            item.segment,
            item.kind,
            item.name,
            f"{item.rms:.4g}",
            f"{item.rms_difference:.3g}",
            f"{item.largest:.3g}",
            f"{item.at_s:.2f}",
            item.unit,
        )
        for item in changed.signals
    ]
    return [
        ("error tables", ("use", "model", "axis", "figure", "first", "second", "change"), errors),
        (
            "coefficients and figures",
            ("of", "name", "first", "second", "std errors", "verdict", "unit"),
            figures,
        ),
        (
            "signals",
            ("segment", "kind", "signal", "RMS", "RMS of difference", "largest", "at s", "unit"),
            signals,
        ),
    ]


def _draw(
    one: Side,
    two: Side,
    found: Sequence[Pair],
    changed: Difference,
    save: Path | None,
    picture: Path | None,
    *,
    quiet: bool,
) -> None:
    from auvid.stages.report.difference.recording import record_difference

    words = _markdown(changed)
    for path, suffix, option in ((save, ".rrd", "--save"), (picture, ".png", "--screenshot")):
        if path is None:
            continue
        inspection.wants(path, suffix, option)
        content = record_difference(one, two, found, words, preview=path is picture)
        write_atomically(path, content if path is save else inspection.photograph(content))
        if not quiet:
            print(f"written: {path_from_here(path.resolve())}")


def _markdown(changed: Difference) -> str:
    verdict = "equal within tolerance" if changed.equal else "different"
    found = [f"# {changed.names[0]} against {changed.names[1]}: {verdict}", ""]
    found += [f"- no partner: {line}" for line in _short(changed.alone)]
    for title, heads, rows in _tables(changed):
        found += [
            "",
            f"## {title.capitalize()}",
            "",
            *(table_lines(heads, _cut(rows)) if rows else ["All hold."]),
        ]
        found += [f"... and {len(rows) - SHOWN} more"] if len(rows) > SHOWN else []
    return "\n".join(found)


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[place]) for row in rows) for place in range(len(rows[0]))]
    return [
        "  "
        + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def _cut(rows: Sequence[Sequence[str]]) -> Sequence[Sequence[str]]:
    return rows[:SHOWN]


def _short(found: Sequence[str]) -> list[str]:
    return [*found[:SHOWN], *([f"and {len(found) - SHOWN} more"] if len(found) > SHOWN else [])]


def _n(value: float | None, form: str = ".6g") -> str:
    return "-" if value is None else f"{value:{form}}"


def _pm(value: float | None, error: float | None) -> str:
    return _n(value, ".5g") + (
        "" if value is None or error is None else f" ± {NORMAL_95 * error:.2g}"
    )


def _percent(old: float | None, new: float | None) -> str:
    return "" if not old or new is None else f"{100 * (new / old - 1):+.3g} %"


def _verdicts(item: FigureChange) -> str:
    return (
        item.new_verdict
        if item.old_verdict == item.new_verdict
        else f"{item.old_verdict} -> {item.new_verdict}"
    )
