"""The vehicle document: every number with value, unit and source."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from auvid.data_schemas.documents.model import Faults, Model, Quantity, Range, Unit, fault
from auvid.data_schemas.errors import PipelineError

UNIT_LENGTH_TOLERANCE = 1e-3
NEUTRAL_US = 1500.0
"""Pulse of a thruster at rest."""

Ratio = Annotated[Quantity, Unit("1")]
Kilograms = Annotated[Quantity, Unit("kg")]
KilogramMetres = Annotated[Quantity, Unit("kg*m")]
KilogramSquareMetres = Annotated[Quantity, Unit("kg*m^2")]
Metres = Annotated[Quantity, Unit("m")]
Lengths = Annotated[Quantity, Unit("m", (-1,))]
Seconds = Annotated[Quantity, Unit("s")]
Vector = Annotated[Quantity, Unit("m", (3,))]
Angles = Annotated[Quantity, Unit("rad", (3,))]
Polynomial = Annotated[Quantity, Unit("1", (3,))]
FinCoefficients = Annotated[Quantity, Unit("1", (6, 4))]
PositiveMetres = Annotated[Quantity, Unit("m", positive=True)]
PositiveRatio = Annotated[Quantity, Unit("1", positive=True)]
PositiveKilograms = Annotated[Quantity, Unit("kg", positive=True)]
PositiveNewtons = Annotated[Quantity, Unit("N", positive=True)]
PositiveNewtonMetres = Annotated[Quantity, Unit("N*m", positive=True)]
PositiveSquareMetres = Annotated[Quantity, Unit("m^2", positive=True)]


def require(model: Model, *keys: str) -> None:
    """Raise the missing keys of a part that needs them in this case."""
    fields = type(model).model_fields
    Faults(
        *(
            fault("missing quantity", key, remedy=fields[key].description)
            for key in keys
            if getattr(model, key) is None
        )
    ).raise_any()


def ascending(points: Quantity, values: Quantity, at: str) -> None:
    """Raise unless points ascend, two or more, with one value each."""
    x, y = points.array, values.array
    if len(x) < 2 or len(x) != len(y) or np.any(np.diff(x) <= 0.0):
        message = "a table needs two or more ascending points with one value each"
        raise Faults(fault(message, at, x.tolist()))


def wrong_shape(at: str, quantity: Quantity, allowed: tuple[int, ...]) -> PipelineError:
    """Return the fault of an array that does not fit the others."""
    shape = quantity.array.shape
    return fault("wrong shape", f"{at}.value", shape, allowed=allowed)


class EnvironmentEntry(Model):
    """Water and gravity."""

    water_density: Annotated[Quantity, Unit("kg/m^3")]
    """Density of the water."""
    gravity: Annotated[Quantity, Unit("m/s^2")]
    """Acceleration of gravity."""


class RigidBodyEntry(Model):
    """Mass, buoyancy and inertia."""

    mass: PositiveKilograms
    """Mass of the vehicle with the water it encloses."""
    displaced_mass: PositiveKilograms
    """Mass of the displaced water; buoyancy is this times gravity."""
    centre_of_gravity: Vector
    """r_G, three components."""
    centre_of_buoyancy: Vector
    """r_B, three components."""
    measured_inertia: str | None = None
    """Path, from this file, of a document of measured moments (schema inertia, as
    pipendulum gives it); they replace those axes of `inertia`.
    """
    inertia: Annotated[Quantity, Unit("kg*m^2", (3, 3))]
    """I_0 about the body origin, 3 by 3; off-diagonals are minus the products of
    inertia.
    """


class AddedMassEntry(Model):
    """Upper triangle of M_A = [X_udot ...] <= 0; what is not given is 0."""

    X_udot: Kilograms
    """Surge."""
    X_vdot: Kilograms | None = None
    """Surge force of sway acceleration."""
    X_wdot: Kilograms | None = None
    """Surge force of heave acceleration."""
    X_pdot: KilogramMetres | None = None
    """Surge force of roll acceleration."""
    X_qdot: KilogramMetres | None = None
    """Surge force of pitch acceleration."""
    X_rdot: KilogramMetres | None = None
    """Surge force of yaw acceleration."""
    Y_vdot: Kilograms
    """Sway."""
    Y_wdot: Kilograms | None = None
    """Sway force of heave acceleration."""
    Y_pdot: KilogramMetres | None = None
    """Sway force of roll acceleration."""
    Y_qdot: KilogramMetres | None = None
    """Sway force of pitch acceleration."""
    Y_rdot: KilogramMetres | None = None
    """Sway force of yaw acceleration."""
    Z_wdot: Kilograms
    """Heave."""
    Z_pdot: KilogramMetres | None = None
    """Heave force of roll acceleration."""
    Z_qdot: KilogramMetres | None = None
    """Heave force of pitch acceleration."""
    Z_rdot: KilogramMetres | None = None
    """Heave force of yaw acceleration."""
    K_pdot: KilogramSquareMetres
    """Roll."""
    K_qdot: KilogramSquareMetres | None = None
    """Roll moment of pitch acceleration."""
    K_rdot: KilogramSquareMetres | None = None
    """Roll moment of yaw acceleration."""
    M_qdot: KilogramSquareMetres
    """Pitch."""
    M_rdot: KilogramSquareMetres | None = None
    """Pitch moment of yaw acceleration."""
    N_rdot: KilogramSquareMetres
    """Yaw."""


class LevelSpeedEntry(Model):
    """u_c(n), speed in steady level running at a propeller speed."""

    propeller_speed: Annotated[Quantity, Unit("1/s", (-1,))]
    """Revolutions per second, ascending."""
    speed: Annotated[Quantity, Unit("m/s", (-1,))]
    """Forward speed."""

    @model_validator(mode="after")
    def _ascends(self) -> LevelSpeedEntry:
        ascending(self.propeller_speed, self.speed, "propeller_speed")
        return self


class PropellerEntry(Model):
    """One propeller on the x axis; listens to propeller_rev_s."""

    level_speed: LevelSpeedEntry
    """u_c(n), speed in steady level running at a propeller speed."""
    diameter: Metres
    """Diameter."""
    wake_fraction: Ratio
    """w_f in V_A = u (1 - w_f)."""
    thrust_coefficient: Polynomial
    """K_T(J), three coefficients, highest power first."""
    torque_coefficient: Polynomial
    """K_Q(J), three coefficients, highest power first."""


class FinsEntry(Model):
    """Four fins, columns starboard, port, bottom, top; listens to fin_{s,p,b,t}_rad."""

    from_geometry: bool = False
    """True: lift of the controlled surfaces of `geometry`, in place of the three keys
    below.
    """
    reference_length: Metres | None = None
    """Length that makes the coefficients nondimensional."""
    linear: FinCoefficients | None = None
    """Coefficients of delta, 6 by 4, rows X Y Z K M N."""
    quadratic: FinCoefficients | None = None
    """Coefficients of delta squared, 6 by 4."""

    @model_validator(mode="after")
    def _complete(self) -> FinsEntry:
        if not self.from_geometry:
            require(self, "reference_length", "linear", "quadratic")
        return self


class ThrustCurveEntry(Model):
    """Bollard thrust of one thruster."""

    pulse_width: Annotated[Quantity, Unit("us", (-1,))]
    """Pulse widths, ascending; of a polynomial those of the commands -100 and 100."""
    force: Annotated[Quantity, Unit("N", (-1,))] | None = None
    """Thrust at these pulse widths."""
    polynomial: Annotated[Quantity, Unit("N", (-1,))] | None = None
    """In place of force: thrust of a command of 0 to 100, highest power first; odd for
    reverse.
    """
    voltage: Annotated[Quantity, Unit("V")]
    """Supply voltage of the curve."""
    voltage_exponent: Ratio
    """Thrust scales with voltage to this power."""

    @model_validator(mode="after")
    def _curve(self) -> ThrustCurveEntry:
        pulses = self.pulse_width.array
        if self.polynomial is None:
            require(self, "force")
            ascending(self.pulse_width, self.force or self.pulse_width, "pulse_width")
        elif self.force is not None or len(pulses) != 2 or not pulses[0] < NEUTRAL_US < pulses[1]:
            allowed = (
                "no table of forces, and the pulses of the commands -100 and 100, on both sides of"
                f" {NEUTRAL_US:g} us"
            )
            raise Faults(
                fault(
                    "a thrust polynomial has other pulses",
                    "pulse_width",
                    pulses.tolist(),
                    allowed=allowed,
                )
            )
        return self


class ThrustersEntry(Model):
    """Fixed thrusters; listens to pwm_{n}_us."""

    position: Annotated[Quantity, Unit("m", (-1, 3))] | None = None
    """n by 3."""
    axis: Annotated[Quantity, Unit("1", (-1, 3))] | None = None
    """Direction of positive force, n by 3, unit length."""
    effect: Annotated[Quantity, Unit("1", (-1, 6))] | None = None
    """In place of position and axis: X Y Z [N] and K M N [N m] of 1 N of each thruster,
    n by 6.
    """
    direction: Annotated[Quantity, Unit("1", (-1,))]
    """1, or -1 where the pulse is mirrored about 1500 us."""
    outputs: list[Annotated[int, Range(1, 16)]] | None = None
    """Output channel of each thruster; default 1 to n."""
    thrust_curve: ThrustCurveEntry | None = None
    """Bollard thrust of one thruster; without it forces are in full commands."""

    @model_validator(mode="after")
    def _fits(self) -> ThrustersEntry:
        if self.effect is not None:
            if self.position is not None or self.axis is not None:
                message = "either effect, or position and axis, describe the thrusters"
                raise Faults(fault(message, "effect"))
        else:
            require(self, "position", "axis")
        n = len((self.effect or self.position or self.direction).array)
        direction, faults = self.direction.array, list[PipelineError]()
        if self.axis is not None:
            length = np.linalg.norm(self.axis.array, axis=1)
            if len(length) != n:
                faults.append(wrong_shape("axis", self.axis, (n, 3)))
            if np.any(np.abs(length - 1.0) > UNIT_LENGTH_TOLERANCE):
                faults.append(
                    fault("a thruster axis is not of unit length", "axis", length.tolist())
                )
        if len(direction) != n:
            faults.append(wrong_shape("direction", self.direction, (n,)))
        if np.any(np.abs(direction) != 1.0):
            faults.append(
                fault("a thruster direction is neither 1 nor -1", "direction", direction.tolist())
            )
        if self.outputs is not None and not len(self.outputs) == len(set(self.outputs)) == n:
            message = "one output channel for each thruster is needed"
            faults.append(fault(message, "outputs", self.outputs))
        Faults(*faults).raise_any()
        return self


class FullForceEntry(Model):
    """Force of a full command, as a pull at the bollard measures it."""

    surge: PositiveNewtons | None = None
    """Forward."""
    sway: PositiveNewtons | None = None
    """To the side."""
    heave: PositiveNewtons | None = None
    """Downward."""
    roll: PositiveNewtonMetres | None = None
    """Moment about x."""
    pitch: PositiveNewtonMetres | None = None
    """Moment about y."""
    yaw: PositiveNewtonMetres | None = None
    """Moment about z."""


class CommandsEntry(Model):
    """Actuators whose newtons are not known: forces count in full commands."""

    axes: list[Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]] | None = None
    """Commands that act, for logs of normalised commands; default those that are logged.
    """
    frame: (
        Literal[
            "bluerov1",
            "vectored",
            "vectored_6dof",
            "vectored_6dof_90deg",
            "simplerov_3",
            "simplerov_4",
            "simplerov_5",
        ]
        | None
    ) = None
    """Frame of ArduSub, for pulses where neither `thrusters` nor the log says how they
    mix.
    """
    full_force: FullForceEntry = FullForceEntry()
    """Force of a full command; one axis is enough to turn everything into newtons."""


class ActuatorsEntry(Model):
    """Propeller, fins, thrusters; none for a vehicle that glides or is towed."""

    propeller: PropellerEntry | None = None
    """One propeller on the x axis; listens to propeller_rev_s."""
    fins: FinsEntry | None = None
    """Four fins, columns starboard, port, bottom, top; listens to fin_{s,p,b,t}_rad."""
    thrusters: ThrustersEntry | None = None
    """Fixed thrusters; listens to pwm_{n}_us."""
    commands: CommandsEntry = CommandsEntry()
    """What is known of actuators in full commands, where newtons are not."""


class MountedEntry(Model):
    """Where a sensor sits."""

    arm: Vector | None = None
    """Position from the origin."""
    mounting: Angles | None = None
    """Roll, pitch, yaw that turn the body axes into the sensor's."""
    lag: Seconds | None = None
    """How late a measurement is reported."""


