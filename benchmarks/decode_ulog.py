"""ULog file to columns: pyulog against auvid's reader, on the data section of one real
log repeated, in one run.

    python -m benchmarks.decode_ulog LOG.ulg

Both give one array per field of every topic. Peak memory is measured in a run of its
own.
"""

from __future__ import annotations

import io
import json
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import ulog as layout
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.ulog.reader import ULOG
from benchmarks.measuring import columns_bytes


def repeated(data: npt.NDArray[np.uint8], megabytes: float) -> npt.NDArray[np.uint8]:
    """A complete log followed by its data section, without the subscriptions, as often
    as makes `megabytes`.
    """
    log = ULOG.read(RawFile("log", data))
    if log.status != "complete":
        raise ValueError("the log to repeat must be complete")
    raw, place, body = (
        data.tobytes(),
        min(int(table.offset[0]) for table in log.messages.values()),
        [],
    )
    while place < len(raw):
        stop = (
            place + layout.MESSAGE_HEADER_BYTES + int.from_bytes(raw[place : place + 2], "little")
        )
        if raw[place + 2] != ord("A"):
            body.append(raw[place:stop])
        place = stop
    again = np.frombuffer(b"".join(body), np.uint8)
    return np.concatenate(
        [data, *[again] * max(0, int(np.ceil((megabytes * 1e6 - data.size) / again.size)))]
    )


def read_with_pyulog(data: npt.NDArray[np.uint8]) -> int:
    """Number of records that pyulog reads."""
    from pyulog import ULog

    log = ULog(io.BytesIO(data.tobytes()))
    return sum(len(item.data["timestamp"]) for item in log.data_list)


def measure(log_path: str | Path, megabytes: float = 20.0) -> dict[str, float]:
    """MB/s of both readers and their ratio, best of three; milliseconds for the log
    itself; peak memory of ours (what it allocates, and the input) over input plus
    decoded columns.
    """
    original = np.fromfile(log_path, dtype=np.uint8)
    data = repeated(original, megabytes)
    size_mb = data.size / 1e6
    seconds: dict[str, float] = {}
    records: dict[str, int] = {}
    for _ in range(3):
        for name in ("pyulog", "auvid", "auvid once"):
            begin = time.perf_counter()
            if name == "pyulog":
                records[name] = read_with_pyulog(data)
            else:
                records[name] = sum(
                    ULOG.read(
                        RawFile("log", original if name == "auvid once" else data)
                    ).counts.values()
                )
            seconds[name] = min(seconds.get(name, np.inf), time.perf_counter() - begin)
    tracemalloc.start()
    log = ULOG.read(RawFile("log", data))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    if records["pyulog"] != records["auvid"]:
        raise ValueError(f"the readers disagree on the number of records: {records}")
    return {
        "megabytes": size_mb,
        "messages": float(records["auvid"]),
        "pyulog_mb_s": size_mb / seconds["pyulog"],
        "auvid_mb_s": size_mb / seconds["auvid"],
        "ratio": seconds["pyulog"] / seconds["auvid"],
        "log_itself_ms": 1e3 * seconds["auvid once"],
        "peak_over_input_and_columns": (peak + data.size) / (data.size + columns_bytes(log)),
    }


if __name__ == "__main__":
    print(
        json.dumps({key: round(value, 3) for key, value in measure(sys.argv[1]).items()}, indent=2)
    )
