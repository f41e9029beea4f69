"""Checks of arming, outputs and battery."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Mask
from auvid.hydro.dynamics.vehicle.logged_directions import MOTOR_OF_FUNCTION
from auvid.hydro.identification.checks.motion_checks import response_gains
from auvid.hydro.identification.checks.response import without_drift
from auvid.stages.columns import FINS
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS, motions
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    finding,
    finite,
    limit,
    listed,
)
from auvid.stages.number_format import percent, significant

PULSES_US = (800.0, 2200.0)
PWM_LIMITS_US = (1100.0, 1900.0)
AT_LIMIT_US = 5.0
PULSES = re.compile(r"pwm_(\d+)_us$")
FULL_COMMAND = 0.99
ACTIVE_COMMAND = 0.02
LIVELY_MOTION = 0.05
"""Standard deviation [m/s, rad/s] about its mean over 10 s of a motion that constant
forces do not make; a moored vehicle at full thrust stays below.
"""
CHANGES_SHARE = 0.3
"""A thruster changes so often at least beside the median of the others; a camera that tilts
does not.
"""
LEAST_PUSHED, SURE_PUSH = 0.02, 10.0
"""Least share of a motion's change that outputs explain beside the thrusters, and that share
for each of them over what chance gives one.
"""
LONGER_RUN, SETTLED_S = 5.0, 5.0
"""A record that froze is so many times as long as any other run of equal outputs; a vehicle
settles at a new force within the time.
"""


def actuation_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield findings on arming, activity and saturation of the outputs."""
    armed = _armed(log)
    if armed is False:
        yield finding(
            "never_armed",
            "The vehicle is disarmed from the first to the last record.",
            stream="mode",
        )
    if not log.has("actuators") or log.under_water is False:
        return
    moving = activity(log)
    if moving is None:
        return
    yield from _no_pulses(log)
    share = float(np.mean(moving))
    if not moving.any() and armed is not False:
        yield finding(
            "no_actuation",
            f"{_idle(log)}: the vehicle was not armed, or not driven.",
            stream="actuators",
            value=_largest(log),
        )
    elif moving.any() and (still := _resting_outputs(log)):
        yield _never_changing(log, still)
    elif frozen := _frozen(log, moving):
        yield frozen
    elif moving.any() and share < limit("little_actuation"):
        text = f"Outputs act in {percent(share)} of the samples only ({_active_span(log, moving)})."
        yield finding("little_actuation", text, stream="actuators", value=share)
    yield from _saturation(log)
    yield from _without_thruster(log, moving)


def _without_thruster(log: CheckedLog, moving: Mask) -> Iterator[Finding]:
    """Yield outputs that act as thrusters do and have none in the vehicle file."""
    vehicle = log.vehicle
    if vehicle is None or vehicle.thrusters is None or vehicle.document.actuators.fins:
        return
    lacking: list[str] = []
    usual = float(np.median([float(_changes(log, name)) for name in log.thrusters()] or [np.inf]))
    for name in log.tables["actuators"].column_names:
        number = PULSES.match(name)
        if number is None or int(number[1]) in vehicle.thrusters.outputs:
            continue
        function = log.info.parameters.get(f"SERVO{number[1]}_FUNCTION")
        if function is not None and function not in MOTOR_OF_FUNCTION:
            continue  # lights, camera, gripper
        offset = log.column("actuators", name) - NEUTRAL_US
        acts = (np.abs(offset) > limit("no_actuation")) & (offset > -NEUTRAL_US) & moving
        shares = [float(np.sum(acts & (sign * offset > 0.0))) for sign in (-1.0, 1.0)]
        often = _changes(log, name) > CHANGES_SHARE * usual
        if often and min(shares) > limit("output_unnamed") * float(np.sum(moving)):
            lacking.append(number[1])
    if lacking and (driven := _driven_by(log, [f"pwm_{number}_us" for number in lacking])):
        several = len(lacking) > 1
        of_csv = all(str(item.format).startswith("CSV") for item in log.info.files)
        yield finding(
            "output_unnamed",
            f"{'Outputs' if several else 'Output'} {listed(lacking)} of the log"
            f" {'push' if several else 'pushes'} both ways as thrusters do,"
            f" {MOTION_WORDS[driven]} answers {'them' if several else 'it'}, and the vehicle file"
            f" ({vehicle.title}) has no thruster there.",
            stream="actuators",
            value=float(len(lacking)),
            remedy=""
            if of_csv
            else "Take the file of this vehicle, or give its thrusters (actuators.thrusters:"
            " position, axis, outputs) a row for each output.",
        )


