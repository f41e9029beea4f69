"""Motion from the poses of a log: streams as its sensors would report, and findings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auvid.data_schemas.checks import checks
from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.tables import matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.bias import lever_arm_velocity
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog
from auvid.stages.columns import ATTITUDE, GYRO, LINEAR_VELOCITY, POSITION
from auvid.stages.ingest.health.agreement.velocity import velocity_clock
from tests.support import tank_runs
from tests.support.motions import vehicle_document
from tests.support.pose_runs import PoseRun, pose_run, tracked
from tests.support.tank_runs import noisy, tank_run

T_S = np.arange(0.0, 60.0, 0.05)
ARM = (0.2, -0.1, -0.3)
POSE = [
    {"column": name, "stream": "pose", "field": name, "unit": unit}
    for names, unit in ((POSITION, "m"), (("q_w", "q_x", "q_y", "q_z"), "1"))
    for name in names
]
COMMANDS = {"cmd2": "surge", "cmd3": "sway", "cmd1": "heave", "cmd0": "yaw"}


def ingested(
    columns: dict[str, Array], entries: list[dict[str, Any]], vehicle: Vehicle | None = None
) -> ingest.Outputs:
    """Return what ingest makes of one CSV file."""
    lines = [
        ",".join(f"{value:.9g}" for value in row) for row in zip(*columns.values(), strict=True)
    ]
    text = "\n".join([",".join(columns), *lines])
    document = {"time": {"column": "t_s", "unit": "s"}, "columns": entries}
    file = RawFile("tank.csv", np.frombuffer(text.encode(), np.uint8), document)
    campaign = {"logs": [{"id": "dive"}]}
    return ingest.run(ingest.Inputs(RawLog("dive", (file,)), campaign, vehicle), ingest.Params())


def pose_columns(run: PoseRun, position: Array, attitude: Array) -> dict[str, Array]:
    """Return the columns of a file of poses."""
    names = (*POSITION, "q_w", "q_x", "q_y", "q_z")
    return {"t_s": run.t_s, **dict(zip(names, np.hstack([position, attitude]).T, strict=True))}


def of(outputs: ingest.Outputs, name: str) -> list[dict[str, Any]]:
    """Return the findings of one name."""
    return [item for item in outputs.health["findings"] if item["id"] == name]


def test_velocity_gyro_attitude_and_depth_come_from_poses_at_their_places() -> None:
    run = pose_run(T_S, 3)
    mounted: dict[str, Any] = {
        "pose": {"arm": {"value": list(ARM), "unit": "m", "source": "measured"}},
        "dvl": {
            "arm": {"value": [0.3, 0.0, 0.2], "unit": "m", "source": "measured"},
            "mounting": {"value": [0.0, 0.0, 90.0], "unit": "deg", "source": "measured"},
            "lag": {"value": 0.1, "unit": "s", "source": "measured"},
        },
        "depth": {"arm": {"value": [0.5, 0.0, 0.1], "unit": "m", "source": "measured"}},
    }
    vehicle = vehicle_from_document({**vehicle_document("bluerov2"), "sensors": mounted})
    poses = tracked(run, 3, noise_m=1e-3, noise_rad=1e-3, arm_m=ARM)
    outputs = ingested(pose_columns(run, *poses), POSE, vehicle)
    assert outputs.velocity is not None
    assert outputs.imu is not None
    assert outputs.attitude is not None
    assert outputs.depth is not None
    stamps = np.asarray(outputs.velocity["time_us"]) / 1e6 - 0.1
    at = np.searchsorted(run.t_s, stamps - 1e-4)
    sensed = matrix(outputs.velocity, LINEAR_VELOCITY) @ vehicle.dvl.rotation.T
    body = lever_arm_velocity(sensed, run.rate[at], vehicle.dvl.arm_m)
    assert np.sqrt(np.mean((body - run.velocity[at]) ** 2)) < 8e-3
    rate = matrix(outputs.imu, GYRO)
    assert np.sqrt(np.mean((rate - run.rate) ** 2)) < 15e-3
    angles = matrix(outputs.attitude, ATTITUDE)
    assert np.abs(np.sin(0.5 * (angles - run.attitude))).max() < 5e-3
    depth = run.position[:, 2] + (run.rotation @ vehicle.depth_sensor.arm_m)[:, 2]
    np.testing.assert_allclose(np.asarray(outputs.depth["depth_m"]), depth, atol=5e-3)
    notes = " ".join(outputs.log_info.notes)
    assert "velocity is derived from the poses" in notes
    assert "not the surface" in notes


def test_a_velocity_log_goes_before_poses() -> None:
    run = pose_run(T_S, 4)
    columns = pose_columns(run, *tracked(run, 4, noise_m=1e-3, noise_rad=1e-3))
    columns |= dict(zip(LINEAR_VELOCITY, (run.velocity + 0.5).T, strict=True))
    entries = POSE + [
        {"column": name, "stream": "velocity", "field": name, "unit": "m/s"}
        for name in LINEAR_VELOCITY
    ]
    outputs = ingested(columns, entries)
    assert outputs.velocity is not None
    np.testing.assert_allclose(
        matrix(outputs.velocity, LINEAR_VELOCITY), run.velocity + 0.5, atol=1e-6
    )
    assert "velocity is derived" not in " ".join(outputs.log_info.notes)
    assert outputs.imu is not None


@pytest.mark.parametrize("stream", ["pose", "attitude"])
def test_a_yaw_rate_alone_has_roll_and_pitch_rates_of_the_attitude(stream: str) -> None:
    run = pose_run(T_S, 5)
    columns = pose_columns(run, *tracked(run, 5, noise_m=1e-3, noise_rad=1e-4))
    columns["r"] = run.rate[:, 2] + 0.01
    # The attitude begins a second late: there is no roll rate before.
    columns["q_w"][T_S < 1.0] = np.nan
    entries = [
        {**entry, "stream": stream}
        for entry in POSE
        if stream == "pose" or entry["field"] not in POSITION
    ]
    entries.append({"column": "r", "stream": "imu", "field": GYRO[2], "unit": "rad/s"})
    outputs = ingested(columns, entries)
    assert outputs.imu is not None
    rate = matrix(outputs.imu, GYRO)
    rows = -len(rate)
    assert T_S[rows] == pytest.approx(1.0)
    np.testing.assert_allclose(rate[:, 2], columns["r"][rows:], atol=1e-6)
    assert np.sqrt(np.mean((rate - run.rate[rows:])[5:-5, :2] ** 2)) < 15e-3
    assert "only the yaw rate is logged" in " ".join(outputs.log_info.notes)
    assert not [words for words in outputs.log_info.notes if "imu" in words and "too" in words]
    assert not of(outputs, "gyro_sign")
    (item,) = of(ingested({**columns, "r": -columns["r"]}, entries), "gyro_sign")
    assert "Gyro z turns against yaw" in item["text"]
    with pytest.raises(PipelineError, match="Map a column to gyro_x_rad_s, gyro_y_rad_s too"):
        ingested(columns, [entries[-1]])


def test_a_jump_and_a_freeze_are_cut_and_named_with_their_times() -> None:
    run = pose_run(T_S, 6)
    position, attitude = tracked(run, 6, noise_m=2e-3, noise_rad=2e-3)
    position[T_S >= 40.0] += [0.0, 0.4, 0.3]
    position[(T_S > 20.0) & (T_S < 21.0)] = position[400]
    attitude[(T_S > 20.0) & (T_S < 21.0)] = attitude[400]
    outputs = ingested(pose_columns(run, position, attitude), POSE)
    (jump,) = of(outputs, "pose_jump")
    (freeze,) = of(outputs, "pose_freeze")
    assert "at 40.0 s by 0.5" in jump["text"]
    assert jump["at_s"] == pytest.approx(40.0, abs=0.11)
    assert "from 20.0 to 2" in freeze["text"]
    assert outputs.velocity is not None
    stamps = np.asarray(outputs.velocity["time_us"]) / 1e6
    assert not np.any((stamps > 20.1) & (stamps < 20.8))
    assert not np.any((stamps > 39.5) & (stamps < 40.5))
    (gap,) = of(outputs, "gap")
    assert "s at 39.4 s from the start: the poses there" in gap["text"]


@pytest.mark.parametrize(
    ("factor", "finding", "remedy"),
    [((1000.0, 1.0), "pose_unit", "unit: mm"), ((1.0, 180.0 / np.pi), "pose_angle_unit", "deg")],
)
def test_millimetres_and_degrees_are_named(
    factor: tuple[float, float], finding: str, remedy: str
) -> None:
    run = noisy(tank_run(2), 2)
    run["roll_rad"], run["pitch_rad"] = 0.1 * run["roll_rad"], 0.1 * run["pitch_rad"]
    outputs = ingested(*tank_poses(run, factor))
    (item,) = of(outputs, finding)
    assert item["severity"] == "error"
    assert remedy in item["remedy"]
    assert not of(ingested(*tank_poses(run)), finding)


def tank_poses(
    run: dict[str, Array], factor: tuple[float, float] = (1.0, 1.0)
) -> tuple[dict[str, Array], list[dict[str, Any]]]:
    """Return poses and commands of a run in a tank, and what the columns are."""
    angles = dict(zip(("roll_rad", "pitch_rad", "yaw_rad"), ATTITUDE, strict=True))
    columns = {"t_s": run["t_s"]}
    columns |= {name: run[name] * factor[0] for name in POSITION}
    columns |= {name: run[name] * factor[1] for name in angles}
    columns |= {name: run[name] for name in COMMANDS}
    entries = [{"column": name, "stream": "pose", "field": name, "unit": "m"} for name in POSITION]
    entries += [
        {"column": name, "stream": "pose", "field": field, "unit": "rad"}
        for name, field in angles.items()
    ]
    entries += [
        {"column": name, "stream": "actuators", "field": f"command_{axis}", "unit": "1"}
        for name, axis in COMMANDS.items()
    ]
    return columns, entries


def tank_velocities(run: dict[str, Array]) -> tuple[dict[str, Array], list[dict[str, Any]]]:
    """Return velocities, yaw rate, angles and commands of a run, and what they are."""
    columns, entries = tank_poses(run)
    entries = [
        {**entry, "stream": "attitude" if entry["stream"] == "pose" else entry["stream"]}
        for entry in entries
        if entry["field"] not in POSITION
    ]
    moves = dict(zip(("u_mps", "v_mps", "w_mps"), LINEAR_VELOCITY, strict=True))
    entries += [
        {"column": name, "stream": "velocity", "field": field, "unit": "m/s"}
        for name, field in moves.items()
    ]
    entries.append({"column": "r_radps", "stream": "imu", "field": GYRO[2], "unit": "rad/s"})
    return columns | {name: run[name] for name in (*moves, "r_radps")}, entries


@pytest.mark.parametrize("turned", ["y_m", "yaw_rad"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_left_handed_frame_is_named(turned: str, seed: int) -> None:
    run = noisy(tank_run(seed), seed)
    assert not of(ingested(*tank_poses(run)), "pose_handedness")
    run[turned] = -run[turned]
    (item,) = of(ingested(*tank_poses(run)), "pose_handedness")
    assert "commands explain" in item["text"]
    assert "sign -1" in item["remedy"]


@pytest.mark.parametrize(
    ("late_s", "table"),
    [(7.3, tank_poses), (-4.1, tank_poses), (3.0, tank_velocities), (-7.3, tank_velocities)],
)
def test_two_clocks_are_named_with_their_offset(
    late_s: float, table: Callable[..., tuple[dict[str, Array], list[dict[str, Any]]]]
) -> None:
    run = noisy(tank_run(3, duration_s=90.0), 3)
    steps = round(late_s / 0.1)
    for name in COMMANDS:
        run[name] = np.roll(run[name], steps)
    cut = slice(abs(steps), -abs(steps))
    outputs = ingested(*table({name: values[cut] for name, values in run.items()}))
    (item,) = of(outputs, "pose_clock")
    assert item["value"] == pytest.approx(-late_s, abs=0.5)
    assert "shift_s" in item["remedy"]
    assert not of(ingested(*table(noisy(tank_run(3), 3))), "pose_clock")


@pytest.mark.parametrize("rate", [1.01, 0.985])
def test_a_clock_that_drifts_is_named_with_its_rate(rate: float) -> None:
    run = noisy(tank_run(3, duration_s=240.0), 3)
    for name in COMMANDS:
        run[name] = run[name][
            np.minimum((run["t_s"] * rate / 0.1).astype(int), run["t_s"].size - 1)
        ]
    (item,) = of(ingested(*tank_poses(run)), "pose_clock")
    factor = float(item["remedy"].split(" by ")[1].split()[0])
    assert factor == pytest.approx(rate, abs=3e-3)
    assert not of(ingested(*tank_poses(noisy(tank_run(3, duration_s=240.0), 3))), "pose_clock")


def test_an_axis_that_is_hardly_commanded_is_not_mixed() -> None:
    """Small corrections aside and in heave, into which a coupled hull takes a part of surge."""
    run = noisy(tank_run(1), 1)
    for name in ("cmd3", "cmd1"):
        run[name] = 0.05 * run[name]
    assert not of(ingested(*tank_poses(run)), "commands_mixed")


def test_a_single_command_that_moves_is_not_mixed() -> None:
    """The run of one thruster ended in an internal fault."""
    run = noisy(tank_run(1), 1)
    for name in COMMANDS:
        if name != "cmd2":
            run[name] = np.zeros_like(run[name])
    assert not of(ingested(*tank_poses(run)), "commands_mixed")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_commands_that_a_frame_mixed_are_named(seed: int) -> None:
    run = noisy(tank_run(seed), seed)
    assert not of(ingested(*tank_poses(run)), "commands_mixed")
    forward, aside, turn = (run[name].copy() for name in ("cmd2", "cmd3", "cmd0"))
    run["cmd2"] = forward + aside + turn
    run["cmd3"] = forward - aside - turn
    run["cmd0"] = aside - forward - turn
    (item,) = of(ingested(*tank_poses(run)), "commands_mixed")
    assert item["value"] >= 2.0
    assert "--commands" in item["remedy"]


@pytest.mark.parametrize(("angle", "seed"), [(0, 1), (10, 2), (-35, 3), (90, 4), (180, 5)])
def test_markers_that_are_turned_are_named_with_their_angle(angle: float, seed: int) -> None:
    """Exchanged commands turn surge one way and sway the other: they are no turn."""
    run = noisy(tank_run(seed), seed)
    run["yaw_rad"] = run["yaw_rad"] + np.radians(angle)
    items = of(ingested(*tank_poses(run)), "pose_turned")
    assert len(items) == (angle != 0)
    for item in items:
        off = (item["value"] + angle + 180.0) % 360.0 - 180.0
        assert off == pytest.approx(0.0, abs=3.0)
        assert f"mounting: {{value: [0, 0, {-item['value']:.0f}]" in item["remedy"]
    run["cmd2"], run["cmd3"] = run["cmd3"], run["cmd2"]
    assert not of(ingested(*tank_poses(run)), "pose_turned")


def test_angles_in_rad_that_are_read_as_degrees_are_no_turned_markers() -> None:
    """One run in degrees makes a map of degrees for those in radians."""
    run = noisy(tank_run(3), 3)
    columns, entries = tank_poses(run)
    for entry in entries:
        if entry["unit"] == "rad":
            entry["unit"] = "deg"
    outputs = ingested(columns, entries)
    (item,) = of(outputs, "attitude_unit")
    assert "unit: rad" in item["remedy"]
    assert not of(outputs, "pose_turned")


@pytest.mark.parametrize("gain", [0.0, 0.004])
def test_a_heading_that_is_held_is_in_no_other_unit(
    gain: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Angles stay small, and commands explain the motion as they are."""
    monkeypatch.setattr(tank_runs, "GAIN", tank_runs.GAIN * [1.0, 1.0, 1.0, gain])
    outputs = ingested(*tank_poses(noisy(tank_run(1), 1)))
    assert outputs.attitude is not None
    assert np.abs(matrix(outputs.attitude, ATTITUDE)).max() < 0.05
    assert not of(outputs, "attitude_unit")


