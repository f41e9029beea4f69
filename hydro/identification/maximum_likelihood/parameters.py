"""The unknown numbers of a model as a vector, and the tables of the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, Array, Ints
from auvid.hydro.dynamics.simulation.plant_constants import FACTORS, Tables, plant_tables
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, basis_term_names
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.regression.least_squares import CONSTANT

VISCOUS, INERTIA, LAG = 0, 1, 2
MINIMUM_SPEED = 0.05


@dataclass(frozen=True)
class ParameterPrior:
    """A normal prior on the parameters: mean (k,) and precision (k, k), 0 for none."""

    mean: Array
    precision: Array


@dataclass(frozen=True)
class UnknownParameters:
    """Which numbers of a vehicle are unknown, in the order of the vector theta.

    `terms`: axis -> basis terms, and `CONSTANT` for a constant force of the axis.
    `inertia`: entries (row, column) of the mass matrix M = M_RB - M_A, e.g. (5, 5) for
    yaw; `lag`: whether a lag [s] of the actuators behind their record is fitted, in place
    of `held_lag_s`. `fixed`: axis -> term -> coefficient of viscous terms that are not
    fitted. `lower` and `upper` bound theta; `prior` weighs it.
    """

    vehicle: Vehicle
    terms: Mapping[str, Sequence[str]]
    inertia: tuple[tuple[int, int], ...] = ()
    lag: bool = False
    held_lag_s: float = 0.0
    fixed: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    lower: Mapping[str, float] = field(default_factory=dict)
    upper: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return names of theta: `Y v*|v|`, `Y 1`, `M[5,5]`, `lag`."""
        viscous = [f"{axis} {term}" for axis, terms in self.terms.items() for term in terms]
        entries = [f"M[{row},{column}]" for row, column in self.inertia]
        return (*viscous, *entries, *(["lag"] if self.lag else []))

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Return the distinct terms, fitted and fixed, in the order of Appendix C."""
        parts = [*self.terms.values(), *self.fixed.values()]
        distinct = {term for terms in parts for term in terms}
        order = (*basis_term_names(), CONSTANT)
        if not distinct <= set(order):
            raise DataError("unknown basis term", value=sorted(distinct - set(order)))
        return tuple(sorted(distinct, key=order.index))

    @cached_property
    def kinds(self) -> Ints:
        """Return kind, axis or row, column of each parameter (k, 3), for the loop."""
        viscous = [
            (VISCOUS, AXES.index(axis), self.columns.index(term))
            for axis, terms in self.terms.items()
            for term in terms
        ]
        entries = [(INERTIA, row, column) for row, column in self.inertia]
        rows = [*viscous, *entries, *([(LAG, 0, 0)] if self.lag else [])]
        return np.array(rows, dtype=np.int64).reshape(-1, 3)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds (k,), infinite where there are none."""
        low = np.array([self.lower.get(name, -np.inf) for name in self.names])
        high = np.array([self.upper.get(name, np.inf) for name in self.names])
        low[self.kinds[:, 0] == LAG] = np.maximum(low[self.kinds[:, 0] == LAG], 0.0)
        return low, high

    def vector(self, values: Mapping[str, float], *, lag_s: float = 0.05) -> Array:
        """Return theta (k,) from values by name.

        Missing inertia is the vehicle's own, other missing values are 0.
        """
        mass = self.vehicle.mass_matrix
        start = {f"M[{row},{column}]": float(mass[row, column]) for row, column in self.inertia}
        start |= {"lag": lag_s} | dict(values)
        return np.array([start.get(name, 0.0) for name in self.names])

    def coefficients(self, theta: Array) -> dict[str, dict[str, float]]:
        """Return axis -> term -> coefficient, fitted and fixed."""
        out = {axis: dict(terms) for axis, terms in self.fixed.items()}
        values = iter(theta.tolist())
        for axis, terms in self.terms.items():
            out.setdefault(axis, {}).update({term: next(values) for term in terms})
        return out

    def lag_s(self, theta: Array) -> float:
        """Return the lag of the actuators [s]."""
        return float(theta[-1]) if self.lag else self.held_lag_s

    @cached_property
    def _frame(self) -> tuple[Tables, NDArray[np.int64]]:
        """Return the tables without viscous force, and the terms' factors."""
        empty = plant_tables(
            self.vehicle, IdentifiedModel("none", {}), lag_s=0.0, minimum_speed=MINIMUM_SPEED
        )
        rows = [
            [FACTORS.index(item) for item in (*_factors(term), "one", "one", "one")[:3]]
            for term in self.columns
        ]
        return empty, np.array(rows, dtype=np.int64).reshape(-1, 3)

    def tables(self, theta: Array) -> Tables:
        """Return the constants of the vehicle with theta for the derivative."""
        empty, factors = self._frame
        matrix = np.zeros((6, len(self.columns)))
        for axis, terms in self.coefficients(theta).items():
            for term, value in terms.items():
                matrix[AXES.index(axis), self.columns.index(term)] = value
        mass = np.array(self.vehicle.mass_matrix)
        for (kind, row, column), value in zip(self.kinds.tolist(), theta.tolist(), strict=True):
            if kind == INERTIA:
                mass[row, column] = mass[column, row] = value
        return empty._replace(
            mass=mass.flatten(),
            inverse=np.asarray(np.linalg.inv(mass), dtype=np.float64).flatten(),
            factors=factors.flatten(),
            coefficients=matrix.flatten(),
            counts=(len(factors), 0, 0),
        )


class FixedParameters(UnknownParameters):
    """The parameters of a model at one theta (k,): none of them is fitted."""

    def __init__(self, model: UnknownParameters, theta: Array) -> None:
        super().__init__(model.vehicle, {})
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "theta", theta)

    model: UnknownParameters
    theta: Array

    def coefficients(self, theta: Array) -> dict[str, dict[str, float]]:
        """Return axis -> term -> coefficient."""
        return self.model.coefficients(self.theta)

    def lag_s(self, theta: Array) -> float:
        """Return the lag of the actuators [s]."""
        return self.model.lag_s(self.theta)

    def tables(self, theta: Array) -> Tables:
        """Return the constants of the vehicle for the derivative."""
        return self.model.tables(self.theta)


def _factors(term: str) -> tuple[str, ...]:
    return () if term == CONSTANT else BASIS_TERMS[term].factors
