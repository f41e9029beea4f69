"""The record of one leg: grid, motion, force, windows, and what a user should know."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.hydro.arrays import AXES, VELOCITIES, Array, Mask, runs_of
from auvid.hydro.identification.axes.record import AxisRecord, LeftOut, ThrusterForces
from auvid.hydro.identification.checks.response import response_lag
from auvid.hydro.identification.regression.excitation import THRESHOLDS
from auvid.hydro.identification.selection.axis_windows import (
    TAUT_S,
    WINDOW_S,
    driven,
    force_without_motion,
    near,
    windows_of_axis,
)
from auvid.hydro.identification.signals.resampling import uniform_clock
from auvid.stages.columns import ATTITUDE, AXIS_UNITS, GYRO, OF_FIXES, OF_POSES, VELOCITY
from auvid.stages.leg_record.force import LegDrive, actuator_table, drive_of
from auvid.stages.leg_record.motion import (
    DEPTH,
    FIXES,
    GYRO_RATES,
    POSES,
    VELOCITY_LOG,
    LegMotion,
    enough,
    motion_of,
    step_s,
)
from auvid.stages.leg_streams import Streams, disarmed_between

SURFACE_M = {axis: 0.4 if axis == "Z" else 0.25 for axis in AXES}
"""At less depth waves and air at the thrusters move an axis too."""
IDLE_SHARE, IDLE_COMMAND = 0.005, 0.02
"""A force within this part of what the actuators can give does not act; with a thrust
curve its dead band is taken off already.
"""
TETHER_SHARE = 0.05
"""A steady force up to this part of what the actuators can give may be the tether's."""
FREE_AXES = "XYZN"
"""Axes without a restoring moment, in which a steady force must move the body."""
DEPTH_RATE_S = 1.0
ONE_WAY_SHARE, DRIFT_SHARE = 0.05, 0.1
"""Less than this part of the moving time against the other way is one way; a hull that other
axes move drifts back at up to this part of its fast speeds, which tells no drag."""
OFFSETS_S = (-3.0, 3.0)
LEAST_EXPLAINED = 0.5
EARLY_S, LATE_S = 0.1, 1.2
"""Motion that comes so much before, or after, its force is that of another clock."""
SLOWEST_HZ = 0.5
WORDS = dict(zip(AXES, ("surge", "sway", "heave", "roll", "pitch", "yaw"), strict=True))
LARGEST_TILT_RAD = float(np.pi / 4.0)
"""Of a hull that is tilted more depth tells the speed ahead and aside more than heave."""
TILTED = f"tilted by more than {np.degrees(LARGEST_TILT_RAD):.0f} degrees, depth tells no heave"
NOT_MEASURED, NOT_COMMANDED = "nothing measures it", "not commanded"
STUCK = "force without motion"
TAUT = f"within {TAUT_S:g} s of a force without motion"


@dataclass(frozen=True)
class RecordOptions:
    """How a record is made: see the parameters of stage axis_record."""

    rate_hz: float = 20.0
    max_gap_s: float = 1.0
    window_s: float = WINDOW_S
    commands: bool = False
    rebuild: bool = True


@dataclass(frozen=True)
class RecordedLeg:
    """The record of a leg, what drives it, the rate of its clock, and sentences.

    `speed`: axis X .. N -> measured velocity (n,), the rate of depth for heave without one.
    """

    record: AxisRecord
    drive: LegDrive
    rate_hz: float
    speed: Mapping[str, Array]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def length_s(self, axis: str) -> float:
        """Return the length of all windows of an axis [s]."""
        windows = self.record.windows.get(axis, ())
        return sum(last - first for first, last in windows) / self.rate_hz


