"""The path of a plotted line holds the samples; ticks are round and inside; of many
models the best are drawn.
"""

from __future__ import annotations

import re

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from auvid.stages.page.pictures.svg_plots import (
    PANEL_STEPS,
    X_STEPS,
    Y_STEPS,
    Line,
    Plot,
    lay_out,
    ticks,
)
from auvid.stages.presentation import panel, plot, series

Array = npt.NDArray[np.float64]


def decoded(drawn: Plot, line: Line) -> tuple[Array, Array]:
    """The samples as plots.js reads them back: the steps of the path, in data units."""
    xs, ys = [], []
    for run in line.path.split("M")[1:]:
        start, moves = run.split("l")
        steps = np.array(re.findall(r"-?\d+", moves), dtype=float).reshape(-1, 2)
        points = np.cumsum(np.vstack([np.array(start.split(), dtype=float), steps]), axis=0)
        xs.append(drawn.low + points[:, 0] / X_STEPS * (drawn.high - drawn.low))
        ys.append(line.top - line.step * points[:, 1])
    return np.concatenate(xs), np.concatenate(ys)


def one_line(x: Array, y: Array) -> Plot:
    return lay_out(plot("title", [panel("u", "m/s", [series("raw", x, y, "raw")])]))


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=60))
def test_samples_come_back_to_half_a_step(values: list[float]) -> None:
    y = np.array([float(f"{value:.6g}") if abs(value) > 1e-20 else 0.0 for value in values])
    drawn = one_line(np.arange(y.size, dtype=float), y)
    x_back, y_back = decoded(drawn, drawn.panels[0].lines[0])
    half = (y.max() - y.min()) / Y_STEPS / 2
    np.testing.assert_allclose(x_back[: y.size], np.arange(y.size), atol=(y.size - 1) / X_STEPS)
    np.testing.assert_allclose(y_back[: y.size], y, atol=half * 1.001 + 1e-9 * np.abs(y).max())


def test_line_lies_inside_its_panel() -> None:
    drawn = one_line(np.array([0.0, 1.0, 2.0]), np.array([-3.0, 5.0, 1.0]))
    line = drawn.panels[0].lines[0]
    assert 0 < line.shift < line.shift + line.scale * Y_STEPS < PANEL_STEPS


def test_gap_splits_the_line() -> None:
    drawn = one_line(np.arange(5.0), np.array([1.0, 2.0, np.nan, 3.0, 4.0]))
    assert drawn.panels[0].lines[0].path.count("M") == 2
    assert drawn.panels[0].lines[0].samples == 4


@pytest.mark.parametrize("value", [0.0, 7.0, -1e-9])
def test_constant_signal_has_room_on_both_sides(value: float) -> None:
    drawn = one_line(np.arange(3.0), np.full(3, value))
    assert drawn.panels[0].low < value < drawn.panels[0].high
    assert drawn.panels[0].lines[0].scale > 0


def test_panel_without_samples_stays_and_is_empty() -> None:
    drawn = one_line(np.arange(3.0), np.full(3, np.nan))
    assert drawn.panels[0].lines == ()
    assert drawn.panels[0].label == "u"


@given(st.floats(-1e5, 1e5), st.floats(1e-4, 1e5), st.integers(2, 8))
def test_ticks_are_inside_and_differ(low: float, span: float, count: int) -> None:
    places = ticks(low, low + span, count)
    assert 2 <= len(places) <= max(count + 1, 5)
    assert all(-1e-6 <= tick.percent <= 100 + 1e-6 for tick in places)
    assert len({tick.percent for tick in places}) == len(places)


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [
        (0, 90, ["0", "20", "40", "60", "80"]),
        (-0.53, 0.48, ["−0.50", "−0.25", "0", "0.25"]),
        (98, 102, ["98", "99", "100", "101", "102"]),
    ],
)
def test_tick_labels(low: float, high: float, labels: list[str]) -> None:
    assert [tick.label for tick in ticks(low, high, 5)] == labels


