"""Speeds of a hull that nothing measures, and depth without their climb."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.record import (
    SHARE_SD,
    AxisRecord,
    climb,
    unmeasured,
    without_climb,
)
from auvid.hydro.identification.axes.single_axis import refusal, speed_share
from auvid.hydro.partial_model import apparent_inertia
from auvid.stages.fit_axes.flight import LegData, idle


@dataclass(frozen=True)
class HullSpeeds:
    """Speeds that nothing measures, as a share of those that forces give.

    travels: leg -> how much deeper a tilted hull gets (n,) [m] by all of them; none where
    they are measured, or nothing has newtons.
    """

    share: float = 1.0
    travels: Mapping[str, Array] = field(default_factory=dict)

    def levelled(self, legs: Mapping[str, LegData]) -> dict[str, LegData]:
        """Return legs whose depth has no climb of a tilted hull."""
        return {
            key: replace(leg, record=without_climb(leg.record, self.travels[key], self.share))
            if key in self.travels
            else leg
            for key, leg in legs.items()
        }

    def doubts(self, legs: Mapping[str, LegData]) -> dict[str, dict[str, AxisRecord]]:
        """Return legs as `levelled`, whose depth has one deviation of a climb."""
        off = {
            key: without_climb(leg.record, self.travels[key], SHARE_SD)
            for key, leg in legs.items()
            if key in self.travels
        }
        return {"climb": off} if off else {}


def hull_speeds(legs: Mapping[str, LegData], vehicle: Vehicle, *, lag_s: float) -> HullSpeeds:
    """Return the speeds of a hull by its forces, as its depth tells them."""
    every = [leg.record for leg in legs.values()]
    if every[0].normalised or not unmeasured(every):
        return HullSpeeds()
    inertia = np.array([apparent_inertia(vehicle, axis) for axis in AXES])
    travels = {key: climb(leg.record, inertia) for key, leg in legs.items()}
    telling = [
        leg.record
        for leg in legs.values()
        if leg.windows.use == "training" and not idle(leg.record, "Z")
    ]
    if not telling or refusal(telling, "Z"):
        return HullSpeeds(1.0, travels)
    return HullSpeeds(speed_share(telling, inertia, lag_s=lag_s), travels)
