"""What synthesis and validation hand on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from auvid.data_schemas.documents.model import Model
from auvid.data_schemas.records.likelihood import LagFit, LikelihoodFit
from auvid.data_schemas.records.partial import PartialFigures

Verdict = Literal[
    "identified",
    "weak",
    "not excited",
    "inseparable",
    "not applicable",
    "at its bound",
    "from the prior",
    "from a bench",
    "from the shelf",
]
InertiaVerdict = Literal["identified", "weak", "not excited", "inseparable", "at its bound"]


class TermCard(Model):
    """Terms."""

    term: str
    """Basis term."""
    unit: str
    """SI unit of the coefficient, as N s^2/m^2."""
    value: float | None = None
    """Coefficient in that unit; null where the data determine none."""
    standard_error: float | None = None
    """Standard error for coloured residuals."""
    verdict: Verdict
    """What the data say; where they say too little, what the value rests on."""
    free_value: float | None = None
    """The value without limits, where limits changed it."""
    inseparable_from: list[str] | None = None
    """Terms it cannot be told from."""
    turns_without: list[str] | None = None
    """Training legs without which its sign turns."""
    assumed_shifts: dict[str, float] = Field(default_factory=dict)
    """Assumed figure of the vehicle -> what one standard deviation of it moves the value
    by, in the unit of the value; no part of the standard error. `form`: what the terms
    that the form lacks move it by; `unsteady`: what the force error leans it by, as it moves
    the vehicle.
    """
    source: str | None = None
    """Where a coefficient comes from that fills an axis; absent for the logs of the run."""


class CovarianceCard(Model):
    """Covariance of the coefficients for coloured residuals.

    It holds the terms, and the rows of the lower triangle.
    """

    terms: list[str]
    """Terms that carry a number."""
    lower: list[list[float]]
    """Rows of the lower triangle in SI."""
    shifts: dict[str, list[list[float]]] = Field(default_factory=dict)
    """Assumed figure -> a row for each of its numbers: what one standard deviation of it
    moves the terms by, with sign, beside noise. The rows of all axes are of the same
    numbers, in the same order, so that axes err together.
    """

    def shifts_of(self, terms: Sequence[str]) -> dict[str, list[list[float]]]:
        """Return `shifts` of terms; 0 for a term that it does not have."""
        place = {term: i for i, term in enumerate(self.terms)}
        return {
            figure: [[row[place[t]] if t in place else 0.0 for t in terms] for row in rows]
            for figure, rows in self.shifts.items()
        }


class TermCombination(Model):
    """A combination of inseparable terms that the data determine."""

    weights: dict[str, float]
    """Term -> its weight."""
    value: float
    """Weighted sum in SI."""
    standard_error: float | None = None
    """Standard error of the sum."""
    reading: str
    """The sum and its value as printed."""
    assumed_shifts: dict[str, float] = Field(default_factory=dict)
    """As of a term, of the sum."""


class AxisCard(Model):
    """Axes."""

    unit: str
    """Unit of the axis."""
    samples: int
    """Training samples."""
    rank: int
    """Rank decided on scaled columns."""
    condition: float | None = None
    """Condition of the scaled columns."""
    j0: float | None
    """RMS of tau_bar on training; null where nothing was fitted."""
    j: float | None
    """RMS of the error on training; null where nothing was fitted."""
    excitation: Literal["excited", "weak", "not excited"]
    """Whether the training legs move this axis."""
    terms: list[TermCard]
    """Coefficients."""
    covariance: CovarianceCard
    """Covariance of the coefficients for coloured residuals: terms, and the rows of the
    lower triangle.
    """
    combinations: list[TermCombination]
    """What the data determine of inseparable terms: weights per term and value."""
    lacking: list[str] = Field(default_factory=list)
    """Terms that the form lacks on this axis, and the training legs show clearly."""
    samples_per_one: float | None = None
    """How many samples count as one: median over coefficients of the variance by blocks left
    out over that of white errors; at most the samples of a block.
    """


class DiveCurrent(Model):
    """A steady current under a velocity over ground, as the forces show it."""

    value_m_s: list[float]
    """Towards north and east."""
    sd_m_s: list[float]
    """Standard deviations."""
    clear: bool
    """Whether it is clear of zero, and large enough to count."""


class PriorCard(Model):
    """The prior on coefficients, where one was used.

    Verdicts stay those of the data without the prior.
    """

    source: Literal["strip_theory", "vehicle"]
    """Where the means come from."""
    relative_sd: float
    """Standard deviation as a share of each mean."""
    means: dict[str, dict[str, float]]
    """Per axis, term -> mean in SI."""


class MeasuredPriorCard(Model):
    """Coefficients that another measurement or publication gives, with covariance."""

    source: Literal["bench", "campaign", "shelf"]
    """A bench, another campaign, or a published set."""
    file: str
    """Its results, its model card, or the name of the set."""
    means: dict[str, dict[str, float]]
    """Per axis, term -> mean in SI."""
    lower: list[list[float]]
    """Rows of the lower triangle of their covariance in SI, in the order of `means`."""


class VelocityRange(Model):
    """What the training legs cover of a velocity, in SI."""

    rms: float
    """Root mean square."""
    low: float
    """Smallest value."""
    high: float
    """Largest value."""
    threshold: float = 0.03
    """RMS from which on a term linear in it counts as excited; cards of 0.1.0 had one."""


class LimitCard(Model):
    """A physical limit that holds coefficients back."""

    name: str
    """The limit, as `K_p <= 0`."""
    unknowns: list[str]
    """The coefficients in it."""


class InertiaCard(Model):
    """An inertia that was fitted beside the viscous terms."""

    name: str
    """The derivative, as `N_rdot`."""
    unit: str
    """SI unit."""
    value: float
    """Total inertia of the axis, rigid body and added mass together."""
    standard_error: float | None
    """Its standard error; null at its bound."""
    free_value: float | None = None
    """The same without physical limits; null where they leave it."""
    in_vehicle_file: float
    """The same from the vehicle file."""
    change: float
    """What is added to the derivative of the vehicle file (negative adds inertia)."""
    beside_lag: float
    """The change where a thrust lag on the axis is fitted beside it."""
    beside_lag_error: float
    """Its standard error."""
    lag_s: float
    """That thrust lag."""
    lag_error_s: float
    """Its standard error."""
    correlation: float
    """Of inertia and lag: near 1 or -1 they are one parameter."""
    verdict: InertiaVerdict
    """Inseparable: from the thrust lag."""
    assumed_shifts: dict[str, float] = Field(default_factory=dict)
    """Assumed figure of the vehicle -> what one standard deviation of it moves `value` by;
    its own in the vehicle file does not move the total.
    """


class ModelCard(Model):
    """One identified viscous model."""

    name: str
    """Name of the model."""
    title: str
    """Name as printed."""
    vehicle: str
    """The vehicle."""
    source: str
    """Where the model form comes from."""
    n_bar: int
    """Number of terms fitted."""
    n_bar_declared: int
    """Number of terms of the model as declared."""
    rank: int
    """Number of coefficients that the data determine."""
    samples: int
    """Training samples."""
    trim: bool
    """Whether a constant force per axis was fitted."""
    velocity_errors: bool | None = None
    """Whether standard errors and covariance allow for errors of the velocities;
    absent: no.
    """
    coverage_on_twins: dict[str, float] = Field(default_factory=dict)
    """True model of a twin -> share of the 95 % intervals of identified coefficients that
    held the truth there, where it was measured for this method.
    """
    left_out: list[str] = Field(default_factory=list)
    """Training legs left out in turn to see whether signs hold; none where there is one.
    """
    assumed: list[str]
    """Figures of the vehicle that are assumed."""
    spreads: dict[str, float] = Field(default_factory=dict)
    """Standard deviations of assumed figures, in SI or as a share; others count as exact.
    """
    axes: dict[str, AxisCard]
    """Per axis: rms_N (J0), residual_rms (J), terms."""
    not_applicable: list[str]
    """Terms left out because the vehicle has no propeller speed."""
    switched_off: dict[str, str] = Field(default_factory=dict)
    """Axis and term, as `X w` -> why the training legs do not carry it."""
    conditions: dict[str, VelocityRange]
    """Range of u v w p q r in training."""
    predictor: dict[str, dict[str, float]]
    """Per axis, term -> number that predicts the force, whatever its verdict (0 for all
    but one of an inseparable group). Results are those of `axes`, with a verdict.
    """
    method: Literal[
        "least squares",
        "within limits",
        "error function",
        "output error",
        "filter error",
        "axes",
        "glides",
        "passive motion",
    ] = "least squares"
    """Least squares alone, or with physical limits and the six axes as one problem, or
    another error function, or maximum likelihood of the sensors themselves, or output
    error over windows of the axes that a log measures, or the balance of steady glides, or
    tows, coasts and swings.
    """
    error_function: Literal["squares", "absolute", "median", "huber"] = "squares"
    """What of the force error is least: sum of squares, sum of moduli, median of moduli,
    Huber's function.
    """
    weights: Literal["equal", "deviations"] = "equal"
    """Weights of samples: equal, or by the deviation that velocities give the force."""
    minimiser: Literal["own", "nelder_mead"] = "own"
    """How the least value was found: the function's own way, or the simplex."""
    damping: Literal["free", "negative", "dissipative"] = "free"
    """Limits on damping: none; no positive damping along an axis; no motion of the flown
    range that gains energy.
    """
    limits: list[LimitCard] = Field(default_factory=list)
    """The limits that hold the solution back."""
    limits_cost: float = 0.0
    """J/J0 on training with limits less that without."""
    inertia: list[InertiaCard] = Field(default_factory=list)
    """Inertia fitted beside the viscous terms; the predictor goes with it."""
    lag: LagFit | None = None
    """Lag of the actuators behind their record that the model goes with; null for none."""
    currents: dict[str, DiveCurrent] = Field(default_factory=dict)
    """Log -> its steady current by the forces, of velocities over ground."""
    moved_by_lag: dict[str, dict[str, float]] = Field(default_factory=dict)
    """Axis -> damping of its own velocity -> how far the lag moved it, by least squares;
    empty without a lag.
    """
    held_out: dict[str, dict[str, float | None]] = Field(default_factory=dict)
    """Training leg -> axis or all -> J/J0 on it, predicted from the other legs; empty
    with one leg.
    """
    prior: PriorCard | None = None
    """The prior on coefficients, where one was used; verdicts stay those of the data
    alone.
    """
    measured_priors: list[MeasuredPriorCard] = Field(default_factory=list)
    """Priors from a bench or from other campaigns."""
    likelihood: LikelihoodFit | None = None
    """Noise and errors of the sensors, for a model fitted by maximum likelihood."""
    partial: PartialFigures | None = None
    """Axes that the model has and lacks, and its unit of mass; absent where it has six in
    newtons.
    """

    @property
    def lag_s(self) -> float:
        """Return the lag of the actuators that the model goes with [s]."""
        return 0.0 if self.lag is None else self.lag.value_s

    @property
    def identified(self) -> int:
        """Return how many coefficients are identified, constant forces not counted."""
        return sum(
            item.verdict == "identified" and item.term != "constant"
            for part in self.axes.values()
            for item in part.terms
        )


