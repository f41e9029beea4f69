"""Differences between two runs: signals, coefficients and named figures.

Signals are compared on the clock of the leg; where the clocks differ, the second is
interpolated linearly to the times of the first within their overlap, and nothing is
extrapolated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.stages.base import Document
from auvid.stages.columns import ATTITUDE, AXIS_UNITS, VELOCITY, force_columns, rms
from auvid.stages.reference_check import ReferenceCheck, Tolerance

STATE = (*VELOCITY, "z_m", *ATTITUDE)
UNITS = {"m_s": "m/s", "rad_s": "rad/s", "m": "m", "rad": "rad", "N": "N", "N_m": "N m"}
SAME_CLOCK_S = 1e-6
NAMED = 6
ROUNDING = 1e-9
"""Differences below this share of the largest signal of the same kind and unit are
rounding: a roll of 1e-16 rad is none.
"""
FORCE, MODEL = "residual force", "model"


@dataclass(frozen=True)
class Side:
    """One of two runs: its name, its documents and its tables by segment.

    `model` narrows it to one model.

    `viewed`: the signals that the views of a bench or control run name, by
    `place_of_view`.
    """

    name: str
    model: str | None = None
    segments: Mapping[str, SegmentRecord] = field(default_factory=dict)
    logs: Mapping[str, LogInfo] = field(default_factory=dict)
    cards: Mapping[str, ModelCard] = field(default_factory=dict)
    results: Mapping[str, Document] = field(default_factory=dict)
    fused: Mapping[str, pa.Table] = field(default_factory=dict)
    residual: Mapping[str, pa.Table] = field(default_factory=dict)
    predictions: Mapping[str, pa.Table] = field(default_factory=dict)
    viewed: Mapping[tuple[str, str], Signals] = field(default_factory=dict)


@dataclass(frozen=True)
class Signals:
    """Signals of one kind over one segment.

    Times (n,) in s on the clock of the log, values (n, k), a name and a unit for each.
    """

    times: Array
    values: Array
    names: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True)
class Pair:
    """Signals of both sides, and second less first at the times of both."""

    segment: str
    kind: str
    first: Signals
    second: Signals
    times: Array
    difference: Array


@dataclass(frozen=True)
class SignalChange:
    """How far one signal moved: RMS of the difference, held against a bound.

    Also the RMS of the first, and the largest difference with its time in s of the log.
    """

    segment: str
    kind: str
    rms: float
    largest: float
    at_s: float
    check: ReferenceCheck

    @property
    def document(self) -> dict[str, Any]:
        """Return the change as JSON."""
        place = {"segment": self.segment, "kind": self.kind, "rms": self.rms}
        return {**place, "largest": self.largest, "at_s": self.at_s, **self.check.document}


def signals_of(side: Side) -> dict[tuple[str, str], Signals]:
    """Return the signals of a side by segment and kind.

    Kinds are state, residual force, and the force of each model.

    A side that is narrowed to one model calls its force `model`, so that two different
    ones are partners.
    """
    signals = dict(side.viewed)
    for segment, document in side.segments.items():
        start = float(document.leg_start_s)
        if segment in side.fused:
            signals[segment, "state"] = _signals(side.fused[segment], STATE, start)
        if segment in side.residual and has_columns(
            side.residual[segment], force_columns("tau_bar")
        ):
            signals[segment, FORCE] = _signals(
                side.residual[segment], force_columns("tau_bar"), start, AXES
            )
        if segment in side.predictions:
            table = side.predictions[segment]
            for model in (
                pc.unique(table["model"]).to_pylist() if side.model is None else [side.model]
            ):
                kind = f"{MODEL} {model}" if side.model is None else MODEL
                rows = table.filter(pc.equal(table["model"], model))
                if rows.num_rows:
                    signals[segment, kind] = _signals(rows, force_columns("tau"), start, AXES)
    return signals


def _signals(
    table: pa.Table, columns: tuple[str, ...], start_s: float, names: tuple[str, ...] = ()
) -> Signals:
    short = names or tuple(name.split("_")[0] for name in columns)
    units = tuple(AXIS_UNITS[name] for name in names) or tuple(
        UNITS[name.partition("_")[2]] for name in columns
    )
    return Signals(column(table, "t_s") + start_s, matrix(table, columns), short, units)


def place_of_view(group: Document) -> tuple[str, str]:
    """Return what a group of a view belongs to (leg, swing, flight) and what it shows.

    `rlse/dive/mass/history` -> dive, mass history.
    """
    parts = str(group["entity"]).split("/")
    own = parts[1:] if len(parts) > 2 else parts
    return own[0], " ".join(own[1:])


def signals_of_view(group: Document, table: pa.Table) -> Signals | None:
    """Return the series of a group of a view on their own clock.

    None for a table without a clock, or where no samples are left.
    """
    columns = tuple(map(str, group["columns"]))
    if not has_columns(table, ("t_s", *columns)):
        return None
    for name, value in (group.get("filter") or {}).items():
        table = table.filter(pc.equal(table[name], value))
    if not table.num_rows:
        return None
    names, unit = tuple(map(str, group["names"])), str(group["unit"])
    return Signals(column(table, "t_s"), matrix(table, columns), names, (unit,) * len(names))


def pairs(first: Side, second: Side) -> tuple[list[Pair], list[str]]:
    """The signals that both sides have, and sentences on those that have no partner."""
    one, two = signals_of(first), signals_of(second)
    matched, unmatched = [], []
    for segment, kind in (key for key in one if key in two):
        pair = _pair(segment, kind, one[segment, kind], two[segment, kind])
        if pair is None:
            unmatched.append(f"{segment}: {kind} at no common time")
        else:
            matched.append(pair)
    only_one_side = [
        *_only_here([key for key in one if key not in two], first),
        *_only_here([key for key in two if key not in one], second),
    ]
    return matched, [*only_one_side, *unmatched]


def _only_here(keys: Sequence[tuple[str, str]], side: Side) -> list[str]:
    """A sentence for each segment, model or stage on what of it one side has alone."""
    names: dict[str, list[str]] = {}
    for of, name in keys:
        names.setdefault(of, []).append(name)
    return [
        f"{of}:"
        f" {', '.join(few[:NAMED])}{f' and {len(few) - NAMED} more' if len(few) > NAMED else ''}"
        f" only in {side.name}"
        for of, few in names.items()
    ]


def _pair(segment: str, kind: str, first: Signals, second: Signals) -> Pair | None:
    same = first.times.size == second.times.size and bool(
        np.all(np.abs(first.times - second.times) < SAME_CLOCK_S)
    )
    if same:
        return Pair(segment, kind, first, second, first.times, second.values - first.values)
    if not first.times.size or not second.times.size:
        return None
    inside = (first.times >= second.times[0]) & (first.times <= second.times[-1])
    times = first.times[inside]
    if not times.size:
        return None
    moved = np.column_stack([np.interp(times, second.times, values) for values in second.values.T])
    return Pair(segment, kind, first, second, times, moved - first.values[inside])


def signal_changes(matched: list[Pair], relative: float) -> list[SignalChange]:
    """Return how far each signal of each pair moved.

    The bound is a share of the signal's RMS, or of the largest of its kind: rounding.
    """
    changes = []
    for pair in matched:
        parts = []
        for place, (name, unit) in enumerate(zip(pair.first.names, pair.first.units, strict=True)):
            change, values = pair.difference[:, place], pair.first.values[:, place]
            good = np.isfinite(change)
            if good.any():
                sizes = rms(values[np.isfinite(values)]), rms(change[good])
                parts.append((name, unit, *sizes, int(np.nanargmax(np.abs(change))), place))
        for name, unit, size, moved, at, place in parts:
            largest = max(max(item[2:4]) for item in parts if item[1] == unit)
            bound = max(relative * size, ROUNDING * largest)
            changes.append(
                SignalChange(
                    pair.segment,
                    pair.kind,
                    size,
                    float(abs(pair.difference[at, place])),
                    float(pair.times[at]),
                    ReferenceCheck(name, moved, unit, high=bound),
                )
            )
    return changes


def coefficient_changes(
    first: Side, second: Side, relative: float
) -> tuple[list[tuple[tuple[str], ReferenceCheck]], list[str]]:
    """Return coefficients and figures of both sides, the second against the first.

    Each after its model or stage, and met within a share of the first with the same
    verdict. Also returns sentences on those that have no partner.
    """
    one, two = _figures(first), _figures(second)
    changes = []
    for of, name in (key for key in one if key in two):
        old, new = one[of, name], two[of, name]
        check = ReferenceCheck(
            name,
            new["value"],
            str(old.get("unit") or "1"),
            reference=old["value"],
            tolerance=Tolerance(relative=relative),
            standard_error=new.get("standard_error"),
            reference_error=old.get("standard_error"),
            status=str(new.get("verdict") or ""),
            required_status=str(old.get("verdict") or ""),
        )
        changes.append(((of,), check))
    return changes, [
        *_only_here([key for key in one if key not in two], first),
        *_only_here([key for key in two if key not in one], second),
    ]


def _figures(side: Side) -> dict[tuple[str, str], Document]:
    """Return (model or stage, name) -> coefficient or figure.

    A side that is narrowed to one model has that one only, called `model`.
    """
    figures: dict[tuple[str, str], Document] = {}
    for name, card in side.cards.items():
        if side.model in (None, name):
            of = f"{MODEL} {name}" if side.model is None else MODEL
            figures |= {
                (of, f"{axis} {term.term}"): term.model_dump()
                for axis, fit in card.axes.items()
                for term in fit.terms
            }
    if side.model is None:
        for name, document in side.results.items():
            figures |= {(name, str(row["quantity"])): row for row in document["rows"]}
    return figures
