"""The model file: one identified model with all that a simulator needs, as JSON."""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Any, Final, Literal

from pydantic import Field, model_validator

from auvid.data_schemas.documents.model import Faults, Model, fault
from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.records.models import (
    AxisMerit,
    CovarianceCard,
    InertiaCard,
    LimitCard,
    MotionCheck,
    PriorCard,
    TermCombination,
    UsableFor,
    VelocityRange,
    Verdict,
)
from auvid.data_schemas.records.partial import Axis, PartialFigures

FORMAT: Final = 1
"""Number of the layout of a model of six axes in newtons; it goes up when a reader of the
old one would be wrong.
"""
PARTIAL_FORMAT: Final = 2
"""That of a model with `partial`, which a reader of format 1 would take for a whole one."""
FORMATS: Final = (FORMAT, PARTIAL_FORMAT)
AS_PUBLISHED: Final = "nothing: as published"
"""Method of a published set."""
PUBLISHED: Final = "published"
"""Verdict of a coefficient that was read from its source and fitted to nothing."""

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Row = Annotated[list[float], Field(min_length=6, max_length=6)]
Matrix = Annotated[list[Row], Field(min_length=6, max_length=6)]
Factor = Literal[
    "u", "v", "w", "p", "q", "r",
    "|u|", "|v|", "|w|", "|p|", "|q|", "|r|",
    "V", "Vv", "Vw", "eta-1",
]  # fmt: skip


class FramesEntry(Model):
    """Axes, angles and signs of all numbers in the file."""

    body: Literal["forward, starboard, down"]
    """Axes x, y, z of the vehicle."""
    world: Literal["north, east, down"]
    """Axes of the position."""
    origin: str
    """The point of the vehicle that positions, moments and velocities count from."""
    velocity: Literal["nu = [u, v, w, p, q, r]"]
    """Velocity through the water of the origin [m/s] and angular velocity [rad/s], in
    body axes.
    """
    pose: Literal["eta = [x, y, z, phi, theta, psi]"]
    """Position [m] and roll, pitch, yaw [rad]; body to world is Rz(psi) Ry(theta) Rx(phi).
    """
    force: Literal["tau = [X, Y, Z, K, M, N]"]
    """Forces [N] and moments about the origin [N m] on the vehicle, in body axes."""
    equation: Literal["mass nu_dot + C(nu) nu = tau_viscous + tau_restoring + tau_actuators"]
    """Fossen's M nu_dot + C(nu) nu + D(nu) nu + g(eta) = tau, with D(nu) nu = -tau_viscous
    and g = -tau_restoring: damping that takes energy out has negative coefficients here.
    C(nu) nu = [omega x a; v x a + omega x b] with [a; b] = mass nu, v = [u, v, w] and
    omega = [p, q, r].
    """


class ThrusterFigures(Model):
    """One thruster; its force f [N] gives tau = effect f."""

    output: int
    """Output channel of the autopilot."""
    position_m: Vector | None
    """Position; null where only the effect is known."""
    axis: Vector | None
    """Direction of positive force, of unit length; null where only the effect is known."""
    effect: Row
    """X Y Z [N] and K M N [N m] of 1 N."""
    direction: Literal[-1, 1]
    """-1: the pulse is mirrored about 1500 us before the curve is entered."""


class ThrustCurveFigures(Model):
    """Force of a thruster over the width of its pulse, in still water.

    Linear between the points; beyond the ends that of the ends, so these are the limits
    of the force; pulses below 800 us give none. f(pulse, V) = f(pulse) (V / voltage) **
    voltage_exponent.
    """

    pulse_us: list[float]
    """Pulse widths, ascending."""
    force_N: list[float]
    """Force at these, at `voltage_V`."""
    polynomial: list[float] | None
    """In place of the points between the ends: P(|c|) sign(c), highest power first, of a
    command c of -100 (first pulse), 0 (1500 us) and 100 (last pulse); null for none.
    """
    voltage_V: float
    """Supply voltage of the curve."""
    voltage_exponent: float
    """Power of the voltage that the force goes with."""


