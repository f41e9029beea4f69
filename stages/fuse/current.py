"""Water current of a segment, from water-track velocity."""

from __future__ import annotations

from typing import Final

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.motion import CurrentRecord
from auvid.data_schemas.tables import column, matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.identification.signals.smoother import FEWEST, SmoothedVelocity
from auvid.stages.columns import VELOCITY

OBSERVABLE: Final = "observable"
NOT_OBSERVABLE: Final = "not observable"
REASON = (
    "accelerometer, velocity over ground and depth say nothing of the water; forces of legs that"
    " turn do, and synthesise says what they show"
)


def water_track(samples: pa.Table | None, span: tuple[float, float]) -> tuple[Array, Array] | None:
    """Return times (n,) and velocity through the water (n, 3) in a span [s].

    None for fewer than five samples.
    """
    if samples is None:
        return None
    times = column(samples, "t_s")
    inside = (times >= span[0]) & (times <= span[1])
    return (
        (times[inside], matrix(samples, VELOCITY[:3])[inside]) if inside.sum() >= FEWEST else None
    )


def without_water_track(samples: pa.Table | None) -> CurrentRecord:
    """Return the fusion document's entry for a current that cannot be observed."""
    lack = (
        "no velocity through the water"
        if samples is None
        else f"fewer than {FEWEST} samples of velocity through the water"
    )
    return CurrentRecord(
        verdict=NOT_OBSERVABLE,
        reason=f"the segment has {lack} (stream water_velocity): {REASON}",
        ned_m_s=None,
        sd_m_s=None,
    )


def current_document(smoothed: SmoothedVelocity) -> CurrentRecord:
    """Return the mean current (north, east, down) and its standard deviation [m/s]."""
    assert smoothed.current is not None
    assert smoothed.current_sd is not None
    return CurrentRecord(
        verdict=OBSERVABLE,
        reason="from velocity through the water beside velocity over ground",
        ned_m_s=smoothed.current.mean(axis=0).tolist(),
        sd_m_s=smoothed.current_sd.mean(axis=0).tolist(),
    )


def drift(smoothed: SmoothedVelocity, t_s: Array, euler: Array) -> Array:
    """Return the current in body axes R' c (n, 3) [m/s] at t_s (n,), euler (n, 3)."""
    assert smoothed.current is not None
    ned = np.column_stack(
        [np.interp(t_s, smoothed.t_s, smoothed.current[:, axis]) for axis in range(3)]
    )
    return np.asarray(np.einsum("nji,nj->ni", rotation_body_to_ned(euler), ned))
