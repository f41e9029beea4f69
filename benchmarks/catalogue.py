"""A catalogue of 1000 small recordings: seconds until it is served and for a query.

    python -m benchmarks.catalogue [--recordings N]

Two recordings have one title and differ in content, as two runs of one campaign. The
query needs datafusion (pip install 'auvid[catalog]'); without it, it is null. Asked
are at most 3 s, .5 s, and none dropped.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from auvid.pipeline.commands.fleet.queries.catalog_command import recordings_of, segments, served
from auvid.stages.report.recording.rerun_stream import Recording

LIMITS = {"up_s": 3.0, "query_s": 0.5}
SAMPLES = 300
DATASET = "catalogue"


def write_recording(folder: Path, number: int) -> None:
    """Write a recording of a few series with the properties of a run."""
    rng = np.random.default_rng(number)
    folder.mkdir(parents=True)
    verdict = "identified" if number % 4 == 0 else "weak"
    out = Recording(
        f"dive {number // 2}",
        content=number,
        properties={"ratio_validation": float(rng.uniform()), "surge": verdict},
        path=str(folder / "recording.rrd"),
    )
    times = np.arange(SAMPLES) / 50.0
    out.series("state/u", times, np.cumsum(rng.standard_normal((SAMPLES, 3)), axis=0))
    out.stream.flush()
    out.discard()


def main() -> None:
    """Write the recordings, serve them, ask, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=1000)
    count = parser.parse_args().recordings
    with tempfile.TemporaryDirectory() as place:
        for number in range(count):
            write_recording(Path(place) / f"run_{number}", number)
        paths = recordings_of(Path(place))
        start = time.perf_counter()
        with served(paths, DATASET) as server:
            up_s = time.perf_counter() - start
            there = segments(server, DATASET)
            query_s, rows = None, None
            if find_spec("datafusion") is not None:
                from datafusion import col, lit

                dataset = server.client().get_dataset(DATASET)
                start = time.perf_counter()
                table = dataset.segment_table()
                ratio = col('"property:auvid:ratio_validation"')[0]
                rows = len(table.filter(ratio < lit(0.5)).to_pandas())
                query_s = time.perf_counter() - start
    figures = {
        "recordings": count,
        "segments": there,
        "up_s": round(up_s, 2),
        "query_s": query_s and round(query_s, 2),
        "rows": rows,
        "limits": LIMITS,
    }
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
