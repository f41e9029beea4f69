"""Actuators whose force is known but for a factor: commands, frames of autopilots.

A force in full commands is 1 in an axis where every thruster of that axis pushes its way
with all it has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import AXES, Array, read_only
from auvid.hydro.dynamics.actuators.thrusters import (
    ThrustCurve,
    Thrusters,
    thruster_allocation,
    thruster_forces,
)

HALF_RANGE_US = 400.0
"""A full command is a pulse so much from the neutral one."""
COMMANDS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Normalised commands in the order of the axes X Y Z K M N."""
UNIT_THRUST = ThrustCurve(
    read_only(NEUTRAL_US + HALF_RANGE_US * np.array([-1.0, 1.0])), read_only([-1.0, 1.0]), 1.0, 0.0
)
"""Thrust of a thruster whose curve is not known: its command, linear, of either sign."""

ARDUSUB_FRAMES: Mapping[str, tuple[tuple[float, ...], ...]] = {
    "bluerov1": (
        (1, 0, 0, 0, 0, -1),
        (1, 0, 0, 0, 0, 1),
        (0, 0, -0.45, -0.5, 0.5, 0),
        (0, 0, -0.45, 0.5, 0.5, 0),
        (0, 0, -1, 0, -1, 0),
        (0, 1, 0, -0.25, 0, 0),
    ),
    "vectored": (
        (-1, 1, 0, 0, 0, 1),
        (-1, -1, 0, 0, 0, -1),
        (1, 1, 0, 0, 0, -1),
        (1, -1, 0, 0, 0, 1),
        (0, 0, 1, 1, 0, 0),
        (0, 0, 1, -1, 0, 0),
    ),
    "vectored_6dof": (
        (-1, 1, 0, 0, 0, 1),
        (-1, -1, 0, 0, 0, -1),
        (1, 1, 0, 0, 0, -1),
        (1, -1, 0, 0, 0, 1),
        (0, 0, 1, 1, -1, 0),
        (0, 0, 1, -1, -1, 0),
        (0, 0, 1, 1, 1, 0),
        (0, 0, 1, -1, 1, 0),
    ),
    "vectored_6dof_90deg": (
        (0, 0, -1, 1, 1, 0),
        (1, 0, 0, 0, 0, 1),
        (0, 0, -1, 1, -1, 0),
        (0, 1, 0, 0, 0, 0),
        (0, 0, -1, -1, 1, 0),
        (1, 0, 0, 0, 0, -1),
        (0, 0, -1, -1, -1, 0),
        (0, -1, 0, 0, 0, 0),
    ),
    "simplerov_3": ((1, 0, 0, 0, 0, -1), (1, 0, 0, 0, 0, 1), (0, 0, 1, 0, 0, 0)),
    "simplerov_4": (
        (1, 0, 0, 0, 0, -1),
        (1, 0, 0, 0, 0, 1),
        (0, 0, 1, 0, 0, 0),
        (0, 0, 1, 0, 0, 0),
    ),
    "simplerov_5": (
        (1, 0, 0, 0, 0, -1),
        (1, 0, 0, 0, 0, 1),
        (0, 0, 1, 0, 0, 0),
        (0, 0, 1, 0, 0, 0),
        (0, 1, 0, 0, 0, 0),
    ),
}
"""Frame -> X Y Z K M N of each motor: the factors of ArduSub's AP_Motors6DOF, whose
throttle is upward. Only the signs are those of the body: its sizes mix, they measure none.
"""
FRAME_OF_CONFIG = tuple(ARDUSUB_FRAMES)
"""FRAME_CONFIG 0 to 6; 7 is a frame of the user's own."""
MOTORS_OF_PX4, MOTOR_OF_PX4 = 12, 101
"""How many rotors PX4 has, and the function of an output that drives the first."""
FUNCTIONS_OF_PX4 = ("PWM_MAIN_FUNC", "PWM_AUX_FUNC", "UAVCAN_EC_FUNC", "HIL_ACT_FUNC")
"""Parameters that say what outputs drive: of the two rows of pulses, of controllers on a
bus, and of a simulator."""


@dataclass(frozen=True)
class FullCommands:
    """What is known of actuators that are told in full commands.

    `axes`: letters that normalised commands drive; none for those that are logged.
    `frame`: layout of the autopilot in the vehicle file, `direction`: of its motors.
    `full_force`: axis -> force of a full command [N, N m], measured. `thrusters`: layout
    with thrust in full commands.
    """

    axes: tuple[str, ...] = ()
    frame: str | None = None
    direction: tuple[int, ...] = ()
    full_force: Mapping[str, float] = field(default_factory=dict)
    thrusters: Thrusters | None = None


