"""Checks of the vehicle: arming, outputs, battery, response, firmware, identity."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array, Mask
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.answers import slow_answer
from auvid.hydro.identification.signals.signal_checks import (
    Response,
    clock_statistics,
    response_lag,
    without_drift,
)
from auvid.stages.columns import GYRO, LINEAR_VELOCITY
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    finding,
    limit,
    listed,
)
from auvid.stages.number_format import percent, significant

PULSES_US = (800.0, 2200.0)
PWM_LIMITS_US = (1100.0, 1900.0)
AT_LIMIT_US = 5.0
FULL_COMMAND = 0.99
ACTIVE_COMMAND = 0.02
LAGS_S = (-1.5, 2.5)
ANSWER_LAGS_S = np.arange(0.0, 2.6, 0.2)
SLOWEST_S, EQUALLY_WELL = 15.0, 0.05
"""Longest time constant of a hull, and by how much less of the motion it may explain
than commands that are early.
"""
RESPONSE_HZ = 20.0
SMALLEST_MOTION = 0.03
LIVELY_MOTION = 0.05
"""Standard deviation [m/s, rad/s] about its mean over 10 s of a motion that constant
forces do not make; a moored vehicle at full thrust stays below.
"""
LEAST_EXPLAINED = 0.6
DEPTH_RATE_S = 1.0
SIMULATOR = re.compile(r"^(SIM\d?|SIMSTATE|SIM_STATE|.*_groundtruth)$")
SEVERAL = re.compile(r"^several vehicles: ")
RECUT = "read although a router cut trailing zeros"
NUMBERS = re.compile(r"(\d+) [A-Z]")
CHECKSUM = re.compile(r"wrong checksum")
NEEDED = ("velocity", "attitude", "depth", "imu", "actuators")
DENSITIES_KG_M3 = (950.0, 1250.0)
"""Fresh water, warm, to brine."""
POUNDS = 2.2046
SURE_BELOW = 0.05
"""Part of the radius of a ball of the displaced water; trim errs by less."""
GYRATION_RADII, THRUSTER_RADII = (0.15, 4.0), 15.0
"""Bounds of radii of gyration and of thrusters' arms, in radii of a ball of the
displaced water: a torpedo of fifteen diameters has 0.19 and 3.1.
"""
MOTION_WORDS = {"u": "surge", "v": "sway", "w": "heave", "p": "roll", "q": "pitch", "r": "yaw"}


def missing_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield streams that the chain needs and the log lacks; a glider has its own."""
    if log.has("glider"):
        return
    for stream in NEEDED:
        if not log.has(stream):
            others = [item for item in log.others if item.stream == stream and item.refused]
            refused = [
                f"{item.source}: {item.refused}"
                for item in others
                if "navigation filter" not in str(item.refused)
            ]
            there = f" ({'; '.join(refused)})" if refused else ""
            yield finding(
                f"no_{stream}",
                f"Nothing in the log fills the stream {stream}{there}.",
                stream=stream,
            )
    if log.has("actuators") and not log.has("battery") and log.thrusters():
        yield finding(
            "no_battery",
            "The log has no battery voltage; thrust is not corrected for it.",
            stream="battery",
        )


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
    elif moving.any() and share < limit("little_actuation"):
        text = f"Outputs act in {percent(share)} of the samples only ({_active_span(log, moving)})."
        yield finding("little_actuation", text, stream="actuators", value=share)
    yield from _saturation(log)


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
                f"Output {name.split('_')[1]} lies from {low} to {high} us.",
                stream="actuators",
                value=share,
                fields=tuple(log.thrusters()),
            )
            return


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
    parts = []
    if log.thrusters():
        outputs = log.values("actuators", log.thrusters())
        parts.append(
            ((np.abs(outputs - NEUTRAL_US) > limit("no_actuation")) & (outputs > 0.0)).any(axis=1)
        )
    if log.commands():
        parts.append((np.abs(log.values("actuators", log.commands())) > ACTIVE_COMMAND).any(axis=1))
    if "propeller_rev_s" in log.tables["actuators"].column_names:
        parts.append(np.abs(log.column("actuators", "propeller_rev_s")) > 0.0)
    return np.any(parts, axis=0) if parts else None


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


