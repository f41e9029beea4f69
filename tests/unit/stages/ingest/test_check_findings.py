"""Every finding of the health page appears where its cause is put into a sound log, and
the sound log has none.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auvid.data_schemas.checks import SEVERITIES, checks
from auvid.data_schemas.documents import check_document
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.commands import FullCommands
from auvid.hydro.dynamics.actuators.thrusters import thruster_forces
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.identification.checks.attitude.rate_agreement import rate_agreement
from auvid.hydro.identification.checks.outputs.joined_outputs import OtherOrder
from auvid.hydro.identification.checks.relation import Relation
from auvid.hydro.identification.checks.response import Response
from auvid.hydro.identification.checks.robust_gains import AxisGains
from auvid.hydro.identification.signals.pose.frames import (
    euler_of_quaternion,
    quaternion_of_euler,
)
from auvid.stages.ingest.health.actuation import (
    force_clocks,
    plausible_forces,
    push_answers,
    unrelated_commands,
)
from auvid.stages.ingest.health.actuation.output_order import _order_words
from auvid.stages.ingest.health.actuation.plausible_forces import MIRRORED, OWN
from auvid.stages.ingest.health.actuation.push_answers import pushes_apart
from auvid.stages.ingest.health.agreement.gyro import _quiet_axes
from auvid.stages.ingest.health.agreement.velocity import output_clocks
from auvid.stages.ingest.health.agreement.velocity.velocity_clock import axis_out_of_time
from auvid.stages.ingest.health.finding import CheckedLog
from auvid.stages.ingest.health.usability import legs
from auvid.stages.ingest.health.vehicle import missing_findings
from auvid.stages.ingest.streams.mapping import OtherSource
from tests.support.motions import vehicle_document
from tests.support.sound_log import (
    DELAY_S,
    FIRST_US,
    LENGTH_S,
    Log,
    acceleration,
    clock,
    depth,
    euler,
    micro,
    sound,
    velocity,
)

SPEED_COLUMNS = ("u_m_s", "v_m_s", "w_m_s")
IMU_COLUMNS = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
RATE_COLUMNS = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
ACCEL = ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2")
Spoil = Callable[[Log], None]
SPOIL: dict[str, Spoil] = {}
CLOCKS = ("velocity_lag", "command_delay", "command_late", "commands_early", "clock_drift")


def for_a_release(cases: Iterable[Any], *, without: Collection[Any]) -> list[Any]:
    """Return cases as parameters: only a release tries those that are not in `without`.

    A vehicle is alike on both sides, and one of a pair goes for the other.
    """
    marks = pytest.mark.release
    return [item if item in without else pytest.param(item, marks=marks) for item in cases]


def spoils(name: str) -> Callable[[Spoil], Spoil]:
    def register(change: Spoil) -> Spoil:
        SPOIL[name] = change
        return change

    return register


def scaled(stream: str, names: tuple[str, ...], factor: float) -> Spoil:
    def change(log: Log) -> None:
        for name in names:
            log.streams[stream][name] = log.streams[stream][name] * factor

    return change


def without(stream: str) -> Spoil:
    def change(log: Log) -> None:
        del log.streams[stream]

    return change


def saying(**info: Any) -> Spoil:
    def change(log: Log) -> None:
        log.info |= info

    return change


def rejecting(stream: str, count: int, reason: str = "repeated time stamp") -> Spoil:
    def change(log: Log) -> None:
        log.dropped.append(
            {
                "stream": stream,
                "reason": reason,
                "count": count,
                "first": 0,
                "last": 9,
            }
        )

    return change


def slower(stream: str, stride: int) -> Spoil:
    def change(log: Log) -> None:
        log.keep(stream, np.arange(log.t_s(stream).size) % stride == 0)

    return change


def at(stream: str, start_s: float, end_s: float, **values: float) -> Spoil:
    """These values between two times."""

    def change(log: Log) -> None:
        rows = (log.t_s(stream) >= start_s) & (log.t_s(stream) < end_s)
        for name, value in values.items():
            log.streams[stream][name] = np.where(rows, value, log.streams[stream][name])

    return change


def other(
    stream: str, source: str, *, refused: str | None = None, **change: Callable[[Any], Any]
) -> Spoil:
    """Another source of a stream that the log has: its columns changed."""

    def add(log: Log) -> None:
        columns = {
            name: change.get(name, lambda values: values)(values)
            for name, values in log.streams[stream].items()
        }
        log.others.append(OtherSource(stream, source, refused, None if refused else columns))

    return add


def of_file(status: str, reason: str, lost: int) -> Spoil:
    def change(log: Log) -> None:
        log.info["status"] = status
        skipped = [{"reason": reason, "bytes": lost, "count": 1}]
        log.info["files"][0] |= {"status": status, "skipped": skipped, "seconds_lost": 0.4}

    return change


SPOIL |= {
    "file_damaged": of_file("damaged", "damaged bytes", 70),
    "file_truncated": of_file("truncated", "record cut off by the end of the file", 7),
    "shared_number": saying(notes=["a and a.1 are subscribed with one number, 3: one is damaged."]),
    "clock_leap": saying(
        notes=["The clock goes back by 5 s near byte 7. It leaps 3 times in all."]
    ),
    "stray_stamps": saying(
        notes=["2 time stamp(s) of mission stray ahead of the clock, up to 1194 s at byte 6."]
    ),
    "rejected_samples": rejecting("imu", 40),
    "most_rejected": rejecting("depth", 2000),
    "low_rate": slower("attitude", 3),
    "low_actuator_rate": slower("actuators", 5),
    "constant_signal": at("velocity", 0.0, 99.0, v_m_s=0.0),
    "stuck_sensor": at("velocity", 20.0, 25.0, u_m_s=0.1, v_m_s=0.0, w_m_s=0.0),
    "outputs_saturated": at("actuators", 20.0, 22.0, pwm_3_us=1900.0),
    "velocity_scale": scaled("depth", ("depth_m",), 100.0),
    "gyro_sign": scaled("imu", ("gyro_y_rad_s",), -1.0),
    "gyro_scale": scaled("imu", IMU_COLUMNS, 57.3),
    "accelerometer_unit": scaled("imu", ACCEL, 1.0 / 9.81),
    "accelerometer_convention": saying(accelerometer="inertial"),
    "accelerometer_direction": scaled("imu", ACCEL, -1.0),
    "attitude_disagrees": other("attitude", "AHR2", psi_rad=lambda psi: psi + np.radians(35.0)),
    "depth_above_water": scaled("depth", ("depth_m",), -1.0),
    "depth_disagrees": other("depth", "XKF1", depth_m=lambda depth: 1.5 * depth),
    "velocity_disagrees": other("velocity", "XKF1", v_m_s=lambda sway: -sway),
    "depth_unit": other("depth", "CTUN", depth_m=lambda depth: 0.01 * depth),
    "depth_estimated": saying(
        notes=["depth: depth is the estimate of the navigation filter, not a pressure"]
    ),
    "unaided_velocity": other(
        "velocity", "XKF1", refused="the navigation filter had no velocity or position sensor"
    ),
    "estimated_velocity": saying(
        notes=["velocity: velocity is the estimate of the navigation filter, not a velocity sensor"]
    ),
    "no_velocity": without("velocity"),
    "no_attitude": without("attitude"),
    "no_depth": without("depth"),
    "no_imu": without("imu"),
    "no_actuators": without("actuators"),
    "no_battery": without("battery"),
    "battery_sag": at("battery", 30.0, 35.0, voltage_v=13.0),
    "battery_current": scaled("battery", ("current_a",), -1.0),
    "little_actuation": (
        lambda log: (
            [
                at("actuators", 5.0, 99.0, **{f"pwm_{number}_us": 1500.0})(log)
                for number in range(1, 9)
            ]
            and None
        )
    ),
    "not_excited": scaled("velocity", ("v_m_s",), 0.1),
    "simulated": saying(counts={"SIM2": 400}),
    "not_underwater": saying(vehicle="ArduCopter V4.5.0"),
    "firmware_unknown": saying(vehicle=None),
    "parameters_missing": saying(parameters={}),
    "several_vehicles": saying(
        notes=[
            "several vehicles: system 1 (90 messages) and system 2 (80 messages); system 1 is read"
        ]
    ),
    "recut_messages": saying(
        notes=[
            "system 1 component 194: read although a router cut trailing zeros after the checksum"
            " was made: 73 DISTANCE_SENSOR"
        ]
    ),
    "wrong_checksum": saying(notes=["system 1 component 1: wrong checksum, not read: 3 ATTITUDE"]),
}


@spoils("housing_barometer")
def _housing(log: Log) -> None:
    log.info["streams"]["depth"] = {"source": "BARO[1]"}
    other("depth", "BARO[0]", depth_m=lambda depth: 80.0 + 3.0 * np.linspace(0.0, 1.0, depth.size))(
        log
    )


@spoils("gap")
def _gap(log: Log) -> None:
    for stream in ("imu", "attitude", "depth", "velocity", "actuators", "battery"):
        log.keep(stream, (log.t_s(stream) < 20.0) | (log.t_s(stream) > 24.0))


@spoils("irregular_rate")
def _irregular(log: Log) -> None:
    random = np.random.default_rng(1)
    log.keep("velocity", random.uniform(size=log.t_s("velocity").size) < 0.6)


@spoils("held_samples")
def _repeated(log: Log) -> None:
    rows = np.arange(log.t_s("velocity").size) // 4 * 4
    for name in ("u_m_s", "v_m_s", "w_m_s"):
        log.streams["velocity"][name] = log.streams["velocity"][name][rows]


@spoils("gyro_saturated")
def _clipped(log: Log) -> None:
    rate = 20.0 * log.streams["imu"]["gyro_z_rad_s"]
    log.streams["imu"]["gyro_z_rad_s"] = np.clip(rate, -4.0, 4.0)


@spoils("gyro_axes")
def _exchanged(log: Log) -> None:
    imu = log.streams["imu"]
    imu["gyro_x_rad_s"], imu["gyro_y_rad_s"] = imu["gyro_y_rad_s"], imu["gyro_x_rad_s"]


@spoils("attitude_order")
def _roll_before_pitch(log: Log) -> None:
    """Angles of turns about z, x and y."""
    attitude = log.streams["attitude"]
    ordered = [attitude[name] for name in ("psi_rad", "theta_rad", "phi_rad")]
    turned = Rotation.from_euler("ZYX", np.column_stack(ordered)).as_euler("ZXY")
    for name, angle in zip(("psi_rad", "phi_rad", "theta_rad"), turned.T, strict=True):
        attitude[name] = angle


@spoils("values_coarse")
def _half_metres(log: Log) -> None:
    depth_m = log.streams["depth"]["depth_m"]
    log.streams["depth"]["depth_m"] = np.round(depth_m / 0.1) * 0.1


@spoils("columns_exchanged")
def _gravity_for_yaw(log: Log) -> None:
    imu = log.streams["imu"]
    imu["gyro_z_rad_s"], imu["accel_z_m_s2"] = imu["accel_z_m_s2"], imu["gyro_z_rad_s"]


@spoils("heading_deviation")
def _compass_beside_iron(log: Log) -> None:
    """A vehicle that turns round and round, whose compass swings by 15 degrees."""
    turning, attitude, imu = 0.3, log.streams["attitude"], log.streams["imu"]
    down = rotation_body_to_ned(euler(log.t_s("imu")))[:, 2]
    for name, part in zip(RATE_COLUMNS, down.T, strict=True):
        imu[name] = imu[name] + turning * part
    heading = attitude["psi_rad"] + turning * log.t_s("attitude")
    attitude["psi_rad"] = heading + np.radians(15.0) * np.sin(heading)


@spoils("gyro_lag")
def _late(log: Log) -> None:
    log.streams["attitude"]["time_us"] = log.streams["attitude"]["time_us"] + 120_000


@spoils("inertial_lag")
def _late_together(log: Log) -> None:
    t = log.t_s("imu")
    for name in ACCEL:  # early by so much, which is the same
        log.streams["imu"][name] = np.interp(t + 0.3, t, log.streams["imu"][name])


@spoils("gyro_bias")
def _biased(log: Log) -> None:
    log.streams["imu"]["gyro_x_rad_s"] = log.streams["imu"]["gyro_x_rad_s"] + 0.04


@spoils("gyro_disagrees")
def _noisy(log: Log) -> None:
    random = np.random.default_rng(2)
    log.streams["imu"]["gyro_z_rad_s"] = 0.3 * random.standard_normal(log.t_s("imu").size)


@spoils("accelerometer_missing")
def _rates_only(log: Log) -> None:
    for name in ACCEL:
        log.streams["imu"][name] = np.full(log.t_s("imu").size, np.nan)


@spoils("attitude_jumps")
def _jump(log: Log) -> None:
    log.streams["attitude"]["psi_rad"] = log.streams["attitude"]["psi_rad"] + np.where(
        log.t_s("attitude") > 33.0, 1.0, 0.0
    )


@spoils("depth_sign")
def _flipped(log: Log) -> None:
    log.streams["depth"]["depth_m"] = 10.0 - log.streams["depth"]["depth_m"]


@spoils("velocity_sign")
def _flu(log: Log) -> None:
    for name in ("v_m_s", "w_m_s"):
        log.streams["velocity"][name] = -log.streams["velocity"][name]


@spoils("velocity_axes")
def _crossed(log: Log) -> None:
    velocity = log.streams["velocity"]
    velocity["u_m_s"], velocity["v_m_s"] = velocity["v_m_s"], velocity["u_m_s"]


@spoils("velocity_lag")
def _slow_velocity(log: Log) -> None:
    log.streams["velocity"]["time_us"] = log.streams["velocity"]["time_us"] + 800_000


@spoils("commands_one_tone")
def _one_sine(log: Log) -> None:
    swing = 200.0 * np.sin(2.0 * np.pi * 0.2 * log.t_s("actuators"))
    for number in range(1, 9):
        log.streams["actuators"][f"pwm_{number}_us"] = np.round(1500.0 + swing)


@spoils("command_late")
def _slow_commands(log: Log) -> None:
    log.streams["actuators"]["time_us"] = log.streams["actuators"]["time_us"] + 900_000


@spoils("commands_early")
def _early_commands(log: Log) -> None:
    """Of surge and turning: sway and heave of this log repeat within the shift."""
    for name in ("v_m_s", "w_m_s"):
        log.streams["velocity"][name] = 0.0 * log.streams["velocity"][name]
    log.streams["actuators"]["time_us"] = log.streams["actuators"]["time_us"] - 1_900_000


@spoils("outputs_held")
def _set_points(log: Log) -> None:
    for number in range(1, 9):
        name = f"pwm_{number}_us"
        log.streams["actuators"][name] = np.full_like(log.streams["actuators"][name], 1600.0)


def of_a_vehicle(name: str, *keys: str, value: Any) -> Spoil:
    """The vehicle file says something else."""

    def change(log: Log) -> None:
        document = copy.deepcopy(vehicle_document(name))
        entry: Any = document
        for key in keys:
            entry = entry[key]
        entry["value"] = value
        log.vehicle = vehicle_from_document(document)

    return change


SPOIL["water_density"] = of_a_vehicle("bluerov2_heavy", "environment", "water_density", value=1.025)
SPOIL["added_mass_size"] = of_a_vehicle("bluerov2_heavy", "added_mass", "Y_vdot", value=-0.7)
SPOIL["weight_in_water"] = of_a_vehicle("bluerov2_heavy", "rigid_body", "mass", value=29.8)


SPOIL["gravity_value"] = of_a_vehicle("bluerov2_heavy", "environment", "gravity", value=-9.81)
SPOIL["upside_down"] = of_a_vehicle(
    "bluerov2_heavy", "rigid_body", "centre_of_buoyancy", value=[0.0, 0.0, 0.02]
)
SPOIL["buoyancy_low"] = of_a_vehicle(
    "bluerov2_heavy", "rigid_body", "centre_of_buoyancy", value=[0.0, 0.0, 0.004]
)
SPOIL["body_size"] = of_a_vehicle(
    "bluerov2_heavy", "rigid_body", "centre_of_buoyancy", value=[0.0, 0.0, -10.0]
)


@spoils("velocity_unsigned")
def _sizes_only(log: Log) -> None:
    for name in SPEED_COLUMNS:
        log.streams["velocity"][name] = np.abs(log.streams["velocity"][name])


RIGHT_ORDER = (1, 2, 3, 4, 5, 6, 7, 8)


def drive(log: Log, order: tuple[int, ...], dead: tuple[int, ...] = ()) -> None:
    """Six motions as the thrusters make them; outputs in an order."""
    log.vehicle = vehicle_from_document(vehicle_document("bluerov2_heavy"))
    log.info["parameters"] = {"FRAME_CONFIG": 2.0}
    thrusters = log.vehicle.thrusters
    assert thrusters is not None
    t_s, random = log.t_s("actuators"), np.random.default_rng(5)
    pulses = np.repeat(random.uniform(-150.0, 150.0, (30, 8)), 20, axis=0)[: t_s.size]
    for place, number in enumerate(order):
        log.streams["actuators"][f"pwm_{number}_us"] = 1500.0 + pulses[:, place]
    alive = [number not in dead for number in range(1, 9)]
    force = (thruster_forces(thrusters, 1500.0 + pulses) * alive) @ thrusters.allocation.T
    rate = force / np.diag(log.vehicle.mass_matrix)
    motion = np.zeros_like(rate)
    for n in range(1, t_s.size):
        motion[n] = motion[n - 1] + 0.1 * (rate[n - 1] - 0.8 * motion[n - 1])
    for axis, name in enumerate(SPEED_COLUMNS):
        log.streams["velocity"][name] = np.interp(log.t_s("velocity"), t_s, motion[:, axis])
    for axis, name in enumerate(IMU_COLUMNS):
        log.streams["imu"][name] = np.interp(log.t_s("imu"), t_s, motion[:, 3 + axis])


@spoils("response_order")
def _other_order(log: Log) -> None:
    drive(log, (5, 6, 7, 8, 1, 2, 3, 4))


@spoils("frame_unlike")
def _frame_of_six_motors(log: Log) -> None:
    drive(log, RIGHT_ORDER)
    log.info["parameters"]["FRAME_CONFIG"] = 1.0


@spoils("curve_voltage")
def _curve_of_four_cells(log: Log) -> None:
    """Thrusters on six cells, with the curve of the data sheet at 16 V."""
    drive(log, RIGHT_ORDER)
    log.streams["battery"]["voltage_v"] = log.streams["battery"]["voltage_v"] + 6.2


@spoils("propeller_speed")
def _turns_of_the_motor(log: Log) -> None:
    log.vehicle = vehicle_from_document(vehicle_document("vt690"))
    ahead = velocity(log.t_s("actuators"))[:, 0]
    log.streams["actuators"]["propeller_rev_s"] = np.where(ahead > 0.05, 140.0, 0.0)


@spoils("output_dead")
def _record_of_another_signal(log: Log) -> None:
    """Output 3 has a wave that its thruster never gave."""
    drive(log, RIGHT_ORDER)
    t_s = log.t_s("actuators")
    log.streams["actuators"]["pwm_3_us"] = 1500.0 + 150.0 * np.sign(np.sin(1.7 * t_s))


@spoils("velocity_zero")
def _heave_at_rest(log: Log) -> None:
    log.streams["velocity"]["w_m_s"] = log.streams["velocity"]["w_m_s"] + 0.06


@spoils("response_scale")
def _small_pulses(log: Log) -> None:
    """Pulses with two thirds of their deflection."""
    drive(log, RIGHT_ORDER)
    for number in range(1, 9):
        name = f"pwm_{number}_us"
        log.streams["actuators"][name] = 500.0 + log.streams["actuators"][name] / 1.5


@spoils("velocity_coarse")
def _whole_numbers(log: Log) -> None:
    for name in SPEED_COLUMNS:
        log.streams["velocity"][name] = np.round(4.0 * log.streams["velocity"][name])


@spoils("accelerometer_axes")
def _turned_accelerometer(log: Log) -> None:
    imu = log.streams["imu"]
    imu[ACCEL[0]], imu[ACCEL[1]] = imu[ACCEL[1]], imu[ACCEL[0]]


@spoils("accelerometer_tilt")
def _pitched_accelerometer(log: Log) -> None:
    imu = log.streams["imu"]
    cos, sin = np.cos(np.radians(8.0)), np.sin(np.radians(8.0))
    x, z = imu[ACCEL[0]], imu[ACCEL[2]]
    imu[ACCEL[0]], imu[ACCEL[2]] = cos * x - sin * z, sin * x + cos * z


@spoils("depth_zero_unseen")
def _absolute_pressure(log: Log) -> None:
    log.info["files"][0]["format"] = "CSV"
    depth_m = log.streams["depth"]["depth_m"]
    log.streams["depth"]["depth_m"] = depth_m - depth_m.min() + 10.1


@spoils("vehicle_guessed")
def _guess(log: Log) -> None:
    document = copy.deepcopy(vehicle_document("remus100"))
    document["guessed"] = "8 outputs are driven and the log names no frame"
    log.vehicle = vehicle_from_document(document)


@spoils("hull_volume")
def _pounds(log: Log) -> None:
    document = copy.deepcopy(vehicle_document("remus100"))
    for name in ("mass", "displaced_mass"):
        document["rigid_body"][name]["value"] *= 2.2046
    log.vehicle = vehicle_from_document(document)


@spoils("columns_alike")
def _sway_of_surge(log: Log) -> None:
    log.streams["velocity"]["v_m_s"] = log.streams["velocity"]["u_m_s"]


@spoils("velocity_outliers")
def _no_bottom(log: Log) -> None:
    surge = log.streams["velocity"]["u_m_s"].copy()
    surge[5::60] = 8.0 + 0.1 * np.arange(surge[5::60].size)
    log.streams["velocity"]["u_m_s"] = surge


@spoils("placeholder_values")
def _no_depth_now_and_then(log: Log) -> None:
    log.streams["depth"]["depth_m"][5::60] = 0.0


@spoils("outputs_unseen")
def _quiet_heave(log: Log) -> None:
    """Heave, roll and pitch follow something else than the vertical thrusters."""
    drive(log, RIGHT_ORDER)
    rng = np.random.default_rng(6)
    for stream, names in (("velocity", SPEED_COLUMNS[2:]), ("imu", IMU_COLUMNS[:2])):
        for name in names:
            log.streams[stream][name] = 0.1 * rng.standard_normal(log.t_s(stream).size)


@spoils("outputs_alike")
def _copied_output(log: Log) -> None:
    drive(log, RIGHT_ORDER)
    log.streams["actuators"]["pwm_6_us"] = log.streams["actuators"]["pwm_5_us"].copy()


@spoils("neutral_pulse")
def _neutral_at_1560(log: Log) -> None:
    drive(log, RIGHT_ORDER)
    outputs = log.streams["actuators"]
    for number in range(1, 9):
        outputs[f"pwm_{number}_us"] = outputs[f"pwm_{number}_us"].copy()
        outputs[f"pwm_{number}_us"][:60] = 1560.0


@spoils("tilt_offset")
def _askew(log: Log) -> None:
    log.streams["attitude"]["theta_rad"] = log.streams["attitude"]["theta_rad"] + 0.1


@spoils("attitude_inverse")
def _conjugate(log: Log) -> None:
    """The quaternion of the earth in the body, and no gyro beside it."""
    del log.streams["imu"]
    attitude, names = log.streams["attitude"], ("phi_rad", "theta_rad", "psi_rad")
    parts = quaternion_of_euler(np.column_stack([attitude[name] for name in names]))
    attitude |= dict(
        zip(names, euler_of_quaternion(parts * [1.0, -1.0, -1.0, -1.0]).T, strict=True)
    )


@spoils("velocity_delay")
def _mean_velocity(log: Log) -> None:
    velocity = log.streams["velocity"]
    velocity["time_us"] = velocity["time_us"] + 250_000


@spoils("curve_range")
def _curve_over_percent(log: Log) -> None:
    drive(log, RIGHT_ORDER)
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    entry = document["actuators"]["thrusters"]["thrust_curve"]["pulse_width"]
    entry["value"] = [(at - 1500.0) / 4.0 for at in entry["value"]]
    log.vehicle = vehicle_from_document(document)


SPOIL["attitude_scale"] = scaled("attitude", ("phi_rad",), 0.8)


@spoils("sign_changes")
def _restarted(log: Log) -> None:
    """The gyro's driver starts again with another sign."""
    imu, t_s = log.streams["imu"], log.t_s("imu")
    imu["gyro_x_rad_s"] = np.where(t_s > 0.6 * t_s[-1], -1.0, 1.0) * imu["gyro_x_rad_s"]


