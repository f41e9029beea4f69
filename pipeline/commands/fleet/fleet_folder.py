"""The folder of a fleet: a workspace with a campaign for each log, and its tables."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.campaigns.workspace import PARAMS_FILE, Workspace
from auvid.pipeline.store.atomic_files import write_atomically

PARAMS = (
    "# Parameters of every campaign of this fleet, by stage (auvid stages); a campaign's own\n"
    "# `stages:` stand above them.\n{}\n"
)
TABLES = {
    "runs": "fleet_runs",
    "findings": "fleet_findings",
    "verdicts": "fleet_verdicts",
    "coefficients": "fleet_coefficients",
}
"""Table of a fleet -> its schema."""


@dataclass(frozen=True)
class FleetFolder:
    """Where a fleet keeps what it makes; nothing is written elsewhere."""

    root: Path

    @property
    def workspace(self) -> Workspace:
        """Return the workspace of all its campaigns."""
        return Workspace(self.root)

    @property
    def logs(self) -> Path:
        """Folder of one folder per log: what it is, and what its run came to."""
        return self.root / "logs"

    @property
    def index(self) -> Path:
        """Return the logs as they were when the fleet was last brought up to date."""
        return self.root / "index.json"

    @property
    def page(self) -> Path:
        """Return the report of the fleet."""
        return self.root / "report.html"

    def campaign(self, log: str) -> Path:
        """Return the folder of a log's campaign."""
        return self.workspace.campaigns / log

    def table(self, name: str) -> Path:
        """Return the file of a table: runs, findings, verdicts or coefficients."""
        return self.root / "tables" / f"{name}.parquet"

    def prepare(self) -> None:
        """Make it a workspace, if it is none yet."""
        if not (self.root / PARAMS_FILE).exists():
            write_atomically(self.root / PARAMS_FILE, PARAMS.encode())


def open_fleet(root: Path) -> FleetFolder:
    """Return the folder of a fleet; `PipelineError` for any other folder."""
    fleet = FleetFolder(root.expanduser().resolve())
    if not fleet.index.is_file():
        raise PipelineError(
            "no fleet in this folder",
            file=root,
            remedy="auvid fleet run DIR --out FLEETDIR makes one.",
        )
    return fleet