def battery_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield voltage sag and an impossible current."""
    if not log.has("battery"):
        return
    volts = log.column("battery", "voltage_v")
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


def motions(log: CheckedLog) -> dict[str, tuple[Array, Array, str]]:
    """Return times (n,), values (n,) and source of each body velocity u v w p q r.

    The gyro is without its median.
    """
    by_axis: dict[str, tuple[Array, Array, str]] = {}
    if log.has("velocity"):
        for axis, name in zip("uvw", LINEAR_VELOCITY, strict=True):
            by_axis[axis] = (
                log.t_s("velocity"),
                log.column("velocity", name),
                log.source("velocity"),
            )
    elif log.has("depth"):
        t_s, depth = log.t_s("depth"), log.column("depth", "depth_m")
        inside = (t_s >= t_s[0] + DEPTH_RATE_S / 2.0) & (t_s <= t_s[-1] - DEPTH_RATE_S / 2.0)
        at = t_s[inside]
        ends = [np.interp(at + side * DEPTH_RATE_S / 2.0, t_s, depth) for side in (-1.0, 1.0)]
        if at.size:
            by_axis["w"] = (
                at,
                (ends[1] - ends[0]) / DEPTH_RATE_S,
                f"rate of depth ({log.source('depth')})",
            )
    if log.has("imu"):
        for axis, name in zip("pqr", GYRO, strict=True):
            rate = log.column("imu", name)
            if np.ptp(rate) == 0.0:
                continue  # no live sensor
            by_axis[axis] = (log.t_s("imu"), rate - np.median(rate), log.source("imu"))
    return by_axis


def responses(log: CheckedLog) -> dict[str, Response]:
    """Return how motion follows the outputs, per axis that they explain."""
    if not log.has("actuators") or log.under_water is False:
        return {}
    names = log.thrusters() + log.commands()
    clock = clock_statistics(log.t_s("actuators"))
    moving = activity(log)
    if (
        not names
        or clock is None
        or clock.rate_hz < limit("low_actuator_rate")
        or moving is None
        or not moving.any()
    ):
        return {}
    commands = np.nan_to_num(log.values("actuators", names))
    answers = {}
    for axis, (at, motion, _) in motions(log).items():
        if float(np.std(motion)) < SMALLEST_MOTION:
            continue
        response = response_lag(
            log.t_s("actuators"), commands, at, motion, lags_s=LAGS_S, rate_hz=RESPONSE_HZ
        )
        if (
            response is not None
            and response.explained >= limit("command_lag")
            and LAGS_S[0] < response.lag_s < LAGS_S[1]
        ):
            answers[axis] = response
    return answers


def command_lead(answers: Mapping[str, Response]) -> tuple[str, Response] | None:
    """Return the axis that answers best, if its motion comes before the outputs."""
    if not answers:
        return None
    axis = max(answers, key=lambda name: answers[name].explained)
    best = answers[axis]
    late = best.explained > LEAST_EXPLAINED and best.lag_s < -limit("command_late")
    return (axis, best) if late else None


def _slow(log: CheckedLog, axis: str) -> bool:
    """Return whether drag and inertia explain by themselves how late a motion comes."""
    at, motion, _ = motions(log)[axis]
    commands = np.nan_to_num(log.values("actuators", log.thrusters() + log.commands()))
    answer = slow_answer(log.t_s("actuators"), commands, at, motion, lags_s=ANSWER_LAGS_S)
    return (
        answer is not None
        and answer.time_constant_s < SLOWEST_S
        and answer.slow > answer.late - EQUALLY_WELL
    )


def response_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield how much later motion follows the outputs, per axis."""
    answers = responses(log)
    lead = command_lead(answers)
    if lead is not None:
        axis, best = lead
        yield finding(
            "command_late",
            f"{MOTION_WORDS[axis].capitalize()} moves {-best.lag_s:.2f} s before the outputs that"
            f" drive it ({percent(round(best.explained, 2))} explained): the outputs are stamped"
            " late, or the sensors early.",
            stream="actuators",
            value=-best.lag_s,
        )
    far = [axis for axis in answers if answers[axis].lag_s > limit("commands_early")]
    # One axis alone may be slow, or repeat within the shift.
    if len(far) > 1 and len(far) == len(answers):
        axis = max(far, key=lambda name: answers[name].explained)
        best = answers[axis]
        if best.explained > LEAST_EXPLAINED and not all(_slow(log, name) for name in far):
            yield finding(
                "commands_early",
                f"{MOTION_WORDS[axis].capitalize()} follows the outputs that drive it by"
                f" {best.lag_s:.2f} s ({percent(round(best.explained, 2))} explained), longer than"
                " thruster and hull take: the outputs are stamped early, or the sensors late.",
                stream="actuators",
                value=best.lag_s,
            )
    lags = []
    for axis, response in answers.items():
        how = (
            f"follows by {response.lag_s:.2f} s"
            if response.lag_s > 0.0
            else f"leads by {-response.lag_s:.2f} s (a controller answers it)"
        )
        lags.append(
            (
                response.explained,
                f"{MOTION_WORDS[axis]} {how}, {percent(round(response.explained, 2))} explained",
            )
        )
    if lags:
        text = f"Motion against outputs: {'; '.join(words for _, words in lags)}."
        yield finding("command_lag", text, stream="actuators", value=max(lags)[0])


