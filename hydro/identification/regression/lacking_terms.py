"""Terms that a form lacks, and how far they move the coefficients that it has.

A coefficient takes over what its form lacks: of drag with X_u and X_u|u| a form without
X_u finds X_u|u| too large, ever more exactly the longer the dive. Each axis is fitted once
more with the terms that it may lack. Those that are clear there count, and what they move
of the coefficients stands beside the noise, as assumed figures do (decision 0083).
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from auvid.hydro.arrays import VELOCITIES, Array
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.dynamics.viscous.symmetry import PORT_STARBOARD, allows
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    AxisFit,
    TriangularFactor,
    solve_axis,
)

CLEAR = 3.0
"""Standard errors from which on a lacking term counts. By 4 fewer wrong intervals are
found, and where the form is true none is lost by either but 2 % of one form (0083).
"""


def terms_to_try(axis: str, terms: Collection[str]) -> tuple[str, ...]:
    """Return the terms that an axis of a form may lack.

    Damping of its own velocity, linear and quadratic; the other one of x and x|x|, and of
    x and u x (lift grows with speed), that it has of any velocity; linear terms that the
    symmetry of port and starboard allows.

    >>> terms_to_try("K", ["p*|p|"])
    ('p', 'v', 'r')
    >>> terms_to_try("Y", ["v", "u*r"])
    ('v*|v|', 'u*v', 'r', 'p')
    """
    own = OWN_VELOCITY[axis]
    quadratic = {x: f"{x}*|{x}|" for x in VELOCITIES}
    tried = [own, quadratic[own]]
    for x in VELOCITIES:
        tried += [x] if quadratic[x] in terms else []
        tried += [quadratic[x]] if x in terms else []
        lift = f"u*{x}"
        tried += [lift] if x in terms and x != "u" else []
        tried += [x] if lift in terms and x != "u" else []
    tried += [x for x in VELOCITIES if allows(axis, x, (PORT_STARBOARD,))]
    return tuple(term for term in dict.fromkeys(tried) if term not in terms)


def completed_fit(factor: TriangularFactor, fit: AxisFit) -> AxisFit | None:
    """Return a fit with what it may lack, as far as the factor has columns of it.

    None for a fit of no term, and where nothing is left to try.
    """
    terms = _without_constant(fit)
    tried = [term for term in terms_to_try(fit.axis, terms) if term in factor.terms]
    return _with_terms(factor, fit, tried) if terms and tried else None


def clear_terms(completed: AxisFit, fit: AxisFit, covariance: Array) -> tuple[str, ...]:
    """Return the terms of a completed fit, beside those of `fit`, that are clear.

    covariance (k, k): of the completed fit, about the truth.
    """
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return tuple(
        term
        for term, value, error in zip(
            completed.terms, completed.coefficients.tolist(), errors.tolist(), strict=True
        )
        if term not in fit.terms and abs(value) >= CLEAR * error > 0.0
    )


def moved_by_terms(factor: TriangularFactor, fit: AxisFit, lacking: Collection[str]) -> Array:
    """Return how far the coefficients (k,) of a fit move when terms are added.

    One that the data do not determine beside them moves by all of itself.
    """
    other = _with_terms(factor, fit, lacking)
    after = np.array([other.coefficients[other.terms.index(term)] for term in fit.terms])
    return np.where(np.isfinite(after), after, 0.0) - np.nan_to_num(fit.coefficients)


def _with_terms(factor: TriangularFactor, fit: AxisFit, more: Collection[str]) -> AxisFit:
    terms = (*_without_constant(fit), *more)
    return solve_axis(factor, fit.axis, terms, trim=CONSTANT in fit.terms)


def _without_constant(fit: AxisFit) -> tuple[str, ...]:
    return tuple(term for term in fit.terms if term != CONSTANT)
