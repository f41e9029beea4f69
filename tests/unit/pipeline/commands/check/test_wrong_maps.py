"""Wrong column maps and manifests over a small healthy campaign: each is refused, stops
the run or is named with its cause before anything is fitted; the healthy one is not.

The log is that of the example that `auvid new` makes, and for the accelerometer the
start of the dive of campaign bluerov2_dvl_csv; docs/checks.md holds the table.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from scipy.spatial.transform import Rotation

from auvid.data_schemas.checks import checks, mistakes
from auvid.data_schemas.errors import PipelineError
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.checks.sign_change import SignChange
from auvid.hydro.identification.signals.pose.frames import (
    euler_of_quaternion,
    quaternion_of_euler,
)
from auvid.pipeline.campaigns.vehicle_files import load_vehicle
from auvid.pipeline.commands.new import new_example
from auvid.pipeline.commands.new.new_example import example_log
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog
from auvid.stages.ingest.health.agreement import sign_changes
from auvid.stages.ingest.health.causes import OF_MOTION

ROOT = Path(__file__).resolve().parents[5]
TEMPLATES = ROOT / "pipeline" / "templates"
DIVE = ROOT / "campaigns" / "bluerov2_dvl_csv"
DIVE_S = 60.0
Values = dict[str, npt.NDArray[np.float64]]


@dataclass
class Case:
    """A log as columns of one or more files, and their column maps, to be spoiled."""

    files: dict[str, Values]
    maps: dict[str, dict[str, Any]]
    vehicle: Vehicle
    formats: dict[str, str] = field(default_factory=dict)

    def entry(self, name: str) -> dict[str, Any]:
        """The entry of a column in its map."""
        return next(
            item for map_ in self.maps.values() for item in map_["columns"] if item["field"] == name
        )

    def values(self, name: str) -> tuple[Values, str]:
        """The file that holds the values of a field, and their column in it."""
        for file, map_ in self.maps.items():
            for item in map_["columns"]:
                if item["field"] == name:
                    return self.files[file], item["column"]
        raise KeyError(name)

    def findings(self) -> list[dict[str, Any]]:
        """The findings of the log, or what reading it raises."""
        raw = tuple(
            RawFile(name, np.frombuffer(_csv(values), np.uint8), self.maps[name])
            for name, values in self.files.items()
        )
        inputs = ingest.Inputs(RawLog("log", raw), None, self.vehicle)
        rows: list[dict[str, Any]] = ingest.run(inputs, ingest.Params()).health["findings"]
        return rows


def _csv(values: Values) -> bytes:
    return _text(tuple(values), np.column_stack(list(values.values())).tobytes())


@cache  # most mistakes leave most files as they are
def _text(names: tuple[str, ...], cells: bytes) -> bytes:
    table = np.frombuffer(cells).reshape(-1, len(names))
    rows = "\n".join(",".join(f"{cell:.9g}" for cell in row) for row in table.tolist())
    return f"{','.join(names)}\n{rows}\n".encode()


@cache
def _example() -> Case:
    vehicle = load_vehicle(TEMPLATES / "vehicles/example_rov.yaml").vehicle
    names, *rows = example_log(vehicle).decode().splitlines()
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    columns = dict(zip(names.split(","), table.T, strict=True))
    text = (TEMPLATES / "campaigns/example/columns/synthetic_run.yaml").read_text(encoding="utf-8")
    return Case({"run.csv": columns}, {"run.csv": yaml.safe_load(text)}, vehicle)


@cache
def _dive(until_s: float = DIVE_S) -> Case:
    files, maps = {}, {}
    for path in sorted((DIVE / "logs").glob("*.csv")):
        names, *rows = path.read_text(encoding="utf-8").splitlines()
        table = np.array([[float(cell or "nan") for cell in row.split(",")] for row in rows])
        table = table[table[:, 0] < until_s]
        files[path.name] = dict(zip(names.split(","), table.T, strict=True))
        text = (DIVE / "columns" / f"{path.stem}.yaml").read_text(encoding="utf-8")
        maps[path.name] = yaml.safe_load(text)
    vehicle = load_vehicle(ROOT / "vehicles/bluerov2_heavy.yaml").vehicle
    return Case(files, maps, vehicle)


Change = Callable[[Case], None]
GYRO = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
ACCEL = ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2")
ANGLES = ("phi_rad", "theta_rad", "psi_rad")
SPEED = ("u_m_s", "v_m_s", "w_m_s")
ADDED = ("X_udot", "Y_vdot", "Z_wdot", "K_pdot", "M_qdot", "N_rdot")
PULSES = tuple(f"pwm_{number}_us" for number in range(1, 5))


def unit(text: str, *names: str) -> Change:
    """The map declares this unit."""

    def change(case: Case) -> None:
        for name in names:
            case.entry(name)["unit"] = text

    return change


def sign(*names: str) -> Change:
    """The map turns these fields."""

    def change(case: Case) -> None:
        for name in names:
            entry = case.entry(name)
            entry["sign"] = -entry.get("sign", 1)

    return change


def frame(text: str, *names: str) -> Change:
    """The map declares this frame."""

    def change(case: Case) -> None:
        for name in names:
            case.entry(name)["frame"] = text

    return change


def exchanged(one: str, other: str) -> Change:
    """The map takes each of two columns for the other."""

    def change(case: Case) -> None:
        first, second = case.entry(one), case.entry(other)
        first["column"], second["column"] = second["column"], first["column"]

    return change


def data(change: Callable[[npt.NDArray[np.float64]], Any], *names: str) -> Change:
    """The file holds something else than the map says."""

    def spoil(case: Case) -> None:
        for name in names:
            values, column = case.values(name)
            values[column] = change(values[column])

    return spoil


def time(text: str) -> Change:
    """The maps declare this unit of time."""

    def change(case: Case) -> None:
        for map_ in case.maps.values():
            map_["time"]["unit"] = text

    return change


def late(seconds: float, *names: str) -> Change:
    """Values were written so much later than they were measured."""

    def change(case: Case) -> None:
        for name in names:
            values, column = case.values(name)
            t = next(iter(values.values()))
            values[column] = np.interp(t - seconds, t, values[column])

    return change


def slow(rate: float, *names: str) -> Change:
    """Values were stamped by a clock that counts so many seconds in one."""

    def change(case: Case) -> None:
        for name in names:
            values, column = case.values(name)
            t = next(iter(values.values()))
            values[column] = np.interp(t[0] + rate * (t - t[0]), t, values[column])

    return change


def changes_sign(*names: str) -> Change:
    """Values have the other sign from the middle of the log on."""

    def change(case: Case) -> None:
        for name in names:
            values, column = case.values(name)
            t = next(iter(values.values()))
            values[column] = np.where(t > 0.5 * (t[0] + t[-1]), -1.0, 1.0) * values[column]

    return change


def frozen(case: Case) -> None:
    values, _ = case.values("u_m_s")
    for name in ("u", "v", "w"):
        values[name] = np.where(np.arange(900) > 500, values[name][500], values[name])


def other_dive(case: Case) -> None:
    """The commands are those of another dive: these, the last first."""
    for name in PULSES if len(case.files) == 1 else tuple(f"pwm_{n}_us" for n in range(1, 9)):
        values, column = case.values(name)
        values[column] = values[column][::-1].copy()


def reordered_quaternion(*order: int) -> Change:
    """The attitude of a quaternion w, x, y, z whose parts are taken in this order."""

    def change(case: Case) -> None:
        entries = [case.values(name) for name in ANGLES]
        angles = np.radians(np.column_stack([values[column] for values, column in entries]))
        turned = euler_of_quaternion(quaternion_of_euler(angles)[:, order])
        for (values, column), angle in zip(entries, np.degrees(turned).T, strict=True):
            values[column] = angle

    return change


def no_bottom(number: float) -> Change:
    """The velocity log writes a number where it sees no bottom, in one of fifty samples."""

    def change(case: Case) -> None:
        for name in SPEED:
            values, column = case.values(name)
            values[column] = np.where(
                np.arange(len(values[column])) % 50 == 7, number, values[column]
            )

    return change


def placeholder_of(number: float, *names: str) -> Change:
    """The recorder writes a number in one of fifty samples that it misses."""

    def change(case: Case) -> None:
        for name in names:
            values, column = case.values(name)
            there = np.arange(len(values[column])) % 50 == 7
            values[column] = np.where(there, number, values[column])

    return change


def thrust_in(factor: float) -> Change:
    """The thrust curve is in another unit."""

    def change(case: Case) -> None:
        document = case.vehicle.document.model_dump(mode="python", exclude_none=True)
        entry = document["actuators"]["thrusters"]["thrust_curve"]["force"]
        entry["value"] = (factor * np.array(entry["value"], dtype=float)).tolist()
        case.vehicle = vehicle_from_document(document)

    return change


def curve_of(change: Callable[[dict[str, Any]], None]) -> Change:
    """The vehicle file has another thrust curve."""

    def spoil(case: Case) -> None:
        document = case.vehicle.document.model_dump(mode="python", exclude_none=True)
        change(document["actuators"]["thrusters"]["thrust_curve"])
        case.vehicle = vehicle_from_document(document)

    return spoil


def mirrored(curve: dict[str, Any]) -> None:
    """Forces ahead and astern are exchanged."""
    curve["force"]["value"] = [-force for force in curve["force"]["value"][::-1]]
    curve["pulse_width"]["value"] = [3000.0 - at for at in curve["pulse_width"]["value"][::-1]]


def in_milliseconds(curve: dict[str, Any]) -> None:
    """The pulses of the curve are in ms."""
    curve["pulse_width"]["value"] = [at / 1000.0 for at in curve["pulse_width"]["value"]]


def shaped(power: float, *names: str) -> Change:
    """Outputs are logged before, or behind, a power of the command."""

    def curved(pulse: npt.NDArray[np.float64]) -> Any:
        command = (pulse - 1500.0) / 400.0
        return 1500.0 + 400.0 * np.sign(command) * np.abs(command) ** power

    return data(curved, *names)


def water_track(case: Case) -> None:
    """From the middle on the velocity log sees the water, which flows north."""
    values = case.files["run.csv"]
    later = np.arange(values["u"].size) > values["u"].size // 2
    yaw = np.radians(values["yaw_deg"])
    values["u"] = values["u"] - 0.3 * later * np.cos(yaw)
    values["v"] = values["v"] + 0.3 * later * np.sin(yaw)


def gyro_turned(case: Case) -> None:
    """The gyro is mounted turned by 90 degrees about the vertical."""
    values, column = case.values(GYRO[0])
    others, other = case.values(GYRO[1])
    values[column], others[other] = -others[other], values[column].copy()


def taken_twice(one: str, other: str) -> Change:
    """Two fields are mapped to one column."""

    def change(case: Case) -> None:
        case.entry(other)["column"] = case.entry(one)["column"]

    return change


def stopped(*names: str) -> Change:
    """Half of the record holds its last value."""

    def change(case: Case) -> None:
        for name in names:
            values, column = case.values(name)
            frozen = values[column][len(values[column]) // 2]
            values[column] = np.where(
                np.arange(len(values[column])) > len(values[column]) // 2, frozen, values[column]
            )

    return change


def other_clock(case: Case) -> None:
    case.files["velocity.csv"]["time_s"] = case.files["velocity.csv"]["time_s"] + 1.7e6


def over_ground(case: Case) -> None:
    """The velocity is north, east, down."""
    phi, theta, psi = (np.radians(values[column]) for values, column in map(case.values, ANGLES))
    turn = rotation_body_to_ned(np.stack([phi, theta, psi], axis=1))
    body = np.stack([values[column] for values, column in map(case.values, SPEED)], axis=1)
    for name, speed in zip(SPEED, np.einsum("nij,nj->in", turn, body), strict=True):
        values, column = case.values(name)
        values[column] = speed


def clock_digits(case: Case) -> None:
    """The time column is 101530.25 for 10:15:30.25."""
    for values in case.files.values():
        name = next(iter(values))
        t = 36_930.25 + values[name]
        values[name] = t // 3600 * 1e4 + t // 60 % 60 * 100 + t % 60


def frozen_sway(case: Case) -> None:
    values, column = case.values("v_m_s")
    values[column] = np.where(np.arange(900) > 500, values[column][500], values[column])


def vehicle(*keys: str, factor: float, of: str = "rigid_body") -> Change:
    """The vehicle file has these numbers times a factor."""

    def change(case: Case) -> None:
        document = case.vehicle.document.model_dump(mode="python", exclude_none=True)
        for key in keys:
            entry = document[of][key] if of != "thrusters" else document["actuators"][of][key]
            entry["value"] = (factor * np.array(entry["value"], dtype=float)).tolist()
        case.vehicle = vehicle_from_document(document)

    return change


def places_exchanged(case: Case) -> None:
    """The vehicle file has x and y of the thrusters' positions exchanged."""
    document = case.vehicle.document.model_dump(mode="python", exclude_none=True)
    entry = document["actuators"]["thrusters"]["position"]
    entry["value"] = np.array(entry["value"], dtype=float)[:, [1, 0, 2]].tolist()
    case.vehicle = vehicle_from_document(document)


