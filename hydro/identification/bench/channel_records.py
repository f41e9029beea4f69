"""The run of one channel, what it is called there, and what is estimated from it.

Symbols of Alberti 2015, (60)-(65).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array, Index
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.bench.output_error import (
    OutputErrorFit,
    SingleRun,
)
from auvid.hydro.identification.bench.persistence_of_excitation import (
    Excitation,
)
from auvid.hydro.identification.bench.recursive_least_squares import (
    RecursiveEstimate,
)
from auvid.hydro.identification.bench.thrust_lag import Lag
from auvid.hydro.identification.regression.standard_errors import mapped

CHANNELS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
DAMPING: Mapping[str, tuple[bool, bool]] = {
    "linear": (True, False),
    "quadratic": (False, True),
    "linear and quadratic": (True, True),
}
"""Damping models of Tables 9, 12, 14, 15: whether they have the linear and the
quadratic term.
"""
WRONG_SIGN = "wrong sign"
"""Verdict on an added mass or damping that is clearly positive, which no body in water
has.
"""
BOTH = "linear and quadratic"
WIDEST = 100.0
"""Largest half width of an interval of a logarithm."""


@dataclass(frozen=True)
class Symbols:
    """Names and units of mass, added mass and damping of a channel."""

    mass: str
    added: str
    linear: str
    quadratic: str
    units: tuple[str, str, str, str]


def symbols(channel: str) -> Symbols:
    """Return the SNAME names and units of a channel.

    surge -> m, X_udot, X_u, X_u|u|; yaw -> I_z, N_rdot, N_r, N_r|r|; units of mass,
    linear and quadratic damping, force.
    """
    index = CHANNELS.index(channel)
    axis, velocity = AXES[index], VELOCITIES[index]
    units = ("kg", "kg/s", "kg/m", "N") if index < 3 else ("kg*m^2", "kg*m^2/s", "kg*m^2", "N*m")
    mass = "m" if index < 3 else f"I_{'xyz'[index - 3]}"
    return Symbols(
        mass, f"{axis}_{velocity}dot", f"{axis}_{velocity}", f"{axis}_{velocity}|{velocity}|", units
    )


@dataclass(frozen=True)
class ChannelRun:
    """One run of a channel: x and s with the force F, and which constants to fit.

    `run`; `restoring` R [N m]. `velocity` (n,) is x on the grid of the run for the
    regression: the measured one, or the slope of the measured position. `samples`:
    nodes of the grid that are samples. `noise`: RMS of x below which the channel counts
    as not excited. `lag`: whether the force is that of a command, which thrusters may
    follow late; `current`: whether a constant of the velocity is fitted. Both only
    where the run is persistently exciting: a single step does not tell them from mass
    and damping.
    """

    run: SingleRun
    velocity: Array
    samples: Index
    restoring: float = 0.0
    constant: bool = False
    rate_bias: bool = False
    noise: float = 0.0
    lag: bool = False
    current: bool = False


@dataclass(frozen=True)
class ChannelFit:
    """M, D_1, D_2, C of one damping model by output error, with covariance (4, 4).

    `values` (4,); 0 for what is left out. `rmse` of x (of s where only that is
    measured) over the run; `held_out`: over its last third with figures from the first
    two; `simulated` (n,): that signal on the grid, with the constant of the sensor.
    `resolved`: False where the run answers its force faster than it was sampled: M is
    not determined; it is then held where its time constant is half a sample, and D_1,
    D_2, C are those of the steady speeds.
    """

    values: Array
    covariance: Array
    rmse: float
    held_out: float
    simulated: Array
    fit: OutputErrorFit
    resolved: bool = True

    @property
    def standard_errors(self) -> Array:
        """Return the standard errors (4,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def mass_interval(self) -> tuple[float, float]:
        """Return the 95 % interval of M > 0, symmetric in its logarithm.

        An M whose error is many times M is anything: a width of e^100 says so, and is
        still a number.
        """
        width = min(NORMAL_95 * float(self.standard_errors[0] / self.values[0]), WIDEST)
        return float(self.values[0] * np.exp(-width)), float(self.values[0] * np.exp(width))

    def normalised(self) -> tuple[Array, Array]:
        """Return Theta = [D_1/M, D_2/M, 1/M] (62) and its covariance (3, 3).

        No more is determined by commands without a unit of force.
        """
        m, one, two, _ = self.values
        by = np.array(
            [[-one / m**2, 1.0 / m, 0.0], [-two / m**2, 0.0, 1.0 / m], [-1.0 / m**2, 0.0, 0.0]]
        )
        return np.array([one / m, two / m, 1.0 / m]), mapped(self.covariance[:3, :3], by)


@dataclass(frozen=True)
class RecursiveFit:
    """M, D_1, D_2, C (n, 4) of a damping model over time, with standard errors.

    `estimate` is Theta over time. Standard errors are those of white noise of the size
    of the residual times the ratio that the colour of the residual has at the end.
    """

    estimate: RecursiveEstimate
    values: Array
    spread: Array


@dataclass(frozen=True)
class ChannelEstimate:
    """All damping models of a run, the chosen one, and persistence of excitation.

    `lag` of the force behind its command, None where none is found; `data`: the run as
    it was fitted, with that lag.
    """

    fits: Mapping[str, ChannelFit]
    recursive: Mapping[str, RecursiveFit]
    excitation: Mapping[str, Excitation]
    chosen: str
    lag: Lag | None
    data: ChannelRun
