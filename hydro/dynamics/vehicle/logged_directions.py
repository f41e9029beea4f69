"""How the motors of a vehicle turn and push, as its autopilot was told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.dynamics.actuators.commands import (
    FullCommands,
    frame_name,
    frame_thrusters,
    px4_thrusters,
)
from auvid.hydro.dynamics.actuators.thrusters import Thrusters
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle

MOTOR_OF_FUNCTION = {32.0 + motor: motor for motor in range(1, 9)} | {
    73.0 + motor: motor for motor in range(9, 13)
}
"""ArduPilot's SERVOc_FUNCTION: 33 to 40 are motors 1 to 8, 82 to 85 motors 9 to 12."""


@dataclass(frozen=True)
class UnscaledLayout:
    """How outputs become forces in full commands, and who says so.

    `sized`: it has lengths. The factors of a frame mix commands: only their signs are those
    of the body. `frame`: its name, None for another layout.
    """

    thrusters: Thrusters
    source: str
    sized: bool
    frame: str | None = None


def layout_without_curve(
    commands: FullCommands, parameters: Mapping[str, float | None]
) -> UnscaledLayout | None:
    """Return the layout of thrusters without a curve, or None.

    The vehicle file's thrusters, its frame, FRAME_CONFIG of the log, or PX4's geometry.
    """
    if commands.thrusters is not None:
        return UnscaledLayout(commands.thrusters, "the layout of the vehicle file", True)
    frame = commands.frame or frame_name(parameters)
    if frame is not None:
        where = "the vehicle file" if commands.frame else "FRAME_CONFIG of the log"
        thrusters = frame_thrusters(frame)
        if len(commands.direction) == len(thrusters.outputs):
            thrusters = replace(thrusters, direction=np.array(commands.direction, dtype=float))
        thrusters = joined_as_logged(thrusters, parameters)
        return UnscaledLayout(thrusters, f"frame {frame} of {where}", False, frame)
    of_px4 = px4_thrusters(parameters)
    return None if of_px4 is None else UnscaledLayout(of_px4, "CA_ROTOR of the log", True)


def with_logged_directions(
    vehicle: Vehicle, parameters: Mapping[str, float | None]
) -> tuple[Vehicle, str]:
    """Return the vehicle with the motor directions that the log records.

    They are the parameters MOT_n_DIRECTION (ArduSub), if the log has one for every
    thruster.

    Motor n is the one that SERVOc_FUNCTION assigns to the thruster's output c; without
    that parameter n = c. Second item: a sentence that says where the directions come
    from, empty for a vehicle without thrusters.
    """
    if vehicle.thrusters is None:
        return vehicle, ""
    thrusters = turned_as_logged(vehicle.thrusters, parameters)
    if thrusters is None:
        return (
            vehicle,
            "Motor directions are those of the vehicle file; the log does not hold them all.",
        )
    return (
        replace(vehicle, thrusters=thrusters),
        "Motor directions are those of the log's parameters MOT_n_DIRECTION.",
    )


def joined_as_logged(thrusters: Thrusters, parameters: Mapping[str, float | None]) -> Thrusters:
    """Return the motors of a frame at the outputs that SERVOc_FUNCTION gives them.

    Motor n that no output names is at output n. Motors stay at their own outputs where one
    of those is another motor's (`motors_without_output`).
    """
    outputs = _outputs_of_motors(len(thrusters.outputs), parameters)
    if len(outputs) < len(thrusters.outputs):
        return thrusters
    return replace(thrusters, outputs=tuple(outputs[motor] for motor in sorted(outputs)))


def motors_without_output(
    thrusters: Thrusters, parameters: Mapping[str, float | None]
) -> tuple[int, ...]:
    """Return the motors of a frame that no output drives by SERVOc_FUNCTION."""
    count = len(thrusters.outputs)
    outputs = _outputs_of_motors(count, parameters)
    return tuple(motor for motor in range(1, count + 1) if motor not in outputs)


def _outputs_of_motors(count: int, parameters: Mapping[str, float | None]) -> dict[int, int]:
    """Return motor -> output, without motors whose output has another function."""
    functions = {output: parameters.get(f"SERVO{output}_FUNCTION") for output in range(16, 0, -1)}
    outputs = {motor: motor for motor in range(1, count + 1) if not functions[motor]}
    for output, function in functions.items():
        motor = MOTOR_OF_FUNCTION.get(function or 0.0)
        if motor is not None and motor <= count:
            outputs[motor] = output
    return outputs


def turned_as_logged(
    thrusters: Thrusters, parameters: Mapping[str, float | None]
) -> Thrusters | None:
    """Return thrusters that turn as MOT_n_DIRECTION says, None where one is missing."""
    motors = [
        MOTOR_OF_FUNCTION.get(parameters.get(f"SERVO{output}_FUNCTION") or 0.0, output)
        for output in thrusters.outputs
    ]
    logged = [parameters.get(f"MOT_{motor}_DIRECTION") for motor in motors]
    directions = [float(value) for value in logged if value in (1.0, -1.0)]
    if len(directions) < len(logged):
        return None
    return replace(thrusters, direction=np.array(directions))
