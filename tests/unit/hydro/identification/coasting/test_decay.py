"""Drag from coasts: modelled laws recovered, and an oracle of another origin."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import curve_fit

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.coasting.decay import CoastRecord, fit_decay

D1, D2 = 0.4, 4.5
STARTS = (0.5, 0.8, -0.6, 0.35, -0.7, 0.45)


def closed_form(t: np.ndarray, d1: float, d2: float, start: float) -> np.ndarray:
    """Return x(t) of x' = -d1 x - d2 x|x| from x(0) = start, of either sign."""
    size = abs(start)
    return d1 * start / ((d1 + d2 * size) * np.exp(d1 * t) - d2 * size)


def coasts(
    *, noise: float, seed: int, push: float = 0.0, duration_s: float = 3.0
) -> list[CoastRecord]:
    """Coasts of the closed form, each pushed by a constant of its own (`push`)."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, duration_s, 0.1)
    empty = np.zeros((t.size, 0))
    out = []
    for start in STARTS:
        x = closed_form(t, D1, D2, start)
        if push:
            fine = np.linspace(0.0, t[-1], 3001)
            y, force, step = np.empty(fine.size), push * random.standard_normal(), fine[1]
            y[0] = start
            for i in range(fine.size - 1):
                middle = y[i] + 0.5 * step * (force - D1 * y[i] - D2 * y[i] * abs(y[i]))
                y[i + 1] = y[i] + step * (force - D1 * middle - D2 * middle * abs(middle))
            x = np.interp(t, fine, y)
        x = x + noise * random.standard_normal(t.size)
        out.append(CoastRecord(t, x, np.zeros(t.size), empty, np.zeros(t.size)))
    return out


def test_exact_coasts_give_the_law_exactly() -> None:
    fitted = fit_decay(coasts(noise=1e-7, seed=0))
    # Runge-Kutta at 20 ms and trapezoids over 0.1 s for the weights.
    np.testing.assert_allclose(fitted.drag, (D1, D2), rtol=1e-3)
    assert fitted.coasts == len(STARTS)


def test_the_fit_agrees_with_least_squares_on_the_closed_form() -> None:
    records = coasts(noise=0.003, seed=3)
    t = np.concatenate([record.t_s for record in records])
    which = np.repeat(np.arange(len(records)), records[0].t_s.size)

    def together(t_s: np.ndarray, *unknown: float) -> np.ndarray:
        starts = np.array(unknown[2:])[which]
        size = np.abs(starts)
        d1, d2 = unknown[:2]
        return d1 * starts / ((d1 + d2 * size) * np.exp(d1 * t_s) - d2 * size)

    measured = np.concatenate([record.speed for record in records])
    oracle, covariance = curve_fit(together, t, measured, p0=[1.0, 2.0, *STARTS])
    fitted = fit_decay(records)
    # They weigh the tails differently, by what unsteady water the fit allows for.
    error = np.sqrt(np.diag(covariance)[:2])
    assert np.all(np.abs(fitted.drag - oracle[:2]) < 1.5 * error)
    assert np.all(np.sqrt(np.diag(fitted.covariance)) < 3.0 * error)


def test_intervals_hold_the_law_where_each_coast_has_a_push_of_its_own() -> None:
    inside = []
    for seed in range(12):
        fitted = fit_decay(coasts(noise=0.002, seed=seed, push=0.03))
        rate, error = fitted.rate(0.3)
        inside.append(abs(rate - D1 - 0.3 * D2) < 1.96 * error)
    assert np.mean(inside) >= 0.75  # 0.97 over 40 seeds


def test_intervals_of_three_coasts_hold_the_law_where_their_drag_differs() -> None:
    """By Student's t: 1.96 without it hold .85, 40 seeds; with it .95."""
    t_s, empty, inside = np.arange(0.0, 3.0, 0.2), np.zeros((15, 0)), []
    for seed in range(14):
        random = np.random.default_rng(seed)
        records = [
            CoastRecord(
                t_s, speed + 0.004 * random.standard_normal(15), 0.0 * t_s, empty, 0.0 * t_s
            )
            for start in STARTS[:3]
            for own in [1.0 + 0.25 * random.standard_normal()]
            for speed in [closed_form(t_s, D1 * own, D2 * own, start)]
        ]
        rate, error = fit_decay(records).rate(0.3)
        inside.append(abs(rate - D1 - 0.3 * D2) < 1.96 * error)
    assert np.mean(inside) >= 0.9


