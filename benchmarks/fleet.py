"""What a fleet says: intervals of the next dive, change alarms, weak thrusters.

    python -m benchmarks.fleet intervals --seeds 4
    python -m benchmarks.fleet alarms --seeds 4
    python -m benchmarks.fleet twins --seeds 6 --leg survey

`intervals` and `alarms` draw fleets y_i = mu + tau e_i + s_i f_i, 1000 or 250 of each kind a
seed, with unequal errors s_i (standard deviation .4 of their logarithm), and compare
ways. `twins` dives the BlueROV2 Heavy of campaigns/bluerov2_twin with flow physics and
tether, each seed once healthy, once with a fifth more drag, once with one thruster at
half strength (they take turns), through resample, fuse, residual and synthesise in
memory; dives of equal condition are then a fleet. One row per result is appended to
build/fleet_NAME.csv; what stands there is not done again.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import csv
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from scipy.special import ndtri
from scipy.stats import t as student

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table, matrix
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.simulation.rov.dive import fly_dive
from auvid.hydro.dynamics.simulation.rov.open_frame import OpenFrame
from auvid.hydro.dynamics.simulation.rov.sensors import START_US
from auvid.hydro.dynamics.simulation.rov.truth import RovTruth, physical_truth
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.identification.fleet.alarms import alarm_limit, change_odds
from auvid.hydro.identification.fleet.figures import drag_of_axis
from auvid.hydro.identification.fleet.pooling import pool
from auvid.hydro.identification.fleet.scatter import BetweenDives, between_dives
from auvid.hydro.identification.fleet.thruster_strength import ThrusterLeg, thruster_strengths
from auvid.stages import fuse, resample, residual, synthesise
from auvid.stages.base import collection
from auvid.stages.columns import VELOCITY, force_columns
from auvid.stages.simulate.rov.dive_plans import dive_plan
from auvid.stages.simulate.rov.dives import recorded_dive
from auvid.stages.simulate.rov.truths import in_plan

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build"
FLEETS, ALARM_FLEETS = 1000, 250
"""Of each kind, a seed: four seeds of alarms take 2 minutes."""
I2 = (0.0, 0.3, 0.5, 0.75, 0.9, 0.98)
"""Share of the variance of estimates that is between dives."""
SPEEDS = {"X": 0.3, "Y": 0.3, "Z": 0.15, "K": 0.2, "M": 0.2, "N": 0.3}
"""Speed at which the drag of twins is compared [m/s, rad/s]."""

Row = dict[str, object]


def drawn(i2: float, dives: int, seed: int, fleets: int = FLEETS) -> tuple[Array, Array, Array]:
    """Return true figures, estimates and errors (fleets, dives), variance 1."""
    random = np.random.default_rng([seed, dives, round(100 * i2)])
    errors = np.exp(0.4 * random.standard_normal((fleets, dives)))
    errors *= np.sqrt(1.0 - i2) / np.sqrt(np.mean(errors**2))
    true = np.sqrt(i2) * random.standard_normal(errors.shape)
    return true, true + errors * random.standard_normal(errors.shape), errors


def intervals(seed: int) -> Iterator[Row]:
    """Yield how often 95 % intervals hold, by way, dives and scatter."""
    for dives in (3, 4, 5, 6, 8, 10):
        for i2 in I2:
            true, estimates, every = drawn(i2, dives + 1, seed)
            y, s = estimates[:, :-1], every[:, :-1]
            scatter = between_dives(y, s)
            targets = {
                "shows": (estimates[:, -1], every[:, -1]),
                "true": (true[:, -1], np.zeros(FLEETS)),
            }
            for target, (value, error) in targets.items():
                for way, inside in _predicted(scatter, y, s, value, error).items():
                    yield {
                        "what": f"next dive, {target}",
                        "way": way,
                        "dives": dives,
                        "i2": i2,
                        "share": float(np.mean(inside)),
                        "of": FLEETS,
                    }
            for way, inside in _means(scatter, y, s).items():
                yield {
                    "what": "mean",
                    "way": way,
                    "dives": dives,
                    "i2": i2,
                    "share": float(np.mean(inside)),
                    "of": FLEETS,
                }
            for way, tau in taus(scatter, y, s).items():
                yield {
                    "what": "tau: bias",
                    "way": way,
                    "dives": dives,
                    "i2": i2,
                    "share": float(np.mean(tau) - np.sqrt(i2)),
                    "of": FLEETS,
                }
            low, high = scatter.tau_quantile(0.025), scatter.tau_quantile(0.975)
            yield {
                "what": "tau: interval",
                "way": "weights",
                "dives": dives,
                "i2": i2,
                "share": float(np.mean((low <= np.sqrt(i2)) & (np.sqrt(i2) <= high))),
                "of": FLEETS,
            }


def taus(scatter: BetweenDives, y: Array, s: Array) -> dict[str, Array]:
    """Return tau (n,) by the four usual ways, all on the grid but the last."""
    k = y.shape[-1]
    likelihood = scatter.log_likelihood - 0.5 * np.log(scatter.mean_variance)
    at_ml, at_pm = np.argmax(likelihood, axis=-1), np.argmax(scatter.squares <= k - 1, axis=-1)
    rows = np.arange(len(y))
    w = 1.0 / s**2
    total = w.sum(axis=-1)
    q = (w * (y - ((w * y).sum(axis=-1) / total)[:, None]) ** 2).sum(axis=-1)
    return {
        "REML": scatter.tau_reml,
        "ML": np.where(at_ml == 0, 0.0, scatter.tau[rows, at_ml]),
        "Paule-Mandel": np.where(at_pm == 0, 0.0, scatter.tau[rows, at_pm]),
        "DerSimonian-Laird": np.sqrt(
            np.maximum(0.0, (q - k + 1.0) / (total - (w**2).sum(axis=-1) / total))
        ),
    }


def _predicted(
    scatter: BetweenDives, y: Array, s: Array, value: Array, error: Array
) -> dict[str, Array]:
    k, result = y.shape[-1], {}
    share = scatter.next_dive_share(value, error)
    result["weights"] = (share > 0.025) & (share < 0.975)
    for name, power in (("uniform prior", 0.0), ("prior 1/(s + tau)^2", 2.0)):
        typical = scatter.tau[:, :1] / 1e-3
        log_weight = scatter.log_weight + (1.0 - power) * np.log(typical + scatter.tau)
        log_weight -= np.logaddexp.reduce(log_weight, axis=-1, keepdims=True)
        share = replace(scatter, log_weight=log_weight).next_dive_share(value, error)
        result[name] = (share > 0.025) & (share < 0.975)
    for name, tau in taus(scatter, y, s).items():
        mean, variance, knapp = _at(tau, y, s)
        off = np.abs(value - mean)
        spread = np.sqrt(tau**2 + variance + error**2)
        result[f"Higgins-Thompson-Spiegelhalter, {name}"] = off < spread * student.ppf(0.975, k - 2)
        result[f"the same, k - 1, {name}"] = off < spread * student.ppf(0.975, k - 1)
        spread = np.sqrt(tau**2 + knapp + error**2)
        result[f"Hartung-Knapp-Sidik-Jonkman, {name}"] = off < spread * student.ppf(0.975, k - 2)
    return result


def _means(scatter: BetweenDives, y: Array, s: Array) -> dict[str, Array]:
    k = y.shape[-1]
    low, high = scatter.mean_quantile(0.025), scatter.mean_quantile(0.975)
    mean, variance, knapp = _at(scatter.tau_reml, y, s)
    return {
        "weights": (low < 0.0) & (high > 0.0),
        "Wald, REML": np.abs(mean) < 1.96 * np.sqrt(variance),
        "Hartung-Knapp-Sidik-Jonkman, REML": np.abs(mean)
        < np.sqrt(knapp) * student.ppf(0.975, k - 1),
    }


def _at(tau: Array, y: Array, s: Array) -> tuple[Array, Array, Array]:
    w = 1.0 / (s**2 + tau[:, None] ** 2)
    total = w.sum(axis=-1)
    mean = (w * y).sum(axis=-1) / total
    knapp = (w * (y - mean[:, None]) ** 2).sum(axis=-1) / (y.shape[-1] - 1) / total
    return mean, 1.0 / total, knapp


def scores(y: Array, s: Array) -> dict[str, Array]:
    """Return by way of alarm its largest statistic (n,) up to each dive (n, dives)."""
    n, dives = y.shape
    result: dict[str, Array] = defaultdict(lambda: np.full((n, dives), -np.inf))
    sums = {(k, sign): np.zeros(n) for k in (0.5, 1.0) for sign in (1.0, -1.0)}
    for k in range(3, dives):
        until, error = y[:, : k + 1], s[:, : k + 1]
        for size in (0.5, 1.0, 3.0, 6.0):
            odds = change_odds(until, error, size=size)
            result[f"largest odds, r = {size:g}"][:, k] = odds.max(axis=-1)
            mean = np.logaddexp.reduce(odds, axis=-1) - np.log(odds.shape[-1])
            result[f"mean odds, r = {size:g}"][:, k] = mean
        share = between_dives(y[:, :k], s[:, :k]).next_dive_share(y[:, k], s[:, k])
        z = ndtri(np.clip(share, 1e-9, 1.0 - 1e-9))
        result["Shewhart, next dive"][:, k] = np.abs(z)
        for (slack, sign), total in sums.items():
            sums[slack, sign] = np.maximum(0.0, total + sign * z - slack)
        for slack in (0.5, 1.0):
            result[f"CUSUM, next dive, slack {slack:g}"][:, k] = np.maximum(
                sums[slack, 1.0], sums[slack, -1.0]
            )
        best = np.full(n, -np.inf)
        for first in range(3, k + 1):
            a, b = until[:, :first], until[:, first:]
            squares = a.var(axis=-1) * first + b.var(axis=-1) * (k + 1 - first)
            spread = np.sqrt(squares / (k - 1) * (1.0 / first + 1.0 / (k + 1 - first)))
            t_value = np.abs(a.mean(axis=-1) - b.mean(axis=-1)) / spread
            best = np.maximum(best, -student.logsf(t_value, k - 1))
        result["Student's t, unweighted"][:, k] = best
    return {way: np.maximum.accumulate(values, axis=-1) for way, values in result.items()}


def alarms(seed: int) -> Iterator[Row]:
    """Yield limits of each way by the seed's fleets, and what finds a fifth more."""
    levels, kinds = (0.05, 0.01), (0.0, 0.5, 0.9, 0.98)
    quiet = [scores(*drawn(i2, 10, seed, ALARM_FLEETS)[1:]) for i2 in kinds]
    limits = {
        (way, level): max(float(np.quantile(rows[way][:, -1], 1.0 - level)) for rows in quiet)
        for way in quiet[0]
        for level in levels
    }
    own = alarm_limit(0.05)
    for i2, rows in zip(kinds, quiet, strict=True):
        yield {
            "what": "false alarms in ten dives",
            "way": "limit of the product",
            "i2": i2,
            "share": float(np.mean(rows["largest odds, r = 1"][:, -1] > own)),
            "of": ALARM_FLEETS,
        }
    for scatter in (0.03, 0.05, 0.07, 0.1):
        for i2 in (0.0, 0.5, 0.9):
            _, y, s = drawn(i2, 10, seed + 10_000, ALARM_FLEETS)
            y, s = 1.0 + scatter * y, scatter * s
            y[:, 5:] += 0.2
            rows = scores(y, s)
            for way, level in limits:
                over = rows[way] > limits[way, level]
                dives = np.argmax(over, axis=-1)[over[:, -1]] - 4
                yield {
                    "what": f"a fifth more, {level:g}",
                    "way": way,
                    "scatter": scatter,
                    "i2": i2,
                    "share": float(np.mean(over[:, -1])),
                    "dives": float(dives.mean()) if dives.size else np.nan,
                    "of": ALARM_FLEETS,
                }


