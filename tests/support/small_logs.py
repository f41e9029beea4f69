"""One log of about 20 kB per reader, cut from the real logs of this repository, with
the place of every record and of what defines it; of binary formats also one of some
kB, with a few records of every type.

The binary logs keep the records of a few message types in the order of the file; the
text log is the binary one printed as firmware prints it; the CSV log is the head of the
inertial record of campaign bluerov2_dvl_csv.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import dataflash, ulog
from auvid.data_schemas.yaml_text import read_yaml
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog, LogReader
from auvid.stages.ingest.formats.csv.reader import CSV
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from auvid.stages.ingest.formats.dataflash.text_reader import DATAFLASH_TEXT
from auvid.stages.ingest.formats.tlog.byte_account import explain
from auvid.stages.ingest.formats.tlog.reader import TLOG
from auvid.stages.ingest.formats.ulog.reader import ULOG

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
BYTES = 20_000
TYPES = "FMT UNIT FMTU MULT PARM MSG MODE RCOU BARO BAT IMU ATT CTUN RATE XKF1 VIBE"
TOPICS = (
    "sensor_combined",
    "vehicle_attitude",
    "actuator_outputs",
    "battery_status",
    "vehicle_air_data",
    "vehicle_status",
)
FEW = 20
SHORT = 3
"""Records of a type in a short log."""

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Places:
    """Of every record of a log: `start` and `stop` (n,) of the bytes that it needs,
    `first` of its own bytes, index of its `type` (n,).

    `needs` names, for each type, the byte ranges that define it, shape (m, 2).
    """

    first: Ints
    start: Ints
    stop: Ints
    type: Ints
    types: tuple[str, ...]
    needs: tuple[Ints, ...]


@dataclass(frozen=True)
class SmallLog:
    """A log, its reader, what the reader gives, and where the records are; `header`
    bytes open its records and name their type.
    """

    name: str
    reader: LogReader
    data: bytes
    columns: Mapping[str, object] | None
    log: DecodedLog
    places: Places
    header: int

    def read(self, data: bytes) -> DecodedLog:
        return self.reader.read(RawFile(self.name, np.frombuffer(data, np.uint8), self.columns))


def _read(
    reader: LogReader, data: bytes, columns: Mapping[str, object] | None = None
) -> DecodedLog:
    return reader.read(RawFile("log", np.frombuffer(data, np.uint8), columns))


def _places(
    log: DecodedLog, stop: Callable[[str, Ints], Ints], needs: Mapping[str, Ints], before: int = 0
) -> Places:
    types = tuple(log.messages)
    offsets = [log.messages[name].offset for name in types]
    first = np.concatenate(offsets)
    return Places(
        first,
        first - before,
        np.concatenate([stop(name, offset) for name, offset in zip(types, offsets, strict=True)]),
        np.repeat(np.arange(len(types)), [offset.size for offset in offsets]),
        types,
        tuple(needs.get(name, np.empty((0, 2), np.int64)) for name in types),
    )


def _definitions(log: DecodedLog) -> tuple[dict[str, int], dict[str, Ints], dict[bytes, int]]:
    """Record length, place of the FMT, and id of each type of a DataFlash log."""
    columns = log.messages["FMT"].columns
    names = [name.decode() for name in columns["Name"].tolist()]
    places = {
        name: np.array([[at, at + dataflash.FMT_BYTES]])
        for name, at in zip(names, log.messages["FMT"].offset.tolist(), strict=True)
    }
    places["FMT"] = np.empty((0, 2), np.int64)
    ids = dict(zip(columns["Name"].tolist(), columns["Type"].tolist(), strict=True))
    return dict(zip(names, columns["Length"].tolist(), strict=True)), places, ids


def _dataflash(each: int | None = None) -> SmallLog:
    data = (DATA / "bluerov2_ugps_small" / "small.BIN").read_bytes()
    log = _read(DATAFLASH, data)
    length, _, ids = _definitions(log)
    kept = {name.encode() for name in TYPES.split()}
    parts: list[tuple[int, int]] = []
    for name, table in log.messages.items():
        rows = np.arange(len(table)) if name.encode() in kept else np.empty(0, np.int64)
        if name == "FMT":
            rows = np.flatnonzero(np.isin(table.columns["Name"], list(kept)))
        elif name == "FMTU":
            rows = np.flatnonzero(np.isin(table.columns["FmtType"], [ids[one] for one in kept]))
        elif name in ("PARM", "UNIT"):
            rows = rows[:FEW]
        if name not in ("FMT", "FMTU"):
            rows = rows[:each]
        parts += [(at, at + length[name]) for at in table.offset[rows].tolist()]
    small = _joined(data, sorted(parts))
    log = _read(DATAFLASH, small)
    length, places, _ = _definitions(log)
    return SmallLog(
        "dataflash",
        DATAFLASH,
        small,
        None,
        log,
        _places(log, lambda name, at: at + length[name], places),
        3,
    )


def _joined(data: bytes, parts: list[tuple[int, int]]) -> bytes:
    """The pieces, one behind the other, as many as fit."""
    sizes = np.cumsum([stop - start for start, stop in parts])
    return b"".join(
        data[start:stop]
        for start, stop in parts[: int(np.searchsorted(sizes, BYTES, side="right"))]
    )


def _text() -> SmallLog:
    log = _dataflash().log
    lines: list[tuple[int, bytes]] = []
    for name, table in log.messages.items():
        columns = [column.tolist() for column in table.columns.values()]
        for offset, *row in zip(table.offset.tolist(), *columns, strict=True):
            cells = [value if isinstance(value, bytes) else repr(value).encode() for value in row]
            lines.append((offset, b", ".join([name.encode(), *cells]) + b"\n"))
    joined = b"ArduSub V4.1.0\n" + b"".join(line for _, line in sorted(lines))
    data = joined[: joined.rfind(b"\n", 0, BYTES) + 1]
    log = _read(DATAFLASH_TEXT, data)
    ends = np.flatnonzero(np.frombuffer(data, np.uint8) == ord("\n")) + 1

    def stop(name: str, offset: Ints) -> Ints:
        return ends[np.searchsorted(ends, offset, side="right")]

    defined = log.messages["FMT"]
    spans = np.stack([defined.offset - 1, stop("FMT", defined.offset)], axis=1)
    needs = {
        name.decode(): spans[i : i + 1]
        for i, name in enumerate(defined.columns["Name"].tolist())
        if name != b"FMT"
    }
    # A line needs the line feed before it: without that it is the tail of another.
    return SmallLog(
        "dataflash_text", DATAFLASH_TEXT, data, None, log, _places(log, stop, needs, before=1), 4
    )


def _tlog(each: int | None = None) -> SmallLog:
    data = (DATA / "bluerov2_ugps_small" / "small.tlog").read_bytes()
    records = explain(np.frombuffer(data, np.uint8)).records
    middle = int(np.searchsorted(records.start, len(data) // 2))
    parts = list(zip(records.start[middle:].tolist(), records.stop[middle:].tolist(), strict=True))
    if each is not None:
        parts = _first_of_each(parts, records.message_id[middle:].tolist(), each)
    small = _joined(data, parts)
    records = explain(np.frombuffer(small, np.uint8)).records
    log = _read(TLOG, small)
    start, stop = records.start.astype(np.int64), records.stop.astype(np.int64)
    none = np.empty((0, 2), np.int64)
    places = Places(start, start, stop, np.zeros(start.size, np.int64), ("frame",), (none,))
    return SmallLog("tlog", TLOG, small, None, log, places, 0)


def _first_of_each(
    parts: list[tuple[int, int]], kinds: list[int], each: int
) -> list[tuple[int, int]]:
    """The first `each` parts of every kind, in their order."""
    chosen, count = [], dict.fromkeys(kinds, 0)
    for part, kind in zip(parts, kinds, strict=True):
        count[kind] += 1
        if count[kind] <= each:
            chosen.append(part)
    return chosen


def _messages(data: bytes) -> list[tuple[int, int, str]]:
    """Begin, end and type of every message of a whole ULog file."""
    messages, at = [], ulog.HEADER_BYTES
    while at < len(data):
        stop = at + ulog.MESSAGE_HEADER_BYTES + int.from_bytes(data[at : at + 2], "little")
        messages.append((at, stop, chr(data[at + 2])))
        at = stop
    return messages


def _ulog(each: int | None = None) -> SmallLog:
    data = (DATA / "px4_ulog" / "sample_log_small.ulg").read_bytes()
    numbers: set[bytes] = set()
    parts = [(0, ulog.HEADER_BYTES)]
    count: dict[bytes, int] = {}
    few = FEW if each is None else each
    for start, stop, kind in _messages(data):
        content = data[start + 3 : stop]
        if kind == "F":
            keep = content.split(b":")[0].decode() in TOPICS
        elif kind == "A":
            keep = content[3:].decode() in TOPICS
            numbers |= {content[1:3]} if keep else set()
        elif kind == "D":
            count[content[:2]] = count.get(content[:2], 0) + 1
            keep = content[:2] in numbers and (each is None or count[content[:2]] <= each)
        else:
            count[kind.encode()] = count.get(kind.encode(), 0) + 1
            keep = kind not in "IMPQ" or count[kind.encode()] <= few
        if keep:
            parts.append((start, stop))
    small = _joined(data, parts)
    log = _read(ULOG, small)
    chain = _messages(small)
    ends = {start: stop for start, stop, _ in chain}
    formats = {
        small[start + 3 : stop].split(b":")[0].decode(): (start, stop)
        for start, stop, kind in chain
        if kind == "F"
    }
    needs = {}
    for start, stop, kind in chain:
        if kind == "A":
            instance, topic = small[start + 3], small[start + 6 : stop].decode()
            needs[f"{topic}.{instance}" if instance else topic] = np.array(
                [formats[topic], (start, stop)]
            )
    places = _places(
        log, lambda name, at: np.array([ends[one] for one in at.tolist()], np.int64), needs
    )
    return SmallLog("ulog", ULOG, small, None, log, places, 5)


def _csv() -> SmallLog:
    folder = ROOT / "campaigns" / "bluerov2_dvl_csv"
    data = (folder / "logs" / "imu.csv").read_bytes()
    data = data[: data.rfind(b"\n", 0, BYTES) + 1]
    columns: dict[str, Any] = read_yaml((folder / "columns" / "imu.yaml").read_text())
    log = _read(CSV, data, columns)
    ends = line_ends(data)
    row = log.messages["imu"].offset
    start, stop = ends[row - 2], ends[row - 1]
    places = Places(
        start, start - 1, stop, np.zeros(row.size, np.int64), ("imu",), (np.array([[0, ends[0]]]),)
    )
    return SmallLog("csv", CSV, data, columns, log, places, 1)


def line_ends(data: bytes) -> Ints:
    """The offset behind each line feed, and of the end of the file where the last line
    has none.
    """
    ends = np.flatnonzero(np.frombuffer(data, np.uint8) == ord("\n")) + 1
    return ends if data.endswith(b"\n") else np.append(ends, len(data))


_MAKERS: Mapping[str, Callable[[], SmallLog]] = {
    "dataflash": _dataflash,
    "dataflash_text": _text,
    "tlog": _tlog,
    "ulog": _ulog,
    "csv": _csv,
}
NAMES = tuple(_MAKERS)
BINARY = ("dataflash", "tlog", "ulog")


@cache
def small_log(name: str) -> SmallLog:
    """The small log of a reader."""
    return _MAKERS[name]()


@cache
def short_log(name: str) -> SmallLog:
    """The log of a binary format with `SHORT` records of every type."""
    return {"dataflash": _dataflash, "tlog": _tlog, "ulog": _ulog}[name](SHORT)
