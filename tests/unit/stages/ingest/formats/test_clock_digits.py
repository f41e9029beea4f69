"""Times as the digits of a clock, and seconds that only look like them."""

from __future__ import annotations

import numpy as np

from auvid.stages.ingest.formats.csv.clock_digits import counts_like_a_clock


def test_a_pause_of_a_log_in_seconds_is_no_clock() -> None:
    first, second = np.arange(0.0, 57.15, 0.1), np.arange(100.2, 158.0, 0.1)
    assert not counts_like_a_clock(np.concatenate([first, second]))


def test_two_full_minutes_or_five_digits_tell_a_clock() -> None:
    t = np.arange(30.0, 170.0, 0.5)
    assert counts_like_a_clock(t // 60 * 100 + t % 60)
    assert counts_like_a_clock(101500.0 + t[:100] // 60 * 100 + t[:100] % 60)
