"""What a control campaign flies."""

from __future__ import annotations

from typing import Literal

from auvid.data_schemas.documents.model import Model


class OpenLoopEntry(Model):
    """Open_loop."""

    title: str | None = None
    """Heading."""
    duration: dict[str, object] | None = None
    """How long is flown."""
    thrust: dict[str, object] | None = None
    """Default 0."""
    rudder: dict[str, object] | None = None
    """Default 0."""
    stern_right: dict[str, object] | None = None
    """Default 0."""
    stern_left: dict[str, object] | None = None
    """Default 0."""
    mass: dict[str, object] | None = None
    """Default neutral."""
    mass_swing: dict[str, object] | None = None
    """Amplitude of a sine about the mass."""
    mass_period: dict[str, object] | None = None
    """Period of that sine."""
    statements: dict[str, dict[str, object]] | None = None
    """Quantity -> {value, tolerance} of the text."""


class LimitsEntry(Model):
    """What the actuators and the path may."""

    fins: dict[str, object]
    """Largest deflection."""
    fin_rate: dict[str, object]
    """Fastest motion of a fin."""
    thrust_rate: dict[str, object] | None = None
    """Fastest change of thrust of a hybrid vehicle."""
    pitch: dict[str, object]
    """Steepest pitch that a trajectory may ask for."""


class WeightsEntry(Model):
    """Weights."""

    Q: dict[str, object]
    """Weights of u v w p q r x y z phi theta psi."""
    R: dict[str, object]
    """Weights of the inputs."""
    Q_Z: dict[str, object]
    """Process noise of the augmented state in the Kalman filter."""
    R_Z: dict[str, object]
    """Measurement noise in the Kalman filter."""


class PoseEntry(Model):
    """Pose at an end of a Dubins path."""

    position: dict[str, object] | None = None
    """NED."""
    heading: dict[str, object] | None = None
    """From north to east."""
    pitch: dict[str, object] | None = None
    """Nose up."""


class PathEntry(Model):
    """Figures of the shape: a helix has radius, pitch, turns, port; a saw-tooth leg,
    pitch, tip_radius, legs; a Dubins path the rest.
    """

    radius: dict[str, object] | None = None
    """Radius of the turns."""
    pitch: dict[str, object] | None = None
    """Pitch of the path, nose up; of a Dubins path the steepest."""
    turns: dict[str, object] | None = None
    """Whole turns of a helix."""
    port: bool | None = None
    """Turns to port; default to starboard."""
    leg: dict[str, object] | None = None
    """Length of the straight part of a tooth."""
    tip_radius: dict[str, object] | None = None
    """Radius of the tips."""
    legs: dict[str, object] | None = None
    """How many."""
    ramp: dict[str, object] | None = None
    """Length over which the curvature rises; default 0, it jumps."""
    start: dict[str, object] | None = None
    """First point, NED; default the origin."""
    heading: dict[str, object] | None = None
    """First heading; default 0."""
    pitch_radius: dict[str, object] | None = None
    """Radius of the changes of pitch of a Dubins path."""
    first: PoseEntry | None = None
    """Pose at an end of a Dubins path."""
    last: PoseEntry | None = None
    """Pose at an end of a Dubins path."""


class WaitingEntry(Model):
    """Reference that waits; without it the reference keeps to the clock."""

    lead: dict[str, object] | None = None
    """Distance behind it at which the reference stands still."""
    catch_up: dict[str, object] | None = None
    """Time in which a delay is made up; default never."""
    fastest: dict[str, object] | None = None
    """Most times its speed; default 1.3."""


class PoweredEntry(Model):
    """Second speed of a glide, on the propeller."""

    speed: dict[str, object] | None = None
    """Speed on the propeller."""
    weights: str | None = None
    """Name of the weights; default those of the trajectory."""
    on_distance: dict[str, object] | None = None
    """Distance beside the path at which the propeller starts."""
    off_distance: dict[str, object] | None = None
    """Distance at which it stops."""
    on_force: dict[str, object] | None = None
    """Estimated horizontal force at which it starts."""
    off_force: dict[str, object] | None = None
    """Force at which it stops."""


class ForceEntry(Model):
    """Force field in NED: constant + amplitude sin(rate t + phase), from start on."""

    constant: dict[str, object] | None = None
    """Three components."""
    amplitude: dict[str, object] | None = None
    """Three components."""
    rate: dict[str, object] | None = None
    """Three angular rates."""
    phase: dict[str, object] | None = None
    """Three phases."""
    start: dict[str, object] | None = None
    """When it starts; default 0."""


class FlightEntry(Model):
    """Flights."""

    title: str
    """Heading."""
    observer: bool | None = None
    """Whether the observer's estimate is used; default false."""
    clock: bool | None = None
    """Reference by the clock whatever the trajectory says; default false."""
    force: ForceEntry | None = None
    """Force field in NED: constant + amplitude sin(rate t + phase), from start on."""
    current: dict[str, object] | None = None
    """Steady water current in NED."""
    redesign: bool | None = None
    """Whether the controllers designed on other models fly it too; default false."""
    headline: bool | None = None
    """Whether the first screen of the report shows its errors."""


class TrajectoryEntry(Model):
    """Trajectories."""

    title: str
    """Heading."""
    kind: Literal["helix", "saw_tooth", "dubins"]
    """Shape of the path."""
    path: PathEntry
    """Figures of the shape: a helix has radius, pitch, turns, port; a saw-tooth leg,
    pitch, tip_radius, legs; a Dubins path the rest.
    """
    speed: dict[str, object]
    """Speed along the path."""
    step: dict[str, object]
    """Time between two questions to the controller."""
    duration: dict[str, object] | None = None
    """How long is flown; default to the end of the path."""
    weights: str
    """Name of the weights."""
    riccati: Literal["backward", "frozen"] | None = None
    """Default backward."""
    observer: Literal["kalman", "poles"] | None = None
    """Default kalman."""
    feed_forward: Literal["target", "pseudo_inverse"] | None = None
    """Default target."""
    equilibrium: Literal["trimmed", "algorithm_1"] | None = None
    """Default trimmed."""
    mass_change_over: dict[str, object] | None = None
    """Epsilon of (3.11); default 0.2 rad."""
    transient: dict[str, object] | None = None
    """What the error figures leave out at the start; default 10 s."""
    waiting: WaitingEntry | None = None
    """Reference that waits; without it the reference keeps to the clock."""
    powered: PoweredEntry | None = None
    """Second speed of a glide, on the propeller."""
    flights: dict[str, FlightEntry]
    """Name -> flight."""


class MonteCarloEntry(Model):
    """Flights with coefficients drawn from the covariance of the model card, or with a
    relative standard deviation.
    """

    trajectory: str
    """Name of a trajectory."""
    flight: str
    """Name of one of its flights."""
    duration: dict[str, object]
    """How long is flown."""
    relative_sd: dict[str, object] | None = None
    """Relative standard deviation of every viscous coefficient where no card gives a
    covariance.
    """


class ControlCasesDocument(Model):
    """What a control campaign flies; trajectories, weights, limits and disturbances,
    each number a quantity {value, unit, source} with its reason.
    """

    open_loop: dict[str, OpenLoopEntry] | None = None
    """Manoeuvres with constant inputs: name -> case."""
    linear: list[str] | None = None
    """Open-loop cases along which the linear model is held against the nonlinear one.
    """
    parameter_set: Literal["as_printed", "as_simulated", "corrected"] | None = None
    """Coefficients of a hybrid vehicle; default as_simulated."""
    redesign: list[str] | None = None
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
