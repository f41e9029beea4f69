"""The shape of a vehicle as strip theory sees it: a hull of revolution and pairs of
thin surfaces (`geometry` of a vehicle document).

Body axes FRD; x counts from the body origin, heights from the hull's axis.

Equations of Al Makdah 2016.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.quantities import Quantities

HULL_SHAPES = ("cylinder", "myring", "stations")
LAYOUTS = ("cruciform", "horizontal", "vertical")
NODES = 32
"""Gauss-Legendre nodes per piece: exact for the polynomial pieces of cylinders and
Myring tails, 1e-5 for a round Myring nose.
"""


@dataclass(frozen=True)
class Hull:
    """A hull of revolution. `radius_m` maps x (...) [m] to the radius, 0 outside
    `tail_x_m`..`nose_x_m`; `knots_m` bound its smooth pieces.

    `frontal_area_m2` is the area that the drag formula (2.82) is given;
    `cross_flow_drag` is C_dc of (2.84).
    """

    radius_m: Callable[[ArrayLike], Array]
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
    """A pair of equal thin surfaces (horizontal or vertical), or two crossed pairs
    (cruciform). `controlled`: they are the control fins.

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
        """Whether a pair stands vertical, so that sway moves water with it."""
        return self.layout in ("cruciform", "vertical")

    @property
    def in_heave(self) -> bool:
        """Whether a pair lies horizontal."""
        return self.layout in ("cruciform", "horizontal")


