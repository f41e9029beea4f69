"""Control law of an ROV's autopilot, as ArduSub lays it out: modes, gains, mixing.

Attitude by a proportional angle loop over PID of the rates, depth and position by
proportional position and velocity loops, pilot's sticks in body axes, outputs of -1 to 1
per axis mixed by the signs of AP_Motors6DOF. Written for numbers: numba compiles it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import Thrusters

STABILIZE, ALT_HOLD, GUIDED, POSHOLD, MANUAL = 0, 2, 4, 16, 19
"""Numbers of the modes in ArduSub."""
MODES = {
    "stabilize": STABILIZE,
    "alt_hold": ALT_HOLD,
    "guided": GUIDED,
    "poshold": POSHOLD,
    "manual": MANUAL,
}
STICKS = ("roll", "pitch", "heave", "yaw", "forward", "lateral")
"""Order of sticks and outputs; heave is positive down, as z is."""
MEMORY = 14
"""Numbers that the autopilot keeps from tick to tick."""
RELEASED = 0.02
"""Stick within this of the middle: the autopilot holds."""


class AutopilotGains(NamedTuple):
    """Gains of the loops; defaults are those of ArduSub where it has them.

    Outputs per axis are -1 to 1. `lean_rad`, `turn_rad_s`, `climb_m_s`: what a full
    stick asks for.
    """

    angle: float = 6.0  # ATC_ANG_*_P [1/s]
    rate_p: float = 0.135  # ATC_RAT_RLL_P, PIT
    rate_i: float = 0.09
    rate_d: float = 0.0036
    yaw_p: float = 0.18  # ATC_RAT_YAW_P
    yaw_i: float = 0.018
    depth: float = 1.0  # PSC_POSZ_P [1/s]
    heave_p: float = 0.8  # PSC_VELZ_P times PSC_ACCZ_P [s/m]
    heave_i: float = 0.8  # [1/m]
    place: float = 0.8  # position to velocity [1/s]
    drive_p: float = 0.7  # velocity to output [s/m]
    drive_i: float = 0.25
    lean_rad: float = 0.6
    turn_rad_s: float = 1.0
    climb_m_s: float = 0.4
    fastest_m_s: float = 0.5
    integral: float = 0.45  # largest integral part of an output


def autopilot_step(
    memory: Array,
    gains: AutopilotGains,
    mode: int,
    stick: Array,
    target: Array,
    pose: tuple[float, ...],
    nu: tuple[float, ...],
    step_s: float,
    out: Array,
) -> None:
    """Write the outputs (6,) in the order of STICKS, and renew `memory` (MEMORY,).

    `stick` (6,) -1 to 1; `target` (6,): north, east [m], their rates [m/s], heading
    [rad], depth [m]; `pose` and `nu` (6) as the autopilot's filter has them. `memory`:
    integrals of p, q, r, heave, forward, lateral; last errors of the rates; heading,
    depth; the mode before (-1 at first); north and east held.
    """
    phi, theta, psi = pose[3], pose[4], pose[5]
    changed = memory[11] != mode
    if changed:
        memory[9], memory[10], memory[11] = psi, pose[2], mode
        memory[4], memory[5] = 0.0, 0.0
    if mode == MANUAL:
        for i in range(6):
            out[i], memory[i] = stick[i], 0.0
        return
    # Heading: a stick turns, a released stick holds; a guided vehicle turns to its goal.
    guided = mode == GUIDED
    turning = 0.0
    if guided:
        memory[9] = target[4]
    elif abs(stick[3]) > RELEASED:
        turning = gains.turn_rad_s * stick[3]
        memory[9] += turning * step_s
    error_psi = memory[9] - psi
    error_psi -= 2.0 * np.pi * np.floor(error_psi / (2.0 * np.pi) + 0.5)
    if abs(turning) > 0.0:  # no lead of more than 20 degrees
        error_psi = min(max(error_psi, -0.35), 0.35)
        memory[9] = psi + error_psi
    lean_phi = 0.0 if guided else gains.lean_rad * stick[0]
    lean_theta = 0.0 if guided else gains.lean_rad * stick[1]
    goal_rates = (
        gains.angle * (lean_phi - phi),
        gains.angle * (lean_theta - theta),
        gains.angle * error_psi + turning,
    )
    for i in range(3):
        error = min(max(goal_rates[i], -3.0), 3.0) - nu[3 + i]
        p, k, d = (
            (gains.yaw_p, gains.yaw_i, 0.0)
            if i == 2
            else (gains.rate_p, gains.rate_i, gains.rate_d)
        )
        memory[i] = min(max(memory[i] + k * error * step_s, -gains.integral), gains.integral)
        slope = 0.0 if changed else (error - memory[6 + i]) / step_s
        memory[6 + i] = error
        out[(0, 1, 3)[i]] = p * error + memory[i] + d * slope
    # Velocities north, east, down from the filter.
    sf, cf, st, ct = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    sp, cp = np.sin(psi), np.cos(psi)
    level_u = ct * nu[0] + st * (sf * nu[1] + cf * nu[2])
    level_v = cf * nu[1] - sf * nu[2]
    down = -st * nu[0] + ct * (sf * nu[1] + cf * nu[2])
    if mode == STABILIZE:
        out[2] = stick[2]
        memory[3] = 0.0
    else:
        if guided:
            memory[10] = target[5]
        climbing = 0.0 if guided else gains.climb_m_s * stick[2]
        memory[10] += climbing * step_s
        sink = min(max(gains.depth * (memory[10] - pose[2]) + climbing, -0.5), 0.5)
        error = sink - down
        memory[3] += gains.heave_i * error * step_s
        memory[3] = min(max(memory[3], -gains.integral), gains.integral)
        out[2] = gains.heave_p * error + memory[3]
    if guided or mode == POSHOLD:
        north, east, north_dot, east_dot = target[0], target[1], target[2], target[3]
        if not guided:
            moving = abs(stick[4]) > RELEASED or abs(stick[5]) > RELEASED
            if changed or moving:
                memory[12], memory[13] = pose[0], pose[1]
            ahead, side = gains.fastest_m_s * stick[4], gains.fastest_m_s * stick[5]
            north, east = memory[12], memory[13]
            north_dot, east_dot = cp * ahead - sp * side, sp * ahead + cp * side
        north_dot += gains.place * (north - pose[0])
        east_dot += gains.place * (east - pose[1])
        shrink = max(np.sqrt(north_dot**2 + east_dot**2) / gains.fastest_m_s, 1.0)
        error_u = (cp * north_dot + sp * east_dot) / shrink - level_u
        error_v = (cp * east_dot - sp * north_dot) / shrink - level_v
        memory[4] += gains.drive_i * error_u * step_s
        memory[5] += gains.drive_i * error_v * step_s
        memory[4] = min(max(memory[4], -gains.integral), gains.integral)
        memory[5] = min(max(memory[5], -gains.integral), gains.integral)
        out[4] = gains.drive_p * error_u + memory[4]
        out[5] = gains.drive_p * error_v + memory[5]
    else:
        out[4], out[5] = stick[4], stick[5]


def frame_factors(thrusters: Thrusters) -> Array:
    """Return the factors of AP_Motors6DOF (n, 6): thruster outputs of axis outputs.

    Thrusters along z serve heave, roll and pitch, the others yaw, forward and lateral;
    each factor is the sign of what the thruster does there, as ArduPilot's frames have
    them.
    """
    force = thrusters.allocation
    upright = np.abs(force[2]) > 0.5
    signs = np.sign(np.where(np.abs(force) > 1e-6, force, 0.0))
    vertical = np.where(upright, signs[[3, 4, 2]], 0.0)
    level = np.where(upright, 0.0, signs[[5, 0, 1]])
    return np.ascontiguousarray(np.concatenate([vertical, level]).T)


def mixed_pulses(
    factors: Array, direction: Array, outputs: Array, pulses: NDArray[np.int64]
) -> None:
    """Write the pulses (n,) [us] of axis outputs (6,), as AP_Motors6DOF mixes them.

    Outputs of the group roll, pitch, heave are scaled together where one passes 1, and
    so are those of yaw, forward, lateral; pulse = 1500 + 400 direction output, 1100 to
    1900.
    """
    most_upright, most_level = 1.0, 1.0
    for i in range(len(pulses)):
        row = factors[i]
        upright = row[0] * outputs[0] + row[1] * outputs[1] + row[2] * outputs[2]
        level = row[3] * outputs[3] + row[4] * outputs[4] + row[5] * outputs[5]
        most_upright, most_level = max(most_upright, abs(upright)), max(most_level, abs(level))
    for i in range(len(pulses)):
        row = factors[i]
        upright = row[0] * outputs[0] + row[1] * outputs[1] + row[2] * outputs[2]
        level = row[3] * outputs[3] + row[4] * outputs[4] + row[5] * outputs[5]
        share = upright / most_upright + level / most_level
        share = min(max(share, -1.0), 1.0)
        pulses[i] = int(np.floor(1500.0 + 400.0 * direction[i] * share + 0.5))
