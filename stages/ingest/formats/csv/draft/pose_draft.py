"""Poses in a drafted column map: which columns, which motion, which frame."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.signals.pose.frames import (
    continuous_signs,
    quaternion_of_euler,
    quaternion_product,
    rotated,
)
from auvid.stages.columns import ATTITUDE, POSITION, named
from auvid.stages.ingest.formats.csv.column_names import NamedColumn
from auvid.stages.ingest.formats.csv.draft.answered_commands import answered_commands
from auvid.stages.ingest.formats.csv.pose_columns import QUATERNION, in_own_axes, upright_with_y_up

SMOOTHED_S = 0.3
TURNED_AXES = ("v", "w", "q", "r")
"""Velocities that change sign between forward-right-down and forward-left-up."""
PLACES = tuple(("position", name) for name in POSITION)
FULL_TURN, LARGEST_M = 6.4, 100.0
"""Angles beyond are in degrees, positions of a tank beyond in mm."""
UPWARD_FRAME = re.compile(
    r"^(?!.*(?:ned|frd)).*(?:map|odom|world|base_link|enu|flu)", re.IGNORECASE
)
"""Frames of ROS with z up; one that says ned has z down."""
MAVROS = "mavros/local_position"
Y_UP, Y_UP_ANSWERS = "y_up", 0.8
"""Frame of tracking systems, and how much more all correlations with commands sum up to in it."""
MORE_LEVEL_RAD = 0.05
"""Numbered parts of a quaternion have w last where the mean tilt is so much smaller then."""


def with_pose(columns: Sequence[NamedColumn]) -> list[NamedColumn]:
    """Return the columns with position and attitude as a pose where nothing else moves.

    A file with a velocity or a gyro is that of a vehicle: its attitude stays one.
    Quaternions take the place of roll, pitch and yaw where there are none.
    """
    places = {item.place for item in columns}
    parts = {item.part: item for item in columns if item.in_quaternion}
    has_quaternion = set(parts) == set("wxyz")
    has_angles = {("attitude", name) for name in ATTITUDE} <= places
    has_position = {("position", name) for name in POSITION} <= places
    moves = any(place and place[0] in ("velocity", "imu") for place in places)
    is_pose = (has_angles or has_quaternion) and has_position and not moves
    columns = [item if is_pose else _by_compass(item) for item in columns]
    if not (has_angles or has_quaternion):
        return columns
    stream = "pose" if is_pose else "attitude"
    upward = {item.frame for item in columns if item.frame and item.place in PLACES}
    frame = upward.pop() if is_pose and len(upward) == 1 else ""
    placed = []
    for item in columns:
        if has_quaternion and not has_angles and item is parts.get(item.part):
            item = replace(item, place=(stream, f"q_{item.part}"), unit="1")
        elif (
            stream == "pose"
            and item.place is not None
            and item.place[0]
            in (
                "position",
                "attitude",
            )
        ):
            item = replace(item, place=(stream, item.place[1]))
        if frame and item.place is not None and item.place[0] == "pose":
            item = replace(item, frame=frame)  # a pose is in one frame
        placed.append(item)
    return placed


def is_numbered(item: NamedColumn) -> bool:
    """Return whether a column is a part of a quaternion that only its number tells."""
    of_quaternion = item.place is not None and item.place[1].startswith("q_")
    return of_quaternion and not item.name.lower().endswith(item.part)


def with_level_order(
    columns: Sequence[NamedColumn], values: Mapping[str, Array]
) -> list[NamedColumn]:
    """Return the columns with w of a numbered quaternion last where that is more level.

    A vehicle changes its heading more than its tilt; in the wrong order headings are tilts.
    """
    parts = [next((item for item in columns if item.part == part), None) for part in "wxyz"]
    if not all(item is not None and is_numbered(item) for item in parts):
        return list(columns)
    q = np.column_stack([values[item.name] for item in parts if item is not None])
    if _tilt_rad(q) - _tilt_rad(q[:, [3, 0, 1, 2]]) < MORE_LEVEL_RAD:
        return list(columns)
    later = dict(zip("wxyz", "xyzw", strict=True))
    return [
        replace(item, place=(item.place[0], f"q_{later[item.part]}"))
        if item.place is not None and item in parts
        else item
        for item in columns
    ]


def _tilt_rad(q: Array) -> float:
    """Return the mean tilt of quaternions (n, 4), w first; 0 is upside down, too."""
    q = q[np.isfinite(q).all(axis=1) & (np.linalg.norm(q, axis=1) > 0.0)]
    if not len(q):
        return 0.0
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    return float(np.mean(np.arccos(np.minimum(np.abs(w**2 - x**2 - y**2 + z**2), 1.0))))


def _by_compass(item: NamedColumn) -> NamedColumn:
    """Return a coordinate of an east-north-up position by where it points."""
    if item.frame != "enu" or item.place not in PLACES:
        return item
    to = {"x_m": "y_m", "y_m": "x_m", "z_m": "z_m"}[item.place[1]]
    return replace(item, place=("position", to))


def in_named_frame(
    columns: Sequence[NamedColumn], texts: Mapping[str, Sequence[str]]
) -> tuple[list[NamedColumn], tuple[str, ...]]:
    """Return the columns in the frame that a header names, and words.

    Messages of ROS name one (`frame_id`): map, odom, world, base_link have z up, body axes
    forward, left, up (REP 103), unless the name says ned. MAVROS gives its poses so.
    """
    names = {
        name: next((text.strip() for text in cells if text.strip()), "")
        for name, cells in texts.items()
        if name.lower().endswith("frame_id")
    }
    upward = [name for name, value in names.items() if UPWARD_FRAME.search(value)]
    of_ros = any(MAVROS in item.name.lower() for item in columns if item.place is not None)
    moved = [_upward(item) for item in columns]
    if not (upward or (of_ros and not names)) or any(item.frame for item in columns):
        return list(columns), ()
    if moved == list(columns):
        return list(columns), ()
    why = f"{upward[0]} is {names[upward[0]]}" if upward else "a topic of MAVROS"
    return moved, (f"{why}: z up, as ROS has it (REP 103), east-north-up and forward-left-up.",)


def _upward(item: NamedColumn) -> NamedColumn:
    """Return a column in axes with z up, where it has any."""
    stream = item.place[0] if item.place else ""
    if stream in ("pose", "attitude"):
        return replace(item, frame="enu")
    if stream in ("velocity", "imu"):
        return replace(item, frame="flu")
    return _by_compass(replace(item, frame="enu")) if stream == "position" else item


def pose_unit(name: str, size: float) -> tuple[str, str]:
    """Return the unit of a column of a pose by its size, and what was assumed."""
    if name in POSITION:
        return ("mm", "by its size") if size > LARGEST_M else ("m", "by its size")
    return (
        ("deg", "by its size") if size > FULL_TURN else ("rad", "no value is beyond a turn in rad")
    )


def pose_velocities(
    columns: Sequence[NamedColumn], values: Mapping[str, Array], t_s: Array, frame: str = "ned"
) -> dict[str, Array]:
    """Return u v w p q r (n,) of a drafted pose by differences; empty without one.

    As if the file were in a frame of column maps: for correlations, not for a fit.
    """
    by_field = {item.place[1]: item for item in columns if item.place and item.place[0] == "pose"}
    angles = [by_field.get(name) for name in ATTITUDE]
    parts = [by_field.get(f"q_{part}") for part in "wxyz"]
    place = [by_field.get(name) for name in POSITION]
    if None in place or (None in angles and None in parts):
        return {}

    def table(chosen: Sequence[NamedColumn | None], limit: float, factor: float) -> Array:
        rows = np.column_stack([values[item.name] for item in chosen if item])
        unit = next((item.unit for item in chosen if item and item.unit), "")
        large = unit in ("mm", "deg") or (not unit and np.nanmax(np.abs(rows)) > limit)
        return np.asarray(rows * factor if large else rows)

    fields = named(POSITION, table(place, LARGEST_M, 1e-3))
    fields |= (
        named(QUATERNION, table(parts, np.inf, 1.0))
        if None in angles
        else named(ATTITUDE, table(angles, FULL_TURN, np.pi / 180.0))
    )
    fields = in_own_axes("pose", fields, frame)
    position = np.column_stack([fields[name] for name in POSITION])
    q = quaternion_of_euler(np.column_stack([fields[name] for name in ATTITUDE]))
    good = np.isfinite(position).all(axis=1) & np.isfinite(q).all(axis=1) & np.isfinite(t_s)
    good &= np.append(True, np.diff(t_s) > 0.0) & (np.linalg.norm(q, axis=1) > 0.0)
    if np.count_nonzero(good) < 10:
        return {}
    t, position, q = t_s[good], position[good], continuous_signs(q[good])
    width = max(1, round(SMOOTHED_S / float(np.median(np.diff(t)))))
    kernel = np.ones(width) / width
    both = np.column_stack(
        [
            np.convolve(np.gradient(column, t), kernel, "same")
            for column in np.hstack([position, q]).T
        ]
    )
    back = q * np.array([1.0, -1.0, -1.0, -1.0])
    body = np.hstack(
        [rotated(back, both[:, :3]), 2.0 * quaternion_product(back, both[:, 3:])[:, 1:]]
    )
    return {axis: np.interp(t_s, t, body[:, k]) for k, axis in enumerate("uvwpqr")}


def pose_frame(commands: Mapping[str, Array], motions: Mapping[str, Array], t_s: Array) -> str:
    """Return the axes of a pose that commands by axis show: frd, flu, or ''.

    Of sway, heave, pitch and yaw two or more answer, all as they are or all reversed: two
    axes at once are a frame, one by itself is a command.
    """
    signs = []
    for axis in TURNED_AXES:
        if axis in commands:
            one = {axis: motions[axis]}
            signs += [
                item.correlation for item in answered_commands(t_s, {axis: commands[axis]}, one)
            ]
    if len(signs) < 2:
        return ""
    return "flu" if max(signs) < 0.0 else "frd" if min(signs) > 0.0 else ""


def in_frame_with_y_up(
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
    t_s: Array,
    by_axis: Mapping[str, Array],
    numbered: Mapping[str, Array],
) -> list[NamedColumn]:
    """Return the columns with those of the pose in a frame with y up where it is.

    A name says it, or commands `by_axis` (u, v ...) answer clearly better so, or those without
    an axis (`numbered`) do, of which an upright vehicle that lies on its side otherwise is a
    sign as well.
    """
    pose = {item.place[1]: item for item in columns if item.place and item.place[0] == "pose"}
    frames = {item.frame for item in pose.values()}
    if not pose or frames - {"", Y_UP}:
        return list(columns)
    if Y_UP not in frames:
        as_is, upward = (pose_velocities(columns, values, t_s, frame) for frame in ("ned", Y_UP))
        if not as_is or not (by_axis or numbered):
            return list(columns)
        parts = [pose.get(name) for name in QUATERNION]
        q = [values[item.name] for item in parts if item]
        on_its_side = not by_axis and len(q) == 4 and upright_with_y_up(np.column_stack(q))
        more = _answering(by_axis, numbered, upward, t_s) - _answering(
            by_axis, numbered, as_is, t_s
        )
        if not on_its_side and more < Y_UP_ANSWERS:
            return list(columns)
    return [replace(item, frame=Y_UP) if item in pose.values() else item for item in columns]


def _answering(
    by_axis: Mapping[str, Array],
    numbered: Mapping[str, Array],
    motions: Mapping[str, Array],
    t_s: Array,
) -> float:
    """Return the sum of the correlations of commands with what answers them."""
    pairs = [({axis: by_axis[axis]}, {axis: motions[axis]}) for axis in by_axis]
    pairs = pairs or [(dict(numbered), dict(motions))]
    answers = [item for pair in pairs for item in answered_commands(t_s, *pair)]
    return sum(abs(item.correlation) for item in answers)


def in_upward_axes(columns: Sequence[NamedColumn]) -> list[NamedColumn]:
    """Return the columns with those of the pose in a frame with z up."""
    return [
        replace(item, frame=item.frame or "flu") if item.place and item.place[0] == "pose" else item
        for item in columns
    ]
