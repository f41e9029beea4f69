"""A dive as one compiled loop: autopilot, thrusters and motion, called by number.

No equation stands here: numba compiles the functions that the array code calls. Import
this module only where a dive is flown: numba takes a second.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numba.extending
import numpy as np
from numpy.typing import NDArray

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_entries, rotation_entries
from auvid.hydro.dynamics.mechanics.restoring import restoring_components
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_components
from auvid.hydro.dynamics.simulation.rov.autopilot import (
    MEMORY,
    AutopilotGains,
    autopilot_step,
    mixed_pulses,
)
from auvid.hydro.dynamics.simulation.rov.motion import (
    FIRST_PULSE_US,
    RovTables,
    hull_components,
    plus,
    rov_rate,
    row_times,
    six_times,
    thruster_components,
)
from auvid.hydro.dynamics.simulation.rov.open_frame import plate_components
from auvid.hydro.dynamics.simulation.rov.tether import tether_components
from auvid.hydro.dynamics.simulation.rov.thrust import delivered_components, drawn_current
from auvid.hydro.dynamics.viscous.basis import cross_flow_speed, signed_speed

EQUATIONS: tuple[Callable[..., Any], ...] = (
    rotation_entries,
    euler_rate_entries,
    coriolis_components,
    restoring_components,
    cross_flow_speed,
    signed_speed,
    plate_components,
    tether_components,
    delivered_components,
    drawn_current,
    plus,
    row_times,
    six_times,
    hull_components,
    thruster_components,
    rov_rate,
    autopilot_step,
    mixed_pulses,
)
_extending: Any = numba.extending
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz"},
    "no_cfunc_wrapper": True,
}
for _equation in EQUATIONS:
    _extending.register_jitable(**_OPTIONS)(_equation)
F = TypeVar("F", bound=Callable[..., Any])


def _loops(sources: str) -> tuple[Any, Any]:
    """Return the compiled loops of a dive and of rates, kept by `sources`."""

    def fly(
        x: Array,
        modes: NDArray[np.int64],
        sticks: Array,
        targets: Array,
        errors: Array,
        push: Array,
        tick_s: float,
        steps: int,
        gains: AutopilotGains,
        c: RovTables,
        states: Array,
        pulses: NDArray[np.int64],
        supply: Array,
        goals: Array,
    ) -> int:
        """Fill the rows of a dive from the state x (12 + n,); return the ticks flown.

        x = [nu, eta, bollard thrust]. Per tick k: `modes`, `sticks` (k, 6), `targets`
        (k, 6), `errors` (k, 12) of what the autopilot sees, `push` (k, 6). Out: `states` ((k - 1)
        steps + 1, 12 + n), `pulses` (k, n) [us], `supply` (k, 2) [V, A], `goals` (k, n)
        bollard thrust [N], held over the tick. A state that is not finite, or above
        water, ends the dive.
        """
        assert len(sources) > 0
        size, count, last = len(x), len(c.direction), len(modes) - 1
        memory, outputs = np.zeros(MEMORY), np.zeros(6)
        stage, total, slope = np.empty(size), np.empty(size), np.empty(size)
        memory[11], charge = -1.0, 0.0
        step_s = tick_s / steps
        for i in range(size):
            states[0, i] = x[i]
        for k in range(last + 1):
            # What the autopilot sees: velocity over ground from its filter.
            e = errors[k]
            sf, cf, st, ct = np.sin(x[9]), np.cos(x[9]), np.sin(x[10]), np.cos(x[10])
            rows = rotation_entries(sf, cf, st, ct, np.sin(x[11]), np.cos(x[11]))
            drift = c.current
            pose = (
                x[6] + e[6], x[7] + e[7], x[8] + e[8],
                x[9] + e[9], x[10] + e[10], x[11] + e[11],
            )  # fmt: skip
            nu = (
                x[0] + rows[0][0] * drift[0] + rows[1][0] * drift[1] + rows[2][0] * drift[2] + e[0],
                x[1] + rows[0][1] * drift[0] + rows[1][1] * drift[1] + rows[2][1] * drift[2] + e[1],
                x[2] + rows[0][2] * drift[0] + rows[1][2] * drift[1] + rows[2][2] * drift[2] + e[2],
                x[3] + e[3], x[4] + e[4], x[5] + e[5],
            )  # fmt: skip
            autopilot_step(
                memory, gains, modes[k], sticks[k], targets[k], pose, nu, tick_s, outputs
            )
            mixed_pulses(c.mixing, c.direction, outputs, pulses[k])
            # Battery: the thrust now, at the voltage of the tick before, draws current.
            drawn = c.supply[5]
            for i in range(count):
                drawn += drawn_current(x[12 + i], c.supply[6])
            charge += drawn * tick_s / 3600.0
            voltage = c.supply[2] - c.supply[3] * charge - c.supply[4] * drawn
            supply[k, 0], supply[k, 1] = voltage, drawn
            scale = (voltage / c.supply[0]) ** c.supply[1]
            for i in range(count):
                pulse = 1500 + int(c.direction[i]) * (pulses[k, i] - 1500)
                goals[k, i] = scale * c.thrust[pulse - FIRST_PULSE_US]
                if c.lag_s == 0.0:
                    x[12 + i] = states[k * steps, 12 + i] = goals[k, i]
            if k == last:
                return k
            for s in range(steps):
                for i in range(size):
                    total[i], stage[i] = 0.0, x[i]
                for part in range(4):
                    share = (s + 0.5 * ((part + 1) // 2)) / steps
                    now = (
                        push[k, 0] + share * (push[k + 1, 0] - push[k, 0]),
                        push[k, 1] + share * (push[k + 1, 1] - push[k, 1]),
                        push[k, 2] + share * (push[k + 1, 2] - push[k, 2]),
                        push[k, 3] + share * (push[k + 1, 3] - push[k, 3]),
                        push[k, 4] + share * (push[k + 1, 4] - push[k, 4]),
                        push[k, 5] + share * (push[k + 1, 5] - push[k, 5]),
                    )
                    rov_rate(stage, goals[k], now, c, slope)
                    weight = 2.0 if part == 1 or part == 2 else 1.0
                    ahead = step_s if part == 2 else 0.5 * step_s
                    for i in range(size):
                        total[i] += weight * slope[i]
                        stage[i] = x[i] + ahead * slope[i]
                finite = 0.0
                for i in range(size):
                    x[i] += step_s / 6.0 * total[i]
                    finite += 0.0 * x[i]
                    states[k * steps + s + 1, i] = x[i]
                if finite != 0.0 or x[8] < 0.0 or abs(x[10]) > 1.4:
                    return k
        return last

    def rates(
        states: Array, goals: Array, push: Array, c: RovTables, out: Array, hull: Array
    ) -> None:
        """Fill d/dt `out` of states (m, 12 + n), and the force `hull` (m, 6)."""
        assert len(sources) > 0
        for i in range(len(states)):
            x, f = states[i], push[i]
            rov_rate(x, goals[i], (f[0], f[1], f[2], f[3], f[4], f[5]), c, out[i])
            force = hull_components(c, (x[0], x[1], x[2], x[3], x[4], x[5]))
            for k in range(6):
                hull[i, k] = force[k]

    return _compiled(fly), _compiled(rates)


def _compiled(function: F) -> F:
    result: F = numba.njit(nogil=True, cache=True, **_OPTIONS)(function)
    return result


_MODULES = {inspect.getmodule(item) for item in EQUATIONS}
_SOURCES = sorted(inspect.getsource(module) for module in _MODULES if module is not None)
fly, rates = _loops(hashlib.sha256("".join(_SOURCES).encode()).hexdigest())
