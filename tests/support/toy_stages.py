"""A graph of four toy stages for tests of the runner: one per kind of work item.
Nothing is physical.

A log is bytes; each byte is a depth in metres, one a second. `BAD` at the start of a
log is a user's fault, `CRASH` one of the program.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import LogError
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.campaign import load_campaign
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.graph import Graph
from auvid.stages.base import Collection, Document, RawLog, Stage, every, make_params, param, port
from auvid.stages.presentation import section

VEHICLES = {"toy": Path(__file__).resolve().parents[2] / "vehicles" / "bluerov2_heavy.yaml"}
KINDS = {"identification": ("decode", "cut", "spread", "total")}


@dataclass(frozen=True)
class DecodeInputs:
    raw_log: RawLog = port("raw_log")
    campaign: Document = port("campaign")


@dataclass(frozen=True)
class DecodeParams:
    scale: float = param("m", 1.0, meaning="depth of one step", low=0.1, high=10.0)


@dataclass(frozen=True)
class DecodeOutputs:
    depth: pa.Table = port("depth")
    section: Document = port("section")
    battery: pa.Table | None = port("battery", optional=True)


def decode(inputs: DecodeInputs, params: DecodeParams) -> DecodeOutputs:
    content = np.concatenate([np.asarray(file.buffer) for file in inputs.raw_log.files])
    start = content[:5].tobytes()
    if start.startswith(b"BAD"):
        raise LogError("not a toy log", file=inputs.raw_log.files[0].name)
    if start == b"CRASH":
        raise ZeroDivisionError("toy crash")
    if start.startswith(b"WARN"):
        warnings.warn("toy warning", RuntimeWarning, stacklevel=1)
    time_us = np.arange(content.size, dtype=np.int64) * 1_000_000
    depth = make_table("depth", {"time_us": time_us, "depth_m": content * params.scale})
    battery = (
        make_table("battery", {"time_us": time_us, "voltage_v": np.full(content.size, 12.0)})
        if content.size > 100
        else None
    )
    return DecodeOutputs(depth, section(f"Log {inputs.raw_log.id}", [], order=1), battery)


@dataclass(frozen=True)
class CutInputs:
    leg: LegEntry = port("leg")
    depth: pa.Table = port("depth")


@dataclass(frozen=True)
class CutParams:
    parts: int = param("1", 1, meaning="segments per leg", low=0, high=9)


@dataclass(frozen=True)
class CutOutputs:
    samples_depth: Mapping[str, pa.Table] = port("samples_depth", many=True)


def cut(inputs: CutInputs, params: CutParams) -> CutOutputs:
    name = inputs.leg.id
    keys = [name] if params.parts == 1 else [f"{name}.{part + 1}" for part in range(params.parts)]
    pieces = np.array_split(inputs.depth["depth_m"].to_numpy(), max(params.parts, 1))
    tables = [
        make_table("samples_depth", {"t_s": np.arange(piece.size, dtype=float), "z_m": piece})
        for piece in pieces
    ]
    return CutOutputs(dict(zip(keys, tables, strict=False)))


@dataclass(frozen=True)
class SpreadInputs:
    samples_depth: pa.Table = port("samples_depth")
    vehicle: Vehicle = port("vehicle")
    depth: pa.Table = port("depth")
    battery: pa.Table | None = port("battery", optional=True)


@dataclass(frozen=True)
class SpreadParams:
    floor: float = param("m", 0.0, meaning="distances below are set to it", low=0.0)
    plan: Mapping[str, float] = param("1", {}, meaning="not used")


@dataclass(frozen=True)
class SpreadOutputs:
    range: pa.Table = port("range")
    section: Document = port("section")


def spread(inputs: SpreadInputs, params: SpreadParams) -> SpreadOutputs:
    values = inputs.samples_depth["z_m"].to_numpy()
    distance = np.maximum(np.abs(values - values.mean()), params.floor)
    table = make_table(
        "range", {"time_us": np.arange(values.size, dtype=np.int64), "range_m": distance}
    )
    return SpreadOutputs(
        table, section("Spread", [], order=2, look_for="" if inputs.battery is None else "battery")
    )


@dataclass(frozen=True)
class TotalInputs:
    range: Collection[pa.Table] = port("range", many=True)
    sections: Collection[Document] = every("section")
    tables: Collection[pa.Table] = every("table")


@dataclass(frozen=True)
class TotalParams:
    pass


@dataclass(frozen=True)
class TotalOutputs:
    error_metrics: Document = port("error_metrics")
    tables_text: bytes = port("tables_text")
    mode: Mapping[str, pa.Table] = port("mode", many=True)


def total(inputs: TotalInputs, params: TotalParams) -> TotalOutputs:
    sums = {
        name: float(np.sum(table["range_m"].to_numpy())) for name, table in inputs.range.items()
    }
    text = "\n".join([*inputs.sections, *inputs.tables])
    empty = make_table(
        "mode", {"time_us": np.zeros(0, dtype=np.int64), "mode": pa.array([], pa.string())}
    )
    return TotalOutputs(
        {"training": {"toy": sums}, "validation": {}},
        text.encode(),
        dict.fromkeys(inputs.range, empty),
    )


STAGES: tuple[Stage[Any, Any, Any], ...] = (
    Stage("decode", "Bytes to depths", "log", DecodeInputs, DecodeParams, DecodeOutputs, decode),
    Stage(
        "cut", "Depths to segments", "leg", CutInputs, CutParams, CutOutputs, cut, yields="segment"
    ),
    Stage(
        "spread",
        "Distance from the mean",
        "segment",
        SpreadInputs,
        SpreadParams,
        SpreadOutputs,
        spread,
    ),
    Stage("total", "Sum per segment", "campaign", TotalInputs, TotalParams, TotalOutputs, total),
)


def write_campaign(
    folder: Path, text: str | None = None, logs: Mapping[str, bytes] | None = None
) -> Path:
    """A campaign folder with two logs and three legs, or with this manifest and these
    logs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in (logs or {"a.log": bytes(range(60)), "b.log": bytes(range(120))}).items():
        (folder / name).write_bytes(content)
    (folder / "campaign.yaml").write_text(text or MANIFEST, encoding="utf-8")
    return folder


MANIFEST = """\
kind: identification
vehicle: toy
logs:
  - {id: a, file: a.log}
  - {id: b, file: b.log}
legs:
  - {id: one, log: a, use: training}
  - {id: two, log: b, use: training}
  - {id: three, log: b, use: validation}
"""


def open_run(folder: Path, runs: Path, **params: Mapping[str, Any]) -> Run:
    """A run of the toy graph with these parameters per stage."""
    campaign = load_campaign(folder, kinds=KINDS, vehicles=VEHICLES)
    values = {
        stage.name: make_params(stage.params, params.get(stage.name, {}), stage=stage.name)
        for stage in STAGES
    }
    return Run(campaign, Graph(STAGES), values, runs / campaign.name)
