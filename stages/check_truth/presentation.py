"""Presentation of the comparison with the truth: section, plots, views."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from auvid.data_schemas.records.motion import SegmentRecord
from auvid.hydro.arrays import AXES, Array
from auvid.stages.check_truth.errors import Errors
from auvid.stages.columns import ATTITUDE, AXIS_UNITS, VELOCITY, force_columns
from auvid.stages.presentation import Block, panel, plot, remark, section, series, table, text
from auvid.stages.reference_check import JUDGED, ReferenceCheck, check_rows, count_bounds

MODEL = "model "


def trust_section(
    errors: Errors,
    check_results: Sequence[ReferenceCheck],
    plots: Sequence[Block],
    titles: Mapping[str, str],
) -> dict[str, Any]:
    """Bounds, error tables and plots; `titles`: model -> name as printed."""
    missed = [check for check in check_results if not check.met]
    blocks: list[Block] = [
        remark(f"Against the truth of the twin: {check.quantity}: {check.shortfall}.", "warning")
        for check in missed
    ]
    if check_results and not missed:
        blocks.append(remark(f"Bounds of this campaign: {count_bounds(check_results)}.", "finding"))
    if not check_results:
        blocks.append(
            text("This campaign sets no bounds (stage check_truth); errors are listed as they are.")
        )
    else:
        rows = check_rows((), [((), check) for check in check_results], JUDGED)
        blocks.append(table("Bounds of this campaign", *rows))
    blocks += [*_states(errors), *_models(errors, titles), *plots]
    words = (
        "Whether the truth lies under the estimate; the rest is the error of sensors and method."
    )
    return section("Estimate against truth", blocks, order=12, look_for=words)


def _states(errors: Errors) -> Iterable[Block]:
    rows = []
    for (quantity, axis), unit in errors.units().items():
        if not quantity.startswith(MODEL):
            error = errors.over_legs(quantity)[axis]
            mean = None if axis == "all" else error.mean
            rows.append([quantity, axis, error.rms_true, error.rms, mean, error.largest, unit])
    note = (
        "Over all legs. Velocity is that of the body origin; a bias counts once per segment; force"
        " is the residual force tau_bar."
    )
    yield table(
        "State, force and biases: estimate minus truth",
        ["quantity", "axis", "RMS of truth", "RMS error", "mean error", "largest", "unit"],
        rows,
        note=note,
    )


def _models(errors: Errors, titles: Mapping[str, str]) -> Iterable[Block]:
    models = list(
        dict.fromkeys(quantity for quantity, _ in errors.units() if quantity.startswith(MODEL))
    )
    rows = []
    for use in ("validation", "training"):
        for quantity in models:
            by_axis = errors.over_legs(quantity, use=use)
            if by_axis:
                ratios = [
                    _ratio(by_axis[axis].rms, by_axis[axis].rms_true) for axis in ("all", *AXES)
                ]
                rows.append(
                    [titles[quantity.removeprefix(MODEL)], use, by_axis["all"].rms, *ratios]
                )
    note = (
        "J and J/J0 with the true force in place of the residual one: what a model gets wrong,"
        " without the errors of the sensors."
    )
    yield table(
        "Models against the true force",
        ["model", "legs", ("J", "N, N m"), "J/J0", *(f"J/J0 {axis}" for axis in AXES)],
        rows,
        note=note,
    )


def _ratio(error: float, size: float) -> float | None:
    return error / size if size > 0 else None


def comparison_plots(
    segment: SegmentRecord, t_s: Array, estimate: Array, true: Array
) -> Iterable[Block]:
    """Return plots of a segment, estimate over truth, on the log's clock.

    Velocity and residual force (n, 12).
    """
    t = t_s + float(segment.leg_start_s)
    symbols = [
        *(
            (name[0], "m/s" if index < 3 else "rad/s", "fused")
            for index, name in enumerate(VELOCITY)
        )
    ]
    symbols += [(axis, AXIS_UNITS[axis], "measured") for axis in AXES]
    panels = [
        panel(
            label,
            unit,
            [series(role, t, estimate[:, index], role), series("true", t, true[:, index], "true")],
        )
        for index, (label, unit, role) in enumerate(symbols)
    ]
    name = segment.id
    yield plot(
        f"Velocity of {name}: fused against true",
        panels[:6],
        group="time",
        look_for="A gap that lasts is a bias; noise is not.",
    )
    yield plot(
        f"Residual force of {name}: measured against true",
        panels[6:],
        group="time",
        look_for="What the models are fitted to, and what it should be.",
    )


def trust_views(segments: Iterable[str]) -> dict[str, Any]:
    """Return the truth beside the fused state and the residual force."""
    groups = []
    for key in segments:
        for entity, names, unit in (
            ("state/velocity", VELOCITY[:3], "m/s"),
            ("state/rates", VELOCITY[3:], "rad/s"),
            ("state/attitude", ATTITUDE, "rad"),
        ):
            groups.append(
                _group(
                    f"{entity}/true",
                    key,
                    names,
                    [name.split("_")[0] for name in names],
                    "State",
                    unit,
                )
            )
        for axis, name in zip(AXES, force_columns("tau_bar"), strict=True):
            groups.append(
                _group(f"residual/{axis}/true", key, (name,), [axis], "Answer", AXIS_UNITS[axis])
            )
    return {"groups": groups}


def _group(
    entity: str, key: str, columns: Sequence[str], symbols: Sequence[str], tab: str, unit: str
) -> dict[str, Any]:
    return {
        "entity": entity,
        "table": f"true_motion/{key}",
        "columns": list(columns),
        "names": [f"{symbol} true" for symbol in symbols],
        "roles": ["true"] * len(columns),
        "tab": tab,
        "unit": unit,
    }
