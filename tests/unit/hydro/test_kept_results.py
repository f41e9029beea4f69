"""A comparison that is kept computes once for the same records."""

from __future__ import annotations

import tracemalloc
from hashlib import sha256

import numpy as np
import pytest

from auvid.hydro import kept_results
from auvid.hydro.identification.checks.motion_checks import gains_by_lag
from auvid.hydro.kept_results import ROWS_AT_ONCE, contents, kept


def test_the_same_contents_are_compared_once_and_any_other_contents_again() -> None:
    compared = []

    @kept
    def total(values: object, *, times: float = 1.0) -> float:
        compared.append(values)
        return times * float(np.sum(values))  # type: ignore[arg-type]

    values = np.arange(6.0)
    assert total(values) == total(values.copy()) == 15.0
    assert len(compared) == 1
    values[0] = 1.0
    others = [values, values.reshape(2, 3), values.astype(np.float32), values[::-1], [values]]
    assert [total(each) for each in others] == [16.0] * 5
    assert total(values, times=2.0) == 32.0
    assert len(compared) == 7


def test_contents_of_a_column_of_many_are_read_block_by_block() -> None:
    rows = 7 * ROWS_AT_ONCE + 3
    columns = np.arange(3.0 * rows).reshape(rows, 3)
    plain = sha256(f"<f8{columns[:, 1:].shape}".encode() + columns[:, 1:].tobytes()).digest()
    tracemalloc.start()
    own = contents(columns[:, 1:])
    used = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert own == plain
    assert used < 0.25 * columns.nbytes  # a copy of both columns takes .67
    assert contents(np.array(1.0)) == sha256(b"<f8()" + np.array(1.0).tobytes()).digest()


def test_only_so_many_results_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_results, "MOST_RESULTS", 2)
    compared: list[int] = []
    same = kept(lambda value: compared.append(value) or value)
    assert [same(value) for value in (1, 2, 1, 3, 1, 2)] == [1, 2, 1, 3, 1, 2]
    assert compared == [1, 2, 3, 2]


def test_no_result_of_a_record_that_is_too_long_is_kept() -> None:
    """Eight results of a log of six hours would be 200 MB."""
    compared: list[int] = []

    def total(values: np.ndarray, factor: np.ndarray) -> float:
        compared.append(len(values))
        return float(np.sum(values * factor))

    same = kept(total, longest=4)
    factor = np.array(2.0)
    assert [same(np.ones(rows), factor) for rows in (4, 4, 5, 5)] == [8.0, 8.0, 10.0, 10.0]
    assert compared == [4, 5, 5]


def test_a_result_that_another_thread_drops_is_given_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(kept_results, "MOST_RESULTS", 0)
    same = kept(lambda value: value)
    assert [same(value) for value in (1, 1, 2)] == [1, 1, 2]


def test_turned_signs_turn_the_gains_and_nothing_else() -> None:
    random = np.random.default_rng(0)
    t = np.arange(0.0, 60.0, 0.1)
    force = np.column_stack([np.sin(t), np.sin(0.4 * t + 1.0)])
    coupled = 0.1 * random.standard_normal((t.size, 2))
    motion = 0.1 * np.cumsum(force @ [0.5, -0.2]) + 0.01 * random.standard_normal(t.size)
    (plain,) = gains_by_lag(t, force, t, motion, lags_s=[0.1], coupled=coupled)
    (turned,) = gains_by_lag(t, force * [1.0, -1.0], t, -motion, lags_s=[0.1], coupled=-coupled)
    assert plain is not None
    assert turned is not None
    assert np.abs(plain.gain).min() > 0.1
    np.testing.assert_allclose(turned.gain, plain.gain * [-1.0, 1.0], rtol=1e-9)
    np.testing.assert_allclose(turned.sd, plain.sd, rtol=1e-9)
    assert np.isclose(turned.explained, plain.explained)
