"""The zero-phase low-pass: amplitude, no lag, edge zone, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.signals.filters import (
    edge_zone_s,
    fast_length,
    spline_lowpass,
    zero_phase_lowpass,
)

T = np.arange(3000) / 50.0


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize(("frequency", "share"), [(0.2, 1.0), (3.0, 0.5), (15.0, 0.0)])
def test_amplitude(frequency: float, share: float, order: int) -> None:
    wave = np.sin(2 * np.pi * frequency * T)
    inner = slice(500, -500)
    filtered = zero_phase_lowpass(T, wave, cutoff_hz=3.0, order=order)
    # Zero phase: the result is the wave itself, scaled.
    np.testing.assert_allclose(filtered[inner], share * wave[inner], atol=2e-3)


@pytest.mark.parametrize("cutoff_hz", [0.05, 1.0, 12.0])
@pytest.mark.parametrize("order", [2, 4, 6])
def test_it_is_the_filter_of_scipy(cutoff_hz: float, order: int) -> None:
    values = 3.0 + np.cumsum(np.random.default_rng(order).standard_normal((3000, 2)), axis=0)
    padding = int(np.ceil(2.0 * edge_zone_s(cutoff_hz, order=order) * 50.0))
    sections = butter(order, cutoff_hz, fs=50.0, output="sos")
    expected = sosfiltfilt(sections, values, axis=0, padlen=min(padding, 2999))
    own = zero_phase_lowpass(T, values, cutoff_hz=cutoff_hz, order=order)
    assert own == pytest.approx(expected, abs=1e-10 * np.abs(values).max())
    assert zero_phase_lowpass(T, values[:, 0], cutoff_hz=cutoff_hz, order=order) == pytest.approx(
        own[:, 0], abs=0.0
    )


def test_all_channels_alike_and_input_untouched() -> None:
    values = np.column_stack([np.sin(T), np.sin(T), T])
    values.flags.writeable = False
    filtered = zero_phase_lowpass(T, values, cutoff_hz=1.0)
    np.testing.assert_array_equal(filtered[:, 0], filtered[:, 1])
    # A ramp is continued as a ramp for two edge zones, after which 1e-4 of its step is
    # felt.
    np.testing.assert_allclose(filtered[:, 2], T, atol=1e-4)


def test_edge_effects_stay_in_the_edge_zone() -> None:
    spike = np.zeros_like(T)
    spike[0] = 1.0
    zone = edge_zone_s(3.0)
    assert zone == pytest.approx(0.64, abs=0.01)
    filtered = np.abs(zero_phase_lowpass(T, spike, cutoff_hz=3.0))
    assert filtered[zone <= T].max() < 0.02 * filtered.max()


def test_short_leg_is_filtered() -> None:
    assert np.isfinite(zero_phase_lowpass(T[:6], np.sin(T[:6]), cutoff_hz=3.0)).all()


def test_refuses_nan_gaps_and_impossible_cutoffs() -> None:
    hole = np.sin(T)
    hole[7] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        zero_phase_lowpass(T, hole, cutoff_hz=3.0)
    with pytest.raises(ValueError, match="uniform clock"):
        zero_phase_lowpass(np.delete(T, 100), np.delete(T, 100), cutoff_hz=3.0)
    with pytest.raises(ValueError, match="belong together"):
        zero_phase_lowpass(T, T[:-1], cutoff_hz=3.0)
    with pytest.raises(DataError, match="half the sample rate"):
        zero_phase_lowpass(T, T, cutoff_hz=25.0)
    with pytest.raises(DataError, match="too few samples"):
        zero_phase_lowpass(T[:3], T[:3], cutoff_hz=3.0)


@pytest.mark.parametrize("cutoff_hz", [0.3, 1.3, 20.0])
@pytest.mark.parametrize("n", [50, 4999, 17903])
def test_a_signal_is_continued_as_far_as_a_spline_reaches(n: int, cutoff_hz: float) -> None:
    signal = np.cumsum(np.random.default_rng(n).standard_normal(n))
    longer = np.concatenate([signal[::-1], signal, signal[::-1]])
    frequency = np.fft.rfftfreq(len(longer), 0.02)
    passed = np.fft.irfft(np.fft.rfft(longer) / (1.0 + (frequency / cutoff_hz) ** 4), len(longer))
    own = spline_lowpass(signal, cutoff_hz, step_s=0.02)
    assert own == pytest.approx(passed[n : 2 * n], abs=1e-8 * np.abs(signal).max())


def test_the_next_length_that_a_transform_likes() -> None:
    good = sorted(2**a * 3**b * 5**c for a in range(12) for b in range(8) for c in range(6))
    for least in range(1, 2000, 7):
        assert fast_length(least) == next(size for size in good if size >= least)


@pytest.mark.parametrize("order", [0, 3])
def test_an_odd_order_is_refused(order: int) -> None:
    with pytest.raises(DataError, match="must be even"):
        zero_phase_lowpass(np.arange(50.0), np.zeros(50), cutoff_hz=0.1, order=order)
