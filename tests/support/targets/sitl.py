"""Evaluator of ArduPilot's submarine: constants of SIM_Submarine.h and SIM_BUOYANCY.

Read from ArduPilot/ardupilot libraries/SITL/SIM_Submarine.cpp (calculate_forces and the
functions that it calls), SIM_Submarine.h (frame_property) and SIM_Aircraft.cpp
(update_dynamics: gyro += rot_accel dt without gyroscopic moment; the earth's velocity moves
by dcm accel_body plus gravity). Frames FRD and NED. The constants stand in NAME.md as the
lines of the header, the parameters in NAME.parm.
"""

import re
from pathlib import Path

import numpy as np

from tests.support.targets.frames import Array, Body, down

DEFAULTS: dict[str, float | Array] = {
    "water_density": 1023.6,
    "weight": 10.5,
    "thrust": 51.48,
    "thruster_mount_radius": 0.25,
    "equivalent_sphere_radius": 0.2,
    "density": 500.0,
    "linear_drag_coefficient": np.array([1.4, 1.8, 2.0]),
    "angular_drag_coefficient": np.array([1.05, 1.05, 1.05]),
}
"""SIM_Submarine.h, water_density and frame_property."""

ANGULAR_DENSITY = 1000.0
"""calculate_angular_drag_torque has a density of its own."""

FOAM_FORCE, FOAM_ARM = 40.0, 0.15
"""calculate_buoyancy_torque: newtons up, metres."""

BUOYANCY = 1.0
"""SIM_BUOYANCY by default, newtons: SITL.cpp."""


def load(folder: Path, name: str) -> Body:
    """Return the body that ArduPilot moves with folder/NAME.md and folder/NAME.parm."""
    parameters = (folder / f"{name}.parm").read_text()
    return parse((folder / f"{name}.md").read_text(), parameters)


def constants(text: str) -> dict[str, float | Array]:
    """Return the constants of lines such as `float weight = 10.5;` over the header's own."""
    values: dict[str, float | Array] = dict(DEFAULTS)
    for key, value in re.findall(r"\b(\w+)\s*=\s*([-+.\deE]+)f?\s*;", text):
        values[key] = float(value)
    for key, value in re.findall(r"\b(\w+)\s*=\s*Vector3f\(([^)]*)\)", text):
        values[key] = np.array([float(x.strip().rstrip("f")) for x in value.split(",")])
    return values


def parse(header: str, parameters: str) -> Body:
    """Return the body of the header's constants and the parameters, full depth of water."""
    c = constants(header)
    lines = (line.split("#")[0].replace(",", " ").split() for line in parameters.splitlines())
    table = {line[0]: float(line[1]) for line in lines if len(line) > 1}
    changed = re.search(r"put (\S+) m there", header)
    arm = float(changed[1]) if changed else FOAM_ARM
    radius = c["equivalent_sphere_radius"]
    volume = c.get("volume", 4 * np.pi * radius**3 / 3)
    mass = c.get("mass", volume * c["density"])
    moment = c.get("moment_of_inertia", 2 * mass * radius**2 / 5)
    area = c.get("equivalent_sphere_area", np.pi / 4 * (volume * 0.75) ** (2 / 3))
    lift = c["weight"] * table.get("SIM_BUOYANCY", BUOYANCY) / mass

    def force(nu: Array, eta: Array) -> Array:
        v, w, lower = nu[:, :3], nu[:, 3:], down(eta)
        drag = 0.5 * c["water_density"] * area * c["linear_drag_coefficient"] * v * np.abs(v)
        spin = 0.5 * ANGULAR_DENSITY * area * c["angular_drag_coefficient"] * w * np.abs(w)
        foam = np.cross(arm * lower, np.array([0.0, 0.0, -FOAM_FORCE]))
        linear = -lift * lower - drag - c["weight"] * np.cross(w, v)
        return np.hstack([linear, foam - radius * spin])

    return Body(np.diag([c["weight"]] * 3 + [moment] * 3), force)
