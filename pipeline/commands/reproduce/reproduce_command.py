"""The command `auvid reproduce`: fly plans with a twin, run the chain in several
variants, and hold its errors against published ones.

Each plan is flown and its logs are read once; each variant has a run of its own over
them. All of it lies under runs/CAMPAIGN/reproduce/ and is cached by the same manifests
as a run: only what is stale is made again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from auvid.data_schemas.schemas import schema
from auvid.pipeline.campaigns.campaign import SIMULATE, Campaign, inside
from auvid.pipeline.campaigns.twin import load_twin
from auvid.pipeline.commands.reproduce.variants import (
    FLIGHT,
    PAGE,
    SHARED,
    Setting,
    chain_of,
    open_setting,
    published_tables,
)
from auvid.pipeline.execution.engines import Engine
from auvid.pipeline.execution.lock import locked
from auvid.pipeline.execution.progress import Progress
from auvid.pipeline.execution.runner import InternalFault, Run, StageFault
from auvid.pipeline.execution.task import Outcome, Task, execute
from auvid.pipeline.execution.task_inputs import Artefact, Many, Source, Value, vehicle_source
from auvid.pipeline.graph import WHOLE, Graph, Port
from auvid.pipeline.store.artefacts import load
from auvid.pipeline.store.atomic_files import prune
from auvid.pipeline.store.fingerprints import FileHashes, hash_value, stage_code
from auvid.pipeline.store.manifest import Manifest
from auvid.pipeline.terminal import path_from_here
from auvid.stages import reproduce as reproduction
from auvid.stages.base import make_params, ports

__all__ = ["Reproduced", "open_setting", "print_tables", "reproduce"]


@dataclass(frozen=True)
class Reproduced:
    """Where the page is, how many items had to run, and the tables that were made."""

    page: Path
    count: int
    errors: list[dict[str, Any]]
    checks: list[dict[str, Any]]

    @property
    def missed(self) -> list[dict[str, Any]]:
        """Bounds that are not met and of which nothing says why."""
        return [row for row in self.checks if not row["met"] and not row["known"]]


def reproduce(
    setting: Setting, engine: Engine, progress: Progress, *, force: bool = False
) -> Reproduced:
    """Bring every variant of every plan and the page up to date. Raises `StageFault` or
    `InternalFault` as a run does.
    """
    published = published_tables(setting)
    with locked(setting.folder):
        try:
            runs, count = _runs(setting, KeptOpen(engine), progress, force=force)
        finally:
            engine.close()
        page = setting.folder / PAGE
        made = _page(page, _sources(setting, runs, published), force=force)
    tables = {
        port.name: load(page / port.path(WHOLE), port.schema)
        for port in PAGE_PORTS
        if schema(port.schema).kind == "table"
    }
    return Reproduced(
        page / "page.html", count + made, tables["errors"].to_pylist(), tables["checks"].to_pylist()
    )


def _runs(
    setting: Setting, engine: Engine, progress: Progress, *, force: bool
) -> tuple[dict[str, Run], int]:
    """The run of every variant of every plan, by `plan/variant`, and how many items had
    to run.
    """
    count = 0
    runs: dict[str, Run] = {}
    document = setting.document.value
    for entry in document["plans"]:
        campaign = _with_plan(setting, entry)
        flight = _run(setting, campaign, {"id": FLIGHT}, entry["id"])
        count += flight.execute(
            [flight.graph.stage(name) for name in SHARED],
            engine,
            Titled(progress, entry["id"]),
            force=force,
        )
        for variant in document["variants"]:
            if variant["id"] in (entry.get("variants") or [variant["id"]]):
                run = _run(setting, campaign, variant, entry["id"])
                run.manifests |= {name: flight.manifests[name] for name in SHARED}
                own = [stage for stage in run.graph.stages if stage.name not in SHARED]
                count += run.execute(
                    own, engine, Titled(progress, f"{entry['id']}/{variant['id']}"), force=force
                )
                runs[f"{entry['id']}/{variant['id']}"] = run
    return runs, count


def _with_plan(setting: Setting, entry: Mapping[str, Any]) -> Campaign:
    """The campaign as if its manifest named this plan."""
    campaign, path = setting.campaign, setting.document.path
    plan = inside(campaign.folder, entry["plan"], path)
    said = {**campaign.file.value[SIMULATE], **({"seed": entry["seed"]} if "seed" in entry else {})}
    twin = load_twin(
        said,
        campaign.vehicle,
        plan=plan,
        vehicle_file=campaign.vehicle_file,
        folder=campaign.folder,
        file=path,
    )
    return replace(campaign, twin=twin)


def _run(setting: Setting, campaign: Campaign, variant: Mapping[str, Any], plan: str) -> Run:
    graph = Graph(chain_of(variant, campaign))
    own = variant.get("stages") or {}
    params = {}
    for stage in graph.stages:
        values = {**(setting.defaults.value.get(stage.name) or {}), **(own.get(stage.name) or {})}
        params[stage.name] = make_params(
            stage.params, values, stage=stage.name, file=setting.document.path
        )
    return Run(campaign, graph, params, setting.folder / plan / str(variant["id"]))


@dataclass(frozen=True)
class KeptOpen:
    """An engine that several runs use after one another: they would otherwise start its
    processes anew each.
    """

    engine: Engine

    def map(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        """Outcomes of the engine itself."""
        return self.engine.map(tasks)

    def close(self) -> None:
        """Left to who made the engine."""


class Titled:
    """Progress of one run among several: its stages carry its name, and those with
    nothing to do are passed over.
    """

    def __init__(self, progress: Progress, title: str) -> None:
        self._progress, self._title, self._busy = progress, title, False

    def stage(self, name: str, *, todo: int, total: int, level: str) -> None:
        """A stage begins."""
        self._busy = todo > 0
        if self._busy:
            self._progress.stage(f"{self._title}/{name}", todo=todo, total=total, level=WHOLE)

    def item(self, name: str) -> None:
        """An item is done."""
        if self._busy:
            self._progress.item(name)

    def finish(self, *, failed: int) -> None:
        """The stage is over."""
        if self._busy:
            self._progress.finish(failed=failed)


def _sources(
    setting: Setting, runs: Mapping[str, Run], published: Mapping[str, Any]
) -> dict[str, Source]:
    """What the page is made of: artefacts of all runs, keyed as
    `stages.reproduce.Inputs` says.
    """
    plans = {key.split("/")[0]: run for key, run in runs.items()}
    by_plan = {name: _artefacts(plans, name) for name in ("simulation", "truth")}
    by_run = (
        "segment",
        "resampled",
        "fused",
        "fusion",
        "residual",
        "predictions",
        "model_card",
        "error_table",
    )
    campaign, first = setting.campaign, runs[_first(setting)]
    return {
        "reproduction": Value(setting.document.value),
        "published": Value(published),
        "vehicle": vehicle_source(campaign.vehicle),
        "campaign": Value(first.campaign.document),
        "provenance": Value(first.provenance()),
        "plans": Documents(
            {
                plan: run.campaign.twin["plan"]
                for plan, run in plans.items()
                if run.campaign.twin is not None
            }
        ),
        **{name: Many(found) for name, found in by_plan.items()},
        **{name: Many(_artefacts(runs, name)) for name in by_run},
    }


def _first(setting: Setting) -> str:
    """The run of the published procedure on the first plan, as `plan/variant`."""
    document = setting.document.value
    return f"{document['plans'][0]['id']}/{document['compared']['published']}"


@dataclass(frozen=True)
class Documents:
    """Documents of files that a user wrote, by key."""

    values: Mapping[str, Any]

    @property
    def fingerprint(self) -> str:
        return hash_value(self.values)

    def load(self) -> Mapping[str, Any]:
        return self.values


def _artefacts(runs: Mapping[str, Run], schema_name: str) -> dict[str, Artefact]:
    """Artefacts of a schema from several runs: `run/item`, or the run's own key where
    there is one of it.
    """
    found = {}
    for name, run in runs.items():
        for port in run.graph.producers(schema_name):
            for item in run.manifests[port.stage.name].records:
                for key, artefact in run.artefacts_of(port, item).items():
                    last = key if key is not None else "" if port.level == WHOLE else item
                    found["/".join([name, *([last] if last else [])])] = artefact
    return found


PAGE_PORTS = tuple(
    Port(reproduction.STAGE, name, spec["port"], bool(spec["many"]))
    for name, spec in ports(reproduction.STAGE.outputs).items()
)


def _page(folder: Path, sources: Mapping[str, Source], *, force: bool) -> int:
    """Make the page unless it is fresh, by the same keys and records as any stage;
    returns how many pages were made.
    """
    stage, code = reproduction.STAGE, stage_code(reproduction.STAGE)
    key = hash_value(
        {"inputs": {name: source.fingerprint for name, source in sources.items()}, "code": code}
    )
    manifest, hashes = Manifest(folder), FileHashes()
    paths = {port.name: folder / port.path(WHOLE) for port in PAGE_PORTS}
    record = manifest.records.get(WHOLE)
    kept = record is not None and all(
        path.is_file() and hashes.of(path) == record.outputs.get(name)
        for name, path in paths.items()
    )
    if kept and not force and record is not None and record.key == key:
        return 0
    manifest.write({}, [])
    outcome = execute(Task(stage, WHOLE, stage.params(), sources, PAGE_PORTS, folder, key, code))
    if outcome.crash is not None:
        raise InternalFault(f"{stage.name}: {outcome.crash}", outcome.trace)
    if outcome.record is None:
        raise StageFault(f"{stage.name}: {outcome.fault}")
    manifest.write({WHOLE: outcome.record}, [WHOLE])
    prune(folder, {manifest.path, *paths.values()})
    return 1


def print_tables(done: Reproduced) -> None:
    """J/J0 of the first plan beside the published, and the bounds, as text."""
    plan = done.errors[0]["plan"]
    rows = [row for row in done.errors if row["plan"] == plan]
    variants = list(dict.fromkeys(row["variant"] for row in rows))
    for use in dict.fromkeys(row["use"] for row in rows):
        print(
            f"\nJ/J0, {use}, plan {plan}\n{'':<16}{'published':>13}"
            + "".join(f"{name:>13}" for name in variants)
        )
        for model in dict.fromkeys(row["model"] for row in rows):
            found = {
                row["variant"]: row for row in rows if (row["use"], row["model"]) == (use, model)
            }
            printed = next(iter(found.values()))["published_ratio"]
            print(
                f"{model:<16}{_cell(printed)}"
                + "".join(_cell(found[name]["ratio"]) for name in variants)
            )
    met = sum(row["met"] for row in done.checks)
    print(f"\nbounds: {met} of {len(done.checks)} met")
    for row in done.checks:
        if not row["met"]:
            reason = f"known: {row['known']}" if row["known"] else "MISSED"
            print(
                f"  {row['plan']}/{row['variant']}: {row['asked']}: {row['least']:.3g} to"
                f" {row['most']:.3g}, {reason}"
            )
    print(f"\npage: {path_from_here(done.page)}")


def _cell(value: float | None) -> str:
    return f"{'-' if value is None else f'{value:.3f}':>13}"
