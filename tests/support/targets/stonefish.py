"""Evaluator of a Stonefish scenario: one robot with a box as its base link, under water.

Read from patrykcieslak/stonefish b21eb8e1, Library/src: core/ScenarioParser.cpp:1942-2134,
entities/SolidEntity.cpp (657 added mass, 849 ellipsoid, 1263 drag coefficients, 1723 drag,
1833 buoyancy), entities/FeatherstoneEntity.cpp (37 inertia, 649 weight),
entities/solids/Box.cpp, graphics/OpenGLContent.cpp (1690 BuildBox, 2787 Subdivide). Frames
FRD and NED. Drag is a sum over the triangles of the mesh; added mass is that of an
ellipsoid about its vertices, of the linear part only the mean over the axes.
"""

import re
import xml.etree.ElementTree as ET
from itertools import product
from math import pi
from pathlib import Path

import numpy as np

from tests.support.targets.frames import (
    Array,
    Body,
    coriolis,
    cross,
    down,
    push,
    readme_of,
    rotation,
    shift,
)

GRAVITY = 9.81
"""SimulationManager.cpp:838."""

WATER = 1000.0
"""ScenarioParser.cpp:649."""

SUBDIVISIONS = 3
"""Box.cpp:72, BuildBox(glHalfExtents, 3, uvMode)."""

CORNERS = ["---", "-+-", "++-", "+--", "+++", "+-+", "--+", "-++"]
FACES = ["1234", "4356", "7821", "6587", "5328", "4671"]
"""BuildBox: vertices v1 to v8 by their signs, four of them to a face."""


def load(folder: Path, name: str) -> Body:
    """Return the body that Stonefish moves for folder/NAME.scn.

    With the gravity that its README asks for: SimulationManager::setGravity.
    """
    stated = re.search(r"setGravity\(([\d.]+)\)", readme_of(folder))
    gravity = float(stated[1]) if stated else GRAVITY
    return parse((folder / f"{name}.scn").read_text(), gravity)


def numbers(element: ET.Element | None, key: str) -> Array | None:
    """Return the numbers of an attribute; None where it is missing."""
    text = None if element is None else element.get(key)
    return None if text is None else np.array(text.split(), float)


def box_mesh(size: Array) -> tuple[Array, list[tuple[int, int, int]]]:
    """Return vertices (n, 3) and triangles of a box as BuildBox and Subdivide make them."""
    signs = [[1.0 if s == "+" else -1.0 for s in corner] for corner in CORNERS]
    points = [tuple(np.array(signs[int(c) - 1]) * size / 2) for face in FACES for c in face]
    triangles = [(4 * k, 4 * k + i, 4 * k + i + 1) for k, i in product(range(len(FACES)), (1, 2))]
    for _ in range(SUBDIVISIONS):
        middles: dict[tuple[int, int], int] = {}
        finer = []
        for triangle in triangles:
            mid = []
            for edge in range(3):
                a, b = sorted((triangle[edge], triangle[(edge + 1) % 3]))
                if (a, b) not in middles:
                    middles[a, b] = len(points)
                    points.append(tuple((np.array(points[a]) + points[b]) / 2))
                mid.append(middles[a, b])
            one, two, three = triangle
            finer += [(one, mid[0], mid[2]), (two, mid[1], mid[0])]
            finer += [(three, mid[2], mid[1]), (mid[0], mid[1], mid[2])]
        triangles = finer
    return np.array(points), triangles


def semi_axes(points: Array) -> Array:
    """Return semi-axes (3,) of the ellipsoid about points: ComputeEllipsoidalApprox."""
    ends = [points[f(points[:, k])] for k in range(3) for f in (np.argmin, last_largest)]
    share = np.array([1 / 6 if any((p == e).all() for e in ends) else 0.0 for p in points])

    def moments() -> tuple[Array, Array, Array]:
        u, v = share @ points**2, share @ points
        return u, v, ((points - v) ** 2 / (3 * (u - v * v))).sum(1)

    u, v, reach = moments()
    tolerance, steps = 1.2 ** (2 / 3) - 1, 0
    while (excess := reach.max() - 1) > tolerance and steps < 10:
        star, beta = int(reach.argmax()), excess / (4 * (1 + excess))
        share = (1 - beta) * share
        share[star] += beta
        u, v, reach = moments()
        steps += 1
    if steps == 0:
        return np.abs([ends[2 * k][k] - ends[2 * k + 1][k] for k in range(3)]) / 2
    return np.sqrt(3 * (u - v * v))


def last_largest(values: Array) -> int:
    """Return the index of the last largest value: std::minmax_element."""
    return len(values) - 1 - int(values[::-1].argmax())


