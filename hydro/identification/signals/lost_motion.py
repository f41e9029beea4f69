"""How far a low-pass leans coefficients, by what it took from the motion.

A low-pass F leaves the force F[Phi(nu)] K, and least squares explains it by Phi(F nu).
Of linear terms the two are one. Of drag they differ: u|u| of the motion is not that of
what is left of it, and neither are the Coriolis force and fins. What F took nobody
knows, but a somewhat lower low-pass takes alike from what is left:

    dS = X2' (X2 - F[X1]),    dq = X2' (f2 - F[f1]),

X1 the columns as they are, X2 those of the motion passed once more, f the known forces.
The force itself does not come in, so that its noise does not.

A smoothing spline of one sensor takes from its channel alone, and of it the fast part
(`lost_by_spline`).

Limits: a motion of which the low-pass left nothing is not seen. Of one at less than
about .7 of the band in which the vehicle moves, a part of the lean is.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, Ints, cross
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis_rows, eta_ratio
from auvid.hydro.identification.regression.assumed_figures import MeasuredLeg
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.regression.normal_changes import NormalChange
from auvid.hydro.identification.signals.filters import (
    edge_zone_s,
    spline_lowpass,
    zero_phase_lowpass,
)
from auvid.hydro.long_series.threads import at_once

SMOOTHED_SHARE = 3.0
"""What a spline took away over what it takes from its own result: 3 to 5 for the pitch
and surge accelerations of the VT 690 twin (benchmarks/coverage_least_squares.py).
"""
HELD_BELOW = 0.1
"""Of the cutoff of an accelerometer's spline: slower velocities are those of other sensors."""
LOWER = 1.25
"""The second low-pass lies so much below the first: its lean is then that of the first
(decision 0075).
"""
PER_PERIOD = 8.0
"""Samples per period of the cutoff; products of three velocities reach thrice as far."""
PIECE = 4096
"""Samples of which all columns are in memory at once."""
FEWEST_EDGES = 4
"""A piece has to be so many edge zones long."""


def lost_by_spline(
    leg: MeasuredLeg,
    vehicle: Vehicle,
    index: int,
    cutoff_hz: float,
    *,
    accelerometer: bool,
    stride: int,
) -> tuple[Array, Array]:
    """Return force and velocities (m, 6) that the spline of a channel took, strided.

    (F - 1) of its velocity and acceleration with F the spline's response, times
    `SMOOTHED_SHARE`, as the motion has passed F already. accelerometer: that of one, which
    measures v_dot + w x v; the velocity lacks the integral, where no other sensor holds it.
    """

    def lost(values: Array) -> Array:
        passed = spline_lowpass(values, cutoff_hz, step_s=leg.step_s)
        return np.asarray(SMOOTHED_SHARE * (passed - values))

    d_nu, d_nu_dot = np.zeros((2, *leg.nu.shape))
    turn = leg.nu[:, 3:]
    if accelerometer:
        d_nu_dot[:, index] = lost(leg.nu_dot[:, index] + cross(turn, leg.nu[:, :3])[:, index])
        steps = leg.step_s * d_nu_dot[:, index]
        integral = np.cumsum(steps) - 0.5 * steps
        slow = spline_lowpass(integral, HELD_BELOW * cutoff_hz, step_s=leg.step_s)
        d_nu[:, index] = integral - slow
        d_nu_dot[:, :3] -= cross(turn, d_nu[:, :3])
    else:
        d_nu[:, index], d_nu_dot[:, index] = lost(leg.nu[:, index]), lost(leg.nu_dot[:, index])
    every, d_nu = leg.every(stride), d_nu[::stride].copy()  # a view would keep all samples
    before, after = (
        residual_force(vehicle, every.eta, nu, nu_dot, every.control).tau_bar
        for nu, nu_dot in (
            (every.nu, every.nu_dot),
            (every.nu + d_nu, every.nu_dot + d_nu_dot[::stride]),
        )
    )
    return after - before, d_nu


def lost_motion(
    leg: MeasuredLeg,
    vehicle: Vehicle,
    terms: Sequence[str],
    *,
    ratio: ArrayLike | None,
    cutoff_hz: float,
) -> NormalChange:
    """Return what the low-pass of a leg did to the normal equations of `terms`.

    ratio (n,): propulsion ratio u_c(n) / U; cutoff_hz: of the low-pass that all of the
    leg passed. No change of a leg that is too short.
    """
    stride = max(1, int(1.0 / (PER_PERIOD * cutoff_hz * leg.step_s)))
    every = leg.every(stride)
    level = None
    if ratio is not None:
        speed = np.linalg.norm(every.nu[:, :3], axis=1)
        level = np.asarray(ratio, dtype=np.float64)[::stride] * speed
    count = max(1, round(len(every.nu) / PIECE))
    places = np.array_split(np.arange(len(every.nu)), count)

    def of_piece(place: Ints) -> NormalChange:
        return _of_piece(
            every.rows(slice(place[0], place[-1] + 1)),
            vehicle,
            tuple(terms),
            level=None if level is None else level[place],
            cutoff_hz=cutoff_hz / LOWER,
            weight=len(leg.nu) / len(every.nu),
        )

    return reduce(NormalChange.merge, at_once(of_piece, places))


def _of_piece(
    leg: MeasuredLeg,
    vehicle: Vehicle,
    terms: tuple[str, ...],
    *,
    level: Array | None,
    cutoff_hz: float,
    weight: float,
) -> NormalChange:
    size = len(terms) + 1
    edge = int(np.ceil(edge_zone_s(cutoff_hz) / leg.step_s))
    if len(leg.nu) <= FEWEST_EDGES * edge:
        return NormalChange((*terms, CONSTANT), np.zeros((size, size)), np.zeros((size, 6)))
    t_s = np.arange(len(leg.nu)) * leg.step_s

    def passed(values: Array) -> Array:
        return zero_phase_lowpass(t_s, values, cutoff_hz=cutoff_hz)

    after = MeasuredLeg(
        passed(leg.eta),
        passed(leg.nu),
        passed(leg.nu_dot),
        Control(
            **{
                name: None if part is None else passed(np.asarray(part))
                for name, part in vars(leg.control).items()
            }
        ),
        leg.step_s,
    )
    inner = slice(edge, len(t_s) - edge)
    before_rows, rows = (_rows(item.nu, level, terms) for item in (leg, after))
    before_force, force = (
        residual_force(vehicle, item.eta, item.nu, item.nu_dot, item.control).tau_bar
        for item in (leg, after)
    )
    left = weight * len(t_s) / (len(t_s) - 2 * edge) * rows[inner].T
    return NormalChange(
        (*terms, CONSTANT),
        left @ (rows - passed(before_rows))[inner],
        left @ (force - passed(before_force))[inner],
    )


def _rows(nu: Array, level: Array | None, terms: tuple[str, ...]) -> Array:
    """Return the columns (n, k + 1) of terms and the constant."""
    ratio = None if level is None else eta_ratio(level, nu)
    return np.column_stack([basis_rows(nu.T, ratio, terms).T, np.ones(len(nu))])
