"""Linear against nonlinear model: Al Makdah 2016, section 4.2.

Along open-loop manoeuvres, by both ways to the equilibrium.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.control.closed_loop import linear_response
from auvid.hydro.control.equilibrium import METHODS, equilibrium
from auvid.hydro.control.open_loop import OpenLoopRun, fly_open_loop
from auvid.hydro.control.paths.trajectories import trajectory_through
from auvid.hydro.control.plants import HybridPlant
from auvid.stages.presentation import Block, panel, plot, series, table

FROM_S, FOR_S, STEP_S = 5.0, 60.0, 0.1
"""The recording starts when the vehicle moves: a path at rest has no direction."""


@dataclass(frozen=True)
class Comparison:
    """Nonlinear run and linear response (n, 12) at t_s (n,).

    From the same state under the same inputs, by one way to the equilibrium.
    """

    run: OpenLoopRun
    method: str
    t_s: Array
    nonlinear: Array
    linear: Array

    @property
    def position_m(self) -> Array:
        """Distance of the linear from the nonlinear vehicle (n,)."""
        return np.asarray(
            np.sqrt(np.sum((self.linear[:, 6:9] - self.nonlinear[:, 6:9]) ** 2, axis=1))
        )


def linear_comparisons(
    plant: HybridPlant, runs: Sequence[OpenLoopRun], names: Sequence[str]
) -> list[Comparison]:
    """Compare open-loop runs with the linear model about their recorded paths.

    The linear model is that of Algorithm 1.

    Raises `CampaignError` for a run shorter than `FROM_S` and a second.
    """
    run_of = {run.case.name: run for run in runs}
    recorded = [_recorded(plant, run_of[name]) for name in names]
    return [_compared(plant, run, method) for run in recorded for method in METHODS]


def _recorded(plant: HybridPlant, run: OpenLoopRun) -> OpenLoopRun:
    """Return the run again, from `FROM_S` on and every `STEP_S`.

    A path through the seconds of a run has kinks that no vehicle can fly.
    """
    if run.t_s[-1] < FROM_S + 1.0:
        allowed = f"at least {FROM_S + 1.0:g} s"
        raise CampaignError(
            "too short to linearise about",
            field=f"open_loop.{run.case.name}",
            value=float(run.t_s[-1]),
            allowed=allowed,
        )
    short = replace(run.case, duration_s=min(FROM_S + FOR_S, float(run.t_s[-1])))
    fine = fly_open_loop(plant.hybrid, short, step_s=STEP_S)
    kept = slice(round(FROM_S / STEP_S), None)
    return replace(fine, t_s=fine.t_s[kept], chi=fine.chi[kept], mass_kg=fine.mass_kg[kept])


def _compared(plant: HybridPlant, run: OpenLoopRun, method: str) -> Comparison:
    t, chi = run.t_s, run.chi
    recorded = trajectory_through(t - t[0], chi[:, 6:9])
    turns = (
        2.0 * np.pi * np.round((chi[0, 11] - recorded.attitude[0, 2]) / (2.0 * np.pi))
    )  # the vehicle may have gone round before
    recorded = replace(recorded, attitude=recorded.attitude + np.array([0.0, 0.0, turns]))
    along = equilibrium(plant, recorded, method=method)
    A, B = plant.linear(along.chi, along.U, mass_kg=along.mass_kg)
    inputs = np.tile(run.case.U, (len(t), 1))
    return Comparison(run, method, t, chi, linear_response(along, A, B, inputs, start=chi[0]))


def linear_part(comparisons: Sequence[Comparison]) -> tuple[list[Block], list[dict[str, Any]]]:
    """Report blocks and rows of `results`."""
    if not comparisons:
        return [], []
    rows, figures, plots = [], [], []
    for item in comparisons:
        pitch = float(np.degrees(np.abs(item.linear[:, 10] - item.nonlinear[:, 10]).max()))
        yaw = float(np.degrees(np.abs(item.linear[:, 11] - item.nonlinear[:, 11]).max()))
        travelled = float(
            np.sum(np.sqrt(np.sum(np.diff(item.nonlinear[:, 6:9], axis=0) ** 2, axis=1)))
        )
        largest = float(item.position_m.max())
        name = item.run.case.name
        rows.append([item.run.case.title, item.method, travelled, largest, pitch, yaw])
        figures.append(
            {
                "quantity": f"linear against nonlinear, {name}, {item.method}, share of the way",
                "value": largest / travelled,
                "unit": "1",
                "note": (
                    f"largest distance between both models in {FOR_S:g} s over the way travelled"
                ),
            }
        )
        signals = ((7, "y", "m"), (8, "z", "m"), (10, "theta", "rad"), (11, "psi", "rad"))
        lines = [
            panel(
                label,
                unit,
                [series(word, item.t_s, chi[:, i], role) for word, chi, role in _lines(item)],
            )
            for i, label, unit in signals
        ]
        plots.append(
            plot(
                f"{item.run.case.title}: linear against nonlinear ({item.method})",
                lines,
                group=f"linear {name}",
            )
        )
    heads: list[str | tuple[str, str]] = [
        "manoeuvre",
        "equilibrium",
        ("travelled", "m"),
        ("apart", "m"),
        ("pitch apart", "deg"),
        ("yaw apart", "deg"),
    ]
    note = (
        "Both from the same state under the same constant inputs; the linear model about the"
        " recorded path (section 4.2). Largest values."
    )
    return [table("Linear against nonlinear model", heads, rows, note=note), *plots], figures


def _lines(item: Comparison) -> tuple[tuple[str, Array, str], ...]:
    return ("nonlinear", item.nonlinear, "true"), ("linear", item.linear, "predicted")
