"""Forces that follow from the fitted equation of motion of one axis.

    x' = a x + b x|x| + c F + d + ...

F in newtons, or in full commands. With the apparent inertia m of the axis, a m, b m and
d m are coefficients in the unit of force, and 1 / c = m where F is in newtons.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array

FORCE, CONSTANT = "force", "constant"


@dataclass(frozen=True)
class AxisEquation:
    """The fitted equation of an axis: terms by name, values (t,), covariance (t, t).

    Names: `w`, `w*|w|`, `force` (c), `constant` (d), couplings by their velocity.
    """

    axis: str
    names: tuple[str, ...]
    values: Array
    covariance: Array
    verdicts: Mapping[str, str]

    @property
    def speed(self) -> str:
        """Return the velocity along the axis."""
        return VELOCITIES[AXES.index(self.axis)]

    def value(self, name: str) -> float:
        """Return the value of a term, 0 for one that it does not have."""
        return float(self.values[self.names.index(name)]) if name in self.names else 0.0

    def error(self, name: str) -> float:
        """Return the standard error of a term, 0 for one that it does not have."""
        if name not in self.names:
            return 0.0
        place = self.names.index(name)
        return float(np.sqrt(self.covariance[place, place]))


@dataclass(frozen=True)
class Inertia:
    """Apparent inertia of an axis: numerator / c ** power, with the error of numerator.

    power 1: the force of F = 1 is `numerator` [N, N m] (1 where F is in newtons). power 0:
    the inertia is given. relative_sd: of the numerator.
    """

    numerator: float
    power: int
    relative_sd: float = 0.0


@dataclass(frozen=True)
class AxisForces:
    """Terms of an axis as forces: values (t,), covariance (t, t), apparent inertia.

    `force` among the names is the force of F = 1: 1 where F is in newtons.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    inertia: float
    inertia_error: float


def as_forces(equation: AxisEquation, inertia: Inertia) -> AxisForces:
    """Return the terms times the apparent inertia m = k / c^p, with their covariance.

    y_i = theta_i k / c^p; d y_i / d theta_i = k / c^p, d y_i / d c = -p y_i / c, and the
    relative error of k goes into all of them.

    >>> heave = AxisEquation("Z", ("w", "force"), np.array([-2.0, 0.05]), np.zeros((2, 2)), {})
    >>> as_forces(heave, Inertia(1.0, 1)).values.round(6).tolist()  # m = 20 kg
    [-40.0, 1.0]
    """
    place, count = equation.names.index(FORCE), len(equation.names)
    c = equation.values[place]
    mass = inertia.numerator / c**inertia.power
    values = equation.values * mass
    slope = np.eye(count) * mass
    slope[:, place] -= inertia.power * values / c
    covariance = slope @ equation.covariance @ slope.T
    covariance += inertia.relative_sd**2 * np.outer(values, values)
    own = inertia.power * equation.error(FORCE) / c
    return AxisForces(
        equation.names,
        values,
        covariance,
        float(mass),
        float(mass * np.hypot(own, inertia.relative_sd)),
    )
