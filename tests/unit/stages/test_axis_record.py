"""Stage axis_record: motion and force on one clock, windows, and what is left out."""

from __future__ import annotations

import copy
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.stages import axis_record
from auvid.stages.axis_tables import axis_record_of
from auvid.stages.fit_axes.fitting import fit_all
from auvid.stages.fit_axes.flight import FitOptions, LegData
from auvid.stages.leg_record.motion import DEPTH, FIXES, smoothed_s
from auvid.stages.leg_record.record import leg_record
from auvid.stages.leg_record.refusal import refusal
from auvid.stages.leg_streams import Streams
from tests.support.axis_dive import (
    FIRST_US,
    GYRO_BIAS,
    THRUSTERS,
    VEHICLE,
    Dive,
    vehicle_document,
)

STREAMS = ("imu", "attitude", "depth", "velocity", "actuators", "battery", "mode")


@pytest.fixture(scope="module")
def dive() -> Dive:
    return Dive()


def outputs(dive: Dive, vehicle=VEHICLE, **params):
    leg = LegEntry.model_validate({"id": "dive", "log": "dive"})
    tables = dive.tables()
    inputs = axis_record.Inputs(
        leg, dive.info(), vehicle, **{name: tables.get(name) for name in STREAMS}
    )
    return axis_record.run(inputs, axis_record.Params(**params))


def without_curve(**commands):
    document = copy.deepcopy(vehicle_document())
    del document["actuators"]["thrusters"]
    document["actuators"]["commands"] = commands
    return vehicle_from_document(document)


def test_yaw_and_heave_are_measured_in_newtons(dive):
    result = outputs(dive)
    record = axis_record_of(result.axis_record, result.axis_windows)
    assert record.measured_by == {"K": "gyro", "M": "gyro", "N": "gyro", "Z": "depth"}
    assert set(record.windows) == {"Z", "N"}
    assert not record.normalised
    assert np.isnan(record.rate["w"]).all()
    true = np.interp(record.t_s, dive.t, dive.r)
    # a gyro at 25 Hz with 0.002 rad/s of noise, its bias of 0.02 taken off
    assert np.nanmean(record.rate["r"] - true) == pytest.approx(0.0, abs=1e-3)
    assert np.nanstd(record.rate["r"] - true) < 0.02
    full = np.abs(record.force["Z"]).max()
    curve = THRUSTERS.curve
    assert full == pytest.approx(2.0 * np.interp(1610.0, curve.pwm_us, curve.force_N), rel=0.02)


def test_the_record_survives_its_table(dive):
    result = outputs(dive)
    record = axis_record_of(result.axis_record, result.axis_windows)
    stamps = result.axis_record["t_us"].to_numpy()
    assert np.abs(record.t_s - (stamps - FIRST_US) / 1e6).max() < 1e-6
    assert record.thrusters is not None
    summed = record.thrusters.force @ record.thrusters.effect.T
    assert record.thrusters.outputs == THRUSTERS.outputs
    for at, axis in enumerate("XYZKMN"):
        assert summed[:, at] == pytest.approx(record.force[axis], abs=1e-9)
    for axis, length in result.axis_windows.windows_s.items():
        total = sum(last - first for first, last in record.windows[axis])
        assert total / result.axis_windows.rate_hz == pytest.approx(length)
    reasons = {item.axis: item.reason for item in record.left_out if item.axis in "XYKM"}
    assert reasons == {
        "X": "nothing measures it",
        "Y": "nothing measures it",
        "K": "not commanded",
        "M": "not commanded",
    }


def test_a_snag_is_named_and_in_no_window():
    result = outputs(Dive(hold=(60.0, 75.0)))
    words = [item for item in result.axis_windows.warnings if "Force without" in item]
    assert words
    assert all("heave" in item and "in other axes balances" in item for item in words)
    spans = [item for item in result.axis_windows.left_out if item.reason == "force without motion"]
    assert min(item.start_s for item in spans) == pytest.approx(61.0, abs=2.0)
    assert max(item.end_s for item in spans) == pytest.approx(75.0, abs=2.0)
    around = [
        item for item in result.axis_windows.left_out if item.reason.startswith("within 10 s")
    ]
    assert min(item.start_s for item in around) == pytest.approx(51.0, abs=2.0)
    assert max(item.end_s for item in around) == pytest.approx(85.0, abs=2.0)
    assert not [w for w in outputs(Dive()).axis_windows.warnings if "Force without" in w]


