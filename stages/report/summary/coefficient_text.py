"""Coefficients of a model card as the first screen prints them, and assumed figures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from auvid.data_schemas.documents.model import Quantity, assumed_quantities
from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.records.models import (
    AxisCard,
    InertiaCard,
    ModelCard,
    TermCard,
    TermCombination,
    VelocityRange,
)
from auvid.data_schemas.records.partial import AT_SPEED, PartialFigures, TotalDrag
from auvid.hydro.arrays import AXES
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, coefficient_unit
from auvid.hydro.identification.regression.assumed_figures import total_error
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.regression.separability import breaks_symmetry
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, stands_clear
from auvid.stages.number_format import (
    estimate,
    part_of,
    printed_unit,
    significant,
    true_minus,
    with_unit,
)
from auvid.stages.page.first_screen import AXIS_WORDS, CoefficientLine
from auvid.stages.presentation import shift_words

VELOCITY_OF = dict(zip(AXES, "uvwpqr", strict=True))
LONGEST = 6
"""Longer lists of assumed numbers stay in the vehicle file."""


INERTIA = {"X": "m", "Y": "m", "Z": "m", "K": "I_x", "M": "I_y", "N": "I_z"}
"""Axis -> symbol of the rigid body's part of its inertia."""


def findings(card: ModelCard) -> tuple[CoefficientLine, ...]:
    """Return lines on damping, constant forces and the number of couplings.

    Damping per axis where a term in that axis's own velocity is identified.

    Each ± is half of the 95 % interval, by noise and those assumed figures of the vehicle
    that stand in brackets; by noise alone where none do. Without newtons damping is that over
    the inertia of its own axis: the ratios of inertia may be guesses.
    """
    own = card.partial if card.partial and card.partial.unit_of_mass is not None else None
    entries = [] if card.partial is None else _drags(card.partial)
    entries += [
        CoefficientLine(f"{AXIS_WORDS[axis]} damping", lines, _range(axis, card.conditions))
        for axis, part in card.axes.items()
        if (lines := _damping(axis, part) if own is None else _over_own_inertia(axis, own))
    ]
    single = [(axis, item) for axis, part in card.axes.items() for item in _identified(part)]
    constant = [
        _figure(axis, item, printed_unit(item.unit))
        for axis, item in single
        if item.term == CONSTANT
    ]
    if constant:
        entries.append(
            CoefficientLine(
                "constant force per axis",
                tuple(constant),
                "Z below zero pushes up: net buoyancy. Moments: trim, or thrusters.",
            )
        )
    crossed = [
        breaks_symmetry(axis, item.term)
        for axis, item in single
        if item.term != CONSTANT and not _own(axis, item.term)
    ]
    if crossed:
        words = f"{len(crossed)} identified, in Models and coefficients"
        note = (
            f"{sum(crossed)} of them a hull symmetric to port and starboard cannot have: look at"
            " thrusters, sensor mounting and load first."
        )
        entries.append(CoefficientLine("couplings", (words,), note if any(crossed) else ""))
    entries += [
        CoefficientLine(
            f"{AXIS_WORDS[item.name[0]]} inertia",
            (_figure(f"{INERTIA[item.name[0]]} - {item.name}", item, printed_unit(item.unit)),),
            f"{item.in_vehicle_file:.3g} {printed_unit(item.unit)} in the vehicle file. It scales"
            " with the thrust.",
        )
        for item in card.inertia
        if item.verdict == IDENTIFIED
    ]
    return tuple(entries)


def _drags(part: PartialFigures) -> list[CoefficientLine]:
    """Return the drag of each axis at one speed, surer than its parts."""
    return [
        CoefficientLine(
            f"{AXIS_WORDS[item.axis]} {item.words}",
            (_figure(f"D_{item.axis}", item, printed_unit(item.unit)),),
            "Force over speed, linear and quadratic part together.",
        )
        for item in part.total_drag
        if item.verdict == IDENTIFIED
    ]


def _range(axis: str, conditions: Mapping[str, VelocityRange]) -> str:
    """Return the range of the training legs, in which the damping holds."""
    name = VELOCITY_OF[axis]
    reach = conditions[name]
    return true_minus(
        f"Between {reach.low:.2g} and {reach.high:.2g} {'m/s' if axis in 'XYZ' else 'rad/s'},"
        " the range of the training legs."
    )