def _driven_by(log: CheckedLog, names: list[str]) -> str:
    """Return the motion that outputs push most beside the thrusters, or nothing.

    Lights and a camera that tilts push none.
    """
    t_s = log.t_s("actuators")
    named = finite(log.values("actuators", log.thrusters()))
    both = np.column_stack([named, np.nan_to_num(log.values("actuators", names))])
    best, axis_of_best = 0.0, ""
    for axis, (at, motion, _) in motions(log).items():
        fits = [response_gains(t_s, pulses, at, motion) for pulses in (named, both)]
        less, more = fits
        if less is None or more is None:
            continue
        gained = more.explained - less.explained
        left = (1.0 - more.explained) / max(more.count - both.shape[1], 1)
        if gained > max(LEAST_PUSHED, SURE_PUSH * len(names) * left) and gained > best:
            best, axis_of_best = gained, axis
    return axis_of_best


def _changes(log: CheckedLog, name: str) -> int:
    """Return how often an output changes."""
    return int(np.count_nonzero(np.diff(log.column("actuators", name))))


def _never_changing(log: CheckedLog, still: str) -> Finding:
    """Return what outputs that never change mean, by the motion."""
    text = f"No output changes from the first to the last sample{still}"
    changes = {
        axis: float(np.std(without_drift(motion, at)))
        for axis, (at, motion, _) in motions(log).items()
        if at.size > 1
    }
    axis = max(changes, key=lambda name: changes[name], default="")
    if not axis or changes[axis] > LIVELY_MOTION:
        return finding(
            "outputs_held",
            f"{text}: they are set points, or their record froze.",
            stream="actuators",
            value=0.0,
        )
    return finding(
        "outputs_constant",
        f"{text}, and the vehicle moves as steadily: {MOTION_WORDS[axis]}, which changes most, by"
        f" {significant(changes[axis])} {'m/s' if axis in 'uvw' else 'rad/s'} (standard"
        " deviation).",
        stream="actuators",
        value=changes[axis],
    )


def _frozen(log: CheckedLog, moving: Mask) -> Finding | None:
    """Return outputs that stop changing, while the vehicle goes on as under others."""
    there = log.tables["actuators"].column_names
    others = [name for name in ("propeller_rev_s", *FINS) if name in there]
    names, t_s = [*log.thrusters(), *log.commands(), *others], log.t_s("actuators")
    if len(t_s) < 2 or not names:
        return None
    changes = np.any([np.diff(log.column("actuators", name)) != 0.0 for name in names], axis=0)
    same = np.append(False, ~changes)
    ends = np.flatnonzero(~np.append(same[1:], False))  # the last sample of each run
    begins = np.append(0, ends[:-1] + 1)
    lengths = t_s[ends] - t_s[begins]
    longest = int(np.argmax(lengths))
    rest = np.delete(lengths, longest)
    start, end = t_s[begins[longest]], t_s[ends[longest]]
    usual = float(rest.max()) if rest.size else np.inf
    if lengths[longest] <= max(limit("outputs_frozen"), LONGER_RUN * usual):
        return None
    if not moving[begins[longest]]:
        return None
    changes = {
        axis: float(np.std(without_drift(motion, at)[(at >= start + SETTLED_S) & (at <= end)]))
        for axis, (at, motion, _) in motions(log).items()
        if np.count_nonzero((at >= start + SETTLED_S) & (at <= end)) > 1
    }
    axis = max(changes, key=lambda name: changes[name], default="")
    if not axis or changes[axis] < LIVELY_MOTION:
        return None
    return finding(
        "outputs_frozen",
        f"No output changes from {start:.1f} to {end:.1f} s, after runs of {usual:.1f} s at most,"
        f" and {MOTION_WORDS[axis]} goes on changing by {significant(changes[axis])}"
        f" {'m/s' if axis in 'uvw' else 'rad/s'} (standard deviation).",
        stream="actuators",
        value=float(end - start),
        at_s=float(start),
    )


def _resting_outputs(log: CheckedLog) -> str:
    """Return at what the outputs stand all log long, or nothing where one moves."""
    names = [*log.thrusters(), *log.commands()]
    values = log.values("actuators", names) if names else np.zeros((0, 0))
    moves = not values.size or np.ptp(values, axis=0).any()
    others = set(log.tables["actuators"].column_names) - {"time_us", "row", *names}
    return "" if moves or others else f" (output {names[0].split('_')[1]} at {values[0, 0]:g})"


def _no_pulses(log: CheckedLog) -> Iterator[Finding]:
    for name in log.thrusters():
        output = log.column("actuators", name)
        outside = (output != 0.0) & ((output < PULSES_US[0]) | (output > PULSES_US[1]))
        share = float(np.mean(outside))
        if share > limit("output_range"):
            low, high = (significant(float(value)) for value in np.percentile(output, (1, 99)))
            yield finding(
                "output_range",
                f"Output {name.split('_')[1]} lies from {low} to {high} us"
                f"{_in_other_unit(float(np.median(output)))}.",
                stream="actuators",
                value=share,
                fields=tuple(log.thrusters()),
            )
            return


def _in_other_unit(middle: float) -> str:
    """Return which unit pulses about a number have, if they are pulses."""
    for factor, unit in ((1e3, "ms"), (1e-3, "ns")):
        if PULSES_US[0] <= factor * middle <= PULSES_US[1]:
            return f": the pulses are in {unit}"
    return ""