class ImuEntry(MountedEntry):
    """Gyro and accelerometer."""

    accelerometer: Literal["specific_force", "inertial", "derivative"] | None = None
    """What the accelerometer measures where the log does not say: gravity inside,
    gravity removed, rate of change of body velocity.
    """


class DepthSensorEntry(MountedEntry):
    """Pressure sensor; its mounting is of no effect."""

    barometer_instance: Annotated[int, Range(0, 15)] | None = None
    """Instance of the barometer in the water."""


class SensorsEntry(Model):
    """Places of the sensors; default: at the origin, aligned, without lag."""

    dvl: MountedEntry = MountedEntry()
    """Velocity sensor."""
    imu: ImuEntry = ImuEntry()
    """Gyro and accelerometer."""
    depth: DepthSensorEntry = DepthSensorEntry()
    """Pressure sensor."""
    pose: MountedEntry | None = None
    """Markers of a motion capture or tracking system."""


class HullEntry(Model):
    """A hull of revolution."""

    shape: Literal["cylinder", "myring", "stations"]
    """How the radius is given."""
    length: PositiveMetres | None = None
    """Length (cylinder, myring)."""
    diameter: PositiveMetres | None = None
    """Largest diameter (cylinder, myring)."""
    nose_x: Metres | None = None
    """x of the nose (cylinder, myring); default half the length."""
    nose_length: PositiveMetres | None = None
    """Length of the nose (myring)."""
    nose_exponent: PositiveRatio | None = None
    """n of the nose (myring)."""
    tail_length: PositiveMetres | None = None
    """Length of the tail (myring)."""
    tail_angle: Annotated[Quantity, Unit("rad", positive=True)] | None = None
    """Half-angle at the end of the tail (myring)."""
    station_x: Lengths | None = None
    """x of the stations, ascending (stations)."""
    station_radius: Lengths | None = None
    """Radius at the stations, linear between them (stations)."""
    frontal_area: PositiveSquareMetres | None = None
    """A_f of (2.82) where the source gives another than that of the diameter."""
    cross_flow_drag: PositiveRatio | None = None
    """C_dc; default 1.1."""

    @model_validator(mode="after")
    def _complete(self) -> HullEntry:
        require(self, *HULL_KEYS[self.shape])
        if self.station_x is not None and self.station_radius is not None:
            x, r = self.station_x.array, self.station_radius.array
            if (
                len(x) < 2
                or len(x) != len(r)
                or np.any(np.diff(x) <= 0.0)
                or min(r) < 0.0 >= max(r)
            ):
                message = "stations need two or more ascending x with a radius, not negative, each"
                raise Faults(fault(message, "station_x", x.tolist()))
        if self.nose_length and self.tail_length and self.length:
            both = self.nose_length.si + self.tail_length.si
            if both > self.length.si:
                message = "nose and tail are longer than the hull"
                allowed = f"at most {self.length.si:g} m together"
                raise Faults(fault(message, "tail_length", both, allowed=allowed))
        return self


