"""What a twin flies, and what its sensors measure."""

from __future__ import annotations

from typing import Annotated, Literal

from auvid.data_schemas.documents.model import Model, Range


class UnsteadyEntry(Model):
    """First-order Gauss-Markov force on the body, as given at 2 m/s.

    It grows with the square of the level speed.
    """

    force_sd_N: list[Annotated[float, Range(0)]]
    """Standard deviation of X, Y, Z."""
    moment_sd_N_m: list[Annotated[float, Range(0)]]
    """Standard deviation of K, M, N."""
    correlation_s: Annotated[float, Range(0.001, 100)]
    """Correlation time."""


class FinLimitsEntry(Model):
    """Limits of the fins."""

    limit_deg: Annotated[float, Range(1, 60)] | None = None
    """Largest deflection; default 25."""
    rate_deg_s: Annotated[float, Range(1, 1000)] | None = None
    """Fastest motion; default 60."""


class AhrsEntry(Model):
    """Attitude, gyro and accelerometer."""

    rate_hz: Annotated[float, Range(1, 1000)] | None = None
    """Rate; default 50."""
    attitude_sd_deg: Annotated[float, Range(0)] | None = None
    """Standard deviation of the attitude error."""
    attitude_correlation_s: Annotated[float, Range(0)] | None = None
    """Correlation time of the attitude error; default 5."""
    gyro_sd_rad_s: Annotated[float, Range(0)] | None = None
    """Noise of the gyro per sample."""
    gyro_bias_sd_rad_s: Annotated[float, Range(0)] | None = None
    """Standard deviation of the gyro bias between logs."""
    accel_sd_m_s2: Annotated[float, Range(0)] | None = None
    """Noise of the accelerometer per sample."""
    accel_bias_sd_m_s2: Annotated[float, Range(0)] | None = None
    """Standard deviation of the accelerometer bias between logs."""


class DvlEntry(Model):
    """Velocity log."""

    rate_hz: Annotated[float, Range(0.1, 100)] | None = None
    """Rate; default 4."""
    sd_m_s: Annotated[float, Range(0)] | None = None
    """Noise per sample."""
    arm_error_m: list[float] | None = None
    """How far it sits from where the vehicle file says."""
    mounting_error_deg: list[float] | None = None
    """Roll, pitch, yaw by which it is turned against the vehicle file."""


class DepthEntry(Model):
    """Pressure sensor."""

    rate_hz: Annotated[float, Range(0.1, 1000)] | None = None
    """Rate; default 10."""
    sd_m: Annotated[float, Range(0)] | None = None
    """Noise per sample."""


class ActuatorLogEntry(Model):
    """What the autopilot logs of propeller and fins."""

    rate_hz: Annotated[float, Range(1, 1000)] | None = None
    """Rate; default 50."""


class PlanSensorsEntry(Model):
    """Rates and noise of the sensors; what is not given is exact."""

    ahrs: AhrsEntry | None = None
    """Attitude, gyro and accelerometer."""
    dvl: DvlEntry | None = None
    """Velocity log."""
    depth: DepthEntry | None = None
    """Pressure sensor."""
    actuators: ActuatorLogEntry | None = None
    """What the autopilot logs of propeller and fins."""


class YawStepsEntry(Model):
    """Heading commands: from times_s on, the angle values_deg times yaw_scale."""

    times_s: list[Annotated[float, Range(0)]]
    """Seconds from the start of the leg."""
    values_deg: list[float]
    """Heading against that of the start."""


class DepthStepsEntry(Model):
    """Depth commands: from times_s on, depth_m plus values_m times depth_scale."""

    times_s: list[Annotated[float, Range(0)]]
    """Seconds from the start of the leg."""
    values_m: list[float]
    """Depth against depth_m."""


class FlownLegEntry(Model):
    """A leg that a twin flies: one log."""

    id: str
    """Short name of leg and log."""
    rpm: float
    """Propeller speed in revolutions per minute."""
    manoeuvre: Literal["yaw_steps", "depth_steps", "straight"]
    """What the autopilot is told."""
    duration_s: float
    """Length of the leg."""
    use: Literal["training", "validation"]
    """Fit or judge."""


class PixhawkEntry(AhrsEntry):
    """Autopilot on pole or tray, at rates and noise of its own.

    A figure that is not given is exact.
    """

    arm_m: Annotated[float, Range(0)] | None = None
    """How far below the pivot it sits on the pole; default 1."""
    mounting_deg: list[float] | None = None
    """Roll, pitch, yaw by which it is turned against pole or tray."""


class CommandStepsEntry(Model):
    """Commands of one channel of a tank run."""

    times_s: list[Annotated[float, Range(0)]]
    """Seconds from the start of the leg."""
    values_percent: list[Annotated[float, Range(-100, 100)]]
    """Command from then on."""


