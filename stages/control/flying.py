"""Controllers of a control campaign, designed and flown.

Per trajectory, for every model of which a controller is designed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auvid.data_schemas.documents.control_cases import ControlCasesDocument
from auvid.data_schemas.errors import CampaignError, PipelineError
from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.arrays import AXES, STATES, Array
from auvid.hydro.control.closed_loop import Flights, Performance, fly, performance
from auvid.hydro.control.controllers import Schedule, Weights, design
from auvid.hydro.control.equilibrium import equilibrium, require_reachable
from auvid.hydro.control.paths.trajectories import Trajectory, fly_path
from auvid.hydro.control.plants import (
    ControlledPlant,
    HybridPlant,
    card_coefficients,
    hybrid_plant,
    identified_plant,
)
from auvid.hydro.dynamics.hybrid_vehicle import hybrid_vehicle
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.constrained.draws import joint_covariance
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.stages.card_errors import axis_errors
from auvid.stages.control.cases import FlightCase, Limits, TrajectoryCase, in_cases

DESIGN_EVERY_S = 0.5
"""Gains are computed this often and are linear between: trajectories turn by a degree
or two in that time.
"""
UNSTABLE_PER_S = 0.02
"""An identified model with a mode that grows faster than this (doubling in 35 s) is
called unstable.
"""
CHUNK = 250


@dataclass(frozen=True)
class DesignModels:
    """The vehicle that flies, and the models of the designs by name.

    The first is the vehicle itself or its card.
    """

    plant: ControlledPlant
    designs: Mapping[str, ControlledPlant]


@dataclass(frozen=True)
class Flown:
    """One flight: arrays of one member, its trajectory and its schedule."""

    case: TrajectoryCase
    flight: FlightCase
    designed_on: str
    trajectory: Trajectory
    schedule: Schedule
    flown: Flights
    errors: Performance

    @property
    def name(self) -> str:
        """Key of its table."""
        return f"{self.case.name}-{self.flight.name}"


def models_of(
    vehicle: Vehicle, card: ModelCard | None, cases: ControlCasesDocument, limits: Limits
) -> DesignModels:
    """Return the plant and the designs of a campaign.

    A hybrid vehicle flies under `parameter_set`; controllers are designed on that set,
    on the model card if one is given, and on the sets of `redesign`. Any other vehicle
    flies its model card. Raises `CampaignError` where there is neither a buoyancy
    engine nor a card.
    """
    if vehicle.buoyancy_engine is not None:
        own = cases.parameter_set

        def plant(name: str) -> HybridPlant:
            hybrid = hybrid_vehicle(vehicle, name)
            return hybrid_plant(
                hybrid,
                fin_limit_rad=limits.fins_rad,
                thrust_rate_N_s=limits.thrust_rate_N_s,
                fin_rate_rad_s=limits.fin_rate_rad_s,
            )

        true = plant(own)
        designs: dict[str, ControlledPlant] = {own: true}
        if card is not None:
            identified = true.hybrid.with_viscous(card_coefficients(card)[0], name=str(card.name))
            designs[f"identified ({card.name})"] = replace(true, hybrid=identified)
        designs |= {name: plant(name) for name in cases.redesign if name != own}
        return DesignModels(true, designs)
    if card is None:
        raise CampaignError(
            "a controller needs a model of the vehicle",
            field="model",
            remedy=(
                "Name a model card: model: PATH (runs/CAMPAIGN/synthesise/model_card/MODEL.json)."
            ),
        )
    flown = identified_plant(
        vehicle, card, fin_limit_rad=limits.fins_rad, fin_rate_rad_s=limits.fin_rate_rad_s
    )
    return DesignModels(flown, {str(card.name): flown})


def require_stable(plant: ControlledPlant, schedule: Schedule, *, allow: bool) -> list[str]:
    """Return the modes of an identified model that grow, in words.

    Raises `PipelineError` where there are any and `allow` is false.
    """
    growing: dict[str, float] = {}
    for index in np.unique(np.linspace(0, len(schedule.A) - 1, 5).astype(int)):
        values, vectors = np.linalg.eig(schedule.A[index])
        for i in np.flatnonzero(values.real > UNSTABLE_PER_S):
            state = STATES[int(np.argmax(np.abs(vectors[:, i])))]
            growing[state] = max(growing.get(state, 0.0), float(values[i].real))
    if growing and not allow:
        raise PipelineError(
            "the identified model is unstable along the trajectory, so a controller on it would"
            " hold a vehicle that may not exist",
            field="model",
            value=", ".join(
                f"mode of {state} grows by {rate:.3g} per s" for state, rate in growing.items()
            ),
            remedy=(
                "Identify with more excitation, or say control: {allow_unstable: true} under stages"
                " of the manifest."
            ),
        )
    return [
        f"{plant.title}: the mode of {state} grows by {rate:.3g} per second without a controller."
        for state, rate in growing.items()
    ]


def fly_case(
    models: DesignModels,
    case: TrajectoryCase,
    weights: Mapping[str, Weights],
    limits: Limits,
    *,
    allow_unstable: bool,
) -> list[Flown]:
    """Fly all flights of a trajectory.

    On designs other than the first those marked `redesign`.
    """
    flown: list[Flown] = []
    for index, (name, model) in enumerate(models.designs.items()):
        chosen = [flight for flight in case.flights if index == 0 or flight.redesign]
        if not chosen:
            continue
        trajectory = _trajectory(case)
        schedules = [_schedule(model, trajectory, case, weights[case.weights], limits)]
        if index == 0 and models.plant.is_identified:
            require_stable(model, schedules[0], allow=allow_unstable)
        if case.powered is not None:
            faster = replace(
                case,
                speed_m_s=case.powered.speed_m_s,
                duration_s=None,
                weights=case.powered.weights,
            )
            schedules.append(
                _schedule(model, _trajectory(faster), faster, weights[faster.weights], limits)
            )
        flown += _fly_groups(
            models.plant, name, trajectory, schedules, replace(case, flights=tuple(chosen))
        )
    return flown


def _trajectory(case: TrajectoryCase) -> Trajectory:
    duration = None if case.powered is not None else case.duration_s
    return fly_path(case.path, speed_m_s=case.speed_m_s, step_s=case.step_s, duration_s=duration)


def _schedule(
    plant: ControlledPlant,
    trajectory: Trajectory,
    case: TrajectoryCase,
    weights: Weights,
    limits: Limits,
) -> Schedule:
    with in_cases(f"trajectories.{case.name}"):
        steady = equilibrium(
            plant, trajectory, method=case.equilibrium, epsilon_rad=case.epsilon_rad
        )
        if case.equilibrium == "trimmed":
            require_reachable(plant, steady, largest_pitch_rad=limits.pitch_rad)
    stride = max(
        1,
        round(
            DESIGN_EVERY_S
            * (0.204 if case.powered else 1.0)
            / (case.speed_m_s if case.powered else 1.0)
            / case.step_s
        ),
    )
    with in_cases(f"weights.{case.weights}"):
        return design(
            plant,
            steady,
            weights,
            riccati=case.riccati,
            observer=case.observer,
            feed_forward=case.feed_forward,
            stride=stride,
        )


def start_of(trajectory: Trajectory, schedule: Schedule) -> Array:
    """Return the start: the first point in the path's frame (section 4.3).

    A glide starts at its equilibrium.
    """
    chi: Array = schedule.equilibrium.chi[0].copy()
    if not schedule.equilibrium.glides:
        chi[:6] = [trajectory.speed[0], 0.0, 0.0, 0.0, 0.0, 0.0]
        chi[9:] = trajectory.attitude[0]
    return chi


def _fly_groups(
    plant: ControlledPlant,
    designed_on: str,
    trajectory: Trajectory,
    schedules: Sequence[Schedule],
    case: TrajectoryCase,
) -> Iterator[Flown]:
    first = schedules[0]
    for clock in (True, False):
        group = [
            flight for flight in case.flights if (flight.clock or case.waiting is None) is clock
        ]
        if not group:
            continue
        drifting = any(flight.current is not None for flight in group)
        flights = fly(
            plant,
            schedules[0] if clock else schedules,
            start=np.tile(start_of(trajectory, first), (len(group), 1)),
            force_ned_N=np.stack([flight.force.at(trajectory.t_s) for flight in group]),
            current_ned_m_s=(
                np.stack([np.zeros(3) if f.current is None else f.current for f in group])
                if drifting
                else None
            ),
            use_observer=np.array([flight.observer for flight in group]),
            waiting=None if clock else case.waiting,
            switch=None if clock or case.powered is None else case.powered.switch,
            duration_s=case.duration_s,
        )
        errors = performance(
            trajectory, flights, first.equilibrium.chi, plant.inputs, after_s=case.transient_s
        )
        for index, flight in enumerate(group):
            yield Flown(
                case,
                flight,
                designed_on,
                trajectory,
                first,
                _member(flights, index),
                _member(errors, index),
            )


def _member(batch: Any, index: int) -> Any:
    """One member of a batch of arrays."""
    shared = {"t_s"}
    return replace(
        batch,
        **{name: value if name in shared else value[index] for name, value in vars(batch).items()},
    )


def monte_carlo(
    models: DesignModels,
    card: ModelCard | None,
    flown: Flown,
    *,
    duration_s: float,
    relative_sd: float,
    members: int,
    seed: int,
) -> tuple[Performance, Array]:
    """Return errors of `members` vehicles with drawn viscous coefficients.

    Under the controller of the nominal one: performance and cross-track error over time
    (members, n). Draws follow the printed intervals of the card, or a relative standard
    deviation without one.
    """
    rng = np.random.default_rng(seed)
    plant, case, schedule = models.plant, flown.case, flown.schedule
    drawn = _drawn(
        plant.viscous,
        plant.terms,
        card if plant.is_identified else None,
        relative_sd,
        members,
        rng,
    )
    parts: list[Performance] = []
    for first in range(0, members, CHUNK):
        varied = plant.with_viscous(drawn[first : first + CHUNK])
        clock = flown.flight.clock or case.waiting is None
        flights = fly(
            varied,
            schedule,
            start=start_of(flown.trajectory, schedule),
            force_ned_N=flown.flight.force.at(flown.trajectory.t_s),
            current_ned_m_s=flown.flight.current,
            use_observer=flown.flight.observer,
            waiting=None if clock else case.waiting,
            duration_s=duration_s,
            members=len(varied.viscous),
        )
        parts.append(
            performance(
                flown.trajectory,
                flights,
                schedule.equilibrium.chi,
                plant.inputs,
                after_s=case.transient_s,
            )
        )
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])
    }
    return replace(parts[0], **joined), joined["cross_track_m"]


def _drawn(
    values: Array,
    terms: Sequence[str],
    card: ModelCard | None,
    relative_sd: float,
    members: int,
    rng: np.random.Generator,
) -> Array:
    """Coefficients (members, 6, n)."""
    if card is None:
        return np.asarray(
            values * (1.0 + relative_sd * rng.standard_normal((members, *values.shape)))
        )
    unknowns = [
        Unknown(axis, term) for axis, part in card.axes.items() for term in part.covariance.terms
    ]
    root = _root(joint_covariance(axis_errors(card, unknowns), len(unknowns)))
    errors = rng.standard_normal((members, len(unknowns))) @ root.T
    out = np.tile(values, (members, 1, 1))
    for unknown, error in zip(unknowns, errors.T, strict=True):
        if unknown.term in terms:
            out[:, AXES.index(unknown.axis), terms.index(unknown.term)] += error
    return out


def _root(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
