"""The history of a campaign: a file per finished run, with parameters, tables, figures.

A run is entered when it made the report again and anything that counts has changed
since the last entry. The last 200 entries are kept.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvid.data_schemas.errors import DataError, UsageError
from auvid.hydro.arrays import AXES
from auvid.hydro.identification.regression.assumed_figures import total_error
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.commands.regress.golden_tables import Tables
from auvid.pipeline.store.artefacts import to_json, to_plain
from auvid.pipeline.store.atomic_files import regular_text, write_atomically
from auvid.pipeline.store.file_hashes import hash_value
from auvid.pipeline.store.fingerprints import as_document
from auvid.stages.page.first_screen import AXIS_WORDS
from auvid.stages.report.summary.figure_summary import DETERMINED

if TYPE_CHECKING:
    from auvid.data_schemas.records.models import ModelCard
    from auvid.pipeline.execution.runner import Run

FOLDER = "history"
FORMAT, FORMATS = 2, (1, 2)
"""Entries of format 2 hold the hash of their content."""
KEPT = 200
HELD_OUT = "fit of the rate on what was held out"
KEPT_OF_FIGURES = ("value", "unit", "standard_error", "verdict", "headline")


@dataclass(frozen=True)
class Entry:
    """One finished run.

    `error_tables`: use -> model -> row, as golden tables; `figures`: of, name -> value
    and standard error.
    """

    number: int
    finished_utc: str
    parameters: Mapping[str, Mapping[str, Any]]
    code: Mapping[str, str]
    data: Mapping[str, str]
    packages: Mapping[str, str]
    error_tables: Tables
    figures: Mapping[str, Mapping[str, Any]]
    recommended: Mapping[str, Any] = field(default_factory=dict)
    """The recommended model: name, title, coefficients and free runs; empty for none, and
    for entries that were written before it was kept.
    """

    @property
    def holds_results(self) -> bool:
        """Return whether the run came as far as error tables, figures or a model."""
        return bool(self.error_tables or self.figures or self.recommended)

    @property
    def content(self) -> dict[str, Any]:
        """Return all but number and time."""
        return {
            name: value
            for name, value in asdict(self).items()
            if name not in ("number", "finished_utc")
        }


def entry_now(run: Run) -> Entry:
    """Return what an entry of the results as they stand would hold, with number 0."""
    return _entry(run, 0)


def add_entry(run: Run) -> None:
    """Enter a run that has just finished into the history.

    Nothing is written for a run without any results, or equal to the last one. A
    damaged entry keeps its number.
    """
    folder = run.folder / FOLDER
    entries = read(run.folder)
    numbers = [int(path.stem) for path in _files(run.folder) if path.stem.isdigit()]
    entry = _entry(run, max(numbers, default=0) + 1)
    if not entry.holds_results or (entries and entries[-1].content == entry.content):
        return
    document = {"format": FORMAT, "content": hash_value(asdict(entry)), **asdict(entry)}
    write_atomically(folder / f"{entry.number:06d}.json", (to_json(document) + "\n").encode())
    for path in _files(run.folder)[:-KEPT]:
        path.unlink(missing_ok=True)


def _files(folder: Path) -> list[Path]:
    """Return the files of the entries of a run folder, oldest first."""
    return sorted((folder / FOLDER).glob("*.json"))


def read(folder: Path) -> list[Entry]:
    """Return the entries of a run folder, oldest first; `damaged` ones are left out."""
    return [entry for path in _files(folder) if (entry := _read(path)) is not None]


def damaged(folder: Path) -> list[Path]:
    """Return the files of entries that are not as they were written."""
    return [path for path in _files(folder) if _read(path) is None]


def _read(path: Path) -> Entry | None:
    try:
        document = json.loads(regular_text(path))
        form, content = document.pop("format"), document.pop("content", None)
        if form not in FORMATS or (form == FORMAT and content != hash_value(document)):
            return None
        return Entry(**document)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


def _entry(run: Run, number: int) -> Entry:
    provenance = run.provenance()
    tables: dict[str, Any] = {}
    for document in run.documents("error_table"):
        tables = golden.tables_of(document.to_pylist())
    figures = {
        f"{document['title']}: {row['quantity']}": {
            "of": document["title"],
            **{name: row.get(name) for name in KEPT_OF_FIGURES},
        }
        for document in run.documents("results")
        for row in document["rows"]
    }
    for card in run.documents("model_card"):
        figures |= _held_out(card)
    data = {
        f"{log} {item['name']}": item["content"]
        for log, items in provenance["logs"].items()
        for item in items
    }
    return Entry(
        number=number,
        finished_utc=time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime()),
        parameters=to_plain({name: as_document(params) for name, params in run.params.items()}),
        code={name: entry["code"] for name, entry in provenance["stages"].items()},
        data={**data, "vehicle": provenance["vehicle"]},
        packages=dict(provenance["packages"]),
        error_tables=to_plain(tables),
        figures=to_plain(figures),
        recommended=to_plain(_recommended(run)),
    )


def _held_out(card: ModelCard) -> dict[str, dict[str, Any]]:
    """Return how far a model of some axes predicts each on what was held out."""
    if card.partial is None:
        return {}
    return {
        f"{HELD_OUT}: {AXIS_WORDS[axis]}": {
            "of": HELD_OUT,
            **dict.fromkeys(KEPT_OF_FIGURES),
            "value": item.held_out_percent,
            "unit": "%",
        }
        for axis, item in card.partial.axes.items()
        if item.held_out_percent is not None
    }


def _recommended(run: Run) -> dict[str, Any]:
    """Return the recommended model as an entry keeps it; empty without one."""
    ranking = next(run.documents("ranking"), None)
    if ranking is None or ranking.choice is None:
        return {}
    card = next(card for card in run.documents("model_card") if card.name == ranking.choice)
    merit = next(model for model in ranking.models if model.name == ranking.choice)
    return {
        "model": card.name,
        "title": card.title,
        "vehicle": card.vehicle,
        "coefficients": {
            f"{axis} {item.term}": {
                "unit": item.unit,
                "value": item.value,
                "standard_error": item.standard_error,
                "with_assumed": total_error(item.standard_error, item.assumed_shifts),
                "verdict": item.verdict,
            }
            for axis, part in card.axes.items()
            for item in part.terms
            if item.value is not None and item.standard_error
        },
        "free_run": {axis: merit.axes[axis].free_run for axis in AXES},
        "free_run_horizon_s": ranking.horizon_s,
        "free_runs": merit.runs,
        "free_runs_lost": merit.lost,
    }


def entry_of(run: Run, number: int) -> Entry:
    """Return an entry by its number. Raises `UsageError` with the numbers there are."""
    entries = {entry.number: entry for entry in read(run.folder)}
    if number not in entries:
        if (lost := run.folder / FOLDER / f"{number:06d}.json") in damaged(run.folder):
            raise DataError("the entry of this run is damaged", file=lost)
        allowed = f"{min(entries)} to {max(entries)}" if entries else "none yet"
        raise UsageError(
            "no such run in the history", file=run.folder / FOLDER, value=number, allowed=allowed
        )
    return entries[number]


def results_of(entry: Entry) -> dict[str, dict[str, Any]]:
    """Return the figures of an entry as documents of schema `results`, by title."""
    documents: dict[str, dict[str, Any]] = {}
    for name, item in entry.figures.items():
        title = str(item.get("of") or name.partition(": ")[0])
        row = {"quantity": name.removeprefix(f"{title}: "), **item}
        documents.setdefault(title, {"title": title, "rows": []})["rows"].append(row)
    return documents


def judged(entry: Entry) -> tuple[int, int]:
    """Count the headline figures that are determined or within bounds, and all."""
    with_verdict = [item for item in entry.figures.values() if item.get("verdict")]
    chosen = [item for item in with_verdict if item.get("headline")] or with_verdict
    return sum(item["verdict"] in DETERMINED and item["value"] is not None for item in chosen), len(
        chosen
    )


def changes(old: Entry | None, new: Entry) -> list[str]:
    """Return what changed since the previous run: parameters, data, code, packages."""
    if old is None:
        return ["first run"]
    rows = []
    for stage, params in new.parameters.items():
        before = old.parameters.get(stage, {})
        rows += [
            f"{stage}.{name}: {_word(before.get(name))} -> {_word(value)}"
            for name, value in params.items()
            if before.get(name) != value
        ]
    for words, one, two in (
        ("data", old.data, new.data),
        ("code", old.code, new.code),
        ("packages", old.packages, new.packages),
    ):
        names = [name for name in dict.fromkeys((*one, *two)) if one.get(name) != two.get(name)]
        if words == "code" and len(names) == len({*one, *two}) > 1:
            names = ["all stages"]
        if names:
            rows.append(f"{words}: {', '.join(names)}")
    return rows or ["nothing that is recorded"]


def _word(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def best(entry: Entry) -> tuple[str, float | None, float | None] | None:
    """Return the recommended model, and its J/J0 of training and of validation.

    Without a recommended one, that of the smallest J on validation; training counts where
    there is none.
    """
    models = entry.error_tables.get("validation") or entry.error_tables.get("training")
    if not models:
        return None
    errors = {name: math.inf if (j := row["J"]) is None else j for name, row in models.items()}
    name = str(entry.recommended.get("model"))
    if name not in models:
        name = min(errors, key=lambda model: errors[model])
    training, validation = (
        entry.error_tables.get(use, {}).get(name, {}).get("ratio")
        for use in ("training", "validation")
    )
    return name, training, validation
