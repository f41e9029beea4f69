"""Open-loop manoeuvres of a hybrid vehicle: Al Makdah 2016, section 4.1.

Inputs are constant; statements of the text are compared with the runs.

The cases stand in the cases document of a campaign under `open_loop`; here they are
read, flown and compared with the statements.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from auvid.data_schemas.documents.control_cases import QUANTITIES, OpenLoopEntry
from auvid.data_schemas.errors import CampaignError, nearest
from auvid.hydro.arrays import STATES, Array
from auvid.hydro.dynamics.hybrid_vehicle import HybridVehicle

PITCH_LIMIT_RAD = 1.5
STRAIGHT_RAD_S = 1e-6
"""Slower turns count as straight."""
STEADY_SHARE = 0.1
"""The steady value of a signal is its mean over this last share of a run."""


@dataclass(frozen=True)
class Statement:
    """A statement of the text: the value of a quantity and its tolerance."""

    quantity: str
    value: float
    tolerance: float
    unit: str
    source: str


@dataclass(frozen=True)
class OpenLoopCase:
    """One manoeuvre from rest at the origin.

    Mass: `mass_kg`, or a sine about it with `swing_kg` and `period_s` (period 0:
    constant).
    """

    name: str
    title: str
    duration_s: float
    thrust_N: float
    rudder_rad: float
    stern_right_rad: float
    stern_left_rad: float
    mass_kg: float
    swing_kg: float
    period_s: float
    statements: tuple[Statement, ...] = field(default=())

    @property
    def U(self) -> Array:
        """Return the inputs (4,) [N, rad]."""
        return np.array([self.thrust_N, self.rudder_rad, self.stern_right_rad, self.stern_left_rad])

    def mass(self, t_s: Array | float) -> Array:
        """Mass (...) [kg] at times (...) [s]."""
        t = np.asarray(t_s, dtype=np.float64)
        swing = (
            self.swing_kg * np.sin(2.0 * math.pi * t / self.period_s)
            if self.period_s > 0.0
            else 0.0
        )
        return np.asarray(self.mass_kg + swing + 0.0 * t)


@dataclass(frozen=True)
class OpenLoopRun:
    """A manoeuvre as flown: t_s (n,), chi (n, 12), mass_kg (n,).

    `stop`: why it ended early, if it did.
    """

    case: OpenLoopCase
    parameter_set: str
    t_s: Array
    chi: Array
    mass_kg: Array
    stop: str | None

    def quantity(self, name: str) -> float:
        """Return one of QUANTITIES; nan for a run that ended early.

        Raises `CampaignError` for another name.
        """
        if name not in QUANTITIES:
            raise CampaignError(
                "unknown quantity",
                field="quantity",
                value=name,
                allowed=QUANTITIES,
                remedy=nearest(name, QUANTITIES),
            )
        if self.stop is not None:
            return math.nan
        chi = self.chi
        if name == "radius":
            rate = self._steady(np.abs(chi[:, 5]))
            return self._steady(self._speed()) / rate if rate > STRAIGHT_RAD_S else math.inf
        if name == "depth":
            return float(chi[-1, 8])
        kind, _, signal = name.partition("_")
        values = self._speed() if signal == "speed" else chi[:, STATES.index(signal)]
        if kind == "peak":
            return float(np.max(np.abs(values[len(values) // 2 :])))
        return self._steady(values)

    def _speed(self) -> Array:
        return np.asarray(np.linalg.norm(self.chi[:, :3], axis=1))

    def _steady(self, values: Array) -> float:
        return float(np.mean(values[round((1.0 - STEADY_SHARE) * (len(values) - 1)) :]))


@dataclass(frozen=True)
class Finding:
    """A statement of the text and the value under a parameter set.

    `holds` when they agree within the statement's tolerance.
    """

    case: str
    parameter_set: str
    statement: Statement
    ours: float

    @property
    def holds(self) -> bool:
        """False also where the run ended early."""
        return bool(abs(self.ours - self.statement.value) <= self.statement.tolerance)


def open_loop_cases(
    entries: Mapping[str, OpenLoopEntry], hybrid: HybridVehicle
) -> tuple[OpenLoopCase, ...]:
    """Return the open-loop cases of a cases document.

    Raises `CampaignError` for a thrust below 0 or above the vehicle's, and a mass
    outside the range of its buoyancy engine.
    """
    return tuple(_case(name, entry, hybrid) for name, entry in entries.items())


def _case(name: str, entry: OpenLoopEntry, hybrid: HybridVehicle) -> OpenLoopCase:
    case = OpenLoopCase(
        name=name,
        title=entry.title or name,
        duration_s=entry.duration.si,
        thrust_N=entry.thrust.si,
        rudder_rad=entry.rudder.si,
        stern_right_rad=entry.stern_right.si,
        stern_left_rad=entry.stern_left.si,
        mass_kg=hybrid.engine.neutral_kg if entry.mass is None else entry.mass.si,
        swing_kg=entry.mass_swing.si,
        period_s=entry.mass_period.si,
        statements=tuple(
            Statement(key, item.value.si, item.tolerance.si, QUANTITIES[key], item.value.source)
            for key, item in entry.statements.items()
        ),
    )
    if not 0.0 <= case.thrust_N <= hybrid.maximum_thrust_N:
        raise CampaignError(
            "the propeller cannot give this thrust",
            field=f"open_loop.{name}.thrust",
            value=case.thrust_N,
            allowed=f"0 to {hybrid.maximum_thrust_N:g} N",
        )
    extremes = np.array([case.mass_kg - abs(case.swing_kg), case.mass_kg + abs(case.swing_kg)])
    key = "mass_swing" if case.swing_kg else "mass"
    hybrid.engine.check(extremes, field=f"open_loop.{name}.{key}")
    return case


def fly_open_loop(hybrid: HybridVehicle, case: OpenLoopCase, *, step_s: float = 1.0) -> OpenLoopRun:
    """Fly a case from rest: states every `step_s`.

    Integrated with a variable step (LSODA, relative tolerance 1e-9).

    A run ends early, and says so, where the pitch leaves +-1.5 rad: the Euler angles
    mean little beyond.
    """
    from scipy.integrate import solve_ivp

    from auvid.hydro.dynamics.simulation.compiled_step import step

    acting, still = hybrid.acting(case.U[None]), np.zeros((1, 3))

    def rate(t: float, chi: Array) -> Array:
        out, rows = np.empty((1, 12)), hybrid.members(case.mass(t))
        step(np.array(chi[None]), acting, still, still, rows, hybrid.tables, 0.0, out)
        return np.asarray(out[0])

    def upright(t: float, chi: Array) -> float:
        return float(PITCH_LIMIT_RAD - abs(chi[10]))

    upright.terminal = True  # type: ignore[attr-defined]
    t_s = step_s * np.arange(int(case.duration_s / step_s + 1e-9) + 1)
    solution = solve_ivp(
        rate,
        (0.0, t_s[-1]),
        np.zeros(12),
        method="LSODA",
        t_eval=t_s,
        events=upright,
        rtol=1e-9,
        atol=1e-10,
    )
    stop = None
    if solution.status == 1:
        stop = f"pitch beyond {PITCH_LIMIT_RAD:g} rad at {solution.t_events[0][0]:.1f} s"
    elif not solution.success:
        stop = f"the integration failed: {solution.message}"
    return OpenLoopRun(
        case, hybrid.parameter_set, solution.t, solution.y.T, case.mass(solution.t), stop
    )


def findings(run: OpenLoopRun) -> tuple[Finding, ...]:
    """Return every statement of the case beside the run."""
    return tuple(
        Finding(run.case.name, run.parameter_set, item, run.quantity(item.quantity))
        for item in run.case.statements
    )
