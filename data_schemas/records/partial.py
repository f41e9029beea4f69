"""What is known of a model that has some axes only, or a unit of mass of its own."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from auvid.data_schemas.documents.model import Model

Axis = Literal["X", "Y", "Z", "K", "M", "N"]
FigureVerdict = Literal[
    "identified", "weak", "not excited", "inseparable", "at its bound", "from the prior"
]
AT_SPEED = "time constant at"
"""Start of the name of a figure in which linear and quadratic drag are one."""


class AxisSource(Model):
    """Where an axis of a partial model comes from, and how well it predicts."""

    source: Literal["fitted", "shelf", "bench"]
    """The logs of this campaign, a published set, or a bench."""
    name: str
    """What was fitted to, or the set or file that the numbers are from, in words."""
    held_out_percent: float | None
    """Fit of its rate on windows that it was not fitted to, 100 (1 - |error| / |departure
    from the mean|); of a tow that of the force, of a swing that of the angle, of a glide
    that of the depth rate; null where nothing judges it.
    """
    lag_s: float
    """Time constant of a first-order lag between command and force on this axis."""
    lag_verdict: Literal["identified", "weak", "assumed"]
    """Whether the data determine the lag."""


class LackingAxis(Model):
    """Why a partial model does not have an axis."""

    verdict: Literal[
        "not observable", "not excited", "not commanded", "left out", "wrong sign", "not predicted"
    ]
    """Nothing measures it; it hardly moves; no actuator drives it; the campaign leaves it
    out; it moves against its force; on what was held out its mean is the better guess.
    """
    words: str
    """The reason."""
    remedy: str
    """What would give the axis."""


class MassFreeFigure(Model):
    """A figure of an axis that needs neither newtons nor kilograms."""

    axis: Axis
    """The axis."""
    quantity: str
    """What it is, as `time constant at 0.3 rad/s`, `Z_w/M` (M: apparent inertia of the axis),
    `steady speed of full command`; the speed of a rotation is its rate.
    """
    value: float
    """The figure."""
    unit: str
    """Its SI unit."""
    interval_95: list[float] | None
    """Ends of its 95 % interval; null where there is none."""
    verdict: FigureVerdict
    """What the data say; of several coefficients in it, of the worst. That of a time constant at a
    speed is its own: linear and quadratic drag trade, and it is surer than both.
    """


class TotalDrag(Model):
    """Drag of an axis at one speed, over that speed: both parts together.

    Linear and quadratic part share their error, so that their sum is known much better than either.
    """

    axis: Axis
    """The axis."""
    speed: float
    """RMS speed that the axis was fitted at [m/s, rad/s]."""
    value: float
    """Force or moment against the motion, over the speed; of yaw -(N_r + N_r|r| speed)."""
    unit: str
    """N s/m or N m s/rad."""
    standard_error: float
    """By noise alone."""
    interval_95: list[float]
    """Ends of its 95 % interval by noise and assumed figures together."""
    assumed_shifts: dict[str, float] = Field(default_factory=dict)
    """What it moves by with one standard deviation of an assumed figure of the vehicle file."""
    verdict: FigureVerdict
    """What the data say, of the sum."""

    @property
    def words(self) -> str:
        """Return its name: `drag at 0.33 rad/s`."""
        return f"drag at {self.speed:g} {'m/s' if self.axis in 'XYZ' else 'rad/s'}"


class CommandGain(Model):
    """What a full command gives: gain of an axis, or of one actuator on it."""

    axis: Axis
    """Component of the force."""
    output: int | None
    """Output channel; null for the command of the axis as a whole."""
    value: float
    """Force of a full command in the unit of force of the file: that of a command x is
    value sign(x) (max(|x| - dead_band, 0) / (1 - dead_band)) ** curve.
    """
    dead_band: float = 0.0
    """Commands below it give none."""
    curve: float = 1.0
    """Exponent beyond it; 1 is a straight line."""
    mixed: bool = False
    """Whether dead band and curve are those of the four thrusters that give surge, sway and yaw:
    value times the mean, over a, b of +-1, of (1 - skew a b sign(s)) times the same of
    s = x + a y + b z, cut to -1 to 1, with the commands y and z of the other two.
    """
    skew: float = 0.0
    """By how much thrusters give more one way than on average both ways; where not mixed, that
    of a command x is 1 + skew sign(x) times as large.
    """
    shape_verdict: Literal["identified", "weak", "assumed"] = "assumed"
    """What the data say of dead band and curve; assumed: a straight line, not tried or no
    better on what was held out.
    """
    unit: str
    """N or N m; of a normalised model m/s^2 or m^2/s^2."""
    interval_95: list[float] | None
    """Ends of its 95 % interval; null where there is none."""
    verdict: FigureVerdict
    """What the data say."""


class ThrusterShare(Model):
    """How strong a thruster is against those that push along the same axes."""

    output: int
    """Output channel of the autopilot."""
    value: float | None
    """Its force over that which its output says, over the median of the same of `others`;
    null where it does not run.
    """
    interval_95: list[float] | None
    """Ends of its 95 % interval; null where there is none."""
    others: list[int]
    """Output channels of the thrusters that it is compared with."""
    verdict: FigureVerdict
    """What the data say; from the prior: the motion does not tell it from the others."""


class ScaleSource(Model):
    """What turned full commands into newtons."""

    axis: Axis
    """The axis that it was measured on."""
    source: Literal["bollard pull", "mass"]
    """A force that was measured, or a mass that is known."""
    value: float
    """The force at full command [N, N m], or the apparent inertia [kg, kg m^2]."""
    relative_sd: float
    """Its standard deviation as a share; every interval in newtons has it."""


class TogetherFigures(Model):
    """Whether axes were fitted together, with Coriolis force, or one by one."""

    axes: list[Axis]
    """Axes that were tried both ways."""
    chosen: bool
    """True: together, and the Coriolis force of `dynamics.mass` acts between all axes. False:
    one by one, and no Coriolis force acts.
    """
    error_ratio: float | None
    """Error together over error one by one, as the geometric mean over axes and what was
    held out; null where nothing was held out.
    """


class CrossForce(Model):
    """A force on one axis that follows the force of another."""

    axis: Axis
    """Axis that it acts on."""
    of: Axis
    """Axis whose force makes it."""
    value: float
    """Force on `axis` by a force of 1 on `of` that has lasted."""
    lag_s: float
    """Time constant by which it follows."""
    interval_95: list[float] | None
    """Ends of the 95 % interval of `value`; null where there is none."""
    verdict: FigureVerdict
    """What the data say."""


class RightingMoment(Model):
    """Righting moment of roll and pitch that these logs give."""

    axes: list[Axis]
    """Axes whose swing gave it; of two, their weighted mean."""
    value: float
    """Moment by the sine of the angle, in the unit of force of the file times metres: z_G W
    - z_B B of `dynamics`.
    """
    unit: str
    """N m, or m^2/s^2 and 1/s^2 of a normalised model."""
    interval_95: list[float] | None
    """Ends of its 95 % interval; null where there is none."""


class DisplacedMass(Model):
    """Mass of the displaced water that these logs give, for a glider's trim."""

    value_kg: float
    """It stands in `dynamics.buoyancy_N`, at `water_density_kg_m3` and no pressure, the
    buoyancy drive at zero.
    """
    interval_95: list[float]
    """Ends of its 95 % interval."""
    verdict: FigureVerdict
    """What the data say."""


