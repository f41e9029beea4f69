"""What the twin of an ROV dives, and what its sensors measure."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from auvid.data_schemas.documents.model import Faults, Model, Range, fault
from auvid.data_schemas.documents.plans.plan import (
    Name,
    NotNegative,
    NotNegativeTriple,
    Triple,
    in_order,
    repeated_names,
)


class StickEntry(Model):
    """How the pilot moves one stick, -1 to 1; right, down and forward are positive."""

    kind: Literal["random", "multisine", "steps"]
    """Held values drawn by the seed, sines with phases drawn by the seed, or values."""
    amplitude: Annotated[float, Range(0, 1)] = 0.5
    """Largest value (random, multisine)."""
    mean: Annotated[float, Range(-1, 1)] = 0.0
    """Added to it."""
    hold_s: Annotated[float, Range(0.1, 600)] = 3.0
    """Mean time between changes (random)."""
    lowest_hz: Annotated[float, Range(0.001, 10)] = 0.05
    """Lowest frequency (multisine)."""
    highest_hz: Annotated[float, Range(0.001, 10)] = 0.5
    """Highest frequency (multisine)."""
    tones: Annotated[int, Range(1, 100)] = 8
    """Sines, spread evenly over the logarithm of frequency (multisine)."""
    times_s: list[NotNegative] = Field(default_factory=list)
    """Seconds from the start of the leg (steps)."""
    values: list[Annotated[float, Range(-1, 1)]] = Field(default_factory=list)
    """Value from then on (steps)."""

    @model_validator(mode="after")
    def _steps(self) -> StickEntry:
        if self.kind == "steps":
            in_order("values", self.times_s, self.values)
        elif self.times_s or self.values:
            raise Faults(fault("times and values belong to a stick of kind steps", "times_s"))
        if self.highest_hz < self.lowest_hz:
            allowed = f"at least {self.lowest_hz:g} Hz"
            raise Faults(
                fault("not above lowest_hz", "highest_hz", self.highest_hz, allowed=allowed)
            )
        return self


class SticksEntry(Model):
    """How the pilot moves the sticks; those that are not named stay in the middle."""

    roll: StickEntry | None = None
    """Lean to starboard."""
    pitch: StickEntry | None = None
    """Nose up."""
    heave: StickEntry | None = None
    """Down."""
    yaw: StickEntry | None = None
    """Turn to starboard."""
    forward: StickEntry | None = None
    """Ahead."""
    lateral: StickEntry | None = None
    """To starboard."""


class ModeChangeEntry(Model):
    """A mode of the autopilot, from a time on."""

    at_s: NotNegative
    """Seconds from the start of the leg."""
    mode: Literal["manual", "stabilize", "alt_hold", "poshold", "guided"]
    """As in ArduSub; stabilize holds the attitude, alt_hold also the depth."""


class RouteEntry(Model):
    """Goals of mode guided, from times_s on; the point asked for moves towards them."""

    times_s: list[NotNegative]
    """Seconds from the start of the leg."""
    north_m: list[float]
    """North of the start of the dive."""
    east_m: list[float]
    """East of the start of the dive."""
    deeper_m: list[float] | None = None
    """Against depth_m; default 0."""
    heading_deg: list[float] | None = None
    """Against that of the start; default 0."""
    speed_m_s: Annotated[float, Range(0.01, 2)] = 0.25
    """Speed of the point asked for."""
    turn_deg_s: Annotated[float, Range(0.1, 90)] = 15.0
    """How fast the heading asked for turns."""

    @model_validator(mode="after")
    def _fits(self) -> RouteEntry:
        for name in ("north_m", "east_m", "deeper_m", "heading_deg"):
            values = getattr(self, name)
            if values is not None:
                in_order(name, self.times_s, values)
        return self


class DiveLegEntry(Model):
    """One leg of a dive, flown and logged for itself."""

    id: Name
    """Short name of leg and log: letters, digits, _ and -."""
    duration_s: Annotated[float, Range(1, 7200)]
    """Length of the leg."""
    use: Literal["training", "validation"]
    """Fit or judge."""
    modes: Annotated[list[ModeChangeEntry], Field(min_length=1)]
    """Modes; the first holds from before the leg."""
    sticks: SticksEntry = SticksEntry()
    """How the pilot moves the sticks; those that are not named stay in the middle."""
    route: RouteEntry | None = None
    """Goals of mode guided."""

    @model_validator(mode="after")
    def _guided(self) -> DiveLegEntry:
        if self.route is None and any(item.mode == "guided" for item in self.modes):
            raise Faults(fault("mode guided needs a route", "route"))
        return self


class RovUnsteadyEntry(Model):
    """First-order Gauss-Markov force on the body, of constant size."""

    force_sd_N: NotNegativeTriple
    """Standard deviation of X, Y, Z."""
    moment_sd_N_m: NotNegativeTriple
    """Standard deviation of K, M, N."""
    correlation_s: Annotated[float, Range(0.001, 100)]
    """Correlation time."""


class WaterEntry(Model):
    """What the water does besides."""

    current_m_s: Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Steady current, NED."""
    unsteady: RovUnsteadyEntry | None = None
    """Force that no model explains."""


