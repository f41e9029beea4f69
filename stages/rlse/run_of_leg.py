"""One run of one channel from the raw streams of a log: measured signal and force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.streams import supply_text
from auvid.data_schemas.tables import column, has_columns
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.propeller import propeller_force
from auvid.hydro.dynamics.actuators.thrusters import thruster_force, thruster_forces
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.bench.channel_records import CHANNELS, ChannelRun
from auvid.hydro.identification.bench.output_error import SingleRun
from auvid.hydro.identification.regression.excitation import THRESHOLDS
from auvid.hydro.identification.signals.resampling import gaps
from auvid.hydro.identification.signals.splines import smoothing_spline
from auvid.stages.columns import ATTITUDE, VELOCITY, Samples, span_text
from auvid.stages.leg_streams import Streams

MIN_SAMPLES = 20
SAME_TIME_S = 1e-9
NO_FORCE = 1e-9
"""Share of a thruster's force below which thrusters that cancel give none."""


@dataclass(frozen=True)
class LegRun:
    """The run of a leg: what was `measured`, its values `signal` (n,), and its data.

    normalised: the force is a command without a unit.
    """

    data: ChannelRun
    channel: str
    normalised: bool
    measured: str
    signal: Array
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def run_of_leg(
    channel: str,
    streams: Streams,
    *,
    constant: bool,
    max_gap_s: float,
    commands: bool,
    leg: str,
    direction_note: str = "",
) -> LegRun:
    """Return the run of a leg.

    Raises `DataError` when a stream that the channel needs is missing or too short, or
    no actuator was logged.
    """
    index = CHANNELS.index(channel)
    notes: list[str] = []
    warnings: list[str] = []
    rate, position, measured = _measured(channel, streams, leg)
    kept = _longest(rate if rate is not None else position, max_gap_s, leg, warnings)
    rate = None if rate is None else rate.between(*kept)
    position = None if position is None else position.between(*kept)
    drive = _drive(index, streams, kept, commands, leg, notes)
    if direction_note and not drive.normalised:
        notes.append(direction_note)
    signal = rate if rate is not None else position
    assert signal is not None
    first, last = max(signal.t_s[0], drive.t_s[0]), min(signal.t_s[-1], drive.end_s + max_gap_s)
    rate = None if rate is None else rate.between(first, last)
    position = None if position is None else position.between(first, last)
    signal = rate if rate is not None else position
    if signal is None or signal.t_s.size < MIN_SAMPLES:
        raise _too_few(signal, leg)
    if position is not None and position.t_s.size < 2:
        position = None
    first, last = signal.t_s[0], signal.t_s[-1]
    changes = drive.t_s[(drive.t_s > first) & (drive.t_s < last)]
    grid = np.unique(
        np.concatenate([signal.t_s, changes, [] if position is None else position.t_s])
    )
    x = _velocity(signal, grid, rate is not None)
    left, right = drive.over(grid, x, streams.vehicle, index)
    restoring = _restoring(channel, streams.vehicle, notes)
    if channel == "pitch":
        coupling = _munk(streams, grid, notes, leg)
        left, right = left + coupling[:-1], right + coupling[1:]
    none, empty = np.zeros(0, dtype=np.intp), np.zeros(0)
    run = SingleRun(
        grid,
        left,
        right,
        none if rate is None else np.searchsorted(grid, rate.t_s),
        empty if rate is None else rate.values[:, 0],
        none if position is None else np.searchsorted(grid, position.t_s),
        empty if position is None else position.values[:, 0],
    )
    data = ChannelRun(
        run,
        x - _gyro_bias(run, index),
        np.searchsorted(grid, signal.t_s),
        restoring=restoring,
        constant=constant,
        rate_bias=rate is not None and index > 2,
        # A constant force and a constant of the velocity (a current, or the sensor's
        # zero) are hardly told apart.
        current=rate is not None and not constant,
        lag=channel != "pitch" and drive.propeller_rev_s is None,
        noise=THRESHOLDS["uvwpqr"[index]],
    )
    return LegRun(
        data,
        channel,
        drive.normalised,
        measured,
        signal.values[:, 0],
        tuple(notes),
        tuple(warnings),
    )


