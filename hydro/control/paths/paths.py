"""Space curves for a vehicle.

Heading and pitch of the tangent over the horizontal run, position by integration, arc
length, frames.

A path is given by the rates of heading and pitch per metre of horizontal run, linear
between knots; a jump is two knots at one place. Heading and pitch are then quadratic
between knots (clothoid-like where a rate is ramped), the tangent is exact, and straight
lines need no care. With run sigma, heading psi and pitch theta (bow up): T = [c(theta)
c(psi), c(theta) s(psi), -s(theta)] in NED and ds = d(sigma) / c(theta).

Equations of Al Makdah 2016.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array, cross

CELL_M = 0.25
"""Positions come from Gauss-Legendre integration over cells no longer than this: 1e-12
m for radii above 1 m.
"""
_NODE, _WEIGHT = (
    0.5 * (np.polynomial.legendre.leggauss(8)[0] + 1.0),
    0.5 * np.polynomial.legendre.leggauss(8)[1],
)


@dataclass(frozen=True)
class CurvePoints:
    """A path at arc lengths `s_m` (n,).

    NED position (n, 3), heading and pitch of the tangent (n,) [rad], their rates per
    metre of arc.
    """

    s_m: Array
    position: Array
    heading: Array
    pitch: Array
    heading_rate: Array
    pitch_rate: Array

    @property
    def tangent(self) -> Array:
        """T (n, 3)."""
        return _tangent(self.heading, self.pitch)

    @property
    def curvature(self) -> Array:
        """(n,) [1/m]: |dT/ds|."""
        return np.asarray(np.hypot(self.pitch_rate, np.cos(self.pitch) * self.heading_rate))


@dataclass(frozen=True)
class Curve:
    """A curve from `start` (3,) with rates at `run_m` (k,) of its knots.

    `heading_rate`, `pitch_rate` (k,) [rad per m of run].

    `segments`: names of parts and the run where each begins.
    """

    start: Array
    start_heading: float
    start_pitch: float
    run_m: Array
    heading_rate: Array
    pitch_rate: Array
    segments: tuple[tuple[str, float], ...] = ()

    @cached_property
    def length_m(self) -> float:
        """Arc length of the whole curve."""
        return float(self._cells[1][-1])

    def angles(self, run: Array) -> tuple[Array, Array, Array, Array]:
        """Heading, pitch and their rates per metre of run, at `run` (...)."""
        knots = self.run_m
        place = np.clip(np.searchsorted(knots, run, side="right") - 1, 0, len(knots) - 2)
        width = np.maximum(knots[place + 1] - knots[place], 1e-300)
        ahead = run - knots[place]
        tables = []
        for first, rate in (
            (self.start_heading, self.heading_rate),
            (self.start_pitch, self.pitch_rate),
        ):
            before = np.concatenate(
                [[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(knots))]
            )
            slope = (rate[place + 1] - rate[place]) / width
            tables.append(
                (
                    first + before[place] + ahead * (rate[place] + 0.5 * slope * ahead),
                    rate[place] + slope * ahead,
                )
            )
        return tables[0][0], tables[1][0], tables[0][1], tables[1][1]

    @cached_property
    def _cells(self) -> tuple[Array, Array, Array]:
        """Edges of cells: run, arc length, position."""
        parts = [self.run_m[:1]]
        for a, b in zip(self.run_m[:-1], self.run_m[1:], strict=True):
            if b > a:
                parts.append(np.linspace(a, b, max(2, int(np.ceil((b - a) / CELL_M)) + 1))[1:])
        edges = np.concatenate(parts)
        length, moved = self._within(edges[:-1], np.diff(edges))
        arc = np.concatenate([[0.0], np.cumsum(length)])
        return (
            edges,
            arc,
            np.asarray(self.start) + np.concatenate([np.zeros((1, 3)), np.cumsum(moved, axis=0)]),
        )

    def _within(self, run: Array, width: Array) -> tuple[Array, Array]:
        """Arc length (n,) and displacement (n, 3) from `run` over `width`."""
        heading, pitch, _, _ = self.angles(run[:, None] + width[:, None] * _NODE)
        weight = width[:, None] * _WEIGHT
        shape = np.stack([np.cos(heading), np.sin(heading), -np.tan(pitch)], axis=-1)
        return (weight / np.cos(pitch)).sum(axis=1), (weight[..., None] * shape).sum(axis=1)

    def at(self, s_m: ArrayLike) -> CurvePoints:
        """The curve at arc lengths (n,); beyond either end it goes straight on."""
        s = np.atleast_1d(np.asarray(s_m, dtype=np.float64))
        inside = np.clip(s, 0.0, self.length_m)
        edges, arc, position = self._cells
        cell = np.clip(np.searchsorted(arc, inside, side="right") - 1, 0, len(edges) - 2)
        ahead = (inside - arc[cell]) * (edges[cell + 1] - edges[cell]) / (arc[cell + 1] - arc[cell])
        for _ in range(6):
            length, _ = self._within(edges[cell], ahead)
            pitch = self.angles(edges[cell] + ahead)[1]
            ahead = np.clip(
                ahead - (length - (inside - arc[cell])) * np.cos(pitch),
                0.0,
                edges[cell + 1] - edges[cell],
            )
        _, moved = self._within(edges[cell], ahead)
        heading, pitch, turning, pitching = self.angles(edges[cell] + ahead)
        outside = s - inside
        straight = outside == 0.0
        place = position[cell] + moved + outside[:, None] * _tangent(heading, pitch)
        cosine = np.cos(pitch)
        return CurvePoints(
            s, place, heading, pitch, turning * cosine * straight, pitching * cosine * straight
        )


def _tangent(heading: Array, pitch: Array) -> Array:
    level = np.cos(pitch)
    return np.stack([level * np.cos(heading), level * np.sin(heading), -np.sin(pitch)], axis=-1)


def path_of_pieces(
    start: ArrayLike,
    heading: float,
    pitch: float,
    pieces: Sequence[tuple[str, float, float, float]],
    *,
    ramp_m: float = 0.0,
) -> Curve:
    """A path of pieces (name, run [m], heading rate, pitch rate [rad per m of run]).

    `ramp_m`: run over which a piece's rates rise from zero and fall to it again, so
    that the curvature is continuous; the piece becomes that much longer and its turn
    stays. Raises `CampaignError` where a turning piece is shorter than its ramps.
    """
    knots, turning, pitching, names, at = [], [], [], [], 0.0
    for name, run, h, p in pieces:
        names.append((name, at))
        ramp = ramp_m if (h or p) else 0.0
        if run < ramp or run < 0.0:
            raise CampaignError(
                f"the piece '{name}' is shorter than the ramp of its curvature",
                value=run,
                allowed=f">= {ramp:g} m",
            )
        shares = (
            ((0.0, 0.0), (ramp, 1.0), (run, 1.0), (run + ramp, 0.0))
            if ramp
            else ((0.0, 1.0), (run, 1.0))
        )
        for ahead, share in shares:
            knots.append(at + ahead)
            turning.append(share * h)
            pitching.append(share * p)
        at += run + ramp
    kept = [
        i
        for i in range(len(knots))
        if i == 0
        or (knots[i], turning[i], pitching[i]) != (knots[i - 1], turning[i - 1], pitching[i - 1])
    ]
    run_m, turns, climbs = (
        np.asarray(values, dtype=np.float64)[kept] for values in (knots, turning, pitching)
    )
    return Curve(
        np.asarray(start, dtype=np.float64), heading, pitch, run_m, turns, climbs, tuple(names)
    )


def helix(
    *,
    radius_m: float,
    pitch_rad: float,
    turns: float,
    starboard: bool = True,
    ramp_m: float = 0.0,
    start: ArrayLike = (0.0, 0.0, 0.0),
    heading_rad: float = 0.0,
) -> Curve:
    """Return a helix of horizontal radius `radius_m` and constant pitch.

    `ramp_m`: run over which its curvature grows from zero.

    Raises `CampaignError` unless the radius and the turns are positive and the pitch is
    below 80 degrees.
    """
    _positive(radius_m=radius_m, turns=turns)
    _pitch(pitch_rad)
    sign = 1.0 if starboard else -1.0
    piece = ("helix", 2.0 * np.pi * radius_m * turns, sign / radius_m, 0.0)
    return path_of_pieces(start, heading_rad, pitch_rad, [piece], ramp_m=ramp_m)


def saw_tooth(
    *,
    leg_m: float,
    pitch_rad: float,
    tip_radius_m: float,
    legs: int,
    ramp_m: float = 0.0,
    start: ArrayLike = (0.0, 0.0, 0.0),
    heading_rad: float = 0.0,
) -> Curve:
    """Return legs of arc length `leg_m` at +-`pitch_rad` in a vertical plane.

    Tips of at least `tip_radius_m` join them.

    Raises `CampaignError` for figures that are not positive.
    """
    _positive(leg_m=leg_m, tip_radius_m=tip_radius_m, legs=legs, pitch_rad=pitch_rad)
    _pitch(pitch_rad)
    straight = leg_m * float(np.cos(pitch_rad))
    pieces: list[tuple[str, float, float, float]] = []
    for index in range(legs):
        pieces.append(("rise" if index % 2 else "dive", straight, 0.0, 0.0))
        if index < legs - 1:
            turn = 2.0 * pitch_rad * (-1.0 if index % 2 else 1.0)
            pieces.append(
                ("tip", abs(turn) * tip_radius_m, 0.0, float(np.sign(turn)) / tip_radius_m)
            )
    return path_of_pieces(start, heading_rad, -pitch_rad, pieces, ramp_m=ramp_m)


def frenet_frame(points: CurvePoints) -> Array:
    """Return [T N B] as columns (n, 3, 3).

    Where the curve is straight N is that of the last bend (before the first bend:
    starboard).

    The principal normal is turned to the starboard half plane (3.8 uses arcsin, which
    loses this), so that its roll (`frame_roll`) stays within +-90 degrees and a turn to
    port is not flown on the back (Al Makdah 2016 (3.5), errata M26).
    """
    heading, pitch = points.heading, points.pitch
    starboard = np.stack([-np.sin(heading), np.cos(heading), np.zeros_like(heading)], axis=-1)
    tangent = points.tangent
    down = cross(tangent, starboard)
    side, under = np.cos(pitch) * points.heading_rate, -points.pitch_rate
    size = np.hypot(side, under)
    bent = size > 1e-9
    unit = np.stack([side, under], axis=-1) / np.where(bent, size, 1.0)[:, None]
    unit *= np.where(unit[:, :1] < 0.0, -1.0, 1.0)
    unit[~bent] = np.nan
    last = np.maximum.accumulate(np.where(bent, np.arange(len(bent)), -1))
    unit = np.where((last >= 0)[:, None], unit[np.maximum(last, 0)], np.array([1.0, 0.0]))
    normal = unit[:, :1] * starboard + unit[:, 1:] * down
    return np.stack([tangent, normal, cross(tangent, normal)], axis=-1)


def frame_roll(frame: Array) -> Array:
    """Roll (n,) [rad] of frames [T N B] (n, 3, 3): the third row of (3.5) by atan2."""
    return np.asarray(np.arctan2(frame[:, 2, 1], frame[:, 2, 2]))


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not value > 0.0:
            raise CampaignError("must be positive", field=name, value=value)


def _pitch(pitch: float) -> None:
    if abs(pitch) > np.radians(80.0):
        raise CampaignError(
            "a path steeper than 80 degrees has no heading to hold",
            field="pitch",
            value=pitch,
            allowed="+-1.396 rad",
        )
