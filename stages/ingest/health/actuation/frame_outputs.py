"""Frame of the autopilot: against the vehicle file, and against the motion of a log."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.commands import (
    COMMANDS,
    FullCommands,
    frame_name,
    frame_thrusters,
    unscaled,
)
from auvid.hydro.dynamics.actuators.thrusters import NO_PULSE_US, Thrusters
from auvid.hydro.dynamics.vehicle.logged_directions import (
    MOTOR_OF_FUNCTION,
    UnscaledLayout,
    joined_as_logged,
    layout_without_curve,
    turned_as_logged,
)
from auvid.hydro.identification.checks.motion_checks import integrals, shared_windows
from auvid.hydro.identification.checks.outputs.joined_outputs import OtherOrder, joined_outputs
from auvid.stages.columns import RATES, SPEEDS
from auvid.stages.ingest.health.actuation.motions import motions
from auvid.stages.ingest.health.actuation.output_order import (
    ANSWERS_S,
    LEAST_ALLOCATION,
    LEAST_ORDER_WINDOWS,
    ORDER_WINDOW_S,
    motion_windows,
    other_terms,
)
from auvid.stages.ingest.health.actuation.push_answers import SMALLEST_MOTION, forces_along
from auvid.stages.ingest.health.finding import (
    SWING_US,
    CheckedLog,
    Finding,
    finding,
    listed,
)
from auvid.stages.number_format import percent

HORIZONTAL = {0: "u", 1: "v", 5: "r"}
"""Rows of an allocation that tell how outputs of a frame are joined. In heave, roll and pitch
an autopilot holds still, and its frame says how commands mix, not how thrusters push: there
sound logs prefer another order by a logarithm of the likelihood of up to 89, here by 23.
"""
BEYOND_SOUND = 30.0
"""Least logarithm of the likelihood over the best other explanation."""
MOST_CAUSES = 3
LEAST_PART, NO_PART = 0.3, 0.05
"""Of the largest entry of a row of an allocation: less has no sure sign, less is none."""
STILL_US, LIKE_A_MOTOR = 5.0, 0.8
"""How far from neutral an output goes that stands still, and the share of the pulses of
another one that those of the motors of a frame explain."""


def frame_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield a frame that the vehicle file or the outputs contradict."""
    parts = [*_of_file(log), *_of_outputs(log)]
    if parts:
        yield finding("frame_unlike", " ".join(parts), stream="actuators", value=float(len(parts)))


def _of_file(log: CheckedLog) -> Iterator[str]:
    """Yield how FRAME_CONFIG of a log contradicts the vehicle file."""
    parameters, vehicle = log.info.parameters, log.vehicle
    logged = frame_name(parameters)
    if logged is None or vehicle is None:
        return
    of_log = f"{logged} of the log (FRAME_CONFIG {parameters['FRAME_CONFIG']:g})"
    own = vehicle.thrusters or vehicle.commands.thrusters
    if own is None:
        if vehicle.commands.frame not in (None, logged):
            yield f"The vehicle file has frame {vehicle.commands.frame}, not {of_log}."
        return
    frame = joined_as_logged(frame_thrusters(logged), parameters)
    if len(own.outputs) != len(frame.outputs):
        yield (
            f"The vehicle file has {len(own.outputs)} thrusters, and frame {of_log} has"
            f" {len(frame.outputs)}."
        )
        return
    if turned_as_logged(frame, parameters) is None:
        return  # signs of the file may stand for directions
    yield from _other_signs(own, frame, of_log)


def _other_signs(own: Thrusters, frame: Thrusters, of_log: str) -> Iterator[str]:
    """Yield thrusters that push another way than the motors of a frame."""
    largest = np.abs(own.allocation).max(axis=1)
    for row, word in enumerate(COMMANDS):
        wrong = []
        if not frame.allocation[row].any():
            continue
        if largest[row] < LEAST_ALLOCATION:
            yield f"No thruster of the vehicle file drives {word}, and motors of frame {of_log} do."
            continue
        for place, output in enumerate(own.outputs):
            if output not in frame.outputs:
                continue
            factor = frame.allocation[row, frame.outputs.index(output)]
            part = own.allocation[row, place] / largest[row]
            none = row < 3 and abs(part) < NO_PART and factor != 0.0
            if none or (abs(part) > LEAST_PART and part * factor < 0.0):
                wrong.append(f"{place + 1} (output {output})")
        if wrong:
            yield (
                f"Another way in {word} than the motors of frame {of_log} push thrusters of the"
                f" vehicle file: {listed(wrong)}."
            )


