"""Windows of output error follow the legs, down to a shortest one that is named."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.maximum_likelihood.records import LegRecord
from auvid.hydro.identification.maximum_likelihood.windows import cut_windows
from tests.support.sway_runs import STEP_S, sway_leg


def still_leg(duration_s: float, *, every: int = 1, name: str = "run") -> LegRecord:
    n = round(duration_s / STEP_S) + 1
    return sway_leg(np.zeros(n), np.zeros(n), every=every, name=name)


def spans(legs: Sequence[LegRecord], length_s: float | None) -> list[tuple[int, float]]:
    windows, _ = cut_windows(legs, length_s=length_s)
    return [(window.leg, round(float(np.ptp(window.t_s)), 1)) for window in windows]


def test_a_leg_is_cut_into_equal_windows_and_a_shorter_one_is_its_own() -> None:
    legs = [still_leg(58.0), still_leg(12.0), still_leg(5.0), still_leg(39.0)]
    assert spans(legs, 20.0) == [(0, 29.0), (0, 29.0), (1, 12.0), (2, 5.0), (3, 39.0)]
    assert spans(legs[:1], 60.0) == [(0, 58.0)]


def test_legs_below_the_shortest_window_are_dropped_with_their_length() -> None:
    windows, dropped = cut_windows([still_leg(4.0, name="a"), still_leg(30.0)], length_s=20.0)
    assert [window.leg for window in windows] == [1]
    (short,) = dropped
    assert (short.leg, short.start_s, short.end_s) == ("a", 0.0, pytest.approx(4.0))
    assert short.reason == "4 s, shorter than the shortest window of 5 s"
    # Whoever asks for shorter windows gets them.
    assert spans([still_leg(4.0)], 2.0) == [(0, 2.0), (0, 2.0)]


def test_without_any_window_each_leg_is_named_with_the_reason() -> None:
    legs = [still_leg(4.0, name="a"), still_leg(30.0, every=60, name="b")]
    with pytest.raises(DataError, match="no leg gives a window") as refused:
        cut_windows(legs, length_s=20.0)
    assert refused.value.value == (
        "'a' from 0.0 to 4.0 s: 4 s, shorter than the shortest window of 5 s;"
        " 'b' from 0.0 to 30.0 s: 26 samples, fewer than 30"
    )
    assert refused.value.allowed == "windows of 5 s and more with 30 samples and more"
    assert "Take longer legs" in (refused.value.remedy or "")
