"""Bounds of a twin campaign beside what was measured."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.stages.check_truth.errors import Errors
from auvid.stages.reference_check import ReferenceCheck

FIGURES = {
    "force_error": ("RMS error of the residual force, six axes", "force, all axes", "N, N m"),
    "velocity_error_m_s": ("RMS error of u, v, w", "velocity", "m/s"),
    "gyro_bias_rad_s": ("RMS error of the gyro bias", "gyro bias", "rad/s"),
    "accel_bias_m_s2": ("RMS error of the accelerometer bias", "accelerometer bias", "m/s^2"),
}
"""Bound -> what it holds in words, the quantity of `Errors`, unit."""


def checks(
    limits: Mapping[str, float | None],
    ratio: Mapping[str, float],
    errors: Errors,
    error_rows: Sequence[Mapping[str, Any]],
    same: Collection[str] = (),
) -> list[ReferenceCheck]:
    """Check all bounds that are set: on errors (by `FIGURES`), and on J/J0 by model.

    Those on models of the form of the truth (`same`) hold by construction. Raises
    `CampaignError` for one on what was not measured.
    """
    return [*_errors(limits, errors), *_ratios(ratio, error_rows, same)]


def same_form(
    simulation: Mapping[str, Any], models: Mapping[str, Mapping[str, Collection[str]]]
) -> tuple[str, ...]:
    """Return the models (terms by axis) that have every term of the truth that flew.

    A truth without coefficients, as flow physics, is the form of none.
    """
    truth = {
        axis: {term for term, value in terms.items() if value}
        for axis, terms in (simulation.get("coefficients") or {}).items()
    }
    if not any(truth.values()):
        return ()
    return tuple(
        name
        for name, terms in models.items()
        if all(own <= set(terms.get(axis, ())) for axis, own in truth.items())
    )


def _errors(limits: Mapping[str, float | None], errors: Errors) -> Iterator[ReferenceCheck]:
    for name, (words, quantity, unit) in FIGURES.items():
        if limits[name] is None:
            continue
        value = errors.total(quantity)
        if value is None:
            remedy = "Choose a method of fuse that finds it, or take the bound away."
            raise CampaignError(
                f"nothing to hold against this bound: no {quantity} was found",
                field=f"stages.check_truth.{name}",
                remedy=remedy,
            )
        yield ReferenceCheck(words, value, unit, high=limits[name])


def _ratios(
    ratio: Mapping[str, float], rows: Sequence[Mapping[str, Any]], same: Collection[str]
) -> Iterator[ReferenceCheck]:
    ratios = {
        row["model"]: row["ratio"]
        for row in rows
        if row["use"] == "validation" and row["axis"] == row["leg"] == "all"
    }
    for model, bound in ratio.items():
        field = f"stages.check_truth.ratio.{model}"
        if isinstance(bound, bool) or not isinstance(bound, int | float) or not bound > 0:
            raise CampaignError(
                "a bound of J/J0 must be a positive number", field=field, value=bound
            )
        if ratios.get(model) is None:
            raise CampaignError(
                "no such model was judged on validation legs",
                field=field,
                allowed=sorted(ratios),
                remedy=nearest(model, ratios),
            )
        yield ReferenceCheck(
            f"J/J0 of {model}, validation",
            float(ratios[model]),
            high=float(bound),
            evidence="construction" if model in same else "method",
            evidence_reason="the twin flew a truth of this form" if model in same else "",
        )
