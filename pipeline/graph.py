"""The graph of stages: an input port is fed by the stage that outputs its schema.

A port of a campaign stage that takes artefacts by key (model cards by model) is fed by
all earlier stages that output them, each under keys of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from auvid.data_schemas.errors import UsageError, nearest
from auvid.data_schemas.schemas import schema
from auvid.stages.base import Item, Stage, ports
from auvid.stages.registry import StageList

AnyStage = Stage[Any, Any, Any]
MANIFEST_PORTS = (
    "vehicle",
    "campaign",
    "leg",
    "raw_log",
    "twin",
    "provenance",
    "reproduction",
    "published_tables",
)
SIMULATED_LOG = "simulated_log"
ONCE = "campaign"
"""The one item of a stage that maps over the campaign, and of what it gives."""
SIZE: dict[Item, int] = {"log": 0, "leg": 1, "segment": 2, "campaign": 3}


class WiringError(Exception):
    """Stages that do not fit together: a fault of auvid, not of the user's campaign."""


@dataclass(frozen=True)
class Port:
    """An output port of a stage."""

    stage: AnyStage
    name: str
    schema: str
    many: bool

    @property
    def level(self) -> Item:
        """Return what an artefact of this port belongs to."""
        return self.stage.yields if self.stage.yields and self.many else self.stage.maps_over

    @property
    def keyed(self) -> bool:
        """Whether one item gives several artefacts that are not items themselves."""
        return self.many and not self.stage.yields

    def owner(self, item: str, key: str | None) -> str:
        """Return the item that an artefact belongs to."""
        return str(key) if self.stage.yields and self.many else item

    def path(self, item: str, key: str | None = None) -> str:
        """Return the path of an artefact in its stage's folder; `key` only for many."""
        suffix = schema(self.schema).suffix
        if self.stage.yields and self.many:
            return f"{key}/{self.name}{suffix}"
        folder = "" if self.stage.maps_over == ONCE else f"{item}/"
        return (
            f"{folder}{self.name}{suffix}" if key is None else f"{folder}{self.name}/{key}{suffix}"
        )


@dataclass(frozen=True)
class Feed:
    """How an input port is fed: by the manifest, one port, or all of a schema.

    A raw log is fed by the manifest, or by the one port of simulated logs; `runs` by
    other runs (`Run.members`). Several `producers` give artefacts by key.
    """

    port: str
    schema: str
    optional: bool
    producers: tuple[Port, ...] = ()
    every: bool = False
    runs: bool = False


@dataclass(frozen=True)
class Graph:
    """Stages in running order. Raises `WiringError` where they do not fit together."""

    stages: tuple[AnyStage, ...]

    def __post_init__(self) -> None:
        for stage in self.stages:
            self.feeds(stage)

    @cached_property
    def outputs(self) -> tuple[Port, ...]:
        return tuple(
            Port(stage, name, spec["port"], bool(spec["many"]))
            for stage in self.stages
            for name, spec in ports(stage.outputs).items()
        )

    def stage(self, name: str) -> AnyStage:
        """Return the stage of a name. Raises `UsageError` for an unknown one."""
        for stage in self.stages:
            if stage.name == name:
                return stage
        names = [stage.name for stage in self.stages]
        raise UsageError(
            "no such stage in this kind of campaign",
            value=name,
            allowed=names,
            remedy=nearest(name, names),
        )

    def producers(self, schema_name: str) -> tuple[Port, ...]:
        """Return the output ports of a schema; `table` stands for all tables."""
        if schema_name == "table":
            return tuple(port for port in self.outputs if schema(port.schema).kind == "table")
        return tuple(port for port in self.outputs if port.schema == schema_name)

    def feeds(self, stage: AnyStage) -> tuple[Feed, ...]:
        """Return how each input port of a stage is fed."""
        return tuple(self._feed(stage, name, spec) for name, spec in ports(stage.inputs).items())

    def _feed(self, stage: AnyStage, name: str, spec: Mapping[str, Any]) -> Feed:
        kind, optional = spec["port"], bool(spec.get("optional"))
        if spec.get("runs"):
            return Feed(name, kind, optional, runs=True)
        if kind in MANIFEST_PORTS:
            # The logs of a twin come from the stage that simulates them.
            return Feed(
                name,
                kind,
                optional,
                self.producers(SIMULATED_LOG) if kind == "raw_log" else (),
            )
        producers = tuple(port for port in self.producers(kind) if port.stage is not stage)
        late = [
            port for port in producers if self.stages.index(port.stage) > self.stages.index(stage)
        ]
        if spec.get("every"):
            return Feed(
                name,
                kind,
                optional,
                tuple(port for port in producers if port not in late),
                every=True,
            )
        if not producers and optional:
            return Feed(name, kind, optional)
        joined = spec["many"] and all(port.keyed and port.level == ONCE for port in producers)
        if not producers or (len(producers) > 1 and not joined) or late:
            givers = ", ".join(port.stage.name for port in producers) or "none"
            raise WiringError(
                f"{stage.name}.{name} needs one earlier stage that outputs '{kind}'; there is:"
                f" {givers}"
            )
        # What belongs to the whole campaign is handed to every item, with keys as a
        # collection.
        level = producers[0].level
        if SIZE[level] > SIZE[stage.maps_over] and level != ONCE and not producers[0].keyed:
            raise WiringError(
                f"{stage.name}.{name} maps over a {stage.maps_over}, but '{kind}' belongs to a"
                f" {producers[0].level}"
            )
        return Feed(name, kind, optional, producers)

    def ancestors(self, stage: AnyStage) -> tuple[AnyStage, ...]:
        """Return the stages that a stage needs, directly or not, in running order."""
        needed = {port.stage.name for feed in self.feeds(stage) for port in feed.producers}
        for name in tuple(needed):
            needed |= {other.name for other in self.ancestors(self.stage(name))}
        return tuple(other for other in self.stages if other.name in needed)


def select(
    graph: Graph, *, only: str | None = None, until: str | None = None
) -> tuple[AnyStage, ...]:
    """Return the stages to run: one, one with all that it needs, or all."""
    if only is not None and until is not None:
        raise UsageError("--only and --until exclude each other")
    if only is not None:
        return (graph.stage(only),)
    if until is not None:
        return (*graph.ancestors(graph.stage(until)), graph.stage(until))
    return graph.stages


def stages_of_kind(
    stages: Sequence[AnyStage], kinds: Mapping[str, tuple[str, ...]], kind: str
) -> tuple[AnyStage, ...]:
    """Return the stages of a campaign kind in their order; imports no other."""
    names = names_of(stages)
    return tuple(stages[place] for place, name in enumerate(names) if name in kinds[kind])


def names_of(stages: Sequence[AnyStage]) -> tuple[str, ...]:
    """Return the names of stages; those of a `StageList` are not imported for it."""
    return stages.names if isinstance(stages, StageList) else tuple(each.name for each in stages)