def test_a_hull_that_tumbles_tells_no_heave_by_its_depth():
    """Pitched by 60 degrees depth is mostly its speed ahead; with a velocity log heave stays."""
    tilted = Dive()
    attitude = tilted.streams["attitude"]
    seconds = (attitude["time_us"] - FIRST_US) / 1e6
    attitude["theta_rad"] = np.where((seconds > 30.0) & (seconds < 50.0), 1.05, 0.0)
    record = outputs(tilted).axis_windows
    (span,) = [item for item in record.left_out if "tilted by more than 45 degrees" in item.reason]
    assert (span.axis, span.start_s, span.end_s) == (
        "Z", pytest.approx(30.0, abs=0.2), pytest.approx(50.0, abs=0.2)
    )  # fmt: skip
    zero = np.zeros(tilted.t.size)
    tilted.log("velocity", 10.0, {"u_m_s": zero, "v_m_s": zero, "w_m_s": tilted.w})
    assert not [item for item in outputs(tilted).axis_windows.left_out if "tilted" in item.reason]


def test_the_surface_is_left_out_further_down_in_heave():
    result = outputs(Dive(start_m=0.05))
    ends = {
        item.axis: item.end_s
        for item in result.axis_windows.left_out
        if item.reason == "at the surface" and item.start_s < 1.0
    }
    assert 0.5 < ends["N"] < ends["Z"] < 10.0


@pytest.mark.parametrize("source", ["log", "vehicle"])
def test_pulses_become_full_commands_by_a_frame(dive, source):
    logged = copy.copy(dive)
    logged.parameters = {f"MOT_{n}_DIRECTION": THRUSTERS.direction[n - 1] for n in range(1, 7)}
    if source == "log":
        logged.parameters["FRAME_CONFIG"] = 1.0
    vehicle = without_curve(**({} if source == "log" else {"frame": "vectored"}))
    result = outputs(logged, vehicle)
    record = axis_record_of(result.axis_record, result.axis_windows)
    assert record.normalised
    assert np.abs(record.force["N"]).max() == pytest.approx(70.0 / 400.0, rel=0.01)
    assert np.abs(record.force["Z"]).max() == pytest.approx(110.0 / 400.0, rel=0.01)
    # No pull ahead tells a moment by the factors of a frame: they have no length.
    assert result.axis_windows.full_thrust == {}
    assert set(record.windows) == {"Z", "N"}


def test_a_layout_with_lengths_ties_the_full_commands(dive):
    document = copy.deepcopy(vehicle_document())
    del document["actuators"]["thrusters"]["thrust_curve"]
    ties = outputs(dive, vehicle_from_document(document)).axis_windows.full_thrust
    lengths = np.abs(THRUSTERS.allocation).sum(axis=1)
    assert ties["N"] / ties["X"] == pytest.approx(lengths[5] / lengths[0])


def test_an_unknown_frame_is_refused_with_those_there_are(dive):
    logged = copy.copy(dive)
    logged.parameters = {"FRAME_CONFIG": 7.0}
    with pytest.raises(DataError, match=r"frame unknown.*7.*vectored_6dof_90deg") as refusal:
        outputs(logged, without_curve())
    assert "actuators.commands.frame" in str(refusal.value)


def test_outputs_that_the_frame_has_and_the_log_lacks_are_named(dive):
    logged = copy.copy(dive)
    logged.parameters = {"FRAME_CONFIG": 2.0}  # eight motors, and the log has six
    with pytest.raises(DataError, match=r"frame vectored_6dof of FRAME_CONFIG.*pwm_7_us") as fault:
        outputs(logged, without_curve())
    assert "map their columns to pwm_n_us" in str(fault.value)
    assert "fewer thrusters has another frame" in str(fault.value)


