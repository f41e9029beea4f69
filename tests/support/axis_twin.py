"""Records of a made-up vehicle that heaves and yaws, in newtons or in full commands."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.records.axes import AxisWindowsRecord
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.stages.fit_axes.flight import LegData

Array = npt.NDArray[np.float64]
STEP_S, LAG_S = 0.05, 0.08
TRUTH = {"Z": (-30.0, -60.0, 28.0), "N": (-1.0, -2.0, 0.7)}
"""Axis -> linear and quadratic damping, apparent inertia [kg, kg m^2]."""
FULL = {"Z": 60.0, "N": 8.0}
"""Force of a full command [N, N m]."""


def _moved(force: Array, linear: float, quadratic: float, inertia: float) -> Array:
    """Return the velocity under a force, by Euler's method in steps of a tenth."""
    late = first_order_lag(force, lag_s=LAG_S, step_s=STEP_S).tolist()
    out, x, parts = np.zeros(len(force)), 0.0, 10
    for i in range(1, len(force)):
        for part in range(parts):
            drive = late[i - 1] + (late[i] - late[i - 1]) * part / parts
            x += STEP_S / parts * (drive + linear * x + quadratic * abs(x) * x) / inertia
        out[i] = x
    return out


def leg(
    *, normalised: bool = False, use: str = "training", seed: int = 1, seconds: float = 120.0
) -> LegData:
    """Return a leg with its yaw rate and depth; drag is that of `TRUTH`."""
    random = np.random.default_rng(seed)
    n = round(seconds / STEP_S)
    t_s = STEP_S * np.arange(n)
    nothing, still = np.full(n, np.nan), np.zeros(n)
    rate = dict.fromkeys(VELOCITIES, nothing)
    force = dict.fromkeys(AXES, still)
    for axis, share in (("Z", 0.5), ("N", 0.4)):
        levels = share * random.uniform(-1.0, 1.0, n // 40 + 1)
        command = np.repeat(levels, 40)[:n]
        moved = _moved(FULL[axis] * command, *TRUTH[axis])
        force[axis] = command if normalised else FULL[axis] * command
        if axis == "Z":
            travel = np.append(0.0, np.cumsum((moved[1:] + moved[:-1]) / 2.0))
            depth = 5.0 + STEP_S * travel + 0.003 * random.standard_normal(n)
        else:
            rate["r"] = moved + 0.003 * random.standard_normal(n)
    rate |= {"p": 1e-3 * random.standard_normal(n), "q": 1e-3 * random.standard_normal(n)}
    record = AxisRecord(
        t_s=t_s,
        rate=rate,
        depth_m=depth,
        attitude_rad=np.zeros((n, 3)),
        force=force,
        normalised=normalised,
        windows=dict.fromkeys("ZN", ((0, n),)),
        left_out=(),
        measured_by={"Z": "depth", "K": "gyro", "M": "gyro", "N": "gyro"},
    )
    windows = AxisWindowsRecord.model_validate(
        {
            "leg": f"leg_{seed}",
            "log": "twin",
            "use": use,
            "start_s": 0.0,
            "rate_hz": 1.0 / STEP_S,
            "normalised": normalised,
            "force": "made up",
            "measured_by": record.measured_by,
            "windows_s": {"Z": seconds, "N": seconds},
            "left_out": [],
            "full_force": {},
            "full_thrust": {},
            "notes": [],
            "warnings": [],
        }
    )
    return LegData(record, windows)
