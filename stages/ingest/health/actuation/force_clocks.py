"""Clock of the outputs, by when their force accelerates the vehicle beside its drag."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.motion_checks import AxisGains
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS
from auvid.stages.ingest.health.actuation.push_answers import push_lags
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

LAGS_S = np.round(np.arange(-10, 21) * 0.2, 1)
USUAL_S = (-0.2, 0.5)
"""Lags of healthy logs: thrusters, hold and steps of the record make -0.2 to 0.3 s."""
SURE_ODDS, AXIS_ODDS = 25.0, 10.0
"""Logarithms of the likelihood: of a lag over the usual ones, and of an axis over none."""
SAME_S = 0.3
LONGEST_S = 1.2
"""No thruster takes longer to come to its force."""
SPEEDS = "uvw"


def force_clock_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield outputs whose force acts before it is stamped, or long after."""
    odds = {
        axis: np.array([_odds(gains) for gains in by_lag])
        for axis, by_lag in push_lags(log, SPEEDS, lags_s=LAGS_S.tolist())
    }
    if len(odds) < 2:
        return
    total = np.sum(list(odds.values()), axis=0)
    lag = float(LAGS_S[np.argmax(total)])
    if float(total.max()) - _usual(total) < SURE_ODDS or 0.0 < lag < limit("command_delay"):
        return
    agreeing = [axis for axis, own in odds.items() if _follows(own, lag)]
    if len(agreeing) < 2:
        return
    late, early = ("late", "early") if lag < 0.0 else ("early", "late")
    yield finding(
        "command_late" if lag < 0.0 else "commands_early" if lag > LONGEST_S else "command_delay",
        f"The force of the outputs accelerates {listed([MOTION_WORDS[axis] for axis in agreeing])}"
        f" best if it acts {abs(lag):.1f} s {'before' if lag < 0.0 else 'after'} its stamp, drag"
        f" beside it: the outputs are stamped {late}, or the velocity {early}.",
        stream="actuators",
        value=abs(lag),
    )


def _odds(gains: AxisGains | None) -> float:
    """Return the logarithm of the likelihood over no force; 0 for a gain against it."""
    if gains is None or gains.gain[0] <= 0.0:
        return 0.0
    share = min(max(gains.explained, 0.0), 1.0 - 1e-9)
    return -0.5 * gains.count * float(np.log1p(-share))


def _usual(odds: Array) -> float:
    inside = (USUAL_S[0] - 1e-9 <= LAGS_S) & (USUAL_S[1] >= LAGS_S)
    return float(odds[inside].max())


def _follows(odds: Array, lag: float) -> bool:
    """Return whether an axis by itself is explained best about a lag."""
    best = float(LAGS_S[np.argmax(odds)])
    return abs(best - lag) < SAME_S and float(odds.max() - odds.min()) > AXIS_ODDS