class TetherEntry(Model):
    """Tether from an anchor at the surface."""

    length_m: Annotated[float, Range(0.1, 1000)] = 25.0
    """Paid out; beyond it the tether pulls."""
    anchor_m: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(
        default_factory=lambda: [0.0, 0.0]
    )
    """North and east of the start of the dive."""
    carried: Annotated[float, Range(0, 1)] = 0.3
    """Share of the hanging length that moves with the vehicle and drags."""


class RovBodyEntry(Model):
    """What of the physical truth a plan may choose."""

    net_buoyancy_N: float = 3.0
    """Lift at rest."""
    thrust_lag_s: Annotated[float, Range(0, 2)] = 0.1
    """Time constant of the thrust; 0 for none. Also in a truth that is a model."""
    tether: TetherEntry | None = Field(default_factory=TetherEntry)
    """Null for none."""


class ImuSensorEntry(Model):
    """Gyro and accelerometer."""

    rate_hz: Annotated[float, Range(1, 1000)] = 25.0
    """Rate."""
    gyro_sd_rad_s: NotNegative = 0.0
    """Noise of the gyro per sample."""
    gyro_bias_sd_rad_s: NotNegative = 0.0
    """Standard deviation of the gyro bias between logs."""
    accel_sd_m_s2: NotNegative = 0.0
    """Noise of the accelerometer per sample."""
    accel_bias_sd_m_s2: NotNegative = 0.0
    """Standard deviation of the accelerometer bias between logs."""


class AttitudeSensorEntry(Model):
    """Attitude of the autopilot's filter; the autopilot steers by it."""

    rate_hz: Annotated[float, Range(1, 1000)] = 10.0
    """Rate."""
    tilt_sd_deg: NotNegative = 0.0
    """Standard deviation of the error of roll and pitch."""
    heading_sd_deg: NotNegative = 0.0
    """Standard deviation of the error of heading."""
    correlation_s: Annotated[float, Range(0.01, 10000)] = 30.0
    """Correlation time of the errors."""


