"""What axis_record says of a leg beside its table."""

from __future__ import annotations

from typing import Literal

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
    notes: list[str]
    """Sentences on how it was made."""
    warnings: list[str]
    """Sentences a user should read."""
