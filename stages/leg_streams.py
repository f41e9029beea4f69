"""Raw streams of a log as the stages of a leg read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pyarrow as pa

from auvid.data_schemas.tables import column, has_columns
from auvid.hydro.arrays import Array, cross
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.columns import GYRO, VELOCITY, Samples, Span, samples_within


@dataclass(frozen=True)
class Streams:
    """Raw streams of a log by name, None where absent; times in s from its start.

    `lags_s`: stream -> how late its stamps are, beside the lags of the vehicle file.
    """

    tables: Mapping[str, pa.Table | None]
    start_us: int
    window: tuple[float, float]
    vehicle: Vehicle
    lags_s: Mapping[str, float] = field(default_factory=dict)

    def samples(self, stream: str, names: tuple[str, ...], lag_s: float = 0.0) -> Samples | None:
        """Return samples of a stream in the leg, None without all of these columns."""
        table = self.tables.get(stream)
        if table is None or not has_columns(table, names):
            return None
        lag_s += self.lags_s.get(stream, 0.0)
        return samples_within(table, names, start_us=self.start_us, lag_s=lag_s, window=self.window)

    def gyro(self) -> Samples | None:
        """Return the gyro in body axes, None without one."""
        gyro = self.samples("imu", GYRO)
        if gyro is None:
            return None
        imu = self.vehicle.imu
        return Samples(gyro.t_s - imu.lag_s, gyro.values @ imu.rotation.T)

    def velocity(self) -> Samples | None:
        """Return u v w of the body origin in body axes, None without a velocity log.

        v = R v_sensor - omega x arm, omega of the gyro where there is one.
        """
        dvl, gyro = self.vehicle.dvl, self.gyro()
        samples = self.samples("velocity", VELOCITY[:3], dvl.lag_s)
        if samples is None or not samples.t_s.size:
            return None
        body = samples.values @ dvl.rotation.T
        if np.any(dvl.arm_m != 0.0) and gyro is not None and gyro.t_s.size:
            omega = np.column_stack(
                [np.interp(samples.t_s, gyro.t_s, gyro.values[:, axis]) for axis in range(3)]
            )
            body = body - cross(omega, dvl.arm_m)
        return Samples(samples.t_s, body)

    def voltage(self, t_s: Array) -> Array | None:
        """Return the voltage (n,) at times (n,) [s], None without a battery."""
        table = self.tables.get("battery")
        if table is None:
            return None
        voltage, t = column(table, "voltage_v"), self.times("battery")
        finite = np.isfinite(voltage)
        return np.interp(t_s, t[finite], voltage[finite]) if finite.any() else None

    def times(self, stream: str) -> Array:
        """Return the times (n,) [s] of a raw stream from the start of the log."""
        table = self.tables[stream]
        assert table is not None
        late = self.lags_s.get(stream, 0.0)
        return np.asarray((column(table, "time_us") - self.start_us) / 1e6 - late)


def disarmed_between(mode: pa.Table | None, start_us: int, end_s: float) -> list[Span]:
    """Return the spans [s] of a log in which it says that the vehicle is disarmed.

    None where it never says armed.
    """
    if mode is None or "armed" not in mode.column_names:
        return []
    states = mode["armed"].to_pylist()
    at_s = (column(mode, "time_us") - start_us) / 1e6
    rows = [(at, state) for at, state in zip(at_s, states, strict=True) if state is not None]
    if not any(state for _, state in rows):
        return []
    times = [0.0, *(float(at) for at, _ in rows[1:]), end_s]
    return [
        (begin, stop)
        for (begin, stop), (_, state) in zip(pairwise(times), rows, strict=True)
        if not state and stop > begin
    ]


def never_armed(mode: pa.Table | None) -> bool:
    """Return whether the log says that the vehicle is disarmed from first to last."""
    if mode is None or "armed" not in mode.column_names:
        return False
    states = [state for state in mode["armed"].to_pylist() if state is not None]
    return bool(states) and not any(states)
