"""A Monte Carlo of closed-loop flights: 1000 H-AUVs with drawn coefficients over 60 s
of the helix, seconds in all.

python -m benchmarks.closed_loop
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

from auvid.data_schemas.yaml_text import read_yaml

ROOT = Path(__file__).resolve().parents[1]
MEMBERS, DURATION_S = 1000, 60.0


def measure() -> dict[str, float]:
    """Seconds for the design of the helix and all its flights, and for the Monte Carlo;
    members and simulated seconds per second.
    """
    from auvid.data_schemas.documents.control_cases import ControlCasesDocument
    from auvid.data_schemas.documents.model import parse
    from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
    from auvid.stages.control.cases import limits_of, trajectories_of, weights_of
    from auvid.stages.control.flying import fly_case, models_of, monte_carlo

    vehicle = vehicle_from_document(read_yaml((ROOT / "vehicles/hauv.yaml").read_text()))
    document = read_yaml((ROOT / "campaigns/hauv/cases.yaml").read_text())
    cases = parse(ControlCasesDocument, {**document, "redesign": []})
    limits = limits_of(cases)
    models = models_of(vehicle, None, cases, limits)
    helix = next(case for case in trajectories_of(cases) if case.name == "helix")
    begin = time.perf_counter()
    flown = fly_case(models, helix, weights_of(cases), limits, allow_unstable=False)
    designed = time.perf_counter()
    errors, _ = monte_carlo(
        models, None, flown[0], duration_s=DURATION_S, relative_sd=0.15, members=MEMBERS, seed=1
    )
    taken = time.perf_counter() - designed
    return {
        "design_and_flights_s": designed - begin,
        "monte_carlo_s": taken,
        "members": float(len(errors.cross_track_rms_m)),
        "vehicle_seconds_per_s": MEMBERS * DURATION_S / taken,
    }


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    print(json.dumps({key: round(value, 3) for key, value in measure().items()}, indent=2))
