"""Do the intervals of least squares hold the truth? Seeds of a twin, in memory.

    python -m benchmarks.coverage_least_squares --truth linear --seeds 6

Each seed flies the training legs of a plan of campaigns/vt690_twin with the viscous
truth refitted to a model, and goes through resample, fuse (smoother), residual and
synthesise as pure functions. One row per coefficient is appended to
build/coverage_least_squares.csv; what stands there is not done again. Printed are the
figures of `summary`, for all coefficients with a number and for those called identified.
Widths over the Cramer-Rao bound are of seeds whose bound stands in build/coverage.csv, by

    python -m benchmarks.coverage --estimator truth_step --truth linear --seeds 6
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import csv
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard, TermCard
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.tables import make_table
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.simulation.rov.sensors import START_US
from auvid.hydro.dynamics.simulation.simulation import SimulatedVehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.regression.assumed_figures import FORM, UNSTEADY, total_error
from auvid.stages import fuse, resample, residual, synthesise
from auvid.stages.base import collection
from auvid.stages.simulate.flights import fly_leg
from auvid.stages.simulate.plans import Plan
from auvid.stages.simulate.sensing import record
from benchmarks.coverage import BUILD, HALF, TRUTH_STEP, share, twin

COLUMNS = (
    "truth", "plan", "seed", "coefficient", "true", "value", "standard_error", "verdict",
)  # fmt: skip
REGULARLY = 0.5
"""A coefficient counts as regularly identified from this share of the seeds on."""


@dataclass(frozen=True)
class Leg:
    """Tables of one training leg between sensors and synthesis."""

    segment: SegmentRecord
    fused: pa.Table
    fusion: FusionRecord
    residual: pa.Table
    controls: pa.Table


def legs_of(plan: Plan, simulated: SimulatedVehicle, seed: int) -> dict[str, Leg]:
    """Return the tables of the training legs of a seed."""
    legs = {}
    for leg in plan.legs:
        if leg.use != "training":
            continue
        flown = fly_leg(plan, leg, simulated, seed=seed)
        log = record(flown, plan, seed=seed, text="")
        info = LogInfo(
            log=leg.id,
            files=[],
            status="complete",
            start_us=START_US,
            end_us=START_US + round(flown.log_end_s * 1e6),
            parameters={},
            accelerometer="specific_force",
            streams={},
            counts={},
            notes=[],
        )
        entry = {
            "id": leg.id,
            "log": leg.id,
            "start_s": flown.start_s,
            "end_s": flown.end_s,
            "use": "training",
        }
        streams = {name: make_table(name, values) for name, values in log.streams.items()}
        vehicle = simulated.vehicle
        cut = resample.run(
            resample.Inputs(LegEntry(**entry), info, vehicle, **streams),  # type: ignore[arg-type]
            resample.Params(),
        )
        for name, segment in cut.segment.items():
            samples = {
                port: tables[name]
                for port in ("samples_imu", "samples_velocity", "samples_depth")
                if (tables := getattr(cut, port))
            }
            motion = fuse.run(
                fuse.Inputs(segment, cut.resampled[name], vehicle, info, **samples),
                fuse.Params(method="smoother"),
            )
            force = residual.run(
                residual.Inputs(
                    segment, motion.fused, motion.fusion, cut.resampled[name], vehicle, info
                ),
                residual.Params(),
            )
            legs[name] = Leg(segment, motion.fused, motion.fusion, force.residual, force.controls)
    return legs


def card_of(legs: Mapping[str, Leg], simulated: SimulatedVehicle, model: str) -> ModelCard:
    """Return the card of a model from the tables of its legs."""
    inputs = synthesise.Inputs(
        collection({name: leg.residual for name, leg in legs.items()}),
        collection({name: leg.segment for name, leg in legs.items()}),
        simulated.vehicle,
        collection({name: leg.fused for name, leg in legs.items()}),
        collection({name: leg.fusion for name, leg in legs.items()}),
        collection({name: leg.controls for name, leg in legs.items()}),
    )
    params = synthesise.Params(models=(model,), current_m_s=0.0)  # as the campaign states
    return synthesise.run(inputs, params).model_card[model]


def rows_of(
    truth: str, plan_name: str, seed: int, plan: Plan, simulated: SimulatedVehicle
) -> Iterator[dict[str, object]]:
    """Fit one seed; yield a row per coefficient of the truth."""
    model = simulated.truth
    assert isinstance(model, IdentifiedModel)
    card = card_of(legs_of(plan, simulated, seed), simulated, truth)
    for axis, terms in model.coefficients.items():
        entries = {item.term: item for item in card.axes[axis].terms}
        for term, true in terms.items():
            item = entries[term]
            yield dict(
                zip(
                    COLUMNS,
                    (
                        truth, plan_name, seed, f"{axis} {term}", true, item.value,
                        _of_the_data(item), item.verdict,
                    ),
                    strict=True,
                )
            )  # fmt: skip


def _of_the_data(item: TermCard) -> float | None:
    """Return the error by noise and by what the force error says.

    The figures of the vehicle are exact on the twin, so they have no part.
    """
    if item.standard_error is None:
        return None
    shifts = {name: item.assumed_shifts.get(name, 0.0) for name in (FORM, UNSTEADY)}
    return total_error(item.standard_error, shifts)


def summary(
    rows: Sequence[Mapping[str, str]], bounds: Mapping[tuple[str, str], float]
) -> dict[str, object]:
    """Return coverage, signs and errors: all coefficients with a number, and identified.

    bounds: seed and coefficient -> the Cramer-Rao bound on its standard error.
    """
    numbered = [row for row in rows if row["value"] and row["standard_error"]]
    seeds = {row["seed"] for row in rows}
    identified = [row for row in numbered if row["verdict"] == "identified"]
    counts = [sum(row["seed"] == seed for row in identified) for seed in seeds]
    out: dict[str, object] = {
        "seeds": len(seeds),
        "coefficients": len({row["coefficient"] for row in rows}),
        "median_identified_of_a_seed": float(np.median(counts)),
    }
    for label, chosen in (("all", numbered), ("identified", identified)):
        true, value, error = (
            np.array([float(row[name]) for row in chosen])
            for name in ("true", "value", "standard_error")
        )
        z, own = np.abs(value - true) / error, np.array([row["seed"] for row in chosen])
        off = np.abs(value - true) / np.abs(true)
        out[label] = {
            "in_95": share(z < NORMAL_95, own),
            "in_3_errors": share(z < 3.0, own),
            "wrong_sign": round(float(np.mean(value * true < 0.0)), 4),
            "off_by_half": round(float(np.mean(off > HALF)), 4),
            "median_error": round(float(np.median(off)), 4),
            "median_width": round(float(np.median(error / np.abs(true))), 4),
            "median_width_over_bound": _width_over_bound(chosen, bounds),
        }
    out["below_85"] = _seldom(identified, len(seeds))
    return out


def _width_over_bound(
    rows: Sequence[Mapping[str, str]], bounds: Mapping[tuple[str, str], float]
) -> float | None:
    """Return the median of standard errors over their bounds; None without a bound."""
    widths = [
        float(row["standard_error"]) / bounds[place]
        for row in rows
        if (place := (row["seed"], row["coefficient"])) in bounds
    ]
    return round(float(np.median(widths)), 2) if widths else None


def _bounds(truth: str, plan: str) -> dict[tuple[str, str], float]:
    """Return seed and coefficient -> the bound that `benchmarks.coverage` kept."""
    kept, key = BUILD / "coverage.csv", (truth, plan, TRUTH_STEP)
    if not kept.exists():
        return {}
    with kept.open(newline="") as file:
        return {
            (row["seed"], row["coefficient"]): float(row["bound"])
            for row in csv.DictReader(file)
            if (row["truth"], row["plan"], row["estimator"]) == key
        }


def _seldom(identified: Sequence[Mapping[str, str]], seeds: int) -> dict[str, str]:
    """Return the regularly identified coefficients that hold their truth in under 85 %."""
    seldom = {}
    for name in dict.fromkeys(row["coefficient"] for row in identified):
        own = [row for row in identified if row["coefficient"] == name]
        inside = sum(
            abs(float(row["value"]) - float(row["true"])) < NORMAL_95 * float(row["standard_error"])
            for row in own
        )
        if len(own) >= REGULARLY * seeds and inside < 0.85 * len(own):
            seldom[name] = f"{inside} of {len(own)}"
    return seldom


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--truth", default="linear", help="name of a viscous model")
    parser.add_argument("--plan", default="default", help="plan of campaigns/vt690_twin")
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--seeds", type=int, default=6, help="last seed")
    parser.add_argument("--minutes", type=float, default=14.0, help="begin no seed after these")
    parser.add_argument("--output", default="coverage_least_squares.csv", help="in build/")
    chosen = parser.parse_args()
    kept = BUILD / chosen.output
    BUILD.mkdir(exist_ok=True)
    if not kept.exists():
        kept.write_text(",".join(COLUMNS) + "\n")
    plan, simulated = twin(chosen.plan, chosen.truth)
    key = (chosen.truth, chosen.plan)

    def rows() -> list[dict[str, str]]:
        with kept.open(newline="") as file:
            return [row for row in csv.DictReader(file) if (row["truth"], row["plan"]) == key]

    done = {int(row["seed"]) for row in rows()}
    begin = time.monotonic()
    for seed in range(chosen.first, chosen.seeds + 1):
        if seed in done or time.monotonic() - begin > 60.0 * chosen.minutes:
            continue
        new = list(rows_of(*key, seed, plan, simulated))
        with kept.open("a", newline="") as file:
            csv.DictWriter(file, COLUMNS).writerows(new)
    print(json.dumps(summary(rows(), _bounds(*key)), indent=2))


if __name__ == "__main__":
    main()
