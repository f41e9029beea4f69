"""Two runs in one recording: signals of both, their difference, and changes as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from auvid.hydro.arrays import Array
from auvid.stages.number_format import visible
from auvid.stages.page.colours import AXIS_INKS, ROLES, Ink, ink
from auvid.stages.report.clock import make_clock
from auvid.stages.report.difference.signals import FORCE, MODEL, Pair, Side, Signals
from auvid.stages.report.recording.blueprint import (
    LEFT_OUT,
    MOST_VIEWS,
    LoggedSeries,
    in_pages,
    limited,
    opened,
    outer,
    time_plot,
)
from auvid.stages.report.recording.rerun_stream import PREVIEW_BINS, Recording

FIRST, SECOND = ROLES["first"], ROLES["second"]


def record_difference(
    first: Side, second: Side, pairs: Sequence[Pair], words: str, *, preview: bool = False
) -> bytes:
    """Return the recording of two runs as .rrd bytes.

    `words`: what changed, in Markdown. Times are those of the first run.
    """
    bins = PREVIEW_BINS if preview else None
    out = Recording(f"{first.name} against {second.name}", content=words, bins=bins)
    out.document("answer/text", words)
    starts = make_clock(first.segments, first.logs).logs
    logged: dict[str, dict[str, LoggedSeries]] = {}
    for pair in pairs:
        shift = (
            starts.get(str(first.segments[pair.segment].log), 0.0)
            if pair.segment in first.segments
            else 0.0
        )
        kind = _entity(pair.kind)
        for place, name in enumerate(pair.first.names):
            origin = _origin(first, pair, name)
            lanes = logged.setdefault(kind, {})
            for side, drawn, line in ((first, pair.first, FIRST), (second, pair.second, SECOND)):
                entity = f"{origin}/{'first' if side is first else 'second'}"
                lanes[origin] = _send(
                    out,
                    entity,
                    _label(side, drawn, place),
                    line,
                    drawn.times + shift,
                    drawn.values[:, place],
                    lanes.get(origin),
                )
            second_less_first = f"difference/{origin}"
            others = logged.setdefault(f"difference/{kind}", {})
            others[second_less_first] = _send(
                out,
                second_less_first,
                f"{name}: second less first",
                _difference_ink(name),
                pair.times + shift,
                pair.difference[:, place],
                others.get(second_less_first),
            )
    units = {
        _origin(first, pair, name): unit
        for pair in pairs
        for name, unit in zip(pair.first.names, pair.first.units, strict=True)
    }
    blueprint, left_out = _blueprint(pairs, logged, units)
    if left_out:
        out.document(LEFT_OUT, left_out)
    return out.finish(blueprint)


def _origin(first: Side, pair: Pair, name: str) -> str:
    """Return the start of a segment's clock.

    Segments follow one another on the clock of their log and share a plot; bench legs
    and flights begin at zero, each in its own.
    """
    parts = [_entity(pair.kind), *([] if pair.segment in first.segments else [pair.segment]), name]
    return "/".join(rr.escape_entity_path_part(str(visible(part))) for part in parts)


def _entity(kind: str) -> str:
    return kind.replace(" ", "_")


def _label(side: Side, drawn: Signals, place: int) -> str:
    return f"{drawn.names[place]} {side.name}"


def _difference_ink(name: str) -> Ink:
    return AXIS_INKS.get(name.lower(), ink("difference"))


def _send(
    out: Recording,
    entity: str,
    name: str,
    line: Ink,
    times: Array,
    values: Array,
    before: LoggedSeries | None,
) -> LoggedSeries:
    column = values[:, None]
    style = rr.SeriesLines(
        colors=[line.rgb],
        names=[str(visible(name))],
        widths=[line.width],
        aggregation_policy="MinMax",
    )
    out.static(entity, style)
    out.series(entity, times, column)
    return (before or LoggedSeries()).add(times, column)


def _blueprint(
    pairs: Sequence[Pair],
    logged: Mapping[str, Mapping[str, LoggedSeries]],
    units: Mapping[str, str],
) -> tuple[rrb.Blueprint, str]:
    kinds = list(dict.fromkeys(pair.kind for pair in pairs))
    words: Any = rrb.TextDocumentView(origin="answer/text", name="What changed")
    opening = next((kind for kind in (MODEL, FORCE, *kinds) if kind in kinds), None)
    if opening is None:
        return opened([words]), ""
    first = limited(
        {opening: _plots(f"difference/{_entity(opening)}", logged, units)}, most=MOST_VIEWS // 4
    )[0][opening]
    tabs = {kind: _plots(_entity(kind), logged, units) for kind in kinds}
    kept, left_out = limited(tabs, most=(MOST_VIEWS - len(first)) // 2)
    if left_out:
        words = rrb.Tabs(words, rrb.TextDocumentView(origin=LEFT_OUT, name="Without a plot"))
    pages: list[Any] = [
        rrb.Horizontal(in_pages(first, None, 2), words, column_shares=[6, 4], name="Answer")
    ]
    for kind, overlaid in kept.items():
        every = _plots(f"difference/{_entity(kind)}", logged, units)
        differences = {origin: every[origin] for origin in overlaid}
        pages.append(
            rrb.Tabs(
                in_pages(overlaid, "both", 2),
                in_pages(differences, "second less first", 2),
                name=kind,
            )
        )
    return opened(pages), left_out


def _plots(
    kind: str, logged: Mapping[str, Mapping[str, LoggedSeries]], units: Mapping[str, str]
) -> dict[str, rrb.TimeSeriesView]:
    lanes = logged[kind]
    times = outer(item.times for item in lanes.values())
    plots: dict[str, rrb.TimeSeriesView] = {}
    for origin, item in lanes.items():
        own = origin.removeprefix("difference/")
        change = "Δ" if origin != own else ""
        words = " ".join(own.split("/")[1:]).replace("\\", "")
        plots[own] = time_plot(
            origin, f"{change}{words} [{units[own]}]", times, item.values, legend=not plots
        )
    return plots
