"""The stages of auvid, in the order of the chain, and which of them each kind of campaign has."""

from __future__ import annotations

from typing import Any

from stages import compare, control, fuse, ingest, pipendulum, report, resample, residual, rlse, simulate, synthesise, trust, validate
from stages.base import Stage

STAGES: tuple[Stage[Any, Any, Any], ...] = (
    simulate.STAGE,
    ingest.STAGE,
    resample.STAGE,
    fuse.STAGE,
    residual.STAGE,
    synthesise.STAGE,
    validate.STAGE,
    trust.STAGE,
    pipendulum.STAGE,
    rlse.STAGE,
    control.STAGE,
    compare.STAGE,
    report.STAGE,
)

KINDS: dict[str, tuple[str, ...]] = {
    "identification": ("ingest", "resample", "fuse", "residual", "synthesise", "validate", "report"),
    "twin": ("simulate", "ingest", "resample", "fuse", "residual", "synthesise", "validate", "trust", "report"),
    "bench": ("ingest", "pipendulum", "rlse", "compare", "report"),
    "bench_twin": ("simulate", "ingest", "pipendulum", "rlse", "compare", "report"),
    "control": ("control", "compare", "report"),
}
