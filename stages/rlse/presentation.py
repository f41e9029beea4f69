"""The report section and recording views of a single-channel run."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.bench.channel_records import (
    CHANNELS,
    DAMPING,
    ChannelEstimate,
    symbols,
)
from auvid.hydro.identification.bench.persistence_of_excitation import PERSISTENT, WINDOWS
from auvid.stages.columns import span_text
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
from auvid.stages.rlse.figures import CLEAR, TOO_FAST
from auvid.stages.rlse.run_of_leg import LegRun

CHAPTER = "Single channels"
SETTLED_AFTER = 0.1
"""Share of a run that the history plots leave out: the first estimates are those of the
prior.
"""


def unexcited_section(leg: str, leg_run: LegRun, reason: str) -> dict[str, Any]:
    """Return the section of a leg whose channel was never excited."""
    words = (
        f"{leg}: {leg_run.channel} was never excited ({reason}), so that nothing is identified"
        " from it."
    )
    return section(
        _title(leg, leg_run),
        [remark(words, "warning"), *map(remark, leg_run.notes)],
        order=20,
        chapter=CHAPTER,
    )


def channel_section(
    leg: str,
    leg_run: LegRun,
    estimate: ChannelEstimate,
    results: dict[str, Any],
    *,
    filter_rate: float,
    dry: float,
) -> dict[str, Any]:
    """Return the section: verdict, figures by both methods, damping models, plots."""
    excited = estimate.excitation[estimate.chosen]
    words = f"{leg}: {excited.words(_columns(leg_run, estimate.chosen))}"
    blocks: list[Block] = [remark(words, "finding" if excited.status == PERSISTENT else "warning")]
    if not estimate.fits[estimate.chosen].resolved:
        blocks.append(
            remark(
                f"{leg}: {TOO_FAST}. Masses, and ratios to them, are not determined; sample faster,"
                " and step the command.",
                "warning",
            )
        )
    blocks += [
        remark(f"{leg}: {item}", "warning")
        for item in (*leg_run.warnings, *_unphysical(leg_run, estimate, dry))
    ]
    t = leg_run.data.run.grid_s
    blocks += [
        text(
            f"{leg_run.channel.capitalize()} from {leg_run.measured}, {span_text((t[0], t[-1]))}."
            " Two estimates: recursive least squares of the filtered static form (Alberti,"
            " equations 43 to 50) shows how the figures converge; output error, started from it,"
            " fits the simulated run to the measured one and gives the figures to take, because"
            " noise in the measured velocity biases a regression but not a simulation. Damping is"
            " chosen by the last third of the run, predicted with figures from the first two."
        ),
        *[remark(item) for item in (*leg_run.notes, *_lag_and_bias(leg_run, estimate))],
        equation(*_equation(leg_run)),
        _methods_table(leg_run, estimate, results),
        _damping_table(leg_run, estimate),
        _run_plot(leg_run, estimate),
        _history_plot(leg_run, estimate, filter_rate),
        _excitation_plot(leg_run, estimate),
    ]
    look = (
        "Whether the chosen model follows the last third of the run too, the estimates stand still"
        " long before the end, and the information (C_n) does not fall."
    )
    return section(_title(leg, leg_run), blocks, order=20, look_for=look, chapter=CHAPTER)


def channel_views(leg: str, leg_run: LegRun, estimate: ChannelEstimate) -> dict[str, Any]:
    """Return the run with every damping model, and the chosen one's history."""
    names = list(DAMPING)
    lead = "depth, " if _signal_unit(leg_run) == "m" else ""
    run = view(
        f"rlse/{leg}/run",
        "channel_run",
        ["measured", *(name.replace(" ", "_") for name in names)],
        ["measured", *names],
        tab="Answer",
        names=[f"{lead}measured", *(f"{lead}{name} damping" for name in names)],
        unit=_signal_unit(leg_run),
    )
    chosen = {"damping": estimate.chosen}
    histories = [
        view(
            f"rlse/{leg}/{quantity}/history",
            "channel_history",
            [quantity],
            ["fused"],
            tab="Histories",
            names=[f"{label}, recursive"],
            unit=unit,
            filter=chosen,
            spread=[f"{quantity}_sd"],
        )
        for quantity, label, unit in _quantities(leg_run, estimate.chosen)
    ]
    excited = view(
        f"rlse/{leg}/excitation/history",
        "channel_history",
        ["smallest_eigenvalue"],
        ["measured"],
        tab="Histories",
        names=["smallest eigenvalue of C_n"],
        filter=chosen,
    )
    return {"groups": [run, *histories, excited]}


def _title(leg: str, leg_run: LegRun) -> str:
    return f"{leg_run.channel.capitalize()} of leg {leg}"


