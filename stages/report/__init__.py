"""The report and the recording: what all stages show, arranged; and a first screen that
says what came out.

The stage knows no other stage: it renders the sections, views and tables that they
emit, in their order. Its own are the summary (`summary.py`), the list of logs and legs,
and the provenance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import pyarrow as pa

from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Collection, Document, Stage, every, param, port
from auvid.stages.page.campaign_sections import legs_section, provenance_section, vehicle_line
from auvid.stages.page.first_screen import Summary
from auvid.stages.page.html import render
from auvid.stages.report.summary.figure_summary import summarise_results
from auvid.stages.report.summary.model_summary import summarise

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
    log_info: Collection[Document] | None = port("log_info", many=True, optional=True)
    segment: Collection[Document] | None = port("segment", many=True, optional=True)
    fused: Collection[pa.Table] | None = port("fused", many=True, optional=True)
    model_card: Collection[Document] | None = port("model_card", many=True, optional=True)
    error_table: pa.Table | None = port("error_table", optional=True)
    free_run: pa.Table | None = port("free_run", optional=True)


@dataclass(frozen=True)
class Params:
    path_rate_hz: float = param(
        "Hz", 10.0, meaning="rate of the vehicle's pose in the 3D view", low=0.1, high=1000.0
    )


@dataclass(frozen=True)
class Outputs:
    report_html: bytes = port("report_html")
    recording: bytes = port("recording")


@dataclass(frozen=True)
class Told:
    """What page and recording share: the title, the first screen, all sections,
    segments and logs.
    """

    title: str
    summary: Summary
    sections: Mapping[str, Document]
    segments: Mapping[str, Document]
    logs: Mapping[str, Document]


def run(inputs: Inputs, params: Params) -> Outputs:
    told = tell(inputs)
    return Outputs(report_html=page(inputs, told), recording=draw(inputs, params, told))


def page(inputs: Inputs, told: Told) -> bytes:
    """The report as HTML."""
    notes = str(inputs.campaign.get("notes") or "")
    log_of = (
        {name: str(item["log"]) for name, item in told.segments.items()}
        if len(told.logs) > 1
        else {}
    )
    return render(
        told.title, vehicle_line(inputs.vehicle), notes, told.summary, told.sections, log_of
    )


def tell(inputs: Inputs, more: Mapping[str, Document] = NO_MORE) -> Told:
    """The first screen and the sections of all stages, and `more` sections."""
    sections, results = dict(inputs.sections.items()), dict(inputs.results.items())
    cards, segments, logs = (
        dict(inputs.model_card or {}),
        dict(inputs.segment or {}),
        dict(inputs.log_info or {}),
    )
    title = str(inputs.campaign.get("title") or inputs.vehicle.title)
    sections["provenance"] = provenance_section(inputs.provenance, inputs.campaign, cards)
    if logs:
        sections["campaign"] = legs_section(segments, logs)
    if results:
        summary = summarise_results(results, logs, sections, inputs.vehicle.document)
    else:
        summary = summarise(
            cards,
            inputs.error_table,
            segments,
            logs,
            sections,
            inputs.vehicle.document,
            inputs.free_run,
        )
    return Told(title, summary, {**sections, **more}, segments, logs)


def draw(
    inputs: Inputs, params: Params, told: Told, *, preview: bool = False, tab: str = ""
) -> bytes:
    """The recording, which opens on `tab`; a `preview` has its series thinned by
    minimum and maximum per bin.
    """
    from auvid.stages.report.recording.recording import (
        record,
    )  # Rerun takes half a second to import, and most commands draw nothing

    return record(
        told.title,
        told.summary,
        inputs.views,
        inputs.tables,
        inputs.fused or {},
        told.segments,
        told.logs,
        params.path_rate_hz,
        told.sections,
        preview=preview,
        tab=tab,
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
