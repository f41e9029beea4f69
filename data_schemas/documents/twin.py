"""What the simulation needs of a twin campaign."""

from __future__ import annotations

from typing import Annotated, Literal

from auvid.data_schemas.documents.model import Model, Range


class TruthEntry(Model):
    """The viscous force of the twin."""

    kind: Literal["physics", "coefficients", "refit"]
    """Flow physics, given coefficients, or a model refitted to the flow physics."""
    name: str
    """Physics, or the name of the model."""
    source: str
    """Where the numbers come from."""
    coefficients: dict[str, dict[str, float]] | None = None
    """Axis -> term -> value in SI."""


class TwinDocument(Model):
    """What the simulation needs of a twin campaign, read from the files that the
    manifest names.
    """

    plan: dict[str, object]
    """The plan (schema plan)."""
    truth: TruthEntry
    """The viscous force of the twin."""
    seed: Annotated[int, Range(0)]
    """Seed of all noise."""
    format: Literal["bin", "tlog", "csv"]
    """Kind of log files."""
    accelerometer: Literal["specific_force", "inertial"]
    """What the accelerometer columns of CSV logs hold; inertial: gravity taken off by
    the AHRS's own attitude.
    """
