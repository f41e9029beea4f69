"""Roll and pitch rates of the attitude, for a gyro that logs the yaw rate only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_matrix_inverse
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.columns import ATTITUDE, GYRO, OF_YAW
from auvid.stages.ingest.rejection import Rejected
from auvid.stages.ingest.streams.mapping import Stream

NO_ATTITUDE = "no attitude around it gives roll and pitch rate"
HALF_STEP_S = 0.1
"""Angles so long before and after give a rate, or one sample of the attitude if longer."""
LONGEST_GAP_S = 1.0


@dataclass(frozen=True)
class YawRateMotion:
    """A gyro of three axes for one of yaw, samples that it lacks, and notes."""

    streams: Mapping[str, Stream] = field(default_factory=dict)
    rejected: tuple[Rejected, ...] = ()
    notes: tuple[str, ...] = ()


def yaw_rate_motion(
    logged: Stream, streams: Mapping[str, Stream], vehicle: Vehicle | None
) -> YawRateMotion:
    """Return a gyro of three axes for a logged yaw rate, by poses or attitude.

    streams: the others of the log, with a gyro where its poses give one.
    """
    if "imu" in streams:
        source, gyro = streams["imu"], streams["imu"].columns
        at_us, rates = gyro["time_us"], np.column_stack([gyro[name] for name in GYRO[:2]])
    elif "attitude" in streams and len(streams["attitude"]) > 1:
        source, angles = streams["attitude"], streams["attitude"].columns
        at_us = angles["time_us"]
        turning = attitude_rates(
            (at_us - at_us[0]) / 1e6, np.column_stack([angles[name] for name in ATTITUDE])
        )
        rates = (turning @ vehicle.imu.rotation if vehicle else turning)[:, :2]
    else:
        lost = Rejected("imu", NO_ATTITUDE, len(logged), *map(int, logged.place[[0, -1]]))
        return YawRateMotion(rejected=(lost,), notes=("the yaw rate is not used: no attitude",))
    stamps = logged.columns["time_us"]
    after = np.searchsorted(at_us, stamps).clip(1, at_us.size - 1)
    near = (at_us[after] - at_us[after - 1] <= 1e6 * LONGEST_GAP_S) & (
        (stamps >= at_us[0]) & (stamps <= at_us[-1])
    )
    columns = {
        name: np.interp(stamps, at_us, rate) for name, rate in zip(GYRO, rates.T, strict=False)
    }
    gyro_of_three = replace(
        logged, columns={**logged.columns, **columns}, source=f"{OF_YAW}{logged.source}"
    )
    kept = gyro_of_three.rows(near)
    rejected: tuple[Rejected, ...] = ()
    if not near.all():
        place = logged.place[~near]
        rejected = (Rejected("imu", NO_ATTITUDE, place.size, int(place[0]), int(place[-1])),)
    note = (
        f"of the gyro only the yaw rate is logged ({logged.source}): roll and pitch rates are the"
        f" change of the attitude ({source.source})"
    )
    return YawRateMotion({"imu": kept} if len(kept) else {}, rejected, (note,))


def attitude_rates(t_s: Array, attitude: Array) -> Array:
    """Return p, q, r (n, 3) [rad/s] by central differences of an attitude (n, 3) [rad].

    t_s (n,): its times [s].
    """
    half = max(HALF_STEP_S, float(np.median(np.diff(t_s))))
    before, after = (np.clip(t_s + side * half, t_s[0], t_s[-1]) for side in (-1.0, 1.0))
    angles = np.unwrap(attitude, axis=0)
    change = np.column_stack(
        [np.interp(after, t_s, own) - np.interp(before, t_s, own) for own in angles.T]
    )
    rates = change / (after - before)[:, None]
    return np.asarray(np.einsum("nij,nj->ni", euler_rate_matrix_inverse(attitude), rates))
