"""Two runs compared: what moved, by how much, what has no partner; as text, as JSON, as
a recording, and by the exit code.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import column, make_table
from auvid.pipeline import cli
from auvid.pipeline.commands.look.diff import diff_command as diff
from auvid.pipeline.commands.look.diff import diff_operands
from auvid.pipeline.commands.look.inspect import rerun_viewer as viewer
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.graph import Port
from auvid.pipeline.output import OUTPUT
from auvid.pipeline.store.artefacts import encode
from auvid.pipeline.store.file_hashes import hash_file
from auvid.pipeline.store.manifest import Manifest, Record
from auvid.stages.base import ports
from auvid.stages.registry import STAGES
from auvid.stages.report.difference.signals import (
    Side,
    coefficient_changes,
    pairs,
    signal_changes,
)
from tests.support.example_run import ExampleRun, example_run

VELOCITY = ("u_m_s", "v_m_s", "w_m_s", "p_rad_s", "q_rad_s", "r_rad_s")


def side_of(run: ExampleRun, name: str, **more: Any) -> Side:
    predictions = {
        key.split("/")[2]: table
        for key, table in run.tables.items()
        if key.startswith("validate/predictions/")
    }
    return Side(
        name,
        segments=run.segments,
        logs=run.logs,
        cards=run.cards,
        fused=run.fused,
        predictions=predictions,
        **more,
    )


def small() -> ExampleRun:
    return example_run({"train": 6.0, "check": 3.0})


def write(folder: Path, run: ExampleRun) -> Path:
    """A run in a folder, as the runner leaves it."""
    files: dict[str, tuple[Any, str]] = {
        "validate/error_table.parquet": (run.error_table(), "error_table")
    }
    files["ingest/dive/log_info.json"] = run.logs["dive"], "log_info"
    for name, document in run.segments.items():
        files[f"resample/{name}/segment.json"] = document, "segment"
        files[f"fuse/{name}/fused.parquet"] = run.fused[name], "fused"
        files[f"validate/predictions/{name}.parquet"] = (
            run.tables[f"validate/predictions/{name}"],
            "predictions",
        )
    for name, (artefact, kind) in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(encode(artefact, kind, file=path))
    vouch(folder)
    return folder


def vouch(folder: Path) -> None:
    """Write the manifests of what lies in the folder of a run."""
    for stage in STAGES:
        home = folder / stage.name
        records: dict[str, dict[str, Any]] = {}
        if not home.is_dir():
            continue
        manifest = Manifest(home)
        for name, spec in ports(stage.outputs).items():
            port = Port(stage, name, spec["port"], bool(spec["many"]))
            for path in sorted(home.rglob(f"{name}{schema(port.schema).suffix}")) + sorted(
                home.glob(f"{name}/*{schema(port.schema).suffix}")
            ):
                place = path.relative_to(home).parts
                key = None
                if port.many:
                    key = place[0] if stage.yields else path.stem
                item = "campaign" if stage.maps_over == "campaign" else place[0]
                outputs = records.setdefault(item, {})
                digest = hash_file(path)
                outputs[name] = digest if key is None else {**outputs.get(name, {}), key: digest}
        manifest.write(
            {item: Record("", "", {}, {}, outputs, {}) for item, outputs in records.items()},
            records,
        )


def test_run_against_itself_has_no_change_and_no_lonely_signal() -> None:
    side = side_of(small(), "a")
    partners, unpaired = pairs(side, side)
    assert {(pair.segment, pair.kind) for pair in partners} == {
        (segment, kind)
        for segment in ("train", "check")
        for kind in ("state", "model linear", "model fossen")
    }
    assert unpaired == []
    assert all(change.check.value == 0.0 for change in signal_changes(partners, 0.0))
    figures, lonely = coefficient_changes(side, side, 0.0)
    assert lonely == []
    assert figures
    assert all(check.change in (0.0, None) and check.met for _, check in figures)


def test_shift_of_one_signal_is_found_where_it_is() -> None:
    one, two = small(), small()
    fused = two.fused["check"]
    moved = column(fused, "u_m_s").copy()
    moved[20] += 0.5
    two.fused["check"] = fused.set_column(
        fused.column_names.index("u_m_s"), fused.schema.field("u_m_s"), [moved]
    )
    partners, _ = pairs(side_of(one, "a"), side_of(two, "b"))
    changed = [change for change in signal_changes(partners, 1e-6) if not change.check.met]
    assert [
        (change.segment, change.kind, change.check.quantity, change.check.unit)
        for change in changed
    ] == [("check", "state", "u", "m/s")]
    assert changed[0].largest == pytest.approx(0.5)
    assert changed[0].check.value == pytest.approx(0.5 / np.sqrt(60))
    assert changed[0].at_s == pytest.approx(
        6.0 + 20 / 20.0
    )  # the leg starts 6 s into the log, 20 samples a second


def test_other_clock_is_interpolated_within_the_overlap_only() -> None:
    t = np.arange(0, 4, 0.1)
    fields = ("x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad", *VELOCITY)
    rates = {
        name.replace("_m", "_dot_m_s", 1).replace("_rad", "_dot_rad_s", 1) for name in fields[:6]
    }
    rates |= {
        "u_dot_m_s2",
        "v_dot_m_s2",
        "w_dot_m_s2",
        "p_dot_rad_s2",
        "q_dot_rad_s2",
        "r_dot_rad_s2",
    }

    def fused(times: Any) -> Any:
        return make_table(
            "fused",
            {
                "t_s": times,
                **dict.fromkeys(fields, 2.0 * times),
                **dict.fromkeys(sorted(rates), 0.0 * times),
            },
        )

    document = SegmentRecord.model_construct(
        leg_start_s=0.0, log="dive", use="training", duration_s=4.0
    )
    one = Side("a", segments={"leg": document}, fused={"leg": fused(t)})
    two = Side(
        "b",
        segments={"leg": document.model_copy(update={"leg_start_s": 1.05})},
        fused={"leg": fused(t[:20])},
    )
    partners, unpaired = pairs(one, two)
    assert unpaired == []
    assert partners[0].times[[0, -1]] == pytest.approx([1.1, 2.9])
    np.testing.assert_allclose(
        partners[0].difference, -2.1, atol=1e-9
    )  # the same ramp, 1.05 s later; rounding
    later = replace(two, segments={"leg": document.model_copy(update={"leg_start_s": 100.0})})
    assert pairs(one, later) == ([], ["leg: state at no common time"])


def test_what_has_no_partner_is_said() -> None:
    one, two = small(), small()
    del two.segments["check"], two.cards["coe"]
    _, unpaired = pairs(side_of(one, "a"), side_of(two, "b"))
    assert unpaired == ["check: state, model linear, model fossen only in a"]
    _, lonely = coefficient_changes(side_of(one, "a"), side_of(two, "b"), 0.0)
    assert lonely == ["model coe: X u, X v, X w, X u*|v|, Y u, Y v and 18 more only in a"]


def test_two_models_of_one_run_are_partners() -> None:
    run = small()
    partners, unpaired = pairs(side_of(run, "a", model="linear"), side_of(run, "a", model="fossen"))
    assert {pair.kind for pair in partners} == {"state", "model"}
    assert unpaired == []
    assert any((change.check.value or 0.0) > 0.1 for change in signal_changes(partners, 0.0))


def call(*words: object) -> tuple[int, str]:
    result = CliRunner().invoke(cli.app, [str(word) for word in words])
    if isinstance(result.exception, PipelineError):
        return 1, str(result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def test_command_says_equal_or_names_what_moved(tmp_path: Path) -> None:
    one, two = write(tmp_path / "one", small()), small()
    for row in two.errors:
        row["rms"] *= 1.1 if row["model"] == "linear" else 1.0
    moved = write(tmp_path / "two", two)
    status, words = call("diff", one, one)
    assert (status, words.rstrip().endswith("compared)")) == (0, True)
    assert "equal within tolerance" in words
    status, words = call("diff", one, moved, "--save", tmp_path / "d.rrd")
    assert status == 1
    assert "validation  linear  all   J " in words
    assert "+10 %" in words
    viewer.verify(tmp_path / "d.rrd")
    status, words = call("diff", one, moved, "--json")
    document = json.loads(words)["answer"]
    assert (status, document["equal"]) == (1, False)
    assert {(item["model"], item["column"]) for item in document["error_tables"]} == {
        ("linear", "J")
    }


def test_run_against_its_golden_tables(tmp_path: Path) -> None:
    run = small()
    folder = tmp_path / "golden"
    folder.mkdir()
    for use, table in golden.tables_of(run.error_table().to_pylist()).items():
        (folder / f"{use}.csv").write_bytes(golden.to_csv(table))
    status, words = call("diff", write(tmp_path / "run", run), folder)
    assert status == 0, words
    assert "holds nothing else" in words


@pytest.mark.parametrize(
    ("word", "message"), [("nowhere", "no such campaign"), ("{}", "there is nothing to compare")]
)
def test_what_cannot_be_compared_is_refused(tmp_path: Path, word: str, message: str) -> None:
    status, words = call("diff", word.format(tmp_path), word.format(tmp_path))
    assert status == 1
    assert message in words


def test_unknown_model_names_the_nearest(tmp_path: Path) -> None:
    folder = write(tmp_path / "run", small())
    assert "Did you mean 'linear'" in call("diff", f"{folder}@lineal", folder)[1]


def bench_folder(folder: Path, *, shift: float = 0.0, value: float = -13.5) -> Path:
    """A bench run with one leg: its results, views and series, where the stage `rlse`
    leaves them.
    """
    leg = folder / "rlse" / "tank"
    leg.mkdir(parents=True)
    t = np.linspace(0.0, 5.0, 11)
    names = ("measured", "linear", "quadratic", "linear_and_quadratic")
    columns = {
        "t_s": t,
        "force": np.zeros(t.size),
        "chosen": ["linear"] * t.size,
        **{name: np.sin(t) + (shift if name == "linear" else 0.0) for name in names},
    }
    (leg / "channel_run.parquet").write_bytes(
        encode(make_table("channel_run", columns), "channel_run", file=leg)
    )
    view = {
        "entity": "rlse/tank/run",
        "table": "channel_run",
        "columns": list(names),
        "names": list(names),
        "roles": list(names),
    }
    views = {"groups": [{**view, "tab": "Answer", "unit": "m/s"}]}
    row = {
        "quantity": "X_udot",
        "value": value,
        "unit": "kg",
        "standard_error": 0.1,
        "verdict": "identified",
    }
    (leg / "views.json").write_bytes(encode(views, "views", file=leg))
    (leg / "results.json").write_bytes(
        encode({"title": "surge of leg tank", "rows": [row]}, "results", file=leg)
    )
    vouch(folder)
    return folder


def test_bench_runs_are_compared_by_the_figures_of_every_leg_and_the_signals_of_their_views(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = (
        bench_folder(tmp_path / "a"),
        bench_folder(tmp_path / "b", shift=0.1, value=-14.0),
    )
    assert diff.diff(str(first), str(first))
    assert OUTPUT.answer["compared"] == {
        "cells": 0,
        "figures": 1,
        "signals": 4,
    }
    assert not diff.diff(str(first), str(second))
    answer = OUTPUT.answer
    assert [(item["of"], item["quantity"], item["value"]) for item in answer["figures"]] == [
        ("surge of leg tank", "X_udot", -14.0)
    ]
    assert [(item["segment"], item["kind"], item["quantity"]) for item in answer["signals"]] == [
        ("tank", "run", "linear")
    ]
    assert answer["signals"][0]["value"] == pytest.approx(0.1)


def test_two_sides_without_anything_in_common_are_an_error_and_not_equal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = diff_operands.RunData(Side("old@1"), {}, partial=True)
    monkeypatch.setattr(diff, "read_operand", lambda word: nothing)
    with pytest.raises(PipelineError, match="nothing that could be compared"):
        diff.diff("old@1", "old@1")


def test_signals_of_the_size_of_rounding_are_equal(tmp_path: Path) -> None:
    run = small()
    side = side_of(run, "a")
    fused = dict(run.fused)
    index = fused["train"].column_names.index("v_m_s")
    noise = 1e-16 * np.random.default_rng(0).standard_normal(fused["train"].num_rows)
    still = fused["train"].set_column(
        index, fused["train"].schema.field("v_m_s"), [np.zeros(noise.size)]
    )
    moved = fused["train"].set_column(index, fused["train"].schema.field("v_m_s"), [noise])
    one, two = (
        replace(side, fused={**fused, "train": still}),
        replace(side, fused={**fused, "train": moved}),
    )
    partners, unpaired = pairs(one, two)
    assert (
        diff.difference(
            diff_operands.RunData(one, {}), diff_operands.RunData(two, {}), partners, unpaired, 1e-6
        ).signals
        == []
    )
