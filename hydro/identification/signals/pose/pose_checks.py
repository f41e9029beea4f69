"""Wrong handedness, wrapped angles that were averaged, and the clock of commands.

Nothing here decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Index
from auvid.hydro.identification.signals.clock_offset import ClockOffset, clock_offset

WRAP_MARGIN_RAD = 0.35
"""A yaw so far from both neighbours on either side of the wrap is no measurement."""
ANSWER_S = 0.5
"""Usual time within which a small vehicle follows its thrust."""
ANSWER_LAGS_S = (0.0, 0.2, 0.4, 0.8, 1.2)
FEWEST_ROWS = 100


def averaged_across_wrap(angle: ArrayLike) -> Index:
    """Return the samples of an angle (n,) [rad] that lie within a leap of a whole turn.

    The mean of 3.1 and -3.1 is 0, not 3.14: one sample between two that are a turn
    apart, far from both.

    >>> averaged_across_wrap([3.0, 3.1, 0.02, -3.1, -3.0])
    array([2])
    """
    a = np.asarray(angle, dtype=np.float64)
    before, middle, after = a[:-2], a[1:-1], a[2:]
    leap = np.abs(after - before) > np.pi
    low, high = np.minimum(before, after), np.maximum(before, after)
    inside = (middle > low + WRAP_MARGIN_RAD) & (middle < high - WRAP_MARGIN_RAD)
    return np.asarray(np.flatnonzero(leap & inside) + 1)


@dataclass(frozen=True)
class Mirrored:
    """How well a track agrees with itself as it is, and with its yaw turned round.

    By commands: shares of the variance of surge and sway that they explain; without
    them: how much the motion keeps to one direction of the body, 0 to 1.
    """

    as_is: float
    mirrored: float
    by_commands: bool


def handedness(
    t_s: ArrayLike,
    position: ArrayLike,
    yaw: ArrayLike,
    *,
    t_commands: ArrayLike = (),
    commands: ArrayLike | None = None,
) -> Mirrored | None:
    """Return how a track (n, 3) looks with yaw (n,) [rad] and with -yaw.

    In a left-handed frame, or with one axis turned, the path turns against the heading.
    commands (m, k) at t_commands (m,). None for too few samples or hardly any turn.
    """
    t, p = np.asarray(t_s, dtype=np.float64), np.asarray(position, dtype=np.float64)
    psi = np.unwrap(np.asarray(yaw, dtype=np.float64))
    if t.size < FEWEST_ROWS or float(np.ptp(psi)) < 1.0:
        return None
    step = max(0.2, 2.0 * float(np.median(np.diff(t))))
    grid = np.arange(t[0], t[-1], step)
    place = np.column_stack([np.interp(grid, t, p[:, axis]) for axis in (0, 1)])
    north, east = (np.diff(place, axis=0) / step).T
    middle = grid[:-1] + 0.5 * step
    heading = np.interp(middle, t, psi)
    driven = None
    if commands is not None and np.size(t_commands) > FEWEST_ROWS:
        at, u = np.asarray(t_commands, dtype=np.float64), np.asarray(commands, dtype=np.float64)
        driven = np.column_stack(
            [
                np.interp(middle - lag, at, u[:, column])
                for lag in ANSWER_LAGS_S
                for column in range(u.shape[1])
            ]
        )
    scores = []
    for sign in (1.0, -1.0):
        c, s = np.cos(sign * heading), np.sin(sign * heading)
        body = np.column_stack([c * north + s * east, c * east - s * north])
        scores.append(_kept_direction(body) if driven is None else _explained(driven, body))
    return Mirrored(scores[0], scores[1], driven is not None)


def _kept_direction(body: Array) -> float:
    """Return (l1 - l2) / (l1 + l2) of the second moments of velocities (n, 2)."""
    low, high = np.linalg.eigvalsh(body.T @ body)
    return float((high - low) / max(high + low, 1e-300))


def _explained(design: Array, body: Array) -> float:
    """Return the adjusted share of variance of (n, 2) that a design (n, k) explains."""
    x = design - design.mean(axis=0)
    y = body - body.mean(axis=0)
    rest = y - x @ np.linalg.lstsq(x, y, rcond=1e-8)[0]
    free = max(len(y) - x.shape[1] - 1, 1)
    share = float(np.sum(rest**2) / max(float(np.sum(y**2)), 1e-300))
    return float(1.0 - share * (len(y) - 1) / free)


def command_clock(
    t_s: ArrayLike, motion: ArrayLike, t_commands: ArrayLike, commands: ArrayLike
) -> ClockOffset | None:
    """Return what to add to the clock of commands (m, k) so that motion (n, k) answers.

    Column by column, each command after a lag of ANSWER_S and scaled to the size of the
    motion. None where the records do not do for a comparison.
    """
    at, u = np.asarray(t_commands, dtype=np.float64), np.asarray(commands, dtype=np.float64)
    t, y = np.asarray(t_s, dtype=np.float64), np.asarray(motion, dtype=np.float64)
    late = np.zeros_like(u)
    late[0] = u[0]
    for row, dt in enumerate(np.diff(at), 1):
        late[row] = late[row - 1] + (u[row - 1] - late[row - 1]) * (1.0 - np.exp(-dt / ANSWER_S))
    moves = (late.std(axis=0) > 0.0) & (y.std(axis=0) > 0.0)
    if not moves.any():
        return None
    late, y = late[:, moves] / late[:, moves].std(axis=0), y[:, moves] / y[:, moves].std(axis=0)
    try:
        return clock_offset(t, y, at, late)
    except DataError:
        return None