@dataclass(frozen=True)
class Drive:
    """Input of a channel: `values` (m,) held from t_s (m,) on, and propeller speed."""

    t_s: Array
    values: Array
    end_s: float
    normalised: bool
    propeller_rev_s: Array | None = None

    def over(self, grid: Array, x: Array, vehicle: Vehicle, index: int) -> tuple[Array, Array]:
        """Return the force at both ends of every step of the grid (n,): two of (n-1,).

        Held, but for a propeller, whose thrust depends on speed.
        """
        at = np.searchsorted(self.t_s, grid[:-1] + SAME_TIME_S, side="right") - 1
        commanded = self.values[at]
        if self.propeller_rev_s is None or vehicle.propeller is None:
            return commanded, commanded.copy()
        nu = np.zeros((grid.size, 6))
        nu[:, 0] = x
        turns = self.propeller_rev_s[at]
        ends = (nu[:-1], nu[1:])
        left, right = (
            propeller_force(vehicle.propeller, end, turns, water_density=vehicle.water_density)[
                :, index
            ]
            for end in ends
        )
        return commanded + left, commanded + right


def _measured(
    channel: str, streams: Streams, leg: str
) -> tuple[Samples | None, Samples | None, str]:
    """Return rate and position samples of a channel, and the name of the signal."""
    index, vehicle = CHANNELS.index(channel), streams.vehicle
    gyro = streams.gyro()
    if index < 3:
        velocity = streams.velocity()
        if velocity is not None:
            body = velocity.values[:, index : index + 1]
            return Samples(velocity.t_s, body), None, f"velocity {VELOCITY[index][0]}"
        depth = (
            streams.samples("depth", ("depth_m",), vehicle.depth_sensor.lag_s)
            if channel == "heave"
            else None
        )
        if depth is None or not depth.t_s.size:
            more = " or 'depth'" if channel == "heave" else ""
            raise _missing("velocity", leg, f"{more} for {channel}")
        return None, depth, "depth"
    angle = streams.samples("attitude", (ATTITUDE[index - 3],))
    if angle is not None and channel == "yaw":
        angle = Samples(angle.t_s, np.unwrap(angle.values, axis=0)) if gyro is None else None
    if gyro is not None:
        gyro = Samples(gyro.t_s, gyro.values[:, index - 3 : index - 2])
    if gyro is None and angle is None:
        raise _missing("imu", leg, f" or 'attitude' for {channel}")
    return (
        gyro,
        angle,
        (
            f"rate {'pqr'[index - 3]}"
            if gyro is not None
            else f"angle {('phi', 'theta', 'psi')[index - 3]}"
        ),
    )


def _missing(stream: str, leg: str, more: str) -> DataError:
    return DataError(
        f"leg '{leg}' needs the stream '{stream}'{more}",
        remedy=f"It can come from: {supply_text(stream)}.",
    )


def _too_few(signal: Samples | None, leg: str) -> DataError:
    return DataError(
        f"too few samples in leg '{leg}'",
        value=0 if signal is None else signal.t_s.size,
        allowed=f"at least {MIN_SAMPLES}",
    )


def _longest(
    signal: Samples | None, max_gap_s: float, leg: str, warnings: list[str]
) -> tuple[float, float]:
    """Return the longest gap-free part of a signal; a warning tells of the rest."""
    if signal is None or signal.t_s.size < MIN_SAMPLES:
        raise _too_few(signal, leg)
    parts = [
        (float(signal.t_s[a]), float(signal.t_s[b - 1])) for a, b in gaps(signal.t_s, max_gap_s)
    ]
    best = max(parts, key=lambda part: part[1] - part[0])
    if len(parts) > 1:
        lost = signal.t_s[-1] - signal.t_s[0] - (best[1] - best[0])
        warnings.append(
            f"Leg {leg} has {len(parts) - 1} gaps of more than {max_gap_s:g} s: the longest part"
            f" without one is used, {span_text(best)}; {lost:.0f} s are left out."
        )
    return best


