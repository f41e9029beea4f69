"""The report section and recording views of swings and decays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from auvid.data_schemas.documents.apparatus import ApparatusDocument
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.bench.channel_records import DAMPING
from auvid.stages.number_format import in_words
from auvid.stages.pipendulum.decays import GOOD_SWINGS, METHODS, DecayResult, sensitivity
from auvid.stages.pipendulum.recordings import ASKEW_DEG
from auvid.stages.pipendulum.swings import SwingResult
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
    view,
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
    apparatus: ApparatusDocument, swings: Sequence[SwingResult], decays: Sequence[DecayResult]
) -> dict[str, Any]:
    """Return the section: verdicts and warnings, then swings, then decays."""
    blocks: list[Block] = _remarks(swings, decays)
    blocks.append(
        text(f"{apparatus.title}. Source: {apparatus.source}. {apparatus.notes or ''}".rstrip())
    )
    if swings:
        blocks += _swing_blocks(swings)
    if decays:
        blocks += _decay_blocks(decays)
    look = (
        "Whether fitted swings lie on the measured ones, those of the chosen damping model also"
        " where it was not fitted."
    )
    return section("Pendulums", blocks, order=18, look_for=look)


def bench_views(swings: Sequence[SwingResult], decays: Sequence[DecayResult]) -> dict[str, Any]:
    """Return swings, decays by damping model, and recursive estimates as views."""
    groups = [
        view(
            f"pendulum/{recording.leg}/swing/rate",
            "swings",
            ["rate_measured_rad_s", "rate_fitted_rad_s"],
            ["measured", "predicted"],
            tab="Answer",
            names=["measured", "fitted"],
            filter={"recording": recording.leg},
        )
        for item in swings
        for recording, _ in item.recordings
    ]
    damping = [f"theta_{name.replace(' ', '_')}_rad" for name in DAMPING]
    for leg in (item.recording.leg for decay in decays for item in decay.recordings):
        groups.append(
            view(
                f"pendulum/{leg}/decay/angle",
                "decays",
                ["theta_measured_rad", *damping],
                ["measured", *DAMPING],
                tab="Answer",
                names=["measured", *(f"{name} damping" for name in DAMPING)],
                filter={"recording": leg},
            )
        )
        groups += [
            view(
                f"pendulum/{leg}/{column}/history",
                "decay_history",
                [column],
                ["fused"],
                tab="Histories",
                names=[f"{label}, recursive"],
                filter={"recording": leg},
            )
            for column, label in (
                ("stiffness", "restoring moment over inertia"),
                ("linear", "linear damping over inertia"),
                ("quadratic", "quadratic damping over inertia"),
                ("smallest_eigenvalue", "smallest eigenvalue of C_n"),
            )
        ]
    return {"groups": groups}


def _remarks(swings: Sequence[SwingResult], decays: Sequence[DecayResult]) -> list[Block]:
    blocks: list[Block] = []
    for item in swings:
        if item.cylinder is not None:
            share = 100.0 * (item.inertia.value / item.cylinder - 1.0)
            words = (
                f"Check of the pendulum: {item.entry.id} comes out {share:+.2f} % against the"
                " hollow cylinder of (58)."
            )
            blocks.append(remark(words, "finding" if abs(share) <= CYLINDER_PERCENT else "warning"))
    for decay in decays:
        if decay.entry.role == "vehicle":
            held_out_error = decay.held_out[decay.chosen]
            words = (
                f"{in_words(decay.entry.id)}: {decay.chosen} damping predicts {decay.judged_on}"
                f" best ({1e3 * held_out_error:.2g} mrad RMS)."
            )
            blocks.append(remark(words, "finding"))
    recordings = [recording for item in swings for recording, _ in item.recordings]
    recordings += [item.recording for decay in decays for item in decay.recordings]
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
    for short in (one for item in decays for one in item.recordings if one.swings < GOOD_SWINGS):
        words = (
            f"{short.recording.leg}: only {short.swings:.1f} swings before it has died down: add"
            " weight or take a longer arm."
        )
        blocks.append(remark(words, "warning"))
    for decay in decays:
        values, errors = (
            getattr(decay.derivatives[decay.chosen, "output error"], key)
            for key in ("values", "standard_errors")
        )
        wrong = [
            name
            for name, value, error in zip(decay.quantities, values, errors, strict=True)
            if value > 2.0 * error > 0.0
        ]
        if wrong:
            words = (
                f"{decay.entry.id}: positive {', '.join(wrong)}, which no body in water has:"
                " check masses, arms and legs."
            )
            blocks.append(remark(words, "warning"))
    if decays and not any(item.entry.role == "empty_pendulum" for item in decays):
        blocks.append(
            remark(
                "No decay of the empty pendulum: added mass and damping of the pole are counted to"
                " the vehicle.",
                "warning",
            )
        )
    return blocks


def _swing_blocks(swings: Sequence[SwingResult]) -> list[Block]:
    rows = []
    for item in swings:
        low, high = item.inertia.interval
        fits = [fit for _, fit in item.recordings]
        rows.append(
            [
                item.entry.id,
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
            remark(f"{recording.leg}: {note}")
            for item in swings
            for recording, _ in item.recordings
            for note in recording.notes
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


def _decay_blocks(decays: Sequence[DecayResult]) -> list[Block]:
    words = [
        f"{item.entry.id}: restoring moment {item.hung.stiffness:.4g} N m as weighed; 1 % more"
        f" of it moves the added mass by {sensitivity(item):.3g} kg. Smallest eigenvalue of C_n"
        f" over the recording {item.recordings[0].estimate.excitation.smallest[-1]:.2g}."
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
            remark(f"{item.recording.leg}: {note}")
            for decay in decays
            for item in decay.recordings
            for note in item.recording.notes
        ],
        *[
            block
            for item in decays
            for block in (_methods_table(item), _damping_table(item), _decay_plot(item))
        ],
    ]
    return blocks


def _methods_table(item: DecayResult) -> Block:
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
    taken = "" if item.entry.role == "empty_pendulum" else "The empty pendulum is taken off. "
    note = (
        f"{taken}Output error gives the figures to take; intervals of the regressions hold their"
        " noise, not the bias that noise in the regressors brings. Point mass: everything at the"
        " arm, as (66) has it, which is wrong for a pole whose mass is spread along it."
    )
    return table(
        f"{item.entry.id}: methods side by side, {item.chosen} damping", heads, rows, note=note
    )


def _damping_table(item: DecayResult) -> Block:
    rows = []
    for name, (linear, quadratic) in DAMPING.items():
        values = item.derivatives[name, "output error"].values
        rmse = [
            float(np.sqrt(np.mean([kind[name].rmse_rad ** 2 for kind in kinds])))
            for kinds in zip(
                *[
                    (one.estimate.output_error, one.estimate.recursive, one.estimate.batch)
                    for one in item.recordings
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
        "choice",
    ]
    return table(
        f"{item.entry.id}: damping models (as Tables 12, 14, 15)",
        heads,
        rows,
        note="RMSE of the simulated angle.",
    )


def _decay_plot(item: DecayResult) -> Block:
    panels = []
    for one in item.recordings:
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
    return plot(f"{item.entry.id}: decay, measured and simulated", panels, look_for=look)
