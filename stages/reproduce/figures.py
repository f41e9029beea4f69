"""The figures of the thesis that a twin can give, numbered as there."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.stages.base import Document
from auvid.stages.columns import (
    ACCELERATION,
    ACCELEROMETER,
    ATTITUDE,
    AXIS_UNITS,
    POSE,
    VELOCITY,
    clock,
    force_columns,
    forces,
)
from auvid.stages.presentation import Block, panel, plot, section, series
from auvid.stages.reproduce.artefacts import Artefacts

MODEL_FIGURES = {
    "mcfarland": "5.8",
    "pitch_yaw": "5.9",
    "gertler_hagen": "5.10",
    "linear": "5.11",
    "coe": "5.12",
    "prestero": "5.13",
    "uncoupled": "5.14",
    "fossen": "5.15",
}
"""Number of the figure that shows the force of a model: the order of Tables 5.1 and
5.2.
"""
LEG_ROLES = ("fused", "predicted", "measured", "difference")
UNITS = {
    "m": "m",
    "rad": "rad",
    "m_s": "m/s",
    "rad_s": "rad/s",
    "m_s2": "m/s^2",
    "rad_s2": "rad/s^2",
}


def figure_sections(inputs: Artefacts, document: Document) -> dict[str, dict[str, Any]]:
    """Return the sections with the figures.

    Raises `CampaignError` for a leg that the first plan does not have.
    """
    plan = str(document["plans"][0]["id"])
    published, corrected = (
        f"{plan}/{document['compared'][role]}" for role in ("published", "corrected")
    )
    label = {entry["id"]: f"({entry['label']})" for entry in document["variants"]}
    segments = {
        key.rpartition("/")[2]: inputs.segment[key]
        for key in inputs.segment
        if key.startswith(f"{published}/")
    }
    chosen = document.get("figures") or {}
    processed = _leg(segments, chosen, "processed", "validation")
    judged = _leg(segments, chosen, "forces", "validation")
    labels = (label[document["compared"]["published"]], label[document["compared"]["corrected"]])
    return {
        "coupling": section(
            "Figure 1.2: roll and pitch coupling",
            [_coupling(inputs, _coupling_key(inputs, document, published, segments))],
            order=20,
            look_for=(
                "Steps in heading make the vehicle roll and pitch, the more the larger they are."
            ),
        ),
        "processed": section(
            "Figures 5.1 to 5.4: raw against processed",
            _processed(inputs, f"{published}/{processed}", f"{corrected}/{processed}", labels),
            order=21,
            look_for=(
                f"Leg {processed}. In a turn the sway of {labels[0]} leaves what was measured; that"
                f" of {labels[1]} does not."
            ),
        ),
        "data": section(
            "Figures 5.5 to 5.7: training and validation data",
            _data(inputs, corrected, segments),
            order=22,
            look_for=(
                "Velocities of the legs that models are fitted to, and of those that judge them."
            ),
        ),
        "wrong": section(
            "The residual force, right and wrong",
            [_measured_forces(inputs, document, plan, judged)],
            order=23,
            look_for=(
                f"Leg {judged}: sway force Y and yaw moment N of {labels[0]} against the truth."
            ),
        ),
        "models": section(
            "Figures 5.8 to 5.15: force of each model against measurement",
            _models(inputs, published, judged, labels[0]),
            order=24,
            look_for=(
                f"Leg {judged}, fitted and measured with {labels[0]}. Uncoupled and Fossen miss the"
                " force in sway and yaw."
            ),
        ),
    }


def _leg(
    segments: Mapping[str, SegmentRecord], chosen: Mapping[str, Any], figure: str, use: str
) -> str:
    """Return the first segment of the leg that the document names, else of the use."""
    leg_name = chosen.get(figure)
    for name, segment in segments.items():
        if segment.leg == leg_name or (leg_name is None and segment.use == use):
            return name
    legs = list(dict.fromkeys(segment.leg for segment in segments.values()))
    raise CampaignError(
        "the first plan has no such leg",
        field=f"figures.{figure}",
        value=leg_name or use,
        allowed=legs,
    )


def _coupling_key(
    inputs: Artefacts, document: Document, published: str, segments: Mapping[str, SegmentRecord]
) -> str:
    """Return the segment of Figure 1.2 as `plan/variant/segment`.

    Another plan is looked at through its first variant.
    """
    coupling = str((document.get("figures") or {}).get("coupling", ""))
    if "/" not in coupling:
        return (
            f"{published}/{_leg(segments, document.get('figures') or {}, 'coupling', 'training')}"
        )
    plan, leg = coupling.split("/", 1)
    keys = [
        key
        for key in inputs.segment
        if key.startswith(f"{plan}/") and inputs.segment[key].leg == leg
    ]
    if not keys:
        raise CampaignError(
            "no such leg of a plan was flown", field="figures.coupling", value=coupling
        )
    return keys[0]


def _coupling(inputs: Artefacts, key: str) -> Block:
    plan, variant, leg = key.split("/")
    truth = inputs.truth[f"{plan}/{variant}/{inputs.segment[key].log}"]
    fused = inputs.resampled[key]
    start = float(inputs.segment[key].leg_start_s)
    inside = (clock(truth) >= start) & (clock(truth) <= start + clock(fused)[-1])
    t_true, t = clock(truth)[inside] - start, clock(fused)
    # A heading is logged within one turn; which one it starts in says nothing.
    turns = {
        name: _turns(column(fused, name)[0] - column(truth, name)[inside][0]) for name in ATTITUDE
    }
    panels = [
        panel(
            words,
            "deg",
            [
                series("measured", t, np.degrees(column(fused, name) - turns[name]), "measured"),
                series("true", t_true, np.degrees(column(truth, name)[inside]), "true"),
            ],
        )
        for words, name in (("heading", "psi_rad"), ("roll", "phi_rad"), ("pitch", "theta_rad"))
    ]
    return plot(f"Growing steps in heading, leg {leg} of plan {plan}", panels, group="coupling")


def _turns(angle: float) -> float:
    """Return the whole turns in an angle [rad]."""
    return 2.0 * np.pi * round(angle / (2.0 * np.pi))


def _processed(
    inputs: Artefacts, published: str, corrected: str, labels: tuple[str, str]
) -> list[Block]:
    raw = inputs.resampled[published]
    fused = [
        (label, inputs.fused[key], role)
        for label, key, role in zip(
            labels, (published, corrected), ("predicted", "fused"), strict=True
        )
    ]
    blocks = []
    for number, title, names, source in (
        ("5.1", "depth and attitude", (POSE[2], *ATTITUDE), (POSE[2], *ATTITUDE)),
        ("5.2", "velocity", VELOCITY[:3], VELOCITY[:3]),
        ("5.3", "angular rates", VELOCITY[3:], VELOCITY[3:]),
        ("5.4", "rates of change of velocity", ACCELERATION[:3], ACCELEROMETER),
    ):
        panels = []
        for name, sensed in zip(names, source, strict=True):
            lines = []
            # Gravity is in the logged accelerometer: drawn only where it does not drown
            # the rest.
            if has_columns(raw, (sensed,)) and sensed not in ACCELEROMETER:
                lines.append(series("raw", clock(raw), column(raw, sensed), "raw"))
            lines += [
                series(f"processed {label}", clock(table), column(table, name), role)
                for label, table, role in fused
            ]
            panels.append(panel(_symbol(name), _unit(name), lines))
        blocks.append(plot(f"Figure {number}: {title}", panels, group="processed"))
    return blocks


def _symbol(name: str) -> str:
    words = name.split("_")
    return " ".join(words[:2]) if words[1] == "dot" else words[0]


def _unit(name: str) -> str:
    return UNITS[name.partition("_dot_")[2] or name.partition("_")[2]]


def _data(inputs: Artefacts, variant: str, segments: Mapping[str, SegmentRecord]) -> list[Block]:
    groups: dict[str, list[str]] = {}
    for name, segment in segments.items():
        kind = "depth steps" if name.startswith("depth") else "heading steps"
        groups.setdefault(
            "validation legs" if segment.use == "validation" else f"training legs, {kind}", []
        ).append(name)
    blocks = []
    for number, (title, names) in zip(
        ("5.5", "5.6", "5.7"), sorted(groups.items(), key=lambda item: item[0]), strict=False
    ):
        tables = {name: inputs.fused[f"{variant}/{name}"] for name in names}
        panels = [
            panel(_symbol(column_name), _unit(column_name), _joined(tables, column_name))
            for column_name in VELOCITY
        ]
        blocks.append(
            plot(
                f"Figure {number}: {title}",
                panels,
                look_for=f"{', '.join(names)}, one after the other.",
            )
        )
    return blocks


def _joined(tables: Mapping[str, pa.Table], name: str) -> list[dict[str, Any]]:
    """One line per leg, the legs after one another with a pause of 3 s."""
    lines, start = [], 0.0
    for (leg, table), role in zip(tables.items(), cycle(LEG_ROLES), strict=False):
        t = clock(table) - clock(table)[0] + start
        lines.append(series(leg, t, column(table, name), role))
        start = float(t[-1]) + 3.0
    return lines


def _measured_forces(inputs: Artefacts, document: Document, plan: str, leg: str) -> Block:
    lines: dict[str, list[dict[str, Any]]] = {axis: [] for axis in AXES}
    roles = ("predicted", "fused", "resampled", "measured", "difference")
    for entry, role in zip(document["variants"], roles, strict=False):
        key = f"{plan}/{entry['id']}/{leg}"
        if entry.get("states") == "truth" or key not in inputs.residual:
            continue
        residual = inputs.residual[key]
        _add(
            lines,
            f"({entry['label']})",
            clock(residual) + float(inputs.segment[key].leg_start_s),
            forces(residual, "tau_bar"),
            role,
        )
    published = f"{plan}/{document['compared']['published']}"
    segment = inputs.segment[f"{published}/{leg}"]
    truth = inputs.truth[f"{published}/{segment.log}"]
    start = float(segment.leg_start_s)
    inside = (clock(truth) >= start) & (clock(truth) <= start + float(segment.duration_s))
    _add(
        lines, "true", clock(truth)[inside], matrix(truth, force_columns("tau_bar"))[inside], "true"
    )
    return plot(
        f"Residual force of leg {leg}",
        [panel(axis, AXIS_UNITS[axis], lines[axis]) for axis in AXES],
        group="force",
    )


def _add(
    lines: dict[str, list[dict[str, Any]]], name: str, t_s: Array, force: Array, role: str
) -> None:
    for index, axis in enumerate(AXES):
        lines[axis].append(series(name, t_s, force[:, index], role))


def _models(inputs: Artefacts, variant: str, leg: str, label: str) -> list[Block]:
    key = f"{variant}/{leg}"
    residual, predictions = inputs.residual[key], inputs.predictions[key]
    measured, t = forces(residual, "tau_bar"), clock(residual)
    names = column_strings(predictions, "model")
    blocks = []
    for model, number in MODEL_FIGURES.items():
        rows = np.flatnonzero(names == model)
        if not rows.size:
            continue
        force, title = (
            matrix(predictions, force_columns("tau"))[rows],
            str(inputs.model_card[f"{variant}/{model}"].title),
        )
        panels = [
            panel(
                axis,
                AXIS_UNITS[axis],
                [
                    series(f"measured {label}", t, measured[:, index], "measured"),
                    series(title, t, force[:, index], model),
                ],
            )
            for index, axis in enumerate(AXES)
        ]
        blocks.append(plot(f"Figure {number}: {title}", panels, group="models"))
    return blocks


def column_strings(table: pa.Table, name: str) -> np.ndarray[Any, np.dtype[Any]]:
    """Return a column of text as an array of objects (n,)."""
    return np.array(table[name].to_pylist(), dtype=object)
