"""The contents of a model file, from card, ranking, vehicle and provenance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from auvid import __version__
from auvid.data_schemas.documents.model import Quantity, Unit, in_schema_units
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.model_file import (
    FORMAT,
    PARTIAL_FORMAT,
    CoefficientEntry,
    FreeRunEntry,
    LagEntry,
    ModelFile,
    OriginEntry,
    UseEntry,
    ValidationEntry,
)
from auvid.data_schemas.records.models import (
    MeritRecord,
    ModelCard,
    RankingRecord,
    TermCard,
    UsableFor,
)
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.logged_directions import with_logged_directions
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.statuses import AT_BOUND, FROM_PRIOR
from auvid.hydro.identification.regression.assumed_figures import CURRENT, UNSTEADY, total_error
from auvid.hydro.model_file import dynamics_of, fitted_change, frames, with_fitted_shares
from auvid.hydro.partial_model import (
    FROM_BENCH,
    FROM_SHELF,
    figures_in_unit,
    with_displaced_mass,
    with_righting_moment,
)
from auvid.stages.base import Document
from auvid.stages.model_use import partial_words, recommendation, usable_for, use_words
from auvid.stages.page.first_screen import ALL

RMS = {
    **{name: f"{name}_rms_m_s" for name in "uvw"},
    **{name: f"{name}_rms_rad_s" for name in "pqr"},
    **{name: f"{name}_rms_rad" for name in ("phi", "theta", "psi")},
}
"""Component of the state -> column of the table of free runs."""

RESTS_ELSEWHERE = (AT_BOUND, FROM_PRIOR, FROM_SHELF, FROM_BENCH)
"""Verdicts of values that the data of the run do not determine."""


def use_entry(ranking: RankingRecord, merit: MeritRecord | None, card: ModelCard) -> UseEntry:
    """Return what a model may be used for; of the one to take in the report's words."""
    if card.partial is not None:
        sentence = f"{card.title}: {partial_words(card.partial, ranking.usable)}"
        return UseEntry(
            recommended=card.name == ranking.choice,
            sentence=sentence,
            rule=ranking.rule,
            axes=ranking.usable or UsableFor(forces=[], simulation=[], control=[], speeds={}),
        )
    judged = any(model.axes[ALL].validation is not None for model in ranking.models)
    recommended = card.name == ranking.choice
    usable = usable_for(merit, card, ranking.constant) if merit is not None and judged else None
    if recommended:
        _, sentence, _ = recommendation(ranking, merit, judged)
    elif merit is None or usable is None:
        sentence = f"{card.title}: nothing judges it, so use it for nothing"
    else:
        sentence = f"{card.title}: {use_words(usable, flown=merit.runs > 0)}"
        if card.name == ranking.simulate_with:
            sentence += f"; take {ranking.choice} to predict forces"
        elif ranking.choice:
            sentence += f"; take {ranking.choice} instead: intervals of this one hold only if its"
            sentence += " form does"
    return UseEntry(recommended=recommended, sentence=sentence, rule=ranking.rule, axes=usable)


def model_document(
    card: ModelCard,
    vehicle: Vehicle,
    *,
    use: UseEntry,
    merit: MeritRecord | None,
    free_runs: Sequence[Mapping[str, Any]],
    title: str,
    provenance: Document,
    minimum_speed_m_s: float,
) -> ModelFile:
    """Return the file of a model card.

    free_runs: its rows of the table of free runs; merit: None where nothing judges it.
    """
    lag, part = card.lag, card.partial
    vehicle = with_fitted_shares(vehicle, part)
    if part is not None and part.righting is not None:
        vehicle = with_righting_moment(vehicle, part.righting.value, part.unit_of_mass)
    if part is not None and part.displaced is not None:
        vehicle = with_displaced_mass(vehicle, part.displaced.value_kg)
    dynamics = dynamics_of(
        vehicle,
        fitted_change(card.inertia),
        lag_s=card.lag_s,
        minimum_speed_m_s=minimum_speed_m_s,
    )
    if part is not None and part.unit_of_mass is not None:
        dynamics = figures_in_unit(dynamics, part.unit_of_mass)
    absent_or_partial: dict[str, Any] = {} if part is None else {"partial": part}
    return ModelFile(
        format=FORMAT if part is None else PARTIAL_FORMAT,
        kind="auvid model",
        auvid=__version__,
        name=card.name,
        title=card.title,
        source=card.source,
        method=card.method,
        use=use,
        frames=frames(vehicle.document.origin),
        dynamics=dynamics,
        coefficients=[
            _coefficient(axis, item, card)
            for axis, part in card.axes.items()
            for item in part.terms
        ],
        covariance={axis: part.covariance for axis, part in card.axes.items()},
        combinations={axis: part.combinations for axis, part in card.axes.items()},
        fitted_inertia=card.inertia,
        fitted_lag=(
            None
            if lag is None
            else LagEntry(
                value_s=lag.value_s, standard_error_s=lag.standard_error_s, verdict=lag.verdict
            )
        ),
        limits=card.limits,
        prior=card.prior,
        validity=card.conditions,
        validation=None if merit is None else _validation(merit, card, free_runs),
        assumed=card.assumed,
        vehicle=in_schema_units(vehicle.document),
        origin=OriginEntry(
            campaign=title,
            logs={name: list(files) for name, files in provenance["logs"].items()},
            vehicle_hash=provenance["vehicle"],
            code={name: entry["code"] for name, entry in provenance["stages"].items()},
            parameters={
                name: dict(entry["parameters"]) for name, entry in provenance["stages"].items()
            },
            packages=dict(provenance["packages"]),
        ),
        **absent_or_partial,
    ).sealed()


