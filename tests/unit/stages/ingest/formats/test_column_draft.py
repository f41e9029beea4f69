"""Column maps drafted from names and values: units, times, marks, commands, refusals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.units import factor_and_offset
from auvid.stages.base import RawFile
from auvid.stages.columns import ATTITUDE, FINS, GYRO, LINEAR_VELOCITY, POSITION
from auvid.stages.ingest.formats.csv.column_map import column_map
from auvid.stages.ingest.formats.csv.column_names import named_columns
from auvid.stages.ingest.formats.csv.draft.column_draft import ColumnDraft
from auvid.stages.ingest.formats.csv.draft.draft_corrections import corrected
from auvid.stages.ingest.formats.csv.draft.drafting import draft_columns
from tests.support.column_drafts import T_S, drafted, wave
from tests.support.tank_runs import noisy, tank_run

PULSES = tuple(f"pwm_{number}_us" for number in range(1, 5))


@pytest.mark.parametrize(
    ("name", "words", "unit"),
    [
        ("Yaw Rate [deg/s]", "yaw rate", "deg/s"),
        ("Depth (m)", "depth", "m"),
        ("velX(mm/s)", "vel x", "mm/s"),
        ("timestamp_ms", "timestamp", "ms"),
        ("accX [m/s²]", "acc x", "m/s^2"),
        ("gyro_x", "gyro x", ""),
        ("t", "t", ""),
    ],
)
def test_units_in_names(name: str, words: str, unit: str) -> None:
    (item,) = named_columns([name])
    assert (item.words, item.unit) == (words, unit)


@pytest.mark.parametrize(
    ("names", "fields"),
    [
        (("vx", "vy", "vz"), ("u_m_s", "v_m_s", "w_m_s")),
        (("wx", "wy", "wz"), ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")),
        (("ax", "ay", "az"), ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2")),
        (("phi", "theta", "psi"), ("phi_rad", "theta_rad", "psi_rad")),
        (("Roll", "Pitch", "Heading [deg]"), ("phi_rad", "theta_rad", "psi_rad")),
        (("servo1_raw", "servo2_raw"), ("pwm_1_us", "pwm_2_us")),
        (("twist.linear.x", "twist.angular.z"), ("u_m_s", "gyro_z_rad_s")),
        (("cmd_surge", "tau_z"), ("command_surge", "command_heave")),
        (("forward", "left", "up"), ("u_m_s", "v_m_s", "w_m_s")),
        (("vel_north", "target_depth", "depth_std"), (None, None, None)),
        (("surge", "sway", "yaw"), ("command_surge", "command_sway", "command_yaw")),
        (("odom_pose_position_x", "translation.y"), ("x_m", "y_m")),
        (("rigid_body_x_m", "RigidBody y", "body_z"), ("x_m", "y_m", None)),
        (("velocity_body_x", "v_b", "body_w"), ("u_m_s", "v_m_s", "w_m_s")),
        (("vel_forward", "v_stbd", "vel_down"), ("u_m_s", "v_m_s", "w_m_s")),
        (("v_ahead_kn", "v_stbd_kn", "v_down_kn"), LINEAR_VELOCITY),
        (("plane_stbd_deg", "port_elevator", "rudder_low", "rudder_up_deg"), FINS),
        (("nu[0]", "nu[1]", "nu[2]", "nu[3]", "nu[4]", "nu[5]"), (*LINEAR_VELOCITY, *GYRO)),
        (("omega_1", "omega_2", "omega_3", "r_rate"), (*GYRO, "gyro_z_rad_s")),
        (("rpy[0]", "rpy[1]", "rpy[2]", "mag_heading"), (*ATTITUDE, "psi_rad")),
        (("T1_pwm", "motor_cmd_2", "chan3_raw", "thrusters[4]"), PULSES),
        (("pressure_pa", "prop_rpm"), ("depth_m", "propeller_rev_s")),
        (("cmd_vel.linear.x", "ref_roll", "fwd_thruster"), (None, None, None)),
        (("gain1", "gain2", "gain3", "p1", "p2", "p3"), (None,) * 6),
        (
            ("x", "y", "z", "roll", "pitch", "yaw", "surge", "sway", "yaw_cmd"),
            (*POSITION, *ATTITUDE, "command_surge", "command_sway", "command_yaw"),
        ),
        (
            ("x", "y", "z", "qw", "surge", "sway", "roll", "yaw"),
            (*POSITION, None, "command_surge", "command_sway", "command_roll", "command_yaw"),
        ),
    ],
)
def test_names_of_columns(names: tuple[str, ...], fields: tuple[str | None, ...]) -> None:
    places = tuple(item.place and item.place[1] for item in named_columns(names))
    assert places == fields


def test_units_that_no_name_tells_are_taken_from_the_values_and_marked() -> None:
    draft = drafted(
        {
            "time": T_S * 1e3 + 5.0,
            "roll": wave(12.0),
            "pitch": wave(3.0),
            "yaw": 180.0 + wave(90.0),
            "vx": wave(350.0),
            "vy": wave(200.0),
            "vz": wave(50.0),
            "gyro_x": wave(20.0),
            "gyro_y": wave(4.0),
            "gyro_z": wave(30.0),
            "acc_x": wave(0.1),
            "acc_y": wave(0.1),
            "acc_z": -1.0 + wave(0.01),
            "voltage": 15_900.0 + wave(100.0),
        }
    )
    assert dict(draft.time) == {"column": "time", "unit": "ms", "epoch": "boot"}
    units = {item.field: item.unit for item in draft.columns}
    assert units["psi_rad"] == units["phi_rad"] == "deg"
    assert units["u_m_s"] == units["w_m_s"] == "mm/s"
    assert units["gyro_y_rad_s"] == "deg/s"
    assert units["accel_x_m_s2"] == "g0"
    assert units["voltage_v"] == "mV"
    assert draft.accelerometer == "specific_force"
    text = draft.text()
    assert 'field: u_m_s, unit: "mm/s"}  # check: by its size' in text


@pytest.mark.parametrize(
    ("names", "marked"),
    [
        (("vx_m_s", "vy_m_s", "vz_m_s"), True),
        (("vel_x [m/s]", "vel_y [m/s]", "vel_z [m/s]"), True),
        (("linear.x [m/s]", "linear.y [m/s]", "linear.z [m/s]"), True),
        (("u_m_s", "v_m_s", "w_m_s"), False),
        (("surge_speed_m_s", "sway_speed_m_s", "heave_speed_m_s"), False),
    ],
)
def test_velocities_that_may_be_of_world_axes_are_marked(
    names: tuple[str, ...], marked: bool
) -> None:
    draft = drafted({"t_s": T_S, **{name: wave(0.5) for name in names}})
    assert [item.field for item in draft.columns] == ["u_m_s", "v_m_s", "w_m_s"]
    check = "body axes assumed, forward right down" if marked else ""
    assert {item.check for item in draft.columns} == {check}


def test_a_numbered_quaternion_has_w_where_it_is_level_and_is_marked() -> None:
    heading = wave(1.2)
    parts = (np.cos(heading), wave(0.02), 0.0 * heading, np.sin(heading))
    for order, words in (("wxyz", "w first"), ("xyzw", "w last")):
        columns = {f"q[{n}]": parts["wxyz".index(part)] for n, part in enumerate(order)}
        draft = drafted({"t_s": T_S, **columns})
        assert [item.field for item in draft.columns] == [f"q_{part}" for part in order]
        assert all(words in item.check for item in draft.columns)


def test_semicolons_and_decimal_commas() -> None:
    draft = drafted({"t_s": T_S, "depth_m": 3.0 + wave(1.0)}, delimiter=";", decimal=",")
    assert (draft.delimiter, draft.decimal) == (";", ",")
    assert draft.document()["decimal"] == ","


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_unix_times_tell_their_unit(factor: float, unit: str) -> None:
    draft = drafted({"stamp": (1.7e9 + T_S) * factor, "depth_m": 3.0 + wave(1.0)})
    assert dict(draft.time) == {"column": "stamp", "unit": unit, "epoch": "unix"}


@pytest.mark.parametrize(
    ("seconds", "nanoseconds"),
    [("header.stamp.sec", "header.stamp.nanosec"), ("secs", "nsecs"), ("stamp_s", "stamp_ns")],
)
def test_stamps_of_ros_are_read_from_their_two_columns(seconds: str, nanoseconds: str) -> None:
    full_s = np.floor(1.7e9 + T_S)
    columns = {
        seconds: full_s,
        nanoseconds: np.rint((1.7e9 + T_S - full_s) * 1e9),
        "depth_m": 3.0 + wave(1.0),
    }
    draft = drafted(columns)
    assert draft.time == {
        "column": seconds,
        "unit": "s",
        "epoch": "unix",
        "nanoseconds": nanoseconds,
    }
    assert draft.unused == ()
    assert np.ptp(draft.span_s) == pytest.approx(T_S[-1], abs=1e-6)


@pytest.mark.parametrize(("start", "factor"), [(1e8, 1e6), (2e9, 1e6), (1e12, 1e9)])
def test_times_since_boot_are_not_taken_for_unix_times(start: float, factor: float) -> None:
    draft = drafted({"timestamp": start + T_S * factor, "depth_m": wave(1.0)})
    unit = {1e6: "us", 1e9: "ns"}[factor]
    assert draft.time == {"column": "timestamp", "unit": unit, "epoch": "boot"}
    assert draft.time_check == f"unit {unit} by the rate of the rows"


@pytest.mark.parametrize("step_s", [2.2, 4.0])
@pytest.mark.parametrize("uneven", [0.0, 0.3])
def test_fixes_that_come_every_few_seconds_are_not_read_in_ms(step_s: float, uneven: float) -> None:
    time = 1.0 + step_s * (np.arange(600) + uneven * np.sin(np.arange(600.0) ** 2))
    assert drafted({"time": time, "depth_m": 3.0 + wave(1.0)}).time["unit"] == "s"
    # Rows of 250 Hz in ms stay what they are, those of a timer with digits, too.
    rows = np.arange(20_000) * step_s
    columns = {"time": rows, "depth_m": 3.0 + 0.1 * np.sin(rows / 300.0)}
    assert drafted(columns).time["unit"] == "ms"
    assert drafted(columns | {"time": rows + 0.02 * np.sin(rows)}).time["unit"] == "ms"


def test_the_speed_of_a_tow_has_the_unit_of_its_own_size() -> None:
    """Newtons of the line say nothing of it."""
    columns = {"t": T_S, "tension_N": 30.0 + wave(5.0), "speed": 1.0 + wave(0.2)}
    units = {item.field: item.unit for item in drafted(columns).columns}
    assert units == {"tow_force_n": "N", "tow_speed_m_s": "m/s"}


def test_a_named_unit_of_time_is_marked_where_no_log_has_such_steps() -> None:
    draft = drafted({"timestamp_s": 1e8 + T_S * 1e6, "depth_m": wave(1.0)})
    assert draft.time["epoch"] == "boot"
    assert draft.time_check == "one row every 1e+05 s in this unit"
    assert drafted({"time_s": T_S, "depth_m": wave(1.0)}).time_check == ""


def test_text_times_are_iso_or_times_of_day() -> None:
    iso = np.array([f"2024-05-01 10:00:{second:06.3f}" for second in T_S])
    draft = drafted({"Date": np.arange(600) * 0.0, "Timestamp": iso, "depth_m": 3.0 + wave(1.0)})
    assert draft.time["unit"] == "iso8601"
    of_day = np.array([f"10:00:{second:06.3f}" for second in T_S])
    draft = drafted({"Time": of_day, "depth_m": 3.0 + wave(1.0)})
    assert draft.time == {"column": "Time", "unit": "time_of_day", "epoch": "arbitrary"}
    minutes = np.array([f"10:{second:02.0f}" for second in T_S])
    with pytest.raises(LogError, match="time of day"):
        drafted({"Time": minutes, "depth_m": 3.0 + wave(1.0)})


def test_a_height_below_the_surface_is_depth_and_z_stands_in_for_it() -> None:
    (depth,) = drafted({"t_s": T_S, "altitude_m": -5.0 + wave(1.0)}).columns
    assert (depth.field, depth.sign) == ("depth_m", -1)
    draft = drafted({"t_s": T_S, "x": wave(1.0), "y": wave(1.0), "z": 4.0 + wave(1.0)})
    assert {item.field for item in draft.columns} == {"x_m", "y_m", "z_m", "depth_m"}


def test_outputs_that_are_no_pulses_and_parts_of_a_stream_are_left_out_and_said() -> None:
    draft = drafted(
        {
            "t_s": T_S,
            "depth_m": 3.0 + wave(1.0),
            "roll_rad": wave(0.1),
            "motor1": 3000.0 + wave(0.5),
            "motor2": 3000.0 + wave(0.5),
        }
    )
    assert draft.streams == ("depth",)
    assert any("no pulses" in remark for remark in draft.remarks)
    assert any("attitude is left out" in remark for remark in draft.remarks)


def test_outputs_by_their_values() -> None:
    normalised = drafted({"t_s": T_S, "thr_0": wave(0.9), "thr_1": wave(0.5)})
    assert [(item.field, item.unit) for item in normalised.columns] == [
        ("pwm_1_us", "1"),
        ("pwm_2_us", "1"),
    ]
    assert "counted from 0" in " ".join(normalised.remarks)
    pulses = drafted({"t_s": T_S, **{f"aux {n}": 1500.0 + wave(200.0) for n in (1, 2, 3)}})
    assert [item.field for item in pulses.columns] == ["pwm_1_us", "pwm_2_us", "pwm_3_us"]
    # Six numbered columns are a velocity by name (nu 0 to 5), and outputs by their values.
    array = {f"data_{n}": 1500.0 + wave(200.0) for n in range(6)}
    assert [item.field for item in drafted({"t_s": T_S, **array}).columns] == [
        f"pwm_{n}_us" for n in range(1, 7)
    ]
    moving = {f"nu_{n}": wave(0.5) for n in range(6)}
    assert "velocity" in drafted({"t_s": T_S, **moving}).streams
    topic = "/mavros/local_position/pose/pose/"
    parts = {f"{topic}position/{axis}": wave(2.0) for axis in "xyz"}
    parts |= {f"{topic}orientation/{axis}": wave(0.1) for axis in "xyz"}
    parts |= {f"{topic}orientation/w": 1.0 + wave(0.0)}
    pose = drafted({"t_s": T_S, **parts})
    assert pose.streams == ("pose",)
    assert {item.frame for item in pose.columns} == {"enu"}


def test_a_pressure_is_depth_only_with_its_unit() -> None:
    (depth,) = drafted({"t_s": T_S, "pressure_mbar": 1100.0 + wave(50.0)}).columns
    assert (depth.field, depth.unit) == ("depth_m", "mbar")
    assert "surface" in depth.check
    assert drafted_streams({"t_s": T_S, "pressure": 1100.0 + wave(50.0)}) == ()
    # Of a Slocum glider it is in bar; of another one it has to be said.
    glider = {"m_ballast_pumped": wave(200.0), "m_pitch": wave(0.4), "m_roll": wave(0.1)}
    slocum = drafted({"t_s": T_S, "m_pressure": 5.0 + wave(4.0), **glider}).columns
    assert [(i.field, i.unit) for i in slocum if "press" in i.field] == [("pressure_pa", "bar")]
    other = drafted({"t_s": T_S, "pressure": 5.0 + wave(4.0), "ballast_cc": wave(200.0)})
    assert any("pressure_dbar" in remark for remark in other.remarks)


def drafted_streams(columns: dict[str, np.ndarray]) -> tuple[str, ...]:
    rows = "\n".join(
        ",".join(f"{value:.4f}" for value in row) for row in zip(*columns.values(), strict=True)
    )
    data = f"{','.join(columns)}\n{rows}\n".encode()
    return draft_columns(RawFile("log.csv", np.frombuffer(data, np.uint8), None)).streams


def test_a_forward_left_up_body_is_a_frame_and_one_axis_is_none() -> None:
    draft = drafted(
        {"t_s": T_S, "vx": wave(1.0), "vy": wave(1.0), "vz": wave(1.0)}
        | {f"gyro_{axis}": wave(0.3) for axis in "xyz"}
    )
    both = [
        {"id": "response_sign", "fields": [name], "text": "Reversed.", "value": -9.0}
        for name in ("v_m_s", "gyro_z_rad_s", "w_m_s")
    ]
    assert {item.frame for item in corrected(draft, both[:2]).columns} == {"flu"}
    assert {item.frame for item in corrected(draft, both[1:]).columns} == {"flu"}  # no sway
    assert corrected(draft, both[:1]) == draft


def test_poses_whose_y_is_up_are_drafted_so() -> None:
    pose = {"t_s": T_S, **{name: wave(1.0) for name in ("x", "y", "z", "roll", "pitch", "yaw")}}
    draft = drafted(pose)
    findings = [{"id": "pose_up", "fields": [], "text": "The poses look as if.", "value": 1.0}]
    of_poses = {"id": "attitude_unit", "stream": "pose", "fields": [], "text": "", "value": None}
    assert corrected(draft, [of_poses]) == draft  # other runs of the map may be in degrees
    better = corrected(draft, findings)
    assert {item.frame for item in better.columns if item.stream == "pose"} == {"y_up"}
    assert "y up: only so heave is down" in better.columns[0].check
    stated = replace(draft, columns=tuple(replace(i, frame="enu") for i in draft.columns))
    assert corrected(stated, findings) == stated


def test_numbered_commands_go_to_the_axes_that_answer_them() -> None:
    rng = np.random.default_rng(4)
    drive = np.repeat(rng.uniform(-1.0, 1.0, (60, 3)), 10, axis=0)
    motion = np.zeros((600, 3))
    for row in range(1, 600):
        motion[row] = 0.8 * motion[row - 1] + 0.2 * drive[row - 1]
    motion += rng.normal(0.0, 0.02, motion.shape)
    draft = drafted(
        {
            "t_s": T_S,
            "u_mps": motion[:, 0],
            "v_mps": motion[:, 1],
            "w_mps": -motion[:, 2],
            "cmd0": drive[:, 2],
            "cmd1": drive[:, 0],
            "cmd2": rng.uniform(-1.0, 1.0, 600),
            "cmd3": drive[:, 1],
        }
    )
    commands = {item.column: (item.field, item.sign) for item in draft.columns[3:]}
    assert commands == {
        "cmd0": ("command_heave", -1),
        "cmd1": ("command_surge", 1),
        "cmd3": ("command_sway", 1),
    }


def test_sticks_in_pulses_are_asked_for_and_taken_once_they_are_named() -> None:
    sticks = {"rc_forward": 1500.0 + wave(400.0), "rc_turn": 1500.0 + wave(300.0)}
    columns = {"t_s": T_S, "depth_m": 3.0 + wave(1.0), **sticks}
    assert any("--commands surge=rc_forward" in remark for remark in drafted(columns).remarks)
    rows = [
        ",".join(columns),
        *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True)),
    ]
    file = RawFile("log.csv", np.frombuffer("\n".join(rows).encode(), np.uint8), None)
    draft = draft_columns(file, commands={"rc_forward": "surge", "rc_turn": "-yaw"})
    read = column_map(draft.document(), list(columns), file="log.csv").columns
    shares = {
        item.field: item.factor * columns[item.column] + item.offset
        for item in read
        if item.stream == "actuators"
    }
    np.testing.assert_allclose(shares["command_surge"], wave(1.0), atol=1e-12)
    np.testing.assert_allclose(shares["command_yaw"], -wave(0.75), atol=1e-12)


def tank_draft(
    names: Mapping[str, str], *, jump: bool = False, upward: bool = False, heave_up: bool = False
) -> ColumnDraft:
    """Return the draft of poses and commands of a run, the columns called as `names` says."""
    run = noisy(tank_run(1), 1)
    if jump:
        run["x_m"] = run["x_m"] + 20.0 * (np.arange(run["x_m"].size) >= 300)
    if heave_up:
        run["cmd1"] = -run["cmd1"]
    if upward:  # x east, y north, z up; roll, pitch, yaw of a body forward-left-up
        run["x_m"], run["y_m"] = run["y_m"], run["x_m"]
        run["yaw_rad"] = 0.5 * np.pi - run["yaw_rad"]
        run |= {name: -run[name] for name in ("z_m", "pitch_rad")}
    moved = ("u_mps", "v_mps", "w_mps", "r_radps")
    return drafted({names.get(name, name): run[name] for name in run if name not in moved})


def test_commands_called_actuators_go_to_the_axes_that_answer_them() -> None:
    names = {f"cmd{number}": f"actuator_{number + 1}" for number in range(4)}
    commands = {item.column: item.field for item in tank_draft(names).columns}
    assert commands["actuator_1"] == "command_yaw"
    assert commands["actuator_3"] == "command_surge"


def test_a_pose_that_jumps_takes_no_command_to_another_axis() -> None:
    """The speed of the jump hid that sway answers, and its command went to yaw."""
    fields = {item.column: item.field for item in tank_draft({}, jump=True).columns}
    axes = {f"cmd{number}": axis for number, axis in enumerate(("yaw", "heave", "surge", "sway"))}
    assert {name: fields.get(name) for name in axes} == {
        name: f"command_{axis}" for name, axis in axes.items()
    }


AXES_OF_COMMANDS = ("yaw", "heave", "surge", "sway")


@pytest.mark.parametrize("angles", [True, False])
@pytest.mark.parametrize(
    ("named", "stem"), [(True, "{}"), (False, "{}"), (True, "{}_yup"), (False, "{}_y_up")]
)
def test_poses_with_y_up_are_taken_as_that(angles: bool, named: bool, stem: str) -> None:
    run = noisy(tank_run(1), 1)
    yaw_pitch_roll = np.column_stack([run[name] for name in ("yaw_rad", "pitch_rad", "roll_rad")])
    to_file = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    body = Rotation.from_euler("ZYX", yaw_pitch_roll).as_matrix()
    turns = Rotation.from_matrix(to_file @ body @ to_file.T)
    columns = {"t_s": run["t_s"]}
    place = np.column_stack([run[name] for name in POSITION]) @ to_file.T
    columns |= {stem.format(name): values for name, values in zip("xyz", place.T, strict=True)}
    if angles:
        written = dict(zip(("yaw", "pitch", "roll"), turns.as_euler("YZX").T, strict=True))
    else:
        written = dict(zip(("qx", "qy", "qz", "qw"), turns.as_quat().T, strict=True))
    columns |= {stem.format(name): values for name, values in written.items()}
    for number, axis in enumerate(AXES_OF_COMMANDS):
        columns[f"cmd_{axis}" if named else f"cmd{number}"] = run[f"cmd{number}"]
    draft = drafted(columns)
    poses = [item for item in draft.columns if item.stream == "pose"]
    assert len(poses) == (6 if angles else 7)
    assert {item.frame for item in poses} == {"y_up"}
    commands = [(item.field, item.sign) for item in draft.columns if item.stream == "actuators"]
    assert commands == [(f"command_{axis}", 1) for axis in AXES_OF_COMMANDS]


def test_a_position_that_is_called_east_north_up_is_taken_as_that() -> None:
    names = {f"{axis}_m": f"{axis}_enu" for axis in "xyz"}
    draft = tank_draft(names, upward=True)
    frames = {item.column: (item.field, item.frame, item.check) for item in draft.columns}
    for column, field in zip((*names.values(), "yaw_rad"), (*POSITION, "psi_rad"), strict=True):
        assert frames[column][:2] == (field, "enu")
        assert "frame enu, z up: by the name" in frames[column][2]
    assert {item.sign for item in draft.columns if item.stream == "actuators"} == {1}
    assert tank_draft({}, upward=True).columns[0].frame == "flu"  # commands answer so
    # A command that is upward by its name is turned before it is asked which way z points.
    axes = ("yaw", "heave_up", "surge", "sway")
    names = {f"cmd{number}": f"cmd_{axis}" for number, axis in enumerate(axes)}
    drafts = [tank_draft(names, upward=upward, heave_up=True) for upward in (True, False)]
    assert [draft.columns[0].frame for draft in drafts] == ["flu", ""]


@pytest.mark.parametrize(("frame", "upward"), [("map", True), ("odom", True), ("map_ned", False)])
def test_the_frame_that_a_message_of_ros_names_is_that_of_the_pose(
    frame: str, upward: bool
) -> None:
    stem = "field.pose."
    places = [f"{stem}position.{axis}" for axis in "xyz"]
    places += [f"{stem}orientation.{axis}" for axis in "xyzw"]
    rows = "\n".join(f"{1700000000 + n},{frame},1.0,2.0,3.0,0.0,0.0,0.{n},0.9" for n in range(9))
    data = f"%time,field.header.frame_id,{','.join(places)}\n{rows}\n".encode()
    draft = draft_columns(RawFile("log.csv", np.frombuffer(data, np.uint8), None))
    assert {item.frame for item in draft.columns} == {"enu" if upward else ""}
    assert any("REP 103" in remark for remark in draft.remarks) is upward
    # A message of odometry has a velocity along the body beside its pose.
    twist = [f"field.twist.linear.{axis}" for axis in "xyz"]
    rows = "\n".join(f"{row},0.{n},0.1,0.2" for n, row in enumerate(rows.splitlines()))
    data = f"%time,field.header.frame_id,{','.join(places + twist)}\n{rows}\n".encode()
    odometry = draft_columns(RawFile("log.csv", np.frombuffer(data, np.uint8), None))
    frames = {(item.field, item.column[-1]): item.frame for item in odometry.columns}
    assert frames[("v_m_s", "y")] == ("flu" if upward else "")
    assert frames[("q_w", "w")] == ("enu" if upward else "")
    assert (("y_m", "x") in frames) is upward  # east


def test_a_position_east_north_up_beside_a_gyro_goes_by_where_it_points() -> None:
    columns = {"t_s": T_S, "gyro_x": wave(1.0), "gyro_y": wave(1.0), "gyro_z": wave(1.0)}
    columns |= {"x_enu": wave(2.0), "y_enu": wave(3.0), "z_enu": wave(1.0) + 5.0}
    fields = {
        (item.column, item.stream): (item.field, item.sign) for item in drafted(columns).columns
    }
    assert fields[("x_enu", "position")] == ("y_m", 1)
    assert fields[("y_enu", "position")] == ("x_m", 1)
    assert fields[("z_enu", "depth")] == ("depth_m", -1)


def test_findings_correct_signs_and_assumed_units_only() -> None:
    draft = drafted(
        {
            "t_s": T_S,
            "roll_deg": wave(0.1),
            "pitch_deg": wave(0.1),
            "yaw_deg": wave(1.0),
            "gyro_x": wave(1.0),
            "gyro_y": wave(1.0),
            "gyro_z": wave(1.0),
        }
    )
    findings = [
        {"id": "gyro_sign", "fields": ["gyro_z_rad_s"], "text": "Turns against.", "value": -1.0},
        {"id": "gyro_scale", "fields": [], "text": "Times 57.", "value": 56.0},
        {"id": "attitude_unit", "fields": [], "text": "In rad.", "value": 1.0},
    ]
    better = corrected(draft, findings)
    by_field = {item.field: item for item in better.columns}
    assert by_field["gyro_z_rad_s"].sign == -1
    assert "sign turned: Turns against" in by_field["gyro_z_rad_s"].check
    assert by_field["gyro_x_rad_s"].unit == "deg/s"
    assert by_field["psi_rad"].unit == "deg"  # its name says so
    assert corrected(draft, []) is draft


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"1.0,2.0,3.0\n1.1,2.0,3.0\n", "holds numbers, no names"),
        (b"depth,roll\n1.0,2.0\n1.0,2.0\n", "no column is the time"),
        (b"", "the file is empty"),
    ],
)
def test_files_without_header_or_time_are_refused(text: bytes, words: str) -> None:
    with pytest.raises(LogError, match=words):
        draft_columns(RawFile("log.csv", np.frombuffer(text, np.uint8), None))


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("tow_force_n", "N"), ("Tension [N]", "N"), ("tow force (kgf)", "kgf"),
        ("load_cell_kg", "kgf"), ("tow_force_lbf", "lbf"), ("Tension [lbs]", "lbf"),
        ("tow_force_kN", "kN"),
    ],
)  # fmt: skip
def test_the_force_of_a_line_has_its_unit(name: str, unit: str) -> None:
    """A load cell reads kg and lb of force, and kn is no knot."""
    (item,) = named_columns([name])
    assert item.place == ("tow", "tow_force_n")
    assert item.unit == unit
    assert named_columns(["speed_kn"])[0].unit == "knot"
    newtons = {"N": 1.0, "kgf": 9.80665, "lbf": 4.4482216, "kN": 1000.0}
    assert factor_and_offset(unit, "N")[0] == pytest.approx(newtons[unit])


def _log(
    times: list[str], pulses: list[str], mark: str = ",", names: str = "time_s,u_m_s,pwm_1"
) -> RawFile:
    rows = [
        mark.join((t, f"{0.01 * n % 0.3:.3f}", p))
        for n, (t, p) in enumerate(zip(times, pulses, strict=True))
    ]
    text = "\n".join([names.replace(",", mark), *rows]) + "\n"
    return RawFile("log.csv", np.frombuffer(text.encode(), np.uint8), None)


TIMES = [f"{0.1 * row:.1f}" for row in range(60)]
PULSE_TEXTS = [str(1500 + row) for row in range(60)]


@pytest.mark.parametrize(
    ("file", "words"),
    [
        (_log(TIMES[::-1], PULSE_TEXTS), "the rows run backwards. Sort them by time"),
        (_log(TIMES[:20] * 3, PULSE_TEXTS), r"falls in 2 rows, first in row 22 \('0.0'\)"),
        (_log(["7e3"] * 60, PULSE_TEXTS), "lacks the digits"),
        (_log([f"{46000 + row / 864000:.8f}" for row in range(60)], PULSE_TEXTS), "counts days"),
        (
            _log([f"0{row // 10}:0{row % 10} PM" for row in range(60)], PULSE_TEXTS),
            "nor a time of day",
        ),
        (_log(TIMES, [f'"1,{p[1:]}"' for p in PULSE_TEXTS]), "have a separator of thousands"),
        (_log(TIMES, [f"1,{p[1:]}" for p in PULSE_TEXTS], ";"), "have a separator of thousands"),
        (_log(TIMES, [f"1 {p[1:]}" for p in PULSE_TEXTS]), "have a separator of thousands"),
        (_log(TIMES, [f"{p} us" for p in PULSE_TEXTS]), "a unit in the cell; found '1500 us'"),
        (_log(TIMES, [f"'{p}'" for p in PULSE_TEXTS]), "have quotation marks"),
        (
            _log(TIMES, PULSE_TEXTS, names="time_s,u_m_s,u_m_s"),
            "2 columns of this name; found 'columns 2 and 3'",
        ),
        (_log([t.replace(".", ",") for t in TIMES], PULSE_TEXTS), "a decimal comma between commas"),
        (_log(TIMES, [p + "," for p in PULSE_TEXTS]), "separators at their end"),
    ],
)
def test_forms_of_numbers_and_rows_that_cannot_be_read_are_named(file: RawFile, words: str) -> None:
    with pytest.raises(LogError, match=words):
        draft_columns(file)


def test_unix_time_in_a_column_of_seconds_is_drafted_in_its_own_unit() -> None:
    draft = draft_columns(
        _log([str(1772406000000000 + 100000 * row) for row in range(60)], PULSE_TEXTS)
    )
    assert draft.time == {"column": "time_s", "unit": "us", "epoch": "unix"}
    assert "its name says s" in draft.text()


def test_points_between_thousands_are_no_decimal_points() -> None:
    times = [t.replace(".", ",") for t in TIMES]
    text = "time_s;u_m_s;pwm_1\n" + "".join(
        f"{t};0,{row % 9}1;1.{p[1:]}\n"
        for row, (t, p) in enumerate(zip(times, PULSE_TEXTS, strict=True))
    )
    with pytest.raises(LogError, match=r"separator of thousands; found '1\.500'"):
        draft_columns(RawFile("log.csv", np.frombuffer(text.encode(), np.uint8), None))
