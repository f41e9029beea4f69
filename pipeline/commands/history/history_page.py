"""`auvid history`: earlier runs of a campaign, and the report compared with one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import DataError
from auvid.pipeline.commands.history.run_history import (
    HELD_OUT,
    Entry,
    best,
    changes,
    damaged,
    entry_of,
    judged,
    read,
)
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.execution.runner import Place, Run
from auvid.pipeline.graph import ONCE
from auvid.pipeline.output import answer, note
from auvid.pipeline.store.atomic_files import write_atomically, write_output
from auvid.pipeline.terminal import path_from_here, plain, table
from auvid.stages import report
from auvid.stages.number_format import fit_in_percent, fixed, significant, with_unit
from auvid.stages.presentation import Block, section, text
from auvid.stages.presentation import table as table_block

COMPARED = "compared.html"
ORDER = 2


def show(campaign: str, *, number: int | None, csv: Path | None = None) -> None:
    """Print the list of runs, or one in full; or write them as a table."""
    run = open_run(campaign)
    for path in damaged(run.folder):
        note(f"damaged and left out: {path_from_here(path)}")
    entries = read(run.folder) if number is None else [entry_of(run, number)]
    answer({"campaign": run.campaign.name, "runs": [asdict(entry) for entry in entries]})
    if csv is not None:
        write_output(csv, to_csv(entries))
        print(f"written: {path_from_here(csv.resolve())}")
    elif number is not None:
        _print_entry(entries[0])
    elif not entries:
        print(f"no run of {run.campaign.name} has been finished yet: auvid run {run.campaign.name}")
    else:
        _print_list(entries)


def to_csv(entries: Sequence[Entry]) -> bytes:
    """Return a row per run and a column per parameter and figure, as CSV.

    A field is empty where a run has none.

    Columns are dotted paths: `parameters.fuse.cutoff_hz`.
    """
    import pandas as pd

    table = pd.json_normalize([asdict(entry) for entry in entries])
    return table.to_csv(index=False).encode()


def _print_list(entries: Sequence[Entry]) -> None:
    models = any(best(entry) for entry in entries)
    columns = ("model to take", "training", "validation") if models else ("values determined",)
    rows = []
    for before, entry in zip((None, *entries), entries, strict=False):
        model, determined = best(entry), judged(entry)
        if model is not None:
            figures: tuple[str, ...] = (model[0], *(fixed(ratio, 3) for ratio in model[1:]))
        elif models:
            figures = ("", "", "")
        elif determined[1]:
            figures = ("{} of {}".format(*determined),)
        else:
            percents = [
                f"{name.removeprefix(f'{HELD_OUT}: ')} {fit_in_percent(item['value'])}"
                for name, item in entry.figures.items()
                if item.get("of") == HELD_OUT
            ]
            figures = (
                f"held out: {', '.join(percents)}" if percents else f"{len(entry.figures)} in all",
            )
        changed = "; ".join(changes(before, entry))
        rows.append((entry.number, entry.finished_utc, *figures, changed))
    table(("run", "finished (UTC)", *columns, "changed since the run before"), rows)


def _print_entry(entry: Entry) -> None:
    print(f"run {entry.number}, finished {entry.finished_utc} UTC")
    for stage, params in entry.parameters.items():
        for name, value in params.items():
            print(plain(f"  {stage}.{name}: {json.dumps(value, ensure_ascii=False)}"))
    for use, models in entry.error_tables.items():
        print(f"\n{use}")
        print(golden.to_csv(models).decode(), end="")
    for name, item in entry.figures.items():
        value = significant(item["value"], 6, empty="not determined")
        verdict = f" ({item['verdict']})" if item["verdict"] else ""
        print(plain(f"{name}: {with_unit(value, item['unit'])}{verdict}"))


def _figure_row(name: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> list[Any]:
    """Return a row of figures; the change in percent where both are known."""
    change = (
        100.0 * (float(new["value"]) / float(old["value"]) - 1.0)
        if old["value"] and new["value"] is not None
        else None
    )
    return [name, old["value"], new["value"], change, new["unit"]]


def write_compared(run: Run, number: int | None) -> Path:
    """Write the report with a section that compares it with an earlier run.

    That is the one before the last unless a number is given.
    Raises `PipelineError` where stages have not been run, or there is no earlier run.
    """
    entries = read(run.folder)
    if number is None and len(entries) < 2:
        remedy = "Every finished run that changes anything is kept; there has been one or none."
        raise DataError(
            "there is no earlier run to compare with", value=run.campaign.name, remedy=remedy
        )
    old = entries[-2] if number is None else entry_of(run, number)
    task = run.task(run.graph.stage("report"), Place(ONCE))
    if not run.is_fresh(task):
        note(f"the report is not up to date: auvid run {run.campaign.name}")
    inputs = report.Inputs(**{name: source.load() for name, source in task.sources.items()})
    content = report.collect(inputs, {"history": comparison(old, entries[-1])})
    path = run.folder / COMPARED
    write_atomically(path, report.page(inputs, content))
    return path


def comparison(old: Entry, new: Entry) -> dict[str, Any]:
    """Return the section: changed settings, and every figure of both runs."""
    blocks: list[Block] = [text("; ".join(changes(old, new)))]
    for use in [use for use in new.error_tables if use in old.error_tables]:
        rows = []
        for model in dict.fromkeys((*old.error_tables[use], *new.error_tables[use])):
            before, now = old.error_tables[use].get(model, {}), new.error_tables[use].get(model, {})
            ratios = [row.get("ratio") for row in (before, now)]
            change = (
                None
                if None in ratios or not ratios[0]
                else 100.0 * (float(ratios[1] or 0.0) / float(ratios[0]) - 1.0)
            )
            rows.append(
                [
                    model,
                    before.get("n_bar"),
                    now.get("n_bar"),
                    before.get("J"),
                    now.get("J"),
                    *ratios,
                    change,
                ]
            )
        heads: list[str | tuple[str, str]] = [
            "model",
            "terms then",
            "terms now",
            ("J then", "mixed"),
            ("J now", "mixed"),
        ]
        heads += ["J/J0 then", "J/J0 now", ("change", "%")]
        blocks.append(table_block(use.capitalize(), heads, rows))
    names = [name for name in new.figures if name in old.figures]
    if names:
        rows = [_figure_row(name, old.figures[name], new.figures[name]) for name in names]
        blocks.append(
            table_block("Figures", ["figure", "then", "now", ("change", "%"), "unit"], rows)
        )
    return section(
        f"Against run {old.number} of {old.finished_utc} UTC",
        blocks,
        order=ORDER,
        look_for="What the change of a parameter did.",
    )
