"""Report sections as data: plain values only, and thinning that keeps peaks and gaps."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from auvid.stages.presentation import (
    SHOWN_POINTS,
    equation,
    panel,
    plot,
    remark,
    rounded,
    section,
    series,
    table,
    text,
    thin,
)


def test_section_is_a_document_of_plain_values() -> None:
    blocks = [
        text("words"),
        remark("look", "warning"),
        equation("x", "x"),
        table(
            "t",
            ["a", ("b", "N")],
            [[np.float64(1.5), np.int64(2)], [None, float("nan")], ["c", np.bool_(True)]],
        ),
        plot(
            "p",
            [panel("u", "m/s", [series("raw", np.arange(3), [1.0, np.nan, np.inf], "raw")])],
            group="time",
        ),
    ]
    document = section("title", blocks, order=3, look_for="this")
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["blocks"][3]["columns"] == [
        {"name": "a", "unit": ""},
        {"name": "b", "unit": "N"},
    ]
    assert document["blocks"][3]["rows"] == [[1.5, 2], [None, None], ["c", True]]
    assert document["blocks"][4]["panels"][0]["series"][0]["y"] == [1.0, None, None]


def test_short_signals_are_left_alone() -> None:
    x = np.arange(SHOWN_POINTS, dtype=float)
    assert thin(x, x)[0] is x


@given(st.integers(0, 2**32 - 1), st.integers(2 * SHOWN_POINTS, 9000))
def test_thinning_keeps_extremes_order_and_values(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = np.cumsum(rng.uniform(0.5, 1.5, n)), rng.normal(size=n)
    kept_x, kept_y = thin(x, y)
    assert kept_x.size <= SHOWN_POINTS
    assert (np.diff(kept_x) > 0).all()
    assert (kept_y.min(), kept_y.max()) == (y.min(), y.max())
    np.testing.assert_array_equal(kept_y, y[np.searchsorted(x, kept_x)])


@pytest.mark.parametrize("width", [1, 40])
def test_single_peak_survives(width: int) -> None:
    y = np.zeros(100_000)
    y[54_321 : 54_321 + width] = 7.0
    assert thin(np.arange(y.size, dtype=float), y)[1].max() == 7.0


def test_gap_stays_a_gap() -> None:
    x, y = np.arange(60_000.0), np.ones(60_000)
    y[20_000:30_000] = np.nan
    kept_x, kept_y = thin(x, y)
    inside = (kept_x >= 20_100) & (kept_x < 29_900)
    assert inside.any()
    assert np.isnan(kept_y[inside]).all()
    assert np.isfinite(kept_y[~((kept_x >= 20_000) & (kept_x < 30_000))]).all()


def test_input_is_not_written_to() -> None:
    x, y = np.arange(5000.0), np.sin(np.arange(5000.0))
    x.flags.writeable = y.flags.writeable = False
    assert series("raw", x, y, "raw")["role"] == "raw"


def six_digits(value: float) -> float | None:
    """Return a number as its six digits give it."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


@given(st.lists(st.floats() | st.floats(-1e7, 1e7) | st.integers(-(10**8), 10**8).map(float)))
def test_numbers_of_a_plot_have_the_six_digits_that_print_gives(values: list[float]) -> None:
    assert rounded(np.array(values, dtype=np.float64)) == list(map(six_digits, values))


def test_halves_powers_of_ten_and_their_neighbours_have_the_six_digits_that_print_gives() -> None:
    halves = np.concatenate([(np.arange(100000, 100500) + 0.5) / 10.0**k for k in range(-3, 9)])
    powers = 10.0 ** np.arange(-18, 19)
    near = [np.nextafter(powers, 0.0), powers, np.nextafter(powers, np.inf), 9.999995 * powers]
    values = np.concatenate([halves, *near])
    values = np.concatenate([values, -values])
    assert rounded(values) == list(map(six_digits, values.tolist()))
