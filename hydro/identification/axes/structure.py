"""Which terms the motion of some axes has, as tables for the compiled loop.

    x_i_dot = a_i x_i + b_i x_i|x_i| + c_i F_i(t) + d_i + couplings + Coriolis_i

x: body velocities, each with its own integral s (heave: depth). 1 / c_i is the apparent
inertia where F is in newtons. Coriolis force of a diagonal inertia m_1 .. m_6 (Kirchhoff;
Fossen 2011, 6.3), over the inertia of the row:

    X: m_2 v r - m_3 w q           K: (m_2 - m_3) v w + (m_5 - m_6) q r
    Y: m_3 w p - m_1 u r           M: (m_3 - m_1) u w + (m_6 - m_4) r p
    Z: m_1 u q - m_2 v p           N: (m_1 - m_2) u v + (m_4 - m_5) p q
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array, Ints

LINEAR, QUADRATIC, INPUT, CONSTANT, RESTORING, SHARE = 0, 1, 2, 3, 4, 9
SIDES = {"ahead": (5, 7), "back": (6, 8)}
"""Kinds of `compiled_motion`; on one side of 0: linear, quadratic."""
SIDES_QUADRATIC = (QUADRATIC, 7, 8)
INERTIA = "inertia"
"""Name of the term by which the inertia of an axis differs from its given one: a factor of
it in the Coriolis force, no force itself (`SHARE`, as all that only multiplies products)."""
LEAST_SHARE, LARGEST_SHARE = 0.2, 5.0
LIFT = "u*v"
"""Name of the term of yaw by the product of the speeds ahead and aside: lift takes part of the
moment that added mass makes of them, so that this moment tells no inertia (decision 0117)."""
FORCE = "force"
"""Name of the term c F of an axis."""
RIGHTING = "restoring"
"""Name of the term of the sine of roll or pitch."""
HULL, ASIDE = "hull", "aside"
"""Names of the terms of a hull whose speeds ahead and aside nobody measures: by their product,
or tilt, and in yaw by the speed aside alone. A model of such axes lacks them."""
SYMMETRIC = {
    "X": "q", "Y": "pr", "Z": "q", "K": "vr", "M": "uw", "N": "vp",
}  # fmt: skip
"""Linear couplings that symmetry of port and starboard allows, beside the diagonal."""


@dataclass(frozen=True)
class AxisTerm:
    """One term of an axis: its name (`r`, `r|r|`, `force`, `constant`) and its tables.

    `lower`, `upper`: bounds of the coefficient. `mean`, `sd`: prior; sd inf for none,
    0 for a value that is fixed.
    """

    axis: str
    name: str
    kind: int
    of: int
    lower: float = -np.inf
    upper: float = np.inf
    mean: float = 0.0
    sd: float = np.inf


@dataclass(frozen=True)
class Structure:
    """Terms of the motion of `velocities` (k,), with inputs by name.

    `inertia` (6,): only its ratios matter, for Coriolis; None leaves it out. `inertia_by`:
    place of a velocity -> term c whose coefficient divides its inertia, m = k / c, so that
    the force has the inertia that the fit gives. Otherwise terms of kind `SHARE` are factors
    of the inertia of their axis.
    """

    velocities: tuple[str, ...]
    terms: tuple[AxisTerm, ...]
    inputs: tuple[str, ...]
    inertia: Array | None = None
    inertia_by: Mapping[int, str] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Return `axis term` of every coefficient."""
        return tuple(f"{term.axis} {term.name}" for term in self.terms)

    @cached_property
    def places(self) -> Ints:
        """Return where the velocities stand among u v w p q r (k,)."""
        return np.array([VELOCITIES.index(item) for item in self.velocities], dtype=np.int64)

    @cached_property
    def table(self) -> Ints:
        """Return row, kind and operand of every term (t, 3)."""
        row = {AXES[place]: i for i, place in enumerate(self.places)}
        rows = [row.get(t.axis, 0) if t.kind == SHARE else row[t.axis] for t in self.terms]
        return np.array(
            [(i, t.kind, t.of) for i, t in zip(rows, self.terms, strict=True)], dtype=np.int64
        )

    @cached_property
    def coriolis(self) -> tuple[Ints, Array]:
        """Return the products (p, 5) and their weights (p,), for coefficients of 1.

        Row, two factors, then the terms whose coefficients multiply and divide the weight,
        -1 for none.
        """
        products, weights = [], []
        if self.inertia is not None:
            term = {place: self.names.index(name) for place, name in self.inertia_by.items()}
            share = {
                VELOCITIES[AXES.index(item.axis)]: number
                for number, item in enumerate(self.terms)
                if item.name == INERTIA
            }
            for i, place in enumerate(self.places):
                for a, b, sign, of in _CORIOLIS[int(place)]:
                    up, down = term.get(int(place), -1), term.get(of, -1)
                    if share:
                        up = share.get(VELOCITIES[of], -1)
                        down = share.get(VELOCITIES[place], -1)
                    if up == down:
                        up = down = -1
                    products.append((i, a, b, up, down))
                    weights.append(sign * self.inertia[of] / self.inertia[place])
        for number, item in enumerate(self.terms):
            if item.name == LIFT:
                row = self.velocities.index(VELOCITIES[AXES.index(item.axis)])
                products.append((row, _U, _V, number, -1))
                weights.append(1.0)
        return np.array(products, dtype=np.int64).reshape(-1, 5), np.array(weights)