def arm_of_log(x: float, y: float) -> Change:
    """The vehicle file has the velocity log here."""

    def change(case: Case) -> None:
        document = case.vehicle.document.model_dump(mode="python", exclude_none=True)
        document["sensors"]["dvl"]["arm"]["value"] = [x, y, 0.0]
        case.vehicle = vehicle_from_document(document)

    return change


def shifted(case: Case) -> None:
    """Each output column is taken for the next."""
    entries = [case.entry(name) for name in PULSES]
    columns = [entry["column"] for entry in entries]
    for entry, column in zip(entries, columns[1:] + columns[:1], strict=True):
        entry["column"] = column


def in_order(*numbers: int) -> Change:
    """Each output is taken from the column of another."""

    def change(case: Case) -> None:
        entries = [case.entry(f"pwm_{number}_us") for number in range(1, 9)]
        columns = [entry["column"] for entry in entries]
        for entry, number in zip(entries, numbers, strict=True):
            entry["column"] = columns[number - 1]

    return change


def turned_velocity(degrees: float | None) -> Change:
    """The velocity in axes turned about the vertical; None: by the heading."""

    def change(case: Case) -> None:
        (first, u), (other, v) = case.values("u_m_s"), case.values("v_m_s")
        values, psi = case.values("psi_rad")
        angle = np.radians(values[psi] if degrees is None else degrees)
        surge, sway = first[u].copy(), other[v].copy()
        first[u] = np.cos(angle) * surge - np.sin(angle) * sway
        other[v] = np.sin(angle) * surge + np.cos(angle) * sway

    return change


