"""Evaluator of a Gazebo world or model: SDF, Hydrodynamics and Buoyancy systems, DART.

Read from gazebosim/gz-sim 93bbf3ed1, gazebosim/gz-physics a43f638a, gazebosim/sdformat
2ace5362. Body axes are FLU, the world is ENU; the model's frame is taken as the origin.
"""

import xml.etree.ElementTree as ET
from itertools import product
from math import pi
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
    rigid_body,
    rotation,
    shift,
)

AXES, RATES, SPEEDS = "xyzkmn", "UVWPQR", "xyzpqr"

WORLD_GRAVITY = 9.8
"""Default of <gravity>: sdformat sdf/1.12/world.sdf:56, "0 0 -9.8"."""

FLUID_DENSITY = 1000.0
"""Default of the Buoyancy system: gz-sim src/systems/buoyancy/Buoyancy.cc:113."""


def load(folder: Path, name: str) -> Body:
    """Return the body that Gazebo moves for folder/NAME.sdf."""
    return parse((folder / f"{name}.sdf").read_text())


def number(parent: ET.Element | None, path: str, default: float = 0.0) -> float:
    """Return an element's number; an absent one has the default of the format."""
    text = None if parent is None else parent.findtext(path)
    return default if text is None else float(text)


def placement(parent: ET.Element) -> tuple[Array, Array]:
    """Return translation (3,) and rotation (3, 3) of a <pose>: x y z roll pitch yaw."""
    pose = parent.find("pose")
    if pose is None:
        return np.zeros(3), np.eye(3)
    values = np.array((pose.text or "").split(), float)
    angles = np.radians(values[3:]) if pose.get("degrees") == "true" else values[3:]
    return values[:3], rotation(angles)


def plugins(root: ET.Element, system: str) -> list[ET.Element]:
    """Return the plugin elements of one system, by its class name."""
    return [p for p in root.iter("plugin") if (p.get("name") or "").split("::")[-1] == system]


def volume(shape: ET.Element) -> float:
    """Return the volume of a <geometry>'s shape: Buoyancy.cc:328-373."""
    kind = shape[0]
    radius, length = number(kind, "radius", 1.0), number(kind, "length", 1.0)
    match kind.tag:
        case "box":
            return float(np.prod([float(x) for x in kind.findtext("size", "1 1 1").split()]))
        case "sphere":
            return 4 / 3 * pi * radius**3
        case "cylinder":
            return pi * radius**2 * length
        case "capsule":
            return pi * radius**2 * (length + 4 / 3 * radius)
        case "ellipsoid":
            radii = kind.findtext("radii", "1 1 1").split()
            return 4 / 3 * pi * float(np.prod([float(x) for x in radii]))
    raise ValueError(f"no volume for <{kind.tag}>")


def fluid_added_mass(inertial: ET.Element) -> Array:
    """Return <fluid_added_mass> about the link's origin: sdformat src/Link.cc:251-294."""
    upper = np.zeros((6, 6))
    element = inertial.find("fluid_added_mass")
    for i, j in product(range(6), range(6)):
        if i <= j:
            upper[i, j] = upper[j, i] = number(element, SPEEDS[i] + SPEEDS[j])
    return upper


def rigid(inertial: ET.Element) -> tuple[float, Array, Array]:
    """Return mass, centre of mass and M_RB about the link's origin of an <inertial>.

    Defaults: sdf/1.12/inertial.sdf (mass 1, ixx iyy izz 1); axes of the tensor turned by the
    inertial's pose: gz-physics dartsim/src/SDFFeatures.cc:697-707.
    """
    mass = number(inertial, "mass", 1.0)
    centre, turn = placement(inertial)
    tensor = np.zeros((3, 3))
    for (i, a), (j, b) in product(enumerate("xyz"), repeat=2):
        key = "i" + min(a, b) + max(a, b)
        tensor[i, j] = number(inertial.find("inertia"), key, 1.0 if i == j else 0.0)
    return mass, centre, rigid_body(mass, centre, turn @ tensor @ turn.T)


