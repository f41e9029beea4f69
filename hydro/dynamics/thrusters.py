"""Fixed thrusters driven by servo pulses: allocation and bollard thrust curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hydro.dynamics.arrays import Array, cross

NO_PULSE_US = 800.0
"""Shorter pulses are no command at all (an autopilot writes 0 when disarmed): the thruster stands still."""

NEUTRAL_US = 1500.0


@dataclass(frozen=True)
class ThrustCurve:
    """Bollard thrust of one thruster type: `force_N` (k,) over `pwm_us` (k,) ascending, measured at `voltage_v`.

    Thrust scales with (V / voltage_v) ** voltage_exponent.
    """

    pwm_us: Array
    force_N: Array
    voltage_v: float
    voltage_exponent: float


@dataclass(frozen=True)
class Thrusters:
    """n thrusters: `position_m` (n, 3) and unit `axis` (n, 3) of positive force in body FRD, `direction` (n,) +1 or -1.

    `outputs` are the autopilot's output channels: thruster i listens to column `pwm_<outputs[i]>_us` of the stream `actuators`.
    """

    position_m: Array
    axis: Array
    direction: Array
    outputs: tuple[int, ...]
    curve: ThrustCurve


def thruster_allocation(position: ArrayLike, axis: ArrayLike) -> Array:
    """B (6, n) with tau = B f: positions (n, 3) [m], unit axes (n, 3), thruster forces f [N]. Column i is [axis; position x axis]."""
    position, axis = np.asarray(position, dtype=np.float64), np.asarray(axis, dtype=np.float64)
    return np.concatenate([axis, cross(position, axis)], axis=-1).T


def thrust_from_pwm(pwm_us: ArrayLike, voltage_v: ArrayLike | None, curve: ThrustCurve) -> Array:
    """Bollard thrust [N] at a pulse width [us]: linear between the points of the table, its dead band kept; any shape.

    The speed controller holds full thrust beyond the ends of the table, so the pulse is clipped there; below `NO_PULSE_US` there is no
    pulse and no thrust; nan stays nan. `voltage_v` is the battery voltage (broadcast), None for the voltage of the curve. Thrust in still
    water: the loss of thrust with inflow is not modelled and ends up in the damping.
    """
    pwm = np.asarray(pwm_us, dtype=np.float64)
    force = np.interp(pwm, curve.pwm_us, curve.force_N)
    force = np.where(pwm < NO_PULSE_US, 0.0, force)
    if voltage_v is not None:
        force = force * (np.asarray(voltage_v, dtype=np.float64) / curve.voltage_v) ** curve.voltage_exponent
    return np.asarray(force)


def thruster_forces(thrusters: Thrusters, pwm_us: ArrayLike, voltage_v: ArrayLike | None = None) -> Array:
    """Force of each thruster along its axis [N]: pulses (..., n) us, voltage (...) V -> (..., n).

    Direction -1 mirrors the pulse about 1500 us: a mirrored propeller or swapped phase wires turn the motor the other way, while the
    strong direction of thrust stays the geometric one, along the axis.
    """
    pwm = np.asarray(pwm_us, dtype=np.float64)
    pulse = np.where(pwm < NO_PULSE_US, pwm, NEUTRAL_US + thrusters.direction * (pwm - NEUTRAL_US))
    voltage = None if voltage_v is None else np.asarray(voltage_v, dtype=np.float64)[..., None]
    return thrust_from_pwm(pulse, voltage, thrusters.curve)


def thruster_force(thrusters: Thrusters, force_N: ArrayLike) -> Array:
    """tau of the thrusters: forces along the axes (..., n) [N] -> (..., 6) [N, N m]."""
    return np.asarray(np.asarray(force_N, dtype=np.float64) @ thruster_allocation(thrusters.position_m, thrusters.axis).T)
