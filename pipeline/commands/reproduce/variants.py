"""The documents of a reproduction: plans and variants, and the published tables."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import (
    CampaignError,
    PipelineError,
    UsageError,
    nearest,
    raise_faults,
)
from auvid.pipeline.campaigns.campaign import ID, Campaign, inside, load_campaign
from auvid.pipeline.campaigns.stage_settings import load_defaults
from auvid.pipeline.campaigns.vehicle_files import published_coefficients, read_coefficients
from auvid.pipeline.campaigns.workspace import workspace_of
from auvid.pipeline.campaigns.yaml_files import YamlFile, load_yaml
from auvid.pipeline.store.atomic_files import readable
from auvid.stages.registry import KINDS, STAGES

FILE = "reproduce.yaml"
FOLDER = "reproduce"
FLIGHT, PAGE = "flight", "page"
"""Folders beside those of the variants and of the plans."""
SHARED = ("simulate", "ingest")


@dataclass(frozen=True)
class Reproduction:
    """A campaign with its document of variants and the folder of the results."""

    campaign: Campaign
    document: YamlFile
    defaults: YamlFile
    folder: Path


def open_reproduction(name: str) -> Reproduction:
    """Open the reproduction of a campaign given by name or path.

    Raises `PipelineError` for anything wrong with its documents.
    """
    workspace = workspace_of(name)
    folder = workspace.campaign_folder(name)
    campaign = load_campaign(folder, kinds=KINDS, vehicles=workspace.vehicle_files())
    path = folder / FILE
    if not path.is_file():
        names = [
            other
            for other in workspace.campaign_names()
            if (workspace.campaigns / other / FILE).is_file()
        ]
        remedy = (
            f"Campaigns that have one: {', '.join(names)}."
            if names
            else f"It needs a {FILE} beside its campaign.yaml."
        )
        raise UsageError("this campaign reproduces nothing", value=campaign.name, remedy=remedy)
    document = load_yaml(path)
    document.check("reproduction")
    raise_faults([document.located(fault) for fault in _faults(document, campaign)], file=path)
    return Reproduction(
        campaign,
        document,
        load_defaults(workspace, STAGES),
        workspace.runs / campaign.name / FOLDER,
    )


def _faults(file: YamlFile, campaign: Campaign) -> Iterator[PipelineError]:
    document, path = file.value, file.path
    if campaign.document["kind"] != "twin":
        yield CampaignError(
            "only a twin can fly the plans of a reproduction",
            file=path,
            field="plans",
            value=campaign.document["kind"],
        )
    names: dict[str, list[str]] = {}
    for part, reserved in (("plans", PAGE), ("variants", FLIGHT)):
        names[part] = [entry["id"] for entry in document[part]]
        if not names[part]:
            yield CampaignError("the list is empty", file=path, field=part)
        for index, name in enumerate(names[part]):
            if not ID.fullmatch(name) or name == reserved or name in names[part][:index]:
                allowed = f"letters, digits, _ and -, each name once, not {reserved}"
                yield CampaignError(
                    "not a name of its own",
                    file=path,
                    field=f"{part}[{index}].id",
                    value=name,
                    allowed=allowed,
                )
    references = [(f"compared.{role}", name) for role, name in document["compared"].items()]
    for index, plan in enumerate(document["plans"]):
        references += [
            (f"plans[{index}].variants[{at}]", name)
            for at, name in enumerate(plan.get("variants") or [])
        ]
    for field, name in references:
        if name not in names["variants"]:
            remedy = nearest(name, names["variants"])
            yield CampaignError(
                "no such variant",
                file=path,
                field=field,
                value=name,
                allowed=names["variants"],
                remedy=remedy,
            )
    flown = [
        f"{plan['id']}/{name}"
        for plan in document["plans"]
        for name in plan.get("variants") or names["variants"]
    ]
    for index, entry in enumerate(document["expected"]):
        key = f"{entry['plan']}/{entry['variant']}"
        if key not in flown:
            yield CampaignError(
                "no such variant of a plan",
                file=path,
                field=f"expected[{index}]",
                value=key,
                allowed=flown,
                remedy=nearest(key, flown),
            )
    for index, variant in enumerate(document["variants"]):
        stages = [stage for stage in KINDS[kind_of(variant)] if stage not in SHARED]
        for stage in variant.get("stages") or {}:
            if stage not in stages:
                at = f"variants[{index}].stages.{stage}"
                yield CampaignError(
                    "not a stage of this variant",
                    file=path,
                    field=at,
                    allowed=stages,
                    remedy=nearest(stage, stages),
                )


def kind_of(variant: Mapping[str, Any]) -> str:
    """Return the kind of graph of a variant, of `auvid.stages.KINDS`."""
    return "variant_with_true_states" if variant.get("states") == "truth" else "variant"


def with_text(reproduction: Reproduction) -> dict[str, Any]:
    """Return the document with the text of the page in place of the file's name."""
    document, manifest = reproduction.document.value, reproduction.document.path
    if "text" not in document:
        return dict(document)
    path = inside(reproduction.campaign.folder, document["text"], manifest)
    with readable(path, file=manifest, what="text of the page"):
        return {**document, "text": path.read_text(encoding="utf-8")}


def published_tables(reproduction: Reproduction) -> dict[str, Any]:
    """Return the document `published_tables`.

    It holds the rows of the CSV file, and the coefficients published with the vehicle
    file.
    """
    name, manifest = reproduction.document.value["published"], reproduction.document.path
    path = inside(reproduction.campaign.folder, name, manifest)
    with readable(path, file=manifest, what="table of published errors"):
        text = path.read_text(encoding="utf-8")
    rows: list[dict[str, Any]] = []
    faults: list[PipelineError] = []
    for number, row in enumerate(csv.DictReader(io.StringIO(text)), start=2):
        try:
            rows.append({column: convert(row[column] or "") for column, convert in COLUMNS.items()})
        except (KeyError, ValueError) as fault:
            faults.append(
                CampaignError(
                    f"not a row of published errors: {fault}",
                    file=path,
                    row=number,
                    allowed=", ".join(COLUMNS),
                )
            )
    if not rows and not faults:
        faults.append(CampaignError("the table of published errors is empty", file=path))
    raise_faults(faults, file=path)
    coefficients = {
        model: read_coefficients(file)
        for model, file in published_coefficients(reproduction.campaign.vehicle_file).items()
    }
    return {"source": name, "rows": rows, "coefficients": coefficients}


COLUMNS: dict[str, Any] = {
    "table": str,
    "set": str,
    "model": str,
    "n_bar_printed": int,
    "J": float,
    "J0": float,
    "ratio_printed": float,
    "ratio_recomputed": float,
    "note": str,
}