@pytest.mark.parametrize("how", ["bottom", "tether"])
def test_a_coast_that_is_stopped_by_something_else_is_left_out(how: str) -> None:
    records = coasts(noise=0.002, seed=5, push=0.01)
    halted = records[1]
    stopped = (
        np.where(halted.t_s < 0.6, halted.speed, 0.0)
        if how == "bottom"
        else halted.speed - 0.5 * np.maximum(halted.t_s - 0.5, 0.0)
    )
    records[1] = CoastRecord(halted.t_s, stopped, halted.modelled, halted.shapes, halted.fading)
    fitted = fit_decay(records)
    assert fitted.odd.tolist() == [1]
    rate, error = fitted.rate(0.3)
    assert abs(rate - D1 - 0.3 * D2) < 4.0 * error


def test_thrust_that_lags_is_no_drag() -> None:
    """A thrust that fades over 0.1 s after the stop, of another size than expected."""
    records = []
    for record in coasts(noise=1e-4, seed=1):
        t, fine = record.t_s, np.linspace(0.0, record.t_s[-1], 3001)
        fading = np.sign(record.speed[0]) * 2.0 * np.exp(-fine / 0.1)
        y, step = np.empty(fine.size), fine[1]
        y[0] = record.speed[0]
        for i in range(fine.size - 1):
            slope = -D1 * y[i] - D2 * y[i] * abs(y[i]) + 0.7 * fading[i]
            middle = y[i] + 0.5 * step * slope
            y[i + 1] = y[i] + step * (-D1 * middle - D2 * middle * abs(middle) + 0.7 * fading[i])
        expected = np.interp(t, fine, fading)
        records.append(
            CoastRecord(t, np.interp(t, fine, y), record.modelled, record.shapes, expected)
        )
    fitted = fit_decay(records)
    # Samples 0.1 s apart resolve what fades over 0.1 s to some percent.
    assert fitted.rate(0.3)[0] == pytest.approx(D1 + 0.3 * D2, rel=0.05)


def test_a_dense_record_is_thinned_and_two_coasts_are_too_few() -> None:
    record = coasts(noise=0.0, seed=0)[0]
    dense = CoastRecord(
        *(
            np.repeat(part, 40, axis=0)
            for part in (record.t_s, record.speed, record.modelled, record.shapes, record.fading)
        )
    )
    assert dense.thinned().t_s.size <= 50
    np.testing.assert_allclose(dense.thinned().speed[[0, -1]], record.speed[[0, -1]], rtol=0.1)
    with pytest.raises(DataError, match="too few coasts"):
        fit_decay(coasts(noise=0.0, seed=0)[:2])


def test_speeds_that_a_turn_ends_at_once_are_no_fault_of_the_fit() -> None:
    """A step of the fit makes their drag a push, and speeds run away."""
    random = np.random.default_rng(1)
    out = []
    for start in (1.29, 0.93, -1.05, 1.02, -1.03, 1.15, 1.14, -1.08):
        t = np.arange(0.0, 2.2, 0.1)
        x = start / (1.0 + np.exp((t - 1.2) / 0.15)) + 0.008 * random.standard_normal(t.size)
        out.append(CoastRecord(t, x, np.zeros(t.size), np.zeros((t.size, 0)), np.zeros(t.size)))
    fitted = fit_decay(out)
    assert np.isfinite(fitted.drag).all()
    assert np.isfinite(fitted.covariance).all()
