"""params.yaml, STAGES and schemas say the same."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import pytest

from auvid.data_schemas.documents.campaign import CampaignDocument
from auvid.data_schemas.schemas import schema_names
from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline.execution.generate_dvc import default_of, params_yaml
from auvid.pipeline.graph import MANIFEST_PORTS, Graph, stages_of_kind
from auvid.stages.base import Stage, make_params, ports
from auvid.stages.registry import KINDS, REPRODUCTION_KINDS, STAGES

ROOT = Path(__file__).resolve().parents[2]
AnyStage = Stage[Any, Any, Any]
PARAMS = read_yaml((ROOT / "params.yaml").read_text(encoding="utf-8"))


def test_params_file_is_what_the_stages_declare() -> None:
    """`make declarations` writes it anew."""
    assert (ROOT / "params.yaml").read_text(encoding="utf-8") == params_yaml(
        STAGES, PARAMS["campaigns"]
    ), "params.yaml is out of date: run make declarations"


def test_campaigns_are_those_in_the_folder() -> None:
    assert PARAMS["campaigns"] == sorted(
        path.parent.name for path in (ROOT / "campaigns").glob("*/campaign.yaml")
    )


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: str(stage.name))
def test_section_gives_the_defaults(stage: AnyStage) -> None:
    section = PARAMS[stage.name] or {}
    defaults = {item.name: default_of(item) for item in fields(stage.params)}
    assert section == defaults, "params.yaml is out of date: run make declarations"
    assert make_params(stage.params, section, stage=stage.name) == stage.params()


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: str(stage.name))
def test_stage_is_declared_as_its_module_says(stage: AnyStage) -> None:
    module = f"auvid.stages.{stage.name}"
    assert {
        stage.run.__module__,
        stage.inputs.__module__,
        stage.params.__module__,
        stage.outputs.__module__,
    } == {module}
    assert len(ports(stage.inputs)) == len(fields(stage.inputs))
    assert len(ports(stage.outputs)) == len(fields(stage.outputs))
    for item in fields(stage.params):
        assert item.metadata["unit"]
        assert item.metadata["meaning"]


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: str(stage.name))
def test_every_port_has_a_schema(stage: AnyStage) -> None:
    named = {
        spec["port"] for kind in (stage.inputs, stage.outputs) for spec in ports(kind).values()
    }
    assert named - {"table", "raw_log"} <= set(schema_names())


@pytest.mark.parametrize("kind", KINDS)
def test_kinds_are_graphs_in_running_order(kind: str) -> None:
    stages = stages_of_kind(STAGES, KINDS, kind)
    assert tuple(stage.name for stage in stages) == KINDS[kind]
    assert Graph(stages).stages == stages


def test_kinds_are_those_of_the_manifest_schema() -> None:
    assert set(get_args(CampaignDocument.model_fields["kind"].annotation)) == {*KINDS} - {
        *REPRODUCTION_KINDS
    }


def test_every_schema_is_used() -> None:
    """A schema nobody reads or writes is a promise nobody keeps.

    Exception: what users write, and what `auvid fleet` writes of many campaigns.
    """
    used = {
        spec["port"]
        for stage in STAGES
        for kind in (stage.inputs, stage.outputs)
        for spec in ports(kind).values()
    }
    assert set(schema_names()) - used - set(MANIFEST_PORTS) == {
        "column_map",
        "dive_plan",
        "fleet_coefficients",
        "fleet_findings",
        "fleet_run",
        "fleet_runs",
        "fleet_verdicts",
        "log_survey",
        "plan",
        "tolerances",
    }
