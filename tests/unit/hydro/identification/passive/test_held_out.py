"""What is predicted of a stretch by the others, where the truth is the same and not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.coasting.decay import CoastRecord
from auvid.hydro.identification.passive.free_swing import FreeSwing, fit_free_swing
from auvid.hydro.identification.passive.held_out import coasts_held_out, swings_held_out
from tests.support.towed_body import towed_body


def coast(start: float, linear: float, quadratic: float, seed: int) -> CoastRecord:
    t_s = np.arange(0.0, 6.0, 0.1)
    x = np.full(t_s.size, start)
    for n in range(1, t_s.size):
        x[n] = x[n - 1] - 0.1 * (linear * x[n - 1] + quadratic * x[n - 1] * abs(x[n - 1]))
    noise = 0.004 * np.random.default_rng(seed).standard_normal(t_s.size)
    none = np.zeros(t_s.size)
    return CoastRecord(t_s, x + noise, none, np.zeros((t_s.size, 0)), none)


def test_alike_coasts_predict_each_other_and_others_do_not() -> None:
    alike = [coast(0.5 + 0.1 * n, 0.1, 0.6, n) for n in range(6)]
    assert (coasts_held_out(alike) or 0.0) > 90.0
    mixed = [coast(0.8, 0.05 if n % 2 else 0.6, 0.2, n) for n in range(6)]
    assert (coasts_held_out(mixed) or 0.0) < 60.0
    assert coasts_held_out(alike[:3]) is None


def test_a_swing_is_judged_by_the_others_only() -> None:
    body = towed_body(4)
    swings = [
        fit_free_swing(body["time_s"][part], body["phi_rad"][part])
        for part in (slice(495 + 660 * n, 655 + 660 * n) for n in range(3))
    ]

    def mean(others: list[FreeSwing]) -> Array:
        return np.mean([item.values for item in others], axis=0)

    assert (swings_held_out(swings, mean) or 0.0) > 90.0
    assert swings_held_out(swings[:1], mean) is None
    slow = replace(swings[0], values=swings[0].values * [0.5, 1.0, 1.0])
    assert (swings_held_out([slow, swings[1]], lambda others: others[0].values) or 0.0) < 60.0
