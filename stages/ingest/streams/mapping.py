"""Streams from decoded messages, by the mapping in data_schemas/formats/streams.yaml.

Values become SI, body frame forward-right-down and north-east-down here, once. Which
source fills a stream is decided by the order of the mapping; the manifest can replace
it (`sources: {depth: "BARO[1]"}`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import STREAMS, FormatStreams, StreamSource, format_streams
from auvid.data_schemas.units import convertible, factor_and_offset
from auvid.hydro.arrays import Ints, Mask
from auvid.hydro.long_series.long_arrays import laid_down
from auvid.stages.ingest.decoded_log import Column, DecodedLog, Messages
from auvid.stages.ingest.streams.common import Columns

Compute = Callable[[Messages, Ints, DecodedLog], Columns]  # with the time of each record
Condition = Callable[[Messages, DecodedLog], str | None]
Score = Callable[[Messages, DecodedLog], float]
Clock = Callable[[Messages, DecodedLog], Ints | None]
MIN_INSTANCES = 2
TEXTS = "TEXTS"
TEXT_STREAMS = frozenset({"texts", "modes"})  # what computes streams from text
ABSENT = ("not logged", "has no column")
NO_CLOCK = "has no time stamp"


@dataclass(frozen=True)
class Rules:
    """What a format adds to its section of streams.yaml.

    Its clock, and the functions that the section (`mapping`) names. `utc` gives what to
    add to the clock for microseconds since 1970 UTC, or None where the log does not
    say. `also` are message types that the functions read besides those of the mapping.
    """

    mapping: str
    clock: Clock
    compute: Mapping[str, Compute] = field(default_factory=dict)
    conditions: Mapping[str, Condition] = field(default_factory=dict)
    scores: Mapping[str, Score] = field(default_factory=dict)
    utc: Callable[[DecodedLog], int | None] = lambda log: None
    also: frozenset[str] = frozenset()

    @property
    def spec(self) -> FormatStreams:
        """Return the section of streams.yaml."""
        spec = format_streams(self.mapping)
        assert spec is not None
        return spec

    @property
    def messages(self) -> frozenset[str]:
        """Return all message types that the streams of the format need."""
        return self.spec.messages | self.also


@dataclass(frozen=True)
class Stream:
    """One stream of a log in SI on its own clock.

    `columns` are fields of the stream's schema with `time_us` (n,) int64; `place` (n,)
    is the byte offset (CSV: row) of each sample. `alternatives` lists every way the log
    could fill the stream, in order, each with its status.
    """

    name: str
    columns: Columns
    place: Ints
    source: str
    alternatives: tuple[dict[str, str], ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.place.size)

    def rows(self, kept: Mask) -> Stream:
        """Return the stream with these rows only."""
        columns = {key: laid_down(values[kept]) for key, values in self.columns.items()}
        return replace(self, columns=columns, place=laid_down(self.place[kept]))


@dataclass(frozen=True)
class Candidate:
    """One source with one instance of its sensor.

    `refused` is why it cannot be used; None if it can.
    """

    source: StreamSource
    label: str
    messages: Messages | None
    refused: str | None

    @property
    def usable(self) -> bool:
        """Return whether the source is logged and not refused."""
        return self.messages is not None and self.refused is None


def map_streams(log: DecodedLog, rules: Rules, sources: Mapping[str, str]) -> dict[str, Stream]:
    """Return all streams that a decoded log can fill, by stream name.

    `sources` names the source that the manifest wants for a stream; where this log does
    not have it, the order of the mapping decides.
    """
    log = _numbers(log, rules.spec)
    streams = {}
    for name in STREAMS:
        candidates = _ordered(list(_candidates(name, log, rules)), log, rules)
        logged = [item for item in candidates if item.messages is not None]
        named = [
            item
            for item in logged
            if sources.get(name) in (item.label, item.source.name) and item.refused != NO_CLOCK
        ]
        for chosen in named or [item for item in logged if item.usable]:
            stream = _stream(name, chosen, candidates, log, rules)
            if set(stream.columns) != {"time_us"}:  # outputs without any pulse are none
                streams[name] = stream
                break
    return streams


@dataclass(frozen=True)
class OtherSource:
    """One source that a log holds for a stream.

    `refused` is why it cannot be used; if it can, `columns` holds it.
    """

    stream: str
    source: str
    refused: str | None
    columns: Columns | None


def every_source(
    log: DecodedLog, rules: Rules, names: Iterable[str], but: Collection[tuple[str, str]]
) -> Iterator[OtherSource]:
    """Yield the sources that the log holds for streams, but the pairs in `but`."""
    log = _numbers(log, rules.spec)
    for name in names:
        for item in _candidates(name, log, rules):
            if item.messages is not None and (name, item.label) not in but:
                columns = _stream(name, item, [item], log, rules).columns if item.usable else None
                yield OtherSource(name, item.label, item.refused, columns)


def _numbers(log: DecodedLog, spec: FormatStreams) -> DecodedLog:
    """Return the log without columns of text, except those that streams need as text.

    A damaged definition can make text of a measured value.
    """
    texts = {
        column
        for group in spec.streams.values()
        for source in group
        if source.compute in TEXT_STREAMS
        for column in (*source.columns, *source.optional)
    }
    messages = {
        name: replace(
            table,
            columns={
                key: values
                for key, values in table.columns.items()
                if key in texts or values.dtype.kind != "S"
            },
        )
        for name, table in log.messages.items()
    }
    return replace(log, messages=messages)


def _candidates(stream: str, log: DecodedLog, rules: Rules) -> Iterator[Candidate]:
    """Yield every source of a stream with every instance, in mapping order."""
    spec = rules.spec

    def refused(source: StreamSource, messages: Messages) -> str | None:
        if rules.clock(messages, log) is None:
            return NO_CLOCK
        return rules.conditions[source.when](messages, log) if source.when else None

    for source in spec.streams.get(stream, ()):
        messages = _texts(log) if source.message == TEXTS else log.messages.get(source.message)
        if messages is None or not len(messages):
            yield Candidate(source, source.name, None, ABSENT[0])
            continue
        missing = [column for column in source.columns if column not in messages.columns]
        if missing:
            yield Candidate(source, source.name, None, f"{ABSENT[1]} {', '.join(missing)}")
            continue
        why = refused(source, messages)
        for label, rows in _instances(source.name, messages, spec.instance):
            yield Candidate(source, label, rows, why)
        for name, sibling in log.messages.items():
            # PX4 writes the further instances of a topic as topic.1, topic.2 ...
            if name.startswith(f"{source.message}.") and len(sibling):
                label = f"{source.name}[{name.rsplit('.', 1)[1]}]"
                yield Candidate(source, label, sibling, refused(source, sibling))


def _instances(
    name: str, messages: Messages, instance: tuple[str, ...]
) -> Iterator[tuple[str, Messages]]:
    column = next((key for key in instance if key in messages.columns), None)
    if column is None:
        yield name, messages
        return
    values = np.asarray(messages.columns[column])
    if values.dtype.kind == "f":  # records of a layout from when there was one sensor only
        values = np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)
    instances = np.unique(values)
    if instances.size < MIN_INSTANCES:
        yield name, messages
        return
    for item in instances:
        yield f"{name}[{int(item)}]", messages.rows(values == item)


def _texts(log: DecodedLog) -> Messages:
    """Return the vehicle's texts, where the format has no message type for them."""
    stamps = np.array([stamp for stamp, _ in log.texts], np.int64)
    columns: dict[str, Column] = {
        "timestamp": stamps,
        "text": np.array([text for _, text in log.texts], object),
    }
    return Messages(TEXTS, columns, np.zeros(stamps.size, np.int64))


