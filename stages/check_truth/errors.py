"""Sums of errors against the truth, per segment, per use and over all legs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from auvid.hydro.arrays import Array

ALL = "all"
Key = tuple[str, str, str, str, str]
"""Use, segment, quantity, axis, unit."""


@dataclass(frozen=True)
class Error:
    """Errors of one component, estimate minus truth.

    Samples, RMS of the truth; RMS, mean and largest magnitude of the error.
    """

    n: int
    rms_true: float
    rms: float
    mean: float
    largest: float


@dataclass(frozen=True)
class Errors:
    """All errors by use, segment, quantity, axis and unit."""

    by_key: dict[Key, Error]

    def over_legs(self, quantity: str, *, use: str = ALL) -> dict[str, Error]:
        """Return errors of a quantity over all legs of a use, by axis.

        Use `all`: of every leg; empty where it was not measured.
        """
        return {
            axis: error
            for (used, segment, name, axis, _), error in self.by_key.items()
            if (used, segment, name) == (use, ALL, quantity)
        }

    def total(self, quantity: str) -> float | None:
        """Return the RMS over components and legs, None where it was not measured."""
        parts = self.over_legs(quantity)
        return (
            float(np.sqrt(np.mean([error.rms**2 for error in parts.values()]))) if parts else None
        )

    def units(self) -> dict[tuple[str, str], str]:
        """Unit by quantity and axis, in the order in which they came."""
        return {(quantity, axis): unit for _, _, quantity, axis, unit in self.by_key}

    def columns(self) -> dict[str, list[object]]:
        """Return the columns of schema `truth_errors`, totals first."""
        keys = sorted(self.by_key, key=lambda key: (key[0] != ALL, key[1] != ALL))
        heads = ("use", "segment", "quantity", "axis", "unit")
        table: dict[str, list[object]] = {
            name: [key[index] for key in keys] for index, name in enumerate(heads)
        }
        errors = [self.by_key[key] for key in keys]
        table |= {
            "samples": [error.n for error in errors],
            "rms_true": [error.rms_true for error in errors],
        }
        table |= {
            "rms_error": [error.rms for error in errors],
            "largest_error": [error.largest for error in errors],
        }
        table["mean_error"] = [
            None if key[3] == ALL else error.mean for key, error in zip(keys, errors, strict=True)
        ]
        return table


@dataclass
class Sums:
    """Sums over samples, by key.

    n, sum of error, of its square, its largest magnitude, and sum of the true value's
    square.
    """

    sums: dict[Key, Array] = field(default_factory=dict)

    def add(
        self,
        place: tuple[str, str],
        quantity: str,
        axes: Sequence[str],
        unit: str,
        estimate: Array,
        true: Array,
    ) -> None:
        """Add samples (n, k) of a quantity with k axes; `place` is use and segment."""
        error = estimate - true
        for index, axis in enumerate(axes):
            part, truth = error[:, index], true[:, index]
            new = np.array([len(part), part.sum(), part @ part, np.abs(part).max(), truth @ truth])
            for use, segment in _places(place):
                key = (use, segment, quantity, axis, unit)
                old = self.sums.get(key, np.zeros(5))
                largest = max(old[3], new[3])
                self.sums[key] = old + new
                self.sums[key][3] = largest

    def errors(self) -> Errors:
        """Return the errors of all that was added."""
        by_key = {}
        for key, (n, total, square, largest, true_square) in self.sums.items():
            by_key[key] = Error(
                int(n),
                float(np.sqrt(true_square / n)),
                float(np.sqrt(square / n)),
                float(total / n),
                float(largest),
            )
        return Errors(by_key)


def _places(place: tuple[str, str]) -> Iterator[tuple[str, str]]:
    use, _ = place
    yield place
    yield use, ALL
    yield ALL, ALL
