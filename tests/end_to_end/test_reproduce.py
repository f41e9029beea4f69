"""auvid reproduce on the short plan: page, tables and bounds from logs that the
variants share; only what is stale is made again.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import yaml
from typer.testing import CliRunner

from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline import cli

ROOT = Path(__file__).parents[2]
TWIN = ROOT / "campaigns/vt690_twin"
KEPT = ("as_published", "corrected", "true_states")


def setting(folder: Path) -> dict[str, Any]:
    """A workspace whose twin flies the short plan, with three variants; returns the
    document of variants.
    """
    campaign = folder / "campaigns" / "small"
    (campaign / "published").mkdir(parents=True)
    (folder / "params.yaml").write_text("campaigns: [small]\n", encoding="utf-8")
    (campaign / "published/error_tables.csv").write_bytes(
        (TWIN / "published/error_tables.csv").read_bytes()
    )
    (campaign / "reproduce.md.j2").write_bytes((TWIN / "reproduce.md.j2").read_bytes())
    plan = read_yaml((TWIN / "plans/short.yaml").read_text(encoding="utf-8"))
    (campaign / "plan.yaml").write_text(yaml.safe_dump(plan | {"settle_s": 10}), encoding="utf-8")
    manifest = {"kind": "twin", "vehicle": "vt690", "simulate": {"plan": "plan.yaml", "seed": 5}}
    (campaign / "campaign.yaml").write_text(yaml.safe_dump(manifest), encoding="utf-8")
    document: dict[str, Any] = read_yaml((TWIN / "reproduce.yaml").read_text(encoding="utf-8"))
    document["plans"] = [{"id": "short", "plan": "plan.yaml", "meaning": "two legs"}]
    document["variants"] = [variant for variant in document["variants"] if variant["id"] in KEPT]
    for variant in document["variants"]:
        variant["stages"]["synthesise"] = {"models": ["linear", "prestero", "fossen"]}
    document["figures"] = {}
    document["expected"] = [
        {"plan": "short", "variant": "as_published", "figure": "force_error", "low": 10.0},
        {"plan": "short", "variant": "true_states", "figure": "force_error", "high": 0.05},
        {
            "plan": "short",
            "variant": "corrected",
            "figure": "ratio",
            "models": ["fossen"],
            "high": 0.5,
        },
        {
            "plan": "short",
            "variant": "corrected",
            "figure": "force_error",
            "high": 0.01,
            "accepted_reason": "sensors have noise",
        },
    ]
    for entry in document["expected"]:
        entry.update(evidence="unprinted", reason="the thesis has no such run")
    document["expected"][2].update(evidence="method", reason="it could be missed")
    write(folder, document)
    return document


def write(folder: Path, document: dict[str, Any]) -> None:
    (folder / "campaigns/small/reproduce.yaml").write_text(
        yaml.safe_dump(document), encoding="utf-8"
    )


def changed_at(folder: Path, item: str) -> str:
    """When an item ran: the time of change of its manifest."""
    return str((folder / "runs/small/reproduce" / item / "manifest.json").stat().st_mtime_ns)


def test_page_tables_bounds_and_freshness(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = setting(tmp_path)
    monkeypatch.chdir(tmp_path)
    first = CliRunner().invoke(cli.app, ["reproduce", "small"], catch_exceptions=False)
    assert first.exit_code == 0, first.output
    assert (
        "bounds: 1 of 4 tests the method (1 met), 3 have no printed value (2 met)" in first.output
    )
    assert "sensors have noise" in first.output
    folder = tmp_path / "runs/small/reproduce"
    page = (folder / "page/page.html").read_text(encoding="utf-8")
    for words in (
        "Table 5.1 (validation)",
        "Figure 1.2",
        "Figure 5.4",
        "Figure 5.15: ",
        "0.278, but the table prints 0.250",
        "123.7 kg",
    ):
        assert words in page, words
    assert "<script src" not in page
    rows = {
        (row["variant"], row["use"], row["model"]): row
        for row in pq.read_table(folder / "page/errors.parquet").to_pylist()
    }
    wrong, right = (
        rows[(name, "validation", "fossen")] for name in ("as_published", "true_states")
    )
    assert wrong["ratio"] > 0.7 > 0.4 > right["ratio"]
    assert wrong["j0"] > 1.5 * right["j0"]
    assert wrong["published_ratio"] == pytest.approx(0.7796)
    assert {path.parent.parent.name for path in folder.glob("short/*/ingest/manifest.json")} == {
        "flight"
    }
    assert {path.parent.parent.name for path in folder.glob("short/*/simulate/manifest.json")} == {
        "flight"
    }

    times = {
        item: changed_at(tmp_path, item)
        for item in (
            "short/flight/simulate",
            "short/as_published/fuse",
            "short/corrected/fuse",
            "page",
        )
    }
    CliRunner().invoke(cli.app, ["reproduce", "small"], catch_exceptions=False)
    assert {item: changed_at(tmp_path, item) for item in times} == times

    document["variants"][1]["stages"]["fuse"]["cutoff_hz"] = 2.0
    document["expected"][2]["high"] = 0.01
    write(tmp_path, document)
    again = CliRunner().invoke(cli.app, ["reproduce", "small"], catch_exceptions=False)
    assert again.exit_code == 1
    assert "missed" in again.output
    changed = {item for item, before in times.items() if changed_at(tmp_path, item) != before}
    assert changed == {"short/corrected/fuse", "page"}
    record = json.loads(
        (folder / "short/corrected/fuse/manifest.json").read_text(encoding="utf-8")
    )["items"]
    assert {item["params"]["cutoff_hz"] for item in record.values()} == {2.0}


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        (
            "published/error_tables.csv",
            "table,set\n5.1,training\n",
            "not a row of published errors",
        ),
        ("published/error_tables.csv", "", "the table of published errors is empty"),
        ("plan.yaml", "title: x\nlegs: []\n", "the plan has no legs"),
    ],
)
def test_what_cannot_be_read_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str, text: str, words: str
) -> None:
    setting(tmp_path)
    (tmp_path / "campaigns/small" / file).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli.app, ["reproduce", "small"])
    assert words in str(result.exception)
    assert not (tmp_path / "runs/small/reproduce/page/page.html").exists()
