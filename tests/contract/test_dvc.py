"""dvc.yaml, params.yaml, STAGES and schemas say the same."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.declarations import campaign_kinds, dvc_yaml
from pipeline.graph import Graph
from stages import KINDS, STAGES
from stages.base import Stage, ports

ROOT = Path(__file__).resolve().parents[2]
DVC: dict[str, Any] = yaml.safe_load((ROOT / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
PARAMS: dict[str, Any] = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
CAMPAIGNS = campaign_kinds(ROOT, PARAMS["campaigns"])
TWINS = [name for name, kind in CAMPAIGNS.items() if "simulate" in KINDS[kind]]
AnyStage = Stage[Any, Any, Any]


def campaigns_of(entry: dict[str, Any]) -> list[str]:
    return list(PARAMS["campaigns"] if entry["foreach"] == "${campaigns}" else entry["foreach"])


def texts(entries: Any) -> Any:
    """The same with ${item}, however an entry calls its campaign."""
    return yaml.safe_load(yaml.safe_dump(entries).replace("${key}", "${item}"))


def paths(entries: list[Any]) -> set[str]:
    return {next(iter(entry)) if isinstance(entry, dict) else entry for entry in entries}


def test_file_is_what_the_stages_declare() -> None:
    """`make declarations` writes it anew."""
    assert (ROOT / "dvc.yaml").read_text(encoding="utf-8") == dvc_yaml(STAGES, KINDS, CAMPAIGNS)


def test_entries_are_the_stages_and_their_code() -> None:
    assert list(DVC) == ["code", *(stage.name for stage in STAGES)]
    assert DVC["code"]["always_changed"] is True
    assert paths(DVC["code"]["outs"]) == {f"runs/.code/{stage.name}.txt" for stage in STAGES}


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: str(stage.name))
def test_entry_runs_the_stage_for_every_campaign_that_has_it(stage: AnyStage) -> None:
    entry = texts(DVC[stage.name])
    assert campaigns_of(entry) == [name for name, kind in CAMPAIGNS.items() if stage.name in KINDS[kind]]
    assert entry["do"]["cmd"] == f"auvid run ${{item}} --only {stage.name}"
    assert f"runs/.code/{stage.name}.txt" in entry["do"]["deps"]


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: str(stage.name))
def test_entry_names_single_parameters(stage: AnyStage) -> None:
    named = DVC[stage.name]["do"].get("params", [])
    assert named == [f"{stage.name}.{item.name}" for item in fields(stage.params)]
    assert all(key.partition(".")[2] in PARAMS[stage.name] for key in named)


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: str(stage.name))
def test_entry_depends_on_what_feeds_the_stage(stage: AnyStage) -> None:
    graph, deps = Graph(STAGES), set(texts(DVC[stage.name])["do"]["deps"])
    for feed in graph.feeds(stage):
        for port in feed.producers:
            if port.stage.name == "simulate" and "${item.logs}" in deps:
                continue  # the campaign folder, or what the twin leaves
            do = texts(DVC[port.stage.name])["do"]
            if feed.schema == "raw_log":
                continue
            assert paths([*do["outs"], *do.get("metrics", [])]) <= deps
    assert ("vehicles" in deps) == ("vehicle" in {spec["port"] for spec in ports(stage.inputs).values()})
    assert any(path.startswith("campaigns/${item}") for path in deps)


def test_logs_of_a_twin_are_those_it_writes() -> None:
    places = {name: entry["logs"] for name, entry in DVC["ingest"]["foreach"].items()}
    assert places == {name: f"runs/{name}/simulate" if name in TWINS else f"campaigns/{name}" for name in CAMPAIGNS}
    assert "${item.logs}" in DVC["ingest"]["do"]["deps"]


def test_outs_persist_and_error_tables_are_metrics() -> None:
    for stage in STAGES:
        do = texts(DVC[stage.name])["do"]
        for entry in (*do["outs"], *do.get("metrics", [])):
            (path, options) = next(iter(entry.items()))
            assert options["persist"] is True
            assert path.startswith(f"runs/${{item}}/{stage.name}")
    assert DVC["validate"]["do"]["metrics"] == [{"runs/${item}/validate/error_metrics.json": {"persist": True}}]


def test_analytics_are_off() -> None:
    for config in (ROOT / ".dvc" / "config", ROOT / "pipeline" / "templates" / "dot_dvc" / "config"):
        assert "analytics = false" in config.read_text(encoding="utf-8")


def test_every_dependency_of_every_campaign_is_there_or_made() -> None:
    """Resolved entry by entry: what a stage of a campaign waits for is a file of the repository or left by an entry of that campaign."""
    resolved: dict[str, dict[str, set[str]]] = {}
    for name, entry in DVC.items():
        each = entry.get("foreach")
        for campaign in campaigns_of(entry) if each else []:
            logs = each[campaign]["logs"] if isinstance(each, dict) else ""
            filled = {
                part: {text.replace("${item.logs}", logs).replace("${item}", campaign).replace("${key}", campaign) for text in found}
                for part in ("deps", "outs", "metrics")
                if (found := paths(entry["do"].get(part, [])))
            }
            resolved[f"{name}@{campaign}"] = filled
    made = {path for parts in resolved.values() for path in (*parts.get("outs", ()), *parts.get("metrics", ()))}
    made |= paths(DVC["code"]["outs"])
    wanted = {path for parts in resolved.values() for path in parts["deps"]}
    assert sorted(path for path in wanted - made if path.startswith("runs/") or not (ROOT / path).exists()) == []
