"""Three-dimensional Dubins paths of bounded pitch and curvature between two poses.

After Al Makdah 2016, 4.3 (Wehbe 2015).

Five segments: helix of constant pitch, helix of variable pitch, straight line, helix of
variable pitch, helix of constant pitch. In plan the path is a turn, a line and a turn;
along the first turn the pitch goes from that of the first pose to that of the line,
along the last turn to that of the second pose. Where the depth cannot be reached within
the pitch limit, whole turns are added.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.control.paths.paths import Curve

SCAN = 181
MOST_TURNS = 12
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(24)


@dataclass(frozen=True)
class Pose:
    """A place in NED [m] with heading and pitch of the path there [rad]."""

    x: float
    y: float
    z: float
    heading: float
    pitch: float


@dataclass(frozen=True)
class Bounds:
    """Bounds of a Dubins path [m, rad].

    Least turning radius in plan, largest pitch, least radius of a change of pitch, and
    the ramp of a curvature-continuous path.

    `ramp_m` 0 gives the classic path, whose curvature jumps between segments.
    """

    radius_m: float
    pitch_rad: float
    pitch_radius_m: float
    ramp_m: float = 0.0


@dataclass(frozen=True)
class _Plan:
    """Turn, line, turn: sides (+1 starboard), turned angles, length of the line."""

    sides: tuple[float, float]
    turned: tuple[float, float]
    line_m: float

    def run(self, bounds: Bounds) -> float:
        """Horizontal length."""
        return sum(_arc(angle, bounds) for angle in self.turned) + self.line_m


def dubins_path(first: Pose, last: Pose, bounds: Bounds) -> Curve:
    """The shortest path of the five segments from `first` to `last` within `bounds`.

    Raises `CampaignError` for poses steeper than the limit, bounds that are not
    positive, and pairs that no such path joins: with what is missing, and the radius or
    the pitch that would do.
    """
    for name in ("radius_m", "pitch_rad", "pitch_radius_m"):
        if not getattr(bounds, name) > 0.0:
            raise CampaignError("must be positive", field=name, value=getattr(bounds, name))
    for name, pose in (("first", first), ("last", last)):
        if abs(pose.pitch) > bounds.pitch_rad:
            limit = f"+-{bounds.pitch_rad:.3g} rad"
            raise CampaignError(
                "the pose is steeper than the path may be",
                field=f"{name}.pitch",
                value=pose.pitch,
                allowed=limit,
            )
    if bounds.ramp_m < 0.0 or bounds.ramp_m > np.pi * bounds.radius_m:
        raise CampaignError(
            "the ramp of the curvature must lie between 0 and half a turn",
            field="ramp_m",
            value=bounds.ramp_m,
        )
    for plan in sorted(_plans(first, last, bounds), key=lambda plan: plan.run(bounds)):
        pitch = _line_pitch(plan, first, last, bounds)
        if pitch is not None:
            return _build(plan, pitch, first, last, bounds)
    raise CampaignError(
        "no Dubins path of five segments joins these poses",
        value=(
            f"{np.hypot(last.x - first.x, last.y - first.y):.4g} m apart in plan,"
            f" {first.z - last.z:+.4g} m of rise"
        ),
        allowed=(
            f"pitch up to {bounds.pitch_rad:.3g} rad, turns of {bounds.radius_m:g} m radius,"
            f" {MOST_TURNS} whole turns at most"
        ),
        remedy=(
            "Give more distance, a larger pitch limit, or a smaller turning radius (not below what"
            " the vehicle can turn)."
        ),
    )


def _arc(angle: float, bounds: Bounds) -> float:
    """Run of a turn by `angle`: with ramps it is one ramp longer than the arc."""
    return angle * bounds.radius_m + (bounds.ramp_m if angle else 0.0)


def _turn(angle: float, bounds: Bounds) -> Array:
    """Displacement (2,) of a turn to starboard by `angle` that starts along x."""
    radius, ramp = bounds.radius_m, bounds.ramp_m
    if not angle:
        return np.zeros(2)
    if not ramp:
        return radius * np.array([np.sin(angle), 1.0 - np.cos(angle)])
    full = angle - ramp / radius  # turned at full curvature
    moved, heading = np.zeros(2), 0.0
    for width, shape in ((ramp, 1.0), (full * radius, 0.0), (ramp, -1.0)):
        x = 0.5 * width * (_NODE + 1.0)
        rate = (
            x / radius
            if shape == 0.0
            else 0.5 * x * x / (ramp * radius)
            if shape > 0.0
            else (x - 0.5 * x * x / ramp) / radius
        )
        pieces = max(1, int(np.ceil(full / 1.0))) if shape == 0.0 else 1
        if shape == 0.0:
            ends = radius * np.array(
                [np.sin(heading + full) - np.sin(heading), np.cos(heading) - np.cos(heading + full)]
            )
            moved, heading = moved + ends, heading + full
            continue
        weight = 0.5 * width * _WEIGHT / pieces
        moved = moved + np.array(
            [(weight * np.cos(heading + rate)).sum(), (weight * np.sin(heading + rate)).sum()]
        )
        heading += 0.5 * ramp / radius
    return moved


def _plans(first: Pose, last: Pose, bounds: Bounds) -> Iterator[_Plan]:
    """Yield all turn-line-turn paths in plan.

    0 to MOST_TURNS whole turns are added to either turn.
    """
    from scipy.optimize import brentq

    target = np.array([last.x - first.x, last.y - first.y])
    least = bounds.ramp_m / bounds.radius_m

    def second(angle: float, sides: tuple[float, float]) -> float:
        left = (sides[1] * (last.heading - first.heading - sides[0] * angle)) % (2.0 * np.pi)
        left = 0.0 if 2.0 * np.pi - left < 1e-9 or left < 1e-9 else left
        return left + 2.0 * np.pi if 0.0 < left < least else left

    def line(angle: float, sides: tuple[float, float]) -> tuple[float, float]:
        """Return the line's sideways miss of the last turn, and its length."""
        there = first.heading + sides[0] * angle
        after = second(angle, sides)
        rest = (
            target
            - _turned(_turn(angle, bounds) * (1.0, sides[0]), first.heading)
            - _turned(_turn(after, bounds) * (1.0, sides[1]), there)
        )
        along = np.array([np.cos(there), np.sin(there)])
        return float(along[0] * rest[1] - along[1] * rest[0]), float(along @ rest)

    for sides in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        grid = np.linspace(least, least + 2.0 * np.pi, SCAN)
        roots = [0.0, *grid[:1]] if least else [0.0]
        miss = np.array([line(angle, sides)[0] for angle in grid])
        for i in np.flatnonzero((miss[:-1] * miss[1:] < 0.0) | (miss[:-1] == 0.0)):
            if miss[i] == 0.0:
                roots.append(float(grid[i]))
                continue
            roots.append(
                float(
                    brentq(
                        lambda angle, sides=sides: line(angle, sides)[0],
                        grid[i],
                        grid[i + 1],
                        xtol=1e-13,
                    )
                )
            )
        for angle in roots:
            missed, length = line(angle, sides)
            if abs(missed) > 1e-6 * (1.0 + np.hypot(*target)) or length < -1e-9:
                continue
            after = second(angle, sides)
            for a, b in product(range(MOST_TURNS + 1), repeat=2):
                if a + b <= MOST_TURNS:
                    yield _Plan(
                        sides, (angle + 2.0 * np.pi * a, after + 2.0 * np.pi * b), max(length, 0.0)
                    )


