"""Bounds of a twin campaign beside what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.stages.check_truth.errors import Errors


@dataclass(frozen=True)
class TruthBounds:
    """Largest RMS errors allowed over all legs, and J/J0 on validation by model.

    None sets no bound.
    """

    force_error: float | None
    velocity_error_m_s: float | None
    gyro_bias_rad_s: float | None
    accel_bias_m_s2: float | None
    ratio: Mapping[str, float]


FIGURES = {
    "force_error": ("RMS error of the residual force, six axes", "force, all axes", "N, N m"),
    "velocity_error_m_s": ("RMS error of u, v, w", "velocity", "m/s"),
    "gyro_bias_rad_s": ("RMS error of the gyro bias", "gyro bias", "rad/s"),
    "accel_bias_m_s2": ("RMS error of the accelerometer bias", "accelerometer bias", "m/s^2"),
}
"""Bound -> what it holds in words, the quantity of `Errors`, unit."""


@dataclass(frozen=True)
class BoundCheck:
    """A bound beside what was measured."""

    figure: str
    unit: str
    bound: float
    value: float

    @property
    def met(self) -> bool:
        """Whether the value is within the bound."""
        return self.value <= self.bound


def checks(
    bounds: TruthBounds, errors: Errors, error_rows: Sequence[Mapping[str, Any]]
) -> list[BoundCheck]:
    """Check all bounds that are set.

    Raises `CampaignError` for one on what was not measured.
    """
    return [*_errors(bounds, errors), *_ratios(bounds, error_rows)]


def _errors(bounds: TruthBounds, errors: Errors) -> Iterator[BoundCheck]:
    for name, (words, quantity, unit) in FIGURES.items():
        bound = getattr(bounds, name)
        if bound is None:
            continue
        value = errors.total(quantity)
        if value is None:
            remedy = "Choose a method of fuse that finds it, or take the bound away."
            raise CampaignError(
                f"nothing to hold against this bound: no {quantity} was found",
                field=f"stages.check_truth.{name}",
                remedy=remedy,
            )
        yield BoundCheck(words, unit, bound, value)


def _ratios(bounds: TruthBounds, rows: Sequence[Mapping[str, Any]]) -> Iterator[BoundCheck]:
    known = {
        row["model"]: row["ratio"]
        for row in rows
        if row["use"] == "validation" and row["axis"] == row["leg"] == "all"
    }
    for model, bound in bounds.ratio.items():
        field = f"stages.check_truth.ratio.{model}"
        if isinstance(bound, bool) or not isinstance(bound, int | float) or not bound > 0:
            raise CampaignError(
                "a bound of J/J0 must be a positive number", field=field, value=bound
            )
        if model not in known or known[model] is None:
            raise CampaignError(
                "no such model was judged on validation legs",
                field=field,
                allowed=sorted(known),
                remedy=nearest(model, known),
            )
        yield BoundCheck(f"J/J0 of {model}, validation", "1", float(bound), float(known[model]))
