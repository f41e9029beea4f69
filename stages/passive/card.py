"""The model file's card of a body without actuators: its drag, damping and righting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.records.models import (
    InertiaCard,
    ModelCard,
    RankingRecord,
    TermCard,
    VelocityRange,
    Verdict,
)
from auvid.data_schemas.records.partial import (
    AxisSource,
    LackingAxis,
    MassFreeFigure,
    PartialFigures,
    RightingMoment,
)
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.hydro.identification.passive.held_out import (
    coasts_held_out,
    fit_percent,
    swings_held_out,
)
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    WEAK,
    TermStatus,
    clear_of_zero,
)
from auvid.hydro.partial_model import apparent_inertia, unit_in
from auvid.stages import few_axes
from auvid.stages.columns import AXIS_UNITS
from auvid.stages.passive.figures import LETTERS, pooled
from auvid.stages.passive.motions import SWINGS, PassiveMotions, apparent_mass

NAME, TITLE = "passive", "Motion without thrust"
REMEDIES = {
    **dict.fromkeys("XY", "Tow the body along the axis with a force sensor, and let go."),
    "Z": "Let the body rise or sink, and log its depth.",
    **dict.fromkeys("KM", "Tilt the body, release it, and log the decay."),
    "N": "Turn the body, let go, and log the yaw rate.",
}


@dataclass(frozen=True)
class PassiveAxis:
    """Drag of one axis over its apparent inertia, or in newtons where `in_newtons`.

    `drag` (2,): D_1, D_2, positive, with covariance (2, 2); `stiffness`: restoring over
    inertia and its error, of a swing; `mass`: inertia that the motion itself tells, with
    its error; `verdicts` of D_1 and D_2; `repeated`: not of one swing.
    `error`: RMS of signal and of what the fit leaves.
    """

    axis: str
    drag: Array
    covariance: Array
    verdicts: tuple[Verdict, Verdict]
    by: str
    held_out: float | None
    trained: float
    samples: int
    rms: tuple[float, float]
    speeds: VelocityRange
    in_newtons: bool = False
    mass: tuple[float, float] | None = None
    stiffness: tuple[float, float] | None = None
    repeated: bool = True


def passive_card(motions: PassiveMotions, vehicle: Vehicle) -> ModelCard | None:
    """Return the card of all axes that move; None where only the water did.

    In newtons where a tow gives them, an axis without one then by the apparent inertia of
    the vehicle file; else in shares of the inertia of the first axis.
    """
    fitted = passive_axes(motions)
    if not fitted:
        return None
    in_newtons = any(item.in_newtons for item in fitted)
    unit = None if in_newtons else fitted[0].axis
    by_axis = {item.axis: item for item in fitted}
    axes = {}
    for axis in AXES:
        head = AXIS_UNITS[axis] if unit is None else unit_in(axis, "constant", unit)
        if axis not in by_axis:
            axes[axis] = few_axes.empty_axis_card(head)
            continue
        item = by_axis[axis]
        terms, covariance = _terms(item, unit, vehicle)
        axes[axis] = few_axes.axis_card(head, terms, covariance, samples=item.samples, rms=item.rms)
    count = sum(len(part.terms) for part in axes.values())
    return ModelCard(
        name=NAME,
        title=TITLE,
        vehicle=vehicle.title,
        source="drag of each axis by its own velocity",
        n_bar=count,
        n_bar_declared=count,
        rank=count,
        samples=sum(item.samples for item in fitted),
        trim=False,
        assumed=list(vehicle.assumed),
        axes=axes,
        not_applicable=[],
        conditions={VELOCITIES[AXES.index(item.axis)]: item.speeds for item in fitted},
        predictor=few_axes.predictor_of(axes),
        method="passive motion",
        damping="negative",
        inertia=[_inertia(item, vehicle) for item in fitted if item.mass is not None],
        partial=PartialFigures.model_validate(
            {
                "unit_of_mass": unit,
                "axes": {
                    item.axis: AxisSource(
                        source="fitted",
                        name=item.by,
                        held_out_percent=item.held_out,
                        lag_s=0.0,
                        lag_verdict="assumed",
                    )
                    for item in fitted
                },
                "lacking": {axis: _lacking(motions, axis) for axis in AXES if axis not in by_axis},
                "without_newtons": [
                    figure for item in fitted if not item.in_newtons for figure in _shares(item)
                ],
                "gains": [],
                "righting": _righting(fitted, unit, vehicle),
            }
        ),
    )


def passive_ranking(card: ModelCard | None, motions: PassiveMotions) -> RankingRecord:
    """Return which axes simulate: by stretches that were left out of the fit."""
    if card is None:
        return RankingRecord(
            models=[],
            choice=None,
            rule="nothing but a drift",
            legs_left_out=0,
            horizon_s=None,
            usable=None,
        )
    trained = {item.axis: item.trained for item in passive_axes(motions)}
    rule = "stretches of tow, coasts and swings that were held out, axis by axis"
    return few_axes.ranking(card, trained, rule=rule)


def passive_axes(motions: PassiveMotions) -> list[PassiveAxis]:
    """Return what each axis gives, in their order; of tow and coasts the tow."""
    fitted = {
        LETTERS[name][0]: _of_swings(motions, name) for name in SWINGS if name in motions.swings
    }
    fitted |= {LETTERS[name][0]: _of_coasts(motions, name) for name in motions.coast_fits}
    fitted |= {LETTERS[name][0]: _of_tow(motions, name) for name in motions.tow_fits}
    return [fitted[axis] for axis in AXES if axis in fitted]


def _of_tow(motions: PassiveMotions, channel: str) -> PassiveAxis:
    fit = motions.tow_fits[channel]
    weak = not (fit.free[1] and fit.free[2]) or channel in motions.odd
    errors = np.sqrt(np.diag(fit.covariance))
    verdicts = [_verdict(fit.values[at], errors[at], weak=weak) for at in (1, 2)]
    about = float(np.sqrt(np.mean((fit.forces_N - fit.forces_N.mean()) ** 2)))
    return PassiveAxis(
        LETTERS[channel][0],
        fit.values[1:],
        fit.covariance[1:, 1:],
        (verdicts[0], verdicts[1]),
        f"{len(motions.tows[channel])} tows, {fit.forces_N.size} windows",
        _percent_of_share(fit.held_out),
        100.0 * (1.0 - fit.residual_N / about),
        fit.forces_N.size,
        (about, fit.residual_N),
        few_axes.speed_range(fit.speeds),
        in_newtons=True,
        mass=(float(fit.values[0]), float(errors[0])) if fit.free[0] else None,
    )


def _percent_of_share(share: float) -> float | None:
    """Return 100 (1 - |error| / |departure|) of a share of the scatter."""
    return 100.0 * (1.0 - float(np.sqrt(1.0 - share))) if np.isfinite(share) else None


def _of_coasts(motions: PassiveMotions, channel: str) -> PassiveAxis:
    fit = motions.coast_fits[channel]
    records = [motions.coasts[channel][at][1] for at in fit.used]
    pairs = [
        (record.thinned().speed, simulated)
        for record, simulated in zip(records, fit.simulated, strict=True)
    ]
    guessed = channel in motions.guessed
    errors = np.sqrt(np.diag(fit.covariance))
    verdicts = [
        _verdict(value, error, weak=guessed or value <= 0.0)
        for value, error in zip(fit.drag, errors, strict=True)
    ]
    return PassiveAxis(
        LETTERS[channel][0],
        fit.drag,
        fit.covariance,
        (verdicts[0], verdicts[1]),
        f"{fit.coasts} coasts",
        coasts_held_out(records),
        fit_percent(pairs),
        sum(measured.size for measured, _ in pairs),
        _rms_of(pairs),
        few_axes.speed_range(np.concatenate([measured for measured, _ in pairs])),
    )


def _of_swings(motions: PassiveMotions, channel: str) -> PassiveAxis:
    swings = [swing for _, swing in motions.swings[channel]]
    values, errors = pooled(swings)
    pairs = [(swing.measured, swing.simulated) for swing in swings]
    verdicts = [
        _verdict(value, error, weak=value <= 0.0 or len(swings) == 1)
        for value, error in zip(values[1:], errors[1:], strict=True)
    ]
    rates = [np.gradient(swing.simulated, swing.t_s) for swing in swings]
    return PassiveAxis(
        LETTERS[channel][0],
        values[1:],
        np.diag(errors[1:] ** 2),
        (verdicts[0], verdicts[1]),
        f"{len(swings)} decay{'s' * (len(swings) != 1)}",
        swings_held_out(swings, lambda others: pooled(others)[0]),
        fit_percent(pairs),
        sum(measured.size for measured, _ in pairs),
        _rms_of(pairs),
        few_axes.speed_range(np.concatenate(rates)),
        stiffness=(float(values[0]), float(errors[0])),
        repeated=len(swings) > 1,
    )


def _rms_of(pairs: Sequence[tuple[Array, Array]]) -> tuple[float, float]:
    measured, fitted = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return (
        float(np.sqrt(np.mean((measured - measured.mean()) ** 2))),
        float(np.sqrt(np.mean((measured - fitted) ** 2))),
    )


def _verdict(value: float, error: float, *, weak: bool) -> TermStatus:
    return IDENTIFIED if not weak and clear_of_zero(value, error) else WEAK


def _terms(item: PassiveAxis, unit: str | None, vehicle: Vehicle) -> tuple[list[TermCard], Array]:
    """Return the terms that are not 0 with their covariance, as forces of the file."""
    size, spread = _size(item, unit, vehicle)
    axis, own = item.axis, VELOCITIES[AXES.index(item.axis)]
    names = (own, f"{own}*|{own}|")
    kept = [at for at in (0, 1) if item.drag[at] != 0.0]
    covariance = size**2 * item.covariance + spread**2 * np.outer(item.drag, item.drag)
    by_file = spread > 0.0
    terms = [
        TermCard(
            term=names[at],
            unit=coefficient_unit(axis, names[at])
            if unit is None
            else unit_in(axis, names[at], unit),
            value=-size * float(item.drag[at]),
            standard_error=float(np.sqrt(covariance[at, at])) or None,
            verdict="from the prior" if by_file else item.verdicts[at],
        )
        for at in kept
    ]
    return terms, covariance[np.ix_(kept, kept)]


def _size(item: PassiveAxis, unit: str | None, vehicle: Vehicle) -> tuple[float, float]:
    """Return what makes a force of drag over inertia, and its standard deviation."""
    if item.in_newtons:
        return 1.0, 0.0
    if unit is not None:
        return apparent_inertia(vehicle, item.axis) / apparent_inertia(vehicle, unit), 0.0
    channel = next(name for name, letters in LETTERS.items() if letters[0] == item.axis)
    return apparent_mass(vehicle, channel)


def _inertia(item: PassiveAxis, vehicle: Vehicle) -> InertiaCard:
    assert item.mass is not None
    value, error = item.mass
    in_file = apparent_inertia(vehicle, item.axis)
    return InertiaCard(
        name=f"{item.axis}_{VELOCITIES[AXES.index(item.axis)]}dot",
        unit="kg",
        value=value,
        standard_error=error,
        in_vehicle_file=in_file,
        change=in_file - value,
        beside_lag=in_file - value,
        beside_lag_error=error,
        lag_s=0.0,
        lag_error_s=0.0,
        correlation=0.0,
        verdict=_verdict(value, error, weak=False),
    )


def _shares(item: PassiveAxis) -> list[MassFreeFigure]:
    """Return drag over inertia and the frequency of a swing."""
    own = VELOCITIES[AXES.index(item.axis)]
    per = "1/m" if item.axis in "XYZ" else "1/rad"
    rows: list[tuple[str, float, float, str, Verdict]] = [
        (name, -float(item.drag[at]), float(item.covariance[at, at]) ** 0.5, unit,
         item.verdicts[at])
        for at, (name, unit) in enumerate(
            ((f"{item.axis}_{own}/M", "1/s"), (f"{item.axis}_{own}|{own}|/M", per))
        )
        if item.drag[at] != 0.0
    ]  # fmt: skip
    if item.stiffness is not None:
        k, error = item.stiffness
        row = ("undamped frequency", k**0.5, error / (2.0 * k**0.5), "rad/s")
        rows.append((*row, _verdict(k, error, weak=not item.repeated)))
    return [
        MassFreeFigure.model_validate(
            {
                "axis": item.axis,
                "quantity": name,
                "value": value,
                "unit": unit,
                "interval_95": [value - NORMAL_95 * error, value + NORMAL_95 * error],
                "verdict": verdict,
            }
        )
        for name, value, error, unit, verdict in rows
    ]


def _righting(
    fitted: Sequence[PassiveAxis], unit: str | None, vehicle: Vehicle
) -> RightingMoment | None:
    """Return the righting moment; of roll and pitch the mean by their errors."""
    rows = []
    for item in fitted:
        if item.stiffness is not None:
            size, spread = _size(item, unit, vehicle)
            k, error = item.stiffness
            rows.append((item.axis, size * k, float(np.hypot(size * error, spread * k))))
    if not rows:
        return None
    value, error = few_axes.mean_by_errors([row[1:] for row in rows])
    return RightingMoment.model_validate(
        {
            "axes": [row[0] for row in rows],
            "value": value,
            "unit": AXIS_UNITS["K"] if unit is None else unit_in("K", "constant", unit),
            "interval_95": [value - NORMAL_95 * error, value + NORMAL_95 * error],
        }
    )


def _lacking(motions: PassiveMotions, axis: str) -> LackingAxis:
    measured = axis in motions.by
    return LackingAxis(
        verdict="not excited" if measured else "not observable",
        words="no tow, coast or decay of it" if measured else "nothing measures it",
        remedy=REMEDIES[axis],
    )
