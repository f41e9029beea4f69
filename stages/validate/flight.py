"""The chosen model flown over the measured motion, with a band of its doubt.

Draws of its coefficients fly beside it, each under a force that wanders as the error of
training did, larger where the actuators push harder than there. Ten or more validation
legs widen the band to what legs really did.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import AXES, Array, Index
from auvid.hydro.dynamics.simulation.free_run import (
    MeasuredMotion,
    WanderingForce,
    fly_freely,
    wrapped,
)
from auvid.hydro.dynamics.simulation.growth import Growth, growth
from auvid.hydro.dynamics.steady_motion import TILT_STATES
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.constrained.draws import (
    draw_within,
    flown_limits,
    joint_covariance,
)
from auvid.hydro.identification.constrained.equations import (
    Unknown,
    added_mass_change,
    added_mass_unknown,
)
from auvid.hydro.identification.constrained.limits import inertia_limits
from auvid.hydro.identification.regression.assumed_figures import UNSTEADY, total_error
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.selection.conformal import LEAST_LEGS, conformal_scale
from auvid.stages.card_errors import axis_errors
from auvid.stages.columns import ATTITUDE, VELOCITY
from auvid.stages.free_run import COMPARED

LEVEL = 0.9
"""Share of the time that a band is to hold."""
SHOWN_S = 0.1
SHORTEST_S = 2.0
"""A window that the end of the data cuts shorter than this is left out."""
WINDOWS, FEWEST = 4, 50
"""All draws fly over this many windows; over more, fewer of them, at least so many."""
NAMES = (*VELOCITY, *ATTITUDE)
LOW, HIGH = (tuple(name.replace("_", f"_{edge}_", 1) for name in NAMES) for edge in ("low", "high"))


@dataclass(frozen=True)
class ModelDraws:
    """Models drawn from a posterior, with constant forces (n, 6) and inertia (n, 6, 6).

    moved: how many lay outside the physical limits and are at the nearest point within;
    outside: by limit, where one draw may count for several.
    """

    models: tuple[IdentifiedModel, ...]
    trims: Array
    added_mass: Array
    moved: int = 0
    outside: Mapping[str, int] = field(default_factory=dict)

    def first(self, count: int) -> ModelDraws:
        """Return the first so many."""
        return replace(
            self,
            models=self.models[:count],
            trims=self.trims[:count],
            added_mass=self.added_mass[:count],
        )


@dataclass(frozen=True)
class FreeFlight:
    """A free run over one segment: times (k,), and states (k, 9) of `NAMES`.

    Restarted from the measured state at `starts_s`, with a row of nan before. low, high:
    edges of the band. flown, lost: draws in the first window, and how many of them left
    all bounds in any. cause: what grows fastest in the one lost first, until then.
    """

    t_s: Array
    measured: Array
    simulated: Array
    low: Array
    high: Array
    starts_s: tuple[float, ...]
    flown: int
    lost: int
    cause: Growth | None = None

    def coverage(self) -> Array:
        """Return the share (9,) of the time that the measured state is in the band."""
        there = np.isfinite(self.low) & np.isfinite(self.high)
        inside = (self.low <= self.measured) & (self.measured <= self.high)
        return np.asarray(np.sum(inside & there, axis=0) / np.maximum(np.sum(there, axis=0), 1))

    def score(self) -> Array:
        """Return how much (9,) the band must widen to hold `LEVEL` of a segment."""
        half = np.maximum(self.high - self.low, 1e-12) / 2.0
        return np.nanquantile(np.abs(self.measured - self.simulated) / half, LEVEL, axis=0)

    def widened(self, scale: Array) -> FreeFlight:
        """Return the flight with a band scale (9,) times as wide, about the run."""
        half = scale * (self.high - self.low) / 2.0
        return replace(self, low=self.simulated - half, high=self.simulated + half)

    def table(self) -> pa.Table:
        """Return the artefact `simulated_motion`."""
        columns = {"t_s": self.t_s}
        for names, values in ((NAMES, self.simulated), (LOW, self.low), (HIGH, self.high)):
            columns |= {name: values[:, i] for i, name in enumerate(names)}
        return make_table("simulated_motion", columns)


def draw_models(card: ModelCard, vehicle: Vehicle, *, count: int, seed: int) -> ModelDraws:
    """Return models drawn from the coefficients of a card, within its limits.

    They have the covariance of the printed intervals: noise axis by axis, each number of
    an assumed figure once for all axes. Inertia counts as independent, without what an unsteady
    force leans, as coefficients do. What the card has no
    error of stays as it is. A draw outside the limits counts at the nearest point within
    (`draw_within`).
    """
    unknowns = [Unknown(axis, term) for axis, row in card.predictor.items() for term in row]
    values = [card.predictor[unknown.axis][unknown.term] for unknown in unknowns]
    unknowns += [added_mass_unknown(item.name) for item in card.inertia]
    values += [item.change for item in card.inertia]
    covariance = joint_covariance(axis_errors(card, unknowns), len(unknowns))
    for item in card.inertia:
        i = unknowns.index(added_mass_unknown(item.name))
        shifts = {name: x for name, x in item.assumed_shifts.items() if name != UNSTEADY}
        covariance[i, i] = total_error(item.standard_error or 0.0, shifts) ** 2
    flown = {name: (span.low, span.high) for name, span in card.conditions.items()}
    rows, cuts = flown_limits(unknowns, card.damping, flown)
    inertia_rows, inertia_cuts = inertia_limits(unknowns, vehicle.added_mass, vehicle.mass_matrix)
    rows, cuts = [*rows, *inertia_rows], [*cuts, *inertia_cuts]
    drawn = draw_within(unknowns, np.array(values), covariance, rows, cuts, count=count, seed=seed)
    kept = drawn.values
    models: list[IdentifiedModel] = []
    trims, added_mass = np.zeros((len(kept), 6)), np.zeros((len(kept), 6, 6))
    for number, draw in enumerate(kept):
        coefficients: dict[str, dict[str, float]] = {axis: {} for axis in AXES}
        inertia = {}
        for unknown, value in zip(unknowns, draw.tolist(), strict=True):
            if unknown.term == CONSTANT:
                trims[number, AXES.index(unknown.axis)] = value
            elif unknown.term in card.predictor.get(unknown.axis, {}):
                coefficients[unknown.axis][unknown.term] = value
            else:
                inertia[unknown] = value
        models.append(IdentifiedModel(card.name, coefficients))
        added_mass[number] = added_mass_change(inertia)
    return ModelDraws(tuple(models), trims, added_mass, drawn.moved, drawn.outside)


def force_errors(
    card: ModelCard, samples_per_one: Mapping[str, float], step_s: float
) -> tuple[Array, Array]:
    """Return size (6,) [N, N m], memory (6,) [s] of a card's force error in training.

    Of filter error the unsteady force that it was fitted with, over the legs. Else of the
    residual force: a first-order autoregression of which R samples count as one has the
    coefficient (R - 1) / (R + 1) from sample to sample.
    """
    fit = card.likelihood
    if fit is not None and fit.force_time_s is not None:
        squares = [[leg.force_sd[axis] ** 2 for axis in AXES] for leg in fit.legs if leg.force_sd]
        memory = np.array([fit.force_time_s[axis] for axis in AXES])
        return np.sqrt(np.mean(squares, axis=0)), memory
    ratio = np.maximum([samples_per_one.get(axis, 1.0) for axis in AXES], 1.001)
    memory = step_s / np.log((ratio + 1.0) / (ratio - 1.0))
    return np.array([card.axes[axis].j or 0.0 for axis in AXES]), memory


def grown_errors(size: Array, usual: Array, acting: Array) -> Array:
    """Return force errors (6,) of training where actuators push harder [N, N m].

    size acting / usual, within size and the larger of size and acting. usual, acting
    (6,): RMS force of the actuators in training and now. A model explains a share of the
    force, so what it leaves grows in proportion, up to the force itself.

    >>> size, usual, acting = np.array([[0.5, 0.5, 0.5], [2.0, 4.0, 0.1], [6.0, 1.0, 3.0]])
    >>> grown_errors(size, usual, acting).tolist()
    [1.5, 0.5, 3.0]
    """
    grown = np.divide(size * acting, usual, out=size.copy(), where=usual > 0.0)
    return np.clip(grown, size, np.maximum(size, acting))


def fly(
    vehicle: Vehicle,
    model: ModelDraws,
    draws: ModelDraws,
    motion: MeasuredMotion,
    *,
    window_s: float,
    errors: tuple[Array, Array],
    windows: int,
    minimum_speed: float,
    lag_s: float = 0.0,
) -> FreeFlight | None:
    """Return the flight of a model (draws of one) over a segment, None if too short.

    windows: how many there are in all segments, which decides how many draws fly.
    lag_s: of the actuators, in all of them.
    """
    stride = max(1, round(SHOWN_S / motion.step_s))
    starts = starts_of(motion, window_s)
    if not len(starts):
        return None
    count = min(len(draws.models), max(FEWEST, len(draws.models) * WINDOWS // windows))
    some = draws.first(count)
    lost, cause = np.zeros(count, dtype=bool), None
    parts: list[list[Array]] = []
    for number, start in enumerate(motion.samples(starts)):
        last = min(start + motion.samples(window_s), len(motion.t_s) - 1)
        # The next window has the last moment of this one.
        steps = np.arange(0, last - start + (number == len(starts) - 1), stride)

        def states(
            flown: ModelDraws,
            disturbance: WanderingForce | None,
            start: int = start,
            steps: Index = steps,
        ) -> tuple[Array, Array]:
            flights, gone = fly_freely(
                vehicle,
                flown.models,
                flown.trims,
                motion,
                first=np.array([start]),
                steps=steps,
                added_mass=flown.added_mass,
                minimum_speed=minimum_speed,
                disturbance=disturbance,
                lags_s=np.full(len(flown.models), lag_s),
            )
            return flights[:, 0][..., COMPARED], gone[:, 0]

        (run,), _ = states(model, None)
        wander = WanderingForce(np.tile(errors[0], (count, 1)), errors[1], seed=number * count)
        around, gone = states(some, wander)
        if cause is None and np.isfinite(gone).any():
            first = int(np.nanargmin(gone))
            inertia = replace(vehicle, added_mass=vehicle.added_mass + some.added_mass[first])
            flown = motion.some_states(start, float(gone[first]))
            cause = growth(inertia, some.models[first], flown[:, :6], flown[:, TILT_STATES])
        lost |= np.isfinite(gone)
        measured = motion.state[start + steps][:, COMPARED]
        measured[:, 8] = np.unwrap(measured[:, 8])
        off, spread = run - measured, around - run
        off[:, 6:], spread[..., 6:] = wrapped(off[:, 6:]), wrapped(spread[..., 6:])
        if lost.any():
            spread[np.isnan(spread)] = np.inf  # a lost draw is outside of any band
        with np.errstate(invalid="ignore"):  # between two lost draws
            edges = np.quantile(spread, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0], axis=0)
        if lost.any():
            edges[np.isnan(edges)] = np.inf
        run = measured + off
        times = motion.t_s[start + steps]  # a segment may begin after its start
        part = [times, measured, run, run + edges[0], run + edges[1]]
        if parts:  # a row of nan lets lines end before the run starts again
            gap = np.full((1, 9), np.nan)
            part = [np.append(times[0] - 0.5 * motion.step_s, times)] + [
                np.vstack([gap, values]) for values in part[1:]
            ]
        parts.append(part)
    t_s, measured, run, low, high = (np.concatenate(part) for part in zip(*parts, strict=True))
    began = tuple((motion.t_s[0] + starts).tolist())
    return FreeFlight(t_s, measured, run, low, high, began, count, int(np.sum(lost)), cause)


def starts_of(motion: MeasuredMotion, window_s: float) -> Array:
    """Return when a run starts again: every window that is not too short."""
    length = float(motion.t_s[-1] - motion.t_s[0])
    starts = np.arange(0.0, length, window_s)
    return starts[starts + min(SHORTEST_S, window_s) <= length]


def calibrated(flights: Sequence[FreeFlight]) -> list[FreeFlight]:
    """Return flights whose band each has the width that the other legs ask for.

    As they are for fewer than `LEAST_LEGS`.
    """
    if len(flights) < LEAST_LEGS:
        return list(flights)
    scores = np.array([flight.score() for flight in flights])
    return [
        flight.widened(conformal_scale(np.delete(scores, i, axis=0), LEVEL))
        for i, flight in enumerate(flights)
    ]