def twins(seed: int, leg: str) -> Iterator[Row]:
    """Yield drag, buoyancy and strengths of the dives of a seed."""
    vehicle = vehicle_from_document(
        read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text(encoding="utf-8"))
    )
    plan = dive_plan(
        read_yaml((ROOT / "campaigns/bluerov2_twin/plans/dives.yaml").read_text(encoding="utf-8")),
        vehicle,
    )
    healthy = in_plan(physical_truth(vehicle), plan)
    assert isinstance(healthy.hull, OpenFrame)
    weak = seed % 8
    strength = np.where(np.arange(8) == weak, 0.5, 1.0)
    plates = np.array(healthy.hull.plates)
    plates[:, 6:] *= 1.2
    conditions: Mapping[str, RovTruth] = {
        "healthy": healthy,
        "drag": replace(healthy, hull=OpenFrame(plates)),
        f"thruster {weak + 1} at .5": replace(healthy, strength=strength),
    }
    for condition, truth in conditions.items():
        tables = _tables(truth, plan, leg, seed)
        card = synthesise.run(
            tables, synthesise.Params(models=("symmetric_quadratic",), trim=True)
        ).model_card["symmetric_quadratic"]
        place = {"leg": leg, "condition": condition.split(" at ")[0].split(" ")[0]}
        for axis in AXES:
            drag = drag_of_axis(card.axes[axis], axis, SPEEDS[axis])
            if drag is not None:
                yield {
                    **place,
                    "figure": f"drag {axis}",
                    "value": drag.force,
                    "standard_error": drag.standard_error,
                    "verdict": f"{drag.trade:.3f}",
                }
        ((name, table),) = tables.residual.items()
        columns = [f"thruster_{number}_N" for number in range(1, 9)]
        strengths = thruster_strengths(
            [
                ThrusterLeg(
                    np.asarray(table["t_s"]),
                    matrix(table, VELOCITY),
                    matrix(table, force_columns("tau_bar")),
                    matrix(tables.controls[name], columns),
                )
            ],
            truth.thrusters.allocation,
        )
        for result in strengths:
            yield {
                **place,
                "figure": f"thruster {result.thruster}" + " weak" * (result.thruster == weak + 1),
                "value": result.strength,
                "standard_error": result.standard_error,
                "verdict": result.verdict,
            }


