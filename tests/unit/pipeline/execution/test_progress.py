"""Progress: lines with the time left, not too many; bars; steps of a stage."""

from __future__ import annotations

import re
import sys
import threading
import time

import pytest

from auvid.pipeline.execution.progress import Bars, ProgressLines, StageWork, duration, wait_s
from auvid.stages.steps import counted, listening, tell

LINE = r"validate: leg 1 of 2, model 3 of 4, \d+ s so far, about \d+ s left"


@pytest.mark.parametrize(
    ("seconds", "words"), [(4.2, "4 s"), (75.0, "1 min 15 s"), (4000.0, "1 h 6 min")]
)
def test_times_in_words(seconds: float, words: str) -> None:
    assert duration(seconds) == words


def test_time_left_follows_from_the_share_that_is_done() -> None:
    work = StageWork(2)
    assert work.left_s is None
    work.start -= 10.0
    work.part("model 3 of 4", 0.5)
    assert work.left_s == pytest.approx(30.0, abs=0.1)
    work.item()
    assert work.left_s == pytest.approx(10.0, abs=0.1)
    assert work.left_words == "about 10 s left"


def test_time_left_counts_down_within_a_part_and_is_not_known_beyond_it() -> None:
    work = StageWork(1)
    work.start -= 10.0
    work.part("draws", 0.8)
    assert work.left_s == pytest.approx(2.5, abs=0.1)
    work.start, work.part_start = work.start - 1.5, work.part_start - 1.5
    assert work.left_s == pytest.approx(1.0, abs=0.1)
    work.start, work.part_start = work.start - 1.5, work.part_start - 1.5
    assert work.left_words == ""


def test_lines_come_every_few_seconds_and_say_what_is_left(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = ProgressLines(every_s=0.1)
    say, second, printed = lines._say, threading.Event(), list[str]()

    def print_and_count(line: str) -> None:
        say(line)
        printed.append(line)
        if len(printed) == 2:
            second.set()

    monkeypatch.setattr(lines, "_say", print_and_count)
    start = time.monotonic()
    lines.stage("validate", todo=2, total=2, level="leg")
    lines._work.start -= 10.0
    lines.part("model 3 of 4", 0.5)
    assert second.wait(60.0), "no second line in a minute"
    assert time.monotonic() - start >= 0.2, "not before its time"
    lines.item("train")
    lines.item("check")
    lines.finish(failed=0)
    assert all(re.fullmatch(LINE, line) for line in printed[:2])
    last = capsys.readouterr().err.splitlines(keepends=True)[-1]
    assert re.fullmatch(r"validate: done \(\d+\.\d s\)\n", last)
    time.sleep(0.15)
    assert capsys.readouterr().err == ""


def test_lines_of_a_long_stage_come_the_more_seldom_the_longer_it_takes() -> None:
    now, count = 0.0, 0
    while now < 3600.0:
        now, count = now + wait_s(now, 5.0), count + 1
    assert count < 60


def test_a_stage_that_is_interrupted_says_no_more(capsys: pytest.CaptureFixture[str]) -> None:
    lines = ProgressLines(every_s=0.05)
    lines.stage("refine", todo=1, total=1, level="campaign")
    lines.close()
    capsys.readouterr()  # on a busy machine a line may have come before the end
    time.sleep(0.15)
    assert capsys.readouterr().err == ""


def test_quick_stages_take_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    lines = ProgressLines()
    lines.stage("cut", todo=3, total=3, level="leg")
    for name in "abc":
        lines.item(name)
    lines.finish(failed=0)
    assert capsys.readouterr().err.count("\n") == 1


def test_bars_show_parts_and_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with Bars() as bars:
        bars.stage("validate", todo=1, total=2, level="leg")
        bars._work.start -= 10.0
        bars.part("model 3 of 4", 0.5)
        task = bars._bars.tasks[-1]
        assert task.completed == pytest.approx(1.5)
        assert task.fields["note"] == "model 3 of 4, about 10 s left"
        bars.item("check")
        bars.finish(failed=0)
        assert task.completed == 2
        assert task.fields["note"] == ""


def test_steps_are_told_to_who_listens() -> None:
    heard: list[tuple[str, float]] = []
    assert list(counted("model", "ab")) == ["a", "b"]
    with listening(lambda words, share: heard.append((words, share))):
        assert list(counted("model", "ab")) == ["a", "b"]
        tell("draws", 3, 4)
    tell("nobody listens", 0, 1)
    assert heard == [("model 1 of 2", 0.0), ("model 2 of 2", 0.5), ("draws", 0.75)]
