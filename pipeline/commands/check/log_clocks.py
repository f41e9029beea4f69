"""Clock of the outputs of one log against that of the other logs of a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS
from auvid.stages.ingest.health.finding import Finding, finding, limit, listed

LEAST_EXPLAINED, FEWEST_AXES, SAME_S = 0.5, 2, 0.12
"""Share of a motion that tells its lag, axes that have to agree, and within what."""


def log_clocks(health: Mapping[str, Mapping[str, Any]]) -> dict[str, list[Finding]]:
    """Return the log whose motion follows the outputs at another time.

    `health` by log; at most one log, that which is farthest off.
    """
    lags = {
        log: {
            axis: float(answer["lag_s"])
            for axis, answer in document.get("answers", {}).items()
            if answer["explained"] > LEAST_EXPLAINED
        }
        for log, document in health.items()
    }
    off = {log: change for log in lags if (change := _change(log, lags)) is not None}
    if not off:
        return {}
    log = max(off, key=lambda name: abs(float(np.median(list(off[name].values())))))
    late_s = float(np.median(list(off[log].values())))
    parts = [f"{MOTION_WORDS[axis]} {change:+.2f} s" for axis, change in off[log].items()]
    others = listed([f"'{name}'" for name in lags if name != log and lags[name]])
    return {
        log: [
            finding(
                "run_clock",
                f"Motion follows the outputs {abs(late_s):.2f} s"
                f" {'later' if late_s > 0.0 else 'sooner'} than in {others} ({listed(parts)}):"
                f" their clock, or that of the sensors, is {abs(late_s):.2f} s off in one of them,"
                " or another vehicle (load, thrusters) was driven in this log: lags of commands do"
                " not tell which.",
                stream="actuators",
                value=abs(late_s),
                fields=("time_us",),
            )
        ]
    }


def _change(log: str, lags: Mapping[str, Mapping[str, float]]) -> dict[str, float] | None:
    """Return by how much motions follow later than in the other logs, by axis.

    None where they do not do so alike.
    """
    change = {}
    for axis, lag in lags[log].items():
        others = [own[axis] for name, own in lags.items() if name != log and axis in own]
        if others:
            change[axis] = lag - float(np.median(others))
    if len(change) < FEWEST_AXES:
        return None
    values = np.array(list(change.values()))
    middle = float(np.median(values))
    alike = float(np.abs(values - middle).max()) < SAME_S
    return change if alike and abs(middle) > limit("run_clock") else None
