"""What a twin flies, and what its sensors measure."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from auvid.data_schemas.documents.model import Faults, Model, Range, fault
from auvid.data_schemas.errors import PipelineError, nearest

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,99}")
DRIVEN = {"pitch": {"surge", "heave"}}
"""Which channels are commanded to excite one; those that are not here by themselves."""


def _three(values: list[float]) -> list[float]:
    if len(values) != 3:
        raise Faults(fault("three numbers are needed", value=values))
    return values


def _name(text: str) -> str:
    if not NAME.fullmatch(text):
        allowed = "letters, digits, _ and -, at most 100, not starting with -"
        raise Faults(fault("not a name", value=text, allowed=allowed))
    return text


NotNegative = Annotated[float, Range(0)]
Triple = Annotated[list[float], AfterValidator(_three)]
NotNegativeTriple = Annotated[list[NotNegative], AfterValidator(_three)]
Name = Annotated[str, AfterValidator(_name)]
Channel = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]


def in_order(name: str, times_s: list[float], values: list[float]) -> None:
    """Raise unless the times ascend, and there are as many values, one or more."""
    if len(times_s) != len(values) or not times_s:
        words, allowed = "as many times as values are needed", f"{len(values)}, as {name} has"
        raise Faults(fault(words, "times_s", len(times_s), allowed=allowed))
    if any(late <= early for early, late in itertools.pairwise(times_s)):
        raise Faults(fault("the times do not increase", "times_s", times_s))


def repeated_names(places: list[tuple[str, str]]) -> Iterator[PipelineError]:
    """Yield a fault for each (place, name) whose name stood before, in any case."""
    before: set[str] = set()
    for place, name in places:
        if name.lower() in before:
            yield fault("not a name of its own", f"{place}.id", name, allowed="each name once")
        before.add(name.lower())


class UnsteadyEntry(Model):
    """First-order Gauss-Markov force on the body, as given at 2 m/s.

    It grows with the square of the level speed.
    """

    force_sd_N: NotNegativeTriple
    """Standard deviation of X, Y, Z."""
    moment_sd_N_m: NotNegativeTriple
    """Standard deviation of K, M, N."""
    correlation_s: Annotated[float, Range(0.001, 100)]
    """Correlation time."""


class FinLimitsEntry(Model):
    """Limits of the fins."""

    limit_deg: Annotated[float, Range(1, 60)] = 25.0
    """Largest deflection."""
    rate_deg_s: Annotated[float, Range(1, 1000)] = 60.0
    """Fastest motion."""


class AhrsEntry(Model):
    """Attitude, gyro and accelerometer."""

    rate_hz: Annotated[float, Range(1, 1000)] = 50.0
    """Rate."""
    attitude_sd_deg: NotNegative = 0.0
    """Standard deviation of the attitude error."""
    attitude_correlation_s: NotNegative = 5.0
    """Correlation time of the attitude error."""
    gyro_sd_rad_s: NotNegative = 0.0
    """Noise of the gyro per sample."""
    gyro_bias_sd_rad_s: NotNegative = 0.0
    """Standard deviation of the gyro bias between logs."""
    accel_sd_m_s2: NotNegative = 0.0
    """Noise of the accelerometer per sample."""
    accel_bias_sd_m_s2: NotNegative = 0.0
    """Standard deviation of the accelerometer bias between logs."""


class DvlEntry(Model):
    """Velocity log."""

    rate_hz: Annotated[float, Range(0.1, 100)] = 4.0
    """Rate."""
    sd_m_s: NotNegative = 0.0
    """Noise per sample."""
    arm_error_m: Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """How far it sits from where the vehicle file says."""
    mounting_error_deg: Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Roll, pitch, yaw by which it is turned against the vehicle file."""


class DepthEntry(Model):
    """Pressure sensor."""

    rate_hz: Annotated[float, Range(0.1, 1000)] = 10.0
    """Rate."""
    sd_m: NotNegative = 0.0
    """Noise per sample."""


class ActuatorLogEntry(Model):
    """What the autopilot logs of propeller and fins."""

    rate_hz: Annotated[float, Range(1, 1000)] = 50.0
    """Rate."""


