"""Added mass and damping of single channels: Alberti 2015, chapters III and V.

By recursive least squares and by output error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.logged_directions import with_logged_directions
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.bench.channel_records import CHANNELS, DAMPING, ChannelEstimate
from auvid.hydro.identification.bench.single_channel import (
    estimate_channel,
    recursive_fits,
    unexcited,
)
from auvid.stages.base import Stage, param, port
from auvid.stages.columns import leg_window, stacked
from auvid.stages.leg_streams import Streams
from auvid.stages.rlse.figures import channel_results, dry_mass, no_results, second_results
from auvid.stages.rlse.presentation import channel_section, channel_views, unexcited_section
from auvid.stages.rlse.run_of_leg import LegRun, run_of_leg


@dataclass(frozen=True)
class Inputs:
    """One leg, its log, the vehicle, and the raw streams of the log."""

    leg: LegEntry = port("leg")
    log_info: LogInfo = port("log_info")
    vehicle: Vehicle = port("vehicle")
    velocity: pa.Table | None = port("velocity", optional=True)
    imu: pa.Table | None = port("imu", optional=True)
    attitude: pa.Table | None = port("attitude", optional=True)
    depth: pa.Table | None = port("depth", optional=True)
    actuators: pa.Table | None = port("actuators", optional=True)
    battery: pa.Table | None = port("battery", optional=True)


@dataclass(frozen=True)
class Params:
    """Filter, estimator, and what counts as the force."""

    filter_rate_rad_s: float = param(
        "rad/s", 1.0, meaning="rate a of the regression filter (44)", low=1e-3, high=1e3
    )
    prior_spread: float = param(
        "1",
        1e6,
        meaning="initial covariance gamma_0 of every coefficient of (62)",
        low=1e-9,
        high=1e15,
    )
    second_prior_spread: float | None = param(
        "1",
        None,
        meaning="gamma_0 of a second recursive estimate, for comparison; null: none",
        low=1e-9,
        high=1e15,
    )
    memory_s: float = param(
        "s", 0.0, meaning="time constant of exponential forgetting; 0: none", low=0.0
    )
    lowest_trace: float = param(
        "1", 0.0, meaning="lower limit of the trace of the covariance; 0: none", low=0.0
    )
    highest_trace: float = param(
        "1", 1e12, meaning="upper limit of the trace of the covariance under forgetting", low=1e-9
    )
    constant_force: tuple[str, ...] = param(
        "1",
        ("heave",),
        meaning="channels in which a constant force is found too (net buoyancy)",
        names=CHANNELS,
    )
    use_commands: bool = param(
        "1", False, meaning="take normalised commands for the force even where pulses are logged"
    )
    max_gap_s: float = param(
        "s", 1.0, meaning="a longer pause of the measured signal splits the leg", low=0.01
    )


@dataclass(frozen=True)
class Outputs:
    """All None for a leg without a channel."""

    results: dict[str, Any] | None = port("results", optional=True)
    channel_run: pa.Table | None = port("channel_run", optional=True)
    channel_history: pa.Table | None = port("channel_history", optional=True)
    section: dict[str, Any] | None = port("section", optional=True)
    views: dict[str, Any] | None = port("views", optional=True)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return masses and damping of one leg.

    Raises `DataError` when a stream that its channel needs is missing or too short.
    """
    channel, leg = inputs.leg.channel, inputs.leg.id
    if channel is None:
        return Outputs()
    vehicle, direction_note = with_logged_directions(inputs.vehicle, inputs.log_info.parameters)
    start_us = int(inputs.log_info.start_us)
    names = ("velocity", "imu", "attitude", "depth", "actuators", "battery")
    tables = {name: getattr(inputs, name) for name in names}
    streams = Streams(
        tables, start_us, leg_window(inputs.leg, start_us, int(inputs.log_info.end_us)), vehicle
    )
    constant = channel in params.constant_force
    leg_run = run_of_leg(
        channel,
        streams,
        constant=constant,
        max_gap_s=params.max_gap_s,
        commands=params.use_commands,
        leg=leg,
        direction_note=direction_note,
    )
    reason = unexcited(leg_run.data)
    if reason:
        return Outputs(
            results=no_results(leg, leg_run, reason),
            section=unexcited_section(leg, leg_run, reason),
        )
    memory_s, limits = params.memory_s or None, (params.lowest_trace, params.highest_trace)
    estimate = estimate_channel(
        leg_run.data,
        filter_rate=params.filter_rate_rad_s,
        prior_spread=params.prior_spread,
        memory_s=memory_s,
        limits=limits,
    )
    dry = dry_mass(channel, vehicle, inputs.leg)
    results = channel_results(leg, leg_run, estimate, dry)
    if params.second_prior_spread is not None:
        fits, _ = recursive_fits(
            estimate.data,
            filter_rate=params.filter_rate_rad_s,
            prior_spread=params.second_prior_spread,
            memory_s=memory_s,
            limits=limits,
        )
        results["rows"] += second_results(leg_run, fits, dry, params.second_prior_spread)
    return Outputs(
        results=results,
        channel_run=_run_table(leg_run, estimate),
        channel_history=_history_table(estimate),
        section=channel_section(
            leg, leg_run, estimate, results, filter_rate=params.filter_rate_rad_s, dry=dry
        ),
        views=channel_views(leg, leg_run, estimate),
    )


def _run_table(leg_run: LegRun, estimate: ChannelEstimate) -> pa.Table:
    """Return measured and simulated signal at the samples of the run."""
    run, at = estimate.data.run, estimate.data.samples
    columns: dict[str, Any] = {
        "t_s": run.grid_s[at],
        "measured": leg_run.signal,
        "force": np.append(run.force_left, run.force_right[-1])[at],
    }
    for name in DAMPING:
        columns[name.replace(" ", "_")] = estimate.fits[name].simulated[at]
    columns["chosen"] = [estimate.chosen] * leg_run.signal.size
    return make_table("channel_run", columns)


def _history_table(estimate: ChannelEstimate) -> pa.Table:
    """Return the recursive estimates of all damping models, one after the other."""
    blocks = []
    for name in DAMPING:
        recursive, excited = estimate.recursive[name], estimate.excitation[name]
        t = recursive.estimate.t_s
        columns: dict[str, Any] = {"damping": [name] * t.size, "t_s": t}
        for index, quantity in enumerate(("mass", "linear", "quadratic")):
            columns[quantity] = recursive.values[:, index]
            columns[f"{quantity}_sd"] = recursive.spread[:, index]
        columns["smallest_eigenvalue"] = np.interp(t, excited.t_s, excited.smallest)
        blocks.append(columns)
    return make_table("channel_history", stacked(blocks))


STAGE = Stage(
    "rlse",
    "Added mass and damping of single-channel legs, by recursive least squares",
    "leg",
    Inputs,
    Params,
    Outputs,
    run,
)
