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
    verdicts = {row["quantity"]: row["verdict"] for row in part.rows}
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


def test_strip_theory_beside_the_published_tables():
    part = coefficients_part(HAUV)
    check_document({"title": "strip theory", "rows": list(part.rows)}, "results")
    values = {row["quantity"]: row["value"] for row in part.rows}
    assert values["Y_v|v|, as_printed"] == pytest.approx(-246.574, abs=1e-3)
    assert values["M_q|q|, corrected"] == pytest.approx(-65.670, abs=1e-3)
    assert len(part.blocks[0]["rows"]) == len(HAUV.document.published)