def _of_outputs(log: CheckedLog) -> Iterator[str]:
    """Yield motors of a frame that stand still, and outputs that it lacks."""
    layout = _layout(log)
    if layout is None or layout.frame is None:
        return
    motors = {
        f"pwm_{output}_us": layout.thrusters.allocation[[0, 1, 2, 5], place] != 0.0
        for place, output in enumerate(layout.thrusters.outputs)
    }
    names = [name for name in motors if name in log.tables["actuators"].column_names]
    moving = [name for name in names if _reach_us(log, name) > SWING_US]
    if not moving or len(names) < len(motors):
        return
    driven = np.any([motors[name] for name in moving], axis=0)
    still = [
        name for name in names if _reach_us(log, name) < STILL_US and (motors[name] & driven).any()
    ]
    if still:
        yield (
            f"Motors of {layout.source} at outputs {_numbers(still)} stand still all log long, and"
            " others of the same axes move."
        )
    others = [name for name in _pulses(log) if name not in motors and log.swings(name)]
    pulses = log.values("actuators", moving) - NEUTRAL_US
    like = [name for name in others if _explained(log.column("actuators", name), pulses)]
    functions = (log.info.parameters.get(f"SERVO{_number(name)}_FUNCTION") for name in like)
    if like and all(value is None or value in MOTOR_OF_FUNCTION for value in functions):
        yield f"Outputs {_numbers(like)} move as motors do, and {layout.source} has none there."


def _reach_us(log: CheckedLog, name: str) -> float:
    """Return how far from neutral an output ever goes."""
    pulses = log.column("actuators", name)
    return float(np.abs(pulses[pulses > NO_PULSE_US] - NEUTRAL_US).max(initial=0.0))


def _pulses(log: CheckedLog) -> list[str]:
    return [name for name in log.tables["actuators"].column_names if name.startswith("pwm_")]


def _number(name: str) -> int:
    return int(name.split("_")[1])


def _numbers(names: list[str]) -> str:
    return listed([str(_number(name)) for name in names])


def _explained(values: Array, motors: Array) -> bool:
    """Return whether pulses (n,) are a sum of those of motors (n, k), almost."""
    there = np.isfinite(values) & np.isfinite(motors).all(axis=1) & (values > NO_PULSE_US)
    terms = np.column_stack([motors[there], np.ones(int(there.sum()))])
    left = values[there]
    fit = terms @ np.linalg.lstsq(terms, left, rcond=None)[0]
    spread = float(left.var()) if left.size > 10 * terms.shape[1] else 0.0
    return spread > 0.0 and 1.0 - float((left - fit).var()) / spread > LIKE_A_MOTOR


def _layout(log: CheckedLog) -> UnscaledLayout | None:
    """Return the layout of outputs without newtons, or None."""
    vehicle = log.vehicle
    if not log.has("actuators") or log.commands():
        return None
    if vehicle is not None and (vehicle.thrusters is not None or vehicle.propeller is not None):
        return None
    commands = FullCommands() if vehicle is None else vehicle.commands
    return layout_without_curve(commands, log.info.parameters)


def frame_outputs(log: CheckedLog) -> Iterator[Finding]:
    """Yield outputs that a frame joins otherwise than surge, sway and yaw show.

    Of logs whose thrusters have no newtons; those with a curve have `joined_otherwise`.
    """
    layout = _layout(log)
    if layout is None:
        return
    thrusters = unscaled(
        turned_as_logged(layout.thrusters, log.info.parameters) or layout.thrusters
    )
    names = [f"pwm_{number}_us" for number in thrusters.outputs]
    if not set(names) <= set(log.tables["actuators"].column_names):
        return
    order = _other_order(log, thrusters)
    if order is not None:
        yield _joined_wrong(log, *order, thrusters, layout, names)


