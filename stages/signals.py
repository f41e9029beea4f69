"""Column names of the state, and small helpers that several stages need to move between tables and arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from data_schemas.tables import column, matrix

Array = npt.NDArray[np.float64]

POSE = ("x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad")
VELOCITY = ("u_m_s", "v_m_s", "w_m_s", "p_rad_s", "q_rad_s", "r_rad_s")
POSE_RATE = ("x_dot_m_s", "y_dot_m_s", "z_dot_m_s", "phi_dot_rad_s", "theta_dot_rad_s", "psi_dot_rad_s")
ACCELERATION = ("u_dot_m_s2", "v_dot_m_s2", "w_dot_m_s2", "p_dot_rad_s2", "q_dot_rad_s2", "r_dot_rad_s2")
ATTITUDE = POSE[3:]
ACCELEROMETER = ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2")
AXES = ("X", "Y", "Z", "K", "M", "N")
AXIS_UNITS = {"X": "N", "Y": "N", "Z": "N", "K": "N m", "M": "N m", "N": "N m"}


def force_columns(component: str) -> tuple[str, ...]:
    """The six column names of a force component: `tau_bar` -> tau_bar_X_N ... tau_bar_N_N_m."""
    return tuple(f"{component}_{axis}_{AXIS_UNITS[axis].replace(' ', '_')}" for axis in AXES)


def named(names: Sequence[str], values: Array) -> dict[str, Array]:
    """Columns of an array (n, k) under k names."""
    return {name: np.ascontiguousarray(values[:, index]) for index, name in enumerate(names)}


def clock(table: pa.Table) -> Array:
    """The time column t_s (n,)."""
    return column(table, "t_s")


def forces(table: pa.Table, component: str) -> Array:
    """The six columns of a force component as an array (n, 6) in N and N m."""
    return matrix(table, force_columns(component))


def rms(values: Array) -> float:
    """Root mean square of all entries, 0 for none."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