class PlanSensorsEntry(Model):
    """Rates and noise of the sensors; what is not given is exact."""

    ahrs: AhrsEntry = AhrsEntry()
    """Attitude, gyro and accelerometer."""
    dvl: DvlEntry = DvlEntry()
    """Velocity log."""
    depth: DepthEntry = DepthEntry()
    """Pressure sensor."""
    actuators: ActuatorLogEntry = ActuatorLogEntry()
    """What the autopilot logs of propeller and fins."""


class YawStepsEntry(Model):
    """Heading commands: from times_s on, the angle values_deg times yaw_scale."""

    times_s: list[NotNegative]
    """Seconds from the start of the leg."""
    values_deg: list[float]
    """Heading against that of the start."""

    @model_validator(mode="after")
    def _ordered(self) -> YawStepsEntry:
        in_order("values_deg", self.times_s, self.values_deg)
        return self


class DepthStepsEntry(Model):
    """Depth commands: from times_s on, depth_m plus values_m times depth_scale."""

    times_s: list[NotNegative]
    """Seconds from the start of the leg."""
    values_m: list[float]
    """Depth against depth_m."""

    @model_validator(mode="after")
    def _ordered(self) -> DepthStepsEntry:
        in_order("values_m", self.times_s, self.values_m)
        return self


class FlownLegEntry(Model):
    """A leg that a twin flies: one log."""

    id: Name
    """Short name of leg and log."""
    rpm: Annotated[float, Range(1)]
    """Propeller speed in revolutions per minute."""
    manoeuvre: Literal["yaw_steps", "depth_steps", "straight"]
    """What the autopilot is told."""
    duration_s: Annotated[float, Range(1, 7200)]
    """Length of the leg; its flight is held in memory."""
    use: Literal["training", "validation"]
    """Fit or judge."""


