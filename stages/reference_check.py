"""A number held against a reference or bounds: the verdict, and how it is printed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from auvid.data_schemas.documents.published_values import Evidence
from auvid.hydro.constants import NORMAL_95
from auvid.stages.number_format import as_printed, estimate, percent, significant, with_unit

ROUNDING = 1e-12
"""A number that is off by exactly its tolerance, as binary numbers have it, is met."""
JUDGED = ("quantity", "measured", "unit", "required", "verdict", "no test", "reason")
SHOWS: dict[Evidence, str] = {
    "method": "test the method",
    "construction": "hold by construction",
    "tuned": "follow from an input chosen to match them",
    "unprinted": "have no printed value",
}
"""What bounds show where they are met, as a clause about several."""
EACH: dict[Evidence, str] = {
    "method": "tests the method",
    "construction": "holds by construction",
    "tuned": "follows from an input chosen to match it",
    "unprinted": "has no printed value",
}
"""The same of one bound."""
MOVED = (
    "quantity",
    "reference",
    "measured",
    "unit",
    "change",
    "tolerance",
    "times tolerance",
    "standard errors",
    "status",
)
"""Columns of `check_rows` for bounds, and for what a reference was left by."""


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
    should be called. A miss with an `accepted_reason` is no failure. `evidence` is what
    it shows where it is met: only `method` is a test of the method.
    """

    quantity: str
    value: float | None
    unit: str = "1"
    least: float | None = None
    reference: float | None = None
    tolerance: Tolerance | None = None
    low: float | None = None
    high: float | None = None
    standard_error: float | None = None
    reference_error: float | None = None
    status: str = ""
    required_status: str | None = None
    accepted_reason: str = ""
    evidence: Evidence = "method"
    evidence_reason: str = ""

    @property
    def allowed(self) -> float | None:
        """Return the largest distance from the reference; None where there is none."""
        if self.tolerance is None or self.reference is None:
            return None
        return self.tolerance.allowed(self.reference)

    @property
    def change(self) -> float | None:
        """Return the value less its reference."""
        if self.value is None or self.reference is None:
            return None
        return self.value - self.reference

    @property
    def relative_change(self) -> float | None:
        """The change as a share of the reference's size; None where that is zero."""
        return (
            self.change / abs(self.reference)
            if self.change is not None and self.reference
            else None
        )

    @property
    def times_tolerance(self) -> float | None:
        """Return the distance from the reference in tolerances; None without any."""
        return abs(self.change) / self.allowed if self.allowed and self.change is not None else None

    @property
    def standard_errors(self) -> float | None:
        """The change in standard errors, as if the two estimates were independent."""
        if self.change is None or self.standard_error is None or self.reference_error is None:
            return None
        spread = math.hypot(self.standard_error, self.reference_error)
        return abs(self.change) / spread if spread > 0 else None

    @property
    def met(self) -> bool | None:
        """Whether all that is required is met; None where nothing is required."""
        parts = [met for met, *_ in self._parts()]
        return all(parts) if parts else None

    @property
    def verdict(self) -> str:
        """One of: met, missed, not judged."""
        return {None: "not judged", True: "met", False: "missed"}[self.met]

    @property
    def failed(self) -> bool:
        """Return whether it is missed without an accepted reason."""
        return self.met is False and not self.accepted_reason

    @property
    def required(self) -> str:
        """What is required: `at most 0.9`, `within 3 %`; empty where nothing is."""
        return ", ".join(required for *_, required in self._parts())

    @property
    def measured(self) -> str:
        """Return the number, or the range from the smallest to the largest."""
        if self.value is None:
            return "no value"
        if self.least is None or self.least == self.value:
            return significant(self.value)
        return f"{significant(self.least)} to {significant(self.value)}"

    @property
    def shortfall(self) -> str:
        """Return what is missed: `12, required at least 13`; empty where nothing is."""
        return "; ".join(
            f"{measured}, required {required}"
            for met, measured, required in self._parts()
            if not met
        )

    @property
    def cells(self) -> dict[str, str]:
        """Text by column, on pages and on the terminal."""
        change = "" if self.change is None else significant(self.change, sign="+")
        if self.relative_change is not None:
            change += f" ({percent(self.relative_change, sign='+')})"
        return {
            "quantity": self.quantity,
            "reference": _interval(self.reference, self.reference_error),
            "measured": (
                _interval(self.value, self.standard_error) if self.tolerance else self.measured
            ),
            "unit": "" if self.unit == "1" else self.unit,
            "change": change,
            "tolerance": significant(self.allowed, empty=""),
            "times tolerance": as_printed(self.times_tolerance, places=1, empty=""),
            "standard errors": as_printed(self.standard_errors, places=1, empty=""),
            "status": " -> ".join(dict.fromkeys((self.required_status or "", self.status))),
            "required": self.required,
            "verdict": "" if self.met is None else self.verdict,
            "shows": "" if self.met is None else EACH[self.evidence],
            "no test": (
                "" if self.met is None or self.evidence == "method" else EACH[self.evidence]
            ),
            "reason": self.accepted_reason if self.met is False else "",
        }

    @property
    def document(self) -> dict[str, Any]:
        """Return the check as JSON."""
        return {
            **asdict(self),
            "allowed": self.allowed,
            "change": self.change,
            "times_tolerance": self.times_tolerance,
            "standard_errors": self.standard_errors,
            "verdict": self.verdict,
        }

    def _parts(self) -> Iterator[tuple[bool, str, str]]:
        """Return each requirement: whether it is met, the number, and its text."""
        if self.tolerance is not None:
            yield self._is_near(), *self._distance()
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
            yield inside, with_unit(self.measured, self.unit), words
        if self.required_status is not None:
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
        elif tolerance.relative and self.relative_change is not None:
            distance = f"off by {percent(abs(self.relative_change))}"
        else:
            distance = f"off by {with_unit(significant(abs(self.change)), self.unit)}"
        limits = [
            *([percent(tolerance.relative)] if tolerance.relative else []),
            *(
                [with_unit(significant(tolerance.absolute), self.unit)]
                if tolerance.absolute
                else []
            ),
        ]
        return distance, f"within {' or '.join(limits) or '0'}"