def test_motors_of_a_frame_are_at_the_outputs_of_the_log(dive):
    """Outputs 9 to 14 in the opposite order, by SERVOn_FUNCTION."""
    own, moved = copy.copy(dive), copy.copy(dive)
    own.parameters = {f"MOT_{n}_DIRECTION": THRUSTERS.direction[n - 1] for n in range(1, 7)}
    own.parameters["FRAME_CONFIG"] = 1.0
    moved.parameters = own.parameters | {f"SERVO{15 - n}_FUNCTION": 32.0 + n for n in range(1, 7)}
    moved.streams = dict(dive.streams)
    table = dive.streams["actuators"]
    moved.streams["actuators"] = {"time_us": table["time_us"]} | {
        f"pwm_{15 - n}_us": table[f"pwm_{n}_us"] for n in range(1, 7)
    }
    forces = [
        axis_record_of(item.axis_record, item.axis_windows).force
        for item in (outputs(own, without_curve()), outputs(moved, without_curve()))
    ]
    for axis in "ZN":
        assert np.nanstd(forces[0][axis]) > 0.05
        assert forces[1][axis] == pytest.approx(forces[0][axis], nan_ok=True)


def test_slow_outputs_are_interpolated_not_held(dive):
    slow = copy.copy(dive)
    slow.streams = dict(dive.streams)
    slow.log("actuators", 2.0, {f"pwm_{n + 1}_us": dive.pulses[:, n] for n in range(6)})
    fast, slowly = (
        axis_record_of(item.axis_record, item.axis_windows)
        for item in (outputs(dive), outputs(slow))
    )
    late = np.interp(slowly.t_s, fast.t_s, fast.force["N"])
    good = np.isfinite(slowly.force["N"])
    lag = (
        np.argmax(
            [
                np.dot(late[good][20:-20], np.roll(slowly.force["N"][good], k)[20:-20])
                for k in range(-8, 9)
            ]
        )
        - 8
    )
    assert abs(lag) <= 1  # 50 ms; held outputs come 250 ms late


def test_neutral_commands_of_a_vehicle_that_turns_may_be_those_of_nobody(dive):
    idle = copy.copy(dive)
    idle.streams = dict(dive.streams)
    idle.log("actuators", 10.0, {f"pwm_{n}_us": np.full(dive.t.size, 1500.0) for n in range(1, 7)})
    streams = Streams(idle.tables(), FIRST_US, (0.0, 1e6), VEHICLE)
    words = refusal(leg_record(streams, idle.info(), "dive"), streams, idle.info())
    assert "moved by hand, or by a controller whose outputs are not these" in words


def test_two_clocks_are_found(dive):
    shifted = copy.copy(dive)
    shifted.streams = dict(dive.streams)
    commands = dict(dive.streams["actuators"])
    commands["time_us"] = commands["time_us"] + 900_000
    shifted.streams["actuators"] = commands
    (words,) = [w for w in outputs(shifted).axis_windows.warnings if "clocks" in w]
    assert "before the commands" in words
    mended = outputs(shifted, lag_s={"actuators": 0.9}).axis_windows.warnings
    assert not [w for w in mended if "clocks" in w]
    assert not [w for w in outputs(dive).axis_windows.warnings if "clocks" in w]


def test_motion_one_way_is_named(dive):
    one_way = copy.copy(dive)
    one_way.pulses = np.where(
        np.arange(6) < 4,
        1500.0
        + np.abs(dive.pulses - 1500.0) * np.sign(THRUSTERS.direction * THRUSTERS.allocation[5]),
        dive.pulses,
    )
    one_way.streams = {}
    one_way.fly()
    # Other axes turn it back a little while nothing drives it: that tells no drag.
    imu = one_way.streams["imu"]
    slow = np.abs(imu["gyro_z_rad_s"] - GYRO_BIAS) < 0.35 * one_way.r.max()
    assert slow.mean() > 0.1
    imu["gyro_z_rad_s"] = np.where(slow, GYRO_BIAS - 0.08 * one_way.r.max(), imu["gyro_z_rad_s"])
    assert 0.08 * one_way.r.max() > 0.04
    assert any(w.startswith("Yaw moves one way") for w in outputs(one_way).axis_windows.warnings)


