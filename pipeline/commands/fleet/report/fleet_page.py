"""`auvid fleet report`: a fleet on one page, what to look at first at the top."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.fleet.alarms import FEWEST_BEFORE, ChangeAlarm
from auvid.hydro.identification.fleet.pooling import FEWEST_DIVES
from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder
from auvid.pipeline.commands.fleet.fleet_tables import UNNAMED, read_table
from auvid.pipeline.commands.fleet.report.coefficient_columns import COLUMNS, Coefficients
from auvid.pipeline.commands.fleet.report.time_picture import time_picture
from auvid.pipeline.commands.fleet.report.vehicle_figures import (
    ALL_DRAGS,
    DiveFigure,
    VehicleFigures,
    in_time,
    vehicle_figures,
)
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.stages.base import Document
from auvid.stages.number_format import estimate, significant, term, true_minus
from auvid.stages.page.first_screen import AXIS_WORDS, Alert, Fact, Summary, anchor
from auvid.stages.page.html import render
from auvid.stages.page.pictures.whisker_picture import WhiskerBox, Whiskers, whisker_picture
from auvid.stages.presentation import fold, section, table, text

STATES = ("done", "partly", "refused")
MOST_BOXES, MOST_DIVES = 12, 6
"""Of one vehicle: figures that are drawn, and the last dives of each."""
KEPT_ROWS = 40
MOST_AGREED, MOST_WEAK = 3, 3
"""On the first screen: drags, and dives of a vehicle with weak thrusters."""
OF_ALL_AXES = (
    "A change of the drag of all axes is one of the hull or its payload, or of the thrust of all"
    " thrusters alike, which is taken for drag: look at voltage and thrust curve too."
)
MOST_CELLS = 5_000
"""Of the table of figures dive by dive; the rest stands in the Parquet table."""
MOST_BOARDS = 4
VEHICLE_OPTION = "--vehicle PATTERN=NAME keeps vehicles apart."
Row = dict[str, Any]


def write_page(fleet: FleetFolder, *, by_name: bool = False) -> None:
    """Write the report of a fleet from its tables.

    by_name: names of files are in order of time.
    """
    rows = {name: read_table(fleet, name).to_pylist() for name in ("runs", "findings")}
    coefficients = Coefficients.of_table(read_table(fleet, "coefficients", COLUMNS))
    index = json.loads(fleet.index.read_text(encoding="utf-8"))
    page = fleet_page(
        str(index["disk"]), rows["runs"], rows["findings"], coefficients, by_name=by_name
    )
    write_atomically(fleet.page, page)


def fleet_page(
    title: str,
    logs: Sequence[Row],
    findings: Sequence[Row],
    coefficients: Coefficients,
    *,
    by_name: bool = False,
) -> bytes:
    """Return the page of a fleet as HTML, from its tables.

    `logs`: rows of table `runs`. by_name: names of files are in order of time.
    """
    runs = sorted(logs, key=in_time(by_name))
    vehicles = vehicle_figures(coefficients, runs, by_name=by_name)
    names = {row["log"]: _name(row) for row in runs}
    documents = {
        "usable": _usable_section(runs, order=1),
        "states": _states_section(runs, order=5),
        "findings": _findings_section(findings, runs, order=3),
        "figures": _figures_section(vehicles, names, order=4),
        "changes": _changes_section(vehicles, names, order=2),
        "time": _time_section(runs, findings, order=6),
    }
    pictures = [
        *time_picture(runs),
        *(picture for each in vehicles for picture in _pictures(each, names)),
    ]
    return render(
        f"Fleet: {title}",
        "",
        "",
        _summary(runs, vehicles, names),
        documents,
        pictures=pictures,
    )


def _hours(runs: Sequence[Row]) -> float:
    """Return the hours of all dives, one of two recorders each."""
    return float(sum(row["duration_s"] for row in runs if not row["same_as"])) / 3600.0


def _name(row: Row) -> str:
    """Return the name of a dive on the page: its file, and its day if there is one."""
    file = str(row["file"]).rpartition("/")[2]
    return f"{file} ({row['start_utc'][:10]})" if row["start_utc"] else file


def _label(name: str) -> str:
    axis, _, words = name.partition("_")
    return f"{axis}_{term(words)}" if axis in AXIS_WORDS else name


def _summary(
    runs: Sequence[Row], vehicles: Sequence[VehicleFigures], names: Mapping[str, str]
) -> Summary:
    counts = Counter(row["state"] for row in runs)
    words = "; ".join(_uses(runs))
    doubts = [*_look_first(vehicles, names), *_doubtful_vehicles(runs)]
    reasons = Counter(
        row["reason"].partition(";")[0][:120] for row in runs if row["state"] != "done"
    )
    notes = [
        Alert(f"{count} logs: {reason}", anchor("states"), "fair")
        for reason, count in reasons.most_common(5)
        if count > 1
    ]
    look = max(vehicles, key=lambda each: each.concerns, default=None)
    first = ""
    if look is not None and look.concerns:
        own = [words for words in doubts if words.startswith(f"{look.vehicle}: ")]
        why = own[0].removeprefix(f"{look.vehicle}: ") if own else ""
        first = f"; look at {look.vehicle} first: {why}".rstrip(": ")
    agreed, since = _agreed(vehicles), _since(vehicles, names)
    level = "poor" if not counts["done"] else "fair" if doubts or notes else "good"
    return Summary(
        level=level,  # type: ignore[arg-type]
        headline=f"{counts['done']} of {len(runs)} logs gave a model or figures{first}",
        explanation=" ".join(
            [
                f"Dives to use, by axis: {words}." if words else "No axis of any dive is usable.",
                f"They agree on {agreed}."
                if agreed
                else "The dives of no vehicle agree on a drag.",
                *([f"Since the last change: {since}."] if since else []),
            ]
        ),
        recommended=None,
        judged_on="validation",
        facts=(
            Fact("done", str(counts["done"]), "a model or figures to take"),
            Fact("partly", str(counts["partly"]), "ended before; the table says where"),
            Fact("refused", str(counts["refused"]), "damaged, doubled, or nothing to fit"),
            Fact("vehicles", str(len({row["vehicle"] for row in runs if row["vehicle"]})), ""),
            Fact("hours", f"{_hours(runs):.1f}", "of logs"),
        ),
        models=(),
        identified=(),
        missing=tuple(doubts),
        warnings=tuple(notes),
    )


def _uses(runs: Sequence[Row]) -> Iterator[str]:
    """Yield by axis how many dives serve for what, as `surge control 3, forces 2`."""
    for word in AXIS_WORDS.values():
        counts = Counter(row[f"use_{word}"] for row in runs if row[f"use_{word}"])
        if counts:
            yield f"{word} " + ", ".join(f"{use} {count}" for use, count in counts.most_common())


def _agreed(vehicles: Sequence[VehicleFigures]) -> str:
    """Return the drag that the dives of each vehicle agree on, in words."""
    words = [
        f"{item.name} {_pooled_words(each, item)}"
        for each in vehicles
        for item in each.figures
        if item.name not in (*each.since, ALL_DRAGS) and _is_agreed_drag(each, item)
    ]
    return "; ".join(words[:MOST_AGREED])


def _since(vehicles: Sequence[VehicleFigures], names: Mapping[str, str]) -> str:
    """Return the drag of each vehicle from its last change on, in words."""
    words = [
        f"{item.name} {_pooled_words(each, item, names[each.dives[each.since[item.name]]])}"
        for each in vehicles
        for item in each.figures
        if item.name in each.since and item.name != ALL_DRAGS and _is_agreed_drag(each, item)
    ]
    return "; ".join(words[:MOST_AGREED])


def _is_agreed_drag(each: VehicleFigures, item: DiveFigure) -> bool:
    return item.name.startswith("drag") and each.pooled[item.name].next_dive is not None


def _pooled_words(each: VehicleFigures, item: DiveFigure, first: str = "") -> str:
    """Return value, vehicle, dives and next dive in words; `first`: of the level."""
    pooled = each.pooled[item.name]
    count = f"{pooled.dives} dives" if pooled.dives > 1 else "1 dive"
    count += f" from {first} on" if first else ""
    doubt = ", if it stays so" if first and pooled.dives < FEWEST_DIVES else ""
    return (
        f"{significant(pooled.mean)} {item.unit} ({each.vehicle}, {count};"
        f" the next {_interval(pooled.next_dive)}{doubt})"
    )


def _change(alarm: ChangeAlarm) -> str:
    """Return a change in per cent; of a departure, that may be about 0, in its unit."""
    if alarm.figure.startswith("sensor"):
        return f"by {significant(alarm.change)}"
    return f"by {100.0 * alarm.share:+.0f} %"


def _look_first(vehicles: Sequence[VehicleFigures], names: Mapping[str, str]) -> Iterator[Alert]:
    """Yield the changes and the outlying dives, changes first."""
    for each in vehicles:
        for alarm in each.alarms:
            yield Alert(
                f"{each.vehicle}: {_label(alarm.figure)} changed {_change(alarm)}"
                f" from {names[each.dives[alarm.first_dive]]} on",
                anchor("changes"),
                "poor",
            )
        for words in list(_uneven(each.weak, names))[:MOST_WEAK]:
            yield Alert(f"{each.vehicle}: {words}", anchor("changes"), "poor")
    for each in vehicles:
        units = {item.name: item.unit for item in each.figures}
        for name, slope in each.trends.items():
            yield Alert(
                f"{each.vehicle}: {_label(name)} drifts by {significant(30.0 * slope.slope)}"
                f" {units[name]} in 30 days (95 % {_interval(slope.interval, 30.0)})",
                anchor("changes"),
                "fair",
            )
        for item in each.outlying:
            different = "; ".join(f"{x.condition} {x.words}" for x in item.differences)
            yield Alert(
                f"{each.vehicle}: {names[each.dives[item.dive]]} departs in"
                f" {_label(item.figure)} by {abs(item.deviation):.1f} standard deviations"
                + (f"; different: {different}" if different else ""),
                anchor("changes"),
                "fair",
            )


def _uneven(rows: Sequence[Row], names: Mapping[str, str]) -> Iterator[str]:
    """Yield a line for each dive on which thrusters give less than those like them."""
    of_log: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        of_log[row["log"]].append(row)
    for log, own in of_log.items():
        if len(own) == 1:
            (row,) = own
            yield (
                f"{row['term']} is {row['verdict']} in {names[log]}:"
                f" {row['value']:.2f} of those like it"
            )
        else:
            each = ", ".join(row["term"].removeprefix("thruster ") for row in own)
            yield f"thrusters {each} are uneven in {names[log]}, or wrong in the vehicle file"


def _doubtful_vehicles(runs: Sequence[Row]) -> Iterator[Alert]:
    """Yield the vehicles that may be several, whose dives are yet taken together."""
    dives: dict[str, list[Row]] = defaultdict(list)
    for row in runs:
        if row["state"] != "refused":
            dives[row["vehicle"]].append(row)
    for vehicle, rows in sorted(dives.items()):
        boards = Counter(row["board"] for row in rows if row["board"])
        if len(boards) > 1:
            each = [f"{count} with {name}" for name, count in boards.most_common(MOST_BOARDS)]
            yield Alert(
                f"{vehicle}: its dives are of {len(boards)} autopilots, {', '.join(each)}: were"
                f" they calibrated anew, or are these several vehicles? {VEHICLE_OPTION}",
                anchor("usable"),
                "fair",
            )
        elif vehicle.startswith(UNNAMED) and len(rows) > 1:
            yield Alert(
                f"{vehicle}: no log names its vehicle, and {len(rows)} dives are taken for those of"
                f" one. {VEHICLE_OPTION}",
                anchor("usable"),
                "fair",
            )


def _usable_section(runs: Sequence[Row], *, order: int) -> Document:
    there = [row for row in runs if row["state"] != "refused"]
    heads = ["dive", "vehicle", "model", "J/J0", *AXIS_WORDS.values(), "start (UTC)", "log"]
    rows = [
        [
            str(row["file"]).rpartition("/")[2],
            row["vehicle"],
            row["model"],
            row["ratio"],
            *(row[f"use_{word}"] or row[word] for word in AXIS_WORDS.values()),
            row["start_utc"] and row["start_utc"][:16].replace("T", " "),
            row["log"],
        ]
        for row in there
    ]
    note = (
        "Per axis: the most that the model is good for (control, simulation, forces), else what"
        " the data say of the damping."
    )
    kept = [place < KEPT_ROWS for place in range(len(rows))]
    blocks = [table("Which dives are usable for what", heads, rows, note=note, kept=kept)]
    return section("Usable dives", blocks if rows else [text("None.")], order=order, is_open=True)


def _states_section(runs: Sequence[Row], *, order: int) -> Document:
    vehicles = sorted({row["vehicle"] for row in runs})
    counts = Counter((row["vehicle"], row["state"]) for row in runs)
    summary = table(
        "Logs by vehicle",
        ["vehicle", *STATES],
        [[name or "unknown", *(counts[name, state] for state in STATES)] for name in vehicles],
    )
    rows = [
        [_name(row), row["state"], row["reason"], row["vehicle"], row["format"], row["status"]]
        for row in runs
        if row["state"] != "done"
    ]
    heads = ["log", "state", "why", "vehicle", "format", "file"]
    kept = [place < KEPT_ROWS for place in range(len(rows))]
    return section(
        "States and reasons", [summary, table("Not done", heads, rows, kept=kept)], order=order
    )


def _findings_section(findings: Sequence[Row], runs: Sequence[Row], *, order: int) -> Document:
    logs = Counter(row["vehicle"] for row in runs if not row["same_as"] and row["duration_s"])
    groups: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for row in findings:
        groups[row["finding"], row["severity"], row["vehicle"]].append(row)
    severities = ("error", "warning", "note")
    rows = []
    for (name, severity, vehicle), items in groups.items():
        hit = {item["log"] for item in items}
        times = sorted(item["start_utc"] for item in items if item["start_utc"])
        rows.append(
            [
                name,
                severity,
                vehicle,
                len(hit),
                100.0 * len(hit) / max(logs[vehicle], 1),
                items[0]["stops"],
                times[0][:10] if times else None,
                times[-1][:10] if times else None,
                items[0]["remedy"],
            ]
        )
    rows.sort(key=lambda row: (severities.index(row[1]), -row[3]))
    heads: list[str | tuple[str, str]] = ["finding", "severity", "vehicle", "logs", ("share", "%")]
    heads += ["stops a run", "first", "last", "remedy"]
    kept = [place < KEPT_ROWS for place in range(len(rows))]
    blocks = [table("Findings by vehicle", heads, rows, kept=kept)] if rows else [text("None.")]
    return section("Findings", blocks, order=order, look_for="What one vehicle has in every dive.")


def _figures_section(
    vehicles: Sequence[VehicleFigures], names: Mapping[str, str], *, order: int
) -> Document:
    rows: list[list[Any]] = []
    single: list[list[str]] = []
    count, most = 0, MOST_CELLS // 5
    for each in vehicles:
        for item in each.figures:
            pooled = each.pooled[item.name]
            rows.append(
                [
                    each.vehicle,
                    each.model,
                    _label(item.name),
                    item.unit,
                    pooled.dives,
                    names[item.dives[each.since[item.name]]] if item.name in each.since else "",
                    pooled.mean,
                    _interval(pooled.mean_interval),
                    pooled.tau,
                    100.0 * pooled.i2,
                    _interval(pooled.next_dive) or pooled.refusal,
                ]
            )
            dives = np.flatnonzero(np.isfinite(item.values))
            count += len(dives)
            for place in dives[: most - len(single)]:
                value, error = float(item.values[place]), float(item.errors[place])
                printed = true_minus(estimate(value, NORMAL_95 * error))
                single.append(
                    [each.vehicle, _label(item.name), item.unit, names[item.dives[place]], printed]
                )
    if not rows:
        words = "No figure is identified in two dives of one vehicle."
        return section("What dives agree on", [text(words)], order=order)
    heads: list[str | tuple[str, str]] = ["vehicle", "model", "figure", "unit", "dives"]
    heads += ["since", "pooled", "95 % of the mean", "tau", ("I2", "%"), "95 % of the next dive"]
    note = (
        "Random effects: tau is the scatter between dives, I2 the share of all scatter that is"
        " between dives. The last interval is that of what a further dive will show, if it is"
        " as sure as these. Where a figure changed, mean and interval are of the dives since"
        " then, with the scatter of all about the mean before and after; what they were before"
        " stands in the table of changes."
    )
    kept = [place < KEPT_ROWS for place in range(len(single))]
    return section(
        "What dives agree on",
        [
            table("Pooled figures", heads, rows, note=note),
            *fold(
                "Dive by dive",
                [
                    table(
                        "Dive by dive",
                        ["vehicle", "figure", "unit", "dive", "value ± half of 95 %"],
                        single,
                        kept=kept,
                        note=(
                            f"The first {most} of {count}; all stand in coefficients.parquet."
                            if count > most
                            else ""
                        ),
                    )
                ],
            ),
        ],
        order=order,
        is_open=True,
    )


def _interval(interval: tuple[float, float] | None, scale: float = 1.0) -> str:
    if interval is None:
        return ""
    low, high = (significant(scale * end) for end in interval)
    return true_minus(f"{low} to {high}")


def _changes_section(
    vehicles: Sequence[VehicleFigures], names: Mapping[str, str], *, order: int
) -> Document:
    alarms = [
        [
            each.vehicle,
            _label(alarm.figure),
            names[each.dives[alarm.first_dive]],
            alarm.before,
            alarm.after,
            _change(alarm),
        ]
        for each in vehicles
        for alarm in each.alarms
    ]
    dives = [
        [
            each.vehicle,
            names[each.dives[item.dive]],
            _label(item.figure),
            item.value,
            _interval(item.expected),
            item.deviation,
            "; ".join(f"{x.condition} {x.words}" for x in item.differences),
        ]
        for each in vehicles
        for item in each.outlying
    ]
    weak = [
        [
            each.vehicle,
            names[row["log"]],
            row["term"],
            row["value"],
            row["standard_error"],
            row["verdict"],
        ]
        for each in vehicles
        for row in each.weak
    ]
    trends = [
        [
            each.vehicle,
            _label(name),
            slope.dives,
            30.0 * slope.slope,
            _interval(slope.interval, 30.0),
        ]
        for each in vehicles
        for name, slope in each.trends.items()
    ]
    blocks = []
    if alarms:
        heads = ["vehicle", "figure", "from", "before", "after", "change"]
        on_all = any(alarm.figure == ALL_DRAGS for each in vehicles for alarm in each.alarms)
        blocks.append(table("Changes", heads, alarms, note=OF_ALL_AXES if on_all else ""))
    if weak:
        heads = [
            "vehicle",
            "dive",
            "thruster",
            "share of those like it",
            "standard error",
            "verdict",
        ]
        blocks.append(table("Uneven thrusters", heads, weak))
    if trends:
        heads = ["vehicle", "figure", "dives", "per 30 days", "95 %"]
        blocks.append(table("Trends", heads, trends))
    if dives:
        heads = ["vehicle", "dive", "figure", "value", "expected", "deviation", "what is different"]
        blocks.append(table("Outlying dives", heads, dives))
    if not blocks:
        blocks.append(text("No figure changed, and no dive departs from the others."))
    blocks += [text(words) for words in _order_unknown(vehicles)]
    blocks += [
        text(f"{each.vehicle}: no dive tells the strength of {', '.join(each.unseen)}.")
        for each in vehicles
        if each.unseen
    ]
    return section("Changes and outlying dives", blocks, order=order)


def _order_unknown(vehicles: Sequence[VehicleFigures]) -> Iterator[str]:
    """Yield what is not watched for want of a clock."""
    for each in vehicles:
        count, dives = each.order_unknown, len(each.dives)
        if count and dives > FEWEST_BEFORE:
            yield (
                f"{each.vehicle}: order unknown of {count} of {dives} dives, which have no clock:"
                " no change and no trend is sought in them (--by-name if the names of their"
                " files are in order of time)."
            )


def _time_section(runs: Sequence[Row], findings: Sequence[Row], *, order: int) -> Document:
    """Return what each month has: logs by state, findings by severity."""
    months: dict[str, Counter[str]] = defaultdict(Counter)
    for row in runs:
        months[(row["start_utc"] or "no clock")[:7]][row["state"]] += 1
    for row in findings:
        months[(row["start_utc"] or "no clock")[:7]][row["severity"]] += 1
    heads = ["month", *STATES, "errors", "warnings"]
    rows = [
        [month, *(counts[name] for name in (*STATES, "error", "warning"))]
        for month, counts in sorted(months.items())
    ]
    return section("Over time", [table("Logs and findings by month", heads, rows)], order=order)


def _pictures(each: VehicleFigures, names: Mapping[str, str]) -> Iterator[Markup]:
    """Yield a picture of figures: last dives, pooled value, interval of the next."""
    drawn = sorted(each.figures, key=lambda item: -int(np.isfinite(item.values).sum()))
    drawn = drawn[:MOST_BOXES]
    if not drawn:
        return
    last = range(max(0, len(each.dives) - MOST_DIVES), len(each.dives))
    boxes = []
    for item in drawn:
        pooled = each.pooled[item.name]
        dives = [
            Whiskers(float(item.values[at]), NORMAL_95 * float(item.errors[at]))
            if np.isfinite(item.values[at])
            else None
            for at in last
        ]
        ends = (pooled.mean_interval, pooled.next_dive)
        boxes.append(
            WhiskerBox(
                _label(item.name.partition(" at ")[0]),
                item.unit,
                (*dives, *(_whiskers(pooled.mean, end) for end in ends)),
            )
        )
    lines = [*(names[each.dives[at]] for at in last), "pooled", "next dive"]
    note = f"95 % intervals; model {each.model}" if each.model else "95 % intervals"
    if len(each.dives) > MOST_DIVES:
        note += f"; the last {MOST_DIVES} of {len(each.dives)} dives"
        note += ", pooled over all since the last change"
    yield whisker_picture(f"Figures of {each.vehicle}, dive by dive", note, lines, boxes)


def _whiskers(mean: float, interval: tuple[float, float] | None) -> Whiskers | None:
    return None if interval is None else Whiskers(mean, 0.5 * (interval[1] - interval[0]))