class SurfaceEntry(Model):
    """A pair of equal fins or wings, or two crossed pairs."""

    layout: Literal["cruciform", "horizontal", "vertical"]
    """Two crossed pairs, a lying pair, a standing pair."""
    controlled: bool = False
    """True: these are the control fins; default false."""
    span: PositiveMetres
    """One surface from root to tip."""
    area: PositiveSquareMetres
    """Planform of one surface."""
    tip_height: PositiveMetres
    """Tip from the axis of the hull."""
    x_rear: Metres
    """Trailing edge."""
    x_front: Metres
    """Leading edge."""
    x_force: Metres | None = None
    """Where the force acts; default mid chord."""
    taper: PositiveRatio | None = None
    """Width of the tip over that of the root, t of (2.85); default 1."""

    @model_validator(mode="after")
    def _forward(self) -> SurfaceEntry:
        rear, front = self.x_rear.si, self.x_front.si
        if front <= rear:
            message = "the front of a surface is not ahead of its rear"
            raise Faults(fault(message, "x_front", front, allowed=f"above {rear:g} m"))
        return self


class GeometryEntry(Model):
    """Shape of hull, fins and wings, for strip theory.

    x is measured from the body origin, heights from the hull's axis.
    """

    hull: HullEntry
    """A hull of revolution."""
    surfaces: dict[str, SurfaceEntry] = Field(default_factory=dict)
    """Pairs of equal fins or wings, by name."""


