"""Which axes of a log can be fitted one by one, or in one line why none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.units import NEUTRAL_US
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.commands import FullCommands, px4_thrusters
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES
from auvid.stages.ingest.health.finding import CheckedLog, limit, listed
from auvid.stages.leg_record.record import FREE_AXES, WORDS, RecordedLeg, leg_record
from auvid.stages.leg_record.refusal import fed_axes, refusal
from auvid.stages.leg_streams import Streams

FRAMES = {1: "bluerov2", 2: "bluerov2_heavy"}
"""ArduSub's FRAME_CONFIG -> vehicle: 1 vectored, 2 vectored 6-DOF."""
MOTORS_OF_VEHICLE = {6: "bluerov2", 8: "bluerov2_heavy"}
"""What an ROV with so many driven outputs most often is."""


def driven_outputs(log: CheckedLog) -> list[int]:
    """Return the outputs whose pulse leaves the dead band while the log runs."""
    numbers = []
    for name in log.thrusters():
        pulses = log.column("actuators", name)
        beyond = (np.abs(pulses - NEUTRAL_US) > limit("no_actuation")) & (pulses > 0.0)
        if beyond.any():
            numbers.append(int(name.split("_")[1]))
    return numbers


def likely_vehicle(log: CheckedLog) -> Vehicle:
    """Return the vehicle of a log: its own, of its frame, or one without newtons."""
    if log.vehicle is not None:
        return log.vehicle
    frame = log.info.parameters.get("FRAME_CONFIG")
    driven = driven_outputs(log) if log.has("actuators") else []
    name = MOTORS_OF_VEHICLE.get(len(driven)) if frame is None else FRAMES.get(int(frame))
    if frame is None and px4_thrusters(log.info.parameters) is not None:
        name = None  # the log has a geometry of its own
    path = SHIPPED_VEHICLES / f"{name or 'bluerov2'}.yaml"
    text = path.read_text(encoding="utf-8")
    vehicle = vehicle_from_document(VehicleDocument.model_validate(read_yaml(text)))
    return vehicle if name else replace(vehicle, thrusters=None, commands=FullCommands())


def whole_log(log: CheckedLog, vehicle: Vehicle) -> tuple[RecordedLeg, Streams]:
    """Return the record of a log as one leg."""
    start_us = int(log.info.start_us)
    window = (0.0, (int(log.info.end_us) - start_us) / 1e6)
    streams = Streams(log.tables, start_us, window, vehicle)
    return leg_record(streams, log.info, log.info.log), streams


@dataclass(frozen=True)
class FedAxes:
    """Axes (X .. N) that a log feeds one by one, or why none; what to know of them."""

    axes: tuple[str, ...] = ()
    why: str = ""
    normalised: bool = False
    warnings: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Return what can be fitted in one sentence."""
        if not self.axes:
            return f"No axis can be fitted by itself: {self.why}."
        names = listed([WORDS[axis] for axis in self.axes])
        unit = ", in full commands, not newtons" if self.normalised else ""
        return f"By itself can be fitted (kind: axes): {names}{unit}."


def axes_fed(log: CheckedLog) -> FedAxes:
    """Return the axes of a log that can be fitted, or in one line why none.

    Roll and pitch do not count: without a decay nothing tells their drag from restoring.
    """
    if log.under_water is False:
        return FedAxes(why="not an underwater vehicle")
    if not log.has("actuators"):
        return FedAxes(why="no actuators")
    try:
        result, streams = whole_log(log, likely_vehicle(log))
    except PipelineError as fault:
        return FedAxes(why=" ".join(str(fault).split()).rstrip("."))
    axes = tuple(axis for axis in fed_axes(result) if axis in FREE_AXES)
    why = refusal(result, streams, log.info)
    if not axes and not why:
        why = "only roll and pitch are driven and move, which a tilt-and-release decay tells"
    return FedAxes(axes, why, result.record.normalised, result.warnings)
