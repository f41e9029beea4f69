"""Streams that a track of poses fills where no sensor of the log does.

They are given as the sensors of the vehicle file would report them, at their places and
with their lags, so that whatever takes places and lags out treats both alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, cross
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor, Vehicle
from auvid.hydro.identification.signals.pose.frames import (
    quaternion_of_euler,
    quaternion_product,
)
from auvid.hydro.identification.signals.pose.track import PoseTrack, pose_track
from auvid.stages.columns import ATTITUDE, GYRO, LINEAR_VELOCITY, OF_POSES, POSITION, named
from auvid.stages.ingest.health.finding import listed
from auvid.stages.ingest.streams.common import Columns
from auvid.stages.ingest.streams.mapping import Stream

AT_ORIGIN = MountedSensor(np.zeros(3), np.eye(3), 0.0)
JUMP_MARGIN_S = 0.6
"""So much on either side of a jump is left out: the pause parts a leg there."""


@dataclass(frozen=True)
class PoseMotion:
    """The track of a log's poses, streams made from it, and notes for a reader."""

    track: PoseTrack | None = None
    streams: Mapping[str, Stream] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def pose_motion(
    streams: Mapping[str, Stream], vehicle: Vehicle | None, *, yaw_rate_logged: bool = False
) -> PoseMotion:
    """Return velocity, imu (gyro), attitude, depth and position from a log's poses.

    Only those that no sensor of the log fills. yaw_rate_logged: the yaw rate of that gyro
    is to give way to a logged one, which has a note of its own.
    """
    if "pose" not in streams:
        return PoseMotion()
    pose = streams["pose"]
    markers = (vehicle and vehicle.markers) or AT_ORIGIN
    stamps = pose.columns["time_us"]
    try:
        track = pose_track(
            (stamps - stamps[0]) / 1e6 - markers.lag_s,
            np.column_stack([pose.columns[name] for name in POSITION]),
            _of_body(np.column_stack([pose.columns[name] for name in ATTITUDE]), markers),
            arm_m=markers.arm_m,
        )
    except DataError as fault:
        return PoseMotion(notes=(f"nothing is taken from the poses: {fault}",))
    kept = np.ones(track.t_s.size, dtype=np.bool_)
    for item in track.faults:
        if item.kind == "jump":
            near = (track.t_s > item.start_s - JUMP_MARGIN_S) & (
                track.t_s < item.end_s + JUMP_MARGIN_S
            )
            kept &= ~near
    absent = {
        name: derived for name, derived in _sensed(track, vehicle).items() if name not in streams
    }
    derived = {}
    for name, (columns, lag_s) in absent.items():
        time_us = stamps[0] + np.rint((track.t_s[kept] + lag_s) * 1e6).astype(np.int64)
        values: Columns = {"time_us": time_us}
        values |= {key: column[kept] for key, column in columns.items()}
        rows = pose.place[np.searchsorted(stamps, time_us).clip(0, len(pose) - 1)]
        derived[name] = Stream(name, values, rows, f"{OF_POSES}{pose.source}")
    notes = []
    if "velocity" in derived:
        sd = np.median(track.velocity_sd[kept], axis=0)
        notes.append(
            "velocity is derived from the poses"
            f" ({pose.source}) by a smoother, no sensor measures it; standard error of u, v, w"
            f" {', '.join(f'{value:.2g}' for value in sd)} m/s"
        )
    own_note = ("velocity", "position", *(["imu"] if yaw_rate_logged else []))
    others = [name for name in derived if name not in own_note]
    if others:
        verb = "comes" if len(others) == 1 else "come"
        notes.append(f"{listed(others)} {verb} from the poses too")
    if "depth" in derived:
        notes.append("zero of the depth is that of the tracking system, not the surface")
    return PoseMotion(track, derived, tuple(notes))


def _of_body(markers: Array, place: MountedSensor) -> Array:
    """Return quaternions (n, 4) of the body from the angles (n, 3) of its markers.

    R_nb = R_nm R_mb, with `place.rotation` R_bm.
    """
    turn = place.rotation
    mounting = np.array(
        [
            [
                np.arctan2(turn[2, 1], turn[2, 2]),
                -np.arcsin(np.clip(turn[2, 0], -1.0, 1.0)),
                np.arctan2(turn[1, 0], turn[0, 0]),
            ]
        ]
    )
    back = quaternion_of_euler(mounting)[0] * np.array([1.0, -1.0, -1.0, -1.0])
    return quaternion_product(quaternion_of_euler(markers), back)


def _sensed(track: PoseTrack, vehicle: Vehicle | None) -> dict[str, tuple[dict[str, Array], float]]:
    """Return the columns that each sensor would report, and its lag [s]."""
    log = vehicle.dvl if vehicle else AT_ORIGIN
    gyro = vehicle.imu if vehicle else AT_ORIGIN
    pressure = vehicle.depth_sensor if vehicle else AT_ORIGIN
    arm = np.broadcast_to(log.arm_m, track.rate.shape)
    at_log = (track.velocity + cross(track.rate, arm)) @ log.rotation
    down = rotation_body_to_ned(track.attitude)[:, 2, :] @ pressure.arm_m
    return {
        "imu": (named(GYRO, track.rate @ gyro.rotation), gyro.lag_s),
        "attitude": (named(ATTITUDE, track.attitude), gyro.lag_s),
        "depth": ({"depth_m": track.position[:, 2] + down}, pressure.lag_s),
        "velocity": (named(LINEAR_VELOCITY, at_log), log.lag_s),
        "position": (named(POSITION, track.position), 0.0),
    }