def _tables(truth: RovTruth, plan: DivePlanDocument, leg: str, seed: int) -> synthesise.Inputs:
    """Return what synthesis takes of one leg of a dive."""
    entry = next(item for item in plan.legs if item.id == leg)
    dive, vehicle = fly_dive(truth, plan, entry, seed=seed), truth.vehicle
    log = recorded_dive(dive, plan, seed, "")
    info = LogInfo(
        log=leg,
        files=[],
        status="complete",
        start_us=START_US,
        end_us=START_US + round(dive.log_end_s * 1e6),
        parameters=dict(log.parameters),
        accelerometer="specific_force",
        streams={},
        counts={},
        notes=[],
    )
    streams: dict[str, pa.Table] = {
        name: make_table(name, values)
        for name, values in log.streams.items()
        if name in resample.Inputs.__dataclass_fields__
    }
    span = LegEntry(id=leg, log=leg, start_s=dive.start_s, end_s=dive.end_s, use="training")
    cut = resample.run(resample.Inputs(span, info, vehicle, **streams), resample.Params())
    ((name, segment),) = cut.segment.items()
    samples = {
        port: tables[name]
        for port in ("samples_imu", "samples_velocity", "samples_depth")
        if (tables := getattr(cut, port))
    }
    motion = fuse.run(
        fuse.Inputs(segment, cut.resampled[name], vehicle, info, **samples),
        fuse.Params(method="smoother", cutoff_hz=2.0),
    )
    force = residual.run(
        residual.Inputs(segment, motion.fused, motion.fusion, cut.resampled[name], vehicle, info),
        residual.Params(),
    )
    return synthesise.Inputs(
        collection({name: force.residual}),
        collection({name: segment}),
        vehicle,
        collection({name: motion.fused}),
        collection({name: motion.fusion}),
        collection({name: force.controls}),
    )