def _drive(
    index: int,
    streams: Streams,
    kept: tuple[float, float],
    commands: bool,
    leg: str,
    notes: list[str],
) -> Drive:
    """Return the force of thrusters and propeller, else the normalised command."""
    table, vehicle = streams.tables.get("actuators"), streams.vehicle
    if table is None:
        raise _missing("actuators", leg, "")
    t = (column(table, "time_us") - streams.start_us) / 1e6
    rows = np.arange(
        max(int(np.searchsorted(t, kept[0], side="right")) - 1, 0),
        int(np.searchsorted(t, kept[1], side="right")),
    )
    command = f"command_{CHANNELS[index]}"
    pulses = (
        ()
        if vehicle.thrusters is None
        else tuple(f"pwm_{number}_us" for number in vehicle.thrusters.outputs)
    )
    has_pulses = bool(pulses) and has_columns(table, pulses)
    has_propeller = vehicle.propeller is not None and has_columns(table, ("propeller_rev_s",))
    if commands or not (has_pulses or has_propeller):
        if not has_columns(table, (command,)):
            raise DataError(
                f"leg '{leg}' has no force or command for {CHANNELS[index]}",
                field="actuators",
                value=", ".join(table.column_names),
                allowed=(
                    f"{', '.join(pulses) or 'pulses of the thrusters'}, propeller_rev_s, or"
                    f" {command}"
                ),
            )
        values = column(table, command)[rows]
        notes.append(
            "The log has commands without a unit of force: only ratios can be estimated (Alberti,"
            " equation 62), not masses."
        )
        return _drive_of(t[rows], values, None, normalised=True, leg=leg)
    force = np.zeros(rows.size)
    if has_pulses:
        assert vehicle.thrusters is not None
        width = np.column_stack([column(table, name)[rows] for name in pulses])
        each = thruster_forces(vehicle.thrusters, width, streams.voltage(t[rows]))
        force = thruster_force(vehicle.thrusters, each)[:, index]
        force[np.abs(force) < NO_FORCE * np.abs(each).max(axis=1)] = 0.0
    turns = column(table, "propeller_rev_s")[rows] if has_propeller and index == 0 else None
    return _drive_of(t[rows], force, turns, normalised=False, leg=leg)


def _drive_of(t: Array, values: Array, turns: Array | None, *, normalised: bool, leg: str) -> Drive:
    """Return the drive without missing (nan) and repeated samples."""
    finite = np.isfinite(values) if turns is None else np.isfinite(values) & np.isfinite(turns)
    if not finite.any():
        raise DataError(
            f"the actuators are empty in leg '{leg}'",
            field="actuators",
            remedy="Choose a leg in which commands are logged.",
        )
    t, values, end = t[finite], values[finite], float(t[finite][-1])
    turns = None if turns is None else turns[finite]
    new = np.append(
        True, (np.diff(values) != 0.0) | (np.diff(turns) != 0.0 if turns is not None else False)
    )
    return Drive(t[new], values[new], end, normalised, None if turns is None else turns[new])


def _velocity(signal: Samples, grid: Array, is_rate: bool) -> Array:
    """Return x on the grid: linear between rates, or the slope of a position spline."""
    if is_rate:
        return np.interp(grid, signal.t_s, signal.values[:, 0])
    return smoothing_spline(signal.t_s, signal.values[:, 0]).evaluate(grid, 1)


def _restoring(channel: str, vehicle: Vehicle, notes: list[str]) -> float:
    """Return R = W z_G - B z_B [N m] of roll and pitch, of the vehicle file.

    Alberti (63)-(64).
    """
    if channel not in ("roll", "pitch"):
        return 0.0
    lever = float(vehicle.weight * vehicle.r_G[2] - vehicle.buoyancy * vehicle.r_B[2])
    notes.append(
        f"Restoring moment of {channel}: {lever:.4g} N m at 90 degrees, from weight, buoyancy and"
        " centres of the vehicle file."
    )
    return lever


def _munk(streams: Streams, grid: Array, notes: list[str], leg: str) -> Array:
    """Return the Munk moment -(Z_wdot - X_udot) u w (n,) [N m], (64) corrected."""
    samples = streams.samples("velocity", VELOCITY[:3], streams.vehicle.dvl.lag_s)
    if samples is None or samples.t_s.size < 2:
        raise _missing("velocity", leg, " for pitch")
    body = samples.values @ streams.vehicle.dvl.rotation.T
    u, w = (np.interp(grid, samples.t_s, body[:, axis]) for axis in (0, 2))
    difference = float(streams.vehicle.added_mass[2, 2] - streams.vehicle.added_mass[0, 0])
    notes.append(
        f"Pitch is driven by -(Z_wdot - X_udot) u w with Z_wdot - X_udot = {difference:.4g} kg of"
        " the vehicle file."
    )
    return np.asarray(-difference * u * w)


def _gyro_bias(run: SingleRun, index: int) -> float:
    """Return the gyro bias [rad/s]: mean rate less the turn of the angle; else 0."""
    if index < 3 or not (run.rate.size and run.position.size > 1):
        return 0.0
    t, at = run.grid_s[run.rate_at], run.grid_s[run.position_at]
    first, last = max(t[0], at[0]), min(t[-1], at[-1])
    turn = np.diff(np.interp([first, last], at, run.position))[0]
    inside = (t >= first) & (t <= last)
    area = float(np.sum(0.5 * (run.rate[inside][1:] + run.rate[inside][:-1]) * np.diff(t[inside])))
    return float((area - turn) / (t[inside][-1] - t[inside][0]))
