"""An identified model in Python: its numbers, forces, motion, file and exports."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from auvid.arguments import (
    refuse_missing,
    row_of_six,
    rows_or_one,
    six_columns,
    time_series,
    uniform_clock,
)
from auvid.data_schemas.errors import UsageError
from auvid.data_schemas.records.model_file import ModelFile
from auvid.hydro import model_file
from auvid.hydro.arrays import AXES, STATES, Array
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.equations_of_motion import Control
from auvid.hydro.dynamics.simulation.free_run import MeasuredMotion, fly_freely
from auvid.hydro.dynamics.steady_motion import TIPPED_RAD
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.force_input import driven_by_force
from auvid.hydro.identification.axes.drive import MIXED, SIGNS
from auvid.hydro.model_file import ModelForces
from auvid.hydro.partial_model import imposed, uncoupled
from auvid.pipeline.store.model_files import read_model, write_model
from auvid.stages.columns import POSE, VELOCITY

STATE_COLUMNS = (*VELOCITY, *POSE)
UNITS = tuple(unit for unit in ("m/s", "rad/s", "m", "rad") for _ in range(3))


class VehicleModel:
    """One identified model of a vehicle: `auvid.Model`.

    Attributes
    ----------
    file : ModelFile
        All that is known of it, as docs/model_file.md describes.
    name, title : str
        Its name, and as printed.
    recommended : bool
        Whether its run advises to take it.
    use : str
        What it may be used for, in words.
    axes : tuple of str
        Axes that it has: all six, but for a partial model.
    lacking : dict
        Axis -> why a partial model does not have it.
    inertia : ndarray, shape (6, 6)
        M, rigid body and added mass, with the inertia that was fitted.
    coefficients : pandas.DataFrame
        Values, 95 % intervals and verdicts by symbol.
    """

    def __init__(self, file: ModelFile) -> None:
        self.file = file

    def __repr__(self) -> str:
        return f"Model({self.name!r}: {self.use})"

    @classmethod
    def load(cls, path: str | PathLike[str]) -> VehicleModel:
        """Read a model file.

        Parameters
        ----------
        path : path
            As ``runs/CAMPAIGN/model_file/model_file/MODEL.json``.

        Returns
        -------
        Model
            The model.

        Raises
        ------
        PipelineError
            Not a model file, one of another format, or one with faults.
        """
        file = read_model(Path(path))
        model_file.vehicle_of(file)
        return cls(file)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the model file and return its path; `load` gives the same model."""
        write_model(self.file, Path(path))
        return Path(path)

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.file.name

    @property
    def title(self) -> str:
        """Name as printed."""
        return self.file.title

    @property
    def recommended(self) -> bool:
        """Return whether the run advises to take this model."""
        return self.file.use.recommended

    @property
    def use(self) -> str:
        """Return what the model may be used for, in words."""
        return self.file.use.sentence

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that the model has, X to N."""
        return model_file.axes_of(self.file)

    @property
    def lacking(self) -> dict[str, str]:
        """Axis -> why the model does not have it; empty for a whole one."""
        part = self.file.partial
        if part is None:
            return {}
        return {axis: f"{item.verdict}: {item.words}" for axis, item in part.lacking.items()}

    @property
    def inertia(self) -> Array:
        """M (6, 6) [kg, kg m, kg m^2], or in the unit of mass of a normalised model."""
        return model_file.inertia(self.file)

    @property
    def vehicle(self) -> Vehicle:
        """Return the vehicle with the inertia that was fitted."""
        return model_file.vehicle_of(self.file)

    @property
    def coefficients(self) -> pd.DataFrame:
        """Coefficients of the viscous force, indexed by symbol.

        Constant forces have rows too, where the run fitted them; "7 of 18" in its report
        counts the others, of which 7 are determined.

        Columns value (nan where the run gives none), unit, low and high (95 % by noise),
        standard_error, low_assumed and high_assumed (95 % by assumed figures of the
        vehicle), low_total and high_total (95 % by both together), nan where either is
        not known, axis, term, determined, verdict; of a partial model also source, empty
        where the logs of the run are it. pandas prints the first and the last of them.
        """
        nothing = [np.nan, np.nan]
        rows = [
            {
                "symbol": item.symbol,
                "value": item.value,
                "unit": item.unit,
                **dict(zip(("low", "high"), item.interval_95 or nothing, strict=True)),
                "standard_error": item.standard_error,
                **dict(
                    zip(
                        ("low_assumed", "high_assumed"),
                        item.interval_95_assumed or nothing,
                        strict=True,
                    )
                ),
                **dict(
                    zip(("low_total", "high_total"), item.interval_95_total or nothing, strict=True)
                ),
                "axis": item.axis,
                "term": item.term,
                "determined": item.determined,
                "verdict": item.verdict,
                **({} if self.file.partial is None else {"source": item.source or ""}),
            }
            for item in self.file.coefficients
        ]
        frame = pd.DataFrame(rows).set_index("symbol")
        return frame.astype({"value": float, "standard_error": float})

    def force(
        self,
        nu: ArrayLike,
        eta: ArrayLike | None = None,
        *,
        propeller_rev_s: ArrayLike | None = None,
    ) -> ModelForces:
        """Return the forces of the model at velocities and poses.

        M nu_dot + coriolis = viscous + restoring + tau of the actuators.

        Parameters
        ----------
        nu : array_like, shape (n, 6) or (6,)
            Velocities u v w [m/s], p q r [rad/s] through the water.
        eta : array_like, shape (n, 6) or (6,), optional
            Pose x y z [m], phi theta psi [rad]; level by default.
        propeller_rev_s : array_like, shape (n,) or scalar, optional
            Propeller speed, for models with the propulsion ratio.

        Returns
        -------
        ModelForces
            ``coriolis``, ``viscous``, ``restoring``, each of the shape of `nu` [N, N m].

        Raises
        ------
        PipelineError
            Shapes that do not fit, values that are not finite.
        """
        nu = six_columns(nu, "nu")
        count = len(np.atleast_2d(nu))
        pose = np.zeros((count, 6)) if eta is None else rows_or_one(eta, count, "eta")
        speed = time_series(propeller_rev_s, count, 0, "propeller_rev_s")
        parts = model_file.forces(self.file, np.atleast_2d(nu), pose, speed)
        shaped = (part.reshape(nu.shape) for part in vars(parts).values())
        return ModelForces(*shaped)

    def simulate(
        self,
        time: ArrayLike,
        tau: ArrayLike | None = None,
        *,
        pulses: ArrayLike | None = None,
        fins: ArrayLike | None = None,
        propeller_rev_s: ArrayLike | None = None,
        voltage: ArrayLike | None = None,
        commands: Mapping[str | int, ArrayLike] | None = None,
        nu: ArrayLike = (0.0,) * 6,
        eta: ArrayLike = (0.0,) * 6,
    ) -> pd.DataFrame:
        """Simulate the vehicle with this model.

        Runge-Kutta of fourth order with the steps of `time`, in which the actuators
        change linearly. The lag of the actuators that was fitted is in it. A partial
        model moves along the axes that it has; the velocities of the others, and the
        angles of other rotations, stay what they are at the start.

        Parameters
        ----------
        time : array_like, shape (n,)
            Uniform clock [s].
        tau : array_like, shape (n, 6) or (6,), optional
            Force of all actuators [N, N m], in place of pulses, fins and voltage; 0 only,
            for a model without newtons (``file.partial.unit_of_mass``).
        pulses : array_like, shape (n, k), optional
            Pulses of the thrusters [us].
        fins : array_like, shape (n, 4), optional
            Deflections [rad]: starboard, port, bottom, top.
        propeller_rev_s : array_like, shape (n,) or scalar, optional
            Propeller speed [1/s]; beside `tau` it gives the propulsion ratio alone.
        voltage : array_like, shape (n,) or scalar, optional
            Battery voltage [V]; by default that of the thrust curve.
        commands : mapping of array_like, shape (n,) or scalar, optional
            Axis (``"Z"``) or output channel -> share of a full command, -1 to 1, for a
            model with gains (``file.partial.gains``).
        nu, eta : array_like, shape (6,)
            Velocity and pose at the start.

        Returns
        -------
        pandas.DataFrame
            t_s, velocities and pose; nan from where the model leaves all bounds on.
            ``attrs["warnings"]`` names velocities beyond the range of the training legs;
            ``attrs["held"]`` the states that a partial model does not simulate.

        Raises
        ------
        PipelineError
            Neither a force nor commands, the clock is not uniform, shapes do not fit,
            values are not finite, an actuator has no command, a command has no actuator,
            `tau` stands beside commands, or is a force on a model without newtons.
        """
        t_s = uniform_clock(time)
        count, vehicle = len(t_s), self.vehicle
        partial, in_newtons = self.file.partial, commands is None
        if commands is not None:
            if tau is not None:
                raise UsageError(
                    "give the force of the actuators or their commands", value=["tau", "commands"]
                )
            tau = _force_of(self.file, commands, count)
        screw, level = vehicle.propeller, None
        thrusters = 0 if vehicle.thrusters is None else len(vehicle.thrusters.outputs)
        others = {"pulses": pulses, "fins": fins, "voltage": voltage}
        if tau is None and vehicle.thrusters is not None:
            del others["pulses"], others["voltage"]
        if tau is None and vehicle.fins is not None:
            del others["fins"]
        if screw is None:
            others["propeller_rev_s"] = propeller_rev_s
        idle = [name for name, values in others.items() if values is not None]
        if idle and tau is not None:
            raise UsageError(
                "give the force of the actuators or their commands", value=["tau", *idle]
            )
        if idle:
            raise UsageError("the vehicle has no actuator for a command", value=idle)
        if tau is None:
            refuse_missing(
                {
                    f"pulses (n, {thrusters})": (vehicle.thrusters, pulses),
                    "fins (n, 4)": (vehicle.fins, fins),
                    "propeller_rev_s (n,)": (screw, propeller_rev_s),
                }
            )
        speed = time_series(propeller_rev_s, count, 0, "propeller_rev_s")
        if tau is not None:
            force = rows_or_one(tau, count, "tau")
            if in_newtons and partial is not None and partial.unit_of_mass and force.any():
                raise UsageError(
                    f"the model has no newtons: the inertia of {partial.unit_of_mass} is its unit",
                    field="tau",
                    remedy="Give commands, or make the model with one bollard pull or the mass.",
                )
            vehicle, control = driven_by_force(vehicle), Control(thruster_force_N=force)
        else:
            control = Control(
                propeller_rev_s=speed,
                fins_rad=time_series(fins, count, 4, "fins"),
                thruster_pwm_us=time_series(pulses, count, thrusters, "pulses"),
                voltage_v=time_series(voltage, count, 0, "voltage"),
            )
        if screw is not None and speed is not None:
            level = level_speed(screw, speed)
        state = np.zeros((count, 12))
        state[:, :6], state[:, 6:] = row_of_six(nu, "nu"), row_of_six(eta, "eta")
        viscous, constant = model_file.viscous_model(self.file)
        motion, imposed_states = MeasuredMotion(t_s, state, control, level), None
        if self.file.partial is not None:
            axes = model_file.axes_of(self.file)
            imposed_states, late = (
                imposed(axes),
                _late(self.file, motion.inputs(vehicle)[:, 6:], motion),
            )
            vehicle = uncoupled(driven_by_force(vehicle), axes)
            motion = MeasuredMotion(t_s, state, Control(thruster_force_N=late), level)
        states, _ = fly_freely(
            vehicle,
            [viscous],
            constant[None],
            motion,
            first=np.zeros(1, dtype=np.intp),
            steps=np.arange(count, dtype=np.intp),
            lags_s=np.array([self.file.dynamics.actuator_lag_s]),
            minimum_speed=_minimum_speed(self.file),
            imposed=imposed_states,
            coriolis=model_file.coriolis_acts(self.file),
        )
        frame = pd.DataFrame(states[0, 0], columns=list(STATE_COLUMNS))
        frame.insert(0, "t_s", t_s)
        frame.attrs["units"] = {"t_s": "s", **dict(zip(STATE_COLUMNS, UNITS, strict=True))}
        frame.attrs["warnings"] = _beyond(self.file, states[0, 0])
        frame.attrs["held"] = (
            [] if imposed_states is None else list(np.array(STATE_COLUMNS)[imposed_states])
        )
        return frame

    def export(
        self,
        target: str,
        folder: str | PathLike[str],
        *,
        lossy: bool = False,
        force: bool = False,
        name: str | None = None,
        draws: int = 1000,
    ) -> list[Path]:
        """Write the model for another simulator.

        Parameters
        ----------
        target : str
            Which simulator, as ``auvid export --help`` lists them.
        folder : path
            Folder for the files.
        lossy : bool
            Write although the target cannot hold all of the model; the files say what
            is lost.
        force : bool
            Write although the model is not usable for simulation, and over files that
            are there.
        name : str, optional
            Name of files, and of functions or classes in them.
        draws : int
            How many draws of the coefficients targets with draws get.

        Returns
        -------
        list of pathlib.Path
            The files written.
        """
        from auvid.export import write

        return write(
            self.file, target, Path(folder), lossy=lossy, force=force, name=name, draws=draws
        )


def _force_of(file: ModelFile, commands: Mapping[str | int, ArrayLike], count: int) -> Array:
    """Return the force (n, 6) of shares of full commands, in the unit of force of the file."""
    gains = [] if file.partial is None else file.partial.gains
    keys = {gain.axis if gain.output is None else gain.output for gain in gains}
    unknown = [key for key in commands if key not in keys]
    if unknown:
        raise UsageError(
            "the model has no gain for a command",
            field="commands",
            value=unknown,
            allowed=sorted(map(str, keys)) or "none: this model takes tau, or pulses",
        )
    force = np.zeros((count, 6))
    for gain in gains:
        command = commands.get(gain.axis if gain.output is None else gain.output)
        values = time_series(command, count, 0, "commands")
        if values is not None:
            parts = [(-1, values)]
            if gain.mixed:
                y, z = (
                    np.zeros(count) if item is None else item
                    for item in (
                        time_series(commands.get(axis), count, 0, "commands")
                        for axis in MIXED.replace(gain.axis, "")
                    )
                )
                parts = [(a * b, np.clip(values + a * y + b * z, -1.0, 1.0)) for a, b in SIGNS]
            for sign, part in parts:
                size = np.maximum(np.abs(part) - gain.dead_band, 0.0) / (1.0 - gain.dead_band)
                share = gain.value * (np.sign(part) - sign * gain.skew) * size**gain.curve
                force[:, AXES.index(gain.axis)] += share / len(parts)
    return force


def _late(file: ModelFile, force: Array, motion: MeasuredMotion) -> Array:
    """Return the force (n, 6) of a partial model, each axis with its own lag.

    With the forces that follow those of other axes.
    """
    assert file.partial is not None
    late = np.zeros(force.shape)
    for axis, source in file.partial.axes.items():
        place = AXES.index(axis)
        late[:, place] = first_order_lag(force[:, place], lag_s=source.lag_s, step_s=motion.step_s)
    for item in file.partial.cross_forces:
        other = force[:, AXES.index(item.of)]
        late[:, AXES.index(item.axis)] += item.value * first_order_lag(
            other, lag_s=item.lag_s, step_s=motion.step_s
        )
    return late


def open_model(name: str | PathLike[str]) -> VehicleModel:
    """Open a model by name, as the command ``auvid export`` does.

    Parameters
    ----------
    name : str or path
        A model file (.json), a campaign (its recommended model), ``CAMPAIGN/MODEL``, a
        published set of the shelf, as ``bluerov2_wu_2018``, or a vehicle file (.yaml)
        with published damping.

    Returns
    -------
    Model
        The model, with a warning where it is of an earlier run. One of a published set
        has no intervals and no range of validity; ``use`` says what else it lacks.

    Raises
    ------
    PipelineError
        There is no such model, or the campaign has none to take.
    """
    from auvid.pipeline.commands.model.named_model import named_model

    named = named_model(fspath(name))
    if named.campaign is not None:
        from auvid.pipeline.commands.run.staleness import stale_words

        if stale := stale_words(named.campaign, until="model_file"):
            warnings.warn(stale, stacklevel=2)
    return VehicleModel(named.model)


def _minimum_speed(file: ModelFile) -> float:
    screw = file.dynamics.propeller
    return 0.05 if screw is None else screw.minimum_speed_m_s


def _beyond(file: ModelFile, states: Array) -> list[str]:
    """Return velocities that leave the range of the fit, and angles that tip over."""
    words = [] if file.validity else ["nothing says up to which velocities this model holds"]
    for name in ("phi", "theta"):
        reach_rad = np.nanmax(np.abs(states[:, STATES.index(name)]))
        if reach_rad > TIPPED_RAD:
            words.append(
                f"{name} reaches {np.degrees(reach_rad):.0f} degrees: the vehicle tips over, and"
                " what follows means nothing; no leg flew so"
            )
    for name, flown in file.validity.items():
        if name not in STATES:  # the propulsion ratio, which a motion alone does not tell
            continue
        reach = states[:, STATES.index(name)]
        low, high = np.nanmin(reach), np.nanmax(reach)
        if low < flown.low or high > flown.high:
            words.append(
                f"{name} reaches {low:.3g} to {high:.3g}, the training legs"
                f" {flown.low:.3g} to {flown.high:.3g} {'m/s' if name in 'uvw' else 'rad/s'}"
            )
    return words
