"""Recursive least squares and pendulums: throughput, and what noise does to the
estimates over many draws.

    python benchmarks/recursive.py [SAMPLES]

Throughput: one pass over SAMPLES samples with three coefficients, histories kept,
compiled code warm; and the difference to batch least squares with the same prior.
Draws: the eight coefficients of Alberti's Table 4 under varying steps, 50 seeds; the
added mass under a single step (Table 3), 200 seeds; the inertia of a tube on the
quadrifilar pendulum from a noisy gyro, 200 seeds. Velocity noise 0.01 m/s and 0.01
rad/s at 8 Hz; thrust (59), known.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import sys
import time

import numpy as np
import numpy.typing as npt

from auvid.hydro.dynamics.actuators.thrusters import polynomial_thrust
from auvid.hydro.dynamics.simulation.bench_motion import Quadrifilar, swing
from auvid.hydro.identification.bench.channel_records import ChannelEstimate, ChannelRun
from auvid.hydro.identification.bench.output_error import SingleRun, simulate_run
from auvid.hydro.identification.bench.quadrifilar import (
    Estimate,
    QuadrifilarGeometry,
    object_inertia,
    slowing,
)
from auvid.hydro.identification.bench.recursive_least_squares import (
    StaticRegression,
    batch_least_squares,
    recursive_least_squares,
)
from auvid.hydro.identification.bench.single_channel import estimate_channel
from auvid.hydro.identification.bench.swing import fit_swing

Array = npt.NDArray[np.float64]
THRUST = (0.006736, -0.03366, 0.0684)
STEPS_S = (0, 8, 14, 22, 27, 35, 41, 49, 54, 62, 70, 75, 83, 89, 97, 102, 110)
STEPS = (40, 80, 30, -50, -90, -30, 60, 90, 20, -70, -40, 50, -80, 30, 90, -60, 40)
TABLE_4 = {
    "surge": (20.9, -13.5778, -27.7411, 1.0),
    "sway": (20.9, -27.9347, -50.6868, 1.0),
    "heave": (20.9, -46.3258, -64.5970, 1.0),
    "yaw": (0.90, -3.1023, -2.1709, 0.15),
}
"""Mass or inertia, added mass, quadratic damping, arm of the thrust [m]."""
NOISE, RATE_HZ = 0.01, 8.0


def throughput(samples: int) -> dict[str, float]:
    """Samples per second of the recursive estimator, and its largest relative
    difference to batch least squares at the end.
    """
    rng = np.random.default_rng(0)
    t = np.arange(1, samples + 1) / 50.0
    regressor = rng.standard_normal((samples, 3)) * [1.0, 0.3, 5.0]
    form = StaticRegression(
        t, regressor @ [0.3, -2.0, 0.1] + 0.1 * rng.standard_normal(samples), regressor, 1.0
    )
    recursive_least_squares(StaticRegression(t[:9], form.z[:9], regressor[:9], 1.0))  # compiles
    best = float("inf")
    for _ in range(3):
        begin = time.perf_counter()
        estimate = recursive_least_squares(form)
        best = min(best, time.perf_counter() - begin)
    theta, _ = batch_least_squares(form)
    difference = float(np.max(np.abs(estimate.theta[-1] / theta - 1.0)))
    return {
        "samples": float(samples),
        "million_samples_per_s": samples / best / 1e6,
        "difference_to_batch": difference,
    }


def truth_run(
    channel: str, times_s: tuple[float, ...], percent: tuple[float, ...], end_s: float
) -> tuple[SingleRun, Array]:
    """A run of Table 4 at rest before its first step, and its true velocity (n,)."""
    dry, added, quadratic, arm = TABLE_4[channel]
    mass = dry - added
    t = np.arange(0.0, end_s + 1e-9, 1.0 / RATE_HZ)
    command = np.asarray(percent, dtype=np.float64)[
        np.searchsorted(times_s, t[:-1] + 1e-9, side="right") - 1
    ]
    force = arm * polynomial_thrust(command, THRUST)
    run = SingleRun(
        t,
        force,
        force,
        np.arange(t.size),
        np.zeros(t.size),
        np.zeros(0, dtype=np.intp),
        np.zeros(0),
    )
    coefficients = np.array([0.0, quadratic / mass, 1.0 / mass, 0.0, 0.0])
    return run, simulate_run(run, coefficients, np.zeros(2), longest_step_s=1e-3)[0]


def estimated(run: SingleRun, velocity: Array, rng: np.random.Generator) -> ChannelEstimate:
    """The estimate from one draw of the noise."""
    measured = velocity + NOISE * rng.standard_normal(velocity.size)
    noisy = SingleRun(
        run.grid_s,
        run.force_left,
        run.force_right,
        run.rate_at,
        measured,
        run.position_at,
        run.position,
    )
    return estimate_channel(ChannelRun(noisy, measured, run.rate_at, noise=0.03), filter_rate=1.0)


def varying_steps(seeds: int) -> dict[str, float]:
    """Median error [%] of added mass and damping, by output error and by the recursive
    estimate, quadratic damping.
    """
    out = {}
    for channel, (dry, added, quadratic, _) in TABLE_4.items():
        run, velocity = truth_run(channel, STEPS_S, STEPS, 120.0)
        rng = np.random.default_rng(4)
        errors = []
        for _ in range(seeds):
            estimate = estimated(run, velocity, rng)
            each = (estimate.fits["quadratic"].values, estimate.recursive["quadratic"].values[-1])
            errors.append(
                [[(dry - values[0]) / added - 1.0, values[2] / quadratic - 1.0] for values in each]
            )
        median = 100.0 * np.median(np.abs(errors), axis=0)
        for index, method in enumerate(("output_error", "recursive")):
            (
                out[f"{channel}_added_mass_{method}_percent"],
                out[f"{channel}_damping_{method}_percent"],
            ) = median[index]
    return out


def single_step(seeds: int) -> dict[str, float]:
    """Share of draws whose interval holds the added mass of surge, and whose verdict is
    `not persistently exciting`.
    """
    dry, added, _, _ = TABLE_4["surge"]
    run, velocity = truth_run("surge", (0.0,), (60.0,), 30.0)
    rng = np.random.default_rng(3)
    covered = fired = recursive = 0
    for _ in range(seeds):
        estimate = estimated(run, velocity, rng)
        low, high = estimate.fits["quadratic"].mass_interval
        covered += low < dry - added < high
        value, spread = (
            estimate.recursive["quadratic"].values[-1, 0],
            estimate.recursive["quadratic"].spread[-1, 0],
        )
        recursive += abs(value - dry + added) < 1.96 * spread
        fired += estimate.excitation["quadratic"].status == "not persistently exciting"
    return {
        "coverage": covered / seeds,
        "coverage_recursive": recursive / seeds,
        "verdict_fired": fired / seeds,
    }


def quadrifilar(seeds: int) -> dict[str, float]:
    """Largest error [%] of the tube's inertia, and coverage of its interval; gyro 50
    Hz, noise 0.005 rad/s, swings of 8 degrees, 90 s.
    """
    tray = QuadrifilarGeometry(0.47, 0.47, 4.23, 9.8, 9.80665)
    t = np.arange(0.0, 90.0, 0.02)
    swings = []
    for inertia, mass in ((2.8590, 12.18), (2.1970, 9.8)):
        states, _ = swing(
            Quadrifilar(inertia, mass, 0.47, 0.47, 4.23, 0.02, 9.80665), np.radians(8.0), 90.0
        )(t)
        swings.append((states[:, 1], slowing(tray, mass, inertia)))
    rng = np.random.default_rng(0)
    errors, covered = [], 0
    for _ in range(seeds):
        fits = [
            fit_swing(t, rate + 0.005 * rng.standard_normal(t.size), slowing=soft)
            for rate, soft in swings
        ]
        tube = object_inertia(
            tray, 2.38, *[Estimate(fit.period_s, fit.standard_error_s) for fit in fits]
        )
        errors.append(100.0 * abs(tube.value / 0.6620 - 1.0))
        covered += tube.interval[0] < 0.6620 < tube.interval[1]
    return {
        "largest_error_percent": max(errors),
        "median_error_percent": float(np.median(errors)),
        "coverage": covered / seeds,
    }


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    parts = {
        "throughput": throughput(count),
        "table_4": varying_steps(50),
        "single_step": single_step(200),
        "quadrifilar": quadrifilar(200),
    }
    print(
        json.dumps(
            {
                name: {key: float(f"{value:.4g}") for key, value in part.items()}
                for name, part in parts.items()
            },
            indent=2,
        )
    )
