"""Checks of the vehicle: streams, vehicle file, firmware, identity."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import numpy as np

from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.dynamics.actuators.thrusters import thruster_forces
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.columns import FINER_FIXES, TOO_COARSE
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

SIMULATOR = re.compile(r"^(SIM\d?|SIMSTATE|SIM_STATE|.*_groundtruth)$")
SEVERAL = re.compile(r"^several vehicles: ")
RECUT = "read although a router cut trailing zeros"
NUMBERS = re.compile(r"(\d+) [A-Z]")
CHECKSUM = re.compile(r"wrong checksum")
NEEDED = ("velocity", "attitude", "depth", "imu", "actuators")
DENSITIES_KG_M3 = (950.0, 1250.0)
"""Fresh water, warm, to brine."""
POUNDS = 2.2046
MASS_UNITS: Mapping[float, str] = {
    1e3: "in g",
    1e-3: "in t",
    POUNDS: "in lb",
    1.0 / POUNDS: "turned from lb to kg twice",
}
"""By how many times a mass is too large in another unit."""
SURE_BELOW = 0.05
"""Part of the radius of a ball of the displaced water; trim errs by less."""
FIRST_TURN = 3
ADDED_NAMES = ("X_udot", "Y_vdot", "Z_wdot", "K_pdot", "M_qdot", "N_rdot")
SENSOR_RADII = 20.0
"""Largest arm of a sensor in the same radii; centimetres are 100 times off, mm 1000 times."""
GYRATION_RADII, LARGEST_OF_SMALLEST, THRUSTER_RADII = (0.15, 4.0), 1.5, 15.0
"""Bounds of radii of gyration and of thrusters' arms, in radii of a ball of the
displaced water: a torpedo of fifteen diameters has 0.19 and 3.1. The smallest one of
seventeen vehicles and published sets is 0.3 to 1.2, but for one set of 3.8.
"""

LEAST_LARGEST = 0.45
"""Of the largest radius of gyration; a ball of one density has 0.63, its heavy core less."""
ADDED_ACROSS, LEAST_OF_SLENDER, MOST_AHEAD = (0.25, 8.0), 0.6, 4.0
"""Bounds of the added mass of sway and heave, of slender hulls, and of surge, as parts of
the displaced mass: a sphere has 0.5, a long cylinder 1; 25 vehicles 0.49 to 6.9.
"""
SLENDER, MOST_OF_TURNS = 5.0, 4.5
"""Length over diameter of a slender hull, and most added inertia of pitch and yaw as a
part of the inertia; 14 vehicles have up to 2.2.
"""
THRUST_OF_WEIGHT, PULSES_US = (0.005, 5.0), (1100.0, 1900.0, 41)
"""Most force of a thruster over the weight of the displaced water, .05 to 1 in six vehicle
files, and first, last and number of the pulses at which it is sought.
"""
LEAST_OF_LENGTH = 0.5
"""Most inertia about the length of a slender hull as a part of that across: .02 to .05 of three
torpedoes.
"""
LONGEST_LAG_S = 5.0
SHORTEST_PULSE_US, LONGEST_PULSE_US = 800.0, 2200.0
LEAST_PLACE, FEWEST_THRUSTERS = 0.5, 3
"""Of the distance of the outermost of three thrusters or more, which sit outside the hull."""


def missing_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield streams that the chain needs and the log lacks; a glider has its own.

    A body that nothing drives needs no actuators.
    """
    if log.has("glider"):
        return
    driven = log.vehicle is None or log.vehicle.is_driven
    for stream in NEEDED:
        if not log.has(stream) and (driven or stream != "actuators"):
            others = [item for item in log.others if item.stream == stream and item.refused]
            refused = [
                f"{item.source}: {item.refused}"
                for item in others
                if "navigation filter" not in str(item.refused)
            ]
            there = f" ({'; '.join(refused)})" if refused else ""
            coarse = [note for note in log.info.notes if TOO_COARSE in note]
            if stream == "velocity" and coarse:
                there = f": {coarse[0].partition('. ')[0]}"
            yield finding(
                f"no_{stream}",
                f"The log has no data for the stream {stream}{there}.",
                stream=stream,
                remedy=FINER_FIXES if stream == "velocity" and coarse else "",
            )
    if log.has("actuators") and not log.has("battery") and log.thrusters():
        yield finding(
            "no_battery",
            "The log has no battery voltage; thrust is not corrected for it.",
            stream="battery",
        )


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
    yield from _curve_range(log)
    yield from _sizes(vehicle)
    yield from _added_mass(vehicle)
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


