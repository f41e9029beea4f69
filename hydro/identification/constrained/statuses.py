"""Where a number comes from: the data, a bound, or a prior.

The verdict on a coefficient is that of the data alone (`regression.verdicts`). What
stands in the model may come from elsewhere, and then its status says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.fit import ConstrainedFit

AT_BOUND: Final = "at its bound"
FROM_PRIOR: Final = "from the prior"
PRIOR_SHARE = 0.5
"""A number is from the prior when the prior gives at least this share of what is known
of it (of the inverse variance).
"""
MOVED = 2.0
"""Errors of a value from which on a limit that moves it decides what it is."""


@dataclass(frozen=True)
class CoefficientStatus:
    """Status of one number, the data's own verdict, and what else speaks in it.

    prior_share: share of the information that is the prior's. held_by: active limits
    that bind it together with others.
    """

    status: str
    verdict: str
    prior_share: float
    held_by: tuple[str, ...]


def moved_far(value: float, free: float | None, error: float) -> bool:
    """Return whether limits moved a value so far that it is theirs, not the data's.

    free: the value without limits, None where they left it; error: its standard error by
    noise and assumed figures.

    >>> moved_far(-5.0, -1.0, 1.0), moved_far(-5.0, -4.0, 1.0), moved_far(-5.0, None, 1.0)
    (True, False, False)
    """
    return free is not None and abs(value - free) > MOVED * error


def statuses(
    fit: ConstrainedFit, verdicts: Mapping[Unknown, str]
) -> dict[Unknown, CoefficientStatus]:
    """Return the status of every unknown of a fit.

    verdicts: those of the data alone; an unknown without one gets the empty word. At
    its bound: an active limit on it alone. From the prior: 1 - var / var(data alone) is
    at least `PRIOR_SHARE`, both without limits. Otherwise the verdict stands.
    """
    after = np.diag(fit.free_covariance)
    table = {}
    for i, unknown in enumerate(fit.unknowns):
        share = max(0.0, 1.0 - float(after[i] / fit.data_variances[i]))
        limits = [limit for limit in fit.active if unknown in limit.unknowns]
        verdict = verdicts.get(unknown, "")
        if any(len(limit.unknowns) == 1 for limit in limits):
            status = AT_BOUND
        elif share >= PRIOR_SHARE:
            status = FROM_PRIOR
        else:
            status = verdict
        together = tuple(limit.name for limit in limits if len(limit.unknowns) > 1)
        table[unknown] = CoefficientStatus(status, verdict, share, together)
    return table
