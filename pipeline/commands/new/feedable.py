"""Which kind of campaign a log can feed: every route in one place, tried in order.

A new route is a function like those below and its place in ROUTES.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import PipelineError
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.regression.excitation import THRESHOLDS
from auvid.hydro.identification.selection.leg_proposal import (
    LegProposal,
    ProposedLeg,
    propose_channel_legs,
    propose_legs,
)
from auvid.pipeline.commands.check.axes_route import axes_fed, likely_vehicle
from auvid.pipeline.commands.check.log_page import LogPage
from auvid.pipeline.commands.new.refusal import NO_ACTUATORS, NOT_UNDER_WATER
from auvid.pipeline.commands.new.vehicle_choice import unbundled_frame
from auvid.stages import passive as passive_stage
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.finding import CheckedLog, listed
from auvid.stages.ingest.health.leg_pieces import pieces_of
from auvid.stages.ingest.health.usability import (
    NO_STATE,
    PASSIVE,
    SHORTEST_DRIVEN_S,
    driven_s,
    glider_lacks,
)
from auvid.stages.passive.motions import MotionRules, motions_of, read_leg

CHANNELS = ("u", "v", "w", "r")
"""Channels of which one alone can be told; roll and pitch need the restoring moment."""
LEAST_SAMPLES = 50
STREAMS_OF_AXES = ("imu", "attitude", "depth", "velocity", "actuators")
SHORTEST_JUDGING_S = 30.0
"""A run that is held out whole lasts so long."""
STEPS_PER_GAP = 4.0
"""A coarse clock leaves out single samples; so many steps are a pause."""


@dataclass(frozen=True)
class CampaignFeed:
    """What a log feeds: kind of campaign, streams of its legs, longest pause [s].

    `channels`: velocities of a campaign of single channels, `axes` of one of axes.
    `normalised`: they are driven
    by commands without a unit of force, so that the vehicle file gives no force.
    """

    kind: str
    streams: tuple[str, ...]
    max_gap_s: float = 1.0
    channels: tuple[str, ...] = ()
    normalised: bool = False
    axes: tuple[str, ...] = ()


def force_model(log: CheckedLog, health: Mapping[str, Any]) -> CampaignFeed | str:
    """Return the feed of a force model in six axes, or what the log lacks for it."""
    if log.under_water is False:
        return NOT_UNDER_WATER
    if log.vehicle is not None and is_passive(log.vehicle):
        return PASSIVE
    rows = {item["name"]: item for item in health["capabilities"]}
    needed = ("resample", "fuse (kinematic)", "residual")
    lacking = [str(rows[name]["reason"]) for name in needed if not rows[name]["possible"]]
    if lacking:
        return "; ".join(dict.fromkeys(why for why in lacking if why != NO_STATE))
    axes = [item for name, item in rows.items() if name.startswith("synthesise ")]
    if not any(item["possible"] for item in axes):
        return "; ".join(dict.fromkeys(str(item["reason"]) for item in axes))
    feed = CampaignFeed("identification", ("attitude", "imu", "depth", "velocity", "actuators"))
    uses = {leg.use for leg in proposal(feed, [log]).legs}
    if len(uses) < 2:
        return (
            "no two stretches of 8 s, one to fit and one to judge, in which it moves under its"
            " own thrust, armed and submerged, with every sensor there"
        )
    return feed


def single_channels(log: CheckedLog, health: Mapping[str, Any]) -> CampaignFeed | str:
    """Return how a log feeds single channels, or what it lacks."""
    if log.under_water is False:
        return NOT_UNDER_WATER
    if not log.has("actuators"):
        return NO_ACTUATORS
    commands = {name.removeprefix("command_") for name in log.commands()}
    if not log.thrusters() and not commands:
        return "no pulses of thrusters and no commands of surge, sway, heave or yaw"
    acting = activity(log)
    if acting is None or not acting.any():
        return "no actuator acts"
    if driven_s(log) < SHORTEST_DRIVEN_S:
        return f"outputs act for {driven_s(log):.1f} s only, {SHORTEST_DRIVEN_S:g} s are needed"
    normalised = not log.thrusters()
    sensors = {
        "u": "velocity",
        "v": "velocity",
        "w": "velocity" if log.has("velocity") else "depth",
        "r": "imu" if log.has("imu") else "attitude",
    }
    measured = [
        axis
        for axis in CHANNELS
        if log.has(sensors[axis]) and (not normalised or MOTION_WORDS[axis] in commands)
    ]
    enough = [axis for axis in measured if log.t_s(sensors[axis]).size >= LEAST_SAMPLES]
    if not enough:
        driven = f" (driven: {listed(sorted(commands))})" if normalised else ""
        return f"nothing measures a channel that is driven{driven}: depth, velocity or gyro"
    streams = tuple(dict.fromkeys([*(sensors[axis] for axis in enough), "actuators"]))
    pause = max(1.0, *(STEPS_PER_GAP * _step_s(log, name) for name in streams))
    feed = CampaignFeed("bench", streams, round(pause, 1), tuple(enough), normalised)
    moving = proposal(feed, [log]).axes
    if not moving:
        names = listed([MOTION_WORDS[axis] for axis in enough])
        least = listed([f"{THRESHOLDS[axis]:g}" for axis in enough[:1]])
        return f"hardly any motion in {names} while driven and submerged (RMS below {least})"
    return CampaignFeed("bench", streams, round(pause, 1), moving, normalised)


def glides(log: CheckedLog, health: Mapping[str, Any]) -> CampaignFeed | str:
    """Return how a log feeds drag and lift of a glider, or what it lacks."""
    if not log.has("glider"):
        return "no column of a buoyancy drive"
    lacking = glider_lacks(log)
    return lacking if lacking is not None else CampaignFeed("glide", ("glider",))


def passive_motions(log: CheckedLog, health: Mapping[str, Any]) -> CampaignFeed | str:
    """Return how a log feeds a body without actuators, or what it lacks.

    A tow force tells that nothing on board drives it, or a vehicle file without actuators.
    """
    if log.under_water is False:
        return NOT_UNDER_WATER
    if log.has("actuators") and _drives(log):
        return "something on board drives it"
    passive = log.vehicle is not None and is_passive(log.vehicle)
    if not log.has("tow") and not passive:
        return (
            "no tow force, and no vehicle file without actuators (--vehicle passive_body) says that"
            " nothing on board drives it"
        )
    vehicle = likely_vehicle(log)
    leg = LegEntry(id="log", log=log.info.log)
    tables = {name: log.tables.get(name) for name in passive_stage.STREAMS}
    try:
        read = read_leg(leg, tables, log.info, vehicle, rate_hz=20.0, max_gap_s=1.0)
    except PipelineError as fault:
        return " ".join(str(fault).split())
    motions = motions_of([read], MotionRules(0.1, 0.2, 8.0), vehicle)
    if motions.empty:
        causes = "; ".join(motions.left_out[:2])
        return "it neither is towed nor coasts nor swings" + (f" ({causes})" if causes else "")
    return CampaignFeed("passive", tuple(name for name in passive_stage.STREAMS if log.has(name)))


def _drives(log: CheckedLog) -> bool:
    """Return whether outputs ever act: an autopilot under tow logs outputs at rest."""
    acting = activity(log)
    return acting is None or bool(acting.any())


def is_passive(vehicle: Vehicle) -> bool:
    """Return whether nothing on board drives a vehicle."""
    return all(part is None for part in (vehicle.thrusters, vehicle.propeller, vehicle.fins))


def single_axes(log: CheckedLog, health: Mapping[str, Any]) -> CampaignFeed | str:
    """Return how a log feeds fits of single axes, or why it does not."""
    fed = axes_fed(log)
    if not fed.axes:
        return fed.why
    streams = tuple(name for name in STREAMS_OF_AXES if log.has(name))
    axes = tuple(VELOCITIES[AXES.index(axis)] for axis in fed.axes)
    return CampaignFeed("axes", streams, axes=axes, normalised=fed.normalised)


ROUTES: dict[str, Callable[[CheckedLog, Mapping[str, Any]], CampaignFeed | str]] = {
    "identification": force_model,
    "axes": single_axes,
    "bench": single_channels,
    "glide": glides,
    "passive": passive_motions,
}
"""What each kind of campaign is fed, or why a log cannot feed it; the better first."""


def feed_of(
    page: LogPage, vehicle: Vehicle | None = None, *, named: bool = False
) -> CampaignFeed | dict[str, str]:
    """Return what a log feeds, or by kind of campaign why it feeds none.

    named: the user names a vehicle. Else one of a frame that none has is in full commands.
    """
    assert page.health is not None
    log = checked(page, vehicle)
    reasons: dict[str, str] = {}
    unscaled = "" if named else unbundled_frame(log)
    for kind, route in ROUTES.items():
        without = unscaled if kind == "identification" else ""
        feed = without or route(log, page.health)
        if isinstance(feed, CampaignFeed):
            return feed
        reasons[kind] = feed
    return reasons


def checked(page: LogPage, vehicle: Vehicle | None = None) -> CheckedLog:
    """Return the log of a health page."""
    assert page.outputs is not None
    return CheckedLog(page.streams, page.outputs.log_info, page.outputs.dropped, vehicle)


def proposal(feed: CampaignFeed, logs: list[CheckedLog]) -> LegProposal:
    """Return the legs that are proposed in logs of one kind of campaign."""
    if feed.kind in ("glide", "axes", "passive"):
        spans = [(int(log.info.end_us) - int(log.info.start_us)) / 1e6 for log in logs]
        judge = judging_log([axes_fed(log).axes for log in logs], spans) if feed.axes else None
        legs = (
            ProposedLeg(n, 0.0, end, "validation" if n == judge else "training", (), ())
            for n, end in enumerate(spans)
        )
        return LegProposal(tuple(legs), (), {})
    dives = [pieces_of(log, feed.streams, max_gap_s=feed.max_gap_s) for log in logs]
    return propose_channel_legs(dives, feed.channels) if feed.channels else propose_legs(dives)


def judging_log(axes: Sequence[Sequence[str]], spans_s: Sequence[float]) -> int | None:
    """Return the number of the log that judges the others, or None.

    axes: those that each log feeds. It is long enough, the others feed every axis that it
    feeds, and it feeds as many as any such log; the shortest of those.
    """
    able = [
        n
        for n, (own, span) in enumerate(zip(axes, spans_s, strict=True))
        if own
        and span >= SHORTEST_JUDGING_S
        and set(own) <= {axis for m, other in enumerate(axes) if m != n for axis in other}
    ]
    return min(able, key=lambda n: (-len(axes[n]), spans_s[n]), default=None)


def _step_s(log: CheckedLog, stream: str) -> float:
    times = log.t_s(stream)
    return float(times[-1] - times[0]) / max(times.size - 1, 1)
