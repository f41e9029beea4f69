"""The command `auvid reproduce`: fly plans with a twin, run the chain in several variants, and hold its errors against published ones.

Each plan is flown and its logs are read once; each variant has a run of its own over them. All of it lies under runs/CAMPAIGN/reproduce/
and is cached by the same manifests as a run: only what is stale is made again.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from data_schemas.schemas import schema
from pipeline import session
from pipeline.artefacts import load
from pipeline.campaign import ID, SIMULATE, Campaign, inside, load_campaign
from pipeline.engines import Engine
from pipeline.files import prune, readable
from pipeline.fingerprints import FileHashes, hash_value, stage_code
from pipeline.graph import WHOLE, AnyStage, Graph, Port, stages_of_kind
from pipeline.lock import locked
from pipeline.manifest import Manifest
from pipeline.progress import Progress
from pipeline.runner import InternalFault, Run, StageFault
from pipeline.sources import Artefact, Many, Source, Value
from pipeline.twin import load_twin, published_coefficients, read_coefficients
from pipeline.work import Task, execute
from pipeline.workspace import load_defaults, workspace_of
from pipeline.yaml_files import YamlFile, load_yaml
from stages import KINDS, STAGES, true_state
from stages.base import make_params, ports
from stages.report import reproduction

FILE = "reproduce.yaml"
FOLDER = "reproduce"
FLIGHT, PAGE = "flight", "page"
"""Folders beside those of the variants and of the plans."""
SHARED = ("simulate", "ingest")
LEFT_OUT = ("report",)


@dataclass(frozen=True)
class Setting:
    """A campaign with its document of variants and the folder of the results."""

    campaign: Campaign
    document: YamlFile
    defaults: YamlFile
    folder: Path


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


def open_setting(name: str) -> Setting:
    """The reproduction of a campaign given by name or path. Raises `PipelineError` for anything wrong with its documents."""
    workspace = workspace_of(name)
    folder = workspace.campaign_folder(name)
    campaign = load_campaign(folder, kinds=KINDS, vehicles=workspace.vehicle_files())
    path = folder / FILE
    if not path.is_file():
        known = [other for other in workspace.campaign_names() if (workspace.campaigns / other / FILE).is_file()]
        remedy = f"Campaigns that have one: {', '.join(known)}." if known else f"It needs a {FILE} beside its campaign.yaml."
        raise CampaignError("this campaign reproduces nothing", value=campaign.name, remedy=remedy)
    document = load_yaml(path)
    document.check("reproduction")
    raise_faults([document.located(fault) for fault in _faults(document, campaign)], file=path)
    return Setting(campaign, document, load_defaults(workspace, STAGES), workspace.runs / campaign.name / FOLDER)


def _faults(file: YamlFile, campaign: Campaign) -> Iterator[PipelineError]:
    document, path = file.value, file.path
    if campaign.twin is None:
        yield CampaignError("only a twin can fly the plans of a reproduction", file=path, field="plans", value=campaign.document["kind"])
    names: dict[str, list[str]] = {}
    for part, reserved in (("plans", PAGE), ("variants", FLIGHT)):
        names[part] = [entry["id"] for entry in document[part]]
        if not names[part]:
            yield CampaignError("the list is empty", file=path, field=part)
        for index, name in enumerate(names[part]):
            if not ID.fullmatch(name) or name == reserved or name in names[part][:index]:
                allowed = f"letters, digits, _ and -, each name once, not {reserved}"
                yield CampaignError("not a name of its own", file=path, field=f"{part}[{index}].id", value=name, allowed=allowed)
    wanted = [(f"compared.{role}", name) for role, name in document["compared"].items()]
    for index, plan in enumerate(document["plans"]):
        wanted += [(f"plans[{index}].variants[{at}]", name) for at, name in enumerate(plan.get("variants") or [])]
    for field, name in wanted:
        if name not in names["variants"]:
            remedy = nearest(name, names["variants"])
            yield CampaignError("no such variant", file=path, field=field, value=name, allowed=names["variants"], remedy=remedy)
    for index, variant in enumerate(document["variants"]):
        known = [stage.name for stage in _stages(variant, campaign) if stage.name not in SHARED]
        for stage in variant.get("stages") or {}:
            if stage not in known:
                at = f"variants[{index}].stages.{stage}"
                yield CampaignError("not a stage of this variant", file=path, field=at, allowed=known, remedy=nearest(stage, known))


def _stages(variant: Mapping[str, Any], campaign: Campaign) -> tuple[AnyStage, ...]:
    """The chain of a variant: with true states, these take the place of fusion; no report."""
    chain = stages_of_kind(STAGES, KINDS, campaign.document["kind"])
    chain = tuple(stage for stage in chain if stage.name not in LEFT_OUT)
    if variant.get("states") == "truth":
        return tuple(true_state.STAGE if stage.name == "fuse" else stage for stage in chain)
    return chain


def reproduce(setting: Setting, engine: Engine, progress: Progress, *, force: bool = False) -> Reproduced:
    """Bring every variant of every plan and the page up to date. Raises `StageFault` or `InternalFault` as a run does."""
    with locked(setting.folder):
        runs, count = _runs(setting, engine, progress, force=force)
        page = setting.folder / PAGE
        made = _page(page, _sources(setting, runs), force=force)
    tables = {port.name: load(page / port.path(WHOLE), port.schema) for port in PAGE_PORTS if schema(port.schema).kind == "table"}
    return Reproduced(page / "page.html", count + made, tables["errors"].to_pylist(), tables["checks"].to_pylist())


def _runs(setting: Setting, engine: Engine, progress: Progress, *, force: bool) -> tuple[dict[str, Run], int]:
    """The run of every variant of every plan, by `plan/variant`, and how many items had to run."""
    count = 0
    runs: dict[str, Run] = {}
    document = setting.document.value
    for entry in document["plans"]:
        campaign = _with_plan(setting, entry)
        flight = _run(setting, campaign, {"id": FLIGHT}, entry["id"])
        count += flight.execute([flight.graph.stage(name) for name in SHARED], engine, Titled(progress, entry["id"]), force=force)
        for variant in document["variants"]:
            if variant["id"] in (entry.get("variants") or [variant["id"]]):
                run = _run(setting, campaign, variant, entry["id"])
                run.manifests |= {name: flight.manifests[name] for name in SHARED}
                own = [stage for stage in run.graph.stages if stage.name not in SHARED]
                count += run.execute(own, engine, Titled(progress, f"{entry['id']}/{variant['id']}"), force=force)
                runs[f"{entry['id']}/{variant['id']}"] = run
    return runs, count


def _with_plan(setting: Setting, entry: Mapping[str, Any]) -> Campaign:
    """The campaign as if its manifest named this plan."""
    campaign, path = setting.campaign, setting.document.path
    plan = inside(campaign.folder, entry["plan"], path)
    said = {**campaign.file.value[SIMULATE], **({"seed": entry["seed"]} if "seed" in entry else {})}
    twin = load_twin(said, campaign.vehicle, plan=plan, vehicle_file=campaign.vehicle_file, folder=campaign.folder, file=path)
    return replace(campaign, twin=twin)


def _run(setting: Setting, campaign: Campaign, variant: Mapping[str, Any], plan: str) -> Run:
    graph = Graph(_stages(variant, campaign))
    own = variant.get("stages") or {}
    params = {}
    for stage in graph.stages:
        values = {**(setting.defaults.value.get(stage.name) or {}), **(own.get(stage.name) or {})}
        params[stage.name] = make_params(stage.params, values, stage=stage.name, file=setting.document.path)
    return Run(campaign, graph, params, setting.folder / plan / str(variant["id"]))


class Titled:
    """Progress of one run among several: its stages carry its name, and those with nothing to do are passed over."""

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


def _sources(setting: Setting, runs: Mapping[str, Run]) -> dict[str, Source]:
    """What the page is made of: artefacts of all runs, keyed as `stages.report.reproduction.Inputs` says."""
    plans = {key.split("/")[0]: run for key, run in runs.items()}
    by_plan = {name: _artefacts(plans, name) for name in ("simulation", "truth")}
    by_run = ("segment", "resampled", "fused", "fusion", "residual", "predictions", "model_card", "error_table")
    campaign, first = setting.campaign, runs[_first(setting)]
    return {
        "reproduction": Value(setting.document.value),
        "published": Value(_published(setting)),
        "vehicle": Value(campaign.vehicle),
        "campaign": Value(first.campaign.document),
        "provenance": Value(first.provenance()),
        "plans": Documents({plan: run.campaign.twin["plan"] for plan, run in plans.items() if run.campaign.twin is not None}),
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
    """Artefacts of a schema from several runs: `run/item`, or the run's own key where there is one of it."""
    found = {}
    for name, run in runs.items():
        for port in run.graph.producers(schema_name):
            for item in run.manifests[port.stage.name].records:
                for key, artefact in run.artefacts_of(port, item).items():
                    last = key if key is not None else "" if port.level == WHOLE else item
                    found["/".join([name, *([last] if last else [])])] = artefact
    return found