def frame_thrusters(frame: str) -> Thrusters:
    """Return the thrusters of a frame of ArduSub, thrust in full commands.

    Raises `KeyError` for a frame that is none of ARDUSUB_FRAMES.
    """
    allocation = np.array(ARDUSUB_FRAMES[frame], dtype=np.float64).T
    count = allocation.shape[1]
    return Thrusters(read_only(allocation), np.ones(count), tuple(range(1, count + 1)), UNIT_THRUST)


def _channels_of(parameters: Mapping[str, float | None], key: str, count: int) -> dict[int, int]:
    """Return rotor -> channel of the outputs of one driver of PX4."""
    channels = {
        int(value) - MOTOR_OF_PX4: channel
        for channel in range(16, 0, -1)
        if (value := parameters.get(f"{key}{channel}")) is not None
    }
    return {rotor: channel for rotor, channel in channels.items() if 0 <= rotor < count}


def px4_thrusters(parameters: Mapping[str, float | None]) -> Thrusters | None:
    """Return the thrusters of PX4's control allocation, None without its geometry.

    Rotor n: place CA_ROTORn_PX, _PY, _PZ [m], axis CA_ROTORn_AX, _AY, _AZ (default
    upward), strength CA_ROTORn_CT. PWM_MAIN_FUNCc = 101 + n names its output c, or the like of
    another driver (`FUNCTIONS_OF_PX4`): the one that has most of the rotors.
    """
    count = min(int(parameters.get("CA_ROTOR_COUNT") or 0), MOTORS_OF_PX4)
    if not count:
        return None

    def of(rotor: int, key: str, default: float) -> float:
        value = parameters.get(f"CA_ROTOR{rotor}_{key}")
        return default if value is None else float(value)

    places = [[of(rotor, key, 0.0) for key in ("PX", "PY", "PZ")] for rotor in range(count)]
    axes = np.array([[of(n, "AX", 0.0), of(n, "AY", 0.0), of(n, "AZ", -1.0)] for n in range(count)])
    axes = axes / np.maximum(np.linalg.norm(axes, axis=1), 1e-9)[:, None]
    strength = np.array([of(rotor, "CT", 1.0) for rotor in range(count)])
    strength = strength / np.abs(strength).max() if np.any(strength) else np.ones(count)
    output = max(
        (_channels_of(parameters, key, count) for key in FUNCTIONS_OF_PX4),
        key=len,  # of those alike the first
    )
    return Thrusters(
        read_only(thruster_allocation(places, axes) * strength),
        np.ones(count),
        tuple(output.get(rotor, rotor + 1) for rotor in range(count)),
        UNIT_THRUST,
    )


def frame_name(parameters: Mapping[str, float | None]) -> str | None:
    """Return the frame that FRAME_CONFIG of a log names, None without or for its own.

    >>> frame_name({"FRAME_CONFIG": 1.0})
    'vectored'
    """
    config = parameters.get("FRAME_CONFIG")
    if config is None or not 0 <= int(config) < len(FRAME_OF_CONFIG):
        return None
    return FRAME_OF_CONFIG[int(config)]


def unscaled(thrusters: Thrusters) -> Thrusters:
    """Return thrusters whose thrust is their command, whatever their curve."""
    return replace(thrusters, curve=UNIT_THRUST)


def full_commands(thrusters: Thrusters) -> Array:
    """Return what all thrusters give in each axis at full thrust (6,), by 1 of each.

    B_i = sum_j |b_ij|; 0 in an axis that no thruster drives.
    """
    return np.asarray(np.abs(thrusters.allocation).sum(axis=1))


def commanded_force(thrusters: Thrusters, pwm_us: ArrayLike) -> Array:
    """Return the force in full commands (..., 6) of pulses (..., n) [us].

    F_i = sum_j b_ij c_j / sum_j |b_ij|, c_j = +-(pulse - 1500 us) / 400 us.

    >>> vectored = frame_thrusters("vectored")
    >>> commanded_force(vectored, [1100, 1100, 1900, 1900, 1500, 1500])[[0, 2, 5]].tolist()
    [1.0, 0.0, 0.0]
    """
    full = full_commands(thrusters)
    force = thruster_forces(thrusters, pwm_us) @ thrusters.allocation.T
    return np.asarray(np.divide(force, full, out=np.zeros_like(force), where=full > 0.0))


def axis_of(command: str) -> str:
    """Return the letter X Y Z K M N of a command, surge to yaw."""
    return AXES[COMMANDS.index(command)]
