"""Make mistakes of units, signs, frames, clocks and vehicle files in sound logs.

    python -m tests.faults.wrong_maps [--log FILE --vehicle NAME]... [--only WORDS]

Each mistake is made in the decoded streams of a log, the example and the bundled dive
without others, and the log is checked again. One row each: what stops a run, what is
named beyond the sound log (notes in parentheses), or `silent`; what is silent should stand
under what the log cannot show, which is printed last. Half a second for each.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import yaml
from rich.console import Console
from rich.table import Table

from auvid.data_schemas.checks import checks
from auvid.data_schemas.errors import PipelineError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.checks.motion_checks import angles_at
from auvid.pipeline.campaigns.vehicle_files import load_vehicle
from auvid.pipeline.commands.new.new_example import example_log
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, GYRO, LINEAR_VELOCITY, POSITION
from auvid.stages.ingest.health.finding import CheckedLog
from auvid.stages.ingest.health.health_check import check_health

ROOT = Path(__file__).resolve().parents[2]
TEMPLATES = ROOT / "pipeline" / "templates"
DIVE = ROOT / "campaigns" / "bluerov2_dvl" / "logs" / "00000029_first130s.BIN"
FOOT, KNOT, POUND = 3.2808, 1.9438, 2.2046
Change = Callable[[CheckedLog], CheckedLog]
Of = Callable[[Array], Array]


def sound_log(path: Path, vehicle: str) -> CheckedLog:
    """Return a log file as it is checked, with a vehicle file of auvid."""
    document = load_vehicle(ROOT / "vehicles" / f"{vehicle}.yaml").vehicle
    return _read(RawFile(path.name, np.fromfile(path, np.uint8), None), document)


def example() -> CheckedLog:
    """Return the log of the example that `auvid new` makes."""
    vehicle = load_vehicle(TEMPLATES / "vehicles" / "example_rov.yaml").vehicle
    text = (TEMPLATES / "campaigns/example/columns/synthetic_run.yaml").read_text(encoding="utf-8")
    data = np.frombuffer(example_log(vehicle), np.uint8)
    return _read(RawFile("run.csv", data, yaml.safe_load(text)), vehicle)


def _read(file: RawFile, vehicle: Vehicle) -> CheckedLog:
    inputs = ingest.Inputs(RawLog("log", (file,)), None, vehicle)
    read = ingest.run(inputs, ingest.Params())
    tables = {name: getattr(read, name) for name in read.health["streams"]}
    return CheckedLog(tables, read.log_info, read.dropped, vehicle)


def health(log: CheckedLog) -> dict[str, Any]:
    """Return the health of a log that is changed."""
    return check_health(log.tables, log.info, log.dropped, vehicle=log.vehicle)


def of(stream: str, names: Sequence[str], change: Of) -> Change:
    """Return what changes columns of a stream, where it is there."""

    def spoil(log: CheckedLog) -> CheckedLog:
        there = [name for name in names if name in log.tables[stream].column_names]
        if not there:
            raise KeyError(stream)
        values = {name: np.asarray(change(log.column(stream, name)), float) for name in there}
        return log.with_columns(stream, values)

    return spoil


def times(factor: float) -> Of:
    """Return what multiplies values."""
    return lambda values: factor * values


def plus(constant: float) -> Of:
    """Return what adds a constant."""
    return lambda values: values + constant


def pulses(change: Of) -> Change:
    """Return what changes the pulses of the thrusters."""
    return lambda log: of("actuators", log.thrusters(), change)(log)


def in_order(stream: str, names: Sequence[str], order: Sequence[int]) -> Change:
    """Return what takes columns for one another."""

    def spoil(log: CheckedLog) -> CheckedLog:
        taken = (log.column(stream, names[place]) for place in order)
        return log.with_columns(stream, dict(zip(names, taken, strict=True)))

    return spoil


def late(stream: str, seconds: float, rate: float = 0.0) -> Change:
    """Return what stamps a stream later, or by a clock that drifts."""

    def spoil(log: CheckedLog) -> CheckedLog:
        table = log.tables[stream]
        stamps = table["time_us"].to_numpy()
        moved = stamps + 1e6 * seconds + rate * (stamps - stamps[0])
        place = table.column_names.index("time_us")
        clock = pa.array(moved.astype(stamps.dtype))
        table = table.set_column(place, table.schema.field(place), clock)
        return replace(log, tables={**log.tables, stream: table}, _times={})

    return spoil


def backward(stream: str, names: Sequence[str]) -> Change:
    """Return what reads columns of another dive: of this one from its end."""
    return of(stream, names, lambda values: values[::-1])


def later_half(change: Of) -> Of:
    """Return what changes values from the middle of the log on."""
    return lambda values: np.where(
        np.arange(values.size) > values.size // 2, change(values), values
    )


def turned(degrees: float) -> Change:
    """Return what turns surge and sway about the vertical."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return _speeds(lambda log, v: v @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0, 0, 1.0]]))