class InertiaShare(Model):
    """A ratio of apparent inertias over that of the vehicle file."""

    value: float
    """The factor."""
    interval_95: list[float]
    """Ends of its 95 % interval."""


class PartialFigures(Model):
    """Axes that a model has and lacks, and its unit of mass."""

    unit_of_mass: Axis | None
    """Null: kg. Else the apparent inertia of this axis is 1 and every mass, inertia, force
    and coefficient of the file is a share of it; ratios of inertia are the vehicle file's,
    times `inertia_shares`.
    """
    axes: dict[Axis, AxisSource]
    """Axes that it has."""
    lacking: dict[Axis, LackingAxis]
    """Axes that it does not have; a simulation holds their velocities."""
    without_newtons: list[MassFreeFigure]
    """What holds whatever the newtons are."""
    total_drag: list[TotalDrag] = Field(default_factory=list)
    """Total drag of each axis at one speed: of a model whose linear and quadratic parts are
    weak the figure to use. None without newtons.
    """
    gains: list[CommandGain]
    """What full commands give; none where the actuators have a thrust curve."""
    thrusters: list[ThrusterShare] = Field(default_factory=list)
    """How strong each is; none where nothing says how outputs mix. Forces of the fit have
    identified ones below .7 that weak, others as strong as their outputs say.
    """
    scale: ScaleSource | None = None
    """What gave the newtons; absent where the thrust curve did, or nothing."""
    together: TogetherFigures | None = None
    """Absent where axes could be fitted one by one only; Coriolis force then acts."""
    righting: RightingMoment | None = None
    """Absent where the logs give none: that of the vehicle file then acts."""
    cross_forces: list[CrossForce] = Field(default_factory=list)
    """Forces that follow those of other axes; absent where none was fitted."""
    inertia_shares: dict[Axis, InertiaShare] = Field(default_factory=dict)
    """By what the apparent inertia of axes over that of the first of them differs from the
    vehicle file's, as their Coriolis force tells; absent where nothing was fitted together.
    """
    displaced: DisplacedMass | None = None
    """Absent where the logs give none: that of the vehicle file then acts."""
