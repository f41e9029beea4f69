"""Parts of the vehicle document: propeller, fins, thrusters and commands."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import model_validator

from auvid.data_schemas.documents.model import Faults, Model, Quantity, Range, Unit, fault
from auvid.data_schemas.documents.quantities import Metres, Ratio
from auvid.data_schemas.documents.vehicle.quantities import (
    FinCoefficients,
    Polynomial,
    PositiveNewtonMetres,
    PositiveNewtons,
    ascending,
    require,
    wrong_shape,
)
from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.units import NEUTRAL_US

UNIT_LENGTH_TOLERANCE = 1e-3
LARGEST_FORCE = 2.0
"""Of 1 N of a thruster, or of the factors of a frame, at most 1 in three axes."""


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
    """K_Q(J) of the moment on the hull, three coefficients, highest power first; of a
    propeller that turns clockwise seen from astern they are negative: the hull rolls to
    port.
    """


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
        for key, low, high, unit in (("voltage", 1, 1000, " V"), ("voltage_exponent", 0, 3, "")):
            value = getattr(self, key).si
            if not low <= value <= high:
                raise Faults(fault("out of range", key, value, allowed=f"{low} to {high}{unit}"))
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


def _possible_effect(effect: Quantity) -> None:
    """Raise `Faults` for thrusters of whose 1 N nothing, or more than 1 N, arrives."""
    faults, force = list[PipelineError](), np.linalg.norm(effect.array[:, :3], axis=1)
    for place, (row, size) in enumerate(zip(effect.array, force, strict=True), start=1):
        words = f"thruster {place} pushes nothing" if not row.any() else ""
        if size > LARGEST_FORCE:
            words = f"1 N of thruster {place} gives {size:.3g} N: a row is X Y Z K M N of 1 N"
        if words:
            allowed = "X, Y, Z of length 1 (not percent), then lever arms in m"
            faults.append(fault(words, "effect.value", row.tolist(), allowed=allowed))
    Faults(*faults).raise_any()


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
            _possible_effect(self.effect)
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
    direction: list[Literal[1, -1]] | None = None
    """1, or -1 for a motor of `frame` that is mirrored; MOT_n_DIRECTION of a log goes before.
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
    lag: Annotated[Quantity, Unit("s", may_be_negative=False)] | None = None
    """How late the force of all actuators follows its record, as a first-order lag; where
    it is not given, that which the training legs show.
    """
    commands: CommandsEntry = CommandsEntry()
    """What is known of actuators in full commands, where newtons are not."""


class PropulsionEntry(Model):
    """What a propeller known by its thrust alone does besides."""

    roll_moment: Annotated[Quantity, Unit("N*m")]
    """Constant roll moment while the propeller pushes."""