def _columns(leg_run: LegRun, name: str) -> tuple[str, ...]:
    index = CHANNELS.index(leg_run.channel)
    x = "uvwpqr"[index]
    linear, quadratic = DAMPING[name]
    drive = "the command" if leg_run.normalised else f"{'XYZKMN'[index]}_prop"
    return tuple(
        word
        for word, has in (
            (x, linear),
            (f"{x}|{x}|", quadratic),
            (drive, True),
            ("the constant force", leg_run.data.constant),
        )
        if has
    )


def _lag_and_bias(leg_run: LegRun, estimate: ChannelEstimate) -> list[str]:
    """Return notes on the lag of the thrust and the bias of the sensor."""
    fit, words = estimate.fits[estimate.chosen].fit, []
    if estimate.lag is not None:
        words.append(
            f"The force follows its command with a time constant of {estimate.lag.value_s:.2g} s"
            f" (standard error {estimate.lag.standard_error_s:.1g} s), found with the figures:"
            " thrusters coming to speed, or a velocity logged late."
        )
    if fit.bias[0] != 0.0:
        what = (
            "the sensor's zero"
            if CHANNELS.index(leg_run.channel) > 2
            else "a current, or the sensor's zero"
        )
        words.append(
            f"Constant of the {leg_run.measured}, found with the figures: {fit.bias[0]:+.2g}"
            f" {_signal_unit(leg_run)} ({what})."
        )
    return words


def _unphysical(leg_run: LegRun, estimate: ChannelEstimate, dry: float) -> list[str]:
    """Return warnings of signs that no body in water has, where clear of zero."""
    fit, names = estimate.fits[estimate.chosen], symbols(leg_run.channel)
    damping = ((names.linear, 1), (names.quadratic, 2))
    wrong = [
        name
        for name, index in damping
        if fit.values[index] > CLEAR * fit.standard_errors[index] > 0.0
    ]
    words = (
        [
            f"{', '.join(wrong)} come out positive: damping that feeds energy in. Look for another"
            " channel that moved."
        ]
        if wrong
        else []
    )
    added = dry - float(fit.values[0])
    if fit.resolved and not leg_run.normalised and added > CLEAR * fit.standard_errors[0]:
        unit = names.units[0]
        words.append(
            f"{names.added} comes out positive, {added:.3g} {unit}: {names.mass} of the vehicle,"
            f" {dry:.4g} {unit}, is more than {names.mass} - {names.added}. Is it the vehicle as it"
            " was driven, and the thrust its own?"
        )
    return words


def _equation(leg_run: LegRun) -> tuple[str, str]:
    index = CHANNELS.index(leg_run.channel)
    x, axis, names = "uvwpqr"[index], "XYZKMN"[index], symbols(leg_run.channel)
    mass = f"{names.mass}-{axis}_{{\\dot {x}}}"
    latex = f"({mass})\\dot {x}={axis}_{x}{x}+{axis}_{{{x}|{x}|}}{x}|{x}|+{axis}_{{prop}}"
    if leg_run.data.restoring:
        latex += f"-R\\sin\\{'phi' if index == 3 else 'theta'}"
    if leg_run.data.constant:
        latex += "+C"
    return (
        latex,
        (
            "one channel by itself, Alberti (61)-(64) corrected; what the other channels couple in"
            " is neglected"
        ),
    )


def _quantities(leg_run: LegRun, name: str) -> list[tuple[str, str, str]]:
    names, (linear, quadratic) = symbols(leg_run.channel), DAMPING[name]
    units = _units(leg_run)
    rows = (
        ("mass", f"{names.mass} - {names.added}", True),
        ("linear", names.linear, linear),
        ("quadratic", names.quadratic, quadratic),
    )
    return [(key, label, unit) for (key, label, has), unit in zip(rows, units, strict=True) if has]


def _units(leg_run: LegRun) -> tuple[str, str, str]:
    """Return units of mass, linear and quadratic damping.

    Per full command if normalised.
    """
    if not leg_run.normalised:
        return symbols(leg_run.channel).units[:3]
    length = "m" if CHANNELS.index(leg_run.channel) < 3 else "rad"
    return f"command s^2/{length}", f"command s/{length}", f"command s^2/{length}^2"


