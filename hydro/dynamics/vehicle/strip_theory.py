"""Added mass and drag of a slender vehicle by strip theory.

Al Makdah 2016 (2.66)-(2.89) after Newman, Blevins and Prestero.

`corrected` False is the thesis as printed, its slips included; True applies the errata.
Both use the heights of fins and wings above the hull's axis for b of (2.74), (2.79) and
the hull radius for a: only that reproduces Table 2.9.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.added_mass import spheroid_added_mass
from auvid.hydro.dynamics.vehicle.geometry import Geometry, Surface
from auvid.hydro.dynamics.vehicle.lift import body_lift, surface_lift
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.coefficients import Coefficient, unit_of

SKIN_FRICTION = 3.397e-3
"""c_ss: Schoenherr's flat plate (2.83)."""
THESIS = "Al Makdah 2016"


def strip_theory(
    geometry: Geometry, *, water_density: float, corrected: bool = True
) -> tuple[Coefficient, ...]:
    """Return all coefficients that the geometry gives; density [kg/m^3].

    Added mass, drag, body lift, lift and control of the surfaces.
    """
    return (
        *added_mass(geometry, water_density=water_density, corrected=corrected),
        *drag(geometry, water_density=water_density, corrected=corrected),
        *body_lift(geometry, water_density=water_density, corrected=corrected),
        *surface_lift(geometry, water_density=water_density),
    )


def strip_theory_of(vehicle: Vehicle, *, corrected: bool = True) -> tuple[Coefficient, ...]:
    """Return strip theory of a vehicle; `CampaignError` where it has no geometry."""
    if vehicle.geometry is None:
        raise CampaignError(
            "the vehicle has no geometry",
            field="geometry.hull",
            remedy=(
                "Strip theory needs the shape of the hull and its fins: give the block `geometry`"
                " in the vehicle file."
            ),
        )
    return strip_theory(vehicle.geometry, water_density=vehicle.water_density, corrected=corrected)


def finned_circle(a: Array, b: float) -> Array:
    """Return the added mass per length over rho of a circle with two fins [m^2].

    Radius a, fins to height b, moving across them: (2.74), Table 2.7.

    pi [a^2 + (b^2 - a^2)^2 / b^2]; a flat plate pi b^2 for a -> 0, a circle pi a^2 for
    b -> a.
    """
    return np.asarray(np.pi * (a**2 + (b**2 - a**2) ** 2 / b**2))


def finned_circle_roll(a: Array, b: float) -> Array:
    """Return the added moment of inertia in roll per length over rho [m^4].

    Of a circle of radius a with two opposite fins to height b (Table 2.7).

    a^4 (csc^4(alpha) [2 alpha^2 - alpha sin 4 alpha + 1/2 sin^2 2 alpha] / pi - pi /
    2), sin alpha = 2 a b / (a^2 + b^2), pi / 2 < alpha < pi (2.65); pi b^4 / 8 for a ->
    0, which is also returned below a = b / 1000, where the form loses its digits.
    """
    a = np.asarray(a, dtype=np.float64)
    plate = np.full(a.shape, np.pi / 8.0 * b**4)
    thick = a > 1e-3 * b
    ratio = np.where(thick, a, b) / b
    sine = 2.0 * ratio / (1.0 + ratio**2)
    alpha = np.pi - np.arcsin(np.clip(sine, 0.0, 1.0))
    bracket = 2.0 * alpha**2 - alpha * np.sin(4.0 * alpha) + 0.5 * np.sin(2.0 * alpha) ** 2
    finned = (ratio * b) ** 4 * (bracket / (np.pi * sine**4) - 0.5 * np.pi)
    return np.where(thick, finned, plate)


def _section(geometry: Geometry, *, heave: bool) -> Callable[[Array], Array]:
    """Return m_22(x) or m_33(x) over rho [m^2].

    Circles, finned where a pair stands across the motion.
    """

    def area(x: Array) -> Array:
        a = geometry.hull.radius_m(x)
        out = np.pi * a**2
        for item in geometry.surfaces:
            if item.in_heave if heave else item.in_sway:
                out = np.where(
                    (x > item.rear_x_m) & (x < item.front_x_m),
                    finned_circle(a, item.tip_height_m),
                    out,
                )
        return out

    return area


