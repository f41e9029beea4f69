"""DataFlash text log to columns: pymavlink against auvid's reader, on one real log
printed as text and repeated, in one run.

    python -m benchmarks.decode_text LOG.BIN

The binary log is printed as firmware prints text logs. pymavlink's messages are
collected into one array per field.
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

from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from auvid.stages.ingest.formats.dataflash.text_reader import DATAFLASH_TEXT
from benchmarks.measuring import columns_bytes, columns_of

NOT_REPEATED = ("FMT", "FMTU", "UNIT", "MULT", "PARM")


def printed(log: DecodedLog, megabytes: float) -> bytes:
    """All records as lines, in the order of the log; those with data repeated to at
    least `megabytes`.
    """
    lines: list[tuple[int, str, str]] = []
    for name, table in log.messages.items():
        columns = [column.tolist() for column in table.columns.values()]
        for offset, *row in zip(table.offset.tolist(), *columns, strict=True):
            cells = [
                value.decode("latin-1") if isinstance(value, bytes) else repr(value)
                for value in row
            ]
            lines.append((offset, name, f"{name}, {', '.join(cells)}\n"))
    lines.sort()
    first = "".join(line for _, _, line in lines).encode()
    again = "".join(line for _, name, line in lines if name not in NOT_REPEATED).encode()
    return first + again * max(0, int(np.ceil((megabytes * 1e6 - len(first)) / len(again))))


def read_with_pymavlink(path: str) -> dict[str, dict[str, npt.NDArray[np.generic]]]:
    """Every message that pymavlink finds, as arrays by message type and field."""
    from pymavlink.DFReader import DFReader_text

    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        log = DFReader_text(path)
        return columns_of(iter(log.recv_msg, None))


def measure(log_path: str | Path, megabytes: float = 20.0) -> dict[str, float]:
    """MB/s of both readers and their ratio (ours best of three); peak memory over input
    plus decoded columns.
    """
    data = printed(DATAFLASH.read(RawFile("log", np.fromfile(log_path, np.uint8))), megabytes)
    buffer, size_mb = np.frombuffer(data, np.uint8), len(data) / 1e6
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "printed.log"
        path.write_bytes(data)
        begin = time.perf_counter()
        theirs = read_with_pymavlink(str(path))
        theirs_s = time.perf_counter() - begin
    their_messages = sum(next(iter(columns.values())).size for columns in theirs.values())
    del theirs
    ours_s = float("inf")
    for _ in range(3):
        begin = time.perf_counter()
        DATAFLASH_TEXT.read(RawFile("printed.log", buffer))
        ours_s = min(ours_s, time.perf_counter() - begin)
    tracemalloc.start()
    log = DATAFLASH_TEXT.read(RawFile("printed.log", buffer))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {
        "size_mb": size_mb,
        "messages": float(sum(log.counts.values())),
        "pymavlink_messages": float(their_messages),
        "pymavlink_mb_s": size_mb / theirs_s,
        "auvid_mb_s": size_mb / ours_s,
        "ratio": theirs_s / ours_s,
        "peak_over_input_and_columns": (peak + len(data)) / (len(data) + columns_bytes(log)),
    }


if __name__ == "__main__":
    print(
        json.dumps({key: round(value, 3) for key, value in measure(sys.argv[1]).items()}, indent=2)
    )
