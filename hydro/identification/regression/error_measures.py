"""Error measures of a force model: McCarter 2014 (4.22)-(4.27).

Sums over segments merge. The medians of (4.27) are exact and need no more memory than a
few samples of each segment, but a second pass over them: a first one brackets the
middle of all absolute errors, a second collects what lies within the bracket.

The force error is tau_tilde = K xi - tau_bar, predicted minus measured (4.11). The
totals mix N and N m, as the thesis has them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, Array

TOTAL = "total"
SKETCH = 128  # entries kept of each segment to bracket the medians


@dataclass(frozen=True)
class ErrorMeasures:
    """SSE, MAE, MSE, RMS, MAD and J0 of a force over `n` samples.

    SSE (4.22), MAE (4.23), MSE (4.24), RMS (4.25), MAD (4.27) and J0, the RMS of the
    measured force.

    Units: SSE and MSE in N^2 (or (N m)^2), the others in N (N m). In the total all six
    axes are counted together.
    """

    sse: float
    mae: float
    mse: float
    rms: float
    mad: float
    j0: float
    n: int

    @property
    def normalised(self) -> float:
        """J / J0, the last column of McCarter's Tables 5.1 and 5.2.

        nan without a measured force.
        """
        return self.rms / self.j0 if self.j0 > 0 else float("nan")


@dataclass(frozen=True)
class ErrorSums:
    """Sums over `n` samples, per axis (6,): e^2, |e|, and tau_bar^2 of the force.

    `sketches`: of each segment every so-manieth absolute error in order of size (k, 6),
    and how many samples each of them stands for.
    """

    n: int
    square: Array
    absolute: Array
    force_square: Array
    sketches: tuple[tuple[Array, int], ...]

    @classmethod
    def of(cls, measured: ArrayLike, predicted: ArrayLike) -> ErrorSums:
        """Return the sums of one segment: forces tau_bar and K xi, each (n, 6).

        Raises `DataError` for an empty series, values that are not finite, or shapes
        that differ.
        """
        force, error = _checked(measured, predicted)
        size = np.sort(np.abs(error), axis=0)
        step = max(1, len(size) // SKETCH)
        return cls(
            len(size),
            np.sum(error**2, axis=0),
            np.sum(size, axis=0),
            np.sum(force**2, axis=0),
            ((size[::step].copy(), step),),
        )

    def merge(self, other: ErrorSums) -> ErrorSums:
        """Return the sums over the samples of both."""
        return ErrorSums(
            self.n + other.n,
            self.square + other.square,
            self.absolute + other.absolute,
            self.force_square + other.force_square,
            self.sketches + other.sketches,
        )

    def bracket(self) -> tuple[Array, Array]:
        """Return two bounds (6,) with the middle of all absolute errors between them.

        With m entries of a segment's sketch below v, between (m - 1) step + 1 and
        m step of its samples are.
        """
        values = np.concatenate([part for part, _ in self.sketches])
        steps = np.concatenate([np.full(len(part), step) for part, step in self.sketches])
        order = np.argsort(values, axis=0)
        values = np.take_along_axis(values, order, axis=0)
        most = np.cumsum(steps[order], axis=0)  # samples up to each entry, at most
        least = most - sum(step for _, step in self.sketches)
        first = np.sum(most - steps[order] <= (self.n - 1) // 2, axis=0) - 1
        last = np.sum(least <= self.n // 2, axis=0)
        low = np.take_along_axis(values, first[None], axis=0)[0]
        high = np.take_along_axis(values, np.minimum(last, len(values) - 1)[None], axis=0)[0]
        return low, np.where(last < len(values), high, np.inf)

    def measures(self, medians: Array) -> dict[str, ErrorMeasures]:
        """Return `total` and the six axes, given the medians (6,) of |e|.

        The total's MAD is the sum of the six medians (4.27).
        """
        table = {}
        for name, axes in {TOTAL: list(range(6)), **{a: [i] for i, a in enumerate(AXES)}}.items():
            size = self.n * len(axes)
            sse = float(np.sum(self.square[axes]))
            table[name] = ErrorMeasures(
                sse=sse,
                mae=float(np.sum(self.absolute[axes])) / size,
                mse=sse / size,
                rms=float(np.sqrt(sse / size)),
                mad=float(np.sum(medians[axes])),
                j0=float(np.sqrt(np.sum(self.force_square[axes]) / size)),
                n=self.n,
            )
        return table


@dataclass(frozen=True)
class MiddleErrors:
    """The absolute errors within a bracket (6,), and how many lie below it, by axis."""

    low: Array
    high: Array
    below: Array
    inside: tuple[tuple[Array, ...], ...] = ((),) * 6

    @classmethod
    def between(cls, low: Array, high: Array) -> MiddleErrors:
        """Return those of no samples."""
        return cls(low, high, np.zeros(6))

    def add(self, measured: ArrayLike, predicted: ArrayLike) -> MiddleErrors:
        """Return the sums with one more segment; arguments as of `ErrorSums.of`."""
        size = np.abs(_checked(measured, predicted)[1])
        chosen = (size >= self.low) & (size <= self.high)
        inside = tuple(
            (*parts, size[chosen[:, axis], axis]) for axis, parts in enumerate(self.inside)
        )
        below = self.below + np.sum(size < self.low, axis=0)
        return MiddleErrors(self.low, self.high, below, inside)

    def medians(self, n: int) -> Array:
        """Return the medians (6,) of all n absolute errors of each axis."""
        middle = [(n - 1) // 2, n // 2]
        return np.array(
            [
                np.mean(np.sort(np.concatenate(parts))[[at - int(below) for at in middle]])
                for parts, below in zip(self.inside, self.below, strict=True)
            ]
        )


def error_table(measured: ArrayLike, predicted: ArrayLike) -> dict[str, ErrorMeasures]:
    """Return `total` and the six axes of one segment. Arguments as `ErrorSums.of`."""
    sums = ErrorSums.of(measured, predicted)
    middle = MiddleErrors.between(*sums.bracket()).add(measured, predicted)
    return sums.measures(middle.medians(sums.n))


def _checked(measured: ArrayLike, predicted: ArrayLike) -> tuple[Array, Array]:
    force, model = np.asarray(measured, dtype=np.float64), np.asarray(predicted, dtype=np.float64)
    if force.shape != model.shape or force.ndim != 2 or force.shape[1] != 6:
        raise DataError(
            "measured and predicted forces must both be (n, 6)", value=(force.shape, model.shape)
        )
    if not len(force):
        raise DataError("no sample to judge a model on")
    if not (np.isfinite(force).all() and np.isfinite(model).all()):
        raise DataError("a force is not finite, so the errors of the model are not defined")
    return force, model - force
