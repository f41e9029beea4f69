"""Evaluator of a uuv_simulator description: xacro, HMFossen and BuoyantObject, Gazebo classic.

Read from uuvsimulator/uuv_simulator bfb40cb1 and gazebosim/gazebo-classic 0127272. Links
are FLU, coefficients FRD; the frame of the link with hydrodynamics is taken as the origin.
"""

import re
import xml.etree.ElementTree as ET
from math import cos, pi, radians, sin, sqrt
from pathlib import Path

import numpy as np

from tests.support.targets.frames import (
    FLIP,
    FLIP6,
    Array,
    Body,
    coriolis,
    down,
    push,
    readme_of,
    rigid_body,
    rotation,
    shift,
)

XACRO = "{http://www.ros.org/wiki/xacro}"

WORLD_GRAVITY = 9.8
"""The worlds of uuv_gazebo_worlds state no gravity: the default of SDF, "0 0 -9.8"."""


def load(folder: Path, name: str) -> Body:
    """Return the body that uuv_simulator moves for folder/NAME.xacro.

    About the link's origin, in a world with the gravity that its README asks for.
    """
    stated = re.search(r"world: set ([\d.]+) m/s", readme_of(folder))
    gravity = float(stated[1]) if stated else WORLD_GRAVITY
    return parse((folder / f"{name}.xacro").read_text(), gravity)


def expand(text: str) -> ET.Element:
    """Return the URDF of a xacro: properties, arguments and macros without blocks."""
    root = ET.fromstring(text)
    names: dict[str, object] = {"pi": pi, "sin": sin, "cos": cos, "radians": radians, "sqrt": sqrt}
    macros: dict[str, ET.Element] = {}

    def value(match: re.Match[str], scope: dict[str, object]) -> str:
        result = eval(match[1], {"__builtins__": {}}, scope)
        return repr(result) if isinstance(result, float) else str(result)

    def fill(text: str | None, scope: dict[str, object]) -> str:
        text = re.sub(r"\$\(arg ([^)]*)\)", lambda m: str(scope[m[1]]), text or "")
        return re.sub(r"\$\{([^}]*)\}", lambda m: value(m, scope), text)

    def typed(text: str) -> object:
        try:
            return int(text) if re.fullmatch(r"[-+]?\d+", text) else float(text)
        except ValueError:
            return text

    def walk(parent: ET.Element, scope: dict[str, object]) -> list[ET.Element]:
        elements: list[ET.Element] = []
        for child in parent:
            kind = child.tag.removeprefix(XACRO)
            if child.tag == XACRO + "property":
                scope[child.attrib["name"]] = typed(fill(child.get("value"), scope))
            elif child.tag == XACRO + "arg":
                scope.setdefault(child.attrib["name"], fill(child.get("default"), scope))
            elif child.tag == XACRO + "macro":
                macros[child.attrib["name"]] = child
            elif kind != child.tag and kind in macros:
                inner = dict(scope)
                for item in macros[kind].get("params", "").split():
                    key, _, default = item.partition(":=")
                    inner[key] = typed(fill(child.get(key, default), scope))
                elements += walk(macros[kind], inner)
            elif kind == child.tag:
                copy = ET.Element(child.tag, {k: fill(v, scope) for k, v in child.attrib.items()})
                copy.text = fill(child.text, scope)
                copy.extend(walk(child, scope))
                elements.append(copy)
        return elements

    flat = ET.Element("robot")
    flat.extend(walk(root, names))
    return flat


def numbers(element: ET.Element | None, default: str = "") -> Array:
    """Return the numbers of an element's text: Str2Vector."""
    return np.array(((element.text if element is not None else None) or default).split(), float)


def matrix(model: ET.Element, tag: str) -> Array:
    """Return a damping matrix: 36 numbers, or 6 on the diagonal: HydrodynamicModel.cc:327-355."""
    values = numbers(model.find(tag), "0 0 0 0 0 0")
    return values.reshape(6, 6) if values.size == 36 else np.diag(values)


def origin(folder: Path) -> Array:
    """Return the link origin, FRD from the body origin, by its README."""
    stated = re.search(r"base_link is at \(([^)]*)\) m", readme_of(folder))
    assert stated is not None
    return np.array(stated[1].split(","), float)


