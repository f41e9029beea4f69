"""A viscous force from flow physics, for the truth of a twin.

It lies outside the span of all eight models of McCarter 2014.

Strips along the hull feel cross-flow drag (Hoerner 1965, ch. 3; Fossen 2011, 6.4.3),
the body lifts at small angles, fins and a tail mast lift and stall softly, the hull has
friction that falls with the Reynolds number, and small asymmetries push at all times.
Ideal-fluid parts (added mass, the Munk moment) stay in M_A and C_A; the deflection of
the fins stays in tau_delta. The rows of `strips` and `surfaces` are constants times
velocities, so that the compiled loop (compiled.py) reads the same tables.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array, components, read_only
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle

SPEED_FLOOR = 1e-6
"""[m^2/s^2] added to squared speeds in quotients, so that a vehicle at rest feels no
force and no division by zero.
"""


@dataclass(frozen=True)
class LiftingSurface:
    """A thin surface: centre, normal in body axes, area, normal force, stall.

    Attached flow gives the normal force 1/2 rho S lift_slope u v_n, separated flow 1/2
    rho S plate_drag |v_n| v_n; the share of attached flow is 1 / (1 + (sin^2(alpha) /
    sin^2(stall))^2) with sin^2(alpha) = v_n^2 / (u^2 + v_n^2).
    """

    name: str
    centre_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    area_m2: float
    lift_slope: float = 3.0
    plate_drag: float = 1.2
    stall_rad: float = math.radians(24.0)
    profile_drag: float = 0.012
    induced_drag: float = 0.6

    def row(self, density: float) -> list[float]:
        """Return the row (11,) of `PhysicalViscous.surfaces`.

        Centre, normal, 1/2 rho S times (slope, plate drag), 1 / sin^2(stall), 1/2 rho S
        times profile and induced drag.
        """
        q = 0.5 * density * self.area_m2
        stall = 1.0 / math.sin(self.stall_rad) ** 2
        return [
            *self.centre_m,
            *self.normal,
            q * self.lift_slope,
            q * self.plate_drag,
            stall,
            q * self.profile_drag,
            q * self.induced_drag,
        ]


@dataclass(frozen=True)
class PhysicalViscous:
    """The constants of the force, each with 1/2 rho and its area in it.

    `strips` (n, 2): x [m], 1/2 rho C_d d dx. `surfaces` (k, 11): `LiftingSurface.row`.
    `body` (3,): 1/2 rho d^2 c_yd [kg/m], its x [m], and the induced drag over (v^2 +
    w^2). `axial` (2,): 1/2 rho C S at 1 m/s, and the power of |u| by which it falls.
    `asymmetry` (6,): force and moment per u|u|.
    """

    strips: Array
    surfaces: Array
    body: Array
    axial: Array
    asymmetry: Array

    def force(self, nu: ArrayLike, level_speed: ArrayLike | None = None) -> Array:
        """Return tau_nu: nu (..., 6) -> (..., 6) [N, N m].

        The level speed has no influence; models with a propulsion ratio need it.
        """
        motion = components(np.asarray(nu, dtype=np.float64))
        tau = np.stack(body_components(self.body, self.axial, self.asymmetry, *motion), axis=-1)
        strips = strip_components(*self.strips.T, *(item[..., None] for item in motion[1:]))
        tau[..., STRIP_AXES] += np.stack(strips, axis=-1).sum(axis=-2)
        for row in self.surfaces:
            tau += np.stack(surface_components(row, *motion), axis=-1)
        return np.asarray(tau)


# The three laws below take arrays of one shape, or numbers in the compiled loop.

STRIP_AXES = (1, 2, 4, 5)


def strip_components(
    x: Array, area: Array, v: Array, w: Array, p: Array, q: Array, r: Array
) -> tuple[Array, ...]:
    """Return Y, Z, M, N of the cross-flow drag on a strip at `x`.

    Y = -1/2 rho C_d d dx sqrt(side^2 + down^2) side, side = v + x r, down = w - x q;
    Z likewise with down; M = -x Z, N = x Y.
    """
    side, down = v + x * r, w - x * q
    drag = -area * np.sqrt(side * side + down * down)
    return drag * side, drag * down, -x * drag * down, x * drag * side


def surface_components(
    row: Array, u: Array, v: Array, w: Array, p: Array, q: Array, r: Array
) -> tuple[Array, ...]:
    """Return X to N of a lifting surface with the constants of `LiftingSurface.row`."""
    sx, sy, sz, nx, ny, nz = row[0], row[1], row[2], row[3], row[4], row[5]
    # Flow at the centre: along x, and along the normal.
    ahead = u + (q * sz - r * sy)
    across = ahead * nx + (v + (r * sx - p * sz)) * ny + (w + (p * sy - q * sx)) * nz
    # sin^2 of the angle of attack decides how much of the flow is attached.
    sine2 = across * across / (ahead * ahead + across * across + SPEED_FLOOR)
    stalled = sine2 * row[8]
    attached = 1.0 / (1.0 + stalled * stalled)
    push = -across * (
        row[6] * attached * np.abs(ahead) + row[7] * (1.0 - attached) * np.abs(across)
    )
    fx = push * nx - (row[9] + row[10] * sine2) * ahead * np.abs(ahead)
    fy, fz = push * ny, push * nz
    return fx, fy, fz, sy * fz - sz * fy, sz * fx - sx * fz, sx * fy - sy * fx


def body_components(
    body: Array, axial: Array, asymmetry: Array,
    u: Array, v: Array, w: Array, p: Array, q: Array, r: Array,
) -> tuple[Array, ...]:  # fmt: skip
    """Return X to N of hull friction, body lift with its drag, and asymmetry.

    X = -c_a u|u|^(1-power) - induced (side^2 + down^2) u / U; Y = -k |u| side, Z = -k
    |u| down at `x`; asymmetry per u|u|. side = v + x r, down = w - x q.
    """
    along, x = np.abs(u), body[1]
    forward = u * along
    side, down = v + x * r, w - x * q
    lift_y, lift_z = -body[0] * along * side, -body[0] * along * down
    speed = np.sqrt(u * u + v * v + w * w + SPEED_FLOOR)
    friction = axial[0] * u * along ** (1.0 - axial[1])
    induced = body[2] * (side * side + down * down) * u / speed
    return (
        asymmetry[0] * forward - friction - induced,
        asymmetry[1] * forward + lift_y,
        asymmetry[2] * forward + lift_z,
        asymmetry[3] * forward,
        asymmetry[4] * forward - x * lift_z,
        asymmetry[5] * forward + x * lift_y,
    )


HULL_FULLNESS = 0.84
"""Displaced volume over length times the circle of the diameter; it gives the VT 690's
printed diameter 0.1753 m.
"""
STRIPS = 20


def physical_viscous(vehicle: Vehicle) -> PhysicalViscous:
    """Return the physical force of a torpedo-shaped vehicle.

    It is sized from the vehicle's length (reference length of the fins) and displaced
    volume.

    Shape and coefficients are assumptions, chosen so that the VT 690 is stable, runs
    1.5 to 2.2 m/s at 1800 to 2600 rpm, and has effective derivatives per m/s of u near
    Y_v -50, Y_r +20, N_v +22, N_r -27. Raises `CampaignError` for a vehicle without
    fins.
    """
    if vehicle.fins is None:
        raise CampaignError(
            "the physical truth is that of a torpedo with fins; this vehicle has none",
            field="vehicle",
            value=vehicle.name,
        )
    rho, length = vehicle.water_density, vehicle.fins.length_m
    diameter = math.sqrt(vehicle.displaced_mass_kg / rho / (HULL_FULLNESS * math.pi / 4.0 * length))
    scale = length / 2.057
    rows = [surface.row(rho) for surface in _scaled(_SURFACES, scale)]
    lift = 0.5 * rho * diameter**2
    return PhysicalViscous(
        strips=read_only(_strips(rho, length, diameter)),
        surfaces=read_only(rows),
        body=read_only([1.38 * lift, 0.16 * scale, 0.32 * lift]),
        axial=read_only([0.5 * rho * 0.0100 * scale**2, 0.12]),
        asymmetry=read_only(np.array([0.0, 0.10, -0.15, 0.008, 0.03, 0.02]) * scale**2),
    )


def _strips(density: float, length: float, diameter: float) -> Array:
    """Return the strips of a blunt nose, a cylinder and a tapered tail.

    Cross-flow drag coefficient 1.0 of a cylinder at these Reynolds numbers.
    """
    edges = np.linspace(-0.5, 0.5, STRIPS + 1)
    x = 0.5 * (edges[1:] + edges[:-1])
    nose = np.where(x < 0.4, 1.0, np.sqrt(np.clip(1.0 - ((x - 0.4) / 0.1) ** 2, 0.0, 1.0)))
    tail = 0.35 + 0.65 * (x + 0.5) / 0.25
    width = np.minimum(nose, np.minimum(tail, 1.0))
    return np.column_stack([x * length, 0.5 * density * 1.0 * width * diameter * length / STRIPS])


_FIN_AREA, _FIN_X, _FIN_RADIUS = 0.0090, -0.98, 0.09
_SURFACES = (
    LiftingSurface("starboard fin", (_FIN_X, _FIN_RADIUS, 0.0), (0.0, 0.0, 1.0), _FIN_AREA),
    LiftingSurface("port fin", (_FIN_X, -_FIN_RADIUS, 0.0), (0.0, 0.0, 1.0), _FIN_AREA),
    LiftingSurface("bottom fin", (_FIN_X, 0.0, _FIN_RADIUS), (0.0, 1.0, 0.0), _FIN_AREA),
    LiftingSurface("top fin", (_FIN_X, 0.0, -_FIN_RADIUS), (0.0, 1.0, 0.0), _FIN_AREA),
    LiftingSurface(
        "mast",
        (-0.72, 0.0, -0.17),
        (0.0, 1.0, 0.0),
        0.003,
        lift_slope=1.2,
        profile_drag=0.08,
        stall_rad=math.radians(18.0),
    ),
)


def _scaled(surfaces: tuple[LiftingSurface, ...], scale: float) -> list[LiftingSurface]:
    def moved(centre: tuple[float, float, float]) -> tuple[float, float, float]:
        return centre[0] * scale, centre[1] * scale, centre[2] * scale

    return [
        replace(item, centre_m=moved(item.centre_m), area_m2=item.area_m2 * scale**2)
        for item in surfaces
    ]