def along_beams(*azimuths: float, tilt: float = 22.5) -> Change:
    """The velocity along three beams [deg from ahead, and from the vertical]."""

    def change(case: Case) -> None:
        body = [values[column].copy() for values, column in map(case.values, SPEED)]
        for name, azimuth in zip(SPEED, np.radians(azimuths), strict=True):
            values, column = case.values(name)
            across = np.cos(azimuth) * body[0] + np.sin(azimuth) * body[1]
            values[column] = np.sin(np.radians(tilt)) * across + np.cos(np.radians(tilt)) * body[2]

    return change


def sampled_at(hertz: float, *names: str) -> Change:
    """A log of 10 Hz holds values that come more slowly."""

    def change(values: npt.NDArray[np.float64]) -> Any:
        rows = np.arange(len(values))
        return values[rows - rows % round(10.0 / hertz)]

    return data(change, *names)


def seconds_of_zeros(case: Case) -> None:
    """The velocity log writes 0 where it sees no bottom, for six seconds at a time."""
    for name in SPEED:
        values, column = case.values(name)
        t = values["time_s"]
        lost = ((t >= 20.0) & (t < 26.0)) | ((t >= 50.0) & (t < 56.0))
        values[column] = np.where(lost, 0.0, values[column])


def late_heading(case: Case) -> None:
    values, column = case.values("psi_rad")
    t = values["time_s"]
    heading = np.unwrap(np.radians(values[column]))
    values[column] = np.degrees(np.interp(t - 0.5, t, heading))


def order_zxy(case: Case) -> None:
    """The angles are those of turns about z, x and y."""
    entries = [case.values(name) for name in ANGLES]
    angles = np.column_stack([values[column] for values, column in reversed(entries)])
    turned = Rotation.from_euler("ZYX", angles, degrees=True).as_euler("ZXY", degrees=True)
    for (values, column), angle in zip(entries, turned[:, [1, 2, 0]].T, strict=True):
        values[column] = angle


def inverse_attitude(case: Case) -> None:
    """The rotation goes from the earth to the body."""
    entries = [case.values(name) for name in ANGLES]
    angles = np.column_stack([values[column] for values, column in reversed(entries)])
    turned = Rotation.from_euler("ZYX", angles, degrees=True).inv().as_euler("ZYX", degrees=True)
    for (values, column), angle in zip(entries, turned.T[::-1], strict=True):
        values[column] = angle


def in_millivolts(case: Case) -> None:
    values = case.files["run.csv"]
    values["battery"] = 15_900.0 - 8.0 * values["time_s"]
    entry = {"column": "battery", "stream": "battery", "field": "voltage_v", "unit": "V"}
    case.maps["run.csv"]["columns"].append(entry)


def in_minutes(case: Case) -> None:
    for values in case.files.values():
        values[next(iter(values))] /= 60.0


def both(*changes: Change) -> Change:
    """Several mistakes at once."""

    def spoil(case: Case) -> None:
        for change in changes:
            change(case)

    return spoil


def limited(rate_s: float) -> Change:
    """The pulses are those behind a limiter: they change by no more than so many us/s."""

    def change(case: Case) -> None:
        for name in PULSES:
            values, column = case.values(name)
            most = rate_s * np.diff(values["time_s"], prepend=values["time_s"][0])
            pulses = values[column].copy()
            for row in range(1, pulses.size):
                step = np.clip(pulses[row] - pulses[row - 1], -most[row], most[row])
                pulses[row] = pulses[row - 1] + step
            values[column] = pulses

    return change


def misspelt(key: str, value: str, name: str) -> Change:
    def change(case: Case) -> None:
        case.entry(name)[key] = value

    return change


