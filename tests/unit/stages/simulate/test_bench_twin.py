"""The bench twin: its logs are read by our readers and by pymavlink, hold the motion
that was flown, and give their truth back.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import DFReader, mavutil

from auvid.data_schemas.documents.apparatus import ApparatusDocument, FreeDecayEntry
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.errors import CampaignError, DataError, PipelineError
from auvid.data_schemas.tables import column, matrix
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.thrusters import thruster_force, thruster_forces
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.stages import ingest, simulate
from auvid.stages.base import RawFile, RawLog
from auvid.stages.simulate.bench import pendulum_of
from auvid.stages.simulate.bench_plans import bench_entries, bench_plan, output_of
from auvid.stages.simulate.csv_writer import column_maps

ROOT = Path(__file__).parents[4]
THAUS = vehicle_from_document(read_yaml((ROOT / "vehicles/thaus.yaml").read_text(encoding="utf-8")))
APPARATUS = read_yaml((ROOT / "campaigns/thaus_twin/apparatus.yaml").read_text(encoding="utf-8"))
STEPS = {"times_s": [0.0, 6.0, 11.0, 19.0, 26.0], "values_percent": [50, -80, 30, 90, -40]}
POLE = {"pole_added_mass": -4.1996, "pole_linear": -1.0, "pole_quadratic": -2.0}
WEISS = {
    "mass": 20.9,
    "X_udot": -13.5778,
    "X_u|u|": -27.7411,
    "X_u": -3.0,
    "M_qdot": -2.0,
    "M_q": -1.0,
    "Z_wdot": -46.3258,
    "Z_w|w|": -64.597,
}
PLAN: dict[str, Any] = {
    "title": "One run of each kind",
    "depth_m": 1.5,
    "sensors": {"ahrs": {"rate_hz": 50}, "dvl": {"rate_hz": 20}},
    "bench": {
        "truths": {
            "weiss": WEISS,
            "decay": {**POLE, "X_udot": -87.0553, "X_u": -45.7734, "X_u|u|": -20.0},
        },
        "tank": [
            {
                "id": "surge",
                "channel": "surge",
                "truth": "weiss",
                "duration_s": 32,
                "commands": {"surge": STEPS},
            }
        ],
        "decays": [
            {"id": "decay", "decay": "surge", "truth": "decay", "angle_deg": 22, "duration_s": 30}
        ],
        "swings": [
            {
                "id": "swing",
                "swing": "tray",
                "inertia_kg_m2": 2.197,
                "angle_deg": 5,
                "duration_s": 20,
            }
        ],
    },
}


def run(
    plan: dict[str, Any] = PLAN, format: str = "bin", apparatus: Any = APPARATUS
) -> simulate.Outputs:
    twin = {
        "plan": plan,
        "truth": {"kind": "physics", "name": "physics", "source": "plan"},
        "seed": 3,
        "format": format,
    }
    return simulate.run(
        simulate.Inputs(
            THAUS,
            parse(TwinDocument, {**twin, "accelerometer": "specific_force"}),
            None if apparatus is None else parse(ApparatusDocument, apparatus),
        ),
        simulate.Params(),
    )


@pytest.fixture(scope="module", params=["bin", "tlog", "csv"])
def streams(request: pytest.FixtureRequest) -> dict[str, ingest.Outputs]:
    outputs, maps = run(format=request.param), column_maps(accelerometer="specific_force")
    logs, _ = bench_entries(PLAN, format=request.param)
    tables = {}
    for log in logs:
        files = log.get("files") or [log]
        raw = [
            RawFile(
                item["file"],
                np.frombuffer(outputs.logs[item["file"]], np.uint8),
                maps[Path(item["columns"]).stem] if "columns" in item else None,
            )
            for item in files
        ]
        tables[log["id"]] = ingest.run(
            ingest.Inputs(RawLog(log["id"], tuple(raw)), None, THAUS), ingest.Params()
        )
    return tables


def changed(part: str, **changes: Any) -> dict[str, Any]:
    plan = copy.deepcopy(PLAN)
    target = (
        plan["bench"]["tank"][0]
        if part == "tank"
        else plan["bench"][part][0]
        if part in ("decays", "swings")
        else plan["bench"][part]
    )
    target.update(changes)
    return plan


def fitted(y: np.ndarray, *regressors: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(np.stack(regressors, axis=1), y, rcond=None)[0]


def test_a_tank_run_gives_its_truth_back(streams: dict[str, ingest.Outputs]) -> None:
    """Integrated between samples: m_u (u2 - u1) = int X + X_u int u + X_u|u| int u|u|,
    by Simpson's rule within steps of thrust.

    To 1e-3: single precision of the logs and the error of the quadrature (20 Hz against
    a time constant of some seconds).
    """
    log = streams["surge"]
    assert log.velocity is not None
    assert log.actuators is not None
    t, u = column(log.velocity, "time_us") / 1e6, column(log.velocity, "u_m_s")
    when = column(log.actuators, "time_us") / 1e6
    pulses = np.full((when.size, 5), 1500.0)
    pulses[:, 0] = column(log.actuators, "pwm_1_us")
    assert set(np.unique(pulses[:, 0])) == {1500.0, 1700.0, 1180.0, 1620.0, 1860.0, 1340.0}
    force = thruster_force(THAUS.thrusters, thruster_forces(THAUS.thrusters, pulses))[:, 0]
    first, last = np.arange(0, t.size - 2, 2), np.arange(2, t.size, 2)
    held_force = force[np.searchsorted(when, t + 1e-9, side="right") - 1]
    same = (
        (held_force[first] == held_force[first + 1])
        & (held_force[first] == held_force[last])
        & (t[first] > t[0] + 2.1)
    )
    changes = when[1:][np.diff(force) != 0.0]
    same &= ~np.array(
        [np.any((changes > a) & (changes <= b)) for a, b in zip(t[first], t[last], strict=True)]
    )
    same &= np.sign(u[first]) == np.sign(u[last])
    width = t[last] - t[first]

    def simpson(values: np.ndarray) -> np.ndarray:
        return (values[first] + 4.0 * values[first + 1] + values[last]) * width / 6.0

    rows = [simpson(u)[same], simpson(u * np.abs(u))[same], (held_force[first] * width)[same]]
    linear, quadratic, inverse = fitted((u[last] - u[first])[same], *rows)
    assert 1.0 / inverse == pytest.approx(20.9 + 13.5778, rel=1e-3)
    assert linear / inverse == pytest.approx(-3.0, rel=1e-2)
    assert quadratic / inverse == pytest.approx(-27.7411, rel=1e-3)


def test_a_decay_gives_its_truth_back(streams: dict[str, ingest.Outputs]) -> None:
    """(70) with the rate of the gyro by central differences (error some 1e-4 at 50 Hz)."""
    log = streams["decay"]
    assert log.attitude is not None
    assert log.imu is not None
    assert log.velocity is None
    theta, rate, t = (
        column(log.attitude, "theta_rad"),
        column(log.imu, "gyro_y_rad_s"),
        column(log.imu, "time_us") / 1e6,
    )
    inside = slice(110, -5)
    speed = np.gradient(rate, t)[inside]
    swing, linear, quadratic = fitted(
        speed, np.sin(theta)[inside], rate[inside], (rate * np.abs(rate))[inside]
    )
    total = 38.10 + 5.93 + 4.62 + 87.0553 + 4.1996
    assert swing == pytest.approx(-(5.93 + 4.62) * 9.80665 / (total * 3.66), rel=1e-3)
    assert linear == pytest.approx(-(45.7734 + 1.0) / total, rel=1e-3)
    assert quadratic == pytest.approx(-22.0 * 3.66 / total, rel=5e-3)
    assert theta[0] == pytest.approx(np.radians(22.0), abs=1e-6)


def test_the_pixhawk_on_the_pole_feels_the_swing(streams: dict[str, ingest.Outputs]) -> None:
    """In body axes, r below the pivot: f_x = r theta_ddot + g sin theta, f_z = -r
    theta_dot^2 - g cos theta (0.01 m/s2: differences).
    """
    log = streams["decay"]
    theta, rate, t = (
        column(log.attitude, "theta_rad"),
        column(log.imu, "gyro_y_rad_s"),
        column(log.imu, "time_us") / 1e6,
    )
    force = matrix(log.imu, ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"))
    inside = slice(110, -5)
    np.testing.assert_allclose(
        force[inside, 0], (np.gradient(rate, t) + 9.80665 * np.sin(theta))[inside], atol=0.01
    )
    np.testing.assert_allclose(
        force[inside, 2], (-(rate**2) - 9.80665 * np.cos(theta))[inside], atol=1e-4
    )
    np.testing.assert_allclose(force[:, 1], 0.0, atol=1e-6)


def test_the_tray_swings_in_yaw(streams: dict[str, ingest.Outputs]) -> None:
    log = streams["swing"]
    psi, rate, t = (
        np.unwrap(np.remainder(column(log.attitude, "psi_rad") + np.pi, 2.0 * np.pi) - np.pi),
        column(log.imu, "gyro_z_rad_s"),
        column(log.imu, "time_us") / 1e6,
    )
    np.testing.assert_allclose(np.gradient(psi, t)[110:-5], rate[110:-5], atol=1e-4)
    up = np.flatnonzero((psi[:-1] < 0.0) & (psi[1:] >= 0.0))
    crossings = t[up] - psi[up] * (t[up + 1] - t[up]) / (psi[up + 1] - psi[up])
    assert np.diff(crossings).mean() == pytest.approx(
        4.1571, abs=5e-3
    )  # s; 5 degrees lengthen it by 0.05 %
    assert np.abs(column(log.imu, "gyro_x_rad_s")).max() < 1e-6


def test_logs_begin_at_rest_before_the_leg_and_are_whole(
    streams: dict[str, ingest.Outputs],
) -> None:
    for name, log in streams.items():
        assert log.log_info.status == "complete"
        assert not [row for row in log.dropped.to_pylist() if row["count"]]
        assert (
            np.abs(matrix(log.imu, ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"))[:95]).max()
            < 1e-7
        ), name


def test_a_bench_campaign_is_not_told_what_a_force_model_would_need() -> None:
    file = RawFile("decay.BIN", np.frombuffer(run().logs["decay.BIN"], np.uint8))
    notes = {}
    for kind in ("bench_twin", "identification"):
        campaign = {
            "kind": kind,
            "vehicle": "thaus",
            "logs": [{"id": "decay", "file": "decay.BIN"}],
            "legs": [],
        }
        section = ingest.run(
            ingest.Inputs(RawLog("decay", (file,)), campaign, THAUS), ingest.Params()
        ).section
        notes[kind] = " ".join(
            block["text"] for block in section["blocks"] if block["kind"] == "remark"
        )
    assert "No force model can be fitted" in notes["identification"]
    assert "stream depth" in notes["identification"]
    assert "force model" not in notes["bench_twin"]
    assert "stream depth" not in notes["bench_twin"]


def test_pymavlink_reads_the_same(tmp_path: Path) -> None:
    outputs = run()
    for name, types in (
        ("surge.BIN", {"IMU", "ATT", "VISO", "BARO", "RCOU"}),
        ("decay.BIN", {"IMU", "ATT"}),
    ):
        path = tmp_path / name
        path.write_bytes(outputs.logs[name])
        reader = DFReader.DFReader_binary(str(path))
        counts: dict[str, int] = {}
        pulses = []
        while (message := reader.recv_msg()) is not None:
            counts[message.get_type()] = counts.get(message.get_type(), 0) + 1
            if message.get_type() == "RCOU":
                pulses.append(message.C1)
        assert types <= set(counts)
        assert not (set(counts) - types - {"FMT", "UNIT", "MULT", "FMTU", "MSG"})
        if pulses:
            assert set(pulses) == {1500, 1700, 1180, 1620, 1860, 1340}
        reader.close()
    path = tmp_path / "surge.tlog"
    path.write_bytes(run(format="tlog").logs["surge.tlog"])
    log = mavutil.mavlink_connection(str(path))
    outputs_seen = {
        message.servo1_raw
        for message in iter(lambda: log.recv_match(type="SERVO_OUTPUT_RAW"), None)
    }
    assert outputs_seen == {1500, 1700, 1180, 1620, 1860, 1340}
    log.close()


def test_a_turned_pixhawk_reports_in_its_own_axes() -> None:
    """Turned by 90 degrees in yaw the swing is in roll, backwards; the attitude is that
    of the sensor.
    """
    plan = copy.deepcopy(PLAN)
    plan["bench"]["pixhawk"] = {"mounting_deg": [0, 0, 90]}
    outputs = run(plan, format="csv")
    rows = np.genfromtxt(
        outputs.logs["decay_ahrs.csv"].decode().splitlines(), delimiter=",", names=True
    )
    straight = np.genfromtxt(
        run(format="csv").logs["decay_ahrs.csv"].decode().splitlines(), delimiter=",", names=True
    )
    np.testing.assert_allclose(rows["gyro_x_rad_s"], straight["gyro_y_rad_s"], atol=1e-12)
    np.testing.assert_allclose(rows["gyro_y_rad_s"], 0.0, atol=1e-12)
    np.testing.assert_allclose(rows["accel_y_m_s2"], -straight["accel_x_m_s2"], atol=1e-12)
    np.testing.assert_allclose(rows["phi_rad"], straight["theta_rad"], atol=1e-12)


def test_noise_is_what_the_plan_says_times_the_factor_of_the_run() -> None:
    plan = copy.deepcopy(PLAN)
    plan["sensors"] = {
        "ahrs": {"rate_hz": 50, "gyro_sd_rad_s": 0.01},
        "dvl": {"rate_hz": 20, "sd_m_s": 0.01},
    }
    plan["bench"]["decays"], plan["bench"]["swings"] = [], []
    noisy = np.genfromtxt(
        run(plan, format="csv").logs["surge_dvl.csv"].decode().splitlines(),
        delimiter=",",
        names=True,
    )
    plan["bench"]["tank"][0]["noise"] = 0
    exact = np.genfromtxt(
        run(plan, format="csv").logs["surge_dvl.csv"].decode().splitlines(),
        delimiter=",",
        names=True,
    )
    assert np.std(noisy["u_m_s"] - exact["u_m_s"]) == pytest.approx(
        0.01, rel=0.15
    )  # 680 samples: 3 % standard error
    np.testing.assert_array_equal(exact["v_m_s"], 0.0)


def test_pitch_is_driven_through_surge_and_heave() -> None:
    plan = changed(
        "tank",
        channel="pitch",
        commands={"surge": STEPS, "heave": {"times_s": [1.0, 15.0], "values_percent": [70, -60]}},
    )
    outputs = run(plan, format="csv")
    ahrs = np.genfromtxt(
        outputs.logs["surge_ahrs.csv"].decode().splitlines(), delimiter=",", names=True
    )
    assert np.abs(ahrs["gyro_y_rad_s"]).max() > 0.01
    np.testing.assert_allclose(ahrs["gyro_x_rad_s"], 0.0, atol=1e-9)


def test_a_physical_pendulum_has_each_part_at_its_own_arm() -> None:
    apparatus = copy.deepcopy(APPARATUS["free_decay"])
    pole = apparatus["parts"][0]
    pole["arm"]["value"] = 1.83
    pole["inertia"] = {"value": 6.62, "unit": "kg*m^2", "source": "rod"}
    pole["displaced_mass"] = {"value": 2.0, "unit": "kg", "source": "wet part"}
    apparatus = parse(FreeDecayEntry, apparatus)
    pendulum = pendulum_of(apparatus, {"X_u": -10.0, **POLE}, THAUS, dof="surge")
    assert pendulum.inertia == pytest.approx(
        5.93 * 1.83**2 + 6.62 + (4.62 + 38.10 + 91.7507 + 4.1996) * 3.66**2
    )
    assert pendulum.restoring == pytest.approx(9.80665 * ((5.93 - 2.0) * 1.83 + 4.62 * 3.66))
    assert pendulum.linear == pytest.approx(-11.0 * 3.66**2)
    assert pendulum.quadratic == pytest.approx(-2.0 * 3.66**3)
    empty = pendulum_of(apparatus, POLE, THAUS, dof=None)
    assert empty.inertia == pytest.approx(5.93 * 1.83**2 + 6.62 + (4.62 + 4.1996) * 3.66**2)


def test_channels_find_the_thruster_that_drives_them_alone() -> None:
    assert [
        output_of(channel, THAUS) for channel in ("surge", "sway", "heave", "roll", "pitch", "yaw")
    ] == [0, 1, 2, 3, None, 4]


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (changed("tank", truth="weis"), "no such truth"),
        (changed("tank", channel="pitch"), "not driven by these commands"),
        (
            changed("tank", channel="pitch", commands={"pitch": STEPS}),
            "not driven by these commands",
        ),
        (
            changed("tank", commands={"surge": {"times_s": [0, 40], "values_percent": [1, 2]}}),
            "do not increase within the leg",
        ),
        (
            changed("tank", commands={"surge": {"times_s": [0], "values_percent": [1, 2]}}),
            "as many times as values",
        ),
        (changed("tank", id="decay"), "not a name of its own"),
        (changed("truths", weiss={"X_uu": -1.0}), "no number of the simplified model"),
        (changed("truths", weiss={"X_u": 1.0}), "is positive"),
        (changed("truths", weiss={"mass": -300.0}), "not positive definite"),
        ({**PLAN, "legs": []}, "either legs or bench"),
        ({**PLAN, "bench": {"truths": {}}}, "no experiment"),
    ],
)
def test_impossible_plans_are_refused(plan: dict[str, Any], words: str) -> None:
    with pytest.raises(PipelineError, match=words):
        bench_plan(plan, THAUS)


def test_a_run_that_leaves_the_water_is_refused() -> None:
    plan = changed(
        "tank", channel="heave", commands={"heave": {"times_s": [0], "values_percent": [-90]}}
    )
    with pytest.raises(DataError, match="leaves the water"):
        run(plan)


@pytest.mark.parametrize("part", ["decays", "swings"])
def test_what_the_apparatus_does_not_have_is_refused(part: str) -> None:
    with pytest.raises(CampaignError, match="no such"):
        run(changed(part, **{part[:-1]: "nothing"}))
    with pytest.raises(CampaignError, match="there is no apparatus"):
        run(apparatus=None)