def added_mass(
    geometry: Geometry, *, water_density: float, corrected: bool = True
) -> tuple[Coefficient, ...]:
    """Return the eight derivatives of (2.66)-(2.81) about the body origin.

    They have McCarter's sign (M_A <= 0).

    X_udot is (2.72) with alpha of the prolate spheroid with the hull's axes, which
    Table 2.8 tabulates. As printed, Z_qdot has the sign of (2.80) and every fin and
    wing rolls like four blades (2.79); corrected, Z_qdot = +int x m_33 and pairs roll
    by Table 2.7.
    """
    rho, hull = water_density, geometry.hull
    sway, heave = _section(geometry, heave=False), _section(geometry, heave=True)
    axial = float(
        spheroid_added_mass(0.5 * hull.length_m, 0.5 * hull.diameter_m, water_density=rho)[0, 0]
    )
    z_qdot = rho * geometry.integral(lambda x: x * heave(x)) * (1.0 if corrected else -1.0)
    rows = (
        (
            "X_udot",
            axial,
            r"-\frac{4\alpha\rho\pi}{3}\frac{l}{2}\left(\frac{d}{2}\right)^2",
            "(2.72)",
            "",
        ),
        ("Y_vdot", -rho * geometry.integral(sway), r"-\int m_{22}\,dx", "(2.67), (2.75)", ""),
        ("Z_wdot", -rho * geometry.integral(heave), r"-\int m_{33}\,dx", "(2.68), (2.76)", ""),
        (
            "K_pdot",
            -rho * _roll(geometry, corrected),
            _ROLL[corrected],
            "(2.79)" + (", pairs by Table 2.7" if corrected else ""),
            "",
        ),
        (
            "M_qdot",
            -rho * geometry.integral(lambda x: x * x * heave(x)),
            r"-\int x^2 m_{33}\,dx",
            "(2.77)",
            "",
        ),
        (
            "N_rdot",
            -rho * geometry.integral(lambda x: x * x * sway(x)),
            r"-\int x^2 m_{22}\,dx",
            "(2.78)",
            "",
        ),
        (
            "Y_rdot",
            -rho * geometry.integral(lambda x: x * sway(x)),
            r"-\int x\,m_{22}\,dx",
            "(2.81)",
            "",
        ),
        (
            "Z_qdot",
            z_qdot,
            ("+" if corrected else "-") + r"\int x\,m_{33}\,dx",
            "(2.80)" + (", sign corrected" if corrected else ""),
            "",
        ),
    )
    return tuple(
        Coefficient(n, value, unit_of(n), "added_mass", formula, f"{THESIS} {at}", note)
        for n, value, formula, at, note in rows
    )


_ROLL = {
    False: r"-\int\frac{2}{\pi}\rho b^4\,dx",
    True: r"-\int m_{44}\,dx,\ m_{44}=\frac{2}{\pi}\rho b^4\text{ (four blades), Table 2.7 (two)}",
}


def _roll(geometry: Geometry, corrected: bool) -> float:
    """Return the integral of m_44 / rho [m^5] over fins and wings.

    The hull is smooth and moves no water in roll.
    """
    total = 0.0
    for item in geometry.surfaces:
        b = item.tip_height_m
        if item.layout == "cruciform" or not corrected:
            total += 2.0 / math.pi * b**4 * (item.front_x_m - item.rear_x_m)
            continue

        def blades(x: Array, item: Surface = item) -> Array:
            inside = (x > item.rear_x_m) & (x < item.front_x_m)
            return np.where(
                inside, finned_circle_roll(geometry.hull.radius_m(x), item.tip_height_m), 0.0
            )

        total += geometry.integral(blades)
    return total


