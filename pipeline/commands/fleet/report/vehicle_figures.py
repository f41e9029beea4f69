"""What the dives of each vehicle of a fleet agree on, from the tables of the fleet."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np

from auvid.hydro.arrays import Array, Ints, Mask
from auvid.hydro.identification.fleet.alarms import ChangeAlarm, change_alarms
from auvid.hydro.identification.fleet.drag import (
    common_drag,
    drag_at_speed,
    drag_terms,
    expected_scatters,
)
from auvid.hydro.identification.fleet.outlying import OutlyingDive, outlying_dives
from auvid.hydro.identification.fleet.pooling import PooledFigure, pool
from auvid.hydro.identification.fleet.thruster_strength import UNEVEN
from auvid.hydro.identification.fleet.trend import FEWEST_DIVES as FEWEST_OF_TREND
from auvid.hydro.identification.fleet.trend import Trend, clear_trends, trend
from auvid.pipeline.commands.fleet.fleet_tables import INSTALLATION, THRUSTERS, finite
from auvid.pipeline.commands.fleet.report.coefficient_columns import Coefficients
from auvid.stages.number_format import significant
from auvid.stages.page.first_screen import AXIS_WORDS
from auvid.stages.presentation import degrees

FIGURE_VERDICTS = ("identified", "persistently exciting")
MEASURED = (*FIGURE_VERDICTS, "weak", "inseparable")
"""Verdicts on what a dive measures. Which of them it is depends on the value itself, so
that the mean of dives that call it identified is too large: all are pooled.
"""
THRUSTER_VERDICTS = (*FIGURE_VERDICTS, *UNEVEN)
AT_BOUND = "at its bound"
"""Verdict on a term that is taken as it is: it has no error of its own."""
NOT_MEASURED = ("from the prior", "from the shelf", "from a bench", "not excited")
"""Verdicts on what is no dive's own: repeated, it would count as many measurements."""
FEWEST_DIVES = 2
"""Of a figure: with a number, and that call it identified."""
ALL_DRAGS = "drag of all axes over its mean"
DRAG_OF_AXIS = "drag in "
SHARES = {"all axes": 0.2, "each axis": 0.6, "others": 0.2}
"""Of the probability of false alarms: what fouls a hull shows in all axes (decision 0062), and
drag is looked for more than other figures (decisions 0072, 0079).
"""
RISES = 0.8
"""Part of a drag's that rises have: what fouls or loads a hull adds to it (decision 0079)."""
NONE_SINCE = "changed, and no dive since then measures it"
NO_ORDER = "changed, and the order of its dives is unknown"
UNKNOWN_SINCE = (NONE_SINCE, NO_ORDER)
"""Of a figure that changed: why nothing is told of the next dive."""
DAY_S = 86_400.0
CONDITIONS = {
    "firmware": "firmware",
    "board": "autopilot",
    "battery_v": "battery in V",
    "mean_depth_m": "mean depth in m",
    "format": "format",
}
"""Column of table `runs` -> its name on the page: what may make a dive differ."""
Row = dict[str, Any]


@dataclass(frozen=True)
class DiveFigure:
    """One figure of one vehicle over its dives in order of time.

    `values`, `errors` (k,): nan where a dive has none. `dives`: their logs, those without a
    place in time last. `watched`: whether changes and outlying dives are sought in it.
    `part_of`: figures that it changes with, where it shows no change of its own.
    """

    name: str
    unit: str
    dives: tuple[str, ...]
    values: Array
    errors: Array
    watched: bool = True
    part_of: tuple[str, ...] = ()


@dataclass(frozen=True)
class VehicleFigures:
    """What the dives of one vehicle agree on, and what changed.

    `since`: figure that changed -> place of the first dive after its last change: those
    from there on are pooled. `trends`: the clear ones of all vehicles, of figures without
    a change. `weak`: row of
    each thruster and dive where it gives less than those like it. `unseen`: thrusters of
    which no dive tells the strength, and why in words. `order_unknown`: dives
    without a place in time, in which no change and no trend is sought.
    """

    vehicle: str
    model: str
    figures: tuple[DiveFigure, ...]
    pooled: Mapping[str, PooledFigure]
    outlying: tuple[OutlyingDive, ...]
    alarms: tuple[ChangeAlarm, ...]
    trends: Mapping[str, Trend]
    weak: tuple[Row, ...]
    unseen: tuple[str, ...]
    since: Mapping[str, int]
    order_unknown: int = 0

    @property
    def dives(self) -> tuple[str, ...]:
        """Return the logs of its dives, by time."""
        return self.figures[0].dives if self.figures else ()

    @property
    def concerns(self) -> int:
        """Return how much speaks for a look at this vehicle."""
        return 3 * (len(self.alarms) + len(self.weak)) + len(self.trends) + len(self.outlying)


