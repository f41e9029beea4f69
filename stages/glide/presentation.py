"""Section and recording views of a glide campaign."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.glide.comparison import GlideComparison, trim_step
from auvid.hydro.identification.glide.drive_gap import DriveGap
from auvid.hydro.identification.glide.problem import UNKNOWNS
from auvid.stages.glide.figures import MEANINGS, NEEDS_SPEED, UNITS, mean_pitch
from auvid.stages.glide.glider import Glider
from auvid.stages.glide.legs import GlideLegs
from auvid.stages.number_format import estimate, fit_in_percent, significant
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

PRINTED = {"C_L_alpha": "the lift slope C_L_alpha", "C_D1": "the induced drag C_D1"}


def glide_section(
    comparison: GlideComparison,
    glides: GlideLegs,
    glider: Glider,
    results: dict[str, Any],
    gap: DriveGap | None,
) -> dict[str, Any]:
    """Return the section: what the glides tell and what not, figures, glides, plots."""
    estimate = comparison.estimate
    blocks = _findings(comparison, glides)
    if gap is not None:
        blocks.append(_drive_remark(gap, glides.stroke_m3))
    if glides.pitch_zero:
        blocks.append(remark(glides.pitch_zero, "warning"))
    blocks += [remark(words, "warning") for words in (*glides.warnings, *glides.notes)]
    body = glider.body
    blocks += [
        text(
            f"{estimate.glides} settled glides ({_counts(glides)}), {estimate.rows} means over"
            f" {significant(_stretch_s(glides), 2)} s. Coefficients are referred to S ="
            f" {significant(body.area_m2, 3)} m². Depth rate is the slope of a smoothing spline of"
            " the pressure over rho g. Intervals are clustered by yo: what disturbs a dive"
            " and the climb after it disturbs all of both. What is 'from the prior' is the"
            " vehicle file's; its spread is in the intervals of the others."
        ),
        equation(
            r"F=g\{\rho[(m/\rho_0+\delta V)(1-\epsilon p+\alpha_T\Delta T)+V_d]-m\},\quad"
            r" F\sin\gamma=\tfrac12\rho S U^2 C_D,\quad F\cos\gamma=-\tfrac12\rho S U^2 C_L",
            "steady balance along and across the path, gamma = pitch - alpha (Merckelbach et"
            " al. 2010)",
        ),
        _figures_table(comparison),
        _left_out_table(glides),
        _glides_table(comparison, glides),
        _rate_plot(comparison, glides),
    ]
    if np.isfinite(glides.rows.speed_m_s).any():
        blocks.append(_speed_plot(comparison, glides))
    look = (
        "Whether fitted depth rates follow dives and climbs alike: a step between the two comes"
        " from trim or the pitch sensor, a slope along each glide from layers of the water or the"
        " hull's compressibility."
    )
    return section("Settled glides", blocks, order=20, look_for=look, is_open=True)


def glide_views(glides: GlideLegs) -> dict[str, Any]:
    """Return depth rate and speed of settled glides, measured and fitted."""
    groups = []
    speed = np.isfinite(glides.rows.speed_m_s).any()
    for leg in dict.fromkeys(glides.leg_of_glide[number] for number in glides.rows.glide):
        for entity, columns, names, unit in (
            ("depth_rate", "depth_rate_{}_m_s", "depth rate {}", "m/s"),
            *([("speed", "speed_{}_m_s", "speed {}", "m/s")] if speed else []),
        ):
            groups.append(
                view(
                    f"glide/{leg}/{entity}/lines",
                    "glides",
                    [columns.format(item) for item in ("measured", "fitted")],
                    ["measured", "predicted"],
                    tab="Answer",
                    names=[names.format(item) for item in ("measured", "fitted")],
                    unit=unit,
                    filter={"recording": leg},
                )
            )
    return {"groups": groups}


def _counts(glides: GlideLegs) -> str:
    dives = glides.directions.count("dive")
    climbs = len(glides.directions) - dives
    return f"{dives} dive{'s' * (dives != 1)}, {climbs} climb{'s' * (climbs != 1)}"


def _stretch_s(glides: GlideLegs) -> float:
    steps = np.diff(glides.rows.t_s)[np.diff(glides.rows.glide) == 0]
    return float(np.median(steps)) if steps.size else 0.0


def _findings(comparison: GlideComparison, glides: GlideLegs) -> list[Block]:
    """Return what the glides tell, and by name what they do not."""
    estimate = comparison.estimate
    at = estimate.at_pitch(mean_pitch(glides))
    words = [
        remark(
            f"At {abs(np.degrees(mean_pitch(glides))):.1f} deg of pitch: C_D"
            f" {_with_interval(*at['C_D'])}, angle of attack"
            f" {_with_interval(*(np.degrees(item) for item in at['alpha']))} deg;"
            " depth rates of held-out glides are predicted to"
            f" {fit_in_percent(comparison.fit_percent)}.",
            "finding",
        )
    ]
    step = trim_step(glides.rows, estimate, glides.stroke_m3)
    if step is not None:
        begin_s = float(glides.rows.t_s[glides.rows.glide == step.glide][0])
        grams = 1e3 * estimate.body.neutral_kg_m3 * np.array([step.size_m3, step.error_m3])
        words.append(
            remark(
                f"From the glide at {begin_s:.0f} s of leg"
                f" '{glides.leg_of_glide[step.glide]}' on it is"
                f" {_with_interval(abs(grams[0]), grams[1])} g"
                f" {'lighter' if grams[0] > 0.0 else 'heavier'}, by its depth rates:"
                " ballast thrown, gas or water taken? One trim stands for both; end a leg there.",
                "warning",
            )
        )
    directions = set(glides.directions)
    if len(directions) == 1:
        (one,) = directions
        words.append(
            remark(
                f"Only {one}s: drag and trim move their depth rates alike and are not told apart"
                " (C_D0, trim). The trim is taken from the vehicle file; settled glides of the"
                " other direction would tell it.",
                "warning",
            )
        )
    speeds = np.isfinite(glides.rows.speed_m_s)
    if not speeds.any():
        fixed = " and ".join(PRINTED[name] for name in NEEDS_SPEED)
        words.append(
            remark(
                "Nothing measured the speed through the water: lift is not observable. Held as the"
                f" vehicle file has them: {fixed}; the angle of attack follows from them.",
                "warning",
            )
        )
    else:
        up = glides.rows.state.pitch_rad > 0.0
        part = {(True, False): "dives", (False, True): "climbs"}.get(
            (bool(speeds[~up].any()), bool(speeds[up].any())), "dives and climbs"
        )
        words.append(
            remark(
                f"Speed through the water was measured on {part}, in"
                f" {100.0 * speeds.mean():.0f} % of the stretches: it tells the lift.",
                "note",
            )
        )
    held_names = [name for name in ("C_D1", "alpha_0") if name not in estimate.free]
    if speeds.any() and held_names:
        words.append(
            remark(
                f"Held as the vehicle file has them, because this record knows them worse:"
                f" {', '.join(f'{name} ({MEANINGS[name]})' for name in held_names)}. Glides of"
                " other pitch would tell them.",
                "note",
            )
        )
    return words


def _drive_remark(gap: DriveGap, stroke_m3: float) -> Block:
    """Return whether the drive moves as far as logged, or what would not show."""
    size, half = 1e6 * abs(gap.size_m3), 1e6 * NORMAL_95 * gap.error_m3
    amount = (
        f"{1e6 * abs(gap.limit_m3):.2g} cm³ ({abs(gap.limit_m3) / stroke_m3:.0%} of its stroke)"
    )
    less = "less" if gap.size_m3 < 0.0 else "more"
    drag = ""
    if np.isfinite(gap.drag_factor):
        drag = f" {abs(gap.drag_factor - 1.0):.0%} {'less' if gap.drag_factor < 1.0 else 'more'}"
    if not gap.named:
        drag = f", and C_D would be{drag}" if drag else ""
        return remark(
            "Dives and climbs agree in how their depth rates follow layers of the water and"
            f" pressure: by that the drive moves {estimate(size, half)} cm³ {less} between them"
            f" than the log says. A drive that moves {amount} less would not be seen{drag}.",
            "note",
        )
    return remark(
        "Dives and climbs disagree: by how their depth rates follow layers of the water and"
        f" pressure, the drive moves {estimate(size, half)} cm³ {less} between them than the log"
        f" says ({size / 1e6 / stroke_m3:.0%} of its stroke)."
        + (f" C_D would then be{drag}; figures are weak." if drag else " Figures are weak.")
        + (
            " A drive at its stop one way, commands in place of its position,"
            if gap.size_m3 < 0.0
            else " A thruster that runs beside the drive (its thrust is in no glide), a drive in"
            " another unit,"
        )
        + " or another compressibility of the hull than the vehicle file has?",
        "warning",
    )


def _with_interval(value: float, error: float) -> str:
    return estimate(value, NORMAL_95 * error)


def _figures_table(comparison: GlideComparison) -> Block:
    estimate, bare = comparison.estimate, comparison.without_speed
    heads: list[str | tuple[str, str]] = ["figure", "unit", "value", "± 95 %", "of it by noise"]
    heads += ["verdict", "meaning"]
    if bare is not None:
        heads[5:5] = ["without speed", "± 95 % without"]
    rows = []
    for index, name in enumerate(UNKNOWNS[:5]):
        unit, factor = UNITS[name]
        noise = float(np.sqrt(estimate.noise_covariance[index, index]))
        row: list[Any] = [
            name,
            unit,
            factor * estimate.value(name),
            factor * NORMAL_95 * estimate.standard_error(name),
            factor * NORMAL_95 * noise,
        ]
        if bare is not None:
            row += [factor * bare.value(name), factor * NORMAL_95 * bare.standard_error(name)]
        rows.append([*row, estimate.verdicts[name], MEANINGS[name]])
    note = (
        f"Student's t with {estimate.degrees} degrees of freedom. Residuals: depth rate"
        f" {1e3 * estimate.residual_m_s[0]:.2g} mm/s"
    )
    if np.isfinite(estimate.residual_m_s[1]):
        note += f", speed {1e3 * estimate.residual_m_s[1]:.2g} mm/s"
    return table("Drag, lift and trim", heads, rows, note=f"{note}.")


def _left_out_table(glides: GlideLegs) -> Block:
    rows = [
        [leg, name, seconds]
        for leg, item in glides.settled.items()
        for name, seconds in item.left_out_s().items()
    ]
    return table("What is left out of the fit", ["leg", "reason", ("time", "s")], rows)


def _glides_table(comparison: GlideComparison, glides: GlideLegs) -> Block:
    rows, estimate = glides.rows, comparison.estimate
    fitted = estimate.predict(rows)
    body = []
    for number in np.unique(rows.glide):
        at = rows.glide == number
        speed = rows.speed_m_s[at]
        body.append(
            [
                glides.leg_of_glide[number],
                "climb" if rows.state.pitch_rad[at][0] > 0.0 else "dive",
                float(rows.t_s[at][0]),
                float(rows.t_s[at][-1]),
                float(np.degrees(rows.state.pitch_rad[at].mean())),
                float(rows.depth_rate_m_s[at].mean()),
                float(fitted.depth_rate_m_s[at].mean()),
                float(np.nanmean(speed)) if np.isfinite(speed).any() else None,
                float(fitted.speed_m_s[at].mean()),
            ]
        )
    heads: list[str | tuple[str, str]] = ["leg", "direction", ("from", "s"), ("to", "s")]
    heads += [("pitch", "deg"), ("depth rate", "m/s"), ("fitted", "m/s")]
    heads += [("speed", "m/s"), ("fitted speed", "m/s")]
    return table("Glides", heads, body)


def _by_leg(glides: GlideLegs, values: Array, leg: str) -> tuple[Array, Array]:
    """Return times and values of a leg, a nan between two glides."""
    rows = glides.rows
    mine = np.array([glides.leg_of_glide[number] == leg for number in rows.glide])
    t, y, glide = rows.t_s[mine], values[mine], rows.glide[mine]
    breaks = np.flatnonzero(np.diff(glide)) + 1
    return np.insert(t, breaks, t[breaks]), np.insert(y, breaks, np.nan)


def _rate_plot(comparison: GlideComparison, glides: GlideLegs) -> Block:
    rows, estimate = glides.rows, comparison.estimate
    fitted = estimate.predict(rows).depth_rate_m_s
    panels = []
    for leg in dict.fromkeys(glides.leg_of_glide[number] for number in rows.glide):
        lines = [
            series("measured", *_by_leg(glides, rows.depth_rate_m_s, leg), "measured"),
            series("fitted", *_by_leg(glides, fitted, leg), "predicted"),
            series("held out", *_by_leg(glides, comparison.held_out_rate_m_s, leg), "fused"),
        ]
        panels.append(panel(f"depth rate of {leg}", "m/s", lines))
    return plot(
        "Depth rate of settled glides",
        panels,
        look_for="Held-out glides lie on the fitted ones where the figures carry over.",
    )


def _speed_plot(comparison: GlideComparison, glides: GlideLegs) -> Block:
    rows, fitted = glides.rows, comparison.estimate.predict(glides.rows).speed_m_s
    panels = [
        panel(
            f"speed of {leg}",
            "m/s",
            [
                series("measured", *_by_leg(glides, rows.speed_m_s, leg), "measured"),
                series("fitted", *_by_leg(glides, fitted, leg), "predicted"),
            ],
        )
        for leg in dict.fromkeys(glides.leg_of_glide[number] for number in rows.glide)
    ]
    return plot("Speed through the water", panels, look_for="Both fall as the net buoyancy does.")
