"""What streams of all log formats share: geometry, outputs, modes, texts, scores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.hydro.arrays import Array, Ints, Mask
from auvid.hydro.constants import FRESH_WATER_KG_M3, STANDARD_GRAVITY, STANDARD_PRESSURE_PA
from auvid.hydro.identification.signals.pose.frames import (
    Body,
    World,
    euler_of_quaternion,
    in_ned,
    ned_from_frd,
)
from auvid.hydro.long_series.long_arrays import laid_down
from auvid.stages.columns import ATTITUDE, LINEAR_VELOCITY, POSITION, named
from auvid.stages.ingest.decoded_log import DecodedLog, Messages

Columns = dict[str, npt.NDArray[Any]]

PWM_OUTPUTS = range(1, 17)
DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270
NO_SENSOR = "the navigation filter had no velocity or position sensor"


def mostly(flags: Array | Mask) -> bool:
    """Return whether a flag is set in more than half of the records."""
    return bool(np.mean(flags) > 0.5)


def vector(messages: Messages, names: Iterable[str]) -> Array:
    """Return columns as the rows of an array (k, n)."""
    return np.stack([messages.floats(name) for name in names])


def to_body(ned: Array, phi: Array, theta: Array, psi: Array) -> Columns:
    """Turn north-east-down velocities (3, n) into body axes.

    v_b = R(Theta)^T v_n, with Fossen's R(Theta) of ZYX Euler angles (n,) in rad.
    """
    sf, cf, st, ct, sp, cp = (f(angle) for angle in (phi, theta, psi) for f in (np.sin, np.cos))
    rotation = np.array(
        [
            [cp * ct, sp * ct, -st],
            [-sp * cf + cp * st * sf, cp * cf + sp * st * sf, ct * sf],
            [sp * sf + cp * st * cf, -cp * sf + sp * st * cf, ct * cf],
        ]
    )
    return dict(zip(LINEAR_VELOCITY, np.einsum("ijn,jn->in", rotation, ned), strict=True))


def to_body_at(
    time_us: Ints, ned: Array, attitude_us: Ints | None, angles: Sequence[Array]
) -> Columns:
    """Turn north-east-down velocities (3, n) into body axes with interpolated attitude.

    At 4 Hz and more the angles between two samples are small enough for each to be
    taken as linear. NaN outside of the attitude, and without one (`attitude_us` None).
    """
    if attitude_us is None or attitude_us.size < 2:
        return {name: np.full(time_us.size, np.nan) for name in LINEAR_VELOCITY}
    at = [
        np.interp(time_us, attitude_us, np.unwrap(angle), left=np.nan, right=np.nan)
        for angle in angles
    ]
    return to_body(ned, *at)


def euler_angles(q: Array) -> Columns:
    """Return roll, pitch, yaw (ZYX) in rad of quaternions (4, n), w first.

    They turn body FRD into NED. NaN for a quaternion of no length.
    """
    return named(ATTITUDE, euler_of_quaternion(q.T))


def pose_in_ned(position: Array, quaternion: Array, world: World, body: Body) -> Columns:
    """Return a pose in NED of positions (n, 3) and quaternions (n, 4), w first."""
    angles = euler_of_quaternion(ned_from_frd(quaternion, world, body))
    return named(POSITION, in_ned(position, world)) | named(ATTITUDE, angles)


def displacement_velocity(delta: Array, interval: Array, confidence: Array | None) -> Columns:
    """Return body velocity in m/s: displacement (3, n) over its own interval (n,) in s.

    NaN where the interval is not positive. `confidence` is in percent.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity = delta * np.where(interval > 0.0, 1.0 / interval, np.nan)
    columns: Columns = dict(zip(LINEAR_VELOCITY, velocity, strict=True))
    columns["interval_s"] = interval
    if confidence is not None:
        columns["quality"] = np.clip(confidence / 100.0, 0.0, 1.0)
    return columns


def depth_m(
    pressure_pa: Array, surface_pa: float = STANDARD_PRESSURE_PA, specific: float = 1.0
) -> Array:
    """Return depth (n,): (p - p_surface) / (1000 kg/m3 specific_gravity g)."""
    return (pressure_pa - surface_pa) / (FRESH_WATER_KG_M3 * specific * STANDARD_GRAVITY)


def pulse_widths(messages: Messages, names: Mapping[int, str]) -> Columns:
    """Return pulse widths of outputs by number, from those of `names` present."""
    return {
        f"pwm_{number}_us": laid_down(messages.floats(name))
        for number, name in names.items()
        if name in messages.columns
    }


def live(outputs: Columns) -> Columns:
    """Return the outputs that have a pulse."""
    return {name: values for name, values in outputs.items() if np.any(values > 0.0)}


def mode_changes(time_us: Ints, modes: Ints, armed: Mask, names: Mapping[int, str]) -> Columns:
    """Return one row per change of mode or arming, from records that hold both.

    A mode without a name keeps its number.
    """
    change = np.append(True, (np.diff(modes) != 0) | (armed[1:] != armed[:-1]))
    at = time_us[change]
    words = [names.get(mode, str(mode)) for mode in modes[change].tolist()]
    return merge_modes(at, words, at, armed[change])


def merge_modes(time_us: Ints, names: list[str], armed_us: Ints, armed: Mask) -> Columns:
    """Return one row per change: the mode and the arming that hold from then on.

    Rows before the first mode are `unknown`.
    """
    times = np.unique(np.concatenate([time_us, armed_us]))
    order = np.argsort(time_us, kind="stable")
    at = np.searchsorted(time_us[order], times, side="right") - 1
    words = [names[order[index]] if index >= 0 else "unknown" for index in at]
    columns: Columns = {"time_us": times, "mode": np.array(words, dtype=object)}
    if armed_us.size:
        by_time = np.argsort(armed_us, kind="stable")
        since = np.searchsorted(armed_us[by_time], times, side="right") - 1
        # Before the first arming event the state was the opposite of it.
        armed_by_time = armed[by_time]
        columns["armed"] = np.where(
            since >= 0, armed_by_time[np.maximum(since, 0)], ~armed_by_time[0]
        )
    return columns


def text_rows(time_us: Ints, texts: list[str]) -> Columns:
    """Return texts in file order; several with one time stamp are set 1 us apart.

    Rows of a stream have distinct times.
    """
    steps = np.arange(time_us.size)
    return {
        "time_us": np.maximum.accumulate(time_us - steps) + steps if time_us.size else time_us,
        "text": np.array(texts, dtype=object),
    }


def downward_score(column: str) -> Callable[[Messages, DecodedLog], float]:
    """Return a score that is 0 for a range finder that looks down, else 1.

    Its orientation stands in `column`.
    """

    def score(messages: Messages, log: DecodedLog) -> float:
        present = column in messages.columns
        return float(present and np.median(messages.floats(column)) != DOWNWARD)

    return score
