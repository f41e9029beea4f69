"""Pictures of the viewer on a slow machine: more tries, more time, and a look at each."""

from __future__ import annotations

import io
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.commands.look.inspect import rerun_viewer as viewer

SIZE = (400, 250)


def png(drawn: bool) -> bytes:
    """A picture of the viewer with noise for plots, or of its empty window."""
    pixels = np.zeros((SIZE[1], SIZE[0], 3), dtype=np.uint8)
    if drawn:
        pixels[40:-40] = np.random.default_rng(1).integers(0, 255, (SIZE[1] - 80, SIZE[0], 3))
    sink = io.BytesIO()
    Image.fromarray(pixels).save(sink, "PNG")
    return sink.getvalue()


@pytest.fixture
def tries(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., list[float]]:
    """Let the viewer answer with what is listed: a picture, nothing, or a time-out."""

    def let(*answers: bytes | str | None) -> list[float]:
        timeouts: list[float] = []
        waiting = list(answers)

        def run(command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
            timeouts.append(options["timeout"])
            reply = waiting.pop(0)
            if reply == "slow":
                raise subprocess.TimeoutExpired(command, options["timeout"])
            if isinstance(reply, bytes):
                Path(command[command.index("--screenshot-to") + 1]).write_bytes(reply)
            return subprocess.CompletedProcess(command, 0, "", "no adapter")

        monkeypatch.setattr(viewer.subprocess, "run", run)
        monkeypatch.setattr(viewer, "verify", lambda recording: None)
        monkeypatch.setattr(viewer, "missing_for_pictures", lambda: None)
        monkeypatch.setattr(viewer, "program", lambda: Path("rerun"))
        return timeouts

    return let


def test_a_slow_viewer_gets_more_time_and_an_empty_picture_another_try(
    tries: Callable[..., list[float]], tmp_path: Path
) -> None:
    timeouts = tries("slow", png(drawn=False), png(drawn=True))
    assert viewer.drawn_share(viewer.picture(tmp_path / "a.rrd", size=SIZE)) > 0.5
    assert timeouts == list(viewer.TIMEOUTS_S)
    assert timeouts == sorted(set(timeouts))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        ("slow", "the viewer took too long"),
        (None, "the viewer took no picture"),
        (png(drawn=False), "without the recording in it"),
    ],
)
def test_the_last_fault_is_told(
    tries: Callable[..., list[float]], tmp_path: Path, reply: bytes | str | None, words: str
) -> None:
    tries(*[reply] * len(viewer.TIMEOUTS_S))
    with pytest.raises(PipelineError, match=words):
        viewer.picture(tmp_path / "a.rrd", size=SIZE)
    assert not list(tmp_path.iterdir())


def test_share_drawn_is_that_of_what_is_not_background() -> None:
    assert viewer.drawn_share(png(drawn=False)) == 0.0


def test_a_viewer_keeps_freed_memory_for_its_next_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    options: list[dict[str, Any]] = []
    monkeypatch.setenv("MIMALLOC_PURGE_DELAY", "0")
    monkeypatch.setattr(viewer, "program", lambda: Path("rerun"))
    monkeypatch.setattr(viewer.subprocess, "run", lambda *_, **own: options.append(own))
    viewer.serve(Path("a.rrd"))
    assert "PATH" in options[0]["env"]
    assert "MIMALLOC_PURGE_DELAY" not in options[0]["env"]