def test_commands_alone_are_taken_in_the_axes_of_the_vehicle(dive):
    commands_only = copy.copy(dive)
    commands_only.streams = dict(dive.streams)
    yaw = (dive.pulses[:, 0] - 1500.0) * THRUSTERS.direction[0] / 400.0
    commands_only.log("actuators", 10.0, {"command_yaw": yaw, "command_heave": np.zeros(yaw.size)})
    record = outputs(commands_only, without_curve(axes=["yaw"])).axis_windows
    assert record.normalised
    assert set(record.windows_s) == {"N"}
    with pytest.raises(DataError, match="no logged command acts"):
        outputs(commands_only, without_curve(axes=["surge"]))


def test_an_empty_command_leaves_the_others(dive):
    logged = copy.copy(dive)
    logged.streams = dict(dive.streams)
    yaw = (dive.pulses[:, 0] - 1500.0) * THRUSTERS.direction[0] / 400.0
    nothing = np.full(yaw.size, np.nan)
    logged.log("actuators", 10.0, {"command_yaw": yaw, "command_roll": nothing})
    record = outputs(logged, without_curve()).axis_windows
    assert set(record.windows_s) == {"N"}
    assert any("command_roll is empty" in item for item in record.notes)
    logged.log("actuators", 10.0, {"command_yaw": nothing})
    with pytest.raises(DataError, match="commands are empty"):
        outputs(logged, without_curve())


@pytest.mark.parametrize("vehicle", [VEHICLE, without_curve(frame="vectored")])
def test_outputs_that_never_leave_neutral_drive_nothing(dive, vehicle):
    """An autopilot that holds still moves its outputs inside the dead band of the ESCs."""
    still = copy.copy(dive)
    still.pulses = 1500.0 + np.clip(dive.pulses - 1500.0, -15.0, 15.0)
    still.streams = {}
    still.fly()
    result = outputs(still, vehicle)
    record = axis_record_of(result.axis_record, result.axis_windows)
    assert record.windows == {}
    reasons = {item.axis: item.reason for item in record.left_out}
    assert reasons["Z"] == reasons["N"] == "not commanded"
    fitted = fit_all({"dive": LegData(record, result.axis_windows)}, vehicle, FitOptions())
    assert fitted.fitted == ()
    lacking = {item.axis: item.verdict for item in fitted.lacking}
    assert lacking["X"] == lacking["Y"] == "not observable"
    assert lacking["Z"] == lacking["N"] == "not commanded"


@pytest.mark.parametrize(
    ("below_s", "words"), [(9.0, "windows of 9 s below 0.25 m"), (0.0, "0.11 m at its deepest")]
)
def test_a_dive_mostly_at_the_surface_is_refused_by_how_long_it_was_below(below_s, words):
    """The depth that it reached for some seconds is no reason against it."""
    shallow = Dive(60.0)
    depth = shallow.streams["depth"]
    seconds = (depth["time_us"] - FIRST_US) / 1e6
    depth["depth_m"] = np.where(seconds < below_s, 0.9, 0.1) + 0.01 * np.sin(seconds)
    streams = Streams(shallow.tables(), FIRST_US, (0.0, 60.0), VEHICLE)
    result = leg_record(streams, shallow.info(), "dive")
    assert words in refusal(result, streams, shallow.info())


@pytest.mark.parametrize(("step_s", "is_seldom"), [(0.1, False), (2.0, True)])
def test_lines_between_seldom_depths_smooth_heave_and_no_other_axis(
    step_s: float, is_seldom: bool
) -> None:
    """They are a mean over a triangle, whose moments are summed here."""
    streams = {
        "depth": SimpleNamespace(rate_hz=1.0 / step_s, smoothed_s=None),
        "velocity": SimpleNamespace(rate_hz=1.0, smoothed_s=1.2),
    }
    info = cast(LogInfo, SimpleNamespace(streams=streams))
    times = smoothed_s({"X": FIXES, "Z": DEPTH, "N": "gyro"}, info)
    assert times.pop("X") == pytest.approx(1.2)
    x = np.linspace(-step_s, step_s, 2001)
    width = float(np.sqrt(np.average(x**2, weights=step_s - np.abs(x))))
    assert times == ({"Z": pytest.approx(width, rel=1e-3)} if is_seldom else {})
