"""Vehicle files, with the documents that they name put in their place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from auvid.hydro.dynamics.vehicle.measured_inertia import with_measured_inertia
from auvid.pipeline.campaigns.yaml_files import YamlFile, load_yaml


def load_vehicle(path: Path, *, named_in: object = None) -> YamlFile:
    """A vehicle file, checked, with the moments of inertia of the document that its key
    `rigid_body.measured_inertia` names.

    That path counts from the vehicle file. Raises `PipelineError` for a file that
    cannot be read or does not agree with its schema.
    """
    file = load_yaml(path, named_in=named_in, what="vehicle")
    file.check("vehicle")
    named = file.value["rigid_body"].get("measured_inertia")
    if named is None:
        return file
    measured = load_yaml(
        path.parent / Path(named).expanduser(), named_in=path, what="rigid_body.measured_inertia"
    )  # JSON is YAML
    measured.check("inertia")
    return replace(file, value=with_measured_inertia(file.value, measured.value))
