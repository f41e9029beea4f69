"""First screen of a page as values: verdict, facts, model scores, findings, figures."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from auvid.data_schemas.documents.published_values import PRINTED_VALUES
from auvid.data_schemas.records.models import MeritRecord

ALL = "all"
AXIS_WORDS = {"X": "surge", "Y": "sway", "Z": "heave", "K": "roll", "M": "pitch", "N": "yaw"}
Level = Literal["good", "fair", "poor"]


NO_VALIDATION_LEG = (
    "There is no validation leg: nothing says how far these models hold outside the data they"
    " were fitted on. Give one leg `use: validation`."
)
MOST_LETTERS = 100
"""An alert longer than this is cut at the end of a clause."""
LEAST_LETTERS = 36


def anchor(*names: str) -> str:
    """Return an id for a link: plain ASCII words joined by dashes.

    Other characters are given by their code, so that two names never meet.
    """
    return (
        "-".join(
            "".join(c if c.isascii() and c.isalnum() else f"_{ord(c):x}" for c in name)
            for name in names
            if name
        )
        or "section"
    )


class Alert(str):
    """A sentence to be read before the answer is used.

    `place`: anchor of where the page says more; `level`: poor for what may make the
    answer wrong, good for what is only to be known. `misleads`: coefficients follow what
    it says, so it stands under the verdict.
    """

    place: str
    level: Level
    misleads: bool

    def __new__(
        cls, words: str, place: str = "", level: Level = "fair", *, misleads: bool = False
    ) -> Alert:
        alert = super().__new__(cls, words)
        alert.place, alert.level, alert.misleads = place, level, misleads
        return alert

    @property
    def brief(self) -> str:
        """Return its first clauses, without what stands in brackets, on one line.

        >>> Alert("The arm of the log departs by +0.23 m (of 0): " + 30 * "see ").brief
        'The arm of the log departs by +0.23 m'
        >>> Alert("rov: dive 00000001.BIN departs in sensor: lag by 7; other: " + 30 * "a ").brief
        'rov: dive 00000001.BIN departs in sensor: lag by 7'
        """
        words = self.replace("+-", "±").strip()
        if len(words) > MOST_LETTERS:
            words = re.sub(r" \([^)]*\)", "", words)
        for mark in (". ", "; ", ": "):
            end = words.find(mark, LEAST_LETTERS)
            if len(words) > MOST_LETTERS and 0 < end <= MOST_LETTERS:
                words = words[:end]
        return words.rstrip(".")


@dataclass(frozen=True)
class CoefficientRow:
    """A row of the table of coefficients of the recommended model, as printed.

    `name` as `X_u`, `meaning` as `surge damping`; `value`, `low` and `high` (95 %) in
    `unit`, None where the data determine none; `noise` and `assumed`: half of the
    interval by noise alone and by assumed figures of the vehicle alone; `published`:
    values of others under that name, `sources`: whose they are.
    """

    name: str
    meaning: str
    unit: str
    verdict: str
    value: float | None = None
    low: float | None = None
    high: float | None = None
    printed: str = "–"
    interval: str = ""
    noise: str = ""
    assumed: str = ""
    published: str = ""
    sources: str = ""


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
    missing: tuple[Alert, ...]
    warnings: tuple[Alert, ...]
    figures: tuple[Figure, ...] = ()
    bounds: tuple[str, ...] = ()
    bounds_on: str = PRINTED_VALUES
    uses: tuple[Use, ...] = ()
    rule: str = ""
    log_findings: tuple[Alert, ...] = ()
    horizon_s: float | None = None
    legs_left_out: int = 0
    coefficients: tuple[CoefficientRow, ...] = ()
    assumed_most: str = ""
    """The assumed figure that moves the most coefficients most."""
    counted_in: str = ""
    """The inertia that all coefficients are divided by; empty where they are in newtons."""
    reference: Mapping[str, float] = field(default_factory=dict)
    """Axis or all -> J/J0 of the mean force of the training legs alone."""

    @property
    def alerts(self) -> tuple[Alert, ...]:
        """Return all sentences to be read before the answer is used, worst first."""
        order = ("poor", "fair", "good")
        every = (*self.log_findings, *self.missing, *self.further_warnings)
        worst = sorted(every, key=lambda alert: order.index(alert.level))
        return tuple(dict.fromkeys(worst))

    @property
    def further_warnings(self) -> tuple[Alert, ...]:
        """Return the warnings that no finding of the logs says already."""
        return tuple(
            words
            for words in self.warnings
            if not any(item.startswith(words.rstrip(".")) for item in self.log_findings)
        )

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