def _turned(moved: Array, heading: float) -> Array:
    c, s = np.cos(heading), np.sin(heading)
    return np.array([c * moved[0] - s * moved[1], s * moved[0] + c * moved[1]])


def _change(angle: float, bounds: Bounds) -> float:
    """Return the run over which the pitch changes by `angle`.

    With ramps the rate rises and falls linearly.
    """
    return abs(angle) * bounds.pitch_radius_m * (2.0 if bounds.ramp_m else 1.0)


def _rise(
    pitch: float, turns: tuple[float, float], line: float, first: Pose, last: Pose, bounds: Bounds
) -> float:
    """Height gained along the path with this pitch on the line."""
    total = line * np.tan(pitch)
    for run, end in zip(turns, (first.pitch, last.pitch), strict=True):
        change = _change(pitch - end, bounds)
        total += (run - change) * np.tan(end)
        x = 0.25 * (_NODE + 1.0)  # first half of the change; the second mirrors it
        early = 2.0 * x * x if bounds.ramp_m else x
        both = np.tan(end + (pitch - end) * early) + np.tan(pitch - (pitch - end) * early)
        total += change * 0.25 * float(_WEIGHT @ both)
    return float(total)


def _line_pitch(plan: _Plan, first: Pose, last: Pose, bounds: Bounds) -> float | None:
    """Return the pitch of the line that meets the second pose's depth, or None.

    None where no pitch within the limit does, or the changes do not fit.
    """
    from scipy.optimize import brentq

    turns = (_arc(plan.turned[0], bounds), _arc(plan.turned[1], bounds))

    def miss(pitch: float) -> float:
        return _rise(pitch, turns, plan.line_m, first, last, bounds) - (first.z - last.z)

    rate = bounds.pitch_radius_m * (2.0 if bounds.ramp_m else 1.0)
    low = max(-bounds.pitch_rad, first.pitch - turns[0] / rate, last.pitch - turns[1] / rate)
    high = min(bounds.pitch_rad, first.pitch + turns[0] / rate, last.pitch + turns[1] / rate)
    if low > high + 1e-12:
        return None
    at_low, at_high = miss(low), miss(high)
    if abs(at_low) < 1e-9:
        return low
    if at_low * at_high > 0.0:
        return None
    return float(brentq(miss, low, high, xtol=1e-14))


