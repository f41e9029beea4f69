"""Documents: what users write and what stages hand on, each as a model."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from auvid.data_schemas.documents.model import Model

MODELS = {
    "apparatus": "documents.apparatus.ApparatusDocument",
    "axis_windows": "records.axes.AxisWindowsRecord",
    "campaign": "documents.campaign.CampaignDocument",
    "column_map": "documents.column_map.ColumnMapDocument",
    "control_cases": "documents.control_cases.ControlCasesDocument",
    "dive_plan": "documents.plans.dive_plan.DivePlanDocument",
    "error_metrics": "records.models.ErrorMetrics",
    "fleet_run": "records.fleet.FleetRun",
    "fusion": "records.motion.FusionRecord",
    "health": "records.logs.HealthRecord",
    "installation": "records.motion.InstallationRecord",
    "inertia": "documents.vehicle.vehicle.InertiaDocument",
    "leg": "documents.campaign.LegEntry",
    "log_info": "records.logs.LogInfo",
    "log_survey": "records.fleet.LogSurvey",
    "model_card": "records.models.ModelCard",
    "model_file": "records.model_file.ModelFile",
    "plan": "documents.plans.plan.PlanDocument",
    "prior_sources": "records.priors.PriorSourcesRecord",
    "provenance": "records.report.Provenance",
    "published_tables": "records.report.PublishedTables",
    "published_values": "documents.published_values.PublishedValuesDocument",
    "ranking": "records.models.RankingRecord",
    "reproduction": "documents.reproduction.ReproductionDocument",
    "results": "records.results.ResultsRecord",
    "section": "records.report.SectionRecord",
    "segment": "records.motion.SegmentRecord",
    "simulation": "records.results.SimulationRecord",
    "tolerances": "documents.tolerances.TolerancesDocument",
    "triangular_factor": "records.models.FactorRecord",
    "twin": "documents.twin.TwinDocument",
    "vehicle": "documents.vehicle.vehicle.VehicleDocument",
    "views": "records.report.ViewsRecord",
}
"""Document -> its model, counted from data_schemas."""
NUMBERS = {float, int, bool, type(None)}
SCALARS = {str, *NUMBERS}


def model_of(name: str) -> type[Model]:
    """Return the model of a document; pydantic is not imported before."""
    module, _, kind = MODELS[name].rpartition(".")
    model: type[Model] = getattr(import_module(f"auvid.data_schemas.{module}"), kind)
    return model


DELIVERED = frozenset(
    {
        "apparatus",
        "axis_windows",
        "control_cases",
        "fleet_run",
        "fusion",
        "leg",
        "installation",
        "log_info",
        "log_survey",
        "model_card",
        "model_file",
        "prior_sources",
        "published_values",
        "ranking",
        "segment",
        "triangular_factor",
        "twin",
    }
)
"""Documents that reach a stage as their models; the others do as mappings."""


def delivered(document: object, name: str, *, file: object = None) -> Any:
    """Return a document as a stage gets it, checked: a model, or a mapping."""
    from auvid.data_schemas.documents.model import parse

    model = parse(model_of(name), document, file=file)
    return model if name in DELIVERED else document


def written(document: object) -> object:
    """Return a document as it is written: the fields of a model that were given."""
    from auvid.data_schemas.documents.model import Model

    return document.model_dump(exclude_unset=True) if isinstance(document, Model) else document


def check_document(document: object, name: str, *, file: object = None) -> None:
    """Raise all faults of a document together; tuples pass for lists."""
    from auvid.data_schemas.documents.model import parse

    where = file if file is not None else f"document '{name}'"
    parse(model_of(name), _plain(written(document)), file=where)


def _plain(value: object) -> object:
    if type(value) in SCALARS:
        return value
    if isinstance(value, dict | Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if not isinstance(value, list | tuple):
        return value
    # long series hold only numbers: nothing in them is to be made plain
    return list(value) if set(map(type, value)) <= NUMBERS else [_plain(item) for item in value]
