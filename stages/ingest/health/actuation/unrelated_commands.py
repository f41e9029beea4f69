"""Commands that have nothing to do with the motion of their log."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.relation import Relation, relation
from auvid.hydro.identification.checks.response import tone_share
from auvid.hydro.long_series.long_arrays import laid_down
from auvid.stages.columns import FINS
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS, motions
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.actuation.push_answers import CLEAR, push_responses
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    finding,
    finite,
    limit,
    listed,
)
from auvid.stages.number_format import percent, significant

SLOWEST_HZ = 1.5
FEWEST_MOTIONS = 3
FEWEST_PUSHED = 2
"""Motions that the vehicle file's forces accelerate, clear of zero, in every healthy dive."""
USUAL_LAG_S = 0.5
"""Motion behind commands that are stamped right."""
LEAST_EXCESS, LEAST_OF_TURNS, CLEAR_EXCESS = 3.0, 1.7, 5.0
"""Excess over chance below which a relation that no force of the vehicle file confirms is
none, the same where only turns can confirm it (95 % of the commands of other dives have
less), and from which on another time of the commands is named.
"""


def unrelated_commands(log: CheckedLog) -> Iterator[Finding]:
    """Yield commands that explain no more of the motion than they do at other times."""
    if log.under_water is False or not log.has("actuators"):
        return
    acting, clock = activity(log), log.clock("actuators")
    if acting is None or float(np.mean(acting)) < limit("little_actuation"):
        return
    if clock is None or clock.rate_hz < SLOWEST_HZ:
        return
    measured = motions(log)
    related = relation(
        log.t_s("actuators"),
        actuator_commands(log),
        [(at, values) for at, values, _ in measured.values()],
    )
    if related is None or len(related.compared) < FEWEST_MOTIONS:
        return
    by_chance = related.p > limit("commands_unrelated")
    if log.vehicle is not None and log.vehicle.thrusters is not None:
        pushed = sum(
            float(gains.gain[0]) > CLEAR * float(gains.sd[0]) for _, gains in push_responses(log)
        )
        by_chance |= related.excess < (LEAST_EXCESS if log.has("velocity") else LEAST_OF_TURNS)
        by_chance &= pushed < FEWEST_PUSHED
    if by_chance:
        yield _finding(log, related, list(measured))


def one_tone(log: CheckedLog) -> Iterator[Finding]:
    """Yield commands of one frequency, to which any order and lag fits."""
    if log.under_water is False or not log.has("actuators"):
        return
    commands = actuator_commands(log)
    if not commands.size:
        return
    frequency, share = tone_share(log.t_s("actuators"), commands)
    if share > limit("commands_one_tone"):
        yield finding(
            "commands_one_tone",
            f"The outputs swing at one frequency ({significant(frequency)} Hz,"
            f" {percent(round(share, 3))} of their power), so that their order, scale and clock"
            " are not observable: the motion of such a log fits any of them. Not tested because of"
            " it: response_order, response_scale, response_unit, velocity_axes (by the thrusters),"
            " command_late, commands_early, commands_unrelated, clock_drift.",
            stream="actuators",
            value=share,
        )


def actuator_commands(log: CheckedLog) -> Array:
    """Return all commands (n, k); an output that is off is neutral."""
    there = log.tables["actuators"].column_names
    others = [name for name in ("propeller_rev_s", *FINS) if name in there]
    names = [*log.thrusters(), *log.commands(), *others]

    def neutral() -> Array:
        values = finite(log.values("actuators", names))
        pulses = np.array([name.startswith("pwm_") for name in names])
        off = pulses & (values == 0.0)
        return laid_down(np.where(off, NEUTRAL_US, values)) if off.any() else values

    return log.once(("commands", *names), (log.tables["actuators"],), neutral)


def _finding(log: CheckedLog, related: Relation, axes: list[str]) -> Finding:
    names = [MOTION_WORDS[axes[place]] for place in related.compared]
    text = (
        f"The commands have nothing to do with this motion: of {listed(names)} they explain"
        f" {percent(round(float(related.share.mean()), 2))} (mean), and as much in"
        f" {percent(round(related.p, 3))} of the cases where they are shifted in time by 10 s and"
        " more, or reversed"
    )
    remedy = ""
    if related.excess_of(related.odds_there) > CLEAR_EXCESS:
        later = related.shift_s - USUAL_LAG_S
        text += f"; stamped some {abs(later):.0f} s {'later' if later > 0.0 else 'earlier'} they"
        text += " fit it"
        remedy = (
            f"Add about {later:+.1f} s to the times of the commands (time: {{..., shift_s:"
            f" {later:.1f}}} in their column map), and check again."
        )
    return finding(
        "commands_unrelated",
        f"{text}.",
        stream="actuators",
        value=related.p,
        remedy=remedy,
    )
