"""The pictures of the first screen: what they show, leave out and may weigh."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from auvid.stages.page.pictures.answer_picture import CELLS, ForceCloud, answer_picture, dots
from auvid.stages.page.pictures.dive_picture import (
    ActuatorUse,
    DrawnLeg,
    dive_picture,
    largest_of_bins,
)
from auvid.stages.page.pictures.drawing import (
    X_STEPS,
    Y_STEPS,
    CurveRow,
    SignalCurve,
    curve_row,
    polyline,
)
from auvid.stages.page.pictures.signal_picture import signal_picture

T = np.linspace(0.0, 100.0, 5001)


def leg(name="train", use="training", start=0.0, depth=10.0):
    place = np.column_stack([np.cos(T / 8), np.sin(T / 5), depth + np.sin(T)])
    return DrawnLeg(name, use, T + start, place)


def parsed(picture):
    return ET.fromstring(str(picture))


def titles(picture):
    return [item.text for item in parsed(picture).iter("title")]


def vertices(path):
    """All places of a path of `M x y l dx dy ...`, absolute."""
    places = []
    for run in path.split("M")[1:]:
        numbers = np.array([int(word) for word in re.findall(r"-?\d+", run)]).reshape(-1, 2)
        places.append(np.cumsum(numbers, axis=0))
    return np.vstack(places)


def test_a_dive_shows_track_depth_modes_and_actuators_by_use():
    use = ActuatorUse("1", "N", (T, T + 100.0), (np.sin(T), 3.0 * np.sin(T)))
    picture = dive_picture(
        [leg(), leg("check", "validation", 100.0)],
        modes=[(0.0, "MANUAL"), (120.0, "ALT_HOLD")],
        actuators=[use],
        span=(0.0, 200.0),
    )
    words = " ".join(parsed(picture).itertext())
    assert {"MANUAL", "ALT_HOLD", "train", "check", "training", "validation"} <= set(
        re.findall(r"\w+", words)
    )
    assert any(title.startswith("Track from above") for title in titles(picture))
    assert "depth in m over time" in titles(picture)
    assert "full height 3 N" in words
    assert "--ink-training" in picture
    assert "--ink-validation" in picture
    assert len(picture.encode()) < 30_000


def test_strips_of_an_actuator_need_the_largest_of_each_bin_alone():
    t_s, values = np.linspace(3.0, 90.0, 5000), np.random.default_rng(2).normal(size=5000)
    values[1000:2000] = np.nan
    times, largest = largest_of_bins(t_s, values, (0.0, 200.0))
    assert times.size < 60
    uses = [ActuatorUse("1", "N", (times,), (largest,)), ActuatorUse("1", "N", (t_s,), (values,))]
    few, many = (dive_picture([leg()], actuators=[use], span=(0.0, 200.0)) for use in uses)
    assert few == many


def test_a_long_track_keeps_its_curves():
    """Circles of ten different sizes: each point lies on one of them to a step of the
    raster, none on a staircase beside it.
    """
    angle = np.linspace(0.0, 20.0 * np.pi, 20_000)
    size = np.repeat(np.linspace(0.5, 5.0, 10), 2000)
    place = np.column_stack([size * np.cos(angle), size * np.sin(angle), 0.0 * angle])
    picture = dive_picture([DrawnLeg("train", "training", angle, place)], span=(0.0, 70.0))
    (track,) = [item for item in parsed(picture).iter("svg") if "viewBox" in item.attrib][:1]
    line = next(item for item in track.iter("path") if item.attrib.get("class") == "line")
    points = vertices(line.attrib["d"])
    assert 600 < len(points) < 720
    radius = np.hypot(*points.T) * 11.2 / 400.0
    off = np.abs(radius[:, None] - np.linspace(0.5, 5.0, 10)).min(axis=1)
    assert np.max(off) < 0.5 * np.sqrt(2.0) * 11.2 / 400.0 + 1e-9


def test_a_dive_without_a_place_has_no_track_and_without_controls_no_strips():
    blind = DrawnLeg("train", "training", T, np.full((T.size, 3), np.nan))
    picture = dive_picture([blind], depth=(T, 5.0 + 0.0 * T), span=(0.0, 100.0))
    assert titles(picture) == ["depth in m over time"]
    assert "actuators" not in picture


def test_depth_counts_downwards():
    row = CurveRow("depth", "m", (SignalCurve("training", T, T),), downwards=True)
    labels = parsed(curve_row(row, (0.0, 100.0))).findall(".//div[@class='side']/span")
    assert len(labels) == 2  # the scale can be read, and a row of 32 px holds no third
    path = parsed(curve_row(row, (0.0, 100.0))).findall(".//path[@class='line']")[0].get("d")
    y = vertices(path)[:, 1]
    assert y[0] < 0.1 * Y_STEPS
    assert y[-1] > 0.9 * Y_STEPS


def test_a_peak_of_one_sample_survives_thinning():
    spike = np.zeros(100_001)
    spike[33_333] = 1.0
    x = np.linspace(0.0, 1.0, spike.size)
    places = vertices(polyline(x, spike, (0.0, 1.0), (0.0, 1.0)))
    assert places[:, 1].min() == 0
    assert places[places[:, 1].argmin(), 0] == pytest.approx(X_STEPS / 3, abs=2)
    assert len(places) < 1000


def test_a_gap_is_not_bridged():
    y = np.where((T > 40.0) & (T < 60.0), np.nan, T)
    assert polyline(T, y, (0.0, 100.0), (0.0, 100.0)).count("M") == 2


def test_every_sample_is_in_a_cell_and_those_outside_at_the_edge():
    measured = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 2.0])
    predicted = np.array([0.0, 0.0, 9.0, 1.0, 1.0, np.nan])
    few, many, beyond = dots(measured, predicted, (0.0, 2.0))
    assert (few + many).count("M") == 3
    assert beyond == "20 %"
    assert f" {int(0.5 * Y_STEPS / CELLS)}h0" in few


def test_an_answer_has_a_box_per_axis_and_a_free_run():
    rng = np.random.default_rng(1)
    force = rng.normal(size=(5000, 6))
    clouds = [
        ForceCloud(axis, "N", force[:, i], force[:, i] + rng.normal(size=5000), 0.5)
        for i, axis in enumerate("XYZKMN")
    ]
    run = CurveRow(
        "surge u", "m/s", (SignalCurve("measured", T, np.sin(T)), SignalCurve("linear", T, T))
    )
    picture = answer_picture(
        "Linear", "linear", clouds, [run], judged_on="validation", span=(0.0, 100.0)
    )
    assert "X: predicted against measured in N" in titles(picture)[0]
    assert len(titles(picture)) == 7
    assert "free run" in picture
    assert len(picture.encode()) < 60_000
    single = answer_picture("Linear", "linear", clouds, [], judged_on="training", span=(0.0, 1.0))
    assert "free run" not in single


def test_names_of_a_log_cannot_act():
    evil = '<script>alert("x")</script>'
    picture = dive_picture([leg(evil)], modes=[(0.0, evil)], span=(0.0, 100.0))
    picture += signal_picture(evil, "", [(CurveRow(evil, "", ()), (0.0, 1.0))], [(evil, evil)])
    assert "<script" not in picture