def _curve_range(log: CheckedLog) -> Iterator[Finding]:
    """Yield a thrust curve over other numbers than pulses, which the outputs are."""
    entry = log.vehicle and log.vehicle.document.actuators.thrusters
    if not entry or entry.thrust_curve is None or not log.thrusters():
        return
    over = entry.thrust_curve.pulse_width.array
    if float(over.max()) > SHORTEST_PULSE_US and float(over.min()) < LONGEST_PULSE_US:
        return
    cause = ": it is in ms" if 0.5 < float(over.min()) < float(over.max()) < 3.0 else ""
    yield finding(
        "curve_range",
        f"The thrust curve of the vehicle file is given over {over.min():g} to {over.max():g} us,"
        f" where no pulse of an output is{cause}.",
        stream="actuators",
        value=float(over.max()),
        fields=log.thrusters(),
    )


def other_masses(vehicle: Vehicle) -> dict[str, Vehicle]:
    """Return the vehicle with masses that a file may have meant, by what is wrong."""
    mass, water = vehicle.mass_kg, vehicle.displaced_mass_kg
    others = {
        f"mass is {_times(mass / water)}": (water, water),
        f"displaced_mass is {_times(water / mass)}": (mass, mass),
    }
    for factor in MASS_UNITS:
        both = mass / factor, water / factor
        others[f"mass and displaced_mass are both {_times(factor)}"] = both
    return {words: _with_masses(vehicle, *masses) for words, masses in others.items()}


def _with_masses(vehicle: Vehicle, mass_kg: float, water_kg: float) -> Vehicle:
    document = vehicle.document.model_dump(mode="python", exclude_none=True)
    for name, value in (("mass", mass_kg), ("displaced_mass", water_kg)):
        document["rigid_body"][name] |= {"value": value, "unit": "kg"}
    return vehicle_from_document(document)


def _times(factor: float) -> str:
    """Return by how much a mass is off, and in which unit it may be."""
    unit = next((words for of, words in MASS_UNITS.items() if abs(factor / of - 1.0) < 0.1), "")
    off = f"{max(factor, 1.0 / factor):.4g} times too {'large' if factor > 1.0 else 'small'}"
    return f"about {off}{f' ({unit})' if unit else ''}"


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
        lengths.append(
            ("a smallest radius of gyration", float(gyration.min()), low, LARGEST_OF_SMALLEST)
        )
        lengths.append(("a largest radius of gyration", float(gyration.max()), LEAST_LARGEST, high))
    if vehicle.thrusters is not None:
        forces, moments = (
            np.linalg.norm(part, axis=0) for part in np.split(vehicle.thrusters.allocation, 2)
        )
        pushing = forces > 0.1  # others make a moment alone
        arm = float((moments[pushing] / forces[pushing]).max(initial=0.0))
        lengths.append(("a thruster's lever arm", arm, 0.0, THRUSTER_RADII))
    entry = vehicle.document.actuators.thrusters
    if entry is not None and entry.position is not None:
        places = np.linalg.norm(entry.position.array, axis=1)
        if places.size >= FEWEST_THRUSTERS:
            words = "a largest distance of the thrusters from the origin"
            lengths.append((words, float(places.max()), LEAST_PLACE, np.inf))
    for words, place in (("velocity log", vehicle.dvl.arm_m), ("IMU", vehicle.imu.arm_m)):
        lengths.append((f"an arm of the {words}", float(np.linalg.norm(place)), 0.0, SENSOR_RADII))
    for words, length, low, high in lengths:
        if not low * radius <= length <= high * radius:
            light = length > high * radius and "smallest" in words
            cause = " Mass and displaced mass may be in pounds twice." if light else ""
            yield finding(
                "body_size",
                f"The vehicle file gives {words} of {length:.3g} m; a ball of its displaced water"
                f" has a radius of {radius:.3g} m.{cause}",
                value=length / radius,
            )
    yield from _slender_inertia(vehicle)
    yield from _thrust_and_lag(vehicle)
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


def _slender_inertia(vehicle: Vehicle) -> Iterator[Finding]:
    """Yield a slender hull whose inertia about its length is not the smallest one."""
    geometry = vehicle.geometry
    if geometry is None or geometry.hull.length_m < SLENDER * geometry.hull.diameter_m:
        return
    about = np.diag(vehicle.inertia)
    if not about.min() or about[0] < LEAST_OF_LENGTH * about[1:].min():
        return
    axis = "yz"[int(np.argmin(about[1:]))]
    yield finding(
        "body_size",
        f"The hull of the vehicle file is {geometry.hull.length_m:.3g} m long and"
        f" {geometry.hull.diameter_m:.3g} m thick, and its inertia about its length (x) is"
        f" {about[0]:.3g} kg m^2, about {axis} {about[1:].min():.3g}: they are exchanged.",
        value=float(about[0] / about[1:].min()),
        fields=(),
    )