def _interval(value: float | None, error: float | None) -> str:
    """Return a number to six digits, or as its 95 % interval has it."""
    if error is None:
        return significant(value, 6, empty="undefined")
    return estimate(value, NORMAL_95 * error, empty="undefined")


def check_rows(
    labels: Sequence[str],
    checks: Sequence[tuple[Sequence[object], ReferenceCheck]],
    columns: Sequence[str],
) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of checks, each after its labels, on page and terminal.

    Columns that are empty in every row are left out.
    """
    rows = [
        [*map(str, of), *(cells[name] for name in columns)]
        for of, check in checks
        for cells in [check.cells]
    ]
    used = [index for index in range(len(labels) + len(columns)) if any(row[index] for row in rows)]
    heads = [*labels, *columns]
    return [heads[index] for index in used], [[row[index] for index in used] for row in rows]


def count_met(checks: Sequence[ReferenceCheck]) -> str:
    """Return how many of the bounds that are judged are met: `11 of 12`."""
    judged = [check.met for check in checks if check.met is not None]
    return f"{sum(judged)} of {len(judged)}"


def count_bounds(checks: Sequence[ReferenceCheck]) -> str:
    """Return how many bounds are judged and met, by what meeting them shows.

    `14 of 73 test the method (14 met), 59 hold by construction (59 met)`; `14 of 14
    met` where all of them test it.
    """
    judged = [check for check in checks if check.met is not None]
    own = {kind: [check for check in judged if check.evidence == kind] for kind in SHOWS}
    if len(own["method"]) == len(judged):
        return f"{count_met(judged)} met"
    parts = [
        f"{len(part)}{'' if kind != 'method' else f' of {len(judged)}'}"
        f" {(EACH if len(part) == 1 else SHOWS)[kind]}"
        f" ({sum(bool(check.met) for check in part)} met)"
        for kind, part in own.items()
        if part or kind == "method"
    ]
    return ", ".join(parts)
