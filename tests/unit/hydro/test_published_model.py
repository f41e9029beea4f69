"""Published sets as model files: they stand alone, and claim nothing of data."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.export import prepare
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.model_file import forces, vehicle_of
from auvid.hydro.published_model import missing_parts, published_model
from auvid.pipeline.campaigns.vehicle_files import load_published, load_vehicle, shelf_files
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES
from auvid.pipeline.store.model_files import read_model, write_model

SHELF = shelf_files()
VT690 = [name for name in SHELF if name.startswith("vt690_")]


@pytest.mark.parametrize("name", SHELF)
def test_a_published_set_is_a_model_file_that_stands_alone(name: str, tmp_path: Path) -> None:
    vehicle = load_published(SHELF[name])
    model = published_model(vehicle, vehicle_hash="0", version="0")
    write_model(model, tmp_path / "set.json")
    again = read_model(tmp_path / "set.json")
    assert again.model_dump() == model.model_dump()
    np.testing.assert_array_equal(vehicle_of(again).mass_matrix, vehicle.mass_matrix)
    assert again.name == name
    assert {item.verdict for item in again.coefficients} == {"published"}
    assert not any(item.determined for item in again.coefficients)
    assert not any(item.interval_95 or item.standard_error for item in again.coefficients)
    assert (again.covariance, again.validity, again.validation) == ({}, {}, None)
    assert not again.use.recommended
    assert again.use.axes is None


@pytest.mark.parametrize("name", VT690)
def test_the_models_of_the_690_have_the_forces_of_their_tables(name: str) -> None:
    """Sign, axis, term and number, as the CSV file has them."""
    path = SHELF[name]
    random = np.random.default_rng(7)
    nu, rev_s = random.uniform(-1.5, 1.5, (20, 6)), random.uniform(30.0, 50.0, 20)
    model = published_model(load_published(path), vehicle_hash="0", version="0")
    screw = model.dynamics.propeller
    assert screw is not None
    level = np.interp(rev_s, screw.level_speed_rev_s, screw.level_speed_m_s)
    ratio = level / np.sqrt((nu[:, :3] ** 2).sum(axis=1))
    expected = np.zeros((20, 6))
    with path.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            (values,) = basis_rows(nu.T, ratio, [row["term"]])
            expected[:, AXES.index(row["axis"])] += float(row["value"]) * values
    ours = forces(model, nu, np.zeros((20, 6)), rev_s).viscous
    np.testing.assert_allclose(ours, expected, rtol=1e-12, atol=1e-9)


def test_what_a_set_has_not_is_named() -> None:
    assert missing_parts(load_published(SHELF["remus100_alberti_2015"])) == [
        "intervals",
        "range of validity",
        "damping in roll, pitch, yaw",
        "actuators",
    ]
    assert missing_parts(load_published(SHELF["vt690_fossen"])) == [
        "intervals",
        "range of validity",
    ]
    model = published_model(
        load_published(SHELF["bluerov2_li_2020"]), vehicle_hash="0", version="0"
    )
    page = prepare(model, "mss").files["README_bluerov2_li_2020_mss.md"]
    assert "no damping in roll, pitch, no actuators" in page


def test_a_vehicle_without_published_damping_is_no_model() -> None:
    vehicle = load_vehicle(SHIPPED_VEHICLES / "remus100.yaml").vehicle
    with pytest.raises(DataError, match="so it is no model"):
        published_model(vehicle, vehicle_hash="0", version="0")
