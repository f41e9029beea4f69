"""Transition of a step: the matrix exponential of mean Jacobians."""

from __future__ import annotations

from auvid.hydro.arrays import Array
from auvid.hydro.identification.maximum_likelihood.window_loop.compiling import compiled
from auvid.hydro.identification.maximum_likelihood.window_loop.layout import MOTION


@compiled
def step_transition(
    A0: Array,
    A1: Array,
    h: float,
    decay: Array,
    Phi: Array,
    fade: Array,
    push: Array,
    mean: Array,
    power: Array,
    product: Array,
) -> None:
    """Write Phi = exp(A h) to fourth order, A the mean over the step, and `push`.

    push (2, 10, 6): what accelerations at both ends of the step, linear between, do to
    the motion: h (phi1 - phi2) and h phi2 of A h, phi1 = sum z^k / (k + 1)!, phi2 = sum
    z^k / (k + 2)! (Higham 2008, 10.7.4). For a linear motion it is the map of
    Runge-Kutta 4 itself. The force fades by `fade` and does not depend on the motion.
    """
    n = Phi.shape[1]
    for i in range(MOTION):
        for j in range(n):
            mean[i, j] = 0.5 * h * (A0[i, j] + A1[i, j])
            power[i, j] = Phi[i, j] = 0.0
        power[i, i] = Phi[i, i] = 1.0
        for k in range(6):
            push[0, i, k] = push[1, i, k] = 0.0
        if i >= 4:
            push[0, i, i - 4] = push[1, i, i - 4] = 0.5 * h
    for k in range(n - MOTION):
        z = decay[k] * h
        fade[MOTION + k] = 1.0 - z * (1.0 - z / 2.0 * (1.0 - z / 3.0 * (1.0 - z / 4.0)))
    factorial = 1.0
    for order in range(1, 5):
        # power = mean^order of the whole matrix, whose lower rows are -decay h.
        write_product(mean, power, product)
        factorial *= order
        for k in range(n - MOTION):
            z = 1.0
            for _ in range(1, order):
                z *= -decay[k] * h
            for i in range(MOTION):
                product[i, MOTION + k] += mean[i, MOTION + k] * z
        for i in range(MOTION):
            for j in range(n):
                power[i, j] = product[i, j]
                Phi[i, j] += power[i, j] / factorial
            if order < 4:
                late = h / (factorial * (order + 1.0) * (order + 2.0))
                for k in range(6):
                    push[1, i, k] += late * power[i, 4 + k]
                    push[0, i, k] += late * (order + 1.0) * power[i, 4 + k]


@compiled
def write_product(left: Array, right: Array, out: Array) -> None:
    """Write left . right into the first rows of `out`, zeros left out."""
    for i in range(len(left)):
        for j in range(right.shape[1]):
            out[i, j] = 0.0
        for k in range(len(right)):
            a = left[i, k]
            if a != 0.0:
                for j in range(right.shape[1]):
                    out[i, j] += a * right[k, j]
