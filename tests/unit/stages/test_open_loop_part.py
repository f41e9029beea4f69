"""Report blocks and figures of the open-loop manoeuvres and of strip theory."""

from pathlib import Path

import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.control_cases import ControlCasesDocument
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.stages.control.open_loop import coefficients_part, open_loop_part
from auvid.stages.presentation import section

ROOT = Path(__file__).parents[3]
HAUV = vehicle_from_document(read_yaml((ROOT / "vehicles/hauv.yaml").read_text()))
CASES = parse(ControlCasesDocument, read_yaml((ROOT / "campaigns/hauv/cases.yaml").read_text()))
FEW = {name: CASES.open_loop[name] for name in ("glide_dive", "straight", "float_up")}


@pytest.fixture(scope="module")
def part():
    return open_loop_part(FEW, HAUV)


def test_figures_and_blocks_are_what_the_schemas_ask(part):
    check_document({"title": "open loop", "rows": list(part.rows)}, "results")
    check_document(section("Open loop", part.blocks, order=1), "section")
    assert len({row["quantity"] for row in part.rows}) == len(part.rows)


def test_every_statement_has_its_verdict_under_every_set(part):
    verdicts = {row["quantity"]: row.get("verdict") for row in part.rows}
    assert verdicts["open loop glide_dive, steady_u, as_simulated"] == "holds"
    assert verdicts["open loop glide_dive, steady_u, as_printed"] == "does not hold"
    assert verdicts["open loop glide_dive, steady_u, corrected"] == "does not hold"
    statements = part.blocks[0]
    under = {(row[0], row[1]): row[-2] for row in statements["rows"]}
    assert under["glide_dive", "steady_u"] == "as_simulated"
    assert under["straight", "depth"] == "none"


def test_the_runs_of_the_simulations_are_drawn(part):
    assert [run.case.name for run in part.runs] == ["glide_dive", "straight", "float_up"]
    drawn = [block for block in part.blocks if block["kind"] == "plot"]
    assert len(drawn) == 3
    assert all(len(block["panels"]) == 3 for block in drawn)


def test_runs_of_which_the_text_states_nothing_have_figures_too(part):
    values = {row["quantity"]: row["value"] for row in part.rows}
    assert values["open loop float_up, depth, as_simulated"] < -100.0
    assert 0.5 < values["open loop float_up, steady_theta, as_simulated"] < 1.0
    assert "open loop float_up, radius, as_simulated" not in values


@pytest.mark.parametrize("case", ["float_up", "dive_down", "spiral_ascent", "spiral_descent"])
def test_every_manoeuvre_of_the_text_has_rows(case):
    document = read_yaml((ROOT / "campaigns/hauv/published.yaml").read_text())
    (table,) = [table for table in document["tables"] if table["id"] == "4.1"]
    names = {row["ours"].split(", ")[1] for row in table["rows"] if f" {case}," in row["ours"]}
    assert {"depth", "steady_theta", "steady_u", "steady_w"} <= names


def test_strip_theory_beside_the_published_tables():
    part = coefficients_part(HAUV)
    check_document({"title": "strip theory", "rows": list(part.rows)}, "results")
    values = {row["quantity"]: row["value"] for row in part.rows}
    assert values["Y_v|v|, as_printed"] == pytest.approx(-246.574, abs=1e-3)
    assert values["M_q|q|, corrected"] == pytest.approx(-65.670, abs=1e-3)
    assert len(part.blocks[0]["rows"]) == len(HAUV.document.published)
