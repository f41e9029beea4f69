"""What the end of a run says: losses, warnings, errors in short, and places. On made-up
artefacts of the real graph.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from auvid.data_schemas.tables import make_table
from auvid.pipeline.campaigns.campaign import load_campaign
from auvid.pipeline.commands.run import run_command
from auvid.pipeline.commands.run.run_summary import (
    error_rows,
    losses,
    print_summary,
    result_files,
    shortened,
    warnings,
)
from auvid.pipeline.commands.run.staleness import stale_stage
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.graph import Graph, select, stages_of_kind
from auvid.pipeline.store.artefacts import encode
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.pipeline.store.file_hashes import hash_bytes
from auvid.pipeline.store.manifest import Record
from auvid.stages.presentation import remark, section
from auvid.stages.registry import KINDS as STAGE_KINDS
from auvid.stages.registry import STAGES
from tests.support.example_run import example_run
from tests.support.toy_stages import KINDS, VEHICLES, write_campaign

FILE = {
    "name": "a.log",
    "format": "text",
    "size_bytes": 100,
    "record_bytes": 60,
    "definition_bytes": 0,
    "status": "truncated",
    "skipped": [{"reason": "damaged bytes", "bytes": 40, "count": 1}],
    "seconds_lost": 1.25,
}
LOG_INFO: dict[str, Any] = {
    "log": "a",
    "files": [FILE],
    "status": "truncated",
    "start_us": 0,
    "end_us": 1,
    "utc_offset_us": None,
    "vehicle": None,
    "parameters": {},
    "accelerometer": None,
    "streams": {},
    "counts": {},
    "notes": [],
}
ERRORS = ("sse", "mae", "mse", "rms", "mad", "j0")


@pytest.fixture
def run(tmp_path: Path) -> Run:
    campaign = load_campaign(write_campaign(tmp_path / "toy"), kinds=KINDS, vehicles=VEHICLES)
    return Run(
        campaign,
        Graph(stages_of_kind(STAGES, STAGE_KINDS, "identification")),
        {},
        tmp_path / "runs" / "toy",
    )


def put(run: Run, stage: str, item: str, **artefacts: Any) -> None:
    """Artefacts as a stage would have left them."""
    hashes = {}
    for port in run.graph.outputs:
        if port.stage.name == stage and port.name in artefacts:
            content = encode(artefacts[port.name], port.schema, file="test")
            write_atomically(run.folder / stage / port.path(item), content)
            hashes[port.name] = hash_bytes(content)
    run.manifests[stage].records[item] = Record("key", "code", {}, {}, hashes, {})


def test_losses_name_log_bytes_time_and_reason(run: Run) -> None:
    dropped = {
        "stream": ["a.log", "velocity", "velocity"],
        "reason": ["damaged bytes", "spike", "spike"],
        "count": [1, 3, 4],
    }
    table = make_table(
        "dropped", {**dropped, "bytes": [40, None, None], "first": [0, 0, 0], "last": [0, 0, 0]}
    )
    put(run, "ingest", "a", log_info=LOG_INFO, dropped=table)
    assert losses(run) == [
        "log 'a' is truncated: 40 bytes skipped, 1.2 s lost",
        "log 'a': 7 rejected (velocity: spike)",
    ]


def test_whole_log_has_no_losses(run: Run) -> None:
    put(run, "ingest", "a", log_info={**LOG_INFO, "status": "complete"})
    assert losses(run) == []


def test_warnings_are_counted(run: Run) -> None:
    for item in ("one", "two"):
        put(
            run,
            "fuse",
            item,
            section=section(
                "Fused", [remark("drifts", "warning"), remark("fine", "note")], order=1
            ),
        )
    assert warnings(run) == ["drifts (2 times)"]


def test_errors_in_short_and_places(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        (use, leg, "fossen", "all", ratio)
        for use, leg, ratio in (
            ("training", "all", 0.5),
            ("training", "one", 9.0),
            ("validation", "all", None),
        )
    ]
    columns = {
        name: [row[index] for row in rows]
        for index, name in enumerate(("use", "leg", "model", "axis", "ratio"))
    }
    counts = {name: [12] * 3 for name in ("n_bar", "rank", "samples")}
    ranking = example_run({"train": 4.0, "check": 2.0}).ranking()
    merit = ranking.models[0].model_copy(update={"name": "fossen"})
    merit.axes["all"] = merit.axes["all"].model_copy(update={"identified": 3, "coefficients": 12})
    put(
        run,
        "validate",
        "campaign",
        ranking=ranking.model_copy(update={"models": [merit]}),
        error_table=make_table(
            "error_table", {**columns, **counts, **{name: [1.0] * 3 for name in ERRORS}}
        ),
    )
    row = {"model": "fossen", "recommended": True, "identified": 3, "coefficients": 12}
    assert error_rows(run) == [{**row, "training": 0.5, "validation": None}]
    assert result_files(run) == {"error table": run.folder / "validate" / "error_table.parquet"}
    # Behind another stage these are results of an earlier run.
    stages = select(run.graph, until="synthesise")
    printed, stale = run_command._up_to_date(run, stages)
    assert (stale, list(printed.graph.stages)) == ("validate", list(stages))
    assert (error_rows(printed), result_files(printed)) == ([], {})
    assert stale_stage(run, stages) is None
    print_summary(run)
    out = capsys.readouterr().out
    assert "model   identified  training  validation\n" in out
    assert "fossen  3 of 12        0.500           -\n" in out
    assert f"error table:    {run.folder}/validate/error_table.parquet" in out


def test_the_answer_stands_first(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    put(run, "report", "campaign", answer=b"Coe: use it\n  not \x1b[31m red\n", report_html=b"")
    print_summary(run)
    out = capsys.readouterr().out
    assert "\nCoe: use it\n  not " in out
    assert "\x1b" not in out
    assert out.index("Coe: use it") < out.index("report:  ")


def test_long_lists_are_cut_with_the_count() -> None:
    assert shortened([str(number) for number in range(25)])[-2:] == ["19", "... and 5 more"]
