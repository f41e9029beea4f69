"""The tows, coasts, decays and drifts of legs, with their fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.coasting.decay import (
    LEAST_COASTS,
    LEAST_SAMPLES,
    CoastDecay,
    CoastRecord,
    fit_decay,
)
from auvid.hydro.identification.passive.free_swing import FreeSwing, fit_free_swing
from auvid.hydro.identification.passive.releases import (
    LEAST_TOW_S,
    fading,
    onsets,
    released,
    towed,
)
from auvid.hydro.identification.passive.tow import (
    AFTER_S,
    BEFORE_S,
    TowFit,
    TowRecord,
    both_ways,
    fit_tow,
    force_delay,
)
from auvid.hydro.identification.regression.standard_errors import mean_error, widened_by
from auvid.hydro.identification.signals.resampling import uniform_clock
from auvid.stages.columns import ATTITUDE, GYRO, POSITION, VELOCITY, leg_window
from auvid.stages.leg_record.motion import LegMotion, enough, motion_of, on_clock, step_s
from auvid.stages.leg_streams import Streams

ROLES = ("tow", "coast", "decay", "drift")
SPEEDS = {"surge": "u", "sway": "v", "heave": "w", "yaw": "r"}
LEAST_SLIP_RAD = float(np.radians(5.0))
"""From there on a hull under tow is oblique: the wash of a carriage gives some degrees."""
TOW_SPEED = ("tow_speed_m_s",)
TOWED_ALONG = ("surge", "sway")
"""In heave the line carries the weight in water as well."""
SWINGS = {"roll": 0, "pitch": 1}
DEGREES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
LEAST_SWING = {"roll": 0.05, "pitch": 0.05, "heave": 0.1}
"""Amplitude [rad, m] from which a swing is looked for where no leg names one."""
UNEVEN, LEAST_HELD_OUT = 0.2, 0.5
"""Scatter of the force over its size, from which on half of the windows must tell the others."""
ODD_MASS, ODD_MASS_ERRORS = 3.0, 3.0
"""Factor beside the mass of the file, clear by so many standard errors; lbf give 4.4."""
WAIT_S = 0.2
"""After a release, for the line to fall slack."""
SMOOTHED_S = 0.4
DRIFT_BLOCKS = 6
UNKNOWN_MASS = 0.2
"""Standard deviation of an apparent mass whose vehicle file has no spread, as a share."""


@dataclass(frozen=True)
class MotionRules:
    """Least speed [m/s] and yaw rate [rad/s] of a coast, and the longest [s]."""

    speed_m_s: float
    rate_rad_s: float
    longest_s: float


@dataclass(frozen=True)
class PassiveLeg:
    """A leg on a uniform clock t_s (n,): motion, tow force (n,) [N], drift (2, 2).

    `tow_speed_m_s` (n,): that of the carriage, which the body has while the line pulls.
    """

    entry: LegEntry
    t_s: Array
    motion: LegMotion
    force_N: Array | None
    drift_m_s: Array | None
    tow_speed_m_s: Array | None = None

    @property
    def step_s(self) -> float:
        """Return the step of the clock [s]."""
        return float(self.t_s[1] - self.t_s[0])

    def speed(self, channel: str) -> Array:
        """Return the velocity (n,) of a channel, nan where nothing measures it."""
        values = self.motion.rate[SPEEDS[channel]]
        depth = self.motion.depth_m
        if channel == "heave" and depth is not None and not np.isfinite(values).any():
            return smoothed(np.gradient(depth, self.step_s), self.step_s)
        return values

    def towed_speed(self, channel: str) -> Array:
        """Return the speed (n,) in a tow: the carriage's where none is measured."""
        values = self.speed(channel)
        along = channel == (self.entry.channel or TOWED_ALONG[0])
        if self.tow_speed_m_s is None or not along or np.isfinite(values).any():
            return values
        return self.tow_speed_m_s

    def deflection(self, channel: str) -> Array | None:
        """Return roll, pitch [rad] or depth [m] (n,), None where not measured."""
        if channel == "heave":
            return self.motion.depth_m
        angle = self.motion.attitude_rad[:, SWINGS[channel]]
        return angle if np.isfinite(angle).any() and np.any(angle != 0.0) else None


