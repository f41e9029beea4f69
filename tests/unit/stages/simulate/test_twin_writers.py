"""The twin's logs: read back by pymavlink and by our readers, equal in all formats;
sensors against what they measure; plans refused.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pymavlink import DFReader, mavutil

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.errors import CampaignError, DataError, PipelineError
from auvid.data_schemas.tables import column, matrix
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.physical_viscous import physical_viscous
from auvid.hydro.dynamics.simulation.sensor_models import specific_force
from auvid.hydro.dynamics.simulation.simulation import SimulatedVehicle
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.identification.signals.bias import inertial_acceleration
from auvid.pipeline.campaigns.twin import load_twin
from auvid.stages import ingest, simulate
from auvid.stages.base import RawFile, RawLog
from auvid.stages.columns import VELOCITY
from auvid.stages.simulate.csv_writer import column_maps
from auvid.stages.simulate.flights import checked_coefficients, fly_leg
from auvid.stages.simulate.plans import (
    CSV_PARTS,
    csv_name,
    log_name,
    manifest_entries,
    plan_from_document,
)
from auvid.stages.simulate.sensing import record

ROOT = Path(__file__).parents[4]
VT690 = vehicle_from_document(read_yaml((ROOT / "vehicles/vt690.yaml").read_text(encoding="utf-8")))
PHYSICS = {"kind": "physics", "name": "physics", "source": "flow physics"}
ACCELEROMETER = {"accel_sd_m_s2": 0.03, "accel_bias_sd_m_s2": 0.15}
PLAN: dict[str, Any] = {
    "title": "One short leg",
    "settle_s": 5,
    "yaw_steps": {"times_s": [0.5, 2], "values_deg": [20, -10]},
    "depth_steps": {"times_s": [1], "values_m": [-1.0]},
    "sensors": {
        "ahrs": {
            "attitude_sd_deg": 0.05,
            "gyro_sd_rad_s": 0.002,
            "gyro_bias_sd_rad_s": 0.005,
            "accel_sd_m_s2": 0.03,
            "accel_bias_sd_m_s2": 0.15,
        },
        "dvl": {"sd_m_s": 0.01},
        "depth": {"sd_m": 0.005},
    },
    "legs": [
        {"id": "yaw", "rpm": 2133, "manoeuvre": "yaw_steps", "duration_s": 6, "use": "training"}
    ],
}


def run(
    plan: Mapping[str, Any] = PLAN, truth: Mapping[str, Any] = PHYSICS, **more: Any
) -> simulate.Outputs:
    twin = {
        "plan": plan,
        "truth": truth,
        "seed": 3,
        "format": "bin",
        "accelerometer": "specific_force",
        **more,
    }
    return simulate.run(simulate.Inputs(VT690, parse(TwinDocument, twin)), simulate.Params())


@pytest.fixture(scope="module")
def logs() -> dict[str, simulate.Outputs]:
    return {name: run(format=name) for name in ("bin", "tlog", "csv")}


@pytest.fixture(scope="module")
def recorded() -> Any:
    plan = plan_from_document(PLAN, VT690)
    return record(
        fly_leg(plan, plan.legs[0], SimulatedVehicle(VT690, physical_viscous(VT690)), seed=3),
        plan,
        seed=3,
        text="twin",
    )


def ingested(
    outputs: simulate.Outputs, format: str, accelerometer: str = "specific_force"
) -> ingest.Outputs:
    def raw(name: str, columns: Any = None) -> RawFile:
        return RawFile(name, np.frombuffer(outputs.logs[name], np.uint8), columns)

    maps = column_maps(accelerometer=accelerometer)
    files = (
        [raw(csv_name("yaw", part), maps[part]) for part in CSV_PARTS]
        if format == "csv"
        else [raw(log_name("yaw", format))]
    )
    return ingest.run(ingest.Inputs(RawLog("yaw", tuple(files)), None, VT690), ingest.Params())


@pytest.mark.parametrize("format", ["bin", "tlog", "csv"])
def test_our_readers_give_back_what_the_sensors_recorded(
    logs: dict[str, simulate.Outputs], recorded: Any, format: str
) -> None:
    """CSV exactly but for units turned there and back; the binary formats to single
    precision (4e-7 of the largest value).
    """
    streams = ingested(logs[format], format)
    for name, columns in recorded.streams.items():
        table = getattr(streams, name)
        assert np.array_equal(np.asarray(table["time_us"]), columns["time_us"]), name
        for field, values in columns.items():
            if field != "time_us":
                decoded = column(table, field)
                if field == "psi_rad":
                    decoded = np.remainder(decoded + np.pi, 2.0 * np.pi) - np.pi
                largest = (
                    2.0 * np.pi if field == "psi_rad" else max(float(np.abs(values).max()), 1.0)
                )
                assert (
                    np.max(np.abs(decoded - values))
                    <= (1e-12 if format == "csv" else 4e-7) * largest
                ), field
    info = streams.log_info
    assert (info.status, info.start_us, info.accelerometer) == (
        "complete",
        10_000_000,
        "specific_force",
    )
    assert streams.dropped.num_rows == 0


def test_pymavlink_reads_the_dataflash_log(
    logs: dict[str, simulate.Outputs], recorded: Any, tmp_path: Path
) -> None:
    path = tmp_path / "yaw.BIN"
    path.write_bytes(logs["bin"].logs["yaw.BIN"])
    reader = DFReader.DFReader_binary(str(path))
    columns: dict[str, list[Any]] = {}
    while (message := reader.recv_msg()) is not None:
        columns.setdefault(message.get_type(), []).append(message)
    imu, actuators = recorded.streams["imu"], recorded.streams["actuators"]
    assert [len(columns[name]) for name in ("IMU", "ATT", "ACTU")] == [
        imu["time_us"].size,
        imu["time_us"].size,
        actuators["time_us"].size,
    ]
    assert {message.Label for message in columns["UNIT"]} >= {"rad/s", "m/s/s", "deg", "rad"}
    assert np.allclose(
        [message.GyrZ for message in columns["IMU"]], imu["gyro_z_rad_s"], rtol=1e-6, atol=1e-9
    )
    assert np.allclose(
        [message.FinT for message in columns["ACTU"]], actuators["fin_t_rad"], rtol=1e-6, atol=1e-9
    )
    assert [message.TimeUS for message in columns["VISO"]] == recorded.streams["velocity"][
        "time_us"
    ].tolist()
    reader.filehandle.close()
    ids = {definition.type: definition for definition in reader.formats.values()}
    for message in columns["FMTU"]:
        assert len(message.UnitIds) == len(message.MultIds) == len(ids[message.FmtType].columns)
        assert set(message.UnitIds) <= {chr(unit.Id) for unit in columns["UNIT"]} | {"-"}
        assert set(message.MultIds) <= {chr(factor.Id) for factor in columns["MULT"]}


def test_pymavlink_reads_the_telemetry_log(
    logs: dict[str, simulate.Outputs], recorded: Any, tmp_path: Path
) -> None:
    path = tmp_path / "yaw.tlog"
    path.write_bytes(logs["tlog"].logs["yaw.tlog"])
    reader = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    columns: dict[str, list[Any]] = {}
    while (message := reader.recv_msg()) is not None:
        columns.setdefault(message.get_type(), []).append(message)
    reader.close()
    assert "BAD_DATA" not in columns
    assert np.allclose(
        [message.yaw for message in columns["ATTITUDE"]],
        recorded.streams["attitude"]["psi_rad"],
        atol=1e-6,
    )
    assert np.allclose(
        [message.xacc for message in columns["HIGHRES_IMU"]],
        recorded.streams["imu"]["accel_x_m_s2"],
        atol=1e-6,
    )
    assert np.allclose(
        [message.data[4] for message in columns["DEBUG_FLOAT_ARRAY"]],
        recorded.streams["actuators"]["fin_t_rad"],
        atol=1e-7,
    )


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(
    logs: dict[str, simulate.Outputs],
) -> None:
    assert run().logs == logs["bin"].logs
    assert run(seed=4).logs != logs["bin"].logs
    assert (
        run(seed=4).truth["yaw"].equals(logs["bin"].truth["yaw"])
    )  # the autopilot knows the true state


def test_a_legs_noise_does_not_depend_on_the_other_legs(logs: dict[str, simulate.Outputs]) -> None:
    more = copy.deepcopy(PLAN)
    more["legs"].insert(
        0,
        {
            "id": "depth",
            "rpm": 1800,
            "manoeuvre": "depth_steps",
            "duration_s": 2,
            "use": "validation",
        },
    )
    assert run(more).logs["yaw.BIN"] == logs["bin"].logs["yaw.BIN"]


def test_accelerometer_is_what_identification_takes_it_for() -> None:
    """Specific force at an arm, undone by `inertial_acceleration`: v_dot + omega x v of
    the body origin, to 1e-12 m/s^2.
    """
    plan = plan_from_document(PLAN, VT690)
    flown = fly_leg(plan, plan.legs[0], SimulatedVehicle(VT690, physical_viscous(VT690)), seed=0)
    motion, arm = flown.motion(np.linspace(2.0, 8.0, 100)), np.array([0.3, -0.1, 0.05])
    omega, v = motion.nu[:, 3:], motion.nu[:, :3]
    acceleration = inertial_acceleration(
        specific_force(motion, arm, gravity=VT690.gravity),
        convention="specific_force",
        euler=motion.eta[:, 3:],
        omega=omega,
        omega_dot=motion.nu_dot[:, 3:],
        velocity=v,
        arm=arm,
        gravity=VT690.gravity,
    )
    assert np.allclose(
        acceleration, motion.nu_dot[:, :3] + np.cross(omega, v), rtol=0.0, atol=1e-12
    )


def test_noise_has_the_deviations_of_the_plan(recorded: Any) -> None:
    """500 samples of the gyro about the true rate: mean is the bias, deviation 0.002
    rad/s within 10 %.
    """
    plan = plan_from_document(PLAN, VT690)
    flown = fly_leg(plan, plan.legs[0], SimulatedVehicle(VT690, physical_viscous(VT690)), seed=3)
    gyro = np.column_stack([recorded.streams["imu"][f"gyro_{axis}_rad_s"] for axis in "xyz"])
    error = gyro - flown.motion((recorded.streams["imu"]["time_us"] - 10_000_000) / 1e6).nu[:, 3:]
    assert np.allclose(error.std(axis=0), 0.002, rtol=0.1)
    assert np.allclose(error.mean(axis=0), recorded.biases["gyro_rad_s"], atol=4e-4)
    assert 1e-4 < np.abs(recorded.biases["gyro_rad_s"]).max() < 0.02


def test_dvl_sees_its_arm_and_mounting_error() -> None:
    """Without noise, at the error's arm and turned: R' (v + omega x arm)."""
    exact = copy.deepcopy(PLAN) | {
        "sensors": {"dvl": {"arm_error_m": [0.5, 0.0, 0.1], "mounting_error_deg": [0.0, 0.0, 3.0]}}
    }
    plan = plan_from_document(exact, VT690)
    flown = fly_leg(plan, plan.legs[0], SimulatedVehicle(VT690, physical_viscous(VT690)), seed=0)
    streams = record(flown, plan, seed=0, text="").streams
    motion = flown.motion((streams["velocity"]["time_us"] - 10_000_000) / 1e6)
    turn = rotation_body_to_ned(np.radians([0.0, 0.0, 3.0]))
    expected = (motion.nu[:, :3] + np.cross(motion.nu[:, 3:], [0.5, 0.0, 0.1])) @ turn
    assert np.allclose(
        np.column_stack([streams["velocity"][name] for name in VELOCITY[:3]]),
        expected,
        rtol=0.0,
        atol=1e-14,
    )


def test_inertial_csv_has_gravity_taken_off_by_the_ahrs() -> None:
    """Level running: the vertical accelerometer reads near 0 instead of -g, within
    bias, noise and 0.05 degrees of gravity.
    """
    outputs = run(format="csv", accelerometer="inertial")
    streams = ingested(outputs, "csv", "inertial")
    assert streams.log_info.accelerometer == "inertial"
    assert streams.imu is not None
    assert np.abs(matrix(streams.imu, ["accel_z_m_s2"])[:50].mean()) < 0.7


def test_truth_is_the_equation_of_motion(logs: dict[str, simulate.Outputs]) -> None:
    truth = logs["bin"].truth["yaw"]
    total = column(truth, "viscous_Y_N") + column(truth, "unsteady_Y_N")
    assert np.array_equal(total, column(truth, "tau_bar_Y_N"))
    assert (truth.num_rows, truth["time_us"][0].as_py()) == (501, 10_000_000)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"accelerometer": "inertial", "format": "bin"}, "hold specific force"),
        ({"truth": "refit:lin"}, "no such model.*refit:linear"),
        ({"truth": "refit:"}, "no such model"),
    ],
)
def test_what_a_twin_cannot_do_is_refused_before_it_flies(
    entry: dict[str, str], words: str, tmp_path: Path
) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text(yaml.safe_dump(dict(PLAN)), encoding="utf-8")
    file = ROOT / "vehicles/vt690.yaml"
    with pytest.raises(CampaignError, match=words):
        load_twin(entry, VT690, plan=plan, vehicle_file=file, folder=tmp_path, file="campaign.yaml")


def test_manifest_of_a_plan() -> None:
    entries = manifest_entries(PLAN, format="csv")
    assert entries[0][0]["files"][1] == {"file": "yaw_dvl.csv", "columns": "columns/dvl.yaml"}
    assert entries[1] == [
        {"id": "yaw", "log": "yaw", "start_s": 2.0, "end_s": 8.0, "use": "training"}
    ]


def leg(**change: Any) -> dict[str, Any]:
    return {"legs": [PLAN["legs"][0] | change]}


IMPOSSIBLE: dict[str, tuple[dict[str, Any], str]] = {
    "TOO_FAST": (leg(rpm=4000), "cannot run at this speed"),
    "STANDING": (leg(rpm=0), r"legs\[0\]\.rpm.*at least 1"),
    "NO_LENGTH": (leg(duration_s=0), r"legs\[0\]\.duration_s.*1 to 7200"),
    "ENDLESS": (leg(duration_s=1.0e9), r"legs\[0\]\.duration_s.*1 to 7200"),
    "INFINITE_SCALE": ({"yaw_scale": float("inf")}, "yaw_scale.*not finite"),
    "NO_NUMBER_DEEP_INSIDE": (
        {"sensors": {"dvl": {"arm_error_m": [0.0, float("nan"), 0.0]}}},
        "sensors.dvl.arm_error_m\\[1\\]",
    ),
    "ABOVE_THE_SURFACE": (leg(manoeuvre="depth_steps") | {"depth_m": 0.8}, "above the surface"),
    "AT_THE_SURFACE": ({"depth_m": 0.0}, "run at the surface"),
    "NO_LEGS": ({"legs": []}, "no legs"),
    "SAME_NAME": ({"legs": PLAN["legs"] * 2}, "not a name of its own"),
    "STEPS_UNKNOWN": ({"yaw_steps": None}, "does not say what these steps are"),
    "STEPS_OUT_OF_ORDER": (
        {"yaw_steps": {"times_s": [2, 1], "values_deg": [1, 2]}},
        "do not increase",
    ),
    "STEPS_WITHOUT_VALUE": (
        {"yaw_steps": {"times_s": [1, 2], "values_deg": [1]}},
        "as many times as values",
    ),
    "LONG_MARGIN": ({"margin_s": 6.0}, "begin before the vehicle does"),
    "UNSTEADY_OF_TWO": (
        {"unsteady": {"force_sd_N": [1, 1], "moment_sd_N_m": [1, 1, 1], "correlation_s": 1}},
        "three numbers",
    ),
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_impossible_plans_are_refused(name: str) -> None:
    change, words = IMPOSSIBLE[name]
    with pytest.raises(PipelineError, match=words):
        plan_from_document({**PLAN, **change}, VT690, file="plan.yaml")


def test_all_faults_of_a_plan_come_together() -> None:
    with pytest.raises(PipelineError, match="2 faults"):
        plan_from_document(
            {**PLAN, "legs": [PLAN["legs"][0] | {"rpm": -1, "duration_s": 0}]}, VT690
        )


def test_a_vehicle_that_cannot_be_flown_is_refused() -> None:
    rov = vehicle_from_document(
        read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text(encoding="utf-8"))
    )
    with pytest.raises(CampaignError, match="propeller and fins"):
        plan_from_document(PLAN, rov)


@pytest.mark.parametrize(
    ("coefficients", "words"),
    [
        ({"X": {"u*z": 1.0}}, "unknown term"),
        ({"Q": {"u": 1.0}}, "unknown axis"),
        ({"X": {"u": float("nan")}}, "not a finite"),
        ({}, "no coefficients"),
    ],
)
def test_bad_coefficients_are_refused(
    coefficients: dict[str, dict[str, float]], words: str
) -> None:
    with pytest.raises(PipelineError, match=words):
        checked_coefficients(coefficients, file="card.json")


def test_unstable_truth_keeps_what_was_flown() -> None:
    """Slow growth of u: the leg is cut, its log ends there, and the section says when
    and why.
    """
    damping = {
        "Y": {"v": -200.0},
        "Z": {"w": -200.0},
        "K": {"p": -5.0},
        "M": {"q": -200.0},
        "N": {"r": -200.0},
    }
    truth = {
        "kind": "coefficients",
        "name": "runaway",
        "source": "made up",
        "coefficients": {"X": {"u": 6.0}} | damping,
    }
    outputs = run(
        {**PLAN, "legs": [PLAN["legs"][0] | {"manoeuvre": "straight", "duration_s": 60}]}, truth
    )
    (flown,) = outputs.simulation["legs"]
    assert "speed above 8 m/s" in flown["stopped"]
    assert 3.0 < flown["end_s"] < 60.0
    assert outputs.truth["yaw"]["t_s"][-1].as_py() == pytest.approx(flown["end_s"], abs=0.02)
    assert any(
        block.get("level") == "warning" and "speed above" in block["text"]
        for block in outputs.section["blocks"]
    )
    with pytest.raises(DataError, match="reached no leg"):
        run(truth=truth | {"coefficients": {"X": {"u": 200.0}} | damping})
