"""Errors of every model as artefacts, and the range of motion that legs cover."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.identification.regression.error_measures import TOTAL, ErrorMeasures

ALL = "all"
Group = tuple[str, str, str]
"""Use, leg (or `all`), model."""
Errors = Mapping[Group, Mapping[str, ErrorMeasures]]
MEASURES = {"samples": "n", "ratio": "normalised"} | {
    name: name for name in ("sse", "mae", "mse", "rms", "mad", "j0")
}
"""Column of the error table -> field of `ErrorMeasures`."""


@dataclass(frozen=True)
class RangeCovered:
    """Range of velocities (6,), and sums of measured force and its square (6,)."""

    n: int
    low: Array
    high: Array
    force: Array
    square: Array

    @classmethod
    def of(cls, nu: Array, force: Array) -> RangeCovered:
        """Return the range of one segment: velocities and forces (n, 6)."""
        square = np.square(force).sum(axis=0)
        return cls(len(nu), nu.min(axis=0), nu.max(axis=0), force.sum(axis=0), square)

    def merge(self, other: RangeCovered) -> RangeCovered:
        """Return the range of both."""
        return RangeCovered(
            self.n + other.n,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
            self.force + other.force,
            self.square + other.square,
        )

    def left_by(self, nu: Array) -> Array:
        """Return how many samples (6,) of velocities (n, 6) lie outside this range."""
        return np.asarray(np.sum((nu < self.low) | (nu > self.high), axis=0))


def mean_force_errors(covered: Mapping[str, RangeCovered]) -> dict[str, dict[str, Any]]:
    """Return (J, J/J0) per use and axis, and in total, of the mean training force.

    It is the least that a model with a constant must beat.
    """
    if "training" not in covered:
        return {}
    mean = covered["training"].force / covered["training"].n
    errors = {}
    for use, part in covered.items():
        j0 = part.square / part.n
        j = np.maximum(j0 - 2.0 * mean * part.force / part.n + mean**2, 0.0)
        both = {axis: (j[index], j0[index]) for index, axis in enumerate(AXES)}
        both[TOTAL] = (np.mean(j), np.mean(j0))
        errors[use] = {
            axis: (
                float(np.sqrt(top)),
                float(np.sqrt(top / bottom)) if bottom > 0 else float("nan"),
            )
            for axis, (top, bottom) in both.items()
        }
    return errors


def constant_ratios(covered: Mapping[str, RangeCovered]) -> dict[str, float]:
    """Return J/J0 of the mean training force by axis and in all, if there is any."""
    reference = mean_force_errors(covered)
    judged = reference.get("validation") or reference.get("training") or {}
    return {
        ALL if axis == TOTAL else axis: ratio
        for axis, (_, ratio) in judged.items()
        if math.isfinite(ratio)
    }


def error_rows(errors: Errors, cards: Mapping[str, ModelCard]) -> pa.Table:
    """Return the error table: a row per use, leg, model and axis, with totals."""
    rows = []
    for (use, leg, model), measures in errors.items():
        for axis, values in measures.items():
            card = cards[model]
            part = card.axes.get(axis)
            total = axis == TOTAL
            rows.append(
                {
                    "use": use,
                    "leg": leg,
                    "model": model,
                    "axis": ALL if total else axis,
                    "n_bar": card.n_bar if total else len(part.terms) if part else 0,
                    "rank": card.rank if total else part.rank if part else 0,
                    **{name: getattr(values, field) for name, field in MEASURES.items()},
                }
            )
    names = ("use", "leg", "model", "axis", "n_bar", "rank", *MEASURES)
    return make_table("error_table", {name: [row[name] for row in rows] for name in names})


def error_metrics(errors: Errors) -> dict[str, Any]:
    """Return J and J/J0 of every model on all legs of a use, in six digits."""
    metrics: dict[str, Any] = {"training": {}, "validation": {}}
    for (use, leg, model), measures in errors.items():
        if leg == ALL:
            values = {"J": measures[TOTAL].rms, "ratio": measures[TOTAL].normalised}
            values |= {axis: measures[axis].normalised for axis in AXES}
            metrics[use][model] = {
                name: float(f"{value:.6g}") if np.isfinite(value) else None
                for name, value in values.items()
            }
    return metrics
