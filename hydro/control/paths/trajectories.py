"""Trajectories in time: where the vehicle shall be, and the path's direction.

From a path flown at a speed or from a recording.

Al Makdah 2016, 3.1.2: the desired position gamma(t), its tangent and frame. The frame
of a trajectory is `level` (starboard axis horizontal, roll 0) or `frenet` (roll of the
principal normal, errata M26): in a vertical plane the latter asks for a vehicle on its
side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.control.paths.paths import Curve, frame_roll, frenet_frame

SLOWEST_M_S = 1e-6
CHORD_M = 0.3
"""A chord this long leaves an arc of 10 m radius by 1 mm."""


@dataclass(frozen=True)
class Trajectory:
    """A trajectory on a uniform clock `t_s` (n,).

    NED `position` and `velocity` (n, 3), `attitude` (n, 3) [phi, theta, psi] of the
    path's frame.

    theta and psi are those of the tangent, psi is not bounded to +-pi (3.9). `speed`
    (n,) [m/s]; `s_m` (n,) arc length; `attitude_rate` (n, 3) [rad/s].
    """

    t_s: Array
    position: Array
    velocity: Array
    attitude: Array
    attitude_rate: Array
    s_m: Array

    @property
    def speed(self) -> Array:
        """|velocity| (n,)."""
        return np.asarray(np.sqrt(np.sum(self.velocity**2, axis=-1)))

    @property
    def step_s(self) -> float:
        """Time between samples."""
        return float(self.t_s[1] - self.t_s[0])


def fly_path(
    path: Curve,
    *,
    speed_m_s: float,
    step_s: float,
    duration_s: float | None = None,
    frame: str = "level",
) -> Trajectory:
    """Return the trajectory of a path flown at a constant speed.

    To its end or for `duration_s` (beyond its end straight on).

    Raises `CampaignError` for a speed or step that is not positive, an unknown frame,
    or a path shorter than two steps.
    """
    if not speed_m_s > 0.0:
        raise CampaignError(
            "a trajectory needs a positive speed", field="speed_m_s", value=speed_m_s
        )
    if frame not in ("level", "frenet"):
        raise CampaignError(
            "unknown frame", field="frame", value=frame, allowed=("level", "frenet")
        )
    if not step_s > 0.0:
        raise CampaignError("a trajectory needs a positive step", field="step_s", value=step_s)
    duration = path.length_m / speed_m_s if duration_s is None else duration_s
    steps = int(np.floor(duration / step_s + 1e-9))
    if steps < 2:
        raise CampaignError(
            "the trajectory is shorter than two steps",
            field="duration_s",
            value=duration,
            allowed=f">= {2.0 * step_s:g} s",
        )
    t_s = step_s * np.arange(steps + 1, dtype=np.float64)
    points = path.at(speed_m_s * t_s)
    roll = np.zeros(len(t_s)) if frame == "level" else frame_roll(frenet_frame(points))
    attitude = np.column_stack([roll, points.pitch, points.heading])
    roll_rate = np.zeros(len(t_s)) if frame == "level" else np.gradient(roll, step_s)
    rate = np.column_stack(
        [roll_rate, speed_m_s * points.pitch_rate, speed_m_s * points.heading_rate]
    )
    return Trajectory(t_s, points.position, speed_m_s * points.tangent, attitude, rate, points.s_m)


def trajectory_through(t_s: ArrayLike, position: ArrayLike) -> Trajectory:
    """Return the trajectory of recorded positions (n, 3) at uniform times.

    By quintic splines; level frame (the helix of 4.3 is such a recording).

    Raises `CampaignError` where the recording stands still: a path has no direction
    there.
    """
    from scipy.interpolate import make_interp_spline

    t, place = np.asarray(t_s, dtype=np.float64), np.asarray(position, dtype=np.float64)
    spline = make_interp_spline(t, place, k=5)
    velocity, acceleration = spline(t, nu=1), spline(t, nu=2)
    speed = np.sqrt(np.sum(velocity**2, axis=-1))
    if speed.min() < SLOWEST_M_S:
        at = float(t[int(np.argmin(speed))])
        raise CampaignError(
            "the recorded vehicle stands still: its path has no direction there",
            field="t_s",
            value=at,
        )
    level = np.hypot(velocity[:, 0], velocity[:, 1])
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    pitch = -np.arctan2(velocity[:, 2], level)
    turning = (velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0]) / level**2
    along = np.sum(velocity * acceleration, axis=-1)
    pitching = -(acceleration[:, 2] - velocity[:, 2] * along / speed**2) / level
    zero = np.zeros_like(t)
    s_m = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
    return Trajectory(
        t,
        place,
        velocity,
        np.column_stack([zero, pitch, heading]),
        np.column_stack([zero, pitching, turning]),
        s_m,
    )


@dataclass(frozen=True)
class TrackingError:
    """Distances (..., n) [m] to a trajectory.

    To its place at that time, and to the nearest point of the path.
    """

    position_m: Array
    cross_track_m: Array


def tracking_error(trajectory: Trajectory, position: ArrayLike) -> TrackingError:
    """Errors of flown positions (..., n, 3) at the first n times of the trajectory.

    The nearest point is sought over the whole path, on the chords between samples about
    `CHORD_M` apart. The path goes on straight for one chord beyond its end: a vehicle
    that is early there has left the end behind, not the path.
    """
    flown = np.asarray(position, dtype=np.float64)
    late = np.sqrt(np.sum((flown - trajectory.position[: flown.shape[-2]]) ** 2, axis=-1))
    stride = max(
        1, int(CHORD_M / max(float(np.median(trajectory.speed)) * trajectory.step_s, 1e-12))
    )
    end = trajectory.position[-1:]
    ahead = trajectory.position[-1:] - trajectory.position[-2:-1]
    beyond = end + CHORD_M * ahead / np.maximum(np.linalg.norm(ahead), 1e-12)
    corners = np.vstack([trajectory.position[:-1:stride], end, beyond])
    return TrackingError(late, _nearest(corners, flown))


def _nearest(path: Array, flown: Array) -> Array:
    """Return the distance of points (..., 3) to the nearest chord of a path (k, 3).

    Only chords at the nearest corner are tried.
    """
    from scipy.spatial import cKDTree

    start, along = path[:-1], np.diff(path, axis=0)
    square = np.maximum(np.sum(along**2, axis=-1), 1e-300)
    flat = flown.reshape(-1, 3)
    finite = np.isfinite(flat).all(axis=1)
    out = np.full(len(flat), np.nan)
    corner = cKDTree(path).query(flat[finite])[1]
    best = np.full(int(finite.sum()), np.inf)
    for chord in (np.maximum(corner - 1, 0), np.minimum(corner, len(start) - 1)):
        there = flat[finite] - start[chord]
        share = np.clip(np.sum(there * along[chord], axis=-1) / square[chord], 0.0, 1.0)
        best = np.minimum(
            best, np.sqrt(np.sum((there - share[:, None] * along[chord]) ** 2, axis=-1))
        )
    out[finite] = best
    return out.reshape(flown.shape[:-1])
