"""Least squares of settled glides: residuals, slopes, search and clustered errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.arrays import Array, Index, Mask
from auvid.hydro.dynamics.gliding.steady_glide import (
    GliderBody,
    Polar,
    SteadyGlide,
    slow_change,
    steady_glide,
)
from auvid.hydro.identification.glide.bins import GlideRows, yos_of

UNKNOWNS = ("C_D0", "C_D1", "C_L_alpha", "alpha_0", "trim", "mass")
"""Drag without lift, induced drag [1/rad^2], slope of the lift [1/rad], angle without
lift [rad], trim: hull volume beyond that of the neutral glider [m^3], mass [kg] (never
fitted: with the trim free it scales what layers of water do, no more).
"""
STEPS = 60
REWEIGHTINGS = 3
OF_FILE = -1
"""Yo of a pull of the vehicle file."""


@dataclass(frozen=True)
class FileFigure:
    """Mean and standard deviation of an unknown in the vehicle file."""

    mean: float
    sd: float


@dataclass(frozen=True)
class Pull:
    """What the file says of a free unknown: (value - mean) sqrt(colour) / sd."""

    name: str
    figure: FileFigure
    colour: float

    def residual(self, values: Array) -> float:
        """Return the residual at values of UNKNOWNS."""
        away = float(values[UNKNOWNS.index(self.name)]) - self.figure.mean
        return away * float(np.sqrt(self.colour)) / self.figure.sd


def polar_of(values: Array) -> Polar:
    """Return drag and lift of the values of UNKNOWNS."""
    return Polar(*(float(value) for value in values[:4]))


@dataclass
class GlideProblem:
    """Rows of glides with their noise; `solve` sets the noise by the residuals."""

    rows: GlideRows
    body: GliderBody
    measured: Mask
    noise: Array
    pulls: tuple[Pull, ...] = ()

    @property
    def yo(self) -> Index:
        """Return the yo of every residual, `OF_FILE` of pulls."""
        yos = yos_of(self.rows)
        pulls = np.full(len(self.pulls), OF_FILE, dtype=yos.dtype)
        return np.concatenate([yos, yos[self.measured], pulls])

    @property
    def speeds(self) -> slice:
        """Return where the residuals of the speed are."""
        split = self.rows.t_s.size
        return slice(split, split + int(self.measured.sum()))

    def residuals(self, values: Array) -> Array:
        """Return residuals of depth rate and speed over their noise, and the pulls."""
        glide = glide_of(values, self.rows, self.body)
        depth_rate = self.rows.depth_rate_m_s - glide.depth_rate_m_s
        speed = (self.rows.speed_m_s - glide.speed_m_s)[self.measured]
        pulls = np.array([pull.residual(values) for pull in self.pulls])
        parts = [depth_rate / self.noise[0], speed / self.noise[1], pulls]
        return np.asarray(np.nan_to_num(np.concatenate(parts), nan=np.inf))

    def slopes(self, values: Array) -> Array:
        """Return the slopes of the residuals by UNKNOWNS."""
        return slopes_of(self.residuals, values)

    def solve(self, values: Array, free: list[str]) -> Array:
        """Return the values of least cost; the noise follows from their residuals."""
        for _ in range(REWEIGHTINGS):
            values = self._gauss_newton(values, [UNKNOWNS.index(name) for name in free])
            residual, split = self.residuals(values), self.rows.t_s.size
            self.noise = self.noise * [rms_of(residual[:split]), rms_of(residual[self.speeds])]
        return values

    def _gauss_newton(self, values: Array, free: list[int]) -> Array:
        """Return the values of least cost; steps that raise it are halved."""
        residual = self.residuals(values)
        best = float(residual @ residual)
        for _ in range(STEPS):
            jacobian = self.slopes(values)[:, free]
            scale = np.linalg.norm(jacobian, axis=0)
            if not (np.isfinite(scale).all() and scale.all()):
                return values  # one that moves nothing there: `standard_errors` says so
            step = np.zeros(values.size)
            step[free] = -np.linalg.lstsq(jacobian / scale, residual, rcond=1e-12)[0] / scale
            share, cost = 1.0, np.inf
            while share > 1e-6:
                trial = values + share * step
                if trial[0] > 0.0 and trial[2] > 0.0:
                    left = self.residuals(trial)
                    cost = float(left @ left)
                    if cost <= best:
                        break
                share /= 2.0
            else:
                return values
            done = best - cost < 1e-10 * max(best, 1.0)
            values, best, residual = trial, cost, left
            if done:
                break
        return values

    def standard_errors(self, values: Array, free: list[str]) -> Array:
        """Return the standard errors of free unknowns by the record.

        Infinite where it does not tell one of them.
        """
        jacobian = self.slopes(values)[:, [UNKNOWNS.index(name) for name in free]]
        if not (np.isfinite(jacobian).all() and jacobian.any(axis=0).all()):
            return np.full(len(free), np.inf)
        return np.sqrt(np.diag(clustered_covariance(jacobian, self.residuals(values), self.yo)))


def rms_of(values: Array) -> float:
    return max(float(np.sqrt(np.mean(values**2))), 1e-6) if values.size else 1.0


def glide_of(values: Array, rows: GlideRows, body: GliderBody) -> SteadyGlide:
    """Return the motion at rows: steady, with the lag of slow changes in each glide."""
    body, trim = replace(body, mass_kg=float(values[5])), float(values[4])
    steady = steady_glide(rows.state, body=body, polar=polar_of(values), trim_m3=trim)
    return slow_change(steady, rows.state, body=body, trim_m3=trim, t_s=rows.t_s, part=rows.glide)


def slopes_of(function: Callable[[Array], Array], values: Array) -> Array:
    """Return the derivatives (n, 6) by UNKNOWNS, by central differences."""
    columns = []
    for index, value in enumerate(values):
        step = np.zeros(values.size)
        step[index] = 1e-6 * max(abs(value), 1e-3)
        columns.append((function(values + step) - function(values - step)) / (2.0 * step[index]))
    return np.stack(columns, axis=-1)


def inverse_of(jacobian: Array) -> Array:
    """Return H^-1 (k, k) of H = J' J."""
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / scale
    return np.asarray(np.linalg.pinv(scaled.T @ scaled, rcond=1e-14) / np.outer(scale, scale))


def clustered_covariance(jacobian: Array, residual: Array, yo: Index) -> Array:
    """Return H^-1 (sum_g s_g s_g') H^-1 (k, k), H = J' J, s_g as in `fit_glides`.

    Of pulls H alone has a share: `_estimate` adds their spread.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / scale
    inverse = inverse_of(scaled)
    meat = np.zeros_like(inverse)
    for number in np.unique(yo[yo != OF_FILE]):
        part, left = scaled[yo == number], residual[yo == number]
        score = part.T @ np.linalg.solve(np.eye(left.size) - part @ inverse @ part.T, left)
        meat += np.outer(score, score)
    return np.asarray(inverse @ meat @ inverse / np.outer(scale, scale))
