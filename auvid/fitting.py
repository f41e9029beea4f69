"""Fit a model to arrays, through the stages that a campaign runs through."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from os import PathLike, fspath
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike

from auvid.arguments import as_numbers, finite, worded_for_arrays
from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.errors import DataError, UsageError, nearest
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.model_file import ModelFile
from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor, Vehicle
from auvid.hydro.force_input import driven_by_force, force_pulses
from auvid.models import VehicleModel
from auvid.pipeline.campaigns.vehicle_files import load_vehicle
from auvid.pipeline.campaigns.workspace import vehicle_file_of
from auvid.pipeline.store.file_hashes import hash_value
from auvid.pipeline.store.fingerprints import as_document, stage_code
from auvid.pipeline.store.package_versions import package_versions
from auvid.stages import fuse, model_file, resample, residual, synthesise, validate
from auvid.stages.base import Stage, collection, make_params
from auvid.stages.columns import (
    ACCELEROMETER,
    ATTITUDE,
    FINS,
    GYRO,
    LINEAR_VELOCITY,
    VELOCITY_SD,
    named,
)
from auvid.stages.synthesise.forms import model_names

LOG = "arrays"
CHAIN: tuple[Stage[Any, Any, Any], ...] = (
    resample.STAGE,
    fuse.STAGE,
    residual.STAGE,
    synthesise.STAGE,
    validate.STAGE,
    model_file.STAGE,
)
OWN = "own"
"""Name of a structure that the caller gives by its terms."""
LARGEST_RATE_RMS = 10.0  # rad/s; 570 deg/s, a turn and a half per second
AT_ORIGIN = MountedSensor(np.zeros(3), np.eye(3), 0.0)


def fit(
    time: ArrayLike,
    nu: ArrayLike,
    angles: ArrayLike,
    vehicle: str | PathLike[str] | VehicleDocument | Vehicle,
    *,
    tau: ArrayLike | None = None,
    pulses: ArrayLike | None = None,
    fins: ArrayLike | None = None,
    propeller_rev_s: ArrayLike | None = None,
    voltage: ArrayLike | None = None,
    velocity_sd: ArrayLike | None = None,
    model: str | Mapping[str, list[str]] = "symmetric",
    validate_from: float | None = None,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
) -> VehicleModel:
    """Fit a model to arrays, as a campaign would to a log with these sensors.

    Runs resample, fuse (method kinematic), residual, synthesise, validate and
    model_file in memory.

    Parameters
    ----------
    time : array_like, shape (n,)
        Clock [s], ascending; it need not be uniform.
    nu : array_like, shape (n, 6)
        Velocity of the body origin u v w [m/s] and rates p q r [rad/s], body
        forward-starboard-down.
    angles : array_like, shape (n, 3)
        Roll, pitch, yaw [rad].
    vehicle : str, path, VehicleDocument or Vehicle
        A vehicle by name or file, or as a value; its sensors do not count here.
    tau : array_like, shape (n, 6), optional
        Force of all actuators [N, N m], in place of the commands below.
    pulses : array_like, shape (n, k), optional
        Pulses of the thrusters [us], in the order of the vehicle file.
    fins : array_like, shape (n, 4), optional
        Deflections [rad]: starboard, port, bottom, top.
    propeller_rev_s : array_like, shape (n,), optional
        Propeller speed [1/s].
    voltage : array_like, shape (n,), optional
        Battery voltage [V].
    velocity_sd : array_like, shape (6,), optional
        Standard deviations of `nu` by all its errors [m/s, rad/s]. With them a linear
        term counts as excited from three of them on; without them from 0.03 on, as
        noise in velocities of unknown origin may have been filtered away.
    model : str or mapping
        Name of a form (``symmetric``, ``diagonal``, ``linear``, ``fossen`` ...), or
        axis -> terms: ``{"X": ["u", "u|u|"], "N": ["r"]}``.
    validate_from : float, optional
        Time from which on the data judge the model and are not fitted; without it
        nothing judges it, and the model says so.
    settings : mapping, optional
        Stage -> parameters, as in params.yaml: ``{"fuse": {"cutoff_hz": 1.0}}``.

    Returns
    -------
    Model
        The model, with verdicts, intervals and uses.

    Raises
    ------
    PipelineError
        Shapes that do not fit, degrees for radians, an actuator without a command, too
        few data.
    """
    _check_model(model)
    t_s = finite(as_numbers(time, "time"), "time")
    if t_s.ndim != 1 or len(t_s) < 2:
        raise DataError("wrong shape", field="time", value=t_s.shape, allowed="(n,), n from 2")
    if not np.all(np.diff(t_s) > 0.0):
        row = int(np.argmin(np.diff(t_s) > 0.0)) + 1
        raise DataError("times do not ascend", field="time", row=row, value=float(t_s[row]))
    own = _vehicle(vehicle)
    acting, commands = _actuators(
        own, t_s, tau, {"pulses": pulses, "fins": fins, "propeller_rev_s": propeller_rev_s}
    )
    motion, euler = _rows(nu, t_s, 6, "nu"), _rows(angles, t_s, 3, "angles")
    _refuse_degrees(motion, euler)
    streams = _streams(
        t_s,
        motion,
        euler,
        commands,
        None if voltage is None else _rows(voltage, t_s, 0, "voltage"),
    )
    deviations = None if velocity_sd is None else _deviations(velocity_sd)
    excitation = "fixed" if deviations is None else "errors"
    with worded_for_arrays():
        params = _parameters(model, settings or {}, excitation)
    origin = _origin(own, streams, params)
    acting = replace(acting, dvl=AT_ORIGIN, imu=AT_ORIGIN, depth_sensor=AT_ORIGIN)
    name = OWN if isinstance(model, Mapping) else model
    split = None if validate_from is None else float(as_numbers(validate_from, "validate_from"))
    with worded_for_arrays():
        files = _chain(t_s, split, streams, own, acting, params, origin, deviations)
    return VehicleModel(files[name])


def _check_model(model: str | Mapping[str, list[str]]) -> None:
    """Raise `UsageError` for a form that is not known, before anything is worked out."""
    if isinstance(model, str):
        names = model_names()
        if model not in names:
            remedy = nearest(model, names)
            raise UsageError(
                "unknown model", field="model", value=model, allowed=names, remedy=remedy
            )
    elif not isinstance(model, Mapping) or not model:
        raise UsageError(
            "not a model",
            field="model",
            value=model,
            allowed='a name as "symmetric", or axis -> terms as {"X": ["u", "u|u|"]}',
        )
    elif unknown := [axis for axis in model if axis not in AXES]:
        raise UsageError("unknown axis", field="model", value=unknown[0], allowed=AXES)


def _chain(
    t_s: Array,
    validate_from: float | None,
    streams: Mapping[str, pa.Table],
    own: Vehicle,
    acting: Vehicle,
    params: Mapping[str, Any],
    origin: Mapping[str, Any],
    velocity_sd: Array | None,
) -> Mapping[str, ModelFile]:
    """Run the stages; `acting` has the actuators that the streams command."""
    log = _log_info(t_s)
    tables: dict[str, dict[str, Any]] = {"segment": {}, "fused": {}, "residual": {}}
    tables |= {"fusion": {}, "controls": {}}
    for leg in _legs(t_s, validate_from):
        even = resample.run(resample.Inputs(leg, log, acting, **streams), params["resample"])
        for key, segment in even.segment.items():
            table = even.resampled[key]
            state = fuse.run(fuse.Inputs(segment, table, acting, log), params["fuse"])
            fused = state.fused
            if velocity_sd is not None:
                columns = {item: fused[item] for item in fused.column_names}
                rows = np.broadcast_to(velocity_sd, (fused.num_rows, 6))
                fused = make_table("fused", columns | named(VELOCITY_SD, rows))
            rest = residual.run(
                residual.Inputs(segment, fused, state.fusion, table, acting, log),
                params["residual"],
            )
            parts = (segment, fused, rest.residual, state.fusion, rest.controls)
            for own_tables, part in zip(tables.values(), parts, strict=True):
                own_tables[key] = part
    data = {name: collection(rows) for name, rows in tables.items()}
    cards = synthesise.run(
        synthesise.Inputs(
            data["residual"],
            data["segment"],
            acting,
            data["fused"],
            data["fusion"],
            data["controls"],
        ),
        params["synthesise"],
    ).model_card
    judged = validate.run(
        validate.Inputs(
            collection(cards),
            data["residual"],
            data["segment"],
            data["fused"],
            data["controls"],
            acting,
        ),
        params["validate"],
    )
    inputs = model_file.Inputs(
        {"title": "Arrays"}, own, origin, collection(cards), judged.ranking, judged.free_run
    )
    return model_file.run(inputs, params["model_file"]).model_file


def _legs(t_s: Array, validate_from: float | None) -> list[LegEntry]:
    if validate_from is None:
        return [LegEntry(id="train", log=LOG)]
    split = float(validate_from - t_s[0])
    if not 0.0 < split < t_s[-1] - t_s[0]:
        raise DataError(
            "the models are to be judged outside the data",
            field="validate_from",
            value=validate_from,
            allowed=f"{t_s[0]:g} to {t_s[-1]:g} s",
        )
    return [
        LegEntry(id="train", log=LOG, start_s=0.0, end_s=split),
        LegEntry(id="check", log=LOG, start_s=split, use="validation"),
    ]


def _vehicle(vehicle: str | PathLike[str] | VehicleDocument | Vehicle) -> Vehicle:
    if isinstance(vehicle, Vehicle):
        return vehicle
    if isinstance(vehicle, VehicleDocument):
        return vehicle_from_document(vehicle)
    return load_vehicle(vehicle_file_of(fspath(vehicle))).vehicle


def _actuators(
    vehicle: Vehicle, t_s: Array, tau: ArrayLike | None, commands: Mapping[str, ArrayLike | None]
) -> tuple[Vehicle, dict[str, Array]]:
    """Return the vehicle that acts and the columns of its commands."""
    if tau is not None:
        both = [name for name, values in commands.items() if values is not None]
        if both:
            raise UsageError(
                "give the force of the actuators or their commands", value=["tau", *both]
            )
        force = _rows(tau, t_s, 6, "tau")
        largest = float(np.abs(force).max()) or 1.0
        names = [f"pwm_{output}_us" for output in range(1, 7)]
        return driven_by_force(vehicle, largest), named(names, force_pulses(force, largest))
    columns: dict[str, Array] = {}
    outputs = () if vehicle.thrusters is None else vehicle.thrusters.outputs
    missing = []
    for name, part, count in (
        (
            "pulses",
            vehicle.thrusters,
            0 if vehicle.thrusters is None else len(vehicle.thrusters.outputs),
        ),
        ("fins", vehicle.fins, 4),
        ("propeller_rev_s", vehicle.propeller, 0),
    ):
        values = commands[name]
        if (part is None) != (values is None):
            missing.append(name)
        elif values is not None:
            array = _rows(values, t_s, count, name)
            if name == "pulses":
                columns |= named([f"pwm_{i}_us" for i in outputs], array)
            else:
                columns |= named(FINS, array) if name == "fins" else {name: array}
    if missing or not columns:
        raise DataError(
            "the commands are not those of the vehicle's actuators",
            field=", ".join(missing) or "tau",
            value=[name for name, values in commands.items() if values is not None],
            remedy="Give the commands of each actuator of the vehicle, or `tau`.",
        )
    return vehicle, columns


def _rows(values: ArrayLike, t_s: Array, width: int, name: str) -> Array:
    """Return an array (n, width), or (n,) for no width, of finite numbers."""
    array = as_numbers(values, name)
    shape = (len(t_s), width) if width else (len(t_s),)
    if array.shape != shape:
        turned = array.ndim == 2 and array.shape[::-1] == shape
        raise DataError(
            "wrong shape",
            field=name,
            value=array.shape,
            allowed=f"{shape}, a row for each time",
            remedy=f"Turn it: {name}.T." if turned else None,
        )
    return finite(array, name)


def _deviations(values: ArrayLike) -> Array:
    array = as_numbers(values, "velocity_sd")
    if array.shape != (6,) or not np.all(np.isfinite(array) & (array >= 0.0)):
        raise DataError(
            "no standard deviations of u v w p q r",
            field="velocity_sd",
            value=array.tolist(),
            allowed="six numbers of at least 0 m/s, rad/s",
        )
    return array


def _refuse_degrees(nu: Array, angles: Array) -> None:
    """Raise `DataError` for angles and rates that can hardly be in radians."""
    for index, (name, most) in enumerate((("roll", np.pi), ("pitch", np.pi / 2.0))):
        largest = int(np.argmax(np.abs(angles[:, index])))
        value = float(angles[largest, index])
        if abs(value) > most + 1e-6:
            raise DataError(
                f"{name} is beyond its range: degrees?",
                field="angles",
                row=largest,
                value=value,
                allowed=f"{-most:.4f} to {most:.4f} rad",
                remedy="Give radians: np.radians(angles).",
            )
    rms = np.sqrt(np.mean(nu[:, 3:] ** 2, axis=0))
    if rms.max() > LARGEST_RATE_RMS:
        raise DataError(
            f"the rate {'pqr'[int(np.argmax(rms))]} is beyond any vehicle: degrees per second?",
            field="nu",
            value=f"RMS {rms.max():.4g}",
            allowed=f"up to {LARGEST_RATE_RMS:g} rad/s",
            remedy="Give radians per second: np.radians(nu[:, 3:]).",
        )


def _streams(
    t_s: Array, nu: Array, angles: Array, commands: Mapping[str, Array], voltage: Array | None
) -> dict[str, pa.Table]:
    """Return the arrays as streams of ideal sensors at the origin."""
    time_us = np.round((t_s - t_s[0]) * 1e6).astype(np.int64)
    nothing = np.full((len(t_s), 3), np.nan)
    streams: dict[str, Mapping[str, Array]] = {
        "imu": named(GYRO, nu[:, 3:]) | named(ACCELEROMETER, nothing),
        "attitude": named(ATTITUDE, angles),
        "depth": {"depth_m": np.zeros(len(t_s))},
        "velocity": named(LINEAR_VELOCITY, nu[:, :3]),
        "actuators": commands,
    }
    if voltage is not None:
        streams["battery"] = {"voltage_v": voltage}
    return {
        name: make_table(name, {"time_us": time_us, **columns}) for name, columns in streams.items()
    }


def _log_info(t_s: Array) -> LogInfo:
    return LogInfo(
        log=LOG,
        files=[],
        status="complete",
        start_us=0,
        end_us=round(float(t_s[-1] - t_s[0]) * 1e6),
        parameters={},
        streams={},
        counts={},
        notes=[],
    )


def _parameters(
    model: str | Mapping[str, list[str]],
    settings: Mapping[str, Mapping[str, Any]],
    excitation: str,
) -> dict[str, Any]:
    names = [stage.name for stage in CHAIN]
    for name in settings:
        if name not in names:
            raise UsageError(
                "no such stage in a fit",
                field="settings",
                value=name,
                allowed=names,
                remedy=nearest(name, names),
            )
    chosen: dict[str, Any] = {"trim": True, "models": [model]}
    if isinstance(model, Mapping):
        terms = {axis: list(row) for axis, row in model.items()}
        chosen = {"trim": True, "models": [], "structures": {OWN: terms}}
    # Draws give the band of the report, which a model file does not hold.
    base = {
        "fuse": {"method": "kinematic"},
        "synthesise": chosen | {"excitation": excitation},
        "validate": {"free_run_draws": 0},
    }
    return {
        stage.name: make_params(
            stage.params,
            {**base.get(stage.name, {}), **settings.get(stage.name, {})},
            stage=stage.name,
            file="settings",
        )
        for stage in CHAIN
    }


def _origin(
    vehicle: Vehicle, streams: Mapping[str, pa.Table], params: Mapping[str, Any]
) -> dict[str, Any]:
    """Return where the numbers come from, as the runner says it of a campaign."""
    content = hashlib.sha256()
    for table in streams.values():
        for column in table.columns:
            content.update(np.ascontiguousarray(column.to_numpy()).tobytes())
    return {
        "logs": {LOG: [{"name": ", ".join(streams), "content": content.hexdigest()}]},
        "vehicle": hash_value(vehicle.document.model_dump(exclude_unset=True)),
        "stages": {
            stage.name: {"code": stage_code(stage), "parameters": as_document(params[stage.name])}
            for stage in CHAIN
        },
        "packages": package_versions(),
    }