def _other_order(log: CheckedLog, thrusters: Thrusters) -> tuple[OtherOrder, list[int]] | None:
    """Return another order that the motion shows, and its rows, or None."""
    measured = motions(log)
    rows = [
        row
        for row, axis in HORIZONTAL.items()
        if axis in measured
        and np.abs(thrusters.allocation[row]).max() > LEAST_ALLOCATION
        and float(measured[axis][1].std()) > SMALLEST_MOTION
    ]
    own: list[tuple[Array, Array]] = [measured[HORIZONTAL[row]][:2] for row in rows]
    t_s = log.t_s("actuators")
    if not rows:
        return None
    at = shared_windows(t_s, *(times for times, _ in own), width_s=ORDER_WINDOW_S)
    at = at[: -int(np.ceil(max(ANSWERS_S) / ORDER_WINDOW_S))]
    if at.size < LEAST_ORDER_WINDOWS:
        return None
    terms = [other_terms(log, row, times) for row, (times, _) in zip(rows, own, strict=True)]
    joined = joined_outputs(
        [motion_windows(own, terms, at + lag) for lag in ANSWERS_S],
        integrals(t_s, forces_along(log, thrusters), at, ORDER_WINDOW_S),
        thrusters.allocation[rows],
        thrusters.direction,
        linear=sum(row < 2 for row in rows),
        horizontal=rows[:2] == [0, 1],
    )
    other = joined.other
    return None if other is None or other.log_ratio < BEYOND_SOUND else (other, rows)


def _joined_wrong(
    log: CheckedLog,
    other: OtherOrder,
    rows: list[int],
    thrusters: Thrusters,
    layout: UnscaledLayout,
    names: list[str],
) -> Finding:
    best = int(np.argmax(other.share - other.own))
    otherwise, as_it_is = (
        percent(round(float(part[best]), 2)) for part in (other.share, other.own)
    )
    words = (*SPEEDS, *RATES)[rows[best]]
    moved = _moved(other.source)
    others = [_words(source, backward, thrusters) for (source, backward), _ in other.equals]
    also = f" As well explained: {'; '.join(others[:MOST_CAUSES])}." if others else ""
    what = _words(other.source, other.backward, thrusters)
    return finding(
        "response_order",
        f"{what[0].upper()}{what[1:]}: then {words} answers {layout.source} ({otherwise} of what"
        f" drag leaves of its changes), as it stands it hardly does ({as_it_is}).{also}",
        stream="actuators",
        value=other.log_ratio,
        fields=tuple(names),
        remedy=_remedy(log, other.backward, moved, thrusters, layout),
    )


def _moved(source: tuple[int, ...]) -> list[int]:
    """Return the places of thrusters that listen to another output."""
    return [place for place, other in enumerate(source) if other != place]


def _words(source: tuple[int, ...], backward: int | None, thrusters: Thrusters) -> str:
    if backward is not None:
        return f"output {thrusters.outputs[backward]} seems to act backward"
    moved = [thrusters.outputs[place] for place in _moved(source)]
    if len(moved) == 2:
        return f"outputs {moved[0]} and {moved[1]} look exchanged"
    return f"outputs look in the order {', '.join(str(thrusters.outputs[n]) for n in source)}"


def _remedy(
    log: CheckedLog,
    backward: int | None,
    moved: list[int],
    thrusters: Thrusters,
    layout: UnscaledLayout,
) -> str:
    """Return what to change at the vehicle, and for this log in the vehicle file."""
    parameters = log.info.parameters
    if backward is not None:
        output = thrusters.outputs[backward]
        motor = MOTOR_OF_FUNCTION.get(
            parameters.get(f"SERVO{output}_FUNCTION") or 0.0, backward + 1
        )
        name = f"MOT_{motor}_DIRECTION"
        turned = f"{-thrusters.direction[backward]:.0f}"
        vehicle = (
            f"Run motor {motor} by itself. If it does, set {name} to {turned} (the log has"
            f" {parameters[name]:g}), or exchange two of its wires; not both."
            if parameters.get(name) is not None
            else f"Check motor {motor}: its wires, its propeller and {name}, which the log lacks."
        )
        change = f"turn the signs of row {backward + 1}"
    else:
        outputs = [thrusters.outputs[place] for place in moved]
        functions = " and ".join(f"SERVO{output}_FUNCTION" for output in outputs[:2])
        vehicle = (
            f"Run both motors one by one. If so, exchange {functions}, or the plugs; not both."
            if len(outputs) == 2
            else f"Check SERVOn_FUNCTION and plugs of outputs {listed([str(n) for n in outputs])}."
        )
        change = "give outputs in the order of the rows"
    if layout.frame is None:
        return f"{vehicle} For this log {change} of actuators.thrusters in the vehicle file."
    return (
        f"{vehicle} For this log give actuators.thrusters in the vehicle file (effect: a row X Y Z"
        f" K M N for each motor of the frame) and {change}."
    )
