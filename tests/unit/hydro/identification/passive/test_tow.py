"""Drag in newtons from tows: truth inside its interval, prior of the mass, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.passive.tow import (
    BothWays,
    TowFit,
    TowRecord,
    both_ways,
    fit_tow,
    force_delay,
)
from tests.support.towed_body import LINEAR, MASS_KG, QUADRATIC, towed_body


def tows(seed: int, *, sign: float = 1.0, **options: object) -> list[TowRecord]:
    """Return the stretches of 25 s under tow."""
    body = towed_body(seed, **options)  # type: ignore[arg-type]
    starts = range(0, body["time_s"].size, 660)
    return [
        TowRecord(
            body["time_s"][at : at + 500],
            body["u_m_s"][at : at + 500],
            sign * body["tow_force_n"][at : at + 500],
        )
        for at in starts
    ]


def fitted(seed: int, **options: object) -> TowFit:
    """Fit with a mass of the file that is 10 % too large."""
    return fit_tow(tows(seed, **options), mass_kg=1.1 * MASS_KG, mass_sd_kg=0.2 * MASS_KG)  # type: ignore[arg-type]


def test_drag_and_mass_lie_in_their_intervals_in_most_of_thirty_tows() -> None:
    truth = np.array([MASS_KG, LINEAR, QUADRATIC])
    fits = [fitted(seed) for seed in range(30)]
    inside = np.mean(
        [np.abs(fit.values - truth) < NORMAL_95 * np.sqrt(np.diag(fit.covariance)) for fit in fits],
        axis=0,
    )
    # 95 % intervals of 30 seeds: fewer than 24 of 30 inside has a chance below 0.2 %.
    assert np.all(inside >= 0.8)
    mean = np.mean([fit.values for fit in fits], axis=0)
    assert mean == pytest.approx(truth, rel=0.05)
    assert all(fit.free == (True, True, True) for fit in fits)


def test_steady_tows_of_few_give_one_drag_and_no_mass() -> None:
    body = towed_body(1, forces=(25.0,), steady=True)
    at = slice(200, 500)
    twice = [TowRecord(body["time_s"][at], body["u_m_s"][at], body["tow_force_n"][at])] * 2
    fit = fit_tow(twice, mass_kg=MASS_KG, mass_sd_kg=0.2 * MASS_KG)
    assert fit.free == (False, False, True)
    drag, error = fit.drag(float(np.mean(fit.speeds)))
    assert drag == pytest.approx(25.0, abs=4.0 * error + 0.2)


def test_a_force_of_the_wrong_sign_and_a_short_tow_are_refused() -> None:
    with pytest.raises(DataError, match="acts against the motion"):
        fitted(2, sign=-1.0)
    body = tows(3)[0]
    short = TowRecord(body.t_s[:300], body.speed[:300], body.force_N[:300])
    with pytest.raises(DataError, match="too short a tow"):
        fit_tow([short], mass_kg=MASS_KG, mass_sd_kg=3.0)


def test_drag_of_another_form_lies_in_its_interval_at_the_speeds_that_were_towed() -> None:
    """4 u + 38 u^1.82 at seven steady speeds: what the form misses stays for all of a level."""
    rng, step = np.random.default_rng(1), 0.1
    speed = np.repeat([0.5, 0.9, 1.3, 1.7, 1.2, 0.7, 0.4], 400)
    noise = rng.normal(size=(2, speed.size))
    force = 4.0 * speed + 38.0 * speed**1.82 + 0.8 * noise[0]
    t_s = step * np.arange(speed.size)
    record = TowRecord(t_s, speed + 0.01 * noise[1], force)
    fit = fit_tow([record], mass_kg=90.0, mass_sd_kg=30.0)
    for towed_at in (0.5, 0.9, 1.3, 1.7):
        drag, error = fit.drag(towed_at)
        truth = 4.0 * towed_at + 38.0 * towed_at**1.82
        assert abs(drag - truth) < 1.3 * NORMAL_95 * error, (towed_at, drag, truth, error)


def test_drag_by_a_power_of_the_speed_counts_what_linear_and_quadratic_drag_miss() -> None:
    rng, t_s = np.random.default_rng(0), 0.1 * np.arange(230)
    records = []
    for level in (0.3, 0.5, 0.7, 0.9, 0.6, 0.4, 0.8):
        speed = level * (1.0 - np.exp(-(t_s + 0.4) / 1.2))
        force = 27.0 * speed**1.62 + 49.0 * np.gradient(speed, t_s)
        noise = rng.normal(size=(2, t_s.size))
        records.append(TowRecord(t_s, speed + 0.004 * noise[0], force + 0.25 * noise[1]))
    fit = fit_tow(records, mass_kg=45.0, mass_sd_kg=9.0)
    speeds = np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.9])

    def away(fit: TowFit) -> float:
        """Return the largest departure from the truth in standard errors."""
        return max(abs(fit.drag(x)[0] - 27.0 * x**1.62) / fit.drag(x)[1] for x in speeds)

    assert away(fit) < NORMAL_95 < away(replace(fit, power=None))


def test_a_force_on_another_clock_is_told_by_tows_whose_speed_changes() -> None:
    for seed in range(6):
        unsteady, steady = tows(seed), tows(seed, steady=True)
        assert force_delay(unsteady) == 0.0
        assert force_delay(steady) == 0.0
        late = [replace(tow, force_N=np.roll(tow.force_N, 20)) for tow in unsteady]
        assert force_delay(late) == pytest.approx(1.0)


def test_tows_both_ways_tell_a_current_from_an_offset_of_the_load_cell() -> None:
    for seed in range(3):
        ahead, astern = tows(seed), tows(seed + 50)
        ways = [
            *ahead,
            *(replace(tow, speed=-tow.speed, force_N=-tow.force_N) for tow in astern),
        ]
        assert both_ways(ways) == BothWays()
        drifting = both_ways([replace(tow, speed=tow.speed + 0.08) for tow in ways])
        assert drifting.current_m_s == pytest.approx(0.08, abs=0.01)
        assert drifting.causes == 1
        pulled = both_ways([replace(tow, force_N=tow.force_N + 3.0) for tow in ways])
        assert pulled.offset_N == pytest.approx(3.0, abs=0.3)
        assert pulled.causes == 1
        assert both_ways([replace(tow, speed=tow.speed + 0.08) for tow in ahead]) == BothWays()


def test_a_hull_whose_drag_is_another_astern_is_in_no_current() -> None:
    """A current that is taken off would be wrong by a tenth, and sure to a hundredth."""
    for seed in range(3):
        ahead, astern = tows(seed), tows(seed + 50)
        blunt = [
            replace(tow, speed=-tow.speed, force_N=-tow.force_N - drag)
            for tow in astern
            for drag in [0.2 * (LINEAR + QUADRATIC * tow.speed) * tow.speed]
        ]
        differ = both_ways([*ahead, *blunt])
        assert differ.astern == pytest.approx(0.2, abs=0.04)
        assert differ.causes == 1
        few = both_ways([ahead[1], ahead[3], blunt[1], blunt[3]])
        assert few.astern > 0.0
