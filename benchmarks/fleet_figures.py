"""Which dives of a fleet count in a figure, and how often it says what is not so.

    python -m benchmarks.fleet_figures selection
    python -m benchmarks.fleet_figures lengths --dives 100 --fleets 500

`selection`: fleets of dives with unequal errors (standard deviation .4 of their
logarithm) whose true figure is 2 to 8 of them; coverage of the 95 % interval of the mean
where dives that call the figure identified are pooled, and where all are, shown from two
such dives on. `lengths`: how often fleets without a change have an alarm, by their number of
dives, at the limit of ten dives and at that of their length. Each line has the 95 % interval
of its share (Clopper and Pearson).
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import betaincinv

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.identification.fleet.alarms import FALSE_ALARMS, alarm_limit, change_odds
from auvid.hydro.identification.fleet.scatter import between_dives
from auvid.hydro.identification.regression.verdicts import T_LIMIT

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


def largest_odds(values: Array, errors: Array) -> Array:
    """Return the largest odds of a change (n, k) that each fleet had up to each dive."""
    largest = np.full(values.shape, -np.inf)
    for end in range(4, values.shape[-1] + 1):
        largest[:, end - 1] = change_odds(values[:, :end], errors[:, :end]).max(axis=-1)
    return np.asarray(np.maximum.accumulate(largest, axis=-1))


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
        largest = np.concatenate(parts)
        for count in (each for each in (10, 30, 50, 100, 200, 300) if each <= dives):
            for figures in (1, 12):
                rate = FALSE_ALARMS / figures
                limits = alarm_limit(rate), alarm_limit(rate * min(1.0, 10.0 / count))
                words = [share(largest[:, count - 1] > limit) for limit in limits]
                yield (
                    f"{count} dives, share between dives {i2}, one of {figures}: limit of ten"
                    f" {words[0]}, of its length {words[1]}"
                )


BATCH = 25
STUDIES = ("selection", "lengths")


def main() -> None:
    """Run a study and print its lines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("--dives", type=int, default=100)
    parser.add_argument("--fleets", type=int, default=500)
    options = parser.parse_args()
    of_lengths = options.study == "lengths"
    for line in lengths(options.dives, options.fleets) if of_lengths else selection():
        print(line, flush=True)


if __name__ == "__main__":
    main()
