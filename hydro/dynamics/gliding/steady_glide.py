"""The steady glide: net buoyancy against drag and lift, in the vertical plane.

Merckelbach, Smeed, Griffiths 2010 (J. Atmos. Oceanic Technol. 27, 547-563), equations
(1) to (8), and Merckelbach, Berger, Krahmann, Dengler, Carpenter 2019 (36, 281-296).
Signs are those of auvid: pitch theta and path angle gamma positive nose up, depth rate
positive down, angle of attack alpha = theta - gamma (positive on a dive).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, Index

STALL_RAD = 0.35
"""Lift grows no further beyond this angle of attack; no steady glide has it."""


@dataclass(frozen=True)
class GliderBody:
    """What is weighed or measured of a glider: mass [kg], reference area [m^2].

    `neutral_kg_m3`: water in which it floats neutral with its drive at zero, but for the
    trim. `added_kg`: added mass along the hull. Compressibility epsilon and expansion
    alpha_T of the hull about `temperature_K`; gravity [m/s^2].
    """

    mass_kg: float
    area_m2: float
    gravity: float
    neutral_kg_m3: float
    added_kg: float = 0.0
    compressibility_1_pa: float = 0.0
    expansion_1_k: float = 0.0
    temperature_K: float = 283.15


@dataclass(frozen=True)
class Polar:
    """Drag C_D0 + C_D1 (alpha - alpha_0)^2 and lift a (alpha - alpha_0), per area."""

    drag: float
    induced: float
    lift_slope: float
    zero_lift_rad: float = 0.0

    def drag_coefficient(self, alpha: ArrayLike) -> Array:
        """Return C_D (n,) at angles of attack (n,) [rad]."""
        return np.asarray(
            self.drag + self.induced * np.square(np.asarray(alpha) - self.zero_lift_rad)
        )


@dataclass(frozen=True)
class GlideState:
    """What a record holds at n times: the inputs of the balance.

    pitch [rad], drive volume [m^3], density [kg/m^3], pressure [Pa], temperature [K].
    """

    pitch_rad: Array
    drive_m3: Array
    density_kg_m3: Array
    pressure_pa: Array
    temperature_K: Array


@dataclass(frozen=True)
class SteadyGlide:
    """Steady motion at n times; nan where the balance has no glide.

    Angle of attack and path angle [rad], speed through the water [m/s], depth rate
    [m/s] positive down.
    """

    alpha_rad: Array
    path_rad: Array
    speed_m_s: Array
    depth_rate_m_s: Array


def net_buoyancy(state: GlideState, body: GliderBody, trim_m3: float) -> Array:
    """Return B - W (n,) [N], positive up.

    B - W = g {rho [V (1 - epsilon p + alpha_T (T - T_0)) + V_drive] - m}
    (Merckelbach 2010 (1)-(2)), V = m / rho_0 + trim.
    """
    hull = (body.mass_kg / body.neutral_kg_m3 + trim_m3) * (
        1.0
        - body.compressibility_1_pa * state.pressure_pa
        + body.expansion_1_k * (state.temperature_K - body.temperature_K)
    )
    return np.asarray(body.gravity * (state.density_kg_m3 * (hull + state.drive_m3) - body.mass_kg))


def angle_of_attack(pitch_rad: ArrayLike, polar: Polar) -> Array:
    """Return alpha (n,) [rad] at which lift and drag stand along the net buoyancy.

    a (alpha - alpha_0) tan(theta - alpha) + C_D(alpha) = 0, by Newton's method from
    alpha = alpha_0 (Merckelbach 2010 (8), in the signs of auvid). nan for a pitch too
    flat to glide at.

    >>> polar = Polar(drag=0.18, induced=10.5, lift_slope=7.5)
    >>> [round(float(np.degrees(x)), 2) for x in angle_of_attack(np.radians([-22.0, 22.0]), polar)]
    [3.51, -3.51]
    """
    # numba: a second to import
    from auvid.hydro.dynamics.gliding.compiled_balance import angles_beyond_zero_lift

    pitch = np.asarray(pitch_rad, dtype=np.float64)
    lean = (pitch - polar.zero_lift_rad).ravel()
    beyond = angles_beyond_zero_lift(lean, polar.lift_slope, polar.drag, polar.induced, STALL_RAD)
    return (beyond + polar.zero_lift_rad).reshape(pitch.shape)


def steady_glide(
    state: GlideState, *, body: GliderBody, polar: Polar, trim_m3: float
) -> SteadyGlide:
    """Return the steady motion (n,) of the balance along and across the path.

    F sin(gamma) = 1/2 rho S U^2 C_D, F cos(gamma) = -1/2 rho S U^2 C_L with F = B - W
    (Merckelbach 2010 (5)-(7)); depth rate -U sin(gamma).

    >>> still = [np.array([x]) for x in (-0.384, -2.3e-4, 1006.0, 2e5, 283.15)]
    >>> body = GliderBody(mass_kg=70.0, area_m2=0.1, gravity=9.81, neutral_kg_m3=1006.0)
    >>> glide = steady_glide(
    ...     GlideState(*still), body=body, polar=Polar(0.18, 10.5, 7.5), trim_m3=0.0
    ... )
    >>> [round(float(each[0]), 3) for each in (glide.speed_m_s, glide.depth_rate_m_s)]
    [0.298, 0.128]
    """
    alpha = angle_of_attack(state.pitch_rad, polar)
    path = state.pitch_rad - alpha
    force = net_buoyancy(state, body, trim_m3)
    square = 2.0 * force * np.sin(path)
    square = square / (state.density_kg_m3 * body.area_m2 * polar.drag_coefficient(alpha))
    speed = np.sqrt(np.where(square > 0.0, square, np.nan))
    return SteadyGlide(alpha, path, speed, -speed * np.sin(path))


def slow_change(
    glide: SteadyGlide,
    state: GlideState,
    *,
    body: GliderBody,
    trim_m3: float,
    t_s: Array,
    part: Index,
) -> SteadyGlide:
    """Return glides (n,) whose speed lags behind the steady one, t_s (n,) [s].

    `part` (n,): number of the glide, ascending; nothing carries over from one to the next.

    Along the path U follows the steady speed U_s as dU/dt = (U_s - U) / tau, with
    tau = (m + m_a) U_s / (2 F sin(gamma)): layers of the water and jitter of the pitch.
    """
    from auvid.hydro.dynamics.gliding.compiled_balance import lagging  # numba: a second

    pull = 2.0 * net_buoyancy(state, body, trim_m3) * np.sin(glide.path_rad)
    lag_s = (body.mass_kg + body.added_kg) * glide.speed_m_s / pull
    share = lagging(t_s, part, glide.speed_m_s, lag_s) / glide.speed_m_s
    return SteadyGlide(
        glide.alpha_rad, glide.path_rad, glide.speed_m_s * share, glide.depth_rate_m_s * share
    )
