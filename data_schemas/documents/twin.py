"""What the simulation needs of a twin campaign."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, ValidatorFunctionWrapHandler, field_validator

from auvid.data_schemas.documents.model import Model, Range, part_of_kind
from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.documents.plans.glide_plan import GlidePlanDocument
from auvid.data_schemas.documents.plans.plan import PlanDocument

Plan = PlanDocument | DivePlanDocument | GlidePlanDocument


def plan_model(document: object) -> type[Plan]:
    """Return the model of a plan: dives and glides say so by their key `kind`."""
    kind = document.get("kind") if isinstance(document, Mapping) else None
    if kind == "glides":
        return GlidePlanDocument
    return DivePlanDocument if kind == "dives" else PlanDocument


class TruthEntry(Model):
    """The viscous force of the twin."""

    kind: Literal["physics", "coefficients", "refit"]
    """Flow physics, given coefficients, or a model refitted to the flow physics."""
    name: str
    """Physics, or the name of the model."""
    source: str
    """Where the numbers come from."""
    coefficients: dict[str, dict[str, float]] = Field(default_factory=dict)
    """Axis -> term -> value in SI."""


class TwinDocument(Model):
    """Input of the simulation of a twin campaign.

    It is read from the files that the manifest names.
    """

    plan: PlanDocument | DivePlanDocument | GlidePlanDocument
    """The plan: with `kind: dives` one of dives, with `kind: glides` of a glider."""
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

    @field_validator("plan", mode="wrap")
    @classmethod
    def _plan_of_kind(cls, value: object, handler: ValidatorFunctionWrapHandler) -> Plan:
        return value if isinstance(value, Plan) else part_of_kind(plan_model(value), value)
