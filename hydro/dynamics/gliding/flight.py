"""Motion of a glider in the vertical plane: yos under drive and a pitch program.

The twin of `steady_glide`: inertia and added mass, drive and pitch that take time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, exp, hypot, sin

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.gliding.steady_glide import STALL_RAD, GliderBody, GlideState, Polar

LONGEST_S = 7200.0
"""A dive or climb that takes longer is one that never turns."""


@dataclass(frozen=True)
class Water:
    """Layers of water: depth (k,) [m], density (k,) [kg/m^3], temperature (k,) [K]."""

    depth_m: Array
    density_kg_m3: Array
    temperature_K: Array


@dataclass(frozen=True)
class Yo:
    """A dive and a climb: pitch [rad] (dive negative) and drive [m^3] of both."""

    dive_pitch_rad: float
    climb_pitch_rad: float
    dive_drive_m3: float
    climb_drive_m3: float


@dataclass(frozen=True)
class FlightPlan:
    """Yos between two depths [m]; speed of the drive [m^3/s], lag of the pitch [s]."""

    yos: tuple[Yo, ...]
    top_m: float
    bottom_m: float
    drive_m3_s: float
    pitch_lag_s: float
    step_s: float = 0.5


@dataclass(frozen=True)
class GliderFlight:
    """Motion at n times: state, depth, depth rate, speed, angle of attack."""

    t_s: Array
    state: GlideState
    depth_m: Array
    depth_rate_m_s: Array
    speed_m_s: Array
    alpha_rad: Array


@dataclass(frozen=True)
class FlyingBody:
    """A glider with its truth: added masses X_udot and Z_wdot [kg] (not positive)."""

    body: GliderBody
    polar: Polar
    trim_m3: float
    X_udot: float
    Z_wdot: float


def fly_yos(glider: FlyingBody, water: Water, plan: FlightPlan) -> GliderFlight:
    """Return the flight of a plan from rest at its top depth.

    (m - X_udot) u' = X - (m - Z_wdot) q w, (m - Z_wdot) w' = Z + (m - X_udot) q u with
    X = F sin(theta) - D cos(alpha) + L sin(alpha),
    Z = -F cos(theta) - D sin(alpha) - L cos(alpha), F = B - W; pitch follows its program
    with a lag. Fourth-order Runge-Kutta. Raises `ValueError` for a yo that never turns.
    """
    h, body, polar = plan.step_s, glider.body, glider.polar
    mass_u, mass_w = body.mass_kg - glider.X_udot, body.mass_kg - glider.Z_wdot
    depths, densities = water.depth_m.tolist(), water.density_kg_m3.tolist()
    temperatures = water.temperature_K.tolist()
    at_surface = body.mass_kg / body.neutral_kg_m3 + glider.trim_m3
    fade = 1.0 - exp(-h / plan.pitch_lag_s)

    def rates(
        u: float, w: float, z: float, theta: float, q: float, drive: float
    ) -> Sequence[float]:
        rho, warm = _layer(z, depths, densities), _layer(z, depths, temperatures)
        pressure = rho * body.gravity * z
        hull = at_surface * (
            1.0
            - body.compressibility_1_pa * pressure
            + body.expansion_1_k * (warm - body.temperature_K)
        )
        force = body.gravity * (rho * (hull + drive) - body.mass_kg)
        speed, alpha = hypot(u, w), atan2(w, u) if u or w else 0.0
        dynamic = 0.5 * rho * body.area_m2 * speed * speed
        beyond = min(max(alpha - polar.zero_lift_rad, -STALL_RAD), STALL_RAD)
        drag = dynamic * (polar.drag + polar.induced * beyond * beyond)
        lift = dynamic * polar.lift_slope * beyond
        X = force * sin(theta) - drag * cos(alpha) + lift * sin(alpha)
        Z = -force * cos(theta) - drag * sin(alpha) - lift * cos(alpha)
        return (
            (X - mass_w * q * w) / mass_u,
            (Z + mass_u * q * u) / mass_w,
            -u * sin(theta) + w * cos(theta),
        )

    u, w, z, theta, drive, t = 0.0, 0.0, plan.top_m, 0.0, 0.0, 0.0
    rows: list[tuple[float, ...]] = []
    for yo in plan.yos:
        for down in (True, False):
            aim = yo.dive_pitch_rad if down else yo.climb_pitch_rad
            target = yo.dive_drive_m3 if down else yo.climb_drive_m3
            start = t
            while z < plan.bottom_m if down else z > plan.top_m:
                q = (aim - theta) * fade / h
                a = rates(u, w, z, theta, q, drive)
                rows.append((t, u, w, z, theta, drive, a[2]))
                half = h / 2.0
                middle = theta + q * half
                b = rates(u + half * a[0], w + half * a[1], z + half * a[2], middle, q, drive)
                c = rates(u + half * b[0], w + half * b[1], z + half * b[2], middle, q, drive)
                d = rates(u + h * c[0], w + h * c[1], z + h * c[2], theta + q * h, q, drive)
                u, w, z = (
                    x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
                    for x, k1, k2, k3, k4 in zip((u, w, z), a, b, c, d, strict=True)
                )
                theta, t = theta + q * h, t + h
                most = plan.drive_m3_s * h
                drive += min(max(target - drive, -most), most)
                if t - start > LONGEST_S:
                    raise ValueError(
                        f"the glider does not reach {plan.bottom_m if down else plan.top_m:g} m"
                        f" within {LONGEST_S:g} s: {'heavier' if down else 'lighter'} drive, or"
                        " steeper"
                    )
    at = np.array(rows)
    depth, pitch = at[:, 3], at[:, 4]
    density = np.interp(depth, water.depth_m, water.density_kg_m3)
    state = GlideState(
        pitch,
        at[:, 5],
        density,
        density * body.gravity * depth,
        np.interp(depth, water.depth_m, water.temperature_K),
    )
    speed = np.hypot(at[:, 1], at[:, 2])
    return GliderFlight(at[:, 0], state, depth, at[:, 6], speed, np.arctan2(at[:, 2], at[:, 1]))


def _layer(depth: float, depths: list[float], values: list[float]) -> float:
    """Return a value of layered water at a depth, by straight lines."""
    if depth <= depths[0]:
        return values[0]
    for index in range(1, len(depths)):
        if depth < depths[index]:
            share = (depth - depths[index - 1]) / (depths[index] - depths[index - 1])
            return values[index - 1] + share * (values[index] - values[index - 1])
    return values[-1]
