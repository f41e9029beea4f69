"""Where the iteration starts: a force from a Kalman filter, then least squares.

The filter knows mass, restoring force and actuators and takes all else as an unsteady
force, wide and slow; its estimate is regressed on the terms of the model, axis by axis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis_rows, eta_ratio, needs_propeller_speed
from auvid.hydro.identification.maximum_likelihood.gauss_newton import maximise
from auvid.hydro.identification.maximum_likelihood.likelihood import (
    BIASES,
    Likelihood,
    NoiseModel,
)
from auvid.hydro.identification.maximum_likelihood.parameters import UnknownParameters
from auvid.hydro.identification.maximum_likelihood.records import LegRecord, rough_sd
from auvid.hydro.identification.maximum_likelihood.windows import cut_windows
from auvid.hydro.identification.regression.least_squares import CONSTANT

START_SD = np.repeat([0.05, 0.5, 0.5, 0.2], [3, 1, 3, 3])
"""Prior of the motion at the start of a leg [rad, m, m/s, rad/s], about what the first
samples say: several times wider than they are."""
BIAS_STEPS = 3
SETTLE_S = 2.0
"""What the filter needs before its force is used [s]."""


def starting_values(
    legs: Sequence[LegRecord], parameters: UnknownParameters
) -> tuple[Array, Array, NoiseModel]:
    """Return theta (k,), biases (legs, 6) and a noise to start from.

    The unsteady force starts with what the regression leaves.
    """
    vehicle = parameters.vehicle
    windows, _ = cut_windows(legs, length_s=None)
    free = UnknownParameters(vehicle, {})
    likelihood = Likelihood(legs, windows, free, True, START_SD)
    noise = wide_noise(legs, vehicle)
    common = np.zeros(likelihood.unknowns)
    starts = likelihood.first_starts(common.reshape(-1, BIASES))

    none = np.full(likelihood.unknowns, np.inf)
    optimum = maximise(
        likelihood.under(noise, starts),
        common,
        np.zeros((0, 10)),
        lower=-none,
        upper=none,
        most_steps=BIAS_STEPS,
    )
    runs = likelihood.run(optimum.common, starts, noise, sensitive=False)
    motions, forces, ratios, numbers = [], [], [], []
    for window, run in zip(windows, runs, strict=True):
        late = window.t_s >= window.t_s[0] + min(SETTLE_S, 0.2 * np.ptp(window.t_s))
        record = legs[window.leg].actuators
        motions.append(run.states[late, 4:10])
        forces.append(run.states[late, 10:16])
        numbers.append(np.full(int(late.sum()), window.leg))
        if record.propeller_rev_s is not None and vehicle.propeller is not None:
            n = np.interp(window.t_s[late], record.t_s, record.propeller_rev_s)
            ratios.append(eta_ratio(level_speed(vehicle.propeller, n), motions[-1]))
    nu, force, leg = np.vstack(motions), np.vstack(forces), np.concatenate(numbers)
    ratio = np.concatenate(ratios) if ratios else None
    values: dict[str, float] = {}
    left = np.empty((len(legs), 6))
    for number, axis in enumerate(AXES):
        rest = force[:, number]
        for term, value in parameters.fixed.get(axis, {}).items():
            rest = rest - value * _column(term, nu, ratio)
        terms = parameters.terms.get(axis, ())
        if terms:
            design = np.stack([_column(term, nu, ratio) for term in terms], axis=-1)
            scale = np.maximum(np.linalg.norm(design, axis=0), np.finfo(float).tiny)
            solution = np.linalg.lstsq(design / scale, rest, rcond=1e-6)[0] / scale
            rest = rest - design @ solution
            values |= {f"{axis} {t}": float(v) for t, v in zip(terms, solution, strict=True)}
        left[:, number] = [np.sqrt(np.mean(rest[leg == i] ** 2)) for i in range(len(legs))]
    assert noise.time_s is not None
    biases = likelihood.split(optimum.common)[1]
    return (
        parameters.vector(values),
        biases,
        NoiseModel(noise.sensor_sd, np.maximum(left, 1e-12), 0.5 * noise.time_s),
    )


def wide_noise(legs: Sequence[LegRecord], vehicle: Vehicle) -> NoiseModel:
    """Return a noise whose force is as large as actuators and gravity together."""
    size = []
    for leg in legs:
        start, end = leg.span_s()
        t = np.linspace(start, end, max(int((end - start) * 10.0), 2))
        motion, values = leg.motion(t), leg.actuators.columns()
        inputs = np.stack([np.interp(t, leg.actuators.t_s, column) for column in values.T], axis=-1)
        eta = np.zeros((len(t), 6))
        eta[:, 2:] = motion[:, [3, 0, 1, 2]]
        thrusters = 0 if vehicle.thrusters is None else len(vehicle.thrusters.direction)
        bare = Control(
            propeller_rev_s=inputs[:, 0],
            fins_rad=inputs[:, 1:5],
            thruster_force_N=np.zeros((len(t), thrusters)),
        )
        parts = residual_force(vehicle, eta, motion[:, 4:], np.zeros((len(t), 6)), bare)
        size.append(np.sqrt(np.mean((parts.tau_bar - inputs[:, 5:]) ** 2, axis=0)))
    force = np.array(size)
    floor = 1e-3 * np.diag(vehicle.mass_matrix)
    return NoiseModel(rough_sd(list(legs)), np.maximum(force, floor), np.ones(6))


def _column(term: str, nu: Array, ratio: Array | None) -> Array:
    if term == CONSTANT:
        return np.ones(len(nu))
    row = basis_rows(nu.T, ratio if needs_propeller_speed(term) else None, (term,))[0]
    return np.asarray(row)