class BuoyancyEngineEntry(Model):
    """Takes water in and out, and moves the centre of gravity along x."""

    mass_empty: Kilograms
    """Mass of the vehicle when empty."""
    mass_neutral: Kilograms
    """Mass at neutral buoyancy."""
    mass_full: Kilograms
    """Mass when full."""
    x_G_per_mass: Annotated[Quantity, Unit("m/kg")]
    """How far x_G moves forward per mass taken in."""

    @model_validator(mode="after")
    def _ascend(self) -> BuoyancyEngineEntry:
        masses = (self.mass_empty.si, self.mass_neutral.si, self.mass_full.si)
        if not 0.0 < masses[0] < masses[1] < masses[2]:
            allowed = "0 < mass_empty < mass_neutral < mass_full"
            message = "the masses of the buoyancy engine do not ascend"
            raise Faults(fault(message, value=masses, allowed=allowed))
        return self


class GliderEntry(Model):
    """What a glide is fitted with: areas, lift and hull of a glider.

    Lift and induced drag are those of the record where speed through the water tells
    them; else they hold as they stand here, with their spread.
    """

    reference_area: PositiveSquareMetres
    """Area S that drag and lift are referred to, mostly that of the wings."""
    lift_slope: Annotated[Quantity, Unit("1/rad", positive=True)]
    """Slope of the lift of hull and wings together, referred to S."""
    lift_slope_sd: Annotated[Quantity, Unit("1/rad", positive=True)] | None = None
    """Its standard deviation; default a tenth."""
    induced_drag: Annotated[Quantity, Unit("1/rad^2", positive=True)]
    """C_D1 in C_D = C_D0 + C_D1 alpha^2, referred to S."""
    induced_drag_sd: Annotated[Quantity, Unit("1/rad^2", positive=True)] | None = None
    """Its standard deviation; default three tenths."""
    zero_lift_sd: Annotated[Quantity, Unit("rad", positive=True)] | None = None
    """Standard deviation of the angle without lift, pitch sensor included; default 2
    degrees.
    """
    trim_sd: Annotated[Quantity, Unit("m^3", positive=True)] | None = None
    """Standard deviation of the ballasting; default a tenth of the drive's stroke."""
    compressibility: Annotated[Quantity, Unit("1/Pa")] | None = None
    """Share of its volume that the hull loses per pressure; default 0."""
    thermal_expansion: Annotated[Quantity, Unit("1/K")] | None = None
    """Share of its volume that the hull gains per temperature; default 0."""
    temperature: Annotated[Quantity, Unit("K")] | None = None
    """Temperature at which it was ballasted; default 283.15 K."""
    drive_stops: Annotated[Quantity, Unit("m^3", (2,))] | None = None
    """Lowest and highest reading of the drive: at a stop the reading tells no volume."""


