"""Vehicle files and published coefficients, read and checked."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from auvid.data_schemas.documents.model import Quantity
from auvid.data_schemas.documents.vehicle.vehicle import InertiaDocument, VehicleDocument
from auvid.data_schemas.errors import CampaignError, PipelineError
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.measured_inertia import with_measured_inertia
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.coefficients import unit_of
from auvid.hydro.dynamics.viscous.models import model_named
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES
from auvid.pipeline.campaigns.yaml_files import YamlFile, load_yaml, yaml_of
from auvid.pipeline.store.atomic_files import document_bytes, readable

FILES_KEPT = 32
"""Vehicle files that a process keeps as they were read."""


def shelf_files() -> dict[str, Path]:
    """Return what `load_published` reads of the sets that come with auvid, by name.

    The vehicle files of `vehicles/shelf`, then `VEHICLE_MODEL` for each table of
    coefficients beside a vehicle file, as vt690_fossen.
    """
    files = {path.stem: path for path in sorted((SHIPPED_VEHICLES / "shelf").glob("*.yaml"))}
    for vehicle in sorted(SHIPPED_VEHICLES.glob("*.yaml")):
        for model, path in published_coefficients(vehicle).items():
            files[f"{vehicle.stem}_{model}"] = path
    return files


@dataclass(frozen=True)
class VehicleFile:
    """A vehicle and the file that it was read from."""

    file: YamlFile
    vehicle: Vehicle


def load_vehicle(path: Path, *, named_in: object = None) -> VehicleFile:
    """Read a vehicle file, with measured moments of inertia where it names them.

    Its key `rigid_body.measured_inertia` names the document of these. A file that has not
    changed is read once: a campaign compares its vehicle with several published sets,
    which stand beside one vehicle file.

    That path counts from the vehicle file. Raises `PipelineError` for a file that
    cannot be read and for what cannot be a vehicle.
    """
    file_named = named_in if named_in is not None else path
    content = document_bytes(path, file=file_named, what="vehicle")
    file, document = _described(path, content)
    named = document.rigid_body.measured_inertia
    if named is None:
        return _plain_vehicle(path, content)
    measured = load_yaml(
        path.parent / Path(named).expanduser(), named_in=path, what="rigid_body.measured_inertia"
    )  # JSON is YAML
    return _vehicle_of(file, with_measured_inertia(document, measured.parse(InertiaDocument)))


@lru_cache(maxsize=FILES_KEPT)
def _described(path: Path, content: bytes) -> tuple[YamlFile, VehicleDocument]:
    file = yaml_of(path, content)
    return file, file.parse(VehicleDocument)


@lru_cache(maxsize=FILES_KEPT)
def _plain_vehicle(path: Path, content: bytes) -> VehicleFile:
    return _vehicle_of(*_described(path, content))


def _vehicle_of(file: YamlFile, document: VehicleDocument) -> VehicleFile:
    try:
        return VehicleFile(file, vehicle_from_document(document))
    except PipelineError as fault:
        raise file.located(fault) from None


def load_published(path: Path, *, named_in: object = None) -> Vehicle:
    """Read a set of published coefficients with its vehicle.

    path: a vehicle file with `published`, or VEHICLE/coefficients/MODEL.csv beside
    VEHICLE.yaml. Raises as `load_vehicle` and `read_coefficients`.
    """
    if path.suffix != ".csv":
        return load_vehicle(path, named_in=named_in).vehicle
    folder = path.parent.parent
    loaded = load_vehicle(folder.with_suffix(".yaml"), named_in=named_in)
    document = loaded.vehicle.document
    published = {
        name: Quantity(value=value, unit=unit_of(name), source=f"{document.source}, {path.name}")
        for axis, row in read_coefficients(path).items()
        for term, value in row.items()
        for name in [f"{axis}_{term.replace('*', '')}"]
    }
    update = {
        "name": f"{folder.name}_{path.stem}",
        "title": f"{document.title}, {model_named(path.stem).title}",
        "published": published,
    }
    return vehicle_from_document(document.model_copy(update=update))


def published_coefficients(vehicle_file: Path) -> dict[str, Path]:
    """Return the files of published coefficients beside a vehicle file, by model."""
    return {
        path.stem: path for path in sorted(vehicle_file.with_suffix("").glob("coefficients/*.csv"))
    }


def read_coefficients(path: Path) -> dict[str, dict[str, float]]:
    """Read coefficients from a CSV file: axis -> term -> value.

    Its columns are axis, term, value. Raises `CampaignError`.
    """
    with readable(path, file=path, what="coefficients"):
        text = path.read_text(encoding="utf-8")
    coefficients: dict[str, dict[str, float]] = {}
    for number, row in enumerate(csv.DictReader(text.splitlines()), start=2):
        try:
            coefficients.setdefault(row["axis"], {})[row["term"]] = float(row["value"])
        except (KeyError, TypeError, ValueError):
            raise CampaignError(
                "not a coefficient",
                file=path,
                row=number,
                value=row,
                allowed="columns axis, term, value",
            ) from None
    return coefficients
