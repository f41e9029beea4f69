"""Judge every model on every segment: predicted forces and the error tables of McCarter 5.1 and 5.2, (4.22)-(4.27)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from data_schemas.errors import DataError
from data_schemas.tables import column, has_columns, make_table, matrix
from hydro.dynamics.viscous_models import IdentifiedModel
from hydro.identification.errors import TOTAL, ErrorAccumulator, ErrorMeasures
from stages.base import Collection, Document, Stage, param, port
from stages.sections import panel, plot, remark, section, series, table
from stages.signals import AXES, AXIS_UNITS, VELOCITY, Array, clock, force_columns, forces, named

USES = ("validation", "training")
LAYOUT = {"validation": "McCarter Table 5.1", "training": "McCarter Table 5.2"}
ALL = "all"
FAILED_RATIO = 1.0


@dataclass(frozen=True)
class Inputs:
    model_card: Collection[Document] = port("model_card", many=True)
    residual: Collection[pa.Table] = port("residual", many=True)
    segment: Collection[Document] = port("segment", many=True)


@dataclass(frozen=True)
class Params:
    failed_ratio: float = param(
        "1", FAILED_RATIO, meaning="a model fails on an axis where J/J0 on validation exceeds this", low=0.1, high=10.0
    )


@dataclass(frozen=True)
class Outputs:
    predictions: Mapping[str, pa.Table] = port("predictions", many=True)
    error_table: pa.Table = port("error_table")
    error_metrics: Document = port("error_metrics")
    tables_text: bytes = port("tables_text")
    section: Document = port("section")
    views: Document = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    cards = dict(inputs.model_card.items())
    models = [IdentifiedModel(name, card["solution"]) for name, card in cards.items()]
    trims = {name: np.array([card["solution"].get(axis, {}).get("constant", 0.0) for axis in AXES]) for name, card in cards.items()}
    sums: dict[tuple[str, str, str], ErrorAccumulator] = {}
    predictions, plots = {}, []
    for key, residual in inputs.residual.items():
        segment = inputs.segment[key]
        measured = forces(residual, "tau_bar")
        predicted = {model.name: predict(model, trims[model.name], residual) for model in models}
        predictions[key] = _prediction_table(key, clock(residual), predicted)
        for name, force in predicted.items():
            for leg in (ALL, str(segment["leg"])):
                group = (str(segment["use"]), leg, name)
                sums[group] = sums.get(group, ErrorAccumulator()).add(measured, force)
        if segment["use"] == "validation":
            plots.append(_prediction_plot(segment, clock(residual), measured, predicted))
    errors = {group: total.table() for group, total in sums.items()}
    if not any(use == "validation" for use, _, _ in errors):
        plots.append(remark("No validation leg: nothing says how far these models hold outside the data they were fitted on.", "warning"))
    blocks = [*_verdicts(errors, cards, params.failed_ratio), *_tables(errors, cards), *plots]
    return Outputs(
        predictions=predictions,
        error_table=_error_table(errors, cards),
        error_metrics=_metrics(errors),
        tables_text=_text(errors, cards).encode("utf-8"),
        section=section(
            "Validation", blocks, order=10, look_for="J/J0 near 0 explains the force; 1 explains nothing; above 1 is worse than no model."
        ),
        views=_views(inputs, cards),
    )


def predict(model: IdentifiedModel, trim: Array, residual: pa.Table) -> Array:
    """Force of a model at the velocities of a residual table: (n, 6), trim (6,) added."""
    ratio = column(residual, "eta_ratio") if has_columns(residual, ("eta_ratio",)) else None
    coefficients = {
        axis: {term: value for term, value in terms.items() if term != "constant"} for axis, terms in model.coefficients.items()
    }
    bare = IdentifiedModel(model.name, coefficients)
    if not bare.terms:
        return np.tile(trim, (residual.num_rows, 1))
    return np.asarray(bare.force(matrix_of_velocity(residual), ratio) + trim)


def matrix_of_velocity(residual: pa.Table) -> Array:
    """nu (n, 6) of a residual table."""
    return matrix(residual, VELOCITY)


def _prediction_table(key: str, t_s: Array, predicted: Mapping[str, Array]) -> pa.Table:
    if not predicted:
        raise DataError("there is no model to judge")
    n, stacked = t_s.size, np.vstack(list(predicted.values()))
    names = pa.array(np.repeat(list(predicted), n).tolist(), type=pa.string())
    columns = {"segment": pa.array([key] * len(names), type=pa.string()), "model": names, "t_s": np.tile(t_s, len(predicted))}
    return make_table("predictions", {**columns, **named(force_columns("tau"), stacked)})


Errors = Mapping[tuple[str, str, str], Mapping[str, ErrorMeasures]]


def _error_table(errors: Errors, cards: Mapping[str, Document]) -> pa.Table:
    rows: dict[str, list[Any]] = {name: [] for name in ("use", "leg", "model", "axis", "n_bar", "rank", "samples")}
    rows |= {name: [] for name in ("sse", "mae", "mse", "rms", "mad", "j0", "ratio")}
    for (use, leg, model), measures in errors.items():
        for axis, found in measures.items():
            counts = _counts(cards[model], axis)
            values: tuple[Any, ...] = (use, leg, model, ALL if axis == TOTAL else axis, *counts, found.n)
            values += (found.sse, found.mae, found.mse, found.rms, found.mad, found.j0, found.normalised)
            for name, value in zip(rows, values, strict=True):
                rows[name].append(value)
    return make_table("error_table", rows)


def _counts(card: Document, axis: str) -> tuple[int, int]:
    if axis == TOTAL:
        return int(card["n_bar"]), int(card["rank"])
    part = card["axes"].get(axis)
    return (len(part["terms"]), int(part["rank"])) if part else (0, 0)


def _metrics(errors: Errors) -> dict[str, Any]:
    metrics: dict[str, Any] = {"training": {}, "validation": {}}
    for (use, leg, model), measures in errors.items():
        if leg == ALL:
            ratios = {axis: _digits(found.normalised) for axis, found in measures.items() if axis != TOTAL}
            metrics[use][model] = {"J": _digits(measures[TOTAL].rms), "ratio": _digits(measures[TOTAL].normalised), **ratios}
    return metrics


def _digits(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None


def _verdicts(errors: Errors, cards: Mapping[str, Document], failed: float) -> list[dict[str, Any]]:
    found = []
    for model, card in cards.items():
        measures = errors.get(("validation", ALL, model))
        if measures is None:
            continue
        bad = [f"{axis} ({measures[axis].normalised:.2f})" for axis in AXES if measures[axis].normalised > failed]
        if bad:
            found.append(remark(f"{card['title']} fails on validation in {', '.join(bad)}: its error exceeds the force itself.", "warning"))
    return found


def _tables(errors: Errors, cards: Mapping[str, Document]) -> list[dict[str, Any]]:
    blocks = []
    for use in USES:
        groups = {model: measures for (kind, leg, model), measures in errors.items() if kind == use and leg == ALL}
        if not groups:
            continue
        totals = ["J0", "SSE", "MAE", "MSE", "MAD"]
        rows: list[list[Any]] = []
        detail: list[list[Any]] = []
        for model, measures in groups.items():
            total, card = measures[TOTAL], cards[model]
            rows.append(
                [card["title"], card["n_bar"], card["rank"], total.rms, total.normalised, *(measures[axis].normalised for axis in AXES)]
            )
            detail.append([card["title"], total.j0, total.sse, total.mae, total.mse, total.mad, *(measures[axis].rms for axis in AXES)])
        heads = ["model", "n-bar", "rank", "J", "J/J0", *(f"J/J0 {axis}" for axis in AXES)]
        j0 = next(iter(groups.values()))
        note = (
            "Totals mix N and N m, as the thesis has them. J0: "
            + ", ".join(f"{axis} {j0[axis].j0:.3g} {AXIS_UNITS[axis]}" for axis in AXES)
            + "."
        )
        blocks.append(table(f"{use.capitalize()} errors, in the layout of {LAYOUT[use]}", heads, rows, note=note))
        units = [(f"J {axis}", AXIS_UNITS[axis]) for axis in AXES]
        blocks.append(table(f"{use.capitalize()}: all measures (4.22)-(4.27)", ["model", *totals, *units], detail))
    legs = sorted({(use, leg) for use, leg, _ in errors if leg != ALL})
    if len(legs) > 1:
        rows = [[cards[model]["title"], *(errors[(use, leg, model)][TOTAL].normalised for use, leg in legs)] for model in cards]
        blocks.append(table("J/J0 of every leg", ["model", *(f"{leg} ({use})" for use, leg in legs)], rows))
    return blocks


def _text(errors: Errors, cards: Mapping[str, Document]) -> str:
    """The tables as plain text, in the layout of McCarter 5.1 and 5.2 with per-axis columns."""
    lines: list[str] = []
    for use in USES:
        groups = {model: measures for (kind, leg, model), measures in errors.items() if kind == use and leg == ALL}
        if not groups:
            continue
        total = next(iter(groups.values()))[TOTAL]
        lines += [f"{use.capitalize()} ({LAYOUT[use]}), J0 = {total.j0:.3f}", ""]
        lines.append(f"{'model':<16}{'n-bar':>6}{'rank':>6}{'J':>9}{'J/J0':>8}" + "".join(f"{axis:>8}" for axis in AXES))
        for model, measures in groups.items():
            cells = "".join(f"{measures[axis].normalised:8.3f}" for axis in AXES)
            head = f"{cards[model]['title']:<16}{cards[model]['n_bar']:>6}{cards[model]['rank']:>6}"
            lines.append(f"{head}{measures[TOTAL].rms:9.3f}{measures[TOTAL].normalised:8.3f}{cells}")
        lines.append("")
    return "\n".join(lines)


def _prediction_plot(segment: Document, t_s: Array, measured: Array, predicted: Mapping[str, Array]) -> dict[str, Any]:
    t = t_s + float(segment["leg_start_s"])
    panels = []
    for index, axis in enumerate(AXES):
        lines = [series("measured", t, measured[:, index], "measured")]
        lines += [series(name, t, force[:, index], name) for name, force in predicted.items()]
        panels.append(panel(axis, AXIS_UNITS[axis], lines))
    title = f"Force on {segment['id']}: every model against measurement (McCarter Figures 5.8-5.15)"
    return plot(title, panels, group="time", look_for="A model that follows the measured line here has not seen it before.")


def _views(inputs: Inputs, cards: Sequence[str] | Mapping[str, Document]) -> dict[str, Any]:
    groups = []
    for key in inputs.segment:
        for index, axis in enumerate(AXES):
            for model in cards:
                groups.append(
                    {
                        "entity": f"residual/{axis}/{model}",
                        "table": f"predictions/{key}",
                        "columns": [force_columns("tau")[index]],
                        "names": [f"{axis} {model}"],
                        "roles": [model],
                        "tab": "Answer",
                        "unit": AXIS_UNITS[axis],
                        "filter": {"model": model},
                    }
                )
    return {"groups": groups}


STAGE = Stage(
    "validate", "Predicted forces and error tables of every model, training and validation", "campaign", Inputs, Params, Outputs, run
)
