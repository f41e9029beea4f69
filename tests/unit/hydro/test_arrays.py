"""Arrays that several rooms share: the recursion and the mean against SciPy's filters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from auvid.hydro import arrays
from auvid.hydro.arrays import median, moving_mean, recursion, unwrapped
from auvid.hydro.dynamics.actuators.lag import first_order_lag


@pytest.mark.parametrize("samples", [1, 2, 3, 400])
@pytest.mark.parametrize("feedback", [[-0.9], [-1.6, 0.7]])
def test_a_recursion_is_scipy_s_filter(samples: int, feedback: list[float]) -> None:
    driven = np.random.default_rng(0).normal(size=(samples, 3))
    np.testing.assert_allclose(
        recursion(driven, feedback), lfilter([1.0], [1.0, *feedback], driven, axis=0), rtol=1e-12
    )


@pytest.mark.compiles("hydro/long_series/compiled_bands.py")
def test_a_long_recursion_is_that_of_a_short_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """But for rounding, in which LAPACK's kernels differ: 4e-15 of the largest value."""
    driven = np.random.default_rng(1).normal(size=(300, 3))
    driven.flags.writeable = False
    for feedback in ([-0.9], [-1.8, 0.81], [-1.2, 0.5, 0.01, -0.02]):
        short = recursion(driven, feedback)
        with monkeypatch.context() as long:
            long.setattr(arrays, "LONG", 0)
            compiled = recursion(driven, feedback)
        np.testing.assert_allclose(compiled, short, rtol=0.0, atol=1e-13 * np.abs(short).max())


@pytest.mark.parametrize(("samples", "width"), [(5, 1), (50, 2), (400, 33), (90, 151)])
def test_a_moving_mean_has_the_bits_of_scipy_s(samples: int, width: int) -> None:
    values = np.random.default_rng(2).normal(size=(samples, 3)) ** 9
    expected = uniform_filter1d(values, width, axis=0, mode="nearest")
    assert np.array_equal(moving_mean(values, width), expected)
    assert np.array_equal(moving_mean(values[:, 0], width), expected[:, 0])


@pytest.mark.parametrize("shape", [(50, 0), (0, 3)])
def test_a_recursion_of_nothing_is_nothing(shape: tuple[int, int]) -> None:
    """LAPACK's wrapper damages the memory of the process where there is no column."""
    for _ in range(100):
        assert recursion(np.zeros(shape), [-0.9]).shape == shape


@pytest.mark.parametrize("shape", [(0,), (0, 4), (5, 0)])
def test_a_lag_of_nothing_is_nothing(shape: tuple[int, ...]) -> None:
    assert first_order_lag(np.zeros(shape), lag_s=0.1, step_s=0.1).shape == shape


@pytest.mark.parametrize("missing", [False, True])
def test_angles_without_jumps_are_numpy_s_to_the_bit(missing: bool) -> None:
    turning = np.cumsum(np.random.default_rng(3).normal(size=(400, 3)), axis=0)
    turning[50] = turning[49] + np.pi  # a half turn may be either one
    jumping = np.column_stack([np.remainder(turning[:, :2], 2.0 * np.pi), 0.01 * turning[:, 2]])
    if missing:
        jumping[200] = np.nan
    for angles in (jumping, jumping[:, 0], jumping[:, 2], jumping[:1], jumping[:0]):
        np.testing.assert_array_equal(unwrapped(angles), np.unwrap(angles, axis=0))


@pytest.mark.parametrize("shape", [(1,), (6,), (7,), (8, 3), (9, 2, 2)])
def test_a_median_is_numpy_s(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(2).normal(size=shape)
    np.testing.assert_array_equal(median(values), np.median(values, axis=0))
    values[0] = np.nan
    np.testing.assert_array_equal(median(values), np.median(values, axis=0))
