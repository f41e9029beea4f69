"""Commands of this motion, of another one, and of another time of it."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.identification.checks.relation import RATE_HZ, Relation, relation

DURATION_S = 120.0


def stepped(rng: np.random.Generator, count: int) -> np.ndarray:
    """Three commands, each held for 2 s."""
    size = round(2.0 * RATE_HZ)
    levels = rng.uniform(-1.0, 1.0, (count // size + 1, 3))
    return np.repeat(levels, size, axis=0)[:count]


def answer(commands: np.ndarray, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Three motions that follow the commands with a time constant of 1 s."""
    t = np.arange(len(commands)) / RATE_HZ
    motion = np.zeros_like(commands)
    for row in range(1, len(t)):
        motion[row] = motion[row - 1] + (commands[row - 1] - motion[row - 1]) / RATE_HZ
    motion += rng.normal(0.0, 0.1, motion.shape)
    return [(t, column) for column in motion.T]


def related(seed: int, *, other: bool = False, late_s: float = 0.0) -> Relation:
    rng = np.random.default_rng(seed)
    commands = stepped(rng, round(DURATION_S * RATE_HZ))
    motions = answer(commands, rng)
    if other:
        commands = stepped(rng, len(commands))
    result = relation(motions[0][0] + late_s, commands, motions)
    assert result is not None
    return result


def test_commands_of_the_motion_explain_more_than_at_any_other_time() -> None:
    results = [related(seed) for seed in range(10)]
    assert all(item.p == 0.0 and item.excess > 8.0 for item in results)


def test_commands_of_another_motion_are_as_likely_as_their_shifts() -> None:
    results = [related(seed, other=True) for seed in range(40)]
    assert np.mean([item.p > 0.02 for item in results]) > 0.9
    assert max(item.excess for item in results) < 3.0


@pytest.mark.parametrize("late_s", [-30.0, -8.0, 5.0, 20.0])
def test_the_shift_of_late_commands_is_named(late_s: float) -> None:
    result = related(3, late_s=late_s)
    assert result.excess < 3.0
    assert result.shift_s == pytest.approx(-late_s + 0.7, abs=0.5)  # the answer takes a second
    assert result.excess_of(result.odds_there) > 1.5  # the longest shift leaves three quarters


def test_commands_that_repeat_themselves_tell_nothing() -> None:
    t = np.arange(0.0, 120.0, 0.1)
    commands = np.column_stack([np.sin(0.8 * t), np.cos(1.1 * t)])
    motions = [(t, np.roll(column, 5)) for column in commands.T]
    assert relation(t, commands, motions) is None


def test_a_short_log_and_resting_commands_have_no_relation() -> None:
    t = np.arange(0.0, 30.0, 0.1)
    motion = [(t, np.sin(t))]
    assert relation(t, np.sin(t)[:, None], motion) is None
    # A pose that freezes for a minute and a half leaves half a minute.
    rng = np.random.default_rng(1)
    commands = stepped(rng, round(DURATION_S * RATE_HZ))
    moved = answer(commands, rng)
    paused = [(at[(at < 15.0) | (at > 105.0)], v[(at < 15.0) | (at > 105.0)]) for at, v in moved]
    assert relation(moved[0][0], commands, moved) is not None
    assert relation(moved[0][0], commands, paused) is None
    longer = np.arange(0.0, 60.0, 0.1)
    assert relation(longer, np.ones((600, 2)), [(longer, np.sin(longer))]) is None
