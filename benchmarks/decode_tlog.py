"""Telemetry log to columns: pymavlink against auvid's reader, on one real log repeated,
in one run.

    python -m benchmarks.decode_tlog LOG.tlog

pymavlink's messages are collected into one array per field, as the reader returns them.
Peak memory is measured in a run of its own.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
import tracemalloc
from pathlib import Path

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import mavlink
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.tlog.byte_account import explain
from auvid.stages.ingest.formats.tlog.reader import TLOG
from benchmarks.measuring import best, columns_bytes, columns_of

PAUSE_US = 50_000
SMALL_BYTES = 20_000


def repeated(data: npt.NDArray[np.uint8], megabytes: float) -> npt.NDArray[np.uint8]:
    """The proven records of a log, repeated to at least `megabytes`, with time stamps
    that go on from copy to copy.
    """
    records = explain(data).records
    span = int(records.stamp[-1] - records.stamp[0]) + PAUSE_US
    inside = np.zeros(data.size + 1, dtype=np.int64)
    np.add.at(inside, records.start, 1)
    np.add.at(inside, records.stop, -1)
    kept = np.cumsum(inside)[:-1] > 0
    stamp_at = records.start[:, None] + np.arange(mavlink.STAMP_BYTES)
    copies = []
    for number in range(int(np.ceil(megabytes * 1e6 / np.count_nonzero(kept)))):
        copy = data.copy()
        copy[stamp_at] = (
            (records.stamp + number * span)
            .astype(">u8")
            .view(np.uint8)
            .reshape(-1, mavlink.STAMP_BYTES)
        )
        copies.append(copy[kept])
    return np.concatenate(copies)


def read_with_pymavlink(path: str) -> dict[str, dict[str, npt.NDArray[np.generic]]]:
    """Every message that pymavlink finds, as arrays by message type and field."""
    from pymavlink import mavutil

    link = mavutil.mavlink_connection(path, dialect="ardupilotmega")
    columns = columns_of(
        message
        for message in iter(link.recv_msg, None)
        if not message.get_type().startswith(("BAD_DATA", "UNKNOWN"))
    )
    link.close()
    return columns


def measure(log_path: str | Path, megabytes: float = 20.0) -> dict[str, float]:
    """MB/s of both readers and their ratio (best of seven runs for ours), the time for
    a 20 kB log, and peak memory.
    """
    data = repeated(np.fromfile(log_path, dtype=np.uint8), megabytes)
    size_mb = data.size / 1e6
    mavlink.crc_extras()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "repeated.tlog"
        data.tofile(path)
        begin = time.perf_counter()
        theirs = read_with_pymavlink(str(path))
        theirs_s = time.perf_counter() - begin
        ours_s, small_s = best(
            lambda: TLOG.read(RawFile(path.name, np.memmap(path, dtype=np.uint8, mode="r"))),
            lambda: TLOG.read(RawFile("small.tlog", data[:SMALL_BYTES])),
        )
    their_messages = sum(next(iter(columns.values())).size for columns in theirs.values())
    del theirs
    tracemalloc.start()
    log = TLOG.read(RawFile("repeated.tlog", data))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {
        "size_mb": size_mb,
        "messages": float(sum(log.counts.values())),
        "pymavlink_messages": float(their_messages),
        "pymavlink_mb_s": size_mb / theirs_s,
        "auvid_mb_s": size_mb / ours_s,
        "ratio": theirs_s / ours_s,
        "small_log_ms": small_s * 1e3,
        "peak_over_input_and_columns": (peak + data.size) / (data.size + columns_bytes(log)),
    }


if __name__ == "__main__":
    print(
        json.dumps({key: round(value, 3) for key, value in measure(sys.argv[1]).items()}, indent=2)
    )
