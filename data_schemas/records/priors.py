"""Priors from other measurements: coefficients with their covariance."""

from __future__ import annotations

from typing import Literal

from auvid.data_schemas.documents.model import Model


class PriorTerm(Model):
    """One coefficient of a prior."""

    axis: Literal["X", "Y", "Z", "K", "M", "N"]
    """Its axis."""
    term: str
    """Its term of the viscous basis, as `u*|u|`."""
    value: float
    """Mean in SI."""


class PriorSource(Model):
    """Coefficients that another measurement or publication gives."""

    kind: Literal["bench", "campaign", "shelf"]
    """Results of a bench stage, the model card of another campaign, or a published set."""
    file: str
    """Where they come from, as the campaign names it."""
    terms: list[PriorTerm]
    """The coefficients."""
    lower: list[list[float]]
    """Rows of the lower triangle of their covariance in SI."""


class PriorSourcesRecord(Model):
    """Priors that a campaign takes from other measurements."""

    sources: list[PriorSource]
    """One for each file."""
