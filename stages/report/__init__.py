"""The report and the recording: what all stages show, under a first screen.

The stage knows no other stage: it renders the sections, views and tables that they
emit, in their order. Its own are the summary (`summary.py`), the list of logs and legs,
and the provenance.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from itertools import chain

import pyarrow as pa

from auvid.data_schemas.checks import checks, log_findings
from auvid.data_schemas.records.axes import AxisWindowsRecord
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard, RankingRecord
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Collection, Document, FileWriter, Stage, every, param, port
from auvid.stages.model_use import partial_words
from auvid.stages.page.campaign_sections import legs_section, provenance_section, vehicle_line
from auvid.stages.page.first_screen import Alert, Level, Summary, anchor
from auvid.stages.page.html import drawn_share, render, thinned
from auvid.stages.page.methods import methods_section
from auvid.stages.report.first_pictures import first_pictures
from auvid.stages.report.recording.identity import run_properties
from auvid.stages.report.summary.answer_text import answer_text
from auvid.stages.report.summary.axes_summary import summarise_axes, uses_of
from auvid.stages.report.summary.figure_summary import summarise_results
from auvid.stages.report.summary.model_summary import NO_RANKING, summarise

NO_MORE: Mapping[str, Document] = {}


@dataclass(frozen=True)
class Inputs:
    campaign: Document = port("campaign")
    vehicle: Vehicle = port("vehicle")
    provenance: Document = port("provenance")
    sections: Collection[Document] = every("section")
    views: Collection[Document] = every("views")
    tables: Collection[pa.Table] = every("table")
    results: Collection[Document] = every("results")
    log_info: Collection[LogInfo] | None = port("log_info", many=True, optional=True)
    health: Collection[Document] | None = port("health", many=True, optional=True)
    segment: Collection[SegmentRecord] | None = port("segment", many=True, optional=True)
    fused: Collection[pa.Table] | None = port("fused", many=True, optional=True)
    model_card: Collection[ModelCard] | None = port("model_card", many=True, optional=True)
    axis_windows: Collection[AxisWindowsRecord] | None = port(
        "axis_windows", many=True, optional=True
    )
    ranking: RankingRecord | None = port("ranking", optional=True)
    shelf: Mapping[str, Vehicle] | None = port("vehicle", many=True, optional=True)


@dataclass(frozen=True)
class Params:
    path_rate_hz: float = param(
        "Hz", 10.0, meaning="rate of the vehicle's pose in the 3D view", low=0.1, high=1000.0
    )
    recording_bins: int = param(
        "1",
        15_000,
        meaning="bins of a long series in the recording, each its smallest and largest value;"
        " up to twice as many samples are all shown",
        low=1000,
    )


@dataclass(frozen=True)
class Outputs:
    report_html: bytes = port("report_html")
    answer: bytes = port("answer")
    recording: FileWriter | None = port("recording", optional=True)


@dataclass(frozen=True)
class ReportContent:
    """Content that page and recording share: title, first screen, sections, logs."""

    title: str
    summary: Summary
    sections: Mapping[str, Document]
    segments: Mapping[str, SegmentRecord]
    logs: Mapping[str, LogInfo]


def run(inputs: Inputs, params: Params) -> Outputs:
    content = collect(inputs)
    outputs = Outputs(
        report_html=page(inputs, content), answer=answer_text(content.summary).encode("utf-8")
    )
    if find_spec("rerun") is None:
        warnings.warn(NO_RECORDING, stacklevel=1)
        return outputs
    recorded = replace(content, sections=without_curves(content.sections))
    return replace(outputs, recording=partial(render_recording, inputs, params, recorded))


def without_curves(sections: Mapping[str, Document]) -> dict[str, Document]:
    """Return sections without the points of their plots, for a recording.

    Those of many legs take much memory.
    """

    def left(block: Document) -> Document:
        if block["kind"] != "plot":
            return block
        panels = [
            {**panel, "series": [{**line, "x": [], "y": []} for line in panel["series"]]}
            for panel in block["panels"]
        ]
        return {**block, "panels": panels}

    return {
        name: {**document, "blocks": [left(block) for block in document["blocks"]]}
        for name, document in sections.items()
    }


NO_RECORDING = (
    "there is no recording for auvid inspect, because rerun-sdk was not installed when the report"
    " was written: pip install 'auvid[view]', then auvid report CAMPAIGN --rebuild"
)


def page(inputs: Inputs, content: ReportContent) -> bytes:
    """Return the report as HTML."""
    notes = str(inputs.campaign.get("notes") or "")
    log_of = (
        {name: str(item.log) for name, item in content.segments.items()}
        if len(content.logs) > 1
        else {}
    )
    return render(
        content.title,
        vehicle_line(inputs.vehicle, with_mass=not without_kilograms(inputs.model_card or {})),
        notes,
        content.summary,
        without_table_of(content.summary.recommended, content.sections),
        log_of,
        first_pictures(
            inputs.tables,
            inputs.fused or {},
            content.segments,
            content.logs,
            content.summary,
            dict(inputs.views.items()),
        ),
        share=1.0,
    )


def without_table_of(model: str | None, sections: Mapping[str, Document]) -> dict[str, Document]:
    """Return sections without the coefficients of the model of the first screen."""
    return {
        path: {
            **document,
            "blocks": [
                block
                for block in document["blocks"]
                if model is None or block.get("coefficients_of") != model
            ],
        }
        for path, document in sections.items()
    }


def collect(inputs: Inputs, more: Mapping[str, Document] = NO_MORE) -> ReportContent:
    """Return the first screen and the sections of all stages, and `more` sections.

    Their plots have the samples that the page draws: those of many legs take much memory.
    """
    share = drawn_share(chain(inputs.sections.values(), more.values()))
    sections = {path: fewer_samples(item, share) for path, item in inputs.sections.items()}
    more = {path: fewer_samples(item, share) for path, item in more.items()}
    results = dict(inputs.results.items())
    cards, segments, logs = (
        dict(inputs.model_card or {}),
        dict(inputs.segment or {}),
        dict(inputs.log_info or {}),
    )
    title = str(inputs.campaign.get("title") or inputs.vehicle.title)
    sections["provenance"] = provenance_section(inputs.provenance, inputs.campaign, cards)
    if logs:
        sections["campaign"] = legs_section(segments, logs)
    part = next((card for card in cards.values() if card.partial is not None), None)
    if results:
        log_of = {str(leg["id"]): str(leg.get("log")) for leg in inputs.campaign.get("legs") or ()}
        summary = summarise_results(results, logs, sections, inputs.vehicle.document, log_of)
        if part is not None and part.partial is not None and inputs.ranking is not None:
            usable = inputs.ranking.usable
            use = partial_words(part.partial, usable).partition(";")[0]
            count = summary.headline.partition(":")[0]
            summary = replace(
                summary,
                headline=f"{use[:1].upper()}{use[1:]}; {count[:1].lower()}{count[1:]}",
                uses=uses_of(part.partial, usable),
                rule=f"Judged by {inputs.ranking.rule}.",
            )
    elif part is not None and inputs.ranking is not None:
        summary = summarise_axes(
            part, inputs.ranking, logs, sections, inputs.vehicle, inputs.shelf or {}
        )
    else:
        summary = summarise(
            cards,
            inputs.ranking or NO_RANKING,
            segments,
            logs,
            sections,
            inputs.vehicle,
            inputs.shelf or {},
        )
    summary = replace(summary, log_findings=finding_alerts(inputs))
    sections["methods"] = methods_section(
        inputs.provenance, inputs.vehicle, segments, cards, summary
    )
    return ReportContent(title, summary, {**sections, **more}, segments, logs)


def fewer_samples(document: Document, share: float) -> Document:
    """Return a section whose plots have this share of their samples."""
    blocks = [
        thinned(block, share) if block["kind"] == "plot" else block for block in document["blocks"]
    ]
    return {**document, "blocks": blocks}


def without_kilograms(cards: Mapping[str, ModelCard]) -> bool:
    """Return whether the models of a run have a unit of mass of their own."""
    parts = [card.partial for card in cards.values()]
    return any(part is not None and part.unit_of_mass is not None for part in parts)


def finding_alerts(inputs: Inputs) -> tuple[Alert, ...]:
    """Return the findings of the logs with the place of each log's health.

    The names of the checks stand there.
    """
    health = dict(inputs.health or {})
    alerts = []
    for item in log_findings(inputs.campaign, health):
        check = checks()[item.check]
        level: Level = "poor" if check.severity == "error" or check.misleads else "fair"
        place = anchor("ingest", item.log)
        words = f"{item.whose}: {item.text}" if len(health) > 1 else item.text
        words += " (accepted)" if item.accepted else ""
        alerts.append(Alert(words, place, level, misleads=check.misleads))
    return tuple(alerts)


def render_recording(
    inputs: Inputs,
    params: Params,
    content: ReportContent,
    path: str,
    *,
    preview: bool = False,
    tab: str = "",
) -> None:
    """Save the recording to `path`; it opens on `tab`.

    A `preview` has few bins, see `Recording`.
    """
    # Rerun takes half a second to import, and most commands draw nothing.
    from auvid.stages.report.recording.recording import record
    from auvid.stages.report.recording.rerun_stream import PREVIEW_BINS

    record(
        content.title,
        content.summary,
        inputs.views,
        inputs.tables,
        inputs.fused or {},
        content.segments,
        content.logs,
        dict(inputs.axis_windows or {}),
        params.path_rate_hz,
        content.sections,
        content=inputs.provenance,
        properties=run_properties(
            content.title,
            inputs.vehicle.name,
            content.summary,
            dict(inputs.model_card or {}),
        ),
        bins=PREVIEW_BINS if preview else params.recording_bins,
        tab=tab,
        path=path,
    )


STAGE = Stage(
    "report",
    "HTML report and Rerun recording of what all stages found",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
    no_views="it draws the views of the others",
)
