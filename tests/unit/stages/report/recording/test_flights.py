"""Closed-loop flights in the recording: lines in 3D, one per flight, and the desired
path of each trajectory.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun.blueprint as rrb

from auvid.stages.report.recording.blueprint import (
    MOST_VIEWS,
    VisibleTabs,
    limited,
    time_plot,
    whole_view,
)
from auvid.stages.report.recording.flights import DESIRED, PLACE, send_flights
from auvid.stages.report.recording.rerun_stream import Recording

RERUN = Path(sys.executable).with_name("rerun")


def flight(offset: float, samples: int = 50, lost_from: int | None = None) -> pa.Table:
    t = np.linspace(0.0, 5.0, samples)
    desired = np.column_stack([t, np.zeros(samples), np.full(samples, 2.0)])
    flown = desired + np.array([0.0, offset, 0.0])
    if lost_from is not None:
        flown[lost_from:] = np.nan
    columns = {
        "t_s": t,
        **dict(zip(PLACE, flown.T, strict=True)),
        **dict(zip(DESIRED, desired.T, strict=True)),
    }
    return pa.table(columns)


def test_flights_and_desired_paths_stand_in_the_recording(tmp_path: Path) -> None:
    out = Recording("flights")
    tables = {
        "control/flights/helix-undisturbed": flight(0.5),
        "control/flights/helix-pushed": flight(-3.0, lost_from=20),
        "control/gains/helix": pa.table({"t_s": [0.0]}),
    }
    boxes = send_flights(out, tables, {})
    assert list(boxes) == ["helix"]
    assert boxes["helix"] == pytest.approx(np.array([[0.0, -3.0, 2.0], [5.0, 0.5, 2.0]]))
    file = tmp_path / "flights.rrd"
    file.write_bytes(out.finish(whole_view([], VisibleTabs({}, boxes))[0]))
    printed = subprocess.run(
        [str(RERUN), "rrd", "print", str(file)],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    ).stdout
    for entity in (
        "/path/helix/undisturbed",
        "/path/helix/pushed",
        "/path/helix/desired",
        "/path/helix/undisturbed/vehicle",
    ):
        assert f"{entity} - " in printed


def test_without_flights_there_is_no_box() -> None:
    assert send_flights(Recording("none"), {"validate/x": pa.table({"t_s": [0.0]})}, {}) == {}


def test_plots_beyond_what_the_viewer_opens_are_left_out_by_name_and_those_of_the_leg_stay() -> (
    None
):
    tabs = {
        "Answer": {
            f"force/leg{n}/X": time_plot(f"force/leg{n}/X", "X", (0.0, 1.0), (0.0, 1.0))
            for n in range(100)
        },
        "State": {
            f"state/leg{n}/u": time_plot(f"state/leg{n}/u", "u", (0.0, 1.0), (0.0, 1.0))
            for n in range(100)
        },
        "Path": {"path/one": time_plot("path/one", "one", (0.0, 1.0), (0.0, 1.0))},
    }
    kept, words = limited(tabs, "leg99")
    assert sum(map(len, kept.values())) == MOST_VIEWS
    assert list(kept["Path"]) == ["path/one"]
    assert "state/leg99/u" in kept["State"]
    assert words.count("\n- ") == 201 - MOST_VIEWS
    assert limited({"Path": tabs["Path"]}) == ({"Path": tabs["Path"]}, "")


def test_no_view_stands_in_two_tabs() -> None:
    """The viewer draws a view in one place: a summary shared by two tabs left one empty."""
    contents = VisibleTabs({}, {"leg": np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])})
    blueprint, _ = whole_view([], contents, first=lambda words: rrb.Horizontal(words))
    parts, views = [blueprint.root_container], []
    while parts:
        part = parts.pop()
        parts += [item for item in part.contents if isinstance(item, rrb.Container)]
        views += [item.id for item in part.contents if not isinstance(item, rrb.Container)]
    assert len(views) == len(set(views)) > 3