def _thrust_and_lag(vehicle: Vehicle) -> Iterator[Finding]:
    """Yield a thrust and a lag in another unit."""
    weight, low, high = vehicle.displaced_mass_kg * vehicle.gravity, *THRUST_OF_WEIGHT
    if vehicle.thrusters is not None:
        count = vehicle.thrusters.allocation.shape[1]
        pulses = np.repeat(np.linspace(*PULSES_US)[:, None], count, axis=1)
        most = float(np.abs(thruster_forces(vehicle.thrusters, pulses)).max())
        if most and not low * weight <= most <= high * weight:
            yield finding(
                "body_size",
                f"The strongest thruster of the vehicle file gives {most:.3g} N at most; its"
                f" displaced water weighs {weight:.3g} N. The thrust curve is in another unit.",
                value=most / weight,
            )
    if abs(vehicle.dvl.lag_s) > LONGEST_LAG_S:
        yield finding(
            "body_size",
            f"The vehicle file gives a lag of the velocity log of {vehicle.dvl.lag_s:g} s; sensors"
            " take tenths of a second. It may be in ms.",
            value=vehicle.dvl.lag_s,
        )


def _added_mass(vehicle: Vehicle) -> Iterator[Finding]:
    """Yield added mass that no body of the displaced water has; 0 is one not given."""
    added, water = np.abs(np.diag(vehicle.added_mass)), vehicle.displaced_mass_kg
    low, high = ADDED_ACROSS
    geometry = vehicle.geometry
    if geometry is not None and geometry.hull.length_m > SLENDER * geometry.hull.diameter_m:
        low = LEAST_OF_SLENDER
    bounds = [(0, 0.0, MOST_AHEAD * water), (1, low * water, high * water)]
    bounds += [(2, low * water, high * water)]
    bounds += [(axis, 0.0, MOST_OF_TURNS * vehicle.inertia[axis - 3, axis - 3]) for axis in (4, 5)]
    off = [
        (axis, least, most)
        for axis, least, most in bounds
        if added[axis] and not least <= added[axis] <= most
    ]
    if not off:
        return
    parts = [
        f"{ADDED_NAMES[axis]} of {-added[axis]:.3g} {'kg' if axis < 3 else 'kg m^2'}, where"
        f" {least:.2g} to {most:.2g} is possible"
        for axis, least, most in off
    ]
    yield finding(
        "added_mass_size",
        f"The vehicle file gives an added mass {listed(parts)} (by its displaced water of"
        f" {water:g} kg and its inertia).{_or_inertia(vehicle, [axis for axis, *_ in off])}",
        value=float(added[off[0][0]] / water),
    )


def _or_inertia(vehicle: Vehicle, off: list[int]) -> str:
    """Return that the inertia may be too small, where added inertia alone is too large.

    Radii of gyration of body and added mass tell a person which of them is off.
    """
    if min(off) < FIRST_TURN:
        return ""
    added, inertia = np.abs(np.diag(vehicle.added_mass)), np.diag(vehicle.inertia)
    parts = [
        f"{np.sqrt(inertia[axis - FIRST_TURN] / vehicle.mass_kg):.2g} m and"
        f" {np.sqrt(added[axis] / added[across]):.2g} m about {'xyz'[axis - FIRST_TURN]}"
        for axis, across in ((4, 2), (5, 1))
        if axis in off and added[across] > 0.0
    ]
    radii = f": radii of gyration of body and added mass are {listed(parts)}" if parts else ""
    return f" Or its inertia is too small{radii}."


GUESSED_GLIDER = (
    "Put mass, density of the water that it is neutral in, reference_area, lift_slope and"
    " induced_drag of your glider into the vehicle file, with their spreads, and delete its line"
    " `guessed`, or begin again with --vehicle."
)


def identity_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield findings on firmware, simulators, parameters and guessed vehicles."""
    info = log.info
    if log.vehicle is not None and log.vehicle.document.guessed:
        text = f"The vehicle file is that of {log.vehicle.title}, a guess:"
        yield finding(
            "vehicle_guessed",
            f"{text} {log.vehicle.document.guessed}.",
            remedy=GUESSED_GLIDER if log.vehicle.document.glider is not None else "",
        )
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
