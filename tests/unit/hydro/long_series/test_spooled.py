"""Items that are kept in a file once they are long together."""

from __future__ import annotations

import tracemalloc
from itertools import repeat

import numpy as np

from auvid.hydro.long_series.spooled import Spooled


def test_items_come_back_the_same_each_time() -> None:
    legs = [np.arange(24.0).reshape(4, 6)[:, ::2], np.zeros((0, 3)), np.ones(100)]
    for limit in (1 << 20, 100):
        with Spooled(iter(legs), in_memory=limit) as kept:
            for _ in range(2):
                for leg, again in zip(legs, kept, strict=True):
                    np.testing.assert_array_equal(again, leg)


def test_long_items_leave_memory() -> None:
    """Forty of half a megabyte, of which one or two are there at a time."""
    item = np.ones(1 << 16)
    tracemalloc.start()
    with Spooled(repeat(item, 40), in_memory=1 << 20) as kept:
        assert sum(float(leg[-1]) for leg in kept) == 40.0
        _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4 << 20
