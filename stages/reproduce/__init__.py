"""The page that holds a publication's error tables against those of a twin, in every
variant of the chain that was run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Collection, Document, Stage, port
from auvid.stages.page.campaign_sections import provenance_section, vehicle_line
from auvid.stages.page.html import render
from auvid.stages.reproduce.figures import figure_sections
from auvid.stages.reproduce.measures import Check, Found, checks, measure
from auvid.stages.reproduce.tables import Told
from auvid.stages.reproduce.text import sections, summary


@dataclass(frozen=True)
class Inputs:
    """`campaign` and `provenance` are those of the published procedure on the first
    plan.

    Collections are keyed `plan/variant/item`, and `plan/item` for what the variants of
    a plan share.
    """

    reproduction: Document = port("reproduction")
    published: Document = port("published_tables")
    vehicle: Vehicle = port("vehicle")
    campaign: Document = port("campaign")
    provenance: Document = port("provenance")
    plans: Collection[Document] = port("plan", many=True)
    simulation: Collection[Document] = port("simulation", many=True)
    truth: Collection[pa.Table] = port("truth", many=True)
    segment: Collection[Document] = port("segment", many=True)
    resampled: Collection[pa.Table] = port("resampled", many=True)
    fused: Collection[pa.Table] = port("fused", many=True)
    fusion: Collection[Document] = port("fusion", many=True)
    residual: Collection[pa.Table] = port("residual", many=True)
    predictions: Collection[pa.Table] = port("predictions", many=True)
    model_card: Collection[Document] = port("model_card", many=True)
    error_table: Collection[pa.Table] = port("error_table", many=True)


@dataclass(frozen=True)
class Params:
    """None: what is compared stands in the document."""


@dataclass(frozen=True)
class Outputs:
    page: bytes = port("report_html")
    errors: pa.Table = port("reproduction_errors")
    checks: pa.Table = port("reproduction_checks")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Raises `CampaignError` where the document names a variant, plan or leg that was
    not run.
    """
    document = inputs.reproduction
    found = {key: measure(key, inputs) for key in inputs.error_table}
    held = checks(document, found)
    told = Told(
        document,
        inputs.published,
        inputs.vehicle,
        dict(inputs.plans.items()),
        found,
        tuple(held),
    )
    shown: dict[str, dict[str, Any]] = {**sections(told), **figure_sections(inputs, document)}
    published = f"{told.plan}/{document['compared']['published']}/"
    cards = {key: inputs.model_card[key] for key in inputs.model_card if key.startswith(published)}
    shown["provenance"] = provenance_section(inputs.provenance, inputs.campaign, cards)
    page = render(
        str(document["title"]),
        vehicle_line(inputs.vehicle),
        str(document.get("notes", "")),
        summary(told),
        shown,
    )
    return Outputs(page, _errors(found, inputs.published), _checks(held))


def _errors(found: Mapping[str, Found], published: Document) -> pa.Table:
    printed = {(row["set"], row["model"]): row for row in published["rows"]}
    rows: list[dict[str, Any]] = []
    for key, item in found.items():
        plan, variant = key.split("/")
        for (use, model), score in item.scores.items():
            row = printed.get((use, model))
            rows.append(
                {
                    "plan": plan,
                    "variant": variant,
                    "use": use,
                    "model": model,
                    "n_bar": score.n_bar,
                    "rank": score.rank,
                    "j": score.j,
                    "j0": item.j0[use],
                    "ratio": score.ratio,
                    "published_j": None if row is None else float(row["J"]),
                    "published_ratio": None if row is None else float(row["ratio_recomputed"]),
                }
            )
    return make_table(
        "reproduction_errors", {name: [row[name] for row in rows] for name in rows[0]}
    )


def _checks(held: list[Check]) -> pa.Table:
    names = ("plan", "variant", "asked", "low", "high", "least", "most", "met", "known")
    return make_table(
        "reproduction_checks", {name: [getattr(item, name) for item in held] for name in names}
    )


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="reproduction",
    summary="Hold a publication's error tables against those of a twin",
    maps_over="campaign",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
)
