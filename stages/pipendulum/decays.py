"""Added mass and damping from free decays of a pendulum in water.

Equations of Alberti 2015.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.documents.apparatus import DecayEntry, FreeDecayEntry
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.bench.channel_records import BOTH, DAMPING, WRONG_SIGN, symbols
from auvid.hydro.identification.bench.free_decay import (
    Decay,
    DecayEstimate,
    Derivatives,
    HungPart,
    PendulumMoments,
    Ratios,
    clear_of_zero,
    derivatives,
    estimate_decay,
    pendulum_moments,
    prediction_error,
)
from auvid.hydro.identification.bench.output_error import SingleRun
from auvid.hydro.identification.bench.persistence_of_excitation import NOT_EXCITED
from auvid.hydro.identification.bench.single_channel import choose_damping
from auvid.hydro.identification.bench.swing import (
    GONE,
    check_one_swing,
    check_rate,
    release_index,
    swing_back_period,
)
from auvid.stages.pipendulum.recordings import Logs, SwingRecording, naming
from auvid.stages.presentation import Figure, figure

MIN_SWINGS, GOOD_SWINGS = 0.5, 2.0
"""Swings before the rate falls to a twentieth: with less than half of one nothing
oscillates; below two the ratios hang on few turns.
"""
METHODS = ("output error", "recursive", "batch")


@dataclass(frozen=True)
class Apparatus:
    """Part `free_decay`: arm L [m], parts of the pendulum, the vehicle as it hangs."""

    arm: float
    parts: tuple[HungPart, ...]
    vehicle: HungPart
    gravity: float

    def hung(self, *, loaded: bool, point_mass: bool = False) -> PendulumMoments:
        """Return dry inertia and restoring moment; point_mass: all at the arm (66).

        Raises `DataError` where buoyancy exceeds weight.
        """
        parts = [*self.parts, self.vehicle] if loaded else list(self.parts)
        return pendulum_moments(parts, self.gravity, arm=self.arm if point_mass else None)


@dataclass(frozen=True)
class DecayRecording:
    """One recorded decay, its estimate, and the number of its swings."""

    recording: SwingRecording
    decay: Decay
    estimate: DecayEstimate
    swings: float


@dataclass(frozen=True)
class DecayResult:
    """One decay of the apparatus: derivatives by damping model and method.

    `held_out`: by damping model, RMS angle error [rad] on what was not fitted;
    `judged_on` says what that is. `hung` as the physical pendulum. `derivatives` has
    keys (damping model, method).
    """

    entry: DecayEntry
    recordings: tuple[DecayRecording, ...]
    chosen: str
    held_out: Mapping[str, float]
    judged_on: str
    hung: PendulumMoments
    arm: float
    derivatives: Mapping[tuple[str, str], Derivatives]
    point_mass: Derivatives

    @property
    def quantities(self) -> tuple[str, str, str]:
        """Return the names of added mass, linear and quadratic damping."""
        if self.entry.dof is None or self.entry.role == "empty_pendulum":
            return "added mass", "linear damping", "quadratic damping"
        names = symbols(self.entry.dof)
        return names.added, names.linear, names.quadratic


def apparatus_of(entry: FreeDecayEntry, vehicle: Vehicle) -> Apparatus:
    """Return the pendulum of an apparatus."""
    parts = [
        HungPart(
            part.mass.si,
            part.arm.si,
            part.displaced_mass.si,
            (part.displaced_arm or part.arm).si,
            part.inertia.si,
        )
        for part in entry.parts
    ]
    arm, hung, displaced = entry.arm.si, entry.vehicle_mass, entry.vehicle_displaced_mass
    mass = vehicle.mass_kg if hung is None else hung.si
    water = vehicle.displaced_mass_kg if displaced is None else displaced.si
    return Apparatus(arm, tuple(parts), HungPart(mass, arm, water, arm), vehicle.gravity)


def decays_of(part: FreeDecayEntry, logs: Logs, vehicle: Vehicle) -> list[DecayResult]:
    """Return all decays of part `free_decay`, the empty pendulum first.

    Raises `CampaignError` and `DataError` as their recordings do.
    """
    apparatus = apparatus_of(part, vehicle)
    # The sort is stable: the empty pendulum first, the others as they stand.
    order = sorted(enumerate(part.decays), key=lambda item: item[1].role != "empty_pendulum")
    has_empty = bool(order) and order[0][1].role == "empty_pendulum"
    results: list[DecayResult] = []
    for index, entry in order:
        empty = results[0] if has_empty and results else None
        results.append(_decay(entry, f"free_decay.decays[{index}]", apparatus, logs, empty))
    return results


def _decay(
    entry: DecayEntry, field: str, apparatus: Apparatus, logs: Logs, empty: DecayResult | None
) -> DecayResult:
    loaded = entry.role == "vehicle"
    hung = apparatus.hung(loaded=loaded)
    pole = None if empty is None else empty.derivatives[empty.chosen, "output error"]
    pole_ratios = (
        (0.0, 0.0)
        if pole is None
        else tuple(pole.values[1:] * apparatus.arm ** np.array([2.0, 3.0]) / hung.stiffness)
    )
    recordings = [logs.recording(leg, f"{field}.legs", upright=False) for leg in entry.legs]
    training = [
        _decay_recording(item, (float(pole_ratios[0]), float(pole_ratios[1])))
        for item in recordings
        if not item.validation
    ]
    if not training:
        raise CampaignError(
            "a decay needs a leg of use training",
            field=f"{field}.legs",
            value=", ".join(entry.legs),
        )
    others = [
        replace(prepared(item)[0], pole=(float(pole_ratios[0]), float(pole_ratios[1])))
        for item in recordings
        if item.validation
    ]
    if others:
        judged_on = "the validation leg" + ("s" if len(others) > 1 else "")
        pairs = [(decay, item.estimate.output_error) for decay in others for item in training]
        held_out = {
            name: _root_mean([prediction_error(decay, ratios[name]) for decay, ratios in pairs])
            for name in DAMPING
        }

    else:
        judged_on = "the last swings"
        held_out = {
            name: _root_mean([item.estimate.output_error[name].held_out_rad for item in training])
            for name in DAMPING
        }
    chosen = choose_damping(
        held_out, *clear_of_zero(training[0].estimate.output_error[BOTH], training[0].decay.pole)
    )
    results = {}
    for name in DAMPING:
        for method in METHODS:
            each = [
                derivatives(
                    _ratios(item.estimate, method)[name], hung, arm=apparatus.arm, empty=pole
                )
                for item in training
            ]
            results[name, method] = mean_of(each)
    point = apparatus.hung(loaded=loaded, point_mass=True)
    pole_point = None if empty is None else empty.point_mass
    points = [
        derivatives(item.estimate.output_error[chosen], point, arm=apparatus.arm, empty=pole_point)
        for item in training
    ]
    return DecayResult(
        entry,
        tuple(training),
        chosen,
        held_out,
        judged_on,
        hung,
        apparatus.arm,
        results,
        mean_of(points),
    )


def _ratios(estimate: DecayEstimate, method: str) -> Mapping[str, Ratios]:
    return {
        "output error": estimate.output_error,
        "recursive": estimate.recursive,
        "batch": estimate.batch,
    }[method]


def _decay_recording(recording: SwingRecording, pole_ratios: tuple[float, float]) -> DecayRecording:
    decay, swings = prepared(recording)
    decay = replace(decay, pole=pole_ratios)
    with naming(recording.leg):
        return DecayRecording(recording, decay, estimate_decay(decay), swings)


def prepared(recording: SwingRecording) -> tuple[Decay, float]:
    """Return the decay from its release on, and how many swings it made.

    Raises `DataError` for an overdamped one or too few swings.
    """
    t, rate = recording.t_s, recording.rate
    first = release_index(rate)
    if t.size - first < 32:
        words = f"too few samples after the release in leg '{recording.leg}'"
        raise DataError(words, value=t.size - first, remedy="Record longer or faster.")
    with naming(recording.leg):
        period = swing_back_period(t[first:], rate[first:])
        check_rate(t, period)
        check_one_swing(t[first:], rate[first:], period)
    centred = np.abs(rate - np.median(rate))
    last = int(np.flatnonzero(centred > GONE * centred.max())[-1])
    swings = float((t[last] - t[first]) / period)
    if swings < MIN_SWINGS:
        raise DataError(
            f"too few swings in leg '{recording.leg}': {swings:.1f} before it has died down or the"
            " recording ends",
            allowed=f"at least {MIN_SWINGS:g}",
            remedy="Add weight or take a longer arm, so that it swings on; record longer.",
        )
    rows = np.flatnonzero(recording.usable & (np.arange(t.size) >= first))
    start = float(t[first])
    angle = None if recording.angle is None else recording.angle.between(start, np.inf)
    if angle is not None and angle.t_s.size < 2:
        angle = None
    grid = np.unique(np.concatenate([t[rows], [] if angle is None else angle.t_s]))
    still: Array = np.zeros(grid.size - 1)
    none, empty = np.zeros(0, dtype=np.intp), np.zeros(0)
    run = SingleRun(
        grid,
        still,
        still,
        np.searchsorted(grid, t[rows]),
        rate[rows],
        none if angle is None else np.searchsorted(grid, angle.t_s),
        empty if angle is None else angle.values[:, 0],
    )
    # Without an angle the first guess of the release is the amplitude that the rate and
    # the period tell.
    guess = float(centred.max() * period / (2.0 * np.pi)) * -float(np.sign(rate[first]))
    begin = np.array([rate[rows[0]], angle.values[0, 0] if angle is not None else guess])
    return Decay(run, begin, 2.0 * np.pi / period), swings


def mean_of(items: Sequence[Derivatives]) -> Derivatives:
    """Return the mean of repeated decays.

    Errors as if independent, or as the repeats scatter where that is more.
    """
    values = np.mean([item.values for item in items], axis=0)
    covariance = np.mean([item.covariance for item in items], axis=0) / len(items)
    if len(items) == 1:
        return Derivatives(values, covariance)
    scatter = np.var([item.values for item in items], axis=0, ddof=1) / len(items)
    widen = np.sqrt(
        np.maximum(1.0, scatter / np.maximum(np.diag(covariance), np.finfo(float).tiny))
    )
    return Derivatives(values, covariance * np.outer(widen, widen))


def measured_rate(run: SingleRun) -> Array:
    """Return the measured rate [rad/s] on a run's grid (n,), linear between samples."""
    return np.interp(run.grid_s, run.grid_s[run.rate_at], run.rate)


