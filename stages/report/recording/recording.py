"""The Rerun recording of a run: series of the views, 3D path, spans, messages, texts.

One timeline `t`, in seconds of the log; later logs of a campaign follow one another
with a gap. One entity per group of series that share a clock, sent in columns. The
blueprint opens on the tab `Answer` and shows the whole time range.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from itertools import compress, groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr

from auvid.data_schemas.records.axes import AxisWindowsRecord
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column, has_columns
from auvid.hydro.arrays import Array, Ints
from auvid.stages.base import Document, part_of
from auvid.stages.number_format import visible
from auvid.stages.page.colours import (
    AXIS_INKS,
    ROLES,
    Ink,
    distinct,
    ink,
    inks_of,
    is_model,
    key,
    roles_of,
)
from auvid.stages.page.first_screen import Summary
from auvid.stages.page.pictures.svg_plots import telling_range
from auvid.stages.report.clock import Clock, make_clock
from auvid.stages.report.recording.blueprint import (
    LEFT_OUT,
    LoggedSeries,
    Owned,
    VisibleTabs,
    outer,
    parent,
    whole_view,
)
from auvid.stages.report.recording.dive import dive_view, send_dive
from auvid.stages.report.recording.flights import send_flights
from auvid.stages.report.recording.identity import Property
from auvid.stages.report.recording.path import send_paths
from auvid.stages.report.recording.readable import readable_group, titled
from auvid.stages.report.recording.rerun_stream import NO_PROPERTIES, Recording
from auvid.stages.report.recording.text import markdown, stage_texts
from auvid.stages.steps import counted

MODELS_SHOWN = 3
PARTS_KEPT = 8
"""In memory beside the table of a group: what groups of it are drawn less."""
MOST_COLUMNS, OF_LOG = 3, "ingest/"
"""Loaded at once of a table with series one below the other; of a log it is one."""
CLOCKS = ("t_s", "t_us", "time_us")
BAND, GAP, MINUTE_S = 2.0, 20.0, 60.0
OPACITY = {"raw": 120, "band": 110, "true": 140}
NOTHING: Mapping[str, Document] = {}
NO_TITLES: Mapping[str, str] = {}
Filter = tuple[tuple[str, str], ...]
Places = slice | Ints
Placed = tuple[str, str, str, list[Document]]
"""Table, entity, owner and groups of what is sent together."""


def record(
    title: str,
    summary: Summary,
    views: Mapping[str, Document],
    tables: Mapping[str, pa.Table],
    fused: Mapping[str, pa.Table],
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    windows: Mapping[str, AxisWindowsRecord],
    path_rate_hz: float,
    sections: Mapping[str, Document] = NOTHING,
    *,
    content: object = "",
    properties: Mapping[str, Property] = NO_PROPERTIES,
    bins: int | None = None,
    tab: str = "",
    path: str,
) -> None:
    """Save the recording to `path`; it opens on `tab` (see `whole_view`).

    One group of series is in memory at a time. `content`, `properties`, `bins`:
    see `Recording`.

    `sections` (keyed `stage/item`): their tables and remarks stand in it as text, a tab
    per stage.
    """
    out = Recording(title, content=content, properties=properties, bins=bins, path=path)
    try:
        _fill(
            out, title, summary, views, tables, fused, segments, logs, windows, path_rate_hz,
            sections, tab,
        )  # fmt: skip
    except BaseException:  # a stream left open fails whatever is recorded next
        out.discard()
        raise


def _fill(
    out: Recording,
    title: str,
    summary: Summary,
    views: Mapping[str, Document],
    tables: Mapping[str, pa.Table],
    fused: Mapping[str, pa.Table],
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    windows: Mapping[str, AxisWindowsRecord],
    path_rate_hz: float,
    sections: Mapping[str, Document],
    tab: str,
) -> None:
    """Fill a recording, as `record`, and end it."""
    clock = make_clock(segments, logs, windows)
    groups = [(owner, group) for owner, document in views.items() for group in document["groups"]]
    out.document("answer/text", markdown(title, summary, segments, clock.segments))
    texts = stage_texts(sections)
    for stage, words in texts.items():
        out.document(f"tables/{stage}", words)
    titles = {model.name: model.title for model in summary.models}
    logged = _send_groups(out, groups, tables, clock, _preferred(summary), titles)
    dive: dict[str, LoggedSeries] = {}
    best = next(iter(_preferred(summary)), "")
    if fused:
        dive = send_dive(out, fused, tables, segments, logs, clock)
        box = send_paths(out, fused, tables, segments, clock.segments, path_rate_hz, best)
        paths = {} if box is None else {"path": box}
    else:
        paths = send_flights(out, tables, inks_of(roles_of(sections)))
    _send_messages(out, tables, segments, clock, summary)
    lanes = _send_spans(out, tables, segments, clock)
    blueprint, left_out = whole_view(
        groups,
        VisibleTabs(logged, paths, tuple(texts), lanes),
        tab,
        partial(dive_view, dive, lanes) if dive else None,
    )
    if left_out:
        out.document(LEFT_OUT, left_out)
    out.finish(blueprint)


def _preferred(summary: Summary) -> list[str]:
    return list(
        dict.fromkeys(
            name
            for name in (summary.recommended, *(model.name for model in summary.models))
            if name
        )
    )[:MODELS_SHOWN]


def _send_groups(
    out: Recording,
    groups: Sequence[Owned],
    tables: Mapping[str, pa.Table],
    clock: Clock,
    preferred: Sequence[str],
    titles: Mapping[str, str] = NO_TITLES,
) -> dict[str, LoggedSeries]:
    """Send every group that has its table; nothing of one piece stays for the next.

    Values are as people read them; `titles`: models by name.

    Returns entity -> ranges of the series that are drawn at first, and of their times.
    """
    logged: dict[str, LoggedSeries] = {}
    load = lru_cache(maxsize=1)(partial(part_of, tables))
    load_part = lru_cache(maxsize=PARTS_KEPT)(partial(part_of, tables))
    bundles = [
        (name, entity, owner, bundle)
        for entity, owner, bundle in _bundles(groups)
        if (name := find_table(tables, owner, str(bundle[0]["table"]))) is not None
    ]
    pieces = _pieces(sorted(bundles, key=itemgetter(0)))
    of_tables: dict[str, list[Document]] = defaultdict(list)
    for name, _, _, bundle in bundles:
        of_tables[name] += bundle
    rows: dict[Filter, pa.Table] = {}
    parts: list[pa.Table] = []
    places: dict[Filter, Places] = {}
    before: tuple[str, ...] = ("",)
    for (name, entity, owner, bundle), columns in counted("recording: group", pieces):
        if (name, *columns) != before:
            if name != before[0]:
                places = _places(tables, name, of_tables[name])
            before = (name, *columns)
            rows.clear()
            parts.clear()
            load.cache_clear()
            load_part.cache_clear()
        parts = [_rows(load(name, columns), group, places, rows) for group in bundle]
        times = clock.seconds(name, parts[0])
        if (
            times is None
            or not len(times)
            or not all(has_columns(parts[0], _loaded(name, group)) for group in bundle)
        ):
            continue
        if entity not in logged:
            out.static(entity, _lines(bundle, preferred, titles))
        lines = (
            _scaled(readable_group(group)[0], line)
            for part, group in zip(parts, bundle, strict=True)
            for line in (
                _values(part, group, tables, load_part, owner)
                if _loaded(name, group)
                else _one_by_one(tables, name, group)
            )
        )
        extents: list[Extent] = []
        out.columns(entity, *parted(times, _measured(lines, _edges(bundle), extents)))
        out.stream.flush()
        is_drawn = _drawn_at_first(bundle, preferred)
        extents = list(compress(extents, is_drawn))
        roles = list(compress(_roles_drawn(bundle), is_drawn))
        limits = telling_range([item.finite for item in extents], roles)
        ends = [
            item.finite if limits is None else np.clip(item.numbers, *limits) for item in extents
        ]
        logged[entity] = logged.get(entity, LoggedSeries()).add(times, np.concatenate(ends))
    return logged


class Extent(NamedTuple):
    """The smallest and the largest of the finite values of a line, and of all numbers.

    Empty for none.
    """

    finite: Array
    numbers: Array

    @classmethod
    def of(cls, values: Array) -> Extent:
        """Return those of values (n,)."""
        if not values.size:
            return cls(values, values)
        ends = np.array([np.fmin.reduce(values), np.fmax.reduce(values)])  # without a copy
        if np.isfinite(ends).all():
            return cls(ends, ends)
        numbers = values[~np.isnan(values)]
        finite = numbers[np.isfinite(numbers)]
        return cls(*(np.array([x.min(), x.max()]) if x.size else x for x in (finite, numbers)))


def _measured(
    lines: Iterable[Array], edges: Sequence[bool], extents: list[Extent]
) -> Iterator[Array]:
    """Yield the lines, and put what sets the range of their plot to `extents`.

    Of edges of bands that is the later half, because estimates begin with any spread.
    """
    for line, is_edge in zip(lines, edges, strict=True):
        extents.append(Extent.of(line[len(line) // 2 :] if is_edge else line))
        yield line


def parted(times: Array, lines: Iterable[Array]) -> tuple[Array, Iterable[Array]]:
    """Return times and lines (n,) with NaN in each gap, so that no line crosses one.

    A gap: `GAP` times as long as the median step, or a minute where that is three steps,
    as between the glides of a dive.
    """
    if times.size < 2:
        return times, lines
    median = float(np.median(np.diff(times), overwrite_input=True))
    places = np.flatnonzero(np.diff(times) > min(GAP * median, max(MINUTE_S, 3.0 * median))) + 1
    if not places.size:
        return times, lines
    middles = 0.5 * (times[places - 1] + times[places])
    return np.insert(times, places, middles), (np.insert(line, places, np.nan) for line in lines)


def _pieces(bundles: Iterable[Placed]) -> list[tuple[Placed, tuple[str, ...]]]:
    """Return what is sent in the order of loading, each with the columns to load.

    bundles: in the order of tables.
    """
    pieces = []
    for table, of_table in groupby(bundles, key=itemgetter(0)):
        members = list(of_table)
        is_filtered = any(_filter(item) for *_, groups in members for item in groups)
        if is_filtered:
            members.sort(key=lambda item: _columns(item[3][0]))
        piece: list[Placed] = []
        columns: dict[str, None] = {}
        for member in members:
            own = dict.fromkeys(name for item in member[3] for name in _loaded(table, item))
            if is_filtered and piece and len(columns | own) > MOST_COLUMNS:
                pieces += [(item, (*columns, *CLOCKS)) for item in piece]
                piece, columns = [], {}
            piece.append(member)
            columns |= own
        pieces += [(item, (*columns, *CLOCKS)) for item in piece]
    return pieces


def _loaded(table: str, group: Document) -> list[str]:
    """Return the columns of a group that are loaded together with others.

    Series of a log are read one by one, when they are drawn.
    """
    is_plain = not (group.get("spread") or group.get("less") or _filter(group))
    return [] if table.startswith(OF_LOG) and is_plain else _columns(group)


def _scaled(factor: float, line: Array) -> Array:
    return line if factor == 1.0 else factor * line


def _one_by_one(tables: Mapping[str, pa.Table], name: str, group: Document) -> Iterator[Array]:
    """Yield the lines (n,) of a group, each read when the one before is sent."""
    for item in _columns(group):
        yield column(part_of(tables, name, (item,)), item)


def _filter(group: Document) -> Filter:
    """Return what the rows of a group have in other columns."""
    return tuple((name, str(value)) for name, value in (group.get("filter") or {}).items())


def _edges_only(group: Document) -> bool:
    """Return whether a group is a band around lines that another group draws.

    Such a group has standard deviations.
    """
    return set(group["roles"]) == {"band"}


def _lines_of(group: Document) -> int:
    """Return how many lines are drawn for each column of a group."""
    return 1 if not group.get("spread") else 2 if _edges_only(group) else 3


def _roles_drawn(bundle: Sequence[Document]) -> list[str]:
    """Return the role of every line of an entity; the edges of a spread are bands."""
    roles = []
    for group in bundle:
        lines = _lines_of(group)
        roles += [
            role
            for own in group["roles"]
            for role in ([str(own), "band", "band"] if lines == 3 else [str(own)] * lines)
        ]
    return roles


def _edges(bundle: Sequence[Document]) -> list[bool]:
    """Return which lines of an entity are edges of bands."""
    return [
        bool(group.get("spread")) and (_edges_only(group) or line > 0)
        for group in bundle
        for _ in group["columns"]
        for line in range(_lines_of(group))
    ]


def _columns(group: Document) -> list[str]:
    return [*group["columns"], *(group.get("spread") or [])]


def _values(
    part: pa.Table,
    group: Document,
    names: Collection[str],
    load: Callable[[str, Sequence[str]], pa.Table],
    owner: str,
) -> Iterator[Array]:
    """Yield the lines (n,) of a group, one in memory at a time.

    They are its columns, less those of another table, or with twice their standard
    deviations around them.
    """
    of_group, other = [str(name) for name in group["columns"]], None
    less = [str(name) for name in group["less"]["columns"]] if group.get("less") else []
    if less:
        name = find_table(names, owner, str(group["less"]["table"]))
        other = None if name is None else load(name, tuple(less))
    for place, name in enumerate(of_group):
        values = column(part, name)
        if less:
            nothing = np.full_like(values, np.nan)
            yield nothing if other is None else values - column(other, less[place])
        elif group.get("spread"):
            spread = BAND * column(part, str(group["spread"][place]))
            yield from () if _edges_only(group) else (values,)
            yield values - spread
            yield values + spread
        else:
            yield values


def _drawn_at_first(bundle: Sequence[Document], preferred: Sequence[str]) -> list[bool]:
    """Return which series of an entity are drawn at first.

    All but the models that are not preferred.
    """
    liked = {key(name) for name in preferred}
    roles = [
        str(role) for group in bundle for role in group["roles"] for _ in range(_lines_of(group))
    ]
    return [not is_model(role) or not liked or key(role) in liked for role in roles]


def _places(
    tables: Mapping[str, pa.Table], name: str, groups: Sequence[Document]
) -> dict[Filter, Places]:
    """Return which rows of a table the filters of its groups leave.

    The texts that they compare take more memory than the numbers that are drawn.
    """
    filters = {_filter(group) for group in groups}
    columns = sorted({column for pairs in filters for column, _ in pairs})
    texts = part_of(tables, name, columns) if columns else pa.table({})
    places: dict[Filter, Places] = {}
    for pairs in filters:
        is_left = [np.asarray(pc.equal(texts[column], value)) for column, value in pairs]
        if not is_left:
            places[pairs] = slice(None)
            continue
        numbers = np.flatnonzero(np.all(is_left, axis=0))
        first, count = (int(numbers[0]), len(numbers)) if len(numbers) else (0, 0)
        is_one_piece = not count or int(numbers[-1]) - first + 1 == count
        places[pairs] = slice(first, first + count) if is_one_piece else numbers
    return places


def _rows(
    table: pa.Table,
    group: Document,
    places: Mapping[Filter, Places],
    rows: dict[Filter, pa.Table],
) -> pa.Table:
    """Return the rows of a group; `rows`: those of other groups, by their filter."""
    chosen = _filter(group)
    if chosen not in rows:
        place = places[chosen]
        is_slice = isinstance(place, slice)
        rows[chosen] = table[place] if is_slice else table.take(pa.array(place))
    return rows[chosen]


def _bundles(groups: Sequence[Owned]) -> list[tuple[str, str, list[Document]]]:
    """Return (entity, owner, groups), with groups on the same clock as one entity.

    Groups that cut the same long table by a filter share its clock.
    """
    bundles: dict[tuple[str, ...], list[Document]] = defaultdict(list)
    for owner, group in groups:
        cut = bool(group.get("filter")) and bool(parent(group))
        entity = parent(group) if cut else str(visible(group["entity"]))
        bundles[(owner, entity, str(group["table"]), "cut" if cut else "whole")].append(group)
    named_bundles = []
    for (owner, entity, _, how), members in bundles.items():
        models = all(is_model(str(role)) for group in members for role in group["roles"])
        name = f"{entity}/{'models' if models else 'series'}" if how == "cut" else entity
        named_bundles.append((name, owner, members))
    return named_bundles


def find_table(tables: Collection[str], owner: str, kind: str) -> str | None:
    """Return the key of the table that a view of `owner` (stage/item) means.

    Its own artefact, a full key, or another stage's of the same item.
    """
    own = f"{owner}/{kind}"
    for name in (own, kind):
        if name in tables:
            return name
    item = owner.partition("/")[2]
    for name in tables:
        parts = name.split("/")
        if sorted(parts) == sorted(own.split("/")) or (item and kind in parts and item in parts):
            return name
    return None


def _lines(
    bundle: Sequence[Document], preferred: Sequence[str], titles: Mapping[str, str]
) -> rr.SeriesLines:
    """Return names, colours and widths of the series of an entity.

    Of many models only the preferred are drawn at first.
    """
    names, inks, opacity = [], [], []
    for group in bundle:
        drawn = line_inks(
            [str(name) for name in group["names"]], [str(role) for role in group["roles"]]
        )
        for name, role, line in zip(group["names"], group["roles"], drawn, strict=True):
            title = titled(str(name), str(role), titles)
            lines = [title, f"{title} − 2 sd", f"{title} + 2 sd"]
            lines = lines if group.get("spread") else lines[:1]
            lines = lines[-2:] if _lines_of(group) == 2 else lines
            names += [str(visible(words)) for words in lines]
            inks += [line] * len(lines)
            opacity += [OPACITY.get(str(role), 255), *[OPACITY["band"]] * (len(lines) - 1)]
    return rr.SeriesLines(
        colors=[(*item.rgb, strength) for item, strength in zip(inks, opacity, strict=True)],
        names=names,
        widths=[item.width for item in inks],
        visible_series=_drawn_at_first(bundle, preferred),
        aggregation_policy="MinMax",  # an average per pixel would hide peaks
    )


def line_inks(names: Sequence[str], roles: Sequence[str]) -> list[Ink]:
    """Return the colours of lines.

    Lines of different roles have the colours of their roles; lines of one role differ
    by axis, or else by their order.
    """
    if len(set(roles)) != 1 or len(names) == 1:
        found_of = inks_of(roles)
        return [found_of[key(role)] for role in roles]
    axes = [
        next((word for word in key(name).split("_") if word in AXIS_INKS), None) for name in names
    ]
    one_axis_each = len(set(axes)) == len(axes) and None not in axes
    chosen = (
        [AXIS_INKS[str(axis)] for axis in axes] if one_axis_each else list(distinct(names).values())
    )
    return [Ink(item.light, item.dark, width=ink(roles[0]).width) for item in chosen]


def _send_messages(
    out: Recording,
    tables: Mapping[str, pa.Table],
    segments: Mapping[str, SegmentRecord],
    clock: Clock,
    summary: Summary,
) -> None:
    """Send messages, mode changes, warnings and starts of segments as text."""
    start = min(clock.logs.values(), default=0.0)
    out.messages("log/warnings", [(start, "warning", words) for words in summary.warnings])
    lines: dict[str, list[tuple[float, str, str]]] = defaultdict(list)
    for name in tables:
        port = name.split("/")[-1]
        if port not in ("events", "mode"):
            continue
        table = tables[name]
        times = clock.seconds(name, table)
        if times is not None:
            words = table["text" if port == "events" else "mode"].to_pylist()
            lead = "mode " if port == "mode" else ""
            lines[f"log/{port}"] += [
                (time, "note", f"{lead}{line}")
                for time, line in zip(times.tolist(), words, strict=True)
            ]
    lines["log/segments"] = [
        (clock.segments[name], "note", f"{item.use} segment {name} starts")
        for name, item in segments.items()
    ]
    for entity, rows in sorted(lines.items()):
        out.messages(entity, rows)


def _send_spans(
    out: Recording,
    tables: Mapping[str, pa.Table],
    segments: Mapping[str, SegmentRecord],
    clock: Clock,
) -> tuple[float, float] | None:
    """Send modes of the vehicle and the segments as lanes of spans.

    Returns the time from the first to the last, None without any.
    """
    modes: list[tuple[float, str | None]] = []
    for name in tables:
        if (
            name.split("/")[-1] == "mode"
            and (starts := clock.seconds(name, tables[name])) is not None
        ):
            modes += zip(starts.tolist(), map(str, tables[name]["mode"].to_pylist()), strict=True)
    if modes:
        named = sorted(modes, key=lambda row: row[0])
        words = [mode for _, mode in named]
        out.states(
            "spans/mode", [time for time, _ in named], words, distinct(str(mode) for mode in words)
        )
    for use in dict.fromkeys(str(item.use) for item in segments.values()):
        spans = [
            (clock.segments[name], item.duration_s, name)
            for name, item in segments.items()
            if item.use == use
        ]
        edges = [time for start, length, _ in sorted(spans) for time in (start, start + length)]
        states = [state for *_, name in sorted(spans) for state in (name, None)]
        out.states(
            f"spans/{use}", edges, states, {name: ROLES.get(use, ink(use)) for *_, name in spans}
        )
    ends = [clock.segments[name] + float(item.duration_s) for name, item in segments.items()]
    times = [*(time for time, _ in modes), *clock.segments.values(), *ends]
    return outer((time, time) for time in times) if times else None
