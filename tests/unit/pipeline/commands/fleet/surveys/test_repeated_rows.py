"""Copies of logs that were cut or damaged hold the same samples; other dives do not."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.fleet import LogSurvey
from auvid.pipeline.commands.fleet.surveys.repeated_rows import MOST_HASHES, repeated, row_hashes
from auvid.pipeline.commands.fleet.surveys.same_dives import same_dives

ROWS = 4000


def samples(seed: int) -> pa.Table:
    """Return samples on one clock, as two logs of one recorder type may have it."""
    gyro = np.random.default_rng(seed).normal(size=ROWS).round(4)
    return pa.table({"time_us": np.arange(ROWS) * 20_000, "gyro_x_rad_s": gyro})


def log(name: str, table: pa.Table, start: str | None = None) -> LogSurvey:
    return LogSurvey(
        key=name,
        id=name,
        files=[name],
        hash=name,
        reason="",
        formats=["DataFlash"],
        start_utc=start,
        rows=table.num_rows,
        row_hashes=row_hashes({"imu": table}),
    )


def test_a_cut_copy_and_a_damaged_one_are_of_the_dive_of_the_whole_log() -> None:
    original = samples(1)
    damaged = pa.concat_tables([original.slice(0, 1500), original.slice(2200)])
    logs = [
        log("cut", original.slice(0, ROWS // 10)),
        log("damaged", damaged),
        log("other", samples(2)),
        log("whole", original, start="2026-01-07T10:00:00Z"),
    ]
    pairs = {pair.other: pair for pair in same_dives(logs)}
    assert sorted(pairs) == ["cut", "damaged"]
    assert "equal bit for bit" in pairs["damaged"].words
    assert pairs["damaged"].better == "whole"


def test_logs_that_share_a_few_samples_are_two() -> None:
    first, second = samples(1), samples(2)
    joined = pa.concat_tables([first.slice(0, ROWS // 4), second.slice(ROWS // 4)])
    assert not list(repeated([log("first", first), log("joined", joined)]))
    assert len(list(repeated([log("second", second), log("joined", joined)]))) == 1


def test_few_hashes_are_kept_of_a_long_log_and_none_where_nothing_is_noise() -> None:
    assert len(row_hashes({"imu": samples(1)})) == MOST_HASHES
    assert row_hashes({"mode": samples(1)}) == []
