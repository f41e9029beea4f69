"""Fixed thrusters driven by servo pulses: allocation and bollard thrust curves.

Equations of Alberti 2015.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array, cross

NO_PULSE_US = 800.0
"""Shorter pulses are no command at all (an autopilot writes 0 when disarmed): the
thruster stands still.
"""

FULL_COMMAND = 100.0


@dataclass(frozen=True)
class ThrustCurve:
    """Bollard thrust of one thruster type.

    `force_N` (k,) over `pwm_us` (k,) ascending, measured at `voltage_v`.

    Thrust scales with (V / voltage_v) ** voltage_exponent. With `polynomial` (highest
    power first), force [N] of a command of 0 to 100, the pulses are those of the
    commands -100 and 100, and the table is not used between them (`polynomial_thrust`).
    """

    pwm_us: Array
    force_N: Array
    voltage_v: float
    voltage_exponent: float
    polynomial: Array | None = None


@dataclass(frozen=True)
class Thrusters:
    """Thrusters with `allocation` (6, n) and `direction` (n,) +1 or -1.

    A column of the allocation is force and moment [N, N m] of 1 N of a thruster, body
    FRD.

    `outputs` are the autopilot's output channels: thruster i listens to column
    `pwm_<outputs[i]>_us` of the stream `actuators`.
    """

    allocation: Array
    direction: Array
    outputs: tuple[int, ...]
    curve: ThrustCurve


def thruster_allocation(position: ArrayLike, axis: ArrayLike) -> Array:
    """Return B (6, n) of tau = B f from positions (n, 3) [m] and unit axes (n, 3).

    f: thruster forces [N]. Column i is [axis; position x axis].
    """
    position, axis = np.asarray(position, dtype=np.float64), np.asarray(axis, dtype=np.float64)
    return np.concatenate([axis, cross(position, axis)], axis=-1).T


def thrust_from_pwm(pwm_us: ArrayLike, voltage_v: ArrayLike | None, curve: ThrustCurve) -> Array:
    """Return the bollard thrust [N] at a pulse width [us], any shape.

    Linear between the points of the table, its dead band kept, or by polynomial.

    The speed controller holds full thrust beyond the ends of the table, so the pulse is
    clipped there; below `NO_PULSE_US` there is no pulse and no thrust; nan stays nan.
    `voltage_v` is the battery voltage (broadcast), None for the voltage of the curve.
    Thrust in still water: the loss of thrust with inflow is not modelled and ends up in
    the damping.
    """
    pwm = np.asarray(pwm_us, dtype=np.float64)
    if curve.polynomial is None:
        force = np.interp(pwm, curve.pwm_us, curve.force_N)
    else:
        command = np.interp(
            pwm, [curve.pwm_us[0], NEUTRAL_US, curve.pwm_us[-1]], [-FULL_COMMAND, 0.0, FULL_COMMAND]
        )
        force = polynomial_thrust(command, curve.polynomial)
    force = np.where(pwm < NO_PULSE_US, 0.0, force)
    if voltage_v is not None:
        force = (
            force
            * (np.asarray(voltage_v, dtype=np.float64) / curve.voltage_v) ** curve.voltage_exponent
        )
    return np.asarray(force)


def polynomial_thrust(command: ArrayLike, coefficients: ArrayLike) -> Array:
    """Return the thrust [N] of a command of -100 to 100 by a polynomial.

    Highest power first; the polynomial holds for commands above 0: Alberti 2015 (59).

    The odd extension, sign(c) P(|c|) and 0 at 0, since (59) is positive everywhere and
    so means commands above 0 only; between 0 and its smallest thrust the curve jumps,
    as the fit does not pass through the origin.
    """
    command = np.asarray(command, dtype=np.float64)
    return np.asarray(
        np.sign(command) * np.polyval(np.asarray(coefficients, dtype=np.float64), np.abs(command))
    )


def thruster_forces(
    thrusters: Thrusters, pwm_us: ArrayLike, voltage_v: ArrayLike | None = None
) -> Array:
    """Return the force of each thruster along its axis [N]: (..., n).

    Pulses (..., n) [us], voltage (...) [V].

    Direction -1 mirrors the pulse about 1500 us: a mirrored propeller or swapped phase
    wires turn the motor the other way, while the strong direction of thrust stays the
    geometric one, along the axis.
    """
    pwm = np.asarray(pwm_us, dtype=np.float64)
    pulse = np.where(pwm < NO_PULSE_US, pwm, NEUTRAL_US + thrusters.direction * (pwm - NEUTRAL_US))
    voltage = None if voltage_v is None else np.asarray(voltage_v, dtype=np.float64)[..., None]
    return thrust_from_pwm(pulse, voltage, thrusters.curve)


def thruster_force(thrusters: Thrusters, force_N: ArrayLike) -> Array:
    """tau of the thrusters: forces along the axes (..., n) [N] -> (..., 6) [N, N m]."""
    return np.asarray(np.asarray(force_N, dtype=np.float64) @ thrusters.allocation.T)
