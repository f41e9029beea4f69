"""One recorded swing from the raw streams of a log: its axis, rate and angle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import CampaignError, DataError, nearest
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import has_columns
from auvid.hydro.arrays import Array
from auvid.hydro.identification.bench.swing import (
    SwingAxis,
    angle_about,
    angle_per_rate,
    outside_range,
    release_index,
    swing_axis,
)
from auvid.hydro.identification.signals.splines import smoothing_spline
from auvid.stages.base import Collection
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, GYRO, Samples, leg_window, samples_within

MIN_SAMPLES = 50
MOST_CLIPPED_PERCENT = 80.0
"""Beyond this only the zero crossings are left. At 73 % the inertia of a swing of 40
degrees is 0.5 % off.
"""
ASKEW_DEG = 5.0
"""A recorder turned by more than this against the nearest of its axes is worth a word."""
ONE_AXIS = 0.95
"""Share of the rotation that must be about one axis; the rest is twist or sway of the
pendulum.
"""
UPRIGHT_DEG = 20.0
LEVELLED = 0.02
"""Share by which an attitude may differ from the turn of the gyro; an autopilot that
takes the swing's accelerations for gravity does.
"""


@dataclass(frozen=True)
class SwingRecording:
    """One recorded swing: rate (n,) about its axis at t_s (n,).

    Also which samples are not clipped, and the angle at its own times, if logged.

    Times in s from the start of the log. `warnings`: what is doubtful.
    """

    leg: str
    validation: bool
    t_s: Array
    rate: Array
    usable: npt.NDArray[np.bool_]
    angle: Samples | None
    axis: SwingAxis
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Logs:
    """The legs of a campaign and what its logs hold."""

    legs: Mapping[str, LegEntry]
    log_info: Mapping[str, LogInfo]
    imu: Collection[pa.Table] | None
    attitude: Collection[pa.Table] | None

    def recording(self, leg_id: str, field: str, *, upright: bool) -> SwingRecording:
        """Return the swing of a leg.

        upright: its axis should be vertical (quadrifilar), else level (free decay).

        Raises `CampaignError` for a leg that the manifest does not have, `DataError`
        where its log has neither gyro nor attitude.
        """
        if leg_id not in self.legs:
            remedy = nearest(leg_id, self.legs)
            raise CampaignError(
                "no such leg in the manifest",
                field=field,
                value=leg_id,
                allowed=self.legs,
                remedy=remedy,
            )
        leg = self.legs[leg_id]
        log = leg.log
        info = self.log_info[log]
        start_us = int(info.start_us)
        window = leg_window(leg, start_us, int(info.end_us))

        def samples(tables: Collection[pa.Table] | None, names: tuple[str, ...]) -> Samples | None:
            if tables is None or log not in tables:
                return None
            table = tables[log]
            if not has_columns(table, names):
                return None
            chosen = samples_within(table, names, start_us=start_us, lag_s=0.0, window=window)
            return chosen if chosen.t_s.size >= MIN_SAMPLES else None

        gyro, attitude = samples(self.imu, GYRO), samples(self.attitude, ATTITUDE)
        if gyro is None and attitude is None:
            raise DataError(
                f"leg '{leg_id}' has neither gyro nor attitude of a pendulum",
                allowed=f"at least {MIN_SAMPLES} samples",
                remedy=(
                    "Log the IMU or the attitude of an autopilot on the pendulum; check start_s and"
                    " end_s of the leg."
                ),
            )
        return _recording(leg, gyro, attitude, samples(self.imu, ACCELEROMETER), upright)


def _recording(
    leg: LegEntry,
    gyro: Samples | None,
    attitude: Samples | None,
    accel: Samples | None,
    upright: bool,
) -> SwingRecording:
    notes: list[str] = []
    warnings: list[str] = []
    if gyro is not None:
        usable = _unclipped(gyro.values, leg.id, warnings)
        axis = swing_axis(gyro.values[usable])
        t, rate = gyro.t_s, gyro.values @ axis.axis
    else:
        assert attitude is not None
        rates = _rates(attitude)
        axis = swing_axis(rates)
        t, rate, usable = (
            attitude.t_s,
            rates @ axis.axis,
            np.ones(attitude.t_s.size, dtype=np.bool_),
        )
        notes.append("No gyro: the rate is the slope of the logged attitude.")
    angle = (
        None
        if attitude is None
        else Samples(attitude.t_s, angle_about(attitude.values, axis.axis)[:, None])
    )
    if angle is not None and gyro is not None and usable.all() and not upright:
        angle = _agreeing(angle, t, rate, warnings)
    _judge_axis(axis, accel, upright, notes, warnings)
    return SwingRecording(
        leg.id,
        leg.use == "validation",
        t,
        rate,
        usable,
        angle,
        axis,
        tuple(notes),
        tuple(warnings),
    )


def _rates(attitude: Samples) -> Array:
    """Return rotation rates (n, 3) from an attitude; turns are below half a turn."""
    turns = np.column_stack([angle_about(attitude.values, axis) for axis in np.eye(3)])
    spline = smoothing_spline(attitude.t_s, turns)
    return spline.evaluate(attitude.t_s, 1)


def _unclipped(gyro: Array, leg: str, warnings: list[str]) -> npt.NDArray[np.bool_]:
    """Return which samples (n,) of a gyro (n, 3) are within its range on all axes.

    Raises `DataError` where too few are left.
    """
    clipped = outside_range(gyro)
    count, share = int(np.count_nonzero(clipped)), 100.0 * float(np.mean(clipped))
    if share > MOST_CLIPPED_PERCENT:
        words = f"the gyro of leg '{leg}' is clipped in {count} of {clipped.size} samples"
        raise DataError(
            words,
            allowed=f"at most {MOST_CLIPPED_PERCENT:g} %",
            remedy="Choose a larger range of the gyro, or swing less far.",
        )
    if count:
        warnings.append(
            f"The gyro is clipped in {count} samples ({share:.1f} %), which are left out: choose a"
            " larger range."
        )
    return ~clipped


def _agreeing(angle: Samples, t: Array, rate: Array, warnings: list[str]) -> Samples | None:
    """Return the angle of the attitude, None where it disagrees with the gyro."""
    first = release_index(rate)
    share = angle_per_rate(t[first:], rate[first:], angle.t_s, angle.values[:, 0])
    if not abs(share - 1.0) > LEVELLED:
        return angle
    warnings.append(
        f"The logged attitude shows {100.0 * share:.0f} % of the swing that the gyro shows and is"
        " not used: an autopilot takes the accelerations of the swing for gravity. The angle is"
        " that of the gyro."
    )
    return None


def _judge_axis(
    axis: SwingAxis, accel: Samples | None, upright: bool, notes: list[str], warnings: list[str]
) -> None:
    askew = float(np.degrees(axis.misalignment_rad))
    notes.append(
        f"It turns about the recorder's {axis.nearest} axis, {askew:.1f} degrees off, with"
        f" {100.0 * axis.share:.1f} % of its rotation."
    )
    if axis.share < ONE_AXIS:
        warnings.append(
            "The pendulum also turned about other axes: it twisted or swayed, which the model does"
            " not have."
        )
    if accel is None:
        return
    down = np.median(accel.values, axis=0)
    length = float(np.linalg.norm(down))
    if length < 5.0:  # gravity is not in it
        return
    tilt = float(np.degrees(np.arccos(min(1.0, abs(float(down @ axis.axis)) / length))))
    if (upright and tilt > UPRIGHT_DEG) or (not upright and tilt < 90.0 - UPRIGHT_DEG):
        expected = "upright" if upright else "level"
        warnings.append(
            f"The axis of the swing stands {tilt:.0f} degrees off the vertical, but should be"
            f" {expected}: is this the right leg?"
        )


@contextmanager
def naming(leg: str) -> Iterator[None]:
    """Name the leg in data errors raised inside."""
    try:
        yield
    except DataError as fault:
        words = fault.message if f"'{leg}'" in fault.message else f"leg '{leg}': {fault.message}"
        raise DataError(
            words, field=fault.field, value=fault.value, allowed=fault.allowed, remedy=fault.remedy
        ) from fault
