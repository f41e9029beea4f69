"""The stages of auvid in the order of the chain, and those of each kind of campaign.

It imports every stage: whoever needs one module of this package does without it.
"""

from __future__ import annotations

from typing import Any

from auvid.stages import (
    axis_record,
    check_installation,
    check_published,
    check_truth,
    coast,
    control,
    fit_axes,
    fuse,
    glide,
    ingest,
    model_file,
    passive,
    pipendulum,
    refine,
    replace_state,
    report,
    reproduce,
    resample,
    residual,
    rlse,
    score_shelf,
    simulate,
    synthesise,
    validate,
)
from auvid.stages.base import Stage

STAGES: tuple[Stage[Any, Any, Any], ...] = (
    simulate.STAGE,
    ingest.STAGE,
    axis_record.STAGE,
    resample.STAGE,
    check_installation.STAGE,
    fuse.STAGE,
    replace_state.STAGE,
    residual.STAGE,
    synthesise.STAGE,
    coast.STAGE,
    refine.STAGE,
    validate.STAGE,
    fit_axes.STAGE,
    glide.STAGE,
    passive.STAGE,
    model_file.STAGE,
    score_shelf.STAGE,
    check_truth.STAGE,
    pipendulum.STAGE,
    rlse.STAGE,
    control.STAGE,
    check_published.STAGE,
    report.STAGE,
    reproduce.STAGE,
)

KINDS: dict[str, tuple[str, ...]] = {
    "identification": (
        "ingest",
        "resample",
        "check_installation",
        "fuse",
        "residual",
        "synthesise",
        "coast",
        "refine",
        "validate",
        "model_file",
        "score_shelf",
        "report",
    ),
    "twin": (
        "simulate",
        "ingest",
        "resample",
        "check_installation",
        "fuse",
        "residual",
        "synthesise",
        "coast",
        "refine",
        "validate",
        "model_file",
        "score_shelf",
        "check_truth",
        "report",
    ),
    "axes": ("ingest", "axis_record", "fit_axes", "model_file", "report"),
    "bench": ("ingest", "pipendulum", "rlse", "check_published", "report"),
    "bench_twin": ("simulate", "ingest", "pipendulum", "rlse", "check_published", "report"),
    "glide": ("ingest", "glide", "model_file", "check_published", "report"),
    "passive": ("ingest", "passive", "model_file", "check_published", "report"),
    "glide_twin": ("simulate", "ingest", "glide", "model_file", "check_published", "report"),
    "control": ("control", "check_published", "report"),
    "variant": ("simulate", "ingest", "resample", "fuse", "residual", "synthesise", "validate"),
    "variant_with_true_states": (
        "simulate",
        "ingest",
        "resample",
        "replace_state",
        "residual",
        "synthesise",
        "validate",
    ),
    "reproduction": ("reproduce",),
}
REPRODUCTION_KINDS = ("variant", "variant_with_true_states", "reproduction")
"""Kinds that `auvid reproduce` runs; a manifest has one of the others."""