def drag(
    geometry: Geometry, *, water_density: float, corrected: bool = True
) -> tuple[Coefficient, ...]:
    """Return the ten coefficients of (2.82)-(2.89) about the body origin.

    As printed: x^3 without modulus cancels the hull in M_q|q| and N_r|r| (2.86; the
    signs of Table 2.10 need |x|^3 for fins and wings even so), fins and wings have the
    wrong sign in M_w|w| and N_v|v| (2.89), roll uses half the tip height, and the axial
    drag mixes two frontal areas: pi r^2 in (2.83), A_f in (2.82). Corrected: |x|^3,
    signs of aft fins that stabilise, the mean of hull radius and tip height, one
    frontal area.
    """
    hull = geometry.hull
    gamma = 0.5 * water_density * hull.cross_flow_drag
    plates = [
        (item, 0.5 * water_density * item.area_m2 * (0.1 + 0.7 * item.taper))
        for item in geometry.surfaces
    ]

    def hull_integral(weight: Callable[[Array], Array]) -> float:
        return gamma * geometry.integral(lambda x: 2.0 * weight(x) * hull.radius_m(x))

    def pairs(weight: Callable[[float], float], *, heave: bool) -> float:
        return sum(
            2.0 * weight(item.force_x_m) * nu
            for item, nu in plates
            if (item.in_heave if heave else item.in_sway)
        )

    cube = hull_integral((lambda x: np.abs(x) ** 3) if corrected else (lambda x: x**3))
    square, first = hull_integral(lambda x: x * np.abs(x)), hull_integral(lambda x: x)
    sign = 1.0 if corrected else -1.0
    slip = ", modulus corrected" if corrected else ""
    turned = ", sign of fins and wings corrected" if corrected else ""
    power = r"\lvert x\rvert^3" if corrected else "x^3"
    plus, minus = ("+", "-") if corrected else ("-", "+")
    cross_w, cross_v = pairs(lambda x: x, heave=True), pairs(lambda x: x, heave=False)
    rows = (
        _axial(geometry, water_density, corrected),
        (
            "Y_v|v|",
            -hull_integral(np.ones_like) - pairs(lambda x: 1.0, heave=False),
            r"-\gamma\int 2r\,dx-2\nu_f",
            "(2.86)",
        ),
        (
            "Z_w|w|",
            -hull_integral(np.ones_like) - pairs(lambda x: 1.0, heave=True),
            r"-\gamma\int 2r\,dx-2\nu_f-2\nu_w",
            "(2.86)",
        ),
        (
            "K_p|p|",
            _roll_drag(geometry, plates, corrected),
            _ROLL_DRAG,
            "(2.88)" + (", mean height corrected" if corrected else ""),
        ),
        (
            "M_q|q|",
            -cube - pairs(lambda x: abs(x) ** 3, heave=True),
            rf"-\gamma\int 2{power}r\,dx-2|x_f|^3\nu_f-2|x_w|^3\nu_w",
            "(2.86)" + slip,
        ),
        (
            "N_r|r|",
            -cube - pairs(lambda x: abs(x) ** 3, heave=False),
            rf"-\gamma\int 2{power}r\,dx-2|x_f|^3\nu_f",
            "(2.86)" + slip,
        ),
        (
            "Y_r|r|",
            -square - pairs(lambda x: x * abs(x), heave=False),
            r"-\gamma\int 2x|x|r\,dx-2x_f|x_f|\nu_f",
            "(2.89)",
        ),
        (
            "Z_q|q|",
            square + pairs(lambda x: x * abs(x), heave=True),
            r"\gamma\int 2x|x|r\,dx+2x_f|x_f|\nu_f+2x_w|x_w|\nu_w",
            "(2.89)",
        ),
        (
            "M_w|w|",
            first + sign * cross_w,
            rf"\gamma\int 2xr\,dx{plus}2x_f\nu_f{plus}2x_w\nu_w",
            "(2.89)" + turned,
        ),
        (
            "N_v|v|",
            -first - sign * cross_v,
            rf"-\gamma\int 2xr\,dx{minus}2x_f\nu_f",
            "(2.89)" + turned,
        ),
    )
    return tuple(
        Coefficient(n, value, unit_of(n), "drag", formula, f"{THESIS} {where}")
        for n, value, formula, where in rows
    )


def _axial(
    geometry: Geometry, water_density: float, corrected: bool
) -> tuple[str, float, str, str]:
    hull = geometry.hull
    d, length = hull.diameter_m, hull.length_m
    shape = 1.0 + 60.0 * (d / length) ** 3 + 0.0025 * length / d
    areas = 1.0 if corrected else hull.frontal_area_m2 / (0.25 * math.pi * d**2)
    value = -0.5 * water_density * SKIN_FRICTION * math.pi * length * d * shape * areas
    formula = r"-\frac12\rho c_{ss}\pi A_p\left[1+60\left(\frac dl\right)^3+0.0025\frac ld\right]"
    if not corrected:
        formula += r"\frac{A_f}{\pi r^2}"
    return "X_u|u|", value, formula, "(2.82), (2.83)" + (", one frontal area" if corrected else "")


_ROLL_DRAG = r"-2\nu_f\bar r_f^3-2\nu_w\bar r_w^3"


def _roll_drag(geometry: Geometry, plates: list[tuple[Surface, float]], corrected: bool) -> float:
    """(2.88) with the drag of one pair of each kind, as the thesis has it."""
    total = 0.0
    for item, nu in plates:
        root = 0.5 * geometry.hull.diameter_m if corrected else 0.0
        total -= 2.0 * nu * (0.5 * (item.tip_height_m + root)) ** 3
    return total