SPOIL["scale_off"] = scaled("depth", ("depth_m",), 1.25)


@spoils("outputs_unanswered")
def _of_another_time(log: Log) -> None:
    drive(log, RIGHT_ORDER)
    rng = np.random.default_rng(6)
    for stream, names in (("velocity", SPEED_COLUMNS), ("imu", IMU_COLUMNS)):
        for name in names:
            noise = 0.1 * rng.standard_normal(log.t_s(stream).size)
            log.streams[stream][name] = 0.02 * log.streams[stream][name] + noise


@spoils("command_delay")
def _outputs_stamped_early(log: Log) -> None:
    drive(log, RIGHT_ORDER)
    log.streams["actuators"]["time_us"] = log.streams["actuators"]["time_us"] - 800_000


@spoils("outputs_frozen")
def _record_stops(log: Log) -> None:
    for number in range(1, 9):
        output = log.streams["actuators"][f"pwm_{number}_us"].copy()
        output[300:] = output[300]
        log.streams["actuators"][f"pwm_{number}_us"] = output


@spoils("output_unnamed")
def _another_frame(log: Log) -> None:
    """A vehicle file of six thrusters for outputs of eight, of which the seventh drives surge."""
    stepped_dive(log)
    pulses = log.streams["actuators"]
    pulses["pwm_1_us"], pulses["pwm_7_us"] = pulses["pwm_7_us"], pulses["pwm_1_us"]
    log.vehicle = vehicle_from_document(vehicle_document("bluerov2"))


