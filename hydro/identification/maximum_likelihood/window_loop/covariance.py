"""Covariance of the state over a step."""

from __future__ import annotations

from auvid.hydro.arrays import Array
from auvid.hydro.identification.maximum_likelihood.window_loop.compiling import compiled
from auvid.hydro.identification.maximum_likelihood.window_loop.layout import MOTION
from auvid.hydro.identification.maximum_likelihood.window_loop.transition import write_product


@compiled
def carry_covariance(
    P: Array,
    Phi: Array,
    fade: Array,
    h: float,
    variance: Array,
    inverse: Array,
    T: Array,
) -> None:
    """Replace P by Phi P Phi' + Q of the force that is new within the step.

    Phi P stays in T.
    """
    n = len(P)
    write_product(Phi, P, T)
    for i in range(MOTION, n):
        for j in range(n):
            T[i, j] = fade[i] * P[i, j]
    for i in range(n):
        for j in range(i + 1):
            if j < MOTION:
                total = 0.0
                for k in range(n):
                    total += T[i, k] * Phi[j, k]
            else:
                total = T[i, j] * fade[j]
            P[i, j] = P[j, i] = total
    # The force is linear between the ends of the step: half of what is new acts in it.
    for k in range(n - MOTION):
        q = variance[k] * (1.0 - fade[MOTION + k] * fade[MOTION + k])
        for i in range(6):
            a = 0.5 * h * inverse[6 * i + k]
            P[4 + i, MOTION + k] += a * q
            P[MOTION + k, 4 + i] += a * q
            for j in range(6):
                P[4 + i, 4 + j] += a * q * 0.5 * h * inverse[6 * j + k]
        P[MOTION + k, MOTION + k] += q