class AxisMerit(Model):
    """How good a model is on one axis, or on all."""

    validation: float | None
    """J/J0 on the validation legs."""
    training: float | None
    """J/J0 on the training legs."""
    left_out: float | None
    """Mean J/J0 of training legs, each predicted from the others; null with one leg."""
    bic: float | None
    """BIC over independent training samples, less that of the least."""
    free_run: float | None
    """RMS error of free runs at the horizon over that of the better guess of no change and
    no motion.
    """
    identified: int
    """Coefficients that the data identify."""
    coefficients: int
    """Coefficients that apply to the vehicle."""
    better_form: str | None = None
    """The model whose form fits the training legs clearly better: a smaller error, and a
    BIC lower by 10 and more. Null for none, and for all axes together.
    """
    lacking: list[str] = Field(default_factory=list)
    """Terms that the form lacks on this axis, and the training legs show clearly."""


class SteadyRange(Model):
    """How far steady motion along an axis goes, with roll and pitch free."""

    axis: str
    """Axis of the drive: X, Y, Z or N."""
    drive: Literal["thrusters", "propeller", "force at the origin"]
    """What drives it: its own actuators, or that one component of force alone."""
    flown: list[float]
    """Lowest and highest speed of the training legs, the range that is tried."""
    upright: list[float]
    """Ends of the range, from rest on, in which it stays upright (below 60 degrees)."""
    stable: list[float] = Field(default_factory=list)
    """Ends of the range, from rest on, in which no disturbance grows by .05 1/s or more."""
    roll_rad: float
    """Largest roll of these steady motions."""
    pitch_rad: float
    """Their largest pitch."""
    growth_1_s: float
    """Fastest growth of a disturbance about them; not above 0 where all are stable."""
    grows_on: str
    """Axis that this disturbance shows on most."""
    grows_by: str = ""
    """What adds most to its growth where it grows: a coefficient, `C` (Coriolis force),
    `G` (righting moment).
    """
    tips_in: Literal["", "roll", "pitch", "no steady motion", "unstable"]
    """What ends the range; empty where it is all of the flown one."""
    cause: str
    """What pushes it over most: a coefficient, `C` (Coriolis force), `actuators`."""
    cause_N_m: float
    """Its moment at the end of the range; 0 for none."""