def stepped_dive(log: Log) -> None:
    """Two minutes in which outputs step every second and six motions follow them."""
    random, fine = np.random.default_rng(4), np.arange(0.0, 120.0, 0.1)
    steps = np.repeat(random.uniform(-1.0, 1.0, (120, 8)), 10, axis=0)
    motion = np.zeros_like(steps)
    for n in range(1, fine.size):
        motion[n] = motion[n - 1] + 0.2 * (steps[n - 1] - motion[n - 1])
    log.streams["actuators"] = {
        "time_us": micro(fine),
        **{f"pwm_{number + 1}_us": 1500.0 + 200.0 * steps[:, number] for number in range(8)},
    }
    for stream, names, first in (("velocity", SPEED_COLUMNS, 0), ("imu", IMU_COLUMNS[:3], 3)):
        columns = {name: motion[:, first + place] for place, name in enumerate(names)}
        log.streams[stream] = {"time_us": micro(fine), **columns}
    rest = {
        "accel_x_m_s2": 0.0 * fine,
        "accel_y_m_s2": 0.0 * fine,
        "accel_z_m_s2": -9.8 + 0.0 * fine,
    }
    log.streams["imu"] |= rest
    log.info["end_us"] = int(micro(fine[-1:])[0])


@spoils("clock_drift")
def _fast_clock(log: Log) -> None:
    stepped_dive(log)
    stamps = log.streams["velocity"]["time_us"]
    log.streams["velocity"]["time_us"] = stamps[0] + np.rint(1.02 * (stamps - stamps[0])).astype(
        np.int64
    )


