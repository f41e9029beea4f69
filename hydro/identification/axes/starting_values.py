"""Coefficients to start from: the integral of the motion, by least squares in bounds.

    x(t) - x(0) - int Coriolis dt = x_0 + sum_t theta_t int phi_t dt

over each window, with terms phi and Coriolis at the measured velocities. Their noise
enters the regressors, so that this is a start and no estimate.
"""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import AXES, Array
from auvid.hydro.identification.axes.pooled_fit import Pool, loop_rows, parts_of
from auvid.hydro.identification.axes.structure import (
    CONSTANT,
    INERTIA,
    INPUT,
    LINEAR,
    QUADRATIC,
    RESTORING,
    SHARE,
    SIDES,
    AxisTerm,
)


def starting_values(pool: Pool) -> Array:
    """Return coefficients (t,) of the structure of a pool, within their bounds."""
    from scipy.optimize import lsq_linear

    rows = loop_rows(pool, pool.drive)
    products, weights = pool.structure.coriolis
    out = np.zeros(len(pool.structure.terms))
    for i, place in enumerate(pool.structure.places):
        own = [
            j
            for j, term in enumerate(pool.structure.terms)
            if AXES[place] == term.axis and term.kind != SHARE
        ]
        terms = [pool.structure.terms[j] for j in own]
        matrix, target = [], []
        for window in pool.windows:
            data = pool.prepared[window.leg]
            nodes, parts = window.nodes, parts_of(data.step_s)
            nu = data.nu[nodes].copy()
            for j, other in enumerate(pool.structure.places):
                nu[:, other] = data.start[nodes, j]
            first = 6 + len(pool.structure.places)
            drive = rows[window.leg][:: 2 * parts][nodes][:, first:]
            angle = data.start[nodes, len(pool.structure.places) + i]
            turning = np.zeros(len(nu))
            for (row, a, b, up, down), weight in zip(products, weights, strict=True):
                by = [pool.structure.terms[j].name for j in (up, down) if j >= 0]
                if row == i and all(name == INERTIA for name in by):  # others need coefficients
                    turning += weight * nu[:, a] * nu[:, b]
            columns = np.column_stack([_value(term, nu, drive, angle) for term in terms])
            part = np.cumsum(columns, axis=0) * data.step_s
            left = nu[:, place] - np.cumsum(turning) * data.step_s
            matrix.append(part - part.mean(axis=0))
            target.append(left - left.mean())
        # Fixed terms go to the left; priors are rows of the size of the target's errors.
        a, y = np.vstack(matrix), np.concatenate(target)
        fixed = np.array([term.sd == 0.0 for term in terms])
        y = y - a[:, fixed] @ np.array([term.mean for term in terms])[fixed]
        size = 0.1 * float(np.std(y)) * np.sqrt(len(y))
        prior = [
            (j, term.mean, size / term.sd) for j, term in enumerate(terms) if 0.0 < term.sd < np.inf
        ]
        for j, mean, weight in prior:
            line = np.zeros(len(terms))
            line[j] = weight
            a, y = np.vstack([a, line]), np.append(y, weight * mean)
        lower, upper = (np.array([getattr(t, end) for t in terms]) for end in ("lower", "upper"))
        solution = np.array([term.mean for term in terms])
        free = ~fixed
        solution[free] = lsq_linear(
            a[:, free], y, bounds=(lower[free] - 1e-9, upper[free] + 1e-9)
        ).x
        out[own] = solution
    return out


def _value(term: AxisTerm, nu: Array, drive: Array, angle: Array) -> Array:
    """Return the term at measured velocities nu (n, 6), inputs and angle."""
    if term.kind == INPUT:
        return drive[:, term.of]
    if term.kind == CONSTANT:
        return np.ones(len(nu))
    if term.kind == RESTORING:
        return np.sin(angle)
    x = nu[:, term.of]
    if term.kind in SIDES["ahead"]:
        x = np.maximum(x, 0.0)
    elif term.kind in SIDES["back"]:
        x = np.minimum(x, 0.0)
    linear = (LINEAR, SIDES["ahead"][0], SIDES["back"][0])
    assert term.kind in (*linear, QUADRATIC, SIDES["ahead"][1], SIDES["back"][1])
    return x if term.kind in linear else np.asarray(x * np.abs(x))
