"""What was flown of a bench plan, as a document and a report section."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from auvid.data_schemas.documents.plans.plan import TankRunEntry
from auvid.stages.presentation import Block, panel, plot, section, series, table, text
from auvid.stages.simulate.bench import FlownExperiment
from auvid.stages.simulate.bench_plans import CHANNELS
from auvid.stages.simulate.sensing import Recorded

SHOWN_S = 120.0


def bench_document(
    title: str,
    truth: str,
    seed: int,
    format: str,
    flown: Mapping[str, FlownExperiment],
    recorded: Mapping[str, Recorded],
) -> dict[str, Any]:
    """Schema `simulation`; a leg names its experiment and its true numbers."""
    legs = [
        {
            "id": name,
            "experiment": item.experiment.kind,
            "start_s": item.experiment.margin_s,
            "end_s": item.experiment.margin_s + item.experiment.end_s,
            "stopped": None,
            "truth": {key: float(value) for key, value in item.truth.items()},
            "biases": {key: value.tolist() for key, value in recorded[name].biases.items()},
        }
        for name, item in flown.items()
    ]
    return {"plan": title, "truth": truth, "seed": seed, "format": format, "legs": legs}


def bench_section(
    document: Mapping[str, Any], flown: Mapping[str, FlownExperiment]
) -> dict[str, Any]:
    """Truths as a table, and the motion of every run."""
    blocks: list[Block] = [
        text(
            f"Plan: {document['plan']}. Seed {document['seed']}, logs as {document['format']}. Each"
            " run begins at rest."
        ),
        table(
            "True numbers of each run",
            ["run", "experiment", "numbers in SI"],
            [
                [
                    leg["id"],
                    leg["experiment"],
                    ", ".join(f"{key} {value:g}" for key, value in leg["truth"].items()),
                ]
                for leg in document["legs"]
            ],
            note=(
                "What is not named here is that of the vehicle file; damping that is not named"
                " is 0."
            ),
        ),
    ]
    blocks += [_plot(name, item) for name, item in flown.items()]
    return section("The twin", blocks, order=5)


def _plot(name: str, flown: FlownExperiment) -> Block:
    t = np.linspace(0.0, min(flown.experiment.end_s, SHOWN_S), 1201)
    state, _ = flown.trajectory(t)
    run = flown.experiment.entry
    if not isinstance(run, TankRunEntry):
        panels = [panel("angle", "deg", [series("true", t, np.degrees(state[:, 0]), "true")])]
        return plot(f"True swing of {name}", panels, look_for="The swing decays without a jump.")
    assert flown.changes_s is not None
    assert flown.pulses_us is not None
    which = np.searchsorted(flown.changes_s, t, side="right") - 1
    used = np.flatnonzero(np.ptp(flown.pulses_us, axis=0) > 0.0)
    pulses = [
        series(f"output {index + 1}", t, flown.pulses_us[which, index], "raw") for index in used
    ]
    axis = CHANNELS.index(run.channel)
    unit = "m/s" if axis < 3 else "rad/s"
    panels = [
        panel("pulse", "us", pulses),
        panel("uvwpqr"[axis], unit, [series("true", t, state[:, axis], "true")]),
    ]
    return plot(
        f"True motion of {name}",
        panels,
        look_for="Each step of the pulse starts a new rise towards its own speed.",
    )
