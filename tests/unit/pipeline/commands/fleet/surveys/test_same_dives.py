"""Logs of one dive are recognised by clock and motion; dives that look alike are not."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.data_schemas.records.fleet import LogSurvey, MotionTrace
from auvid.pipeline.commands.fleet.surveys.same_dives import Compared, same_dives, with_clocks

STEP_S = 0.5
LENGTH_S = 200.0


def motion(seed: int, *, noise_seed: int, shift_s: float = 0.0) -> MotionTrace:
    """Return a smooth random motion, seen by a recorder that starts `shift_s` later."""
    rng = np.random.default_rng(seed)
    count = int(LENGTH_S / STEP_S)
    kernel = np.hanning(12) / np.hanning(12).sum()
    rate = np.convolve(rng.normal(0.0, 0.5, count), kernel, "same")
    depth = 10.0 + np.cumsum(np.convolve(rng.normal(0.0, 0.3, count), kernel, "same"))
    noise = np.random.default_rng(noise_seed)
    first = int(shift_s / STEP_S)
    return MotionTrace(
        step_s=STEP_S,
        start_s=0.0,
        depth_m=(depth + noise.normal(0.0, 0.01, count))[first:].tolist(),
        yaw_rate_rad_s=(rate + noise.normal(0.0, 0.01, count))[first:].tolist(),
    )


def log(name: str, trace: MotionTrace, *, form: str, start: str | None = None) -> LogSurvey:
    return LogSurvey(
        key=name,
        id=name,
        files=[name],
        hash=name,
        reason="",
        kind="identification",
        formats=[form],
        duration_s=STEP_S * len(trace.depth_m),
        start_utc=start,
        rows=1000 if form == "DataFlash" else 100,
        motion=trace,
    )


@pytest.mark.parametrize("start", [None, "2026-01-07T10:00:00Z"])
def test_two_recorders_of_a_dive_are_one_and_the_fuller_is_used(start: str | None) -> None:
    logs = [
        log("bin", motion(1, noise_seed=2), form="DataFlash"),
        log("tlog", motion(1, noise_seed=3, shift_s=20.0), form="telemetry", start=start),
        log("other", motion(4, noise_seed=5), form="telemetry", start=start),
    ]
    pairs = same_dives(logs)
    assert [(pair.better, pair.other) for pair in pairs] == [("bin", "tlog")]
    clocks = {
        name: item.start_utc
        for name, item in with_clocks({each.id: each for each in logs}, pairs).items()
    }
    assert clocks == {"bin": start, "tlog": start, "other": start}


def test_of_two_like_recorders_the_one_with_a_clock_is_used() -> None:
    for names in (("a", "b"), ("b", "a")):
        logs = [
            log(names[0], motion(1, noise_seed=2), form="DataFlash", start="2026-01-07T10:00:00Z"),
            log(names[1], motion(1, noise_seed=3), form="ULog").model_copy(update={"rows": 1000}),
        ]
        assert [pair.better for pair in same_dives(logs)] == [names[0]]


def test_two_vehicles_at_one_time_are_two_dives() -> None:
    start = "2026-01-07T10:00:00Z"
    logs = [
        log(str(seed), motion(seed, noise_seed=seed), form="DataFlash", start=start)
        for seed in (1, 2)
    ]
    assert same_dives(logs) == []


def test_a_clock_that_says_otherwise_keeps_equal_motions_apart() -> None:
    logs = [
        log("one", motion(1, noise_seed=2), form="DataFlash", start="2026-01-07T10:00:00Z"),
        log("two", motion(1, noise_seed=3), form="telemetry", start="2026-01-08T10:00:00Z"),
    ]
    assert same_dives(logs) == []


def test_a_pair_is_compared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    logs = [
        log("bin", motion(1, noise_seed=2), form="DataFlash"),
        log("tlog", motion(1, noise_seed=3, shift_s=20.0), form="telemetry"),
    ]
    compared = Compared()
    first = same_dives(logs, compared)
    assert len(first) == len(compared.words) == 1
    monkeypatch.setattr("auvid.pipeline.commands.check.motion_trace.clock_offset", None)
    assert same_dives(logs, compared) == first
    assert same_dives(logs[:1], compared) == []
    with pytest.raises(TypeError):  # a log that comes back is compared again
        same_dives(logs, compared)


def test_a_short_log_within_a_long_one_is_recognised() -> None:
    long = motion(1, noise_seed=2)
    part = motion(1, noise_seed=3)
    steps = slice(120, 180)
    part = part.model_copy(
        update={"depth_m": part.depth_m[steps], "yaw_rate_rad_s": part.yaw_rate_rad_s[steps]}
    )
    logs = [log("tlog", long, form="telemetry"), log("bin", part, form="DataFlash")]
    assert len(same_dives(logs)) == 1


def test_depths_that_look_alike_are_no_dive_where_the_turns_are_others() -> None:
    one, other = motion(1, noise_seed=2), motion(4, noise_seed=5)
    alike = other.model_copy(update={"depth_m": one.depth_m})
    assert same_dives([log("a", one, form="DataFlash"), log("b", alike, form="telemetry")]) == []
    still = [0.0] * len(one.depth_m)
    start = "2026-01-07T10:00:00Z"
    straight = [
        log(name, item.model_copy(update={"yaw_rate_rad_s": still}), form=name, start=start)
        for name, item in (("a", one), ("b", motion(1, noise_seed=3)))
    ]
    assert len(same_dives(straight)) == 1, "nothing turns, so the depth says it"


def holding(trace: MotionTrace, noise_seed: int) -> MotionTrace:
    """Return a motion with its heading held: noise of the compass is left of its yaw rate."""
    noise = np.random.default_rng(noise_seed).normal(0.0, 0.004, len(trace.yaw_rate_rad_s))
    return trace.model_copy(update={"yaw_rate_rad_s": noise.tolist()})


@pytest.mark.parametrize("start", [None, "2026-01-07T10:00:00Z"])
def test_two_recorders_of_a_dive_with_its_heading_held_are_one(start: str | None) -> None:
    logs = [
        log("bin", holding(motion(1, noise_seed=2), 6), form="DataFlash", start=start),
        log(
            "tlog", holding(motion(1, noise_seed=3, shift_s=20.0), 7), form="telemetry", start=start
        ),
        log("other", holding(motion(4, noise_seed=5), 8), form="telemetry", start=start),
    ]
    assert [(pair.better, pair.other) for pair in same_dives(logs)] == [("bin", "tlog")]


def test_dives_that_go_down_and_come_up_alike_are_two() -> None:
    down_and_up = np.interp(np.arange(400), [0, 60, 340, 400], [0.0, 12.0, 12.0, 0.0])
    logs = []
    for place, form in enumerate(("DataFlash", "telemetry")):
        trace = holding(motion(1, noise_seed=2), place)
        heave = 0.5 * np.array(motion(9 + place, noise_seed=place).depth_m)
        depth = (down_and_up + heave).tolist()
        logs.append(log(form, trace.model_copy(update={"depth_m": depth}), form=form))
    assert same_dives(logs) == []
