"""Every log of a folder, field by field: auvid's readers against pymavlink and pyulog.
Prints a table; exit code 1 if they disagree.

    python -m tests.support.agreement FOLDER

Every record that the other library reads must be there with the same values in every
field. Of a damaged log this holds for the records of its chain: those that begin where
another ends and end where another begins, as the other library sees it (frames with a
checksum: for all). What auvid reads beyond that is counted as `more`. A file that the
other library cannot read at all is named with its error. CSV logs have no such library;
they are left out.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import track
from rich.table import Table

from auvid.data_schemas.errors import PipelineError
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.tlog.byte_account import BAD_STAMP, explain
from auvid.stages.ingest.registry import READERS, reader_of

Column = npt.NDArray[np.generic]
TABLE_WIDTH = 200
BY_NAME = {reader.name: reader for reader in READERS}


@dataclass
class Agreement:
    """How one file compares: records of both sides, columns compared, records missing
    on our side, columns that differ.
    """

    file: str
    format: str = ""
    status: str = ""
    ours: int = 0
    theirs: int = 0
    columns: int = 0
    missing: list[str] = field(default_factory=list)
    differing: list[str] = field(default_factory=list)
    note: str = ""

    @property
    def agrees(self) -> bool:
        return not self.missing and not self.differing


def equal(ours: Column, theirs: list[Any]) -> bool:
    """Whether a column has the values of the other library; text as bytes up to the
    first NUL.
    """
    if ours.dtype.kind == "S":
        return [bytes(value) for value in ours.tolist()] == [_raw(value) for value in theirs]
    return bool(np.array_equal(ours, np.asarray(theirs), equal_nan=ours.dtype.kind == "f"))


def _raw(value: Any) -> bytes:
    raw = value if isinstance(value, bytes) else str(value).encode("utf-8", "surrogateescape")
    return raw.split(b"\0", 1)[0]


def _as_text(ours: Column) -> Column:
    """What pymavlink makes of text: UTF-8, or Latin-1 where it is not."""

    def words(raw: bytes) -> bytes:
        try:
            return raw.decode("utf-8").encode()
        except UnicodeDecodeError:
            return raw.decode("latin-1").encode()

    return (
        np.array([words(raw) for raw in ours.tolist()], "S")
        if ours.size and ours.dtype.kind == "S"
        else ours
    )


def _quietly(read: Callable[[], Any]) -> Any:
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        return read()


def compare_dataflash(path: Path, log: DecodedLog, agreement: Agreement) -> None:
    """Records are paired by their offset."""
    from pymavlink.DFReader import DFReader_binary

    def read() -> list[tuple[int, int, Any]]:
        reader, records = DFReader_binary(str(path)), []
        while (message := reader.recv_msg()) is not None:
            records.append((reader.offset - message.fmt.len, reader.offset, message))
        reader.close()
        return records

    theirs = _quietly(read)
    rows = {
        name: {int(at): row for row, at in enumerate(table.offset)}
        for name, table in log.messages.items()
    }
    matched: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    size = path.stat().st_size
    for index, (start, stop, message) in enumerate(theirs):
        name = message.get_type()
        if start in rows.get(name, ()):
            matched[name].append((rows[name][start], message))
            continue
        follows = theirs[index + 1][0] if index + 1 < len(theirs) else size
        before = theirs[index - 1][1] if index else 0
        if log.status == "complete" or (before == start and follows == stop):
            agreement.missing.append(f"{name} at byte {start}")
    agreement.theirs = len(theirs)
    _compare_columns(log, matched, agreement)


def _compare_columns(
    log: DecodedLog, matched: dict[str, list[tuple[int, Any]]], agreement: Agreement
) -> None:
    """Columns of records that both sides have; where a type has several layouts, those
    fields that a record has.
    """
    for name, pairs in matched.items():
        table = log.messages[name]
        fields: dict[str, tuple[list[int], list[Any]]] = defaultdict(lambda: ([], []))
        for row, message in pairs:
            for key in message.get_fieldnames():
                fields[key][0].append(row)
                fields[key][1].append(getattr(message, key))
        for key, (where, values) in fields.items():
            agreement.columns += 1
            if isinstance(values[0], bytes):  # the contents of a file, in which NUL is a value
                same = [value.rstrip(b"\0") for value in values] == table.columns[key][
                    where
                ].tolist()
            else:
                same = key in table.columns and equal(_as_text(table.columns[key][where]), values)
            if not same:
                agreement.differing.append(f"{name}.{key}")


def compare_text(path: Path, log: DecodedLog, agreement: Agreement) -> None:
    """Records are paired by their order; pymavlink ends a text at its first comma and
    drops a unit without a label.
    """
    from pymavlink.DFReader import DFReader_text

    def read() -> dict[str, list[Any]]:
        records: dict[str, list[Any]] = defaultdict(list)
        reader = DFReader_text(str(path))
        while (message := reader.recv_msg()) is not None:
            records[message.get_type()].append(message)
        reader.close()
        return records

    theirs = _quietly(read)
    agreement.theirs = sum(map(len, theirs.values()))
    for name, messages in theirs.items():
        if len(messages) > log.counts.get(name, 0):
            agreement.missing.append(f"{len(messages) - log.counts.get(name, 0)} {name}")
        elif name not in ("MSG", "UNIT") and len(messages) == log.counts[name]:
            _compare_columns(log, {name: list(enumerate(messages))}, agreement)


def compare_tlog(path: Path, log: DecodedLog, agreement: Agreement) -> None:
    """Frames are paired by their bytes, equal ones in their order; frames whose own
    time stamp is damaged are no records for auvid.
    """
    from pymavlink import mavutil

    def read() -> list[Any]:
        link, records = mavutil.mavlogfile(str(path)), []
        while (message := link.recv_msg()) is not None:
            if message.get_type() != "BAD_DATA" and not message.get_type().startswith("UNKNOWN"):
                records.append(message)
        link.close()
        return records

    mavutil.set_dialect("ardupilotmega")
    theirs = _quietly(read)
    data = path.read_bytes()
    records = explain(np.frombuffer(data, np.uint8)).records
    stop = dict(zip(records.start.tolist(), records.stop.tolist(), strict=True))
    missing = Counter(bytes(message.get_msgbuf()) for message in theirs)
    missing.subtract(data[start + 8 : end] for start, end in stop.items())
    corrupted = sum(part.count for part in log.account.skipped if part.reason == BAD_STAMP)
    lost = sum(count for count in missing.values() if count > 0)
    agreement.missing += [f"{lost - corrupted} frames"] if lost > corrupted else []
    agreement.note = f"{corrupted} frames have a damaged time stamp" if corrupted else ""
    agreement.theirs = len(theirs)
    rows_of: dict[bytes, list[int]] = defaultdict(list)
    for table in log.messages.values():
        for row, at in enumerate(table.offset.tolist()):
            rows_of[data[at + 8 : stop[at]]].append(row)
    matched: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    met: Counter[bytes] = Counter()
    for message in theirs:
        raw = bytes(message.get_msgbuf())
        if met[raw] < len(rows_of.get(raw, ())):
            matched[message.get_type()].append((rows_of[raw][met[raw]], message))
        met[raw] += 1
    for name, pairs in matched.items():
        table, where = log.messages[name], [row for row, _ in pairs]
        for key in pairs[0][1].get_fieldnames():
            agreement.columns += 1
            values = [
                getattr(message, f"_{key}_raw", getattr(message, key)) for _, message in pairs
            ]
            if not equal(table.columns[key][where], values):
                agreement.differing.append(f"{name}.{key}")
        if log.status == "complete":
            agreement.columns += 1
            if table.columns["time_unix_us"][where].tolist() != [
                round(message._timestamp * 1e6) for _, message in pairs
            ]:
                agreement.differing.append(f"{name} time stamp")


def compare_ulog(path: Path, log: DecodedLog, agreement: Agreement) -> None:
    """Records are paired by their order; of damaged logs by their bytes, as pyulog has
    no offsets.
    """
    from pyulog import ULog

    theirs = _quietly(lambda: ULog(str(path)))
    for item in theirs.data_list:
        name = f"{item.name}.{item.multi_id}" if item.multi_id else item.name
        count = len(item.data["timestamp"])
        agreement.theirs += count
        table = log.messages.get(name)
        if table is None or len(table) < count:
            agreement.missing.append(f"{count - (0 if table is None else len(table))} {name}")
            continue
        for key, column in table.columns.items():
            if column.dtype.kind == "S":
                continue  # pyulog gives one column per character
            agreement.columns += 1
            if len(table) != count:
                rows = np.flatnonzero(np.isin(table.columns["timestamp"], item.data["timestamp"]))[
                    :count
                ]
                column = column[rows]
            if column.tobytes() != np.ascontiguousarray(item.data[key]).tobytes():
                agreement.differing.append(f"{name}.{key}")


COMPARE: dict[str, Callable[[Path, DecodedLog, Agreement], None]] = {
    "dataflash": compare_dataflash,
    "dataflash_text": compare_text,
    "tlog": compare_tlog,
    "ulog": compare_ulog,
}


def compare(path: Path, name: str) -> Agreement | None:
    """One file, or None for one that no reader with an oracle recognises."""
    file = RawFile(
        name, np.memmap(path, np.uint8, "r") if path.stat().st_size else np.zeros(0, np.uint8)
    )
    try:
        reader = reader_of(file)
    except PipelineError:
        return None
    if reader.name not in COMPARE:
        return None
    log = reader.read(file)
    agreement = Agreement(name, reader.name, log.status, sum(log.counts.values()))
    try:
        COMPARE[reader.name](path, log, agreement)
    except (
        TypeError,
        ValueError,
        KeyError,
        IndexError,
        AttributeError,
        UnicodeDecodeError,
    ) as fault:
        agreement.note = f"the other library fails: {type(fault).__name__}: {fault}"[:80]
    return agreement


def table_of(results: Iterable[Agreement]) -> Table:
    """One row per file."""
    table = Table(
        "file",
        "reader",
        "status",
        "auvid",
        "other library",
        "more",
        "columns",
        "missing",
        "differing",
        "remark",
    )
    for one in results:
        more = str(one.ours - one.theirs) if one.theirs else "-"
        cells = (one.ours, one.theirs, more, one.columns, len(one.missing), len(one.differing))
        remark = "; ".join([one.note, *one.missing[:3], *one.differing[:3]]).strip("; ")
        table.add_row(one.file, one.format, one.status, *map(str, cells), remark)
    return table


def main() -> int:
    """Compare all; print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    console = Console(width=None if sys.stdout.isatty() else TABLE_WIDTH)
    agreements = [
        compare(path, str(path.relative_to(folder)))
        for path in track(files, "comparing", console=Console(stderr=True))
    ]
    results = [one for one in agreements if one is not None]
    console.print(table_of(results))
    bad = [one.file for one in results if not one.agrees]
    console.print(
        f"{len(results)} logs, {len(agreements) - len(results)} other files; "
        + (f"disagree: {', '.join(bad)}" if bad else "all agree")
    )
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