def parse(text: str) -> Body:
    """Return the body of an SDF text with one link that has a Hydrodynamics system."""
    root = ET.fromstring(text)
    system = plugins(root, "Hydrodynamics")[0]
    links = {link.get("name"): link for link in root.iter("link")}
    link = links[system.findtext("link_name")]
    inertial = link.find("inertial")
    assert inertial is not None
    mass, centre, body = rigid(inertial)

    # stability derivatives by name: Hydrodynamics.cc:305-330 and :354-365
    linear, added = np.zeros((6, 6)), np.zeros((6, 6))
    signed, absolute = np.zeros((6, 6, 6)), np.zeros((6, 6, 6))
    for (i, axis), (j, rate) in product(enumerate(AXES), enumerate(RATES)):
        linear[i, j] = number(system, axis + rate)
        added[i, j] = number(system, axis + "Dot" + rate)
        for k, other in enumerate(RATES):
            signed[i, j, k] = number(system, axis + rate + other)
            absolute[i, j, k] = number(system, axis + rate + "abs" + other)
    no_added = system.findtext("disable_added_mass", "false") in ("true", "1")
    no_coriolis = system.findtext("disable_coriolis", "false") in ("true", "1")

    # DART: rigid body plus <fluid_added_mass>, with the Coriolis force of their sum
    # (gz-physics dartsim/src/AddedMassFeatures.cc:30-72, Newton-Euler of a spatial tensor)
    carried = body + fluid_added_mass(inertial)
    explicit = np.zeros((6, 6)) if no_added else -added  # Hydrodynamics.cc:558-567
    diagonal = np.zeros((6, 6)) if no_coriolis else np.diag(np.diag(-added))

    # gravity of the world at the centre of mass; buoyancy at the centre of volume
    world = root.find("world")
    gravity = WORLD_GRAVITY
    if world is not None and world.find("gravity") is not None:
        gravity = -float(world.findtext("gravity", "").split()[2])
    collisions = link.findall("collision")
    volumes = np.array([volume(c.find("geometry")) for c in collisions])  # type: ignore[arg-type]
    buoyancy, centre_of_volume = 0.0, np.zeros(3)
    systems = plugins(root, "Buoyancy")
    if volumes.sum() > 0 and (systems or world is None):
        density = number(systems[0] if systems else None, "uniform_fluid_density", FLUID_DENSITY)
        buoyancy = density * volumes.sum() * gravity  # Buoyancy.cc:598-613
        places = np.array([placement(c)[0] for c in collisions])
        centre_of_volume = volumes @ places / volumes.sum()
    weight = 0.0 if link.findtext("gravity", "true") in ("false", "0") else mass * gravity

    # persistent wrenches, in axes of the world, the force at the centre of mass:
    # ApplyLinkWrench.cc:150-187 and :262-276 (31afa945), on the model's canonical link
    pulled, turned = np.zeros(3), np.zeros(3)
    model = root.find(".//model")
    for steady in (w for s in plugins(root, "ApplyLinkWrench") for w in s.findall("persistent")):
        assert steady.findtext("entity_type") == "model"
        assert model is not None
        assert steady.findtext("entity_name") == model.get("name")
        pulled += np.array([float(x) for x in steady.findtext("force", "0 0 0").split()])
        turned += np.array([float(x) for x in steady.findtext("torque", "0 0 0").split()])

    # the link's frame in the model's frame
    arm, turn = placement(link)
    to_link = np.kron(np.eye(2), turn.T) @ shift(arm)

    # links on joints, thrusters here, ride along; no collision, so nothing floats them
    pulls = [(centre, weight)]
    for other in links.values():
        inside = other.find("inertial")
        pose = other.find("pose")
        if other is link or inside is None or pose is None:
            continue
        assert pose.get("relative_to") == link.get("name")
        assert other.find("collision") is None
        place, angle = placement(other)
        to_other = np.kron(np.eye(2), angle.T) @ shift(place)
        small, middle, part = rigid(inside)
        carried = carried + to_other.T @ part @ to_other
        pulls.append((place + angle @ middle, small * gravity))

    def force(nu: Array, eta: Array) -> Array:
        state = nu @ (to_link @ FLIP6).T
        # damping: HydrodynamicsUtils.hh:89-113, applied with the sign of
        # Hydrodynamics.cc:589 and :623-631, at the link's origin (Link.cc:555-600)
        wrench = state @ linear.T
        wrench += np.einsum("ijk,nj,nk->ni", absolute, state, np.abs(state))
        wrench += np.einsum("ijk,nj,nk->ni", signed, state, state)
        # HydrodynamicsUtils.hh:45-72: diagonal of the added mass only
        wrench -= coriolis(diagonal, state) + coriolis(carried, state)
        lower = down(eta) @ FLIP @ turn
        for point, pull in pulls:
            wrench += push(point, pull * lower)
        wrench -= push(centre_of_volume, buoyancy * lower)
        # ENU to the link, FLU; `down` knows no heading, so the vertical alone can be told
        assert not pulled.any()
        assert not turned[:2].any()
        wrench[:, 3:] -= turned[2] * lower
        return wrench @ to_link @ FLIP6

    return Body(FLIP6 @ to_link.T @ (carried + explicit) @ to_link @ FLIP6, force)
