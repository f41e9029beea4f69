"""dvc.yaml, params.yaml, STAGES and schemas say the same."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline.execution.generate_dvc import campaign_kinds, dvc_yaml
from auvid.pipeline.graph import Graph, stages_of_kind
from auvid.stages.base import Stage
from auvid.stages.registry import KINDS, STAGES

ROOT = Path(__file__).resolve().parents[2]
DECLARED: dict[str, Any] = read_yaml((ROOT / "dvc.yaml").read_text(encoding="utf-8"))
DVC: dict[str, Any] = DECLARED["stages"]
PARAMS: dict[str, Any] = read_yaml((ROOT / "params.yaml").read_text(encoding="utf-8"))
CAMPAIGNS = campaign_kinds(ROOT, PARAMS["campaigns"])
TWINS = [name for name, kind in CAMPAIGNS.items() if "simulate" in KINDS[kind]]
USED = [stage for stage in STAGES if any(stage.name in KINDS[kind] for kind in CAMPAIGNS.values())]
AnyStage = Stage[Any, Any, Any]


def campaigns_of(entry: dict[str, Any]) -> list[str]:
    return list(PARAMS["campaigns"] if entry["foreach"] == "${campaigns}" else entry["foreach"])


def entries_of(stage: str) -> dict[str, dict[str, Any]]:
    """The entries of a stage: its own, and `STAGE-KIND`."""
    return {
        name: entry
        for name, entry in DVC.items()
        if name == stage or name.rpartition("-")[0] == stage
    }


def paths(entries: list[Any]) -> set[str]:
    return {next(iter(entry)) if isinstance(entry, dict) else entry for entry in entries}


def test_file_is_what_the_stages_declare() -> None:
    """`make declarations` writes it anew."""
    assert (ROOT / "dvc.yaml").read_text(encoding="utf-8") == dvc_yaml(STAGES, KINDS, CAMPAIGNS)


def test_entries_are_the_stages_and_their_code() -> None:
    used = [
        stage.name
        for stage in STAGES
        if any(stage.name in KINDS[kind] for kind in CAMPAIGNS.values())
    ]
    assert [name for name in DVC if name in ("code", *used)] == ["code", *used]
    assert set(DVC) == {"code", "inputs", *(name for stage in used for name in entries_of(stage))}
    assert DVC["code"]["always_changed"] is True
    assert campaigns_of(DVC["inputs"]) == PARAMS["campaigns"]
    assert DVC["inputs"]["do"]["cmd"] == "auvid code ${item}"
    assert DVC["inputs"]["do"]["always_changed"] is True
    assert paths(DVC["inputs"]["do"]["outs"]) == {"runs/.code/${item}"}
    assert paths(DVC["code"]["outs"]) == {f"runs/.code/{stage.name}.txt" for stage in STAGES}


@pytest.mark.parametrize("stage", USED, ids=lambda stage: str(stage.name))
def test_entries_run_the_stage_once_for_every_campaign_that_has_it(stage: AnyStage) -> None:
    entries = entries_of(stage.name).values()
    having = [name for name, kind in CAMPAIGNS.items() if stage.name in KINDS[kind]]
    assert sorted(name for entry in entries for name in campaigns_of(entry)) == sorted(having)
    for entry in entries:
        assert entry["do"]["cmd"] == f"auvid run ${{item}} --only {stage.name}"
        assert f"runs/.code/{stage.name}.txt" in entry["do"]["deps"]


@pytest.mark.parametrize("stage", USED, ids=lambda stage: str(stage.name))
def test_entry_names_single_parameters(stage: AnyStage) -> None:
    for entry in entries_of(stage.name).values():
        named = entry["do"].get("params", [])
        assert named == [f"{stage.name}.{item.name}" for item in fields(stage.params)]
        assert all(key.partition(".")[2] in PARAMS[stage.name] for key in named)


@pytest.mark.parametrize("stage", USED, ids=lambda stage: str(stage.name))
def test_entry_depends_on_what_feeds_the_stage(stage: AnyStage) -> None:
    for entry in entries_of(stage.name).values():
        kinds = {CAMPAIGNS[name] for name in campaigns_of(entry)}
        deps = set(entry["do"]["deps"])
        for kind in kinds:
            for feed in Graph(stages_of_kind(STAGES, KINDS, kind)).feeds(stage):
                for port in feed.producers:
                    do = next(
                        other
                        for other in entries_of(port.stage.name).values()
                        if set(campaigns_of(other)) & set(campaigns_of(entry))
                    )["do"]
                    assert paths(do["outs"]) <= deps
        assert f"runs/.code/${{item}}/{stage.name}.txt" in deps
        assert all(path.startswith("runs/") for path in deps)


def test_logs_of_a_twin_are_those_it_writes() -> None:
    for entry in entries_of("ingest").values():
        for name in campaigns_of(entry):
            assert ("runs/${item}/simulate" in entry["do"]["deps"]) == (name in TWINS)


def test_a_stage_leaves_its_folder_whatever_its_settings() -> None:
    """What lies in it may be absent, as free runs are where the campaign flies none; DVC
    refuses a stage that leaves a declared output out.
    """
    for stage in USED:
        for entry in entries_of(stage.name).values():
            assert entry["do"]["outs"] == [{f"runs/${{item}}/{stage.name}": {"persist": True}}]
            assert "metrics" not in entry["do"]


def test_error_tables_are_metrics() -> None:
    validated = [name for name, kind in CAMPAIGNS.items() if "validate" in KINDS[kind]]
    assert DECLARED["metrics"] == [
        f"runs/{name}/validate/error_metrics.json" for name in sorted(validated)
    ]


def test_analytics_are_off() -> None:
    for config in (
        ROOT / ".dvc" / "config",
        ROOT / "pipeline" / "templates" / "dot_dvc" / "config",
    ):
        assert "analytics = false" in config.read_text(encoding="utf-8")


def test_every_dependency_of_every_campaign_is_made() -> None:
    """Resolved entry by entry: what a stage of a campaign waits for is left by an entry
    of that campaign, itself or in a folder.
    """
    resolved: dict[str, dict[str, set[str]]] = {}
    for name, entry in DVC.items():
        each = entry.get("foreach")
        for campaign in campaigns_of(entry) if each else []:
            filled = {
                part: {text.replace("${item}", campaign) for text in named_paths}
                for part in ("deps", "outs")
                if (named_paths := paths(entry["do"].get(part, [])))
            }
            resolved[f"{name}@{campaign}"] = filled
    outputs = {path for parts in resolved.values() for path in parts.get("outs", ())}
    outputs |= paths(DVC["code"]["outs"])
    needed = {path for parts in resolved.values() for path in parts.get("deps", ())}
    assert {path for path in needed if not {path, str(Path(path).parent)} & outputs} == set()
