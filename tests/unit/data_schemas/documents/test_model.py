"""Faults of documents as a user reads them, and JSON schemas for editors."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Annotated, Any

import pytest

from auvid.data_schemas.documents import MODELS, check_document, model_of
from auvid.data_schemas.documents.model import Model, Range, parse
from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.errors import ManyFaults, PipelineError
from auvid.data_schemas.yaml_text import read_yaml

ROOT = Path(__file__).parents[4]
DOCUMENT = read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text(encoding="utf-8"))


def changed(value: Any, *path: str) -> dict[str, Any]:
    document = copy.deepcopy(DOCUMENT)
    part = document
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    return document


@pytest.mark.parametrize(
    ("document", "words"),
    [
        (changed(1, "titel"), ["'titel'", "unknown key", "Did you mean 'title'?"]),
        (changed(1, "qqqq"), ["'qqqq'", "unknown key", "Known keys: name, title"]),
        (changed(3, "title"), ["'title'", "wrong type", "found 3", "string. YAML", "quotes"]),
        (changed({}, "rigid_body", "mass"), ["'rigid_body.mass.value'", "missing key", "source"]),
        (changed("kg", "rigid_body", "mass", "value"), ["rigid_body.mass.value", "not numbers"]),
        (changed(True, "rigid_body", "mass", "value"), ["rigid_body.mass.value", "not numbers"]),
        (changed("fill in a, b", "rigid_body", "mass", "value"), ["No log tells it: write"]),
        (changed("1e3", "rigid_body", "mass", "value"), ["not numbers", "a sign: 1.0e+3"]),
        (changed({"value": 14, 0: None}, "rigid_body", "mass"), ["14.0 and not 14,0"]),
        (changed([14.0], "rigid_body", "mass", "value"), ["found [14.0]; allowed: one number"]),
        (
            changed(1.0, "rigid_body", "centre_of_buoyancy", "value"),
            ["wrong shape; found 1.0; allowed: a list of 3 numbers"],
        ),
        (changed([1.0], "rigid_body", "inertia", "value"), ["a list of 3 lists of 3 numbers"]),
        (
            changed("mV", "actuators", "thrusters", "thrust_curve", "voltage", "unit"),
            ["thrust_curve.voltage'", "out of range; found 0.0", "1 to 1000 V"],
        ),
        (
            changed(11, "actuators", "thrusters", "thrust_curve", "voltage_exponent", "value"),
            ["out of range; found 11.0; allowed: 0 to 3"],
        ),
        (changed([[1], 2], "rigid_body", "mass", "value"), ["not numbers"]),
        (changed(5, "rigid_body"), ["'rigid_body'", "not a mapping"]),
        (changed(16, "sensors", "depth", "barometer_instance"), ["found 16", "allowed: 0 to 15"]),
        (changed(1.5, "sensors", "depth", "barometer_instance"), ["wrong type", "integer"]),
        ([], ["not a mapping"]),
    ],
)
def test_a_fault_says_field_value_and_remedy(document: object, words: list[str]) -> None:
    with pytest.raises(PipelineError) as caught:
        parse(VehicleDocument, document, file="rov.yaml")
    text = str(caught.value)
    assert text.startswith("rov.yaml")
    assert [word for word in words if word not in text] == []


def test_all_faults_come_together_by_row_the_first_twenty_and_the_count() -> None:
    class Numbers(Model):
        values: list[Annotated[float, Range(0.0, 1.0)]]

    with pytest.raises(ManyFaults) as caught:
        parse(
            Numbers,
            {"valeus": 1, "values": [2.0] * 24},
            file="n.yaml",
            row=lambda field: 1 if field == "valeus" else 2,
        )
    lines = str(caught.value).splitlines()
    assert lines[0] == "n.yaml: 25 faults"
    assert lines[1].startswith("  n.yaml, row 1, field 'valeus'")
    assert lines[2].startswith("  n.yaml, row 2, field 'values[0]': out of range; found 2.0")
    assert lines[-1] == "  ... and 5 more"
    assert len(lines) == 22


@pytest.mark.parametrize("name", MODELS)
def test_every_field_of_every_document_says_what_it_is(name: str) -> None:
    schema = model_of(name).model_json_schema()
    json.dumps(schema)
    for part in (schema, *schema.get("$defs", {}).values()):
        assert part["description"]
        bare = [
            key for key, spec in part["properties"].items() if not {"description", "$ref"} & {*spec}
        ]
        assert bare == []


def test_a_key_that_holds_a_part_says_what_it_is_too() -> None:
    """Meanings are read when somebody asks, not at every start."""
    assert "use_attribute_docstrings" not in Model.model_config
    schema = model_of("column_map").model_json_schema()
    assert schema["properties"]["time"] == {
        "$ref": "#/$defs/TimeEntry",
        "description": "The time column.",
    }


def test_json_schema_holds_ranges_choices_and_refuses_unknown_keys() -> None:
    schema = model_of("campaign").model_json_schema()
    assert schema["additionalProperties"] is False
    assert "identification" in schema["properties"]["kind"]["enum"]
    start = schema["$defs"]["LegEntry"]["properties"]["start_s"]["anyOf"][0]
    assert (start["minimum"], "maximum" in start) == (0, False)


def test_tuples_pass_for_lists_in_documents_that_stages_make() -> None:
    check_document({"title": "figures", "rows": ()}, "results")
