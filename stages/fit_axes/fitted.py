"""What the fits of single axes hand to card, section and pictures."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypedDict

import numpy as np

from auvid.data_schemas.records.models import VelocityRange
from auvid.data_schemas.records.motion import InstallationFigure
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.axis_figures import AxisEquation
from auvid.hydro.identification.axes.judgement import STRAIGHT, ShapeVerdict
from auvid.hydro.identification.axes.pooled_fit import Pool, PoolFit
from auvid.hydro.identification.axes.quantities import FitQuantity
from auvid.hydro.identification.fleet.thruster_ratios import ThrusterRatio
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, T_LIMIT, WEAK
from auvid.stages.number_format import SIMULATED_PERCENT

LackingVerdict = Literal[
    "not observable", "not excited", "not commanded", "left out", "wrong sign", "not predicted"
]
LagVerdict = Literal["identified", "weak", "assumed"]
DIVES_DIFFER, DRAG_AHEAD = "the dives differ by more than chance", "drag ahead is"
"""Words of warnings by fits of single axes."""
ArmChoice = Literal["where_assumed", "file", "estimated"]


@dataclass(frozen=True)
class HeldOutFit:
    """Fit [%] of the rate on windows or a leg that the fit did not use.

    one_run: of a leg, that of one free run from its first window to its last.
    """

    what: str
    percent: float
    windows: int
    one_run: float | None = None

    @property
    def validates(self) -> bool:
        """Return whether a leg for validation judged it: that decides nothing."""
        return self.what.startswith("validation")


@dataclass(frozen=True)
class AxisMotion:
    """An axis on one leg: clock (n,), its rate and depth as measured and as simulated.

    nan outside the windows (first, last + 1).
    """

    axis: str
    leg: str
    t_s: Array
    measured: Array
    simulated: Array
    windows: tuple[tuple[int, int], ...]
    depth_measured: Array | None = None
    depth_simulated: Array | None = None

    @property
    def longest_s(self) -> float:
        """Return the length of the longest window."""
        return max(float(self.t_s[last - 1] - self.t_s[first]) for first, last in self.windows)

    def rms_errors(self) -> tuple[float, float]:
        """Return RMS errors of the simulation, and of no change in a window."""
        change = self.measured.copy()
        for first, last in self.windows:
            change[first:last] -= self.measured[first]
        inside = np.isfinite(self.simulated) & np.isfinite(self.measured)
        error = (self.simulated - self.measured)[inside]
        return float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean(change[inside] ** 2)))


@dataclass(frozen=True)
class FlownAxis:
    """One velocity of a fit: the pool of its training legs, and what was fitted."""

    velocity: str
    pool: Pool
    fit: PoolFit

    @property
    def axis(self) -> str:
        """Return its letter."""
        return AXES[VELOCITIES.index(self.velocity)]

    @property
    def place(self) -> int:
        """Return where its velocity stands among those of the fit."""
        return self.pool.structure.velocities.index(self.velocity)

    @property
    def theta(self) -> Array:
        """Return the coefficients of all terms of the fit."""
        return self.fit.values[: len(self.pool.structure.terms)]


class JudgedMotion(TypedDict):
    """How a fitted axis moves, as `FittedAxis` has it."""

    held_out: tuple[HeldOutFit, ...]
    training_percent: float
    error_rms: float
    speeds: VelocityRange
    samples: int
    windows: int
    seconds: float
    per_leg: Mapping[str, tuple[float, int]]
    motion: tuple[AxisMotion, ...]
    flown: FlownAxis
    whole_legs: Mapping[str, float]
    unused_legs: Mapping[str, str]


@dataclass(frozen=True)
class FittedAxis:
    """One axis: its equation of motion, how well it moves, what it was fitted to.

    training_percent: fit [%] on its own windows. rate_rms, error_rms: of the windows.
    speeds: range of the rate. warnings and notes are sentences.
    """

    equation: AxisEquation
    held_out: tuple[HeldOutFit, ...]
    training_percent: float
    rate_rms: float
    error_rms: float
    speeds: VelocityRange
    samples: int
    windows: int
    seconds: float
    measured_by: str
    lag_s: float
    lag_error_s: float
    lag_verdict: LagVerdict
    lag_told_s: tuple[float, float] | None = None
    """What the motion tells of the lag, with its error, whatever is taken."""
    shape: ShapeVerdict = STRAIGHT
    inertia: str = "determined"
    """What the fit says of 1 / c: given, determined, weak, from the prior, not determined."""
    quantities: tuple[FitQuantity, ...] = ()
    """What needs no newtons."""
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    per_leg: Mapping[str, tuple[float, int]] = field(default_factory=dict)
    """Leg -> fit [%] on it by the pooled model, and its windows."""
    motion: tuple[AxisMotion, ...] = ()
    whole_legs: Mapping[str, float] = field(default_factory=dict)
    """Validation leg -> fit [%] of one free run from its first window to its last."""
    unused_legs: Mapping[str, str] = field(default_factory=dict)
    """Leg without windows of its own -> why: nothing commands or measures it there."""
    surge: AxisEquation | None = None
    """`force`, and acceleration down by a force ahead of 1, behind the lag of the surge
    speed (`SURGE`).
    """
    righting: AxisEquation | None = None
    """`force`, and acceleration by the sine of the angle [1/s^2] (`RIGHTING`), below 0 where
    it rights.
    """
    flown: FlownAxis | None = None
    """The fit that it is of, and the pool of its windows."""

    @property
    def axis(self) -> str:
        """Return its letter."""
        return self.equation.axis

    @property
    def held_out_percent(self) -> float | None:
        """Return the least fit on what was held out, None where nothing moved there."""
        values = [item.percent for item in self.held_out if np.isfinite(item.percent)]
        return min(values) if values else None

    @property
    def predicts_training(self) -> bool:
        """Return whether it flies training windows that it was not fitted to."""
        parts = [i.percent for i in self.held_out if not i.validates and np.isfinite(i.percent)]
        return min(parts, default=0.0) >= SIMULATED_PERCENT

    @property
    def predicts(self) -> bool:
        """Return whether it moves as measured where it was not fitted."""
        return (self.held_out_percent or 0.0) >= SIMULATED_PERCENT

    def verdict(self, name: str) -> str:
        """Return the verdict on a term.

        Weak at best where the axis does not predict, or the interval by few windows is wide.
        """
        word = self.equation.verdicts[name]
        clear = abs(self.equation.value(name)) >= T_LIMIT * self.equation.error(name)
        return word if word != IDENTIFIED or (self.predicts and clear) else WEAK


@dataclass(frozen=True)
class Lacking:
    """An axis that is not fitted, and why.

    `no_thruster`: whether no thruster of the vehicle acts along it; None where nothing says.
    """

    axis: str
    verdict: LackingVerdict
    words: str
    no_thruster: bool | None = None


@dataclass(frozen=True)
class CommandForces:
    """What a full command is: shares where `normalised`, and what gives its newtons.

    full_force: axis -> force of a full command, measured [N, N m]. full_thrust: axis ->
    force of a full command by that of one thruster [1, m], where their layout is known.
    """

    normalised: bool
    full_force: Mapping[str, float]
    full_thrust: Mapping[str, float]

    def pulled(self, axes: Container[str]) -> str | None:
        """Return the first of some axes whose full force was measured, or None."""
        return next((axis for axis in self.full_force if axis in axes), None)


@dataclass(frozen=True)
class Together:
    """Whether some axes are of one fit with Coriolis force, and what decided it.

    error_ratio: geometric mean, over legs and axes that were held out, of the error of
    that fit over those of fits one by one; nan where nothing was compared. inertia_shares:
    axis -> its inertia over that of the first of `axes`, over the same of the vehicle file,
    as Coriolis force tells, and the standard error: also of an axis that nothing fits.
    """

    axes: tuple[str, ...]
    chosen: bool
    error_ratio: float
    pairs: int
    inertia_shares: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class LegClock:
    """How late [s] commands of a leg are stamped against the others, with its error."""

    late_s: float
    error_s: float


@dataclass(frozen=True)
class Markers:
    """Arm of markers or velocity log (`sensor`) by file and legs.

    `stated`: the file has one. `used`: the motion has that of the legs.
    """

    figures: tuple[InstallationFigure, ...]
    sensor: str
    stated: bool
    used: bool

    @property
    def departure(self) -> Array:
        """Return what departs (3,) [m]; 0 where legs agree with the vehicle file."""
        return np.array([i.departure if i.verdict == "departs" else 0.0 for i in self.figures])

    @property
    def departs(self) -> bool:
        """Return whether any of the three departs."""
        return any(item.verdict == "departs" for item in self.figures)


@dataclass(frozen=True)
class AxisFits:
    """All that the logs say of the six axes; force in full commands where `normalised`.

    full_force, full_thrust: as in `CommandForces`.
    """

    fitted: tuple[FittedAxis, ...]
    lacking: tuple[Lacking, ...]
    normalised: bool
    full_force: Mapping[str, float]
    full_thrust: Mapping[str, float]
    force: str
    legs: tuple[str, ...]
    together: Together | None = None
    markers: Markers | None = None
    thrusters: tuple[ThrusterRatio, ...] = ()
    """How strong each is against those like it."""
    clocks: Mapping[str, LegClock] = field(default_factory=dict)
    """Leg -> how late its commands were stamped, which the fits have moved."""
    common_clock: LegClock | None = None
    """How late commands of all legs were stamped beside that, if so."""

    @property
    def inertia_shares(self) -> dict[str, tuple[float, float]]:
        """Return axis -> factor of its inertia in the vehicle file, and its error."""
        chosen = self.together is not None and self.together.chosen
        return dict(self.together.inertia_shares) if self.together and chosen else {}

    @property
    def commands(self) -> CommandForces:
        """Return what a full command is."""
        return CommandForces(self.normalised, self.full_force, self.full_thrust)
