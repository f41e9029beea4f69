"""Where markers of poses or a velocity log sit, by all legs, and what departs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from auvid.data_schemas.records.motion import InstallationFigure
from auvid.hydro.arrays import AXES, VELOCITIES, Array, cross, runs_of
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.quantities import FitQuantity
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, WEAK
from auvid.hydro.identification.signals.installation import CERTAIN, departure_verdict
from auvid.hydro.identification.signals.pose.marker_arm import TurningLeg, marker_arm
from auvid.stages.fit_axes.fitted import ArmChoice, FittedAxis, Markers
from auvid.stages.fit_axes.flight import LegData
from auvid.stages.leg_record.motion import POSES, VELOCITY_LOG
from auvid.stages.page.first_screen import AXIS_WORDS

LIMITS_M = (0.02, 0.02, 0.05)
"""A departure from a measured arm counts beyond these and three standard errors: down, the
centre of the added mass is no better known."""
LEAST_ASSUMED_M = 0.02
"""The same from an assumed arm, in every direction; an estimated one has no limit."""
LARGEST_ERROR_M = 0.1
"""Standard error up to which an arm is determined."""
LARGEST_M = 2.0
"""Size of a departure that no vehicle has, where the vehicle file has no length of its hull."""
DOUBT_M = 0.5
"""Largest deviation of an arm that nothing shows: sensors sit on the hull."""
NAMES = ("arm forward", "arm right", "arm down")
POSE_MOTION_SD = 0.01
"""Relative deviation of what motion by poses gives, beside its noise: the smoother passes
what is slow, and takes of drag by .5 to 2.1 % in twenty tanks (decision 0032).
"""
SLOWEST_SHARE = 3.0
"""Largest factor by which smoothing makes a time constant long."""
SENSORS = {POSES: "pose", VELOCITY_LOG: "dvl"}
"""What measures a velocity -> its key among the sensors of the vehicle file."""
STEADY = "steady speed"
"""Begin of the names of quantities that no time is in."""
WORTH_WORDS = 0.05
"""Relative deviation by smoothing from which a sentence says so."""
REACHES = ("YZN", "XZN", "XY")
"""Axes whose fits a wrong arm forward, right and down reaches."""


def markers_of(
    legs: Mapping[str, LegData], vehicle: Vehicle, *, place: ArmChoice = "file"
) -> Markers | None:
    """Return where the markers or the velocity log sit; None where no leg has either.

    place: whether the motion has the arm of the file, the one that legs show, or that of
    legs `where_assumed`: where the file has none, or one that nobody measured.
    """
    sensor = next((name for leg in legs.values() for name in SENSORS if _of(leg, name)), None)
    turning = [part for leg in legs.values() if _of(leg, sensor) for part in _turning(leg)]
    if sensor is None or not turning:
        return None
    mounted = vehicle.markers if sensor == POSES else vehicle.dvl
    entry = vehicle.document.sensors.pose if sensor == POSES else vehicle.document.sensors.dvl
    written = None if entry is None else entry.arm
    used = place == "estimated" or (
        place == "where_assumed" and (written is None or written.assumed)
    )
    arm = marker_arm(turning, vehicle.mass_matrix)
    in_file = np.zeros(3) if mounted is None else mounted.arm_m
    limits = np.array(LIMITS_M)
    if used:
        limits = np.full(3, 0.0 if place == "estimated" else LEAST_ASSUMED_M)
    shape = vehicle.geometry
    largest = LARGEST_M if shape is None else shape.hull.length_m
    figures = []
    for at, name in enumerate(NAMES):
        value, sd = float(arm.departure[at]), float(arm.standard_error[at])
        determined = sd <= LARGEST_ERROR_M and abs(value) <= largest
        departs = determined and abs(value) > max(CERTAIN * sd, limits[at])
        verdict = "departs" if departs else departure_verdict(value, sd, LIMITS_M[at])
        if not determined:
            verdict = "not observable"
        in_axis = float(in_file[at])
        figures.append(
            InstallationFigure(
                name=name,
                unit="m",
                departure=value,
                standard_error=sd if np.isfinite(sd) else None,
                limit=LIMITS_M[at],
                verdict=verdict,
                file_value=in_axis,
                corrected=in_axis + value if departs else None,
            )
        )
    return Markers(tuple(figures), sensor, written is not None, used)


def at_origin(legs: Mapping[str, LegData], sensor: str, departure: Array) -> dict[str, LegData]:
    """Return legs whose velocity of a sensor is v - omega x departure."""
    out = {}
    for key, leg in legs.items():
        rate = leg.record.rate
        if _of(leg, sensor):
            omega = np.column_stack([rate[name] for name in VELOCITIES[3:]])
            moved = cross(omega, np.broadcast_to(departure, omega.shape))
            own = {name: rate[name] - moved[:, at] for at, name in enumerate(VELOCITIES[:3])}
            leg = replace(leg, record=replace(leg.record, rate={**rate, **own}))
        out[key] = leg
    return out


def arm_doubts(
    legs: Mapping[str, LegData], markers: Markers | None
) -> dict[str, dict[str, AxisRecord]]:
    """Return legs with each component of an arm that they show one deviation off.

    Of one that departs it is the standard error; what is not applied counts in full, up to
    `DOUBT_M`. A component that nothing turns about moves nothing.
    """
    if markers is None or not markers.used:
        return {}
    out = {}
    for place, item in enumerate(markers.figures):
        if item.standard_error is None:
            continue
        applied = item.verdict == "departs"
        sd = item.standard_error
        if not applied:
            sd = min(float(np.hypot(sd, item.departure)), DOUBT_M)
        moved = at_origin(legs, markers.sensor, sd * np.eye(3)[place])
        out[item.name] = {key: leg.record for key, leg in moved.items()}
    return out


def doubted(item: FittedAxis, markers: Markers | None) -> FittedAxis:
    """Return an axis, at best weak where a wrong arm reaches its motion."""
    if markers is None or markers.used:
        return item
    reached = {
        axis
        for figure, axes in zip(markers.figures, REACHES, strict=True)
        for axis in axes
        if figure.verdict == "departs"
    }
    if item.axis not in reached:
        return item
    verdicts = {
        name: WEAK if word == IDENTIFIED else word for name, word in item.equation.verdicts.items()
    }
    return replace(item, equation=replace(item.equation, verdicts=verdicts))


def by_poses(item: FittedAxis, legs: Mapping[str, LegData]) -> FittedAxis:
    """Return an axis with the error of a motion by poses in its intervals.

    All but the constant err together by `POSE_MOTION_SD` of their value: P + d d', d = s x.
    """
    if all(leg.record.measured_by.get(item.axis) != POSES for leg in legs.values()):
        return item
    equation = item.equation
    shift = POSE_MOTION_SD * np.array(
        [
            0.0 if name == CONSTANT else value
            for name, value in zip(equation.names, equation.values, strict=True)
        ]
    )
    quantities = tuple(_widened(quantity) for quantity in item.quantities)
    wide = replace(equation, covariance=equation.covariance + np.outer(shift, shift))
    return replace(item, equation=wide, quantities=quantities)


def by_smoothed(item: FittedAxis, legs: Mapping[str, LegData]) -> FittedAxis:
    """Return an axis with what smoothing of fixes or depths does in its intervals.

    A smoother over T makes the answer to a step slower, T^2 more in the square of its time
    constant tau: x' = a x + b x|x| + c F + d has all four small by one factor up to f =
    1 / sqrt(1 - T^2 / tau^2), and P + d d' with d = s (a, b, c, d), 1.96 s = f - 1. What has
    no time in it, as the steady speed and drag per thrust, is as sure as before.
    """
    times = [pair for leg in legs.values() for pair in leg.windows.smoothed_s.items()]
    longest_s = max((time for axis, time in times if axis == item.axis), default=0.0)
    if not longest_s:
        return item
    equation = item.equation
    values = dict(zip(equation.names, equation.values, strict=True))
    rate = VELOCITIES[AXES.index(item.axis)]
    slope = -values.get(rate, 0.0) - 2.0 * item.rate_rms * values.get(f"{rate}*|{rate}|", 0.0)
    rest = 1.0 - (longest_s * max(slope, 0.0)) ** 2
    factor = 1.0 / float(np.sqrt(max(rest, SLOWEST_SHARE**-2)))
    share = (factor - 1.0) / NORMAL_95
    shift = share * np.asarray(equation.values)
    wide = replace(equation, covariance=equation.covariance + np.outer(shift, shift))
    quantities = tuple(
        quantity if quantity.name.startswith(STEADY) else _slower(quantity, share)
        for quantity in item.quantities
    )
    words = (
        f"{AXIS_WORDS[item.axis].capitalize()} is measured by {item.measured_by}, smoothed over"
        f" {longest_s:.2g} s: its time constant may be {factor:.2g} times too long, damping and"
        " gain over the inertia too small by that factor, which intervals contain. The steady"
        " speed of a force is free of it."
    )
    warnings = (*item.warnings, words) if share > WORTH_WORDS else item.warnings
    return replace(item, equation=wide, quantities=quantities, warnings=warnings)


def _slower(quantity: FitQuantity, share: float) -> FitQuantity:
    """Return a quantity that goes with time, wider by the error of smoothing."""
    if not quantity.low > 0.0:
        return _widened(quantity, share)
    ends = np.log(quantity.high / quantity.value), np.log1p(NORMAL_95 * share)
    half = float(np.hypot(*ends))  # an interval in the logarithm
    error = float(np.hypot(quantity.standard_error, share * quantity.value))
    low, high = (float(quantity.value * np.exp(end)) for end in (-half, half))
    return replace(quantity, standard_error=error, low=low, high=high)


def _widened(quantity: FitQuantity, share: float = POSE_MOTION_SD) -> FitQuantity:
    shift = share * abs(quantity.value)
    low, high = (
        quantity.value + sign * float(np.hypot(abs(end - quantity.value), NORMAL_95 * shift))
        for sign, end in ((-1.0, quantity.low), (1.0, quantity.high))
    )
    error = float(np.hypot(quantity.standard_error, shift))
    return replace(quantity, standard_error=error, low=low, high=high)


def markers_words(markers: Markers) -> str:
    """Return what the legs say of the place of the sensor, in sentences."""
    name = "Markers sit" if markers.sensor == POSES else "The velocity log sits"
    where = "the markers sit" if markers.sensor == POSES else "the velocity log sits"
    unseen = [item.name for item in markers.figures if item.verdict == "not observable"]
    open_words = ""
    if unseen:
        file = "" if markers.stated else "; the vehicle file states none (0 is taken)"
        open_words = (
            f"Where {where} ({', '.join(unseen)}) is not determined: the vehicle turns too"
            f" little{file}."
        )
    if not markers.departs:
        return open_words or f"{name} where the vehicle file says, as far as these legs tell."
    parts = [
        f"{item.name.removeprefix('arm ')} {item.corrected:.3f} m (vehicle file"
        f" {item.file_value:.3f}, standard error {item.standard_error:.3f})"
        for item in markers.figures
        if item.corrected is not None
    ]
    states = "states" if markers.stated else "states (none: 0)"
    head = f"{name} off the place that the vehicle file {states}: {', '.join(parts)}."
    if markers.used:
        words = (
            "Velocities are corrected by that: they, and the model, are of the point about which"
            " the hull turns."
        )
    else:
        words = (
            "Turning is taken for motion ahead and aside, and what follows from that is weak at"
            f" best. Write it as sensors.{SENSORS[markers.sensor]}.arm of the vehicle file, or set"
            " stages.fit_axes.marker_arm: estimated."
        )
    return " ".join(part for part in (head, words, open_words) if part)


def _of(leg: LegData, sensor: str | None) -> bool:
    """Return whether a sensor measures the velocity of a leg."""
    by = leg.windows.measured_by
    return sensor in (by.get("X"), by.get("Y"), by.get("Z"))


def _turning(leg: LegData) -> list[TurningLeg]:
    """Return unbroken motion within the windows of any axis."""
    record = leg.record
    nu = np.column_stack([record.rate[name] for name in VELOCITIES])
    force = np.column_stack([record.force[axis] for axis in "XYZ"])
    inside = np.zeros(len(nu), dtype=np.bool_)
    for windows in record.windows.values():
        for first, end in windows:
            inside[first:end] = True
    inside &= np.isfinite(nu).all(axis=1) & np.isfinite(force).all(axis=1)
    step_s = float(record.t_s[1] - record.t_s[0])
    return [TurningLeg(step_s, nu[a:b], force[a:b]) for a, b in runs_of(inside)]
