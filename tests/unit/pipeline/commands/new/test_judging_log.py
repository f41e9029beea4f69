"""Of several runs one is held out: one that the others can do without; a named glider."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from auvid.pipeline.commands.new import vehicle_choice
from auvid.pipeline.commands.new.feedable import judging_log
from auvid.pipeline.commands.new.vehicle_choice import choose_vehicle


@pytest.mark.parametrize(
    ("axes", "spans_s", "judge"),
    [
        (["XYZN", "XYZ", "X"], [165.0, 215.0, 40.0], 1),
        (["XYZN", "XYZN", "XYZN"], [165.0, 215.0, 40.0], 2),
        (["XYZN", "XYZN"], [165.0, 20.0], 0),
        (["XY", "ZN"], [100.0, 100.0], None),
        (["XYZN"], [100.0], None),
        (["XYZN", ""], [100.0, 100.0], None),
    ],
)
def test_the_others_feed_all_that_it_feeds(
    axes: Sequence[str], spans_s: Sequence[float], judge: int | None
) -> None:
    assert judging_log(axes, spans_s) == judge


def test_a_named_glider_is_neutral_in_the_water_of_its_log() -> None:
    """2 % more density is more than its drive; one that the file has measured stays."""
    density = np.array([1026.0, 1027.0, 1028.0])
    table = SimpleNamespace(column_names=["density_kg_m3"])
    log: Any = SimpleNamespace(
        has=lambda stream: stream == "glider",
        tables={"glider": table},
        column=lambda stream, name: density,
        info=SimpleNamespace(parameters={}),
    )
    text = choose_vehicle(log, named="slocum", normalised=False).text
    assert "water_density: {value: 1027.0, unit: kg/m^3, source: median of the log" in text
    measured = text.replace("source: median of the log, assumed: true", "source: measured")
    assert vehicle_choice._of_glider(measured, log) == measured
    unnamed = choose_vehicle(log, named=None, normalised=False).text
    for words in (
        "lift_slope_sd: {value: 1.5,",
        "induced_drag_sd: {value: 4.0,",
        "mass: {value: 9.0,",
        "  mass: {value: 60.0,",
        "displaced_mass: {value: 60.0,",
    ):
        assert words in unnamed
        assert words not in text