def model_plot(models: list[str]) -> dict[str, object]:
    x = np.arange(3.0)
    return plot(
        "title",
        [
            panel(
                "X",
                "N",
                [
                    series("measured", x, x, "measured"),
                    *(series(name, x, x, name) for name in models),
                ],
            )
        ],
    )


def test_of_many_models_the_preferred_are_drawn() -> None:
    models = ["linear", "fossen", "coe", "prestero", "uncoupled"]
    drawn = lay_out(
        model_plot(models),
        preferred=["uncoupled", "fossen", "coe", "linear"],
        titles={"coe": "Coe"},
    )
    assert [entry.name for entry in drawn.entries if entry.is_drawn] == [
        "measured",
        "fossen",
        "Coe",
        "uncoupled",
    ]
    assert drawn.hidden == 2


def test_range_follows_the_lines_that_are_drawn() -> None:
    x = np.arange(3.0)
    lines = [
        series(name, x, size * x, name)
        for name, size in (("linear", 1), ("fossen", 1), ("coe", 1), ("prestero", 1000))
    ]
    drawn = lay_out(plot("title", [panel("X", "N", lines)]), preferred=["linear", "fossen", "coe"])
    assert drawn.panels[0].high < 3


def test_plots_of_another_clock_are_another_group() -> None:
    block = plot(
        "title", [panel("u", "", [series("a", [0.0, 1.0], [0.0, 1.0], "raw")])], group="time"
    )
    assert lay_out(block).group == "time"
    assert lay_out(block, clock="dive_2").group == "dive_2 time"


def test_simulation_that_runs_away_does_not_flatten_the_measurement() -> None:
    t = np.linspace(0.0, 10.0, 200)
    lines = [
        series("measured", t, np.sin(t), "measured"),
        series("lost", t, 1e6 * t, "linear"),
        series("near", t, 2 * np.sin(t), "quadratic"),
    ]
    drawn = lay_out(plot("Run", [panel("speed", "m/s", lines)]))
    assert (drawn.panels[0].low, drawn.panels[0].high) == pytest.approx((-3.0, 3.0), abs=0.1)
    assert drawn.panels[0].cut == ("lost",)
    assert drawn.note == "Beyond the axis: lost."


def test_depth_grows_downwards() -> None:
    depth = np.array([2.0, 12.0, 7.0])
    (drawn,) = lay_out(plot("Dive", [panel("depth", "m", [series("d", depth, depth, "d")])])).panels
    at = {mark.label: mark.percent for mark in drawn.ticks}
    assert list(at) == ["10", "5"]
    assert at["5"] < at["10"]
    (line,) = drawn.lines
    first, second = re.findall(r"-?\d+", line.path)[1:4:2]
    assert drawn.sign * (line.top - line.step * int(first)) == pytest.approx(2.0)
    assert int(second) > 0, "deeper is further down"


def test_wide_start_of_a_band_does_not_flatten_its_estimate() -> None:
    t = np.linspace(0.0, 10.0, 200)
    lines = [
        series("estimate", t, 1.0 + 0.1 * t, "fused"),
        series("95 % high", t, 1.0 + 1e5 * np.exp(-t), "band"),
    ]
    assert lay_out(plot("History", [panel("X_u", "kg/s", lines)])).panels[0].high == pytest.approx(
        3.0
    )


def test_place_over_place_has_equal_scales() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 100)
    circle = plot(
        "Plan",
        [panel("north", "m", [series("flown", 10 * np.cos(angle), 10 * np.sin(angle), "fused")])],
        x_label="east",
        x_unit="m",
    )
    assert lay_out(circle).aspect == pytest.approx(1 / 1.12, rel=0.01)
    assert (
        lay_out(plot("Run", [panel("depth", "m", [series("z", angle, angle, "fused")])])).aspect
        == 0.0
    )
