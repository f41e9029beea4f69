"""A scenario of Stonefish, whose drag is geometric: six numbers fitted to the model."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import nnls

from auvid.export.body import STANDING, Body, Force
from auvid.export.exported import Exported, Request, Target
from auvid.export.losses import Lost, judged_axes, lost_added_mass, sample_envelope
from auvid.export.text import number, numbers, xml_comment
from auvid.export.thrusters import unplaced_note
from auvid.hydro.arrays import AXES, Array, cross
from auvid.hydro.dynamics.mechanics.kinematics import skew
from auvid.hydro.dynamics.mechanics.rigid_body import rigid_body_matrix

SUBDIVISIONS = 3
"""How often Box.cpp has each triangle cut into four."""
FITTED = 512
"""Velocities that the six numbers are fitted over."""
BLOCK = 128
CONVENTION = (
    "Stonefish counts in NED with gravity along +z, so body axes are x forward, y starboard, z"
    " down as in auvid; origin of the robot: the body origin of the vehicle file; moments act"
    " about the centre of gravity; SI and radians. viscous_drag and quadratic_drag are positive"
    " factors of the drag of its own mesh, not coefficients of the vehicle."
)
_USAGE = """\
Load `{name}.scn`, or copy its `robot` into your scenario. Keep the box: drag, buoyancy
and added mass all follow from its faces; another mesh needs another fit. Set gravity with
`SimulationManager::setGravity({gravity})`; the ocean has the density of the model.
{thrusters}"""
_THRUSTERS = "Thruster i is an actuator of type push that takes a force in N.\n"


SEMI_AXES = np.array([0.83136766, 0.93661729, 0.83974215])
"""Semi-axes of Stonefish's ellipsoid round a box over the box's sides, alike for every box.

