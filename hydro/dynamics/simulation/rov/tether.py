"""Force of a tether on the vehicle: slack or taut, with drag, lift and a moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import Rows

TETHER_WIDTH = 11
"""Numbers in `Tether.row`."""


def tether_components(
    row: Array,
    rotation: Rows,
    position: tuple[Array, ...],
    nu: tuple[Array, ...],
    current: tuple[Array, ...],
) -> tuple[Array, ...]:
    """Return X to N of the tether with the constants of `Tether.row`.

    At the attachment a: P = position + R a, V = R (v + omega x a) through the water,
    h = depth of P, e = |anchor - P| - length,
    F = T (anchor - P) / |anchor - P| - c h |V| V + d h |current| current - f h down,
    T = k / 2 (e + sqrt(e^2 + b^2)), which is slack below and k e beyond the length;
    body force R' F and moment a x R' F. `current` (3) NED [m/s].

    Arrays of one shape, or numbers in the compiled loop.
    """
    ax, ay, az = row[0], row[1], row[2]
    u, v, w, p, q, r = nu
    vx, vy, vz = u + q * az - r * ay, v + r * ax - p * az, w + p * ay - q * ax
    (r11, r12, r13), (r21, r22, r23), (r31, r32, r33) = rotation
    # To the anchor, NED; depth of the attachment.
    north = row[3] - position[0] - (r11 * ax + r12 * ay + r13 * az)
    east = row[4] - position[1] - (r21 * ax + r22 * ay + r23 * az)
    depth = position[2] + r31 * ax + r32 * ay + r33 * az
    distance = np.sqrt(north * north + east * east + depth * depth) + 1e-9
    beyond = distance - row[5]
    pull = 0.5 * row[6] * (beyond + np.sqrt(beyond * beyond + row[7] * row[7])) / distance
    hanging = np.maximum(depth, 0.0)
    # Water flows past the part of the tether that hangs still.
    flow = row[10] * hanging * np.sqrt(current[0] ** 2 + current[1] ** 2 + current[2] ** 2)
    fn = pull * north + flow * current[0]
    fe = pull * east + flow * current[1]
    fd = -pull * depth + flow * current[2] - row[9] * hanging
    # Drag of the part that follows the vehicle, in body axes.
    drag = row[8] * hanging * np.sqrt(vx * vx + vy * vy + vz * vz)
    x = r11 * fn + r21 * fe + r31 * fd - drag * vx
    y = r12 * fn + r22 * fe + r32 * fd - drag * vy
    z = r13 * fn + r23 * fe + r33 * fd - drag * vz
    return x, y, z, ay * z - az * y, az * x - ax * z, ax * y - ay * x


@dataclass(frozen=True)
class Tether:
    """A tether from an anchor at the surface to a point of the vehicle.

    `attachment_m` in body axes, `anchor_m` north and east of the start. Beyond
    `length_m` it pulls with `stiffness_N_m`, rounded over `softness_m`. `carried`:
    share of the hanging length that moves with the vehicle and drags.
    """

    attachment_m: tuple[float, float, float] = (-0.18, 0.0, -0.10)
    anchor_m: tuple[float, float] = (0.0, 0.0)
    length_m: float = 25.0
    stiffness_N_m: float = 12.0
    softness_m: float = 0.5
    diameter_m: float = 0.0076
    drag_coefficient: float = 1.2
    carried: float = 0.3
    lift_N_m: float = 0.02

    def row(self, density: float) -> Array:
        """Return the constants of `tether_components` (TETHER_WIDTH,)."""
        half = 0.5 * density * self.drag_coefficient * self.diameter_m
        return np.array(
            [
                *self.attachment_m,
                *self.anchor_m,
                self.length_m,
                self.stiffness_N_m,
                self.softness_m,
                half * self.carried,
                self.lift_N_m,
                0.5 * half,  # half of the load of an even flow reaches the lower end
            ]
        )


NO_TETHER = np.zeros(TETHER_WIDTH)
"""The constants of no tether: no force."""