def _armed(log: CheckedLog) -> bool | None:
    """Return whether the vehicle was ever armed; None if the log does not say."""
    if not log.has("mode") or "armed" not in log.tables["mode"].column_names:
        return None
    states = [state for state in log.tables["mode"]["armed"].to_pylist() if state is not None]
    return any(states) if states else None


def activity(log: CheckedLog) -> Mask | None:
    """Return the samples (n,) of the actuators in which any of them acts.

    A thruster acts where its output left the dead band. None without any column.
    """
    acts: Mask | None = None
    for name in (*log.thrusters(), *log.commands(), "propeller_rev_s"):
        if name not in log.tables["actuators"].column_names:
            continue
        values = log.column("actuators", name)
        if name in log.thrusters():
            own = (np.abs(values - NEUTRAL_US) > limit("no_actuation")) & (values > 0.0)
        else:
            own = np.abs(values) > (0.0 if name == "propeller_rev_s" else ACTIVE_COMMAND)
        acts = own if acts is None else acts | own
    return acts


def _largest(log: CheckedLog) -> float:
    outputs = log.values("actuators", log.thrusters()) if log.thrusters() else np.zeros((1, 1))
    return float(np.nanmax(np.abs(np.where(outputs > 0.0, outputs - NEUTRAL_US, 0.0))))


def _idle(log: CheckedLog) -> str:
    if not log.thrusters():
        return "Every command is zero"
    return (
        f"Outputs {_numbers(log.thrusters())} stay within {_largest(log):.0f} us of"
        f" {NEUTRAL_US:.0f} us"
    )


def _numbers(names: list[str]) -> str:
    numbers = [int(name.split("_")[1]) for name in names]
    return (
        f"{numbers[0]} to {numbers[-1]}"
        if numbers == list(range(numbers[0], numbers[-1] + 1)) and len(numbers) > 1
        else ", ".join(map(str, numbers))
    )


def _active_span(log: CheckedLog, moving: Mask) -> str:
    at = log.t_s("actuators")[moving]
    return f"between {at[0]:.1f} and {at[-1]:.1f} s"


def _saturation(log: CheckedLog) -> Iterator[Finding]:
    parameters = log.info.parameters
    low, high = (
        parameters.get(key) or usual
        for key, usual in zip(("MOT_PWM_MIN", "MOT_PWM_MAX"), PWM_LIMITS_US, strict=True)
    )
    shares = []
    for name in log.thrusters():
        output = log.column("actuators", name)
        at_limit = (output > 0.0) & ((output <= low + AT_LIMIT_US) | (output >= high - AT_LIMIT_US))
        shares.append((float(np.mean(at_limit)), f"output {name.split('_')[1]}"))
    for name in log.commands():
        at_limit = np.abs(log.column("actuators", name)) >= FULL_COMMAND
        shares.append((float(np.mean(at_limit)), name.replace("_", " ")))
    beyond = [
        (share, name)
        for share, name in sorted(shares, reverse=True)
        if share > limit("outputs_saturated")
    ]
    if beyond:
        text = (
            "At the limit:"
            f" {listed([f'{name} in {percent(share)} of the samples' for share, name in beyond])}."
        )
        yield finding("outputs_saturated", text, stream="actuators", value=beyond[0][0])


def _curve_voltage(log: CheckedLog, volts: float) -> Iterator[Finding]:
    thrusters = log.vehicle and log.vehicle.thrusters
    curve = thrusters.curve if thrusters else None
    if curve is None or not curve.voltage_exponent:
        return
    off = volts / curve.voltage_v - 1.0
    if abs(off) < limit("curve_voltage"):
        return
    scale = max(volts, 0.0) / curve.voltage_v
    yield finding(
        "curve_voltage",
        f"The battery has {volts:.1f} V (median), and the thrust curve of the vehicle file is that"
        f" of {curve.voltage_v:.1f} V: all thrust is multiplied by"
        f" {scale**curve.voltage_exponent:.2f}, and damping with it.",
        stream="battery",
        value=off,
    )


def battery_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield voltages that sag, or that are not those of the thrust, and currents."""
    if not log.has("battery"):
        return
    volts = log.column("battery", "voltage_v")
    yield from _curve_voltage(log, float(np.nanmedian(volts)))
    low, high = np.percentile(volts, (1.0, 95.0))
    if high > 0.0 and 1.0 - low / high > limit("battery_sag"):
        text = (
            f"The battery sags from {high:.2f} V (95th percentile) to {low:.2f} V (1st percentile)."
        )
        yield finding("battery_sag", text, stream="battery", value=float(1.0 - low / high))
    if "current_a" in log.tables["battery"].column_names:
        amperes = log.column("battery", "current_a")
        current = (
            float(np.median(amperes[np.isfinite(amperes)])) if np.isfinite(amperes).any() else 0.0
        )
        if current < limit("battery_current"):
            yield finding(
                "battery_current",
                f"The median current is {current:.1f} A.",
                stream="battery",
                value=current,
            )
