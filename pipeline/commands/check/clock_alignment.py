"""The offset between the clocks of two logs of one dive."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.tables import column, matrix
from auvid.hydro.identification.signals.clock_offset import ClockOffset, clock_offset
from auvid.pipeline.commands.check.log_page import LogPage
from auvid.pipeline.terminal import plain
from auvid.stages.columns import GYRO

Signal = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
MIN_RATE_HZ = 5.0
"""An angular rate sampled less often says nothing about the clock."""
MIN_CORRELATION = 0.5
MAX_STD_S = 1.0
"""Beyond it the records share a trend, as two dives of one kind do, and no moment."""
SHARED_SIGNALS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "angular rate": ("imu", GYRO),
    "depth": ("depth", ("depth_m",)),
}


@dataclass(frozen=True)
class ClockAlignment:
    """The clocks of two logs: time of `first` = time of `second` + offset."""

    first: str
    second: str
    signal: str
    offset: ClockOffset

    @property
    def document(self) -> dict[str, Any]:
        """Return the alignment as JSON."""
        names = ("offset_s", "std_s", "correlation", "overlap_s")
        return {
            "first": self.first,
            "second": self.second,
            "signal": self.signal,
            **{name: getattr(self.offset, name) for name in names},
        }

    @property
    def text(self) -> str:
        """Return the offset in one sentence."""
        offset = self.offset
        digits = 4 if offset.std_s >= 1e-4 else 6
        seconds = round(offset.offset_s, digits) + 0.0  # no minus before a zero
        std_s = max(offset.std_s, 10.0**-digits)  # not known better than it is printed
        return (
            f"clock of {plain(self.second)} {seconds:+.{digits}f} s = clock of {plain(self.first)}"
            f" (standard deviation {std_s:.{digits}f} s; {self.signal}, correlation"
            f" {offset.correlation:.2f} over {offset.overlap_s:.0f} s)"
        )


def align_clocks(first: LogPage, second: LogPage) -> ClockAlignment:
    """Estimate the clock offset from the shared signal that gives it most precisely.

    Raises `DataError` if the logs share no signal, or none that agrees.
    """
    candidates: list[ClockAlignment] = []
    reason = "no signal in common"
    for name, (stream, columns) in SHARED_SIGNALS.items():
        one, two = (_signal(page, stream, columns) for page in (first, second))
        if one is None or two is None:
            continue
        shorter = min(times[-1] - times[0] for times, _ in (one, two))
        try:
            offset = clock_offset(*one, *two, min_overlap_s=max(20.0, 0.2 * shorter))
        except DataError:
            continue
        # Whether stamps are cut or rounded to their resolution is not known, so it is
        # part of the uncertainty.
        rounding = math.hypot(_resolution_s(one[0]), _resolution_s(two[0])) / math.sqrt(12.0)
        offset = replace(offset, std_s=math.hypot(offset.std_s, rounding))
        if offset.correlation >= MIN_CORRELATION and offset.std_s <= MAX_STD_S:
            candidates.append(ClockAlignment(first.name, second.name, name, offset))
        else:
            reason = (
                f"{stream}: correlation {offset.correlation:.2f}, standard deviation"
                f" {offset.std_s:.2g} s"
            )
    if not candidates:
        raise DataError(
            "the clocks of the two logs cannot be aligned: no signal that both hold agrees at any"
            " offset",
            file=f"{first.name} and {second.name}",
            value=reason,
            allowed=(
                f"a correlation of at least {MIN_CORRELATION:g} and a standard deviation of at"
                f" most {MAX_STD_S:g} s"
            ),
            remedy="They must overlap by 20 s or more in which the vehicle turns or changes depth.",
        )
    return min(candidates, key=lambda item: item.offset.std_s)


def _signal(page: LogPage, stream: str, columns: tuple[str, ...]) -> Signal | None:
    """Return times and values of a stream if it is there and sampled often enough."""
    table = page.streams.get(stream)
    if page.health is None or table is None:
        return None
    rate_hz = page.health["streams"][stream]["rate_hz"]
    if not rate_hz or (stream == "imu" and rate_hz < MIN_RATE_HZ):
        return None
    return column(table, "time_us") / 1e6, matrix(table, columns)


def _resolution_s(times_s: npt.NDArray[np.float64]) -> float:
    """Return the step of which all times are multiples, in seconds."""
    return float(np.gcd.reduce(np.diff(np.rint(times_s * 1e6).astype(np.int64)))) / 1e6
