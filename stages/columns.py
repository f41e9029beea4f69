"""Column names of the state, and helpers between tables and arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.equations_of_motion import Control

Span = tuple[float, float]

TOO_COARSE = "too coarse for a velocity"
"""Said of position fixes that give none."""
FINER_FIXES = (
    "Keep each speed for longer (10 s where fixes of 0.5 m come once a second, 20 s where those of"
    " 1 m do), log finer or more frequent fixes, or log a velocity (DVL)."
)
"""What would give one."""
OF_FIXES, OF_POSES = "fixes of ", "pose of "
"""How the sources of streams begin that are made from positions."""
OF_YAW = "yaw rate of "
"""How the source of a gyro begins whose roll and pitch rates are those of the attitude."""

POSE = ("x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad")
VELOCITY = ("u_m_s", "v_m_s", "w_m_s", "p_rad_s", "q_rad_s", "r_rad_s")
VELOCITY_SD = ("u_sd_m_s", "v_sd_m_s", "w_sd_m_s", "p_sd_rad_s", "q_sd_rad_s", "r_sd_rad_s")
POSE_RATE = (
    "x_dot_m_s",
    "y_dot_m_s",
    "z_dot_m_s",
    "phi_dot_rad_s",
    "theta_dot_rad_s",
    "psi_dot_rad_s",
)
ACCELERATION = (
    "u_dot_m_s2",
    "v_dot_m_s2",
    "w_dot_m_s2",
    "p_dot_rad_s2",
    "q_dot_rad_s2",
    "r_dot_rad_s2",
)
POSITION, ATTITUDE = POSE[:3], POSE[3:]
LINEAR_VELOCITY = VELOCITY[:3]
FINS = ("fin_s_rad", "fin_p_rad", "fin_b_rad", "fin_t_rad")
GYRO = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
SPEEDS, RATES = ("surge", "sway", "heave"), ("roll", "pitch", "yaw")
"""Words for linear and angular velocities, in the order of their columns."""
ACCELEROMETER = ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2")
UNIX_TIME_US = 1_000_000_000_000_000
"""A clock beyond this (September 2001) counts from 1970; below it, from boot."""
ACTUATORS = ("fins", "propeller", "thrusters")
"""Components of the residual force that a lag of the actuators delays."""
AXIS_UNITS = {"X": "N", "Y": "N", "Z": "N", "K": "N m", "M": "N m", "N": "N m"}


def force_columns(component: str) -> tuple[str, ...]:
    """Return the six columns of a force: `tau_bar` -> tau_bar_X_N ... tau_bar_N_N_m."""
    return tuple(f"{component}_{axis}_{AXIS_UNITS[axis].replace(' ', '_')}" for axis in AXES)


def named(names: Sequence[str], values: Array) -> dict[str, Array]:
    """Columns of an array (n, k) under k names."""
    return {name: np.ascontiguousarray(values[:, index]) for index, name in enumerate(names)}


def clock(table: pa.Table) -> Array:
    """Return the time column t_s (n,)."""
    return column(table, "t_s")


def forces(table: pa.Table, component: str) -> Array:
    """Return the six columns of a force component as an array (n, 6) in N and N m."""
    return matrix(table, force_columns(component))


def rms(values: Array) -> float:
    """Root mean square of all entries, 0 for none."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0


class Rows(Protocol):
    """A table on disk; rows are loaded by their clock."""

    def between(self, start_us: float, end_us: float) -> pa.Table:
        """Return the rows of these times, and maybe more of them."""


def rows_between(table: pa.Table | Rows, start_us: float, end_us: float) -> pa.Table:
    """Return the rows of these times, and maybe more; all of a table in memory."""
    return table if isinstance(table, pa.Table) else table.between(start_us, end_us)


def leg_window(leg: LegEntry, start_us: int, end_us: int) -> Span:
    """Return the leg in seconds from the start of the log.

    Raises `DataError` for a leg that lies outside the log.
    """
    length = (end_us - start_us) / 1e6
    first = leg.start_s or 0.0
    last = length if leg.end_s is None else leg.end_s
    if first >= length or last <= first:
        raise DataError(
            f"leg '{leg.id}' lies outside log '{leg.log}'",
            field="start_s" if first >= length else "end_s",
            value=f"from {first:g} s on" if leg.end_s is None else f"{first:g} to {last:g} s",
            allowed=f"0 to {length:.3f} s from the first time-stamped record",
        )
    return first, last


@dataclass(frozen=True)
class Samples:
    """Samples of one stream at their own times.

    `t_s` (n,) in s from the start of the log, `values` (n, k), all finite.
    """

    t_s: Array
    values: Array

    def between(self, first_s: float, last_s: float) -> Samples:
        """Return the samples at or between two times."""
        rows = (self.t_s >= first_s) & (self.t_s <= last_s)
        return Samples(self.t_s[rows], self.values[rows])


def samples_within(
    table: pa.Table, names: Sequence[str], *, start_us: int, lag_s: float, window: Span
) -> Samples:
    """Finite samples of a raw stream inside a window [s], its lag taken off."""
    t = (column(table, "time_us") - start_us) / 1e6 - lag_s
    values = matrix(table, names)
    rows = np.isfinite(values).all(axis=1) & (t >= window[0]) & (t <= window[1])
    return Samples(t[rows], values[rows])


def span_text(span: Span) -> str:
    """Return a span of a log in words."""
    return f"{span[0]:.1f} to {span[1]:.1f} s of the log"


def stacked(blocks: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return blocks of columns one after the other; text columns are lists."""
    return {
        name: (
            [cell for block in blocks for cell in block[name]]
            if isinstance(blocks[0][name], list)
            else np.concatenate([block[name] for block in blocks])
        )
        for name in blocks[0]
    }


def control_of(controls: pa.Table, rows: slice) -> tuple[Control, Array | None]:
    """Return the control series and level speed u_c (n,) of a `controls` table."""
    thrusters = [name for name in controls.column_names if name.startswith("thruster_")]

    def values(*names: str) -> Array | None:
        return matrix(controls, names)[rows] if names and has_columns(controls, names) else None

    propeller, level = values("propeller_rev_s"), values("level_speed_m_s")
    control = Control(
        propeller_rev_s=None if propeller is None else propeller[:, 0],
        fins_rad=values(*FINS),
        thruster_force_N=values(*thrusters),
    )
    return control, None if level is None else level[:, 0]
