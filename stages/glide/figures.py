"""The figures of a glide campaign: values with 95 % intervals and verdicts."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.glide.comparison import GlideComparison
from auvid.hydro.identification.glide.fit import GlideEstimate
from auvid.hydro.identification.glide.problem import UNKNOWNS
from auvid.hydro.identification.regression.verdicts import clear_of_zero
from auvid.stages.glide.glider import Glider
from auvid.stages.glide.legs import GlideLegs
from auvid.stages.number_format import significant
from auvid.stages.presentation import Figure, figure

UNITS = {
    "C_D0": ("1", 1.0),
    "C_D1": ("1/rad^2", 1.0),
    "C_L_alpha": ("1/rad", 1.0),
    "alpha_0": ("deg", float(np.degrees(1.0))),
    "trim": ("cm^3", 1e6),
    "mass": ("kg", 1.0),
}
"""Unknown -> unit in print and factor from SI."""
MEANINGS = {
    "C_D0": "drag without lift",
    "C_D1": "induced drag",
    "C_L_alpha": "slope of the lift of hull and wings",
    "alpha_0": "angle without lift, with the mounting of the pitch sensor",
    "trim": "volume beyond that of the neutral glider",
    "mass": "mass",
}
NEEDS_SPEED = ("C_L_alpha", "C_D1")
"""What no record without speed through the water tells."""


def glide_results(comparison: GlideComparison, glides: GlideLegs, glider: Glider) -> dict[str, Any]:
    """Return the figures: drag and lift of the mean glide first, then the unknowns."""
    estimate = comparison.estimate
    rows = _of_glide(estimate, glides, headline=True)
    rows += [_unknown(estimate, name, headline=True) for name in UNKNOWNS[:5]]
    rows.append(
        figure(
            "depth rate of other glides predicted",
            comparison.fit_percent,
            "percent",
            note="alternate glides held out; 0 % would be one mean rate for all",
            headline=True,
        )
    )
    rows.append(
        figure(
            "the same within dives and climbs",
            comparison.fit_within_percent,
            "percent",
            note="0 % would be one mean rate for all dives and one for all climbs",
        )
    )
    rows += [
        figure(f"{name} predicted", value, "percent", note="fitted to the other direction alone")
        for name, value in comparison.other_way_percent.items()
    ]
    if comparison.without_speed is not None:
        suffix = " (without speed)"
        rows += _of_glide(comparison.without_speed, glides, suffix=suffix)
        rows += [_unknown(comparison.without_speed, name, suffix=suffix) for name in UNKNOWNS[:5]]
    names = ("depth rate", "speed")
    rows += [
        figure(f"rms residual of {name}", value, "m/s")
        for name, value in zip(names, estimate.residual_m_s, strict=True)
        if np.isfinite(value)
    ]
    rows.append(figure("settled glides", float(estimate.glides), "1"))
    area = f"referred to S = {significant(glider.body.area_m2, 3)} m²"
    return {"title": f"glider, {area}", "rows": rows}


def mean_pitch(glides: GlideLegs) -> float:
    """Return the mean steepness of the glides as pitch of a dive [rad]."""
    return -float(np.mean(np.abs(glides.rows.state.pitch_rad)))


def _of_glide(
    estimate: GlideEstimate, glides: GlideLegs, *, suffix: str = "", headline: bool = False
) -> list[Figure]:
    """Return drag, lift and angle of attack of the mean glide."""
    pitch = mean_pitch(glides)
    at = estimate.at_pitch(pitch)
    where = f"at {abs(np.degrees(pitch)):.1f} deg of pitch"
    lift_is_free = "C_L_alpha" in estimate.free
    rows = []
    for name, label, unit, factor, note in (
        ("C_D", "C_D", "1", 1.0, "C_D0 + C_D1 (alpha - alpha_0)^2"),
        ("C_L", "C_L", "1", 1.0, "C_L_alpha (alpha - alpha_0)"),
        ("alpha", "angle of attack", "deg", float(np.degrees(1.0)), "of a dive"),
    ):
        value, error = (factor * item for item in at[name])
        if estimate.verdicts["C_D0"] == "inseparable" and name != "alpha":
            verdict = "inseparable"
        elif name != "C_D" and not lift_is_free:
            verdict = "from the prior"
        else:
            clear = clear_of_zero(value, error) and name not in estimate.doubted
            verdict = "identified" if clear else "weak"
        rows.append(
            _figure(
                estimate,
                f"{label}{suffix}",
                value,
                error,
                unit,
                verdict,
                f"{where}; {note}",
                headline,
            )
        )
    return rows


def _unknown(
    estimate: GlideEstimate, name: str, *, suffix: str = "", headline: bool = False
) -> Figure:
    unit, factor = UNITS[name]
    note = MEANINGS[name]
    if name not in estimate.free:
        note += "; that of the vehicle file"
        if name in NEEDS_SPEED and not np.isfinite(estimate.residual_m_s[1]):
            note += ": not observable without speed through the water"
    if name in estimate.free and estimate.verdicts[name] == "from the prior":
        note += "; it goes with C_D1 of the vehicle file, their sum C_D is what glides tell"
    if estimate.verdicts[name] == "inseparable":
        note += "; one direction alone does not tell drag from trim"
    value, error = factor * estimate.value(name), factor * estimate.standard_error(name)
    return _figure(
        estimate, f"{name}{suffix}", value, error, unit, estimate.verdicts[name], note, headline
    )


def _figure(
    estimate: GlideEstimate,
    quantity: str,
    value: float,
    error: float,
    unit: str,
    verdict: str,
    note: str,
    headline: bool,
) -> Figure:
    half = NORMAL_95 * error
    return figure(
        quantity,
        value,
        unit,
        error,
        interval=(value - half, value + half),
        verdict=verdict,
        note=note,
        headline=headline,
    )