class MotionCheck(Model):
    """What a model does by itself: steady motion, steps, decay from the flown range."""

    verdict: Literal["holds", "unstable", "tips over", "unknown", "not tried"]
    """Driven by its own actuators (by a force at the origin where it has none)."""
    words: str
    """The same in words, with speeds."""
    remedies: list[str]
    """What would cure it or make it sure, in words; empty for nothing."""
    ranges: list[SteadyRange]
    """Axis by axis and drive by drive."""
    rest_rad: list[float] | None
    """Roll and pitch at which it floats by itself; null where that is not upright."""
    righting_N_m: list[float]
    """Righting moment per radian of roll and of pitch about level."""
    righting_is_assumed: bool
    """Whether it follows from a centre of gravity or buoyancy that nobody measured."""
    steps: int
    """Steps of the drive from rest that were flown, each for `seconds`."""
    steps_lost: int
    """Of them, those that tipped over or left all bounds."""
    decays: int
    """Decays from the edges of the flown velocities, without any drive."""
    decays_lost: int
    """Of them, those that tipped over or left all bounds."""
    seconds: float
    """Length of each."""


class MeritRecord(Model):
    """How good one model is, and what speaks against it."""

    name: str
    """Name of the model."""
    title: str
    """Name as printed."""
    published: bool
    """Whether it is a form of the thesis."""
    terms: int
    """Terms fitted."""
    rank: int
    """Coefficients that the data determine."""
    j: float | None
    """J on the validation legs, else on training; N and N m mixed."""
    axes: dict[str, AxisMerit]
    """Axis or all -> merit."""
    runs: int
    """Free runs, 0 where none was made."""
    lost: int
    """Free runs that left all bounds."""
    faults: list[str]
    """What it does that no vehicle does; empty for a model that passes physics."""
    motion: MotionCheck | None = None
    """What it does by itself; null for one with other faults, which is not tried."""


