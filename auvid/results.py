"""Runs of campaigns in Python: start them, and read what they made."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import cached_property
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import pandas as pd

from auvid.data_schemas.errors import DataError, UsageError, nearest
from auvid.data_schemas.schemas import schema
from auvid.frames import as_frame
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.models import VehicleModel
from auvid.pipeline.commands.open_run import open_run as open_folder
from auvid.pipeline.commands.run.answer import answer_of
from auvid.pipeline.commands.run.run_command import execute
from auvid.pipeline.commands.run.staleness import stale_words
from auvid.pipeline.execution.engines import make_engine
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.execution.task_inputs import Artefact
from auvid.pipeline.graph import ONCE, select


class RunResults(Mapping[str, Any]):
    """What a run of a campaign made, by name.

    A name is the path of an artefact under ``runs/CAMPAIGN`` without its suffix:
    ``fuse/train/fused``, ``validate/error_table``, ``report/answer``. Tables come as
    pandas DataFrames with ``attrs["units"]``, documents as typed values or mappings,
    pages as bytes. Each is read, and held against its schema and hash, when asked for.

    Attributes
    ----------
    name : str
        Name of the campaign.
    folder : pathlib.Path
        Folder of the results.
    model : Model
        The model to take.
    models : dict of str to Model
        All models by name.
    answer : str
        What the run says, as the command prints it.
    report : pathlib.Path
        The page.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self.name = run.campaign.name
        self.folder = run.folder

    def __repr__(self) -> str:
        return f"RunResults({self.name!r}, {len(self)} artefacts)"

    def __getitem__(self, name: str) -> Any:
        artefact = self._artefact(name)
        value = artefact.load()
        kind = schema(artefact.schema).kind
        return as_frame(value, artefact.schema) if kind == "table" else value

    def __iter__(self) -> Any:
        return iter(self._artefacts)

    def __len__(self) -> int:
        return len(self._artefacts)

    def table(self, name: str) -> pd.DataFrame:
        """Return a table of the run.

        Parameters
        ----------
        name : str
            As ``validate/error_table``.

        Returns
        -------
        pandas.DataFrame
            With units in ``attrs["units"]``.

        Raises
        ------
        PipelineError
            No such artefact, or it is no table.
        """
        kind = schema(self._artefact(name).schema).kind
        if kind != "table":
            raise UsageError("not a table", field=name, value=kind)
        frame: pd.DataFrame = self[name]
        return frame

    def artefacts(self, schema_name: str) -> dict[str, Artefact]:
        """Return the artefacts of a schema by item, as segment -> fused; `load` reads one."""
        return {
            port.owner(item, key) if key is None or port.level != ONCE else key: artefact
            for stage in self._run.graph.stages
            for port, item, key, artefact in self._run.artefacts(stage)
            if port.schema == schema_name
        }

    def parameters(self, stage: str) -> Any:
        """Return the parameters of a stage, as in params.yaml."""
        return self._run.params[self._run.graph.stage(stage).name]

    @property
    def vehicle(self) -> Vehicle:
        """Return the vehicle of the campaign."""
        return self._run.campaign.vehicle

    @cached_property
    def models(self) -> dict[str, VehicleModel]:
        """Models of the run by name."""
        return {
            name: VehicleModel(artefact.load())
            for name, artefact in self.artefacts("model_file").items()
        }

    @property
    def model(self) -> VehicleModel:
        """Return the model to take; `DataError` where the run advises none."""
        for model in self.models.values():
            if model.recommended:
                return model
        if not self.models:
            raise DataError(
                "the run has no model", value=self.name, remedy=f'auvid.run("{self.name}")'
            )
        raise DataError(
            "the run advises to take none of its models",
            value=self.name,
            remedy="`answer` says why; `models` has them all.",
        )

    @property
    def answer(self) -> str:
        """Return what the run says in words: verdict, uses, coefficients, what is missing.

        Of a dive of a fleet too, whose page is drawn when it is first asked for.
        """
        if "report/answer" in self._artefacts:
            text: bytes = self["report/answer"]
            return text.decode("utf-8")
        if words := answer_of(self._run):
            return words
        raise DataError(
            "the run has no answer yet: a stage before its report has not been run",
            value=self.name,
            remedy=f'auvid.run("{self.name}")',
        )

    @property
    def report(self) -> Path:
        """Return the path of the page; `DataError` where it is not drawn."""
        if "report/report_html" not in self._artefacts:
            raise DataError(
                "the page of the run is not drawn",
                value=self.name,
                remedy=f"auvid report {self.name}",
            )
        return self._artefact("report/report_html").path

    @cached_property
    def _artefacts(self) -> dict[str, Artefact]:
        return {
            f"{stage.name}/{port.path(item, key)}".rpartition(".")[0]: artefact
            for stage in self._run.graph.stages
            for port, item, key, artefact in self._run.artefacts(stage)
        }

    def _artefact(self, name: str) -> Artefact:
        if name not in self._artefacts:
            raise UsageError(
                "the run has no such artefact",
                value=name,
                remedy=nearest(name, self._artefacts)
                or ("list(results) names them." if len(self) else f'auvid.run("{self.name}")'),
            )
        return self._artefacts[name]


def open_run(campaign: str | PathLike[str]) -> RunResults:
    """Open the results of a campaign; nothing runs.

    Parameters
    ----------
    campaign : str or path
        Name of a folder under ``campaigns/``, or a path to one or to its
        ``campaign.yaml``.

    Returns
    -------
    RunResults
        What has been made so far; a warning names the first stage with results that are
        not up to date.

    Raises
    ------
    PipelineError
        No such campaign, or nothing of it has been run.
    """
    results = RunResults(open_folder(fspath(campaign)))
    if not results:
        raise DataError(
            "the campaign has not been run", value=results.name, remedy=f'auvid.run("{campaign}")'
        )
    if stale := stale_words(fspath(campaign)):
        warnings.warn(stale, stacklevel=2)
    return results


def run(
    campaign: str | PathLike[str],
    *,
    only: str | None = None,
    until: str | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    memory: str | None = None,
    exchange: str | None = None,
    force: bool = False,
    progress: bool = True,
) -> RunResults:
    """Bring a campaign up to date, as the command ``auvid run`` does.

    Parameters
    ----------
    campaign : str or path
        As `open_run`.
    only, until : str, optional
        Run this stage only, or this one and all that it needs.
    engine : {"serial", "processes", "dask"}, optional
        Where items run; results are the same.
    jobs : int, optional
        How many processes.
    scheduler : str, optional
        Address of a Dask scheduler; without it Dask starts workers on this machine.
    memory : str, optional
        Memory of each worker that Dask starts on this machine, as "1.2GB".
    exchange : str, optional
        Where files go that Dask's workers need and make if they share no folder with this
        machine: a URL of fsspec, as "s3://bucket/folder".
    force : bool
        Run again what is up to date.
    progress : bool
        Print progress and findings of the logs.

    Returns
    -------
    RunResults
        All results of the campaign.

    Raises
    ------
    PipelineError
        A log cannot be read, its findings stop the run, or a stage fails.
    """
    opened = open_folder(fspath(campaign))
    stages = select(opened.graph, only=only, until=until)
    chosen = make_engine(engine, jobs, scheduler=scheduler, memory=memory, exchange=exchange)
    execute(opened, stages, engine=chosen, force=force, quiet=not progress)
    return RunResults(opened)