def test_no_axis_of_poses_has_a_clock_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Poses have one clock: sway that follows late is a hull whose drag is bent."""
    monkeypatch.setattr(velocity_clock, "slow_by_itself", lambda log, axis, less: False)
    run = noisy(tank_run(1), 1)
    run["cmd3"] = np.roll(run["cmd3"], -12)
    assert not of(ingested(*tank_poses(run)), "velocity_lag")


def with_y_up(run: dict[str, Array], frame: str) -> tuple[dict[str, Array], list[dict[str, Any]]]:
    """Return poses of a run as a tracking system with y up writes them, in a declared frame."""
    columns, entries = tank_poses(run)
    to_file = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    angles = np.column_stack([run[name] for name in ("yaw_rad", "pitch_rad", "roll_rad")])
    body = Rotation.from_euler("ZYX", angles).as_matrix()
    q = Rotation.from_matrix(to_file @ body @ to_file.T).as_quat()
    place = np.column_stack([run[name] for name in POSITION]) @ to_file.T
    columns = {name: values for name, values in columns.items() if not name.endswith("_rad")}
    columns |= dict(
        zip((*POSITION, "q_x", "q_y", "q_z", "q_w"), np.hstack([place, q]).T, strict=True)
    )
    entries = [entry for entry in entries if entry["stream"] != "pose"]
    return columns, entries + [{**entry, "frame": frame} for entry in POSE]


@pytest.mark.parametrize(("frame", "seed"), [("ned", 1), ("enu", 2), ("flu", 3)])
def test_poses_with_y_up_are_named(frame: str, seed: int) -> None:
    outputs = ingested(*with_y_up(noisy(tank_run(seed), seed), frame))
    (item,) = of(outputs, "pose_up")
    assert "sway, heave and yaw answer their own commands" in item["text"]
    assert "frame: y_up" in item["remedy"]
    assert not of(outputs, "commands_mixed")


@pytest.mark.parametrize(("frame", "seed"), [("ned", 2), ("enu", 3)])
def test_upright_angles_with_y_up_are_named(frame: str, seed: int) -> None:
    """Of roll, pitch and yaw by their meaning only the place has another axis up."""
    columns, entries = with_y_up(noisy(tank_run(seed), seed), frame)
    q = np.column_stack([columns.pop(name) for name in ("q_x", "q_y", "q_z", "q_w")])
    yaw_pitch_roll = Rotation.from_quat(q).as_euler("YZX").T
    columns |= dict(zip(ATTITUDE[::-1], yaw_pitch_roll, strict=True))
    entries = [entry for entry in entries if not entry["field"].startswith("q_")]

    def findings(frame: str) -> list[dict[str, Any]]:
        angles = [
            {"column": name, "stream": "pose", "field": name, "unit": "rad"} for name in ATTITUDE
        ]
        declared = [
            {**entry, "frame": frame} if entry["stream"] == "pose" else entry
            for entry in [*entries, *angles]
        ]
        return of(ingested(columns, declared), "pose_up")

    (item,) = findings(frame)
    assert "heave moves it to one side" in item["text"]
    assert not findings("y_up")


def test_poses_with_y_up_that_are_declared_so_are_sound() -> None:
    run = noisy(tank_run(2), 2)
    outputs = ingested(*with_y_up(run, "y_up"))
    assert not [item for item in outputs.health["findings"] if item["severity"] == "error"]
    assert outputs.velocity is not None
    at = np.searchsorted(run["t_s"], np.asarray(outputs.velocity["time_us"]) / 1e6 - 1e-4)
    speeds = np.column_stack([run[name] for name in ("u_mps", "v_mps", "w_mps")])[at]
    assert np.sqrt(np.mean((matrix(outputs.velocity, LINEAR_VELOCITY) - speeds) ** 2)) < 0.03


def test_small_motion_of_poses_names_the_unit_of_the_position() -> None:
    """Centimetres taken for millimetres: a tenth of all speeds."""
    columns, entries = tank_poses(noisy(tank_run(1), 1))
    small = ingested(columns | {name: 0.1 * columns[name] for name in POSITION}, entries)
    (unit,) = of(small, "pose_unit")
    assert "10 times that" in unit["text"]
    assert "unit: cm, where it has mm" in unit["remedy"]
    assert not of(ingested(columns, entries), "pose_unit")
    large = ingested(columns | {name: 100.0 * columns[name] for name in POSITION}, entries)
    assert "unit: cm, where it has m)" in of(large, "pose_unit")[0]["remedy"]
    (item,) = of(small, "not_excited")
    assert "set unit: cm" in item["remedy"]
    (tilt,) = of(ingested(columns, entries), "not_excited")
    assert "position" not in tilt["remedy"]


def test_a_vehicle_that_loops_has_no_y_up() -> None:
    """Its poses look the same, but the commands of its axes as they are move it."""
    columns, entries = with_y_up(noisy(tank_run(2), 2), "ned")
    other = {"command_sway": "heave", "command_heave": "sway", "command_yaw": "pitch"}
    entries = [
        {**entry, "field": f"command_{other[entry['field']]}"} if entry["field"] in other else entry
        for entry in entries
    ]
    columns["cmd1"], columns["cmd0"] = -columns["cmd1"], -columns["cmd0"]
    outputs = ingested(columns, entries)
    assert not of(outputs, "pose_up")
    assert not of(outputs, "commands_mixed")


def test_yaw_that_was_averaged_across_its_wrap_is_named() -> None:
    run = noisy(tank_run(1, duration_s=120.0), 1)
    yaw = run["yaw_rad"]
    rows = np.flatnonzero(np.abs(np.diff(yaw)) > np.pi)
    assert rows.size
    yaw[rows] = 0.5 * (yaw[rows] + yaw[rows + 1])
    (item,) = of(ingested(*tank_poses(run)), "yaw_across_wrap")
    columns, entries = tank_poses(run)
    entries += [{**entry, "stream": "attitude"} for entry in entries if entry["field"] in ATTITUDE]
    assert [row["value"] for row in of(ingested(columns, entries), "yaw_across_wrap")] == [
        item["value"]
    ]
    assert item["value"] >= 0.5 * rows.size
    assert item["at_s"] == pytest.approx(run["t_s"][rows[0]], abs=20.0)


def test_outliers_and_a_stretch_without_any_motion_are_named() -> None:
    run = pose_run(T_S, 7)
    position, attitude = tracked(run, 7, noise_m=2e-3, noise_rad=2e-3, outliers=0.05)
    lost = (T_S > 30.0) & (T_S < 32.0)
    rng = np.random.default_rng(7)
    position[lost] = rng.normal(0.0, 3.0, (int(lost.sum()), 3))
    outputs = ingested(pose_columns(run, position, attitude), POSE)
    (outliers,) = of(outputs, "pose_outliers")
    assert outliers["value"] == pytest.approx(0.05, abs=0.025)
    gone = [*of(outputs, "pose_lost"), *of(outputs, "pose_jump")]
    assert any(29.5 < item["at_s"] < 32.5 for item in gone)
    assert outputs.velocity is not None
    stamps = np.asarray(outputs.velocity["time_us"]) / 1e6
    at = np.searchsorted(run.t_s, stamps - 1e-4)
    off = matrix(outputs.velocity, LINEAR_VELOCITY) - run.velocity[at]
    assert np.sqrt(np.mean(off**2)) < 0.03


def test_every_finding_of_poses_has_its_cause_here() -> None:
    text = Path(__file__).read_text()
    names = {name for name in checks() if name.startswith("pose_")} | {"yaw_across_wrap"}
    assert {name for name in names if f'"{name}"' not in text} == set()
