"""Documents: what users write and what stages hand on, each as a model."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from auvid.data_schemas.documents.model import Model

MODELS = {
    "vehicle": "vehicle.VehicleDocument",
    "inertia": "inertia.InertiaDocument",
}
"""Document -> its model in this folder."""


def model_of(name: str) -> type[Model]:
    """Return the model of a document; pydantic is not imported before."""
    module, _, kind = MODELS[name].partition(".")
    found: type[Model] = getattr(import_module(f"{__name__}.{module}"), kind)
    return found


def check_document(document: object, name: str, *, file: object = None) -> None:
    """Raise all faults of a document together."""
    where = file if file is not None else f"document '{name}'"
    if name in MODELS:
        from auvid.data_schemas.documents.model import parse

        parse(model_of(name), document, file=where)
        return
    from auvid.data_schemas.documents.yaml_schema import check_against_yaml

    check_against_yaml(document, name, file=file)
