"""A fleet of dives in Python: its tables, and the logs of which something holds."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import pandas as pd

from auvid.data_schemas.schemas import schema
from auvid.frames import as_frame
from auvid.pipeline.commands.fleet.fleet_folder import TABLES, FleetFolder, open_fleet
from auvid.pipeline.commands.fleet.fleet_tables import read_table
from auvid.pipeline.commands.fleet.pooled_campaign import pool_campaign
from auvid.pipeline.commands.fleet.queries.find_command import find


class Fleet:
    """What ``auvid fleet run`` made of a disk of dives.

    Attributes
    ----------
    folder : pathlib.Path
        Folder of the fleet.
    runs : pandas.DataFrame
        Every log with its state, reason, vehicle and the short answer of its run.
    findings : pandas.DataFrame
        Every finding of every log.
    verdicts : pandas.DataFrame
        Every model of every run by axis.
    coefficients : pandas.DataFrame
        Every coefficient with its interval and verdict.
    """

    def __init__(self, fleet: FleetFolder) -> None:
        self._fleet = fleet
        self.folder = fleet.root

    def __repr__(self) -> str:
        return f"Fleet({str(self.folder)!r})"

    @property
    def runs(self) -> pd.DataFrame:
        """Return a row per log."""
        return self._table("runs")

    @property
    def findings(self) -> pd.DataFrame:
        """Return a row per finding."""
        return self._table("findings")

    @property
    def verdicts(self) -> pd.DataFrame:
        """Return a row per log, model and axis."""
        return self._table("verdicts")

    @property
    def coefficients(self) -> pd.DataFrame:
        """Return a row per log, model and term."""
        return self._table("coefficients")

    def find(self, expression: str) -> pd.DataFrame:
        """Return the rows of `runs` of which an expression holds.

        Parameters
        ----------
        expression : str
            As ``"surge = identified and J/J0 < .5"`` (docs/fleet.md).

        Returns
        -------
        pandas.DataFrame
            Columns of `runs`.

        Raises
        ------
        PipelineError
            A name or a sign that the language has not; it names those there are.
        """
        rows = find(self._fleet, expression)
        columns = list(schema(TABLES["runs"]).columns)
        return pd.DataFrame(rows, columns=columns)

    def pool(
        self, vehicle: str | None = None, *, name: str | None = None, since: str | None = None
    ) -> Path:
        """Write one campaign of all dives of a vehicle; nothing runs.

        Parameters
        ----------
        vehicle : str, optional
            As `runs` names it; needed where the fleet has several.
        name : str, optional
            Of the campaign; `VEHICLE_dives` by default.
        since : str, optional
            Log of the first dive that counts, as after a change.

        Returns
        -------
        pathlib.Path
            Folder of the campaign, for `auvid run`.

        Raises
        ------
        PipelineError
            A vehicle or log that is not there, fewer than two dives, a campaign of that name.
        """
        return pool_campaign(self._fleet, vehicle, name=name, since=since).folder

    def _table(self, name: str) -> pd.DataFrame:
        return as_frame(read_table(self._fleet, name), TABLES[name])


def fleet(folder: str | PathLike[str]) -> Fleet:
    """Open a fleet; nothing runs.

    Parameters
    ----------
    folder : str or path
        Folder that ``auvid fleet run`` has written.

    Returns
    -------
    Fleet
        Its tables.

    Raises
    ------
    PipelineError
        No fleet in this folder.
    """
    return Fleet(open_fleet(Path(folder)))
