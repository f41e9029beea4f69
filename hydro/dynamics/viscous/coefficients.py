"""A hydrodynamic coefficient as a value, and the two ways it is named.

It is `Y_v|v|` in tables, axis Y and term v*|v| in the basis.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, PROPULSION

FIN_INPUTS = ("deltar", "deltas")


@dataclass(frozen=True)
class Coefficient:
    """One hydrodynamic coefficient.

    `kind` added_mass, drag, body_lift, surface_lift or control; `formula` in LaTeX;
    `source` thesis and equation.

    Added mass follows McCarter's sign, tau_A = M_A nu_dot with M_A <= 0; the others
    multiply their basis term on the right-hand side; control coefficients multiply u^2
    delta, delta in rad: both fins of a pair together, for K the right one by delta, the
    left by -delta.
    """

    name: str
    value: float
    unit: str
    kind: str
    formula: str
    source: str
    note: str = ""

    @property
    def axis(self) -> str:
        """X Y Z K M N."""
        return self.name[0]

    @property
    def term(self) -> str:
        """Return the basis term (McCarter C.7).

        For other kinds, what stands behind the underscore.
        """
        return term_of(self.name)


def term_of(name: str) -> str:
    """Return the basis term of a name, which is the axis and the term without stars.

    An added mass (`M_qdot`) or a control stays as it stands.

    Raises `CampaignError` for a name that is neither.

    >>> term_of("Y_v|v|"), term_of("N_ur"), term_of("Z_(wV)(eta-1)"), term_of("M_qdot")
    ('v*|v|', 'u*r', '(w*V)*(eta-1)', 'qdot')
    """
    axis, _, rest = name.partition("_")
    if axis in AXES and (rest in _DERIVATIVES or rest in _CONTROLS):
        return rest
    if axis not in AXES or rest not in _TERMS:
        names = [f"{item}_{speed}|{speed}|" for item in AXES for speed in VELOCITIES]
        raise CampaignError(
            "not a hydrodynamic coefficient",
            field=name,
            remedy=nearest(name, names) or "Write Y_vdot, Y_v|v|, Y_uv.",
        )
    return _TERMS[rest]


_TERMS = {term.replace("*", ""): term for term in BASIS_TERMS}
_DERIVATIVES = tuple(f"{speed}dot" for speed in VELOCITIES)
_CONTROLS = tuple(f"uu{delta}" for delta in FIN_INPUTS)


def unit_of(name: str) -> str:
    """Return the SI unit of a coefficient by its name.

    That of the force divided by that of the velocities; radians and eta - 1 count as 1.

    >>> unit_of("Y_v|v|"), unit_of("N_r"), unit_of("X_|u|"), unit_of("Z_(wV)(eta-1)")
    ('kg/m', 'kg*m^2/s', 'kg/s', 'kg/m')
    """
    axis, term = AXES.index(name[0]), term_of(name)
    if term in _CONTROLS:
        return "kg/m" if axis < 3 else "kg"
    moving = []
    if term in _DERIVATIVES:
        power = (axis > 2) + (VELOCITIES.index(term[0]) > 2)
    else:
        factors = BASIS_TERMS[term].factors
        moving = [item.strip("|") for item in factors if item != PROPULSION]
        power = (axis > 2) + sum(item in "pqr" for item in moving) - len(moving) + 1
    unit = {-2: "kg/m^2", -1: "kg/m", 0: "kg", 1: "kg*m", 2: "kg*m^2"}[power]
    return f"{unit}/s" if len(moving) == 1 else unit


def added_mass_matrix(coefficients: Iterable[Coefficient]) -> Array:
    """M_A (6, 6), symmetric, of those coefficients that are added masses."""
    matrix = np.zeros((6, 6))
    for item in coefficients:
        if item.kind == "added_mass":
            i, j = AXES.index(item.axis), VELOCITIES.index(item.term[0])
            matrix[i, j] = matrix[j, i] = item.value
    return matrix


def control_matrix(coefficients: Iterable[Coefficient]) -> Array:
    """Return the force per u^2 and rad (6, 3) of the control surfaces.

    Columns delta_r, delta_s_right, delta_s_left: each stern fin gives half of what its
    pair gives.
    """
    matrix = np.zeros((6, 3))
    for item in coefficients:
        if item.kind != "control":
            continue
        axis = AXES.index(item.axis)
        if item.term == _CONTROLS[0]:
            matrix[axis, 0] = item.value
        else:
            matrix[axis, 1], matrix[axis, 2] = (
                0.5 * item.value,
                (-0.5 if item.axis == "K" else 0.5) * item.value,
            )
    return matrix


def viscous_terms(coefficients: Iterable[Coefficient]) -> dict[str, dict[str, float]]:
    """Return axis -> term -> coefficient of the viscous force.

    Drag is Al Makdah (2.36, corrected: each term times its velocity), X_drag = X_u|u|
    u|u|, Y_drag = Y_v|v| v|v| + Y_r|r| r|r| and so on [N, N m]; drag and lift are summed
    where several parts share a term.

    >>> viscous_terms([Coefficient("Y_r|r|", 3.0, unit_of("Y_r|r|"), "drag", "", "")])
    {'Y': {'r*|r|': 3.0}}
    """
    total: dict[str, dict[str, float]] = {}
    for item in coefficients:
        if item.kind in ("drag", "body_lift", "surface_lift"):
            terms = total.setdefault(item.axis, {})
            terms[item.term] = terms.get(item.term, 0.0) + item.value
    return total