EXAMPLE: dict[str, tuple[Change, str, str]] = {
    "gyro in rad/s declared deg/s": (unit("deg/s", *GYRO), "gyro_scale", "rad/s"),
    "gyro in deg/s declared rad/s": (data(np.degrees, *GYRO), "gyro_scale", "deg/s"),
    "gyro p turned": (sign(GYRO[0]), "gyro_sign", "Gyro x"),
    "gyro q turned": (sign(GYRO[1]), "gyro_sign", "Gyro y"),
    "gyro r turned": (sign(GYRO[2]), "gyro_sign", "Gyro z"),
    "gyro of a forward-right-down unit declared flu": (
        frame("flu", *GYRO),
        "gyro_sign",
        "pitch and yaw",
    ),
    "gyro p and q exchanged": (exchanged(GYRO[0], GYRO[1]), "gyro_axes", "Roll"),
    "gyro q and r exchanged": (exchanged(GYRO[1], GYRO[2]), "gyro_axes", "Yaw"),
    "gyro 0.4 s late": (late(0.4, *GYRO), "gyro_lag", "gyro comes 0.4"),
    "attitude in degrees declared rad": (unit("rad", *ANGLES), "attitude", "degrees"),
    "yaw alone in degrees declared rad": (unit("rad", ANGLES[2]), "attitude_unit", "yaw"),
    "attitude in rad declared degrees": (
        data(np.radians, *ANGLES),
        "attitude_unit",
        "declared as degrees",
    ),
    "yaw alone in rad declared degrees": (
        data(np.radians, ANGLES[2]),
        "attitude_unit",
        "declared as degrees",
    ),
    "roll and pitch in rad declared degrees": (
        data(np.radians, *ANGLES[:2]),
        "attitude_unit",
        "roll and pitch",
    ),
    "attitude declared flu": (frame("flu", *ANGLES), "gyro_sign", "pitch"),
    "roll and pitch exchanged": (exchanged(*ANGLES[:2]), "gyro_axes", "Roll"),
    "yaw declared enu": (frame("enu", ANGLES[2]), "gyro_sign", "yaw"),
    "depth turned": (sign("depth_m"), "depth_sign", "Depth"),
    "depth in cm declared m": (data(lambda z: 100.0 * z, "depth_m"), "velocity_scale", "in cm"),
    "depth in m declared ft": (unit("ft", "depth_m"), "velocity_scale", "declared as ft"),
    "depth in m declared cm": (unit("cm", "depth_m"), "velocity_scale", "declared as cm"),
    "depth that counts half": (data(lambda z: 0.5 * z, "depth_m"), "velocity_scale", "counts half"),
    "velocity in mm/s declared m/s": (
        data(lambda u: 1000.0 * u, *SPEED),
        "stream 'velocity'",
        "mm/s",
    ),
    "velocity in cm/s declared m/s": (data(lambda u: 100.0 * u, *SPEED), "", "cm/s"),
    "velocity in m/s declared cm/s": (unit("cm/s", *SPEED), "velocity_scale", "declared as cm/s"),
    "velocity in knots declared m/s": (
        data(lambda u: u / 0.5144, *SPEED),
        "velocity_scale",
        "knots",
    ),
    "sway and heave turned": (frame("flu", *SPEED), "velocity_sign", "Heave"),
    "surge turned": (sign(SPEED[0]), "velocity_sign", "Surge"),
    "surge turned from the middle on": (changes_sign(SPEED[0]), "sign_changes", "Surge of the"),
    "gyro r turned from the middle on": (changes_sign(GYRO[2]), "sign_changes", "Gyro z (or yaw"),
    "sway turned": (sign(SPEED[1]), "velocity_sign", "Sway"),
    "heave turned": (sign(SPEED[2]), "velocity_sign", "Heave"),
    "surge and sway exchanged": (exchanged(*SPEED[:2]), "velocity_", "velocity"),
    "velocity 1 s late": (late(1.0, *SPEED), "velocity_lag", "velocity comes 1.0"),
    "commands 1 s late": (late(1.0, *PULSES), "command_late", "before"),
    "velocity frozen": (frozen, "stuck_sensor", "repeats one value"),
    "time in s declared ms": (time("ms"), "time_unit", "declared as ms"),
    "time in s declared us": (time("us"), "repeated", "declared as us"),
    "time in ms declared s": (
        data(lambda t: 1e3 * t, "t"),
        "time_unit",
        "in ms, declared as s",
    ),
    "time in us declared s": (
        data(lambda t: 1e6 * t, "t"),
        "time_unit",
        "in us, declared as s",
    ),
    "commands of -1 to 1 as pulses": (
        data(lambda pulse: (pulse - 1500.0) / 400.0, *PULSES),
        "actuators",
        "no pulses",
    ),
    "commands of 0 to 1 as pulses": (
        data(lambda pulse: (pulse - 1100.0) / 800.0, *PULSES),
        "output_range",
        "Output 1",
    ),
    "pulses around zero": (data(lambda pulse: pulse - 1500.0, *PULSES), "actuators", "no pulses"),
    "pulses turned": (
        data(lambda pulse: 3000.0 - pulse, *PULSES),
        "response_sign",
        "All outputs act the other way round",
    ),
    "field misspelt": (
        misspelt("field", "roll_rad", "phi_rad"),
        "phi_rad",
        "Did you mean 'phi_rad'?",
    ),
    "stream misspelt": (misspelt("stream", "attitud", "phi_rad"), "attitude", "Did you mean"),
    "unit misspelt": (misspelt("unit", "degre", "phi_rad"), "degre", "unit of rad"),
    "no such column": (misspelt("column", "roll", "phi_rad"), "roll_deg", "Did you mean"),
    "gyro in turns per minute": (
        data(lambda p: 60.0 * p / (2.0 * np.pi), *GYRO),
        "gyro_scale",
        "turns per minute",
    ),
    "gyro at half scale": (data(lambda p: 0.5 * p, *GYRO), "gyro_scale", "0.5"),
    "yaw as a bearing from east": (data(lambda psi: 90.0 - psi, ANGLES[2]), "gyro_sign", "yaw"),
    "attitude 0.5 s late": (late(0.5, *ANGLES), "gyro_lag", "attitude comes 0.5"),
    "attitude and gyro both flu": (
        both(frame("flu", *ANGLES), frame("flu", *GYRO)),
        "response_sign",
        "forward, left, up",
    ),
    "depth in fathoms": (data(lambda z: z / 1.8288, "depth_m"), "velocity_scale", "fathoms"),
    "pressure in kPa as depth": (
        data(lambda z: 101.3 + 10.05 * z, "depth_m"),
        "velocity_scale",
        "kPa",
    ),
    "altitude over ground as depth": (
        data(lambda z: 20.0 - z, "depth_m"),
        "depth_sign",
        "goes up",
    ),
    "depth 2 s late": (late(2.0, "depth_m"), "velocity_lag", "depth comes 2.0"),
    "velocity in km/h declared m/s": (
        data(lambda u: 3.6 * u, *SPEED),
        "velocity_scale",
        "km/h",
    ),
    "velocity of the water past the hull": (
        sign(*SPEED),
        "velocity_sign",
        "past the hull",
    ),
    "velocity over ground as body velocity": (over_ground, "velocity_axes", "over ground"),
    "velocity held at 1 Hz": (sampled_at(1.0, *SPEED), "velocity_lag", "(held_samples)"),
    "battery in mV declared V": (in_millivolts, "stream 'battery'", "mV"),
    "three beams of four as body velocity": (
        along_beams(0.0, 180.0, 90.0),
        "velocity_axes",
        "along beams",
    ),
    "surge and heave exchanged": (exchanged(SPEED[0], SPEED[2]), "velocity_axes", "surge and"),
    "sway and heave exchanged": (exchanged(SPEED[1], SPEED[2]), "velocity_axes", "sway and"),
    "time in minutes declared s": (in_minutes, "time_unit", "in minutes"),
    "commands 2 s early": (late(-2.0, *PULSES), "commands_early", "stamped early"),
    "commands frozen": (data(lambda p: 0.0 * p + 1600.0, *PULSES), "outputs_held", "No output"),
    "outputs 1 and 2 exchanged": (exchanged(*PULSES[:2]), "response_sign", "Yaw"),
    "depth and heave turned": (
        both(sign("depth_m"), sign(SPEED[2])),
        "depth_sign",
        "both count upward",
    ),
    "surge and pulses turned": (
        both(sign(SPEED[0]), data(lambda pulse: 3000.0 - pulse, *PULSES)),
        "response_sign",
        "All outputs act the other way round",
    ),
    "inertia in g cm^2 taken for kg m^2": (vehicle("inertia", factor=1e7), "body_size", "gyration"),
    "inertia in lb ft^2 taken for kg m^2": (
        vehicle("inertia", factor=23.73),
        "body_size",
        "gyration",
    ),
    "centre of buoyancy in mm taken for m": (
        vehicle("centre_of_buoyancy", factor=1e3),
        "body_size",
        "centres",
    ),
    "centre of buoyancy counted upward": (
        vehicle("centre_of_buoyancy", factor=-1.0),
        "upside_down",
        "turn over",
    ),
    "places of thrusters in mm taken for m": (
        vehicle("position", factor=1e3, of="thrusters"),
        "body_size",
        "lever arm",
    ),
    "gravity counted upward": (
        vehicle("gravity", factor=-1.0, of="environment"),
        "gravity_value",
        "-9.8",
    ),
    "gravity in ft/s^2": (vehicle("gravity", factor=3.2808, of="environment"), "gravity_value", ""),
    "output columns shifted by one": (shifted, "response_order", "vehicle file"),
    "speeds without signs": (data(np.abs, *SPEED), "velocity_unsigned", "signs"),
    "velocity over ground, down as heave": (turned_velocity(None), "velocity_axes", "over ground"),
    "velocity log turned by 45 degrees": (turned_velocity(45.0), "velocity_axes", "by 45 degrees"),
    "attitude in gradians declared degrees": (
        data(lambda angle: angle / 0.9, *ANGLES),
        "attitude_unit",
        "unit: grad",
    ),
    "attitude in degrees declared gradians": (unit("grad", *ANGLES), "attitude_unit", "unit: deg"),
    "time as digits of a clock declared s": (clock_digits, "digits of a clock", "hhmmss"),
    "surge at one value": (data(lambda u: 0.0 * u + 0.2, SPEED[0]), "velocity_frozen", "u_m_s"),
    "sway frozen halfway": (frozen_sway, "stuck_sensor", "v_m_s"),
    "gyro in deg/s and velocity in cm/s": (
        both(data(np.degrees, *GYRO), data(lambda u: 100.0 * u, *SPEED)),
        "gyro_scale",
        "deg/s",
    ),
    "one thruster output reversed": (
        data(lambda pulse: 3000.0 - pulse, PULSES[0]),
        "response_order",
        "Output 1 acts backward",
    ),
    "pulses with half their deflection": (
        data(lambda pulse: 750.0 + 0.5 * pulse, *PULSES),
        "response_scale",
        "half their deflection",
    ),
    "pounds applied twice to mass and displaced mass": (
        vehicle("mass", "displaced_mass", factor=0.4536),
        "body_size",
        "in pounds twice",
    ),
    "velocity in whole m/s": (data(np.round, *SPEED), "velocity_coarse", "steps of 1 m/s"),
    "commands of another dive": (other_dive, "commands_unrelated", "nothing to do with"),
    "commands 8 s late": (late(8.0, *PULSES), "commands_unrelated", "8 s earlier"),
    "quaternion x, y, z, w read as w, x, y, z": (
        reordered_quaternion(1, 2, 3, 0),
        "gyro_axes",
        "taken for x, y, z, w",
    ),
    "quaternion w, x, y, z read as x, y, z, w": (
        reordered_quaternion(3, 0, 1, 2),
        "gyro_axes",
        "taken for w, x, y, z",
    ),
    "thrust in kgf declared N": (thrust_in(1.0 / 9.80665), "response_unit", "kgf"),
    "thrust in N declared kgf": (thrust_in(9.80665), "response_unit", "too much"),
    "one aft output of two reversed": (
        data(lambda pulse: 3000.0 - pulse, PULSES[1]),
        "response_order",
        "Output 2 acts backward",
    ),
    "outputs of sway and heave exchanged": (
        exchanged(*PULSES[2:4]),
        "response_order",
        "sway and heave",
    ),
    "pressure in psi as depth": (
        data(lambda z: z / 0.6895, "depth_m"),
        "velocity_scale",
        "psi",
    ),
    "-32.768 m/s where no bottom is seen": (
        no_bottom(-32.768),
        "rejected_samples",
        "stands for none",
    ),
    "0 m/s where no bottom is seen": (no_bottom(0.0), "placeholder_values", "u_m_s = 0"),
    "9 m/s where no bottom is seen": (no_bottom(9.0), "placeholder_values", "u_m_s = 9"),
    "depth of 0 where the sensor gave none": (
        placeholder_of(0.0, "depth_m"),
        "placeholder_values",
        "depth_m = 0",
    ),
    "depth of 9999 where the sensor gave none": (
        placeholder_of(9999.0, "depth_m"),
        "placeholder_values",
        "depth_m = 9999",
    ),
    "gyro of 0 where the sensor gave none": (
        placeholder_of(0.0, *GYRO),
        "placeholder_values",
        "gyro_z_rad_s = 0",
    ),
    "0 m/s for seconds where no bottom is seen": (
        seconds_of_zeros,
        "placeholder_values",
        "from 20.0 to 25.9, 50.0 to 55.9 s",
    ),
    "depth in steps of half a metre": (
        data(lambda z: np.round(2.0 * z) / 2.0, "depth_m"),
        "values_coarse",
        "steps of 0.5 m",
    ),
    "heading in whole degrees": (data(np.round, "psi_rad"), "values_coarse", "steps of 1 degrees"),
    "heading alone 0.5 s late": (late_heading, "gyro_lag", "Yaw of the attitude comes 0.49"),
    "angles of the order yaw, roll, pitch": (order_zxy, "attitude_order", "yaw, roll, pitch"),
    "heave 0.12 m/s too much": (data(lambda w: w + 0.12, "w_m_s"), "velocity_zero", "+0.12"),
    "an output that logs another signal": (
        data(lambda p: 1500.0 + 200.0 * np.sin(np.arange(p.size) / 50.0), PULSES[1]),
        "output_dead",
        "output 2",
    ),
    "depth and heave exchanged": (
        exchanged("depth_m", "w_m_s"),
        "columns_exchanged",
        "the depth rate follows heave",
    ),
    "attitude of the earth in axes of the body": (
        inverse_attitude,
        "gyro_axes",
        "of the earth in axes of the body",
    ),
    "compass beside iron": (
        data(lambda psi: psi + 15.0 * np.sin(np.radians(psi)), "psi_rad"),
        "heading_deviation",
        "swings by 15",
    ),
    "surge mapped to sway as well": (taken_twice(*SPEED[:2]), "columns_alike", "u_m_s and v_m_s"),
    "outputs frozen halfway": (stopped(*PULSES), "outputs_frozen", "No output changes"),
    "velocity 6 s late": (late(6.0, *SPEED), "velocity_lag", "velocity comes"),
    "pulses in ms declared us": (data(lambda p: 1e-3 * p, *PULSES), "output_range", "are in ms"),
    "pressure in mbar read as cm": (
        data(lambda z: (1013.25 + 100.5 * z) / 100.0, "depth_m"),
        "depth_zero_unseen",
        "not observable",
    ),
    "time mapped to depth as well": (
        lambda case: case.entry("depth_m").update(column="time_s"),
        "columns_alike",
        "column of the time",
    ),
    "thrust curve over pulses in ms": (curve_of(in_milliseconds), "curve_range", "it is in ms"),
    "thrust curve mirrored about neutral": (curve_of(mirrored), "response_shape", "mirrored"),
    "root of the commands as pulses": (shaped(0.5, *PULSES), "response_shape", "by their square"),
    "square of the commands as pulses": (shaped(2.0, *PULSES), "response_shape", "by their root"),
    "roll and yaw exchanged": (
        exchanged(ANGLES[0], ANGLES[2]),
        "gyro_axes",
        "Roll and yaw of the attitude",
    ),
    "columns of the velocity shifted by one": (
        both(exchanged(SPEED[0], SPEED[1]), exchanged(SPEED[1], SPEED[2])),
        "velocity_axes",
        "three columns exchanged",
    ),
    "thrust curve 1.3 times too strong": (thrust_in(1.3), "response_scale", "too much"),
    "mass and displaced mass in pounds": (
        vehicle("mass", "displaced_mass", factor=2.2046),
        "response_scale",
        "too little",
    ),
    "displaced mass 15 % too large": (
        vehicle("displaced_mass", factor=1.15),
        "weight_held",
        "the vehicle file gives -20",
    ),
    "pitch and its rate turned, without an accelerometer": (
        sign(ANGLES[1], GYRO[1]),
        "response_sign",
        "Pitch and its rate",
    ),
    "roll 4 degrees off": (data(lambda a: a + 4.0, ANGLES[0]), "tilt_offset", "roll reads +4.0"),
    "depth of another dive": (
        data(lambda z: z[::-1], "depth_m"),
        "depth_unrelated",
        "they correlate by -0.0",
    ),
    "outputs logged behind a limiter of 400 us/s": (
        limited(400.0),
        "command_late",
        "a limit to how fast they change",
    ),
    "velocity in cm/s, sway and heave exchanged": (
        both(data(lambda speed: 100.0 * speed, *SPEED), exchanged(*SPEED[1:])),
        "velocity_axes",
        "with sway and heave exchanged and in cm/s",
    ),
    "sway alone 1 s late": (late(1.0, "v_m_s"), "velocity_lag", "sway alone is some 0.8 s late"),
    "surge of a setpoint 1 s ahead": (
        late(-1.0, "u_m_s"),
        "velocity_lag",
        "surge alone is some 1.0 s early",
    ),
    "depth 12 s late": (late(12.0, "depth_m"), "depth_unrelated", "With the depth 12 s earlier"),
    "depth zeroed anew under way": (
        data(lambda z: z - 0.4 * (np.arange(z.size) > 400), "depth_m"),
        "depth_jumps",
        "jumps once and goes on at another level, by -0.4",
    ),
    "bottom track, then water track": (water_track, "velocity_step", "goes on from there"),
}
"""Change, the finding that must stop the run (or words of the refusal), words of it."""
DIVE_CASES: dict[str, tuple[Change, str, str]] = {
    "roll of a unit mounted upside down": (
        data(lambda angle: angle % 360.0 - 180.0, ANGLES[0]),
        "accelerometer_direction",
        "upside down, and gravity in the accelerometer has it upright",
    ),
    "attitude of a world east, north, up": (
        both(sign(ANGLES[1]), data(lambda angle: 90.0 - angle, ANGLES[2])),
        "gyro_sign",
        "Pitch and yaw of the attitude are in axes forward, left, up",
    ),
    "gyro turned by 90 degrees about the vertical": (gyro_turned, "gyro_axes", "hardly move"),
    "pitch that counts .8": (
        data(lambda angle: 0.8 * angle, ANGLES[1]),
        "attitude_scale",
        "pitch turns 0.80 times as much as the gyro, and gravity",
    ),
    "accelerometer in g declared m/s^2": (
        data(lambda a: a / 9.80665, *ACCEL),
        "accelerometer_unit",
        "in g",
    ),
    "accelerometer turned to g twice": (
        data(lambda a: a / 9.80665**2, *ACCEL),
        "accelerometer_convention",
        "g twice",
    ),
    "accelerometer declared inertial": (
        lambda case: case.maps["imu.csv"].update(accelerometer="inertial"),
        "accelerometer_convention",
        "inertial",
    ),
    "accelerometer declared derivative": (
        lambda case: case.maps["imu.csv"].update(accelerometer="derivative"),
        "accelerometer_convention",
        "derivative",
    ),
    "accelerometer of the other sign": (sign(*ACCEL), "accelerometer_direction", "179 degrees"),
    "accelerometer declared flu": (frame("flu", *ACCEL), "accelerometer_direction", "degrees"),
    "one file on another clock": (other_clock, "streams_apart", "velocity"),
    "up of a velocity log taken for down": (
        frame("frd", *SPEED),
        "velocity_sign",
        "Heave",
    ),
    "x and y of the accelerometer exchanged": (
        exchanged(*ACCEL[:2]),
        "accelerometer_axes",
        "as the roll turns it",
    ),
    "outputs in reverse order": (
        in_order(8, 7, 6, 5, 4, 3, 2, 1),
        "response_order",
        "with 8, 7, 6, 5, 4, 3, 2, 1 for 1 to 8",
    ),
    "outputs shifted by one on the dive": (
        in_order(2, 3, 4, 5, 6, 7, 8, 1),
        "response_order",
        "with 8, 1, 2, 3, 4, 5, 6, 7 for 1 to 8",
    ),
    "velocity log of the dive turned by 45 degrees": (
        turned_velocity(45.0),
        "velocity_axes",
        "turned by",
    ),
    "three beams all round as body velocity": (
        along_beams(30.0, 150.0, 270.0, tilt=25.0),
        "velocity_axes",
        "along beams",
    ),
    "commands of another dive, eight thrusters": (
        other_dive,
        "commands_unrelated",
        "nothing to do with",
    ),
    "yaw and its rate both turned": (sign("psi_rad", GYRO[2]), "response_sign", "Yaw"),
    "velocity 0.6 s early": (late(-0.6, *SPEED), "velocity_lag", "0.7 s early"),
    "depth 0.5 s late": (late(0.5, "depth_m"), "velocity_lag", "depth comes"),
    "clock of the velocity 2 % slow": (slow(0.98, *SPEED), "clock_drift", "clock of the velocity"),
    "pitch and its rate turned": (sign("theta_rad", GYRO[1]), "accelerometer_axes", "or pitch"),
    "x and y of the thrusters' places exchanged": (
        places_exchanged,
        "response_order",
        "x and y of the positions exchanged",
    ),
    "attitude and gyro 0.3 s late": (
        late(0.3, *ANGLES, *GYRO),
        "inertial_lag",
        "both come 0.40 s after",
    ),
    "velocity log placed 0.3 m too far ahead": (
        arm_of_log(0.42, 0.0),
        "arm_off",
        "gives +0.42",
    ),
    "a tenth of the added mass": (
        vehicle(*ADDED, factor=0.1, of="added_mass"),
        "added_mass_size",
        "Y_vdot",
    ),
    "ten times the added mass": (
        vehicle(*ADDED, factor=10.0, of="added_mass"),
        "added_mass_size",
        "Z_wdot",
    ),
}
WHOLE_DIVE = tuple(DIVE_CASES)[-15:-2]
"""Those that the first minute does not show."""
NOT_STOPPING = (
    "stuck_sensor",
    "velocity_frozen",
    "velocity_unsigned",
    "response_scale",
    "weight_held",
    "depth_zero_unseen",
    "rejected_samples",
    "velocity_outliers",
    "outputs_frozen",
    "tilt_offset",
    "response_shape",
    "arm_off",
    "depth_jumps",
    "velocity_step",
    "values_coarse",
    "heading_deviation",
    "velocity_zero",
)


