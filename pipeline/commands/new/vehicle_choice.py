"""Which vehicle a log is of, and its file with a remedy at every assumed figure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.commands import frame_name, px4_thrusters
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.logged_directions import MOTOR_OF_FUNCTION
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES, vehicle_file_of
from auvid.pipeline.commands.check.axes_route import (
    FRAMES,
    MOTORS_OF_VEHICLE,
    driven_outputs,
)
from auvid.stages.ingest.health.actuation.output_order import directions_by_motion
from auvid.stages.ingest.health.finding import CheckedLog, listed

OWN_FILE = "vehicle"
"""Name of a vehicle that no bundled one is like."""
FRAME_NAMES = {
    0: "BlueROV1",
    3: "vectored 6-DOF, 90 degrees",
    4: "SimpleROV-3",
    5: "SimpleROV-4",
    6: "SimpleROV-5",
    7: "custom",
}
"""Frames without a bundled vehicle."""
REMEDIES: Mapping[str, str] = {
    "water_density": "1000 in fresh water; 1025 at sea, less in brackish water",
    "mass": "weigh the vehicle as it dived, with payload and flooded parts full of water",
    "displaced_mass": "mass plus what must be added under water until it neither rises nor sinks",
    "centre_of_buoyancy": "from a tilt test: hang a known weight aside and read the angle",
    "inertia": "swing it (docs/bench.md), or take it from a CAD model",
    "X_udot": "added masses: by strip theory, from a similar vehicle, or from a bench",
    "position": "measure each thruster from the centre of gravity: forward, right, down",
    "axis": "the way each thruster pushes at a pulse above 1500 us",
    "direction": "-1 where the pulse is mirrored; MOT_n_DIRECTION of a log takes precedence",
    "outputs": "the output channel of each thruster, in the order of the rows above",
    "thrust_curve": "the curve of your thruster at your voltage; coefficients scale with it",
    "reference_area": "the area that drag and lift are referred to: the wings' planform",
    "lift_slope": "of hull and wings by area; fitted where speed through the water is logged",
    "induced_drag": "by area; from a similar glider, a record rarely tells it",
    "arm": "measure where the sensor sits from the centre of gravity: forward, right, down",
}
"""Key of a vehicle file -> what to do about an assumed figure."""
FILL_IN = """
actuators:
  thrusters:  # fill in: no log tells where thrusters sit; forward, right, down
    position:
      value:
{places}
      unit: m
      source: measured
    axis:
      value:
{axes}
      unit: "1"
      source: measured
    direction: {{value: {ones}, unit: "1", source: no thruster mirrored, assumed: true}}
    outputs: {outputs}
    thrust_curve:
      pulse_width:
        {{value: [1100, 1475, 1525, 1900], unit: us, source: class of thruster, assumed: true}}
      force: {{value: [-40.0, 0.0, 0.0, 50.0], unit: N, source: class of thruster, assumed: true}}
      voltage: {{value: 16.0, unit: V, source: class of thruster, assumed: true}}
      voltage_exponent: {{value: 1.0, unit: "1", source: class of thruster, assumed: true}}
