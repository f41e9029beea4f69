"""DataFlash log to columns: pymavlink, auvid's reader and the floor, on one real log
repeated, in one run.

    python -m benchmarks.decode_dataflash LOG.BIN

pymavlink's messages are collected into one array per field, as the reader returns them.
The floor is what no reader of this kind can go below: read the file, look for headers,
gather the records of each type (their places are given) and copy each field to a
column.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
import time
import tracemalloc
from pathlib import Path

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import dataflash as layout
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.accounting import GATHER_BYTES
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH, Index, build_index
from auvid.stages.ingest.formats.dataflash.scan import candidates, read_times
from benchmarks.measuring import best, columns_bytes, columns_of

PAUSE_MS = 10
CLOCKS = ((1, "<u8", 1), (2, "<u4", 1000))
"""Kind of time stamp, as it is stored, and its unit in us: logs before 2015 have TimeMS."""


def repeated(data: npt.NDArray[np.uint8], megabytes: float) -> npt.NDArray[np.uint8]:
    """The records of a log, repeated to at least `megabytes`; FMT only once, time
    stamps that go on from copy to copy.
    """
    index = build_index(data)
    chain = index.chain
    kept = np.zeros(data.size, np.bool_)
    for start, length in zip(chain.offset.tolist(), chain.length.tolist(), strict=True):
        kept[start : start + length] = True
    first = data[kept]
    for start in chain.offset[chain.type == layout.FMT_ID].tolist():
        kept[start : start + layout.FMT_BYTES] = False
    kind = index.clock[chain.entry]
    stamps = read_times(data, chain.offset, kind)
    timed = kind > 0
    if not timed.any():
        raise SystemExit("no record of this log has a time stamp")
    span_ms = int(np.ptp(stamps[timed])) // 1000 + PAUSE_MS
    copies = [first]
    for number in range(1, int(np.ceil(megabytes * 1e6 / max(int(np.count_nonzero(kept)), 1)))):
        copy = data.copy()
        for code, dtype, unit_us in CLOCKS:
            rows = np.flatnonzero(kind == code)
            later = (stamps[rows] // unit_us + number * span_ms * 1000 // unit_us).astype(dtype)
            bytes_of = np.arange(later.itemsize) + layout.HEADER_BYTES
            copy[chain.offset[rows, None] + bytes_of] = later[:, None].view(np.uint8)
        copies.append(copy[kept])
    return np.concatenate(copies)


def read_with_pymavlink(path: str) -> dict[str, dict[str, npt.NDArray[np.generic]]]:
    """Every message that pymavlink finds, as arrays by message type and field."""
    from pymavlink.DFReader import DFReader_binary

    with contextlib.redirect_stderr(io.StringIO()):
        log = DFReader_binary(path)
        columns = columns_of(iter(log.recv_match, None))
        log.close()
    return columns


def read_floor(path: str, index: Index) -> int:
    """Read, scan, gather and copy: nothing is checked, scaled or counted. Returns the
    bytes of the columns.
    """
    data = np.fromfile(path, np.uint8)
    candidates(data)
    chain, total = index.chain, 0
    order = np.argsort(chain.type, kind="stable")
    for part in np.split(
        chain.offset[order], np.cumsum(np.bincount(chain.type, minlength=256))[:-1]
    ):
        if part.size == 0:
            continue
        entry = int(index.definitions.first[data[part[0] + 2]])
        definition = index.definition(entry)
        dtype = definition.record
        records = np.ndarray(
            (data.size - definition.length + 1,), f"V{definition.length}", data, 0, (1,)
        )
        columns = [
            np.empty((part.size, *dtype[name].shape), dtype[name].base)
            for name in dtype.names or ()
        ]
        step = max(1, GATHER_BYTES // definition.length)
        for start in range(0, part.size, step):
            block = records[part[start : start + step]].view(dtype)
            for i, column in enumerate(columns):
                column[start : start + step] = block[f"f{i}"]
        total += sum(column.nbytes for column in columns)
    return total


def measure(log_path: str | Path, megabytes: float = 20.0) -> dict[str, float]:
    """MB/s of pymavlink (one run), of the floor and of auvid (best of seven), their
    ratios, the time for a 20 kB log, and peak memory.
    """
    original = np.fromfile(log_path, np.uint8)
    data = repeated(original, megabytes)
    size_mb = data.size / 1e6
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "repeated.BIN"
        data.tofile(path)
        begin = time.perf_counter()
        theirs = read_with_pymavlink(str(path))
        theirs_s = time.perf_counter() - begin
        their_messages = sum(next(iter(columns.values())).size for columns in theirs.values())
        del theirs
        index = build_index(data)
        ours_s, floor_s, small_s = best(
            lambda: DATAFLASH.read(RawFile(path.name, np.memmap(path, np.uint8, "r"))),
            lambda: read_floor(str(path), index),
            lambda: DATAFLASH.read(RawFile("small.BIN", original[:20_000])),
        )
    tracemalloc.start()
    log = DATAFLASH.read(RawFile("repeated.BIN", data))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {
        "size_mb": size_mb,
        "messages": float(sum(log.counts.values())),
        "pymavlink_messages": float(their_messages),
        "pymavlink_mb_s": size_mb / theirs_s,
        "auvid_mb_s": size_mb / ours_s,
        "floor_mb_s": size_mb / floor_s,
        "ratio": theirs_s / ours_s,
        "of_floor": floor_s / ours_s,
        "small_log_ms": small_s * 1e3,
        "peak_over_input_and_columns": (peak + data.size) / (data.size + columns_bytes(log)),
    }


if __name__ == "__main__":
    print(
        json.dumps({key: round(value, 3) for key, value in measure(sys.argv[1]).items()}, indent=2)
    )