def _ordered(candidates: list[Candidate], log: DecodedLog, rules: Rules) -> list[Candidate]:
    """Return the candidates that share a `choose` rule in the order of their score.

    They share the places that such candidates have; the others stay.
    """
    result = list(candidates)
    for rule in {item.source.choose for item in candidates if item.source.choose}:
        scored = [
            (rules.scores[rule](item.messages, log), place)
            for place, item in enumerate(candidates)
            if item.source.choose == rule and item.messages is not None
        ]
        for (_, place), (_, best) in zip(scored, sorted(scored), strict=True):
            result[place] = candidates[best]
    return result


def _stream(
    name: str, chosen: Candidate, candidates: list[Candidate], log: DecodedLog, rules: Rules
) -> Stream:
    messages, source = chosen.messages, chosen.source
    assert messages is not None
    time_us = rules.clock(messages, log)
    assert time_us is not None
    columns = (
        rules.compute[source.compute](messages, time_us, log)
        if source.compute
        else linear(name, messages, source)
    )
    columns = {key: laid_down(values) for key, values in {"time_us": time_us, **columns}.items()}
    rows = columns["time_us"].size
    place = messages.offset if rows == len(messages) else np.zeros(rows, np.int64)
    notes = [f"{name}: {source.note}"] if source.note else []
    if chosen.refused is not None:
        notes.append(
            f"{name} is taken from {chosen.label} because the manifest says so, although:"
            f" {chosen.refused}"
        )
    logged = {item.source.name for item in candidates if item.messages is not None}
    status = [
        {
            "source": item.label,
            "columns": ", ".join(item.source.columns),
            "status": "used" if item is chosen else item.refused or "available",
        }
        for item in candidates
        # Other column names of older firmware are not worth a line where the message is
        # there under the newer ones.
        if item.messages is not None or item.source.name not in logged
    ]
    return Stream(name, columns, place, chosen.label, tuple(status), tuple(notes))


def rate_hz(time_us: Ints) -> float:
    """Return the median sample rate; 0 for fewer than two samples."""
    step = float(np.median(np.diff(np.sort(time_us)))) if time_us.size > 1 else 0.0
    return 1e6 / step if step > 0.0 else 0.0


def linear(stream: str, messages: Messages, source: StreamSource) -> Columns:
    """Return fields that are one column each: unit to SI, sign.

    The unit that the log declares goes before that of the mapping, if not forced.
    """
    columns: Columns = {}
    for name, rule in source.fields.items():
        target = schema(stream).columns[name].unit
        declared = messages.units.get(rule.column, "")
        unit = (
            declared
            if not rule.forced and declared not in ("", "#") and convertible(declared, target)
            else rule.unit
        )
        factor, offset = factor_and_offset(unit, target)
        with np.errstate(over="ignore"):  # of damaged values
            values = rule.sign * (factor * messages.floats(rule.column) + offset)
            columns[name] = laid_down(values)
    return columns