def _published(setting: Setting) -> dict[str, Any]:
    """The document `published_tables` of the campaign's CSV file, and the published coefficients beside the vehicle file."""
    name, manifest = setting.document.value["published"], setting.document.path
    path = inside(setting.campaign.folder, name, manifest)
    with readable(path, file=manifest, what="table of published errors"):
        text = path.read_text(encoding="utf-8")
    rows: list[dict[str, Any]] = []
    faults: list[PipelineError] = []
    for number, row in enumerate(csv.DictReader(io.StringIO(text)), start=2):
        try:
            rows.append({column: convert(row[column] or "") for column, convert in COLUMNS.items()})
        except (KeyError, ValueError) as fault:
            faults.append(CampaignError(f"not a row of published errors: {fault}", file=path, row=number, allowed=", ".join(COLUMNS)))
    if not rows and not faults:
        faults.append(CampaignError("the table of published errors is empty", file=path))
    raise_faults(faults, file=path)
    coefficients = {model: read_coefficients(file) for model, file in published_coefficients(setting.campaign.vehicle_file).items()}
    return {"source": name, "rows": rows, "coefficients": coefficients}


COLUMNS: dict[str, Any] = {
    "table": str,
    "set": str,
    "model": str,
    "n_bar_printed": int,
    "J": float,
    "J0": float,
    "ratio_printed": float,
    "ratio_recomputed": float,
    "note": str,
}


