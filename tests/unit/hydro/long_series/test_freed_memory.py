"""Memory of freed arrays serves the next ones."""

from __future__ import annotations

import resource

import numpy as np
import pytest

from auvid.hydro.long_series.freed_memory import keep_freed_memory


def test_arrays_take_the_memory_of_those_before() -> None:
    if not keep_freed_memory():
        pytest.skip("another C library than that of GNU")
    pages = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        for _ in range(4):
            [np.ones(400_000) for _ in range(8)]  # 6300 pages
        pages.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    assert min(pages[1:]) < 1000