def body_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield mass, displaced water and density of the vehicle file that do not fit."""
    vehicle = log.vehicle
    if vehicle is None:
        return
    density, water = vehicle.water_density, vehicle.displaced_mass_kg
    if not DENSITIES_KG_M3[0] < density < DENSITIES_KG_M3[1]:
        yield finding(
            "water_density",
            f"The vehicle file gives {density:g} kg/m^3 as water_density; no water has that.",
            value=density,
        )
        return
    yield from _sizes(vehicle)
    excess = vehicle.mass_kg / water - 1.0
    if abs(excess) > limit("weight_in_water"):
        newtons = (vehicle.mass_kg - water) * vehicle.gravity
        factor = max(vehicle.mass_kg / water, water / vehicle.mass_kg)
        pounds = " One of them is probably in pounds." if abs(factor / POUNDS - 1.0) < 0.1 else ""
        yield finding(
            "weight_in_water",
            f"The vehicle file gives a mass of {vehicle.mass_kg:g} kg and {water:g} kg of displaced"
            f" water: the vehicle would {'sink' if newtons > 0.0 else 'rise'} with"
            f" {abs(newtons):.0f} N.{pounds}",
            value=excess,
        )
    if vehicle.geometry is not None:
        hull = vehicle.geometry.hull
        volume = vehicle.geometry.integral(lambda x: np.pi * hull.radius_m(x) ** 2)
        ratio = water / (density * volume)
        if not 1.0 / (1.0 + limit("hull_volume")) < ratio < 1.0 + limit("hull_volume"):
            yield finding(
                "hull_volume",
                f"The hull of the vehicle file holds {1e3 * volume:.4g} l, and its displaced water"
                f" of {water:g} kg is {ratio:.2g} times that.",
                value=ratio,
            )


def _sizes(vehicle: Vehicle) -> Iterator[Finding]:
    """Yield gravity, inertia, centres and arms in a wrong unit or sign."""
    if abs(vehicle.gravity - STANDARD_GRAVITY) > limit("gravity_value"):
        yield finding(
            "gravity_value",
            f"The vehicle file gives {vehicle.gravity:g} m/s^2 as gravity.",
            value=vehicle.gravity,
        )
    volume = vehicle.displaced_mass_kg / vehicle.water_density
    radius = float(np.cbrt(0.75 * volume / np.pi))
    lever = float(np.linalg.norm(vehicle.r_B - vehicle.r_G))
    lengths = [("a distance of the centres of gravity and buoyancy", lever, 0.0, 1.0)]
    gyration = np.sqrt(np.abs(np.diag(vehicle.inertia)) / vehicle.mass_kg)
    if gyration.min() > 0.0:
        low, high = GYRATION_RADII
        lengths.append(("a smallest radius of gyration", float(gyration.min()), low, np.inf))
        lengths.append(("a largest radius of gyration", float(gyration.max()), 0.0, high))
    if vehicle.thrusters is not None:
        forces, moments = (
            np.linalg.norm(part, axis=0) for part in np.split(vehicle.thrusters.allocation, 2)
        )
        pushing = forces > 0.1  # others make a moment alone
        arm = float((moments[pushing] / forces[pushing]).max(initial=0.0))
        lengths.append(("a thruster's lever arm", arm, 0.0, THRUSTER_RADII))
    for words, length, low, high in lengths:
        if not low * radius <= length <= high * radius:
            yield finding(
                "body_size",
                f"The vehicle file gives {words} of {length:.3g} m; a ball of its displaced water"
                f" has a radius of {radius:.3g} m.",
                value=length / radius,
            )
    below = float(vehicle.r_B[2] - vehicle.r_G[2])
    if below > limit("buoyancy_low"):
        actuators = vehicle.document.actuators
        driven = actuators.propeller or actuators.fins or actuators.thrusters
        sure = driven is not None and below > SURE_BELOW * radius
        yield finding(
            "upside_down" if sure else "buoyancy_low",
            f"The centre of buoyancy of the vehicle file lies {below:.3g} m below its centre of"
            " gravity: at rest the vehicle would turn over.",
            value=below,
        )


def identity_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield findings on firmware, simulators, parameters, other vehicles."""
    info = log.info
    messages = sorted(name for name in info.counts if SIMULATOR.match(name))
    if messages:
        yield finding("simulated", f"The log holds messages of a simulator: {', '.join(messages)}.")
    firmware = info.vehicle
    if log.under_water is False:
        words = firmware or f"PX4 of another vehicle (MAV_TYPE {info.parameters['MAV_TYPE']:.0f})"
        yield finding("not_underwater", f"The firmware is {words}.")
    binary = any(not str(item.format).startswith("CSV") for item in info.files)
    if binary and firmware is None and log.under_water is None:
        yield finding("firmware_unknown", "No text of the log names the firmware.")
    if binary and log.thrusters() and log.under_water is not False:
        expected = (
            "FRAME_CONFIG",
            *(f"MOT_{name.split('_')[1]}_DIRECTION" for name in log.thrusters()),
        )
        missing = [name for name in expected if name not in info.parameters]
        if missing:
            words = (
                f"{missing[0]} and {len(missing) - 1} directions"
                if len(missing) > 2
                else listed(missing)
            )
            text = f"Not in the log: {words} ({len(info.parameters)} parameters are)."
            yield finding("parameters_missing", text, stream="actuators", value=len(missing))
    for note in info.notes:
        if SEVERAL.match(note):
            yield finding(
                "several_vehicles", f"{note[0].upper()}{note[1:]}.", value=note.count(" messages)")
            )
        elif CHECKSUM.search(note):
            yield finding("wrong_checksum", f"{note[0].upper()}{note[1:]}.")
    recut = [note for note in info.notes if RECUT in note]
    if recut:
        parts = [(note.split(": ")[0], note.split(": ")[-1]) for note in recut]
        count = sum(int(digits) for _, types in parts for digits in NUMBERS.findall(types))
        types_lost = "; ".join(f"{types} of {sender}" for sender, types in parts)
        yield finding(
            "recut_messages",
            f"{count} messages lost trailing zeros in a router and are read all the same"
            f" ({types_lost}).",
            value=count,
        )