def as_logged(vehicle: Vehicle, log: LogInfo) -> Vehicle:
    """Return the vehicle with the motor directions of a log, where it has others."""
    logged, words = with_logged_directions(vehicle, log.parameters)
    if vehicle.thrusters is None or logged.thrusters is None:
        return vehicle
    directions = logged.thrusters.direction
    if np.array_equal(directions, vehicle.thrusters.direction):
        return vehicle
    entry = vehicle.document.actuators.thrusters
    assert entry is not None  # the vehicle has thrusters
    quantity = Quantity(value=directions.tolist(), unit="1", source=f"log {log.log}: {words}")
    thrusters = entry.model_copy(update={"direction": Unit("1", (-1,)).read(quantity)})
    actuators = vehicle.document.actuators.model_copy(update={"thrusters": thrusters})
    document = vehicle.document.model_copy(update={"actuators": actuators})
    return replace(logged, document=document)


def differing_directions(vehicle: Vehicle, chosen: Vehicle, logs: Sequence[LogInfo]) -> str:
    """Return a warning where logs turn the motors differently; empty where they agree.

    chosen: the vehicle that model files hold. Each leg is fitted with its own log's.
    """
    if chosen.thrusters is None:
        return ""
    directions = chosen.thrusters.direction
    others = []
    for log in logs:
        thrusters = with_logged_directions(vehicle, log.parameters)[0].thrusters
        if thrusters is not None and not np.array_equal(thrusters.direction, directions):
            others.append(f"{log.log} {thrusters.direction.astype(int).tolist()}")
    if not others:
        return ""
    return (
        f"Motor directions differ between the logs: model files hold"
        f" {directions.astype(int).tolist()}, but those of {', '.join(others)}. Each leg was fitted"
        " with its own. A model for the others needs a campaign of their logs."
    )


def _coefficient(axis: str, item: TermCard, card: ModelCard) -> CoefficientEntry:
    value, error = item.value, item.standard_error
    assumed = total_error(0.0, item.assumed_shifts) if item.assumed_shifts else None
    # A current and a force are no figures of the vehicle: with these, noise is still no total.
    figures = item.assumed_shifts.keys() - {CURRENT, UNSTEADY}
    total = None if error is None or not figures else total_error(error, item.assumed_shifts)
    return CoefficientEntry.model_validate(
        {
            "symbol": str(Unknown(axis, item.term)),
            "axis": axis,
            "term": item.term,
            "factors": list(BASIS_TERMS[item.term].factors) if item.term in BASIS_TERMS else [],
            "unit": item.unit,
            "determined": value is not None and item.verdict not in RESTS_ELSEWHERE,
            "value": value,
            # A term that a refined model leaves out keeps its verdict and acts no more.
            "predictor": card.predictor.get(axis, {}).get(item.term, 0.0),
            "verdict": item.verdict,
            "standard_error": error,
            "interval_95": _interval(value, error),
            "interval_95_assumed": _interval(value, assumed),
            "interval_95_total": _interval(value, total),
            "assumed_shifts": item.assumed_shifts,
            "inseparable_from": item.inseparable_from or [],
            "turns_without": item.turns_without or [],
            **({} if item.source is None else {"source": item.source}),
        }
    )


def _interval(value: float | None, deviation: float | None) -> list[float] | None:
    if value is None or deviation is None:
        return None
    return [value - NORMAL_95 * deviation, value + NORMAL_95 * deviation]


def _validation(
    merit: MeritRecord, card: ModelCard, free_runs: Sequence[Mapping[str, Any]]
) -> ValidationEntry:
    return ValidationEntry(
        axes=merit.axes,
        free_runs=[
            FreeRunEntry(
                segment=row["segment"],
                horizon_s=row["horizon_s"],
                starts=row["starts"],
                lost=row["diverged"],
                rms={name: _finite(row[column]) for name, column in RMS.items()},
            )
            for row in free_runs
        ],
        runs=merit.runs,
        lost=merit.lost,
        faults=merit.faults,
        motion=merit.motion,
        coverage_on_twins=card.coverage_on_twins,
    )


def _finite(value: float | None) -> float | None:
    return None if value is None or math.isnan(value) else value