def leg_record(
    streams: Streams, info: LogInfo, leg: str, options: RecordOptions | None = None
) -> RecordedLeg:
    """Return the record of a leg.

    Raises `DataError` where nothing is logged that moves or drives the vehicle.
    """
    options = options or RecordOptions()
    t_s, rate_hz = _clock(streams, leg, options.rate_hz)
    motion = _of_places(motion_of(streams, t_s, options.max_gap_s), info)
    drive = drive_of(
        streams,
        info,
        t_s,
        surge=motion.rate["u"],
        max_gap_s=options.max_gap_s,
        commands=options.commands,
        rebuild=options.rebuild,
    )
    shared: list[tuple[str, Mask]] = [
        ("gap of the outputs", _not_finite(drive.values)),
        ("gap of the attitude", _not_finite(motion.attitude_rad)),
        ("disarmed", _disarmed(streams, info, t_s)),
    ]
    windows: dict[str, tuple[tuple[int, int], ...]] = {}
    left_out: list[LeftOut] = []
    warnings: list[str] = []
    speeds = {axis: _speed(motion, axis, rate_hz) for axis in AXES}
    from_surface = _depth_of_surface(info)
    reasons = {axis: _reasons(axis, motion, drive, rate_hz, shared, from_surface) for axis in AXES}
    stuck = np.zeros(t_s.size, dtype=bool)
    for axis in FREE_AXES:
        force, usable = drive.values[:, AXES.index(axis)], ~_any(reasons[axis])
        least = _tether(drive, axis)
        own = usable & force_without_motion(t_s, force, speeds[axis], usable, least=least)
        warnings += _stuck_words(axis, t_s, force, own, _unit(axis, drive.normalised))
        stuck |= own
    around = round(TAUT_S * rate_hz)
    taut = near(stuck, around, around)
    for axis in AXES:
        # What holds the vehicle in one axis holds it in the others.
        windows[axis], own_left_out = windows_of_axis(
            axis, t_s, [*reasons[axis], (STUCK, stuck), (TAUT, taut)], window_s=options.window_s
        )
        left_out += own_left_out
    record = AxisRecord(
        t_s,
        motion.rate,
        None if motion.depth_m is None else _bridged(motion.depth_m),
        np.stack([_bridged(angle) for angle in motion.attitude_rad.T], axis=1),
        {axis: _bridged(drive.values[:, at]) for at, axis in enumerate(AXES)},
        drive.normalised,
        {axis: own for axis, own in windows.items() if own},
        tuple(left_out),
        motion.by,
        _bridged_thrusters(drive.thrusters),
    )
    warnings += _clock_words(record, speeds, rate_hz)
    warnings += _one_way_words(record, speeds)
    return RecordedLeg(
        record, drive, rate_hz, speeds, (*motion.notes, *drive.notes), tuple(warnings)
    )


def _of_places(motion: LegMotion, info: LogInfo) -> LegMotion:
    """Return a motion that says what of it are slopes of poses or fixes."""
    by = dict(motion.by)
    for stream, sensor in (("velocity", VELOCITY_LOG), ("imu", GYRO_RATES)):
        source = info.streams[stream].source if stream in info.streams else ""
        for places, words in ((OF_POSES, POSES), (OF_FIXES, FIXES)):
            if source.startswith(places):
                by |= {axis: words for axis, own in motion.by.items() if own == sensor}
    rate = motion.rate
    if by.get("Z") == FIXES and motion.depth_m is not None:
        # Between fixes it is the slope of the depth, which tells more by itself.
        by["Z"] = DEPTH
        rate = {**rate, "w": np.full_like(rate["w"], np.nan)}
    return replace(motion, by=by, rate=rate)


def _clock(streams: Streams, leg: str, rate_hz: float) -> tuple[Array, float]:
    """Return the uniform clock (n,) [s], where outputs and motion are, and its rate."""
    actuator_table(streams)
    times = streams.times("actuators")
    times = times[(times >= streams.window[0]) & (times <= streams.window[1])]
    columns = {"imu": GYRO, "attitude": ATTITUDE, "depth": ("depth_m",), "velocity": VELOCITY[:3]}
    measured = [
        samples
        for name, names in columns.items()
        if (samples := enough(streams.samples(name, names))) is not None
    ]
    if not measured:
        raise DataError(
            f"nothing measures how the vehicle moves in leg '{leg}'",
            allowed="a gyro, an attitude, a depth or a velocity",
        )
    fastest = max(1.0 / step_s(samples) for samples in measured)
    rate_hz = max(SLOWEST_HZ, min(rate_hz, fastest))
    first = min(samples.t_s[0] for samples in measured)
    last = max(samples.t_s[-1] for samples in measured)
    span = (max(first, times[0]), min(last, times[-1])) if times.size else (0.0, 0.0)
    if span[1] - span[0] < 2.0 / rate_hz:
        raise DataError(
            f"outputs and motion of leg '{leg}' do not overlap in time",
            field="actuators",
            value="no sample" if not times.size else f"{times[0]:.1f} to {times[-1]:.1f} s",
            allowed=f"{first:.1f} to {last:.1f} s, where motion is measured",
        )
    return uniform_clock(span[0], span[1], rate_hz), rate_hz


