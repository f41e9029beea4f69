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
    motors_without_output,
    turned_as_logged,
)
from auvid.hydro.identification.checks.motion_checks import integrals, shared_windows
from auvid.hydro.identification.checks.outputs.joined_outputs import WindowMotion
from auvid.hydro.identification.checks.outputs.turned_outputs import (
    OtherWiring,
    TurnedOutputs,
    turned_outputs,
)
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
sound twins prefer another order by a logarithm of the likelihood of up to 89.
"""
BACKWARD, EXCHANGED = 20.0, 45.0
"""Least logarithm of the likelihood over the outputs as they stand."""
WORSE, LEAST_COMMAND = 3.0, 0.05
"""By how much less likely an axis may get, and the spread of the command of one that tells, in
full commands. Outputs that are joined otherwise explain every axis better; a hull whose sway
answers yaw, or that a sway thruster turns, takes from one axis what it gives to another.
"""
EQUALLY, LEAST_RISE = 10.0, 0.2
MOST_CAUSES = 3
LEAST_PART, NO_PART = 0.3, 0.05
"""Of the largest entry of a row of an allocation: less has no sure sign, less is none."""
STILL_US, LIKE_A_MOTOR, SWITCHED = 5.0, 0.8, 5
"""How far from neutral an output goes that stands still, the share of the changes of another
one that those of the motors of a frame explain, and how often a light is switched."""


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
    lacking = motors_without_output(layout.thrusters, log.info.parameters)
    if lacking:
        functions = listed([f"SERVO{motor}_FUNCTION" for motor in lacking])
        yield (
            f"No output drives motors {listed([str(motor) for motor in lacking])} of"
            f" {layout.source}: {functions} of the log names others. Log SERVOn_FUNCTION of all"
            " outputs, or give actuators.thrusters with outputs in the vehicle file."
        )
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
    set_to = [log.info.parameters.get(f"SERVO{_number(name)}_FUNCTION") for name in like]
    if like and all(value is None or value in MOTOR_OF_FUNCTION for value in set_to):
        several = len(like) > 1
        yield (
            f"Output{'s' * several} {_numbers(like)} move{'s' * (not several)} as motors do, and"
            f" {layout.source} has none there."
        )


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
    """Return whether changes of pulses (n,) are almost sums of those of motors (n, k).

    But for the `SWITCHED` largest ones: a light that goes on as a dive begins looks like the
    thrust that holds it down.
    """
    there = np.isfinite(values) & np.isfinite(motors).all(axis=1) & (values > NO_PULSE_US)
    change = np.diff(values[there])
    usual = np.argsort(np.abs(change))[:-SWITCHED]
    change, terms = change[usual], np.diff(motors[there], axis=0)[usual]
    if change.size <= 10 * terms.shape[1]:
        return False
    left = change - terms @ np.linalg.lstsq(terms, change, rcond=None)[0]
    size = float(change @ change)
    return size > 0.0 and 1.0 - float(left @ left) / size > LIKE_A_MOTOR


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
    turned = turned_as_logged(layout.thrusters, log.info.parameters)
    thrusters = unscaled(turned or layout.thrusters)
    names = [f"pwm_{number}_us" for number in thrusters.outputs]
    if not set(names) <= set(log.tables["actuators"].column_names):
        return
    other, rows = _other_wiring(log, thrusters, LEAST_COMMAND)
    if other is not None and other.best.backward:
        # Turned round, outputs drive axes that they hardly did as declared.
        other, rows = _other_wiring(log, thrusters, 0.0)
    if other is None:
        return
    stated = turned is not None or (log.vehicle and log.vehicle.commands.direction)
    if layout.frame is None or stated:
        yield _joined_wrong(log, other, rows, thrusters, layout, names)
    else:
        yield _unstated(other, rows, thrusters, layout, names)


def _unstated(
    other: OtherWiring,
    rows: list[int],
    thrusters: Thrusters,
    layout: UnscaledLayout,
    names: list[str],
) -> Finding:
    """Return the finding of motors of a frame whose directions nothing states."""
    words = [(*SPEEDS, *RATES)[row] for row in rows]
    guess = np.ones(len(thrusters.outputs), dtype=int)
    guess[list(other.best.backward)] = -1
    level = np.abs(thrusters.allocation[rows]).max(axis=0) > LEAST_ALLOCATION
    others = [str(number) for number in np.array(thrusters.outputs)[~level]]
    rest = f"; this log does not tell those of outputs {listed(others)}" if others else ""
    turned = f": {_words(other.best, thrusters)}" if other.best.backward else ""
    return finding(
        "response_order",
        f"Nothing states how the motors turn, and {layout.source} with all of them forward"
        f" does not explain {listed(words)}{turned}.",
        stream="actuators",
        value=other.log_ratio,
        fields=tuple(names),
        remedy=f"State them in the vehicle file as MOT_n_DIRECTION of the autopilot has them:"
        f" actuators: {{commands: {{frame: {layout.frame}, direction: {guess.tolist()}}}}}{rest}.",
    )


def _other_wiring(
    log: CheckedLog, thrusters: Thrusters, least: float
) -> tuple[OtherWiring | None, list[int]]:
    """Return what clearly explains the motion better than as declared, and the rows.

    least: command of an axis, as declared, from which on it tells, in full commands.
    """
    motion = _level_motion(log, thrusters, least)
    if motion is None:
        return None, []
    answers, impulse, rows = motion
    other = turned_outputs(
        answers,
        impulse,
        thrusters.allocation[rows],
        thrusters.direction,
        equally=EQUALLY,
        worse=WORSE,
    )
    if other is None or float(np.max(other.share - other.own)) < LEAST_RISE:
        return None, rows
    clear = other.log_ratio >= (BACKWARD if other.best.backward else EXCHANGED)
    return (other if clear else None), rows


def _level_motion(
    log: CheckedLog, thrusters: Thrusters, least: float
) -> tuple[list[WindowMotion], Array, list[int]] | None:
    """Return changes of surge, sway and yaw, impulses of thrusters, and the rows."""
    measured = motions(log)
    forces = forces_along(log, thrusters)
    commands = (forces @ thrusters.allocation.T).std(axis=0)
    rows = [
        row
        for row, axis in HORIZONTAL.items()
        if axis in measured
        and np.abs(thrusters.allocation[row]).max() > LEAST_ALLOCATION
        and commands[row] >= least * np.abs(thrusters.allocation[row]).sum()
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
    impulse = integrals(t_s, forces, at, ORDER_WINDOW_S)
    return [motion_windows(own, terms, at + lag) for lag in ANSWERS_S], impulse, rows


def _joined_wrong(
    log: CheckedLog,
    other: OtherWiring,
    rows: list[int],
    thrusters: Thrusters,
    layout: UnscaledLayout,
    names: list[str],
) -> Finding:
    axis = int(np.argmax(other.share - other.own))
    otherwise, as_it_is = (
        percent(round(float(part[axis]), 2)) for part in (other.share, other.own)
    )
    what = _words(other.best, thrusters)
    others = [_words(item, thrusters) for item in other.equals[:MOST_CAUSES]]
    also = f" As well explained: {'; '.join(others)}." if others else ""
    return finding(
        "response_order",
        f"{what[0].upper()}{what[1:]}: then {(*SPEEDS, *RATES)[rows[axis]]} answers"
        f" {layout.source} ({otherwise} of what drag leaves of its changes), as it stands"
        f" {as_it_is}.{also}",
        stream="actuators",
        value=other.log_ratio,
        fields=tuple(names),
        remedy=_remedy(log, other.best, thrusters, layout),
    )


def _words(item: TurnedOutputs, thrusters: Thrusters) -> str:
    """Return how outputs are joined, in the middle of a sentence."""
    numbers = [str(thrusters.outputs[place]) for place in (*item.backward, *item.exchanged)]
    if item.exchanged:
        return f"outputs {listed(numbers)} look exchanged"
    if not numbers:
        return "all outputs as they stand"
    several = len(numbers) > 1
    return f"output{'s' * several} {listed(numbers)} seem{'s' * (not several)} to act backward"


def _remedy(
    log: CheckedLog, item: TurnedOutputs, thrusters: Thrusters, layout: UnscaledLayout
) -> str:
    """Return what to change at the vehicle, and for this log in the vehicle file."""
    parameters = log.info.parameters
    if layout.source.startswith("CA_ROTOR"):
        return (
            "Run each motor by itself. If so, correct the functions and the reversed range of the"
            " outputs in PX4 (PWM_MAIN_FUNCn, PWM_MAIN_REV), or exchange wires. For this log give"
            " actuators.thrusters in the vehicle file."
        )
    if item.exchanged:
        functions = " and ".join(
            f"SERVO{thrusters.outputs[place]}_FUNCTION" for place in item.exchanged
        )
        vehicle = f"Run both motors one by one. If so, exchange {functions}, or the plugs, not both"
        change = "give outputs in the order of the rows"
    else:
        parts = []
        for place in item.backward:
            function = parameters.get(f"SERVO{thrusters.outputs[place]}_FUNCTION") or 0.0
            name = f"MOT_{MOTOR_OF_FUNCTION.get(function, place + 1)}_DIRECTION"
            logged = parameters.get(name)
            has = "" if logged is None else f" (the log has {logged:g})"
            parts.append(f"{name} to {-thrusters.direction[place]:.0f}{has}")
        vehicle = f"Run each motor by itself. If so, set {listed(parts)}, or exchange two wires"
        rows = listed([str(place + 1) for place in item.backward])
        change = f"turn the signs of row {rows}"
    if layout.frame is None:
        return f"{vehicle}. For this log {change} of actuators.thrusters in the vehicle file."
    return (
        f"{vehicle}. For this log give actuators.thrusters in the vehicle file (effect: a row X Y Z"
        f" K M N for each motor of the frame) and {change}."
    )
