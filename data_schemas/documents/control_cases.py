"""What a control campaign flies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_validator,
)

from auvid.data_schemas.documents.model import (
    Faults,
    Model,
    Quantity,
    Unit,
    default,
    fault,
    part_of_kind,
)
from auvid.data_schemas.documents.quantities import (
    Kilograms,
    Metres,
    PositiveMetres,
    PositiveRatio,
    Ratio,
    Seconds,
)
from auvid.data_schemas.errors import PipelineError, nearest

Radians = Annotated[Quantity, Unit("rad")]
Newtons = Annotated[Quantity, Unit("N")]
Numbers = Annotated[Quantity, Unit("1", (-1,))]
Forces = Annotated[Quantity, Unit("N", (3,))]
PositiveRadians = Annotated[Quantity, Unit("rad", positive=True)]
PositiveSeconds = Annotated[Quantity, Unit("s", positive=True)]
PositiveSpeed = Annotated[Quantity, Unit("m/s", positive=True)]
PositiveRate = Annotated[Quantity, Unit("rad/s", positive=True)]
PositiveThrustRate = Annotated[Quantity, Unit("N/s", positive=True)]
ParameterSet = Literal["as_printed", "as_simulated", "corrected"]

SIGNALS = {
    **dict.fromkeys(("u", "v", "w", "speed"), "m/s"),
    **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("x", "y", "z"), "m"),
    **dict.fromkeys(("phi", "theta", "psi"), "rad"),
}
QUANTITIES = {
    "radius": "m",
    "depth": "m",
    **{f"steady_{signal}": unit for signal, unit in SIGNALS.items()},
    **{f"peak_{signal}": unit for signal, unit in SIGNALS.items()},
}
"""What can be stated of an open-loop manoeuvre, with its unit.

