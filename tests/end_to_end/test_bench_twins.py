"""auvid reproduce on the bench twins: simulated, written as logs, identified, and held
against the printed tables.
"""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.published_values import PublishedValuesDocument
from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline import cli
from auvid.pipeline.commands.reproduce import printed_values as comparison
from auvid.pipeline.commands.run.run_summary import comparison_rows
from auvid.stages.reference_check import SHOWS

ROOT = Path(__file__).parents[2]
KEPT = ("decay_empty", "decay_surge", "decay_surge_check", "swing_tray", "swing_x")


def small_workspace(folder: Path) -> Path:
    """A workspace with the REMUS twin cut down to one decay and one swing with their
    empty runs; returns its campaign folder.
    """
    campaign = folder / "campaigns" / "small"
    shutil.copytree(ROOT / "campaigns/remus_twin", campaign)
    (folder / "params.yaml").write_text("campaigns: [small]\n", encoding="utf-8")
    plan = load(campaign / "plans/thesis.yaml")
    for kind in ("decays", "swings"):
        plan["bench"][kind] = [entry for entry in plan["bench"][kind] if entry["id"] in KEPT]
    apparatus = load(campaign / "apparatus.yaml")
    for part, entries in (("free_decay", "decays"), ("quadrifilar", "swings")):
        apparatus[part][entries] = [
            entry for entry in apparatus[part][entries] if set(entry["legs"]) <= set(KEPT)
        ]
    published = load(campaign / "published.yaml")
    kept = {"Table 11", "Table 8", "Table 14"}
    published["tables"] = [table for table in published["tables"] if table["id"] in kept]
    for table in published["tables"]:
        table["rows"] = [
            row for row in table["rows"] if not any(other in row["ours"] for other in OTHERS)
        ]
    published["figures"] = [
        entry
        for entry in published["figures"]
        if all(line["recording"] in KEPT for line in entry["lines"])
    ]
    save(campaign / "plans/thesis.yaml", plan)
    save(campaign / "apparatus.yaml", apparatus)
    save(campaign / "published.yaml", published)
    return campaign


OTHERS = ("surge_noisy:", "surge_linear:", "surge_quadratic:", "remus_y", "remus_z", ":I_y", ":I_z")


def load(path: Path) -> Any:
    return read_yaml(path.read_text(encoding="utf-8"))


def save(path: Path, document: Any) -> None:
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")


def reproduce() -> tuple[int, str]:
    done = CliRunner().invoke(cli.app, ["reproduce", "small"], catch_exceptions=False)
    return done.exit_code, done.output


def test_printed_values_are_found_and_a_missed_bound_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = small_workspace(tmp_path)
    monkeypatch.chdir(tmp_path)
    status, printed = reproduce()
    assert status == 0, printed
    assert "Table 14" in printed
    assert "bounds: " in printed
    assert "missed" not in printed
    run = comparison.open_comparison("small")
    assert run is not None
    rows = comparison_rows(run)
    bounded = [row for row in rows if row["met"] is not None]
    assert len(bounded) >= 6
    page = (tmp_path / "runs/small/report/report_html.html").read_text(encoding="utf-8")
    assert "Errata of the source" in page
    assert "Printed tables beside ours" in page
    assert "Figure 25: velocity of REMUS in the free decay, surge" in page
    published = load(campaign / "published.yaml")
    published["tables"][-1]["rows"][0]["truth"] = -50.0
    save(campaign / "published.yaml", published)
    status, printed = reproduce()
    assert status == 1
    assert "missed" in printed
    by_construction = [row for row in bounded if row["evidence"] == "construction"]
    assert f"bounds: 0 of {len(bounded)} test the method (0 met)" in printed
    assert (
        f"{len(by_construction)} hold by construction ({len(by_construction) - 1} met)" in printed
    )


@pytest.mark.parametrize("name", ["thaus_twin", "remus_twin"])
def test_documents_of_the_campaigns_agree(name: str) -> None:
    """Every run names what the apparatus has, every leg of the apparatus is flown, and
    every erratum of a table is listed.
    """
    folder = ROOT / "campaigns" / name
    plan, apparatus, published = (
        load(folder / file) for file in ("plans/thesis.yaml", "apparatus.yaml", "published.yaml")
    )
    for document, schema in (
        (plan, "plan"),
        (apparatus, "apparatus"),
        (published, "published_values"),
    ):
        check_document(document, schema)
    flown = {entry["id"] for kind in ("decays", "swings") for entry in plan["bench"][kind]}
    named_legs = [
        leg
        for part, kind in (("free_decay", "decays"), ("quadrifilar", "swings"))
        for entry in apparatus[part][kind]
        for leg in entry["legs"]
    ]
    assert set(named_legs) == flown
    listed = {entry["id"] for entry in published["errata"]}
    assert {
        erratum for table in published["tables"] for erratum in table.get("errata", ())
    } <= listed
    if name == "thaus_twin":
        document = parse(PublishedValuesDocument, published)
        kinds = Counter(
            table.evidence_of(row)[0]
            for table in document.tables
            for row in table.rows
            if row.bounded
        )
        words = [
            f"{kinds['method']} of {kinds.total()} test the method ({kinds['method']} met)",
            *(f"{kinds[kind]} {SHOWS[kind]} ({kinds[kind]} met)" for kind in list(SHOWS)[1:]),
        ]
        page = " ".join((ROOT / "docs/howto/twin.md").read_text(encoding="utf-8").split())
        assert f"bounds: {', '.join(words)}" in page
        assert listed == {f"A{number}" for number in range(1, 31)}