class ExperimentEntry(Model):
    """An experiment of a bench campaign: one log and one leg."""

    id: str
    """Short name of leg and log."""
    duration_s: Annotated[float, Range(1, 3600)]
    """Length of the leg."""
    use: Literal["training", "validation"] | None = None
    """Fit or judge; default training."""
    noise: Annotated[float, Range(0)] | None = None
    """Factor on the noise of its sensors; 0 is exact; default 1."""


class TankRunEntry(ExperimentEntry):
    """A run in which one channel is driven from rest."""

    channel: Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]
    """What is identified from it."""
    truth: str
    """Name of its truth."""
    commands: dict[str, CommandStepsEntry]
    """Channel -> steps; pitch is driven through surge and heave."""


class DecayFlightEntry(ExperimentEntry):
    """A free decay of the pendulum in water of the apparatus."""

    decay: str
    """Id of the decay in the apparatus."""
    truth: str
    """Name of its truth; with pole_added_mass, pole_linear, pole_quadratic of the
    pendulum itself at the arm.
    """
    angle_deg: Annotated[float, Range(-90, 90)]
    """Angle at the release."""


class SwingFlightEntry(ExperimentEntry):
    """A swing of the quadrifilar pendulum of the apparatus."""

    swing: str
    """Id of the swing in the apparatus."""
    inertia_kg_m2: Annotated[float, Range(0)]
    """True inertia about the vertical of the tray with all that lies on it."""
    damping_N_m_s: Annotated[float, Range(0)] | None = None
    """Moment of the air per rad/s; default 0."""
    angle_deg: Annotated[float, Range(-60, 60)]
    """Angle at the release."""


class BenchEntry(Model):
    """Experiments of a bench campaign, each one log and one leg.

    The sensors above record the tank runs.
    """

    truths: dict[str, dict[str, float]]
    """Name -> numbers in SI that replace those of the vehicle: mass, I_x, X_udot, X_u,
    X_u|u| ... N_r|r|; damping that is not given is 0.
    """
    keep_z_G: bool | None = None
    """Whether the inertia terms with z_G that (26) drops are flown; default no."""
    pixhawk: PixhawkEntry | None = None
    """Autopilot on pole or tray, at rates and noise of its own; what is not given is
    exact.
    """
    tank: list[TankRunEntry] | None = None
    """Runs in which one channel is driven from rest."""
    decays: list[DecayFlightEntry] | None = None
    """Free decays of the pendulum in water of the apparatus; released at rest."""
    swings: list[SwingFlightEntry] | None = None
    """Swings of the quadrifilar pendulum of the apparatus; released at rest."""


class PlanDocument(Model):
    """What a twin flies, and with which sensors it is watched."""

    title: str
    """One line for the report."""
    notes: str | None = None
    """Where the numbers come from."""
    depth_m: Annotated[float, Range(0)] | None = None
    """Depth that the vehicle holds between steps; default 5."""
    yaw_scale: float | None = None
    """Factor on the angles of all yaw steps; default 1."""
    depth_scale: float | None = None
    """Factor on all depth steps; default 1."""
    settle_s: Annotated[float, Range(1, 600)] | None = None
    """Running at the leg's propeller speed before each leg; default 40."""
    margin_s: Annotated[float, Range(0, 60)] | None = None
    """What the log holds before and after the leg; default 2."""
    step_s: Annotated[float, Range(0.0001, 0.02)] | None = None
    """Largest step of Runge-Kutta; default 0.01."""
    control_hz: Annotated[float, Range(10, 500)] | None = None
    """Rate of the autopilot; default 50."""
    viscous_lag_s: Annotated[float, Range(0, 10)] | None = None
    """Time constant by which the viscous force follows the motion; default 0."""
    unsteady: UnsteadyEntry | None = None
    """First-order Gauss-Markov force on the body, as given at 2 m/s; it grows with the
    square of the level speed.
    """
    fins: FinLimitsEntry | None = None
    """Limits of the fins."""
    sensors: PlanSensorsEntry | None = None
    """Rates and noise of the sensors; what is not given is exact."""
    yaw_steps: YawStepsEntry | None = None
    """Heading commands: from times_s on, the angle values_deg times yaw_scale."""
    depth_steps: DepthStepsEntry | None = None
    """Depth commands: from times_s on, depth_m plus values_m times depth_scale."""
    legs: list[FlownLegEntry] | None = None
    """The legs, each one log; every plan has them but one with `bench`."""
    bench: BenchEntry | None = None
    """Experiments of a bench campaign, each one log and one leg; the sensors above
    record the tank runs.
    """
