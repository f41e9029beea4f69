"""What no glider records, and glides that never settle: errors with their remedy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Mask
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.glide.bins import GlideRows
from auvid.hydro.identification.glide.fit import GlideEstimate
from auvid.hydro.identification.glide.problem import FileFigure
from auvid.hydro.identification.glide.settled import (
    AGAINST,
    REASONS,
    SLOWEST_S,
    SettledGlides,
    SettlingRules,
)
from auvid.stages.columns import span_text

FLATTER_RAD = float(np.radians(3.0))
"""A glide is steeper than its pitch, for its lift holds what weight or buoyancy has across the
path. Both ways together, a zero of the pitch and the angle without lift cancel."""
FLATTER_ONE_WAY_RAD = float(np.radians(8.0))
"""The same with speed one way only, where a zero of the pitch of some degrees looks alike."""
STEEPER_RAD = (float(np.radians(-1.0)), float(np.radians(7.0)))
"""Angles of attack that gliders have, beside a zero of the pitch of one degree."""
ODD_LIFT = 3.0
"""Standard errors and spreads together."""
ODD_ZERO = 2.0
"""The same of the angle without lift."""
MOST_RATE_M_S, MOST_JUMPS = 1.0, 0.05
"""No glider goes up and down this fast from sample to sample; share of samples that may."""
STEEPEST_RAD = float(np.radians(12.0))
"""Angle of attack and zero of the pitch together are less."""


def unsettled(
    head: str,
    settled: Mapping[str, SettledGlides],
    rules: SettlingRules,
    warnings: Sequence[str] = (),
) -> DataError:
    """Return the error of legs with too few settled glides: what left most out."""
    parts, hints = [], []
    for leg, glides in settled.items():
        out = sorted(glides.left_out_s().items(), key=lambda item: -item[1])
        words = ", ".join(f"{name} {seconds:.0f} s" for name, seconds in out[:4])
        at = np.flatnonzero(glides.reason == REASONS.index(out[0][0]))
        span = span_text((float(glides.record.t_s[at[0]]), float(glides.record.t_s[at[-1]])))
        parts.append(f"leg '{leg}': {words}; mostly {out[0][0]} ({span})")
        steepest = float(np.nanpercentile(np.abs(glides.record.state.pitch_rad), 99.0))
        if steepest < rules.least_pitch_rad:
            hints.append(
                f"The steepest pitch is {np.degrees(steepest):.2g} deg: is the column in rad where"
                " the map says deg?"
            )
        if out[0][0] == AGAINST:
            hints.append(
                "Nose up and depth are positive: turn the sign of the pitch in the column map"
                " (sign: -1), or of the pressure."
            )
        period = float(np.median(np.diff(glides.record.t_s)))
        if period > SLOWEST_S:
            hints.append(
                f"The log has a sample every {period:.0f} s: to bridge that raise"
                " stages.glide.max_gap_s."
            )
            continue
        deepest = float(np.nanmax(glides.depth_m)) if np.isfinite(glides.depth_m).any() else 0.0
        if deepest < 0.0:
            hints.append("The depth is negative: turn the sign of the pressure (sign: -1).")
        elif deepest < 2.0 * rules.surface_m:
            hints.append(
                f"The deepest point is {deepest:.3g} m: is the pressure in bar where the map says"
                " dbar? In shallow water lower stages.glide.surface_m."
            )
    return DataError(
        " ".join([f"{head}: {'; '.join(parts)}", *warnings]),
        allowed=(
            f"{rules.shortest_s:g} s below {rules.surface_m:g} m, {rules.settling_s:g} s after"
            " drive and pitch came to rest"
        ),
        remedy=(
            " ".join(dict.fromkeys(hints))
            or "Fly longer glides with drive and pitch at rest, or shorten stages.glide.settling_s"
            " and stages.glide.shortest_s."
        ),
    )


def check_speed(rows: GlideRows, legs: Sequence[str]) -> str:
    """Return what is odd of pitch and speed where speed is measured one way only.

    Raises `DataError` for speeds that are not those through the water along the path: no
    glider sinks faster than it moves, glides flatter than its pitch, or has one speed.
    """
    speed, sink = rows.speed_m_s, np.abs(rows.depth_rate_m_s)
    finite = np.isfinite(speed)
    if not finite.any():
        return ""
    faster: Mask = finite & (sink > speed)
    at = int(np.flatnonzero(faster if faster.any() else finite)[0])
    where = f"leg '{legs[rows.glide[at]]}' at {rows.t_s[at]:.0f} s"
    if faster.sum() > 0.5 * finite.sum():
        raise DataError(
            "the depth changes faster than the speed through the water",
            field="speed_m_s",
            value=f"{sink[at]:.3g} m/s of depth at {speed[at]:.3g} m/s, {where}",
            remedy=(
                "Is the pressure in dbar where the map says bar, in psi, or the speed in knots or"
                " cm/s?"
            ),
        )
    if finite.sum() > 1 and float(np.ptp(speed[finite])) < 1e-6:
        raise DataError(
            "the speed through the water never changes",
            field="speed_m_s",
            value=f"{speed[at]:.3g} m/s in all {int(finite.sum())} stretches",
            remedy="A set or an assumed speed measures nothing: leave its column out of the map.",
        )
    path = np.arcsin(np.clip(sink / np.where(finite, speed, np.inf), 0.0, 1.0))
    pitch, up = np.abs(rows.state.pitch_rad), rows.state.pitch_rad > 0.0
    ways = [way & finite for way in (up, ~up) if (way & finite).any()]
    steep = [float(np.median(pitch[way])) for way in ways]
    flat = [float(np.median(path[way])) for way in ways]
    steeper = float(np.mean(flat) - np.mean(steep))
    if -steeper > (FLATTER_RAD if len(ways) == 2 else FLATTER_ONE_WAY_RAD):
        raise DataError(
            "the speed is more than pitch and depth rate allow: its path is flatter than the pitch",
            field="speed_m_s",
            value=_path_words(flat, steep),
            remedy=(
                "Is it a speed over ground, with a current in it, or in knots? Leave its column"
                " out of the map: drag is told without it."
            ),
        )
    if steeper > STEEPEST_RAD:
        raise DataError(
            "the depth changes faster than pitch and speed allow: its path is steeper than any",
            field="pressure_pa",
            value=_path_words(flat, steep),
            remedy=(
                "Is the pressure in psi where the map says dbar, or the speed in another unit, or"
                " only a part of it?"
            ),
        )
    if len(ways) == 2 or STEEPER_RAD[0] <= steeper <= STEEPER_RAD[1]:
        return ""
    one, other = ("climbs", "dives") if (up & finite).any() else ("dives", "climbs")
    return (
        f"By its speed the path of {one} is {np.degrees(abs(steeper)):.2g} deg"
        f" {'steeper' if steeper > 0.0 else 'flatter'} than their"
        " pitch. The zero of the pitch sensor, the unit of the pressure, or a speed that is not"
        f" through the water moves it so; speed on {other} as well would tell which."
    )


def check_one_vehicle(t_s: Array, depth_m: Array, leg: str) -> None:
    """Raise `DataError` for depths (n,) [m] that go between two vehicles."""
    rate = np.diff(depth_m) / np.maximum(np.diff(t_s), 1e-3)
    fast = np.abs(rate) > MOST_RATE_M_S
    jumps = fast[1:] & fast[:-1] & (np.sign(rate[1:]) != np.sign(rate[:-1]))
    share = float(np.mean(jumps)) if jumps.size else 0.0
    if share <= MOST_JUMPS:
        return
    at = int(np.flatnonzero(jumps)[0])
    raise DataError(
        f"the depth of leg '{leg}' goes to and fro from sample to sample",
        field="pressure_pa",
        value=(
            f"{depth_m[at]:.3g}, {depth_m[at + 1]:.3g} and {depth_m[at + 2]:.3g} m within"
            f" {t_s[at + 2] - t_s[at]:.3g} s at {t_s[at]:.0f} s; {share:.0%} of the samples do so"
        ),
        allowed=f"up to {MOST_RATE_M_S:g} m/s, but for single samples",
        remedy=(
            "Are the rows of two vehicles, or of two sensors, in one file? Give each a file and a"
            " log of its own."
        ),
    )


def _path_words(flat: Sequence[float], steep: Sequence[float]) -> str:
    path, pitch = np.degrees(np.mean(flat)), np.degrees(np.mean(steep))
    return f"{path:.2g} deg of path at {pitch:.2g} deg of pitch"


def odd_lift(estimate: GlideEstimate, file: FileFigure) -> str:
    """Return what is odd of a lift that is clearly another than the vehicle file's."""
    slope, error = estimate.value("C_L_alpha"), estimate.standard_error("C_L_alpha")
    if abs(slope - file.mean) < ODD_LIFT * np.hypot(error, file.sd):
        return ""
    return (
        f"By the speed the slope of the lift is {slope:.2g} ± {NORMAL_95 * error:.1g} per rad, in"
        f" the vehicle file {file.mean:.2g} ± {NORMAL_95 * file.sd:.1g}. A horizontal speed looks"
        " like less lift, or is the file another glider's?"
        " Figures are weak."
    )


def odd_zero(estimate: GlideEstimate, file: FileFigure) -> str:
    """Return what is odd of an angle without lift that is clearly not the file's."""
    if "alpha_0" not in estimate.free:
        return ""
    angle, error = estimate.value("alpha_0"), estimate.standard_error("alpha_0")
    if abs(angle - file.mean) < ODD_ZERO * np.hypot(error, file.sd):
        return ""
    return (
        f"Dives and climbs go as if the pitch were {abs(np.degrees(angle)):.2g} ±"
        f" {np.degrees(NORMAL_95 * error):.1g} deg {'less' if angle > 0.0 else 'more'} than logged"
        f" (alpha_0; the vehicle file allows {np.degrees(NORMAL_95 * file.sd):.2g}): is the zero of"
        " the pitch sensor off? Level the glider, read it, and take that off the column; where it"
        " sits so by intent raise glider.zero_lift_sd of the vehicle file. Figures are weak."
    )
