"""From decoded messages to streams: the declared mapping
(data_schemas/formats/streams.yaml) carried out.

Values become SI, body frame forward-right-down and north-east-down here, once. Which
source fills a stream is decided by the order of the mapping; the manifest can replace
it (`sources: {depth: "BARO[1]"}`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import STREAMS, FormatStreams, Source, format_streams
from auvid.data_schemas.units import convertible, factor_and_offset
from auvid.stages.ingest.decoded_log import DecodedLog, Messages

Columns = dict[str, npt.NDArray[Any]]
Compute = Callable[[Messages, DecodedLog], Columns]
Condition = Callable[[Messages, DecodedLog], str | None]
Score = Callable[[Messages, DecodedLog], float]
Clock = Callable[[Messages, DecodedLog], npt.NDArray[np.int64] | None]
FEW = 2
TEXTS = "TEXTS"
WORDS = frozenset({"texts", "modes"})  # what computes streams from text


@dataclass(frozen=True)
class Rules:
    """What a format adds to its declared mapping: its clock, and the functions that the
    mapping names.
    """

    clock: Clock
    compute: Mapping[str, Compute] = field(default_factory=dict)
    conditions: Mapping[str, Condition] = field(default_factory=dict)
    scores: Mapping[str, Score] = field(default_factory=dict)
    utc: Callable[[DecodedLog], int | None] = lambda log: None
    """What to add to the clock to get microseconds since 1970 UTC, or None where the
    log does not say.
    """
    also: frozenset[str] = frozenset()
    """Message types that the functions read besides those of the mapping."""

    def messages(self, mapping: str) -> frozenset[str]:
        """All message types that have to be decoded for the streams of a format."""
        spec = format_streams(mapping)
        assert spec is not None
        return spec.messages | self.also


@dataclass(frozen=True)
class Stream:
    """One stream of a log in SI on its own clock.

    `columns` are fields of the stream's schema with `time_us` (n,) int64; `place` (n,)
    is the byte offset (CSV: row) of each sample. `alternatives` lists every way the log
    could fill the stream, in order, each with its status.
    """

    name: str
    columns: Columns
    place: npt.NDArray[np.int64]
    source: str
    alternatives: tuple[dict[str, str], ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.place.size)

    def rows(self, kept: npt.NDArray[Any]) -> Stream:
        """The stream with these rows only."""
        return replace(
            self,
            columns={key: values[kept] for key, values in self.columns.items()},
            place=self.place[kept],
        )


@dataclass(frozen=True)
class Candidate:
    """One source with one instance of its sensor, and why it cannot be used (None if it
    can).
    """

    source: Source
    label: str
    messages: Messages | None
    refused: str | None


def map_streams(
    log: DecodedLog, mapping: str, rules: Rules, wanted: Mapping[str, str]
) -> dict[str, Stream]:
    """All streams that a decoded log can fill, by stream name.

    `wanted` names the source that the manifest wants for a stream; where this log does
    not have it, the order of the mapping decides.
    """
    spec = format_streams(mapping)
    assert spec is not None
    log = _numbers(log, spec)
    streams = {}
    for name in STREAMS:
        candidates = _ordered(
            [
                item
                for source in spec.streams.get(name, ())
                for item in _candidates(source, log, rules, spec)
            ],
            log,
            rules,
        )
        chosen = _chosen(candidates, wanted.get(name))
        if chosen is not None:
            streams[name] = _stream(name, chosen, candidates, log, rules)
    return streams


@dataclass(frozen=True)
class OtherSource:
    """One source that a log holds for a stream: why it is refused (None if it is not),
    and its columns if it is not.
    """

    stream: str
    source: str
    refused: str | None
    columns: Columns | None


def every_source(
    log: DecodedLog, mapping: str, rules: Rules, names: Iterable[str]
) -> Iterator[OtherSource]:
    """All sources that the log holds for the named streams, used or not, so that they
    can be compared.
    """
    spec = format_streams(mapping)
    assert spec is not None
    log = _numbers(log, spec)
    for name in names:
        for source in spec.streams.get(name, ()):
            for item in _candidates(source, log, rules, spec):
                if item.messages is not None:
                    columns = (
                        None
                        if item.refused is not None
                        else _stream(name, item, [item], log, rules).columns
                    )
                    yield OtherSource(name, item.label, item.refused, columns)


def _numbers(log: DecodedLog, spec: FormatStreams) -> DecodedLog:
    """The log without columns of text, save those that are read as words: a damaged
    definition can make text of a measured value.
    """
    words = {
        column
        for group in spec.streams.values()
        for source in group
        if source.compute in WORDS
        for column in (*source.columns, *source.optional)
    }
    messages = {
        name: replace(
            table,
            columns={
                key: values
                for key, values in table.columns.items()
                if key in words or values.dtype.kind != "S"
            },
        )
        for name, table in log.messages.items()
    }
    return replace(log, messages=messages)


def _candidates(
    source: Source, log: DecodedLog, rules: Rules, spec: FormatStreams
) -> Iterator[Candidate]:
    messages = _texts(log) if source.message == TEXTS else log.messages.get(source.message)
    if messages is None or not len(messages):
        yield Candidate(source, source.name, None, "not logged")
        return
    missing = [column for column in source.columns if column not in messages.columns]
    if missing:
        yield Candidate(source, source.name, None, f"has no column {', '.join(missing)}")
        return
    refused = rules.conditions[source.when](messages, log) if source.when else None
    if rules.clock(messages, log) is None:
        refused = "has no time stamp"
    for label, rows in _instances(source.name, messages, spec.instance):
        yield Candidate(source, label, rows, refused)
    for name, sibling in log.messages.items():
        # PX4 writes the further instances of a topic as topic.1, topic.2 ...
        if name.startswith(f"{source.message}.") and len(sibling):
            refused = rules.conditions[source.when](sibling, log) if source.when else None
            if rules.clock(sibling, log) is None:
                refused = "has no time stamp"
            yield Candidate(source, f"{source.name}[{name.rsplit('.', 1)[1]}]", sibling, refused)


def _instances(
    name: str, messages: Messages, instance: tuple[str, ...]
) -> Iterator[tuple[str, Messages]]:
    column = next((key for key in instance if key in messages.columns), None)
    if column is None:
        yield name, messages
        return
    values = np.asarray(messages.columns[column])
    if values.dtype.kind == "f":
        values = np.nan_to_num(
            values, nan=0.0, posinf=0.0, neginf=0.0
        )  # records of a layout from when there was one sensor only
    found = np.unique(values)
    if found.size < FEW:
        yield name, messages
        return
    for item in found:
        yield f"{name}[{int(item)}]", select(messages, values == item)


def _texts(log: DecodedLog) -> Messages:
    """The text messages of the vehicle where the format has no message type for them."""
    stamps = np.array([stamp for stamp, _ in log.texts], np.int64)
    return Messages(
        TEXTS,
        {"timestamp": stamps, "text": np.array([text for _, text in log.texts], object)},
        np.zeros(stamps.size, np.int64),
    )


def select(messages: Messages, rows: npt.NDArray[Any]) -> Messages:
    """The given rows of a message type."""
    return replace(
        messages,
        columns={key: values[rows] for key, values in messages.columns.items()},
        offset=messages.offset[rows],
    )


def _ordered(candidates: list[Candidate], log: DecodedLog, rules: Rules) -> list[Candidate]:
    """The candidates that share a `choose` rule by their score, at the places that such
    candidates have; the others stay.
    """
    result = list(candidates)
    for rule in {item.source.choose for item in candidates if item.source.choose}:
        places = [
            index
            for index, item in enumerate(candidates)
            if item.source.choose == rule and item.messages is not None
        ]
        scores = [rules.scores[rule](candidates[index].messages, log) for index in places]  # type: ignore[arg-type]
        for place, (_, index) in zip(places, sorted(zip(scores, places, strict=True)), strict=True):
            result[place] = candidates[index]
    return result


def _chosen(candidates: list[Candidate], wanted: str | None) -> Candidate | None:
    usable = [item for item in candidates if item.messages is not None]
    named = next((item for item in usable if wanted in (item.label, item.source.name)), None)
    return named or next((item for item in usable if item.refused is None), None)


def _stream(
    name: str, chosen: Candidate, candidates: list[Candidate], log: DecodedLog, rules: Rules
) -> Stream:
    messages, source = chosen.messages, chosen.source
    assert messages is not None
    columns = (
        rules.compute[source.compute](messages, log)
        if source.compute
        else linear(name, messages, source)
    )
    if "time_us" not in columns:
        time_us = rules.clock(messages, log)
        assert time_us is not None
        columns = {"time_us": time_us, **columns}
    place = (
        messages.offset
        if columns["time_us"].size == len(messages)
        else np.zeros(columns["time_us"].size, np.int64)
    )
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
            "status": _status(item, chosen),
        }
        for item in candidates
        # Other column names of older firmware are not worth a line where the message is
        # there under the newer ones.
        if item.messages is not None or item.source.name not in logged
    ]
    return Stream(name, columns, place, chosen.label, tuple(status), tuple(notes))


def rate_hz(time_us: npt.NDArray[np.int64]) -> float:
    """Median sample rate; 0 for fewer than two samples."""
    step = float(np.median(np.diff(np.sort(time_us)))) if time_us.size > 1 else 0.0
    return 1e6 / step if step > 0.0 else 0.0


def _status(item: Candidate, chosen: Candidate) -> str:
    return "used" if item is chosen else item.refused or "available"


def linear(stream: str, messages: Messages, source: Source) -> Columns:
    """Fields that are one column each: unit to SI, sign. The unit that the log declares
    goes before that of the mapping, if not forced.
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
        # Damage can leave a signalling NaN, which numpy warns of when it widens the
        # value.
        with np.errstate(invalid="ignore", over="ignore"):
            columns[name] = rule.sign * (
                factor * np.asarray(messages.columns[rule.column], dtype=np.float64) + offset
            )
    return columns