ComputeEllipsoidalApprox of SolidEntity.cpp stops its search for the smallest ellipsoid
(0.866 of each side) at 20 % of its volume, and corners count once per face.
"""


def export(request: Request) -> Exported:
    """Return `NAME.scn` with a box and six fitted factors.

    Over faces with area A, outward normal n, water velocity v_c = -(v + omega x r):
    F_q = sum v_c |v_c| (-v_c n) A where v_c n < 0, F_f = sum v_t A with v_t = v_c - (v_c n)
    n; F = rho / 2 (|F_q| / |F_q|_2 . Cd) F_q + rho (|F_f| / |F_f|_2 . Cf) F_f, moments
    likewise: patrykcieslak/stonefish Library/src/entities/SolidEntity.cpp:1262-1287 and
    1723-1797 (b21eb8e1), Cf = viscous_drag, Cd = quadratic_drag
    (Library/src/core/ScenarioParser.cpp:1953). Mass with the mean added mass of an
    ellipsoid round the box: SolidEntity.cpp:843-990, getAugmentedMass.
    """
    body, name = request.body, request.name
    nu, excess = sample_envelope(request.model.validity)
    model = request.model
    judged = judged_axes(model.use.axes)
    factors = _fit(body, nu[:FITTED], excess[:FITTED], judged)
    target_mass = rigid_body_matrix(
        body.mass_kg, body.r_G, np.diag(np.diag(body.inertia_about_G)) - _steiner(body)
    ) + _own_added_mass(body)
    lost = (
        Lost(
            "viscous force against the fit of 6 factors of the box's drag",
            "drag follows from the faces of a mesh",
            _fit_error(body, factors),
        ),
        lost_added_mass(
            inertia=body.mass - target_mass,
            what="inertia and added mass against Stonefish's own",
            why="it takes principal inertia, and added mass of an ellipsoid, the same in x, y, z",
        ),
    )
    pushes = "".join(
        _push(i + 1, item.position_m, item.axis, body) for i, item in enumerate(body.thrusters)
    )
    notes = ["Its pressure drag has three factors of the velocity, so it grows with the cube."]
    notes += unplaced_note(body)
    if body.fins is not None or body.propeller is not None:
        notes.append("Fins and propeller are left out: apply their force.")
    if pushes:
        notes.append("Thrusters take forces: no curve, no voltage, no lag.")
    return Exported(
        {f"{name}.scn": _document(request, factors, pushes)},
        lost,
        CONVENTION,
        _USAGE.format(
            name=name, gravity=number(body.gravity), thrusters=_THRUSTERS if pushes else ""
        ),
        tuple(notes),
    )


def box_faces(sides: Array) -> tuple[Array, Array, Array]:
    """Return middles (f, 3), normals (f, 3) and areas (f,) of the triangles of a box.

    Each side has two triangles, and each of these is cut into four `SUBDIVISIONS` times.
    """
    half, middles, normals, areas = np.asarray(sides) / 2.0, [], [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            corners = np.zeros((4, 3))
            corners[:, axis] = sign * half[axis]
            corners[:, i] = half[i] * np.array([-1, -1, 1, 1])
            corners[:, j] = half[j] * np.array([-1, 1, 1, -1])
            triangles = corners[[[0, 1, 2], [0, 2, 3]]]
            for _ in range(SUBDIVISIONS):
                a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
                ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
                parts = ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))
                triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
            normal = np.zeros(3)
            normal[axis] = sign
            middles.append(triangles.mean(axis=1))
            normals.append(np.tile(normal, (len(triangles), 1)))
            sides_of = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
            areas.append(np.linalg.norm(cross(*sides_of), axis=1) / 2.0)
    return np.concatenate(middles), np.concatenate(normals), np.concatenate(areas)


def drag_columns(body: Body, nu: Array) -> Array:
    """Return the drag (n, 6, 6) per factor, [Cf, Cd] last, about the body origin."""
    middles, normals, areas = box_faces(body.box)
    arms = middles + body.r_B - body.r_G
    (x, y, z), (n_x, n_y, n_z) = arms.T, normals.T
    density = body.water_density
    columns = np.empty((len(nu), 6, 6))
    for start in range(0, len(nu), BLOCK):
        part = nu[start : start + BLOCK]
        # By components (n, f): arrays whose last axis has three numbers are slow.
        u, v, w = (part[:, :3] + cross(part[:, 3:], body.r_G)).T[:, :, None]
        p, q, r = part[:, 3:].T[:, :, None]
        flow = -(u + q * z - r * y), -(v + r * x - p * z), -(w + p * y - q * x)
        through = flow[0] * n_x + flow[1] * n_y + flow[2] * n_z
        speed = np.sqrt(flow[0] ** 2 + flow[1] ** 2 + flow[2] ** 2)
        pressed = np.where(through < -1e-12, speed * -through * areas, 0.0)
        skin = [(f - through * n) * areas for f, n in zip(flow, (n_x, n_y, n_z), strict=True)]
        pressure = [f * pressed for f in flow]
        for first, force, scale in ((0, skin, density), (3, pressure, 0.5 * density)):
            total = np.stack([f.sum(axis=1) for f in force], axis=-1)
            lever = np.stack([f @ arms for f in force], axis=-1)
            turned = lever - lever.swapaxes(1, 2)
            moment = np.stack([turned[:, 1, 2], turned[:, 2, 0], turned[:, 0, 1]], axis=-1)
            block = columns[start : start + BLOCK, :, first : first + 3]
            block[:, :3] = scale * total[:, :, None] * _direction(total)[:, None, :]
            about_G = scale * moment[:, :, None] * _direction(moment)[:, None, :]
            # about the origin: M + r_G x F, column by column
            block[:, 3:] = about_G + np.einsum("ij,njk->nik", skew(body.r_G), block[:, :3])
    return columns


def _direction(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.abs(vectors) / np.maximum(length, STANDING))


def _fit(body: Body, nu: Array, excess: Array, judged: tuple[str, ...]) -> Array:
    """Return [Cf, Cd] (6,) >= 0, nearest to the viscous force on the judged axes."""
    viscous = body.viscous(nu, excess)
    size = np.sqrt(np.mean(viscous**2, axis=0))
    axes = [i for i in range(6) if AXES[i] in judged and size[i] > 0.0]
    if not axes:
        return np.zeros(6)
    columns = drag_columns(body, nu)[:, axes, :] / size[axes][:, None]
    solution, _ = nnls(columns.reshape(-1, 6), (viscous[:, axes] / size[axes]).ravel())
    return np.asarray(solution)


def _fit_error(body: Body, factors: Array) -> Force:
    return lambda nu, excess: body.viscous(nu, excess) - drag_columns(body, nu) @ factors


def _steiner(body: Body) -> Array:
    """m S(r_G) S(r_G) (3, 3), so that inertia about the origin is I_G less it."""
    arm = skew(body.r_G)
    return np.asarray(body.mass_kg * arm @ arm)


def _own_added_mass(body: Body) -> Array:
    """Return the added inertia (6, 6) that Stonefish gives a box, about the origin.

    Of its ellipsoid round the box, `SEMI_AXES` of the sides; masses in their mean.
    """
    a, b, c = SEMI_AXES * body.box
    density = body.water_density
    mean = (b + c) / 2.0
    volume = 4.0 / 3.0 * math.pi * density
    masses = [_lamb_factor(a, mean) * volume * a * mean**2, volume * c * c * a, volume * b * b * a]
    moments = [
        0.0,
        math.pi / 12.0 * density * b * b * a**3,
        math.pi / 12.0 * density * c * c * a**3,
    ]
    return rigid_body_matrix(
        float(np.mean(masses)), body.r_G, np.diag(moments) - np.mean(masses) * _unit_arm(body)
    )


def _unit_arm(body: Body) -> Array:
    arm = skew(body.r_G)
    return np.asarray(arm @ arm)


def _lamb_factor(r1: float, r2: float) -> float:
    """As LambKFactor of SolidEntity.cpp, whose e = 1 - r2^2 / r1 is no pure number."""
    e = 1.0 - r2 * r2 / r1
    if e * e >= 1.0 or e == 0.0:
        return 1.0
    alpha = 2.0 * (1.0 - e * e) / (e * e) * (0.5 * math.log((1.0 + e) / (1.0 - e)) - e)
    return alpha / (2.0 - alpha)


def _document(request: Request, factors: Array, pushes: str) -> str:
    body, name = request.body, request.name
    material = body.mass_kg / body.volume
    return (
        '<?xml version="1.0"?>\n'
        + xml_comment([f"Model {name}: {body.title}.", *request.head, CONVENTION])
        + "<scenario>\n"
        '  <environment>\n    <ned latitude="0.0" longitude="0.0"/>\n'
        f'    <ocean><water density="{number(body.water_density)}" jerlov="0.2"/></ocean>\n'
        "  </environment>\n"
        f'  <materials>\n    <material name="{name}_material" density="{number(material)}"'
        ' restitution="0.5"/>\n  </materials>\n'
        f'  <looks>\n    <look name="{name}_look" gray="0.5" roughness="0.5"/>\n  </looks>\n'
        f'  <robot name="{name}" fixed="false" self_collisions="false">\n'
        '    <base_link name="Vehicle" type="box" physics="submerged" buoyant="true">\n'
        f'      <dimensions xyz="{numbers(body.box)}"/>\n'
        f'      <origin xyz="{numbers(body.r_B)}" rpy="0 0 0"/>\n'
        f'      <material name="{name}_material"/>\n      <look name="{name}_look"/>\n'
        f'      <mass value="{number(body.mass_kg)}"/>\n'
        f'      <inertia xyz="{numbers(np.diag(body.inertia_about_G))}"/>\n'
        f'      <cg xyz="{numbers(body.r_G)}" rpy="0 0 0"/>\n'
        f'      <hydrodynamics viscous_drag="{numbers(factors[:3])}"'
        f' quadratic_drag="{numbers(factors[3:])}"/>\n'
        f"    </base_link>\n{pushes}"
        '    <world_transform xyz="0 0 2" rpy="0 0 0"/>\n  </robot>\n</scenario>\n'
    )


def _push(place: int, position: list[float] | None, axis: list[float] | None, body: Body) -> str:
    """Return an actuator of type push, which pushes along its x axis."""
    if position is None or axis is None:
        return ""
    low, high = body.force_limits or (0.0, 0.0)
    yaw = math.atan2(axis[1], axis[0])
    pitch = math.atan2(-axis[2], math.hypot(axis[0], axis[1]))
    return (
        f'    <actuator name="thruster_{place}" type="push">\n      <link name="Vehicle"/>\n'
        f'      <origin xyz="{numbers(position)}" rpy="0.0 {number(pitch)} {number(yaw)}"/>\n'
        f'      <specs lower_limit="{number(low)}" upper_limit="{number(high)}"/>\n'
        "    </actuator>\n"
    )


STONEFISH = Target(
    "stonefish",
    "a scenario of Stonefish, drag fitted",
    "six factors of the drag of a box",
    "patrykcieslak/stonefish b21eb8e1",
    export,
)
