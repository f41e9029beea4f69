"""The stages of auvid in the order of the chain, and those of each kind of campaign.

A stage is the module of its name in this package; it is imported when it is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any, overload

from auvid.stages.base import Stage

AnyStage = Stage[Any, Any, Any]


class StageList(Sequence[AnyStage]):
    """Stages in an order, by `names`: a run imports those of its kind, not all."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)

    @property
    def modules(self) -> tuple[str, ...]:
        """Names of the modules that hold them."""
        return tuple(f"{__package__}.{name}" for name in self.names)

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, place: int) -> AnyStage: ...

    @overload
    def __getitem__(self, place: slice) -> tuple[AnyStage, ...]: ...

    def __getitem__(self, place: int | slice) -> AnyStage | tuple[AnyStage, ...]:
        if isinstance(place, slice):
            return tuple(self)[place]
        stage: AnyStage = import_module(self.modules[place]).STAGE
        return stage


STAGES = StageList(
    (
        "simulate",
        "ingest",
        "axis_record",
        "resample",
        "check_installation",
        "fuse",
        "replace_state",
        "residual",
        "synthesise",
        "coast",
        "refine",
        "validate",
        "fit_axes",
        "glide",
        "passive",
        "model_file",
        "score_shelf",
        "check_truth",
        "pipendulum",
        "rlse",
        "control",
        "check_published",
        "report",
        "reproduce",
    )
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
