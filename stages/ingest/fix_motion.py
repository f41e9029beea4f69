"""Velocity and position from position fixes, where no sensor of the log measures them.

Fixes are taken as those of the place of `sensors.pose` in the vehicle file, whose lag is
taken off; its arm is not, as it is below the noise of any acoustic fix. The velocity is
written as `sensors.dvl` would report it, since what follows takes arm, mounting and lag of
that off again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, cross
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.pose.fixes import COARSE, FixTrack, fix_track
from auvid.stages.columns import (
    ATTITUDE,
    GYRO,
    LINEAR_VELOCITY,
    OF_FIXES,
    POSITION,
    TOO_COARSE,
    named,
)
from auvid.stages.ingest.streams.common import Columns, to_body_at
from auvid.stages.ingest.streams.mapping import Stream

FIX = ("north_m", "east_m")


@dataclass(frozen=True)
class FixMotion:
    """Streams made from a log's fixes, and notes for a reader."""

    track: FixTrack | None = None
    streams: Mapping[str, Stream] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def fix_motion(streams: Mapping[str, Stream], vehicle: Vehicle | None) -> FixMotion:
    """Return velocity and position from a log's fixes, those that it lacks.

    A velocity needs an attitude; fixes too coarse for one say so and give none.
    """
    if "fixes" not in streams:
        return FixMotion()
    fixes = streams["fixes"]
    stamps = fixes.columns["time_us"]
    markers = vehicle and vehicle.markers
    late_us = 1e6 * markers.lag_s if markers else 0.0
    try:
        track = fix_track(
            (stamps - stamps[0]) / 1e6, np.column_stack([fixes.columns[name] for name in FIX])
        )
    except DataError as fault:
        return FixMotion(notes=(f"nothing is taken from the position fixes: {fault}",))
    time_us = stamps[0] + np.rint(track.t_s * 1e6 - late_us).astype(np.int64)
    rows = fixes.place[np.searchsorted(stamps, time_us).clip(0, len(fixes) - 1)]
    noise, deviation = (
        float(np.sqrt(np.mean(values**2))) for values in (track.noise_m, track.velocity_sd)
    )
    about = (
        f"position fixes ({fixes.source}): noise {noise:.2g} m, {track.outliers} outliers left out;"
        f" velocity by a smoother, standard deviation {deviation:.2g} m/s"
    )
    source = f"{OF_FIXES}{fixes.source}"
    by_stream: dict[str, Columns] = {}
    depth, depth_rate = _depth(streams, time_us)
    if "position" not in streams and depth is not None:
        by_stream["position"] = named(POSITION, np.column_stack([track.position, depth]))
    if "velocity" in streams:
        about += "; the log's own velocity is taken"
    elif track.too_coarse:
        about += (
            f", {track.coarseness:.0%} of what is there ({COARSE:.0%} at most): {TOO_COARSE}."
            " Surge and sway are not measured; heave by depth and yaw by gyro are"
        )
    elif "attitude" not in streams:
        about += "; without an attitude it cannot be turned into body axes"
    else:
        attitude = streams["attitude"].columns
        ned = np.column_stack([track.velocity, depth_rate]).T
        angles = [attitude[name] for name in ATTITUDE]
        body = to_body_at(time_us, ned, attitude["time_us"], angles)
        finite = np.all([np.isfinite(values) for values in body.values()], axis=0)
        by_stream["velocity"] = _as_logged(body, streams, time_us, vehicle)
        if not finite.all():
            by_stream = {key: _rows(columns, finite) for key, columns in by_stream.items()}
            time_us, rows = time_us[finite], rows[finite]
        if depth is None:
            about += "; without a depth its vertical speed is taken as 0: heave is not measured"
        about += (
            "; no sensor measures u, v, w, and what changes within a few seconds is smoothed away"
        )
    lag_us = {"velocity": round(1e6 * vehicle.dvl.lag_s)} if vehicle else {}
    derived = {
        name: Stream(name, {"time_us": time_us + lag_us.get(name, 0), **columns}, rows, source)
        for name, columns in by_stream.items()
        if time_us.size
    }
    return FixMotion(track, derived, (about,))


def _as_logged(
    body: Columns, streams: Mapping[str, Stream], time_us: Array, vehicle: Vehicle | None
) -> Columns:
    """Return the velocity of the body as the log of the vehicle file reports it.

    R' (v + omega x arm), R from log axes to body axes, omega by the gyro where there is one.
    """
    if vehicle is None:
        return body
    velocity = np.column_stack([body[name] for name in LINEAR_VELOCITY])
    if "imu" in streams and np.isfinite(streams["imu"].columns[GYRO[2]]).any():
        gyro = streams["imu"].columns
        rates = np.column_stack([gyro[name] for name in GYRO])
        good, at = np.isfinite(rates).all(axis=1), gyro["time_us"] - 1e6 * vehicle.imu.lag_s
        turn = [np.interp(time_us, at[good], column) for column in rates[good].T]
        rate = np.column_stack(turn) @ vehicle.imu.rotation.T
        velocity = velocity + cross(rate, np.broadcast_to(vehicle.dvl.arm_m, rate.shape))
    return named(LINEAR_VELOCITY, velocity @ vehicle.dvl.rotation)


def _rows(columns: Columns, kept: Array) -> Columns:
    return {name: values[kept] for name, values in columns.items()}


def _depth(streams: Mapping[str, Stream], time_us: Array) -> tuple[Array | None, Array]:
    """Return depth (n,), None without one, and its rate (n,) between fixes."""
    if "depth" not in streams:
        return None, np.zeros(time_us.size)
    at, depth = (streams["depth"].columns[name] for name in ("time_us", "depth_m"))
    good = np.isfinite(depth)
    step = max(float(np.median(np.diff(time_us))), 1e6)
    before, after = (
        np.interp(time_us + side * step / 2, at[good], depth[good]) for side in (-1.0, 1.0)
    )
    return np.interp(time_us, at[good], depth[good]), (after - before) / (step / 1e6)
