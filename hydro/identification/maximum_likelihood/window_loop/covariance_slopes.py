"""Derivatives of the covariance by parameters and noise, in single precision."""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array, Ints, Singles
from auvid.hydro.identification.maximum_likelihood.window_loop.compiling import compiled
from auvid.hydro.identification.maximum_likelihood.window_loop.layout import (
    FORCE,
    INERTIA,
    LAG,
    MOTION,
    VISCOUS,
    Noise,
)

TINY = np.float32(1e-28)
"""Where sums of single precision start, since numbers that fade to nothing are slow."""


@compiled
def carry_tangents(
    D: Singles,
    Phi: Array,
    fade: Array,
    push: Array,
    product: Array,
    h: float,
    noise: Noise,
    inverse: Array,
    kinds: Ints,
    places: tuple[Ints, int, int],
    pull0: Array,
    pull1: Array,
    T: Singles,
    b: Array,
    w: Array,
    mean: Array,
) -> None:
    """Replace the derivatives D (n, n, q) of P by those after a step; lower half.

    D <- Phi D Phi' + B w' + w B' + dQ with dPhi = B m', w = Phi P m: every parameter adds
    to A a product of a force on one axis and the gradient of a term, every time constant
    one entry. B = int exp(A s) ds b and m = (1 + Phi') gradient / 2 are good to second
    order. `product`: Phi P.
    """
    n, q, size = MOTION + FORCE, D.shape[2], len(kinds)
    times, forces = places[1], places[2]
    # Phi D, its upper rows; below them the force only fades.
    for i in range(MOTION):
        for j in range(n):
            write_gathered(Phi[i], D, j, T[i, j])
    for i in range(n):
        for j in range(i + 1):
            if i < MOTION:
                for d in range(q):
                    D[i, j, d] = TINY
                for k in range(0, n, 4):
                    e0, e1 = np.float32(Phi[j, k]), np.float32(Phi[j, k + 1])
                    e2, e3 = np.float32(Phi[j, k + 2]), np.float32(Phi[j, k + 3])
                    for d in range(q):
                        D[i, j, d] += (
                            e0 * T[i, k, d] + e1 * T[i, k + 1, d]
                            + e2 * T[i, k + 2, d] + e3 * T[i, k + 3, d]
                        )  # fmt: skip
            elif j < MOTION:
                single = np.float32(fade[i])
                for d in range(q):
                    D[i, j, d] = single * T[j, i, d]
            else:
                single = np.float32(fade[i] * fade[j])
                for d in range(q):
                    D[i, j, d] = single * D[i, j, d] + TINY
    # What the parameters change of Phi, axis by axis of their force.
    for p in range(size):
        for row in range(6):
            if kinds[p, 0] == LAG or (kinds[p, 0] == VISCOUS and row != kinds[p, 1]):
                continue
            for i in range(MOTION):
                b[i] = 0.0
                for k in range(6):
                    b[i] += (push[0, i, k] + push[1, i, k]) * inverse[6 * k + row]
            for j in range(n):
                mean[j] = 0.5 * pull0[p, row, j]
                if j >= MOTION:
                    mean[j] += 0.5 * fade[j] * pull1[p, row, j]
            for k in range(MOTION):
                a = 0.5 * pull1[p, row, k]
                if a != 0.0:
                    for j in range(n):
                        mean[j] += a * Phi[k, j]
            for i in range(n):
                w[i] = 0.0
                for j in range(n):
                    w[i] += product[i, j] * mean[j]
            for i in range(MOTION, n):
                b[i] = 0.0
            add_pair(D, p, b, w)
    # What the time constants change of Phi and, with the sizes, of the news of a step.
    for k in range(n - MOTION):
        f = MOTION + k
        z = noise.decay[k] * h
        for i in range(MOTION):
            b[i] = 0.5 * z * Phi[i, f]
        for i in range(MOTION, n):
            b[i] = 0.0
        b[f] = z * fade[f]
        for i in range(n):
            w[i] = product[i, f]
        if q > size:
            add_pair(D, times + k, b, w)
        new = noise.force[k] * (1.0 - fade[f] * fade[f])
        if q > size:
            add_news(D, times + k, k, h, -2.0 * noise.force[k] * fade[f] * fade[f] * z, inverse)
            add_news(D, forces + k, k, h, 2.0 * new, inverse)
        for p in range(size):
            if kinds[p, 0] == INERTIA:
                # The news act through M^-1, whose derivative is -M^-1 E M^-1.
                row, column = kinds[p, 1], kinds[p, 2]
                for i in range(6):
                    b[4 + i] = -inverse[6 * i + row] * inverse[6 * column + k]
                    if row != column:
                        b[4 + i] -= inverse[6 * i + column] * inverse[6 * row + k]
                    b[4 + i] *= 0.5 * h
                    w[4 + i] = 0.5 * h * inverse[6 * i + k] * new
                for i in range(4):
                    b[i] = w[i] = 0.0
                for i in range(MOTION, n):
                    b[i] = w[i] = 0.0
                w[f] = new
                add_pair(D, p, b, w)