def lamb(long: float, wide: float) -> float:
    """Return LambKFactor(r1, r2): 1 where its logarithm has no value."""
    e = 1 - wide * wide / long
    if not (1 + e) / (1 - e) > 0:
        return 1.0
    alpha = 2 * (1 - e * e) / (e * e) * (0.5 * np.log((1 + e) / (1 - e)) - e)
    return float(alpha / (2 - alpha))


def added(axes: Array, density: float) -> tuple[Array, Array]:
    """Return added mass (3,) and added inertia (3,) of the ellipsoid, by that function."""
    x, y, z = axes
    mean = (y + z) / 2
    mass = 4 / 3 * pi * density * x * np.array([lamb(x, mean) * mean**2, z * z, y * y])
    return mass, pi * density / 12 * x**3 * np.array([0.0, y * y, z * z])


def parse(text: str, gravity: float = GRAVITY) -> Body:
    """Return the body of a scenario with one robot, its base link a box."""
    root = ET.fromstring(text)
    link = next(root.iter("base_link"))
    if link.get("type") != "box":
        raise ValueError(f"no mesh for <base_link type={link.get('type')!r}>")
    size = numbers(link.find("dimensions"), "xyz")
    assert size is not None
    place = numbers(link.find("origin"), "xyz")
    assert place is not None
    water = root.find(".//ocean/water")
    density = WATER if water is None else float(water.get("density", WATER))
    materials = {m.get("name"): float(m.get("density", "nan")) for m in root.iter("material")}
    volume = float(np.prod(size))

    # mass, inertia and centre of gravity over those of the material: ParseSolid
    material = link.find("material")
    mass = volume * materials.get(None if material is None else material.get("name"), np.nan)
    spans = size**2
    stated = link.find("mass")
    natural = mass
    if stated is not None:
        mass = float(stated.get("value", "nan"))
    inertia = numbers(link.find("inertia"), "xyz")
    if inertia is None:
        inertia = (natural if stated is None else mass) / 12 * (spans.sum() - spans)
    centre, turn = place, np.eye(3)
    cg = link.find("cg")
    if cg is not None:
        where, angles = numbers(cg, "xyz"), numbers(cg, "rpy")
        assert where is not None
        assert angles is not None
        centre, turn = where, rotation(angles)

    # drag coefficients by default from the ellipsoid, and added mass
    points, triangles = box_mesh(size)
    axes = semi_axes(points)
    extra, extra_inertia = added(axes, density)
    if link.get("physics", "") != "submerged":
        extra, extra_inertia = np.zeros(3), np.zeros(3)
    water_figures = link.find("hydrodynamics")
    cd, cf = numbers(water_figures, "quadratic_drag"), numbers(water_figures, "viscous_drag")
    natural_drag = (1 / axes) / (1 / axes).max()
    cd = natural_drag if cd is None or (cd < 0).any() else cd
    cf = 0.1 * natural_drag if cf is None or (cf < 0).any() else cf

    corners = points[np.array(triangles)] + place
    normal = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    area, normal = length / 2, normal / length[:, None]
    middle = corners.mean(1) - centre

    def weighted(load: Array, coefficient: Array) -> Array:
        """CorrectHydrodynamicForces: the coefficient along the load's own direction."""
        norm = np.linalg.norm(load)
        return load * float(np.abs(load / norm) @ coefficient) if norm > 0 else load

    def drag(velocity: Array, rate: Array) -> Array:
        flow = -(velocity + cross(rate, middle))
        into = (flow * normal).sum(1)
        along = flow - into[:, None] * normal
        wet = np.where(into < -1e-12, -into * area, 0.0)
        quadratic = flow * (np.linalg.norm(flow, axis=1) * wet)[:, None]
        skin = along * np.where((along**2).sum(1) > 1e-9, area, 0.0)[:, None]
        total = []
        for lever in (lambda f: f, lambda f: cross(middle, f)):
            pressure, friction = lever(quadratic).sum(0), lever(skin).sum(0)
            total.append(density * (0.5 * weighted(pressure, cd) + weighted(friction, cf)))
        return np.hstack(total)

    tensor = turn @ np.diag(inertia + extra_inertia) @ turn.T
    lumped = (mass + extra.mean()) * np.eye(3)
    about_centre = np.block([[lumped, np.zeros((3, 3))], [np.zeros((3, 3)), tensor]])
    to_centre = shift(centre)
    total_inertia = to_centre.T @ about_centre @ to_centre

    def force(nu: Array, eta: Array) -> Array:
        at_centre = nu @ to_centre.T
        wet = np.array([drag(state[:3], state[3:]) for state in at_centre])
        lower = down(eta)
        wrench = wet @ to_centre - coriolis(total_inertia, nu)
        wrench += push(centre, mass * gravity * lower)
        return wrench - push(place, volume * density * gravity * lower)

    return Body(total_inertia, force)
