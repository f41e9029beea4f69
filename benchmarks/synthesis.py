"""Least-squares fits of all eight viscous models: one triangular factor against numpy's
lstsq, on the same samples, in one run.

    python -m benchmarks.synthesis [SAMPLES]

Both sides start from velocities, propulsion ratios and forces, and build the basis with
the same function. numpy gets the whole basis once, kept in memory, and as few calls as
give the models: one per model and distinct set of terms. One BLAS thread.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import resource
import sys
import time
import tracemalloc
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.models import MODELS
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis

Array = npt.NDArray[np.float64]
AXES = "XYZKMN"
BLOCK_SAMPLES = 4096
TERMS = tuple(dict.fromkeys(term for model in MODELS for term in model.distinct_terms))
Coefficients = Mapping[tuple[str, str], Array]


def rich_motion(n: int, seed: int = 5) -> tuple[Array, Array, Array]:
    """Velocities (6, n) that excite every axis (surge in both directions), propulsion
    ratio (n,), and forces (n, 6) with noise.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(n) / 50.0
    size = np.array([1.5, 0.4, 0.3, 0.3, 0.25, 0.4])
    nu = np.zeros((6, n))
    for axis in range(6):
        for rate in rng.uniform(0.05, 2.0, size=5):
            nu[axis] += size[axis] / 2.0 * np.sin(rate * t + rng.uniform(0.0, 2.0 * np.pi))
    eta = 1.0 + 0.3 * np.sin(0.21 * t)
    force = np.empty((n, 6))
    drag = rng.uniform(5.0, 50.0, size=6)
    for start in range(0, n, BLOCK_SAMPLES):
        part = nu[:, start : start + BLOCK_SAMPLES]
        force[start : start + BLOCK_SAMPLES] = -(drag[:, None] * part * np.abs(part)).T
    force += rng.standard_normal((n, 6))
    return nu, eta, force


def fit_in_one_pass(nu: Array, eta: Array, force: Array) -> Coefficients:
    """Every model from one triangular factor, the basis built block by block."""
    factor = TriangularFactor.empty(TERMS)
    for start in range(0, nu.shape[1], BLOCK_SAMPLES):
        stop = start + BLOCK_SAMPLES
        factor = factor.update(
            basis_rows(nu[:, start:stop], eta[start:stop], TERMS), force[start:stop]
        )
    return {
        (model.name, axis): solve_axis(factor, axis, model.terms[axis]).solution
        for model in MODELS
        for axis in AXES
        if model.terms[axis]
    }


def fit_with_numpy(nu: Array, eta: Array, force: Array) -> Coefficients:
    """Every model by numpy.linalg.lstsq on columns of the whole basis."""
    basis = basis_rows(nu, eta, TERMS).T
    place = {term: index for index, term in enumerate(TERMS)}
    coefficients = {}
    for model in MODELS:
        for terms in {terms for terms in model.terms.values() if terms}:
            axes = [axis for axis in AXES if model.terms[axis] == terms]
            columns = basis[:, [place[term] for term in terms]]
            values = np.asarray(
                np.linalg.lstsq(columns, force[:, [AXES.index(axis) for axis in axes]], rcond=None)[
                    0
                ],
                dtype=np.float64,
            )
            coefficients.update(
                {(model.name, axis): values[:, index] for index, axis in enumerate(axes)}
            )
    return coefficients


def measure(n: int = 1_000_000) -> dict[str, float]:
    """Seconds of both ways and their ratio, peak memory beyond the input, and the
    largest relative difference of a coefficient vector.

    Memory: ours by tracemalloc in a run of its own; numpy's as the growth of the
    process (a lower bound). Ours is the best of two runs.
    """
    data = rich_motion(n)
    ours_s = float("inf")
    for _ in range(2):
        begin = time.perf_counter()
        ours = fit_in_one_pass(*data)
        ours_s = min(ours_s, time.perf_counter() - begin)
    tracemalloc.start()
    fit_in_one_pass(*data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.perf_counter()
    theirs = fit_with_numpy(*data)
    theirs_s = time.perf_counter() - begin
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return {
        "samples": float(n),
        "models": float(len(MODELS)),
        "numpy_s": theirs_s,
        "auvid_s": ours_s,
        "ratio": theirs_s / ours_s,
        "numpy_peak_mb": grown / 1024,
        "auvid_peak_mb": peak / 1e6,
        "largest_relative_difference": max(
            float(np.linalg.norm(ours[key] - theirs[key]) / np.linalg.norm(theirs[key]))
            for key in theirs
        ),
    }


if __name__ == "__main__":
    samples = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    print(
        json.dumps(
            {key: float(f"{value:.4g}") for key, value in measure(samples).items()}, indent=2
        )
    )
