"""The cases document of a control campaign as values.

Trajectories with their controllers, flights, limits and weights.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.documents.control_cases import (
    ControlCasesDocument,
    DubinsEntry,
    FlightEntry,
    HelixEntry,
    PoseEntry,
    PoweredEntry,
    SawToothEntry,
    TrajectoryEntry,
)
from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.control.closed_loop import ForceField
from auvid.hydro.control.controllers import Weights
from auvid.hydro.control.paths.dubins import Bounds, Pose, dubins_path
from auvid.hydro.control.paths.paths import Curve, helix, saw_tooth
from auvid.hydro.control.reference import ModeSwitch, Waiting


@dataclass(frozen=True)
class FlightCase:
    """One flight along a trajectory.

    A force field, a current (3,) or None, whether the observer's estimate is used.
    """

    name: str
    title: str
    observer: bool
    clock: bool
    force: ForceField
    current: Array | None
    headline: bool
    redesign: bool


@dataclass(frozen=True)
class Powered:
    """The second speed of a glide."""

    speed_m_s: float
    weights: str
    switch: ModeSwitch


@dataclass(frozen=True)
class TrajectoryCase:
    """A trajectory with its controller and its flights."""

    name: str
    title: str
    path: Curve
    speed_m_s: float
    step_s: float
    duration_s: float | None
    weights: str
    riccati: str
    observer: str
    feed_forward: str
    equilibrium: str
    epsilon_rad: float
    transient_s: float
    waiting: Waiting | None
    powered: Powered | None
    flights: tuple[FlightCase, ...]
    turn_s: float | None
    """Time of one full turn, for helices."""


@dataclass(frozen=True)
class Limits:
    """Limits of the actuators and of the pitch of a trajectory."""

    fins_rad: float
    fin_rate_rad_s: float
    thrust_rate_N_s: float
    pitch_rad: float


CASES = "the cases of the campaign"
MOST_TICKS = 200_000
"""More are refused: a step that is wrong by a thousand shall not fill the memory."""


@contextmanager
def in_cases(where: str) -> Iterator[None]:
    """Add the document, and the place in it, to faults raised inside."""
    try:
        yield
    except CampaignError as fault:
        fault.file = fault.file or CASES
        if fault.field and not fault.field.startswith(where):
            fault.field = f"{where}.{fault.field}"
        fault.args = (str(fault),)
        raise


def limits_of(cases: ControlCasesDocument) -> Limits:
    """Return the limits of the cases."""
    entry = cases.limits
    return Limits(entry.fins.si, entry.fin_rate.si, entry.thrust_rate.si, entry.pitch.si)


def weights_of(cases: ControlCasesDocument) -> dict[str, Weights]:
    """Return the weights of the cases by name."""
    return {
        name: Weights(entry.Q.array, entry.R.array, entry.Q_Z.array, entry.R_Z.array)
        for name, entry in cases.weights.items()
    }


def trajectories_of(cases: ControlCasesDocument) -> tuple[TrajectoryCase, ...]:
    """Return the trajectories of the cases.

    Raises `CampaignError` for impossible paths and trajectories with more ticks than
    `MOST_TICKS`.
    """
    return tuple(_trajectory(name, entry) for name, entry in cases.trajectories.items())


def _trajectory(name: str, entry: TrajectoryEntry) -> TrajectoryCase:
    where, shape, speed = f"trajectories.{name}", entry.path, entry.speed.si
    with in_cases(f"{where}.path"):
        path = _path(shape)
    duration = None if entry.duration is None else entry.duration.si
    waiting = None
    if entry.waiting is not None:
        catch_up = entry.waiting.catch_up
        waiting = Waiting(
            entry.waiting.lead.si,
            float("inf") if catch_up is None else catch_up.si,
            entry.waiting.fastest.si,
        )
    powered = None if entry.powered is None else _powered(entry.powered, entry.weights)
    slowest = min(speed, powered.speed_m_s) if powered else speed
    if max(path.length_m / slowest, duration or 0.0) / entry.step.si > MOST_TICKS:
        raise CampaignError(
            "too many steps",
            file=CASES,
            field=f"{where}.step",
            value=entry.step.si,
            allowed=f"at most {MOST_TICKS} steps along a path of {path.length_m:.4g} m",
        )
    turn = None
    if isinstance(shape, HelixEntry):
        turn = 2.0 * np.pi * shape.radius.si / (speed * np.cos(path.start_pitch))
    return TrajectoryCase(
        name=name,
        title=entry.title,
        path=path,
        speed_m_s=speed,
        step_s=entry.step.si,
        duration_s=duration,
        weights=entry.weights,
        riccati=entry.riccati,
        observer=entry.observer,
        feed_forward=entry.feed_forward,
        equilibrium=entry.equilibrium,
        epsilon_rad=entry.mass_change_over.si,
        transient_s=entry.transient.si,
        waiting=waiting,
        powered=powered,
        flights=tuple(_flight(key, flight) for key, flight in entry.flights.items()),
        turn_s=turn,
    )


def _powered(entry: PoweredEntry, weights: str) -> Powered:
    switch = ModeSwitch(
        entry.on_distance.si, entry.off_distance.si, entry.on_force.si, entry.off_force.si
    )
    return Powered(entry.speed.si, entry.weights or weights, switch)


def _flight(name: str, entry: FlightEntry) -> FlightCase:
    field = entry.force
    return FlightCase(
        name=name,
        title=entry.title,
        observer=entry.observer,
        clock=entry.clock,
        force=ForceField(
            field.constant.array,
            field.amplitude.array,
            field.rate.array,
            field.phase.array,
            field.start.si,
        ),
        current=None if entry.current is None else entry.current.array,
        headline=entry.headline,
        redesign=entry.redesign,
    )


def _path(entry: HelixEntry | SawToothEntry | DubinsEntry) -> Curve:
    ramp, start, heading = entry.ramp.si, entry.start.array, entry.heading.si
    if isinstance(entry, HelixEntry):
        return helix(
            radius_m=entry.radius.si,
            pitch_rad=entry.pitch.si,
            turns=entry.turns.si,
            starboard=not entry.port,
            ramp_m=ramp,
            start=start,
            heading_rad=heading,
        )
    if isinstance(entry, SawToothEntry):
        return saw_tooth(
            leg_m=entry.leg.si,
            pitch_rad=entry.pitch.si,
            tip_radius_m=entry.tip_radius.si,
            legs=round(entry.legs.si),
            ramp_m=ramp,
            start=start,
            heading_rad=heading,
        )
    bounds = Bounds(entry.radius.si, entry.pitch.si, entry.pitch_radius.si, ramp)
    return dubins_path(_pose(entry.first), _pose(entry.last), bounds)


def _pose(entry: PoseEntry) -> Pose:
    x, y, z = entry.position.array.tolist()
    return Pose(x, y, z, entry.heading.si, entry.pitch.si)
