"""Checks of single outputs against those of other thrusters, and of all at rest."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import NO_PULSE_US, Thrusters, thrust_from_pwm
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    finding,
    finite,
    limit,
    listed,
)
from auvid.stages.number_format import percent

PARALLEL, FEWEST_PEERS = 0.95, 3
"""Cosine of axes that are the same, or mirrored; thrusters of a group, itself included."""
LONG_S, LONG_SHARE = 20.0, 0.25
"""An output that stands still is conspicuous for so long, and for so much of the log."""
FEWEST_CHANGES = 10
SAME_US = 0.5
LEAST_REST, OF_RESTS, FEWEST_AXES = 0.02, 0.8, 3
"""Share of the samples in which all outputs are alike, and of those with one value, from
which on it is that of rest; axes in which equal outputs cannot all be balanced.
"""


def single_output_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield an output that stands still while its peers work, or is a copy."""
    vehicle = log.vehicle
    if vehicle is None or vehicle.thrusters is None or not log.has("actuators"):
        return
    names = [f"pwm_{number}_us" for number in vehicle.thrusters.outputs]
    if not set(names) <= set(log.tables["actuators"].column_names):
        return
    pulses = finite(log.values("actuators", names))
    t_s = log.t_s("actuators")
    yield from _resting(pulses, vehicle.thrusters)
    for group in _groups(vehicle.thrusters.allocation[:3]):
        numbers = [vehicle.thrusters.outputs[place] for place in group]
        yield from _still(t_s, pulses[:, group], numbers)
        yield from _alike(pulses[:, group], numbers)


def rest_of(pulses: Array, thrusters: Thrusters) -> tuple[float, float] | None:
    """Return the pulse [us] at which all outputs (n, k) rest, and how often.

    None where they do not.
    """
    if np.linalg.matrix_rank(thrusters.allocation) < FEWEST_AXES:
        return None
    alike = (np.ptp(pulses, axis=1) < SAME_US) & (pulses[:, 0] > NO_PULSE_US)
    share = float(alike.mean())
    if share < LEAST_REST:
        return None
    rest = float(np.median(pulses[alike, 0]))
    one = np.abs(pulses[alike, 0] - rest) < SAME_US
    return (rest, share) if float(one.mean()) >= OF_RESTS else None


def _resting(pulses: Array, thrusters: Thrusters) -> Iterator[Finding]:
    """Yield the pulse at which all outputs rest, where it is none of rest."""
    resting = rest_of(pulses, thrusters)
    if resting is None:
        return
    rest, share = resting
    forces = thrust_from_pwm([rest, thrusters.curve.pwm_us[-1]], None, thrusters.curve)
    part = float(abs(forces[0] / forces[1])) if forces[1] else 0.0
    if part < limit("neutral_pulse"):
        return
    yield finding(
        "neutral_pulse",
        f"All outputs stand at {rest:.0f} us together in {percent(share)} of the"
        f" samples, as at rest, and the thrust curve of the vehicle file gives {forces[0]:+.1f} N"
        " there.",
        stream="actuators",
        value=part,
    )


def _groups(axes: Array) -> list[list[int]]:
    """Return thrusters (places) that push along one axis, by axes (3, n)."""
    size = np.linalg.norm(axes, axis=0)
    unit = axes / np.where(size > 0.0, size, 1.0)
    cosine = np.abs(np.round(np.abs(unit).T @ np.abs(unit), 6))
    left, groups = set(np.flatnonzero(size > 0.0).tolist()), []
    while left:
        first = min(left)
        group = [place for place in sorted(left) if cosine[first, place] > PARALLEL]
        left -= {first, *group}
        if len(group) >= FEWEST_PEERS:
            groups.append(group)
    return groups


def _still(t_s: Array, pulses: Array, numbers: list[int]) -> Iterator[Finding]:
    """Yield one output that keeps its value while all others of its group change."""
    if t_s.size < 2:
        return
    changes = np.diff(pulses, axis=0) != 0.0
    for place, number in enumerate(numbers):
        at = np.flatnonzero(np.concatenate([[True], changes[:, place], [True]]))
        longest = int(np.argmax(np.diff(at)))
        first, last = int(at[longest]), int(at[longest + 1]) - 1
        lasts = float(t_s[last] - t_s[first])
        if lasts < max(LONG_S, LONG_SHARE * float(t_s[-1] - t_s[0])):
            continue
        others = np.delete(changes[first:last], place, axis=1).sum(axis=0)
        if others.size and int(others.min()) >= FEWEST_CHANGES:
            peers = [str(other) for other in numbers if other != number]
            yield finding(
                "outputs_frozen",
                f"Output {number} stands at {pulses[first, place]:g} us from {t_s[first]:.1f} to"
                f" {t_s[last]:.1f} s, while {listed(peers)}, which push along the same axes, go on"
                " changing: its record froze, or nothing drives it.",
                stream="actuators",
                value=lasts,
                at_s=float(t_s[first]),
                fields=(f"pwm_{number}_us",),
            )


def _alike(pulses: Array, numbers: list[int]) -> Iterator[Finding]:
    """Yield two outputs of one record, equal or mirrored, where all others differ.

    Heave and roll without pitch make two such pairs of four.
    """
    offset = pulses - NEUTRAL_US
    pairs = [
        (first, other)
        for first, other in combinations(range(len(numbers)), 2)
        if np.ptp(offset[:, first]) > limit("no_actuation")
        and min(
            float(np.abs(offset[:, first] - sign * offset[:, other]).max()) for sign in (1.0, -1.0)
        )
        < SAME_US
    ]
    if len(pairs) == 1 and len(numbers) > FEWEST_PEERS:
        first, other = (numbers[place] for place in pairs[0])
        yield finding(
            "outputs_alike",
            f"Outputs {first} and {other} are the same in every sample, and no two others of"
            f" {listed([str(number) for number in numbers])} are: one is mapped or copied twice.",
            stream="actuators",
            fields=(f"pwm_{first}_us", f"pwm_{other}_us"),
        )
