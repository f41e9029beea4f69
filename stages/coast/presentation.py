"""Tables and report section of the coasts: what they give, and what they cannot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.coasting.decay import LEAST_COASTS, CoastDecay, CoastRecord
from auvid.hydro.identification.coasting.finding import CoastSearch
from auvid.hydro.identification.coasting.thrust_scale import CommonScale, ThrustScale
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, WEAK, clear_of_zero
from auvid.stages.number_format import significant
from auvid.stages.presentation import (
    Block,
    half_95,
    panel,
    plot,
    remark,
    section,
    series,
    table,
    text,
)

WORDS = {"u": "surge", "v": "sway", "w": "heave", "r": "yaw"}
UNITS = {"u": "m/s", "v": "m/s", "w": "m/s", "r": "rad/s"}
TAKEN, ODD, SHORT = "taken", "another matter", "too short"


@dataclass
class AxisCoasts:
    """Coasts of all segments on one velocity, and what was found with them."""

    places: list[tuple[str, float, float, float]] = field(default_factory=list)
    """Segment, and stop, start and end of each coast [s of the log]."""
    records: list[CoastRecord] = field(default_factory=list)
    short: list[tuple[str, float, float]] = field(default_factory=list)
    idle_s: float = 0.0
    slow: int = 0
    decay: CoastDecay | None = None
    scale: ThrustScale | None = None
    mass_share: float = 0.0

    def add(
        self,
        segment: str,
        start_s: float,
        search: CoastSearch,
        records: tuple[CoastRecord, ...],
    ) -> None:
        """Take in one segment that starts at `start_s` of its log."""
        for item in search.coasts:
            stop_s, first_s, last_s = item.stop_s, item.start_s, item.end_s
            self.places.append((segment, start_s + stop_s, start_s + first_s, start_s + last_s))
        self.records += records
        self.short += [(segment, start_s + first, start_s + last) for first, last in search.short]
        self.idle_s += search.idle_s
        self.slow += search.slow

    @property
    def verdict(self) -> str:
        """Return identified, weak or not excited, of drag over mass at its speed."""
        if self.decay is None:
            return "not excited"
        rate, error = self.decay.rate(self.decay.reference_speed)
        return IDENTIFIED if clear_of_zero(rate, error) else WEAK


def coast_rows(axes: Mapping[str, AxisCoasts]) -> dict[str, Any]:
    """Return the columns of `coasts`: a row per coast, also for those too short."""
    rows: list[tuple[Any, ...]] = []
    for name, axis in axes.items():
        odd = set() if axis.decay is None else set(axis.decay.odd.tolist())
        for index, (place, record) in enumerate(zip(axis.places, axis.records, strict=True)):
            ends = record.speed[[0, -1]] if record.speed.size else np.full(2, np.nan)
            use = ODD if index in odd else TAKEN
            rows.append((name, *place, *(float(value) for value in ends), use))
        for segment, first, last in axis.short:
            rows.append((name, segment, first, first, last, np.nan, np.nan, SHORT))
    heads = ("velocity", "segment", "stop_s", "start_s", "end_s", "start_speed", "end_speed", "use")
    return {head: [row[place] for row in rows] for place, head in enumerate(heads)}


def drag_rows(axes: Mapping[str, AxisCoasts]) -> dict[str, Any]:
    """Return the columns of `coast_drag`: a row per velocity; nan where too few."""
    heads = (
        "velocity", "coasts", "verdict", "d1", "d1_se", "d2", "d2_se", "speed", "rate",
        "rate_se", "scale", "scale_se", "thrust_lag_s", "mass_share",
    )  # fmt: skip
    rows = []
    for name, axis in axes.items():
        decay, scale = axis.decay, axis.scale
        values = [np.nan] * 7
        if decay is not None:
            d1, d2 = (float(value) for value in decay.drag)
            e1, e2 = (float(value) for value in np.sqrt(np.diag(decay.covariance)))
            speed = decay.reference_speed
            values = [d1, e1, d2, e2, speed, *decay.rate(speed)]
        scales = (
            [np.nan] * 3 if scale is None else [scale.scale, scale.standard_error, scale.lag.lag_s]
        )
        count = len(axis.records) if decay is None else decay.coasts
        rows.append((name, count, axis.verdict, *values, *scales, axis.mass_share))
    return {head: [row[place] for row in rows] for place, head in enumerate(heads)}


def coast_section(
    axes: Mapping[str, AxisCoasts], common: CommonScale | None, vehicle: Vehicle, least_s: float
) -> dict[str, Any]:
    """Return the report section: the scale in a sentence, drag, what lacks."""
    fitted = {name: axis for name, axis in axes.items() if axis.decay is not None}
    lacking = {name: axis for name, axis in axes.items() if axis.decay is None}
    blocks: list[Block] = []
    if common is not None:
        blocks.append(
            remark(
                scale_words(fitted, common),
                "warning" if common.alarming else "finding",
            )
        )
    if lacking:
        blocks.append(remark(lacking_words(lacking, vehicle, least_s)))
    blocks += [remark(words) for words in odd_words(axes)]
    if fitted:
        blocks.append(_drag_table(fitted))
        blocks += _plots(fitted)
        blocks.append(
            text(
                "Drag over apparent mass follows from the decay of the speed alone; no thrust curve"
                " takes part. Drag in newtons is that times the apparent mass of the vehicle file,"
                " so the scale is that of thrust over mass."
            )
        )
    return section(
        "Coasting: drag without the thrust curve",
        blocks,
        order=45,
        look_for="A scale far from 1: the thrust curve or the mass is wrong, and so each force.",
    )


def scale_words(fitted: Mapping[str, AxisCoasts], common: CommonScale) -> str:
    """Return the sentence on the thrust curve."""
    used = [name for name, axis in fitted.items() if axis.scale is not None]
    count = sum(axis.decay.coasts for axis in fitted.values() if axis.decay is not None)
    half = half_95(common.noise) or 0.0
    size = f"{common.scale:.2f} +- {half:.2f}"
    coasts = f"{count} coasts in {', '.join(WORDS[name] for name in used)}"
    if common.by_mass:
        reach = half_95(common.total) or 0.0
        return (
            f"Thrust over mass by the vehicle file is {size} times what {coasts} say: the thrust"
            " curve or the mass is off. What nobody measured of the mass may be all of it: with"
            f" that, thrust alone is {common.scale - reach:.2f} to {common.scale + reach:.2f} times"
            " what they say."
        )
    words = f"Thrust by the vehicle file is {size} times what {coasts} say it is"
    if common.departs:
        words += (
            f": the thrust curve or the mass is off, and forces and coefficients with it"
            f" ({significant(common.scale, 3)} times too large if the mass is right). If it is"
            " weighed, multiply thrust_curve.force of the vehicle file by"
            f" {1.0 / common.scale:.2f}; else weigh it first"
        )
    else:
        words += ": the thrust curve holds as far as they show"
    share = np.sqrt(max(common.total**2 - common.noise**2, 0.0))
    if share > 0.0:
        words += f". What nobody measured of the mass makes +- {half_95(float(share)):.2f} of it"
    return words + "."


def lacking_words(lacking: Mapping[str, AxisCoasts], vehicle: Vehicle, least_s: float) -> str:
    """Return why there is no drag from coasts on these velocities."""
    passive = vehicle.thrusters is None and vehicle.propeller is None
    if passive and not any(axis.records or axis.short or axis.slow for axis in lacking.values()):
        return (
            "No coasts: the vehicle has no thrust that could end. Drag shows where a tow or a hand"
            " lets go of it: begin a leg at each release and name the legs in"
            " stages.coast.releases."
        )
    parts = []
    for name, axis in lacking.items():
        reasons = []
        if axis.records:
            reasons.append(f"{len(axis.records)} of {LEAST_COASTS} coasts needed")
        if axis.short:
            reasons.append(f"{len(axis.short)} shorter than {least_s:g} s")
        if axis.slow:
            reasons.append(f"{axis.slow} rests that begin too slow")
        if not reasons:
            reasons.append(
                "its thrust never stops"
                if axis.idle_s == 0.0
                else "its thrust never stops in motion"
            )
        parts.append(f"{WORDS[name]} ({', '.join(reasons)})")
    return (
        f"Too few coasts in {', '.join(parts)}: there the thrust curve was not checked. Let go of"
        f" the sticks at speed for {2 * least_s:g} to 4 s, ten times, heading hold off for yaw."
    )


def odd_words(axes: Mapping[str, AxisCoasts]) -> Iterator[str]:
    """Yield a sentence for each velocity with coasts that are another matter."""
    for name, axis in axes.items():
        if axis.decay is not None and axis.decay.odd.size:
            places = ", ".join(
                f"{axis.places[index][1]:.1f} s of {axis.places[index][0]}"
                for index in axis.decay.odd.tolist()
            )
            yield (
                f"Left out in {WORDS[name]}, as they do not slow down as the others do (bottom, a"
                f" taut tether, another current): {places}."
            )


def _drag_table(fitted: Mapping[str, AxisCoasts]) -> Block:
    rows = []
    for name, axis in fitted.items():
        assert axis.decay is not None
        decay, scale = axis.decay, axis.scale
        speed = decay.reference_speed
        rate, error = decay.rate(speed)
        errors = np.sqrt(np.diag(decay.covariance))
        rows.append(
            [
                WORDS[name],
                decay.coasts,
                f"{significant(speed, 2)} {UNITS[name]}",
                significant(rate),
                significant(half_95(error), 2),
                axis.verdict,
                significant(float(decay.drag[0])),
                significant(half_95(float(errors[0])), 2),
                significant(float(decay.drag[1])),
                significant(half_95(float(errors[1])), 2),
                None if scale is None else significant(scale.scale),
                None if scale is None else significant(half_95(scale.standard_error), 2),
                significant(100.0 * axis.mass_share, 2),
            ]
        )
    return table(
        "Drag over apparent mass from coasts, and the scale of thrust over mass",
        [
            "velocity",
            "coasts",
            "at",
            ("drag / m", "1/s"),
            ("± 95 %", "1/s"),
            "verdict",
            ("linear d1", "1/s"),
            ("± 95 % d1", "1/s"),
            ("quadratic d2", "1/m, 1/rad"),
            ("± 95 % d2", "1/m, 1/rad"),
            "scale",
            "± 95 % scale",
            ("mass assumed to ±", "%"),
        ],
        rows,
        note=(
            "x' = -(d1 x + d2 x|x|) + constant of the coast. Intervals by how coasts differ. Linear"
            " and quadratic part share their error: read them together, or the drag at the speed."
        ),
    )


def _plots(fitted: Mapping[str, AxisCoasts]) -> list[Block]:
    panels = []
    for name, axis in fitted.items():
        assert axis.decay is not None
        lines = []
        for index, simulated in zip(axis.decay.used.tolist(), axis.decay.simulated, strict=True):
            record = axis.records[index].thinned()
            since: Array = record.t_s - record.t_s[0]
            sign = float(np.sign(record.speed[0]))
            lines += [
                series("measured", since, sign * record.speed, "measured"),
                series("simulated", since, sign * simulated, "fused"),
            ]
        panels.append(panel(WORDS[name], UNITS[name], lines))
    return [
        plot(
            "Speed of each coast, measured and simulated",
            panels,
            look_for="All coasts of an axis follow one law, from whatever speed they start.",
        )
    ]
