"""What free runs say a model can simulate: whether they hold, and on which axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import pyarrow as pa

from auvid.hydro.arrays import AXES, VELOCITIES

PERSISTENCE = "persistence"
ANGLES = ("phi_rms_rad", "theta_rms_rad", "psi_rms_rad")
LONG_S = 10.0
"""Horizon at which a simulation is judged, the longest below it where legs are short."""


@dataclass(frozen=True)
class Simulation:
    """Free runs of all models on all validation legs.

    horizon_s: at which errors are compared. lost: models of which a run left all
    bounds. useful: model -> axes whose velocity, and angle in roll, pitch and yaw, it
    predicts better than no change.
    """

    horizon_s: float
    lost: frozenset[str]
    useful: Mapping[str, tuple[str, ...]]

    def holds(self, model: str) -> bool:
        """Return whether no run of a model was lost; false for one that was not run."""
        return model in self.useful and model not in self.lost


def simulation(free_run: pa.Table | None) -> Simulation | None:
    """Return what a free-run table says; None without a run."""
    rows = [] if free_run is None else free_run.to_pylist()
    horizons = sorted({row["horizon_s"] for row in rows})
    if not horizons:
        return None
    horizon = max([h for h in horizons if h <= LONG_S], default=horizons[0])
    rates = [f"{velocity}_rms_{'m_s' if velocity in 'uvw' else 'rad_s'}" for velocity in VELOCITIES]
    names = [*rates, *ANGLES]
    squares: dict[str, list[float]] = {}
    for row in rows:
        if row["horizon_s"] == horizon:
            sums = squares.setdefault(row["model"], [0.0] * len(names))
            # A row without a bounded run has nan: it stays, and nothing is useful.
            weight = row["starts"] - row["diverged"]
            for i, name in enumerate(names):
                value = row[name]
                sums[i] += weight * value**2 if value is not None else float("nan")
    kept = squares.pop(PERSISTENCE, [float("inf")] * len(names))
    useful = {
        model: tuple(
            axis
            for i, axis in enumerate(AXES)
            # A rotation is of use only where its angle is, too.
            if all(sums[j] < kept[j] for j in ((i,) if i < 3 else (i, i + 3)))
        )
        for model, sums in squares.items()
    }
    return Simulation(horizon, frozenset(row["model"] for row in rows if row["diverged"]), useful)