class FinFigures(Model):
    """Four fins, columns starboard, port, bottom, top, deflections delta [rad].

    tau = u^2 (linear delta + quadratic delta^2).
    """

    linear: list[list[float]]
    """6 by 4 [N s^2/(m^2 rad); moments N m s^2/(m^2 rad)]."""
    quadratic: list[list[float]]
    """6 by 4, as `linear` per rad^2."""


class PropellerFigures(Model):
    """One propeller on the x axis at n [rev/s].

    X = thrust . [a^2, a |n|, n |n|] and K likewise with torque, a = inflow_per_u u. The
    propulsion ratio is eta = u_c(n) / max(U, minimum_speed), U = sqrt(u^2 + v^2 + w^2).
    """

    inflow_per_u: float
    """(1 - wake fraction) / diameter [1/m]."""
    thrust: Vector
    """Of X [N s^2]."""
    torque: Vector
    """Of K [N m s^2]."""
    level_speed_rev_s: list[float]
    """Propeller speeds of u_c(n), ascending; linear between."""
    level_speed_m_s: list[float]
    """u_c(n), the forward speed in steady level running."""
    minimum_speed_m_s: float
    """Lower bound of U in eta."""


class DynamicsFigures(Model):
    """Inertia, buoyancy and actuators in SI, all that the equation needs but damping.

    It follows from `vehicle` and `fitted_inertia`. Where `partial.unit_of_mass` names an
    axis, every kg below is that unit, so that N is m/s^2, and there are no actuators: what
    drives the vehicle are `partial.gains`.
    """

    mass_kg: float
    """Mass with the water enclosed."""
    centre_of_gravity_m: Vector
    """r_G from the origin."""
    inertia_kg_m2: Annotated[list[Vector], Field(min_length=3, max_length=3)]
    """Of the rigid body about the origin; off-diagonals are minus the products of inertia.
    """
    rigid_body: Matrix
    """M_RB of mass, r_G and inertia [kg, kg m, kg m^2]."""
    added_mass: Matrix
    """M_A = [X_udot ...], derivatives and so <= 0 on the diagonal, as SNAME and McCarter
    have them; a tool that takes positive added mass takes -M_A. An inertia that the run
    fitted is in it: the data cannot tell a moment of inertia from its added mass.
    """
    mass: Matrix
    """M = rigid_body - added_mass, which the acceleration is multiplied by."""
    weight_N: float
    """W = mass gravity."""
    buoyancy_N: float
    """B; the net force that a run fitted is the coefficient Z_constant, not here."""
    centre_of_buoyancy_m: Vector
    """r_B from the origin. With s, c of phi (f) and theta (t) and [a b c] = r_G W - r_B B:
    tau_restoring = [-(W-B) st, (W-B) ct sf, (W-B) ct cf, b ct cf - c ct sf, -c st - a ct
    cf, a ct sf + b st].
    """
    water_density_kg_m3: float
    """Density of the water."""
    gravity_m_s2: float
    """Acceleration of gravity."""
    thrusters: list[ThrusterFigures]
    """Fixed thrusters; their forces add up."""
    thrust_curve: ThrustCurveFigures | None
    """Of each thruster; null without any."""
    fins: FinFigures | None
    """Fins; null without any."""
    propeller: PropellerFigures | None
    """Propeller; null without one."""
    actuator_lag_s: float
    """Time constant of a first-order lag between command and force that the run fitted; 0
    where it fitted none.
    """


