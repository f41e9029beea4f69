"""Samples that cannot be used: incomplete, impossible, or with a wrong time stamp."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import NEEDED
from auvid.hydro.arrays import Ints, Mask
from auvid.stages.columns import LINEAR_VELOCITY
from auvid.stages.ingest.decoded_log import Column
from auvid.stages.ingest.streams.common import Columns
from auvid.stages.ingest.streams.mapping import Stream

EMPTY = "empty or non-finite cell"
IMPOSSIBLE = "impossible value"
NO_TIME = "no time stamp"
REPEATED = "repeated time stamp"
BACKWARD = "time stamp out of order"
BEFORE_LEAP = "before the clock was set"
USUAL_UNITS: Mapping[str, str] = {
    "attitude": "angles beyond 7 rad: if the file has degrees, set unit: deg",
    "imu": "rates beyond 100 rad/s or 1000 m/s^2: if the file has deg/s, set unit: deg/s",
    "velocity": "speeds beyond 50 m/s: if the file has mm/s or cm/s, set that unit",
    "depth": "depths beyond -1 or 12 km: if the file has mm, cm or Pa, set that unit",
    "position": "positions beyond 10 000 km: if the file has mm or degrees, set that unit",
    "pose": "angles beyond 7 rad or positions beyond 10 000 km: degrees need unit: deg",
    "battery": "voltages beyond 1000 V or currents beyond 10 kA: if the file has mV or mA, set that"
    " unit",
    "actuators": "outputs that are no pulses (1100 to 1900 us); a command is command_surge ...",
}
"""What impossible values of a stream usually are."""
LEAP_US = 30 * 86_400_000_000
"""No dive lasts 30 days; a clock that is set to Unix time jumps by 50 years."""
FAR_US, FAR_SHARE = 365 * 86_400_000_000, 0.34
"""A stamp a year from most others is destroyed, if these are at most so many of all."""
FEW = 3
"""So many samples are judged by the other streams, and set no clock."""
POSSIBLE: Mapping[str, tuple[float, float]] = {
    "gyro": (-100.0, 100.0),
    "accel": (-1000.0, 1000.0),
    "phi_rad": (-7.0, 7.0),
    "theta_rad": (-7.0, 7.0),
    "depth_m": (-1000.0, 12_000.0),
    "u_m_s": (-50.0, 50.0),
    "v_m_s": (-50.0, 50.0),
    "w_m_s": (-50.0, 50.0),
    "interval_s": (0.0, 3600.0),
    "x_m": (-1e7, 1e7),
    "y_m": (-1e7, 1e7),
    "z_m": (-12_000.0, 12_000.0),
    "psi_rad": (-1e5, 1e5),
    "current_a": (-10_000.0, 10_000.0),
    "range_m": (-1.0, 20_000.0),
    "command": (-1e3, 1e3),
    "fin": (-7.0, 7.0),
    "propeller_rev_s": (-1e3, 1e3),
}
"""Limits that no underwater vehicle reaches, by the beginning of the column's name.
Damaged records that still look like records are far beyond them.
"""
STEEPEST_RAD, LARGEST_ROLL_STEP_RAD, DAMAGED_SHARE = 1.6, 1.0, 0.01
"""Pitch of any attitude in rad, and a step of a roll without wraps; degrees are beyond."""
NO_VELOCITY_M_S, ROUNDING_M_S = 32.768, 1e-6
"""The largest number of 16 bits in mm/s, of either sign: a velocity log writes it for none."""


@dataclass(frozen=True)
class Rejected:
    """Samples of one stream that were rejected for one reason.

    How many, and where the first and the last are in the file.
    """

    stream: str
    reason: str
    count: int
    first: int
    last: int


def reject_samples(
    stream: Stream, *, set_us: int | None = None, usual_us: float | None = None
) -> tuple[Stream, list[Rejected]]:
    """Return the usable samples of a stream, and the account of the others.

    `set_us` is the time to which a jumping clock was set, `usual_us` the `usual_time`.
    """
    rejected: list[Rejected] = []

    def keep(stream: Stream, good: Mask, reason: str) -> Stream:
        if good.all():
            return stream
        place = stream.place[~good]
        first, last = int(place[0]), int(place[-1])
        rejected.append(Rejected(stream.name, reason, int(place.size), first, last))
        return stream.rows(good)

    stamps = stream.columns["time_us"]
    if stamps.dtype != np.int64:
        finite = np.isfinite(stamps) & (np.abs(stamps) < float(2**62))
        stream = keep(stream, finite, NO_TIME)
        whole_us = np.rint(stream.columns["time_us"]).astype(np.int64)
        stream = replace(stream, columns={**stream.columns, "time_us": whole_us})
    stream = keep(stream, complete_rows(stream.name, stream.columns), EMPTY)
    stream = keep(stream, possible_rows(stream.name, stream.columns), IMPOSSIBLE)
    if set_us is not None:
        stream = keep(stream, stream.columns["time_us"] >= set_us, BEFORE_LEAP)
    far = _far_from_most(stream.columns["time_us"], usual_us)
    stream = keep(stream, ~far, BACKWARD)
    stamps = stream.columns["time_us"]
    if stamps.size and (np.diff(stamps) <= 0).any():
        stream = keep(stream, np.append(True, np.diff(stamps) != 0), REPEATED)
        stream = keep(stream, increasing(stream.columns["time_us"]), BACKWARD)
    return stream, rejected


def _far_from_most(stamps: Column, usual_us: float | None) -> Mask:
    """Return the stamps (n,) that lie a year from the median, if these are few.

    At the end of a stream such a stamp would be in order. Differences are taken in
    floats: those of destroyed stamps overflow integers. Where there are `FEW` samples the
    usual time of the log decides.
    """
    times = stamps.astype(np.float64)
    if usual_us is not None and times.size <= FEW:
        return np.asarray(np.abs(times - usual_us) > FAR_US)
    far = np.abs(times - np.median(times if times.size else [0.0])) > FAR_US
    return far if np.count_nonzero(far) <= FAR_SHARE * times.size else np.zeros_like(far)


def complete_rows(stream: str, columns: Columns) -> Mask:
    """Return the rows (n,) whose needed fields are all there.

    Of a stream without needed fields, rows with any field there.
    """
    needed = NEEDED[stream]
    if stream == "imu":  # a yaw rate may stand alone: the attitude gives the others
        needed = tuple(name for name in needed if name in columns)
    there = [_there(columns[name]) for name in needed or columns if name != "time_us"]
    return np.asarray(np.all(there, axis=0) if needed else np.any(there, axis=0))


def possible_rows(stream: str, columns: Columns) -> Mask:
    """Return the rows (n,) with all values in range.

    The range is that of the schema, or what an underwater vehicle can reach.
    """
    good = np.ones(columns["time_us"].size, bool)
    for name, values in columns.items():
        limits = schema(stream).columns[name].range or next(
            (span for key, span in POSSIBLE.items() if name.startswith(key)), None
        )
        if name == "phi_rad" and _unwrapped(columns):
            limits = POSSIBLE["psi_rad"]
        if limits is not None:
            good &= ~((values < limits[0]) | (values > limits[1]))
        if stream == "velocity" and name in LINEAR_VELOCITY:
            good &= np.abs(np.abs(values) - NO_VELOCITY_M_S) > ROUNDING_M_S
    return good


def _unwrapped(columns: Columns) -> bool:
    """Return whether roll goes on beyond a turn, as of a vehicle that turns over.

    Its steps are small, and pitch is one of radians.
    """
    if "theta_rad" not in columns:
        return False
    phi, theta = (columns[name].astype(np.float64) for name in ("phi_rad", "theta_rad"))
    steep, leaps = np.abs(theta) > STEEPEST_RAD, np.abs(np.diff(phi)) > LARGEST_ROLL_STEP_RAD
    return phi.size > 1 and max(steep.mean(), leaps.mean()) < DAMAGED_SHARE


def _there(values: Column) -> Mask:
    if values.dtype == object:
        return np.array([item is not None for item in values], bool)
    return np.asarray(np.isfinite(values))


def increasing(stamps: Ints) -> Mask:
    """Return a largest set of samples (n,) whose time stamps increase strictly.

    So one wrong stamp far ahead costs one sample. Samples that agree with all others
    are kept at once; the search for the longest increasing sequence runs on the rest.
    """
    before = np.append(np.iinfo(np.int64).min, np.maximum.accumulate(stamps)[:-1])
    after = np.append(np.minimum.accumulate(stamps[::-1])[::-1][1:], np.iinfo(np.int64).max)
    kept = (stamps > before) & (stamps < after)
    doubtful = np.flatnonzero(~kept)
    if doubtful.size:
        kept[doubtful[_longest(stamps[doubtful].tolist())]] = True
    return kept


def _longest(values: list[int]) -> list[int]:
    """Return indices of a longest strictly increasing subsequence (patience sort)."""
    tails: list[int] = []
    ends: list[int] = []
    previous = [-1] * len(values)
    for index, value in enumerate(values):
        pile = bisect_left(tails, value)
        previous[index] = ends[pile - 1] if pile else -1
        if pile == len(tails):
            tails.append(value)
            ends.append(index)
        else:
            tails[pile], ends[pile] = value, index
    chain = []
    index = ends[-1]
    while index >= 0:
        chain.append(index)
        index = previous[index]
    return chain[::-1]


def clock_set(clocks: Sequence[Column]) -> int | None:
    """Return the time to which the clock was set during the log; None if it was not.

    The longest stream shows it as a jump of more than 30 days.
    """
    if not clocks:
        return None
    stamps = np.asarray(max(clocks, key=len), dtype=np.float64)
    jumps = np.flatnonzero(np.diff(stamps) > LEAP_US)
    # Stamps far ahead come back down, or are the last; a clock that was set stays.
    stays = [
        index
        for index in jumps
        if np.median(stamps[index + 1 :]) - stamps[index] > LEAP_US
        and stamps.size - index - 1 > FEW
    ]
    return int(np.rint(stamps[stays[0] + 1])) if stays else None


def usual_time(clocks: Sequence[Column], *, set_us: int | None) -> float | None:
    """Return the median of the time stamps of all streams, each at most a thousand.

    Those before the clock was set are left out. None where no stamp is there.
    """
    parts = [np.asarray(clock[:: 1 + len(clock) // 1000], dtype=np.float64) for clock in clocks]
    times = np.concatenate([np.empty(0), *parts])
    times = times[np.isfinite(times) & (times >= (-np.inf if set_us is None else set_us))]
    return float(np.median(times)) if times.size else None
