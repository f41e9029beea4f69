"""What swings and decays show in the report and in the recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.bench.single_channel import DAMPING
from auvid.stages.base import Document
from auvid.stages.pipendulum.decays import GOOD_SWINGS, METHODS, Decayed, sensitivity
from auvid.stages.pipendulum.recordings import ASKEW_DEG
from auvid.stages.pipendulum.swings import Swung
from auvid.stages.presentation import (
    Block,
    equation,
    panel,
    plot,
    remark,
    section,
    series,
    table,
    text,
)

UNITS = ("kg", "kg/s", "kg/m")
CYLINDER_PERCENT = 3.0
"""A pendulum that misses a calculated cylinder by more than this is not trusted."""
FREE_DECAY = (
    "A free decay is not driven: its signals die out and C_n falls as 1/t, so that in the sense of"
    " (52) no free decay is persistently exciting. It tells three ratios and nothing more:"
    " restoring moment, linear and quadratic damping, each over the inertia. Inertia and restoring"
    " moment are fully correlated (correlation 1): the added mass rests on the weighed one."
)


def bench_section(
    apparatus: Document, swings: Sequence[Swung], decays: Sequence[Decayed]
) -> dict[str, Any]:
    """Verdicts and warnings first, then the swings, then the decays."""
    blocks: list[Block] = _remarks(swings, decays)
    blocks.append(
        text(
            f"{apparatus['title']}. Source: {apparatus['source']}. {apparatus.get('notes', '')}".strip()
        )
    )
    if swings:
        blocks += _swing_blocks(swings)
    if decays:
        blocks += _decay_blocks(decays)
    look = (
        "Measured and fitted swings lie on each other; the chosen damping model also on the swings"
        " that it was not fitted to."
    )
    return section("Pendulums", blocks, order=18, look_for=look)


def bench_views(swings: Sequence[Swung], decays: Sequence[Decayed]) -> dict[str, Any]:
    """Swings, decays with each damping model, and recursive estimates, one entity per
    recording.
    """
    groups = [
        {
            "entity": f"pendulum/{recording.leg}/swing/rate",
            "table": "swings",
            "columns": ["rate_measured_rad_s", "rate_fitted_rad_s"],
            "names": ["measured", "fitted"],
            "roles": ["measured", "predicted"],
            "tab": "Answer",
            "unit": "rad/s",
            "filter": {"recording": recording.leg},
        }
        for item in swings
        for recording, _ in item.recordings
    ]
    for decayed in decays:
        for item in decayed.fallen:
            leg = item.recording.leg
            groups.append(
                {
                    "entity": f"pendulum/{leg}/decay/angle",
                    "table": "decays",
                    "columns": [
                        "theta_measured_rad",
                        *(f"theta_{name.replace(' ', '_')}_rad" for name in DAMPING),
                    ],
                    "names": ["measured", *(f"{name} damping" for name in DAMPING)],
                    "roles": ["measured", *DAMPING],
                    "tab": "Answer",
                    "unit": "rad",
                    "filter": {"recording": leg},
                }
            )
            groups += [
                {
                    "entity": f"pendulum/{leg}/{column}/history",
                    "table": "decay_history",
                    "columns": [column],
                    "names": [f"{label}, recursive"],
                    "roles": ["fused"],
                    "tab": "Histories",
                    "unit": unit,
                    "filter": {"recording": leg},
                }
                for column, label, unit in (
                    ("stiffness", "restoring moment over inertia", "1/s^2"),
                    ("linear", "linear damping over inertia", "1/s"),
                    ("quadratic", "quadratic damping over inertia", "1"),
                    ("smallest_eigenvalue", "smallest eigenvalue of C_n", "1"),
                )
            ]
    return {"groups": groups}


def _remarks(swings: Sequence[Swung], decays: Sequence[Decayed]) -> list[Block]:
    blocks: list[Block] = []
    for item in swings:
        if item.cylinder is not None:
            share = 100.0 * (item.inertia.value / item.cylinder - 1.0)
            words = (
                f"Check of the pendulum: {item.entry['id']} comes out {share:+.2f} % against the"
                " hollow cylinder of (58)."
            )
            blocks.append(remark(words, "finding" if abs(share) <= CYLINDER_PERCENT else "warning"))
    for decayed in decays:
        if decayed.entry["role"] == "vehicle":
            held = decayed.held_out[decayed.chosen]
            words = (
                f"{decayed.entry['id']}: {decayed.chosen} damping predicts {decayed.judged_on} best"
                f" ({1e3 * held:.2g} mrad RMS)."
            )
            blocks.append(remark(words, "finding"))
    recordings = [recording for item in swings for recording, _ in item.recordings]
    recordings += [item.recording for decayed in decays for item in decayed.fallen]
    blocks += [
        remark(f"{item.leg}: {words}", "warning") for item in recordings for words in item.warnings
    ]
    askew = {item.leg: float(np.degrees(item.axis.misalignment_rad)) for item in recordings}
    turned = [f"{leg} {angle:.1f} degrees" for leg, angle in askew.items() if angle > ASKEW_DEG]
    if turned:
        blocks.append(
            remark(
                "The recorder sits askew against the swing, which is allowed for:"
                f" {', '.join(turned)}.",
                "warning",
            )
        )
    for fallen in (one for item in decays for one in item.fallen if one.swings < GOOD_SWINGS):
        words = (
            f"{fallen.recording.leg}: only {fallen.swings:.1f} swings before it has died down: add"
            " weight or take a longer arm."
        )
        blocks.append(remark(words, "warning"))
    for decayed in decays:
        values, errors = (
            getattr(decayed.derivatives[decayed.chosen, "output error"], key)
            for key in ("values", "standard_errors")
        )
        wrong = [
            name
            for name, value, error in zip(decayed.quantities, values, errors, strict=True)
            if value > 2.0 * error > 0.0
        ]
        if wrong:
            words = (
                f"{decayed.entry['id']}: positive {', '.join(wrong)}, which no body in water has:"
                " check masses, arms and legs."
            )
            blocks.append(remark(words, "warning"))
    if decays and not any(item.entry["role"] == "empty_pendulum" for item in decays):
        blocks.append(
            remark(
                "No decay of the empty pendulum: added mass and damping of the pole are counted to"
                " the vehicle.",
                "warning",
            )
        )
    return blocks


def _swing_blocks(swings: Sequence[Swung]) -> list[Block]:
    rows = []
    for item in swings:
        low, high = item.inertia.interval
        fits = [fit for _, fit in item.recordings]
        rows.append(
            [
                item.entry["id"],
                item.mass or None,
                item.period.value,
                item.period.standard_error,
                item.amplitude_deg,
                min((fit.swings for fit in fits), default=None),
                100.0 * max(fit.residual for fit in fits) if fits else None,
                item.inertia.value,
                low,
                high,
                item.cylinder,
            ]
        )
    heads: list[str | tuple[str, str]] = [
        "swing",
        ("mass", "kg"),
        ("period", "s"),
        ("standard error", "s"),
        ("amplitude", "deg"),
        "swings",
        ("residual", "%"),
        ("inertia", "kg m^2"),
        ("low", "kg m^2"),
        ("high", "kg m^2"),
        ("calculated", "kg m^2"),
    ]
    note = (
        "Inertia of the object with that of the tray taken off (57), of the tray itself in the"
        " first row; 95 % intervals from all periods, "
    )
    note += "lengths and masses. Periods are those of small swings."
    blocks: list[Block] = [
        equation(
            "I_{eq}=\\frac{m_{eq}gR_1R_2}{4\\pi^2h}T^2,\\quad I_O=I_{eq}-I_P",
            "quadrifilar pendulum, Alberti (56)-(57)",
        ),
        table("Moments of inertia", heads, rows, note=note),
        *[
            remark(f"{recording.leg}: {said}")
            for item in swings
            for recording, _ in item.recordings
            for said in recording.said
        ],
    ]
    panels = [
        panel(
            recording.leg,
            "rad/s",
            [
                series("measured", recording.t_s, recording.rate, "raw"),
                series("fitted", fit.t_s, fit.fitted, "predicted"),
            ],
        )
        for item in swings
        for recording, fit in item.recordings
    ]
    if panels:
        blocks.append(
            plot(
                "Swings of the tray",
                panels,
                look_for="Measured and fitted on each other to the end; a slow parting is drift.",
            )
        )
    return blocks


def _decay_blocks(decays: Sequence[Decayed]) -> list[Block]:
    words = [
        f"{item.entry['id']}: restoring moment {item.hung.stiffness:.4g} N m as weighed; 1 % more"
        f" of it moves the added mass by {sensitivity(item):.3g} kg. Smallest eigenvalue of C_n"
        f" over the recording {item.fallen[0].estimate.excitation.smallest[-1]:.2g}."
        for item in decays
    ]
    blocks: list[Block] = [
        equation(
            "I\\ddot\\theta=-G\\sin\\theta+D_1\\dot\\theta+D_2\\dot\\theta|\\dot\\theta|",
            "free decay, Alberti (70) corrected, every part at its own arm; damping models are the"
            " vehicle's, the pole keeps its own",
        ),
        remark(FREE_DECAY),
        *[remark(item) for item in words],
        *[
            remark(f"{item.recording.leg}: {said}")
            for decayed in decays
            for item in decayed.fallen
            for said in item.recording.said
        ],
        *[
            block
            for item in decays
            for block in (_methods_table(item), _damping_table(item), _decay_plot(item))
        ],
    ]
    return blocks


def _methods_table(item: Decayed) -> Block:
    rows: list[list[Any]] = []
    has = (True, *DAMPING[item.chosen])
    for index, name in enumerate(item.quantities):
        if has[index]:
            row: list[Any] = [name, UNITS[index]]
            for method in METHODS[::-1]:
                result = item.derivatives[item.chosen, method]
                row += [result.values[index], NORMAL_95 * result.standard_errors[index]]
            rows.append([*row, item.point_mass.values[index]])
    heads = [
        "figure",
        "unit",
        *(word for method in METHODS[::-1] for word in (method, "± 95 %")),
        "output error, point mass",
    ]
    taken = "" if item.entry["role"] == "empty_pendulum" else "The empty pendulum is taken off. "
    note = (
        f"{taken}Output error gives the figures to take; intervals of the regressions hold their"
        " noise, not the bias that noise in the regressors brings. Point mass: everything at the"
        " arm, as (66) has it, which is wrong for a pole whose mass is spread along it."
    )
    return table(
        f"{item.entry['id']}: methods side by side, {item.chosen} damping", heads, rows, note=note
    )


def _damping_table(item: Decayed) -> Block:
    rows = []
    for name, (linear, quadratic) in DAMPING.items():
        values = item.derivatives[name, "output error"].values
        rmse = [
            float(np.sqrt(np.mean([kind[name].rmse_rad ** 2 for kind in kinds])))
            for kinds in zip(
                *[
                    (one.estimate.output_error, one.estimate.recursive, one.estimate.batch)
                    for one in item.fallen
                ],
                strict=True,
            )
        ]
        chosen = "chosen" if name == item.chosen else ""
        rows.append(
            [
                name,
                values[0],
                values[1] if linear else None,
                values[2] if quadratic else None,
                *rmse,
                item.held_out[name],
                chosen,
            ]
        )
    heads: list[str | tuple[str, str]] = ["damping", *zip(item.quantities, UNITS, strict=True)]
    heads += [
        ("RMSE", "rad"),
        ("RMSE recursive", "rad"),
        ("RMSE batch", "rad"),
        (f"RMSE on {item.judged_on}", "rad"),
        "",
    ]
    return table(
        f"{item.entry['id']}: damping models (as Tables 12, 14, 15)",
        heads,
        rows,
        note="RMSE of the simulated angle.",
    )


def _decay_plot(item: Decayed) -> Block:
    panels = []
    for one in item.fallen:
        t, estimate = one.decay.run.grid_s, one.estimate
        lines = [series("measured", t, estimate.measured, "raw")]
        lines += [series(f"{name} damping", t, estimate.simulated[name], name) for name in DAMPING]
        panels.append(panel(f"{one.recording.leg}: angle", "rad", lines))
        history = estimate.history[item.chosen]
        rows = slice(history.t_s.size // 10, None)
        panels.append(
            panel(
                "restoring / inertia",
                "1/s^2",
                [series("recursive", history.t_s[rows], history.theta[rows, 0], "fused")],
            )
        )
        panels.append(
            panel(
                "C_n",
                "1",
                [
                    series(
                        "smallest eigenvalue",
                        estimate.excitation.t_s,
                        estimate.excitation.smallest,
                        "measured",
                    )
                ],
            )
        )
    look = (
        "Which damping keeps to the measured swings as they grow small; the recursive ratio stands"
        " still before the end."
    )
    return plot(f"{item.entry['id']}: decay, measured and simulated", panels, look_for=look)
