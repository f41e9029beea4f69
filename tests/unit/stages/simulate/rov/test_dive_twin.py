"""Dives as logs: read back by our readers in all formats, refits, truth tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.tables import column, matrix
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.basis import basis
from auvid.pipeline.campaigns.twin import load_truth
from auvid.stages import fuse, ingest, resample, residual, simulate
from auvid.stages.base import RawFile, RawLog
from auvid.stages.columns import ACCELERATION, POSE, VELOCITY, clock, force_columns
from auvid.stages.simulate.csv_writer import column_maps
from auvid.stages.simulate.rov.dive_plans import dive_entries, dive_plan
from auvid.stages.simulate.rov.dives import DivesResult, fly_plan
from auvid.stages.truth_lookup import true_values

ROOT = Path(__file__).parents[5]


def vehicle(name: str) -> Any:
    return vehicle_from_document(
        read_yaml((ROOT / f"vehicles/{name}.yaml").read_text(encoding="utf-8"))
    )


HEAVY = vehicle("bluerov2_heavy")
PHYSICS = {"kind": "physics", "name": "physics", "source": "flow physics"}
DRIVEN = {
    "forward": {"kind": "random", "amplitude": 0.6, "hold_s": 2.0},
    "lateral": {"kind": "random", "amplitude": 0.6, "hold_s": 2.0},
    "heave": {"kind": "multisine", "amplitude": 0.6},
    "yaw": {"kind": "random", "amplitude": 0.6, "hold_s": 2.0},
    "roll": {"kind": "multisine", "amplitude": 0.6, "highest_hz": 1.0},
    "pitch": {"kind": "multisine", "amplitude": 0.6, "highest_hz": 1.0},
}
PLAN: dict[str, Any] = {
    "kind": "dives",
    "title": "One short dive",
    "settle_s": 5,
    "sensors": {"imu": {"gyro_sd_rad_s": 0.001, "gyro_bias_sd_rad_s": 0.002}},
    "legs": [
        {
            "id": "a",
            "duration_s": 20,
            "use": "training",
            "modes": [{"at_s": 0, "mode": "stabilize"}, {"at_s": 8, "mode": "alt_hold"}],
            "sticks": DRIVEN,
        }
    ],
}


def twin(**changes: object) -> TwinDocument:
    common = {"seed": 3, "format": "bin", "accelerometer": "specific_force"}
    return parse(TwinDocument, {"plan": PLAN, "truth": PHYSICS, **common, **changes})


@pytest.fixture(scope="module")
def result() -> DivesResult:
    return fly_plan(HEAVY, twin())


def read_back(format: str) -> Any:
    outputs = simulate.run(simulate.Inputs(HEAVY, twin(format=format)), simulate.Params())
    maps = column_maps(accelerometer="specific_force")
    logs, _ = dive_entries(PLAN, format=format)
    files = []
    for item in logs[0].get("files", logs):
        buffer = np.frombuffer(outputs.logs[item["file"]], np.uint8)
        columns = maps[Path(item["columns"]).stem] if "columns" in item else None
        files.append(RawFile(item["file"], buffer, columns))
    assert set(outputs.logs) == {item["file"] for item in logs[0].get("files", logs)}
    source = RawLog("a", tuple(files))
    return ingest.run(ingest.Inputs(source, None, HEAVY), ingest.Params())


@pytest.mark.parametrize("format", ["bin", "tlog", "csv"])
def test_our_readers_read_what_was_recorded(format: str, result: DivesResult) -> None:
    tables = read_back(format)
    streams = result.recorded["a"].streams
    tolerance = {"bin": 2e-6, "tlog": 2e-5, "csv": 1e-12}[format]
    for stream in ("imu", "attitude", "velocity", "depth"):
        columns = {name: values for name, values in streams[stream].items() if name != "time_us"}
        table = getattr(tables, stream)
        assert np.array_equal(column(table, "time_us"), streams[stream]["time_us"])
        for name, values in columns.items():
            error = column(table, name) - values
            if name == "psi_rad":
                error = np.remainder(error + np.pi, 2.0 * np.pi) - np.pi
            assert np.abs(error).max() < tolerance * max(1.0, np.abs(values).max()), name
    for number in range(1, 9):
        name = f"pwm_{number}_us"
        assert np.array_equal(column(tables.actuators, name), streams["actuators"][name])
    volts = {"bin": 1e-5, "tlog": 6e-4, "csv": 1e-12}[format]
    battery = column(tables.battery, "voltage_v") - streams["battery"]["voltage_v"]
    assert np.abs(battery).max() < volts


@pytest.mark.parametrize("format", ["bin", "tlog"])
def test_modes_and_arming_are_logged(format: str) -> None:
    mode = read_back(format).mode
    assert mode.column("mode").to_pylist() == ["STABILIZE", "ALT_HOLD"]
    assert mode.column("armed").to_pylist() == [True, True]
    moments = (column(mode, "time_us") - 10_000_000) / 1e6
    assert moments == pytest.approx([0.0, 10.0], abs=1.0 if format == "tlog" else 1e-6)


def test_the_log_has_the_parameters_of_its_motors() -> None:
    parameters = read_back("bin").log_info.parameters
    assert [parameters[f"MOT_{i}_DIRECTION"] for i in range(1, 9)] == [-1, -1, 1, 1, -1, 1, 1, -1]
    assert [parameters[f"SERVO{i}_FUNCTION"] for i in range(1, 9)] == list(range(33, 41))


def test_the_truth_table_holds_the_equation_of_motion(result: DivesResult) -> None:
    truth = result.truth["a"]
    thrust = matrix(truth, [f"thruster_{i}_N" for i in range(1, 9)])
    force = residual_force(
        HEAVY,
        matrix(truth, POSE),
        matrix(truth, VELOCITY),
        matrix(truth, ACCELERATION),
        Control(thruster_force_N=thrust),
    ).tau_bar
    parts = ("viscous", "tether", "buoyancy", "thrust_loss", "inertia", "unsteady")
    total = sum(matrix(truth, force_columns(part)) for part in parts)
    np.testing.assert_allclose(total, matrix(truth, force_columns("tau_bar")), atol=1e-12)
    np.testing.assert_allclose(force, total, atol=1e-9)


@pytest.mark.parametrize("form", ["linear", "symmetric_quadratic", "fossen"])
def test_a_refit_is_a_truth_inside_its_form(form: str) -> None:
    """Fit the truth's own motion with its own form: its coefficients come back."""
    truth = {"kind": "refit", "name": form, "source": "refitted"}
    outcome = fly_plan(HEAVY, twin(truth=truth))
    table = outcome.truth["a"]
    for index, (axis, terms) in enumerate(outcome.document["coefficients"].items()):
        assert axis == "XYZKMN"[index]
        tau = column(table, force_columns("tau_bar")[index])
        columns = basis(matrix(table, VELOCITY), None, tuple(terms))
        fit = np.linalg.lstsq(columns, tau, rcond=None)[0]
        scale = np.abs(list(terms.values())).max()
        np.testing.assert_allclose(fit, list(terms.values()), atol=1e-7 * scale)


