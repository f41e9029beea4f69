"""What one leg hands to the fits of single and coupled axes: motion, force, windows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from auvid.hydro.arrays import Array


class LeftOut(NamedTuple):
    """A stretch of the leg that no window of an axis may use, and why.

    `axis`: letter of the axis (X .. N); `start_s`, `end_s` as `AxisRecord.t_s`.
    """

    axis: str
    start_s: float
    end_s: float
    reason: str


@dataclass(frozen=True)
class AxisRecord:
    """Measured motion of one leg on a uniform grid, what drives it, and windows.

    `t_s` (n,): times [s] from the start of the log. `rate`: body velocity (u v w p q r)
    -> (n,) [m/s, rad/s], nan where nothing measures it. `depth_m` (n,), positive down,
    or None. `attitude_rad` (n, 3): phi, theta, psi. `force`: axis (X Y Z K M N) -> (n,)
    of the actuators before any lag, in N and N m, or in full commands where
    `normalised`. `windows`: axis -> (first, last + 1) on the grid. `left_out`:
    stretches without windows. `measured_by`: axis -> what measures it, in words.

    Without a velocity log rate["w"] is nan, and heave is fitted to `depth_m`.
    """

    t_s: Array
    rate: Mapping[str, Array]
    depth_m: Array | None
    attitude_rad: Array
    force: Mapping[str, Array]
    normalised: bool
    windows: Mapping[str, tuple[tuple[int, int], ...]]
    left_out: tuple[LeftOut, ...]
    measured_by: Mapping[str, str]
