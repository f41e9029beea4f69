"""Lift of hull, fins and wings from their geometry: Al Makdah 2016 (2.38)-(2.54).

After Hoerner and Prestero.

`corrected` False is the thesis as printed; True applies the errata to reference area
and sign of the body lift.
"""

from __future__ import annotations

import math

import numpy as np

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import read_only
from auvid.hydro.dynamics.actuators.fins import Fins
from auvid.hydro.dynamics.vehicle.geometry import Geometry, Surface
from auvid.hydro.dynamics.viscous.coefficients import Coefficient, unit_of

HOERNER_SLOPE_PER_DEGREE = 0.003
HOERNER_RANGE = (6.7, 10.0)
SECTION_EFFICIENCY = 0.9
CENTRE_OF_PRESSURE = 0.65
"""Of the length from the nose (2.47); Hoerner gives 0.6 to 0.7."""


def lift_slope(surface: Surface) -> float:
    """Return the lift slope c_L,alpha (2.53) [1/rad] of one surface.

    The effective aspect ratio is AR_e = 2 b^2 / S (2.54): the hull mirrors the surface.
    """
    aspect = 2.0 * surface.span_m**2 / surface.area_m2
    return 1.0 / (1.0 / (2.0 * SECTION_EFFICIENCY * math.pi) + 1.0 / (math.pi * aspect))


def body_lift(
    geometry: Geometry, *, water_density: float, corrected: bool = True
) -> tuple[Coefficient, ...]:
    """Return Y_uv, Z_uw, M_uw, N_uv of the hull (2.38)-(2.50), moments at the origin.

    As printed the slope refers to the planform A_p and M_uw = -1/2 rho A_p c x_cp.
    Corrected: Hoerner's slope, which has l/d in it, refers to d^2, and M_uw = -x_cp
    Z_uw. The slope is measured for l/d from 6.7 to 10; outside the coefficients carry a
    note.
    """
    hull = geometry.hull
    slope = hull.slenderness * HOERNER_SLOPE_PER_DEGREE * 180.0 / math.pi
    planform = geometry.integral(lambda x: 2.0 * hull.radius_m(x))
    area = hull.diameter_m**2 if corrected else planform
    x_cp = hull.nose_x_m - CENTRE_OF_PRESSURE * hull.length_m
    force = -0.5 * water_density * area * slope
    moment = (-1.0 if corrected else 1.0) * x_cp * force
    outside = not HOERNER_RANGE[0] <= round(hull.slenderness, 6) <= HOERNER_RANGE[1]
    note = f"l/d {hull.slenderness:.2f} is outside Hoerner's range 6.7 to 10" if outside else ""
    symbol, sign = ("d^2", "") if corrected else ("A_p", "-")
    plain = (
        rf"-\frac{{1}}{{2}}\rho {symbol}"
        r" c_{yd\beta},\ c_{yd\beta}=\frac{l}{d}\,0.003\,\frac{180}{\pi}"
    )
    turned = (
        rf"{sign}\frac{{1}}{{2}}\rho {symbol} c_{{yd\beta}} x_{{cp}},\ x_{{cp}}=-0.65l-x_{{zero}}"
    )
    opposite = rf"{'-' if corrected else ''}\frac{{1}}{{2}}\rho {symbol} c_{{yd\beta}} x_{{cp}}"
    errata = ", reference area corrected" if corrected else ""
    signs = ", area and sign corrected" if corrected else ""
    return (
        _lift("Y_uv", force, plain, f"Al Makdah 2016 (2.46){errata}", note),
        _lift("Z_uw", force, plain, f"Al Makdah 2016 (2.46){errata}", note),
        _lift("M_uw", moment, turned, f"Al Makdah 2016 (2.50){signs}", note),
        _lift("N_uv", -moment, opposite, f"Al Makdah 2016 (2.50){signs}", note),
    )


def _lift(name: str, value: float, formula: str, source: str, note: str) -> Coefficient:
    return Coefficient(name, value, unit_of(name), "body_lift", formula, source, note)


