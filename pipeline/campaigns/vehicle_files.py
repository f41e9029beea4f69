"""Vehicle files: read, checked, and with the documents that they name put in place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from auvid.data_schemas.documents.vehicle import InertiaDocument, VehicleDocument
from auvid.data_schemas.errors import PipelineError
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.measured_inertia import with_measured_inertia
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES
from auvid.pipeline.campaigns.yaml_files import YamlFile, load_yaml


def shelf_files() -> dict[str, Path]:
    """Return the files of published vehicles that come with auvid, by name."""
    return {path.stem: path for path in sorted((SHIPPED_VEHICLES / "shelf").glob("*.yaml"))}


@dataclass(frozen=True)
class VehicleFile:
    """A vehicle and the file that it was read from."""

    file: YamlFile
    vehicle: Vehicle


def load_vehicle(path: Path, *, named_in: object = None) -> VehicleFile:
    """Read a vehicle file, with measured moments of inertia where it names them.

    Its key `rigid_body.measured_inertia` names the document of these.

    That path counts from the vehicle file. Raises `PipelineError` for a file that
    cannot be read and for what cannot be a vehicle.
    """
    file = load_yaml(path, named_in=named_in, what="vehicle")
    document = file.parse(VehicleDocument)
    named = document.rigid_body.measured_inertia
    if named is not None:
        measured = load_yaml(
            path.parent / Path(named).expanduser(),
            named_in=path,
            what="rigid_body.measured_inertia",
        )  # JSON is YAML
        document = with_measured_inertia(document, measured.parse(InertiaDocument))
    try:
        return VehicleFile(file, vehicle_from_document(document))
    except PipelineError as fault:
        raise file.located(fault) from None