@dataclass(frozen=True)
class Geometry:
    """Hull and surfaces."""

    hull: Hull
    surfaces: tuple[Surface, ...]

    @property
    def fins(self) -> Surface | None:
        """The controlled surfaces, or None."""
        return next((item for item in self.surfaces if item.controlled), None)

    def integral(self, function: Callable[[Array], Array]) -> float:
        """Integral of a function of x [m] over the hull, piece by piece between the
        knots of the hull and the edges of the surfaces.
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


def geometry_from_document(document: Mapping[str, Any]) -> Geometry:
    """The geometry of a vehicle document (schema `vehicle`, key `geometry`).

    Raises `CampaignError` when there is none, when an area, length or diameter is not
    positive, when a surface lies ahead of or behind the hull, does not rise above it or
    does not touch it, and when a profile's pieces do not fit its length.
    """
    read = Quantities(document).part("geometry")
    if "hull" not in read:
        raise CampaignError(
            "the vehicle has no geometry",
            field="geometry.hull",
            remedy=(
                "Strip theory needs the shape of the hull and its fins: give the block `geometry`"
                " in the vehicle file."
            ),
        )
    hull = _hull(read.part("hull"))
    surfaces = read.part("surfaces")
    names = list(document["geometry"].get("surfaces") or {})
    return Geometry(hull, tuple(_surface(name, surfaces.part(name), hull) for name in names))


def _positive(read: Quantities, key: str, unit: str, *, default: float | None = None) -> float:
    value = read.number(key, unit, default=default)
    if value <= 0.0:
        raise CampaignError(
            "must be positive",
            field=f"{read.where(key)}.value",
            value=value,
            allowed=f"more than 0 {unit}",
        )
    return value


def _hull(read: Quantities) -> Hull:
    shape = str(read.plain("shape", "cylinder"))
    if shape not in HULL_SHAPES:
        raise CampaignError(
            "unknown hull shape", field=read.where("shape"), value=shape, allowed=HULL_SHAPES
        )
    if shape == "stations":
        x, r = (
            read.array("station_x", "m", shape=(-1,)),
            read.array("station_radius", "m", shape=(-1,)),
        )
        if (
            len(x) < 2
            or len(x) != len(r)
            or np.any(np.diff(x) <= 0.0)
            or np.any(r < 0.0)
            or not np.any(r > 0.0)
        ):
            raise CampaignError(
                "stations need two or more ascending x with a radius, not negative, each",
                field=read.where("station_x"),
                value=x.tolist(),
            )
        tail, nose, diameter = float(x[0]), float(x[-1]), 2.0 * float(r.max())
        profile, knots = _through_stations(x, r), tuple(x.tolist())
    else:
        length, diameter = _positive(read, "length", "m"), _positive(read, "diameter", "m")
        nose = read.number("nose_x", "m", default=0.5 * length)
        tail = nose - length
        profile, knots = _cylinder(tail, nose, diameter), (tail, nose)
        if shape == "myring":
            profile, knots = _myring(read, tail=tail, nose=nose, diameter=diameter)
    return Hull(
        radius_m=profile,
        tail_x_m=tail,
        nose_x_m=nose,
        diameter_m=diameter,
        knots_m=knots,
        frontal_area_m2=_positive(read, "frontal_area", "m^2", default=0.25 * np.pi * diameter**2),
        cross_flow_drag=_positive(read, "cross_flow_drag", "1", default=1.1),
    )


def _through_stations(x: Array, r: Array) -> Callable[[ArrayLike], Array]:
    return lambda at: np.interp(np.asarray(at, dtype=np.float64), x, r, left=0.0, right=0.0)


def _cylinder(tail: float, nose: float, diameter: float) -> Callable[[ArrayLike], Array]:
    def radius(at: ArrayLike) -> Array:
        x = np.asarray(at, dtype=np.float64)
        return np.where((x >= tail) & (x <= nose), 0.5 * diameter, 0.0)

    return radius


def _myring(
    read: Quantities, *, tail: float, nose: float, diameter: float
) -> tuple[Callable[[ArrayLike], Array], tuple[float, ...]]:
    """Myring's nose and tail about a cylinder (Prestero 2001, section 2.2): nose length
    a, exponent n, tail length c, tail half-angle.
    """
    a, c = _positive(read, "nose_length", "m"), _positive(read, "tail_length", "m")
    n, angle = _positive(read, "nose_exponent", "1"), _positive(read, "tail_angle", "rad")
    if a + c > nose - tail:
        raise CampaignError(
            "nose and tail are longer than the hull",
            field=read.where("tail_length"),
            value=a + c,
            allowed=f"at most {nose - tail:g} m together",
        )

    def radius(at: ArrayLike) -> Array:
        x = np.asarray(at, dtype=np.float64)
        into_nose = np.clip((x - (nose - a)) / a, 0.0, 1.0)
        s = np.clip((tail + c) - x, 0.0, c)
        front = 0.5 * diameter * (1.0 - into_nose**2) ** (1.0 / n)
        slope = np.tan(angle)
        back = (
            0.5 * diameter
            - (1.5 * diameter / c**2 - slope / c) * s**2
            + (diameter / c**3 - slope / c**2) * s**3
        )
        inside = (x >= tail) & (x <= nose)
        return np.where(inside, np.minimum(front, np.maximum(back, 0.0)), 0.0)

    return radius, (tail, tail + c, nose - a, nose)


def _surface(name: str, read: Quantities, hull: Hull) -> Surface:
    layout = str(read.plain("layout", ""))
    if layout not in LAYOUTS:
        raise CampaignError(
            "unknown layout of surfaces", field=read.where("layout"), value=layout, allowed=LAYOUTS
        )
    rear, front = read.number("x_rear", "m"), read.number("x_front", "m")
    surface = Surface(
        name=name,
        layout=layout,
        span_m=_positive(read, "span", "m"),
        area_m2=_positive(read, "area", "m^2"),
        tip_height_m=_positive(read, "tip_height", "m"),
        rear_x_m=rear,
        front_x_m=front,
        force_x_m=read.number("x_force", "m", default=0.5 * (rear + front)),
        taper=_positive(read, "taper", "1", default=1.0),
        controlled=bool(read.plain("controlled", False)),
    )
    if front <= rear:
        raise CampaignError(
            "the front of a surface is not ahead of its rear",
            field=read.where("x_front"),
            value=front,
            allowed=f"above {rear:g} m",
        )
    if rear < hull.tail_x_m or front > hull.nose_x_m:
        raise CampaignError(
            "the surface lies outside the hull",
            field=read.where("x_rear"),
            value=(rear, front),
            allowed=f"{hull.tail_x_m:g} to {hull.nose_x_m:g} m",
            remedy="x counts from the body origin, positive forward.",
        )
    below = hull.radius_m(np.linspace(rear, front, NODES))
    if surface.tip_height_m <= float(below.max()):
        raise CampaignError(
            "the surface does not rise above the hull",
            field=read.where("tip_height"),
            value=surface.tip_height_m,
            allowed=f"more than {float(below.max()):g} m, the radius of the hull there",
        )
    root = surface.tip_height_m - surface.span_m
    if root > 0.5 * hull.diameter_m * (1.0 + 1e-6):
        raise CampaignError(
            "the surface does not touch the hull",
            field=read.where("span"),
            value=surface.span_m,
            allowed=(
                f"at least {surface.tip_height_m - 0.5 * hull.diameter_m:g} m, so that its root"
                " reaches the hull"
            ),
        )
    return surface
