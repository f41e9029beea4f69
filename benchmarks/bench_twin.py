"""Tables 3 and 4 of Alberti 2015 over many draws of the noise, through log files:
python -m benchmarks.bench_twin [--seeds 50]

The runs `step_*` and `steps_*` of campaigns/thaus_twin are flown once; for each seed
their sensors are read anew, written as DataFlash logs, read back and identified by the
stage rlse. Printed: the median and the largest relative error of each coefficient, the
share of 95 % intervals that hold the truth, and how often a step was called not
persistently exciting. The mass of these runs is the 20.9 kg of Weiss.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.documents.plans.plan import TankRunEntry
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.identification.bench.channel_records import symbols
from auvid.hydro.identification.bench.persistence_of_excitation import NOT_PERSISTENT
from auvid.stages import ingest, rlse
from auvid.stages.base import RawFile, RawLog
from auvid.stages.simulate.bench import fly_experiment, record_experiment
from auvid.stages.simulate.bench_plans import bench_entries, bench_plan
from auvid.stages.simulate.dataflash_writer import write_dataflash

ROOT = Path(__file__).resolve().parents[1]
TRUTH = "weiss"
PRINTED_PERCENT = {
    "X_u|u|": 1.00,
    "X_udot": 1.33,
    "Y_v|v|": 0.68,
    "Y_vdot": 1.86,
    "Z_w|w|": 2.39,
    "Z_wdot": 1.56,
    "N_r|r|": 0.25,
    "N_rdot": 0.30,
}
"""Relative errors of Table 4 as printed."""


def draws(seeds: int) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Leg, channel and results (by quantity) of every draw of every run."""
    document = read_yaml((ROOT / "vehicles/thaus.yaml").read_text(encoding="utf-8"))
    vehicle = vehicle_from_document(document)
    written = read_yaml(
        (ROOT / "campaigns/thaus_twin/plans/thesis.yaml").read_text(encoding="utf-8")
    )
    plan = bench_plan(written, vehicle)
    legs = {leg["id"]: LegEntry(**leg) for leg in bench_entries(written, format="bin")[1]}
    for experiment in plan.experiments:
        if not isinstance(experiment.entry, TankRunEntry) or experiment.entry.truth != TRUTH:
            continue
        flown = fly_experiment(experiment, plan, vehicle, None)
        for seed in range(seeds):
            content = write_dataflash(
                record_experiment(flown, plan, vehicle, seed=seed, text="benchmark")
            )
            file = RawFile(f"{experiment.id}.BIN", np.frombuffer(content, np.uint8))
            log = ingest.run(
                ingest.Inputs(RawLog(experiment.id, (file,)), None, vehicle), ingest.Params()
            )
            streams = (log.velocity, log.imu, log.attitude, log.depth, log.actuators, log.battery)
            outputs = rlse.run(
                rlse.Inputs(legs[experiment.id], log.log_info, vehicle, *streams), rlse.Params()
            )
            assert outputs.results is not None
            yield (
                experiment.id,
                experiment.entry.channel,
                {row["quantity"]: row for row in outputs.results["rows"]},
            )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=50)
    seeds = parser.parse_args().seeds
    plan = read_yaml((ROOT / "campaigns/thaus_twin/plans/thesis.yaml").read_text(encoding="utf-8"))
    truth = plan["bench"]["truths"][TRUTH]
    errors: dict[str, dict[str, list[tuple[float, bool]]]] = {}
    verdicts: dict[str, list[str]] = {}
    for leg, channel, rows in draws(seeds):
        names = symbols(channel)
        dry = truth["mass"] if names.mass == "m" else truth[names.mass]
        total = rows[f"{names.mass} - {names.added} (quadratic)"]
        for name, row, estimate, true in (
            (names.added, total, dry - total["value"], dry - truth[names.added]),
            (
                names.quadratic,
                rows[f"{names.quadratic} (quadratic)"],
                rows[f"{names.quadratic} (quadratic)"]["value"],
                truth[names.quadratic],
            ),
        ):
            covered = row["low"] <= true <= row["high"]
            errors.setdefault(leg, {}).setdefault(name, []).append(
                (abs(estimate - truth[name]) / abs(truth[name]), covered)
            )
        verdicts.setdefault(leg, []).append(total["verdict"])
    report: dict[str, Any] = {"seeds": seeds, "runs": {}}
    for leg, found_of in errors.items():
        report["runs"][leg] = {
            name: {
                "median_percent": round(100.0 * float(np.median([error for error, _ in pairs])), 3),
                "largest_percent": round(100.0 * max(error for error, _ in pairs), 3),
                "coverage": round(float(np.mean([covered for _, covered in pairs])), 3),
                "printed_percent": PRINTED_PERCENT[name] if leg.startswith("steps_") else None,
            }
            for name, pairs in found_of.items()
        }
        report["runs"][leg]["not_persistently_exciting"] = sum(
            verdict == NOT_PERSISTENT for verdict in verdicts[leg]
        )
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
