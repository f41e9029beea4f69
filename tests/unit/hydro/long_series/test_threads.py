"""Work on several items at once."""

from __future__ import annotations

import threading
from functools import partial

import pytest

from auvid.hydro.long_series import threads


def test_items_are_worked_on_at_once_and_come_in_their_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(threads, "THREADS", 2)
    both_there = threading.Barrier(2, timeout=10.0)

    def work(item: int) -> int:
        both_there.wait()  # breaks where they come one after the other
        return -item

    assert threads.at_once(work, [3, 1, 2, 4]) == [-3, -1, -2, -4]
    assert threads.together(partial(work, 1), partial(work, 2)) == (-1, -2)
    with pytest.raises(ZeroDivisionError):
        threads.at_once(lambda item: 1 // item, [1, 0])


def test_the_environment_says_how_many_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", "3")
    assert threads._thread_count() == 3
    monkeypatch.delenv("NUMBA_NUM_THREADS")
    assert threads._thread_count() >= 1


def test_processes_share_the_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    for processors, processes, left in ((5, 2, 2), (2, 3, 1)):
        monkeypatch.setattr(threads, "THREADS", processors)
        threads.share_among(processes)
        assert left == threads.THREADS
