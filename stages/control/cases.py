"""The cases document of a control campaign as values.

Trajectories with their controllers, flights, limits and weights.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.hydro.arrays import Array
from auvid.hydro.control.closed_loop import ForceField
from auvid.hydro.control.controllers import Weights
from auvid.hydro.control.paths.dubins import Bounds, Pose, dubins_path
from auvid.hydro.control.paths.paths import Curve, helix, saw_tooth
from auvid.hydro.control.reference import ModeSwitch, Waiting
from auvid.hydro.dynamics.quantities import Quantities
from auvid.stages.base import Document


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
    kind: str
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


MOST_TICKS = 200_000
"""More are refused: a step that is wrong by a thousand shall not fill the memory."""


@contextmanager
def in_cases(where: str = "") -> Iterator[None]:
    """Add the document, and the place in it, to faults raised inside."""
    try:
        yield
    except CampaignError as fault:
        fault.file = fault.file or "the cases of the campaign"
        if where and fault.field and not fault.field.startswith(where):
            fault.field = f"{where}.{fault.field}"
        fault.args = (str(fault),)
        raise


def positive(read: Quantities, key: str, unit: str, *, default: float | None = None) -> float:
    """A quantity above zero. Raises `CampaignError` naming it."""
    value = read.number(key, unit, default=default)
    if not value > 0.0:
        raise CampaignError(
            "must be positive", field=read.where(key), value=value, allowed=f"> 0 {unit}"
        )
    return value


def limits_of(cases: Document) -> Limits:
    """Key `limits`. Raises `CampaignError` for what is not above zero."""
    with in_cases():
        read = Quantities(cases).part("limits")
        return Limits(
            positive(read, "fins", "rad"),
            positive(read, "fin_rate", "rad/s"),
            positive(read, "thrust_rate", "N/s", default=100.0),
            positive(read, "pitch", "rad"),
        )


@dataclass(frozen=True)
class Spread:
    """The Monte Carlo of the cases.

    `relative_sd` holds where no card gives a covariance.
    """

    trajectory: str
    flight: str
    duration_s: float
    relative_sd: float


def spread_of(cases: Document) -> Spread | None:
    """Return key `monte_carlo`, or None where there is none.

    Raises `CampaignError` for numbers that are not above zero.
    """
    entry = cases.get("monte_carlo")
    if not entry:
        return None
    with in_cases():
        read = Quantities(cases).part("monte_carlo")
        duration, relative = (
            positive(read, "duration", "s"),
            positive(read, "relative_sd", "1", default=0.1),
        )
    return Spread(str(entry["trajectory"]), str(entry["flight"]), duration, relative)


def weights_of(cases: Document) -> dict[str, Weights]:
    """Key `weights`: name -> weights."""
    with in_cases():
        read = Quantities(cases).part("weights")
        return {
            name: Weights(
                *(read.part(name).array(key, "1", shape=(-1,)) for key in ("Q", "R", "Q_Z", "R_Z"))
            )
            for name in cases["weights"]
        }


def trajectories_of(cases: Document) -> tuple[TrajectoryCase, ...]:
    """Key `trajectories`.

    Raises `CampaignError` for missing numbers, wrong units, impossible paths, unknown
    weights, a mode switch without waiting reference, and trajectories without a flight
    or with more ticks than `MOST_TICKS`.
    """
    read = Quantities(cases).part("trajectories")
    trajectories = []
    for name, entry in cases["trajectories"].items():
        with in_cases():
            trajectories.append(_trajectory(name, entry, read.part(name), cases["weights"]))
    return tuple(trajectories)


def _trajectory(
    name: str, entry: Document, read: Quantities, weights: Mapping[str, Any]
) -> TrajectoryCase:
    where = f"trajectories.{name}"
    for key, value in (
        (f"{where}.weights", entry["weights"]),
        (f"{where}.powered.weights", (entry.get("powered") or {}).get("weights")),
    ):
        if value is not None and value not in weights:
            raise CampaignError(
                "no such weights",
                field=key,
                value=value,
                allowed=tuple(weights),
                remedy=nearest(str(value), weights),
            )
    waiting, powered = None, None
    if entry.get("waiting"):
        part = read.part("waiting")
        waiting = Waiting(
            positive(part, "lead", "m"),
            positive(part, "catch_up", "s", default=float("inf")),
            positive(part, "fastest", "1", default=1.3),
        )
    if entry.get("powered"):
        part = read.part("powered")
        rule = ModeSwitch(
            part.number("on_distance", "m"),
            part.number("off_distance", "m"),
            part.number("on_force", "N"),
            part.number("off_force", "N"),
        )
        if rule.off_m > rule.on_m or rule.off_N > rule.on_N:
            words = "the propeller would stop before it starts"
            raise CampaignError(
                words,
                field=f"{where}.powered",
                value=f"off {rule.off_m:g} m, {rule.off_N:g} N",
                allowed="at most those of on",
            )
        powered = Powered(
            positive(part, "speed", "m/s"),
            str(entry["powered"].get("weights", entry["weights"])),
            rule,
        )
        if waiting is None:
            raise CampaignError(
                "a glide with a propeller needs a waiting reference",
                field=f"{where}.waiting",
                remedy="Give waiting: {lead}.",
            )
    speed, step = positive(read, "speed", "m/s"), positive(read, "step", "s")
    with in_cases(f"{where}.path"):
        path = _path(str(entry["kind"]), read.part("path"))
    duration = positive(read, "duration", "s") if "duration" in read else None
    slowest = min(speed, powered.speed_m_s) if powered else speed
    if max(path.length_m / slowest, duration or 0.0) / step > MOST_TICKS:
        allowed = f"at most {MOST_TICKS} steps along a path of {path.length_m:.4g} m"
        raise CampaignError("too many steps", field=f"{where}.step", value=step, allowed=allowed)
    if not entry["flights"]:
        raise CampaignError(
            "there is no flight",
            field=f"{where}.flights",
            remedy="Give flights: {undisturbed: {title: Undisturbed}}.",
        )
    turn = None
    if entry["kind"] == "helix":
        turn = (
            2.0
            * np.pi
            * read.part("path").number("radius", "m")
            / (speed * np.cos(path.start_pitch))
        )
    return TrajectoryCase(
        name=name,
        title=str(entry["title"]),
        kind=str(entry["kind"]),
        path=path,
        speed_m_s=speed,
        step_s=step,
        duration_s=duration,
        weights=str(entry["weights"]),
        riccati=str(entry.get("riccati", "backward")),
        observer=str(entry.get("observer", "kalman")),
        feed_forward=str(entry.get("feed_forward", "target")),
        equilibrium=str(entry.get("equilibrium", "trimmed")),
        epsilon_rad=positive(read, "mass_change_over", "rad", default=0.2),
        transient_s=read.number("transient", "s", default=10.0),
        waiting=waiting,
        powered=powered,
        flights=tuple(
            _flight(key, value, read.part("flights").part(key))
            for key, value in entry["flights"].items()
        ),
        turn_s=turn,
    )


def _flight(name: str, entry: Document, read: Quantities) -> FlightCase:
    part = read.part("force")
    units = {"constant": "N", "amplitude": "N", "rate": "rad/s", "phase": "rad"}
    force = ForceField(
        *(part.array(key, unit, shape=(3,), default=np.zeros(3)) for key, unit in units.items()),
        start_s=part.number("start", "s", default=0.0),
    )
    current = read.array("current", "m/s", shape=(3,)) if "current" in read else None
    flags = {
        key: bool(entry.get(key, False)) for key in ("observer", "clock", "headline", "redesign")
    }
    return FlightCase(name=name, title=str(entry["title"]), force=force, current=current, **flags)


def _path(kind: str, read: Quantities) -> Curve:
    ramp = read.number("ramp", "m", default=0.0)
    start = read.array("start", "m", shape=(3,), default=np.zeros(3))
    heading = read.number("heading", "rad", default=0.0)
    if kind == "helix":
        radius, turns = read.number("radius", "m"), read.number("turns", "1")
        pitch, starboard = read.number("pitch", "rad"), not read.plain("port", False)
        return helix(
            radius_m=radius,
            pitch_rad=pitch,
            turns=turns,
            starboard=starboard,
            ramp_m=ramp,
            start=start,
            heading_rad=heading,
        )
    if kind == "saw_tooth":
        return saw_tooth(
            leg_m=read.number("leg", "m"),
            pitch_rad=read.number("pitch", "rad"),
            tip_radius_m=read.number("tip_radius", "m"),
            legs=round(read.number("legs", "1")),
            ramp_m=ramp,
            start=start,
            heading_rad=heading,
        )
    bounds = Bounds(
        read.number("radius", "m"),
        read.number("pitch", "rad"),
        read.number("pitch_radius", "m"),
        ramp,
    )
    return dubins_path(_pose(read.part("first")), _pose(read.part("last")), bounds)


def _pose(read: Quantities) -> Pose:
    x, y, z = read.array("position", "m", shape=(3,))
    return Pose(
        float(x), float(y), float(z), read.number("heading", "rad"), read.number("pitch", "rad")
    )
