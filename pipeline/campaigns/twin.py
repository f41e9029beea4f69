"""What a twin campaign reads: the plan, the viscous truth, and its logs and legs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.documents.plans.glide_plan import GlidePlanDocument
from auvid.data_schemas.documents.twin import Plan, TruthEntry, TwinDocument, plan_model
from auvid.data_schemas.errors import CampaignError, PipelineError, nearest
from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.dynamics.vehicle.glider_body import glider_body
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.vehicle_files import published_coefficients, read_coefficients
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.stages.simulate.bench_plans import bench_entries, bench_plan
from auvid.stages.simulate.flights import FORMS
from auvid.stages.simulate.glides import glide_entries
from auvid.stages.simulate.plans import Entries, manifest_entries, plan_from_document
from auvid.stages.simulate.rov.dive_plans import dive_entries, dive_plan

PHYSICS = "physics"
REFIT = "refit:"


def load_twin(
    entry: Mapping[str, Any],
    vehicle: Vehicle,
    *,
    plan: Path,
    vehicle_file: Path,
    folder: Path,
    file: object,
) -> TwinDocument:
    """Return the document of schema `twin`, with plan and truth read and checked.

    It belongs to the key `simulate` of a manifest.

    `plan` is the path of the plan, `file` the manifest (or command) that names it.
    Raises `CampaignError` or `SchemaError`.
    """
    accelerometer, format = entry.get("accelerometer", "specific_force"), entry.get("format", "bin")
    if accelerometer != "specific_force" and format != "csv":
        remedy = "Write CSV, or leave accelerometer out."
        raise CampaignError(
            f"logs of format {format} hold specific force",
            file=file,
            field="simulate.accelerometer",
            value=accelerometer,
            remedy=remedy,
        )
    read, truth = load_plan(plan, vehicle, file=file), entry.get("truth", PHYSICS)
    document = {
        "plan": read,
        "truth": load_truth(str(truth), vehicle_file=vehicle_file, folder=folder, file=file),
        "seed": entry.get("seed", 0),
        "format": format,
        "accelerometer": accelerometer,
    }
    return parse(TwinDocument, document, file=file)


def load_plan(path: Path, vehicle: Vehicle, *, file: object) -> Plan:
    """Return a plan that this vehicle can fly, checked."""
    plan_file = load_yaml(path, named_in=file, what="plan")
    plan = plan_file.parse(plan_model(plan_file.value))
    try:
        if isinstance(plan, DivePlanDocument):
            dive_plan(plan, vehicle, file=path)
        elif isinstance(plan, GlidePlanDocument):
            glider_body(vehicle)
        elif plan.bench is not None:
            bench_plan(plan, vehicle, file=path)
        else:
            plan_from_document(plan, vehicle, file=path)
    except PipelineError as fault:
        raise plan_file.located(fault) from None
    return plan


def load_truth(text: str, *, vehicle_file: Path, folder: Path, file: object) -> TruthEntry:
    """Return the truth that a manifest names (part `truth` of schema `twin`).

    `physics`; the name of a model for its published coefficients beside the vehicle
    file; `refit:MODEL` for a model refitted to the physics; or a path ending in .json
    for a model card.
    """
    if text == PHYSICS:
        source = "flow physics, hydro/dynamics/simulation/physical_viscous.py"
        return TruthEntry(kind="physics", name=PHYSICS, source=source)
    published = published_coefficients(vehicle_file)
    allowed = [PHYSICS, *published, f"{REFIT}MODEL", "a model card (.json)"]
    if text.startswith(REFIT):
        name = text.removeprefix(REFIT)
        if name not in FORMS:
            raise CampaignError(
                "no such model",
                file=file,
                field="simulate.truth",
                value=text,
                allowed=[f"{REFIT}{each}" for each in FORMS],
                remedy=nearest(name, FORMS),
            )
        return TruthEntry(kind="refit", name=name, source="refitted to the flow physics")
    if text.endswith(".json"):
        return _of_card(Path(text) if Path(text).is_absolute() else folder / text, file)
    if text not in published:
        raise CampaignError(
            "no such truth",
            file=file,
            field="simulate.truth",
            value=text,
            allowed=allowed,
            remedy=nearest(text, published),
        )
    return TruthEntry(
        kind="coefficients",
        name=text,
        source=f"published, {published[text].name}",
        coefficients=read_coefficients(published[text]),
    )


def _of_card(path: Path, file: object) -> TruthEntry:
    card = load_yaml(path, named_in=file, what="model card").parse(ModelCard)  # JSON is YAML
    return TruthEntry(
        kind="coefficients", name=card.name, source=path.name, coefficients=card.predictor
    )


def entries_of(plan: Plan, *, format: str) -> Entries:
    """Return the logs and legs of a plan, as a manifest has them."""
    if isinstance(plan, DivePlanDocument):
        return dive_entries(plan, format=format)
    if isinstance(plan, GlidePlanDocument):
        return glide_entries(plan)
    return (bench_entries if plan.bench is not None else manifest_entries)(plan, format=format)


def with_logs_of_plan(manifest: Mapping[str, Any], twin: TwinDocument) -> dict[str, Any]:
    """Return the manifest with the logs and legs of the plan."""
    logs, legs = entries_of(twin.plan, format=twin.format)
    return {**manifest, "logs": logs, "legs": legs}