def inertial_of(inertial: ET.Element) -> tuple[float, Array, Array]:
    """Return mass, centre and M_RB about the link's origin of a URDF <inertial>."""
    mass = float(inertial.find("mass").get("value"))  # type: ignore[union-attr, arg-type]
    origin, tensor = inertial.find("origin"), np.zeros((3, 3))
    centre, turn = np.zeros(3), np.eye(3)
    if origin is not None:
        centre = np.array(origin.get("xyz", "0 0 0").split(), float)
        turn = rotation(np.array(origin.get("rpy", "0 0 0").split(), float))
    for i, a in enumerate("xyz"):
        for j, b in enumerate("xyz"):
            tensor[i, j] = float(inertial.find("inertia").get("i" + min(a, b) + max(a, b), 0))  # type: ignore[union-attr, arg-type]
    return mass, centre, rigid_body(mass, centre, turn @ tensor @ turn.T)


def parse(text: str, gravity: float = WORLD_GRAVITY) -> Body:
    """Return the body of a description with one link under the underwater object plugin."""
    robot = expand(text)
    plugin = next(p for p in robot.iter("plugin") if "underwater_object" in p.get("filename", ""))
    water = plugin.find("link")
    assert water is not None
    link = next(e for e in robot.findall("link") if e.get("name") == water.get("name"))
    inertial = link.find("inertial")
    model = water.find("hydrodynamic_model")
    assert inertial is not None
    assert model is not None
    assert model.findtext("type") == "fossen"

    mass, centre, body = inertial_of(inertial)
    # links on joints, thrusters here, ride along; the plugin floats none of them
    pulls = [(centre, mass * gravity)]
    links = {e.get("name"): e for e in robot.findall("link")}
    for joint in robot.findall("joint"):
        parent, place = joint.find("parent"), joint.find("origin")
        inside = links[joint.find("child").get("link")].find("inertial")  # type: ignore[union-attr]
        assert parent is not None
        assert place is not None
        assert inside is not None
        assert parent.get("link") == link.get("name")
        at = np.array(place.get("xyz", "0 0 0").split(), float)
        small, middle, part = inertial_of(inside)
        body = body + shift(at).T @ part @ shift(at)
        pulls.append((at + middle, small * gravity))

    # coefficients in FRD, negative where they brake; the quadratic matrix counts on its
    # diagonal only: HydrodynamicModel.cc:463-489
    added = numbers(model.find("added_mass"), "0 " * 36).reshape(6, 6)
    linear, quadratic = matrix(model, "linear_damping"), matrix(model, "quadratic_damping")
    forward = matrix(model, "linear_damping_forward_speed")

    # buoyancy: BuoyantObject.cc:82-119, density of UnderwaterObjectPlugin.cc:81-84
    density = float(plugin.findtext("fluid_density", "1028"))
    buoyancy = float(water.findtext("volume", "0")) * density * gravity
    if water.findtext("neutrally_buoyant", "0").strip() in ("1", "true"):
        buoyancy = mass * gravity
    above = numbers(water.find("center_of_buoyancy"), "0 0 0")

    # AddRelativeForce acts at the centre of mass (ODELink.cc, dBodyAddRelForce), although
    # the velocity is that of the link's origin (ODELink.cc, WorldLinearVel); likewise the
    # centre of buoyancy counts from the centre of mass (dBodyAddForceAtRelPos)
    to_origin = shift(centre).T

    def force(nu: Array, eta: Array) -> Array:
        wet = nu @ linear.T + nu[:, :1] * (nu @ forward.T)
        wet += np.diag(quadratic) * nu * np.abs(nu) - coriolis(added, nu)
        state, lower = nu @ FLIP6, down(eta) @ FLIP
        wrench = wet @ FLIP6 @ to_origin.T - coriolis(body, state)
        for point, pull in pulls:
            wrench += push(point, pull * lower)
        wrench -= push(centre + above, buoyancy * lower)
        return wrench @ FLIP6

    inertia = body + to_origin @ FLIP6 @ added @ FLIP6
    return Body(FLIP6 @ inertia @ FLIP6, force)
