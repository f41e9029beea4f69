"""Do standard errors of least squares hold the truth on short legs? Drawn regressions.

    python -m benchmarks.coverage_short_legs --trials 60

One axis with eight columns (own velocity, its square with sign, five other velocities, a
constant) of which five have the coefficient zero; velocities that wander or that answer
steps of 4 to 12 s, all low-passed at 1 Hz; an error of the force that remembers 1 or 3 s,
that has a fast and a slow part, that grows with the velocity, or that is white. Nothing
of it comes from a twin of this project. One row per case is appended to
build/coverage_short_legs.csv; a case that stands there is not done again. Beside
`LeftOutBlocks` stands the covariance with Bartlett's kernel and automatic lags.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import csv
from collections.abc import Callable
from itertools import product

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.hydro.identification.regression.standard_errors import (
    LeftOutBlocks,
    hac_covariance,
)
from auvid.hydro.identification.regression.verdicts import T_LIMIT
from benchmarks.coverage import BUILD

STEP_S = 0.05
LOWPASS = butter(2, 1.0 * 2.0 * STEP_S, output="sos")
LEGS = ((20, 8), (45, 1), (45, 4), (90, 1), (90, 4), (300, 1), (1200, 1))
"""Length [s] and number of legs."""
TERMS = ("u", "u*|u|", "v", "w", "p", "q", "r")
TRUE = np.array([-20.0, -30.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
COLUMNS = (
    "leg_s", "legs", "motion", "error", "trials", "estimator", "in_95", "in_3_errors",
    "zeros_identified", "median_error",
)  # fmt: skip


def wander(rng: np.random.Generator, n: int, memory_s: float, count: int) -> Array:
    """Return stationary first-order noise (n, count) of variance 1."""
    kept, start = np.exp(-STEP_S / memory_s), int(10 * memory_s / STEP_S)
    white = rng.normal(size=(n + start, count))
    return np.asarray(lfilter([np.sqrt(1 - kept**2)], [1, -kept], white, axis=0)[start:])


def answers(rng: np.random.Generator, n: int) -> Array:
    """Return answers (n, 6), with 2 s, to steps of 4 to 12 s, each velocity by itself."""
    commands = np.zeros((n, 6))
    for column in commands.T:
        start = 0
        while start < n:
            stop = start + int(rng.uniform(4.0, 12.0) / STEP_S)
            column[start:stop] = rng.choice([-1, 0, 0, 1]) * rng.uniform(0.5, 1.0)
            start = stop
    kept = np.exp(-STEP_S / 2.0)
    return np.asarray(lfilter([1 - kept], [1, -kept], commands, axis=0)) + 0.05 * wander(
        rng, n, 1.0, 6
    )


MOTIONS: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "wandering": lambda rng, n: wander(rng, n, 3.0, 6),
    "steps": answers,
}
ERRORS: dict[str, Callable[[np.random.Generator, int, Array], Array]] = {
    "1 s": lambda rng, n, u: wander(rng, n, 1.0, 1)[:, 0],
    "3 s": lambda rng, n, u: wander(rng, n, 3.0, 1)[:, 0],
    "fast and slow": lambda rng, n, u: (
        0.7 * (wander(rng, n, 0.3, 1) + wander(rng, n, 8.0, 1))[:, 0]
    ),
    "with velocity": lambda rng, n, u: wander(rng, n, 1.0, 1)[:, 0] * (0.3 + np.abs(u) / 0.1),
    "white": lambda rng, n, u: 3.0 * rng.normal(size=n),
}


def trial(seed: int, leg_s: int, legs: int, motion: str, error: str) -> dict[str, Array]:
    """Return errors over standard errors (8,), and standard errors, by estimator."""
    rng, n = np.random.default_rng(seed), int(leg_s / STEP_S)
    parts = []
    for _ in range(legs):
        nu = 0.15 * np.asarray(sosfiltfilt(LOWPASS, MOTIONS[motion](rng, n), axis=0))
        rows = np.vstack([nu[:, 0], nu[:, 0] * np.abs(nu[:, 0]), nu[:, 1:].T])
        noise = sosfiltfilt(LOWPASS, ERRORS[error](rng, n, nu[:, 0]))
        parts.append((rows, TRUE[:-1] @ rows + noise))
    factor = TriangularFactor.empty(TERMS)
    for rows, force in parts:
        factor = factor.update(rows, np.column_stack([force, np.zeros((n, 5))]))
    fit = solve_axis(factor, "X", TERMS, trim=True)
    blocks = LeftOutBlocks.empty(fit)
    scores = []
    for rows, force in parts:
        blocks = blocks.update(rows, force)
        design = np.vstack([rows, np.ones(n)])
        scores.append((design * (force - fit.solution @ design)).T)
    design = np.hstack([np.vstack([rows, np.ones(n)]) for rows, _ in parts])
    covariances = {
        "left-out blocks": blocks.covariance(),
        "Bartlett, automatic lags": hac_covariance(scores, np.linalg.inv(design @ design.T)),
    }
    out = {}
    for name, covariance in covariances.items():
        errors = np.sqrt(np.diag(covariance))
        out[name] = np.vstack([np.abs(fit.solution - TRUE) / errors, errors])
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--trials", type=int, default=60, help="drawn records a case")
    parser.add_argument("--output", default="coverage_short_legs.csv", help="in build/")
    chosen = parser.parse_args()
    path = BUILD / chosen.output
    BUILD.mkdir(exist_ok=True)
    if not path.exists():
        path.write_text(",".join(COLUMNS) + "\n")
    with path.open(newline="") as file:
        done = {tuple(row[name] for name in COLUMNS[:5]) for row in csv.DictReader(file)}
    for (leg_s, legs), motion, error in product(LEGS, MOTIONS, ERRORS):
        trials = chosen.trials if leg_s < 1000 else max(chosen.trials // 4, 1)
        key = (leg_s, legs, motion, error, trials)
        if tuple(map(str, key)) in done:
            continue
        drawn = [trial(seed, leg_s, legs, motion, error) for seed in range(trials)]
        for estimator in drawn[0]:
            z, errors = np.array([item[estimator] for item in drawn]).transpose(1, 0, 2)
            row = (
                *key,
                estimator,
                round(float(np.mean(z < NORMAL_95)), 3),
                round(float(np.mean(z < 3.0)), 3),
                round(float(np.mean(z[:, 2:7] >= T_LIMIT)), 4),
                float(np.format_float_positional(np.median(errors[:, 0]), 3, fractional=False)),
            )
            with path.open("a", newline="") as file:
                csv.writer(file).writerow(row)
            print(*row, sep="\t", flush=True)


if __name__ == "__main__":
    main()
