"""Coverage of 95 % intervals of single and coupled axis fits, truth inside the model.

    python -m benchmarks.coverage_axes {yaw,heave,coupled} SEEDS ROWS.json

Two legs of 120 s with steps of force every second, 20 Hz (coupled: 80 s, 10 Hz), white
noise of .01 rad/s, 5 mm of depth, .01 m/s. Rows that the file has are not made again.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from auvid.data_schemas.records.partial import AT_SPEED
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.identification.axes.coupled import fit_coupled
from auvid.hydro.identification.axes.drive import ForceDrive
from auvid.hydro.identification.axes.pooled_fit import loop_rows, make_pool, motion
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.axes.structure import Structure, axis_terms
from auvid.hydro.identification.axes.windows import MotionWindow

INERTIA = np.array([19.9, 20.6, 32.2, 0.45, 0.36, 2.9])
TRUTH = {
    "u": (-0.25, -1.2, 2.0, 0.02), "v": (-0.3, -1.6, 2.0, -0.02),
    "w": (-0.6, -2.0, 1.5, -0.05), "r": (-1.0, -0.8, 3.0, 0.03),
}  # fmt: skip
NOISE = {"u": 0.01, "v": 0.01, "w": 0.01, "r": 0.01, "depth": 0.005}


def leg(
    rng: np.random.Generator,
    velocities: tuple[str, ...],
    *,
    seconds: float,
    step_s: float,
    by_depth: bool = False,
    inertia: np.ndarray | None = None,
) -> AxisRecord:
    """Return one leg whose motion is that of TRUTH, with noise."""
    n = round(seconds / step_s)
    t = np.arange(n) * step_s
    nothing = np.full(n, np.nan)
    force = {axis: np.zeros(n) for axis in AXES}
    for velocity in velocities:
        hold = round(1.0 / step_s)
        force[AXES[VELOCITIES.index(velocity)]] = np.repeat(
            rng.uniform(-0.5, 0.5, n // hold + 1), hold
        )[:n]
    still = dict.fromkeys(VELOCITIES, np.zeros(n))
    depth = np.zeros(n) if by_depth else None
    attitude = np.zeros((n, 3))
    windows = dict.fromkeys(AXES, ((0, n),))
    blank = AxisRecord(t, still, depth, attitude, force, True, windows, (), {})
    axes = tuple(AXES[VELOCITIES.index(v)] for v in velocities)
    terms = tuple(term for axis in axes for term in axis_terms(axis, inputs=axes))
    pool = make_pool(
        Structure(velocities, terms, axes, inertia), [blank], [MotionWindow(0, 0, n)],
        constant_sd=np.zeros(len(axes)), drive=ForceDrive(0.08),
    )  # fmt: skip
    theta = np.concatenate([TRUTH[v] for v in velocities])
    rows = loop_rows(pool, pool.drive)[0]
    states = motion(pool, rows, theta, pool.windows[0], np.zeros(3 * len(axes)))[:, :, 0]
    rate = dict.fromkeys(VELOCITIES, nothing)
    if inertia is not None:
        rate |= {"p": np.zeros(n), "q": np.zeros(n)}
    for i, velocity in enumerate(velocities):
        if by_depth:
            depth = states[:, len(axes) + i] + NOISE["depth"] * rng.normal(size=n)
        else:
            rate[velocity] = states[:, i] + NOISE[velocity] * rng.normal(size=n)
    return AxisRecord(t, rate, depth, attitude, force, True, windows, (), {})


def row(kind: str, seed: int) -> dict[str, list[float]]:
    """Return name -> estimate, low, high, truth of one seed."""
    rng = np.random.default_rng(seed)
    out = {}
    velocities = {"yaw": ("r",), "heave": ("w",), "coupled": ("u", "v", "w", "r")}[kind]
    inertia = INERTIA if kind == "coupled" else None
    seconds, step_s = (80.0, 0.1) if kind == "coupled" else (120.0, 0.05)
    legs = [
        leg(rng, velocities, seconds=seconds, step_s=step_s, by_depth=kind == "heave",
            inertia=inertia)
        for _ in range(2)
    ]  # fmt: skip
    fit = fit_coupled(legs, velocities, inertia=inertia, leave_out=False, free=())
    blocks = {
        v: (*fit.block(v), fit.width, fit.without_newtons(v), fit.speeds[v]) for v in velocities
    }
    for velocity, (values, covariance, width, quantities, speed) in blocks.items():
        for name, value, error, truth in zip(
            "abcd", values, np.sqrt(np.diag(covariance)), TRUTH[velocity], strict=True
        ):
            if error > 0.0:
                out[f"{velocity} {name}"] = [
                    value,
                    value - width * error,
                    value + width * error,
                    truth,
                ]
        a, b, c, _ = TRUTH[velocity]
        steady = 2.0 * c / (np.sqrt(a * a - 4.0 * b * c) - a)
        for item in quantities:
            if item.name.startswith("steady"):
                out[f"{velocity} steady"] = [item.value, item.low, item.high, steady]
            if item.name.startswith(AT_SPEED):
                tau = -1.0 / (a + 2.0 * b * float(f"{speed:.2g}"))  # as the name has it
                out[f"{velocity} tau"] = [item.value, item.low, item.high, tau]
    return {name: [float(x) for x in values] for name, values in out.items()}


def study(kind: str, seeds: int, path: Path) -> None:
    """Make the rows that are missing, and print coverage and errors."""
    rows = json.loads(path.read_text()) if path.exists() else {}
    for seed in range(seeds):
        if str(seed) not in rows:
            rows[str(seed)] = row(kind, seed)
            path.write_text(json.dumps(rows))
    every: list[bool] = []
    for name in rows["0"]:
        data = np.array([item[name] for item in rows.values() if name in item])
        inside = (data[:, 1] <= data[:, 3]) & (data[:, 3] <= data[:, 2])
        every += inside.tolist()
        ci = binomtest(int(inside.sum()), len(inside)).proportion_ci()
        bias = float(np.mean(data[:, 0] / data[:, 3] - 1.0))
        print(f"{name:10s} {inside.mean():.3f} ({ci.low:.3f} to {ci.high:.3f}) of {len(inside)}, "
              f"mean error {100 * bias:+.2f} %")  # fmt: skip
    print(f"all        {np.mean(every):.3f} of {len(every)}")


def main() -> None:
    """Run the study of the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.coverage_axes")
    parser.add_argument("kind", choices=("yaw", "heave", "coupled"))
    parser.add_argument("seeds", type=int)
    parser.add_argument("path", type=Path, metavar="ROWS.json")
    study(**vars(parser.parse_args()))


if __name__ == "__main__":
    main()