ONE_CAUSE = {
    "three beams of four as body velocity": (),
    "three beams all round as body velocity": (),
    "velocity held at 1 Hz": (),
    "surge turned": ("response_sign of surge",),
    "heave turned": ("response_sign of heave",),
    "depth and heave turned": ("depth_above_water", "velocity_sign of surge", "of sway"),
    "velocity 1 s late": ("command_delay",),
    "commands 2 s early": ("commands_early",),
    "pitch and its rate turned, without an accelerometer": ("velocity_sign of surge",),
}
"""Mistakes of several findings, of which one is left that names what else it explains."""
EITHER = {
    "yaw and its rate both turned": ("x of the positions counted backward", "yaw and its rate"),
}
"""Mistakes that nothing in the log tells from others, which are all named."""


def judged(case: Case) -> list[dict[str, Any]]:
    """The findings; a log that is refused counts as one that stops."""
    try:
        return case.findings()
    except PipelineError as fault:
        return [{"id": "refused", "text": str(fault), "remedy": str(fault), "severity": "error"}]


def _whole_dive() -> Case:
    return _dive(np.inf)


@pytest.mark.parametrize("base", [_example, _dive, _whole_dive])
def test_the_healthy_case_has_no_finding_that_stops(base: Callable[[], Case]) -> None:
    assert [item["id"] for item in base().findings() if checks()[item["id"]].stops] == []


