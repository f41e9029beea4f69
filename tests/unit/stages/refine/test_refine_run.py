"""The stage refine through the runner: its cards are judged like any other."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq

from tests.support.campaign_runs import auvid, write_short_example


def test_refined_models_stand_beside_the_others(tmp_path: Path) -> None:
    folder = tmp_path / "workspace"
    folder.mkdir()
    write_short_example(folder)
    manifest = folder / "campaigns/example/campaign.yaml"
    text = manifest.read_text(encoding="utf-8")
    refine = "\nstages:\n  refine: {models: [fossen], estimator: output_error}"
    manifest.write_text(text.replace("\nstages:", refine), encoding="utf-8")
    printed = auvid("run", "example", folder=folder)
    assert "fossen_output_error" in printed
    results = folder / "runs/example"
    card = json.loads((results / "refine/model_card/fossen_output_error.json").read_text())
    assert card["method"] == "output error"
    errors = pq.read_table(results / "validate/error_table.parquet").to_pylist()
    ratio = {
        row["model"]: row["ratio"]
        for row in errors
        if row["use"] == "training" and row["leg"] == row["axis"] == "all"
    }
    assert ratio["fossen_output_error"] < 1.0
    assert set(ratio) == {"fossen", "fossen_output_error"}
    page = (results / "report/report_html.html").read_text(encoding="utf-8")
    assert "Models fitted to the sensors themselves" in page
    assert page.count("Fossen (output error)") > 2
