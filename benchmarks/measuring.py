"""What the benchmarks of readers share: the shortest of several times, and the size of
decoded columns.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.stages.ingest.decoded_log import DecodedLog

RUNS = 7


def best(*runs: Callable[[], object]) -> list[float]:
    """The shortest time of each, seconds; they take turns, so that a busy machine slows
    all of them alike.
    """
    times: list[list[float]] = [[] for _ in runs]
    for _ in range(RUNS):
        for run, seconds in zip(runs, times, strict=True):
            begin = time.perf_counter()
            run()
            seconds.append(time.perf_counter() - begin)
    return [min(seconds) for seconds in times]


def columns_of(messages: Iterable[Any]) -> dict[str, dict[str, npt.NDArray[np.generic]]]:
    """Return pymavlink's messages as arrays by message type and field."""
    lists: dict[str, dict[str, list[object]]] = defaultdict(lambda: defaultdict(list))
    for message in messages:
        columns = lists[message.get_type()]
        for field in message.get_fieldnames():
            columns[field].append(getattr(message, field))
    return {
        name: {field: np.asarray(values) for field, values in columns.items()}
        for name, columns in lists.items()
    }


def columns_bytes(log: DecodedLog) -> int:
    """Bytes of all decoded columns."""
    return sum(
        column.nbytes
        for table in log.messages.values()
        for column in (*table.columns.values(), table.offset)
    )