@dataclass
class PassiveMotions:
    """Every stretch with its fit; `left_out`: what was not taken, in words."""

    tows: dict[str, list[tuple[str, TowRecord]]] = field(default_factory=dict)
    around_tows: dict[str, list[TowRecord]] = field(default_factory=dict)
    """Channel -> its tows with what is before and after them, nan where nothing is."""
    tow_fits: dict[str, TowFit] = field(default_factory=dict)
    coasts: dict[str, list[tuple[str, CoastRecord]]] = field(default_factory=dict)
    coast_fits: dict[str, CoastDecay] = field(default_factory=dict)
    swings: dict[str, list[tuple[str, FreeSwing]]] = field(default_factory=dict)
    drifts: list[tuple[str, Array, Array]] = field(default_factory=list)
    """Leg, velocity north and east (2,) [m/s], standard errors (2,)."""
    left_out: list[str] = field(default_factory=list)
    by: dict[str, str] = field(default_factory=dict)
    oblique: dict[str, float] = field(default_factory=dict)
    """Leg that is towed with a sideslip -> angle between hull and path [rad]."""
    both_ways: dict[str, str] = field(default_factory=dict)
    """Channel -> what its tows ahead and astern tell of a current along them, in words."""
    odd: dict[str, str] = field(default_factory=dict)
    """Channel whose tows no drag and no mass explain as the file has them -> in words."""
    guessed: set[str] = field(default_factory=set)
    """Channels whose coasts begin at a peak of speed, where no force says that it ended."""
    guessed_drifts: list[str] = field(default_factory=list)
    """Legs without a role that are taken for a drift, as nothing else moves them."""

    @property
    def empty(self) -> bool:
        """Return whether nothing was fitted."""
        return not (self.tow_fits or self.coast_fits or self.swings or self.drifts)


