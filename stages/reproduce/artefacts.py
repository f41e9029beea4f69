"""The results of all variants of a reproduction, keyed `PLAN/VARIANT/ITEM`."""

from __future__ import annotations

from dataclasses import dataclass

import pyarrow as pa

from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Collection, Document, from_runs, port


@dataclass(frozen=True)
class Artefacts:
    """Results of the runs `PLAN/VARIANT`; what a campaign has once has that key."""

    vehicle: Vehicle = port("vehicle")
    twin: Collection[TwinDocument] = from_runs("twin")
    provenance: Collection[Document] = from_runs("provenance")
    simulation: Collection[Document] = from_runs("simulation")
    truth: Collection[pa.Table] = from_runs("truth")
    segment: Collection[SegmentRecord] = from_runs("segment")
    resampled: Collection[pa.Table] = from_runs("resampled")
    fused: Collection[pa.Table] = from_runs("fused")
    fusion: Collection[FusionRecord] = from_runs("fusion")
    residual: Collection[pa.Table] = from_runs("residual")
    predictions: Collection[pa.Table] = from_runs("predictions")
    model_card: Collection[ModelCard] = from_runs("model_card")
    error_table: Collection[pa.Table] = from_runs("error_table")
