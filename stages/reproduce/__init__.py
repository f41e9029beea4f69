"""The page that puts a publication's error tables beside those of a twin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from auvid.data_schemas.tables import make_table
from auvid.stages.base import Document, Stage, port
from auvid.stages.page.campaign_sections import provenance_section, vehicle_line
from auvid.stages.page.html import render
from auvid.stages.reproduce.artefacts import Artefacts
from auvid.stages.reproduce.content import ReproductionContent
from auvid.stages.reproduce.figures import figure_sections
from auvid.stages.reproduce.measures import VariantCheck, VariantMeasures, checks, measure
from auvid.stages.reproduce.text import sections, summary


@dataclass(frozen=True)
class Inputs(Artefacts):
    reproduction: Document = port("reproduction")
    published: Document = port("published_tables")
    campaign: Document = port("campaign")


@dataclass(frozen=True)
class Params:
    """No parameters: the document of the reproduction says what is compared."""


@dataclass(frozen=True)
class Outputs:
    page: bytes = port("report_html")
    errors: pa.Table = port("reproduction_errors")
    checks: pa.Table = port("reproduction_checks")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Measure every variant and make the page.

    Raises `CampaignError` where the document names a variant, plan or leg that was not
    run.
    """
    document = inputs.reproduction
    measures = {key: measure(key, inputs) for key in inputs.error_table}
    results = checks(document, measures)
    content = ReproductionContent(
        document,
        inputs.published,
        inputs.vehicle,
        {
            key.split("/")[0]: twin.plan.model_dump(exclude_unset=True)
            for key, twin in inputs.twin.items()
        },
        measures,
        tuple(results),
    )
    published = f"{content.plan}/{document['compared']['published']}"
    cards = {
        key: inputs.model_card[key] for key in inputs.model_card if key.startswith(f"{published}/")
    }
    page = render(
        str(document["title"]),
        vehicle_line(inputs.vehicle),
        str(document.get("notes", "")),
        summary(content),
        {
            **sections(content),
            **figure_sections(inputs, document),
            "provenance": provenance_section(inputs.provenance[published], inputs.campaign, cards),
        },
    )
    return Outputs(page, _errors(measures, content.printed), _checks(results))


def _errors(
    measures: Mapping[str, VariantMeasures], printed: Mapping[tuple[str, str], Document]
) -> pa.Table:
    rows: list[dict[str, Any]] = []
    for key, item in measures.items():
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


def _checks(results: Sequence[VariantCheck]) -> pa.Table:
    checked = [item.check for item in results]
    return make_table(
        "reproduction_checks",
        {
            "plan": [item.plan for item in results],
            "variant": [item.variant for item in results],
            "quantity": [check.quantity for check in checked],
            "low": [check.low for check in checked],
            "high": [check.high for check in checked],
            "least": [check.least for check in checked],
            "most": [check.value for check in checked],
            "met": [check.met for check in checked],
            "evidence": [check.evidence for check in checked],
            "reason": [check.evidence_reason for check in checked],
            "accepted_reason": [check.accepted_reason for check in checked],
        },
    )


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="reproduce",
    summary="A publication's error tables beside those of a twin, from several runs",
    maps_over="campaign",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
    no_views="its figures are those of the publication, on the page",
)
