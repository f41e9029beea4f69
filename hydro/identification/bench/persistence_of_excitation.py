"""Persistence of excitation: the matrix C_n of Alberti 2015 (51)-(52) over time.

The verdict follows from its smallest eigenvalue and from where in the run that comes
from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array

Status = Literal["persistently exciting", "not persistently exciting", "not excited"]
PERSISTENT: Status = "persistently exciting"
NOT_PERSISTENT: Status = "not persistently exciting"
NOT_EXCITED: Status = "not excited"
WINDOWS = 10
FEWEST_WINDOWS = 2.0
"""Windows of ten over which the information must be spread. A single step gives 1.0 to
1.2, varying steps 2.5 to 8 (measured).
"""
COLLINEAR = 1e-8
"""Smallest eigenvalue of the scaled C_n below which two columns are one."""
MOST_POINTS = 400


@dataclass(frozen=True)
class Excitation:
    """C_n of (51) over time, and the verdict.

    `t_s` (m,); `smallest` (m,): smallest eigenvalue of C_n(t) = 1/t integral of Phi'
    Phi with every column scaled to unit RMS over the run (1 for orthogonal columns, 0
    for dependent ones); `matrix` (k, k): C_n at the end, scaled; `weakest` (k,): its
    eigenvector of the smallest eigenvalue; `rms` (k,): RMS of each column; `spread`:
    over how many of ten equal windows its information is spread (participation ratio: 1
    for a single window, 10 for all alike).
    """

    t_s: Array
    smallest: Array
    matrix: Array
    weakest: Array
    rms: Array
    spread: float
    status: Status

    def words(self, names: tuple[str, ...]) -> str:
        """Return the verdict as a sentence; `names` are those of the columns."""
        if self.status == NOT_EXCITED:
            still = (
                ", ".join(name for name, size in zip(names, self.rms, strict=True) if size == 0.0)
                or "every regressor"
            )
            return f"Not excited: {still} stayed at zero or below the sensor's noise."
        main = [name for name, part in zip(names, self.weakest, strict=True) if abs(part) > 0.3]
        figures = (
            f"smallest eigenvalue of C_n {self.smallest[-1]:.2g}, information spread over"
            f" {self.spread:.1f} of {WINDOWS} windows"
        )
        if self.status == NOT_PERSISTENT:
            return (
                f"Not persistently exciting: what tells {' from '.join(main)} apart comes from a"
                f" small part of the run ({figures}); more of the same run would not help, other"
                " inputs would."
            )
        return f"Persistently exciting ({figures})."


def excitation(t_s: ArrayLike, regressor: ArrayLike, *, floor: ArrayLike = 0.0) -> Excitation:
    """Return C_n and verdict for a regressor (n, k) at times t_s (n,) [s]: (51)-(52).

    C_n(t) = 1/t integral of Phi' Phi dt, every column scaled to unit RMS. The limit in
    (52) is over infinite time. For a finite run the question is whether C_n goes on
    growing: where does the information in its weakest direction come from? If from
    fewer than two of ten windows, a longer run would drive the smallest eigenvalue to
    zero. floor (k,): RMS of a column below which it counts as not excited.
    """
    t, phi = np.asarray(t_s, dtype=np.float64), np.asarray(regressor, dtype=np.float64)
    step = np.diff(t, prepend=t[0])
    span = max(float(t[-1] - t[0]), np.finfo(float).tiny)
    rms = np.sqrt(step @ phi**2 / span)
    scaled = phi / np.where(rms > 0, rms, 1.0)
    grown = np.cumsum(step[:, None, None] * scaled[:, :, None] * scaled[:, None, :], axis=0)
    kept = np.unique(np.linspace(1, t.size - 1, min(MOST_POINTS, t.size - 1)).astype(np.intp))
    smallest = np.linalg.eigvalsh(grown[kept] / (t[kept] - t[0])[:, None, None])[:, 0]
    values, vectors = np.linalg.eigh(grown[-1] / span)
    weakest = vectors[:, 0]
    edges = (
        np.searchsorted(t, t[0] + span * np.linspace(0.0, 1.0, WINDOWS + 1)[1:], side="right") - 1
    )
    share = np.diff(np.einsum("i,mij,j->m", weakest, grown[edges], weakest), prepend=0.0)
    spread = float(share.sum() ** 2 / np.sum(share**2)) if np.any(share > 0) else 0.0
    status: Status = PERSISTENT
    if np.any(rms <= np.broadcast_to(np.asarray(floor, dtype=np.float64), rms.shape)):
        status = NOT_EXCITED
    elif spread < FEWEST_WINDOWS or values[0] < COLLINEAR:
        status = NOT_PERSISTENT
    return Excitation(t[kept], smallest, grown[-1] / span, weakest, rms, spread, status)
