"""Swings of one channel pooled: damping of one kind only."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.identification.passive.free_swing import FreeSwing
from auvid.stages.passive.figures import alike_damped, pooled


def swing(damping: str, values: tuple[float, float, float], amplitude: float) -> FreeSwing:
    nothing = np.zeros(0)
    return FreeSwing(
        np.array(values), np.diag([1e-4, 1e-4, 1e-4]), 0.0, 4.0, amplitude, 0.01, damping,
        nothing, nothing, nothing,
    )  # fmt: skip


def test_damping_is_the_mean_of_swings_with_the_same_terms() -> None:
    both = [swing("both", (6.0, 0.4, 0.3), 0.4), swing("both", (6.2, 0.42, 0.32), 0.4)]
    values, errors = pooled([*both, swing("linear", (5.8, 0.6, 0.0), 0.2)])
    assert values == pytest.approx([6.0, 0.41, 0.31])
    assert errors[0] == pytest.approx(0.2 / np.sqrt(3.0))


def test_of_as_many_the_larger_swings_are_taken() -> None:
    large, small = swing("both", (6.0, 0.4, 0.3), 0.4), swing("linear", (6.0, 0.5, 0.0), 0.2)
    assert alike_damped([small, large]) == [large]
