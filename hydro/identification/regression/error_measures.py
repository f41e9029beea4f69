"""Error measures of a force model: McCarter 2014 (4.22)-(4.27).

The force error is tau_tilde = K xi - tau_bar, predicted minus measured (4.11). The
totals mix N and N m, as the thesis has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, Array

TOTAL = "total"


@dataclass(frozen=True)
class ErrorMeasures:
    """SSE (4.22), MAE (4.23), MSE (4.24), RMS (4.25), MAD (4.27) and J0, the RMS of the
    measured force, over `n` samples.

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
        """J / J0, the last column of McCarter's Tables 5.1 and 5.2; nan without a
        measured force.
        """
        return self.rms / self.j0 if self.j0 > 0 else float("nan")


def total_errors(measured: ArrayLike, predicted: ArrayLike) -> ErrorMeasures:
    """The measures over all six axes: forces tau_bar and K xi, each (n, 6). MAD is the
    sum of the six medians (4.27).

    Raises `DataError` for an empty series, values that are not finite, or shapes that
    differ.
    """
    force, error = _checked(measured, predicted)
    return _measures(force, error)


def axis_errors(measured: ArrayLike, predicted: ArrayLike) -> dict[str, ErrorMeasures]:
    """The measures of each axis X Y Z K M N by itself; J0 is that axis's own. Arguments
    and errors as `total_errors`.
    """
    force, error = _checked(measured, predicted)
    return {axis: _measures(force[:, [i]], error[:, [i]]) for i, axis in enumerate(AXES)}


def error_table(measured: ArrayLike, predicted: ArrayLike) -> dict[str, ErrorMeasures]:
    """`total` and the six axes. Arguments and errors as `total_errors`."""
    return {TOTAL: total_errors(measured, predicted), **axis_errors(measured, predicted)}


@dataclass(frozen=True)
class ErrorAccumulator:
    """Measured and predicted forces of several segments, to be judged together.

    The medians of MAD need every error, so the parts are kept (96 bytes a sample); the
    order of the parts does not matter.
    """

    parts: tuple[tuple[Array, Array], ...] = field(default=())

    def add(self, measured: ArrayLike, predicted: ArrayLike) -> ErrorAccumulator:
        """With one more segment, each (n, 6). Errors as `total_errors`."""
        force, error = _checked(measured, predicted)
        return ErrorAccumulator((*self.parts, (force, force + error)))

    def merge(self, other: ErrorAccumulator) -> ErrorAccumulator:
        """With the segments of another one."""
        return ErrorAccumulator(self.parts + other.parts)

    def table(self) -> Mapping[str, ErrorMeasures]:
        """`error_table` of all segments together; `DataError` when there is none."""
        if not self.parts:
            raise DataError("no segment to judge a model on")
        measured, predicted = (np.concatenate(series) for series in zip(*self.parts, strict=True))
        return error_table(measured, predicted)


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


def _measures(force: Array, error: Array) -> ErrorMeasures:
    sse = float(np.sum(error**2))
    mse = sse / error.size
    return ErrorMeasures(
        sse=sse,
        mae=float(np.mean(np.abs(error))),
        mse=mse,
        rms=float(np.sqrt(mse)),
        mad=float(np.sum(np.median(np.abs(error), axis=0))),
        j0=float(np.sqrt(np.mean(force**2))),
        n=len(error),
    )