class PropulsionEntry(Model):
    """What a propeller known by its thrust alone does besides."""

    roll_moment: Annotated[Quantity, Unit("N*m")]
    """Constant roll moment while the propeller pushes."""


Share = Annotated[Quantity, Unit("1", positive=True)]


class SpreadsEntry(Model):
    """Standard deviations of figures that nobody measured on this vehicle.

    Identified coefficients move with them, however long the dive; what is not given
    counts as exact. Shares are of the figure's own value.
    """

    thrust: Share | None = None
    """Scale of the thrust of propeller and thrusters, as a share."""
    thrust_lag: Annotated[Quantity, Unit("s", positive=True)] | None = None
    """How late the thrust follows the command."""
    mass: PositiveKilograms | None = None
    """Mass; weight and buoyancy are trimmed and stay."""
    inertia: Share | None = None
    """Each moment of inertia, as a share."""
    added_mass: Share | None = None
    """Each of the six added masses X_udot to N_rdot, as a share."""
    velocity_arm: PositiveMetres | None = None
    """Each component of the arm of the velocity sensor."""


class VehicleDocument(Model):
    """A vehicle: mass, inertia, added mass, actuators and sensors.

    Every number has value, unit and source; assumed numbers are marked as such. Body
    axes forward-right-down.
    """

    name: str
    """Short name."""
    title: str
    """Name as printed."""
    source: str
    """Where the numbers come from."""
    origin: str
    """The point of the vehicle that arms and centres count from."""
    notes: str | None = None
    """What a reader of the report should know."""
    licence: str | None = None
    """Under which terms the numbers may be passed on, where they are another's."""
    environment: EnvironmentEntry
    """Water and gravity."""
    rigid_body: RigidBodyEntry
    """Mass, buoyancy and inertia."""
    added_mass: AddedMassEntry
    """Upper triangle of M_A = [X_udot ...] <= 0; what is not given is 0."""
    actuators: ActuatorsEntry = ActuatorsEntry()
    """Propeller, fins, thrusters; none for a vehicle that glides or is towed."""
    sensors: SensorsEntry = SensorsEntry()
    """Where the sensors sit; what is not given is at the origin, aligned, without lag.
    """
    geometry: GeometryEntry | None = None
    """Shape of hull, fins and wings, for strip theory; x from the body origin, heights
    from the hull's axis.
    """
    buoyancy_engine: BuoyancyEngineEntry | None = None
    """Takes water in and out, and moves the centre of gravity along x."""
    glider: GliderEntry | None = None
    """What a glide is fitted with: reference area, lift and hull of a glider."""
    propulsion: PropulsionEntry | None = None
    """What a propeller known by its thrust alone does besides."""
    spreads: SpreadsEntry = SpreadsEntry()
    """Standard deviations of figures that nobody measured on this vehicle."""
    published: dict[str, Quantity] = Field(default_factory=dict)
    """Hydrodynamic coefficients as the source prints them, by name: Y_vdot, Y_v|v|."""
    as_simulated: dict[str, Quantity] = Field(default_factory=dict)
    """Coefficients that the source's own simulations need, in place of the published
    ones.
    """


HULL_KEYS = {
    "cylinder": ("length", "diameter"),
    "myring": ("length", "diameter", "nose_length", "nose_exponent", "tail_length", "tail_angle"),
    "stations": ("station_x", "station_radius"),
}
"""What each shape of a hull needs."""


class InertiaDocument(Model):
    """Measured moments of inertia of a vehicle about its centre of gravity.

    A vehicle file can name it.
    """

    vehicle: str
    """Vehicle that was swung."""
    source: str
    """How it was measured."""
    I_x: KilogramSquareMetres | None = None
    """About the body x axis."""
    I_y: KilogramSquareMetres | None = None
    """About the body y axis."""
    I_z: KilogramSquareMetres | None = None
    """About the body z axis."""