`steady_<signal>`: mean over the last tenth; `peak_<signal>`: largest modulus in the
second half; radius of the turn; depth at the end.
"""


class StatementEntry(Model):
    """What the text says of a manoeuvre."""

    value: Quantity
    """Value of the quantity."""
    tolerance: Quantity
    """How far ours may be from it."""


class OpenLoopEntry(Model):
    """A manoeuvre with constant inputs, from rest."""

    title: str | None = None
    """Heading; default the name of the case."""
    duration: PositiveSeconds
    """How long is flown."""
    thrust: Newtons = default(0.0, "N")
    """Thrust of the propeller."""
    rudder: Radians = default(0.0, "rad")
    """Rudder pair."""
    stern_right: Radians = default(0.0, "rad")
    """Right stern fin."""
    stern_left: Radians = default(0.0, "rad")
    """Left stern fin."""
    mass: Kilograms | None = None
    """Default neutral."""
    mass_swing: Kilograms = default(0.0, "kg")
    """Amplitude of a sine about the mass."""
    mass_period: Seconds = default(0.0, "s")
    """Period of that sine."""
    statements: dict[str, StatementEntry] = Field(default_factory=dict)
    """Quantity -> {value, tolerance} of the text."""

    @model_validator(mode="after")
    def _units_of_statements(self) -> OpenLoopEntry:
        faults: list[PipelineError] = []
        for name, statement in self.statements.items():
            at = f"statements.{name}"
            if name not in QUANTITIES:
                close = nearest(name, QUANTITIES)
                faults.append(fault("unknown quantity", at, name, remedy=close))
                continue
            for key, quantity in (("value", statement.value), ("tolerance", statement.tolerance)):
                try:
                    Unit(QUANTITIES[name]).read(quantity)
                except Faults as wrong:
                    faults += wrong.under(f"{at}.{key}")
        Faults(*faults).raise_any()
        return self


class LimitsEntry(Model):
    """What the actuators and the path may."""

    fins: PositiveRadians
    """Largest deflection."""
    fin_rate: PositiveRate
    """Fastest motion of a fin."""
    thrust_rate: PositiveThrustRate = default(100.0, "N/s")
    """Fastest change of thrust of a hybrid vehicle."""
    pitch: PositiveRadians
    """Steepest pitch that a trajectory may ask for."""


class WeightsEntry(Model):
    """Diagonals of the weights of a controller and its observer."""

    Q: Numbers
    """Weights of u v w p q r x y z phi theta psi."""
    R: Numbers
    """Weights of the inputs."""
    Q_Z: Numbers
    """Process noise of the augmented state in the Kalman filter."""
    R_Z: Numbers
    """Measurement noise in the Kalman filter."""


class PoseEntry(Model):
    """Pose at an end of a Dubins path."""

    position: Annotated[Quantity, Unit("m", (3,))]
    """NED."""
    heading: Radians
    """From north to east."""
    pitch: Radians
    """Nose up."""


class PathEntry(Model):
    """Where a path starts, and how its curvature rises."""

    ramp: Metres = default(0.0, "m")
    """Length over which the curvature rises; where it is 0 the curvature jumps."""
    start: Annotated[Quantity, Unit("m", (3,))] = default([0.0, 0.0, 0.0], "m")
    """First point, NED."""
    heading: Radians = default(0.0, "rad")
    """First heading."""


class HelixEntry(PathEntry):
    """A helix."""

    radius: Metres
    """Radius of the turns."""
    pitch: Radians
    """Pitch of the path, nose up."""
    turns: Ratio
    """Whole turns."""
    port: bool = False
    """Turns to port; else to starboard."""


class SawToothEntry(PathEntry):
    """A saw-tooth in depth."""

    leg: Metres
    """Length of the straight part of a tooth."""
    pitch: Radians
    """Pitch of the legs."""
    tip_radius: Metres
    """Radius of the tips."""
    legs: Ratio
    """How many."""


class DubinsEntry(PathEntry):
    """A Dubins path in three dimensions."""

    radius: Metres
    """Radius of the turns."""
    pitch: Radians
    """Steepest pitch."""
    pitch_radius: Metres
    """Radius of the changes of pitch."""
    first: PoseEntry
    """Pose at its start."""
    last: PoseEntry
    """Pose at its end."""


PATHS: dict[str, type[PathEntry]] = {
    "helix": HelixEntry,
    "saw_tooth": SawToothEntry,
    "dubins": DubinsEntry,
}


class WaitingEntry(Model):
    """Reference that waits; without it the reference keeps to the clock."""

    lead: PositiveMetres
    """Distance behind it at which the reference stands still."""
    catch_up: PositiveSeconds | None = None
    """Time in which a delay is made up; default never."""
    fastest: PositiveRatio = default(1.3, "1")
    """Most times its speed."""


class PoweredEntry(Model):
    """Second speed of a glide, on the propeller."""

    speed: PositiveSpeed
    """Speed on the propeller."""
    weights: str | None = None
    """Name of the weights; default those of the trajectory."""
    on_distance: Metres
    """Distance beside the path at which the propeller starts."""
    off_distance: Metres
    """Distance at which it stops."""
    on_force: Newtons
    """Estimated horizontal force at which it starts."""
    off_force: Newtons
    """Force at which it stops."""

    @model_validator(mode="after")
    def _stops_after_it_starts(self) -> PoweredEntry:
        off_m, off_N = self.off_distance.si, self.off_force.si
        if off_m > self.on_distance.si or off_N > self.on_force.si:
            value, words = (
                f"off {off_m:g} m, {off_N:g} N",
                "the propeller would stop before it starts",
            )
            raise Faults(fault(words, value=value, allowed="at most those of on"))
        return self


class ForceEntry(Model):
    """Force field in NED: constant + amplitude sin(rate t + phase), from start on."""

    constant: Forces = default([0.0, 0.0, 0.0], "N")
    """Three components."""
    amplitude: Forces = default([0.0, 0.0, 0.0], "N")
    """Three components."""
    rate: Annotated[Quantity, Unit("rad/s", (3,))] = default([0.0, 0.0, 0.0], "rad/s")
    """Three angular rates."""
    phase: Annotated[Quantity, Unit("rad", (3,))] = default([0.0, 0.0, 0.0], "rad")
    """Three phases."""
    start: Seconds = default(0.0, "s")
    """When it starts."""


class FlightEntry(Model):
    """One flight along a trajectory."""

    title: str
    """Heading."""
    observer: bool = False
    """Whether the observer's estimate is used."""
    clock: bool = False
    """Reference by the clock whatever the trajectory says."""
    force: ForceEntry = ForceEntry()
    """Force field in NED: constant + amplitude sin(rate t + phase), from start on."""
    current: Annotated[Quantity, Unit("m/s", (3,))] | None = None
    """Steady water current in NED."""
    redesign: bool = False
    """Whether the controllers designed on other models fly it too."""
    headline: bool = False
    """Whether the first screen of the report shows its errors."""


