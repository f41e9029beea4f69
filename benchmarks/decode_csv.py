"""CSV log to streams: a bare pyarrow.csv read of the same file against auvid's reader,
on one real log repeated, in one run.

    python -m benchmarks.decode_csv LOG.csv COLUMNS.yaml

The bare read makes float64 columns of every column of the file and nothing more. Both
use one thread, as auvid reads (Arrow's threads can abort a process at its exit,
apache/arrow#34314); they take turns.
"""

from __future__ import annotations

import json
import sys
import tempfile
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from auvid.data_schemas.yaml_text import read_yaml
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.csv.reader import CSV
from benchmarks.measuring import best, columns_bytes


def repeated(data: bytes, megabytes: float) -> bytes:
    """The header once and the rows as often as makes `megabytes`."""
    header, rows = data.split(b"\n", 1)
    return header + b"\n" + rows * int(np.ceil(megabytes * 1e6 / len(rows)))


def bare_read(path: Path) -> pa.Table:
    """All columns as float64, by one thread."""
    with path.open() as file:
        names = file.readline().strip().split(",")
    return pacsv.read_csv(
        path,
        read_options=pacsv.ReadOptions(use_threads=False),
        convert_options=pacsv.ConvertOptions(column_types=dict.fromkeys(names, pa.float64())),
    )


def measure(
    log_path: str | Path, map_path: str | Path, megabytes: float = 20.0
) -> dict[str, float]:
    """MB/s of both and ours over bare (times); peak memory over input plus columns,
    what pyarrow allocates included.
    """
    original = Path(log_path).read_bytes()
    data = repeated(original, megabytes)
    columns = read_yaml(Path(map_path).read_text())
    size_mb = len(data) / 1e6
    buffer = np.frombuffer(data, np.uint8)
    small = np.frombuffer(original[: original.rfind(b"\n", 0, 20_000) + 1], np.uint8)
    CSV.read(RawFile("small.csv", small, columns))  # what is imported then is not counted
    tracemalloc.start()
    log = CSV.read(RawFile("repeated.csv", buffer, columns))
    peak = tracemalloc.get_traced_memory()[1] + (
        pa.default_memory_pool().max_memory() or 0
    )  # of this process so far
    tracemalloc.stop()
    decoded = columns_bytes(log)
    rows = max(log.counts.values())
    del log
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "repeated.csv"
        path.write_bytes(data)
        bare_s, ours_s, small_s = best(
            lambda: bare_read(path),
            lambda: CSV.read(RawFile(path.name, np.memmap(path, np.uint8, "r"), columns)),
            lambda: CSV.read(RawFile("small.csv", small, columns)),
        )
    return {
        "size_mb": size_mb,
        "rows": float(rows),
        "bare_pyarrow_mb_s": size_mb / bare_s,
        "auvid_mb_s": size_mb / ours_s,
        "time_over_bare": ours_s / bare_s,
        "small_log_ms": small_s * 1e3,
        "peak_over_input_and_columns": (peak + len(data)) / (len(data) + decoded),
    }


if __name__ == "__main__":
    print(
        json.dumps(
            {key: round(value, 3) for key, value in measure(*sys.argv[1:]).items()}, indent=2
        )
    )
