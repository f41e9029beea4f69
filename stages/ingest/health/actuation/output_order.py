"""Outputs of which one acts backward, or that come in another order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import (
    Thrusters,
    thruster_allocation,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.logged_directions import with_logged_directions
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.checks.motion_checks import integrals, windows
from auvid.hydro.identification.checks.outputs.joined_outputs import (
    JoinedOutputs,
    OtherOrder,
    WindowMotion,
    joined_outputs,
)
from auvid.hydro.identification.checks.outputs.motor_directions import motor_directions
from auvid.hydro.identification.checks.outputs.output_gains import (
    ChangedOrder,
    OutputGains,
    answered,
    changed_order,
    odds_without,
    output_gains,
)
from auvid.stages.columns import ATTITUDE, GYRO, RATES, SPEEDS
from auvid.stages.ingest.health.actuation.motions import motions as body_motions
from auvid.stages.ingest.health.actuation.push_answers import (
    RIGHTED,
    SMALLEST_MOTION,
    answers_backward,
    coupling,
    forces_along,
)
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed
from auvid.stages.number_format import percent

ORDER_WINDOW_S, LEAST_ORDER_WINDOWS, ANSWERS_S = 0.5, 100, (0.0, 0.1, 0.2, 0.3)
LEAST_ALLOCATION = 1e-6
CLEARLY_DEAD, PRECISE, WEAK, MOST_UNLIKE = 3.0, 0.75, 0.25, 5.0
"""Standard deviations by which an output without effect stays below the limit, and what
part of the usual gain they may be. Beyond a quarter of it for certain a thruster is weak; by
how much the gains of the others may differ.
"""
LEAST_FOLLOWED = 0.3
"""Share of some axis that the outputs must explain to tell which of them does nothing."""
SURE_CHANGE, RISE_OF_CHANGE, SURE_PART = 30.0, 0.14, 12.0
"""Log likelihood of outputs that change under way over those that do not, by how much more of
an axis they explain so, and the log likelihood of the one order over the other in each of both
parts: 300 sound logs and parts of them have 16 and .12, or 46 and .11; of 127 none has a part
beyond 9.1, and those with 16 or more 5.
"""
FIRST_TURN, MOST_CAUSES = 3, 3
"""Row of roll in an allocation, those before are speeds; and causes named beside the best."""
OTHER_PLACES: Mapping[str, tuple[tuple[int, int, int], tuple[float, float, float]]] = {
    "x of the positions counted backward": ((0, 1, 2), (-1.0, 1.0, 1.0)),
    "y of the positions counted to the left": ((0, 1, 2), (1.0, -1.0, 1.0)),
    "x and y of the positions exchanged": ((1, 0, 2), (1.0, 1.0, 1.0)),
}
"""Order and signs of the coordinates of thrusters in a wrong vehicle file."""
PLACES_TOO = (
    " Positions of the thrusters that count from another point than the origin look like outputs in"
    " another order: compare both with the vehicle."
)


def joined_otherwise(log: CheckedLog, *, signs: bool = True) -> Iterator[Finding]:
    """Yield outputs of which one acts backward, or that come in another order.

    `signs`: whether the sign of an answer is a finding of this log, and tells orders apart.
    """
    vehicle, streams = log.vehicle, ("actuators", "velocity", "imu")
    if vehicle is None or vehicle.thrusters is None or not log.has(*streams):
        return
    vehicle, _ = with_logged_directions(vehicle, log.info.parameters)
    thrusters = vehicle.thrusters
    assert thrusters is not None
    names = [f"pwm_{number}_us" for number in thrusters.outputs]
    if not set(names) <= set(log.tables["actuators"].column_names):
        return
    t_s, t_velocity, t_imu = (log.t_s(name) for name in streams)
    forces = forces_along(log, thrusters)
    motions = [(t_velocity, axis) for axis in log.body_velocity().T]
    motions += [(t_imu, log.column("imu", name)) for name in GYRO]
    driven = [
        row
        for row, (_, motion) in enumerate(motions)
        if np.abs(thrusters.allocation[row]).max() > LEAST_ALLOCATION
        and float(motion.std()) > SMALLEST_MOTION
        and (row not in RIGHTED or log.has("attitude"))
    ]
    start, end = max(t_s[0], t_velocity[0], t_imu[0]), min(t_s[-1], t_velocity[-1], t_imu[-1])
    clocks = t_s, t_velocity, t_imu
    at = windows(start, end - max(ANSWERS_S), *clocks, width_s=ORDER_WINDOW_S)
    if not driven or at.size < LEAST_ORDER_WINDOWS:
        return
    own = [motions[row] for row in driven]
    terms = [other_terms(log, row, motions[row][0]) for row in driven]
    places = other_places(vehicle)
    impulse = integrals(t_s, forces, at, ORDER_WINDOW_S)
    answers = [motion_windows(own, terms, at + lag) for lag in ANSWERS_S]
    joined = joined_outputs(
        answers,
        impulse,
        thrusters.allocation[driven],
        thrusters.direction,
        linear=sum(row < FIRST_TURN for row in driven),
        horizontal=driven[:2] == [0, 1],
        geometries=[allocation[driven] for allocation in places.values()],
    )
    words = [(*SPEEDS, *RATES)[row] for row in driven]
    if joined.other is not None:
        wrong = _joined_wrong(joined.other, words, thrusters.outputs, list(places), names)
        wrong["text"] += _of_another_vehicle(log, names)
        yield wrong
        return
    motion = answered(answers, impulse, thrusters.allocation[driven])
    gains, change = output_gains(motion), changed_order(motion, thrusters.direction)
    dead = _without_effect(gains)
    sure = change is not None and _is_sure(change) and _is_measured(change, gains)
    if change is not None and sure and change.better > odds_without(motion, dead):
        yield _changed(change, thrusters, at)
        return
    if gains is not None and dead:
        yield _dead(gains, dead, thrusters.outputs)
        return
    if len(joined.unseen) == len(names):
        yield finding(
            "outputs_unanswered",
            f"No direction of an output shows in the motion ({listed(words)}): it hardly answers"
            " the thrusters as the vehicle file joins them, at the times of the log.",
            stream="actuators",
            value=float(len(names)),
        )
    else:
        if signs:
            joined = _without_signs(joined, log, list(places.values()))
        yield from _not_told(joined, words, thrusters.outputs, list(places))


def directions_by_motion(log: CheckedLog, vehicle: Vehicle) -> Array | None:
    """Return the direction (m,) of each thruster as the motion of a log has it.

    By velocities, the rate of the depth and the gyro. None where it does not tell them all.
    """
    thrusters = vehicle.thrusters
    if thrusters is None or not log.has("actuators", "imu"):
        return None
    names = [f"pwm_{number}_us" for number in thrusters.outputs]
    if not set(names) <= set(log.tables["actuators"].column_names):
        return None
    measured = {"uvwpqr".index(axis): own[:2] for axis, own in body_motions(log).items()}
    if log.has("velocity"):
        speeds = log.body_velocity().T
        measured |= {row: (log.t_s("velocity"), own) for row, own in enumerate(speeds)}
    driven = [
        row
        for row in sorted(measured)
        if np.abs(thrusters.allocation[row]).max() > LEAST_ALLOCATION
        and log.has("attitude" if row in RIGHTED else "imu")
        and float(measured[row][1].std()) > SMALLEST_MOTION
    ]
    t_s, own = log.t_s("actuators"), [measured[row] for row in driven]
    clocks = (t_s, *(times for times, _ in own))
    start, end = max(times[0] for times in clocks), min(times[-1] for times in clocks)
    at = windows(start, end - max(ANSWERS_S), *clocks, width_s=ORDER_WINDOW_S)
    if not driven or at.size < LEAST_ORDER_WINDOWS:
        return None
    ahead, back = (
        integrals(t_s, forces_along(log, each), at, ORDER_WINDOW_S)
        for sign in (1.0, -1.0)
        for each in [replace(thrusters, direction=np.full(len(names), sign))]
    )
    terms = [
        other_terms(log, row, measured[row][0]) if row in RIGHTED or log.has("velocity") else None
        for row in driven
    ]
    answers = [motion_windows(own, terms, at + lag) for lag in ANSWERS_S]
    return motor_directions(answers, (ahead, back), thrusters.allocation[driven])


def _without_effect(gains: OutputGains | None) -> list[int]:
    """Return the places of outputs whose force the motion does not follow."""
    if gains is None or gains.explained < LEAST_FOLLOWED or np.count_nonzero(gains.acts) < 3:
        return []
    usual = float(np.median(gains.gain[gains.acts]))
    most = CLEARLY_DEAD * gains.sd
    dead = gains.acts & (gains.gain + most < limit("output_dead") * usual)
    precise = (most < PRECISE * usual) & (gains.gain + most > -usual)
    places = np.flatnonzero(dead & precise & (gains.gain - most < WEAK * usual)).tolist()
    measured = gains.acts & (most < PRECISE * usual)
    others = np.delete(gains.gain, places)[np.delete(measured, places)]
    if len(places) > np.count_nonzero(gains.acts) // 2:
        return []
    # Gains of others that differ so much fit no thrusters.
    if places and others.size and others.min() < others.max() / MOST_UNLIKE:
        return []
    return places


def _dead(gains: OutputGains, places: list[int], outputs: tuple[int, ...]) -> Finding:
    """Return the finding of outputs whose force the motion does not follow."""
    usual = float(np.median(gains.gain[gains.acts]))
    parts = [
        f"output {outputs[place]} ({gains.gain[place]:.2f} +- {2.0 * gains.sd[place]:.2f} of the"
        " force that the vehicle file gives it)"
        for place in places
    ]
    several = len(places) > 1
    rest = np.delete(gains.gain, places)[np.delete(gains.acts, places)]
    return finding(
        "output_dead",
        f"The motion does not follow {listed(parts)}, and the others with {rest.min():.2f} to"
        f" {rest.max():.2f}: {'their columns are' if several else 'its column is'} another signal,"
        f" or the thruster{'s' * several} give{'s' * (not several)} nothing.",
        stream="actuators",
        value=float(gains.gain[places].max() / usual),
        fields=tuple(f"pwm_{outputs[place]}_us" for place in places),
    )


def _is_measured(change: ChangedOrder, gains: OutputGains | None) -> bool:
    """Return whether the outputs of a change have gains of their own.

    Those of two that move alike all log long stand for each other, as do their signs.
    """
    if gains is None:
        return True
    usual = float(np.median(gains.gain[gains.acts])) if gains.acts.any() else 1.0
    return bool((gains.sd[list(change.pair)] < usual).all())


def _is_sure(change: ChangedOrder) -> bool:
    """Return whether outputs clearly change under way, by the log and both parts."""
    return (
        change.better >= SURE_CHANGE
        and change.rise >= RISE_OF_CHANGE
        and change.by_part >= SURE_PART
    )


def _changed(change: ChangedOrder, thrusters: Thrusters, at: Array) -> Finding:
    """Return the finding of outputs that are joined otherwise from some time on."""
    first, second = (thrusters.outputs[place] for place in change.pair)
    start, last = (float(at[window]) for window in change.windows)
    what = (
        f"output {first} acts backward"
        if first == second
        else f"outputs {first} and {second} are exchanged"
    )
    return finding(
        "response_order",
        f"From a time between {start:.0f} and {last:.0f} s on {what}: so the motion answers the"
        " thrusters of the vehicle file all log long, and as it stands only until then.",
        stream="actuators",
        value=change.better,
        at_s=start,
        fields=tuple(dict.fromkeys((f"pwm_{first}_us", f"pwm_{second}_us"))),
        remedy="Let legs end before, or cut the log in two and give each part the outputs that it"
        " had: the vehicle was wired otherwise, or its parameters changed, under way.",
    )


def _without_signs(joined: JoinedOutputs, log: CheckedLog, places: list[Array]) -> JoinedOutputs:
    """Return what is not told, without what would turn the sign of an answer."""
    thrusters = None if log.vehicle is None else log.vehicle.thrusters
    if thrusters is None:
        return joined
    signs = 1.0 - 2.0 * np.eye(len(thrusters.outputs))
    backward = [replace(thrusters, direction=thrusters.direction * each) for each in signs]
    exchanged = {
        pair: replace(thrusters, outputs=_exchanged(thrusters.outputs, *pair))
        for pair in joined.alike
    }
    placed = [replace(thrusters, allocation=each) for each in places]
    return replace(
        joined,
        unseen=tuple(n for n in joined.unseen if not answers_backward(log, backward[n])),
        alike=tuple(n for n in joined.alike if not answers_backward(log, exchanged[n])),
        places=tuple(n for n in joined.places if not answers_backward(log, placed[n])),
    )


def _exchanged(outputs: tuple[int, ...], first: int, last: int) -> tuple[int, ...]:
    """Return outputs with those at two places exchanged."""
    own = list(outputs)
    own[first], own[last] = own[last], own[first]
    return tuple(own)


def _not_told(
    joined: JoinedOutputs, words: list[str], outputs: tuple[int, ...], places: list[str]
) -> Iterator[Finding]:
    """Yield what the motion does not tell of the outputs: direction, order, places."""
    parts = []
    if joined.unseen:
        numbers = listed([str(outputs[place]) for place in joined.unseen])
        several = len(joined.unseen) > 1
        parts.append(
            f"Whether output{'s' * several} {numbers} act{'s' * (not several)} forward is not"
            f" observable: {listed(words)} move{'s' * (len(words) == 1)} too little by"
            f" {'them' if several else 'it'}."
        )
    pairs = [pair for pair in joined.alike if not set(pair) <= set(joined.unseen)]
    if pairs:
        names = "; ".join(f"{outputs[first]} and {outputs[last]}" for first, last in pairs)
        parts.append(f"Whether outputs are exchanged is not observable of {names}.")
    if joined.places:
        names = "; ".join(places[number] for number in joined.places)
        parts.append(f"As well explained with {names} of the thrusters, not observable either.")
    if parts:
        yield finding(
            "outputs_unseen",
            " ".join(parts),
            stream="actuators",
            value=float(len(joined.unseen)),
        )


def _of_another_vehicle(log: CheckedLog, names: list[str]) -> str:
    """Return that outputs move which the vehicle file has no thruster for."""
    actuators = log.tables["actuators"]
    others = [
        name.removeprefix("pwm_").removesuffix("_us")
        for name in actuators.column_names
        if name.startswith("pwm_") and name not in names and log.swings(name)
    ]
    if not others:
        return ""
    return f" Or it is the file of another vehicle: it has no thruster on {listed(others)}."


def _joined_wrong(
    order: OtherOrder,
    words: list[str],
    outputs: tuple[int, ...],
    places: list[str],
    names: list[str],
) -> Finding:
    axis = int(np.argmax(order.share - order.own))
    otherwise, as_it_is = (
        percent(round(float(part[axis]), 2)) for part in (order.share, order.own)
    )
    what = (
        _order_words(order, outputs)
        if order.geometry is None
        else f"The vehicle file has {places[order.geometry]} of the thrusters: the other way"
    )
    others = [
        _cause(source, backward, geometry, outputs, places)
        for (source, backward), geometry in order.equals
    ]
    also = f" As well explained: {'; '.join(others[:MOST_CAUSES])}." if others else ""
    return finding(
        "response_order",
        f"{what} {words[axis]} answers the thrusters of the vehicle file ({otherwise} of what drag"
        f" leaves of its changes), as it stands it hardly does ({as_it_is}).{also}{PLACES_TOO}",
        stream="actuators",
        value=order.log_ratio,
        fields=() if order.geometry is not None else tuple(names),
    )


def other_terms(log: CheckedLog, row: int, at: Array) -> Array | None:
    """Return what accelerates an axis beside thrust and drag (n, k)."""
    if row not in RIGHTED:
        return coupling(log, row, at)
    angle = log.column("attitude", ATTITUDE[row - FIRST_TURN])
    return np.sin(np.interp(at, log.t_s("attitude"), angle))[:, None]


def other_places(vehicle: Vehicle) -> dict[str, Array]:
    """Return the allocations (6, m) of thrusters in other places, by what is wrong."""
    entry = vehicle.document.actuators.thrusters
    if entry is None or entry.position is None or entry.axis is None:
        return {}
    position, axis = entry.position.array, entry.axis.array
    axis = axis / np.linalg.norm(axis, axis=1)[:, None]
    return {
        words: thruster_allocation(position[:, order] * signs, axis)
        for words, (order, signs) in OTHER_PLACES.items()
    }


def placed_otherwise(
    vehicle: Vehicle, order: tuple[int, int, int], signs: tuple[float, float, float]
) -> Vehicle:
    """Return the vehicle of a file with other places of the thrusters."""
    document = vehicle.document.model_dump(mode="python", exclude_none=True)
    entry = document["actuators"]["thrusters"]["position"]
    places = np.asarray(entry["value"], dtype=np.float64)
    entry["value"] = (places[:, order] * signs).tolist()
    return vehicle_from_document(document)


def motion_windows(
    motions: list[tuple[Array, Array]], turns: list[Array | None], at: Array
) -> WindowMotion:
    """Return changes of motions (times, values) over windows, and drag and turns."""
    changes, drag = [], []
    for (t, motion), coupled in zip(motions, turns, strict=True):
        first, last = (np.interp(side, t, motion) for side in (at, at + ORDER_WINDOW_S))
        changes.append(last - first)
        terms = np.column_stack([motion, motion * np.abs(motion)])
        terms = terms if coupled is None else np.hstack([terms, coupled])
        drag.append(integrals(t, terms, at, ORDER_WINDOW_S))
    return WindowMotion(np.column_stack(changes), drag)


def _order_words(order: OtherOrder, outputs: tuple[int, ...]) -> str:
    if order.backward is not None:
        return f"Output {outputs[order.backward]} acts backward: with its force the other way round"
    moved = [place for place, source in enumerate(order.source) if source != place]
    if len(moved) == 2:
        first, second = (outputs[place] for place in moved)
        return f"Outputs {first} and {second} look exchanged: the other way round"
    listing = ", ".join(str(outputs[source]) for source in order.source)
    in_row = outputs == tuple(range(outputs[0], outputs[-1] + 1))
    stated = f"{outputs[0]} to {outputs[-1]}" if in_row else ", ".join(map(str, outputs))
    return f"The outputs come in another order: with {listing} for {stated}"


def _cause(
    source: tuple[int, ...],
    backward: int | None,
    geometry: int | None,
    outputs: tuple[int, ...],
    places: list[str],
) -> str:
    """Return another cause in words, in the middle of a sentence."""
    if geometry is not None:
        return f"the vehicle file has {places[geometry]}"
    if backward is not None:
        return f"output {outputs[backward]} acts backward"
    moved = [outputs[place] for place, other in enumerate(source) if other != place]
    if len(moved) == 2:
        return f"outputs {moved[0]} and {moved[1]} exchanged"
    return f"the outputs in the order {', '.join(str(outputs[place]) for place in source)}"
