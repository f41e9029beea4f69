"""What a fit of x' = a x + b x|x| + c F + d says in units, with intervals.

In newtons 1 / c is the apparent inertia M, and the coefficients are a M, b M, d M. With
commands (F in full commands) M is not determined: time constants, steady speeds and
damping over mass are. One bollard pull P [N at full command] gives M = P / c; one known
M gives the force of a full command, c M. Errors go by the delta method, those of what is
positive in its logarithm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.records.partial import AT_SPEED
from auvid.hydro.arrays import AXES, VELOCITIES, Array

STEP = 1e-6
"""Relative step of derivatives by differences."""
WIDEST = float(np.log(10.0))
"""Largest half width of an interval of a logarithm: one that is wider says nothing."""


@dataclass(frozen=True)
class Scale:
    """What turns commands into newtons: a bollard pull, or a known inertia.

    `pull_N` at full command, or `mass`, with its standard error;
    for an axis of rotation in N m and kg m^2.
    """

    pull_N: float | None = None
    mass: float | None = None
    standard_error: float = 0.0


@dataclass(frozen=True)
class FitQuantity:
    """A number of a fit with error and 95 % interval, nan where undetermined."""

    name: str
    unit: str
    value: float
    standard_error: float
    low: float
    high: float


def quantity(
    name: str,
    unit: str,
    function: Callable[[Array], float],
    values: Array,
    covariance: Array,
    *,
    width: float,
    positive: bool = False,
) -> FitQuantity:
    """Return f(values) with its error: sqrt(g' P g), g by central differences.

    width: standard errors of half an interval; positive: the interval is symmetric in
    the logarithm.
    """
    gradient = np.zeros(len(values))
    with np.errstate(all="ignore"):
        for i, value in enumerate(values):
            step = np.zeros(len(values))
            step[i] = STEP * max(abs(value), float(np.sqrt(covariance[i, i])), 1e-9)
            gradient[i] = (function(values + step) - function(values - step)) / (2.0 * step[i])
        here = function(values)
        error = float(np.sqrt(gradient @ covariance @ gradient))
    if not (np.isfinite(here) and np.isfinite(error)):
        return FitQuantity(name, unit, float("nan"), float("nan"), float("nan"), float("nan"))
    if positive and here > 0.0:
        half = width * error / here
        if half > WIDEST:
            return FitQuantity(name, unit, float("nan"), float("nan"), float("nan"), float("nan"))
        return FitQuantity(name, unit, here, error, here * np.exp(-half), here * np.exp(half))
    return FitQuantity(name, unit, here, error, here - width * error, here + width * error)


def steady_speed(a: float, b: float, c: float) -> float:
    """Return the speed of full command: a x + b x^2 + c = 0, x > 0; nan for none.

    >>> steady_speed(-1.0, 0.0, 0.5)
    0.5
    >>> steady_speed(-1.0, -2.0, 3.0)
    1.0
    """
    root = np.sqrt(a * a - 4.0 * b * c)
    return float(2.0 * c / (root - a)) if root - a > 0.0 else float("nan")


def normalised_quantities(
    axis: str, values: Array, covariance: Array, *, width: float, speed: float
) -> tuple[FitQuantity, ...]:
    """Return what commands determine, of (a, b, c, d) with covariance (4, 4).

    Damping over mass, gain over mass, steady speed per full command, time constants
    from rest, 1 / -a, and about `speed`, 1 / -(a + 2 b speed).
    """
    turning = AXES.index(axis) > 2
    length, x = ("rad" if turning else "m"), VELOCITIES[AXES.index(axis)]

    def about(v: Array) -> float:
        slope = float(-(v[0] + 2.0 * v[1] * speed))
        return 1.0 / slope if slope > 0.0 else float("nan")

    def rest(v: Array) -> float:
        return float(-1.0 / v[0]) if v[0] < 0.0 else float("nan")

    speed = float(f"{speed:.2g}")  # as its name has it

    def steady(v: Array) -> float:
        return steady_speed(*v[:3])

    rows: tuple[tuple[str, str, Callable[[Array], float], bool], ...] = (
        (f"{axis}_{x}/M", "1/s", lambda v: float(v[0]), False),
        (f"{axis}_{x}|{x}|/M", f"1/{length}", lambda v: float(v[1]), False),
        ("full command/M", f"{length}/s^2", lambda v: float(v[2]), True),
        ("steady speed of full command", f"{length}/s", steady, True),
        ("time constant from rest", "s", rest, True),
        (f"{AT_SPEED} {speed:.2g} {length}/s", "s", about, True),
    )
    return tuple(
        quantity(name, unit, f, values, covariance, width=width, positive=positive)
        for name, unit, f, positive in rows
    )


def physical_quantities(
    axis: str, values: Array, covariance: Array, *, width: float, scale: Scale | None = None
) -> tuple[FitQuantity, ...]:
    """Return inertia, damping and constant of (a, b, c, d), with covariance, in SI.

    M, D_1 = a M, D_2 = b M, C = d M. scale: for commands; None where F is in newtons.
    """
    turning = AXES.index(axis) > 2
    x = VELOCITIES[AXES.index(axis)]
    mass_unit, force = ("kg*m^2", "N*m") if turning else ("kg", "N")
    linear, squared = ("N*m*s", "N*m*s^2") if turning else ("N*s/m", "N*s^2/m^2")
    extra = 1.0 if scale is None else (scale.mass if scale.pull_N is None else scale.pull_N)
    assert extra is not None
    both = np.append(values, extra)
    error = np.zeros((5, 5))
    error[:4, :4] = covariance
    error[4, 4] = 0.0 if scale is None else scale.standard_error**2

    def mass(v: Array) -> float:
        return float(v[4] if scale is not None and scale.pull_N is None else v[4] / v[2])

    rows: tuple[tuple[str, str, Callable[[Array], float], bool], ...] = (
        ("M", mass_unit, mass, True),
        (f"{axis}_{x}", linear, lambda v: float(v[0] * mass(v)), False),
        (f"{axis}_{x}|{x}|", squared, lambda v: float(v[1] * mass(v)), False),
        (f"{axis} constant", force, lambda v: float(v[3] * mass(v)), False),
        ("full command", force, lambda v: float(v[2] * mass(v)), True),
    )
    return tuple(
        quantity(name, unit, f, both, error, width=width, positive=positive)
        for name, unit, f, positive in rows
        if scale is not None or name != "full command"
    )
