"""Drag of an open frame from plates on its faces, for the truth of an ROV's twin.

Each face is cut into plates. A plate feels a pressure on its windward side, a smaller
suction on its leeward side, quadratic friction along it, and a part linear in speed
(laminar friction). All of it goes with the local velocity of the plate, so that turning
couples with translation, ahead differs from astern and up from down, and the force is in
the span of no model of hydro/dynamics/viscous.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, read_only

PLATE_WIDTH = 10
"""Numbers in a row of `OpenFrame.plates`."""


def plate_components(
    row: tuple[Array, ...], u: Array, v: Array, w: Array, p: Array, q: Array, r: Array
) -> tuple[Array, ...]:
    """Return X to N of a plate with the constants of `OpenFrame.plates`.

    V = v + omega x c, s = V . n, |V| its length:
    F = -n |V| (a max(s, 0) + b min(s, 0)) - t |V| (V - s n) - l V, moment c x F.

    Arrays of one shape, or numbers in the compiled loop. F . V <= 0: a plate takes
    energy out of every motion.

    >>> row = np.zeros(10)
    >>> row[[3, 6, 7, 9]] = 1.0, 40.0, 10.0, 1.0
    >>> [float(plate_components(row, u, 0.0, 0.0, 0.0, 0.0, 0.0)[0]) for u in (2.0, -2.0)]
    [-162.0, 42.0]
    """
    cx, cy, cz, nx, ny, nz, windward, leeward, friction, linear = row
    vx, vy, vz = u + q * cz - r * cy, v + r * cx - p * cz, w + p * cy - q * cx
    into = vx * nx + vy * ny + vz * nz
    speed = np.sqrt(vx * vx + vy * vy + vz * vz)
    along, size = friction * speed, abs(into)
    # max(s, 0) = (s + |s|) / 2, min(s, 0) = (s - |s|) / 2
    pressure = 0.5 * (windward * (into + size) + leeward * (into - size))
    normal = along * into - speed * pressure
    damping = along + linear
    x = normal * nx - damping * vx
    y = normal * ny - damping * vy
    z = normal * nz - damping * vz
    return x, y, z, cy * z - cz * y, cz * x - cx * z, cx * y - cy * x


@dataclass(frozen=True)
class Face:
    """One face of the frame, with pressure where it meets the water and suction behind.

    `centre_m` and `size_m` (3,): the middle and the extent along the axes, 0 along the
    normal. `windward` and `leeward`: drag coefficients on the solid area.
    """

    centre_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    size_m: tuple[float, float, float]
    windward: float
    leeward: float
    solidity: float = 1.0
    cuts: int = 3

    def rows(self, density: float, *, along: float, linear: float) -> list[list[float]]:
        """Return the plates of the face (k, PLATE_WIDTH), `cuts` along each direction.

        `along`: friction coefficient; `linear`: damping per area [N s/m^3].
        """
        cuts = [self.cuts if size > 0.0 else 1 for size in self.size_m]
        sides = [size for size in self.size_m if size > 0.0]
        area = self.solidity * sides[0] * sides[1] / self.cuts**2
        half = 0.5 * density * area
        return [
            [
                *(
                    middle + size * ((step + 0.5) / count - 0.5)
                    for middle, size, step, count in zip(
                        self.centre_m, self.size_m, place, cuts, strict=True
                    )
                ),
                *self.normal,
                half * self.windward,
                half * self.leeward,
                half * along,
                area * linear,
            ]
            for place in product(*map(range, cuts))
        ]


@dataclass(frozen=True)
class OpenFrame:
    """The plates of a frame (n, 10), their areas and 1/2 rho in the constants.

    Columns: centre [m], outward normal, windward a, leeward b, tangential t [kg/m], and
    linear l [kg/s].
    """

    plates: Array

    def force(self, nu: ArrayLike) -> Array:
        """Return the drag of the frame: nu (..., 6) -> (..., 6) [N, N m]."""
        motion = np.moveaxis(np.asarray(nu, dtype=np.float64), -1, 0)
        parts = [np.stack(plate_components(tuple(row), *motion), axis=-1) for row in self.plates]
        return np.asarray(sum(parts))


HEAVY_FACES = (
    # Front and stern: the domes of the tubes, the frame and the thrusters behind.
    Face((0.22, 0.0, 0.01), (1, 0, 0), (0.0, 0.50, 0.25), 0.72, 0.30, 0.80),
    Face((-0.23, 0.01, 0.01), (-1, 0, 0), (0.0, 0.50, 0.25), 0.95, 0.38, 0.80),
    # Sides: open frames with the ducts of the vertical thrusters.
    Face((0.01, 0.28, 0.02), (0, 1, 0), (0.45, 0.0, 0.25), 0.95, 0.42, 0.85),
    Face((0.01, -0.28, 0.02), (0, -1, 0), (0.45, 0.0, 0.25), 0.95, 0.42, 0.85),
    # Bottom with skid and ballast, top with the fairings of the buoyancy.
    Face((-0.01, 0.0, 0.14), (0, 0, 1), (0.45, 0.55, 0.0), 0.62, 0.34, 0.80),
    Face((0.02, 0.0, -0.12), (0, 0, -1), (0.45, 0.50, 0.0), 0.88, 0.40, 0.80),
    # A velocity log hangs below the front, off the middle.
    Face((0.12, 0.04, 0.18), (1, 0, 0), (0.0, 0.10, 0.08), 1.0, 0.40, 1.0, 1),
    Face((0.12, 0.04, 0.18), (-1, 0, 0), (0.0, 0.10, 0.08), 1.0, 0.40, 1.0, 1),
)
"""Faces of a BlueROV2 Heavy, 0.457 x 0.575 x 0.254 m (Blue Robotics); coefficients of
bluff bodies (Hoerner 1965, ch. 3), chosen so that surge, sway and heave come near the
quadratic damping of published models (60 to 220 N s^2/m^2)."""
FRICTION = 0.02
LINEAR_N_S_M3 = 7.0
"""Damping per area of the faces; with them 5 to 9 N s/m in translation."""


def heavy_frame(density: float) -> OpenFrame:
    """Return the drag of a BlueROV2 Heavy in water of this density [kg/m^3]."""
    rows = [
        row
        for face in HEAVY_FACES
        for row in face.rows(density, along=FRICTION, linear=LINEAR_N_S_M3)
    ]
    return OpenFrame(read_only(rows))