class CoefficientEntry(Model):
    """One viscous coefficient of one component of tau.

    It adds predictor * product(factors), with V = sqrt(v^2 + w^2), Vv = V sign(v),
    Vw = V sign(w); eta - 1 is that of the propeller; the product of no factor is 1 (a
    constant force).
    """

    symbol: str
    """Name, as Y_v|v|."""
    axis: Axis
    """Component of tau."""
    term: str
    """Product of the factors, as v*|v|; constant for none."""
    factors: list[Factor]
    """What is multiplied."""
    unit: str
    """SI unit."""
    determined: bool
    """Whether the data determine the number. Where not, `value` is null, or rests on the
    bound, the prior or the publication that `verdict` names, and `predictor` is no result:
    it belongs to the model as a whole and is of no use by itself.
    """
    value: float | None
    """The coefficient; null where the run gives none."""
    predictor: float
    """The number that the judged model computes with, whatever the verdict."""
    verdict: Literal[Verdict, "published"]
    """What the data say; where they say too little, what the value rests on; published:
    read from `source` of the file, and nothing was fitted. What fills an axis that the
    logs do not give is `from the shelf` or `from a bench`, with its `source`.
    """
    standard_error: float | None
    """Standard error by noise, for coloured residuals; null where there is none."""
    interval_95: list[float] | None
    """Ends of the 95 % interval by noise; null where there is no standard error."""
    interval_95_assumed: list[float] | None
    """Ends of the 95 % interval by assumed figures of the vehicle, of their standard
    deviations `vehicle.spreads`; no longer dive makes it smaller. null where none is given,
    and where the value rests on a bound or a prior.
    """
    interval_95_total: list[float] | None = None
    """Ends of the 95 % interval by noise and assumed figures together, which are
    independent; null where either is null.
    """
    assumed_shifts: dict[str, float]
    """Assumed figure -> what one standard deviation of it moves the value by; empty where
    the value rests on a bound or a prior.
    """
    inseparable_from: list[str]
    """Terms of the axis it cannot be told from."""
    turns_without: list[str]
    """Training legs without which its sign turns."""
    source: str | None = None
    """Where a coefficient that fills an axis comes from; absent for the logs of the run and
    for a published set, whose `source` the file has.
    """


class LagEntry(Model):
    """The lag of the actuators, where the run fitted one."""

    value_s: float
    """Time constant."""
    standard_error_s: float | None
    """Its standard error; null at its bound, and of one stated without a spread."""
    verdict: Literal["identified", "weak", "inseparable", "at its bound", "stated"]
    """Inseparable: from an inertia, or from the lag of the velocity log. Stated: by the
    vehicle file.
    """


class FreeRunEntry(Model):
    """RMS errors of free runs over a validation segment, at one horizon."""

    segment: str
    """The validation segment."""
    horizon_s: float
    """Time after a start."""
    starts: int
    """Starting points."""
    lost: int
    """Runs that had left all bounds by then; they do not count below."""
    rms: dict[str, float | None]
    """u v w [m/s], p q r [rad/s], phi theta psi [rad] -> RMS error; null where all are lost.
    """


class ValidationEntry(Model):
    """How good the model is on data that it was judged on."""

    axes: dict[str, AxisMerit]
    """Axis or all -> J/J0 and the other figures; 1 is predicting no force at all."""
    free_runs: list[FreeRunEntry]
    """Errors of motion simulated from measured controls."""
    runs: int
    """Free runs made; 0 for none."""
    lost: int
    """Free runs that left all bounds."""
    faults: list[str]
    """What the model does that no vehicle does; empty where it passes physics."""
    motion: MotionCheck | None = None
    """What it does by itself, without a pilot: whether it tips over; null for not tried."""
    coverage_on_twins: dict[str, float]
    """True model of a twin -> share of 95 % intervals of identified coefficients that held
    the truth there, where it was measured for the method.
    """


class UseEntry(Model):
    """What the model may be used for."""

    recommended: bool
    """Whether this is the model of its run to take."""
    sentence: str
    """Use in words."""
    rule: str
    """Why the run takes the model that it takes."""
    axes: UsableFor | None
    """Uses by axis; null where nothing judges the model."""


