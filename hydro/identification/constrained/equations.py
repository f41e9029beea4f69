"""The unknowns of a force model, and which columns each adds to each axis.

An unknown that acts on one axis is a coefficient of least squares as ever. Added mass
acts on several, through its Coriolis force, and a thrust lag on all: they need the six
axes in one problem.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import PipelineError, nearest
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.viscous.models import ViscousModel
from auvid.hydro.identification.regression.least_squares import CONSTANT

ACCELERATIONS = tuple(f"{name}dot" for name in VELOCITIES)
"""Columns of body accelerations [m/s^2, rad/s^2]."""
ACTUATOR_RATES = tuple(f"d{axis}/dt" for axis in AXES)
"""Columns of the rate of the actuator force [N/s, N m/s]."""
LAG = "lag"
ALL_AXES = "all"


class Unknown(NamedTuple):
    """One number to be fitted: a term of an axis, `udot` for added mass, or a lag [s].

    >>> str(Unknown("Y", "v*|v|")), str(Unknown("N", "rdot")), str(Unknown("all", "lag"))
    ('Y_v|v|', 'N_rdot', 'thrust lag')
    """

    axis: str
    term: str

    def __str__(self) -> str:
        if self.term == LAG:
            return "thrust lag" if self.axis == ALL_AXES else f"thrust lag of {self.axis}"
        return f"{self.axis}_{self.term.replace('*', '')}"


@dataclass(frozen=True)
class ForceEquations:
    """tau_bar of every axis as a sum of unknowns times columns of the factor.

    shares: unknown -> (axis, column, weight); the axis's force is the sum of unknown *
    weight * column.
    """

    shares: Mapping[Unknown, tuple[tuple[str, str, float], ...]]

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Return the unknowns in the order of the solution."""
        return tuple(self.shares)

    def with_unknowns_of(self, other: ForceEquations) -> ForceEquations:
        """Return the equations with the unknowns of both."""
        return ForceEquations({**self.shares, **other.shares})

    def columns_of(self, axis: str) -> tuple[str, ...]:
        """Return the columns that act on an axis, each once."""
        return tuple(
            dict.fromkeys(
                column
                for parts in self.shares.values()
                for where, column, _ in parts
                if where == axis
            )
        )

    def weights(self, axis: str, columns: Sequence[str]) -> Array:
        """Return the matrix (len(columns), p): unknowns -> weights of the columns."""
        place = {column: i for i, column in enumerate(columns)}
        matrix = np.zeros((len(columns), len(self.shares)))
        for j, parts in enumerate(self.shares.values()):
            for where, column, weight in parts:
                if where == axis:
                    matrix[place[column], j] += weight
        return matrix


def viscous_equations(model: ViscousModel, *, trim: bool = False) -> ForceEquations:
    """Return K xi(nu) of a model, one unknown per axis and term.

    `trim`: and a constant per axis.
    """
    return ForceEquations(
        {
            Unknown(axis, term): ((axis, term, 1.0),)
            for axis in AXES
            for term in (*model.terms.get(axis, ()), *((CONSTANT,) if trim else ()))
        }
    )


def inertia_equations(names: Sequence[str]) -> ForceEquations:
    """Return what added mass beyond the vehicle file's adds to the residual force.

    tau_bar = K xi + dM_A nu_dot + C(dM_A, nu) nu: the residual force (McCarter 4.4) is
    formed with the file's M; dM_A (McCarter's sign, negative adds inertia) is the rest.
    Each name is an entry of dM_A (`N_rdot`, `Y_rdot`; symmetric, so that is N_vdot
    too). Products of velocities of the Coriolis force are the columns u*u ... r*r. An
    unknown moment of inertia is N_rdot too: the two act alike.

    >>> inertia_equations(["X_udot"]).shares[Unknown("X", "udot")][:3]
    (('X', 'udot', 1.0), ('N', 'u*v', -1.0), ('M', 'u*w', 1.0))
    """
    return ForceEquations({added_mass_unknown(name): _inertia_parts(name) for name in names})


def lag_equations(axes: Sequence[str] | None = None) -> ForceEquations:
    """Return what a lag T [s] of the actuators adds to the force: -T dtau_U/dt.

    The force acts T later than the command says: tau_U(t - T) = tau_U - T dtau_U/dt.
    One lag for all axes, or one for each of `axes`.
    """
    rates = dict(zip(AXES, ACTUATOR_RATES, strict=True))
    if axes is None:
        return ForceEquations(
            {Unknown(ALL_AXES, LAG): tuple((axis, rates[axis], -1.0) for axis in AXES)}
        )
    return ForceEquations({Unknown(axis, LAG): ((axis, rates[axis], -1.0),) for axis in axes})


def extra_rows(nu_dot: ArrayLike, actuators: ArrayLike, *, step_s: float) -> Array:
    """Return the rows (12, n) of `ACCELERATIONS` and `ACTUATOR_RATES` for a factor.

    nu_dot (n, 6) [m/s^2, rad/s^2]; actuators (n, 6) [N, N m], on a uniform clock of
    `step_s` [s]. Products for the Coriolis force are basis terms.
    """
    rate = np.gradient(np.asarray(actuators, dtype=np.float64), step_s, axis=0)
    return np.ascontiguousarray(np.vstack([np.asarray(nu_dot, dtype=np.float64).T, rate.T]))


def added_mass_change(values: Mapping[Unknown, float]) -> Array:
    """Return dM_A (6, 6), symmetric, of the added masses among the unknowns."""
    change = np.zeros((6, 6))
    for unknown, value in values.items():
        if unknown.term in ACCELERATIONS:
            change += value * inertia_pattern(unknown)
    return change


def inertia_pattern(unknown: Unknown) -> Array:
    """Return the matrix (6, 6) of ones where an added mass stands, symmetric."""
    i, j = AXES.index(unknown.axis), ACCELERATIONS.index(unknown.term)
    pattern = np.zeros((6, 6))
    pattern[i, j] = pattern[j, i] = 1.0
    return pattern


def added_mass_unknown(name: str) -> Unknown:
    """Return the unknown of a derivative's name; `PipelineError` for another name.

    >>> added_mass_unknown("N_vdot")
    Unknown(axis='Y', term='rdot')
    """
    names = [f"{axis}_{speed}" for axis in AXES for speed in ACCELERATIONS]
    if name not in names:
        raise PipelineError("not an added mass", value=name, remedy=nearest(name, names))
    axis, _, term = name.partition("_")
    # One name for each of the two equal entries.
    i, j = sorted((AXES.index(axis), ACCELERATIONS.index(term)))
    return Unknown(AXES[i], ACCELERATIONS[j])


def _inertia_parts(name: str) -> tuple[tuple[str, str, float], ...]:
    pattern = inertia_pattern(added_mass_unknown(name))
    parts = [
        (AXES[i], ACCELERATIONS[j], 1.0) for i in range(6) for j in range(6) if pattern[i, j] != 0.0
    ]
    # The weights of the products follow from the quadratic form itself, by polarisation.
    unit = np.eye(6)
    for a in range(6):
        for b in range(a, 6):
            product = coriolis_force(pattern, unit[a] + unit[b])
            if a == b:
                product = product / 4.0
            else:
                product = (
                    product - coriolis_force(pattern, unit[a]) - coriolis_force(pattern, unit[b])
                )
            parts += [
                (AXES[i], f"{VELOCITIES[a]}*{VELOCITIES[b]}", float(product[i]))
                for i in np.flatnonzero(product)
            ]
    return tuple(parts)
