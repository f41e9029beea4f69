"""Moments of inertia on a quadrifilar pendulum: Alberti 2015, chapter IV, (54)-(58)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95

LARGE_RAD, NODES = np.pi / 4.0, 400


@dataclass(frozen=True)
class Estimate:
    """A value and its standard error."""

    value: float
    standard_error: float

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval."""
        half = NORMAL_95 * self.standard_error
        return self.value - half, self.value + half


@dataclass(frozen=True)
class QuadrifilarGeometry:
    """A tray on four lines: radii R_1, R_2, line length h [m], tray mass [kg].

    R_1 is at the ceiling, R_2 at the tray; the mass is that of tray and wires.
    `length_sd` [m] and `mass_sd` [kg] are the standard errors of each measured length
    and each weighed mass.
    """

    radius_ceiling: float
    radius_tray: float
    line: float
    tray_mass: float
    gravity: float
    length_sd: float = 0.0
    mass_sd: float = 0.0

    @property
    def drop(self) -> float:
        """Return the height of the ceiling's circle above the tray at rest [m].

        sqrt(h^2 - (R_1 - R_2)^2); h itself where R_1 = R_2, as in (54).
        """
        return float(np.sqrt(self.line**2 - (self.radius_ceiling - self.radius_tray) ** 2))


def equivalent_inertia(geometry: QuadrifilarGeometry, mass: float, period_s: float) -> float:
    """Return I_eq [kg m^2] of all that swings from mass [kg] and period [s]: (56).

    I_eq = m g R_1 R_2 T^2 / (4 pi^2 h), T of small swings.

    >>> tray = QuadrifilarGeometry(0.47, 0.47, 4.23, 9.8, 9.80665)
    >>> round(equivalent_inertia(tray, 9.8, 4.157), 3)
    2.197
    """
    product = geometry.radius_ceiling * geometry.radius_tray
    return mass * geometry.gravity * product * period_s**2 / (4.0 * np.pi**2 * geometry.drop)


def softening(geometry: QuadrifilarGeometry, mass: float, inertia: float) -> float:
    """Return c of w = w_0 (1 - c A^2) [1/rad^2] for swings of amplitude A.

    From the energy to fourth order. The tray hangs z = sqrt(h^2 - 2 R_1 R_2 (1 - cos
    psi)) below the ceiling (h the drop). With q = R_1 R_2 the potential is m g q / h
    (psi^2 / 2 + b psi^4), b = q / (8 h^2) - 1/24, and the kinetic energy I/2 (1 + e
    psi^2) psi_dot^2, e = m q^2 / (h^2 I), so that c = -3/2 (b - e/6). It is 1/16 for
    long lines, the simple pendulum's.
    """
    product = geometry.radius_ceiling * geometry.radius_tray
    bend = product / (8.0 * geometry.drop**2) - 1.0 / 24.0
    heave = mass * product**2 / (geometry.drop**2 * inertia)
    return -1.5 * (bend - heave / 6.0)


def slowing(geometry: QuadrifilarGeometry, mass: float, inertia: float) -> tuple[float, float]:
    """Return (c, e) of w = w_0 (1 - c a^2 - e a^4) [1/rad^2, 1/rad^4].

    a is the amplitude of the rate's first harmonic over w_0. c is that of `softening`;
    e from the exact swing at 45 degrees, so that what is left out there is of the order
    of 1e-5 of the period.
    """
    first = softening(geometry, mass, inertia)
    share, rate = _large_swing(geometry, mass, inertia, LARGE_RAD)
    return first, (1.0 - share - first * rate**2) / rate**4


def small_swing_period(
    geometry: QuadrifilarGeometry, mass: float, period_s: float, amplitude_rad: float
) -> float:
    """Return the period of small swings [s] from one timed at an amplitude."""
    if amplitude_rad == 0.0:
        return period_s
    small = period_s
    for _ in range(
        3
    ):  # how much a large swing is slowed depends a little on the inertia that comes out
        small = (
            period_s
            * _large_swing(
                geometry, mass, equivalent_inertia(geometry, mass, small), amplitude_rad
            )[0]
        )
    return small


def _large_swing(
    geometry: QuadrifilarGeometry, mass: float, inertia: float, amplitude: float
) -> tuple[float, float]:
    """Return w / w_0 and a of an undamped swing of any amplitude, from its energy.

    I (1 + m/I (dz/dpsi)^2) psi_dot^2 / 2 = m g (z(psi) - z(A)). Quarter swing by the
    midpoint rule in u, psi = A sin u, which converges exponentially.
    """
    u = 0.5 * np.pi * (np.arange(NODES) + 0.5) / NODES
    product, psi = geometry.radius_ceiling * geometry.radius_tray, amplitude * np.sin(u)

    def hang(angle: Array) -> Array:
        return np.asarray(np.sqrt(geometry.drop**2 - 2.0 * product * (1.0 - np.cos(angle))))

    slope = product * np.sin(psi) / hang(psi)
    lifted = (
        4.0
        * product
        * np.sin(0.5 * (amplitude + psi))
        * np.sin(0.5 * (amplitude - psi))
        / (hang(psi) + hang(np.array(amplitude)))
    )
    rate = np.sqrt(2.0 * mass * geometry.gravity * lifted / (inertia + mass * slope**2))
    step = 0.5 * np.pi / NODES * amplitude * np.cos(u) / rate
    time = np.cumsum(step) - 0.5 * step
    w = 0.5 * np.pi / float(step.sum())
    small = np.sqrt(mass * geometry.gravity * product / (inertia * geometry.drop))
    harmonic = 4.0 / np.pi * w * float(np.sum(step * rate * np.cos(w * time)))
    return float(w / small), float(harmonic / small)