@spoils("commands_unrelated")
def _of_another_dive(log: Log) -> None:
    """Outputs that a pilot held for a second each on another day."""
    rng = np.random.default_rng(9)
    count = log.t_s("actuators").size
    for number in range(1, 9):
        levels = np.repeat(rng.uniform(1300.0, 1700.0, count // 10 + 1), 10)[:count]
        log.streams["actuators"][f"pwm_{number}_us"] = levels


def thrust_times(factor: float) -> Spoil:
    """A thrust curve of the vehicle file in another unit."""

    def change(log: Log) -> None:
        drive(log, RIGHT_ORDER)
        assert log.vehicle is not None
        document = log.vehicle.document.model_dump(mode="python", exclude_none=True)
        entry = document["actuators"]["thrusters"]["thrust_curve"]["force"]
        entry["value"] = (factor * np.array(entry["value"])).tolist()
        log.vehicle = vehicle_from_document(document)

    return change


SPOIL |= {"response_unit": thrust_times(1.0 / 9.80665), "drag_size": thrust_times(30.0)}


@spoils("weight_held")
def _too_much_water(log: Log) -> None:
    drive(log, RIGHT_ORDER)
    assert log.vehicle is not None
    document = log.vehicle.document.model_dump(mode="python", exclude_none=True)
    document["rigid_body"]["displaced_mass"]["value"] += 6.0
    for name in ("phi_rad", "theta_rad"):
        log.streams["attitude"][name] = 0.1 * log.streams["attitude"][name]
    log.streams["velocity"]["w_m_s"] = 0.1 * log.streams["velocity"]["w_m_s"]
    log.streams["velocity"]["u_m_s"] = 0.1 * log.streams["velocity"]["u_m_s"]
    log.vehicle = vehicle_from_document(document)


@spoils("response_sign")
def _backward(log: Log) -> None:
    """Thrusters push aft where the vehicle speeds up."""
    log.vehicle = vehicle_from_document(vehicle_document("bluerov2_heavy"))
    thrusters = log.vehicle.thrusters
    assert thrusters is not None
    push = -1500.0 * acceleration(log.t_s("actuators"))[:, 0]
    for number, share in enumerate(thrusters.direction * thrusters.allocation[0], start=1):
        log.streams["actuators"][f"pwm_{number}_us"] = 1500.0 + share * push
    log.info["parameters"] = {"FRAME_CONFIG": 2.0}


def with_track(log: Log, turned_deg: float = 0.0, *, noise_m: float = 0.05) -> None:
    """A position of its own sensor; the heading reads so much too little."""
    fine = np.arange(0.0, LENGTH_S, 0.01)
    over_ground = np.einsum("nij,nj->ni", rotation_body_to_ned(euler(fine)), velocity(fine))
    t_s, noise = clock(5.0), np.random.default_rng(7)
    track = [np.interp(t_s, fine, np.cumsum(part) * 0.01) for part in over_ground.T[:2]]
    log.streams["position"] = {
        "time_us": micro(t_s),
        "x_m": track[0] + noise_m * noise.standard_normal(t_s.size),
        "y_m": track[1] + noise_m * noise.standard_normal(t_s.size),
        "z_m": depth(t_s),
    }
    log.streams["attitude"]["psi_rad"] = log.streams["attitude"]["psi_rad"] - np.radians(turned_deg)


@spoils("heading_offset")
def _turned_compass(log: Log) -> None:
    with_track(log, 25.0)


@spoils("position_axes")
def _east_before_north(log: Log) -> None:
    with_track(log)
    track = log.streams["position"]
    track["x_m"], track["y_m"] = track["y_m"], track["x_m"]


def turn_velocity(log: Log, angle_deg: float) -> None:
    """A velocity log that is mounted turned about the vertical, clockwise from above."""
    columns, angle = log.streams["velocity"], np.radians(angle_deg)
    u, v = columns["u_m_s"], columns["v_m_s"]
    columns["u_m_s"] = np.cos(angle) * u + np.sin(angle) * v
    columns["v_m_s"] = np.cos(angle) * v - np.sin(angle) * u


@spoils("velocity_turned")
def _crooked(log: Log) -> None:
    turn_velocity(log, 9.0)


@spoils("arm_off")
def _moved_log(log: Log) -> None:
    log.vehicle = vehicle_from_document(vehicle_document("bluerov2_heavy"))
    rates = [
        np.interp(log.t_s("velocity"), log.t_s("imu"), log.streams["imu"][name])
        for name in RATE_COLUMNS
    ]
    added = np.cross(np.column_stack(rates), [-0.5, 0.0, 0.0])
    for name, part in zip(SPEED_COLUMNS, added.T, strict=True):
        log.streams["velocity"][name] = log.streams["velocity"][name] + part


@spoils("heading_unseen")
def _no_track(log: Log) -> None:
    assert "position" not in log.streams


@spoils("velocity_frozen")
def _frozen_axis(log: Log) -> None:
    at("velocity", 0.0, 99.0, u_m_s=0.3)(log)


@spoils("outputs_constant")
def _moored(log: Log) -> None:
    """At a bollard: one pulse, and hardly any motion."""
    _set_points(log)
    for stream, names in {"velocity": SPEED_COLUMNS, "imu": IMU_COLUMNS}.items():
        scaled(stream, names, 0.1)(log)


@spoils("time_unit")
def _milliseconds(log: Log) -> None:
    for columns in log.streams.values():
        columns["time_us"] = FIRST_US + (columns["time_us"] - FIRST_US) * 1000
    log.info["end_us"] = FIRST_US + int(LENGTH_S * 1e9)


@spoils("streams_apart")
def _other_zero(log: Log) -> None:
    log.streams["velocity"]["time_us"] = log.streams["velocity"]["time_us"] + 10_000_000_000
    log.info["end_us"] = log.info["end_us"] + 10_000_000_000


@spoils("attitude_unit")
def _degrees(log: Log) -> None:
    for name in ("phi_rad", "theta_rad", "psi_rad"):
        log.streams["attitude"][name] = np.degrees(log.streams["attitude"][name])


@spoils("output_range")
def _small_outputs(log: Log) -> None:
    for number in range(1, 9):
        pulses = log.streams["actuators"][f"pwm_{number}_us"]
        log.streams["actuators"][f"pwm_{number}_us"] = (pulses - 1100.0) / 800.0


@spoils("impossible_values")
def _impossible(log: Log) -> None:
    rejecting("attitude", 300, "impossible value")(log)


@spoils("never_armed")
def _disarmed(log: Log) -> None:
    log.streams["mode"]["armed"] = [False]


@spoils("without_vehicle")
def _long_after(log: Log) -> None:
    log.info["end_us"] = log.info["end_us"] + 900_000_000


@spoils("out_of_water")
def _on_deck(log: Log) -> None:
    for number in range(1, 9):
        at("actuators", 0.0, 35.0, **{f"pwm_{number}_us": 1500.0})(log)
    at("depth", 0.0, 35.0, depth_m=0.02)(log)


@spoils("moved_by_hand")
def _carried(log: Log) -> None:
    for number in range(1, 9):
        at("actuators", 0.0, 15.0, **{f"pwm_{number}_us": 1500.0})(log)
    turning = np.where(log.t_s("imu") < 12.0, np.sin(4.0 * log.t_s("imu")), 0.0)
    log.streams["imu"]["gyro_y_rad_s"] = log.streams["imu"]["gyro_y_rad_s"] + turning


@spoils("depth_outliers")
def _leaping_depth(log: Log) -> None:
    depth = log.streams["depth"]["depth_m"]
    log.streams["depth"]["depth_m"] = depth + np.where(np.arange(depth.size) % 100 == 50, 3.0, 0.0)


@spoils("velocity_saturated")
def _limited_velocity(log: Log) -> None:
    log.streams["velocity"]["u_m_s"] = np.clip(log.streams["velocity"]["u_m_s"], -0.2, 0.2)


@spoils("span_copied")
def _copied(log: Log) -> None:
    for name in IMU_COLUMNS:
        log.streams["imu"][name][1000:1100] = log.streams["imu"][name][300:400]


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_simulation_that_moves_to_and_fro_is_no_copy(noise: float) -> None:
    """The same sines of 4 s are there fifteen times; noise that repeats as well is a copy."""
    log = sound()
    t_s = log.t_s("imu")
    scatter = np.random.default_rng(1).standard_normal((200, 3))[np.arange(t_s.size) % 200]
    for number, name in enumerate(("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")):
        sine = 0.1 * np.sin(np.pi / 2.0 * (np.arange(t_s.size) % 200) / 50.0 + number)
        log.streams["imu"][name] = np.round(sine, 5) + noise * scatter[:, number]
    named = [item["id"] for item in log.health()["findings"]]
    assert ("span_copied" in named) == bool(noise)


@spoils("no_actuation")
def _neutral(log: Log) -> None:
    for number in range(1, 9):
        log.streams["actuators"][f"pwm_{number}_us"] = np.full(log.t_s("actuators").size, 1500.0)


def test_a_sound_log_has_no_finding_but_the_answer_to_its_outputs() -> None:
    log = sound()
    with_track(log)
    document = log.health()
    check_document(document, "health")
    (finding,) = document["findings"]
    assert finding["id"] == "command_lag"
    # Motion was made to answer 0.3 s late; the moving mean that takes slow drift off
    # bends the slow sines a little.
    for axis in ("surge", "sway", "heave", "roll", "pitch", "yaw"):
        assert f"{axis} follows by" in finding["text"]
    lags = [float(words.split(" s")[0]) for words in finding["text"].split("follows by ")[1:]]
    assert lags == pytest.approx([DELAY_S] * 6, abs=0.04)
    assert (
        document["verdict"]
        == "A force model can be fitted in surge, sway, heave, roll, pitch and yaw."
    )
    assert all(item["possible"] for item in document["capabilities"])


def test_a_guessed_glider_is_not_asked_for_thrusters() -> None:
    log = sound()
    log.vehicle = vehicle_from_document({**vehicle_document("slocum"), "guessed": "no name"})
    (item,) = (each for each in log.health()["findings"] if each["id"] == "vehicle_guessed")
    assert "thrusters" not in item["remedy"]
    assert "lift_slope" in item["remedy"]


def test_every_check_of_the_catalogue_has_its_cause_here() -> None:
    of_poses = {name for name in checks() if name.startswith("pose_")} | {"yaw_across_wrap"}
    of_poses |= {"commands_mixed", "run_clock"}  # which is of several logs
    of_poses |= {"response_shape", "depth_unrelated", "depth_jumps"}  # test_wrong_maps.py
    of_poses |= {"velocity_level", "velocity_step", "velocity_stops"}
    assert set(SPOIL) | {"command_lag"} | of_poses == set(checks())  # test_pose_motion.py


@pytest.mark.parametrize("name", sorted(SPOIL))
def test_a_spoilt_log_shows_the_finding(name: str) -> None:
    log = sound()
    SPOIL[name](log)
    document = log.health()
    check_document(document, "health")
    both = (*document["findings"], *document["explained"])
    finding = next((item for item in both if item["id"] == name), None)
    assert finding is not None, [item["id"] for item in document["findings"]]
    assert finding["severity"] == checks()[name].severity
    assert finding["text"].endswith(".")
    assert len(finding["remedy"]) > 10


def test_a_wrong_gyro_is_no_jump_of_the_attitude_and_the_verdict_says_it() -> None:
    for name in ("gyro_sign", "gyro_scale", "gyro_axes"):
        log = sound()
        imu = log.streams["imu"]
        for column in IMU_COLUMNS:
            imu[column] = 6.0 * imu[column]
        for column in ("phi_rad", "theta_rad", "psi_rad"):
            log.streams["attitude"][column] = 6.0 * log.streams["attitude"][column]
        SPOIL[name](log)
        assert "attitude_jumps" not in log.ids(), name
        assert "gyro" in log.health()["verdict"].split("but ")[1], name


def test_a_noisy_angle_of_a_quiet_vehicle_is_no_disagreement() -> None:
    log, random = sound(), np.random.default_rng(3)
    attitude = log.streams["attitude"]
    noise = 0.007 * random.standard_normal(log.t_s("attitude").size)
    attitude["phi_rad"] = attitude["phi_rad"] + noise
    fine = rate_agreement(
        log.t_s("attitude"),
        np.column_stack([attitude[name] for name in ("phi_rad", "theta_rad", "psi_rad")]),
        log.t_s("imu"),
        np.column_stack([log.streams["imu"][name] for name in IMU_COLUMNS]),
    )
    assert fine is not None
    assert fine.correlation[0, 0] < 0.7, "from sample to sample the noise decides"
    assert "gyro_disagrees" not in log.ids()


def test_noise_makes_no_lag_between_gyro_and_attitude() -> None:
    """Of a slow swing in pitch: the quiet axes are noise alone, and half of the gyro is."""

    def late_s(seed: int) -> float:
        random, log = np.random.default_rng(seed), sound()
        t_s, t_imu = log.t_s("attitude"), log.t_s("imu")

        def swing(t: Array) -> Array:
            return np.asarray(0.12 * np.exp(-t / 40.0) * np.sin(2.0 * np.pi * t / 12.0))

        angles = 0.001 * random.standard_normal((3, t_s.size))
        rates = 0.01 * random.standard_normal((3, t_imu.size))
        angles[1] += swing(t_s)
        rates[1] += np.gradient(swing(t_imu), t_imu)
        names = ("phi_rad", "theta_rad", "psi_rad")
        log.streams["attitude"] |= dict(zip(names, angles, strict=True))
        log.streams["imu"] |= dict(zip(IMU_COLUMNS, rates, strict=True))
        agreement = rate_agreement(t_s, angles.T, t_imu, rates.T)
        assert agreement is not None
        assert "gyro_lag" not in log.ids(), agreement.lag_s
        return abs(agreement.lag_s)

    assert min(map(late_s, (7, 12))) > 0.13, "the noise makes lags that the check would name"


def test_a_heading_that_is_late_by_itself_is_named_with_its_own_lag() -> None:
    log = sound()
    attitude, t_s = log.streams["attitude"], log.t_s("attitude")
    attitude["psi_rad"] = np.interp(t_s - 0.7, t_s, attitude["psi_rad"])
    item = log.finding("gyro_lag")
    assert item["value"] == pytest.approx(0.7, abs=0.05)
    assert item["text"].startswith("Yaw of the attitude comes 0.7"), item["text"]
    assert "roll and pitch are in time" in item["text"]
    assert item["fields"] == ["psi_rad"]


def test_an_attitude_behind_a_filter_is_late_without_its_gyro() -> None:
    log = sound()
    log.streams["attitude"]["time_us"] = log.streams["attitude"]["time_us"] + 96_000
    late = log.finding("inertial_lag")
    assert late["fields"] == ["phi_rad", "theta_rad", "psi_rad"]
    assert "0.10 s after the gyro" in late["text"]


def test_halves_of_a_drift_of_outputs_are_those_of_the_time_that_they_act(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log, halves = sound(), list[tuple[float, float]]()
    drive(log, RIGHT_ORDER)
    t_s = log.t_s("actuators")
    for name, values in log.streams["actuators"].items():
        if name.startswith("pwm"):
            log.streams["actuators"][name] = np.where(t_s < 0.4 * t_s[-1], 1500.0, values)
    rest_s, cut_out = 0.4 * t_s[-1], CheckedLog.between

    def between(self: CheckedLog, start_s: float, end_s: float) -> CheckedLog:
        halves.append((start_s, end_s))
        return cut_out(self, start_s, end_s)

    monkeypatch.setattr(CheckedLog, "between", between)
    monkeypatch.setattr(force_clocks, "push_lags", lambda *_, **__: [])
    log.health()
    assert halves[0][0] == pytest.approx(rest_s, abs=1.0)
    assert halves[0][1] == pytest.approx(0.5 * (rest_s + t_s[-1]), abs=2.0)


@pytest.mark.parametrize(
    ("gain", "late", "other", "named"),
    [(1.0, 0.9, 0.1, True), (1.0, 0.2, 0.1, False), (-1.0, 0.7, 0.8, False)],
    ids=["late", "joined otherwise", "turned"],
)
def test_a_force_that_hardly_acts_or_acts_backward_tells_no_clock(
    gain: float, late: float, other: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Shares of surge and sway that forces explain 2 s late, and at any other lag."""

    def answer(lag: float) -> AxisGains:
        at_once = lag < 0.5
        size = np.array([gain if at_once else 1.0])
        share = late if lag == 2.0 else other
        return AxisGains(size, np.array([0.01]), share, 1000, np.array([1.0]))

    by_lag = [answer(lag) for lag in force_clocks.LAGS_S.tolist()]
    monkeypatch.setattr(force_clocks, "push_lags", lambda *_, **__: [("u", by_lag), ("v", by_lag)])
    log = cast(CheckedLog, SimpleNamespace(vehicle=None))
    ids = [item["id"] for item in force_clocks.force_clock_findings(log)]
    assert ids == (["commands_early"] if named else [])


def test_all_stretches_of_zeros_of_a_velocity_are_named() -> None:
    """Seconds without bottom that are written as 0; one long stop is a stuck sensor."""
    log = sound()
    for start in (11.2, 29.2, 47.2):  # from speed to speed
        at("velocity", start, start + 4.4, u_m_s=0.0, v_m_s=0.0, w_m_s=0.0)(log)
    text = log.finding("placeholder_values")["text"]
    assert "from 11.2 to 15.5, 29.2 to 33.5, 47.2 to 51.5 s" in text, text
    assert "stuck_sensor" not in log.ids()
    log = sound()
    for start in (10.0, 30.0):
        at("velocity", start, start + 4.0, u_m_s=0.1, v_m_s=0.1, w_m_s=0.1)(log)
    assert "from 10.0 s on, and others from 30.0 s on" in log.finding("stuck_sensor")["text"]


def test_a_vehicle_that_rests_at_a_dock_and_circles_then_is_not_stuck_or_carried() -> None:
    """Zeros of its velocity log are true; what it turns by afterwards is no bias of the gyro."""
    log = sound()
    start = np.clip((log.t_s("velocity") - 6.0) / 10.0, 0.0, 1.0)
    for name in SPEED_COLUMNS:
        log.streams["velocity"][name] = log.streams["velocity"][name] * start
    log.streams["velocity"]["w_m_s"][: np.argmax(start > 0.0) + 4] = 0.0  # below its threshold
    for number in range(1, 9):
        at("actuators", 0.0, 7.0, **{f"pwm_{number}_us": 1500.0})(log)
    circling = np.where(log.t_s("imu") < 6.0, 0.0, 0.7)
    log.streams["imu"]["gyro_z_rad_s"] = log.streams["imu"]["gyro_z_rad_s"] * 0.1 + circling
    assert not {"stuck_sensor", "moved_by_hand"} & set(log.ids())


def test_a_regular_clock_with_losses_is_not_slow() -> None:
    log = sound()
    slower("imu", 5)(log)
    log.keep("imu", np.arange(log.t_s("imu").size) % 17 > 1)
    assert log.health()["streams"]["imu"]["rate_hz"] < 4.8
    assert "low_rate" not in log.ids()


def test_an_angle_and_its_rate_and_depth_and_heave_are_named_where_they_are_exchanged() -> None:
    log = sound()
    attitude, imu = log.streams["attitude"], log.streams["imu"]
    t_s, t_imu = log.t_s("attitude"), log.t_s("imu")
    attitude["psi_rad"], imu["gyro_z_rad_s"] = (
        np.interp(t_s, t_imu, imu["gyro_z_rad_s"]),
        np.interp(t_imu, t_s, attitude["psi_rad"]),
    )
    assert "psi_rad (ATTITUDE) and gyro_z_rad_s (IMU)" in log.finding("columns_exchanged")["text"]
    log = sound()
    heave, t = log.streams["velocity"]["w_m_s"], log.t_s("velocity")
    depth_m, t_depth = log.streams["depth"]["depth_m"], log.t_s("depth")
    log.streams["velocity"]["w_m_s"] = np.interp(t, t_depth, depth_m)
    log.streams["depth"]["depth_m"] = np.interp(t_depth, t, heave)
    (item,) = [item for item in log.health()["findings"] if checks()[item["id"]].stops]
    assert (item["id"], item["fields"]) == ("columns_exchanged", ["depth_m", "w_m_s"])


def test_rejected_rows_of_one_table_are_one_finding() -> None:
    log = sound()
    for stream in ("imu", "attitude", "depth"):
        log.info["streams"][stream] = {"source": "dive.csv"}
        rejecting(stream, 40, "time stamp out of order")(log)
    item = log.finding("rejected_samples")
    assert "of imu, attitude and depth cannot" in item["text"] or "attitude, imu" in item["text"]
    assert "sort the table by its time" in item["remedy"]


def test_every_jump_of_the_attitude_has_its_time() -> None:
    log = sound()
    attitude, t_s = log.streams["attitude"], log.t_s("attitude")
    attitude["psi_rad"] = attitude["psi_rad"] + (t_s > 33.0) + 1.0 * (t_s > 40.0)
    text = log.finding("attitude_jumps")["text"]
    assert "jumps 2 times" in text
    assert re.search(r"Jumps at (32\.9|33\.0), (39\.9|40\.0) s\.$", text), text


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ((5, 6, 7, 8, 1, 2, 3, 4), "with 5, 6, 7, 8, 1, 2, 3, 4 for 1 to 8"),
        ((8, 7, 6, 5, 4, 3, 2, 1), "with 8, 7, 6, 5, 4, 3, 2, 1 for 1 to 8"),
        ((2, 3, 4, 5, 6, 7, 8, 1), "with 2, 3, 4, 5, 6, 7, 8, 1 for 1 to 8"),
    ],
)
def test_outputs_in_another_order_are_named_with_the_right_one(
    order: tuple[int, ...], words: str
) -> None:
    log = sound()
    drive(log, order)
    assert words in log.finding("response_order")["text"]


def test_outputs_that_the_vehicle_file_states_in_no_row_are_listed() -> None:
    order = OtherOrder((1, 2, 0), None, np.ones(1), np.zeros(1), 9.0)
    assert "with 5, 2, 9 for 9, 5, 2" in _order_words(order, (9, 5, 2))


@pytest.mark.parametrize("number", for_a_release(range(1, 9), without=(1, 4, 5, 8)))
def test_a_thruster_that_acts_backward_is_named(number: int) -> None:
    log = sound()
    drive(log, RIGHT_ORDER)
    name = f"pwm_{number}_us"
    log.streams["actuators"][name] = 3000.0 - log.streams["actuators"][name]
    assert f"Output {number} acts backward" in log.finding("response_order")["text"]


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ((1.0, -1.0, 1.0), "y of the positions counted to the left"),
        ((-1.0, 1.0, 1.0), "x of the positions counted backward"),
    ],
)
def test_places_of_thrusters_counted_the_other_way_are_named(
    factors: tuple[float, ...], words: str
) -> None:
    """Yaw of the vectored thrusters, roll and pitch of the vertical ones answer otherwise."""
    log = sound()
    drive(log, RIGHT_ORDER)
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    entry = document["actuators"]["thrusters"]["position"]
    entry["value"] = (np.array(entry["value"]) * factors).tolist()
    log.vehicle = vehicle_from_document(document)
    assert words in log.finding("response_order")["text"]


@pytest.mark.parametrize(
    "dead", for_a_release([(), (2,), (2, 7), (1, 2), (5, 8)], without=((), (2, 7), (5, 8)))
)
def test_thrusters_are_named_where_they_give_nothing_and_else_not(
    dead: tuple[int, ...],
) -> None:
    log = sound()
    drive(log, RIGHT_ORDER, dead)
    answers = {"response_order", "response_sign", "response_scale", "velocity_axes"}
    findings = log.health()["findings"]
    assert not answers & {item["id"] for item in findings}
    of_dead = [item["fields"] for item in findings if item["id"] == "output_dead"]
    assert of_dead == ([[f"pwm_{number}_us" for number in dead]] if dead else [])


@pytest.mark.parametrize(
    ("numbers", "words"),
    [((1, 3), "outputs 1 and 3 are exchanged"), ((2, 2), "output 2 acts backward")],
)
def test_outputs_that_change_under_way_are_named_with_the_time(
    numbers: tuple[int, int], words: str
) -> None:
    """One that turns halfway gives nothing on average, and is not named as dead."""
    log = sound()
    drive(log, RIGHT_ORDER)
    outputs, late = log.streams["actuators"], log.t_s("actuators") > 36.0
    first, second = (f"pwm_{number}_us" for number in numbers)
    if first == second:
        outputs[first] = np.where(late, 3000.0 - outputs[first], outputs[first])
    else:
        outputs[first], outputs[second] = (
            np.where(late, outputs[second], outputs[first]),
            np.where(late, outputs[first], outputs[second]),
        )
    item = log.finding("response_order")
    assert words in item["text"], item["text"]
    assert "output_dead" not in log.ids()
    start, last = re.findall(r"between (\d+) and (\d+) s", item["text"])[0]
    assert int(start) - 1 <= 36 <= int(last) + 1


def test_lights_and_a_camera_that_tilts_are_no_thrusters() -> None:
    """They move as often as thrusters do, and no motion answers them."""
    log = sound()
    stepped_dive(log)
    log.vehicle = vehicle_from_document(vehicle_document("bluerov2"))
    assert "output_unnamed" not in log.ids()


def test_a_binary_log_has_no_column_map_to_mend() -> None:
    log = sound()
    SPOIL["output_unnamed"](log)
    assert "column map" not in log.finding("output_unnamed")["remedy"]


@pytest.mark.parametrize(
    ("late_s", "name"),
    [(0.6, "command_late"), (0.0, None), (-0.8, "command_delay"), (-2.0, "commands_early")],
)
def test_the_clock_of_the_outputs_by_when_their_force_acts(late_s: float, name: str | None) -> None:
    log = sound()
    drive(log, RIGHT_ORDER)
    log.streams["actuators"]["time_us"] = log.streams["actuators"]["time_us"] + int(1e6 * late_s)
    texts = [item for item in log.health()["findings"] if "The force of the" in item["text"]]
    assert [item["id"] for item in texts] == ([] if name is None else [name])
    assert all(item["value"] == pytest.approx(abs(late_s - 0.1), abs=0.31) for item in texts)


@pytest.mark.parametrize(("late_s", "stated_s"), [(0.8, 0.8), (0.5, 0.5), (0.8, 0.0)])
def test_a_lag_that_the_vehicle_file_states_is_no_finding_and_one_that_is_not_there_is(
    late_s: float, stated_s: float
) -> None:
    log = sound()
    of_a_vehicle("bluerov2_heavy", "sensors", "dvl", "lag", value=stated_s)(log)
    log.streams["velocity"]["time_us"] = log.streams["velocity"]["time_us"] + int(1e6 * late_s)
    clocks = [item for item in log.health()["findings"] if item["id"] in CLOCKS]
    assert bool(clocks) == (late_s != stated_s)
    for item in clocks:
        if item["id"] == "velocity_lag":
            assert ("vehicle file states" in item["text"]) == bool(stated_s)


def test_a_body_that_nothing_drives_lacks_no_outputs() -> None:
    heavy = vehicle_from_document(vehicle_document("bluerov2_heavy"))
    for vehicle in (heavy, replace(heavy, thrusters=None, commands=FullCommands())):
        info = SimpleNamespace(notes=[])
        log = SimpleNamespace(has=lambda stream: False, others=[], vehicle=vehicle, info=info)
        names = [item["id"] for item in missing_findings(cast(CheckedLog, log))]
        assert ("no_actuators" in names) == vehicle.is_driven == (vehicle is heavy)


def test_one_output_that_stands_still_while_its_peers_work_is_named() -> None:
    log = sound()
    drive(log, RIGHT_ORDER)
    assert "outputs_frozen" not in log.ids()
    output = log.streams["actuators"]["pwm_8_us"].copy()
    output[300:] = output[300]
    log.streams["actuators"]["pwm_8_us"] = output
    assert "Output 8 stands at" in log.finding("outputs_frozen")["text"]


def test_heave_and_roll_without_pitch_are_no_copies() -> None:
    log = sound()
    drive(log, RIGHT_ORDER)
    pulses = log.streams["actuators"]
    pulses["pwm_7_us"], pulses["pwm_8_us"] = pulses["pwm_5_us"].copy(), pulses["pwm_6_us"].copy()
    assert "outputs_alike" not in log.ids()


@pytest.mark.parametrize("factor", [1.5, 0.7])
def test_a_scale_that_is_off_is_measured(factor: float) -> None:
    log = sound()
    for name in SPEED_COLUMNS:
        log.streams["velocity"][name] = log.streams["velocity"][name] / factor
    scales = [
        item
        for item in log.health()["findings"]
        if item["id"].startswith(("scale_off", "velocity_scale"))
    ]
    assert scales
    measured = [item["value"] + (item["id"] == "scale_off") for item in scales]
    assert measured == pytest.approx([factor] * len(scales), rel=0.1)


def test_span_of_each_stream_and_of_all_together() -> None:
    log = sound()
    t_s = log.t_s("attitude")
    log.streams["attitude"] = {
        name: values[(t_s > 12.0) & (t_s < 40.0)]
        for name, values in log.streams["attitude"].items()
    }
    health = log.health()
    attitude = health["streams"]["attitude"]
    assert (attitude["start_s"], attitude["end_s"]) == pytest.approx((12.0, 40.0), abs=0.2)
    assert health["shared_spans_s"] == [pytest.approx([12.0, 40.0], abs=0.2)]
    assert health["streams"]["imu"]["start_s"] < 1.0
    assert health["duration_s"] > 50.0


def test_a_velocity_against_the_filters_own() -> None:
    log = sound()
    SPOIL["velocity_disagrees"](log)
    assert (
        log.finding("velocity_disagrees")["text"]
        == "XKF1 moves against VELOCITY in sway (correlation -1.00)."
    )
    assert "sensors.dvl" in log.finding("velocity_disagrees")["remedy"]
    log.info["streams"]["velocity"]["source"] = "pose of mocap.csv"
    assert "sensors.pose" in log.finding("velocity_disagrees")["remedy"]
    agreeing = sound()
    other("velocity", "XKF1")(agreeing)
    assert "velocity_disagrees" not in agreeing.ids()


def test_findings_are_ranked() -> None:
    log = sound()
    for name in ("parameters_missing", "not_excited", "gyro_sign"):
        SPOIL[name](log)
    severities = [SEVERITIES.index(item["severity"]) for item in log.health()["findings"]]
    assert severities == sorted(severities)
    assert {0, 1, 2} == set(severities)


def test_measured_values() -> None:
    """The numbers on the page are those that were put in."""
    values = {
        "attitude_disagrees": (35.0, 0.5),  # deg
        "held_samples": (0.75, 0.02),
        "gyro_scale": (56.3, 0.6),
        "gyro_bias": (0.04, 0.002),  # rad/s
        "gyro_lag": (0.12, 0.02),  # s
        "gap": (4.0, 0.3),  # s
        "attitude_jumps": (np.degrees(1.0), 3.0),  # deg
        "accelerometer_direction": (
            180.0,
            1.0,
        ),  # deg, attitude and accelerometer agree within their noise
        "accelerometer_tilt": (8.0, 0.3),  # deg
        "stuck_sensor": (5.0, 0.3),  # s
        "low_actuator_rate": (2.0, 0.01),  # Hz
    }
    for name, (value, tolerance) in values.items():
        log = sound()
        SPOIL[name](log)
        finding = next(item for item in log.health()["findings"] if item["id"] == name)
        assert finding["value"] == pytest.approx(value, abs=tolerance), name


def test_a_shared_gap_is_one_finding_and_a_signal_that_steps_by_its_resolution_is_not_held() -> (
    None
):
    log = sound()
    SPOIL["gap"](log)
    assert "imu, attitude, depth, velocity, actuators and battery" in log.finding("gap")["text"]
    assert {"imu", "attitude"} & {
        item["stream"] for item in log.health()["findings"] if item["id"] == "gap"
    } == set()
    still = sound()
    random = np.random.default_rng(5)
    for name in ("phi_rad", "theta_rad", "psi_rad"):
        still.streams["attitude"][name] = np.radians(
            0.01 * np.round(random.uniform(0.0, 1.2, still.t_s("attitude").size))
        )
    assert "held_samples" not in still.ids()


def test_what_cannot_run_is_said_with_the_reason() -> None:
    log = sound()
    del log.streams["velocity"]
    reasons = {
        item["name"]: (item["possible"], item["reason"]) for item in log.health()["capabilities"]
    }
    assert reasons["fuse (kinematic)"] == (False, "no velocity")
    assert reasons["fuse (thesis)"] == (
        False,
        "no velocity",
    ), "the accelerometer's bias is found against a velocity"
    assert reasons["fuse (smoother)"] == (False, "no velocity")
    assert not reasons["synthesise surge"][0]
    assert log.health()["verdict"] == "No force model can be fitted: no velocity."
    SPOIL["no_actuation"](log)
    assert log.health()["verdict"] == "No force model can be fitted: no velocity; no actuator acts."


def test_short_pieces_cannot_be_resampled() -> None:
    log = sound()
    keep = log.t_s("imu") % 6.0 < 3.0
    log.keep("imu", keep)
    (reason,) = (
        item["reason"] for item in log.health()["capabilities"] if item["name"] == "resample"
    )
    assert reason == "all sensors together cover 3.0 s at most, 5 s are needed"


def test_thrusters_come_from_the_vehicle_file_then_from_parameters() -> None:
    log = sound()
    log.streams["actuators"]["pwm_10_us"] = np.full(log.t_s("actuators").size, 1900.0)
    assert "outputs_saturated" not in log.ids()
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    thrusters = document["actuators"]["thrusters"]
    for key in ("position", "axis", "direction"):
        thrusters[key]["value"] = thrusters[key]["value"][:3]
    log.vehicle = vehicle_from_document(
        {**document, "actuators": {"thrusters": {**thrusters, "outputs": [1, 2, 10]}}}
    )
    assert "output 10 in 100 %" in log.finding("outputs_saturated")["text"]
    log.vehicle = None
    log.info["parameters"] |= {"SERVO1_FUNCTION": 33.0, "SERVO10_FUNCTION": 34.0}
    assert "output 10 in 100 %" in log.finding("outputs_saturated")["text"]


def test_streams_are_listed_with_what_else_is_there() -> None:
    log = sound()
    SPOIL["unaided_velocity"](log)
    stream = log.health()["streams"]["velocity"]
    assert stream["refused"] == ["XKF1"]
    assert stream["rate_hz"] == pytest.approx(8.0)
    assert stream["jitter_s"] == pytest.approx(0.0, abs=1e-9)


def test_duration_counts_from_the_first_record() -> None:
    log = sound()
    assert log.health()["duration_s"] == LENGTH_S
    assert int(micro(np.zeros(1))[0]) == FIRST_US


def test_a_leg_over_a_stretch_by_hand_is_named() -> None:
    log = sound()
    _carried(log)
    assert "0 to 12 s" in log.finding("moved_by_hand")["text"]
    tables = {name: make_table(name, columns) for name, columns in log.streams.items()}
    columns = {name: [] for name in ("stream", "reason", "count", "bytes", "first", "last")}
    recorded = CheckedLog(
        tables, LogInfo.model_validate(log.info), make_table("dropped", columns), log.vehicle
    )
    before, after = legs(
        recorded, [{"id": "a", "start_s": 5.0}, {"id": "b", "start_s": 16.0, "end_s": 30.0}]
    )
    assert before["unusable"] == ["5 to 12 s moved by hand"]
    assert after["unusable"] == []


def test_the_height_of_a_pose_is_no_depth_above_water() -> None:
    """Its zero is where the tracking system stands, not the surface."""
    log = sound()
    SPOIL["depth_above_water"](log)
    assert "depth_above_water" in log.every_id()
    log.info["streams"]["depth"] = {"source": "pose of run.csv"}
    assert "depth_above_water" not in log.every_id()


def test_a_depth_that_is_mapped_to_the_position_too_does_not_hide_its_sign() -> None:
    log = sound()
    SPOIL["depth_above_water"](log)
    columns = log.streams["depth"]
    level = np.zeros(columns["depth_m"].size)
    log.streams["position"] = {
        "time_us": columns["time_us"],
        "x_m": level,
        "y_m": level,
        "z_m": columns["depth_m"],
    }
    for name in ("depth", "position"):
        log.info["streams"][name] = {"source": "run.csv"}
    assert {"depth_above_water", "depth_sign"} <= log.every_id()


def test_a_noisy_depth_in_bar_is_too_small_whatever_noise_takes_off() -> None:
    log, random = sound(), np.random.default_rng(4)
    depth = 0.1 * log.streams["depth"]["depth_m"]
    log.streams["depth"]["depth_m"] = depth + 0.01 * random.standard_normal(depth.size)
    assert "a pressure in bar" in log.finding("velocity_scale")["text"]


def test_a_heading_that_is_off_by_half_a_turn_is_no_wrong_sign_of_the_velocity() -> None:
    log = sound()
    with_track(log, 180.0)
    assert log.finding("heading_offset")["value"] == 180.0
    assert "velocity_sign" not in log.ids()


@pytest.mark.parametrize("turned_deg", [12.0, -40.0, 90.0])
def test_a_heading_that_is_off_is_measured_against_the_track(turned_deg: float) -> None:
    log = sound()
    with_track(log, turned_deg)
    assert log.finding("heading_offset")["value"] == pytest.approx(turned_deg, abs=3.0)  # deg


@pytest.mark.parametrize(
    ("name", "words"), [("x_m", "x (north) has the wrong"), ("y_m", "y (east) has the wrong")]
)
def test_a_mirrored_track_is_named_and_nothing_else_is(name: str, words: str) -> None:
    log = sound()
    with_track(log)
    log.streams["position"][name] = -log.streams["position"][name]
    assert words in log.finding("position_axes")["text"]
    assert not {"heading_offset", "velocity_sign"} & set(log.ids())


@pytest.mark.parametrize("up", [False, True])
def test_a_velocity_over_ground_is_named_by_the_accelerometer(up: bool) -> None:
    log = sound()
    columns, attitude = log.streams["velocity"], log.streams["attitude"]
    names = ("phi_rad", "theta_rad", "psi_rad")
    angles = [
        np.interp(log.t_s("velocity"), log.t_s("attitude"), np.unwrap(attitude[name]))
        for name in names
    ]
    turn = rotation_body_to_ned(np.column_stack(angles))
    body = np.column_stack([columns[name] for name in SPEED_COLUMNS])
    ground = np.einsum("nij,nj->ni", turn, body)
    if up:
        ground = ground[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    columns |= dict(zip(SPEED_COLUMNS, ground.T, strict=True))
    finding = log.finding("velocity_axes")
    assert ("east, north, up" if up else "north, east, down") in finding["text"]
    assert "velocity_sign" not in log.ids()


@pytest.mark.parametrize("angle_deg", [8.0, -15.0])
def test_a_turned_velocity_log_is_measured_by_the_accelerometer(angle_deg: float) -> None:
    log = sound()
    turn_velocity(log, angle_deg)
    assert log.finding("velocity_turned")["value"] == pytest.approx(angle_deg, abs=1.5)  # deg
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    mounting = {"value": [0.0, 0.0, np.radians(angle_deg)], "unit": "rad", "source": "measured"}
    document["sensors"]["dvl"]["mounting"] = mounting
    log.vehicle = vehicle_from_document(document)
    assert "velocity_turned" not in log.ids()


@pytest.mark.parametrize(
    ("place", "words"), [(0, "x of the accelerometer, or pitch"), (1, "y of the accelerometer, or")]
)
def test_a_tilt_against_gravity_is_named_with_both_causes(place: int, words: str) -> None:
    log = sound()
    scaled("imu", ACCEL[place : place + 1], -1.0)(log)
    assert words in log.finding("accelerometer_axes")["text"]
    assert "velocity_sign" not in log.ids()  # a turned accelerometer is no evidence


@pytest.mark.parametrize("factor", [1e-3, 102.0])
def test_a_thrust_curve_in_another_unit_is_of_no_body(factor: float) -> None:
    log = sound()
    thrust_times(factor)(log)
    texts = [item["text"] for item in log.health()["findings"] if item["id"] == "body_size"]
    assert any("strongest thruster" in text for text in texts)


def test_a_lag_of_the_velocity_log_in_ms() -> None:
    log = sound()
    of_a_vehicle("bluerov2_heavy", "sensors", "dvl", "lag", value=150.0)(log)
    assert "may be in ms" in log.finding("body_size")["text"]


def test_outputs_that_may_as_well_be_exchanged_are_listed() -> None:
    """Nothing turns: the two thrusters of a side push alike."""
    log = sound()
    drive(log, RIGHT_ORDER)
    for name in IMU_COLUMNS:
        log.streams["imu"][name] = 1e-4 * log.streams["imu"][name]
    text = log.finding("outputs_unseen")["text"]
    assert "exchanged is not observable of" in text
    assert "2 and 3" in text


def test_an_accelerometer_that_reads_a_fifth_too_much_is_named() -> None:
    log = sound()
    scaled("imu", ACCEL, 1.2)(log)
    assert "unit or scale is wrong" in log.finding("accelerometer_convention")["remedy"]


def test_an_accelerometer_of_half_the_scale_is_sent_to_its_unit() -> None:
    log = sound()
    scaled("imu", ACCEL, 0.54)(log)
    assert "unit or scale is wrong" in log.finding("accelerometer_convention")["remedy"]


def test_without_attitude_the_unit_of_the_gyro_is_listed_as_unseen() -> None:
    log = sound()
    names = [item["name"] for item in log.health()["unseen"]]
    assert "unit, signs and axes of the gyro" not in names
    del log.streams["attitude"]
    names = [item["name"] for item in log.health()["unseen"]]
    assert "unit, signs and axes of the gyro" in names


def test_outputs_that_rest_at_another_pulse_are_not_called_restless() -> None:
    log, name = sound(), "neutral pulse of the outputs"
    drive(log, RIGHT_ORDER)
    assert name in [item["name"] for item in log.health()["unseen"]]
    _neutral_at_1560(log)
    assert name not in [item["name"] for item in log.health()["unseen"]]


def test_a_velocity_that_accelerometer_or_track_shows_is_not_listed_as_unseen() -> None:
    log = sound()
    turn, scale = "turn of the velocity log", "scale of surge and sway"
    names = " ".join(item["name"] for item in log.health()["unseen"])
    assert turn not in names
    assert "scale of surge and sway of the velocity (below 8." in names  # what noise leaves open
    for name in ACCEL:
        log.streams["imu"][name] = np.full(log.t_s("imu").size, np.nan)
    names = " ".join(item["name"] for item in log.health()["unseen"])
    assert turn in names
    assert f"{scale} of the velocity" in names
    assert f"{scale} of the velocity (below" not in names


def test_single_axes_of_the_velocity_of_another_scale_or_held_are_named() -> None:
    log = sound()
    log.streams["velocity"]["v_m_s"] = 0.7 * log.streams["velocity"]["v_m_s"]
    (item,) = [item for item in log.health()["findings"] if item["id"] == "scale_off"]
    assert item["text"].startswith("Sway of the velocity (VELOCITY) is 0.7"), item["text"]
    log = sound()
    sway = log.streams["velocity"]["v_m_s"]
    log.streams["velocity"]["v_m_s"] = sway[np.arange(sway.size) // 4 * 4]
    item = log.finding("held_samples")
    assert item["fields"] == ["v_m_s"]


def test_a_track_in_feet_is_named_as_that() -> None:
    log = sound()
    with_track(log, noise_m=0.01)
    for name in ("x_m", "y_m"):
        log.streams["position"][name] = 3.2808 * log.streams["position"][name]
    (text,) = [item["text"] for item in log.health()["findings"] if item["id"] == "scale_off"]
    assert "0.3048 would be a position in ft" in text


def test_a_mirrored_curve_needs_more_than_another_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of sound logs it explains up to .27 of what the force does."""
    root = "act by their root"
    for odds, named in (({MIRRORED: 30.0}, 0), ({MIRRORED: 45.0}, 1), ({root: 30.0}, 1)):
        monkeypatch.setattr(
            plausible_forces,
            "shape_odds",
            lambda _, odds=odds: {OWN: 100.0, MIRRORED: -9.0, **odds},
        )
        texts = [item["text"] for item in plausible_forces.shape_findings(cast(CheckedLog, None))]
        assert len(texts) == named
    assert root in texts[0]


@pytest.mark.parametrize("factor", [1.15, 1.0 / 1.15])
def test_a_velocity_of_another_scale_is_measured_by_accelerometer_and_track(factor: float) -> None:
    log = sound()
    with_track(log, noise_m=0.01)
    for name in SPEED_COLUMNS:
        log.streams["velocity"][name] = factor * log.streams["velocity"][name]
    scales = [item for item in log.health()["findings"] if item["id"] == "scale_off"]
    for words in ("the accelerometer adds up", "the track"):
        (value,) = (item["value"] for item in scales if words in item["text"])
        assert value == pytest.approx(factor - 1.0, abs=0.03)


def test_a_velocity_on_a_slow_clock_drifts_against_the_accelerometer() -> None:
    log = sound()
    stamps = log.streams["velocity"]["time_us"]
    slow = stamps[0] + 0.96 * (stamps - stamps[0])
    log.streams["velocity"]["time_us"] = slow.astype(np.int64)
    drifts = [item for item in log.health()["findings"] if item["id"] == "clock_drift"]
    assert any("behind the accelerometer" in item["text"] for item in drifts)


@pytest.mark.parametrize(
    ("keys", "value"),
    [(("X_udot",), -60.0), (("Z_wdot",), -187.0), (("M_qdot",), -1.3), (("Y_vdot",), -0.7)],
)
def test_added_mass_of_no_body(keys: tuple[str], value: float) -> None:
    log = sound()
    of_a_vehicle("bluerov2_heavy", "added_mass", *keys, value=value)(log)
    text = log.finding("added_mass_size")["text"]
    assert keys[0] in text
    assert ("inertia is too small: radii of gyration" in text) == (keys[0] == "M_qdot")


def test_an_added_mass_that_is_not_given_is_none_of_a_wrong_size() -> None:
    log = sound()
    of_a_vehicle("bluerov2_heavy", "added_mass", "Y_vdot", value=0.0)(log)
    assert "added_mass_size" not in log.ids()


def test_a_track_that_was_made_with_the_heading_tells_nothing_about_it() -> None:
    log = sound()
    with_track(log)
    assert not {"heading_offset", "heading_unseen"} & set(log.ids())
    log.info["notes"] = ["position: position is the estimate of the navigation filter, no fix"]
    assert "heading_unseen" in log.ids()


@pytest.mark.parametrize(("factor", "unit"), [(400.0 / 360.0, "grad"), (0.9, "deg")])
def test_an_attitude_in_gradians(factor: float, unit: str) -> None:
    log = sound()
    for name in ("phi_rad", "theta_rad", "psi_rad"):
        log.streams["attitude"][name] = factor * log.streams["attitude"][name]
    findings = log.finding("attitude_unit")
    assert "gradians" in findings["text"]
    assert f"unit: {unit} " in findings["remedy"]


def test_yaw_in_gradians_that_wraps_is_no_jump_of_the_attitude() -> None:
    """A slow vehicle that hardly turns about roll and pitch: the wrap tells."""
    log = sound()
    t_s = log.t_s("attitude")
    psi = 400.0 + 20.0 * np.sin(0.5 * t_s)  # gradians, across the wrap, slower than the gyro
    log.streams["attitude"]["psi_rad"] = np.radians(psi % 400.0)
    findings = log.health()["findings"]
    ids = [item["id"] for item in findings]
    assert "attitude_unit" in ids
    assert "attitude_jumps" not in ids


def test_one_axis_that_freezes_halfway_is_named() -> None:
    log = sound()
    at("velocity", 30.0, 99.0, v_m_s=0.07)(log)
    findings = log.finding("stuck_sensor")
    assert findings["fields"] == ["v_m_s"]
    assert findings["value"] == pytest.approx(30.0, abs=0.3)  # s


def test_tunnel_thrusters_that_rest_while_fins_steer_are_not_frozen() -> None:
    log = sound()
    at("actuators", 20.0, 99.0, **{f"pwm_{number}_us": 1500.0 for number in range(1, 9)})(log)
    t_s = log.t_s("actuators")
    log.streams["actuators"]["propeller_rev_s"] = 20.0 + np.sin(0.3 * t_s)
    log.streams["actuators"]["fin_s_rad"] = 0.2 * np.sin(0.4 * t_s)
    assert "outputs_frozen" not in log.ids()


def test_one_number_that_is_missing_hides_no_mistake() -> None:
    log = sound()
    log.streams["velocity"]["u_m_s"][7] = np.nan
    assert set(log.ids()) == {"command_lag", "heading_unseen"}
    walk = np.random.default_rng(2).normal(0.0, 0.04, log.t_s("depth").size).cumsum()
    log.streams["depth"]["depth_m"] = 5.0 + walk
    assert "depth_unrelated" in log.ids()


@pytest.mark.parametrize(
    ("behind", "hits", "named"), [(0.05, True, False), (0.05, False, True), (0.3, True, True)]
)
def test_a_velocity_that_is_at_rest_at_once_is_lost_unless_the_hull_hits_something(
    behind: float, hits: bool, named: bool
) -> None:
    """What goes on at another speed than rest has another velocity log."""
    log = sound()
    _stop_at_once(log, behind)
    t_s = log.t_s("imu")
    impact = np.where((t_s > 29.8) & (t_s < 30.0), (behind - 0.8) / 0.2, 0.0)
    log.streams["imu"]["accel_x_m_s2"] = log.streams["imu"]["accel_x_m_s2"] + hits * impact
    assert ("velocity_step" in log.ids()) == named
    assert "velocity_stops" not in log.ids()


def test_a_velocity_that_falls_to_rest_at_once_is_noted_where_nothing_tells_why() -> None:
    log = _without_accelerometer()
    _stop_at_once(log, 0.05)
    assert log.finding("velocity_stops")["value"] == pytest.approx(0.75, abs=0.02)  # m/s


def test_a_velocity_is_lost_where_the_depth_goes_on() -> None:
    log = _without_accelerometer()
    later = log.t_s("velocity") > 30.0
    noise = np.random.default_rng(4).normal(0.0, 0.004, (3, later.size))
    for name, reads in zip(SPEED_COLUMNS, noise, strict=True):
        log.streams["velocity"][name] = np.where(later, reads, log.streams["velocity"][name])
    assert "falls once to rest while the vehicle goes on" in log.finding("velocity_step")["text"]


def test_an_accelerometer_that_is_stuck_is_named_by_itself() -> None:
    log = sound()
    at("imu", 20.0, 35.0, accel_x_m_s2=0.1, accel_y_m_s2=0.2, accel_z_m_s2=-9.8)(log)
    assert (
        "The accelerometer (IMU) repeats one value for 15." in log.finding("stuck_sensor")["text"]
    )


@pytest.mark.parametrize("moves", [False, True])
def test_a_depth_is_stuck_where_the_velocity_moves_it(moves: bool) -> None:
    log = sound()
    from_s, until_s = 20.0, 30.0
    at("depth", from_s, until_s, depth_m=5.0)(log)
    if not moves:
        at("velocity", from_s - 1.0, until_s + 1.0, u_m_s=0.0, v_m_s=0.0, w_m_s=1e-3)(log)
    stuck = {item["stream"] for item in log.health()["findings"] if item["id"] == "stuck_sensor"}
    assert ("depth" in stuck) == moves


def test_a_heave_that_holds_its_depth_is_slow_and_not_late() -> None:
    answers = {axis: Response(lag, 0.8) for axis, lag in (("u", 0.57), ("v", 0.47), ("w", 1.18))}
    assert axis_out_of_time(answers) is None
    answers["v"] = Response(1.47, 0.8)
    answers["w"] = Response(0.6, 0.8)
    assert axis_out_of_time(answers) == ("v", pytest.approx(0.885))


def test_a_velocity_whose_samples_are_held_is_not_cut_off() -> None:
    log = sound()
    for name in SPEED_COLUMNS:
        speed = log.streams["velocity"][name]
        log.streams["velocity"][name] = speed[8 * (np.arange(speed.size) // 8)]
    assert "velocity_saturated" not in log.ids()


def test_a_depth_in_steps_as_large_as_it_moves_is_coarse() -> None:
    log = sound()
    depth = log.streams["depth"]["depth_m"]
    log.streams["depth"]["depth_m"] = 0.2 * np.round(depth / 0.2)
    assert np.unique(log.streams["depth"]["depth_m"]).size <= 3
    assert log.finding("values_coarse")["value"] == pytest.approx(0.2)  # m


def test_a_turn_of_the_inertial_unit_is_unseen_without_an_accelerometer() -> None:
    name = "turn of the inertial unit about the vertical (below 45 degrees)"
    for log, listed in ((sound(), False), (_without_accelerometer(), True)):
        assert (name in [item["name"] for item in log.health()["unseen"]]) == listed


def test_a_speed_over_ground_is_no_surge() -> None:
    log = sound()
    speeds = log.streams["velocity"]
    speeds["u_m_s"] = np.hypot(speeds["u_m_s"], speeds["v_m_s"])
    speeds["v_m_s"] = np.zeros(speeds["v_m_s"].size)
    assert "it is the size of the velocity" in log.finding("constant_signal")["text"]


def test_a_velocity_log_pitched_by_twenty_degrees_is_named_with_its_angle() -> None:
    log = sound()
    speeds, angle = log.streams["velocity"], np.radians(20.0)
    surge, heave = speeds["u_m_s"], speeds["w_m_s"]
    speeds["u_m_s"] = np.cos(angle) * surge - np.sin(angle) * heave
    speeds["w_m_s"] = np.sin(angle) * surge + np.cos(angle) * heave
    assert log.finding("tilt_offset")["value"] == pytest.approx(-20.0, abs=1.5)  # degrees


@pytest.mark.parametrize("alike", [False, True])
def test_a_depth_of_another_sensor_is_named_where_the_hull_moves_slowly(alike: bool) -> None:
    log = sound()
    t_s, t_depth = log.t_s("velocity"), log.t_s("depth")
    for name in SPEED_COLUMNS:
        log.streams["velocity"][name] = np.zeros(t_s.size)
    log.streams["velocity"]["w_m_s"] = 0.025 * np.sin(0.3 * t_s)
    noise = np.random.default_rng(5).normal(0.0, 0.004, t_depth.size)
    log.streams["depth"]["depth_m"] = 12.0 + noise - alike * np.cos(0.3 * t_depth) / 12.0
    assert ("depth_unrelated" not in log.ids()) == alike


@pytest.mark.parametrize("late_s", [0.0, 0.8])
def test_a_hull_that_answers_slowly_along_one_axis_is_no_late_velocity(late_s: float) -> None:
    """The accelerometer is as slow as the hull."""
    log = sound()

    def surge(t_s: Array) -> Array:
        return np.asarray(sum(0.1 * np.sin(w * t_s + 3.0 * w * w) for w in (0.7, 1.0, 1.4, 1.9)))

    def rate(t_s: Array) -> Array:
        return np.asarray(np.gradient(surge(t_s), t_s))

    imu, t_s, t = log.streams["imu"], log.t_s("imu"), log.t_s("actuators")
    more = surge(t_s) - velocity(t_s)[:, 0]
    of_axes = (np.gradient(more, t_s), imu["gyro_z_rad_s"] * more, -imu["gyro_y_rad_s"] * more)
    for axis, push in zip("xyz", of_axes, strict=True):
        imu[f"accel_{axis}_m_s2"] = imu[f"accel_{axis}_m_s2"] + push
    log.streams["velocity"]["u_m_s"] = surge(log.t_s("velocity") - late_s)
    log.streams["actuators"]["pwm_1_us"] = 1500.0 + 200.0 * (surge(t + 0.3) + 4.0 * rate(t + 0.3))
    findings = [i for i in log.health()["findings"] if i["id"] == "velocity_lag"]
    assert [i["fields"] for i in findings] == [["u_m_s"]] * bool(late_s)


def answering_waves(early_s: float) -> Log:
    """Return a log whose sway is that of waves, which an output answers."""
    log = sound()

    def sway(t_s: Array) -> Array:
        return np.asarray(sum(0.1 * np.sin(w * t_s + 3.0 * w * w) for w in (0.7, 1.0, 1.4, 1.9)))

    imu, t_s, t = log.streams["imu"], log.t_s("imu"), log.t_s("actuators")
    more = sway(t_s) - velocity(t_s)[:, 1]
    of_axes = (-imu["gyro_z_rad_s"] * more, np.gradient(more, t_s), imu["gyro_x_rad_s"] * more)
    for axis, push in zip("xyz", of_axes, strict=True):
        imu[f"accel_{axis}_m_s2"] = imu[f"accel_{axis}_m_s2"] + push
    log.streams["velocity"]["v_m_s"] = sway(log.t_s("velocity") + early_s)
    log.streams["actuators"]["pwm_1_us"] = 1500.0 - 200.0 * sway(t - 0.3 + early_s)
    return log


@pytest.mark.parametrize("early_s", [0.0, 1.0])
def test_a_controller_that_answers_waves_is_no_early_velocity(early_s: float) -> None:
    """The accelerometer feels the waves when the velocity shows them."""
    named = {"velocity_lag", "command_late"}
    findings = [i for i in answering_waves(early_s).health()["findings"] if i["id"] in named]
    assert [i["fields"] for i in findings] == [["v_m_s"]] * bool(early_s)


@pytest.mark.parametrize("early_s", [0.0, 1.0])
def test_a_velocity_before_its_outputs_is_early_where_the_accelerometer_says_so(
    early_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Outputs far behind the waves lead the velocity as another clock would."""

    def lag(_t_s: Array, _commands: Array, measured: list[tuple[Array, Array]]) -> float:
        of_velocity = np.median(np.diff(measured[0][0])) > 0.05
        return -0.8 if of_velocity else 0.5

    monkeypatch.setattr(output_clocks, "_lag", lag)
    log = answering_waves(0.0)
    log.streams["velocity"]["time_us"] = log.streams["velocity"]["time_us"] - int(early_s * 1e6)
    findings = log.health()["findings"]
    early = [i for i in findings if i["id"] == "velocity_lag" and "outputs -0.8 s" in i["text"]]
    assert len(early) == bool(early_s)


def test_a_steady_speed_in_coarse_steps_is_not_cut_off() -> None:
    log = sound()
    t_s = log.t_s("velocity")
    steady = np.clip(0.1 * (t_s % 20.0), 0.0, 1.0) - np.clip(0.1 * (t_s % 20.0) - 1.5, 0.0, 0.5)
    log.streams["velocity"]["u_m_s"] = 0.05 * np.round(steady / 0.05)
    assert "velocity_saturated" not in log.ids()


def test_turns_of_a_dive_that_is_logged_seldom_are_no_outliers() -> None:
    log = sound()
    t_s = log.t_s("depth")
    log.streams["depth"]["depth_m"] = 20.0 + np.abs(t_s % 20.0 - 10.0)
    log.keep("depth", np.arange(t_s.size) % 10 == 0)
    assert "depth_outliers" not in log.ids()


def _without_accelerometer() -> Log:
    log = sound()
    for name in ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"):
        log.streams["imu"][name] = np.full(log.t_s("imu").size, np.nan)
    return log


def _stop_at_once(log: Log, behind: float) -> None:
    t_s = log.t_s("velocity")
    log.streams["velocity"]["u_m_s"] = np.where(t_s < 30.0, 0.8, behind) + 0.02 * np.sin(t_s)


def test_an_attitude_that_settles_at_the_start_disagrees_with_no_gyro() -> None:
    """Of a vehicle that rests, the start alone decides how its angles turn."""
    log = sound()
    attitude, imu = log.streams["attitude"], log.streams["imu"]
    noise = np.random.default_rng(4).standard_normal
    settling = 0.6 * np.exp(-2.0 * log.t_s("attitude"))
    for angle, rate in zip(("phi_rad", "theta_rad", "psi_rad"), RATE_COLUMNS, strict=True):
        attitude[angle] = settling + 1e-4 * noise(settling.size)
        imu[rate] = 2e-3 * noise(imu[rate].size)
    assert "gyro_disagrees" not in log.every_id()


def test_without_a_velocity_commands_of_the_log_explain_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A vehicle that holds roll and pitch itself shows one motion that its thrusters make."""
    log = sound()
    drive(log, RIGHT_ORDER)
    explained = Relation((0, 1, 2), np.full(3, 0.5), 2.0, 0.0, 1.0, 0.0, 0.0, 2.0)
    monkeypatch.setattr(unrelated_commands, "relation", lambda *_: explained)
    monkeypatch.setattr(unrelated_commands, "push_responses", lambda _: iter(()))
    assert "commands_unrelated" in log.ids()
    del log.streams["velocity"]
    assert "commands_unrelated" not in log.ids()


def test_an_accelerometer_in_axes_of_the_earth_is_named() -> None:
    log = sound()
    names = [f"accel_{axis}_m_s2" for axis in "xyz"]
    turn, imu = rotation_body_to_ned(euler(log.t_s("imu"))), log.streams["imu"]
    level = np.einsum("nij,nj->ni", turn, np.column_stack([imu[name] for name in names]))
    imu |= dict(zip(names, level.T, strict=True))
    assert "are level" in log.finding("accelerometer_axes")["text"]


def test_a_hull_that_waves_tilt_is_no_accelerometer_in_axes_of_the_earth() -> None:
    """Across the slope of a wave, or on a rope, nothing of gravity is read: no tilt tells."""
    log = sound()
    without("velocity")(log)
    tilt = rotation_body_to_ned(euler(log.t_s("imu")))[:, 2]
    for index, axis in enumerate("xy"):
        log.streams["imu"][f"accel_{axis}_m_s2"] += 9.81 * tilt[:, index]
    assert "accelerometer_axes" not in log.every_id()


@pytest.mark.parametrize("axes", ["uvw", "ww"])
def test_numbers_that_are_missing_in_turn_end_no_check(axes: str) -> None:
    log = sound()
    row = np.arange(log.t_s("velocity").size)
    for turn, axis in enumerate(axes):
        log.streams["velocity"][f"{axis}_m_s"][row % 3 == turn] = np.nan
    assert set(log.ids()) == {"command_lag", "heading_unseen"}


def test_an_axis_that_is_not_measured_is_not_frozen() -> None:
    log = sound()
    at("velocity", 0.0, 99.0, v_m_s=0.0)(log)
    assert "velocity_frozen" not in log.ids()
    assert "constant_signal" in log.ids()


def driven(time_constant_s: float, early_s: float) -> Log:
    """Surge and yaw answer steps of the outputs slowly; outputs are stamped early."""
    log, random = sound(), np.random.default_rng(11)
    fine = np.arange(0.0, LENGTH_S, 0.05)
    steps = np.repeat(random.uniform(-1.0, 1.0, (2, 30)), 40, axis=1)[:, : fine.size]
    motion = np.zeros_like(steps)
    for n in range(1, fine.size):
        motion[:, n] = motion[:, n - 1] + 0.05 * (steps[:, n - 1] - motion[:, n - 1]) / (
            time_constant_s
        )
    t_u = log.t_s("actuators")
    for number in range(1, 9):
        part = np.interp(t_u, fine, steps[number % 2])
        log.streams["actuators"][f"pwm_{number}_us"] = 1500.0 + 200.0 * part
    for name in ("v_m_s", "w_m_s"):
        log.streams["velocity"][name] = 0.0 * log.streams["velocity"][name]
    t_v, t_i = log.t_s("velocity"), log.t_s("imu")
    noise = 0.01 * random.standard_normal(t_v.size)
    log.streams["velocity"]["u_m_s"] = np.interp(t_v, fine, motion[0]) + noise
    for name in IMU_COLUMNS[:2]:
        log.streams["imu"][name] = 0.0 * log.streams["imu"][name]
    log.streams["imu"][IMU_COLUMNS[2]] = 0.5 * np.interp(t_i, fine, motion[1])
    log.streams["actuators"]["time_us"] = log.streams["actuators"]["time_us"] - round(1e6 * early_s)
    return log


@pytest.mark.parametrize("time_constant_s", [3.0, 6.0])
def test_a_slow_vehicle_is_no_early_command(time_constant_s: float) -> None:
    assert "commands_early" not in driven(time_constant_s, 0.0).ids()


@pytest.mark.parametrize(("time_constant_s", "early_s"), [(0.5, 1.9), (1.0, 1.4)])
def test_commands_that_are_early_are_no_slow_vehicle(
    time_constant_s: float, early_s: float
) -> None:
    assert "commands_early" in driven(time_constant_s, early_s).ids()


def test_outputs_that_are_joined_as_the_vehicle_file_says_have_no_finding() -> None:
    log = sound()
    drive(log, tuple(range(1, 9)))
    assert not {"response_order", "response_sign", "velocity_axes"} & set(log.ids())


@pytest.mark.parametrize("name", ["bluerov2_heavy", "remus100", "thaus", "vt690", "hauv"])
def test_bundled_vehicles_have_possible_sizes(name: str) -> None:
    log = sound()
    log.vehicle = vehicle_from_document(vehicle_document(name))
    assert not {"body_size", "upside_down", "gravity_value"} & set(log.ids())


def test_moments_of_inertia_of_a_long_hull_that_are_exchanged_are_found() -> None:
    log, document = sound(), copy.deepcopy(vehicle_document("remus100"))
    entry = document["rigid_body"]["inertia"]
    entry["value"] = np.diag(np.diag(entry["value"])[::-1]).tolist()
    log.vehicle = vehicle_from_document(document)
    assert "they are exchanged" in log.finding("body_size")["text"]


def test_outputs_that_are_held_for_half_a_second_are_found() -> None:
    log = sound()
    columns = log.streams["actuators"]
    for name in columns:
        if name.startswith("pwm_"):
            moving = columns[name] + 20.0 * np.sin(0.3 * np.arange(columns[name].size))
            columns[name] = moving[np.arange(moving.size) // 5 * 5]
    assert "every 0.5 s only" in log.finding("low_actuator_rate")["text"]


def turned_log(degrees: float) -> Log:
    """Log of a driven vehicle whose velocity sensor is turned about the vertical."""
    log = sound()
    drive(log, tuple(range(1, 9)))
    angle, columns = np.radians(degrees), log.streams["velocity"]
    surge, sway = columns["u_m_s"], columns["v_m_s"]
    columns["u_m_s"] = np.cos(angle) * surge + np.sin(angle) * sway
    columns["v_m_s"] = np.cos(angle) * sway - np.sin(angle) * surge
    return log


def test_a_mounting_that_the_vehicle_file_says_is_taken_off() -> None:
    log = turned_log(45.0)
    assert "sensors.dvl" in log.finding("velocity_axes")["remedy"]
    log.info["streams"]["velocity"]["source"] = "pose of mocap.csv"
    assert "sensors.dvl" not in log.finding("velocity_axes")["remedy"]
    assert "frame of the pose" in log.finding("velocity_axes")["remedy"]
    log.info["streams"]["velocity"]["source"] = "VELOCITY"
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    document["sensors"]["dvl"]["mounting"] = {
        "value": [0.0, 0.0, 45.0], "unit": "deg", "source": "drawing", "assumed": False,
    }  # fmt: skip
    log.vehicle = vehicle_from_document(document)
    assert not {"velocity_axes", "response_sign", "response_order"} & set(log.ids())


def test_a_push_in_sway_that_is_a_small_part_of_surge_tells_no_turn() -> None:
    surge = np.random.default_rng(1).standard_normal(500)
    other = np.random.default_rng(2).standard_normal(500)
    assert pushes_apart(surge, other)
    assert not pushes_apart(surge, 0.017 * surge)
    assert not pushes_apart(surge, 0.1 * other)
    assert not pushes_apart(surge, -0.8 * surge + 0.01 * other)
    assert not pushes_apart(surge, 0.0 * surge)


@pytest.mark.parametrize("source", ["fixes of run.csv", "pose of run.csv"])
def test_a_velocity_that_was_made_with_the_heading_tells_nothing_about_it(source: str) -> None:
    log = sound()
    with_track(log, 25.0)
    assert "heading_offset" in log.ids()
    log.info["streams"]["velocity"] = {"source": source}
    findings = log.ids()
    assert "heading_offset" not in findings
    assert "heading_unseen" in findings


def test_a_low_centre_of_buoyancy_stops_no_vehicle_without_actuators() -> None:
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    document["rigid_body"]["centre_of_buoyancy"]["value"] = [0.0, 0.0, 0.02]
    document["actuators"] = {}
    log = sound()
    log.vehicle = vehicle_from_document(document)
    findings = log.ids()
    assert "buoyancy_low" in findings
    assert "upside_down" not in findings


@pytest.mark.parametrize("name", ["velocity_unsigned", "velocity_frozen"])
def test_one_sided_and_steady_speeds_stop_no_run(name: str) -> None:
    assert not checks()[name].stops
    assert checks()[name].severity == "warning"


@pytest.mark.parametrize(("axis", "factor"), [(0, 0.01), (2, 60.0)])
def test_one_moment_of_inertia_that_does_not_fit_is_found(axis: int, factor: float) -> None:
    log = sound()
    log.vehicle = vehicle_from_document(vehicle_document("bluerov2_heavy"))
    inertia = log.vehicle.inertia.copy()
    inertia[axis, axis] *= factor
    log.vehicle = replace(log.vehicle, inertia=inertia)
    assert "body_size" in log.ids()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (("rigid_body", "inertia"), "largest radius of gyration"),
        (("actuators", "thrusters", "position"), "distance of the thrusters"),
    ],
)
def test_a_tenth_of_inertia_or_of_arms_is_found(keys: tuple[str, ...], words: str) -> None:
    log, entry = sound(), vehicle_document("bluerov2_heavy")
    document = copy.deepcopy(entry)
    part: Any = document
    for key in keys:
        part = part[key]
    part["value"] = (0.1 * np.array(part["value"])).tolist()
    log.vehicle = vehicle_from_document(document)
    texts = [item["text"] for item in log.health()["findings"] if item["id"] == "body_size"]
    assert any(words in text for text in texts)


@pytest.mark.parametrize("sensor", ["dvl", "imu"])
def test_an_arm_in_millimetres_is_found(sensor: str) -> None:
    log = sound()
    log.vehicle = vehicle_from_document(vehicle_document("bluerov2_heavy"))
    place = replace(getattr(log.vehicle, sensor), arm_m=np.array([-120.0, 0.0, 60.0]))
    log.vehicle = replace(log.vehicle, **{sensor: place})
    (finding,) = [item for item in log.health()["findings"] if item["id"] == "body_size"]
    assert "arm of the" in finding["text"]


def test_noise_of_a_level_hull_turns_no_axis_of_the_gyro() -> None:
    """Roll and pitch are noise that the gyro has not: of other axes it has no more."""
    t_s = np.arange(0.0, 300.0, 0.1)
    for seed in range(3):
        noise = np.random.default_rng(seed).standard_normal((2, len(t_s), 3))
        assert not list(_quiet_axes(t_s, 0.01 * noise[0], (t_s, 0.05 * noise[1])))


def test_a_turned_velocity_needs_half_a_minute_of_outputs(monkeypatch: pytest.MonkeyPatch) -> None:
    log = sound()
    drive(log, RIGHT_ORDER)
    cos, sin = np.cos(np.pi / 4.0), np.sin(np.pi / 4.0)
    speed = log.streams["velocity"]
    surge, sway = speed["u_m_s"].copy(), speed["v_m_s"].copy()
    speed["u_m_s"], speed["v_m_s"] = cos * surge + sin * sway, cos * sway - sin * surge
    assert "velocity_axes" in log.ids()
    monkeypatch.setattr(push_answers, "FEWEST_OF_TURNED", 200)
    assert "velocity_axes" not in log.ids()
