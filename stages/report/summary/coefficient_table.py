"""The table of coefficients of the recommended model, with published values beside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from auvid.data_schemas.records.models import AxisCard, InertiaCard, ModelCard, TermCard
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.identification.regression.assumed_figures import (
    FIGURES,
    FORM,
    UNSTEADY,
    total_error,
)
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, stands_clear
from auvid.stages.number_format import (
    estimate,
    interval,
    part_of,
    printed_unit,
    significant,
    true_minus,
)
from auvid.stages.page.first_screen import AXIS_WORDS, CoefficientRow
from auvid.stages.report.summary.coefficient_text import INERTIA

SPEED_WORDS = {
    **dict(zip("uvw", ("surge", "sway", "heave"), strict=True)),
    **dict(zip("pqr", ("roll rate", "pitch rate", "yaw rate"), strict=True)),
    "V": "speed",
    "(eta-1)": "propulsion ratio",
}


def coefficient_rows(
    card: ModelCard, vehicle: Vehicle, shelf: Mapping[str, Vehicle]
) -> tuple[CoefficientRow, ...]:
    """Return every coefficient of a model, in the order of the model.

    Combinations that the data determine of inseparable terms and inertias follow the
    terms of their axis.
    """
    rows: list[CoefficientRow] = []
    for axis, part in card.axes.items():
        rows += [_row(axis, item, vehicle, shelf) for item in part.terms]
        rows += _combinations(axis, part)
        rows += [_inertia_row(item) for item in card.inertia if item.name[0] == axis]
    return tuple(rows)


def _row(
    axis: str, item: TermCard, vehicle: Vehicle, shelf: Mapping[str, Vehicle]
) -> CoefficientRow:
    name = coefficient_name(axis, item.term)
    words, sources = _published(name, vehicle, shelf)
    return CoefficientRow(
        name=name,
        meaning=meaning(axis, item.term),
        unit=printed_unit(item.unit),
        verdict=item.verdict,
        **_figures(item.value, item.standard_error, item.assumed_shifts),
        published=words,
        sources=sources,
    )


def coefficient_name(axis: str, term: str) -> str:
    """Return the name of a coefficient.

    >>> coefficient_name("Y", "v*|v|"), coefficient_name("Z", "constant")
    ('Y_v|v|', 'Z_0')
    """
    if term == CONSTANT:
        return f"{axis}_0"
    return f"{axis}_{term.replace('*', '').replace('(eta-1)', '(η−1)')}"


def meaning(axis: str, term: str) -> str:
    """Return what a coefficient is.

    >>> meaning("X", "u"), meaning("N", "r*|r|"), meaning("Y", "r"), meaning("Z", "constant")
    ('surge damping', 'yaw damping, quadratic', 'sway from yaw rate', 'constant heave force')
    """
    word = AXIS_WORDS[axis]
    if term == CONSTANT:
        return f"constant {word} {'force' if axis in 'XYZ' else 'moment'}"
    factors = [factor.strip("|") for factor in BASIS_TERMS[term].factors]
    if set(factors) == {OWN_VELOCITY[axis]}:
        return f"{word} damping" + (", quadratic" if len(factors) > 1 else "")
    named = [SPEED_WORDS.get(factor, factor) for factor in factors]
    if len(set(named)) < len(named):
        named = [f"{named[0]} squared"]
    return f"{word} from {' times '.join(named)}"


def _combinations(axis: str, part: AxisCard) -> Iterator[CoefficientRow]:
    """Yield determined sums of inseparable terms: `X_u + X_u|u|`."""
    for item in part.combinations:
        error = item.standard_error
        units = {term.unit for term in part.terms if term.term in item.weights}
        shifts = item.assumed_shifts
        if error and stands_clear(item.value, error, shifts) and len(units) == 1:
            parts = [
                f"{'' if weight == 1 else f'{weight:.3g} '}{coefficient_name(axis, term)}"
                for term, weight in item.weights.items()
            ]
            yield CoefficientRow(
                name=" + ".join(parts).replace("+ -1 ", "− "),
                meaning="of inseparable terms",
                unit=printed_unit(units.pop()),
                verdict=IDENTIFIED,
                **_figures(item.value, error, shifts),
            )


def _inertia_row(item: InertiaCard) -> CoefficientRow:
    return CoefficientRow(
        name=f"{INERTIA[item.name[0]]} − {item.name}",
        meaning=f"{AXIS_WORDS[item.name[0]]} inertia",
        unit=printed_unit(item.unit),
        verdict=item.verdict,
        **_figures(item.value, item.standard_error, item.assumed_shifts),
        published=f"{significant(item.in_vehicle_file)} (file)",
        sources="mass or moment of inertia and added mass of the vehicle file",
    )


def _figures(
    value: float | None, error: float | None, shifts: Mapping[str, float]
) -> dict[str, Any]:
    """Return value and 95 % interval by noise and assumed figures.

    What noise and what assumed figures add alone are `noise` and `assumed`. Without shifts
    the interval is by noise alone and `assumed` is empty.
    """
    if value is None:
        return {}
    if not error:
        return {"value": value, "printed": true_minus(significant(value))}
    half = NORMAL_95 * total_error(error, shifts)
    return {
        "value": value,
        "low": value - half,
        "high": value + half,
        "printed": true_minus(estimate(value, half)),
        "interval": true_minus(interval(value, half)),
        "noise": part_of(half, NORMAL_95 * error),
        "assumed": part_of(half, NORMAL_95 * total_error(0.0, shifts)) if shifts else "",
    }


def assumed_most(card: ModelCard) -> str:
    """Return the assumed figure that is most of most intervals, or ''.

    Most of one: more than half of its variance, that of noise included.
    """
    largest = [
        next(
            (
                name
                for name, shift in item.assumed_shifts.items()
                if name not in (FORM, UNSTEADY) and shift**2 > 0.5 * error**2
            ),
            "",
        )
        for part in card.axes.values()
        for item in part.terms
        if item.verdict == IDENTIFIED and item.standard_error
        for error in [total_error(item.standard_error, item.assumed_shifts)]
    ]
    most = max(largest, key=largest.count, default="")
    return FIGURES[most] if most and largest.count(most) > 0.5 * len(largest) else ""


def _published(name: str, vehicle: Vehicle, shelf: Mapping[str, Vehicle]) -> tuple[str, str]:
    """Return published values of a coefficient as a range, and their sources."""
    values = {
        item.title: item.published[name].value
        for item in (vehicle, *shelf.values())
        if name in item.published
    }
    if not values:
        return "", ""
    low, high = min(values.values()), max(values.values())
    words = significant(low) if low == high else f"{significant(low)} to {significant(high)}"
    words += f" ({len(values)} sets)" if len(values) > 1 else ""
    sources = "; ".join(f"{title}: {significant(value, 4)}" for title, value in values.items())
    return true_minus(words), true_minus(sources)
