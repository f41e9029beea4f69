"""`auvid reproduce`: fly the plans of a twin and run the chain in several variants.

Each plan is flown and its logs are read once; each variant has a run of its own over
them. All results lie under runs/CAMPAIGN/reproduce/ and are cached by the manifests of
the runner: only what is stale is made again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from auvid.data_schemas.schemas import schema
from auvid.pipeline import terminal
from auvid.pipeline.campaigns.campaign import SIMULATE, Campaign, inside
from auvid.pipeline.campaigns.twin import load_twin
from auvid.pipeline.commands.reproduce.variants import (
    FLIGHT,
    PAGE,
    SHARED,
    Reproduction,
    kind_of,
    open_reproduction,
    published_tables,
    with_text,
)
from auvid.pipeline.commands.run.run_summary import print_checks
from auvid.pipeline.execution.engines import Engine
from auvid.pipeline.execution.lock import locked
from auvid.pipeline.execution.progress import Progress, Silent
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.graph import ONCE, Graph, stages_of_kind
from auvid.pipeline.output import answer
from auvid.pipeline.store.manifest import Manifest
from auvid.stages.base import make_params
from auvid.stages.number_format import fixed
from auvid.stages.reference_check import ReferenceCheck
from auvid.stages.registry import KINDS, STAGES

__all__ = ["Reproduced", "open_reproduction", "print_tables", "reproduce"]


@dataclass(frozen=True)
class Reproduced:
    """Where the page is, how many items had to run, and the tables that were made."""

    page: Path
    count: int
    errors: list[dict[str, Any]]
    checks: list[dict[str, Any]]

    @property
    def missed(self) -> list[dict[str, Any]]:
        """Bounds that are missed without an accepted reason."""
        return [row for row in self.checks if not row["met"] and not row["accepted_reason"]]


def reproduce(
    reproduction: Reproduction, engine: Engine, progress: Progress, *, force: bool = False
) -> Reproduced:
    """Bring every variant of every plan and the page up to date.

    Raises `StageFault` or `InternalFault` as a run does.
    """
    documents = {
        "reproduction": with_text(reproduction),
        "published_tables": published_tables(reproduction),
    }
    with locked(reproduction.folder):
        try:
            runs, count = _run_variants(reproduction, engine, progress, force=force)
        finally:
            engine.close()
    campaign = replace(next(iter(runs.values())).campaign, documents=documents)
    page = _run(reproduction, campaign, "reproduction", {}, reproduction.folder)
    page.members = runs
    page.manifests["reproduce"] = Manifest(reproduction.folder / PAGE)
    count += page.execute(page.graph.stages, engine, Silent(), force=force)
    files = {
        port.name: artefact
        for port in page.graph.outputs
        for artefact in page.artefacts_of(port, ONCE).values()
    }
    rows = {
        name: artefact.load().to_pylist()
        for name, artefact in files.items()
        if schema(artefact.schema).kind == "table"
    }
    return Reproduced(files["page"].path, count, rows["errors"], rows["checks"])


def _run_variants(
    reproduction: Reproduction, engine: Engine, progress: Progress, *, force: bool
) -> tuple[dict[str, Run], int]:
    """Run every variant of every plan; return them by `PLAN/VARIANT`, and the items."""
    count = 0
    runs: dict[str, Run] = {}
    document = reproduction.document.value
    for plan in document["plans"]:
        campaign = _with_plan(reproduction, plan)
        folder = reproduction.folder / plan["id"]
        flight = _run(reproduction, campaign, "variant", {}, folder / FLIGHT, plan["id"])
        shared = [flight.graph.stage(name) for name in SHARED]
        count += flight.execute(shared, engine, progress, force=force, close_engine=False)
        for variant in document["variants"]:
            if variant["id"] in (plan.get("variants") or [variant["id"]]):
                name = f"{plan['id']}/{variant['id']}"
                run = runs[name] = _run(
                    reproduction,
                    campaign,
                    kind_of(variant),
                    variant.get("stages") or {},
                    folder / variant["id"],
                    name,
                )
                run.manifests |= {stage.name: flight.manifests[stage.name] for stage in shared}
                own = [stage for stage in run.graph.stages if stage.name not in SHARED]
                count += run.execute(own, engine, progress, force=force, close_engine=False)
    return runs, count


def _with_plan(reproduction: Reproduction, entry: Mapping[str, Any]) -> Campaign:
    """Return the campaign as if its manifest named this plan."""
    campaign, path = reproduction.campaign, reproduction.document.path
    options = dict(campaign.file.value[SIMULATE])
    if "seed" in entry:
        options["seed"] = entry["seed"]
    twin = load_twin(
        options,
        campaign.vehicle,
        plan=inside(campaign.folder, entry["plan"], path),
        vehicle_file=campaign.vehicle_file,
        folder=campaign.folder,
        file=path,
    )
    return replace(campaign, twin=twin)


def _run(
    reproduction: Reproduction,
    campaign: Campaign,
    kind: str,
    values: Mapping[str, Mapping[str, Any]],
    folder: Path,
    title: str = "",
) -> Run:
    """Return a run of a kind over a folder; `values`: changed parameters, by stage."""
    graph = Graph(stages_of_kind(STAGES, KINDS, kind))
    params = {
        stage.name: make_params(
            stage.params,
            {
                **(reproduction.defaults.value.get(stage.name) or {}),
                **(values.get(stage.name) or {}),
            },
            stage=stage.name,
            file=reproduction.document.path,
        )
        for stage in graph.stages
    }
    return Run(campaign, graph, params, folder, title=title)


def print_tables(done: Reproduced) -> None:
    """Print J/J0 of the first plan next to the published, and missed bounds."""
    answer(
        {"page": done.page, "met": not done.missed, "errors": done.errors, "checks": done.checks}
    )
    plan = done.errors[0]["plan"]
    rows = [row for row in done.errors if row["plan"] == plan]
    variants = list(dict.fromkeys(row["variant"] for row in rows))
    for use in dict.fromkeys(row["use"] for row in rows):
        ratios: dict[str, dict[str, float | None]] = {}
        for row in rows:
            if row["use"] == use:
                of_model = ratios.setdefault(row["model"], {"published": row["published_ratio"]})
                of_model[row["variant"]] = row["ratio"]
        print()
        terminal.table(
            ["model", "published", *variants],
            [
                [model, *(fixed(by_variant[name], 3) for name in ("published", *variants))]
                for model, by_variant in ratios.items()
            ],
            title=f"J/J0, {use}, plan {plan}",
        )
    print_checks(
        ["plan", "variant"],
        [((row["plan"], row["variant"]), check_of(row)) for row in done.checks],
        missed_only=True,
    )
    print(f"\npage: {terminal.path_from_here(done.page)}")


def check_of(row: Mapping[str, Any]) -> ReferenceCheck:
    """Return the check of a row of schema `reproduction_checks`."""
    return ReferenceCheck(
        row["quantity"],
        row["most"],
        least=row["least"],
        low=row["low"],
        high=row["high"],
        accepted_reason=row["accepted_reason"],
        evidence=row["evidence"],
        evidence_reason=row["reason"],
    )
