"""The model file of a glider: its forces balance in the glides that it was fitted to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.records.model_file import ModelFile
from auvid.hydro.dynamics.gliding.steady_glide import GlideState, Polar, steady_glide
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.glider_body import glider_body
from auvid.hydro.model_file import forces, vehicle_of
from auvid.stages import glide, ingest, model_file
from auvid.stages.base import collection
from tests.unit.stages.glide.test_glide import document, ingested, run, without

__all__ = ["ingested"]
PROVENANCE: dict[str, Any] = {"logs": {}, "vehicle": "", "stages": {}, "packages": {}}


def filed(outputs: glide.Outputs) -> ModelFile:
    """Return the model file of a glide."""
    vehicle = vehicle_from_document(VehicleDocument.model_validate(document()))
    files = model_file.run(
        model_file.Inputs(
            {"title": "glide"},
            vehicle,
            PROVENANCE,
            collection(dict(outputs.model_card)),
            outputs.ranking,
            None,
        ),
        model_file.Params(),
    )
    return files.model_file["glide"]


def test_forces_of_the_file_balance_in_steady_glides(ingested: ingest.Outputs) -> None:
    """The balance of Merckelbach et al. by coefficients, the file by its terms."""
    model = filed(run(ingested))
    assert model.partial is not None
    of = {item.quantity: item.value for item in model.partial.without_newtons}
    polar = Polar(of["C_D0"], of["C_D1"], of["C_L_alpha"], of["alpha_0"])
    pitch = np.radians([-28.0, -22.0, -18.0, 18.0, 22.0, 28.0])
    drive = np.where(pitch < 0.0, -2e-4, 2.2e-4)
    body = glider_body(vehicle_of(model))
    density = np.full(6, body.neutral_kg_m3)
    state = GlideState(pitch, drive, density, np.zeros(6), np.full(6, body.temperature_K))
    trim_kg = model.dynamics.buoyancy_N / body.gravity - body.mass_kg
    steady = steady_glide(state, body=body, polar=polar, trim_m3=trim_kg / body.neutral_kg_m3)
    nu, eta = np.zeros((6, 6)), np.zeros((6, 6))
    nu[:, 0] = steady.speed_m_s * np.cos(steady.alpha_rad)
    nu[:, 2] = steady.speed_m_s * np.sin(steady.alpha_rad)
    eta[:, 4] = pitch
    parts = forces(model, nu, eta)
    up = body.neutral_kg_m3 * body.gravity * drive  # the buoyancy drive is the caller's
    by_drive = np.column_stack([up * np.sin(pitch), -up * np.cos(pitch)])
    left = (parts.viscous + parts.restoring)[:, [0, 2]] + by_drive
    assert np.all(np.abs(left) < 0.01 * np.abs(up)[:, None])
    assert np.isnan(parts.viscous[:, [1, 3, 4, 5]]).all()


def test_verdicts_follow_what_the_record_tells(ingested: ingest.Outputs) -> None:
    with_speed, bare = filed(run(ingested)), filed(run(ingested, without("speed_m_s")))
    verdict = {
        name: {f"{item.axis}_{item.term}": item.verdict for item in model.coefficients}
        for name, model in (("with", with_speed), ("bare", bare))
    }
    assert verdict["with"]["Z_u*w"] == "identified"
    assert verdict["bare"]["Z_u*w"] == "from the prior"
    # Every glide has the same pitch: drag without lift goes with the file's induced drag.
    assert verdict["with"]["X_u*u"] == "from the prior"
    assert with_speed.use.axes is not None
    assert with_speed.use.axes.simulation == ["X", "Z"]
    assert with_speed.use.axes.control == []
    assert with_speed.partial is not None
    assert set(with_speed.partial.lacking) == {"Y", "K", "M", "N"}
    trim = with_speed.partial.displaced
    assert trim is not None
    assert with_speed.dynamics.buoyancy_N == pytest.approx(9.81 * trim.value_kg)
    assert trim.interval_95[0] < trim.value_kg < trim.interval_95[1]


def test_dives_alone_give_a_file_for_nothing(ingested: ingest.Outputs) -> None:
    def dives(columns: dict[str, Any]) -> None:
        up = columns["pitch_rad"] > 0.0
        columns["pitch_rad"] = np.where(up, np.nan, columns["pitch_rad"])

    model = filed(run(ingested, dives))
    assert not model.use.recommended
    assert {
        item.verdict for item in model.coefficients if item.axis == "X" and item.term == "u*u"
    } == {"inseparable"}
