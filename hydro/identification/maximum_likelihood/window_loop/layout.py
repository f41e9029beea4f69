"""Sizes and places of states, outputs and parameters in the loop, and its noise."""

from __future__ import annotations

from typing import NamedTuple

from auvid.hydro.arrays import Array

MOTION, FORCE, MEASURED, BIASES = 10, 6, 13, 6
VISCOUS, INERTIA, LAG = 0, 1, 2
"""Kinds of parameters: a coefficient of a viscous term or constant (axis, column of the
tables), an entry of the mass matrix (row, column), the lag of the actuators."""

Workspace = tuple[Array, ...]
"""Arrays that a function may write to: made once a loop, since making them costs."""


class Noise(NamedTuple):
    """Variances (13,) of samples; variance (6,) and rate 1/T (6,) of the force."""

    sensor: Array
    force: Array
    decay: Array