def vehicle_figures(
    coefficients: Coefficients, runs: Sequence[Row], *, by_name: bool = False
) -> list[VehicleFigures]:
    """Return the figures of each vehicle, of the model that most of its dives take.

    Dives are in order of their clocks. A name of a file is no time: one without a clock
    has no place, unless the user says that names are in order (`by_name`).
    """
    main = main_models(runs)
    without_axis = coefficients.among("axis", {""})
    vehicles = []
    for vehicle in sorted(coefficients.words["vehicle"]):
        model = main.get(vehicle, "")
        own = coefficients.among("vehicle", {vehicle})
        own &= without_axis | coefficients.among("model", {model})
        chosen = coefficients.where(own)
        logs = {chosen.words["log"][code] for code in np.unique(chosen.codes["log"])}
        dives = sorted((row for row in runs if row["log"] in logs), key=in_time(by_name))
        vehicles.append(_of_vehicle(vehicle, model, chosen, dives, by_name=by_name))
    clear = clear_trends(
        {(each.vehicle, name): item for each in vehicles for name, item in each.trends.items()}
    )
    return [
        replace(each, trends={
            name: item for name, item in each.trends.items() if (each.vehicle, name) in clear
        })
        for each in vehicles
    ]  # fmt: skip


def main_models(runs: Sequence[Row]) -> dict[str, str]:
    """Return vehicle -> the model that most of its dives take."""
    models: dict[str, Counter[str]] = defaultdict(Counter)
    for row in runs:
        if row["model"]:
            models[row["vehicle"]][row["model"]] += 1
    return {
        vehicle: min(counts, key=lambda name: (-counts[name], name))
        for vehicle, counts in models.items()
    }


def in_time(by_name: bool) -> Callable[[Row], tuple[bool, str, str]]:
    """Return the key by which runs are in order: by clock, or by name of the file."""

    def key(row: Row) -> tuple[bool, str, str]:
        clock = "" if by_name else row["start_utc"] or ""
        return not (clock or by_name), clock, row["file"]

    return key


def _of_vehicle(
    vehicle: str, model: str, rows: Coefficients, dives: Sequence[Row], *, by_name: bool
) -> VehicleFigures:
    """Return the figures of a vehicle; `trends`: all, clear or not."""
    figures = tuple(_figures(rows, dives))
    strengths = rows.where(rows.among("model", {THRUSTERS})).rows()
    series = {item.name: (item.values, item.errors) for item in figures}
    watched = {
        item.name: series[item.name]
        for item in figures
        if item.watched and np.isfinite(item.values).sum() > FEWEST_DIVES
    }
    placed = np.array([by_name or row["start_utc"] is not None for row in dives], dtype=bool)
    in_order = {
        name: (np.where(placed, values, np.nan), errors)
        for name, (values, errors) in watched.items()
    }
    alarms = alarms_of(in_order) if in_order else ()
    changes = {item.name: _changes(item, alarms) for item in figures}
    levels = {
        name: np.searchsorted(firsts, np.arange(len(dives)), side="right")
        for name, firsts in changes.items()
    }
    pooled = {
        name: _pooled(values, errors, levels[name], placed)
        for name, (values, errors) in series.items()
    }
    days = [_day(row) for row in dives]
    trends = {name: _trend(days, *pair) for name, pair in watched.items() if not changes[name]}
    return VehicleFigures(
        vehicle,
        model,
        figures,
        pooled,
        outlying_dives(watched, _conditions(dives), levels=levels) if watched else (),
        alarms,
        {name: item for name, item in trends.items() if item is not None},
        tuple(row for row in strengths if row["verdict"] in UNEVEN),
        tuple(_unseen(strengths)),
        {
            name: firsts[-1]
            for name, firsts in changes.items()
            if firsts and pooled[name].refusal not in UNKNOWN_SINCE
        },
        int((~placed).sum()),
    )


