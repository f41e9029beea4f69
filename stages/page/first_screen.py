"""First screen of a page as values: verdict, facts, model scores, findings, figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from auvid.data_schemas.records.models import MeritRecord

ALL = "all"
AXIS_WORDS = {"X": "surge", "Y": "sway", "Z": "heave", "K": "roll", "M": "pitch", "N": "yaw"}
Level = Literal["good", "fair", "poor"]


@dataclass(frozen=True)
class CoefficientLine:
    """One line: its subject (`surge damping`), the figures, and a remark on them."""

    label: str
    figures: tuple[str, ...]
    note: str = ""


@dataclass(frozen=True)
class Use:
    """One use of the recommended model: the axes it is good for, and the reason."""

    label: str
    axes: str
    reason: str


@dataclass(frozen=True)
class Fact:
    """A figure with its label and what it is made of."""

    label: str
    value: str
    note: str


@dataclass(frozen=True)
class Figure:
    """One named figure of a bench or control stage, as the first screen shows it."""

    part: str
    quantity: str
    value: str
    interval: str
    verdict: str
    note: str


@dataclass(frozen=True)
class Summary:
    """Content of the first screen.

    `models` is sorted best first; `recommended` is the name of the recommended model, or None.
    """

    level: Level
    headline: str
    explanation: str
    recommended: str | None
    judged_on: str
    facts: tuple[Fact, ...]
    models: tuple[MeritRecord, ...]
    identified: tuple[CoefficientLine, ...]
    missing: tuple[str, ...]
    warnings: tuple[str, ...]
    figures: tuple[Figure, ...] = ()
    bounds: tuple[str, ...] = ()
    uses: tuple[Use, ...] = ()
    rule: str = ""
    log_findings: tuple[str, ...] = ()
    horizon_s: float | None = None
    legs_left_out: int = 0

    @property
    def leading(self) -> tuple[MeritRecord, ...]:
        """Return the models that are no forms of the thesis, and the recommended one.

        All of them where there are no others.
        """
        own = [m for m in self.models if not m.published or m.name == self.recommended]
        return tuple(own) if any(not m.published for m in own) else self.models

    @property
    def folded(self) -> tuple[MeritRecord, ...]:
        """Return the forms of the thesis beside them."""
        return tuple(m for m in self.models if m not in self.leading)
