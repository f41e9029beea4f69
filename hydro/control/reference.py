"""The reference of a controller in flight.

It follows the clock or waits for the vehicle, on one of two schedules (glide or
propeller).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.hydro.arrays import Array, matrix_product
from auvid.hydro.control.controllers import Schedule
from auvid.hydro.control.observer import N
from auvid.hydro.control.plants import ControlledPlant
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned


@dataclass(frozen=True)
class Waiting:
    """A reference that waits for a vehicle whose thrust is at its limit.

    It moves along the trajectory at 1 + lead / `lead_m` times its speed (lead < 0 where
    the vehicle lags), plus (t - reference) / `catch_up_s`, within 0 and `fastest`.
    """

    lead_m: float
    catch_up_s: float = float("inf")
    fastest: float = 1.3


@dataclass(frozen=True)
class ModeSwitch:
    """Rule for starting and stopping the propeller of a gliding vehicle.

    The second schedule is flown with it, the first without.

    On: further than `on_m` beside the path, or the observer's estimate of the
    horizontal force above `on_N`. Off: nearer than `off_m` and the estimate below
    `off_N`. Where the observer is not used only the distance counts.
    """

    on_m: float
    off_m: float
    on_N: float
    off_N: float


@dataclass(frozen=True)
class Aim:
    """Where the controller aims: `chi`, `U` and `mass_kg` of the equilibrium there.

    With a waiting reference the members are in front.
    """

    chi: Array
    U: Array
    mass_kg: Array


class Reference:
    """The references of b members.

    Without waiting all aim at one sample of one schedule; else each has a place of its
    own.

    `time_s` (b,) is the place as time on the first schedule; a second schedule has the
    same path at another speed.
    """

    def __init__(
        self, schedules: Sequence[Schedule], members: int, waiting: Waiting | None
    ) -> None:
        self.schedules, self.waiting = tuple(schedules), waiting
        self.step_s = schedules[0].equilibrium.step_s
        self.time_s = np.zeros(members)
        self.mode = np.zeros(members, dtype=int)
        self._rows: dict[str, list[tuple[Array, int]]] = {}
        ends = [schedule.equilibrium.t_s[-1] for schedule in schedules]
        self.ratio = np.array([end / ends[0] for end in ends])
        first = schedules[0].equilibrium
        velocity = np.gradient(first.chi[:, 6:9], first.t_s, axis=0)
        self.tangent = velocity / np.sqrt(np.sum(velocity**2, axis=1))[:, None]

    def aim(self) -> Aim:
        """Return the equilibrium at the reference."""
        return Aim(self.value("chi"), self.value("U"), self.value("mass_kg"))

    def value(self, name: str) -> Array:
        """Return a value of the schedules at the reference.

        `chi`, `U`, `mass_kg` linear between samples, gains at a sample, the observer's
        at a design instant.

        With a waiting reference the members are in front.
        """
        return self._at(name, self.time_s)

    def _at(self, name: str, time_s: Array) -> Array:
        if name not in self._rows:
            self._rows[name] = [_rows_and_stride(schedule, name) for schedule in self.schedules]
        if self.waiting is None:
            (rows, stride), *_ = self._rows[name]
            return np.asarray(rows[min(round(time_s[0] / self.step_s) // stride, len(rows) - 1)])
        values = []
        for (rows, stride), ratio in zip(self._rows[name], self.ratio, strict=True):
            real = np.minimum(time_s * ratio / self.step_s, stride * len(rows) - 1.0)
            values.append(_between(rows, real / stride, name))
        if len(values) == 1:
            return values[0]
        return np.where(
            self.mode.reshape(-1, *(1,) * (values[0].ndim - 1)) == 1, values[1], values[0]
        )

    def _tangent(self) -> Array:
        place = np.clip(self.time_s / self.step_s, 0, len(self.tangent) - 1).astype(int)
        return np.asarray(self.tangent[place])

    def advance(self, chi: Array, now_s: float) -> tuple[Array, Array]:
        """Move on by a tick: return chi_eq a tick ahead, and the shift.

        The shift is how far the chosen reference stays behind (chi_eq ahead - chi_eq).
        """
        tick_s = self.step_s / self.ratio[self.mode]
        ahead = self._at("chi", self.time_s + tick_s)
        if self.waiting is None:
            self.time_s = self.time_s + self.step_s
            return ahead, np.zeros(N)
        lead = np.einsum("bi,bi->b", self._tangent(), chi[:, 6:9] - ahead[:, 6:9])
        pace = 1.0 + lead / self.waiting.lead_m + (now_s - self.time_s) / self.waiting.catch_up_s
        pace = np.where(np.isfinite(pace), np.clip(pace, 0.0, self.waiting.fastest), 1.0)
        self.time_s = np.minimum(self.time_s + pace * tick_s, self.schedules[0].equilibrium.t_s[-1])
        return ahead, ahead - self.value("chi")

    def switch(
        self, rule: ModeSwitch, plant: ControlledPlant, chi: Array, d: Array, mass_kg: Array
    ) -> bool:
        """Choose each member's mode; return whether any changed.

        From its distance to the path and the estimated disturbance `d` (b, 6).
        """
        away = chi[:, 6:9] - self.value("chi")[:, 6:9]
        tangent = self._tangent()
        off_path = np.sqrt(
            np.sum((away - np.sum(away * tangent, axis=1)[:, None] * tangent) ** 2, axis=1)
        )
        force = matrix_product(plant.mass_matrix(mass_kg), d)[:, :3]
        north_east = matrix_product(rotation_body_to_ned(chi[:, 9:]), force)[:, :2]
        push = np.hypot(north_east[:, 0], north_east[:, 1])
        on, off = (
            (off_path > rule.on_m) | (push > rule.on_N),
            (off_path < rule.off_m) & (push < rule.off_N),
        )
        before = self.mode
        self.mode = np.where(on, 1, np.where(off, 0, before))
        return bool((self.mode != before).any())


def _rows_and_stride(schedule: Schedule, name: str) -> tuple[Array, int]:
    """Rows of a schedule, and how many ticks each lasts."""
    if name in ("chi", "U", "mass_kg", "k"):
        holder: Any = schedule if name == "k" else schedule.equilibrium
        return getattr(holder, name), 1
    return getattr(schedule.observer, name), schedule.stride


def _between(rows: Array, real: Array, name: str) -> Array:
    if name not in ("chi", "U", "mass_kg"):
        return np.asarray(rows[np.minimum(real.astype(int), len(rows) - 1)])
    low = np.minimum(real.astype(int), len(rows) - 2)
    share = (real - low).reshape(-1, *(1,) * (rows.ndim - 1))
    return np.asarray((1.0 - share) * rows[low] + share * rows[low + 1])
