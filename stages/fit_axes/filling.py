"""Axes that the logs do not give, from published sets or a bench, and marked so."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.records.models import TermCard
from auvid.data_schemas.records.partial import AxisSource
from auvid.data_schemas.records.priors import PriorSource
from auvid.hydro.dynamics.actuators.commands import axis_of
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.hydro.dynamics.viscous.coefficients import viscous_terms
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.partial_model import FROM_BENCH, FROM_SHELF, apparent_inertia, unit_in

BENCH = ".json"
"""Suffix of the results of a bench; a source without it is a published set."""


@dataclass(frozen=True)
class FilledAxis:
    """An axis that was not fitted here: its coefficients, each with its source."""

    axis: str
    terms: tuple[TermCard, ...]
    source: AxisSource


@dataclass(frozen=True)
class FillSources:
    """Published sets and benches that the campaign names under `fill`, by name."""

    sets: Mapping[str, Vehicle]
    benches: Mapping[str, PriorSource]


def filled_axes(
    fill: Mapping[str, str],
    sources: FillSources,
    *,
    fitted: Collection[str],
    vehicle: Vehicle,
    unit_of_mass: str | None,
) -> list[FilledAxis]:
    """Return the axes that sources fill; those that the logs give stay the logs'.

    fill: motion (surge to yaw) -> published set, or results of a bench. Damping alone comes
    from there; inertia stays that of the vehicle file. In a model without newtons damping
    over the inertia of the published vehicle is kept.
    """
    out = []
    for motion, name in fill.items():
        axis = axis_of(motion)
        if axis in fitted:
            continue
        if name.endswith(BENCH):
            bench = sources.benches[name.rpartition("/")[2]]
            values = {item.term: item.value for item in bench.terms if item.axis == axis}
            scale, words, kind = 1.0, f"bench {name}", "bench"
            if unit_of_mass is not None:
                scale = 1.0 / apparent_inertia(vehicle, unit_of_mass)
                words += ", over the inertia of the vehicle file"
        else:
            other = sources.sets[name.rpartition("/")[2].removesuffix(".yaml")]
            values = viscous_terms(other.published.values()).get(axis, {})
            scale, words, kind = 1.0, f"{name} ({other.title})", "shelf"
            if unit_of_mass is not None:
                ratio = apparent_inertia(vehicle, axis) / apparent_inertia(vehicle, unit_of_mass)
                scale = ratio / apparent_inertia(other, axis)
                words += ", over its own inertia"
        if not values:
            raise CampaignError(
                f"the source has no damping in {motion}",
                field=f"fill.{motion}",
                value=name,
                remedy="Name another source, or leave the axis out.",
            )
        out.append(_filled(axis, values, scale, words, kind, unit_of_mass))
    return out


def _filled(
    axis: str,
    values: Mapping[str, float],
    scale: float,
    words: str,
    kind: str,
    unit_of_mass: str | None,
) -> FilledAxis:
    verdict = FROM_SHELF if kind == "shelf" else FROM_BENCH
    terms = tuple(
        TermCard.model_validate(
            {
                "term": term,
                "unit": coefficient_unit(axis, term)
                if unit_of_mass is None
                else unit_in(axis, term, unit_of_mass),
                "value": scale * value,
                "verdict": verdict,
                "source": words,
            }
        )
        for term, value in values.items()
        if term != CONSTANT
    )
    source = AxisSource.model_validate(
        {
            "source": kind,
            "name": words,
            "held_out_percent": None,
            "lag_s": 0.0,
            "lag_verdict": "assumed",
        }
    )
    return FilledAxis(axis, terms, source)
