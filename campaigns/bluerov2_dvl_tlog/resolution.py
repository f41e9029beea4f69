"""What the resolution of each telemetry message costs: the change of J when that
message alone is as coarse as it is.

Run from the root of the repository: `python campaigns/bluerov2_dvl_tlog/resolution.py`
(two minutes; writes resolution.csv beside this file). The chain runs on the dive as CSV
with all digits, then with the values and time stamps of one stream rounded to the
`STEPS` of its message, stream by stream, and on the telemetry log itself. Changes are
in per cent of J, all axes together.
"""

from __future__ import annotations

import contextlib
import csv
import importlib.util
import os
import shutil
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from auvid.data_schemas.tables import column
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.execution.engines import Serial
from auvid.pipeline.graph import select

HERE = Path(__file__).resolve().parent
CAMPAIGNS = HERE.parent
CSV_NAME, TLOG_NAME = "bluerov2_dvl_csv", HERE.name
TARGET = HERE / "resolution.csv"

Errors = dict[tuple[str, str], float]


def script(path: Path) -> ModuleType:
    """A script of a campaign as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def rounded(table: pa.Table, fields: Mapping[str, float], time_us: int) -> pa.Table:
    """A stream with the values and time stamps that its message can carry."""
    steps = {name: step for name, step in fields.items() if name in table.column_names}
    for name, step in {**steps, "time_us": float(time_us)}.items():
        values = np.rint(column(table, name) / step) * step
        table = table.set_column(
            table.column_names.index(name),
            name,
            pa.array(values).cast(table.schema.field(name).type),
        )
    return table


def errors(workspace: Path, name: str) -> Errors:
    """J of all axes by use of the legs and model, after a run up to validation."""
    with contextlib.chdir(workspace):
        run = open_run(name)
        run.execute(select(run.graph, until="validate"), Serial())
    table = (
        pq.ParquetFile(workspace / "runs" / name / "validate" / "error_table.parquet")
        .read()
        .to_pylist()
    )
    return {
        (row["use"], row["model"]): row["ratio"] * row["j0"]
        for row in table
        if row["axis"] == "all" and row["leg"] == "all"
    }


def changes() -> tuple[Errors, dict[str, Errors]]:
    """J with all digits, and the relative change of it by stream, and for the telemetry
    log.
    """
    make_tlog, make_csv = (
        script(HERE / "make_tlog.py"),
        script(CAMPAIGNS / CSV_NAME / "make_csv.py"),
    )
    streams = make_tlog.streams_of(make_tlog.SOURCE)
    start_us = int(column(streams["velocity"], "time_us")[0])
    by_stream: dict[str, Errors] = {}
    with tempfile.TemporaryDirectory() as name:
        workspace = Path(name)
        for campaign in (CSV_NAME, TLOG_NAME):
            shutil.copytree(CAMPAIGNS / campaign, workspace / "campaigns" / campaign)
        shutil.copy(CAMPAIGNS.parent / "params.yaml", workspace)
        logs = workspace / "campaigns" / CSV_NAME / "logs"
        exact = errors(workspace, CSV_NAME)
        for stream, step in make_tlog.STEPS.items():
            file = logs / f"{stream}.csv"
            original = file.read_bytes()
            file.write_text(
                make_csv.csv_text(
                    rounded(streams[stream], step.fields, step.time_us),
                    make_csv.FILES[stream],
                    start_us,
                )
            )
            by_stream[stream] = _relative(errors(workspace, CSV_NAME), exact)
            file.write_bytes(original)
        by_stream["telemetry"] = _relative(errors(workspace, TLOG_NAME), exact)
    return exact, by_stream


def _relative(errors: Errors, exact: Errors) -> Errors:
    return {key: errors[key] / exact[key] - 1.0 for key in exact}


def main() -> None:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    exact, by_stream = changes()
    with TARGET.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["use", "model", "J", *(f"{name}_percent" for name in by_stream)])
        for (use, model), value in exact.items():
            writer.writerow(
                [
                    use,
                    model,
                    f"{value:.6g}",
                    *(f"{100 * change[use, model]:.4f}" for change in by_stream.values()),
                ]
            )
    print(TARGET.read_text())


if __name__ == "__main__":
    main()
