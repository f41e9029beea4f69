"""What axis_record says of a leg beside its table."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from auvid.data_schemas.documents.model import Model

AxisLetter = Literal["X", "Y", "Z", "K", "M", "N"]


class LeftOutStretch(Model):
    """A stretch of the leg that no window of an axis has."""

    axis: AxisLetter
    """The axis."""
    start_s: float
    """Seconds from the start of the log."""
    end_s: float
    """Seconds from the start of the log."""
    reason: str
    """Why."""


class ThrusterEffect(Model):
    """What one thruster does to the vehicle."""

    output: int
    """Output channel of the autopilot."""
    effect: list[float]
    """Force on X Y Z K M N by 1 N of it [1, m]; of full commands the share that its full
    command has in that of the axis.
    """


class AxisWindowsRecord(Model):
    """How the record of a leg was made: clock, force, windows, what was left out."""

    leg: str
    """The leg."""
    log: str
    """The log."""
    use: Literal["training", "validation"]
    """Fit or judge."""
    start_s: float
    """First time of the record in seconds from the start of the log."""
    rate_hz: float
    """Rate of the uniform clock."""
    normalised: bool
    """True: forces are in full commands, not in newtons."""
    force: str
    """Where the force comes from, in words."""
    measured_by: dict[AxisLetter, str]
    """Axis -> what measures its velocity, in words; axes that nothing measures lack."""
    smoothed_s: dict[AxisLetter, float] = Field(default_factory=dict)
    """Axis -> time over which position fixes, or lines between seldom depths, smooth it."""
    windows_s: dict[AxisLetter, float]
    """Axis -> length of its windows together."""
    left_out: list[LeftOutStretch]
    """Stretches without windows."""
    full_force: dict[AxisLetter, float]
    """Axis -> force of a full command [N, N m], where a pull at the bollard measured it."""
    full_thrust: dict[AxisLetter, float]
    """Axis -> force of a full command by that of one thruster [1, m], where the layout of
    the thrusters is known: they tie the full commands of the axes together.
    """
    thrusters: list[ThrusterEffect] = Field(default_factory=list)
    """What makes up the force, in the order of the allocation; none where nothing says how
    outputs mix.
    """
    notes: list[str]
    """Sentences on how it was made."""
    warnings: list[str]
    """Sentences a user should read."""