def study(name: str, seeds: int, rows_of: Callable[[int], Iterator[Row]]) -> list[dict[str, str]]:
    """Return the rows of all seeds; what is missing is computed and appended."""
    file = BUILD / f"fleet_{name}.csv"
    BUILD.mkdir(exist_ok=True)
    done = {row["seed"] for row in _rows(file)}
    for seed in range(seeds):
        if str(seed) in done:
            continue
        start = time.perf_counter()
        rows = [{"seed": seed, **row} for row in rows_of(seed)]
        columns = list(dict.fromkeys(key for row in rows for key in row))
        if name == "alarms":
            columns = ["seed", "what", "way", "scatter", "i2", "share", "dives", "of"]
        new = not file.exists()
        with file.open("a", newline="", encoding="utf-8") as out:
            writer = csv.DictWriter(out, columns)
            if new:
                writer.writeheader()
            writer.writerows(rows)
        print(f"seed {seed}: {time.perf_counter() - start:.1f} s", flush=True)
    return [row for row in _rows(file) if int(row["seed"]) < seeds]


def _rows(file: Path) -> list[dict[str, str]]:
    if not file.exists():
        return []
    with file.open(newline="", encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


def summary(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Return a line per way: shares in % over scatters, mean over seeds."""
    groups: dict[tuple[str, ...], list[float]] = defaultdict(list)
    for row in rows:
        key = (row["what"], row.get("scatter", ""), row.get("dives", ""), row["way"])
        if "alarm" in row["what"] or "fifth" in row["what"]:
            key = (row["what"], row.get("scatter", ""), "", row["way"])
        groups[(*key, row["i2"])].append(float(row["share"]))
    lines: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for (*place, _), shares in groups.items():
        lines[tuple(place)].append(f"{100.0 * float(np.mean(shares)):5.1f}")
    return [f"{' | '.join(place)}: {' '.join(shares)}" for place, shares in lines.items()]


def of_twins(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Return a line per figure of healthy dives, of alarms and of thrusters."""
    lines = []
    random = np.random.default_rng(0)
    drags = sorted({row["figure"] for row in rows if row["figure"].startswith("drag")})
    by: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for row in rows:
        by[row["condition"], row["figure"]].append(
            (float(row["value"] or "nan"), float(row["standard_error"] or "nan"))
        )
    for figure in drags:
        count = min(len(by["healthy", figure]), len(by["drag", figure]))
        healthy, changed = (np.array(by[kind, figure][:count]) for kind in ("healthy", "drag"))
        if count < 9:
            continue
        pooled = pool(healthy[:, 0], healthy[:, 1])
        inside = alarm = quiet = 0
        draws = 200
        for _ in range(draws):
            order = random.permutation(count)[:10]
            y, s = healthy[order].T
            share = float(between_dives(y[:7], s[:7]).next_dive_share(y[7], s[7]))
            inside += 0.025 < share < 0.975
            fleet = healthy[order[:10]].copy()
            quiet += _alarm(fleet)
            fleet[5:] = changed[order[5:10]]
            alarm += _alarm(fleet)
        lines.append(
            f"{figure}: mean {pooled.mean:.3g}, tau {pooled.tau / abs(pooled.mean):.1%}, typical"
            f" error {np.median(healthy[:, 1]) / abs(pooled.mean):.1%}, I2 {pooled.i2:.2f}, p of Q"
            f" {pooled.q_p:.2g}; a fifth more {np.mean(changed[:, 0]) / pooled.mean - 1:+.1%};"
            f" next of 7 dives inside {inside / draws:.1%}, alarms {alarm / draws:.1%}, false"
            f" {quiet / draws:.1%} of {draws} draws"
        )
    strengths = [row for row in rows if row["figure"].startswith("thruster")]
    for kind, test in (
        (
            "at half strength",
            lambda row: row["figure"].endswith("weak") and row["condition"][0] == "t",
        ),
        (
            "healthy",
            lambda row: not (row["figure"].endswith("weak") and row["condition"][0] == "t"),
        ),
    ):
        part = [row for row in strengths if test(row)]
        verdicts = defaultdict(int)
        for row in part:
            verdicts[row["verdict"]] += 1
        values = np.array([float(row["value"]) for row in part])
        lines.append(
            f"thrusters {kind}: {dict(verdicts)}, strength {np.nanmin(values):.2f} to"
            f" {np.nanmax(values):.2f}, middle {np.nanmedian(values):.2f}"
        )
    return lines


def _alarm(fleet: Array) -> bool:
    limit = alarm_limit(0.05)
    return any(change_odds(*fleet[:k].T).max() > limit for k in range(4, len(fleet) + 1))


def main() -> None:
    """Run a study and print its summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", choices=("intervals", "alarms", "twins"))
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--leg", default="survey")
    options = parser.parse_args()
    if options.study == "twins":
        rows = study(f"twins_{options.leg}", options.seeds, lambda s: twins(s, options.leg))
        print("\n".join(of_twins(rows)))
    else:
        kind = {"intervals": intervals, "alarms": alarms}[options.study]
        print("\n".join(summary(study(options.study, options.seeds, kind))))


if __name__ == "__main__":
    main()
