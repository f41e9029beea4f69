"""Inertia against thrust lag: two unknowns that answer to the same motion.

More inertia and a later thrust both let the vehicle answer later. A short dive often
takes one for the other, so each is fitted with and without the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import AXES
from auvid.hydro.identification.constrained.equations import (
    ForceEquations,
    Unknown,
    inertia_equations,
    lag_equations,
)
from auvid.hydro.identification.constrained.fit import ConstrainedFit, fit_within
from auvid.hydro.identification.regression.least_squares import TriangularFactor
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    INSEPARABLE,
    VIF_LIMIT,
    WEAK,
    TermStatus,
)

CLEAR = 2.0
"""Standard errors from which on an inertia is clear: one number that was named before
the fit, not the clearest of many terms.
"""


@dataclass(frozen=True)
class Trade:
    """An added mass beyond the file's and a lag on the same axis, alone and together.

    single: fitted one without the other, joint: with it; (2,) inertia [kg, kg m,
    kg m^2; McCarter's sign] and lag [s], with standard errors. correlation: of the two
    joint estimates. gain (3,): by how much the sum of squares of
    the axis falls, as a share, by inertia, by lag, by both. verdict: of the inertia.
    """

    inertia: Unknown
    lag: Unknown
    single: tuple[float, float]
    single_errors: tuple[float, float]
    joint: tuple[float, float]
    joint_errors: tuple[float, float]
    correlation: float
    gain: tuple[float, float, float]
    verdict: TermStatus

    def __str__(self) -> str:
        return (
            f"{self.inertia} {self.single[0]:.3g} +- {self.single_errors[0]:.2g} without a lag,"
            f" {self.joint[0]:.3g} +- {self.joint_errors[0]:.2g} beside a lag of"
            f" {self.joint[1]:.2g} +- {self.joint_errors[1]:.2g} s (correlation"
            f" {self.correlation:.2f}): {self.verdict}"
            + (f" from the {self.lag}" if self.verdict == INSEPARABLE else "")
        )


def inertia_against_lag(
    factor: TriangularFactor,
    equations: ForceEquations,
    name: str,
    *,
    noise: Mapping[str, float] | None = None,
) -> Trade:
    """Return what the data say of one added mass (`N_rdot`) and of a lag on its axis.

    equations: of the viscous model. Identified: clear beside the lag, too. Inseparable:
    clear alone, but not beside the lag, or the two estimates are one (their correlation
    is that of a variance inflation above `VIF_LIMIT`). Otherwise weak. `noise` as in
    `fit_within`.
    """
    mass = inertia_equations([name])
    (inertia,) = mass.unknowns
    delay = lag_equations([inertia.axis])
    (lag,) = delay.unknowns
    fits = {
        "none": fit_within(factor, equations, noise=noise),
        "inertia": fit_within(factor, equations.with_unknowns_of(mass), noise=noise),
        "lag": fit_within(factor, equations.with_unknowns_of(delay), noise=noise),
        "both": fit_within(
            factor, equations.with_unknowns_of(mass).with_unknowns_of(delay), noise=noise
        ),
    }
    values = {key: (_read(fit, inertia), _read(fit, lag)) for key, fit in fits.items()}
    both = fits["both"]
    i, j = both.unknowns.index(inertia), both.unknowns.index(lag)
    errors = both.standard_errors
    correlation = float(both.covariance[i, j] / (errors[i] * errors[j]))
    axis = AXES.index(inertia.axis)
    gain = [1.0 - float(fits[key].rms[axis] / fits["none"].rms[axis]) ** 2 for key in fits]
    (single, single_error), (joint, joint_error) = values["inertia"][0], values["both"][0]
    verdict: TermStatus
    if 1.0 - correlation**2 < 1.0 / VIF_LIMIT:
        verdict = INSEPARABLE
    elif abs(joint) >= CLEAR * joint_error:
        verdict = IDENTIFIED
    else:
        verdict = INSEPARABLE if abs(single) >= CLEAR * single_error else WEAK
    return Trade(
        inertia=inertia,
        lag=lag,
        single=(single, values["lag"][1][0]),
        single_errors=(single_error, values["lag"][1][1]),
        joint=(joint, values["both"][1][0]),
        joint_errors=(joint_error, values["both"][1][1]),
        correlation=correlation,
        gain=(gain[1], gain[2], gain[3]),
        verdict=verdict,
    )


def _read(fit: ConstrainedFit, unknown: Unknown) -> tuple[float, float]:
    """Return value and standard error; nan for an unknown that was not fitted."""
    if unknown not in fit.unknowns:
        return np.nan, np.nan
    i = fit.unknowns.index(unknown)
    return float(fit.values[i]), float(fit.standard_errors[i])