@compiled
def sample_tangents(
    D: Singles,
    P: Array,
    h_row: Array,
    gain: Array,
    variance: float,
    own: float,
    place: int,
    kinds: Ints,
    lever: Array,
    pull: Array,
    dg: Singles,
) -> None:
    """Update D by one scalar sample; write `dg` (n + 1, q), the last row d(variance).

    dg = variance d(gain / variance). `own`, `place`: variance of the sample and its place
    among directions, -1 for none.
    `lever` (parameters, 6), where it has rows: what a unit of force on an axis adds to the
    sample, so that parameters turn h by lever . pull.
    """
    n, q = MOTION + FORCE, dg.shape[1]
    ds = dg[n]
    for i in range(n):
        write_gathered(h_row, D, i, dg[i])
    for d in range(q):
        ds[d] = 0.0
    for p in range(len(kinds) if len(lever) > 0 else 0):
        for row in range(6):
            if kinds[p, 0] == LAG or (kinds[p, 0] == VISCOUS and row != kinds[p, 1]):
                continue
            for j in range(n):
                a = lever[row] * pull[p, row, j]
                if a != 0.0:
                    ds[p] += a * gain[j]
                    for i in range(n):
                        dg[i, p] += a * P[i, j]
    for i in range(n):
        if h_row[i] != 0.0:
            single = np.float32(h_row[i])
            for d in range(q):
                ds[d] += single * dg[i, d]
    if place >= 0:
        ds[place] += 2.0 * own
    # P - g g' / s and its derivative, with dg - K ds / 2 in the place of dg.
    for i in range(n):
        single = np.float32(0.5 * gain[i] / variance)
        for d in range(q):
            dg[i, d] -= single * ds[d]
    for i in range(n):
        first = np.float32(gain[i] / variance)
        for j in range(i + 1):
            second = np.float32(gain[j] / variance)
            for d in range(q):
                D[i, j, d] -= second * dg[i, d] + first * dg[j, d]
    for i in range(n):
        single = np.float32(0.5 * gain[i] / variance)
        for d in range(q):
            dg[i, d] -= single * ds[d]


@compiled
def write_gathered(row: Array, D: Singles, j: int, out: Array) -> None:
    """Write row . D[:, j, :] (q,) of a symmetric D, stored as its lower half."""
    for d in range(len(out)):
        out[d] = TINY
    for k in range(0, len(row), 4):
        e0, e1 = np.float32(row[k]), np.float32(row[k + 1])
        e2, e3 = np.float32(row[k + 2]), np.float32(row[k + 3])
        if e0 == 0.0 and e1 == 0.0 and e2 == 0.0 and e3 == 0.0:
            continue
        d0 = D[k, j] if k > j else D[j, k]
        d1 = D[k + 1, j] if k + 1 > j else D[j, k + 1]
        d2 = D[k + 2, j] if k + 2 > j else D[j, k + 2]
        d3 = D[k + 3, j] if k + 3 > j else D[j, k + 3]
        for d in range(len(out)):
            out[d] += e0 * d0[d] + e1 * d1[d] + e2 * d2[d] + e3 * d3[d]


@compiled
def add_pair(D: Singles, d: int, b: Array, w: Array) -> None:
    """Add b w' + w b' to one derivative, lower half."""
    for i in range(len(b)):
        for j in range(i + 1):
            D[i, j, d] += b[i] * w[j] + w[i] * b[j]


@compiled
def add_news(D: Singles, d: int, k: int, h: float, variance: float, inverse: Array) -> None:
    """Add what news of the k-th force of a variance add to P, lower half."""
    f = MOTION + k
    for i in range(6):
        a = 0.5 * h * inverse[6 * i + k] * variance
        D[f, 4 + i, d] += a
        for j in range(i + 1):
            D[4 + i, 4 + j, d] += a * 0.5 * h * inverse[6 * j + k]
    D[f, f, d] += variance