def smoothed(values: Array, step: float) -> Array:
    """Return means over `SMOOTHED_S` (n,), nan near a gap."""
    size = max(round(SMOOTHED_S / step) // 2 * 2 + 1, 1)
    return np.asarray(np.convolve(values, np.full(size, 1.0 / size), mode="same"))


def read_leg(
    entry: LegEntry,
    tables: Mapping[str, pa.Table | None],
    info: LogInfo,
    vehicle: Vehicle,
    *,
    rate_hz: float,
    max_gap_s: float,
) -> PassiveLeg:
    """Return a leg on one clock; raise `DataError` where nothing measures it."""
    start_us = int(info.start_us)
    window = leg_window(entry, start_us, int(info.end_us))
    streams = Streams(tables, start_us, window, vehicle)
    columns = {
        "imu": GYRO,
        "attitude": ATTITUDE,
        "depth": ("depth_m",),
        "velocity": VELOCITY[:3],
        "position": POSITION,
        "tow": TOW_SPEED,
    }
    measured = [
        samples
        for name, names in columns.items()
        if (samples := enough(streams.samples(name, names))) is not None
    ]
    if not measured:
        raise DataError(
            f"nothing measures how the body moves in leg '{entry.id}'",
            allowed="a gyro, an attitude, a depth, a velocity, a position or the speed of the tow",
        )
    rate = min(rate_hz, max(1.0 / step_s(samples) for samples in measured))
    first = min(samples.t_s[0] for samples in measured)
    last = max(samples.t_s[-1] for samples in measured)
    t_s = uniform_clock(first, last, rate)
    motion = motion_of(streams, t_s, max_gap_s)
    force = enough(streams.samples("tow", ("tow_force_n",)))
    carriage = enough(streams.samples("tow", TOW_SPEED))
    position = enough(streams.samples("position", POSITION))
    return PassiveLeg(
        entry,
        t_s,
        motion,
        None if force is None else on_clock(force, t_s, max_gap_s)[:, 0],
        None if position is None else position_slope(position.t_s, position.values),
        None if carriage is None else on_clock(carriage, t_s, max_gap_s)[:, 0],
    )


def position_slope(t_s: Array, position: Array) -> Array:
    """Return velocity north, east [m/s] and standard errors of a drift, (2, 2).

    Slopes of position over time in six blocks. Water meanders for longer than a block: the
    errors have the correlation of blocks in a row, as Student's t makes 1.96 of them half of
    the 95 % interval.
    """
    blocks = np.array_split(np.arange(t_s.size), DRIFT_BLOCKS)
    slopes = np.array([np.polyfit(t_s[part], position[part, :2], 1)[0] for part in blocks])
    errors = [mean_error(part) for part in slopes.T]
    return np.stack([slopes.mean(axis=0), widened_by(DRIFT_BLOCKS - 1) * np.array(errors)])


def motions_of(legs: Sequence[PassiveLeg], rules: MotionRules, vehicle: Vehicle) -> PassiveMotions:
    """Return the motions of all legs, fitted.

    A leg with a role is what its role says, from its first sample on; one without is
    searched: tows where the line pulls, coasts after it lets go or after a peak of speed,
    swings of roll, pitch and depth.
    """
    out = PassiveMotions()
    for leg in legs:
        out.by |= {axis: words for axis, words in leg.motion.by.items() if axis not in out.by}
        if leg.entry.role is None:
            _search(out, leg, rules)
        else:
            _as_named(out, leg, rules)
    for channel, tows in out.tows.items():
        mass, spread = apparent_mass(vehicle, channel)
        try:
            records, words = _in_still_water([record for _, record in tows])
            out.tows[channel] = list(zip([name for name, _ in tows], records, strict=True))
            out.both_ways[channel] = f"In {channel} {words}"
            # A mass that is assumed only says how large it may be.
            assumed = spread if vehicle.spreads else mass
            out.tow_fits[channel] = fit_tow(records, mass_kg=mass, mass_sd_kg=assumed)
            unbound = fit_tow(records, mass_kg=mass, mass_sd_kg=10.0 * mass)
            delay_s = force_delay(out.around_tows[channel])
            if words := _odd_tow(unbound, mass, delay_s):
                out.odd[channel] = f"In {channel} {words} Figures of the tow are weak."
        except DataError as fault:
            out.left_out.append(f"tow, {channel}: {fault}")
    for channel, coasts in out.coasts.items():
        try:
            out.coast_fits[channel] = fit_decay([record for _, record in coasts])
        except DataError:
            why = f"{len(coasts)}, {LEAST_COASTS} and more are needed"
            if len(coasts) >= LEAST_COASTS:
                why = f"no drag explains the {len(coasts)} that were looked at"
            out.left_out.append(f"coasts in {channel}: {why}")
    return out


def _in_still_water(tows: list[TowRecord]) -> tuple[list[TowRecord], str]:
    """Return tows without the current or offset that they show, and that in words."""
    differ = both_ways(tows)
    current, offset, astern = differ.current_m_s, differ.offset_N, differ.astern
    causes = [
        words
        for value, words in (
            (current, f"a current of {current:.2g} m/s along them, or that zero of the speed"),
            (offset, f"an offset of {offset:.2g} N of the load cell"),
            (astern, f"a drag that is {100.0 * astern:.0f} % larger astern than ahead"),
        )
        if value
    ]
    if len(causes) > 1:
        return tows, (
            f"tows ahead and astern differ as by {', or by '.join(causes)}: tows at other speeds"
            " would tell which. Nothing is taken off."
        )
    if astern:
        return tows, (
            f"tows ahead and astern show {causes[0]}. Figures are those of both ways together:"
            " take legs of one way for its drag."
        )
    if causes:
        moved = [
            replace(tow, speed=tow.speed - current, force_N=tow.force_N - offset) for tow in tows
        ]
        return moved, f"tows ahead and astern show {causes[0]}. It is taken off."
    signs = {bool(np.nanmean(tow.speed) > 0.0) for tow in tows}
    if len(signs) == 1:
        return tows, (
            "all tows go one way: a steady current along them and an offset of the load cell are in"
            " the drag, and nothing tells them from it. Tow both ways."
        )
    return tows, "tows ahead and astern agree: no steady current along them."


def _odd_tow(fit: TowFit, mass_kg: float, delay_s: float) -> str:
    """Return what is odd of tows: forces without speeds, or far another mass.

    `fit`: one whose mass that of the file, `mass_kg`, does not hold.
    """
    if delay_s:
        late = "late" if delay_s > 0.0 else "early"
        return (
            f"the force of the line is logged {abs(delay_s):.2g} s {late} against the speed: log"
            " both on one clock, or take the force from a file of its own with time.shift_s:"
            f" {-delay_s:.2g} in its column map."
        )
    size = float(np.mean(np.abs(fit.forces_N)))
    if float(np.std(fit.forces_N)) > UNEVEN * size and fit.held_out < LEAST_HELD_OUT:
        return (
            "the force of the line changes and the speed does not follow it: is one of them stuck,"
            " on another clock, or the line slack?"
        )
    own, error = float(fit.values[0]), float(np.sqrt(fit.covariance[0, 0]))
    clear = ODD_MASS_ERRORS * error
    if own + clear > mass_kg / ODD_MASS and own - clear < mass_kg * ODD_MASS:
        return ""
    return (
        f"the tows show an apparent mass of {own:.3g} ± {NORMAL_95 * error:.2g} kg, the vehicle"
        f" file {mass_kg:.3g} kg: is the force in another unit (kgf, lbf), or on another clock than"
        " the speed?"
    )


def apparent_mass(vehicle: Vehicle, channel: str) -> tuple[float, float]:
    """Return apparent mass or inertia of a channel and its standard deviation."""
    at = DEGREES.index(channel)
    total = float(vehicle.mass_matrix[at, at])
    body = float(vehicle.inertia[at - 3, at - 3]) if at > 2 else 1.0
    own = vehicle.spreads.get("inertia" if at > 2 else "mass", 0.0) * body
    added = vehicle.spreads.get("added_mass", 0.0) * float(vehicle.added_mass[at, at])
    spread = float(np.hypot(own, added))
    return total, spread if spread > 0.0 else UNKNOWN_MASS * total


def _as_named(out: PassiveMotions, leg: PassiveLeg, rules: MotionRules) -> None:
    """Take a leg as its role says."""
    role, channel = leg.entry.role, leg.entry.channel or "surge"
    name = leg.entry.id
    if role == "drift":
        if leg.drift_m_s is None:
            out.left_out.append(f"{name}: a drift needs a position")
        else:
            out.drifts.append((name, leg.drift_m_s[0], leg.drift_m_s[1]))
    elif role == "decay":
        if leg.entry.channel is None or channel not in LEAST_SWING:
            raise CampaignError(
                f"leg '{name}' does not say what decays",
                field="channel",
                value=leg.entry.channel,
                allowed=tuple(LEAST_SWING),
            )
        _swing(out, leg, channel, named=True)
    elif channel not in SPEEDS or not np.isfinite(_speed_in(leg, role, channel)).any():
        out.left_out.append(f"{name}: nothing measures the speed in {channel}")
    elif role == "tow":
        if channel not in TOWED_ALONG:
            out.left_out.append(
                f"{name}: a tow is along surge or sway; in {channel} the line"
                " carries weight or turns"
            )
        elif leg.force_N is None:
            out.left_out.append(f"{name}: no tow force is logged (stream tow, tow_force_n)")
        else:
            speed, everything = leg.towed_speed(channel), slice(0, leg.t_s.size)
            record = TowRecord(leg.t_s, speed, leg.force_N)
            _note_slip(out, leg, channel, everything)
            out.tows.setdefault(channel, []).append((name, record))
            around = _around(leg, speed, leg.force_N, everything)
            out.around_tows.setdefault(channel, []).append(around)
    else:
        begin = int(np.argmax(np.isfinite(leg.speed(channel))))
        last = begin + int((WAIT_S + rules.longest_s) / leg.step_s)
        _coast(out, leg, channel, (begin, min(last, leg.t_s.size)), rules)


def _around(leg: PassiveLeg, speed: Array, force_N: Array, part: slice) -> TowRecord:
    """Return a tow with what is before and after it, nan beyond the leg."""
    before, after = round(BEFORE_S / leg.step_s), round(AFTER_S / leg.step_s)
    edges = (before, after)
    wide = [np.pad(values, edges, constant_values=np.nan) for values in (speed, force_N)]
    own = slice(part.start, part.stop + before + after)
    t_s = leg.t_s[0] + leg.step_s * (np.arange(own.start, own.stop) - before)
    return TowRecord(t_s, wide[0][own], wide[1][own])


def _note_slip(out: PassiveMotions, leg: PassiveLeg, channel: str, part: slice) -> None:
    """Note the sideslip of a tow whose speed across is measured and not small."""
    along = leg.towed_speed(channel)[part]
    across = leg.speed("sway" if channel == "surge" else "surge")[part]
    both = np.isfinite(along) & np.isfinite(across)
    if not both.any():
        return
    size = float(np.median(np.abs(along[both])))
    angle = abs(float(np.arctan2(np.median(across[both] * np.sign(along[both])), size)))
    if angle > LEAST_SLIP_RAD:
        out.oblique[leg.entry.id] = max(angle, out.oblique.get(leg.entry.id, 0.0))


def _speed_in(leg: PassiveLeg, role: str | None, channel: str) -> Array:
    return leg.towed_speed(channel) if role == "tow" else leg.speed(channel)


def _search(out: PassiveMotions, leg: PassiveLeg, rules: MotionRules) -> None:
    """Find tows, coasts and swings in a leg that has no role; else it drifts."""
    step, force = leg.step_s, leg.force_N
    for channel in LEAST_SWING:
        _swing(out, leg, channel, named=False)
    swings = any(name == leg.entry.id for name, _ in out.swings.get("heave", []))
    is_idle = not any(name == leg.entry.id for own in out.swings.values() for name, _ in own)
    channel_of_tow = leg.entry.channel or "surge"
    for channel in SPEEDS:
        speed = leg.speed(channel)
        least = rules.rate_rad_s if channel == "yaw" else rules.speed_m_s
        along_tow = force is not None and channel == channel_of_tow and channel in TOWED_ALONG
        pulled = leg.towed_speed(channel)
        if force is not None and along_tow and np.isfinite(pulled).any():
            pulls = towed(force, step)
            if not pulls:
                out.left_out.append(
                    f"{leg.entry.id}: the line pulls in no stretch of {LEAST_TOW_S:g} s (mean force"
                    f" {np.nanmean(force):.2g} N): it is slack, or tow_force_n another column."
                    " Take legs in which it is taut"
                )
            for first, last in pulls:
                part = slice(first, last)
                record = TowRecord(leg.t_s[part], pulled[part], force[part])
                _note_slip(out, leg, channel, part)
                out.tows.setdefault(channel, []).append((leg.entry.id, record))
                around = _around(leg, pulled, force, part)
                out.around_tows.setdefault(channel, []).append(around)
        if not np.isfinite(speed).any() or (channel == "heave" and swings):
            continue  # a float that bobs is pushed back: its drag is not all that slows it
        if force is not None and along_tow:
            spans = released(force, step, rules.longest_s + WAIT_S)
        elif force is not None:
            continue  # towed along one axis, it coasts along none but that
        else:
            even = smoothed(speed, step)
            spans = fading(even, step, least=least, longest_s=rules.longest_s + WAIT_S)
            if spans:
                out.guessed.add(channel)
        for span in spans:
            _coast(out, leg, channel, span, rules)
        is_idle = is_idle and not spans
    if force is None and leg.drift_m_s is not None and is_idle:
        out.drifts.append((leg.entry.id, leg.drift_m_s[0], leg.drift_m_s[1]))
        out.guessed_drifts.append(leg.entry.id)


def _coast(
    out: PassiveMotions, leg: PassiveLeg, channel: str, span: tuple[int, int], rules: MotionRules
) -> None:
    first = span[0] + int(np.ceil(WAIT_S / leg.step_s))
    t_s, speed = leg.t_s[first : span[1]], leg.speed(channel)[first : span[1]]
    good = np.isfinite(speed)
    t_s, speed = t_s[good], speed[good]
    least = rules.rate_rad_s if channel == "yaw" else rules.speed_m_s
    if t_s.size < LEAST_SAMPLES or abs(float(speed[:3].mean())) < least:
        out.left_out.append(
            f"{leg.entry.id}, {leg.t_s[span[0]]:.1f} s: too short or too slow a coast in {channel}"
        )
        return
    none = np.zeros(t_s.size)
    record = CoastRecord(t_s, speed, none, np.zeros((t_s.size, 0)), none)
    out.coasts.setdefault(channel, []).append((leg.entry.id, record))


def _swing(out: PassiveMotions, leg: PassiveLeg, channel: str, *, named: bool) -> None:
    values = leg.deflection(channel)
    if values is None:
        if named:
            out.left_out.append(f"{leg.entry.id}: nothing measures {channel}")
        return
    rest = float(np.nanmedian(values))
    if not named and float(np.nanmax(np.abs(values - rest))) < LEAST_SWING[channel]:
        return
    parts = [(0, values.size)] if named else onsets(values - rest, leg.step_s)
    for first, last in parts:
        try:
            swing = fit_free_swing(
                leg.t_s[first:last], values[first:last], is_depth=channel == "heave"
            )
        except DataError as fault:
            at = f"{leg.entry.id}, {leg.t_s[first]:.1f} s"
            out.left_out.append(f"{at}: no decay of {channel}, {fault}")
            continue
        out.swings.setdefault(channel, []).append((leg.entry.id, swing))
