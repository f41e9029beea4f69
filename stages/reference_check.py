"""A number held against a reference or bounds: the verdict, and how it is printed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

ROUNDING = 1e-12
"""A number that is off by exactly its tolerance, as binary numbers have it, is met."""
CHECK_COLUMNS = ("required", "measured", "verdict", "reason")
"""Heads of `ReferenceCheck.cells`, on pages and on the terminal."""


@dataclass(frozen=True)
class Tolerance:
    """How far a number may be from its reference, in its unit; the larger counts."""

    unit: str = "1"
    reason: str = ""
    relative: float = 0.0
    absolute: float = 0.0

    def allowed(self, reference: float) -> float:
        """Return the largest distance from a reference."""
        return max(self.relative * abs(reference), self.absolute)


@dataclass(frozen=True)
class ReferenceCheck:
    """A number, or the range of several, held against a reference or bounds.

    `value` is the number or the largest of several, `least` the smallest of these.
    `status` is what a stage calls its own result (`weak`), `required_status` what it
    should be called. A miss with an `accepted_reason` is no failure.
    """

    quantity: str
    value: float | None
    unit: str = "1"
    least: float | None = None
    reference: float | None = None
    tolerance: Tolerance | None = None
    low: float | None = None
    high: float | None = None
    status: str = ""
    required_status: str = ""
    by_construction: bool = False
    accepted_reason: str = field(default="")

    @property
    def allowed(self) -> float | None:
        """The largest distance from the reference; None where there is none."""
        if self.tolerance is None or self.reference is None:
            return None
        return self.tolerance.allowed(self.reference)

    @property
    def change(self) -> float | None:
        """The value less its reference."""
        if self.value is None or self.reference is None:
            return None
        return self.value - self.reference

    @property
    def times_tolerance(self) -> float:
        """The distance from the reference in tolerances; infinite where undefined."""
        return abs(self.change) / self.allowed if self.allowed and self.change else math.inf

    @property
    def met(self) -> bool | None:
        """Whether all that is required is met; None where nothing is required."""
        parts = [met for met, *_ in self._parts()]
        return all(parts) if parts else None

    @property
    def verdict(self) -> str:
        """One of: met, missed, by construction, not judged."""
        if self.met is None:
            return "not judged"
        if not self.met:
            return "missed"
        return "by construction" if self.by_construction else "met"

    @property
    def failed(self) -> bool:
        """Whether it is missed without an accepted reason."""
        return self.verdict == "missed" and not self.accepted_reason

    @property
    def required(self) -> str:
        """What is required: `at most 0.9`, `within 3 %`; empty where nothing is."""
        return ", ".join(required for *_, required in self._parts())

    @property
    def measured(self) -> str:
        """The number, or the range from the smallest to the largest."""
        if self.value is None:
            return "no value"
        if self.least is None or self.least == self.value:
            return f"{self.value:.3g}"
        return f"{self.least:.3g} to {self.value:.3g}"

    @property
    def shortfall(self) -> str:
        """What is missed: `12, required at least 13`; empty where nothing is."""
        return "; ".join(
            f"{measured}, required {required}"
            for met, measured, required in self._parts()
            if not met
        )

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Text under `CHECK_COLUMNS`."""
        reason = self.accepted_reason if self.verdict == "missed" else ""
        return self.required, self.measured, self.verdict, reason

    @property
    def document(self) -> dict[str, Any]:
        """The check as JSON."""
        return {
            "quantity": self.quantity,
            "unit": self.unit,
            "value": self.value,
            "least": self.least,
            "reference": self.reference,
            "allowed_difference": self.allowed,
            "low": self.low,
            "high": self.high,
            "verdict": self.verdict,
            "accepted_reason": self.accepted_reason,
        }

    def _parts(self) -> Iterator[tuple[bool, str, str]]:
        """Each requirement: whether it is met, the number and the requirement in words."""
        if self.tolerance is not None:
            yield self._is_near(), *self._distance()
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.low is not None or self.high is not None:
            least = self.value if self.least is None else self.least
            inside = (
                self.value is not None
                and least is not None
                and (self.low is None or least >= self.low)
                and (self.high is None or self.value <= self.high)
            )
            if self.low is None:
                words = f"at most {self.high:g}"
            elif self.high is None:
                words = f"at least {self.low:g}"
            else:
                words = f"{self.low:g} to {self.high:g}"
            yield inside, f"{self.measured}{unit}", words
        if self.required_status:
            same = self.status == self.required_status
            yield same, f"the verdict is '{self.status}'", f"'{self.required_status}'"

    def _is_near(self) -> bool:
        if self.change is None or self.allowed is None or self.reference is None:
            return self.value is self.reference
        slack = ROUNDING * abs(self.reference) if self.allowed else 0.0
        return abs(self.change) <= self.allowed + slack

    def _distance(self) -> tuple[str, str]:
        """The distance from the reference and the tolerance, in percent or the unit."""
        tolerance = self.tolerance or Tolerance()
        if self.value is None:
            distance = f"no value ({self.status or 'no verdict'})"
        elif self.change is None:
            distance = "no reference"
        elif tolerance.relative and self.reference:
            distance = f"off by {100 * abs(self.change / self.reference):.3g} %"
        else:
            distance = f"off by {abs(self.change):.3g} {self.unit}"
        limits = [
            *([f"{100 * tolerance.relative:.3g} %"] if tolerance.relative else []),
            *([f"{tolerance.absolute:.3g} {self.unit}"] if tolerance.absolute else []),
        ]
        return distance, f"within {' or '.join(limits) or '0'}"
