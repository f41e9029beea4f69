"""What a target makes of a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from auvid.data_schemas.records.model_file import ModelFile
from auvid.export.body import Body
from auvid.export.losses import Lost


@dataclass(frozen=True)
class Request:
    """What to export: a model as read and as arrays, a name, and lines for the head.

    head: lines that each file carries as a comment. draws: how many posterior draws.
    """

    model: ModelFile
    body: Body
    name: str
    head: tuple[str, ...]
    draws: int = 1000


@dataclass(frozen=True)
class Exported:
    """Files (name -> text) of a target, and what it loses.

    convention: axes, signs and points of the target's numbers; usage: how to use the
    files, in Markdown; notes: what cannot be held and makes no force over the envelope.
    """

    files: Mapping[str, str]
    lost: tuple[Lost, ...]
    convention: str
    usage: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Target:
    """A simulator that models are exported to.

    source: public files that its formula stands in. lacking_axes: whether it takes a model
    that lacks axes; any_unit_of_mass: one that has no newtons.
    """

    name: str
    title: str
    holds: str
    source: str
    export: Callable[[Request], Exported]
    lacking_axes: bool = False
    any_unit_of_mass: bool = False