def surface_lift(geometry: Geometry, *, water_density: float) -> tuple[Coefficient, ...]:
    """Return the damping and control coefficients of each pair of surfaces.

    These are (2.52), (2.60)-(2.64), with moments about the body origin.

    A vertical pair gives Y = k [u^2 delta_r - uv - x ur], N = x Y; a horizontal pair Z
    = -k [u^2 delta_s + uw - x uq], M = -x Z, with k = rho c_L,alpha S for the two
    surfaces together. Controls only for the fins; their roll arm y_fin is the middle of
    the span (the thesis gives none).
    """
    coefficients: list[Coefficient] = []
    for item in geometry.surfaces:
        k, x = water_density * lift_slope(item) * item.area_m2, item.force_x_m
        where = f"{item.name}: S {item.area_m2:g} m^2, x {x:g} m, c_Lalpha {lift_slope(item):.4g}"
        rows: list[tuple[str, float, str]] = []
        if item.in_sway:
            rows += [
                ("Y_uv", -k, "-k"),
                ("Y_ur", -k * x, "-k x"),
                ("N_uv", -k * x, "-k x"),
                ("N_ur", -k * x * x, "-k x^2"),
            ]
            rows += (
                [("Y_uudeltar", k, "k"), ("N_uudeltar", k * x, "k x")] if item.controlled else []
            )
        if item.in_heave:
            rows += [
                ("Z_uw", -k, "-k"),
                ("Z_uq", k * x, "k x"),
                ("M_uw", k * x, "k x"),
                ("M_uq", -k * x * x, "-k x^2"),
            ]
            arm = item.tip_height_m - 0.5 * item.span_m
            roll = ("K_uudeltas", -k * arm, "-k y_{fin}")
            rows += (
                [("Z_uudeltas", -k, "-k"), roll, ("M_uudeltas", k * x, "k x")]
                if item.controlled
                else []
            )
        for name, value, factor in rows:
            kind = "control" if "delta" in name else "surface_lift"
            formula = (
                rf"{factor},\ k=\rho"
                r" c_{L\alpha}S,\ c_{L\alpha}=\left[\frac{1}{2\bar\alpha\pi}+\frac{1}{\pi"
                r" AR_e}\right]^{-1}"
            )
            coefficients.append(
                Coefficient(
                    name, value, unit_of(name), kind, formula, "Al Makdah 2016 (2.52)-(2.54)", where
                )
            )
    return tuple(coefficients)


def fins_from_geometry(geometry: Geometry | None, *, water_density: float) -> Fins:
    """Return the control fins of a geometry in McCarter's form (2.45).

    Columns starboard, port, bottom, top; angles as in (2.61)-(2.64).

    Each fin gives half the force of its pair at the middle of its span, so that unequal
    deflections roll the vehicle. A positive rudder pushes to starboard, a positive
    stern fin up. Raises `CampaignError` when no cruciform surface is marked
    `controlled`.
    """
    fins = None if geometry is None else geometry.fins
    if geometry is None or fins is None or fins.layout != "cruciform":
        raise CampaignError(
            "the geometry has no cruciform control fins",
            field="geometry.surfaces",
            remedy="Mark them `controlled: true`.",
        )
    k = 0.5 * water_density * lift_slope(fins) * fins.area_m2
    arm, x = fins.tip_height_m - 0.5 * fins.span_m, fins.force_x_m
    force = np.zeros((6, 4))
    for column, y in ((0, arm), (1, -arm)):
        force[[2, 3, 4], column] = -k, -k * y, x * k
    for column, z in ((2, arm), (3, -arm)):
        force[[1, 3, 5], column] = k, -k * z, x * k
    length = geometry.hull.length_m
    scale = 0.5 * water_density * length ** np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
    return Fins(
        length_m=length,
        linear=read_only(force / scale[:, None]),
        quadratic=read_only(np.zeros((6, 4))),
    )
