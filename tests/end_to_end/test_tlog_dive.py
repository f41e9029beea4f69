"""The dive as MAVLink telemetry: the log is what its script writes, its streams differ
by what the messages can carry, and so do the error tables of the whole chain: by the
sum of what each message alone costs (campaigns/bluerov2_dvl_tlog/resolution.csv).
"""

from __future__ import annotations

import csv
import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from auvid.data_schemas.tables import column

ROOT = Path(__file__).parents[2]
HERE = ROOT / "campaigns" / "bluerov2_dvl_tlog"
NAMES = ("bluerov2_dvl", HERE.name)
TRAINING_SHARE, VALIDATION_SHARE = 0.0015, 0.02
PREDICTION_FLOOR, PREDICTION_SHARE = (
    0.0005,
    0.3,
)  # of J; the costs of single messages add up as long as they are small


@pytest.fixture(scope="module")
def script() -> Iterator[ModuleType]:
    spec = importlib.util.spec_from_file_location("make_tlog", HERE / "make_tlog.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["make_tlog"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["make_tlog"]


@pytest.fixture(scope="module")
def streams(script: ModuleType) -> dict[str, Any]:
    by_stream: dict[str, Any] = script.streams_of(script.SOURCE)
    return by_stream


@pytest.fixture(scope="module")
def tables(
    committed_run: Callable[[str], Path],
) -> dict[str, dict[tuple[str, str], dict[str, Any]]]:
    """Rows of the error tables for all axes and legs: campaign -> (use, model) -> row."""
    tables = {}
    for name in NAMES:
        file = committed_run(name) / "runs" / name / "validate" / "error_table.parquet"
        tables[name] = {
            (row["use"], row["model"]): row
            for row in pq.ParquetFile(file).read().to_pylist()
            if row["axis"] == "all" and row["leg"] == "all"
        }
    return tables


def test_the_log_is_what_its_script_writes(script: ModuleType, streams: dict[str, Any]) -> None:
    assert script.TARGET.read_bytes() == script.telemetry(streams)


def test_streams_differ_by_what_the_messages_can_carry(
    script: ModuleType, streams: dict[str, Any]
) -> None:
    ours = script.streams_of(script.TARGET)
    start_us = int(column(streams["velocity"], "time_us")[0])
    assert int(column(ours["velocity"], "time_us")[0]) == start_us
    for name, step in script.STEPS.items():
        exact, carried = streams[name], ours[name]
        assert exact.num_rows == carried.num_rows
        # A battery message has no time of its own: the recorder's, moved by the median
        # delay, which knows milliseconds.
        off_us = step.time_us / 2 if name != "battery" else 500.0
        assert np.abs(column(exact, "time_us") - column(carried, "time_us")).max() <= off_us
        fields = [field for field in step.fields if field in exact.column_names]
        assert fields
        for field in fields:
            error = np.abs(column(exact, field) - column(carried, field)).max()
            assert error <= 0.5001 * step.fields[field] * (
                2.0 if name in ("attitude", "depth") else 1.0
            ), (name, field)
    assert [row["mode"] for row in ours["mode"].to_pylist()] == [
        row["mode"] for row in streams["mode"].to_pylist()
    ]
    assert ours["events"]["text"].to_pylist() == streams["events"]["text"].to_pylist()


def test_error_tables_differ_by_what_the_messages_explain(
    tables: dict[str, dict[tuple[str, str], dict[str, Any]]],
) -> None:
    """The gyro's whole milliradians per second are nearly all of it: 0.1 % of J in
    training at most, 1.6 % where a model extrapolates (the ends of a leg are in it, too).
    """
    with (HERE / "resolution.csv").open(encoding="utf-8") as file:
        costs = {(row.pop("use"), row.pop("model")): row for row in csv.DictReader(file)}
    exact, telemetry = (tables[name] for name in NAMES)
    assert set(exact) == set(telemetry) == set(costs)
    for key, row in exact.items():
        other = telemetry[key]
        assert (row["rank"], row["samples"], row["n_bar"]) == (
            other["rank"],
            other["samples"],
            other["n_bar"],
        )
        change = other["ratio"] * other["j0"] / (row["ratio"] * row["j0"]) - 1.0
        assert abs(change) <= (TRAINING_SHARE if key[0] == "training" else VALIDATION_SHARE), key
        messages = [
            float(value) / 100.0
            for name, value in costs[key].items()
            if name not in ("J", "telemetry_percent")
        ]
        predicted = sum(messages)
        assert abs(change - predicted) <= PREDICTION_FLOOR + PREDICTION_SHARE * abs(predicted), key


def test_the_log_has_the_messages_that_a_vehicle_sends(script: ModuleType) -> None:
    from auvid.stages.base import RawFile
    from auvid.stages.ingest.formats.tlog.reader import TLOG

    log = TLOG.read(RawFile("dive.tlog", np.fromfile(script.TARGET, np.uint8)))
    assert log.status == "complete"
    assert set(log.counts) == {step.message for step in script.STEPS.values()} | {
        "SYS_STATUS",
        "HEARTBEAT",
        "STATUSTEXT",
        "PARAM_VALUE",
    }
    assert log.parameters == pytest.approx(script.PARAMETERS, rel=1e-7)
