"""How far a force that moves the vehicle leans the coefficients of least squares.

A force that no term has, as of a wake, waves or a tether, moves the vehicle: the velocities
go with it, and least squares takes a part of it for damping that is too small, or for
couplings (simultaneity; Young 2011, Recursive Estimation, chapter 6). A longer dive does not
cure it. The force error e = tau_bar - K xi has its own past in it, and the inertia of the
vehicle says what motion that past has caused:

    d_nu(t) = integral over s <= `REACH_S` of Phi(t, t-s) M^-1 e(t-s) ds

with Phi of the linearised motion. X'e has the expectation sum of (dx/dnu d_nu) e', which
stands here as a change of the normal equations, one for each of the six velocities: what
they do may cancel, and each is known to a factor only. Noise of a sensor moves nothing: its
force is a derivative, and what of it goes with its own past is that noise once more, which
errors of the velocities count.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.regression.normal_changes import NormalChange, StridedLeg

REACH_S = 1.0
"""How long ago a force may have acted: some correlation times of an unsteady force, and about
as long as the damping of a vehicle lets its motion last (decision 0093).
"""
LINEARISED = 10
"""Samples over which the motion is linearised about one of them: a second, of every fifth one
at 50 Hz.
"""
POWER_BAND_HZ = 0.1
"""Width of the band over which powers of motion are compared (decision 0107)."""


def unsteady_changes(
    part: StridedLeg,
    coefficients: Array,
    force_slopes: Array,
    mass: Array,
    *,
    nu_dot: Array,
    step_s: float,
    accelerations: Sequence[str] = (),
) -> tuple[NormalChange, ...]:
    """Return what the force error does by each of the six velocities it moves.

    coefficients (6, k): of the terms of `part`; force_slopes (ceil(m / LINEARISED), 6, 6): of
    the measured force [axis, velocity] at every `LINEARISED`-th sample; mass (6, 6): with
    added mass; nu_dot (m, 6): as measured, at `part`; step_s: between its samples;
    accelerations: the six terms of `part` that are these, where inertia is fitted. They go
    with the force error itself: M^-1 e.
    """
    error = part.forces - part.rows @ coefficients.T
    error = error - error.mean(axis=0)
    slopes = coefficients @ part.slopes[::LINEARISED] - force_slopes
    rates = without_gain(np.asarray(np.linalg.solve(mass, slopes), dtype=np.float64), mass)
    pushed = np.linalg.solve(mass, error.T).T
    moved = caused_motion(rates, pushed, step_s)
    pushed += np.einsum("mij,mj->mi", rates[np.arange(len(error)) // LINEARISED], moved)
    if accelerations:
        pushed = no_more_than(nu_dot, pushed, step_s)
    none, changes = np.zeros((len(part.terms),) * 2), []
    for i in range(6):
        rows = part.slopes[:, :, i] * moved[:, [i]]
        if accelerations:
            rows[:, part.terms.index(accelerations[i])] = pushed[:, i]
        changes.append(NormalChange(part.terms, none, part.weight * rows.T @ error))
    return tuple(changes)


def caused_motion(rates: Array, accelerations: Array, step_s: float) -> Array:
    """Return what accelerations (m, 6) of the last `REACH_S` add to the velocities.

    accelerations and result (m, 6); rates (ceil(m / LINEARISED), 6, 6): d(nu_dot)/d(nu) of
    `LINEARISED` samples each. Trapezoids.
    """
    half, unit = 0.5 * step_s * rates, np.eye(6)
    onward = np.linalg.solve(unit - half, unit + half).transpose(0, 2, 1)
    lags, count = max(1, round(REACH_S / step_s)), len(accelerations)
    share, earlier = np.zeros((2, len(rates) * LINEARISED, 6))
    share[:count] = step_s * accelerations
    moved = 0.5 * share
    for lag in range(1, lags + 1):
        earlier[1:] = share[:-1]
        # What a second has of samples goes on by one matrix: one product for all of them.
        share = (earlier.reshape(-1, LINEARISED, 6) @ onward).reshape(-1, 6)
        moved += share if lag < lags else 0.5 * share
    return np.asarray(moved[:count])


def no_more_than(measured: Array, caused: Array, step_s: float) -> Array:
    """Return what was caused (m, 6), at no frequency more than was measured (m, 6).

    Thrusters of a vehicle that holds a heading answer what a force does to it, and so does a
    hull that rights itself: of what the force alone would cause a part is left. That part is
    among what was measured, so its power is at most that of the whole, about each frequency
    (`POWER_BAND_HZ`).
    """
    from scipy.ndimage import uniform_filter1d

    count, taper = len(caused), np.hanning(len(caused) + 2)[1:-1, None]
    bins = 1 + 2 * max(1, round(POWER_BAND_HZ * count * step_s))

    def power(series: Array) -> Array:
        spectrum = np.fft.rfft((series - series.mean(axis=0)) * taper, 2 * count, axis=0)
        smooth = uniform_filter1d(np.abs(spectrum) ** 2, bins, axis=0, mode="nearest")
        return np.asarray(np.maximum(smooth, 0.0))

    least = np.finfo(float).tiny
    share = np.sqrt(np.minimum(1.0, power(measured) / np.maximum(power(caused), least)))
    spectrum = share * np.fft.rfft(caused, 2 * count, axis=0)
    return np.asarray(np.fft.irfft(spectrum, 2 * count, axis=0)[:count])


def without_gain(rates: Array, mass: Array) -> Array:
    """Return rates (m, 6, 6) by which no motion gains energy.

    Least squares that leans may push: what gains kinetic energy is left out, of the
    symmetric part of M^1/2 A M^-1/2.
    """
    sizes, axes = np.linalg.eigh(mass)
    root, inverse = (axes * np.sqrt(sizes)) @ axes.T, (axes / np.sqrt(sizes)) @ axes.T
    scaled = root @ rates @ inverse
    symmetric = 0.5 * (scaled + scaled.transpose(0, 2, 1))
    gains, directions = np.linalg.eigh(symmetric)
    lossy = (directions * np.minimum(gains, 0.0)[:, None, :]) @ directions.transpose(0, 2, 1)
    return np.asarray(inverse @ (scaled - symmetric + lossy) @ root)