def _bridged(values: Array) -> Array:
    """Return values (n,) with gaps bridged, for filters that run over a whole leg.

    No window has a gap; a leg without any value is 0.
    """
    good = np.isfinite(values)
    if good.all():
        return values
    at = np.arange(values.size)
    return np.interp(at, at[good], values[good]) if good.any() else np.zeros(values.size)


def _bridged_thrusters(thrusters: ThrusterForces | None) -> ThrusterForces | None:
    """Return forces of thrusters with gaps bridged; None where two share an output."""
    if thrusters is None or len(set(thrusters.outputs)) < len(thrusters.outputs):
        return None
    force = np.stack([_bridged(column) for column in thrusters.force.T], axis=1)
    return thrusters._replace(force=force)


def _any(reasons: list[tuple[str, Mask]]) -> Mask:
    return np.asarray(np.any([mask for _, mask in reasons], axis=0))


def _not_finite(values: Array) -> Mask:
    return np.asarray(~np.isfinite(values).all(axis=1))


def _disarmed(streams: Streams, info: LogInfo, t_s: Array) -> Mask:
    mask = np.zeros(t_s.size, dtype=bool)
    end_s = (int(info.end_us) - int(info.start_us)) / 1e6
    for begin, end in disarmed_between(streams.tables.get("mode"), streams.start_us, end_s):
        mask |= (t_s >= begin) & (t_s <= end)
    return mask


def _depth_of_surface(info: LogInfo) -> bool:
    """Return whether depth counts from the surface: that of a pose does not."""
    position = info.streams.get("position")
    depth = info.streams.get("depth")
    return depth is not None and (position is None or position.source != depth.source)


def _speed(motion: LegMotion, axis: str, rate_hz: float) -> Array:
    """Return the measured velocity of an axis (n,); the rate of depth for heave."""
    own = motion.rate[VELOCITIES[AXES.index(axis)]]
    if axis != "Z" or motion.depth_m is None or np.isfinite(own).any():
        return own
    half = max(1, round(DEPTH_RATE_S * rate_hz / 2.0))
    speed = np.full(own.size, np.nan)
    depth = motion.depth_m
    speed[half:-half] = (depth[2 * half :] - depth[: -2 * half]) * rate_hz / (2.0 * half)
    return speed


def _peak(values: Array) -> float:
    """Return the 99th percentile of the size of values (n,); 0 without any."""
    finite = np.abs(values[np.isfinite(values)])
    return float(np.percentile(finite, 99.0)) if finite.size else 0.0


def _reasons(
    axis: str,
    motion: LegMotion,
    drive: LegDrive,
    rate_hz: float,
    shared: list[tuple[str, Mask]],
    from_surface: bool,
) -> list[tuple[str, Mask]]:
    """Return why samples are left out of an axis; the first that applies counts."""
    at = AXES.index(axis)
    force = drive.values[:, at]
    everywhere = np.ones(force.size, dtype=bool)
    if axis not in motion.by:
        return [(NOT_MEASURED, everywhere)]
    full = float(drive.full[at]) if np.isfinite(drive.full[at]) else _peak(force)
    idle = (IDLE_COMMAND if drive.normalised else IDLE_SHARE) * full
    if axis not in drive.axes or _peak(force - np.nanmedian(force)) <= idle:
        return [(NOT_COMMANDED, everywhere)]
    reasons = [(f"gap of the {motion.by[axis]}", _gaps(motion, axis)), *shared]
    if motion.depth_m is not None and from_surface:
        shallow = np.nan_to_num(motion.depth_m, nan=np.inf) < SURFACE_M[axis]
        reasons.append(("at the surface", shallow))
    if axis == "Z" and motion.depth_m is not None and not np.isfinite(motion.rate["w"]).any():
        level = np.prod(np.cos(motion.attitude_rad[:, :2]), axis=1)
        reasons.append((TILTED, np.nan_to_num(level, nan=1.0) < np.cos(LARGEST_TILT_RAD)))
    step = 1.0 / rate_hz
    reasons.append(("the attitude jumps", motion.jumps))
    reasons.append(("no actuator acts", ~driven(drive.acting.astype(float), step, 0.5)))
    return reasons