def _build(plan: _Plan, pitch: float, first: Pose, last: Pose, bounds: Bounds) -> Curve:
    """Return the path from piecewise linear rates of heading and of pitch.

    Each has knots of its own.
    """
    runs = (_arc(plan.turned[0], bounds), plan.line_m, _arc(plan.turned[1], bounds))
    ends = (runs[0], runs[0] + runs[1], sum(runs))
    heading = [*_box(0.0, runs[0], plan.sides[0] / bounds.radius_m, bounds.ramp_m)]
    heading += _box(ends[1], ends[2], plan.sides[1] / bounds.radius_m, bounds.ramp_m)
    down, up = _change(pitch - first.pitch, bounds), _change(last.pitch - pitch, bounds)
    pitching = [
        *_hat(runs[0] - down, runs[0], pitch - first.pitch, bounds),
        *_hat(ends[1], ends[1] + up, last.pitch - pitch, bounds),
    ]
    inner = {0.0, ends[2], *(at for at, _ in (*heading, *pitching))}
    run_m = np.repeat(np.array(sorted(inner)), 2)
    side = np.tile([-1.0, 1.0], len(inner))
    segments = (
        ("helix of constant pitch", 0.0),
        ("helix of variable pitch", runs[0] - down),
        ("straight line", ends[0]),
        ("helix of variable pitch", ends[1]),
        ("helix of constant pitch", ends[1] + up),
    )
    columns = [_value(knots, run_m, side) for knots in (heading, pitching)]
    return Curve(
        np.array([first.x, first.y, first.z]),
        first.heading,
        first.pitch,
        run_m[1:-1],
        columns[0][1:-1],
        columns[1][1:-1],
        segments,
    )


Knots = list[tuple[float, float]]


def _box(start: float, end: float, rate: float, ramp: float) -> Knots:
    if end <= start:
        return []
    return [(start, 0.0), (start + ramp, rate), (end - ramp, rate), (end, 0.0)]


def _hat(start: float, end: float, angle: float, bounds: Bounds) -> Knots:
    if end <= start:
        return []
    if not bounds.ramp_m:
        return _box(start, end, angle / (end - start), 0.0)
    return [(start, 0.0), (0.5 * (start + end), 2.0 * angle / (end - start)), (end, 0.0)]


def _value(knots: Knots, run: Array, side: Array) -> Array:
    """Return the value just before (side -1) or after (+1) each place.

    The function is linear between knots and zero outside.
    """
    out = np.zeros(len(run))
    for (a, low), (b, high) in pairwise(knots):
        if b > a:
            inside = ((run > a) | ((run == a) & (side > 0))) & (
                (run < b) | ((run == b) & (side < 0))
            )
            out[inside] = low + (high - low) * (run[inside] - a) / (b - a)
    return out
