"""The shape of a vehicle for strip theory (`geometry` of a vehicle document).

It is a hull of revolution and pairs of thin surfaces.

Body axes FRD; x counts from the body origin, heights from the hull's axis.

Equations of Al Makdah 2016.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvid.hydro.arrays import Array

NODES = 32
"""Gauss-Legendre nodes per piece: exact for the polynomial pieces of cylinders and
Myring tails, 1e-5 for a round Myring nose.
"""


class Profile(Protocol):
    """The radius of a hull along x; `knots_m` bound its smooth pieces, tail to nose."""

    @property
    def diameter_m(self) -> float: ...

    @property
    def knots_m(self) -> tuple[float, ...]: ...

    def __call__(self, x_m: ArrayLike) -> Array:
        """Return the radius (...) [m] at x (...) [m], 0 outside the hull."""
        ...


@dataclass(frozen=True)
class Stations:
    """A hull through stations: radius (n,) at ascending x (n,) [m], linear between."""

    x_m: Array
    station_radius_m: Array

    @property
    def diameter_m(self) -> float:
        return 2.0 * float(self.station_radius_m.max())

    @property
    def knots_m(self) -> tuple[float, ...]:
        return tuple(self.x_m.tolist())

    def __call__(self, x_m: ArrayLike) -> Array:
        x = np.asarray(x_m, dtype=np.float64)
        return np.interp(x, self.x_m, self.station_radius_m, left=0.0, right=0.0)


@dataclass(frozen=True)
class Cylinder:
    """A hull of one diameter."""

    tail_x_m: float
    nose_x_m: float
    diameter_m: float

    @property
    def knots_m(self) -> tuple[float, ...]:
        return (self.tail_x_m, self.nose_x_m)

    def __call__(self, x_m: ArrayLike) -> Array:
        return np.where(self._inside(x_m), 0.5 * self.diameter_m, 0.0)

    def _inside(self, x_m: ArrayLike) -> NDArray[np.bool_]:
        x = np.asarray(x_m, dtype=np.float64)
        return (x >= self.tail_x_m) & (x <= self.nose_x_m)


@dataclass(frozen=True)
class Myring(Cylinder):
    """Myring's nose and tail about a cylinder (Prestero 2001, section 2.2).

    nose  r = d/2 [1 - ((x - x_n + a)/a)^2]^(1/n)
    tail  r = d/2 - (3d/(2c^2) - tan(alpha)/c) s^2 + (d/c^3 - tan(alpha)/c^2) s^3

    a nose length `nose_m`, n `exponent`, c tail length `tail_m`, alpha its half-angle
    at the end; s counts from the fore end of the tail backwards.
    """

    nose_m: float
    exponent: float
    tail_m: float
    angle_rad: float

    @property
    def knots_m(self) -> tuple[float, ...]:
        tail, nose = self.tail_x_m, self.nose_x_m
        return (tail, tail + self.tail_m, nose - self.nose_m, nose)

    def __call__(self, x_m: ArrayLike) -> Array:
        x, d, c = np.asarray(x_m, dtype=np.float64), self.diameter_m, self.tail_m
        into_nose = np.clip((x - (self.nose_x_m - self.nose_m)) / self.nose_m, 0.0, 1.0)
        s = np.clip((self.tail_x_m + c) - x, 0.0, c)
        slope = np.tan(self.angle_rad)
        front = 0.5 * d * (1.0 - into_nose**2) ** (1.0 / self.exponent)
        back = 0.5 * d - (1.5 * d / c**2 - slope / c) * s**2 + (d / c**3 - slope / c**2) * s**3
        return np.where(self._inside(x), np.minimum(front, np.maximum(back, 0.0)), 0.0)


@dataclass(frozen=True)
class Hull:
    """A hull of revolution.

    `radius_m` maps x (...) [m] to the radius, 0 outside `tail_x_m`..`nose_x_m`;
    `knots_m` bound its smooth pieces.

    `frontal_area_m2` is the area that the drag formula (2.82) is given;
    `cross_flow_drag` is C_dc of (2.84).
    """

    radius_m: Profile
    tail_x_m: float
    nose_x_m: float
    diameter_m: float
    knots_m: tuple[float, ...]
    frontal_area_m2: float
    cross_flow_drag: float

    @property
    def length_m(self) -> float:
        """l [m]."""
        return self.nose_x_m - self.tail_x_m

    @property
    def slenderness(self) -> float:
        """l / d."""
        return self.length_m / self.diameter_m


@dataclass(frozen=True)
class Surface:
    """A pair of equal thin surfaces (horizontal or vertical), or two crossed pairs.

    Two crossed pairs are `cruciform`. `controlled`: they are the control fins.

    `span_m` b of one surface from root to tip, `area_m2` its planform, `tip_height_m`
    from the hull's axis, `force_x_m` where its force acts, `taper` t of (2.85): width
    of the tip over that of the root.
    """

    name: str
    layout: str
    span_m: float
    area_m2: float
    tip_height_m: float
    rear_x_m: float
    front_x_m: float
    force_x_m: float
    taper: float
    controlled: bool

    @property
    def in_sway(self) -> bool:
        """Return whether a pair stands vertical, so that sway moves water with it."""
        return self.layout in ("cruciform", "vertical")

    @property
    def in_heave(self) -> bool:
        """Return whether a pair lies horizontal."""
        return self.layout in ("cruciform", "horizontal")


@dataclass(frozen=True)
class Geometry:
    """Hull and surfaces."""

    hull: Hull
    surfaces: tuple[Surface, ...]

    @property
    def fins(self) -> Surface | None:
        """Return the controlled surfaces, or None."""
        return next((item for item in self.surfaces if item.controlled), None)

    def integral(self, function: Callable[[Array], Array]) -> float:
        """Return the integral of a function of x [m] over the hull.

        It is taken piece by piece between the knots of the hull and the edges of the
        surfaces.
        """
        low, high = self.hull.tail_x_m, self.hull.nose_x_m
        edges = {
            low,
            high,
            *self.hull.knots_m,
            *(x for item in self.surfaces for x in (item.rear_x_m, item.front_x_m)),
        }
        cuts = np.array(sorted(x for x in edges if low <= x <= high))
        node, weight = np.polynomial.legendre.leggauss(NODES)
        half, middle = 0.5 * np.diff(cuts), 0.5 * (cuts[1:] + cuts[:-1])
        return float(half @ (function(middle[:, None] + half[:, None] * node) @ weight))
