"""A frame of the autopilot against the vehicle file, the outputs and the motion of a log."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from auvid.data_schemas.errors import CampaignError, PipelineError
from auvid.hydro.dynamics.actuators.commands import ARDUSUB_FRAMES
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.stages.ingest.health.finding import Finding
from tests.support.motions import vehicle_document
from tests.support.sound_log import Log, sound
from tests.unit.stages.ingest.test_check_findings import RIGHT_ORDER, drive


@pytest.fixture(scope="module")
def flown() -> Log:
    log = sound()
    drive(log, RIGHT_ORDER)
    assert log.vehicle is not None
    assert log.vehicle.thrusters is not None
    turns = log.vehicle.thrusters.direction
    log.info["parameters"] = {"FRAME_CONFIG": 2.0} | {
        f"MOT_{number}_DIRECTION": float(turn) for number, turn in enumerate(turns, start=1)
    }
    return log


@pytest.fixture
def log(flown: Log) -> Log:
    """A log of eight thrusters with its frame, without a vehicle file."""
    own = copy.deepcopy(flown)
    own.vehicle = None
    return own


def named(log: Log, name: str) -> list[Finding]:
    return [item for item in log.health()["findings"] if item["id"] == name]


def described(vehicle: str = "bluerov2_heavy", **thrusters: object) -> object:
    document = copy.deepcopy(vehicle_document(vehicle))
    for key, value in thrusters.items():
        document["actuators"]["thrusters"][key]["value"] = value
    return vehicle_from_document(document)


def test_a_sound_log_agrees_with_its_frame(log: Log) -> None:
    assert not named(log, "response_order")
    assert not named(log, "frame_unlike")


@pytest.mark.parametrize("motor", [1, 4])
def test_a_motor_of_a_frame_that_acts_backward_is_named(log: Log, motor: int) -> None:
    turn = log.info["parameters"][f"MOT_{motor}_DIRECTION"]
    log.info["parameters"][f"MOT_{motor}_DIRECTION"] = -turn
    (item,) = named(log, "response_order")
    assert f"Output {motor} seems to act backward" in item["text"]
    assert "frame vectored_6dof of FRAME_CONFIG of the log" in item["text"]
    assert f"set MOT_{motor}_DIRECTION to {turn:.0f} (the log has {-turn:.0f})" in item["remedy"]
    assert f"turn the signs of row {motor}" in item["remedy"]


def test_exchanged_outputs_of_a_frame_are_named(log: Log) -> None:
    parameters = log.info["parameters"]
    turns = [parameters["MOT_2_DIRECTION"], parameters["MOT_1_DIRECTION"]]
    for motor, output in enumerate((2, 1, 3, 4, 5, 6, 7, 8), start=1):
        parameters[f"SERVO{output}_FUNCTION"] = 32.0 + motor
    parameters["MOT_1_DIRECTION"], parameters["MOT_2_DIRECTION"] = turns
    (item,) = named(log, "response_order")
    assert "Outputs 2 and 1 look exchanged" in item["text"]
    assert "exchange SERVO2_FUNCTION and SERVO1_FUNCTION" in item["remedy"]


def test_motors_whose_directions_nothing_states_are_named_with_them(log: Log) -> None:
    turns = [log.info["parameters"].pop(f"MOT_{number}_DIRECTION") for number in range(1, 9)]
    backward = [str(number) for number, turn in enumerate(turns[:4], start=1) if turn < 0.0]
    (item,) = named(log, "response_order")
    assert "Nothing states how the motors turn" in item["text"]
    assert f"{' and '.join(backward)} seem" in item["text"]
    assert "does not tell those of outputs 5, 6, 7 and 8" in item["remedy"]
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    turned = [int(turn) for turn in turns]
    commands = {"frame": "vectored_6dof", "direction": turned}
    document["actuators"] = {"commands": commands}
    log.vehicle = vehicle_from_document(document)
    assert not named(log, "response_order")
    commands["direction"] = turned[:6]
    with pytest.raises(CampaignError, match="8 of 1 and -1 for frame vectored_6dof"):
        vehicle_from_document(document)


def test_another_frame_of_the_vehicle_file_is_named(log: Log) -> None:
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    document["actuators"] = {"commands": {"frame": "vectored"}}
    log.vehicle = vehicle_from_document(document)
    (item,) = named(log, "frame_unlike")
    assert "frame vectored, not vectored_6dof of the log (FRAME_CONFIG 2)" in item["text"]
    log.vehicle = described("bluerov2")  # type: ignore[assignment]
    (item,) = named(log, "frame_unlike")
    assert (
        "has 6 thrusters, and frame vectored_6dof of the log (FRAME_CONFIG 2) has 8"
        in (item["text"])
    )


def test_bundled_vehicles_push_as_their_frames(log: Log) -> None:
    log.vehicle = described()  # type: ignore[assignment]
    assert not named(log, "frame_unlike")


def test_an_axis_of_a_thruster_turned_round_in_the_vehicle_file_is_named(log: Log) -> None:
    axis = np.array(vehicle_document("bluerov2_heavy")["actuators"]["thrusters"]["axis"]["value"])
    axis[2] *= -1.0
    log.vehicle = described(axis=axis.tolist())  # type: ignore[assignment]
    (item,) = named(log, "frame_unlike")
    assert "in surge than the motors of frame vectored_6dof" in item["text"]
    assert "push thrusters of the vehicle file: 3 (output 3)" in item["text"]


def test_outputs_that_move_and_a_frame_lacks_are_named(log: Log) -> None:
    """Eight outputs of a vehicle that moves level, by a frame of six motors, and round."""
    del log.info["parameters"]["FRAME_CONFIG"]
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    document["actuators"] = {"commands": {"frame": "vectored"}}
    log.vehicle = vehicle_from_document(document)
    table = log.streams["actuators"]
    heave = table["pwm_5_us"] - 1500.0
    for number, factor in enumerate(np.array(ARDUSUB_FRAMES["vectored_6dof"])[4:, 2], start=5):
        turn = log.info["parameters"][f"MOT_{number}_DIRECTION"]
        table[f"pwm_{number}_us"] = 1500.0 + turn * factor * heave
    (item,) = named(log, "frame_unlike")
    assert "Outputs 7 and 8 move as motors do" in item["text"]
    table["pwm_7_us"] = np.full(heave.size, 1500.0)
    table["pwm_8_us"] = np.full(heave.size, 1500.0)
    assert not named(log, "frame_unlike")
    log.info["parameters"]["FRAME_CONFIG"] = 2.0
    log.vehicle = None
    (item,) = named(log, "frame_unlike")
    assert "at outputs 7 and 8 stand still all log long" in item["text"]


@pytest.mark.parametrize(
    ("row", "words"),
    [([0.0] * 6, "thruster 2 pushes nothing"), ([0, 100, 0, 0, 0, 20], "gives 100 N")],
)
def test_a_row_of_a_matrix_that_no_thruster_has_is_refused(row: list[float], words: str) -> None:
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    entry = document["actuators"]["thrusters"]
    rows = np.array(ARDUSUB_FRAMES["vectored_6dof"], dtype=float)
    del entry["position"], entry["axis"]
    entry["effect"] = {"value": rows.tolist(), "unit": "1", "source": "factors"}
    vehicle_from_document(document)
    rows[1] = row
    entry["effect"]["value"] = rows.tolist()
    with pytest.raises(PipelineError, match=words):
        vehicle_from_document(document)


def test_yaw_that_is_not_commanded_tells_nothing(log: Log) -> None:
    """Its motor of sway turns a hull whose stick for yaw rests: no outputs are exchanged."""
    parameters, table = log.info["parameters"], log.streams["actuators"]
    parameters["FRAME_CONFIG"] = 6.0
    t_s = log.t_s("actuators")
    push = np.repeat(np.random.default_rng(3).uniform(-1.0, 1.0, 60), 10)[: t_s.size]
    turn = np.concatenate([[0.0], np.cumsum(0.1 * push)[:-1]])
    for number in range(1, 9):
        table[f"pwm_{number}_us"] = 1500.0 + 0.0 * push
    for number in (1, 2):
        turns = parameters[f"MOT_{number}_DIRECTION"]
        table[f"pwm_{number}_us"] = 1500.0 + turns * 200.0 * np.roll(push, 170)
    table["pwm_5_us"] = 1500.0 + parameters["MOT_5_DIRECTION"] * 200.0 * push
    log.streams["imu"]["gyro_z_rad_s"] = 0.2 * np.interp(log.t_s("imu"), t_s, turn)
    del log.streams["velocity"]
    assert not named(log, "response_order")


def test_a_light_that_goes_on_as_the_dive_begins_is_no_motor(log: Log) -> None:
    """From then on thrusters hold the vehicle down, about which they hardly move."""
    table = log.streams["actuators"]
    dives = np.arange(table["time_us"].size) > 200
    for number in range(1, 9):
        holds = 60.0 * log.info["parameters"][f"MOT_{number}_DIRECTION"] * (number > 4)
        small = 0.15 * (table[f"pwm_{number}_us"] - 1500.0)
        table[f"pwm_{number}_us"] = 1500.0 + np.where(dives, holds + small, 0.0)
    table["pwm_9_us"] = np.where(dives, 1900.0, 1100.0)
    assert not named(log, "frame_unlike")


def test_two_motors_at_one_output_are_named(log: Log) -> None:
    """Functions that are logged in part, against the usual outputs of the other motors."""
    parameters = log.info["parameters"]
    parameters["SERVO1_FUNCTION"] = 34.0
    (item,) = named(log, "frame_unlike")
    assert "No output drives motors 1 of frame vectored_6dof" in item["text"]
    parameters["SERVO2_FUNCTION"] = 33.0
    assert not named(log, "frame_unlike")
    assert named(log, "response_order"), "the log was flown with motors 1 and 2 in place"
    del parameters["SERVO1_FUNCTION"], parameters["SERVO2_FUNCTION"]
    parameters["SERVO3_FUNCTION"] = 35.0
    assert not {"frame_unlike", "response_order"} & set(log.ids())