def decay_figures(decays: Sequence[DecayResult]) -> list[Figure]:
    """Return the derivatives of every decay.

    Names: `surge: X_udot`, `surge: X_udot (linear)`,
    `surge: X_udot (linear, recursive)` ...
    """
    rows: list[Figure] = []
    for item in decays:
        name, units = item.entry.id, ("kg", "kg/s", "kg/m")
        excited = item.recordings[0].estimate.excitation
        blocks = [("", item.chosen, "output error")]
        blocks += [(f" ({damping})", damping, "output error") for damping in DAMPING]
        blocks += [
            (f" ({damping}, {method})", damping, method)
            for damping in DAMPING
            for method in METHODS[1:]
        ]
        for suffix, damping, method in blocks:
            result = item.derivatives[damping, method]
            has = (True, *DAMPING[damping])
            for index, quantity in enumerate(item.quantities):
                if not has[index]:
                    continue
                value, error = float(result.values[index]), float(result.standard_errors[index])
                verdict = (
                    _verdict(value, error, excited.status == NOT_EXCITED)
                    if method == "output error"
                    else None
                )
                note = f"{damping} damping, output error" if not suffix else None
                headline = not suffix and item.entry.role == "vehicle"
                rows.append(
                    figure(
                        f"{name}: {quantity}{suffix}",
                        value,
                        units[index],
                        error,
                        verdict=verdict,
                        note=note,
                        headline=headline,
                    )
                )
        point = item.point_mass
        for index, quantity in enumerate(item.quantities):
            if (True, *DAMPING[item.chosen])[index]:
                rows.append(
                    figure(
                        f"{name}: {quantity} (point mass)",
                        point.values[index],
                        units[index],
                        point.standard_errors[index],
                    )
                )
        rows += _decay_errors(name, item)
        run = item.recordings[0].decay.run
        speed = item.arm * float(np.max(np.abs(run.rate)))
        rows.append(
            figure(f"{name}: largest speed", speed, "m/s", note="measured rate times the arm")
        )
        rows.append(
            figure(
                f"{name}: smallest eigenvalue of C_n",
                float(excited.smallest[-1]),
                "1",
                note="a free decay is never persistently exciting (52)",
            )
        )
        rows.append(
            figure(
                f"{name}: {item.quantities[0]} per 1 % of restoring moment", sensitivity(item), "kg"
            )
        )
    return rows


def _verdict(value: float, error: float, still: bool) -> str:
    if still:
        return NOT_EXCITED
    return "weak" if abs(value) < 2.0 * error else WRONG_SIGN if value > 0.0 else "identified"


def sensitivity(item: DecayResult) -> float:
    """Return the change of added mass [kg] per 1 % of restoring moment.

    -0.01 (G/k) / L^2.
    """
    k = float(item.recordings[0].estimate.output_error[item.chosen].values[0])
    return -0.01 * item.hung.stiffness / k / item.arm**2


def _decay_errors(name: str, item: DecayResult) -> list[Figure]:
    rows = []
    for damping in DAMPING:
        rmse = {
            method: _root_mean(
                [_ratios(one.estimate, method)[damping].rmse_rad for one in item.recordings]
            )
            for method in METHODS
        }
        rows.append(figure(f"{name}: rmse ({damping})", rmse["output error"], "rad"))
        rows += [
            figure(f"{name}: rmse ({damping}, {method})", rmse[method], "rad")
            for method in METHODS[1:]
        ]
        rows.append(figure(f"{name}: rmse held out ({damping})", item.held_out[damping], "rad"))
    return rows


def _root_mean(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
