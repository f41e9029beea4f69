"""The report and the recording: what all stages show, arranged; and a first screen that says what came out.

The stage knows no other stage: it renders the sections, views and tables that they emit, in their order. Its own are the summary
(`summary.py`), the list of logs and legs, and the provenance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from stages.base import Collection, Document, Stage, every, param, port
from stages.report.html import render
from stages.report.own_sections import legs_section, provenance_section, vehicle_line
from stages.report.summary import summarise
from stages.report.summary_results import summarise_results


@dataclass(frozen=True)
class Inputs:
    campaign: Document = port("campaign")
    vehicle: Document = port("vehicle")
    provenance: Document = port("provenance")
    sections: Collection[Document] = every("section")
    views: Collection[Document] = every("views")
    tables: Collection[pa.Table] = every("table")
    results: Collection[Document] = every("results")
    log_info: Collection[Document] | None = port("log_info", many=True, optional=True)
    segment: Collection[Document] | None = port("segment", many=True, optional=True)
    fused: Collection[pa.Table] | None = port("fused", many=True, optional=True)
    model_card: Collection[Document] | None = port("model_card", many=True, optional=True)
    error_table: pa.Table | None = port("error_table", optional=True)
    free_run: pa.Table | None = port("free_run", optional=True)


@dataclass(frozen=True)
class Params:
    path_rate_hz: float = param("Hz", 10.0, meaning="rate of the vehicle's pose in the 3D view", low=0.1, high=1000.0)


@dataclass(frozen=True)
class Outputs:
    report_html: bytes = port("report_html")
    recording: bytes = port("recording")


def run(inputs: Inputs, params: Params) -> Outputs:
    sections, results = dict(inputs.sections.items()), dict(inputs.results.items())
    cards, segments, logs = dict(inputs.model_card or {}), dict(inputs.segment or {}), dict(inputs.log_info or {})
    title = str(inputs.campaign.get("title") or inputs.vehicle.get("title") or inputs.campaign["vehicle"])
    notes = str(inputs.campaign.get("notes") or "")
    own: dict[str, dict[str, Any]] = {"provenance": provenance_section(inputs.provenance, inputs.campaign, cards)}
    if logs:
        own["campaign"] = legs_section(segments, logs)
    if results:
        summary = summarise_results(results, logs, {**sections, **own}, inputs.vehicle)
    else:
        summary = summarise(cards, inputs.error_table, segments, logs, {**sections, **own}, inputs.vehicle, inputs.free_run)
    log_of = {name: str(item["log"]) for name, item in segments.items()} if len(logs) > 1 else {}
    page = render(title, vehicle_line(inputs.vehicle), notes, summary, {**sections, **own}, log_of)
    from stages.report.recording import record  # Rerun takes half a second to import, and most commands draw nothing

    recording = record(title, summary, inputs.views, inputs.tables, inputs.fused or {}, segments, logs, params.path_rate_hz)
    return Outputs(report_html=page, recording=recording)


STAGE = Stage("report", "HTML report and Rerun recording of what all stages found", "campaign", Inputs, Params, Outputs, run)
