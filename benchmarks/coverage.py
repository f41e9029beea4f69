"""Do the intervals of an estimator hold the truth? Seeds of a twin, sensors in memory.

    python -m benchmarks.coverage --estimator filter_error --plan matched --truth linear

Each seed flies the training legs of a plan of campaigns/vt690_twin with the viscous
truth refitted to a model, reads their sensors, starts from least squares on a filtered
force and fits every coefficient of the model. One row per coefficient is appended to
build/coverage.csv; what stands there is not done again. Printed: the share of 95 %
intervals and of three standard errors that hold the truth, with a 95 % interval of the
share (binomial, and from its scatter between seeds, since coefficients of one flight
are not independent), wrong signs, errors above half, the median error, the median width
in parts of the Cramer-Rao bound (the information at the truth under the true noise, all
legs unbroken), the worst single coefficient of those that are identified in at least
half of the seeds, and the mean square of errors in standard errors. `identified`
coefficients are those above `T_LIMIT` of their standard errors; the bound itself puts
`above_t_limit_by_the_bound` of them there. A fit that did not converge counts among the
seeds only, since no card comes of it. The estimator `truth_step` is one step of scoring
from the truth under the true noise, with the Cramer-Rao bound as its error: what the best
estimator would do, within some seconds a seed. It tells bad luck of seeds from intervals
that are too short.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import csv
import json
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import beta

from auvid.data_schemas.documents.twin import TruthEntry
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.simulation.rov.sensors import START_US
from auvid.hydro.dynamics.simulation.simulation import SimulatedVehicle
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.models import IdentifiedModel, model_named
from auvid.hydro.identification.maximum_likelihood.estimate import LikelihoodEstimate
from auvid.hydro.identification.maximum_likelihood.filter_error import fit_filter_error
from auvid.hydro.identification.maximum_likelihood.gauss_newton import solve_scaled
from auvid.hydro.identification.maximum_likelihood.likelihood import Likelihood, NoiseModel
from auvid.hydro.identification.maximum_likelihood.output_error import (
    WINDOW_S,
    fit_output_error,
)
from auvid.hydro.identification.maximum_likelihood.parameters import UnknownParameters
from auvid.hydro.identification.maximum_likelihood.records import (
    ActuatorRecord,
    LegRecord,
    SensorGeometry,
    SensorRecord,
)
from auvid.hydro.identification.maximum_likelihood.starting_values import (
    START_SD,
    starting_values,
)
from auvid.hydro.identification.maximum_likelihood.windows import cut_windows
from auvid.hydro.identification.regression.verdicts import T_LIMIT
from auvid.stages.columns import GYRO, POSE, VELOCITY
from auvid.stages.simulate.flights import REFERENCE_SPEED_M_S, fly_leg, truth_force
from auvid.stages.simulate.plans import Plan, plan_from_document
from auvid.stages.simulate.sensing import ACCEL, FINS, record

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build"
COLUMNS = (
    "truth", "plan", "estimator", "seed", "coefficient", "true", "estimate",
    "standard_error", "bound", "start", "word", "weighted_residual", "seconds",
)  # fmt: skip
HALF, REGULAR = 0.5, 0.5
OUTPUT_ERROR, TRUTH_STEP = "output_error", "truth_step"
STREAMS = {
    "attitude": ("attitude", POSE[3:]),
    "gyro": ("imu", GYRO),
    "accel": ("imu", ACCEL),
    "velocity": ("velocity", VELOCITY[:3]),
    "depth": ("depth", ("depth_m",)),
}


def twin(plan_name: str, truth: str) -> tuple[Plan, SimulatedVehicle]:
    """Return a plan and the vehicle with its truth, which is kept under build/."""
    written = (ROOT / "vehicles/vt690.yaml").read_text(encoding="utf-8")
    vehicle = vehicle_from_document(read_yaml(written))
    path = ROOT / f"campaigns/vt690_twin/plans/{plan_name}.yaml"
    plan = plan_from_document(read_yaml(path.read_text(encoding="utf-8")), vehicle)
    kept = BUILD / f"coverage_truth_{truth}_{plan_name}.json"
    if not kept.exists():
        model = truth_force(TruthEntry(name=truth, kind="refit", source="refitted"), plan, vehicle)[
            0
        ].truth
        assert isinstance(model, IdentifiedModel)
        BUILD.mkdir(exist_ok=True)
        kept.write_text(json.dumps({a: dict(t) for a, t in model.coefficients.items()}))
    coefficients = json.loads(kept.read_text())
    return plan, SimulatedVehicle(vehicle, IdentifiedModel(truth, coefficients))


def recorded_legs(
    plan: Plan, simulated: SimulatedVehicle, seed: int
) -> tuple[list[LegRecord], NoiseModel, Array]:
    """Return the training legs of a seed, the true noise and the true biases."""
    vehicle = simulated.vehicle
    place = SensorGeometry(vehicle.imu, vehicle.dvl, vehicle.depth_sensor, vehicle.gravity)
    legs, biases, force_sd = [], [], []
    for leg in plan.legs:
        if leg.use != "training":
            continue
        flown = fly_leg(plan, leg, simulated, seed=seed)
        log = record(flown, plan, seed=seed, text="")
        sensors = {}
        for name, (stream, columns) in STREAMS.items():
            t = (log.streams[stream]["time_us"] - START_US) / 1e6
            inside = (t >= flown.start_s) & (t <= flown.end_s)
            values = np.stack([log.streams[stream][column] for column in columns], axis=-1)
            sensors[name] = SensorRecord(t[inside], values[inside])
        acting = log.streams["actuators"]
        actuators = ActuatorRecord(
            (acting["time_us"] - START_US) / 1e6,
            acting["propeller_rev_s"],
            np.stack([acting[fin] for fin in FINS], axis=-1),
        )
        legs.append(LegRecord(leg.id, sensors, actuators, place))
        biases.append(np.concatenate([log.biases["accel_m_s2"], log.biases["gyro_rad_s"]]))
        if plan.unsteady is not None:
            assert vehicle.propeller is not None
            cruise = float(level_speed(vehicle.propeller, leg.rev_s))
            force_sd.append(plan.unsteady.sd * (cruise / REFERENCE_SPEED_M_S) ** 2)
    sd = (plan.ahrs.attitude_rad, plan.ahrs.gyro_rad_s, plan.ahrs.accel_m_s2, plan.dvl_sd_m_s)
    noise = NoiseModel(np.array([*np.repeat(sd, 3), plan.depth_sd_m]))
    if plan.unsteady is not None:
        time_s = np.full(6, plan.unsteady.correlation_s)
        noise = NoiseModel(noise.sensor_sd, np.array(force_sd), time_s)
    return legs, noise, np.array(biases)


def at_the_truth(
    legs: Sequence[LegRecord],
    parameters: UnknownParameters,
    theta: Array,
    biases: Array,
    noise: NoiseModel,
) -> tuple[Array, Array]:
    """Return a step of scoring (k,) from the truth, and the Cramer-Rao bound (k,).

    All legs unbroken, under the true noise.
    """
    windows, _ = cut_windows(legs, length_s=None)
    likelihood = Likelihood(legs, windows, parameters, noise.force_sd is not None, START_SD)
    common = np.concatenate([theta, biases.ravel()])
    evaluation, _ = likelihood.evaluate(
        common, likelihood.first_starts(biases), noise, sensitive=True
    )
    assert evaluation.equations is not None
    matrix, vector = evaluation.equations.reduced()
    inverse = solve_scaled(matrix, np.eye(len(matrix)))
    k = len(theta)
    return (inverse @ vector)[:k], np.sqrt(np.diag(inverse)[:k])


def rows_of(
    truth: str,
    plan_name: str,
    estimator: str,
    seed: int,
    plan: Plan,
    simulated: SimulatedVehicle,
    *,
    window_s: float = WINDOW_S,
) -> Iterator[dict[str, object]]:
    """Fit one seed; yield a row per coefficient."""
    model = simulated.truth
    assert isinstance(model, IdentifiedModel)
    legs, noise, biases = recorded_legs(plan, simulated, seed)
    terms = {axis: tuple(own) for axis, own in model.coefficients.items()}
    parameters = UnknownParameters(simulated.vehicle, terms)
    true = parameters.vector(
        {f"{axis} {t}": v for axis, own in model.coefficients.items() for t, v in own.items()}
    )
    begin = time.perf_counter()
    step, limit = at_the_truth(legs, parameters, true, biases, noise)
    if estimator == TRUTH_STEP:
        seconds = round(time.perf_counter() - begin, 1)
        for values in zip(parameters.names, true, true + step, limit, strict=True):
            name, own, value, error = values
            row = (name, own, value, error, error, own, "converged", 1.0, seconds)
            yield dict(zip(COLUMNS, (truth, plan_name, estimator, seed, *row), strict=True))
        return
    begin = time.perf_counter()
    start, first, first_noise = starting_values(legs, parameters)
    fit: LikelihoodEstimate
    if estimator.startswith(OUTPUT_ERROR):
        fit = fit_output_error(legs, parameters, start, biases=first, window_s=window_s)
    else:
        fit = fit_filter_error(legs, parameters, start, biases=first, noise=first_noise)
    seconds = time.perf_counter() - begin
    for i, name in enumerate(fit.names):
        yield dict(
            zip(
                COLUMNS,
                (
                    truth, plan_name, estimator, seed, name, true[i], fit.theta[i],
                    fit.standard_errors[i], limit[i], start[i], fit.word,
                    fit.weighted_residual, round(seconds, 1),
                ),
                strict=True,
            )
        )  # fmt: skip


def share(hits: Array, seeds: Array) -> dict[str, float | list[float]]:
    """Return a share with its 95 % interval, binomial and from the scatter of seeds."""
    n, k = len(hits), int(hits.sum())
    if not n:
        return {"share": float("nan")}
    low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
    by_seed = np.array([hits[seeds == seed].mean() for seed in np.unique(seeds)])
    half = NORMAL_95 * by_seed.std(ddof=1) / np.sqrt(len(by_seed)) if len(by_seed) > 1 else np.nan
    return {
        "share": round(k / n, 4),
        "binomial": [round(low, 3), round(high, 3)],
        "by_seeds": [round(k / n - half, 3), round(k / n + half, 3)],
    }


def summary(rows: Sequence[Mapping[str, str]]) -> dict[str, object]:
    """Return the figures of one estimator on one truth and plan, of fits that converged."""
    attempts = len({row["seed"] for row in rows})
    rows = [row for row in rows if row["word"] == "converged"]
    if not rows:
        return {"seeds": attempts, "converged": 0}

    def column(name: str) -> Array:
        return np.array([float(row[name]) for row in rows])

    true, value, error = column("true"), column("estimate"), column("standard_error")
    limit, seeds = column("bound"), column("seed")
    names = np.array([row["coefficient"] for row in rows])
    z = np.abs(value - true) / error
    identified = np.isfinite(z) & (np.abs(value) > T_LIMIT * error)
    off = np.abs(value - true) / np.abs(true)
    clear = np.abs(true) > T_LIMIT * limit
    out: dict[str, object] = {
        "seeds": attempts,
        "converged": len(np.unique(seeds)),
        "median_seconds": float(np.median(column("seconds"))),
        "weighted_residual": round(float(np.median(column("weighted_residual"))), 4),
        "above_t_limit_by_the_bound": float(
            np.median([np.sum(clear[seeds == seed]) for seed in np.unique(seeds)])
        ),
    }
    regular = [name for name in np.unique(names) if np.mean(identified[names == name]) >= REGULAR]
    worst = {name: float(np.mean(z[identified & (names == name)] < NORMAL_95)) for name in regular}
    lowest = min(worst, key=worst.__getitem__, default="")
    for label, chosen in (("all", np.isfinite(z)), ("identified", identified)):
        out[label] = {
            "in_the_median_seed": float(
                np.median([chosen[seeds == seed].sum() for seed in np.unique(seeds)])
            ),
            "in_95": share(z[chosen] < NORMAL_95, seeds[chosen]),
            "in_3_errors": share(z[chosen] < 3.0, seeds[chosen]),
            "wrong_sign": round(float(np.mean(value[chosen] * true[chosen] < 0.0)), 4),
            "off_by_half": round(float(np.mean(off[chosen] > HALF)), 4),
            "median_error": round(float(np.median(off[chosen])), 5),
            "median_error_of_start": round(
                float(np.median((np.abs(column("start") - true) / np.abs(true))[chosen])), 5
            ),
            "median_width_over_bound": round(float(np.median((error / limit)[chosen])), 3),
        }
    out["worst_identified"] = {lowest: round(worst[lowest], 3)} if lowest else {}
    out["mean_square_of_errors"] = round(float(np.mean(z[np.isfinite(z)] ** 2)), 3)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument(
        "--estimator", choices=(OUTPUT_ERROR, "filter_error", TRUTH_STEP), required=True
    )
    parser.add_argument("--truth", default="linear", help="name of a viscous model")
    parser.add_argument("--plan", default="default", help="plan of campaigns/vt690_twin")
    parser.add_argument("--window", type=float, default=WINDOW_S, help="of output error [s]")
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--seeds", type=int, default=5, help="last seed")
    parser.add_argument("--minutes", type=float, default=40.0, help="begin no seed after these")
    chosen = parser.parse_args()
    model_named(chosen.truth)
    kept = BUILD / "coverage.csv"
    BUILD.mkdir(exist_ok=True)
    if not kept.exists():
        kept.write_text(",".join(COLUMNS) + "\n")
    other = chosen.estimator == OUTPUT_ERROR and chosen.window != WINDOW_S
    estimator = f"{OUTPUT_ERROR}_{chosen.window:g}_s" if other else chosen.estimator
    key = (chosen.truth, chosen.plan, estimator)
    done = {int(row["seed"]) for row in _rows(kept) if _key(row) == key}
    plan, simulated = twin(chosen.plan, chosen.truth)
    begin = time.monotonic()
    for seed in range(chosen.first, chosen.seeds + 1):
        if seed in done or time.monotonic() - begin > 60.0 * chosen.minutes:
            continue
        rows = list(rows_of(*key, seed, plan, simulated, window_s=chosen.window))
        with kept.open("a", newline="") as file:
            csv.DictWriter(file, COLUMNS).writerows(rows)
    groups: dict[tuple[str, ...], list[dict[str, str]]] = defaultdict(list)
    for row in _rows(kept):
        groups[_key(row)].append(row)
    print(json.dumps(summary(groups[key]), indent=2))


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def _key(row: Mapping[str, str]) -> tuple[str, str, str]:
    return row["truth"], row["plan"], row["estimator"]


if __name__ == "__main__":
    main()