_U, _V, _W, _P, _Q, _R = range(6)
_CORIOLIS = (
    ((_V, _R, 1.0, _V), (_W, _Q, -1.0, _W)),
    ((_W, _P, 1.0, _W), (_U, _R, -1.0, _U)),
    ((_U, _Q, 1.0, _U), (_V, _P, -1.0, _V)),
    ((_V, _W, 1.0, _V), (_V, _W, -1.0, _W), (_Q, _R, 1.0, _Q), (_Q, _R, -1.0, _R)),
    ((_U, _W, 1.0, _W), (_U, _W, -1.0, _U), (_R, _P, 1.0, _R), (_R, _P, -1.0, _P)),
    ((_U, _V, 1.0, _U), (_U, _V, -1.0, _V), (_P, _Q, 1.0, _P), (_P, _Q, -1.0, _Q)),
)
"""Row -> factors of each product, its sign, and the velocity whose inertia it has."""


def axis_terms(
    axis: str,
    *,
    inputs: Sequence[str],
    inverse: tuple[float, float] | None = None,
    sides: bool = False,
    restoring: bool = False,
    couplings: Sequence[str] = (),
    extra: Mapping[str, tuple[float, float]] | None = None,
    share_sd: float = 0.0,
    creeps: bool = False,
) -> tuple[AxisTerm, ...]:
    """Return the terms of one axis: damping not above 0, force, constant, couplings.

    inverse: prior of c, mean and sd (0 fixes it). sides: damping ahead and back by
    coefficients of their own. couplings: velocities with linear terms. extra: input ->
    prior of its coefficient. share_sd: prior of the factor of its inertia, around 1; 0 for none.
    creeps: quadratic damping is 0.
    """
    at = AXES.index(axis)
    x = VELOCITIES[at]
    mean, sd = inverse or (0.0, np.inf)
    out = []
    for side, kinds in SIDES.items() if sides else {"": (LINEAR, QUADRATIC)}.items():
        words = (f"{x} {side}".strip(), f"{x}|{x}| {side}".strip())
        for name, kind in zip(words, kinds, strict=True):
            sd_of = 0.0 if creeps and kind in SIDES_QUADRATIC else np.inf
            out.append(AxisTerm(axis, name, kind, at, upper=0.0, sd=sd_of))
    out.append(AxisTerm(axis, FORCE, INPUT, list(inputs).index(axis), lower=0.0, mean=mean, sd=sd))
    out.append(AxisTerm(axis, "constant", CONSTANT, 0))
    if restoring:
        out.append(AxisTerm(axis, RIGHTING, RESTORING, 0, upper=0.0))
    out += [AxisTerm(axis, other, LINEAR, VELOCITIES.index(other)) for other in couplings]
    for name, (middle, width) in (extra or {}).items():
        out.append(AxisTerm(axis, name, INPUT, list(inputs).index(name), mean=middle, sd=width))
    if share_sd > 0.0:
        out.append(share_term(axis, share_sd))
    return tuple(out)


def lift_term(axis: str) -> AxisTerm:
    """Return the term of `LIFT`, a coefficient of one product of velocities."""
    return AxisTerm(axis, LIFT, SHARE, AXES.index(axis))


def share_term(axis: str, sd: float) -> AxisTerm:
    """Return the factor of the inertia of an axis, of prior 1 and sd; no force.

    The axis may be one that is measured and not fitted: its inertia moves the others.
    """
    at = AXES.index(axis)
    bounds = {"lower": LEAST_SHARE, "upper": LARGEST_SHARE}
    return AxisTerm(axis, INERTIA, SHARE, at, **bounds, mean=1.0, sd=sd)
