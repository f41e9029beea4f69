"""Numbers that a recorder writes where it has no value: they leap and come back."""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array, Mask, run_edges

FEWEST_ROWS, FEWEST_RUNS, LEAST_SHARE = 50, 5, 0.004
"""Least samples of a column, separate places of the number, and share of the samples."""
LONGEST_S = 2.0
"""A longer run is a rest or a sensor that is stuck."""
LEAP = 3.0
"""A placeholder is so many usual steps away from the samples before and after it."""
MOST_NUMBERS = 3
FEWEST_OTHERS, PAST_STEP = 3, 1.5
"""A sensor that rounds goes to the next step and comes back: a number that stands for none
is so many of the least steps of the other numbers away, of which there are so many.
"""
FAR_MORE, AS_FAR = 20.0, 0.7
"""Count over that of the next number, and spread of the samples before it over that of all."""


def placeholder(
    t_s: Array, values: Array, least: float, *, angle: bool = False
) -> tuple[float, Mask] | None:
    """Return a number that stands for none in a column (n,) at t_s (n,), and its rows.

    It comes back exactly in many short runs, from both of whose neighbours it is far, on
    one side and by more than `least`. None where no number does. Turns of an `angle`
    [rad] by 2 pi are none: a heading about north goes from 0 to 6.28 and back.
    """
    if values.size < FEWEST_ROWS or not np.isfinite(values).all():
        return None
    numbers, counts = np.unique(values, return_counts=True)
    fewest = max(FEWEST_RUNS, LEAST_SHARE * values.size)
    often = np.argsort(-counts)[:MOST_NUMBERS]
    usual = int(counts[often[1]]) if often.size > 1 else 0
    for number in numbers[often[counts[often] >= fewest]]:
        only = counts.max() > FAR_MORE * usual
        rows = _leaping(t_s, values, values == number, least, only=only, angle=angle)
        if rows is not None:
            return float(number), rows
    return None


def _leaping(
    t_s: Array, values: Array, same: Mask, least: float, *, only: bool, angle: bool
) -> Mask | None:
    """Return the rows (n,) of short runs of one number that leap and come back.

    `only`: the only number that comes back often; it need not leap where the samples about
    it are as far apart as all others: a sensor that rounds writes it near itself.
    """
    steps = np.abs(_difference(np.diff(values[~same]), angle))
    if steps.size < FEWEST_ROWS // 2:
        return None
    first, end = run_edges(same).T
    inside = (first > 0) & (end < same.size)
    inside[inside] = t_s[end[inside]] - t_s[first[inside] - 1] <= LONGEST_S
    short_first, short_end = first[inside], end[inside]
    if not short_first.size:
        return None
    others = np.unique(values[~same])
    if others.size < FEWEST_OTHERS:
        return None
    number, other_step = values[same][0], PAST_STEP * float(np.diff(others).min())
    before, after = (
        _difference(values[rows] - number, angle) for rows in (short_first - 1, short_end)
    )
    far = max(LEAP * float(np.percentile(steps, 90.0)), least, other_step)
    leaps = (np.minimum(np.abs(before), np.abs(after)) > far) & (before * after > 0.0)
    spread = max(AS_FAR * float(np.std(values[~same])), least)
    anywhere = only and float(np.std(before)) > spread
    enough = first.size if anywhere else np.count_nonzero(leaps)
    if enough < max(FEWEST_RUNS, 0.5 * first.size):
        return None
    rows = np.zeros(same.size, dtype=np.bool_)
    for start, stop in zip(short_first, short_end, strict=True):
        rows[start:stop] = True
    return rows if float(rows.mean()) >= LEAST_SHARE else None


def _difference(differences: Array, angle: bool) -> Array:
    """Return differences, those of angles between -pi and pi."""
    return (differences + np.pi) % (2.0 * np.pi) - np.pi if angle else differences