def test_forms_of_the_symmetry_can_be_named(tmp_path: Path) -> None:
    where = {"vehicle_file": tmp_path / "v.yaml", "folder": tmp_path, "file": "m"}
    assert load_truth("refit:symmetric", **where).name == "symmetric"
    with pytest.raises(CampaignError, match="symmetric"):
        load_truth("refit:symetric", **where)


def test_a_vehicle_without_thrusters_is_refused() -> None:
    with pytest.raises(CampaignError, match="thrusters alone"):
        dive_plan(PLAN, vehicle("vt690"), file="plan.yaml")


def test_a_current_stands_in_the_truth_table() -> None:
    flown = PLAN | {"water": {"current_m_s": [0.2, 0.0, 0.0]}}
    table = fly_plan(HEAVY, twin(plan=flown)).truth["a"]
    u = column(table, "u_m_s") - column(table, "u_water_m_s")
    v = column(table, "v_m_s") - column(table, "v_water_m_s")
    assert np.all(np.hypot(u, v) <= 0.2 + 1e-9)
    level = np.abs(matrix(table, POSE)[:, 3:5]).max(axis=1) < 0.01
    assert np.hypot(u, v)[level] == pytest.approx(0.2, abs=1e-3)


def test_the_chain_finds_the_force_of_exact_sensors() -> None:
    """Without lag of thrust, at 50 Hz: what splines and the low-pass leave is below 6 %."""
    fast = {"rate_hz": 50.0}
    names = ("imu", "attitude", "dvl", "depth", "outputs", "battery")
    exact = PLAN | {"sensors": dict.fromkeys(names, fast), "body": {"thrust_lag_s": 0.0}}
    outputs = simulate.run(simulate.Inputs(HEAVY, twin(plan=exact)), simulate.Params())
    file = RawFile("a.BIN", np.frombuffer(outputs.logs["a.BIN"], np.uint8), None)
    log = ingest.run(ingest.Inputs(RawLog("a", (file,)), None, HEAVY), ingest.Params())
    leg = LegEntry(**dive_entries(exact, format="bin")[1][0])
    streams = ("imu", "attitude", "depth", "velocity", "actuators", "battery")
    resampled = resample.run(
        resample.Inputs(leg, log.log_info, HEAVY, **{name: getattr(log, name) for name in streams}),
        resample.Params(),
    )
    (key,) = resampled.segment
    segment, table = resampled.segment[key], resampled.resampled[key]
    fused = fuse.run(fuse.Inputs(segment, table, HEAVY, log.log_info), fuse.Params(cutoff_hz=5.0))
    force = residual.run(
        residual.Inputs(segment, fused.fused, fused.fusion, table, HEAVY, log.log_info),
        residual.Params(),
    ).residual
    at = clock(fused.fused) + float(segment.leg_start_s)
    truth = true_values(outputs.truth["a"], force_columns("tau_bar"), at)
    error = matrix(force, force_columns("tau_bar")) - truth
    share = np.sqrt(np.mean(error**2, axis=0) / np.mean(truth**2, axis=0))
    assert np.all(share < 0.06), share
