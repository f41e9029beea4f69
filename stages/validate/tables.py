"""Error tables of every model: as artefact, as metrics, as blocks of the report, and as
text in McCarter's layout.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.identification.regression.error_measures import (
    TOTAL,
    ErrorAccumulator,
    ErrorMeasures,
)
from auvid.stages.base import Document
from auvid.stages.columns import AXIS_UNITS
from auvid.stages.presentation import remark, table

USES = ("validation", "training")
LAYOUT = {"validation": "McCarter Table 5.1", "training": "McCarter Table 5.2"}
ALL = "all"
CONSTANT_TITLE = "constant alone"
"""The reference row: the mean force of the training legs and no model."""
FAILED_RATIO = 1.0
OUTSIDE_SHARE = 0.05
"""From this share of validation samples outside the training range on, a warning says
so.
"""

Errors = Mapping[tuple[str, str, str], Mapping[str, ErrorMeasures]]
Constant = Mapping[str, Mapping[str, tuple[float, float]]]


@dataclass(frozen=True)
class Seen:
    """Velocities (n, 6) and sums of the measured force and its square (6,) of the
    segments of one use.
    """

    parts: tuple[Array, ...] = field(default=())
    force: Array = field(default_factory=lambda: np.zeros(6))
    square: Array = field(default_factory=lambda: np.zeros(6))

    def add(self, nu: Array, force: Array) -> Seen:
        return Seen(
            (*self.parts, nu),
            self.force + force.sum(axis=0),
            self.square + np.square(force).sum(axis=0),
        )

    @property
    def nu(self) -> Array:
        return np.concatenate(self.parts)


def total_errors_of(
    sums: Mapping[tuple[str, str, str], ErrorAccumulator],
) -> dict[tuple[str, str, str], Mapping[str, ErrorMeasures]]:
    """Measures per use, leg and model, and of all legs of a use together, these first."""
    together: dict[tuple[str, str, str], ErrorAccumulator] = {}
    for (use, _, model), part in sums.items():
        together[(use, ALL, model)] = together.get((use, ALL, model), ErrorAccumulator()).merge(
            part
        )
    return {group: total.table() for group, total in (together | dict(sums)).items()}


def error_rows(errors: Errors, cards: Mapping[str, Document]) -> pa.Table:
    rows: dict[str, list[Any]] = {
        name: [] for name in ("use", "leg", "model", "axis", "n_bar", "rank", "samples")
    }
    rows |= {name: [] for name in ("sse", "mae", "mse", "rms", "mad", "j0", "ratio")}
    for (use, leg, model), measures in errors.items():
        for axis, found in measures.items():
            counts = _counts(cards[model], axis)
            values: tuple[Any, ...] = (
                use,
                leg,
                model,
                ALL if axis == TOTAL else axis,
                *counts,
                found.n,
            )
            values += (
                found.sse,
                found.mae,
                found.mse,
                found.rms,
                found.mad,
                found.j0,
                found.normalised,
            )
            for name, value in zip(rows, values, strict=True):
                rows[name].append(value)
    return make_table("error_table", rows)


def _counts(card: Document, axis: str) -> tuple[int, int]:
    if axis == TOTAL:
        return int(card["n_bar"]), int(card["rank"])
    part = card["axes"].get(axis)
    return (len(part["terms"]), int(part["rank"])) if part else (0, 0)


def metrics(errors: Errors) -> dict[str, Any]:
    metrics: dict[str, Any] = {"training": {}, "validation": {}}
    for (use, leg, model), measures in errors.items():
        if leg == ALL:
            ratios = {
                axis: _digits(found.normalised) for axis, found in measures.items() if axis != TOTAL
            }
            metrics[use][model] = {
                "J": _digits(measures[TOTAL].rms),
                "ratio": _digits(measures[TOTAL].normalised),
                **ratios,
            }
    return metrics


def _digits(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None


def constant_alone(seen: Mapping[str, Seen]) -> dict[str, dict[str, tuple[float, float]]]:
    """J and J/J0 per use and axis (and in total) of the mean training force, the least
    that a model with a constant must beat.
    """
    if "training" not in seen:
        return {}
    mean = seen["training"].force / len(seen["training"].nu)
    found = {}
    for use, part in seen.items():
        n = len(part.nu)
        j0 = np.sqrt(part.square / n)
        j = np.sqrt(np.maximum(part.square / n - 2.0 * mean * part.force / n + mean**2, 0.0))
        both = {axis: (float(j[index]), float(j0[index])) for index, axis in enumerate(AXES)}
        both[TOTAL] = (float(np.sqrt(np.mean(j**2))), float(np.sqrt(np.mean(j0**2))))
        found[use] = {
            axis: (top, top / bottom if bottom > 0 else float("nan"))
            for axis, (top, bottom) in both.items()
        }
    return found


def verdicts(
    errors: Errors, cards: Mapping[str, Document], constant: Constant, failed: float
) -> list[dict[str, Any]]:
    """One warning that names all models that fail on an axis, with their J/J0; a note
    per model that a constant force equals.
    """
    found, failing = [], []
    alone = constant.get("validation", {})
    judged = {
        model: errors[("validation", ALL, model)]
        for model in cards
        if ("validation", ALL, model) in errors
    }
    for model, measures in judged.items():
        title, ratios = cards[model]["title"], {axis: measures[axis].normalised for axis in AXES}
        bad = [f"{axis} {ratio:.2f}" for axis, ratio in ratios.items() if ratio > failed]
        if bad:
            failing.append(f"{title} ({', '.join(bad)})")
        idle = [
            f"{axis} ({ratio:.2f} against {alone[axis][1]:.2f})"
            for axis, ratio in ratios.items()
            if cards[model]["trim"]
            and axis in alone
            and ratio >= alone[axis][1]
            and min(ratio, measures[TOTAL].normalised) <= failed
        ]
        if idle:
            found.append(
                remark(
                    f"{title} predicts no better than a constant force alone in {', '.join(idle)}.",
                    "note",
                )
            )
    if failing:
        count = (
            "All models"
            if len(failing) == len(judged) > 1
            else f"{len(failing)} of {len(judged)} models"
        )
        reason = (
            "the error exceeds the force itself"
            if failed == FAILED_RATIO
            else f"J/J0 exceeds {failed:g}"
        )
        found.insert(
            0,
            remark(
                f"{count} fail in some axes on validation, where {reason} (J/J0):"
                f" {'; '.join(failing)}.",
                "warning",
            ),
        )
    return found


def error_blocks(
    errors: Errors, cards: Mapping[str, Document], constant: Constant
) -> list[dict[str, Any]]:
    blocks = []
    for use in USES:
        groups = {
            model: measures
            for (kind, leg, model), measures in errors.items()
            if kind == use and leg == ALL
        }
        if not groups:
            continue
        rows: list[list[Any]] = []
        detail: list[list[Any]] = []
        for model, measures in groups.items():
            total, card = measures[TOTAL], cards[model]
            ratios = (measures[axis].normalised for axis in AXES)
            rows.append(
                [card["title"], card["n_bar"], card["rank"], total.rms, total.normalised, *ratios]
            )
            detail.append(
                [
                    card["title"],
                    total.j0,
                    total.sse,
                    total.mae,
                    total.mse,
                    total.mad,
                    *(measures[axis].rms for axis in AXES),
                ]
            )
        if use in constant:
            j, ratio = constant[use][TOTAL]
            rows.append(
                [CONSTANT_TITLE, 0, 0, j, ratio, *(constant[use][axis][1] for axis in AXES)]
            )
        heads = ["model", "n-bar", "rank", "J", "J/J0", *(f"J/J0 {axis}" for axis in AXES)]
        j0 = next(iter(groups.values()))
        note = "Totals mix N and N m, as the thesis has them. J0: "
        note += ", ".join(f"{axis} {j0[axis].j0:.3g} {AXIS_UNITS[axis]}" for axis in AXES) + "."
        if use in constant:
            note += (
                " The last row is no model but the reference: the mean force of the training legs"
                " and nothing else."
            )
        blocks.append(
            table(
                f"{use.capitalize()} errors, in the layout of {LAYOUT[use]}", heads, rows, note=note
            )
        )
        units = [(f"J {axis}", AXIS_UNITS[axis]) for axis in AXES]
        note = (
            "Over all six axes together, N and N m mixed; MAD is the sum of the medians of the six"
            " axes."
        )
        columns: list[str | tuple[str, str]] = ["model", "J0", "SSE", "MAE", "MSE", "MAD", *units]
        blocks.append(
            table(f"{use.capitalize()}: all measures (4.22)-(4.27)", columns, detail, note=note)
        )
    legs = sorted({(use, leg) for use, leg, _ in errors if leg != ALL})
    if len(legs) > 1:
        rows = [
            [
                cards[model]["title"],
                *(errors[(use, leg, model)][TOTAL].normalised for use, leg in legs),
            ]
            for model in cards
        ]
        blocks.append(
            table("J/J0 of every leg", ["model", *(f"{leg} ({use})" for use, leg in legs)], rows)
        )
    return blocks


def range_blocks(seen: Mapping[str, Seen]) -> list[dict[str, Any]]:
    """The range of each velocity in training and in validation, and a warning where the
    models have to extrapolate.
    """
    if not {"training", "validation"} <= set(seen):
        return []
    fitted, judged = seen["training"].nu, seen["validation"].nu
    low, high = fitted.min(axis=0), fitted.max(axis=0)
    outside = np.mean((judged < low) | (judged > high), axis=0)
    rows, far = [], []
    for index, name in enumerate("uvwpqr"):
        unit = "m/s" if index < 3 else "rad/s"
        span = (judged[:, index].min(), judged[:, index].max())
        rows.append([name, unit, low[index], high[index], *span, 100.0 * outside[index]])
        if outside[index] >= OUTSIDE_SHARE:
            far.append(
                f"{name} ({100.0 * outside[index]:.0f} % of the time, {span[0]:.2g} to"
                f" {span[1]:.2g} {unit})"
            )
    heads: list[str | tuple[str, str]] = [
        "velocity",
        "unit",
        "training lowest",
        "highest",
        "validation lowest",
        "highest",
        ("outside", "%"),
    ]
    blocks = [table("Range of motion: fitted in, judged in", heads, rows)]
    if far:
        words = (
            f"The validation legs leave the range of the training legs in {', '.join(far)}: there"
            " every model extrapolates."
        )
        blocks.insert(0, remark(words, "warning"))
    return blocks


def tables_as_text(errors: Errors, cards: Mapping[str, Document], constant: Constant) -> str:
    """The tables as plain text, in the layout of McCarter 5.1 and 5.2 with per-axis
    columns.
    """
    lines: list[str] = []
    width = max(
        len(title)
        for title in ("model", CONSTANT_TITLE, *(str(card["title"]) for card in cards.values()))
    )
    for use in USES:
        groups = {
            model: measures
            for (kind, leg, model), measures in errors.items()
            if kind == use and leg == ALL
        }
        if not groups:
            continue
        total = next(iter(groups.values()))[TOTAL]
        lines += [
            (
                f"{use.capitalize()} ({LAYOUT[use]}), J0 = {total.j0:.3f} (N and N m mixed); right"
                " of J/J0 the same per axis"
            ),
            "",
        ]
        lines.append(
            f"{'model':<{width}}{'n-bar':>6}{'rank':>6}{'J':>10}{'J/J0':>9}"
            + "".join(f"{axis:>9}" for axis in AXES)
        )

        def line(title: str, n_bar: int, rank: int, j: float, ratios: Sequence[float]) -> str:
            return f"{title:<{width}}{n_bar:>6}{rank:>6}{j:10.3f}" + "".join(
                f"{ratio:9.3f}" for ratio in ratios
            )

        for model, measures in groups.items():
            card, ratios = cards[model], [measures[axis].normalised for axis in (TOTAL, *AXES)]
            lines.append(
                line(card["title"], card["n_bar"], card["rank"], measures[TOTAL].rms, ratios)
            )
        if use in constant:
            alone = constant[use]
            lines.append(
                line(
                    CONSTANT_TITLE,
                    0,
                    0,
                    alone[TOTAL][0],
                    [alone[axis][1] for axis in (TOTAL, *AXES)],
                )
            )
        lines.append("")
    return "\n".join(lines)