def _tether(drive: LegDrive, axis: str) -> float:
    """Return a force that a tether may hold steadily."""
    full = float(drive.full[AXES.index(axis)])
    return TETHER_SHARE * full if np.isfinite(full) else 0.0


def _unit(axis: str, normalised: bool) -> str:
    return "full commands" if normalised else AXIS_UNITS[axis]


def _gaps(motion: LegMotion, axis: str) -> Mask:
    own = motion.rate[VELOCITIES[AXES.index(axis)]]
    if axis == "Z" and motion.depth_m is not None and not np.isfinite(own).any():
        own = motion.depth_m
    return ~np.isfinite(own)


def _stuck_words(axis: str, t_s: Array, force: Array, stuck: Mask, unit: str) -> Iterator[str]:
    """Yield a sentence for each stretch in which a force moves nothing."""
    for first, last in runs_of(stuck):
        low, high = np.sort(np.percentile(force[first:last], (10.0, 90.0)))
        yield (
            f"Force without motion in {WORDS[axis]}, {t_s[first]:.0f} to {t_s[last - 1]:.0f} s:"
            f" {low:.2g} to {high:.2g} {unit} and hardly a move. Something holds the vehicle"
            " (tether, sea floor, a hand), or its motion in other axes balances the force; the"
            " stretch is left out."
        )


def _clock_words(record: AxisRecord, speeds: Mapping[str, Array], rate_hz: float) -> Iterator[str]:
    """Yield a sentence where motion and force stand on clocks that differ.

    Judged in the axis that answers its force best.
    """
    answers = {}
    for axis in record.windows:
        speed, force = speeds[axis], record.force[axis]
        good = np.isfinite(speed) & np.isfinite(force)
        answer = response_lag(
            record.t_s,
            np.interp(record.t_s, record.t_s[good], force[good])[:, None],
            record.t_s[good],
            speed[good],
            lags_s=OFFSETS_S,
            rate_hz=rate_hz,
        )
        if answer is not None:
            answers[axis] = answer
    if not answers:
        return
    axis = max(answers, key=lambda name: answers[name].explained)
    best = answers[axis]
    if best.explained < LEAST_EXPLAINED or -EARLY_S <= best.lag_s <= LATE_S:
        return
    where = f"{-best.lag_s:.2f} s before" if best.lag_s < 0.0 else f"{best.lag_s:.2f} s after"
    yield (
        f"{WORDS[axis].capitalize()} moves {where} the commands that drive it"
        f" ({100.0 * best.explained:.0f} % explained): commands and motion seem to stand on clocks"
        " of two computers. Set stages.axis_record.lag_s (actuators: how late their stamps are)."
    )


def _one_way_words(record: AxisRecord, speeds: Mapping[str, Array]) -> Iterator[str]:
    """Yield a sentence for each axis that moves one way only."""
    for axis, windows in record.windows.items():
        speed = np.concatenate([speeds[axis][first:last] for first, last in windows])
        fast = float(np.quantile(np.abs(np.nan_to_num(speed)), 0.95))
        limit = max(THRESHOLDS[VELOCITIES[AXES.index(axis)]], DRIFT_SHARE * fast)
        ways = np.count_nonzero(speed > limit), np.count_nonzero(speed < -limit)
        if sum(ways) and min(ways) < ONE_WAY_SHARE * sum(ways):
            yield (
                f"{WORDS[axis].capitalize()} moves one way only: its constant force and its drag"
                " are hardly told apart, and the drag of the other way is not known."
            )