def _damping(axis: str, part: AxisCard) -> tuple[str, ...]:
    """Return the identified terms in the axis's own velocity, with 95 % intervals.

    Determined sums of such terms are included.
    """
    lines = [
        _figure(_symbol(axis, item.term), item, printed_unit(item.unit))
        for item in _identified(part)
        if _own(axis, item.term)
    ]
    for item in part.combinations:
        error = item.standard_error
        if (
            error
            and stands_clear(item.value, error, item.assumed_shifts)
            and all(_own(axis, term) for term in item.weights)
        ):
            units = {_unit(axis, term) for term in item.weights}
            if len(units) == 1:
                name = " + ".join(
                    f"{'' if weight == 1 else f'{weight:.3g} '}{_symbol(axis, term)}"
                    for term, weight in item.weights.items()
                )
                lines.append(_figure(name.replace("+ -1 ", "− "), item, units.pop()))
    return tuple(lines)


def _over_own_inertia(axis: str, part: PartialFigures) -> tuple[str, ...]:
    """Return identified damping over inertia, and the time constant at a speed."""
    return tuple(
        _within(
            item.quantity,
            item.value,
            (item.interval_95[1] - item.interval_95[0]) / 2.0,
            printed_unit(item.unit),
        )
        for item in part.without_newtons
        if item.interval_95 is not None
        and (item.axis, item.verdict) == (axis, IDENTIFIED)
        and (item.quantity in _over_mass(axis) or item.quantity.startswith(AT_SPEED))
    )


def _over_mass(axis: str) -> tuple[str, str]:
    """Return the names of damping over inertia of an axis: `N_r/M`, `N_r|r|/M`."""
    velocity = VELOCITY_OF[axis]
    return f"{axis}_{velocity}/M", f"{axis}_{velocity}|{velocity}|/M"


def _identified(part: AxisCard) -> list[TermCard]:
    """Return the identified coefficients."""
    return [
        item
        for item in part.terms
        if item.verdict == IDENTIFIED and item.value is not None and item.standard_error
    ]


def _factors(term: str) -> tuple[str, ...]:
    return tuple(BASIS_TERMS[term].factors) if term in BASIS_TERMS else ()


def _own(axis: str, term: str) -> bool:
    factors = _factors(term)
    return bool(factors) and all(factor.strip("|") == VELOCITY_OF[axis] for factor in factors)


def _symbol(axis: str, term: str) -> str:
    return f"{axis}_{term.replace('*', '').replace('(eta-1)', '(η−1)')}"


def _unit(axis: str, term: str) -> str:
    """Unit of a coefficient as engineers print it: N s/m, N s²/m², N m s/rad."""
    return printed_unit(coefficient_unit(axis, term))


def _figure(
    symbol: str, item: TermCard | TermCombination | InertiaCard | TotalDrag, unit: str
) -> str:
    """Return a value within its 95 % interval, and what the interval is made of.

    `X_u = −58 ± 23 N s/m (noise ± 4, scale of the thrust curve ± 23)`.
    """
    value, error = item.value or 0.0, item.standard_error or 0.0
    half = NORMAL_95 * total_error(error, item.assumed_shifts)
    words = _within(symbol, value, half, unit)
    shifts = shift_words(item.assumed_shifts, error)
    if shifts:
        words += f" (noise {part_of(half, NORMAL_95 * error)}, {shifts})"
    return words


def _within(symbol: str, value: float, half: float, unit: str) -> str:
    """Return a value and half of its interval with the unit: `K = 0.16 ± 0.05 N m`."""
    return true_minus(f"{symbol} = {estimate(value, half)} {unit}")


def assumed_words(vehicle: VehicleDocument) -> tuple[int, str]:
    """Return how many figures of a vehicle document are assumed, and which.

    Names and values, grouped, without their sources.
    """
    groups: dict[str, list[str]] = {}
    for path, quantity in assumed_quantities(vehicle):
        groups.setdefault("".join(path[-2:-1]).replace("_", " "), []).append(
            f"{_name(path[-1])}{_value(quantity)}"
        )
    words = [
        f"{group}: {', '.join(items)}" if group else ", ".join(items)
        for group, items in groups.items()
    ]
    return sum(len(items) for items in groups.values()), "; ".join(words)


def _name(field: str) -> str:
    return field if field != field.lower() else field.replace("_", " ")


def _value(quantity: Quantity) -> str:
    """Return a value as text; empty for a longer list, which the vehicle file holds.

    ` 13.5 kg`, ` diag(0.26, 0.23, 0.37) kg m²`.
    """
    value = np.asarray(quantity.value, dtype=float)
    if (
        value.ndim == 2
        and value.shape[0] == value.shape[1]
        and not np.any(value - np.diag(np.diag(value)))
    ):
        words = f" diag({', '.join(map(significant, np.diag(value)))})"
    elif value.size > LONGEST:
        return ""
    else:
        words = (
            f" [{', '.join(map(significant, value.ravel()))}]"
            if value.ndim
            else f" {significant(float(value), 4)}"
        )
    return true_minus(with_unit(words, printed_unit(quantity.unit)))