PAGE_PORTS = tuple(
    Port(reproduction.STAGE, name, spec["port"], bool(spec["many"])) for name, spec in ports(reproduction.STAGE.outputs).items()
)


def _page(folder: Path, sources: Mapping[str, Source], *, force: bool) -> int:
    """Make the page unless it is fresh, by the same keys and records as any stage; returns how many pages were made."""
    stage, code = reproduction.STAGE, stage_code(reproduction.STAGE)
    key = hash_value({"inputs": {name: source.fingerprint for name, source in sources.items()}, "code": code})
    manifest, hashes = Manifest(folder), FileHashes()
    paths = {port.name: folder / port.path(WHOLE) for port in PAGE_PORTS}
    record = manifest.records.get(WHOLE)
    kept = record is not None and all(path.is_file() and hashes.of(path) == record.outputs.get(name) for name, path in paths.items())
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
        print(f"\nJ/J0, {use}, plan {plan}\n{'':<16}{'published':>13}" + "".join(f"{name:>13}" for name in variants))
        for model in dict.fromkeys(row["model"] for row in rows):
            found = {row["variant"]: row for row in rows if (row["use"], row["model"]) == (use, model)}
            printed = next(iter(found.values()))["published_ratio"]
            print(f"{model:<16}{_cell(printed)}" + "".join(_cell(found[name]["ratio"]) for name in variants))
    met = sum(row["met"] for row in done.checks)
    print(f"\nbounds: {met} of {len(done.checks)} met")
    for row in done.checks:
        if not row["met"]:
            reason = f"known: {row['known']}" if row["known"] else "MISSED"
            print(f"  {row['plan']}/{row['variant']}: {row['asked']}: {row['least']:.3g} to {row['most']:.3g}, {reason}")
    print(f"\npage: {session.shown(done.page)}")


def _cell(value: float | None) -> str:
    return f"{'-' if value is None else f'{value:.3f}':>13}"
