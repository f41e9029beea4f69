"""What a control campaign flies."""

from __future__ import annotations

from typing import Any, Literal

from auvid.data_schemas.documents.model import Model


class OpenLoopEntry(Model):
    """Open_loop."""

    title: str | None = None
    """Heading."""
    duration: dict[str, Any] | None = None
    """How long is flown."""
    thrust: dict[str, Any] | None = None
    """Default 0."""
    rudder: dict[str, Any] | None = None
    """Default 0."""
    stern_right: dict[str, Any] | None = None
    """Default 0."""
    stern_left: dict[str, Any] | None = None
    """Default 0."""
    mass: dict[str, Any] | None = None
    """Default neutral."""
    mass_swing: dict[str, Any] | None = None
    """Amplitude of a sine about the mass."""
    mass_period: dict[str, Any] | None = None
    """Period of that sine."""
    statements: dict[str, dict[str, Any]] | None = None
    """Quantity -> {value, tolerance} of the text."""


class LimitsEntry(Model):
    """What the actuators and the path may."""

    fins: dict[str, Any]
    """Largest deflection."""
    fin_rate: dict[str, Any]
    """Fastest motion of a fin."""
    thrust_rate: dict[str, Any] | None = None
    """Fastest change of thrust of a hybrid vehicle."""
    pitch: dict[str, Any]
    """Steepest pitch that a trajectory may ask for."""


class WeightsEntry(Model):
    """Weights."""

    Q: dict[str, Any]
    """Weights of u v w p q r x y z phi theta psi."""
    R: dict[str, Any]
    """Weights of the inputs."""
    Q_Z: dict[str, Any]
    """Process noise of the augmented state in the Kalman filter."""
    R_Z: dict[str, Any]
    """Measurement noise in the Kalman filter."""


class PoseEntry(Model):
    """Pose at an end of a Dubins path."""

    position: dict[str, Any] | None = None
    """NED."""
    heading: dict[str, Any] | None = None
    """From north to east."""
    pitch: dict[str, Any] | None = None
    """Nose up."""


class PathEntry(Model):
    """Figures of the shape: a helix has radius, pitch, turns, port; a saw-tooth leg,
    pitch, tip_radius, legs; a Dubins path the rest.
    """

    radius: dict[str, Any] | None = None
    """Radius of the turns."""
    pitch: dict[str, Any] | None = None
    """Pitch of the path, nose up; of a Dubins path the steepest."""
    turns: dict[str, Any] | None = None
    """Whole turns of a helix."""
    port: bool | None = None
    """Turns to port; default to starboard."""
    leg: dict[str, Any] | None = None
    """Length of the straight part of a tooth."""
    tip_radius: dict[str, Any] | None = None
    """Radius of the tips."""
    legs: dict[str, Any] | None = None
    """How many."""
    ramp: dict[str, Any] | None = None
    """Length over which the curvature rises; default 0, it jumps."""
    start: dict[str, Any] | None = None
    """First point, NED; default the origin."""
    heading: dict[str, Any] | None = None
    """First heading; default 0."""
    pitch_radius: dict[str, Any] | None = None
    """Radius of the changes of pitch of a Dubins path."""
    first: PoseEntry | None = None
    """Pose at an end of a Dubins path."""
    last: PoseEntry | None = None
    """Pose at an end of a Dubins path."""


class WaitingEntry(Model):
    """Reference that waits; without it the reference keeps to the clock."""

    lead: dict[str, Any] | None = None
    """Distance behind it at which the reference stands still."""
    catch_up: dict[str, Any] | None = None
    """Time in which a delay is made up; default never."""
    fastest: dict[str, Any] | None = None
    """Most times its speed; default 1.3."""


class PoweredEntry(Model):
    """Second speed of a glide, on the propeller."""

    speed: dict[str, Any] | None = None
    """Speed on the propeller."""
    weights: str | None = None
    """Name of the weights; default those of the trajectory."""
    on_distance: dict[str, Any] | None = None
    """Distance beside the path at which the propeller starts."""
    off_distance: dict[str, Any] | None = None
    """Distance at which it stops."""
    on_force: dict[str, Any] | None = None
    """Estimated horizontal force at which it starts."""
    off_force: dict[str, Any] | None = None
    """Force at which it stops."""


class ForceEntry(Model):
    """Force field in NED: constant + amplitude sin(rate t + phase), from start on."""

    constant: dict[str, Any] | None = None
    """Three components."""
    amplitude: dict[str, Any] | None = None
    """Three components."""
    rate: dict[str, Any] | None = None
    """Three angular rates."""
    phase: dict[str, Any] | None = None
    """Three phases."""
    start: dict[str, Any] | None = None
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
    current: dict[str, Any] | None = None
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
    speed: dict[str, Any]
    """Speed along the path."""
    step: dict[str, Any]
    """Time between two questions to the controller."""
    duration: dict[str, Any] | None = None
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
    mass_change_over: dict[str, Any] | None = None
    """Epsilon of (3.11); default 0.2 rad."""
    transient: dict[str, Any] | None = None
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
    duration: dict[str, Any]
    """How long is flown."""
    relative_sd: dict[str, Any] | None = None
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