class UsableFor(Model):
    """What the chosen model is usable for, by axis."""

    forces: list[str]
    """Axes whose force it predicts on the validation legs (J/J0 below 1)."""
    simulation: list[str]
    """Axes that it simulates better than no change or no motion, where no run is lost."""
    under_attitude_hold: list[str] = Field(default_factory=list)
    """Further axes that it simulates so where an autopilot, or the simulator, holds roll and
    pitch: left free, driving along them tips it over.
    """
    control: list[str]
    """Of those, axes with identified damping and a force error below half."""
    speeds: dict[str, VelocityRange]
    """Velocity -> range of the training legs, in SI."""


class RankingRecord(Model):
    """Models by merit, the one to take, and what for."""

    models: list[MeritRecord]
    """Best first by J on the validation legs, else on training."""
    choice: str | None
    """The model to take; null where none is better than predicting no force."""
    rule: str
    """Why this one, or why none."""
    simulate_with: str | None = None
    """The model to simulate with where free runs of the one to take fail; null where they do
    not, or none is better.
    """
    legs_left_out: int
    """Training legs left out in turn; 0 with one leg."""
    horizon_s: float | None
    """When free runs are compared; null without any."""
    usable: UsableFor | None
    """What the chosen model is usable for; null for nothing."""
    constant: dict[str, float] = Field(default_factory=dict)
    """Axis or all -> J/J0 that the mean force of the training legs alone has where models
    are judged.
    """


class ErrorMetrics(Model):
    """J and J/J0 as nested figures, for `dvc metrics`."""

    training: dict[str, dict[str, object]]
    """Model -> {J, ratio, per axis ratios}."""
    validation: dict[str, dict[str, object]]
    """The same on validation."""


class FactorRecord(Model):
    """The triangular factor of the training data.

    Every least-squares model follows from it.
    """

    terms: list[str]
    """Basis columns."""
    samples: int
    """Rows that went in."""
    factor: list[list[float]]
    """Rows of the upper triangle."""
