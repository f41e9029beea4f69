"""The report section of models fitted to the sensors themselves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from auvid.data_schemas.records.likelihood import LagFit, LikelihoodFit
from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.constrained.actuator_lag import CLEAR
from auvid.stages.model_use import coverage_words
from auvid.stages.presentation import (
    NOISE_95,
    Block,
    equation,
    half_95,
    remark,
    section,
    table,
    text,
)

NORMAL = 1.3
"""Normalised errors beyond this, or below its inverse, are named."""


def refine_section(
    started: Mapping[str, ModelCard],
    refined: Mapping[str, ModelCard],
    warnings: Sequence[str],
    *,
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the section: coefficients of each model beside its start, noise, lag.

    notes: why models were left to least squares.
    """
    blocks = [
        equation(
            r"\ln L = -\tfrac{1}{2} \sum_i \left( e_i^2 / s_i + \ln 2 \pi s_i \right)",
            "Errors e of all sensors at their own times, s their predicted variances: the model,"
            " the noise, the biases and the lag that make what was measured most likely.",
        )
    ]
    for card in refined.values():
        assert card.likelihood is not None
        blocks += [
            _coefficients(started[card.likelihood.started_from], card),
            *_motion_blocks(card, card.likelihood),
            *stated_lag_blocks(started[card.likelihood.started_from].lag, card),
            _channels(card, card.likelihood),
            *_noise(card, card.likelihood),
        ]
    blocks += [remark(words, "warning") for words in dict.fromkeys(warnings)]
    blocks += [remark(words) for words in notes]
    return section(
        "Models fitted to the sensors themselves",
        blocks,
        order=55,
        look_for=(
            "Values that leave those of least squares by more than both errors: the velocities or"
            " the force of the smoother misled one of the two."
        ),
    )


def _coefficients(first: ModelCard, card: ModelCard) -> Block:
    rows = []
    for axis, part in card.axes.items():
        for item, old in zip(part.terms, first.axes[axis].terms, strict=True):
            verdict = item.verdict
            partners = f" from {', '.join(item.inseparable_from)}" if item.inseparable_from else ""
            rows.append(
                [
                    axis,
                    item.term,
                    item.value,
                    half_95(item.standard_error),
                    old.value,
                    half_95(old.standard_error),
                    item.unit,
                    f"{verdict}{partners}",
                ]
            )
    heads = [
        "axis",
        "term",
        "value",
        NOISE_95,
        f"{first.method}: value",
        f"{NOISE_95} there",
        "unit",
        "verdict",
    ]
    note = (
        "Intervals are the larger of those for white and for coloured errors. Constant"
        " forces that an unsteady force with a long memory can take over have wide ones."
    )
    if card.likelihood is not None and card.likelihood.windows_agree is False:
        note = "Intervals are by windows left out, and no smaller than those for white errors."
    return table(f"{card.title}: {card.n_bar} terms", heads, rows, note=note)


def stated_lag_blocks(stated: LagFit | None, card: ModelCard) -> list[Block]:
    """Return a warning where the fitted lag departs from the one of the file."""
    lag = card.lag
    if stated is None or stated.verdict != "stated" or lag is None or not lag.standard_error_s:
        return []
    sd = math.hypot(lag.standard_error_s, stated.standard_error_s or 0.0)
    if abs(lag.value_s - stated.value_s) <= CLEAR * sd:
        return []
    words = (
        f"{card.title}: the sensors show actuators that are {lag.value_s:.2g} +-"
        f" {NORMAL_95 * lag.standard_error_s:.1g} s (95 %) late, and this fit goes with that; the"
        f" vehicle file states {stated.value_s:.2g} s (actuators.lag)."
    )
    return [remark(words, "warning")]