"""

LAYOUT = "position and axis of each thruster"
FILL_IN_FINS = """
actuators: fill in propeller and fins, in place of this line, as in the example below
# actuators:
#   propeller:
#     # check: K_T and K_Q by the advance J, highest power first, from the maker or a bench; K_Q is
#     # that of the moment on the hull, negative where it turns clockwise seen from astern
#     diameter: {value: 0.12, unit: m, source: measured}
#     wake_fraction: {value: 0.2, unit: "1", source: class of vehicle, assumed: true}
#     thrust_coefficient: {value: [-0.14, 0.05, 0.06], unit: "1", source: bench}
#     torque_coefficient: {value: [0.012, -0.006, -0.004], unit: "1", source: bench}
#     # check: the speed that it holds straight and level at each propeller speed
#     level_speed:
#       propeller_speed: {value: [0.0, 15.0, 30.0], unit: 1/s, source: straight runs}
#       speed: {value: [0.0, 0.8, 1.6], unit: m/s, source: straight runs}
#   fins:
#     # check: force and moment of each fin by its angle, over half of water density, U^2 and
#     # powers L^2 (X Y Z) or L^3 (K M N) of the length; from strip theory or a tow
#     reference_length: {value: 1.6, unit: m, source: measured}
#     linear:
#       # check: rows X Y Z K M N; columns starboard, port, bottom and top fin, per rad
#       value: [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
#       unit: "1"
#       source: fill in
#     # check: the same by the square of the angle; X is the drag of a fin
#     quadratic:
#       value: [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
#       unit: "1"
#       source: fill in
# auvid vehicles says where vt690.yaml is, a file with both.
"""


@dataclass(frozen=True)
class VehicleChoice:
    """A vehicle for a log: name, why, and the text of its file.

    `lacking`: what must be filled in before any run; empty if nothing. `guessed`: the log
    does not name it. `title`: that of its file where the user named it.
    """

    name: str
    why: str
    text: str
    lacking: str = ""
    guessed: bool = False
    title: str = ""


def choose_vehicle(log: CheckedLog, *, named: str | None, normalised: bool) -> VehicleChoice:
    """Return the vehicle named in the call, else that of the log, else a skeleton.

    `normalised`: no force comes from the vehicle file. Raises `PipelineError` for a name
    that no vehicle has.
    """
    if named is not None:
        path = vehicle_file_of(named)
        text = _annotated(path, log)
        if log.has("glider"):
            text = _of_glider(text, log)
        title = str(read_yaml(text).get("title", path.stem))
        return VehicleChoice(path.stem, "named by --vehicle", text, title=title)
    if log.has("glider"):
        text = _of_glider(_annotated(SHIPPED_VEHICLES / "slocum.yaml", log), log)
        why = "figures of a Slocum: the log names no glider"
        return VehicleChoice("slocum", why, _as_guess(_of_any_glider(text), why), guessed=True)
    if log.has("tow"):
        why = "a body under tow: its masses turn drag over mass into newtons"
        return VehicleChoice(OWN_FILE, why, _skeleton(log, ""))
    if normalised:
        why = "commands have no unit of force: only ratios to its mass come out"
        frame_words = unbundled_frame(log)
        if frame_words:
            why = f"{frame_words}: forces in full commands, newtons need a file of your own"
        return VehicleChoice(OWN_FILE, why, _skeleton(log, ""))
    frame = log.info.parameters.get("FRAME_CONFIG")
    if frame is not None and int(frame) in FRAMES:
        name = FRAMES[int(frame)]
        return VehicleChoice(
            name,
            f"FRAME_CONFIG {int(frame)} of the log",
            _annotated(SHIPPED_VEHICLES / f"{name}.yaml", log),
        )
    driven = driven_outputs(log)
    if frame is None and len(driven) in MOTORS_OF_VEHICLE and not unbundled_frame(log):
        name = MOTORS_OF_VEHICLE[len(driven)]
        why = f"{len(driven)} outputs are driven and the log names no frame"
        text = _as_guess(_annotated(SHIPPED_VEHICLES / f"{name}.yaml", log), why)
        return VehicleChoice(name, f"guessed, {why}", _as_moved(text, log), guessed=True)
    return _unknown(log, driven, frame)


def unbundled_frame(log: CheckedLog) -> str:
    """Return in words that no bundled vehicle has the frame of a log, '' otherwise."""
    config, name = log.info.parameters.get("FRAME_CONFIG"), frame_name(log.info.parameters)
    rotors = px4_thrusters(log.info.parameters) if config is None else None
    if rotors is not None:
        count = len(rotors.outputs)
        return f"no bundled vehicle has the geometry of the log (CA_ROTOR_COUNT {count})"
    if config is None or name is None or int(config) in FRAMES:
        return ""
    return f"no bundled vehicle has frame {name} (FRAME_CONFIG {config:g})"


def _as_guess(text: str, why: str) -> str:
    """Return the text of a vehicle file that says of itself that it is a guess."""
    line = (
        "# check: delete the next line when mass and actuators are those of your vehicle\n"
        f'guessed: "{why}"\n'
    )
    return re.sub(r"^(origin: )", line + r"\1", text, count=1, flags=re.MULTILINE)


def _as_moved(text: str, log: CheckedLog) -> str:
    """Return the text of a vehicle file with the directions that a motion has.

    Those of the file are of another vehicle; a log that has its own keeps them.
    """
    if any(f"MOT_{number}_DIRECTION" in log.info.parameters for number in range(1, 9)):
        return text
    directions = directions_by_motion(log, vehicle_of_text(text))
    if directions is None:
        return text
    entry = (
        f'    direction:\n      value: {directions.astype(int).tolist()}\n      unit: "1"\n'
        "      source: the motion of the log\n      assumed: true\n"
    )
    return re.sub(r"^    direction:\n(?:      .*\n)+", entry, text, flags=re.MULTILINE)


def _of_any_glider(text: str) -> str:
    """Return the file of a Slocum with the spreads of gliders, where no log names one.

    Gliders weigh 50 to 75 kg, so that the 70 of a Slocum is at their end (decision 0132);
    lift and induced drag go with their wings.
    """
    text = re.sub(
        r"^(  induced_drag: .*\n)",
        r"\1"
        "  lift_slope_sd: {value: 1.5, unit: 1/rad, source: wings unknown, assumed: true}\n"
        "  induced_drag_sd: {value: 4.0, unit: 1/rad^2, source: wings unknown, assumed: true}\n",
        text,
        flags=re.MULTILINE,
    )
    text = re.sub(
        r"^(  (?:displaced_)?mass: )\{value: 70\.0, .*$",
        r'\1{value: 60.0, unit: kg, source: "gliders weigh 50 to 75 kg", assumed: true}',
        text,
        flags=re.MULTILINE,
    )
    return re.sub(
        r"^  mass: \{value: 5.0, .*$",
        '  mass: {value: 9.0, unit: kg, source: "gliders weigh 50 to 75 kg", assumed: true}',
        text,
        flags=re.MULTILINE,
    )


def _of_glider(text: str, log: CheckedLog) -> str:
    """Return the file of a glider that is neutral in the median water of a log.

    A density that the file has measured stays.
    """
    if "density_kg_m3" not in log.tables["glider"].column_names:
        return text
    density = float(np.nanmedian(log.column("glider", "density_kg_m3")))
    entry = (
        f"  water_density: {{value: {density:.1f}, unit: kg/m^3, source: median of the log,"
        " assumed: true}"
    )
    return re.sub(r"^  water_density: .*assumed: true}$", entry, text, flags=re.MULTILINE)


def _unknown(log: CheckedLog, driven: Sequence[int], frame: float | None) -> VehicleChoice:
    if not driven:
        text = _skeleton(log, FILL_IN_FINS)
        return VehicleChoice(OWN_FILE, "a skeleton", text, "propeller and fins")
    about = (
        f"FRAME_CONFIG {int(frame)} ({FRAME_NAMES.get(int(frame), 'unknown')}) of the log has no"
        " bundled vehicle"
        if frame is not None
        else f"outputs {listed([str(number) for number in driven])} are driven"
    )
    rows = {
        key: "\n".join(f"        - fill in one {words} for output {number}" for number in driven)
        for key, words in (("places", "[x, y, z]"), ("axes", "[x, y, z] of length 1"))
    }
    block = FILL_IN.format(ones=[1] * len(driven), outputs=list(driven), **rows)
    why = f"a skeleton, {about}"
    return VehicleChoice(OWN_FILE, why, _skeleton(log, block), f"{LAYOUT} ({about})")


def _skeleton(log: CheckedLog, actuators: str) -> str:
    template = resources.files(__package__ or "") / "vehicle_skeleton.yaml"
    title = f'"Vehicle of {log.info.vehicle or "a log that names none"}"'
    text = template.read_text(encoding="utf-8")
    return _with_remedies(text.format(name=OWN_FILE, title=title, actuators=actuators))


def _annotated(path: Path, log: CheckedLog) -> str:
    """Return a vehicle file with remedies, outputs and directions of the log."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(
        r"^(  measured_inertia: )(\S+)$",
        lambda match: f"{match[1]}{(path.parent / match[2]).resolve()}",
        text,
        flags=re.MULTILINE,
    )
    parameters = log.info.parameters
    outputs = {
        MOTOR_OF_FUNCTION[function]: number
        for number in range(1, 17)
        if (function := parameters.get(f"SERVO{number}_FUNCTION") or 0.0) in MOTOR_OF_FUNCTION
    }
    listing = re.search(r"^    outputs: \[(.*)\]", text, re.MULTILINE)
    count = len(listing[1].split(",")) if listing else 0
    if listing and set(range(1, count + 1)) <= set(outputs):
        numbers = ", ".join(str(outputs[motor]) for motor in range(1, count + 1))
        text = text.replace(listing[0], f"    outputs: [{numbers}]")
    return _with_remedies(text)


def _with_remedies(text: str) -> str:
    """Return the text with a comment above keys of REMEDIES that hold a figure."""
    lines, before = [], ""
    for line in text.splitlines():
        key = re.match(r"( +)(\w+):", line)
        if key and key[2] in REMEDIES and not before.strip().startswith("# check"):
            lines.append(f"{key[1]}# check: {REMEDIES[key[2]]}")
        lines.append(line)
        before = line
    return "\n".join(lines) + "\n"


def vehicle_of_text(text: str) -> Vehicle:
    """Return the vehicle of the text of its file."""
    return vehicle_from_document(VehicleDocument.model_validate(read_yaml(text)))
