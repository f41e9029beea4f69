"""Logs that hold the same samples bit for bit: copies that were cut or damaged."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from auvid.data_schemas.records.fleet import LogSurvey
from auvid.data_schemas.tables import numbers

STREAMS = ("imu", "attitude", "depth", "velocity")
"""Their noise makes each sample one of its kind; the first that a log has is taken."""
MOST_HASHES = 256
LEAST_EQUAL, LEAST_SHARE = 8, 0.5
"""Hashes that two logs share, and their share of those that they could share."""
MOST_ALIKE = 20
"""A sample that more logs have is no noise: a sensor stands still."""
NO_LIMIT = 1 << 64
FACTOR, SHIFT = np.uint64(0x9E3779B97F4A7C15), np.uint64(29)
DROPPED_BITS = np.uint64(1)


def row_hashes(streams: Mapping[str, Any]) -> list[int]:
    """Return the smallest hashes of a log's samples, time and values of each.

    Which samples those are depends on their content alone, so that a log and a piece of it
    keep the same ones.
    """
    name = next((name for name in STREAMS if name in streams), None)
    if name is None:
        return []
    mixed = np.zeros(streams[name].num_rows, dtype=np.uint64)
    for column in streams[name].columns:
        values = np.asarray(numbers(column), dtype=np.float64)
        mixed = (mixed ^ values.view(np.uint64)) * FACTOR
        mixed ^= mixed >> SHIFT
    smallest: list[int] = np.unique(mixed >> DROPPED_BITS)[:MOST_HASHES].tolist()
    return smallest


def repeated(logs: Sequence[LogSurvey]) -> Iterator[tuple[str, str, str]]:
    """Yield two logs with the same samples, and in words how many they share."""
    of_hash: dict[int, list[int]] = defaultdict(list)
    for place, log in enumerate(logs):
        for item in log.row_hashes:
            of_hash[item].append(place)
    shared = Counter(
        pair
        for places in of_hash.values()
        if len(places) <= MOST_ALIKE
        for pair in combinations(places, 2)
    )
    for (one, two), equal in sorted(shared.items()):
        hashes = logs[one].row_hashes, logs[two].row_hashes
        # Both have kept all of their hashes up to this one.
        last = min((each[-1] for each in hashes if len(each) == MOST_HASHES), default=NO_LIMIT)
        possible = min(sum(item <= last for item in each) for each in hashes)
        if equal >= LEAST_EQUAL and equal >= LEAST_SHARE * possible:
            words = f"{equal} of {possible} samples that were compared are equal bit for bit"
            yield logs[one].id, logs[two].id, words
