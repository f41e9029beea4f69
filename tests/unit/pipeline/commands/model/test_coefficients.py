"""`auvid coefficients`: text, JSON, and what it refuses."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline import cli
from auvid.pipeline.commands.model.coefficients import coefficients_of

ROOT = Path(__file__).parents[5]


def test_text_shows_value_unit_formula_source_and_the_published_value():
    outcome = CliRunner().invoke(cli.app, ["coefficients", "hauv", "--set", "as_printed"])
    assert outcome.exit_code == 0
    lines = outcome.output.splitlines()
    at = next(index for index, line in enumerate(lines) if line.startswith("  N_v|v|"))
    assert lines[at].split()[1:6] == ["-16.016", "kg", "-16.016", "(Table", "2.10)"]
    assert r"\nu_f" in lines[at]
    assert "Al Makdah 2016 (2.89)" in lines[at]


def test_json_holds_the_same_and_a_model_that_a_simulation_can_take():
    outcome = CliRunner().invoke(
        cli.app, ["coefficients", "hauv", "--set", "as_simulated", "--json"]
    )
    answer = json.loads(outcome.output)["answer"]
    rows = {
        row["name"]: row for row in answer["coefficients"] if row["kind"] in ("added_mass", "drag")
    }
    assert rows["X_u|u|"]["value"] == -67.7
    assert rows["X_u|u|"]["published"] == -4.593
    assert answer["viscous_model"]["X"] == {"u*|u|": -67.7}


def test_a_published_model_stands_beside_the_terms_that_both_have():
    terms = coefficients_of("vt690", model="prestero")["model"]["terms"]
    assert {(row["axis"], row["term"]) for row in terms} >= {
        ("Y", "u*v"),
        ("K", "p*|p|"),
        ("N", "r*|r|"),
    }
    surge = next(row for row in terms if row["axis"] == "X")
    assert (surge["term"], surge["published"]) == ("u*|u|", -4.977)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"vehicle": "hauvv"}, "no such vehicle.*hauv"),
        ({"vehicle": "bluerov2_heavy"}, "bluerov2_heavy.yaml.*no geometry"),
        (
            {"vehicle": "vt690", "parameter_set": "as_simulated"},
            "no coefficients for this parameter set",
        ),
        ({"vehicle": "hauv", "parameter_set": "printed"}, "unknown parameter set.*as_printed"),
        (
            {"vehicle": "vt690", "model": "presero"},
            "no published coefficients of this model.*prestero",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_a_remedy(arguments, message):
    with pytest.raises(PipelineError, match=message):
        coefficients_of(**arguments)


def test_a_fin_outside_the_hull_is_named_with_file_and_line(tmp_path):
    path = tmp_path / "odd.yaml"
    text = (
        (ROOT / "vehicles/hauv.yaml")
        .read_text()
        .replace("x_rear: {value: -0.76,", "x_rear: {value: -1.76,")
    )
    path.write_text(text)
    outcome = CliRunner().invoke(cli.app, ["coefficients", str(path)])
    assert isinstance(outcome.exception, PipelineError)
    line = next(number for number, row in enumerate(text.splitlines(), start=1) if "-1.76" in row)
    assert (
        f"odd.yaml, row {line}, field 'geometry.surfaces.fins.x_rear': the surface lies outside the"
        " hull" in str(outcome.exception)
    )
