"""The model card, the ranking and the figures of fitted axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from auvid.data_schemas.records.models import (
    AxisCard,
    AxisMerit,
    CovarianceCard,
    InertiaCard,
    MeritRecord,
    ModelCard,
    RankingRecord,
    TermCard,
    UsableFor,
    VelocityRange,
    Verdict,
)
from auvid.data_schemas.records.partial import (
    AxisSource,
    CommandGain,
    LackingAxis,
    MassFreeFigure,
    PartialFigures,
)
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.axis_figures import (
    CONSTANT,
    FORCE,
    AxisForces,
)
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, WEAK
from auvid.hydro.partial_model import apparent_inertia
from auvid.stages.fit_axes.beside_damping import interval_95, righting_and_surge, unit_of
from auvid.stages.fit_axes.filling import FilledAxis
from auvid.stages.fit_axes.fitted import (
    SIMULATED_PERCENT,
    AxisFits,
    FittedAxis,
    Lacking,
    Together,
)
from auvid.stages.fit_axes.scaling import ScaledAxes
from auvid.stages.model_use import TILTS
from auvid.stages.page.first_screen import ALL, AXIS_WORDS

NAME, TITLE = "axes", "Axes of the log"
CONTROL_PERCENT = 50.0
"""Held-out fit from which on it is good for the design of a controller."""
REMEDIES = {
    **dict.fromkeys("XY", "Log a velocity (DVL) or a position (motion capture, USBL)."),
    "Z": "Log the depth while the vehicle moves up and down.",
    **dict.fromkeys("KM", "Tilt the vehicle, release it, and log the decay."),
    "N": "Log the gyro while the vehicle turns both ways.",
}
"""Axis -> what would give it, where nothing measures it, and of tilts at all."""
MOVE = "Drive the axis by itself, both ways, for some minutes."
"""What would give surge, sway, heave or yaw that is measured."""
REMEDY_OF = {
    "not commanded": "Command the axis both ways in a dive.",
    "left out": "Name it in stages.fit_axes.axes, or name none there.",
    "wrong sign": "Check the directions of the thrusters, the frame, and the signs of the columns.",
}
"""Verdict -> what would give an axis, where the verdict tells it."""
WORST = ("not excited", "inseparable", "weak", "at its bound", "from the prior", "identified")


def model_card(
    fits: AxisFits,
    scaled: ScaledAxes,
    filled: Sequence[FilledAxis],
    vehicle: Vehicle,
) -> ModelCard:
    """Return the card of all axes that were fitted or filled."""
    by_axis = {item.axis: item for item in fits.fitted}
    fill = {item.axis: item for item in filled}
    axes = {}
    for axis in AXES:
        if axis in by_axis:
            axes[axis] = _fitted_card(by_axis[axis], scaled, vehicle)
        else:
            axes[axis] = _empty_card(axis, scaled, fill[axis].terms if axis in fill else ())
    terms = [item for part in axes.values() for item in part.terms]
    return ModelCard(
        name=NAME,
        title=TITLE,
        vehicle=vehicle.title,
        source="damping of each axis by its own velocity, and what the log ties to it",
        n_bar=len(terms),
        n_bar_declared=len(terms),
        rank=sum(item.value is not None and item.source is None for item in terms),
        samples=sum(item.samples for item in fits.fitted),
        trim=True,
        assumed=list(vehicle.assumed),
        axes=axes,
        not_applicable=[],
        conditions={item.equation.speed: item.speeds for item in fits.fitted},
        predictor={
            axis: {item.term: item.value for item in part.terms if item.value is not None}
            for axis, part in axes.items()
        },
        method="axes",
        damping="negative",
        inertia=_inertias(by_axis, scaled, vehicle),
        partial=partial_figures(fits, scaled, filled),
    )


def partial_figures(
    fits: AxisFits, scaled: ScaledAxes, filled: Sequence[FilledAxis]
) -> PartialFigures:
    """Return axes, what is lacking, and figures that need no newtons."""
    fill = {item.axis for item in filled}
    sources = {
        item.axis: AxisSource(
            source="fitted",
            name=f"{item.windows} windows, {item.seconds:.0f} s, {item.measured_by}",
            held_out_percent=item.held_out_percent,
            lag_s=item.lag_s,
            lag_verdict=item.lag_verdict,
        )
        for item in fits.fitted
    }
    sources |= {item.axis: item.source for item in filled}
    return PartialFigures.model_validate(
        {
            "unit_of_mass": scaled.unit_of_mass,
            "axes": {axis: sources[axis] for axis in AXES if axis in sources},
            "lacking": {
                item.axis: lacking_axis(item) for item in fits.lacking if item.axis not in fill
            },
            "without_newtons": [
                figure for item in fits.fitted for figure in free_figures(item, fits.normalised)
            ],
            "gains": _gains(fits, scaled) if fits.normalised else [],
            **({} if scaled.scale is None else {"scale": scaled.scale}),
            **({} if fits.together is None else {"together": _together(fits.together)}),
            **righting_and_surge(fits, scaled),
        }
    )


def _together(item: Together) -> dict[str, object]:
    return {
        "axes": list(item.axes),
        "chosen": item.chosen,
        "error_ratio": item.error_ratio if np.isfinite(item.error_ratio) else None,
    }


def lacking_axis(item: Lacking) -> LackingAxis:
    """Return why an axis is lacking, and what would give it."""
    measured = item.verdict in ("not excited", "not predicted")
    by_axis = MOVE if measured and item.axis in "XYZN" else REMEDIES[item.axis]
    remedy = REMEDY_OF.get(item.verdict, by_axis)
    return LackingAxis(verdict=item.verdict, words=item.words, remedy=remedy)


def free_figures(item: FittedAxis, normalised: bool) -> list[MassFreeFigure]:
    """Return the figures of an axis that no newtons go into.

    Their verdict is the worst of the coefficients in them; what a full command gives is
    left out where the force is in newtons.
    """
    figures = []
    for quantity in item.quantities:
        full = "full command" in quantity.name
        if not np.isfinite(quantity.value) or (full and not normalised):
            continue
        terms = _terms_in(quantity.name, item.equation.names)
        acting = [name for name in terms if item.equation.value(name) != 0.0]
        if not acting or (
            len(acting) < len(terms) and quantity.name.startswith("time constant at")
        ):
            continue  # 0 at its bound, or what the time constant from rest says already
        figures.append(
            MassFreeFigure.model_validate(
                {
                    "axis": item.axis,
                    "quantity": quantity.name,
                    "value": quantity.value,
                    "unit": quantity.unit,
                    "interval_95": [quantity.low, quantity.high],
                    "verdict": _worst([item.verdict(name) for name in acting]),
                }
            )
        )
    return figures


def _terms_in(quantity: str, names: Sequence[str]) -> Sequence[str]:
    """Return the terms that a quantity follows from."""
    own, square, force = names[:3]
    if quantity == "full command/M":
        return (force,)
    if quantity.endswith("/M"):
        return (square,) if "|" in quantity else (own,)
    if quantity == "time constant from rest":
        return (own,)
    return (own, square) if quantity.startswith("time constant") else (own, square, force)


def ranking(card: ModelCard, fits: AxisFits) -> RankingRecord:
    """Return the record of the one model, by its fit on what was held out."""
    usable = usable_for(card)
    merit = MeritRecord(
        name=card.name,
        title=card.title,
        published=False,
        terms=card.n_bar,
        rank=card.rank,
        j=None,
        axes=_merits(card, fits),
        runs=0,
        lost=0,
        faults=[],
    )
    chosen = card.name if usable.simulation else None
    rule = "the fit on windows or legs that were held out, axis by axis"
    if chosen is None:
        rule = f"no axis reaches a fit of {SIMULATED_PERCENT:g} % on what was held out"
    return RankingRecord(
        models=[merit],
        choice=chosen,
        rule=rule,
        legs_left_out=0,
        horizon_s=None,
        usable=usable if usable.simulation else None,
    )


def usable_for(card: ModelCard) -> UsableFor:
    """Return which axes simulate, and which are good enough for a controller.

    Roll and pitch only with a righting moment that was fitted, not that of the vehicle file.
    """
    assert card.partial is not None
    righting = card.partial.righting
    fit = {
        axis: item.held_out_percent
        for axis, item in card.partial.axes.items()
        if axis not in TILTS or (righting is not None and axis in righting.axes)
    }

    def above(limit: float) -> list[str]:
        return [axis for axis, value in fit.items() if value is not None and value >= limit]

    damped = [
        axis
        for axis, part in card.axes.items()
        if any(
            item.verdict == IDENTIFIED and VELOCITIES[AXES.index(axis)] in item.term
            for item in part.terms
        )
    ]
    return UsableFor(
        forces=[],
        simulation=above(SIMULATED_PERCENT),
        control=[axis for axis in above(CONTROL_PERCENT) if axis in damped],
        speeds=card.conditions,
    )


def _merits(card: ModelCard, fits: AxisFits) -> dict[str, AxisMerit]:
    """Return errors of the rate over its departure from the mean, axis by axis."""
    by_axis = {item.axis: item for item in fits.fitted}
    merits = {}
    for axis, part in card.axes.items():
        item = by_axis.get(axis)
        fit = None if item is None else item.held_out_percent
        error = None if fit is None else 1.0 - fit / 100.0
        merits[axis] = AxisMerit(
            validation=error,
            training=None if item is None else 1.0 - item.training_percent / 100.0,
            left_out=None,
            bic=None,
            free_run=error,
            identified=sum(term.verdict == IDENTIFIED for term in part.terms),
            coefficients=len(part.terms),
        )
    errors = [m.validation for m in merits.values() if m.validation is not None]
    trained = [m.training for m in merits.values() if m.training is not None]
    return merits | {
        ALL: AxisMerit(
            validation=float(np.mean(errors)) if errors else None,
            training=float(np.mean(trained)) if trained else None,
            left_out=None,
            bic=None,
            free_run=None,
            identified=sum(m.identified for m in merits.values()),
            coefficients=sum(m.coefficients for m in merits.values()),
        )
    }


def _fitted_card(item: FittedAxis, scaled: ScaledAxes, vehicle: Vehicle) -> AxisCard:
    axis, forces = item.axis, scaled.forces[item.axis]
    kept = [place for place, name in enumerate(forces.names) if name != FORCE]
    return AxisCard(
        unit=unit_of(axis, CONSTANT, scaled),
        samples=item.samples,
        rank=len(kept),
        condition=None,
        j0=item.rate_rms,
        j=item.error_rms,
        excitation="excited",
        terms=[_term(item, forces, place, scaled, vehicle) for place in kept],
        covariance=CovarianceCard(
            terms=[forces.names[place] for place in kept],
            lower=[
                [float(forces.covariance[row, column]) for column in kept[: i + 1]]
                for i, row in enumerate(kept)
            ],
        ),
        combinations=[],
    )


def _term(
    item: FittedAxis, forces: AxisForces, place: int, scaled: ScaledAxes, vehicle: Vehicle
) -> TermCard:
    axis, name = item.axis, forces.names[place]
    value = float(forces.values[place])
    if name == CONSTANT:
        value -= _net_weight(axis, scaled, vehicle)
    error = float(np.sqrt(forces.covariance[place, place]))
    spread = vehicle.spreads.get("thrust")
    in_newtons = scaled.unit_of_mass is None and scaled.scale is None
    return TermCard(
        term=name,
        unit=unit_of(axis, name, scaled),
        value=value,
        standard_error=error or None,
        verdict=cast(Verdict, item.verdict(name)),
        assumed_shifts=(
            {"thrust": spread * abs(value)} if spread is not None and in_newtons else {}
        ),
    )


def _net_weight(axis: str, scaled: ScaledAxes, vehicle: Vehicle) -> float:
    """Return weight less buoyancy on an axis when level, in the unit of force."""
    if axis != "Z":
        return 0.0
    unit = scaled.unit_of_mass
    share = 1.0 if unit is None else apparent_inertia(vehicle, unit)
    return (vehicle.weight - vehicle.buoyancy) / share


def _empty_card(axis: str, scaled: ScaledAxes, terms: Sequence[TermCard]) -> AxisCard:
    return AxisCard(
        unit=unit_of(axis, CONSTANT, scaled),
        samples=0,
        rank=0,
        condition=None,
        j0=0.0,
        j=0.0,
        excitation="not excited",
        terms=list(terms),
        covariance=CovarianceCard(terms=[], lower=[]),
        combinations=[],
    )


def _inertias(
    by_axis: Mapping[str, FittedAxis], scaled: ScaledAxes, vehicle: Vehicle
) -> list[InertiaCard]:
    """Return the apparent inertia of each axis whose newtons are known."""
    if scaled.unit_of_mass is not None:
        return []
    cards = []
    for axis, item in by_axis.items():
        if item.inertia == "given":
            continue
        forces, in_file = scaled.forces[axis], apparent_inertia(vehicle, axis)
        change = in_file - forces.inertia
        cards.append(
            InertiaCard.model_validate(
                {
                    "name": f"{axis}_{item.equation.speed}dot",
                    "unit": "kg" if axis in "XYZ" else "kg m^2",
                    "value": forces.inertia,
                    "standard_error": forces.inertia_error,
                    "in_vehicle_file": in_file,
                    "change": change,
                    "beside_lag": change,
                    "beside_lag_error": forces.inertia_error,
                    "lag_s": item.lag_s,
                    "lag_error_s": item.lag_error_s,
                    "correlation": 0.0,
                    "verdict": _inertia_verdict(item),
                }
            )
        )
    return cards


def _inertia_verdict(item: FittedAxis) -> str:
    return IDENTIFIED if item.inertia == "determined" and item.predicts else WEAK


def _gains(fits: AxisFits, scaled: ScaledAxes) -> list[CommandGain]:
    gains = []
    for item in fits.fitted:
        forces = scaled.forces[item.axis]
        place = forces.names.index(FORCE)
        value = float(forces.values[place])
        error = float(np.sqrt(max(forces.covariance[place, place], 0.0)))
        gains.append(
            CommandGain.model_validate(
                {
                    "axis": item.axis,
                    "output": None,
                    "value": value,
                    "unit": unit_of(item.axis, CONSTANT, scaled),
                    "interval_95": interval_95(value, error),
                    "dead_band": item.dead_band,
                    "curve": item.curve,
                    "verdict": item.verdict(FORCE),
                }
            )
        )
    return gains


def _worst(verdicts: Sequence[str]) -> str:
    return next((word for word in WORST if word in verdicts), "weak")


def speed_range(values: Any) -> VelocityRange:
    """Return RMS and ends of measured velocities, nan left out."""
    finite = np.asarray(values)[np.isfinite(values)]
    return VelocityRange(
        rms=float(np.sqrt(np.mean(finite**2))),
        low=float(finite.min()),
        high=float(finite.max()),
    )


def words_of(axis: str) -> str:
    """Return an axis as `heave (Z)`."""
    return f"{AXIS_WORDS[axis]} ({axis})"