@pytest.mark.parametrize("name", [*EXAMPLE, *DIVE_CASES])
def test_a_wrong_map_is_stopped_with_its_cause(name: str) -> None:
    spoil, expected, words = {**EXAMPLE, **DIVE_CASES}[name]
    base = _example if name in EXAMPLE else _whole_dive if name in WHOLE_DIVE else _dive
    case = copy.deepcopy(base())
    if name in ("time in ms declared s", "time in us declared s"):
        values = case.files["run.csv"]
        values["time_s"] = values["time_s"] * (1e3 if "ms" in name else 1e6)
    else:
        spoil(case)
    findings = judged(case)
    stopping = [
        item
        for item in findings
        if item["id"] == "refused" or checks()[item["id"]].stops or item["id"] in NOT_STOPPING
    ]
    assert stopping, [item["text"] for item in findings]
    hit = [
        item
        for item in stopping
        if (item["id"].startswith(expected) or expected in item["text"])
        and words in f"{item['text']} {item['remedy']}"
    ]
    assert hit, [(item["id"], item["text"], item["remedy"]) for item in stopping]
    assert mistakes()[name] in [item["id"] for item in hit]
    if name in ONE_CAUSE:
        assert [item["id"] for item in findings if item["id"] in OF_MOTION] == [hit[0]["id"]]
    for part in (*ONE_CAUSE.get(name, ()), *EITHER.get(name, ())):
        assert part in hit[0]["text"]