def alarms_of(figures: Mapping[str, tuple[Array, Array]]) -> tuple[ChangeAlarm, ...]:
    """Return the changes of figures over dives in order, by the shares of the page."""
    drags = [name for name in figures if name == ALL_DRAGS or name.startswith(DRAG_OF_AXIS)]
    axes = [name for name in drags if name != ALL_DRAGS]
    return change_alarms(
        figures,
        shares=alarm_shares(list(figures)),
        rises=dict.fromkeys(drags, RISES),
        expected=dict(
            zip(axes, expected_scatters([figures[name][0] for name in axes]), strict=True)
        ),
    )


def alarm_shares(names: Sequence[str]) -> dict[str, float]:
    """Return the share of each figure of the probability of false alarms, 1 in all.

    >>> alarm_shares(["drag in surge at 0.3 m/s", "X_u*v", "thruster 1"])["thruster 1"]
    0.14285714285714288
    """
    groups: dict[str, list[str]] = {group: [] for group in SHARES}
    for name in names:
        of_axis = name.startswith(DRAG_OF_AXIS)
        groups["all axes" if name == ALL_DRAGS else "each axis" if of_axis else "others"].append(
            name
        )
    total = sum(SHARES[group] for group, members in groups.items() if members)
    return {
        name: SHARES[group] / total / len(members)
        for group, members in groups.items()
        for name in members
    }


def _unseen(strengths: Sequence[Row]) -> Iterator[str]:
    """Yield the thrusters of which no dive tells the strength, and why."""
    verdicts: dict[str, Counter[str]] = defaultdict(Counter)
    for row in strengths:
        verdicts[row["term"]][row["verdict"] if row["value"] is None else ""] += 1
    for name, counts in sorted(verdicts.items()):
        if not counts[""]:
            why = ", ".join(f"{verdict} in {count}" for verdict, count in counts.most_common())
            yield f"{name} ({why})"


def _pooled(values: Array, errors: Array, levels: Ints, placed: Mask) -> PooledFigure:
    """Return what dives (k,) agree on; where it changed, those of the last level.

    placed (k,): dives with a place in time; the level of others is not certain.
    """
    numbers = np.isfinite(values) & np.isfinite(errors)
    if not levels.any():
        return pool(values, errors)
    in_order = numbers & placed
    if np.count_nonzero(in_order) < FEWEST_DIVES:
        return replace(pool(values, errors), next_dive=None, refusal=NO_ORDER)
    every = pool(np.where(in_order, values, np.nan), errors, levels=levels)
    if np.any(in_order & (levels == levels[placed].max())):
        return every
    return replace(every, next_dive=None, refusal=NONE_SINCE)


def _changes(item: DiveFigure, alarms: Sequence[ChangeAlarm]) -> list[int]:
    """Return the first dive of each new level of a figure, in order."""
    for name in (item.name, *item.part_of):
        firsts = sorted(alarm.first_dive for alarm in alarms if alarm.figure == name)
        if firsts:
            return firsts
    return []


def _figures(rows: Coefficients, dives: Sequence[Row]) -> Iterator[DiveFigure]:
    """Yield drag at a common speed, of all axes, then other figures of two dives.

    Two dives decide that a figure is shown; all dives that measure it count in it.
    """
    logs = tuple(row["log"] for row in dives)
    place = {log: index for index, log in enumerate(logs)}
    damping = {term for axis in AXIS_WORDS for term in drag_terms(axis)}
    drags = list(_drags(rows.where(rows.among("term", damping)).rows(), dives, place))
    yield from (item for _, item in drags)
    together = common_drag([(item.values, item.errors) for _, item in drags])
    if together is not None:
        yield DiveFigure(ALL_DRAGS, "1", logs, *together)
    within = {
        f"{axis}_{term}": (item.name, ALL_DRAGS)
        for axis, item in drags
        for term in drag_terms(axis)
    }
    place_of_code = np.array([place.get(log, -1) for log in rows.words["log"]], dtype=np.int64)
    strengths = rows.among("model", {THRUSTERS})
    measured = np.where(
        strengths, rows.among("verdict", THRUSTER_VERDICTS), rows.among("verdict", MEASURED)
    )
    error = rows.numbers["standard_error"]
    certain = measured & np.isfinite(rows.numbers["value"]) & np.isfinite(error) & (error > 0.0)
    for group in rows.where(certain).groups("model", "axis", "term"):
        of = group.where(group.codes["unit"] == group.codes["unit"][0])
        sure = of.among("model", {THRUSTERS}) | of.among("verdict", FIGURE_VERDICTS)
        if np.count_nonzero(sure) < FEWEST_DIVES:
            continue
        name = _name(of.texts("model")[0], of.texts("axis")[0], of.texts("term")[0])
        values, errors = np.full((2, len(logs)), np.nan)
        at = place_of_code[of.codes["log"]]
        values[at], errors[at] = of.numbers["value"], of.numbers["standard_error"]
        # Before intervals are written as text.
        factor, unit = degrees(of.texts("unit")[0])
        drag = within.get(name, ())
        yield DiveFigure(name, unit, logs, factor * values, factor * errors, not drag, drag)


