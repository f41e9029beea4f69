"""Open-loop manoeuvres of a control campaign, and strip theory.

Report blocks and named figures; strip theory is compared with the printed coefficients.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.data_schemas.documents.control_cases import QUANTITIES, OpenLoopEntry
from auvid.hydro.control.open_loop import (
    Finding,
    OpenLoopRun,
    findings,
    fly_open_loop,
    open_loop_cases,
)
from auvid.hydro.dynamics.hybrid_vehicle import (
    PARAMETER_SETS,
    hybrid_vehicle,
)
from auvid.hydro.dynamics.vehicle.strip_theory import strip_theory_of
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.coefficients import Coefficient
from auvid.stages.presentation import Block, panel, plot, remark, series, table

SHOWN_SET = "as_simulated"
UNSTATED = ("steady_u", "steady_w", "steady_phi", "steady_theta", "depth", "radius")
"""Quantities that every run of the shown set gives, whether the text states them or not."""
LONGEST_BESIDE_S = 200.0
"""The other parameter sets fly the cases with statements up to this duration: a glide
of 1000 s says no more than one of 200 s.
"""


@dataclass(frozen=True)
class Part:
    """Report blocks, rows of `results`, and runs under the simulations' parameters."""

    blocks: tuple[Block, ...]
    rows: tuple[dict[str, Any], ...]
    runs: tuple[OpenLoopRun, ...] = ()


def open_loop_part(cases: Mapping[str, OpenLoopEntry], vehicle: Vehicle) -> Part:
    """Fly the open-loop cases of a cases document.

    With every parameter set of the vehicle that has them.

    Figures are named `open loop CASE, QUANTITY, SET`, in SI. Errors as `hybrid_vehicle`
    and `open_loop_cases`.
    """
    runs: list[OpenLoopRun] = []
    for name in PARAMETER_SETS:
        hybrid = hybrid_vehicle(vehicle, name)
        for case in open_loop_cases(cases, hybrid):
            if name == SHOWN_SET or (case.statements and case.duration_s <= LONGEST_BESIDE_S):
                runs.append(fly_open_loop(hybrid, case))
    compared = [item for run in runs for item in findings(run)]
    own = tuple(run for run in runs if run.parameter_set == SHOWN_SET)
    blocks = [
        _statements(compared),
        *(remark(words, "note") for words in _ended(runs)),
        *(_plot(run) for run in own),
    ]
    rows = [_row(item) for item in compared] + [row for run in own for row in _unstated(run)]
    return Part(tuple(blocks), tuple(rows), own)


def coefficients_part(vehicle: Vehicle) -> Part:
    """Compare strip theory, printed and corrected, with the published coefficients.

    Figures are named `NAME, as_printed` and `NAME, corrected`.
    """
    printed, corrected = (
        _by_name(strip_theory_of(vehicle, corrected=flag)) for flag in (False, True)
    )
    rows = [
        [
            name,
            item.unit,
            item.value,
            printed[name].value,
            corrected[name].value,
            item.source,
            corrected[name].source,
        ]
        for name, item in vehicle.published.items()
        if name in printed
    ]
    heads = (
        "coefficient",
        "unit",
        "published",
        "formulas as printed",
        "errata applied",
        "published in",
        "formula",
    )
    note = "What does not agree, and why, stands in docs/strip_theory.md."
    figures = [
        {
            "quantity": f"{name}, {kind}",
            "value": items[name].value,
            "unit": items[name].unit,
            "note": items[name].source,
        }
        for name in printed
        for kind, items in (("as_printed", printed), ("corrected", corrected))
    ]
    return Part(
        (table("Strip theory beside the published coefficients", heads, rows, note=note),),
        tuple(figures),
    )


def _by_name(items: Sequence[Coefficient]) -> dict[str, Coefficient]:
    return {item.name: item for item in items if item.kind in ("added_mass", "drag")}


def _row(item: Finding) -> dict[str, Any]:
    finite = bool(np.isfinite(item.ours))
    return {
        "quantity": f"open loop {item.case}, {item.statement.quantity}, {item.parameter_set}",
        "value": item.ours if finite else None,
        "unit": item.statement.unit,
        "verdict": "holds" if item.holds else "does not hold",
        "note": (
            f"text: {item.statement.value:.4g} +- {item.statement.tolerance:.2g}"
            f" {item.statement.unit}: {item.statement.source}"
        ),
    }


def _unstated(run: OpenLoopRun) -> list[dict[str, Any]]:
    """Return the figures that a run has and of which the text states nothing."""
    stated = {item.quantity for item in run.case.statements}
    values = {name: run.quantity(name) for name in UNSTATED if name not in stated}
    return [
        {
            "quantity": f"open loop {run.case.name}, {name}, {run.parameter_set}",
            "value": value,
            "unit": QUANTITIES[name],
            "note": "the text states none",
        }
        for name, value in values.items()
        if np.isfinite(value)
    ]


def _statements(compared: Sequence[Finding]) -> Block:
    by_statement: dict[tuple[str, str], dict[str, Finding]] = {}
    for item in compared:
        by_statement.setdefault((item.case, item.statement.quantity), {})[item.parameter_set] = item
    rows = []
    for (case, quantity), sets in by_statement.items():
        statement = next(iter(sets.values())).statement
        ours = [_finite(sets[name].ours) if name in sets else None for name in PARAMETER_SETS]
        under = ", ".join(name for name, item in sets.items() if item.holds) or "none"
        rows.append(
            [
                case,
                quantity,
                statement.unit,
                statement.value,
                statement.tolerance,
                *ours,
                under,
                statement.source,
            ]
        )
    heads = (
        "case",
        "quantity",
        "unit",
        "text",
        "tolerance",
        *PARAMETER_SETS,
        "holds under",
        "source",
    )
    note = (
        "steady: mean over the last tenth of a run; peak: largest modulus in its second half."
        " Empty: not flown, or ended early."
    )
    return table("Open-loop manoeuvres beside the text (section 4.1)", heads, rows, note=note)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _ended(runs: Sequence[OpenLoopRun]) -> list[str]:
    return [
        f"{run.case.title}, parameter set {run.parameter_set}: the run ended early, {run.stop}."
        for run in runs
        if run.stop
    ]


def _plot(run: OpenLoopRun) -> Block:
    chi, t = run.chi, run.t_s
    lines: Mapping[str, tuple[str, list[tuple[str, Any]]]] = {
        "path": ("m", [("x", chi[:, 6]), ("y", chi[:, 7]), ("z", chi[:, 8])]),
        "attitude": ("deg", [("phi", np.degrees(chi[:, 9])), ("theta", np.degrees(chi[:, 10]))]),
        "velocity": ("m/s", [("u", chi[:, 0]), ("v", chi[:, 1]), ("w", chi[:, 2])]),
        "mass": ("kg", [("m", run.mass_kg)]),
    }
    if np.ptp(run.mass_kg) == 0.0:
        lines = {name: entry for name, entry in lines.items() if name != "mass"}
    panels = [
        panel(label, unit, [series(name, t, values, name) for name, values in signals])
        for label, (unit, signals) in lines.items()
    ]
    return plot(
        f"{run.case.title} ({run.parameter_set})", panels, group=f"open loop {run.case.name}"
    )
