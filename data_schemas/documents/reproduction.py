"""How the published tables of a twin are reproduced."""

from __future__ import annotations

from typing import Annotated, Literal

from auvid.data_schemas.documents.model import Model, Range
from auvid.data_schemas.documents.published_values import Evidence


class PlanEntry(Model):
    """Plans."""

    id: str
    """Short name."""
    plan: str
    """Path of the plan."""
    meaning: str
    """Why this plan is flown."""
    seed: Annotated[int, Range(0)] | None = None
    """Seed of all noise; that of the manifest unless said."""
    variants: list[str] | None = None
    """Variants to run; all unless said."""


class VariantEntry(Model):
    """Variants."""

    id: str
    """Short name."""
    label: str
    """a letter or two for the heads of tables."""
    title: str
    """What it is."""
    states: Literal["sensors", "truth"] | None = None
    """Where the state comes from; default sensors."""
    stages: dict[str, dict[str, object]] | None = None
    """Parameters per stage that differ from params.yaml."""


class ComparedEntry(Model):
    """The variants that the words of the page speak of, by id."""

    published: str
    """The published procedure as written."""
    corrected: str
    """The same without its flaw."""


class FigureLegsEntry(Model):
    """Legs of the figures; the first leg of the use unless said."""

    coupling: str | None = None
    """Leg of roll and pitch in growing yaw steps, or PLAN/LEG for another plan than the
    first.
    """
    processed: str | None = None
    """Leg of raw against processed signals."""
    forces: str | None = None
    """Leg on which models are compared with the measured force."""


class ExpectedEntry(Model):
    """Expected."""

    plan: str
    """Id of the plan."""
    variant: str
    """Id of the variant."""
    figure: Literal[
        "j0",
        "ratio",
        "order",
        "force_error",
        "velocity_error",
        "gyro_bias",
        "accel_bias",
        "sway_gap",
    ]
    """J0; J/J0 of models; their order; RMS error of the residual force, of u v w, of
    the biases; integrated against measured sway.
    """
    models: list[str] | None = None
    """For ratio: the models."""
    groups: list[list[str]] | None = None
    """For order: groups of models, every J/J0 of one below every one of the next."""
    sets: list[Literal["training", "validation"]] | None = None
    """For j0, ratio and order: training, validation; both unless said."""
    low: float | None = None
    """At least."""
    high: float | None = None
    """At most."""
    evidence: Evidence
    """What meeting it shows. method: it could be missed; construction: twin and chain
    are inverse; tuned: a value was set for it; unprinted: the source prints no number.
    """
    reason: str
    """Why it shows that."""
    accepted_reason: str | None = None
    """Why the bound is not met; a miss without a reason fails the command."""


class ReproductionDocument(Model):
    """Recipe to make the tables of a publication again with a twin.

    It is the file reproduce.yaml in the folder of the manifest of its campaign.
    """

    title: str
    """One line for the page."""
    notes: str | None = None
    """What a reader should know first."""
    published: str
    """CSV file of the published tables, in the campaign folder."""
    text: str | None = None
    """Jinja template of the text of the page, in the campaign folder."""
    plans: list[PlanEntry]
    """Plans to fly; the first is the one that is compared with the published tables."""
    variants: list[VariantEntry]
    """Ways to go from the logs to the models."""
    compared: ComparedEntry
    """The variants that the words of the page speak of, by id."""
    figures: FigureLegsEntry | None = None
    """Legs of the figures; the first leg of the use unless said."""
    expected: list[ExpectedEntry]
    """Bounds that the results must meet."""
