"""First screen of a page as values: verdict, facts, model scores, findings, figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

AXIS_WORDS = {"X": "surge", "Y": "sway", "Z": "heave", "K": "roll", "M": "pitch", "N": "yaw"}
Level = Literal["good", "fair", "poor"]


@dataclass(frozen=True)
class CoefficientLine:
    """One line: its subject (`surge damping`), the figures, and a remark on them."""

    label: str
    figures: tuple[str, ...]
    note: str = ""


@dataclass(frozen=True)
class Score:
    """Errors of one model on one axis ("all" for the total).

    J/J0 on validation and on training, None where there is none.
    """

    axis: str
    validation: float | None
    training: float | None


@dataclass(frozen=True)
class ModelScore:
    """One row of the model table.

    `j` is J on the validation legs, in N and N m mixed, as McCarter (4.25) has it.
    """

    name: str
    title: str
    terms: int
    rank: int
    j: float | None
    scores: tuple[Score, ...]

    @property
    def total(self) -> Score:
        return self.scores[0]


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
    models: tuple[ModelScore, ...]
    identified: tuple[CoefficientLine, ...]
    missing: tuple[str, ...]
    warnings: tuple[str, ...]
    figures: tuple[Figure, ...] = ()
    bounds: tuple[str, ...] = ()
