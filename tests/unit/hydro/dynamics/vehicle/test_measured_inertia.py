"""Measured moments of inertia in the place of those of a vehicle file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.vehicle.vehicle import InertiaDocument, VehicleDocument
from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.measured_inertia import with_measured_inertia
from auvid.pipeline.campaigns.vehicle_files import load_vehicle

THAUS = Path(__file__).parents[5] / "vehicles" / "thaus.yaml"
MEASURED = {
    "vehicle": "thaus",
    "source": "pendulum",
    "I_x": {"value": 1.8, "unit": "kg*m^2", "source": "swing x"},
}


def test_measured_axes_replace_those_of_the_file_about_the_origin() -> None:
    document = read_yaml(THAUS.read_text(encoding="utf-8"))
    document["rigid_body"]["centre_of_gravity"]["value"] = [0.1, 0.0, 0.05]
    original, measured = parse(VehicleDocument, document), parse(InertiaDocument, MEASURED)
    before = original.model_dump_json()
    changed = with_measured_inertia(original, measured)
    vehicle = vehicle_from_document(changed)
    # I_x about the origin: I_x + m (y^2 + z^2).
    np.testing.assert_allclose(np.diag(vehicle.inertia), [1.8 + 38.10 * 0.05**2, 2.2278, 1.4046])
    assert original.model_dump_json() == before
    assert "the rest: Table 7" in changed.rigid_body.inertia.source


def test_vehicle_file_names_the_document(tmp_path: Path) -> None:
    text = THAUS.read_text(encoding="utf-8").replace(
        "rigid_body:\n", "rigid_body:\n  measured_inertia: measured.json\n"
    )
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(PipelineError, match=r"measured\.json"):
        load_vehicle(tmp_path / "mine.yaml")
    (tmp_path / "measured.json").write_text(json.dumps(MEASURED), encoding="utf-8")
    assert load_vehicle(tmp_path / "mine.yaml").vehicle.inertia[0, 0] == 1.8
    (tmp_path / "measured.json").write_text(
        json.dumps({**MEASURED, "I_w": MEASURED["I_x"]}), encoding="utf-8"
    )
    with pytest.raises(PipelineError, match="unknown key"):
        load_vehicle(tmp_path / "mine.yaml")
