"""Named faults in the samples of a stream: what must stay, and what is rejected and
counted.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import STREAMS
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog
from auvid.stages.ingest.rejection import (
    BACKWARD,
    BEFORE_LEAP,
    EMPTY,
    IMPOSSIBLE,
    NO_TIME,
    POSSIBLE,
    REPEATED,
    clock_set,
    increasing,
    possible_rows,
    reject_samples,
    usual_time,
)
from auvid.stages.ingest.streams.mapping import Stream

COUNT = 100


def depth_stream(**columns: Any) -> Stream:
    values = {
        "time_us": np.arange(COUNT, dtype=np.int64) * 100_000,
        "depth_m": np.linspace(1.0, 2.0, COUNT),
    }
    return Stream("depth", {**values, **columns}, np.arange(COUNT, dtype=np.int64) * 50, "BARO")


def stamps(**changes: int) -> np.ndarray[Any, Any]:
    time_us = np.arange(COUNT, dtype=np.int64) * 100_000
    for place, value in changes.items():
        time_us[int(place.removeprefix("at"))] = value
    return time_us


def test_healthy_stream_is_left_alone() -> None:
    stream = depth_stream()
    kept, rejected = reject_samples(stream)
    assert kept is stream
    assert rejected == []


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_gyro_dropout(bad: float) -> None:
    """GYRO_DROPOUT: cells without a number are rejected, with the place of the first
    and the last.
    """
    values = np.linspace(1.0, 2.0, COUNT)
    values[[3, 50, 60]] = bad
    kept, rejected = reject_samples(depth_stream(depth_m=values))
    assert len(kept) == COUNT - 3
    assert [(item.reason, item.count, item.first, item.last) for item in rejected] == [
        (EMPTY, 3, 150, 3000)
    ]


def test_dvl_spike() -> None:
    """DVL_SPIKE: a value that no vehicle reaches, as damaged records have, is rejected;
    a wrong but possible one is not seen here.
    """
    values = np.linspace(1.0, 2.0, COUNT)
    values[[3, 4]] = [1e30, 25.0]
    kept, rejected = reject_samples(depth_stream(depth_m=values))
    assert [(item.reason, item.count) for item in rejected] == [(IMPOSSIBLE, 1)]
    assert 25.0 in kept.columns["depth_m"]


def test_clock_stuck() -> None:
    """CLOCK_STUCK: of samples with one time stamp the first is kept."""
    kept, rejected = reject_samples(depth_stream(time_us=stamps(at11=1_000_000, at12=1_000_000)))
    assert [(item.reason, item.count, item.first, item.last) for item in rejected] == [
        (REPEATED, 2, 550, 600)
    ]
    assert kept.place.tolist()[10:12] == [500, 650]


@pytest.mark.parametrize(("where", "value"), [(40, 10**15), (40, 0), (0, 10**12), (99, 5)])
def test_clock_jump_of_one_sample(where: int, value: int) -> None:
    """CLOCK_JUMP: one wrong time stamp costs one sample, ahead or behind."""
    kept, rejected = reject_samples(depth_stream(time_us=stamps(**{f"at{where}": value})))
    assert [(item.reason, item.count, item.first) for item in rejected] == [
        (BACKWARD, 1, where * 50)
    ]
    assert len(kept) == COUNT - 1


@pytest.mark.parametrize("where", [0, 99])
@pytest.mark.parametrize("value", [2**62, -(2**62), 2**55])
def test_destroyed_stamp_at_an_end_of_a_stream(where: int, value: int) -> None:
    """CLOCK_JUMP: the last stamp, its top bits changed, is not the end of the dive."""
    kept, rejected = reject_samples(depth_stream(time_us=stamps(**{f"at{where}": value})))
    assert [(item.reason, item.count, item.first) for item in rejected] == [
        (BACKWARD, 1, where * 50)
    ]
    assert np.ptp(kept.columns["time_us"]) < 1e7


def test_destroyed_stamps_that_their_stream_alone_does_not_tell() -> None:
    """CLOCK_JUMP: the only stamp of a stream is judged by the others of the log, and the
    last one of the longest stream sets no clock.
    """
    usual_us = usual_time([stamps(), np.array([2**61])], set_us=None)
    lone = depth_stream(time_us=stamps(at7=2**61)).rows(np.arange(COUNT) == 7)
    kept, rejected = reject_samples(lone, usual_us=usual_us)
    assert (len(kept), [item.reason for item in rejected]) == (0, [BACKWARD])
    assert clock_set([stamps(at99=2**61), stamps()[:50]]) is None
    late_us = stamps() + 2**55 * (np.arange(COUNT) >= 40)
    assert clock_set([late_us]) == late_us[40]
    assert usual_time([late_us, stamps()], set_us=int(late_us[40])) == np.median(late_us[40:])


def test_a_clock_that_leaps_for_half_of_a_stream_is_not_judged_by_one_stream() -> None:
    time_us = np.arange(COUNT, dtype=np.int64) * 100_000
    time_us[50:] += 2**55
    assert reject_samples(depth_stream(time_us=time_us))[1] == []


def test_restart_keeps_the_longer_part() -> None:
    """RESTART: the clock starts again; the longer of the two recordings stays."""
    time_us = np.concatenate([np.arange(30), np.arange(70)]) * 100_000
    kept, rejected = reject_samples(depth_stream(time_us=time_us))
    assert len(kept) >= 70
    assert (np.diff(kept.columns["time_us"]) > 0).all()
    assert sum(item.count for item in rejected) == COUNT - len(kept)


def test_clock_set_during_the_log() -> None:
    """CLOCK_SET: what was logged before the clock leapt to Unix time is rejected, and
    the note says so.
    """
    text = "t,d\n" + "".join(
        f"{stamp},1\n" for stamp in [0, 1, 2, *range(1_700_000_000, 1_700_000_050)]
    )
    mapping = {
        "time": {"column": "t", "unit": "s"},
        "columns": [{"column": "d", "stream": "depth", "field": "depth_m", "unit": "m"}],
    }
    log = RawLog("dive", (RawFile("d.csv", np.frombuffer(text.encode(), np.uint8), mapping),))
    outputs = ingest.run(ingest.Inputs(log), ingest.Params())
    assert [
        (row["reason"], row["count"], row["first"], row["last"])
        for row in outputs.dropped.to_pylist()
    ] == [(BEFORE_LEAP, 3, 2, 4)]
    assert outputs.log_info.start_us == 1_700_000_000_000_000
    assert any("was set" in note for note in outputs.log_info.notes)


@pytest.mark.parametrize("column", sorted(POSSIBLE))
def test_values_beyond_either_limit_are_impossible(column: str) -> None:
    """IMPOSSIBLE: the value just below the lower limit goes, as does that above the upper."""
    low, high = POSSIBLE[column]
    named = [
        (stream, name)
        for stream in STREAMS
        for name in schema(stream).columns
        if name.startswith(column) and schema(stream).columns[name].range is None
    ]
    assert named, "no stream has a column of this name"
    for stream, name in named:
        values = np.array([low - 1e-6 * abs(low) - 1e-6, low, high, high + 1e-6 * high])
        columns = {"time_us": np.arange(4) * 1000, name: values}
        assert possible_rows(stream, columns).tolist() == [False, True, True, False], name


def test_rows_without_a_time() -> None:
    """NO_TIME: a CSV row without a time stamp is rejected."""
    kept, rejected = reject_samples(
        depth_stream(time_us=np.where(np.arange(COUNT) == 7, np.nan, np.arange(COUNT) * 1e5))
    )
    assert [(item.reason, item.count, item.first) for item in rejected] == [(NO_TIME, 1, 350)]
    assert kept.columns["time_us"].dtype == np.int64


def test_too_many_bad_samples_refuse_the_log() -> None:
    text = "t,d,h\n" + "".join(f"{stamp},{'' if stamp % 3 else 1},1\n" for stamp in range(30))
    columns = [
        {"column": "d", "stream": "velocity", "field": f"{axis}_m_s", "unit": "m/s"}
        for axis in "uv"
    ]
    columns += [{"column": "h", "stream": "velocity", "field": "w_m_s", "unit": "m/s"}]
    log = RawLog(
        "dive",
        (
            RawFile(
                "d.csv",
                np.frombuffer(text.encode(), np.uint8),
                {"time": {"column": "t", "unit": "s"}, "columns": columns},
            ),
        ),
    )
    with pytest.raises(
        DataError, match=r"20 of 30 samples of stream 'velocity'.*velocity: none.*max_dropped_share"
    ):
        ingest.run(ingest.Inputs(log), ingest.Params())
    outputs = ingest.run(ingest.Inputs(log), ingest.Params(max_dropped_share=0.7))
    assert outputs.velocity is not None
    assert outputs.velocity.num_rows == 10
    assert outputs.log_info.streams["velocity"].rejected == 20


@settings(max_examples=200, deadline=None)
@given(st.lists(st.integers(-50, 50), max_size=40))
def test_kept_time_stamps_increase_and_none_could_be_added_in_greater_number(
    values: list[int],
) -> None:
    kept = increasing(np.array(values, np.int64))
    chosen = [value for value, keep in zip(values, kept, strict=True) if keep]
    assert all(first < second for first, second in pairwise(chosen))
    assert len(chosen) == longest_increasing(values)


def longest_increasing(values: list[int]) -> int:
    best = [1] * len(values)
    for index, value in enumerate(values):
        best[index] = 1 + max(
            (best[before] for before in range(index) if values[before] < value), default=0
        )
    return max(best, default=0)
