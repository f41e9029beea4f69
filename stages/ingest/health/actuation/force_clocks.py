"""Clock of the outputs, by when their force accelerates the vehicle beside its drag."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.robust_gains import AxisGains
from auvid.hydro.identification.checks.velocity_answer import drift_of
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.actuation.push_answers import force_odds, push_lags
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

LAGS_S = np.round(np.arange(-10, 21) * 0.2, 1)
USUAL_S = (-0.2, 0.5)
"""Lags of healthy logs: thrusters, hold and steps of the record make -0.2 to 0.3 s."""
USUAL = np.flatnonzero((USUAL_S[0] - 1e-9 <= LAGS_S) & (USUAL_S[1] >= LAGS_S)).tolist()
SURE_ODDS, AXIS_ODDS = 25.0, 10.0
"""Logarithms of the likelihood: of a lag over the usual ones, and of an axis over none."""
LEAST_SHARE = 0.25
"""Part of an axis that the force must explain at some lag: of a vehicle file that joins the
outputs otherwise it explains .12 to .22 of slow motions at any lag, of sound logs .5 and more.
"""
SAME_S = 0.3
LONGEST_S = 1.2
"""No thruster takes longer to come to its force."""
SPEEDS = "uvw"


def force_clock_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield outputs whose force acts before it is stamped, or long after."""
    odds = _odds_by_axis(log)
    if len(odds) < 2:
        return
    total = np.sum(list(odds.values()), axis=0)
    lag = float(LAGS_S[np.argmax(total)])
    stated_s = 0.0 if log.vehicle is None else log.vehicle.dvl.lag_s
    if (
        float(total.max()) - _usual(total) < SURE_ODDS
        or 0.0 < lag < limit("command_delay") + stated_s
    ):
        return
    agreeing = [axis for axis, own in odds.items() if _follows(own, lag)]
    if len(agreeing) < 2:
        return
    late, early = ("late", "early") if lag < 0.0 else ("early", "late")
    yield finding(
        "command_late"
        if lag < 0.0
        else "commands_early"
        if lag > LONGEST_S + stated_s
        else "command_delay",
        f"The force of the outputs accelerates {listed([MOTION_WORDS[axis] for axis in agreeing])}"
        f" best if it acts {abs(lag):.1f} s {'before' if lag < 0.0 else 'after'} its stamp, drag"
        f" beside it: the outputs are stamped {late}, or the velocity {early}"
        f"{', or a clock drifts' if abs(lag) >= limit('clock_drift') else ''}.",
        stream="actuators",
        value=abs(lag),
    )


def _odds_by_axis(log: CheckedLog) -> dict[str, Array]:
    """Return the odds of each lag (k,) by axis that the force drives at one of them.

    An axis that goes against its force when it acts is turned, and tells no clock.
    """
    odds = {}
    for axis, by_lag in push_lags(log, SPEEDS, lags_s=LAGS_S.tolist()):
        own = np.array([force_odds(gains) for gains in by_lag])
        share = _explained(by_lag[int(np.argmax(own))])
        backward = [_explained(by_lag[place]) for place in USUAL if own[place] == 0.0]
        turned = max(backward, default=0.0)
        if share > max(LEAST_SHARE, turned):
            odds[axis] = own
    return odds


def _explained(gains: AxisGains | None) -> float:
    return 0.0 if gains is None else gains.explained


def drift_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield outputs whose force acts at another time in each half of the log."""
    if not log.has("actuators"):
        return
    acting = activity(log)
    times = log.t_s("actuators")
    times = times if acting is None else times[acting]  # a rest tells no lag, and looks certain
    if times.size < 2:
        return
    start, end = times[[0, -1]]
    middle = 0.5 * (start + end)
    parts: list[dict[str, Array]] = []
    for span in ((start, middle), (middle, end)):
        parts.append(_odds_by_axis(log.between(*span)))
        axes = [axis for axis in SPEEDS if all(axis in part for part in parts)]
        if len(axes) < 2:
            return
    halves = [np.sum([part[axis] for axis in axes], axis=0) for part in parts]
    drift = drift_of(LAGS_S, np.array(halves))
    if abs(drift.change_s) < limit("clock_drift") or drift.better_than_none < SURE_ODDS:
        return
    yield finding(
        "clock_drift",
        f"From the first half of the log to the second the force of the outputs acts"
        f" {drift.change_s:+.1f} s later: the clock of the outputs, or that of the velocity, drifts"
        f" by some {100.0 * abs(drift.change_s) / (middle - start):.1f} %.",
        stream="actuators",
        value=drift.change_s,
        fields=("time_us",),
    )


def _usual(odds: Array) -> float:
    return float(odds[USUAL].max())


def _follows(odds: Array, lag: float) -> bool:
    """Return whether an axis by itself is explained best about a lag."""
    best = float(LAGS_S[np.argmax(odds)])
    return abs(best - lag) < SAME_S and float(odds.max() - odds.min()) > AXIS_ODDS