class PixhawkEntry(AhrsEntry):
    """Autopilot on pole or tray, at rates and noise of its own.

    A figure that is not given is exact.
    """

    arm_m: NotNegative = 1.0
    """How far below the pivot it sits on the pole."""
    mounting_deg: Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Roll, pitch, yaw by which it is turned against pole or tray."""


class CommandStepsEntry(Model):
    """Commands of one channel of a tank run."""

    times_s: list[NotNegative]
    """Seconds from the start of the leg."""
    values_percent: list[Annotated[float, Range(-100, 100)]]
    """Command from then on."""

    @model_validator(mode="after")
    def _ordered(self) -> CommandStepsEntry:
        in_order("values_percent", self.times_s, self.values_percent)
        return self


class ExperimentEntry(Model):
    """An experiment of a bench campaign: one log and one leg."""

    id: Name
    """Short name of leg and log."""
    duration_s: Annotated[float, Range(1, 3600)]
    """Length of the leg."""
    use: Literal["training", "validation"] = "training"
    """Fit or judge."""
    noise: NotNegative = 1.0
    """Factor on the noise of its sensors; 0 is exact."""


class TankRunEntry(ExperimentEntry):
    """A run in which one channel is driven from rest."""

    channel: Channel
    """What is identified from it."""
    truth: str
    """Name of its truth."""
    commands: dict[str, CommandStepsEntry]
    """Channel -> steps; pitch is driven through surge and heave."""

    @model_validator(mode="after")
    def _drives_its_channel(self) -> TankRunEntry:
        driven = DRIVEN.get(self.channel, {self.channel})
        if set(self.commands) != driven:
            words = "the channel is not driven by these commands"
            raise Faults(fault(words, "commands", sorted(self.commands), allowed=sorted(driven)))
        Faults(
            *(
                fault(
                    "the times do not increase within the leg",
                    f"commands.{channel}.times_s",
                    steps.times_s,
                )
                for channel, steps in self.commands.items()
                if steps.times_s[-1] >= self.duration_s
            )
        ).raise_any()
        return self


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
    damping_N_m_s: NotNegative = 0.0
    """Moment of the air per rad/s."""
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
    keep_z_G: bool = False
    """Whether the inertia terms with z_G that (26) drops are flown."""
    pixhawk: PixhawkEntry = PixhawkEntry()
    """Autopilot on pole or tray, at rates and noise of its own; what is not given is
    exact.
    """
    tank: list[TankRunEntry] = Field(default_factory=list)
    """Runs in which one channel is driven from rest."""
    decays: list[DecayFlightEntry] = Field(default_factory=list)
    """Free decays of the pendulum in water of the apparatus; released at rest."""
    swings: list[SwingFlightEntry] = Field(default_factory=list)
    """Swings of the quadrifilar pendulum of the apparatus; released at rest."""

    @property
    def experiments(self) -> list[TankRunEntry | DecayFlightEntry | SwingFlightEntry]:
        """Return all runs, in the order of the logs."""
        return [*self.tank, *self.decays, *self.swings]

    @model_validator(mode="after")
    def _fits(self) -> BenchEntry:
        faults: list[PipelineError] = []
        if not self.experiments:
            allowed = ("tank", "decays", "swings")
            faults.append(fault("the plan has no experiment", allowed=allowed))
        places = [
            (f"{kind}[{index}]", item.id)
            for kind, items in (
                ("tank", self.tank), ("decays", self.decays), ("swings", self.swings),
            )
            for index, item in enumerate(items)
        ]  # fmt: skip
        faults += repeated_names(places)
        truths = [(f"tank[{i}]", item.truth) for i, item in enumerate(self.tank)]
        truths += [(f"decays[{i}]", item.truth) for i, item in enumerate(self.decays)]
        for place, name in truths:
            if name not in self.truths:
                known, at = list(self.truths), f"{place}.truth"
                remedy = nearest(name, known)
                faults.append(fault("no such truth", at, name, allowed=known, remedy=remedy))
        Faults(*faults).raise_any()
        return self


class PlanDocument(Model):
    """What a twin flies, and with which sensors it is watched."""

    title: str
    """One line for the report."""
    notes: str | None = None
    """Where the numbers come from."""
    depth_m: Annotated[float, Range(0)] = 5.0
    """Depth that the vehicle holds between steps."""
    yaw_scale: float = 1.0
    """Factor on the angles of all yaw steps."""
    depth_scale: float = 1.0
    """Factor on all depth steps."""
    settle_s: Annotated[float, Range(1, 600)] = 40.0
    """Running at the leg's propeller speed before each leg."""
    margin_s: Annotated[float, Range(0, 60)] = 2.0
    """What the log holds before and after the leg."""
    step_s: Annotated[float, Range(0.0001, 0.02)] = 0.01
    """Largest step of Runge-Kutta."""
    control_hz: Annotated[float, Range(10, 500)] = 50.0
    """Rate of the autopilot."""
    viscous_lag_s: Annotated[float, Range(0, 10)] = 0.0
    """Time constant by which the viscous force follows the motion."""
    unsteady: UnsteadyEntry | None = None
    """First-order Gauss-Markov force on the body, as given at 2 m/s; it grows with the
    square of the level speed.
    """
    fins: FinLimitsEntry = FinLimitsEntry()
    """Limits of the fins."""
    sensors: PlanSensorsEntry = PlanSensorsEntry()
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

    @model_validator(mode="after")
    def _can_be_flown(self) -> PlanDocument:
        Faults(*self._faults()).raise_any()
        return self

    def _faults(self) -> Iterator[PipelineError]:
        if self.bench is not None:
            if self.legs is not None:
                yield fault("a plan has either legs or bench", "legs", len(self.legs))
            return
        if not self.legs:
            remedy = "List the legs; a plan with bench is flown by a campaign of kind bench_twin."
            yield fault("the plan has no legs", "legs", [], remedy=remedy)
            return
        if self.margin_s > self.settle_s:
            words = "the log would begin before the vehicle does"
            yield fault(words, "margin_s", self.margin_s, allowed="at most settle_s")
        if self.depth_m <= 0.0:
            words = "the vehicle would run at the surface"
            yield fault(words, "depth_m", self.depth_m, allowed="more than 0 m")
        yield from repeated_names([(f"legs[{i}]", leg.id) for i, leg in enumerate(self.legs)])
        used = {leg.manoeuvre for leg in self.legs}
        for name, steps in (("yaw_steps", self.yaw_steps), ("depth_steps", self.depth_steps)):
            if name in used and steps is None:
                words, remedy = "the plan does not say what these steps are", f"Add {name}."
                yield fault(words, name, remedy=remedy)
        if "depth_steps" in used and self.depth_steps is not None:
            depths = (self.depth_scale * value for value in self.depth_steps.values_m)
            shallowest = self.depth_m + min([0.0, *depths])
            if shallowest <= 0.0:
                words, value = "a depth step goes above the surface", f"{shallowest:g} m"
                yield fault(words, "depth_steps.values_m", value, allowed="depths below 0 m")
