"""What stages show: every stage declares views beside its outputs, or says why it has
none.
"""

from __future__ import annotations

from typing import Any

import pytest

from auvid.stages.base import Stage, ports
from auvid.stages.registry import STAGES


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_stage_shows_something_or_says_why_not(stage: Stage[Any, Any, Any]) -> None:
    shows = any(spec["port"] == "views" for spec in ports(stage.outputs).values())
    assert shows != bool(stage.no_views), (
        "a stage has a port of schema views, or a reason in no_views, not both"
    )


NO_SECTION = {
    "report": "it arranges the sections of the others",
    "reproduce": "its page is its own: it compares several runs, of which each has a report",
}


@pytest.mark.parametrize(
    "stage",
    [stage for stage in STAGES if stage.name not in NO_SECTION],
    ids=lambda stage: stage.name,
)
def test_stage_has_a_section_of_the_report(stage: Stage[Any, Any, Any]) -> None:
    schemas = {spec["port"] for spec in ports(stage.outputs).values()}
    assert "section" in schemas or stage.name == "resample", (
        "resample's facts are those of its segments, which the report lists"
    )