class VelocityLogEntry(Model):
    """Velocity log, reported as displacements (VISO)."""

    rate_hz: Annotated[float, Range(0.1, 100)] = 9.2
    """Rate of its pings."""
    sd_m_s: NotNegative = 0.0
    """Noise per ping."""
    slow_share: Annotated[float, Range(0, 0.9)] = 0.0
    """Share of pings that take 1.8 times as long."""
    lost_share: Annotated[float, Range(0, 0.9)] = 0.0
    """Share of pings without a report."""
    held_share: Annotated[float, Range(0, 0.9)] = 0.0
    """Share of reports that repeat the velocity before."""
    jitter_s: Annotated[float, Range(0, 0.05)] = 0.0
    """Standard deviation of the time of arrival."""
    late_s: Annotated[float, Range(-0.5, 0.5)] = 0.0
    """How much later it reports than the vehicle file says."""
    arm_error_m: Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """How far it sits from where the vehicle file says."""
    mounting_error_deg: Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Roll, pitch, yaw by which it is turned against the vehicle file."""


class BarometerEntry(Model):
    """Pressure sensor in the water."""

    rate_hz: Annotated[float, Range(0.1, 1000)] = 10.0
    """Rate."""
    sd_m: NotNegative = 0.0
    """Noise per sample."""
    late_s: Annotated[float, Range(-0.5, 1)] = 0.0
    """How much later it reports than the vehicle file says."""
    step_m: NotNegative = 0.0
    """Resolution; 0 for none."""


class RateEntry(Model):
    """What the autopilot logs of itself."""

    rate_hz: Annotated[float, Range(1, 1000)] = 10.0
    """Rate."""


class BatterySensorEntry(Model):
    """Voltage and current of the battery."""

    rate_hz: Annotated[float, Range(0.1, 1000)] = 10.0
    """Rate."""
    sd_V: NotNegative = 0.0
    """Noise per sample."""


class DiveSensorsEntry(Model):
    """Rates and noise of the sensors; what is not given is exact."""

    imu: ImuSensorEntry = ImuSensorEntry()
    """Gyro and accelerometer."""
    attitude: AttitudeSensorEntry = AttitudeSensorEntry()
    """Attitude of the autopilot's filter; the autopilot steers by it."""
    dvl: VelocityLogEntry = VelocityLogEntry()
    """Velocity log."""
    depth: BarometerEntry = BarometerEntry()
    """Pressure sensor in the water."""
    outputs: RateEntry = RateEntry()
    """Pulses."""
    battery: BatterySensorEntry = BatterySensorEntry()
    """Voltage and current of the battery."""


class DivePlanDocument(Model):
    """What the twin of an ROV dives, and with which sensors it is watched."""

    kind: Literal["dives"]
    """Tells this plan from that of a twin with a propeller."""
    title: str
    """One line for the report."""
    notes: str | None = None
    """Where the numbers come from."""
    depth_m: Annotated[float, Range(0.5, 1000)] = 8.0
    """Depth at the start."""
    heading_deg: float = 0.0
    """Heading at the start."""
    settle_s: Annotated[float, Range(1, 600)] = 15.0
    """Diving in the first mode before each leg."""
    margin_s: Annotated[float, Range(0, 60)] = 2.0
    """What the log holds before and after the leg."""
    step_s: Annotated[float, Range(0.0001, 0.02)] = 0.01
    """Largest step of Runge-Kutta."""
    control_hz: Annotated[float, Range(10, 500)] = 50.0
    """Rate of the autopilot."""
    body: RovBodyEntry = RovBodyEntry()
    """What of the physical truth a plan may choose."""
    water: WaterEntry = WaterEntry()
    """What the water does besides."""
    sensors: DiveSensorsEntry = DiveSensorsEntry()
    """Rates and noise of the sensors; what is not given is exact."""
    legs: Annotated[list[DiveLegEntry], Field(min_length=1)]
    """The legs, each one log."""

    @model_validator(mode="after")
    def _legs(self) -> DivePlanDocument:
        Faults(
            *repeated_names([(f"legs[{index}]", leg.id) for index, leg in enumerate(self.legs)])
        ).raise_any()
        if self.margin_s > self.settle_s:
            message = "the log would begin before the vehicle does"
            raise Faults(fault(message, "margin_s", self.margin_s, allowed="at most settle_s"))
        for index, leg in enumerate(self.legs):
            deeper = leg.route.deeper_m if leg.route is not None else None
            if deeper and self.depth_m + min(deeper) <= 0.0:
                raise Faults(
                    fault("a goal lies above the surface", f"legs[{index}].route.deeper_m")
                )
        return self