class TrajectoryEntry(Model):
    """A trajectory, its controller and its flights."""

    title: str
    """Heading."""
    kind: Literal["helix", "saw_tooth", "dubins"]
    """Shape of the path."""
    path: HelixEntry | SawToothEntry | DubinsEntry
    """Figures of the shape: a helix has radius, pitch, turns, port; a saw-tooth leg,
    pitch, tip_radius, legs; a Dubins path radius, pitch, pitch_radius, first, last.
    """
    speed: PositiveSpeed
    """Speed along the path."""
    step: PositiveSeconds
    """Time between two questions to the controller."""
    duration: PositiveSeconds | None = None
    """How long is flown; default to the end of the path."""
    weights: str
    """Name of the weights."""
    riccati: Literal["backward", "frozen"] = "backward"
    """Gains backward in time, or as if the vehicle stood still at each instant."""
    observer: Literal["kalman", "poles"] = "kalman"
    """A Kalman filter, or poles that are placed."""
    feed_forward: Literal["target", "pseudo_inverse"] = "target"
    """How the estimate is used: a target that holds the path, or inputs alone."""
    equilibrium: Literal["trimmed", "algorithm_1"] = "trimmed"
    """Trimmed in pitch and heading too, or as the thesis has it."""
    mass_change_over: PositiveRadians = default(0.2, "rad")
    """Epsilon of (3.11)."""
    transient: Seconds = default(10.0, "s")
    """What the error figures leave out at the start."""
    waiting: WaitingEntry | None = None
    """Reference that waits; without it the reference keeps to the clock."""
    powered: PoweredEntry | None = None
    """Second speed of a glide, on the propeller."""
    flights: dict[str, FlightEntry]
    """Name -> flight."""

    @field_validator("path", mode="wrap")
    @classmethod
    def _path_of_kind(
        cls, value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo
    ) -> Any:
        kind = PATHS.get(info.data.get("kind", ""))
        return value if kind is None else part_of_kind(kind, value)

    @model_validator(mode="after")
    def _can_be_flown(self) -> TrajectoryEntry:
        faults = []
        if not self.flights:
            remedy = "Give flights: {undisturbed: {title: Undisturbed}}."
            faults.append(fault("there is no flight", "flights", remedy=remedy))
        if self.powered is not None and self.waiting is None:
            words, remedy = (
                "a glide with a propeller needs a waiting reference",
                "Give waiting: {lead}.",
            )
            faults.append(fault(words, "waiting", remedy=remedy))
        Faults(*faults).raise_any()
        return self


class MonteCarloEntry(Model):
    """Flights with coefficients drawn at random.

    They are drawn from the covariance of the model card, or with a relative standard
    deviation.
    """

    trajectory: str
    """Name of a trajectory."""
    flight: str
    """Name of one of its flights."""
    duration: PositiveSeconds
    """How long is flown."""
    relative_sd: PositiveRatio = default(0.1, "1")
    """Relative standard deviation of every viscous coefficient where no card gives a
    covariance.
    """


class ControlCasesDocument(Model):
    """Flights of a control campaign: trajectories, weights, limits and disturbances.

    Each number is a quantity {value, unit, source} with its reason.
    """

    open_loop: dict[str, OpenLoopEntry] = Field(default_factory=dict)
    """Manoeuvres with constant inputs: name -> case."""
    linear: list[str] = Field(default_factory=list)
    """Open-loop cases along which the linear model is held against the nonlinear one.
    """
    parameter_set: ParameterSet = "as_simulated"
    """Coefficients of a hybrid vehicle."""
    redesign: list[ParameterSet] = Field(default_factory=list)
    """Parameter sets whose controllers fly the vehicle too, so that a wrong model
    shows.
    """
    limits: LimitsEntry
    """What the actuators and the path may."""
    weights: dict[str, WeightsEntry]
    """Name -> diagonals of Q (12), R (inputs), Q_Z (18), R_Z (12)."""
    trajectories: dict[str, TrajectoryEntry]
    """Name -> trajectory, its controller and its flights."""
    monte_carlo: MonteCarloEntry | None = None
    """Flights with coefficients drawn from the covariance of the model card, or with a
    relative standard deviation.
    """

    @model_validator(mode="after")
    def _names(self) -> ControlCasesDocument:
        Faults(*self._unknown_names()).raise_any()
        return self

    def _unknown_names(self) -> Iterator[PipelineError]:
        """Yield a fault for each name of something that the document does not have."""
        if not self.trajectories:
            yield fault("there is no trajectory to fly", "trajectories")
        for name, item in self.trajectories.items():
            at = f"trajectories.{name}"
            yield from _unknown(item.weights, self.weights, f"{at}.weights", "weights")
            if item.powered is not None and item.powered.weights is not None:
                own = item.powered.weights
                yield from _unknown(own, self.weights, f"{at}.powered.weights", "weights")
        for index, name in enumerate(self.linear):
            yield from _unknown(name, self.open_loop, f"linear[{index}]", "open-loop case")
        if self.monte_carlo is not None:
            pair = f"{self.monte_carlo.trajectory} / {self.monte_carlo.flight}"
            flights = {
                f"{name} / {flight}": item
                for name, item in self.trajectories.items()
                for flight in item.flights
            }
            yield from _unknown(pair, flights, "monte_carlo", "flight")


def _unknown(name: str, known: dict[str, Any], at: str, what: str) -> Iterator[PipelineError]:
    if name not in known:
        remedy = nearest(name, known)
        yield fault(f"no such {what}", at, name, allowed=tuple(known), remedy=remedy)
