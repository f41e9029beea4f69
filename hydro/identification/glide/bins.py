"""Means over short stretches of settled glides, the rows of the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array, Index, Mask
from auvid.hydro.dynamics.gliding.steady_glide import GlideState
from auvid.hydro.identification.glide.settled import SettledGlides

LEAST_SHARE = 0.5
"""A stretch has a mean speed where so much of it was measured."""


@dataclass(frozen=True)
class GlideRows:
    """Means over stretches of settled glides, m rows.

    Time of the middle [s], inputs of the balance, depth rate and speed through the water
    [m/s] (nan where not measured), number of the glide.
    """

    t_s: Array
    state: GlideState
    depth_rate_m_s: Array
    speed_m_s: Array
    glide: Index

    def where(self, rows: Mask) -> GlideRows:
        """Return the rows of a mask (m,)."""
        state = self.state
        return GlideRows(
            self.t_s[rows],
            GlideState(
                state.pitch_rad[rows],
                state.drive_m3[rows],
                state.density_kg_m3[rows],
                state.pressure_pa[rows],
                state.temperature_K[rows],
            ),
            self.depth_rate_m_s[rows],
            self.speed_m_s[rows],
            self.glide[rows],
        )

    def without_speed(self) -> GlideRows:
        """Return the same rows as if nothing had measured the speed."""
        return GlideRows(
            self.t_s,
            self.state,
            self.depth_rate_m_s,
            np.full_like(self.speed_m_s, np.nan),
            self.glide,
        )


def glide_rows(settled: SettledGlides, *, stretch_s: float) -> GlideRows:
    """Return means over stretches of about stretch_s [s], none across two glides."""
    t, record = settled.record.t_s, settled.record
    label = np.full(t.size, -1, dtype=np.intp)
    glides: list[int] = []
    for number, (first, last) in enumerate(settled.spans_s):
        rows = np.flatnonzero(settled.glide == number)
        count = max(round((last - first) / stretch_s), 1)
        bin_of = np.minimum(((t[rows] - first) / (last - first) * count).astype(np.intp), count - 1)
        for each in np.unique(bin_of):
            label[rows[bin_of == each]] = len(glides)
            glides.append(number)
    inside = label >= 0
    at, total = label[inside], np.bincount(label[inside], minlength=len(glides))

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(at, values[inside], minlength=len(glides)) / total)

    measured = np.isfinite(record.speed_m_s)
    share = mean(measured.astype(np.float64))
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = mean(np.where(measured, record.speed_m_s, 0.0)) / share
    state = record.state
    return GlideRows(
        mean(t),
        GlideState(
            mean(state.pitch_rad),
            mean(state.drive_m3),
            mean(state.density_kg_m3),
            mean(state.pressure_pa),
            mean(state.temperature_K),
        ),
        mean(settled.depth_rate_m_s),
        np.where(share >= LEAST_SHARE, speed, np.nan),
        np.array(glides, dtype=np.intp),
    )


def yos_of(rows: GlideRows) -> Index:
    """Return the yo (m,) of each row: a climb belongs to the dive before it.

    Water that rises or sinks for half an hour disturbs both.
    """
    numbers, first = np.unique(rows.glide, return_index=True)
    up = rows.state.pitch_rad[first] > 0.0
    follows = np.append(False, up[1:] & ~up[:-1])
    yo = np.cumsum(~follows) - 1
    return np.asarray(yo[np.searchsorted(numbers, rows.glide)], dtype=np.intp)


def joined(parts: Sequence[GlideRows]) -> tuple[GlideRows, tuple[int, ...]]:
    """Return the rows of several records with glides numbered on.

    Beside them the record of each glide.
    """
    counts = [int(part.glide.max()) + 1 for part in parts]
    first = np.cumsum([0, *counts[:-1]])
    states = [part.state for part in parts]
    rows = GlideRows(
        np.concatenate([part.t_s for part in parts]),
        GlideState(
            np.concatenate([state.pitch_rad for state in states]),
            np.concatenate([state.drive_m3 for state in states]),
            np.concatenate([state.density_kg_m3 for state in states]),
            np.concatenate([state.pressure_pa for state in states]),
            np.concatenate([state.temperature_K for state in states]),
        ),
        np.concatenate([part.depth_rate_m_s for part in parts]),
        np.concatenate([part.speed_m_s for part in parts]),
        np.concatenate([part.glide + shift for part, shift in zip(parts, first, strict=True)]),
    )
    return rows, tuple(index for index, count in enumerate(counts) for _ in range(count))
