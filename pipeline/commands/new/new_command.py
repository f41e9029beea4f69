"""`auvid new`: a workspace with an example campaign and synthetic data."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.campaigns.vehicle_files import load_vehicle
from auvid.pipeline.commands.new.new_example import example_log
from auvid.pipeline.execution.generate_dvc import dvc_yaml, params_yaml
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.stages.registry import KINDS, STAGES

EXAMPLE = "example"


def make_workspace(folder: Path) -> None:
    """Write the workspace. Raises `PipelineError` if the folder holds anything."""
    folder = folder.expanduser()
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise PipelineError(
            "there is something already, and nothing is overwritten",
            file=folder,
            remedy="Choose a new folder.",
        )
    files = {
        "params.yaml": params_yaml(STAGES, [EXAMPLE]),
        "dvc.yaml": dvc_yaml(STAGES, KINDS, {EXAMPLE: "identification"}),
    }
    for name, text in files.items():
        write_atomically(folder / name, text.encode())
    _copy(resources.files("auvid.pipeline") / "templates", folder)
    vehicle = load_vehicle(folder / "vehicles" / "example_rov.yaml").vehicle
    write_atomically(
        folder / "campaigns" / EXAMPLE / "logs" / "synthetic_run.csv", example_log(vehicle)
    )


def _copy(source: Traversable, target: Path) -> None:
    for entry in source.iterdir():
        if entry.is_dir():
            _copy(entry, target / entry.name.replace("dot_", "."))
        else:
            write_atomically(target / entry.name.replace("dot_", "."), entry.read_bytes())