def _motion_blocks(card: ModelCard, fit: LikelihoodFit) -> list[Block]:
    """Return how the fit went, the lag, the inertia, and what limits moved."""
    words = (
        f"{card.title} converged in {fit.steps} steps on {fit.samples} measured numbers; the"
        f" log-likelihood rose by {fit.log_likelihood_gain:.4g}. Errors are"
        f" {fit.weighted_residual:.3g} of what is predicted of them (1 where model and noise fit)."
    )
    if card.lag is not None:
        error = card.lag.standard_error_s
        spread = "" if error is None else f" +- {NORMAL_95 * error:.2g} (95 %)"
        words += f" Lag of the actuators: {card.lag.value_s:.3g}{spread} s, {card.lag.verdict}."
    for item in card.inertia:
        error = item.standard_error
        spread = "" if error is None else f" +- {NORMAL_95 * error:.2g} (95 %)"
        words += (
            f" Inertia of {item.name}: {item.value:.3g}{spread} {item.unit},"
            f" {item.verdict} (vehicle file {item.in_vehicle_file:.3g})"
        )
        words += (
            f"; its correlation with the lag is {item.correlation:.2f}."
            if card.lag is not None and card.lag.correlations
            else "."
        )
    if card.limits:
        names = "; ".join(dict.fromkeys(item.name for item in card.limits))
        words += (
            f" Limits that hold coefficients back: {names}. They lower the log-likelihood by"
            f" {fit.limits_cost:.2g}."
        )
    if fit.windows_agree is False:
        words += f" {disagreement(fit)}"
    if card.coverage_on_twins:
        words += f" {coverage_words(card.coverage_on_twins, card.method)}"
    blocks = [text(words)]
    if fit.left_out:
        blocks.append(remark(f"{card.title}, left out: {'; '.join(fit.left_out)}."))
    return blocks


def disagreement(fit: LikelihoodFit) -> str:
    """Return what it means that the windows do not agree."""
    return (
        f"Windows differ by {fit.windows_differ:.3g} times what noise explains (mean square): the"
        " form lacks something. Intervals come from leaving windows out, and how far a value is"
        " from that of least squares counts as what the form lacks. How many of them hold the"
        " truth where a form lacks something is not known."
    )


def _channels(card: ModelCard, fit: LikelihoodFit) -> Block:
    rows = [
        [item.channel, item.samples, item.noise_sd, item.unit, item.normalised_rms]
        for item in fit.channels
    ]
    away = [
        item.channel for item in fit.channels if not 1.0 / NORMAL < item.normalised_rms < NORMAL
    ]
    note = "Normalised: RMS error in parts of its predicted deviation, near 1 where all is said."
    if away:
        note += f" Away from 1: {', '.join(away)}."
    heads = ["sensor", "samples", "noise per sample", "unit", "normalised error"]
    return table(f"{card.title}: what the sensors say", heads, rows, note=note)


def _noise(card: ModelCard, fit: LikelihoodFit) -> list[Block]:
    """Return tables of biases and of the unsteady force of each leg."""
    sensors = [
        (name, unit, values, errors)
        for leg in fit.legs
        for name, unit, values, errors in (
            (f"{leg.leg}: accelerometer", "m/s^2", leg.accel_bias_m_s2, leg.accel_bias_sd_m_s2),
            (f"{leg.leg}: gyro", "rad/s", leg.gyro_bias_rad_s, leg.gyro_bias_sd_rad_s),
        )
    ]
    rows = [
        [name, *values, *errors, unit]
        for name, unit, values, errors in sensors
        if values is not None and errors is not None
    ]
    heads = ["leg and sensor", "x", "y", "z", "error of x", "of y", "of z", "unit"]
    blocks = [table(f"{card.title}: biases in body axes", heads, rows)]
    if fit.force_time_s is not None:
        forces = [
            [axis, time_s, *(leg.force_sd[axis] for leg in fit.legs if leg.force_sd is not None)]
            for axis, time_s in fit.force_time_s.items()
        ]
        columns: list[str | tuple[str, str]] = [
            "axis",
            ("time constant", "s"),
            *((leg.leg, "N, N m") for leg in fit.legs),
        ]
        note = "What the model does not explain acts as a force with this deviation and memory."
        blocks.append(table(f"{card.title}: unsteady force", columns, forces, note=note))
    return blocks
