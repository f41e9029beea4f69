"""`auvid diff`: what changed between two runs, golden tables, variants or models."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES
from auvid.pipeline.commands.look.diff.diff_operands import RunData, common, read_operand
from auvid.pipeline.commands.look.inspect import rerun_viewer as viewer
from auvid.pipeline.commands.look.inspect.inspect_command import check_suffix, photograph
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.commands.regress.golden_tables import Departure, Tables
from auvid.pipeline.output import answer, note
from auvid.pipeline.store.atomic_files import write_output
from auvid.pipeline.terminal import path_from_here, plain, table
from auvid.stages.number_format import fixed, significant
from auvid.stages.reference_check import MOVED, ReferenceCheck, Tolerance, check_rows
from auvid.stages.report.difference.signals import (
    Pair,
    SignalChange,
    coefficient_changes,
    pairs,
    signal_changes,
)
from auvid.stages.report.recording.text import table_lines

MAX_ROWS = 20
RELATIVE = 1e-6
FIGURE_COLUMNS = [name for name in MOVED if "tolerance" not in name]
SIGNAL_LABELS = ("segment", "kind", "RMS", "largest difference", "at s")
SIGNAL_COLUMNS = ("quantity", "measured", "unit")


@dataclass(frozen=True)
class Difference:
    """Changes from the first run to the second, and what only one of them has."""

    names: tuple[str, str]
    departures: list[Departure]
    figures: list[tuple[tuple[str], ReferenceCheck]]
    signals: list[SignalChange]
    unmatched: list[str]
    compared: Mapping[str, int]

    @property
    def equal(self) -> bool:
        """Return whether everything has a partner and equals it within tolerance."""
        return not (self.departures or self.figures or self.signals or self.unmatched)

    @property
    def verdict(self) -> str:
        """Both names and whether they are equal, in words."""
        words = "equal within tolerance" if self.equal else "different"
        return f"{self.names[0]} against {self.names[1]}: {words}"

    @property
    def document(self) -> dict[str, Any]:
        """Return the difference as JSON."""
        return {
            "first": self.names[0],
            "second": self.names[1],
            "equal": self.equal,
            "compared": dict(self.compared),
            "error_tables": [item.document for item in self.departures],
            "figures": [{"of": of, **check.document} for (of,), check in self.figures],
            "signals": [item.document for item in self.signals],
            "no_partner": self.unmatched,
        }

    @property
    def tables(self) -> list[tuple[str, list[str], list[list[str]]]]:
        """Title, columns and rows of every table, the largest change first."""
        signals = [
            (
                (
                    item.segment,
                    item.kind,
                    significant(item.rms),
                    significant(item.largest),
                    fixed(item.at_s, 2),
                ),
                item.check,
            )
            for item in self.signals
        ]
        return [
            ("error tables", *golden.departure_rows(self.departures)),
            ("coefficients and figures", *check_rows(("of",), self.figures, FIGURE_COLUMNS)),
            (
                "signals: RMS of the difference",
                *check_rows(SIGNAL_LABELS, signals, SIGNAL_COLUMNS),
            ),
        ]


def diff(
    first: str,
    second: str,
    *,
    save: Path | None = None,
    picture: Path | None = None,
    relative: float = RELATIVE,
) -> bool:
    """Print changes, write recording or picture, and return whether all is equal."""
    one, two = read_operand(first), read_operand(second)
    partial = [item.side.name for item in (one, two) if item.partial]
    if partial:
        one, two = common(one, two)
    signal_pairs, unmatched = pairs(one.side, two.side)
    changed = difference(one, two, signal_pairs, unmatched, relative)
    if not any(changed.compared.values()) and changed.equal:
        raise DataError(
            "the two hold nothing that could be compared",
            value=f"{first}, {second}",
            remedy="Compare two whole runs.",
        )
    if partial:
        kinds = "error tables and figures" if one.side.results else "error tables"
        note(f"only {kinds} are compared: {partial[0]} holds nothing else")
    print_difference(changed)
    answer({**changed.document, "written": [path for path in (save, picture) if path is not None]})
    for path, suffix, option in ((save, ".rrd", "--save"), (picture, ".png", "--screenshot")):
        if path is None:
            continue
        viewer.require_rerun()
        from auvid.stages.report.difference.recording import record_difference

        check_suffix(path, suffix, option)
        content = record_difference(
            one.side, two.side, signal_pairs, _markdown(changed), preview=path is picture
        )
        write_output(path, content if path is save else photograph(content))
        print(f"written: {path_from_here(path.resolve())}")
    return changed.equal


def difference(
    one: RunData,
    two: RunData,
    signal_pairs: Sequence[Pair],
    unmatched: Sequence[str],
    relative: float,
) -> Difference:
    """Return all changes between two runs, the largest first."""
    figures, only_in_one = coefficient_changes(one.side, two.side, relative)
    signals = signal_changes(list(signal_pairs), relative)
    old, new = (_tables_of_model(item) for item in (one, two))
    departures = golden.compare(old, new, _tolerances(one, two, old, new))[1] if old and new else []
    if bool(old) != bool(new):
        only_in_one = [*only_in_one, f"error tables only in {(one if old else two).side.name}"]
    return Difference(
        names=(one.side.name, two.side.name),
        departures=departures,
        figures=sorted((item for item in figures if not item[1].met), key=_by_standard_errors),
        signals=sorted((item for item in signals if not item.check.met), key=_by_share),
        unmatched=[*unmatched, *only_in_one],
        compared={
            "cells": sum(len(row) for rows in old.values() for row in rows.values()),
            "figures": len(figures),
            "signals": len(signals),
        },
    )


def _by_standard_errors(item: tuple[object, ReferenceCheck]) -> float:
    return -math.inf if item[1].standard_errors is None else -item[1].standard_errors


def _by_share(item: SignalChange) -> float:
    return -(item.check.value or 0.0) / max(item.rms, 1e-300)


def _tables_of_model(data: RunData) -> Tables:
    """Return the error tables of a run; those of one model under the name `model`.

    So two models that are compared are partners in spite of their names.
    """
    model = data.side.model
    if model is None:
        return data.tables
    return {use: {"model": rows[model]} for use, rows in data.tables.items() if model in rows}


def _tolerances(one: RunData, two: RunData, old: Tables, new: Tables) -> dict[str, Tolerance]:
    """Return those of the golden folder, if one operand is one; else the default."""
    for item in (one, two):
        if item.tolerances is not None and (item.tolerances / golden.TOLERANCES).is_file():
            return golden.read_tolerances(
                item.tolerances / golden.TOLERANCES, golden.columns_of(old, new)
            )
    with resources.as_file(
        resources.files("auvid.pipeline.commands.regress") / "default_tolerances.yaml"
    ) as path:
        tolerances = golden.read_tolerances(path, (*golden.FIXED[1:], *AXES))
    return {name: tolerances.get(name, tolerances["ratio"]) for name in golden.columns_of(old, new)}


def print_difference(changed: Difference) -> None:
    """Print what has no partner, then every table, the largest change first."""
    cells = [
        f"{item.use}{f', {item.model}' if item.model else ''}"
        for item in changed.departures
        if item.check is None
    ]
    for line in (*_first_rows(changed.unmatched), *cells):
        print(f"no partner: {plain(line)}")
    for title, columns, rows in changed.tables:
        if rows:
            print()
        table(columns, rows[:MAX_ROWS], title=title, indent=2)
        if len(rows) > MAX_ROWS:
            print(f"... and {len(rows) - MAX_ROWS} more")
    compared = ", ".join(f"{count} {name}" for name, count in changed.compared.items())
    print(plain(f"\n{changed.verdict} ({compared} compared)").strip())


def _markdown(changed: Difference) -> str:
    lines = [f"# {changed.verdict}", ""]
    lines += [f"- no partner: {line}" for line in _first_rows(changed.unmatched)]
    for title, columns, rows in changed.tables:
        lines += ["", f"## {title.capitalize()}", ""]
        lines += table_lines(columns, rows[:MAX_ROWS]) if rows else ["All hold."]
        lines += [f"... and {len(rows) - MAX_ROWS} more"] if len(rows) > MAX_ROWS else []
    return "\n".join(lines)


def _first_rows(lines: Sequence[str]) -> list[str]:
    more = [f"and {len(lines) - MAX_ROWS} more"] if len(lines) > MAX_ROWS else []
    return [*lines[:MAX_ROWS], *more]
