"""What a twin campaign reads: the plan, the viscous truth, and its logs and legs."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.yaml_files import YamlFile, load_yaml
from auvid.pipeline.store.atomic_files import readable
from auvid.stages.simulate.bench_plans import bench_entries, bench_plan
from auvid.stages.simulate.flights import FORMS
from auvid.stages.simulate.plans import manifest_entries, plan_from_document
from auvid.stages.simulate.rov.dive_plans import dive_entries, dive_plan, is_dive_plan

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
) -> dict[str, Any]:
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
    plan_file = load_plan(plan, vehicle, file=file)
    truth = load_truth(
        str(entry.get("truth", PHYSICS)), vehicle_file=vehicle_file, folder=folder, file=file
    )
    return {
        "plan": plan_file.value,
        "truth": truth,
        "seed": int(entry.get("seed", 0)),
        "format": format,
        "accelerometer": accelerometer,
    }


def load_plan(path: Path, vehicle: Vehicle, *, file: object) -> YamlFile:
    """A plan that agrees with its schema and that this vehicle can fly."""
    plan_file = load_yaml(path, named_in=file, what="plan")
    dives = isinstance(plan_file.value, Mapping) and is_dive_plan(plan_file.value)
    plan_file.check("dive_plan" if dives else "plan")
    try:
        if dives:
            dive_plan(plan_file.value, vehicle, file=path)
        else:
            check = bench_plan if "bench" in plan_file.value else plan_from_document
            check(plan_file.value, vehicle, file=path)
    except CampaignError as fault:
        raise plan_file.located(fault) from None
    return plan_file


def load_truth(text: str, *, vehicle_file: Path, folder: Path, file: object) -> dict[str, Any]:
    """The truth that a manifest names (part `truth` of schema `twin`).

    `physics`; the name of a model for its published coefficients beside the vehicle
    file; `refit:MODEL` for a model refitted to the physics; or a path ending in .json
    for a model card.
    """
    if text == PHYSICS:
        return {
            "kind": "physics",
            "name": PHYSICS,
            "source": "flow physics, hydro/dynamics/simulation/physical_viscous.py",
        }
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
        return {"kind": "refit", "name": name, "source": "refitted to the flow physics"}
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
    return {
        "kind": "coefficients",
        "name": text,
        "source": f"published, {published[text].name}",
        "coefficients": read_coefficients(published[text]),
    }


def published_coefficients(vehicle_file: Path) -> dict[str, Path]:
    """The files of published coefficients beside a vehicle file, by model."""
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


def _of_card(path: Path, file: object) -> dict[str, Any]:
    card = load_yaml(path, named_in=file, what="model card").parse(ModelCard)  # JSON is YAML
    return {
        "kind": "coefficients",
        "name": card.name,
        "source": path.name,
        "coefficients": card.predictor,
    }


def entries_of(plan: Mapping[str, Any]) -> Callable[..., Entries]:
    """Return what gives the logs and legs of a plan of this kind."""
    if is_dive_plan(plan):
        return dive_entries
    return bench_entries if "bench" in plan else manifest_entries


Entries = tuple[list[dict[str, Any]], list[dict[str, Any]]]
"""The logs and the legs of a manifest."""


def with_logs_of_plan(manifest: Mapping[str, Any], twin: Mapping[str, Any]) -> dict[str, Any]:
    """The manifest with the logs and legs of the plan."""
    logs, legs = entries_of(twin["plan"])(twin["plan"], format=twin["format"])
    return {**manifest, "logs": logs, "legs": legs}
