"""Size and speed of a recording: one hour at 50 Hz of 60 channels, whole and as the
preview that pictures are taken of.

    python -m benchmarks.recording [--keep FOLDER]

The channels wander and carry noise, as sensors do; constant ones would pack better.
Asked are at most 10 s and 120 MB. With --keep the recordings stay in FOLDER.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from auvid.pipeline.store.pipes import saved_pieces
from auvid.stages.page.first_screen import Summary
from auvid.stages.report.recording.recording import record
from auvid.stages.report.recording.rerun_stream import PREVIEW_BINS

HOURS, RATE_HZ = 1.0, 50.0
GROUPS, COLUMNS = 10, 6
LIMITS = {"seconds": 10.0, "megabytes": 120.0}


def tables() -> dict[str, pa.Table]:
    """Ten streams of six channels, on the clock of a log."""
    rng = np.random.default_rng(0)
    count = int(3600 * HOURS * RATE_HZ)
    stamps = (np.arange(count) * (1e6 / RATE_HZ)).astype(np.int64)
    streams = {}
    for group in range(GROUPS):
        wander = np.cumsum(rng.standard_normal((count, COLUMNS)), axis=0) * 1e-2
        values = wander + 0.05 * rng.standard_normal((count, COLUMNS))
        columns = {f"c{index}": values[:, index] for index in range(COLUMNS)}
        streams[f"ingest/dive/stream{group}"] = pa.table({"time_us": stamps, **columns})
    return streams


def views() -> dict[str, dict[str, object]]:
    """One group per stream."""
    names = [f"c{index}" for index in range(COLUMNS)]
    groups = [
        {
            "entity": f"raw/stream{group}",
            "table": f"stream{group}",
            "columns": names,
            "names": names,
            "roles": ["raw"] * COLUMNS,
        }
        | {"tab": "Logs", "unit": "1"}
        for group in range(GROUPS)
    ]
    return {"ingest/dive": {"groups": groups}}


def main() -> None:
    """Write both and print the figures as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--keep", type=Path)
    keep = parser.parse_args().keep
    data, view_documents = tables(), views()
    logs = {"dive": {"start_us": 0, "end_us": int(3.6e9 * HOURS)}}
    summary = Summary("fair", "Benchmark", "", None, "validation", (), (), (), (), ())
    figures: dict[str, object] = {
        "channels": GROUPS * COLUMNS,
        "samples": int(3600 * HOURS * RATE_HZ),
        "limits": LIMITS,
    }
    for name, bins in (("preview", PREVIEW_BINS), ("default", 15_000), ("whole", None)):
        start = time.perf_counter()
        save = partial(
            lambda path, bins: record(
                "Benchmark", summary, view_documents, data, {}, {}, logs, 10.0, bins=bins, path=path
            ),
            bins=bins,
        )
        content = b"".join(saved_pieces(save))
        figures[name] = {
            "seconds": round(time.perf_counter() - start, 2),
            "megabytes": round(len(content) / 1e6, 2),
        }
        if keep is not None:
            keep.mkdir(parents=True, exist_ok=True)
            (keep / f"{name}.rrd").write_bytes(content)
    figures["peak_memory_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
