"""Closed-loop flights in the recording: lines in 3D, one per flight, and the desired path of each trajectory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from stages.report.blueprint import Seen, whole_view
from stages.report.recording_flights import DESIRED, PLACE, send_flights
from stages.report.sending import Recording

RERUN = Path(sys.executable).with_name("rerun")


def flight(offset: float, samples: int = 50, lost_from: int | None = None) -> pa.Table:
    t = np.linspace(0.0, 5.0, samples)
    desired = np.column_stack([t, np.zeros(samples), np.full(samples, 2.0)])
    flown = desired + np.array([0.0, offset, 0.0])
    if lost_from is not None:
        flown[lost_from:] = np.nan
    columns = {"t_s": t, **dict(zip(PLACE, flown.T, strict=True)), **dict(zip(DESIRED, desired.T, strict=True))}
    return pa.table(columns)


def test_flights_and_desired_paths_stand_in_the_recording(tmp_path: Path) -> None:
    out = Recording("flights")
    tables = {
        "control/flights/helix-undisturbed": flight(0.5),
        "control/flights/helix-pushed": flight(-3.0, lost_from=20),
        "control/gains/helix": pa.table({"t_s": [0.0]}),
    }
    corners = send_flights(out, tables)
    assert corners is not None
    assert corners == pytest.approx(np.array([[0.0, -3.0, 2.0], [5.0, 0.5, 2.0]]))
    file = tmp_path / "flights.rrd"
    file.write_bytes(out.finish(whole_view([], Seen({}, corners))))
    printed = subprocess.run([str(RERUN), "rrd", "print", str(file)], capture_output=True, text=True, timeout=60, check=True).stdout
    for entity in ("/path/helix/undisturbed", "/path/helix/pushed", "/path/helix/desired", "/path/helix/undisturbed/vehicle"):
        assert f"{entity} - " in printed


def test_without_flights_there_is_no_box() -> None:
    assert send_flights(Recording("none"), {"validate/x": pa.table({"t_s": [0.0]})}) is None
