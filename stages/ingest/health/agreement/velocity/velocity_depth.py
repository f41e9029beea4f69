"""Depths that have nothing to do with a velocity, and velocities in level axes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.hydro.identification.checks.attitude.depth_rate import SLOW, DepthRates, depth_rates
from auvid.hydro.identification.checks.signal_checks import rounding_step
from auvid.stages.columns import ATTITUDE, LINEAR_VELOCITY
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit

LEAST_RATE_M_S, FEWEST_WINDOWS = 0.03, 40
"""Standard deviation over a second from which a depth rate tells, and how many of them."""
NEAR_S, NEAR_ALIKE, ALIKE = 3.0, 0.5, 0.8
"""Shifts up to which velocity_lag tells a clock, and correlations there and further away
that are more than chance.
"""
SLOWLY_ALIKE = 0.7
"""Correlation over ten seconds of one dive: waves move the depth by their pressure, or the
velocity of a hull that rides them, and a coarse or restless depth hides what is faster.
"""

STILL = 0.1
"""Part of what the velocity makes up to which a depth does not move."""
SOME, FEWEST_JOINED, LEAST_MOVE_M, LEAST_PERSISTENCE, LEAST_UNEXPLAINED = 5, 10, 0.03, 0.3, 0.5
"""Of a hull that moves little: windows that are joined, how many of these, and what the
velocity must make of them, from window to window too, and for no tilt of its mounting.
"""
FEWEST_SLOW, LEAST_SLOW_M, GROWS, HARDLY = 6, 0.1, 1.3, 0.3
"""Of a depth alone that moves: windows of ten seconds, what it moves by in them, how much
more than in five, which no swell does, and the part that the velocity makes at most.
"""


def log_depth_rates(log: CheckedLog) -> DepthRates | None:
    if not log.has("depth", "velocity", "attitude"):
        return None
    return depth_rates(
        *log.depth_of_velocity(),
        log.t_s("attitude"),
        log.values("attitude", ATTITUDE),
        log.t_s("velocity"),
        log.body_velocity(),
    )


def is_rounded_away(log: CheckedLog) -> bool:
    """Return whether the depth has steps larger than its change in a second."""
    rates, step = log_depth_rates(log), rounding_step(log.column("depth", "depth_m"))
    return rates is not None and step is not None and step > float(np.std(rates.rise))


def unrelated_depth(log: CheckedLog) -> Iterator[Finding]:
    """Yield a depth that changes in another way than the velocity says."""
    rates = log_depth_rates(log)
    if rates is None or rates.rise.size < FEWEST_WINDOWS:
        return
    moves = [float(np.std(values)) for values in (rates.rise, rates.expected)]
    unmeasured = float(np.ptp(rates.parts[:, 2])) == 0.0
    little = min(moves) < LEAST_RATE_M_S
    if unmeasured or (little and not _moves_alone(rates)):
        return
    likeness = rates.joined(SOME).correlation if little else rates.correlation
    is_still = little and moves[0] < STILL * moves[1]
    least, most = -limit("depth_unrelated"), limit("depth_unrelated")
    if little:  # a depth with a wrong sign correlates better
        least, most = -SLOWLY_ALIKE, SLOWLY_ALIKE if is_still else most
    if not least < likeness < most or rates.slow_correlation > SLOWLY_ALIKE:
        return
    shift_s, there = rates.best_shift()
    if abs(shift_s) <= NEAR_S and there > NEAR_ALIKE:
        return
    text = (
        f"Depth ({log.source('depth')}) and velocity ({log.source('velocity')}) have nothing to do"
        f" with each other: the depth changes by {moves[0]:.2f} m/s (standard deviation over a"
        f" second), the velocity as the attitude turns it makes {moves[1]:.2f} m/s of it, and they"
        f" correlate by {likeness:.2f}."
    )
    if there > ALIKE:
        side = "earlier" if shift_s > 0.0 else "later"
        text += f" With the depth {abs(shift_s):.0f} s {side} they would by {there:.2f}."
    yield finding("depth_unrelated", text, stream="depth", value=likeness, fields=("depth_m",))


def _moves_alone(rates: DepthRates) -> bool:
    """Return whether one of depth and velocity moves alone, if only little."""
    some, slow = rates.joined(SOME), rates.joined(SLOW)
    if some.rise.size < FEWEST_JOINED or slow.rise.size < FEWEST_SLOW:
        return False
    by_velocity = (
        float(np.std(some.expected)) > LEAST_MOVE_M
        and rates.persistence > LEAST_PERSISTENCE
        and some.unexplained > LEAST_UNEXPLAINED
    )
    move = float(np.std(slow.rise))
    by_depth = (
        move > max(LEAST_SLOW_M, GROWS * float(np.std(some.rise)))
        and float(np.std(slow.expected)) < HARDLY * move
    )
    return by_velocity or by_depth


def level_velocity(log: CheckedLog) -> Iterator[Finding]:
    """Yield a velocity whose heave is the depth rate, whatever roll and pitch are."""
    rates = log_depth_rates(log)
    if rates is None:
        return
    odds = rates.level_odds()
    if odds < limit("velocity_level"):
        return
    yield finding(
        "velocity_level",
        f"The depth rate follows heave of the velocity ({log.source('velocity')}) alone,"
        f" e^{odds:.0f} times as likely as with the roll and pitch of the attitude: the velocity is"
        " in level axes (ahead, aside, down) or over ground, and not in those of the body.",
        stream="velocity",
        value=odds,
        fields=LINEAR_VELOCITY,
    )
