"""Which dives of a fleet count in a figure, and how often it says what is not so.

    python -m benchmarks.fleet_figures selection
    python -m benchmarks.fleet_figures lengths --dives 100 --fleets 500
    python -m benchmarks.fleet_figures next --fleets 5000
    python -m benchmarks.fleet_figures after --fleets 1000
    python -m benchmarks.fleet_figures together --fleets 400

`selection`: fleets of dives with unequal errors (standard deviation .4 of their
logarithm) whose true figure is 2 to 8 of them; coverage of the 95 % interval of the mean
where dives that call the figure identified are pooled, and where all are, shown from two
such dives on. `lengths`: how often fleets without a change have an alarm, by their number of
dives, at the limit of ten dives and at that of their length. `next`: how often a further dive
shows what its interval holds, by dives and by share of the variance between them; with the
level of the product and at 95 % of the weights. `after`: the same of fleets in which a change
was found, pooled as levels, over all dives, and over those since the change. `together`: a
change of all drags after five of ten dives among twenty figures, found within five dives
with the shares of the product, with equal ones and without the drag of all axes, and false
alarms. Each line has the 95 % interval of
its share (Clopper and Pearson).
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np
from scipy.special import betaincinv

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.identification.fleet.alarms import (
    FALSE_ALARMS,
    alarm_limit,
    change_odds,
    change_odds_and_sizes,
)
from auvid.hydro.identification.fleet.drag import common_drag, expected_scatters
from auvid.hydro.identification.fleet.pooling import FEWEST_DIVES, outside_share
from auvid.hydro.identification.fleet.scatter import between_dives
from auvid.hydro.identification.regression.verdicts import T_LIMIT
from auvid.pipeline.commands.fleet.report.vehicle_figures import (
    ALL_DRAGS,
    DRAG_OF_AXIS,
    RISES,
    alarm_shares,
)

FLEETS = 2000


def share(hits: Sequence[bool] | Mask) -> str:
    """Return a share with its 95 % interval, exact for a binomial count."""
    n, k = len(hits), int(np.sum(hits))
    if not n:
        return "none"
    low = betaincinv(k, n - k + 1, 0.025) if k else 0.0
    high = betaincinv(k + 1, n - k, 0.975) if k < n else 1.0
    return f"{k / n:.3f} ({low:.3f} to {high:.3f}, of {n})"


def unequal(random: np.random.Generator, shape: tuple[int, int], typical: float) -> Array:
    """Return standard errors of that shape about a typical one."""
    return np.asarray(typical * np.exp(0.4 * random.standard_normal(shape)))


def holds(values: Array, errors: Array, true: float) -> tuple[Array, Mask]:
    """Return the mean of each fleet (n,), and whether its interval holds the truth."""
    scatter = between_dives(values, errors)
    weight = 1.0 / (errors**2 + scatter.tau_reml[:, None] ** 2)
    low, high = scatter.mean_quantile(0.025), scatter.mean_quantile(0.975)
    mean = (weight * values).sum(axis=-1) / weight.sum(axis=-1)
    return mean, (low < true) & (true < high)


def selection() -> Iterator[str]:
    """Yield the mean and the coverage by dives that are pooled."""
    random = np.random.default_rng(2)
    for dives in (5, 10, 30):
        for ratio in (2.0, 3.0, 4.0, 5.0, 8.0):
            for tau in (0.0, 0.15):
                shape = FLEETS, dives
                errors = unequal(random, shape, 1.0 / ratio)
                values = 1.0 + tau * random.standard_normal(shape)
                values += errors * random.standard_normal(shape)
                clear = np.abs(values) >= T_LIMIT * errors
                mean, inside = holds(values, errors, 1.0)
                printed = clear.sum(axis=-1) >= 2
                some = [
                    (float(each[0][0]), bool(each[1][0]))
                    for y, s, kept in zip(values, errors, clear, strict=True)
                    if kept.sum() >= 3
                    for each in [holds(y[None, kept], s[None, kept], 1.0)]
                ][: FLEETS // 4]
                yield (
                    f"{dives} dives, {ratio:g} errors, scatter {tau}: identified ones"
                    f" {np.mean([m for m, _ in some]) if some else np.nan:.2f},"
                    f" {share([x for _, x in some])}; all where shown"
                    f" {mean[printed].mean():.3f}, {share(inside[printed])};"
                    f" shown {printed.mean():.2f}"
                )


def largest_odds(values: Array, errors: Array, expected: Array | None = None) -> Array:
    """Return the largest odds of a rise and of a fall (2, n, k) up to each dive."""
    largest = np.full((2, *values.shape), -np.inf)
    for end in range(4, values.shape[-1] + 1):
        odds, sizes = change_odds_and_sizes(values[:, :end], errors[:, :end], expected=expected)
        for side, is_of_it in enumerate((sizes > 0.0, sizes <= 0.0)):
            largest[side, :, end - 1] = np.where(is_of_it, odds, -np.inf).max(axis=-1)
    return np.asarray(np.maximum.accumulate(largest, axis=-1))


def raised(odds: Array, rate: float, rises: float = 0.5) -> Mask:
    """Return which fleets have an alarm by their largest odds (2, n) of a rise and a fall."""
    limits = [alarm_limit(2.0 * rate * part) for part in (rises, 1.0 - rises)]
    return np.asarray((odds > np.array(limits)[:, None]).any(axis=0))


def lengths(dives: int, fleets: int) -> Iterator[str]:
    """Yield false alarms by scatter and length."""
    for i2 in (0.0, 0.5, 0.9):
        random = np.random.default_rng([11, dives, round(10 * i2)])
        parts = []
        for _ in range(fleets // BATCH):
            errors = unequal(random, (BATCH, dives), np.sqrt((1.0 - i2) / np.exp(0.32)))
            values = np.sqrt(i2) * random.standard_normal(errors.shape)
            parts.append(
                largest_odds(values + errors * random.standard_normal(errors.shape), errors)
            )
        largest = np.concatenate(parts, axis=1).max(axis=0)
        for count in (each for each in (10, 30, 50, 100, 200, 300) if each <= dives):
            for figures in (1, 12):
                rate = FALSE_ALARMS / figures
                limits = alarm_limit(rate), alarm_limit(rate * min(1.0, 10.0 / count))
                words = [share(largest[:, count - 1] > limit) for limit in limits]
                yield (
                    f"{count} dives, share between dives {i2}, one of {figures}: limit of ten"
                    f" {words[0]}, of its length {words[1]}"
                )


def next_dive(fleets: int) -> Iterator[str]:
    """Yield the coverage of the interval of the next dive, error of the next one unknown."""
    for dives in (3, 4, 5, 6, 8, 10, 20):
        for i2 in (0.0, 0.1, 0.3, 0.5, 0.75, 0.9, 0.98):
            random = np.random.default_rng([31, dives, round(100 * i2)])
            every = unequal(random, (fleets, dives + 1), np.sqrt((1.0 - i2) / np.exp(0.32)))
            values = np.sqrt(i2) * random.standard_normal(every.shape)
            values += every * random.standard_normal(every.shape)
            errors = every[:, :-1]
            scatter = between_dives(values[:, :-1], errors)
            below = scatter.next_dive_share(values[:, -1], np.sqrt(np.mean(errors**2, axis=-1)))
            words = [
                share((below > 0.5 * outside) & (below < 1.0 - 0.5 * outside))
                for outside in (outside_share(scatter, errors, 0.05), 0.05)
            ]
            yield f"{dives} dives, share between dives {i2}: {words[0]}, of the weights {words[1]}"


def after_change(fleets: int, change: float = 0.3) -> Iterator[str]:
    """Yield the coverage of the next dive where a change was found, by way of pooling."""
    for dives, at in ((8, 5), (10, 5), (10, 7), (10, 9), (20, 10)):
        for size, i2 in product((0.03, 0.05, 0.08), (0.0, 0.3, 0.9)):
            random = np.random.default_rng([37, dives, at, round(100 * size), round(10 * i2)])
            every = size * unequal(random, (fleets, dives + 1), np.sqrt((1 - i2) / np.exp(0.32)))
            values = 1.0 + size * np.sqrt(i2) * random.standard_normal(every.shape)
            values += every * random.standard_normal(every.shape)
            values[:, at:] += change
            y, s = values[:, :-1], every[:, :-1]
            levels = np.zeros(y.shape, dtype=np.int64)
            for end in range(4, dives + 1):  # the first alarm decides
                odds = change_odds(y[:, :end], s[:, :end])
                raised = (odds.max(axis=-1) > alarm_limit(FALSE_ALARMS)) & ~levels.any(axis=-1)
                first = 3 + np.argmax(odds[raised], axis=-1)
                levels[raised] = np.arange(dives) >= first[:, None]
            alarmed = levels.any(axis=-1)
            y, s, levels, following = y[alarmed], s[alarmed], levels[alarmed], values[alarmed, -1]
            error = np.sqrt(np.mean(s**2, axis=-1))
            below = between_dives(y, s, levels=levels).next_dive_share(following, error)
            every_dive = between_dives(y, s)
            words = [share((below > 0.025) & (below < 0.975))]
            below, outside = (
                every_dive.next_dive_share(following, error),
                outside_share(every_dive, s, 0.05),
            )
            words.append(share((below > 0.5 * outside) & (below < 1.0 - 0.5 * outside)))
            few = []
            for row in range(len(y)):
                own = levels[row] == 1
                if own.sum() >= FEWEST_DIVES:
                    since = between_dives(y[row, own], s[row, own])
                    part = float(since.next_dive_share(following[row], error[row]))
                    half = 0.5 * float(outside_share(since, s[row, own], 0.05))
                    few.append(half < part < 1.0 - half)
            yield (
                f"{dives} dives, {change:g} more after {at}, scatter {size:g}, share between dives"
                f" {i2}: found {alarmed.mean():.2f}; levels {words[0]}; all dives {words[1]};"
                f" dives since {share(few)}"
            )


CHANGES: dict[str, tuple[Sequence[float], Sequence[float], float]] = {
    "none, six axes, all of it errors": ([0.05] * 6, [0.0] * 6, 0.0),
    "none, six axes": ([0.05] * 6, [0.0] * 6, 0.9),
    "none, axes of twins": ([0.039, 0.078, 0.127, 0.082], [0.0] * 4, 0.68),
    "a fifth, six axes at 5 %": ([0.05] * 6, [0.2] * 6, 0.9),
    "a fifth, six axes at 7 %": ([0.07] * 6, [0.2] * 6, 0.9),
    "a fifth, six axes at 10 %": ([0.1] * 6, [0.2] * 6, 0.9),
    "a fifth, two axes at 5 %": ([0.05] * 2, [0.2] * 2, 0.9),
    "a fifth, one of six axes at 5 %": ([0.05] * 6, [0.2] + [0.0] * 5, 0.9),
    "a fifth, one of six axes at 5 %, half of it errors": ([0.05] * 6, [0.2] + [0.0] * 5, 0.5),
    "a fifth more hull drag of twins": (
        [0.039, 0.078, 0.127, 0.082],
        [0.139, 0.169, 0.142, 0.185],
        0.68,
    ),
}
"""Case -> scatter and change of the drag of each axis, share of variance between dives."""


def together(fleets: int, dives: int = 10, figures: int = 20) -> Iterator[str]:
    """Yield how often a change is found among so many figures, and falsely."""
    for case, (scatters, change, i2) in CHANGES.items():
        random = np.random.default_rng(5)
        size = np.concatenate([scatters, np.full(figures - len(scatters), 0.05)])[:, None, None]
        shape = fleets, dives
        errors = size * np.array(
            [unequal(random, shape, np.sqrt((1.0 - i2) / np.exp(0.32))) for _ in size]
        )
        values = 1.0 + size * np.sqrt(i2) * random.standard_normal(errors.shape)
        values += errors * random.standard_normal(errors.shape)
        values[: len(change), :, dives // 2 :] += np.array(change)[:, None, None]
        expected = np.full((figures, fleets), np.nan)
        expected[: len(change)] = np.transpose(
            [expected_scatters(list(values[: len(change), n])) for n in range(fleets)]
        )
        own = [largest_odds(*each)[..., -1] for each in zip(values, errors, expected, strict=True)]
        drags = [
            common_drag([(values[a, n], errors[a, n]) for a in range(len(change))])
            for n in range(fleets)
        ]
        pairs = [pair for pair in drags if pair is not None]
        common = largest_odds(*(np.array(part) for part in zip(*pairs, strict=True)))[..., -1]
        names = [f"{DRAG_OF_AXIS}{a}" if a < len(change) else str(a) for a in range(figures)]
        equal = np.any([raised(odds, FALSE_ALARMS / figures) for odds in own], axis=0)
        shares = alarm_shares([*names, ALL_DRAGS])
        alarmed = raised(common, FALSE_ALARMS * shares[ALL_DRAGS], RISES)
        for place, (name, odds) in enumerate(zip(names, own, strict=True)):
            part = RISES if place < len(change) else 0.5
            alarmed |= raised(odds, FALSE_ALARMS * shares[name], part)
        yield f"{case}: {share(alarmed)}; equal shares, no drag of all axes {share(equal)}"


BATCH = 25
STUDIES = ("selection", "lengths", "next", "after", "together")


def main() -> None:
    """Run a study and print its lines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("--dives", type=int, default=100)
    parser.add_argument("--fleets", type=int, default=500)
    options = parser.parse_args()
    studies: dict[str, Callable[[], Iterator[str]]] = {
        "selection": selection,
        "lengths": lambda: lengths(options.dives, options.fleets),
        "next": lambda: next_dive(options.fleets),
        "after": lambda: after_change(options.fleets),
        "together": lambda: together(options.fleets),
    }
    for line in studies[options.study]():
        print(line, flush=True)


if __name__ == "__main__":
    main()