def unseen(case: Case) -> list[str]:
    """What the log cannot show."""
    raw = tuple(
        RawFile(name, np.frombuffer(_csv(values), np.uint8), case.maps[name])
        for name, values in case.files.items()
    )
    inputs = ingest.Inputs(RawLog("log", raw), None, case.vehicle)
    return [item["name"] for item in ingest.run(inputs, ingest.Params()).health["unseen"]]


SHAPE = "shape of the thrust curve, and a limit to how fast outputs change"


def test_what_a_log_cannot_show_is_listed_by_name() -> None:
    """The slow dive hides the scale of the thrust, which the made log shows."""
    of_dive, of_example = unseen(_whole_dive()), unseen(_example())
    assert {"scale of the thrust", "mass and added mass", "steady current", SHAPE} <= set(of_dive)
    assert "scale of surge and sway of the velocity" in of_dive
    assert {"zero of the depth", "smoothing of roll and pitch (means of a second)"} <= set(of_dive)
    assert "angles of the thrusters, moments of inertia by themselves" in of_dive
    assert any(name.startswith("scale of heave against depth below 6.") for name in of_example)
    assert "weight in water (displaced mass)" not in of_dive
    assert any(name.startswith("weight in water (displaced mass) off by") for name in of_dive)
    assert {"scale of the thrust", SHAPE}.isdisjoint(of_example)
    assert any("attitude and gyro share" in name for name in of_example)
    assert "smoothing of roll and pitch (means of a second)" not in of_example
    assert {"steady current", "rate of a clock that all sensors share"} <= set(of_example)