class OriginEntry(Model):
    """Where the numbers come from."""

    campaign: str
    """Title of the campaign; none for a published set."""
    logs: dict[str, list[dict[str, Any]]]
    """Log -> its files with name and content hash (SHA-256)."""
    vehicle_hash: str
    """Hash of the vehicle document as the user wrote it."""
    code: dict[str, str]
    """Stage -> hash of its code and schemas."""
    parameters: dict[str, dict[str, Any]]
    """Stage -> every parameter in force."""
    packages: dict[str, str]
    """Versions of packages."""


class ModelFile(Model):
    """One identified model that stands alone: all that is needed to compute with it.

    Everything is in SI. Start at `frames.equation`: `dynamics` has inertia, buoyancy and
    actuators, `coefficients` the viscous force; `use` says what all this may be used for,
    `validity` where. A file with `partial` lacks axes, or has a unit of mass of its own:
    read that first.
    """

    format: Literal[1, 2]
    """Number of this layout: 2 with `partial`, 1 without."""
    kind: Literal["auvid model"]
    """What this file is."""
    auvid: str
    """Version of auvid that wrote it."""
    name: str
    """Name of the model."""
    title: str
    """Name as printed."""
    source: str
    """Where the form of the model comes from."""
    method: str
    """How it was fitted; nothing: as published, for a published set."""
    use: UseEntry
    """What the model may be used for."""
    frames: FramesEntry
    """Axes, angles and signs."""
    dynamics: DynamicsFigures
    """Inertia, buoyancy and actuators; from `vehicle` and `fitted_inertia`."""
    coefficients: list[CoefficientEntry]
    """The viscous force: tau_viscous of an axis is the sum over its coefficients of
    predictor * product(factors).
    """
    covariance: dict[str, CovarianceCard]
    """Axis -> covariance of its coefficients, by noise and by assumed figures."""
    combinations: dict[str, list[TermCombination]]
    """Axis -> what the data determine of inseparable coefficients."""
    fitted_inertia: list[InertiaCard]
    """Inertia that the run fitted; `dynamics` has it."""
    fitted_lag: LagEntry | None
    """Lag of the actuators that the run fitted; null for none."""
    limits: list[LimitCard]
    """Physical limits that hold coefficients back."""
    prior: PriorCard | None
    """The prior on coefficients; null for none."""
    validity: dict[str, VelocityRange]
    """u v w [m/s], p q r [rad/s] -> range of the training legs; outside nothing is known.
    Empty for a published set.
    """
    validation: ValidationEntry | None
    """Figures of validation; null where nothing judges the model."""
    assumed: list[str]
    """Figures of the vehicle that nobody measured, in words."""
    vehicle: VehicleDocument
    """The vehicle document in SI with the source of each number; fitted inertia is not in
    it.
    """
    origin: OriginEntry
    """Hashes of logs and code, parameters, versions."""
    partial: PartialFigures | None = None
    """Axes that the model has and lacks, and its unit of mass; absent where it has six axes
    in newtons.
    """
    content_sha256: str | None = None
    """Of everything else in the file, so that a damaged copy is refused. Whoever changes a
    figure by hand deletes this line.
    """

    @model_validator(mode="after")
    def _format_of_a_part(self) -> ModelFile:
        right = FORMAT if self.partial is None else PARTIAL_FORMAT
        if self.format != right:
            raise Faults(fault("a model file with `partial` has format 2", value=self.format))
        return self

    def content_hash(self) -> str:
        """Return the SHA-256 of all fields but `content_sha256`, in whatever layout.

        Defaults do not count: a file from before a field was added stays as it was written.
        """
        content = self.model_dump(
            mode="json", exclude_none=True, exclude_defaults=True, exclude={"content_sha256"}
        )
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def sealed(self) -> ModelFile:
        """Return the model file with the hash of its content."""
        return self.model_copy(update={"content_sha256": self.content_hash()})
