"""`auvid score`: published sets and other models on the dive of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import isnan
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import DataError, UsageError, nearest
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.regression.error_measures import TOTAL
from auvid.pipeline.campaigns.vehicle_files import load_published, shelf_files
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.run.staleness import stale_words
from auvid.pipeline.execution.runner import Place
from auvid.pipeline.graph import ONCE
from auvid.pipeline.output import answer, note
from auvid.pipeline.store.model_files import read_model
from auvid.pipeline.terminal import table
from auvid.stages.number_format import significant
from auvid.stages.page.first_screen import AXIS_WORDS
from auvid.stages.score_shelf import (
    RATIOS,
    STAGE,
    Inputs,
    PublishedSet,
    judge,
    nearest_set,
    worse_than_nothing,
)

SHELF = "shelf"


@dataclass(frozen=True)
class Scores:
    """A row per set and use, and name -> why of sets that cannot be judged."""

    rows: list[dict[str, Any]]
    skipped: dict[str, str]


def score(campaign: str, others: Sequence[str]) -> Scores:
    """Return scores of what `others` names, and of the run's own model.

    others: `shelf` for all published sets, names of them (with * for any letters), paths
    of vehicle files (.yaml) or model files (.json). Raises `PipelineError` for what is
    none of these and for a campaign that has not run.
    """
    if Path(campaign).suffix == ".json" or campaign in shelf_files():
        raise UsageError(
            "a model is judged on the dive of a run: name the run's campaign first",
            value=campaign,
            remedy=f"auvid score CAMPAIGN --with {campaign}",
        )
    run = open_run(campaign)
    if STAGE.name not in (stage.name for stage in run.graph.stages):
        raise UsageError(
            "this kind of campaign identifies no model of forces",
            value=run.campaign.document["kind"],
            allowed="identification, twin",
        )
    if stale := stale_words(campaign, until="validate"):
        note(f"WARNING: scores are on an earlier run: {stale}")
    sets, skipped = sets_named(others, run.campaign.vehicle)
    task = run.task(run.graph.stage(STAGE.name), Place(ONCE))
    inputs = Inputs(**{name: source.load() for name, source in task.sources.items()})
    return Scores(judge(sets, inputs, run.params[STAGE.name]), skipped)


def sets_named(
    others: Sequence[str], own: Vehicle
) -> tuple[dict[str, PublishedSet], dict[str, str]]:
    """Return the sets that `others` of `score` names, on the user's actuators.

    With them those of `shelf` and of patterns that cannot be judged on this vehicle, and
    why; one that is named raises `DataError`.
    """
    shipped = shelf_files()
    sets: dict[str, PublishedSet] = {}
    skipped: dict[str, str] = {}
    for name in others:
        path = Path(name).expanduser()
        if path.suffix == ".json":
            # Every run names its files by model, so a second one keeps its path.
            sets[path.stem if path.stem not in sets else name] = PublishedSet.of_file(
                read_model(path), own
            )
            continue
        pattern = "*" if name == SHELF else name
        vehicles = {key: file for key, file in shipped.items() if fnmatchcase(key, pattern)}
        if path.suffix == ".yaml":
            vehicles = {path.stem: path}
        if not vehicles:
            raise UsageError(
                "not on the shelf",
                value=name,
                allowed=[SHELF, *shipped],
                remedy=nearest(name, shipped) or "Name a vehicle file (.yaml) or a model (.json).",
            )
        for key, file in vehicles.items():
            try:
                sets[key] = PublishedSet.of(load_published(file), own)
            except DataError as fault:
                if key == name or path.suffix:
                    raise
                skipped[key] = fault.message
    return sets, skipped


def print_score(campaign: str, others: Sequence[str]) -> None:
    """Print `score` as text, the nearest set first."""
    scores = score(campaign, others)
    rows = scores.rows
    for name, why in scores.skipped.items():
        note(f"not judged: {name}: {why}")
    best = nearest_set(rows)
    answer(
        {
            "campaign": campaign,
            "nearest": best and best["set"],
            "sets": rows,
            "not_judged": scores.skipped,
        }
    )
    if best is None:
        return
    judged = sorted((row for row in rows if row["use"] == best["use"]), key=_total)
    heads = ("set", *AXIS_WORDS.values(), "total", "u", "v", "w", "r")
    table(heads, [_cells(row) for row in judged], title=f"J/J0 on {best['use']}, and free runs")
    print("Above 1: worse than no force. u v w [m/s], r [rad/s]: RMS error of free runs.")
    print(f"Nearest: {best['title']}.")
    if axes := worse_than_nothing(rows):
        print(f"Worse than no model in every set: {', '.join(AXIS_WORDS[axis] for axis in axes)}.")


def _error(value: float) -> str:
    """Return an error as printed; without one every free run was lost."""
    return "lost" if isnan(value) else significant(value, 2)


def _total(row: Mapping[str, Any]) -> float:
    return float(row["ratio"])


def _cells(row: Mapping[str, Any]) -> list[str]:
    ratios = [significant(row[RATIOS[axis]], 2) for axis in (*AXIS_WORDS, TOTAL)]
    names = ("u_rms_m_s", "v_rms_m_s", "w_rms_m_s", "r_rms_rad_s")
    errors = [_error(row[name]) if row["starts"] else "" for name in names]
    return [row["set"], *ratios, *errors]
