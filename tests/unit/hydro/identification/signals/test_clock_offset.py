"""The offset between two clocks: known shifts are recovered within the stated
uncertainty, and what cannot be aligned is refused.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.signals.clock_offset import ClockOffset, clock_offset

OFFSET_S = 37.123
NOISE = 0.2  # of the signal's standard deviation


def motion(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """200 s of two band-limited random signals of unit size at 100 Hz: (n,), (n, 2)."""
    t = np.arange(0.0, 200.0, 0.01)
    values = sosfiltfilt(
        butter(3, 1.0, fs=100.0, output="sos"),
        np.random.default_rng(seed).standard_normal((t.size, 2)),
        axis=0,
    )
    return t, values / values.std(axis=0)


def sampled(
    t: np.ndarray, signal: tuple[np.ndarray, np.ndarray], *, seed: int, noise: float = NOISE
) -> np.ndarray:
    clean = np.stack([np.interp(t, signal[0], column) for column in signal[1].T], axis=1)
    return clean + noise * np.random.default_rng(seed).standard_normal(clean.shape)


def aligned(seed: int, *, noise: float = NOISE) -> ClockOffset:
    """A record of 140 s at about 14 Hz, not uniform, against one of 150 s at 10 Hz, 110
    s in common.
    """
    signal = motion(seed)
    t1 = 10.0 + np.cumsum(np.random.default_rng(1000 + seed).uniform(0.05, 0.09, 2000))
    t2 = np.arange(40.0, 190.0, 0.1)
    one, two = (
        sampled(t, signal, seed=part + 2 * seed, noise=noise) for part, t in enumerate((t1, t2))
    )
    return clock_offset(t1, one, t2 - OFFSET_S, two)


def test_a_known_shift_is_recovered_within_its_uncertainty() -> None:
    offsets = [aligned(seed) for seed in range(20)]
    errors = np.array([item.offset_s - OFFSET_S for item in offsets])
    stated = np.array([item.std_s for item in offsets])
    # Sub-sample: the faster record has steps of 70 ms.
    assert np.abs(errors).max() < 0.01
    assert np.abs(errors / stated).max() < 4.0
    # Twenty draws give the spread to 16 %; the bound may be conservative, not wrong by
    # a factor of three.
    assert 1.0 / 3.0 < errors.std() / stated.mean() < 1.5
    assert all(0.9 < item.correlation <= 1.0 for item in offsets)
    assert all(item.overlap_s == pytest.approx(110.0, abs=2.0) for item in offsets)


def test_more_noise_is_more_uncertainty() -> None:
    quiet, loud = aligned(1, noise=0.05), aligned(1, noise=0.8)
    assert loud.std_s > 5.0 * quiet.std_s
    assert abs(loud.offset_s - OFFSET_S) < 4.0 * loud.std_s


def test_the_order_of_the_logs_flips_the_sign() -> None:
    signal = motion(4)
    t = np.arange(10.0, 150.0, 0.1)
    values = sampled(t, signal, seed=1)
    there = clock_offset(t, values, t + 5.0, values)
    back = clock_offset(t + 5.0, values, t, values)
    assert there.offset_s == pytest.approx(-5.0, abs=1e-6)
    assert back.offset_s == pytest.approx(5.0, abs=1e-6)
    assert there.correlation == pytest.approx(1.0)


def test_a_pause_is_no_signal() -> None:
    """Without the pause being masked, the straight line across it would pull at the
    offset.
    """
    signal = motion(6)
    t1, t2 = np.arange(10.0, 150.0, 0.05), np.arange(20.0, 190.0, 0.1)
    t1 = t1[(t1 < 60.0) | (t1 > 90.0)]
    offset = clock_offset(
        t1, sampled(t1, signal, seed=1), t2 - OFFSET_S, sampled(t2, signal, seed=2)
    )
    assert abs(offset.offset_s - OFFSET_S) < 4.0 * offset.std_s
    assert offset.overlap_s == pytest.approx(100.0, abs=2.0)


def test_level_and_size_of_a_signal_do_not_matter() -> None:
    """Depths against two surfaces, one in feet."""
    signal = motion(7)
    t1, t2 = np.arange(10.0, 150.0, 0.1), np.arange(20.0, 190.0, 0.1)
    one, two = sampled(t1, signal, seed=1)[:, 0], sampled(t2, signal, seed=2)[:, 0]
    offset = clock_offset(t1, 1000.0 + one, t2 - OFFSET_S, 3.28 * two - 7.0)
    assert abs(offset.offset_s - OFFSET_S) < 4.0 * offset.std_s


def test_two_dives_have_a_low_correlation() -> None:
    t = np.arange(0.0, 150.0, 0.1)
    one, two = sampled(t, motion(8), seed=1), sampled(t, motion(9), seed=2)
    assert clock_offset(t, one, t, two, min_overlap_s=50.0).correlation < 0.4


def test_arrays_of_the_caller_stay_as_they_are() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    values = sampled(t, motion(2), seed=3)
    values[5] = np.nan
    before = values.copy()
    clock_offset(t, values, t, values)
    np.testing.assert_array_equal(values, before)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, x: (t[:20], x[:20]), "too short"),
        (lambda t, x: (t, np.ones_like(x)), "constant"),
        (lambda t, x: (t[::-1], x), "increase"),
        (lambda t, x: (t[:-1], x), "length"),
        (lambda t, x: (t, x[:, :1]), "number"),
        (lambda t, x: (t[:80], x[:80]), "overlap"),
    ],
)
def test_what_cannot_be_aligned_is_refused(change, message: str) -> None:  # type: ignore[no-untyped-def]
    t = np.arange(0.0, 60.0, 0.1)
    values = sampled(t, motion(2), seed=3)
    with pytest.raises(DataError, match=message):
        clock_offset(t, values, *change(t, values))
