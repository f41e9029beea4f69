"""The water current of a segment: what velocity through the water says of it, and what
is said where there is none.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.tables import column, matrix
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.identification.signals.smoother import FEWEST, SmoothedVelocity
from auvid.stages.columns import VELOCITY, Array
from auvid.stages.presentation import Block, remark, table

OBSERVABLE, NOT_OBSERVABLE = "observable", "not observable"
REASON = (
    "accelerometer, velocity over ground and depth say nothing of the water; in the forces a steady"
    " current cannot be told from damping and constant forces"
)


def water_track(samples: pa.Table | None, span: tuple[float, float]) -> tuple[Array, Array] | None:
    """Times (n,) and velocity of the sensor through the water (n, 3) within a span [s],
    sensor axes; None for fewer than five samples.
    """
    if samples is None:
        return None
    times = column(samples, "t_s")
    inside = (times >= span[0]) & (times <= span[1])
    return (
        (times[inside], matrix(samples, VELOCITY[:3])[inside]) if inside.sum() >= FEWEST else None
    )


def without_water_track(samples: pa.Table | None) -> dict[str, Any]:
    """What the fusion document says of a current that was asked for and cannot be seen."""
    given = (
        "no velocity through the water"
        if samples is None
        else f"fewer than {FEWEST} samples of velocity through the water"
    )
    return {
        "verdict": NOT_OBSERVABLE,
        "reason": f"the segment has {given} (stream water_velocity): {REASON}",
        "ned_m_s": None,
        "sd_m_s": None,
    }


def current_document(smoothed: SmoothedVelocity) -> dict[str, Any]:
    """Mean current north, east, down of a segment and its standard deviation [m/s]."""
    assert smoothed.current is not None
    assert smoothed.current_sd is not None
    return {
        "verdict": OBSERVABLE,
        "reason": "from velocity through the water beside velocity over ground",
        "ned_m_s": smoothed.current.mean(axis=0).tolist(),
        "sd_m_s": smoothed.current_sd.mean(axis=0).tolist(),
    }


def drift(smoothed: SmoothedVelocity, t_s: Array, euler: Array) -> Array:
    """The current in body axes (n, 3) [m/s] at times t_s (n,) with attitudes euler (n,
    3): R' c.
    """
    assert smoothed.current is not None
    ned = np.column_stack(
        [np.interp(t_s, smoothed.t_s, smoothed.current[:, axis]) for axis in range(3)]
    )
    return np.asarray(np.einsum("nji,nj->ni", rotation_body_to_ned(euler), ned))


def current_blocks(found: Mapping[str, Any] | None) -> list[Block]:
    """The current in the section of a segment."""
    if found is None:
        return []
    if found["verdict"] == NOT_OBSERVABLE:
        return [
            remark(
                f"Water current: {NOT_OBSERVABLE}, because {found['reason']}. Forces are taken in"
                " still water.",
                "warning",
            )
        ]
    rows = [
        [name, value, sd, "m/s"]
        for name, value, sd in zip(
            ("north", "east", "down"), found["ned_m_s"], found["sd_m_s"], strict=True
        )
    ]
    note = (
        "Mean over the segment. The forces are taken at the velocity through the water; position is"
        " over ground."
    )
    return [
        table("Water current", ["towards", "value", "standard deviation", "unit"], rows, note=note)
    ]