def _name(model: str, axis: str, term: str) -> str:
    if axis:
        return f"{axis}_{term}"
    if model == THRUSTERS:
        return term
    return f"{'sensor' if model == INSTALLATION else model}: {term}"


def _drags(
    rows: Sequence[Row], dives: Sequence[Row], place: Mapping[str, int]
) -> Iterator[tuple[str, DiveFigure]]:
    """Yield each axis and its drag at the median speed of the dives.

    Linear and quadratic terms trade from dive to dive; their sum at a speed does not.
    """
    damping: dict[str, dict[str, list[Row]]] = {axis: defaultdict(list) for axis in AXIS_WORDS}
    terms_of = {axis: drag_terms(axis) for axis in AXIS_WORDS}
    for row in rows:
        # Terms of models without newtons are in other units.
        if row["term"] in terms_of.get(row["axis"], ()) and row["unit"].startswith(("N", "kg")):
            damping[row["axis"]][row["log"]].append(row)
    for axis, word in AXIS_WORDS.items():
        speeds = [row[f"speed_{word}"] for row in dives if finite(row[f"speed_{word}"])]
        if not speeds:
            continue
        speed = float(f"{np.median(speeds):.2g}")
        cells = {}
        for log, terms in damping[axis].items():
            if any(row["verdict"] in NOT_MEASURED for row in terms):
                continue
            sd = [_error(row) for row in terms]
            covariance = [
                [sd[i] ** 2 if i == j else 0.0 for j in range(len(sd))] for i in range(len(sd))
            ]
            if len(terms) == 2 and all(sd):
                share = terms[0]["correlation"]
                covariance[0][1] = covariance[1][0] = (
                    math.nan if share is None else share * sd[0] * sd[1]
                )
            drag = drag_at_speed(
                [row["term"] for row in terms],
                [np.nan if row["value"] is None else row["value"] for row in terms],
                covariance,
                axis=axis,
                speed=speed,
            )
            if drag is not None and drag.standard_error > 0.0:
                cells[place[log]] = drag.force, drag.standard_error
        if len(cells) >= FEWEST_DIVES:
            moment = axis in "KMN"
            name = f"{DRAG_OF_AXIS}{word} at {significant(speed)} {'rad/s' if moment else 'm/s'}"
            values, errors = _columns(cells, len(place))
            logs = tuple(place)
            unit = "N m" if moment else "N"
            yield axis, DiveFigure(name, unit, logs, values, errors, part_of=(ALL_DRAGS,))


def _error(row: Row) -> float:
    """Return the standard error of a term: 0 at its bound, nan where there is none."""
    if row["verdict"] == AT_BOUND:
        return 0.0
    return float("nan") if row["standard_error"] is None else float(row["standard_error"])


def _columns(cells: Mapping[int, tuple[float, float]], count: int) -> tuple[Array, Array]:
    columns = np.full((2, count), np.nan)
    for index, pair in cells.items():
        columns[:, index] = pair
    return columns[0], columns[1]


def _conditions(dives: Sequence[Row]) -> dict[str, list[float | str | None]]:
    return {name: [row[key] or None for row in dives] for key, name in CONDITIONS.items()}


def _day(row: Row) -> float:
    """Return the start in days; nan for a dive without a clock."""
    if row["start_utc"] is None:
        return float("nan")
    return datetime.fromisoformat(row["start_utc"]).timestamp() / DAY_S


def _trend(days: Sequence[float], values: Array, errors: Array) -> Trend | None:
    """Return the slope per day; None for too few dives with a clock."""
    times = np.array(days)
    present = np.isfinite(times) & np.isfinite(values)
    if present.sum() < FEWEST_OF_TREND or np.ptp(times[present]) == 0.0:
        return None
    return trend(times, values, errors)
