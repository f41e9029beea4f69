"""What commands without newtons determine: errors of one twin after another.

    python -m benchmarks.commands_twin {single,together,bent} SEEDS ROWS.json [LEGS] [SECONDS]

Legs with steps of all commands every second, white noise of 20 mm/s and .02 rad/s at
10 Hz, the lag fitted; bent: thrust goes with a power of what a command exceeds a dead band
by, and both are fitted too.
Prints, of what a user quotes, the share of twins within 2 %, and how far 95 % of them lie:
gain ratio (c over that of surge), damping over inertia at the RMS speed, time constant
at it, steady speed of a full command. Rows that the file has are not made again.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from auvid.hydro.identification.axes.coupled import fit_coupled
from auvid.hydro.identification.axes.drive import CURVE, DEAD_BAND, LAG
from auvid.hydro.identification.axes.quantities import steady_speed
from auvid.hydro.identification.axes.record import AxisRecord
from benchmarks import coverage_axes
from benchmarks.coverage_axes import INERTIA, TRUTH, leg

WITHIN = 0.02
KINDS = ("single", "together", "bent")
PLANE = ("u", "v", "w", "r")
BAND, POWER = 0.08, 1.7


def row(kind: str, seed: int, legs: int, seconds: float) -> dict[str, float]:
    """Return the relative error of each quantity of one twin."""
    coverage_axes.NOISE.update(dict.fromkeys(PLANE, 0.02))
    rng = np.random.default_rng(seed)
    inertia = INERTIA if kind == "together" else None
    records = [leg(rng, PLANE, seconds=seconds, step_s=0.1, inertia=inertia) for _ in range(legs)]
    free: tuple[str, ...] = (LAG,)
    if kind == "bent":
        records = [bent(item) for item in records]
        free = (LAG, DEAD_BAND, CURVE)
    if kind == "together":
        fit = fit_coupled(records, PLANE, inertia=inertia, leave_out=False)
        blocks = {v: (fit.block(v)[0], fit.speeds[v]) for v in PLANE}
    else:
        fits = {v: fit_coupled(records, (v,), free=free, leave_out=False) for v in PLANE}
        blocks = {v: (fits[v].block(v)[0], fits[v].speeds[v]) for v in PLANE}
    out = {}
    for v in PLANE:
        (a, b, c, _), speed = blocks[v]
        a0, b0, c0, _ = TRUTH[v]
        gain = (c / blocks["u"][0][2], c0 / TRUTH["u"][2])
        drag = (a + b * speed, a0 + b0 * speed)
        slope = (a0 + 2.0 * b0 * speed, a + 2.0 * b * speed)
        steady = (steady_speed(a, b, c), steady_speed(a0, b0, c0))
        pairs = {"gain ratio": gain, "drag over inertia": drag, "time constant": slope,
                 "steady speed": steady}  # fmt: skip
        out |= {f"{v} {name}": float(x / y - 1.0) for name, (x, y) in pairs.items()}
    return out


def bent(record: AxisRecord) -> AxisRecord:
    """Return the leg with the commands that give its forces behind BAND and POWER."""
    force = {
        axis: np.sign(x) * ((1.0 - BAND) * np.abs(x) ** (1.0 / POWER) + BAND * (x != 0.0))
        for axis, x in record.force.items()
    }
    return replace(record, force=force)


def study(kind: str, seeds: int, path: Path, legs: int, seconds: float) -> None:
    """Make the rows that are missing, and print how far they are off."""
    rows = json.loads(path.read_text()) if path.exists() else {}
    for seed in range(seeds):
        if str(seed) not in rows:
            rows[str(seed)] = row(kind, seed, legs, seconds)
            path.write_text(json.dumps(rows))
    for name in rows["0"]:
        off = np.abs([item[name] for item in rows.values()])
        print(f"{name:22s} within 2 % {np.mean(off < WITHIN):.2f}, 95 % of {len(off)} within "
              f"{100 * np.quantile(off, 0.95):.1f} %")  # fmt: skip


def main() -> None:
    """Run the study of the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.commands_twin")
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("seeds", type=int)
    parser.add_argument("path", type=Path, metavar="ROWS.json")
    parser.add_argument("legs", type=int, nargs="?", default=3)
    parser.add_argument("seconds", type=float, nargs="?", default=120.0)
    study(**vars(parser.parse_args()))


if __name__ == "__main__":
    main()