def object_inertia(
    geometry: QuadrifilarGeometry, mass: float, loaded: Estimate, empty: Estimate
) -> Estimate:
    """Return I_O = I_eq - I_P (57) of an object of this mass [kg].

    `loaded` and `empty` are the periods [s] with and without it on the tray. The
    standard error carries those of both periods, of all lengths (common to both swings)
    and of the masses. Raises `DataError` when the difference is not positive.
    """

    def inertia(x: Array) -> float:
        changed = QuadrifilarGeometry(x[0], x[1], x[2], x[3], geometry.gravity)
        return equivalent_inertia(changed, x[3] + x[4], x[5]) - equivalent_inertia(
            changed, x[3], x[6]
        )

    lengths = [geometry.radius_ceiling, geometry.radius_tray, geometry.line]
    at = np.array([*lengths, geometry.tray_mass, mass, loaded.value, empty.value])
    sd = np.array(
        [geometry.length_sd] * 3
        + [geometry.mass_sd] * 2
        + [loaded.standard_error, empty.standard_error]
    )
    value = inertia(at)
    if value <= 0.0:
        raise DataError(
            "the moment of inertia is negative after the tray's is taken off",
            value=(
                f"{value:.4g} kg m^2 from periods {loaded.value:.4g} s loaded and {empty.value:.4g}"
                " s empty"
            ),
            remedy=(
                "Check the masses, that the radii are radii (not diameters), and that the"
                " recordings are not exchanged."
            ),
        )
    return Estimate(value, float(np.linalg.norm(_gradient(inertia, at) * sd)))


def tray_inertia(geometry: QuadrifilarGeometry, empty: Estimate) -> Estimate:
    """Return I_P [kg m^2] of the tray with its wires from its period alone [s]: (56).

    `equivalent_inertia` of the tray's mass; standard error from those of period, radii,
    line and mass, to first order.
    """

    def inertia(x: Array) -> float:
        return equivalent_inertia(
            QuadrifilarGeometry(x[0], x[1], x[2], x[3], geometry.gravity), x[3], x[4]
        )

    at = np.array(
        [
            geometry.radius_ceiling,
            geometry.radius_tray,
            geometry.line,
            geometry.tray_mass,
            empty.value,
        ]
    )
    sd = np.array([geometry.length_sd] * 3 + [geometry.mass_sd, empty.standard_error])
    return Estimate(inertia(at), float(np.linalg.norm(_gradient(inertia, at) * sd)))


def hollow_cylinder(mass: float, length: float, outer_radius: float, inner_radius: float) -> float:
    """Return I_y = I_z [kg m^2] of a hollow cylinder about its centre: (58).

    m (L^2 / 12 + (R^2 + r^2) / 4); R and r are radii, not diameters as printed (errata
    A14).
    """
    return mass * (length**2 / 12.0 + (outer_radius**2 + inner_radius**2) / 4.0)


def counted_period(oscillations: int, duration_s: float, duration_sd_s: float) -> Estimate:
    """Return period and standard error from a stop watch: T = t / N."""
    return Estimate(duration_s / oscillations, duration_sd_s / oscillations)


def combined(estimates: Sequence[Estimate]) -> Estimate:
    """Return the mean of repeated values weighted by 1 / variance.

    Its standard error is widened where they scatter by more than their errors.
    """
    values = np.array([item.value for item in estimates])
    errors = np.array([item.standard_error for item in estimates])
    if values.size == 1:
        return estimates[0]
    weight = 1.0 / np.maximum(errors, 1e-12 * np.abs(values)) ** 2
    mean = float(weight @ values / weight.sum())
    scatter = float(weight @ (values - mean) ** 2) / (values.size - 1)
    return Estimate(mean, float(np.sqrt(max(1.0, scatter) / weight.sum())))


def _gradient(function: Callable[[Array], float], at: Array) -> Array:
    """Return the central-difference gradient of a function of positive arguments."""
    out = np.empty_like(at)
    for index, value in enumerate(at):
        step = 1e-6 * abs(value)
        high, low = at.copy(), at.copy()
        high[index] += step
        low[index] -= step
        out[index] = (function(high) - function(low)) / (2.0 * step)
    return out
