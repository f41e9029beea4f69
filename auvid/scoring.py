"""How well a model does on the legs of a run, also one that it was not fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from os import PathLike

import numpy as np
import pandas as pd
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import matrix
from auvid.frames import as_frame
from auvid.hydro import model_file
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.equations_of_motion import restoring_of
from auvid.hydro.dynamics.simulation.free_run import FreeRuns
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.regression.error_measures import TOTAL, ErrorSums
from auvid.models import VehicleModel
from auvid.results import RunResults, open_run
from auvid.stages.columns import POSE, forces
from auvid.stages.free_run import free_run_table, measured_motion, run_segment
from auvid.stages.score_shelf import in_body
from auvid.stages.validate import Predictor
from auvid.stages.validate.ranking import free_run_ratios
from auvid.stages.validate.tables import ALL


def score(
    model: VehicleModel,
    run: RunResults | str | PathLike[str],
    *,
    use: str = "validation",
    refit_constant: bool = False,
) -> pd.DataFrame:
    """Judge a model on the legs of a run, by force and by free runs.

    The model brings inertia, restoring and viscous force; actuators, their forces and
    the motion are those of the run.

    Parameters
    ----------
    model : Model
        Of this run, of another one, or read from a file.
    run : RunResults or str or path
        The run, or its campaign.
    use : {"validation", "training"}
        Legs to judge on.
    refit_constant : bool
        Fit the constant force per axis to the training legs of the run, as the command
        ``auvid score`` does for models of other vehicles: net buoyancy and tether are
        the day's. By default the model is judged with its own.

    Returns
    -------
    pandas.DataFrame
        Rows ``all``, X Y Z K M N. Columns ``J0`` (RMS of the residual force [N, N m]),
        ``J`` (RMS error of the model's), ``J/J0`` (1 is predicting no force) and
        ``free_run`` (RMS error of free runs over that of the better guess of no change and
        no motion, nan where
        none stayed bounded). ``attrs["free_runs"]`` has the errors at each horizon,
        ``attrs["horizon_s"]`` the one of the column.

    Raises
    ------
    PipelineError
        The run has no leg of this use, its stages have not run, or the model counts from
        another origin than the vehicle of the run.
    """
    results = run if isinstance(run, RunResults) else open_run(run)
    records = results.artefacts("segment")
    segments: dict[str, SegmentRecord] = {name: item.load() for name, item in records.items()}
    names = [name for name, item in segments.items() if item.use == use]
    if not names:
        raise DataError(
            "the run has no leg of this use",
            field="use",
            value=use,
            allowed=sorted({item.use for item in segments.values()}),
        )
    vehicle = results.vehicle
    own = model.vehicle
    judged = _predictor(model, vehicle)
    if refit_constant:
        judged = replace(judged, trim=_refitted(judged, own, results, segments))
    sums: list[ErrorSums] = []
    flown: dict[tuple[str, str], FreeRuns] = {}
    settings = results.parameters("validate")
    for name in names:
        residual, fused, controls = _tables(results, name)
        predicted = _predicted(judged, own, vehicle, residual, fused)
        sums.append(ErrorSums.of(forces(residual, "tau_bar"), predicted))
        runs = run_segment(
            in_body(own, vehicle),
            [judged.viscous],
            judged.trim[None],
            np.zeros((1, 6, 6)),
            measured_motion(fused, controls),
            horizons_s=settings.free_run_horizons_s,
            every_s=settings.free_run_every_s,
            minimum_speed=settings.minimum_speed_m_s,
            lags_s=np.array([judged.lag_s]),
        )
        if runs is not None:
            flown[name, ""] = runs
    return _table(model.name, reduce(ErrorSums.merge, sums), free_run_table(flown, [model.name]))


def _tables(results: RunResults, segment: str) -> tuple[pa.Table, pa.Table, pa.Table]:
    residual, fused, controls = (
        results.artefacts(schema)[segment].load() for schema in ("residual", "fused", "controls")
    )
    return residual, fused, controls


def _predicted(
    judged: Predictor, own: Vehicle, vehicle: Vehicle, residual: pa.Table, fused: pa.Table
) -> Array:
    """Return the residual force (n, 6) of the run's vehicle that the model predicts."""
    eta = matrix(fused, POSE)
    change = restoring_of(own, eta) - restoring_of(vehicle, eta)
    return np.asarray(judged.force(residual, fused) + change)


def _refitted(
    judged: Predictor, own: Vehicle, results: RunResults, segments: Mapping[str, SegmentRecord]
) -> Array:
    """Return the constant force (6,) that leaves no mean error on the training legs."""
    errors = []
    for name, segment in segments.items():
        if segment.use == "training":
            residual, fused, _ = _tables(results, name)
            predicted = _predicted(judged, own, results.vehicle, residual, fused)
            errors.append(forces(residual, "tau_bar") - predicted)
    if not errors:
        raise DataError("the run has no training leg to fit a constant force to")
    return np.asarray(judged.trim + np.vstack(errors).mean(axis=0))


def _predictor(model: VehicleModel, vehicle: Vehicle) -> Predictor:
    """Return the model as `validate` judges one, against the inertia of the run."""
    viscous, constant = model_file.viscous_model(model.file)
    change: Array = vehicle.mass_matrix - model.inertia
    return Predictor(viscous, constant, change, model.file.dynamics.actuator_lag_s)


def _table(name: str, sums: ErrorSums, flown: pa.Table) -> pd.DataFrame:
    measures = sums.measures(np.full(6, np.nan))
    horizon, ratios = free_run_ratios(flown.to_pylist()) if flown.num_rows else (None, {})
    of = ratios.get(name, {})
    rows = [
        {
            "axis": axis,
            "J0": measures[key].j0,
            "J": measures[key].rms,
            "J/J0": measures[key].normalised,
            "free_run": of.get(axis, np.nan),
        }
        for axis, key in ((ALL, TOTAL), *zip(AXES, AXES, strict=True))
    ]
    frame = pd.DataFrame(rows).set_index("axis")
    frame.attrs = {"horizon_s": horizon, "free_runs": as_frame(flown, "free_run")}
    return frame
