"""`auvid report A B C`: several runs on one page, of campaigns or of one's history."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES
from auvid.hydro.constants import NORMAL_95
from auvid.pipeline.commands.history.run_history import Entry, entry_now, entry_of, read
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.stages.base import Document
from auvid.stages.model_use import listed
from auvid.stages.number_format import estimate, significant, term, true_minus
from auvid.stages.page.first_screen import AXIS_WORDS, Alert, Summary, anchor
from auvid.stages.page.html import render
from auvid.stages.page.pictures.whisker_picture import WhiskerBox, Whiskers, whisker_picture
from auvid.stages.presentation import section, table, text

HISTORY_PAGE = "history.html"
MOST_RUNS = 12
"""Columns of one page; of a longer history the last ones."""
MOST_BOXES = 36
FEWEST = 2


@dataclass(frozen=True)
class RunColumn:
    """A run on the page: its name, and what it holds; None if it has not been run."""

    name: str
    entry: Entry | None

    @property
    def model(self) -> str:
        """Name of the recommended model, empty without one."""
        return "" if self.entry is None else str(self.entry.recommended.get("model", ""))


def write_runs_page(names: Sequence[str], *, whole_history: bool = False) -> Path:
    """Write the page of several runs and return its path.

    `names`: campaigns, or `CAMPAIGN@N` for run N of a history. Raises `PipelineError` for
    a name that is no campaign, `DataError` where fewer than two have been run.
    """
    if whole_history:
        run = open_run(names[0])
        every = read(run.folder)
        columns = [RunColumn(f"run {entry.number}", entry) for entry in every[-MOST_RUNS:]]
        title = f"Runs of {run.campaign.name}"
        left_out = f"the last {MOST_RUNS} of {len(every)} runs" if len(every) > MOST_RUNS else ""
        path = run.folder / HISTORY_PAGE
    else:
        columns = [_column(name) for name in dict.fromkeys(names)]
        title, left_out = listed([column.name for column in columns]), ""
        run = open_run(names[0].partition("@")[0])
        words = "+".join(re.sub(r"[^\w.@-]", "_", column.name) for column in columns)
        path = run.folder.parent / f"{words[:120]}.html"
    if sum(column.entry is not None for column in columns) < FEWEST:
        lacking = [column.name for column in columns if column.entry is None]
        words = f": no finished run of {', '.join(lacking)}" if lacking else ""
        raise DataError(
            f"fewer than two runs to set side by side{words}",
            remedy="Run them first: auvid run CAMPAIGN. Of one campaign, CAMPAIGN@N is run N.",
        )
    write_atomically(path, runs_page(title, left_out, columns))
    return path


def _column(name: str) -> RunColumn:
    campaign, _, number = name.partition("@")
    run = open_run(campaign)
    if number:
        if not number.isdigit():
            raise DataError(
                "no number of a run", value=name, allowed="CAMPAIGN or CAMPAIGN@N of auvid history"
            )
        return RunColumn(f"{run.campaign.name}@{number}", entry_of(run, int(number)))
    return RunColumn(run.campaign.name, _now(run))


def _now(run: Run) -> Entry | None:
    """Return the results as they stand, None without any."""
    entry = entry_now(run)
    return entry if entry.holds_results else None


def runs_page(title: str, left_out: str, columns: Sequence[RunColumn]) -> bytes:
    """Return the page as HTML."""
    there = [column for column in columns if column.entry is not None]
    boxes = _boxes(there)
    names = [column.name for column in there]
    note = "95 % intervals: thick by noise, thin with the assumed figures of the vehicle"
    if len(boxes) > MOST_BOXES:
        note += f"; the first {MOST_BOXES} of {len(boxes)}, all stand in the table"
    pictures = (
        (whisker_picture("Coefficients and figures", note, names, boxes[:MOST_BOXES]),)
        if boxes
        else ()
    )
    documents = {
        "runs": _runs_section(columns, order=1),
        "parameters": _parameters_section(there, order=2),
        **_optional("errors", _errors_section(there, order=3)),
        **_optional("coefficients", _values_section(there, _coefficients, "Coefficients", 4)),
        **_optional("free_runs", _free_run_section(there, order=5)),
        **_optional("figures", _values_section(there, _figures, "Figures", 6)),
    }
    return render(title, left_out, "", _summary(there), documents, pictures=pictures)


def _optional(name: str, document: Document | None) -> dict[str, Document]:
    return {} if document is None else {name: document}


def _entry(column: RunColumn) -> Entry:
    assert column.entry is not None  # columns without results are left out before
    return column.entry


def _judged_on(entry: Entry) -> str:
    return "validation" if entry.error_tables.get("validation") else "training"


def _ratio(column: RunColumn) -> float | None:
    """Return J/J0 of the recommended model on the legs that it is judged on."""
    entry = _entry(column)
    row = entry.error_tables.get(_judged_on(entry), {}).get(column.model, {})
    return row.get("ratio")


def _summary(columns: Sequence[RunColumn]) -> Summary:
    """Return the first screen, with the run of the least error where there is one."""
    ratios = {column.name: ratio for column in columns if (ratio := _ratio(column)) is not None}
    doubts = [
        Alert(f"{column.name}: {words}", anchor("runs"), "poor" if "cannot" in words else "fair")
        for column in columns[1:]
        if (words := " ".join(_departures(columns[0], column)))
    ]
    explanation = []
    if len(ratios) >= FEWEST:
        best = min(ratios, key=ratios.__getitem__)
        least, most = (f"{edge(ratios.values()):.2f}" for edge in (min, max))
        explanation = [
            f"J/J0 of the recommended models: {least} in all of them."
            if least == most
            else f"Least J/J0 of the recommended models: {least} in {best}."
        ]
        if len({json.dumps(_entry(c).data, sort_keys=True) for c in columns}) > 1:
            explanation.append("Logs differ, so these are errors on other dives.")
    return Summary(
        level="fair" if doubts else "good",
        headline=f"{len(columns)} runs side by side{_agreement(columns)}",
        explanation=" ".join(explanation),
        recommended=None,
        judged_on="validation",
        facts=(),
        models=(),
        identified=(),
        missing=tuple(doubts),
        warnings=(),
    )


def _agreement(columns: Sequence[RunColumn]) -> str:
    """Return whether figures that two runs or more have differ by more than noise."""
    boxes = [[item for item in box.runs if item is not None] for box in _boxes(columns)]
    shared = [runs for runs in boxes if len(runs) >= FEWEST]
    differing = sum(any(_differ(*pair) for pair in combinations(runs, 2)) for runs in shared)
    if not shared:
        return ""
    figures = "the one figure that they share" if len(shared) == 1 else f"{len(shared)} figures"
    if not differing:
        return f": {figures} agree{'s' * (len(shared) == 1)} within noise"
    return (
        f": {differing} of {len(shared)} figure{'s' * (len(shared) > 1)} differ by more than noise"
    )


def _differ(one: Whiskers, two: Whiskers) -> bool:
    """Return whether two values differ by more than their 95 % intervals by noise."""
    noises = [run.half if run.noise is None else run.noise for run in (one, two)]
    return abs(one.value - two.value) > math.hypot(*noises)


def _departures(first: RunColumn, column: RunColumn) -> list[str]:
    """Return why a run cannot be compared with the first one, or with caution only."""
    one, two = _entry(first), _entry(column)
    if bool(one.error_tables) != bool(two.error_tables):
        what = "has none" if one.error_tables else "alone has them"
        return [f"errors of forces cannot be compared with {first.name}: it {what}."]
    words = []
    logs = [{k: v for k, v in e.data.items() if k != "vehicle"} for e in (one, two)]
    vehicles = [entry.recommended.get("vehicle") for entry in (one, two)]
    if None not in vehicles and vehicles[0] != vehicles[1]:
        words.append(
            f"cannot be compared with {first.name}: another vehicle, {vehicles[1]} and not"
            f" {vehicles[0]}."
        )
    elif one.data.get("vehicle") != two.data.get("vehicle"):
        words.append("other figures in its vehicle file: coefficients rest on them.")
    if sorted(logs[0].values()) != sorted(logs[1].values()):
        words.append("other logs: its errors are those of other dives.")
    if two.error_tables and not two.recommended:
        words.append(
            "no recommended model in its entry, so it has no coefficients here: none was"
            " recommended, or an earlier version of auvid kept none."
        )
    return words


def _runs_section(columns: Sequence[RunColumn], *, order: int) -> Document:
    rows: list[list[Any]] = []
    first = next(column for column in columns if column.entry is not None)
    for column in columns:
        if column.entry is None:
            rows.append([column.name, None, None, None, f"no results: auvid run {column.name}"])
            continue
        entry = column.entry
        words = [] if column is first else _departures(first, column)
        rows.append(
            [
                column.name,
                entry.finished_utc if entry.number else "as it stands",
                entry.recommended.get("title"),
                _ratio(column),
                " ".join(words) or "compared",
            ]
        )
    heads = ["run", "finished (UTC)", "recommended model", "J/J0", "comparison with the first"]
    return section("Runs", [table("Runs", heads, rows)], order=order)


def _parameters_section(columns: Sequence[RunColumn], *, order: int) -> Document:
    """Return the section of parameters, data, code and packages that differ.

    Of stages that all runs have; the others are those of another kind of campaign.
    """
    stages = set.intersection(*({*_entry(column).parameters} for column in columns))
    sources: list[dict[str, str]] = []
    for column in columns:
        entry = _entry(column)
        values = {
            f"{stage}.{name}": json.dumps(value, ensure_ascii=False)
            for stage, params in entry.parameters.items()
            for name, value in params.items()
            if stage in stages
        }
        values |= {f"data: {name}": value[:8] for name, value in entry.data.items()}
        values |= {
            f"code of {name}": value[:8] for name, value in entry.code.items() if name in stages
        }
        values |= {f"package {name}": value for name, value in entry.packages.items()}
        sources.append(values)
    names = dict.fromkeys(name for values in sources for name in values)
    rows = [
        [name, *(values.get(name, "–") for values in sources)]
        for name in names
        if len({values.get(name) for values in sources}) > 1
    ]
    if not rows:
        return section("Parameters", [text("Nothing that is recorded differs.")], order=order)
    heads = ["parameter", *(column.name for column in columns)]
    note = "Data and code by the first digits of their hash. –: the run has no such parameter."
    return section("Parameters", [table("What differs", heads, rows, note=note)], order=order)


def _errors_section(columns: Sequence[RunColumn], *, order: int) -> Document | None:
    blocks = []
    for use in ("validation", "training"):
        chosen = [column for column in columns if _entry(column).error_tables.get(use)]
        if not chosen:
            continue
        models = dict.fromkeys(name for c in chosen for name in _entry(c).error_tables[use])
        rows = [
            [
                name,
                *(_entry(c).error_tables[use].get(name, {}).get("ratio") for c in chosen),
            ]
            for name in models
        ]
        heads: list[str | tuple[str, str]] = ["model", *(f"J/J0 {c.name}" for c in chosen)]
        blocks.append(table(f"Every model on the {use} legs", heads, rows))
        by_axis = [
            [c.name, _entry(c).recommended["title"], *(row.get(axis) for axis in AXES)]
            for c in chosen
            if c.model and (row := _entry(c).error_tables[use].get(c.model))
        ]
        if by_axis:
            axes = [f"J/J0 {axis} {AXIS_WORDS[axis]}" for axis in AXES]
            title = f"The recommended model by axis on the {use} legs"
            blocks.append(table(title, ["run", "model", *axes], by_axis))
    return section("Error tables", blocks, order=order) if blocks else None


Values = dict[str, tuple[str, Whiskers | None, str]]
"""Name -> unit, value with its interval, and how it is printed."""


def _coefficients(entry: Entry) -> Values:
    """Return the coefficients of the recommended model that the data identify."""
    values: Values = {}
    for key, item in entry.recommended.get("coefficients", {}).items():
        axis, _, name = key.partition(" ")
        label = f"{axis} constant" if name == "constant" else f"{axis}_{term(name)}"
        if item["verdict"] != "identified":
            values[label] = (item["unit"], None, item["verdict"])
            continue
        half = NORMAL_95 * item["with_assumed"]
        whiskers = Whiskers(item["value"], half, NORMAL_95 * item["standard_error"])
        values[label] = (item["unit"], whiskers, true_minus(estimate(item["value"], half)))
    return values


def _figures(entry: Entry) -> Values:
    """Return the figures of a bench or control campaign, headlines where it has any."""
    chosen = {name: item for name, item in entry.figures.items() if item.get("headline")}
    values: Values = {}
    for name, item in (chosen or entry.figures).items():
        if item["value"] is None:
            values[name] = (item["unit"], None, item.get("verdict") or "not determined")
            continue
        error = item.get("standard_error")
        half = NORMAL_95 * error if error else 0.0
        words = estimate(item["value"], half) if half else significant(item["value"], 5)
        whiskers = Whiskers(item["value"], half) if half else None
        values[name] = (item["unit"], whiskers, true_minus(words))
    return values


def _boxes(columns: Sequence[RunColumn]) -> list[WhiskerBox]:
    """Return a box for each coefficient or figure that has an interval in some run."""
    boxes = []
    for source in (_coefficients, _figures):
        values = [source(_entry(column)) for column in columns]
        for name in dict.fromkeys(name for run in values for name in run):
            unit = next(run[name][0] for run in values if name in run)
            runs = tuple(run[name][1] if name in run else None for run in values)
            if any(item is not None for item in runs):
                part, _, quantity = name.rpartition(": ")
                # The quantity first: a narrow box cuts the end of its name.
                boxes.append(WhiskerBox(f"{quantity}, {part}" if part else name, unit, runs))
    return boxes


def _values_section(
    columns: Sequence[RunColumn], source: Callable[[Entry], Values], title: str, order: int
) -> Document | None:
    values = [source(_entry(column)) for column in columns]
    names = list(dict.fromkeys(name for run in values for name in run))
    if not names:
        return None
    rows: list[list[Any]] = []
    for name in names:
        unit = next(run[name][0] for run in values if name in run)
        rows.append([name, unit, *(run[name][2] if name in run else None for run in values)])
    heads = ["name", "unit", *(column.name for column in columns)]
    note = "± is half of the 95 % interval, by noise and by assumed figures where known."
    return section(title, [table(title, heads, rows, note=note)], order=order)


def _free_run_section(columns: Sequence[RunColumn], *, order: int) -> Document | None:
    rows = []
    for column in columns:
        chosen = _entry(column).recommended
        if not chosen.get("free_runs"):
            continue
        lost = f"{chosen['free_runs_lost']} of {chosen['free_runs']}"
        ratios = [chosen["free_run"][axis] for axis in AXES]
        rows.append([column.name, chosen["title"], chosen["free_run_horizon_s"], lost, *ratios])
    if not rows:
        return None
    heads: list[str | tuple[str, str]] = ["run", "model", ("after", "s"), "lost"]
    heads += [f"{axis} {AXIS_WORDS[axis]}" for axis in AXES]
    note = (
        "RMS error of free runs over that of the better guess of no change and no motion: below 1"
        " the model helps."
    )
    return section("Free runs", [table("Free runs", heads, rows, note=note)], order=order)