def _speeds(change: Callable[[CheckedLog, Array], Array]) -> Change:
    def spoil(log: CheckedLog) -> CheckedLog:
        values = change(log, log.values("velocity", LINEAR_VELOCITY))
        return log.with_columns("velocity", dict(zip(LINEAR_VELOCITY, values.T, strict=True)))

    return spoil


def _over_ground(log: CheckedLog, velocity: Array, *, level: bool, water: float = 0.0) -> Array:
    """Return a velocity over ground, in level axes, or beside a current from the middle on."""
    angles = angles_at(log.t_s("velocity"), log.t_s("attitude"), log.values("attitude", ATTITUDE))
    if water:
        current = np.array([water, -0.6 * water, 0.0])
        drift = rotation_body_to_ned(angles).transpose(0, 2, 1) @ current
        return velocity - np.where(np.arange(len(drift)) > len(drift) // 2, drift.T, 0.0).T
    if level:
        angles = angles * [1.0, 1.0, 0.0]
    return np.asarray(np.einsum("nij,nj->ni", rotation_body_to_ned(angles), velocity))


def file(*path: str, change: Callable[[Any], Any]) -> Change:
    """Return what changes an entry of the vehicle file, where it is there."""

    def spoil(log: CheckedLog) -> CheckedLog:
        assert log.vehicle is not None
        document = log.vehicle.document.model_dump(mode="python", exclude_none=True)
        entry = document
        for name in path:
            entry = entry[name]
        entry["value"] = np.asarray(change(np.array(entry["value"], float))).tolist()
        return CheckedLog(log.tables, log.info, log.dropped, vehicle_from_document(document))

    return spoil


BODY, THRUSTERS = "rigid_body", ("actuators", "thrusters")
U, V, W = ((name,) for name in LINEAR_VELOCITY)
DEPTH = partial(of, "depth", ("depth_m",))
MISTAKES: dict[str, Change] = {
    **{f"velocity in {unit}": of("velocity", LINEAR_VELOCITY, times(factor))
       for unit, factor in (("knots", KNOT), ("ft/s", FOOT), ("cm/s", 100.0), ("mm/s", 1e3))},
    **{f"{axis} in {unit}": of("velocity", name, times(factor))
       for axis, name in (("surge", U), ("sway", V), ("heave", W))
       for unit, factor in (("knots", KNOT), ("ft/s", FOOT), ("cm/s", 100.0))},
    **{f"{axis} turned": of("velocity", name, times(-1.0))
       for axis, name in (("surge", U), ("sway", V), ("heave", W))},
    **{f"velocity log turned by {degrees}": turned(degrees)
       for degrees in (10, 30, 45, -45, 90, 180)},
    "speed of sound 5 % off": of("velocity", LINEAR_VELOCITY, times(1.05)),
    "velocity forward, left, up": of("velocity", LINEAR_VELOCITY[1:], times(-1.0)),
    "columns of the velocity shifted": in_order("velocity", LINEAR_VELOCITY, (1, 2, 0)),
    "velocity in level axes": _speeds(partial(_over_ground, level=True)),
    "velocity over ground": _speeds(partial(_over_ground, level=False)),
    "bottom, then water track": _speeds(partial(_over_ground, level=False, water=0.25)),
    "velocity of another dive": backward("velocity", LINEAR_VELOCITY),
    "surge turned from the middle": of("velocity", U, later_half(times(-1.0))),
    "surge reads .1 m/s at rest": of("velocity", U, plus(0.1)),
    "heave reads .1 m/s at rest": of("velocity", W, plus(0.1)),
    **{f"depth in {unit}": DEPTH(times(factor))
       for unit, factor in (("ft", FOOT), ("kPa", 10.055), ("mbar", 100.55), ("dm", 10.0))},
    "depth in bar, absolute": DEPTH(lambda z: 1.013 + 0.10055 * z),
    "density 2.6 % off": DEPTH(times(1.026)),
    "depth upward": DEPTH(times(-1.0)),
    "depth not zeroed": DEPTH(plus(10.1)),
    "depth zeroed anew": DEPTH(later_half(plus(0.6))),
    "depth of another dive": backward("depth", ("depth_m",)),
    "gyro in deg/s": of("imu", GYRO, np.degrees),
    **{f"gyro {axis} in deg/s": of("imu", (name,), np.degrees)
       for axis, name in zip("xyz", GYRO, strict=True)},
    **{f"gyro {axis} turned": of("imu", (name,), times(-1.0))
       for axis, name in zip("xyz", GYRO, strict=True)},
    "gyro x and y exchanged": in_order("imu", GYRO, (1, 0, 2)),
    "gyro of another dive": backward("imu", GYRO),
    "gyro reads 3 degrees/s at rest": of("imu", GYRO, plus(0.052)),
    "accelerometer in g": of("imu", ACCELEROMETER, times(1.0 / 9.80665)),
    "accelerometer of the other sign": of("imu", ACCELEROMETER, times(-1.0)),
    "accelerometer without gravity": of("imu", ACCELEROMETER[2:], plus(9.80665)),
    "inertial unit forward, left, up": of("imu", (*GYRO[1:], *ACCELEROMETER[1:]), times(-1.0)),
    "attitude in degrees": of("attitude", ATTITUDE, np.degrees),
    "attitude forward, left, up": of("attitude", ATTITUDE[1:], times(-1.0)),
    "roll and pitch exchanged": in_order("attitude", ATTITUDE, (1, 0, 2)),
    "heading from east": of("attitude", ATTITUDE[2:], lambda angle: np.pi / 2.0 - angle),
    "heading magnetic, 15 degrees": of("attitude", ATTITUDE[2:], plus(0.26)),
    "pitch 3 degrees off": of("attitude", ATTITUDE[1:2], plus(0.052)),
    "pitch times .8": of("attitude", ATTITUDE[1:2], times(0.8)),
    "position in ft": of("position", POSITION[:2], times(FOOT)),
    "north and east exchanged": in_order("position", POSITION[:2], (1, 0)),
    **{f"{stream} {seconds} s late": late(stream, seconds)
       for stream in ("velocity", "depth", "attitude", "imu", "actuators")
       for seconds in (0.5, 2.0, 3600.0)},
    **{f"clock of {stream} 1 % slow": late(stream, 0.0, 0.01)
       for stream in ("velocity", "actuators")},
    "pulses turned": pulses(lambda pulse: 3000.0 - pulse),
    "neutral at 1550": pulses(plus(50.0)),
    "half the deflection": pulses(lambda pulse: 750.0 + 0.5 * pulse),
    "root of the command": pulses(
        lambda pulse: 1500.0 + np.sign(pulse - 1500.0) * 20.0 * np.sqrt(np.abs(pulse - 1500.0))
    ),
    "outputs of another dive": lambda log: backward("actuators", log.thrusters())(log),
    "outputs 1 and 2 exchanged": in_order("actuators", ("pwm_1_us", "pwm_2_us"), (1, 0)),
    "output 1 reversed": of("actuators", ("pwm_1_us",), lambda pulse: 3000.0 - pulse),
    **{f"thrust {words}": file(*THRUSTERS, "thrust_curve", "force", change=times(factor))
       for words, factor in (("in kgf", 1.0 / 9.81), ("in lbf", 1.0 / 4.448), ("of 12 V", 0.6))},
    "thrust curve mirrored": file(
        *THRUSTERS, "thrust_curve", "force", change=lambda force: -force[::-1]
    ),
    **{f"places of thrusters {words}": file(*THRUSTERS, "position", change=times(factor))
       for words, factor in (("in mm", 1e3), ("in inches", 39.37), ("twice as far", 2.0))},
    **{f"{axis} of the places turned": file(
        *THRUSTERS, "position", change=partial(np.multiply, signs))
       for axis, signs in (("x", [-1, 1, 1]), ("y", [1, -1, 1]), ("z", [1, 1, -1]))},
    "mass in pounds": file(BODY, "mass", change=times(POUND)),
    "ballast counted twice": file(BODY, "mass", change=times(1.05)),
    "volume of sea water for fresh": file(BODY, "displaced_mass", change=times(1.026)),
    "inertia in g cm^2": file(BODY, "inertia", change=times(1e7)),
    "inertia twice": file(BODY, "inertia", change=times(2.0)),
    "centre of buoyancy below": file(BODY, "centre_of_buoyancy", change=times(-1.0)),
    "density in g/cm^3": file("environment", "water_density", change=times(1e-3)),
    "added mass of another sign": file("added_mass", "Y_vdot", change=times(-1.0)),
}  # fmt: skip
"""What is done to a sound log; a stream or an entry that is not there leaves it out."""


def rows(log: CheckedLog, only: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield mistake, outcome (stopped, named, note, silent) and findings beyond the sound log."""
    clean = {(item["id"], item["text"]) for item in health(log)["findings"]}
    for name, spoil in MISTAKES.items():
        if only not in name:
            continue
        try:
            findings = health(spoil(log))["findings"]
        except (KeyError, StopIteration):
            continue  # no such stream, column or entry
        except PipelineError as fault:
            yield name, "stopped", str(fault).partition("\n")[0][:60]
            continue
        new = [item for item in findings if (item["id"], item["text"]) not in clean]
        new = [item for item in new if item["id"] != "command_lag"]
        stops = [item["id"] for item in new if checks()[item["id"]].stops]
        named = [item["id"] for item in new if item["severity"] != "note"]
        notes = [f"({item['id']})" for item in new if item["severity"] == "note"]
        outcome = "stopped" if stops else "named" if named else "note" if notes else "silent"
        yield name, outcome, " ".join(dict.fromkeys([*stops, *named, *notes]))


def main() -> None:
    """Print the table of each log, and what it cannot show."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--log", type=Path, action="append", default=[])
    options.add_argument("--vehicle", action="append", default=[], help="one for each log")
    options.add_argument("--only", default="", help="words of the mistakes to make")
    chosen = options.parse_args()
    logs = [sound_log(*pair) for pair in zip(chosen.log, chosen.vehicle, strict=True)]
    for log in logs or [example(), sound_log(DIVE, "bluerov2_heavy")]:
        table, outcomes = Table(title=log.info.files[0].name), Counter[str]()
        for column in ("mistake", "outcome", "findings"):
            table.add_column(column)
        for row in rows(log, chosen.only):
            table.add_row(*row)
            outcomes[row[1]] += 1
        Console(width=120).print(table)
        print(", ".join(f"{count} {outcome}" for outcome, count in outcomes.items()))
        print("not observable:", "; ".join(item["name"] for item in health(log)["unseen"]))


if __name__ == "__main__":
    main()
