"""Quaternions, world velocities and poses of a CSV file, turned into auvid's axes.

These need several columns at once: the fields of one stream are turned together, and
all of them must be in one frame.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.streams import NEEDED
from auvid.hydro.arrays import Array
from auvid.hydro.identification.signals.pose.fixes import metres_from_degrees
from auvid.hydro.identification.signals.pose.frames import (
    Body,
    World,
    euler_of_quaternion,
    in_ned,
    ned_from_frd,
    quaternion_of_euler,
)
from auvid.stages.columns import ATTITUDE, GYRO, LINEAR_VELOCITY, POSITION, named
from auvid.stages.ingest.streams.common import to_body_at

Fields = dict[str, npt.NDArray[Any]]

QUATERNION = ("q_w", "q_x", "q_y", "q_z")
WORLD_VELOCITY = ("v_north_m_s", "v_east_m_s", "v_down_m_s")
"""Velocity in the world of the file: with frame enu its x, y and z fill them."""
GLOBE, FIX = ("latitude_rad", "longitude_rad"), ("north_m", "east_m")
EXTRA_FIELDS: Mapping[str, Mapping[str, str]] = {
    "attitude": dict.fromkeys(QUATERNION, "1"),
    "pose": dict.fromkeys(QUATERNION, "1"),
    "velocity": dict.fromkeys(WORLD_VELOCITY, "m/s"),
    "fixes": dict.fromkeys(GLOBE, "rad"),
}
"""Fields of a column map that streams do not have, with their unit: they are turned."""
REPLACED: Mapping[tuple[str, ...], tuple[str, ...]] = {
    QUATERNION: ATTITUDE,
    WORLD_VELOCITY: LINEAR_VELOCITY,
    GLOBE: FIX,
}
FRAMES: Mapping[str, tuple[World, Body]] = {
    "ned": ("ned", "frd"),
    "frd": ("ned", "frd"),
    "enu": ("enu", "flu"),
    "flu": ("nwu", "flu"),
    "y_up": ("nue", "fur"),
}
"""Word of a column map -> world and body axes of a pose or a quaternion."""


ORDERS = {
    "x, y, z, w and not w, x, y, z": (3, 0, 1, 2),
    "w, x, y, z and not x, y, z, w": (1, 2, 3, 0),
    "w, z, y, x and not w, x, y, z": (0, 3, 2, 1),
}
"""Order of the file, and the place in what is read of the right w, x, y, z."""
ON_ITS_BACK, UPRIGHT, MOSTLY, ON_SIDE = 0.02, 0.7, 0.95, 0.5
"""Share of the time on its back, cosine of the tilt of an upright vehicle, how long it is
upright in the right order, and cosine of the tilt of one on its side.
"""


def turned_together(stream: str, field: str) -> bool:
    """Return whether a field is turned with its group, not by itself."""
    return stream == "pose" or field in EXTRA_FIELDS.get(stream, {})


def lacking_fields(mapped: Collection[tuple[str, str]], stream: str) -> list[str]:
    """Return the needed fields of a stream that the mapped ones do not give.

    mapped: stream and field of all columns; a yaw rate needs no others with an attitude.
    """
    own = {name for of, name in mapped if of == stream}
    lacking = [name for name in NEEDED[stream] if name not in own]
    if stream == "imu" and lacking == list(GYRO[:2]):
        streams = {of for of, _ in mapped} & {"attitude", "pose"}
        if any(not lacking_fields(mapped, of) for of in streams):
            return []
    for group, replaced in REPLACED.items():
        if any(name in own for name in group) and set(replaced) & set(lacking):
            rest = [name for name in group if name not in own]
            lacking = [*(name for name in lacking if name not in replaced), *rest]
    return lacking


def in_own_axes(stream: str, fields: Fields, frame: str) -> Fields:
    """Return fields (n,) of pose or attitude in NED and FRD, quaternions as angles.

    Latitude and longitude of fixes become metres north and east of the first.
    """
    if stream == "fixes" and set(GLOBE) <= set(fields):
        rest = {key: values for key, values in fields.items() if key not in GLOBE}
        return rest | named(FIX, metres_from_degrees(*_columns(fields, GLOBE).T))
    world, body = FRAMES[frame or "ned"]
    has_quaternion = set(QUATERNION) <= set(fields)
    if stream not in ("pose", "attitude") or not (stream == "pose" or has_quaternion):
        return fields
    rest = {key: values for key, values in fields.items() if key not in QUATERNION}
    angles = _columns(fields, QUATERNION if has_quaternion else ATTITUDE)
    if has_quaternion or world != "nue":
        q = angles if has_quaternion else quaternion_of_euler(angles)
        angles = euler_of_quaternion(ned_from_frd(q, world, body))
    else:  # with y up: roll about x, then pitch about z, then yaw about y
        angles = angles * [1.0, 1.0, -1.0]
    rest |= named(ATTITUDE, angles)
    if stream == "pose":
        rest |= named(POSITION, in_ned(_columns(fields, POSITION), world))
    return rest


def right_order(fields: Fields, frame: str) -> str:
    """Return in which order a quaternion keeps the vehicle upright; empty if as it is.

    Another order is right where this one has the vehicle on its back.
    """
    if not set(QUATERNION) <= set(fields):
        return ""
    q = _columns(fields, QUATERNION)
    if np.mean(_upright(q, frame) < 0.0) > ON_ITS_BACK:
        for words, order in ORDERS.items():
            if np.mean(_upright(q[:, order], frame) > UPRIGHT) > MOSTLY:
                return words
    return ""


def upright_with_y_up(quaternion: Array) -> bool:
    """Tell whether a vehicle is upright with y up, and sometimes on its side if not."""
    q = quaternion[np.linalg.norm(quaternion, axis=1) > 0.0]
    on_its_side = np.mean(_upright(q, "ned") < ON_SIDE) > ON_ITS_BACK
    return bool(on_its_side and np.mean(_upright(q, "y_up") > UPRIGHT) > MOSTLY)


def _upright(quaternion: Array, frame: str) -> Array:
    """Return the cosine (n,) of the angle between down of the body and of the world."""
    square = ned_from_frd(quaternion, *FRAMES[frame or "ned"]) ** 2
    return np.asarray(1.0 - 2.0 * (square[:, 1] + square[:, 2]) / square.sum(axis=1))


def velocity_in_body_axes(fields: Fields, frame: str, attitude: Fields | None) -> Fields:
    """Return the fields of a velocity, those of the world turned by the attitude.

    NaN where there is no attitude.
    """
    world, _ = FRAMES[frame or "ned"]
    ned = in_ned(_columns(fields, WORLD_VELOCITY), world)
    rest = {key: values for key, values in fields.items() if key not in WORLD_VELOCITY}
    at = None if attitude is None else attitude["time_us"]
    angles = [] if attitude is None else [attitude[name] for name in ATTITUDE]
    return rest | to_body_at(fields["time_us"], ned.T, at, angles)


def _columns(fields: Fields, names: Sequence[str]) -> Array:
    return np.column_stack([np.asarray(fields[name], dtype=np.float64) for name in names])