def test_outputs_whose_exchange_turns_the_sign_of_an_answer_are_not_listed() -> None:
    """Of those of the dive that the order alone does not tell, 1 and 3 turn sway."""
    for order, named in (((3, 2, 1, 4), True), ((1, 4, 3, 2), False)):
        case = copy.deepcopy(_whole_dive())
        in_order(*order, 5, 6, 7, 8)(case)
        assert ("response_sign" in weighty(case)) == named
    (text,) = [item["text"] for item in _whole_dive().findings() if item["id"] == "outputs_unseen"]
    assert "exchanged is not observable of 2 and 4." in text


def driven(pulses: npt.NDArray[np.float64], seed: int) -> Case:
    """The example under other pulses (n, 4), each held as long as its simulation holds them."""
    case, rng = copy.deepcopy(_example()), np.random.default_rng(seed)
    state = new_example.simulate(case.vehicle, pulses)
    values = [
        0.1 * np.arange(len(pulses)),
        *pulses.T,
        *(np.degrees(state[:, 9:]) + rng.normal(0.0, 0.05, (len(pulses), 3))).T,
        *(state[:, 3:6] + rng.normal(0.0, 0.002, (len(pulses), 3))).T,
        state[:, 8] + rng.normal(0.0, 0.005, len(pulses)),
        *(state[:, :3] + rng.normal(0.0, 0.002, (len(pulses), 3))).T,
    ]
    case.files["run.csv"] = dict(zip(case.files["run.csv"], values, strict=True))
    return case


def sines(hertz: float, seed: int, *, hold_s: float) -> npt.NDArray[np.float64]:
    """Pulses (900, 4) of one frequency, whose steps are held for a time."""
    hold, phase = round(10.0 * hold_s), np.random.default_rng(seed).uniform(0.0, 6.28, 4)
    angle = 2.0 * np.pi * hertz * 0.1 * np.arange(0, 900, hold)[:, None] + phase
    return np.repeat(1500.0 + np.array([220.0, 220.0, 220.0, 110.0]) * np.sin(angle), hold, axis=0)


def sticks(count: int, seed: int) -> npt.NDArray[np.float64]:
    """Deflections (count, 4) of three seconds each."""
    steps = np.random.default_rng(seed).uniform(-250.0, 250.0, (count // 30, 4))
    return np.repeat(steps * [1.0, 1.0, 1.0, 0.5], 30, axis=0)


def weighty(case: Case) -> list[str]:
    """The findings of a log but for notes."""
    return [item["id"] for item in case.findings() if item["severity"] != "note"]


def test_a_heave_that_is_the_depth_rate_is_no_axis_of_a_tilted_body() -> None:
    """Most of the depth is by heave, so that other axes explain no more for certain."""
    case = driven(1500.0 + sticks(900, 4) * [0.5, 0.5, 0.5, 1.6], 4)
    assert weighty(case) == []
    values = case.files["run.csv"]
    tilt = Rotation.from_euler(
        "YX", np.column_stack([values["pitch_deg"], values["roll_deg"]]), degrees=True
    )
    level = tilt.apply(np.column_stack([values[name] for name in "uvw"]))
    values |= dict(zip("uvw", level.T, strict=True))
    assert weighty(case) == ["velocity_level"]


@pytest.mark.parametrize(("hertz", "seed"), [(0.03, 0), (0.1, 3), (0.15, 4), (0.4, 7)])
def test_sines_of_one_frequency_say_nothing_of_order_and_clock(
    hertz: float, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(new_example, "HOLD_S", 0.1)
    findings = driven(sines(hertz, seed, hold_s=0.1), seed).findings()
    assert [item["id"] for item in findings if item["severity"] != "note"] == []
    (note,) = [item for item in findings if item["id"] == "commands_one_tone"]
    assert f"{hertz:g}"[:3] in note["text"]


def test_an_axis_that_keeps_its_sign_tells_no_change_of_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As of a tow along one axis: sway follows the accelerometer, surge and heave do not."""
    change = SignChange(5, 30.0, False, 68.0, 20.0, [-0.01, 0.74, -0.36, 0.25])
    monkeypatch.setattr(sign_changes, "sign_change", lambda *_: change)
    monkeypatch.setattr(sign_changes, "with_one_turn", lambda log: (log, []))
    assert "sign_changes" not in weighty(_dive())


@pytest.mark.parametrize("step", [0.2, 0.3])
def test_a_depth_in_coarse_steps_is_neither_late_nor_absent(step: float) -> None:
    case = copy.deepcopy(_example())
    data(lambda z: step * np.round(z / step), "depth_m")(case)
    assert weighty(case) == ["values_coarse"]


def test_pulses_of_one_frequency_that_are_turned_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(new_example, "HOLD_S", 0.1)
    case = driven(sines(0.1, 3, hold_s=0.1), 3)
    data(lambda pulse: 3000.0 - pulse, *PULSES)(case)
    assert "response_sign" in weighty(case)


@pytest.mark.parametrize("seed", [1, 3])
def test_slow_waves_of_the_outputs_are_no_wrong_clock(seed: int) -> None:
    assert weighty(driven(sines(0.03, seed, hold_s=3.0), seed)) == []


def test_sway_that_a_turn_makes_is_no_wrong_sign() -> None:
    """Surge times yaw rate accelerates it more than its thruster."""
    moving = (np.arange(2400) % 150 < 75)[:, None]
    assert weighty(driven(1500.0 + moving * sticks(2400, 3), 3)) == []


@pytest.mark.parametrize("threshold", [0.05, 0.1])
def test_a_vehicle_at_rest_has_no_outliers(threshold: float) -> None:
    """Its velocity log writes 0 below a threshold."""
    case = driven(1500.0 + (np.arange(2400) % 150 < 75)[:, None] * sticks(2400, 3), 3)
    values = case.files["run.csv"]
    still = np.max([np.abs(values[name]) for name in "uvw"], axis=0) < threshold
    assert np.mean(still) > 0.2
    for name in "uvw":
        values[name] = np.where(still, 0.0, values[name])
    assert weighty(case) == []


def test_a_roll_that_goes_on_beyond_a_turn_is_legal() -> None:
    case = copy.deepcopy(_example())
    values = case.files["run.csv"]
    turning = np.clip(0.5 * (values["time_s"] - 30.0), 0.0, 8.0 * np.pi)
    values["roll_deg"] = values["roll_deg"] + np.degrees(turning)
    assert np.abs(values["roll_deg"]).max() > 1000.0
    texts = [item["text"] for item in case.findings() if item["id"] == "impossible_values"]
    assert texts == []


def test_the_documentation_lists_these_mistakes() -> None:
    assert list(mistakes()) == [*EXAMPLE, *DIVE_CASES]