def _methods_table(leg_run: LegRun, estimate: ChannelEstimate, results: dict[str, Any]) -> Block:
    figures = {item["quantity"]: item for item in results["rows"]}
    rows = []
    for item in results["rows"]:
        if item["headline"]:
            recursive = figures.get(f"{item['quantity']} ({estimate.chosen}, recursive)", {})
            rows.append(
                [
                    item["quantity"],
                    item["unit"],
                    recursive.get("value"),
                    recursive.get("standard_error"),
                    item["value"],
                    item["standard_error"],
                    item["low"],
                    item["high"],
                    item["verdict"],
                ]
            )
    heads = (
        "figure",
        "unit",
        "recursive",
        "standard error",
        "output error",
        "standard error",
        "low",
        "high",
        "verdict",
    )
    note = (
        "Intervals are 95 %, coloured residuals allowed for; mass and inertia of the vehicle file"
        " count as exact."
    )
    return table(f"Methods side by side, {estimate.chosen} damping", heads, rows, note=note)


def _damping_table(leg_run: LegRun, estimate: ChannelEstimate) -> Block:
    names, unit = symbols(leg_run.channel), _signal_unit(leg_run)
    rows = []
    for name, fit in estimate.fits.items():
        m, one, two, _ = fit.values
        linear, quadratic = DAMPING[name]
        chosen = "chosen" if name == estimate.chosen else ""
        rows.append(
            [
                name,
                m if fit.resolved else None,
                one if linear else None,
                two if quadratic else None,
                fit.rmse,
                fit.held_out,
                chosen,
            ]
        )
    heads: list[str | tuple[str, str]] = [
        "damping",
        *zip(
            (f"{names.mass} - {names.added}", names.linear, names.quadratic),
            _units(leg_run),
            strict=True,
        ),
        ("RMSE", unit),
        ("RMSE, last third", unit),
        "choice",
    ]
    note = (
        "Chosen by the last third; of nearly equal ones (5 %) the simpler, unless the term that it"
        " leaves out is clear of zero."
    )
    return table("Damping models (as in Table 9 of Alberti)", heads, rows, note=note)


def _run_plot(leg_run: LegRun, estimate: ChannelEstimate) -> Block:
    run, at = estimate.data.run, estimate.data.samples
    t = run.grid_s[at]
    lines = [series("measured", t, leg_run.signal, "measured")]
    lines += [
        series(f"{name} damping", t, fit.simulated[at], name) for name, fit in estimate.fits.items()
    ]
    drive = np.append(run.force_left, run.force_right[-1])[at]
    unit = "1" if leg_run.normalised else symbols(leg_run.channel).units[3]
    panels = [
        panel(leg_run.measured, _signal_unit(leg_run), lines),
        panel("driven by", unit, [series("force", t, drive, "thrusters")]),
    ]
    look = "Which damping follows fast and slow parts alike."
    return plot("Measured and simulated", panels, group=f"rlse {leg_run.channel}", look_for=look)


def _history_plot(leg_run: LegRun, estimate: ChannelEstimate, rate: float) -> Block:
    recursive, fit = estimate.recursive[estimate.chosen], estimate.fits[estimate.chosen]
    t = recursive.estimate.t_s
    rows = slice(int(SETTLED_AFTER * t.size), None)
    panels = []
    for index, (_, label, unit) in enumerate(_quantities(leg_run, "linear and quadratic")):
        if fit.standard_errors[index] == 0.0:  # not in this damping model, or not determined
            continue
        value, spread = recursive.values[rows, index], NORMAL_95 * recursive.spread[rows, index]
        lines = [
            series("recursive", t[rows], value, "fused"),
            series("95 % low", t[rows], value - spread, "band"),
            series("95 % high", t[rows], value + spread, "band"),
            series("output error", t[[rows.start, -1]], np.full(2, fit.values[index]), "predicted"),
        ]
        panels.append(panel(label, unit, lines))
    note = (
        f"Filter rate {rate:g} rad/s; the first tenth, which the prior rules, is not shown. The"
        " lines stand still before the end."
    )
    return plot(
        f"Recursive estimates over time, {estimate.chosen} damping",
        panels,
        group=f"rlse {leg_run.channel}",
        look_for=note,
    )


def _excitation_plot(leg_run: LegRun, estimate: ChannelEstimate) -> Block:
    lines = [
        series(f"{name} damping", item.t_s, item.smallest, name)
        for name, item in estimate.excitation.items()
    ]
    spread = ", ".join(f"{item.spread:.1f} ({name})" for name, item in estimate.excitation.items())
    look = (
        "A line that falls towards zero has lost its excitation. Information spread over windows"
        f" of {WINDOWS}: {spread}."
    )
    panels = [panel("eigenvalue", "1", lines)]
    return plot(
        "Smallest eigenvalue of C_n (52), columns of unit RMS",
        panels,
        group=f"rlse {leg_run.channel}",
        look_for=look,
    )


def _signal_unit(leg_run: LegRun) -> str:
    rotation = CHANNELS.index(leg_run.channel) > 2
    if leg_run.data.run.rate.size:
        return "rad/s" if rotation else "m/s"
    return "rad" if rotation else "m"
