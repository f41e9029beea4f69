"""Which single faults of the thrusters of a dive are named: exchanged or reversed outputs.

    auvid run bluerov2_dvl
    python -m benchmarks.wiring bluerov2_dvl

The vehicle file is given each single fault in turn: two columns of the allocation
exchanged, or one of the other sign. Residual forces are those that a run with this file
has, since only the forces of the thrusters differ. Printed: how many of the faults come
out as the best explanation and how many are named, by the limit on certainty, on the
training legs and on all legs; and whether the dive as it is has one.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections.abc import Sequence
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pyarrow as pa

from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet import wiring
from auvid.hydro.identification.fleet.thruster_strength import ThrusterLeg
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.execution.runner import Run
from auvid.stages.synthesise.wiring import thruster_legs
from benchmarks.installation import share

LIMITS = (0.0, wiring.CERTAIN, 5.0)


def legs_of(run: Run, *, training: bool) -> list[ThrusterLeg]:
    """Return residual and thrusts of the training legs, or of all."""
    items = [
        key for key, leg in run.campaign.legs.items() if not training or leg["use"] == "training"
    ]
    pairs: list[tuple[pa.Table, pa.Table | None]] = []
    residual, controls = (run.graph.producers(name)[0] for name in ("residual", "controls"))
    for item in items:
        forces, thrusts = (run.artefacts_of(port, item) for port in (residual, controls))
        pairs += [(forces[key].load(), thrusts[key].load()) for key in forces]
    return thruster_legs(pairs, run.campaign.vehicle)


def with_allocation(legs: Sequence[ThrusterLeg], right: Array, wrong: Array) -> list[ThrusterLeg]:
    """Return legs as a vehicle file with another allocation (6, m) makes them."""
    return [replace(leg, tau_bar=leg.tau_bar + leg.thrust_N @ (right - wrong).T) for leg in legs]


def counted(legs: Sequence[ThrusterLeg], right: Array, limit: float) -> tuple[int, int, int]:
    """Return how many faults are the best explanation and are named, of how many."""
    best = named = 0
    faults = wiring._faulty(right)
    for outputs, wrong in faults.items():
        miswired = with_allocation(legs, right, wrong)
        with patch.multiple(wiring, CERTAIN=-np.inf, LEAST_GAIN=-np.inf):
            fault = wiring.wiring_fault(miswired, wrong)
        best += fault is not None and fault.outputs == outputs
        with patch.multiple(wiring, CERTAIN=limit):
            fault = wiring.wiring_fault(miswired, wrong)
        named += fault is not None and fault.outputs == outputs
    return best, named, len(faults)


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaign", nargs="?", default="bluerov2_dvl")
    run = open_run(parser.parse_args().campaign)
    thrusters = run.campaign.vehicle.thrusters
    assert thrusters is not None
    for training in (True, False):
        legs = legs_of(run, training=training)
        words = "training legs" if training else "all legs"
        print(f"{words}, as the dive is: {wiring.wiring_fault(legs, thrusters.allocation)}")
        for limit in LIMITS:
            best, named, tried = counted(legs, thrusters.allocation, limit)
            print(f"{words}, limit {limit:.1f}: best {best}, named {share(named, tried)}")


if __name__ == "__main__":
    main()
