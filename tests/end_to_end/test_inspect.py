"""`auvid inspect` as a user calls it: files, pictures, and what it says where there is
nothing to show or nothing to show it with.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline import cli
from auvid.pipeline.commands.look.inspect import inspect_command
from auvid.pipeline.commands.look.inspect import rerun_viewer as viewer
from tests.support.pictures import PICTURES, look

ROOT = Path(__file__).parents[2]
SMALL = ROOT / "tests/data/bluerov2_ugps_small/small.BIN"


@dataclass(frozen=True)
class Done:
    """What a call printed, and the fault that ended it."""

    stdout: str
    fault: PipelineError | None


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def auvid(*words: object) -> Done:
    """Run the command in this process; a fault that is none of the user's fails the
    test.
    """
    result = CliRunner().invoke(cli.app, [str(word) for word in words])
    assert isinstance(result.exception, PipelineError | None), result.exception
    return Done(result.output, result.exception)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("inspect") / "small.rrd"
    done = auvid("inspect", SMALL, "--save", file)
    assert done.fault is None
    assert "small.rrd" in done.stdout
    return file


def test_saved_recording_is_verified_and_holds_the_streams(recording: Path) -> None:
    viewer.verify(recording)
    printed = subprocess.run(
        [str(viewer.program()), "rrd", "print", str(recording)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for entity in ("raw/attitude/deg", "raw/depth/m", "log/findings", "path/vehicle"):
        assert f"/{entity} - " in printed


@pytest.mark.skipif(
    viewer.missing_for_pictures() is not None, reason=str(viewer.missing_for_pictures())
)
def test_picture_is_not_empty(recording: Path) -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    file = PICTURES / "inspect_log.png"
    file.write_bytes(viewer.picture(recording, size=(800, 500)))
    picture = look(file)
    assert picture.size == (800, 500)
    assert picture.colours > 30, "an empty viewer has a handful of greys"
    assert picture.bytes <= 200_000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("no_such_campaign",), "no such campaign"),
        (("nowhere/dive.BIN",), "is not there"),
        (("nowhere/run.rrd",), "the recording is not there"),
        ((str(SMALL), "--save", "x.txt"), "does not end in .rrd"),
        ((str(SMALL), "--screenshot", "x.jpg"), "does not end in .png"),
        ((str(SMALL), "--tab", "Foo", "--save", "x.rrd"), "no such tab"),
        ((str(SMALL),), "--save FILE.rrd"),
        ((str(SMALL.parent),), "Name one of its files."),
    ],
)
def test_refusals_say_what_to_do(words: tuple[str, ...], message: str) -> None:
    assert message in str(auvid("inspect", *words).fault)


def test_recording_cut_off_or_of_something_else_is_refused(recording: Path, tmp_path: Path) -> None:
    for name, content in (
        ("cut.rrd", recording.read_bytes()[:1000]),
        ("other.rrd", b"RRF9" + bytes(2000)),
        ("empty.rrd", b""),
    ):
        file = tmp_path / name
        file.write_bytes(content)
        assert "cannot be read" in str(auvid("inspect", file).fault), name


def test_log_larger_than_memory_is_refused_before_it_is_read(tmp_path: Path) -> None:
    file = tmp_path / "huge.BIN"
    with file.open("wb") as handle:
        handle.truncate(
            10 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        )  # no byte of it is written
    assert "of memory" in str(auvid("inspect", file, "--save", tmp_path / "huge.rrd").fault)
    assert not (tmp_path / "huge.rrd").exists()


@pytest.mark.release
def test_unknown_tab_is_named_and_leaves_no_warning_behind(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "auvid",
        "inspect",
        str(SMALL),
        "--tab",
        "Foo",
        "--save",
        str(tmp_path / "x.rrd"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 2
    assert "no such tab" in done.stderr
    assert "Dropping data" not in done.stderr


def test_without_a_display_nothing_is_decoded_or_left_in_the_temporary_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(PipelineError, match=r"no display.*--web"):
        inspect_command.inspect(str(SMALL))
    assert list(tmp_path.iterdir()) == []


def test_viewer_that_ends_at_once_is_a_fault(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":98765")
    with pytest.raises(PipelineError, match=r"opened no window.*--web"):
        viewer.show(recording)


def test_viewer_that_is_not_installed_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(PipelineError, match=r"not installed.*--save"):
        viewer.program()
    assert "apt-get install xvfb xauth mesa-vulkan-drivers" in str(viewer.missing_for_pictures())


def test_picture_of_a_flat_image_counts_one_colour(tmp_path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.zeros((20, 30, 3), dtype=np.uint8)).save(tmp_path / "flat.png")
    assert look(tmp_path / "flat.png").colours == 1
