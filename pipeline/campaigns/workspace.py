"""The folder of params.yaml, campaigns/, vehicles/ and runs/.

Nothing heavy is imported here: a run with nothing to do needs no more.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from auvid.data_schemas.errors import PipelineError, UsageError, nearest

PARAMS_FILE = "params.yaml"
SHIPPED_VEHICLES = Path(__file__).resolve().parents[2] / "vehicles"


@dataclass(frozen=True)
class Workspace:
    """A workspace by its root folder."""

    root: Path

    @property
    def campaigns(self) -> Path:
        return self.root / "campaigns"

    @property
    def runs(self) -> Path:
        return self.root / "runs"

    @property
    def code(self) -> Path:
        """Folder of the small files on which DVC depends in place of the code."""
        return self.runs / ".code"

    def campaign_folder(self, name: str) -> Path:
        """Return the folder of a campaign, given by name, folder or manifest."""
        path = Path(name).expanduser()
        if path.name == "campaign.yaml":
            return path.resolve().parent
        if (path / "campaign.yaml").is_file():
            return path.resolve()
        names = self.campaign_names()
        if name in names:
            return self.campaigns / name
        raise UsageError(
            "no such campaign",
            value=name,
            allowed=names or "none yet",
            remedy=nearest(name, names)
            or f"Campaigns live in {self.campaigns}, one folder with a campaign.yaml each.",
        )

    def campaign_names(self) -> list[str]:
        """Names of the campaigns of this workspace."""
        return sorted(path.parent.name for path in self.campaigns.glob("*/campaign.yaml"))

    def vehicle_files(self) -> dict[str, Path]:
        """Vehicles by name: those of the workspace, then those that come with auvid."""
        files: dict[str, Path] = {}
        for folder in (SHIPPED_VEHICLES, self.root / "vehicles"):
            files |= {path.stem: path for path in folder.glob("*.yaml")}
        return dict(sorted(files.items()))


def find_workspace(start: Path) -> Workspace:
    """Return the nearest folder at or above `start` that holds params.yaml."""
    for folder in (start.resolve(), *start.resolve().parents):
        if (folder / PARAMS_FILE).is_file():
            return Workspace(folder)
    raise PipelineError(
        f"no {PARAMS_FILE} here or above",
        value=str(start),
        remedy="Go to a workspace, or make one: auvid new DIR.",
    )


def workspace_of(campaign: str) -> Workspace:
    """The workspace around the current folder, or around a campaign given by path.

    A campaign folder outside any workspace is its own: every stage parameter has its
    default, and runs/ stands in that folder.
    """
    start = Path(campaign).expanduser()
    try:
        return find_workspace(Path.cwd())
    except PipelineError:
        if not start.exists():
            raise
    folder = start.resolve().parent if start.is_file() else start.resolve()
    try:
        return find_workspace(folder)
    except PipelineError:
        if not (folder / "campaign.yaml").is_file():
            raise
    return Workspace(folder)


def vehicle_file_of(name: str) -> Path:
    """Return the file of a vehicle, given by name or by its path.

    Names are those of the workspace here and of the vehicles that come with auvid.
    """
    if name.endswith(".yaml"):
        return Path(name).expanduser()
    try:
        files = find_workspace(Path.cwd()).vehicle_files()
    except PipelineError:
        files = {path.stem: path for path in sorted(SHIPPED_VEHICLES.glob("*.yaml"))}
    if name not in files:
        raise UsageError("no such vehicle", value=name, allowed=files, remedy=nearest(name, files))
    return files[name]
