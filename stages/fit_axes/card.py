"""The model card, the ranking and the figures of fitted axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from auvid.data_schemas.records.models import (
    AxisCard,
    InertiaCard,
    ModelCard,
    RankingRecord,
    TermCard,
    Verdict,
)
from auvid.data_schemas.records.partial import (
    AT_SPEED,
    AxisSource,
    CommandGain,
    LackingAxis,
    MassFreeFigure,
    PartialFigures,
    TotalDrag,
)
from auvid.hydro.arrays import AXES
from auvid.hydro.axis_figures import (
    CONSTANT,
    FORCE,
    AxisForces,
)
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.drive import MIXED
from auvid.hydro.identification.axes.quantities import WIDEST, FitQuantity
from auvid.hydro.identification.fleet.drag import drag_at_speed
from auvid.hydro.identification.regression.assumed_figures import INERTIA_RATIO, total_error
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    T_LIMIT,
    WEAK,
    stands_clear,
)
from auvid.hydro.partial_model import apparent_inertia
from auvid.stages import few_axes
from auvid.stages.columns import FINER_FIXES, TOO_COARSE
from auvid.stages.fit_axes.filling import FilledAxis
from auvid.stages.fit_axes.fitted import (
    AxisFits,
    FittedAxis,
    Lacking,
    Together,
)
from auvid.stages.fit_axes.scaling import (
    ScaledAxes,
    fitted_vehicle,
    interval_95,
    righting_and_surge,
    unit_of,
)
from auvid.stages.fit_axes.thrusters import share_of
from auvid.stages.page.first_screen import AXIS_WORDS

NAME, TITLE = "axes", "Axes of the log"
REMEDIES = {
    **dict.fromkeys("XY", "Log a velocity (DVL) or a position (motion capture, USBL)."),
    "Z": "Log the depth while the vehicle moves up and down.",
    **dict.fromkeys("KM", "Tilt the vehicle, release it, and log the decay."),
    "N": "Log the gyro while the vehicle turns both ways.",
}
"""Axis -> what would give it, where nothing measures it, and of tilts at all."""
MOVE = "Drive the axis by itself, both ways, for some minutes."
"""What would give surge, sway, heave or yaw that is measured."""
OUTPUTS_FIRST = (
    "Does one leg have another neutral of a command, or markers at another place?"
    " Is a motor reversed, are two outputs exchanged, is a pose's marker frame turned (in one leg"
    " or all), or is the frame another one (FRAME_CONFIG, MOT_n_DIRECTION, actuators of the vehicle"
    " file)? Else drive"
)
COMMAND = "Command the axis both ways in a dive"
ELSEWHERE = "ake its damping from a published set or a bench (`fill` of the campaign)."
REMEDY_OF = {
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
            elsewhere = fill[axis].terms if axis in fill else ()
            axes[axis] = few_axes.empty_axis_card(unit_of(axis, CONSTANT, scaled), elsewhere)
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
        predictor=few_axes.predictor_of(axes),
        method="axes",
        damping="negative",
        inertia=_inertias(by_axis, scaled, fitted_vehicle(fits, vehicle)),
        partial=partial_figures(fits, scaled, filled, vehicle),
    )


def partial_figures(
    fits: AxisFits, scaled: ScaledAxes, filled: Sequence[FilledAxis], vehicle: Vehicle
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
            "total_drag": total_drags(fits, scaled, vehicle),
            "gains": _gains(fits, scaled) if fits.normalised else [],
            "thrusters": [share_of(item) for item in fits.thrusters],
            **({} if scaled.scale is None else {"scale": scaled.scale}),
            **({} if fits.together is None else {"together": _together(fits.together)}),
            "inertia_shares": {
                axis: {"value": share, "interval_95": interval_95(share, error)}
                for axis, (share, error) in fits.inertia_shares.items()
            },
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
    remedy = REMEDY_OF.get(item.verdict, FINER_FIXES if TOO_COARSE in item.words else by_axis)
    if item.verdict == "not predicted" and by_axis is MOVE:
        remedy = f"{OUTPUTS_FIRST}{MOVE.removeprefix('Drive')}"
    if item.verdict == "not commanded" and item.axis in "XYZN":
        remedy = {
            True: f"T{ELSEWHERE}",
            False: f"{COMMAND}.",
            None: f"{COMMAND}; where no thruster acts along it, t{ELSEWHERE}",
        }[item.no_thruster]
    return LackingAxis(verdict=item.verdict, words=item.words, remedy=remedy)


def free_figures(item: FittedAxis, normalised: bool) -> list[MassFreeFigure]:
    """Return the figures of an axis that no newtons go into.

    Their verdict is the worst of the coefficients in them, but for the time constant at a
    speed: linear and quadratic drag trade, and it is surer than both. What a full command
    gives is left out where the force is in newtons.
    """
    figures = []
    for quantity in item.quantities:
        full = "full command" in quantity.name
        if not np.isfinite(quantity.value) or (full and not normalised):
            continue
        terms = _terms_in(quantity.name, item.equation.names)
        acting = [name for name in terms if item.equation.value(name) != 0.0]
        if not acting or (len(acting) < len(terms) and quantity.name.startswith(AT_SPEED)):
            continue  # 0 at its bound, or what the time constant from rest says already
        figures.append(
            MassFreeFigure.model_validate(
                {
                    "axis": item.axis,
                    "quantity": quantity.name,
                    "value": quantity.value,
                    "unit": quantity.unit,
                    "interval_95": [quantity.low, quantity.high],
                    "verdict": _figure_verdict(item, quantity, acting),
                }
            )
        )
    return figures


def _figure_verdict(item: FittedAxis, quantity: FitQuantity, acting: Sequence[str]) -> str:
    worst = _worst([item.verdict(name) for name in acting])
    if not quantity.name.startswith(AT_SPEED) or worst not in (IDENTIFIED, WEAK):
        return worst
    half = float(np.log(quantity.high / quantity.low)) / 2.0
    return IDENTIFIED if item.predicts and half * T_LIMIT <= NORMAL_95 else WEAK


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
    trained = {item.axis: item.training_percent for item in fits.fitted}
    rule = "the fit on windows or legs that were held out, axis by axis"
    return few_axes.ranking(card, trained, rule=rule)


def _fitted_card(item: FittedAxis, scaled: ScaledAxes, vehicle: Vehicle) -> AxisCard:
    axis, forces = item.axis, scaled.forces[item.axis]
    kept = [place for place, name in enumerate(forces.names) if name != FORCE]
    terms = [_term(item, forces, place, scaled, vehicle) for place in kept]
    shifts = np.array([term.assumed_shifts.get("thrust", 0.0) for term in terms])
    moved = shifts * np.sign(forces.values[kept])
    return few_axes.axis_card(
        unit_of(axis, CONSTANT, scaled),
        terms,
        forces.covariance[np.ix_(kept, kept)],
        samples=item.samples,
        rms=(item.rate_rms, item.error_rms),
        shifts={"thrust": moved} if shifts.any() else None,
    )


def _term(
    item: FittedAxis, forces: AxisForces, place: int, scaled: ScaledAxes, vehicle: Vehicle
) -> TermCard:
    axis, name = item.axis, forces.names[place]
    measured = float(forces.values[place])
    value = measured - (_net_weight(axis, scaled, vehicle) if name == CONSTANT else 0.0)
    error = float(np.sqrt(forces.covariance[place, place]))
    ratio_sd = scaled.ratio_sd.get(axis, 0.0)
    shifts = (
        {INERTIA_RATIO: ratio_sd * abs(measured)}
        if ratio_sd
        else _thrust_shift(measured, scaled, vehicle)
    )
    verdict = item.verdict(name)
    if verdict == IDENTIFIED and not stands_clear(value, error, shifts):
        verdict = WEAK  # sure over an inertia that is not
    return TermCard(
        term=name,
        unit=unit_of(axis, name, scaled),
        value=value,
        standard_error=error or None,
        verdict=cast(Verdict, verdict),
        assumed_shifts=shifts,
    )


def _thrust_shift(value: float, scaled: ScaledAxes, vehicle: Vehicle) -> dict[str, float]:
    """Return what one deviation of the thrust curve moves a force or an inertia by.

    All of them scale with it: in newtons the motion tells their ratio to the thrust. Where a
    pull or a mass gives newtons, its own error is in them.
    """
    spread = vehicle.spreads.get("thrust")
    in_newtons = scaled.unit_of_mass is None and scaled.scale is None
    return {"thrust": spread * abs(value)} if spread is not None and in_newtons else {}


def _net_weight(axis: str, scaled: ScaledAxes, vehicle: Vehicle) -> float:
    """Return weight less buoyancy on an axis when level, in the unit of force."""
    if axis != "Z":
        return 0.0
    unit = scaled.unit_of_mass
    share = 1.0 if unit is None else apparent_inertia(vehicle, unit)
    return (vehicle.weight - vehicle.buoyancy) / share


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
                    "assumed_shifts": _thrust_shift(forces.inertia, scaled, vehicle),
                }
            )
        )
    return cards


def _inertia_verdict(item: FittedAxis) -> str:
    return IDENTIFIED if item.inertia == "determined" and item.predicts else WEAK


def total_drags(fits: AxisFits, scaled: ScaledAxes, vehicle: Vehicle) -> list[TotalDrag]:
    """Return the drag of each axis at its RMS speed, over that speed, in newtons.

    Its interval is symmetric in its logarithm.
    """
    if scaled.unit_of_mass is not None:
        return []
    drags = []
    for item in fits.fitted:
        forces, speed = scaled.forces[item.axis], float(f"{item.rate_rms:.2g}")
        drag = drag_at_speed(
            forces.names, forces.values, forces.covariance, axis=item.axis, speed=speed
        )
        if drag is None or not 0.0 < NORMAL_95 * drag.standard_error < WIDEST * drag.force:
            continue  # no drag, or an interval that says nothing
        value, error = drag.force / speed, drag.standard_error / speed
        shifts = _thrust_shift(value, scaled, vehicle)
        clear = item.predicts and stands_clear(value, error, shifts)
        half = float(np.exp(NORMAL_95 * total_error(error, shifts) / value))
        drags.append(
            TotalDrag.model_validate(
                {
                    "axis": item.axis,
                    "speed": speed,
                    "value": value,
                    "unit": unit_of(item.axis, item.equation.speed, scaled),
                    "standard_error": error,
                    "interval_95": [value / half, value * half],
                    "assumed_shifts": shifts,
                    "verdict": IDENTIFIED if clear else WEAK,
                }
            )
        )
    return drags


def _gains(fits: AxisFits, scaled: ScaledAxes) -> list[CommandGain]:
    gains = []
    for item in fits.fitted:
        forces = scaled.forces[item.axis]
        place = forces.names.index(FORCE)
        value = float(forces.values[place])
        ratio_sd = scaled.ratio_sd.get(item.axis, 0.0)
        error = float(np.sqrt(max(forces.covariance[place, place], 0.0)))
        error = float(np.hypot(error, ratio_sd * value))
        gains.append(
            CommandGain.model_validate(
                {
                    "axis": item.axis,
                    "output": None,
                    "value": value,
                    "unit": unit_of(item.axis, CONSTANT, scaled),
                    "interval_95": interval_95(value, error),
                    "dead_band": item.shape.dead_band,
                    "curve": item.shape.curve,
                    "mixed": item.shape.mixed and item.axis in MIXED,
                    "skew": item.shape.skew_of(item.axis),
                    "shape_verdict": item.shape.word,
                    "verdict": item.verdict(FORCE),
                }
            )
        )
    return gains


def _worst(verdicts: Sequence[str]) -> str:
    return next((word for word in WORST if word in verdicts), "weak")


def words_of(axis: str) -> str:
    """Return an axis as `heave (Z)`."""
    return f"{AXIS_WORDS[axis]} ({axis})"
