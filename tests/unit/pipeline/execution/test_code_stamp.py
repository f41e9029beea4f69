"""The quick look that tells whether hashes of code are still those of the sources."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from auvid.pipeline.execution import code_stamp, runner
from auvid.pipeline.store.file_hashes import hash_file
from auvid.pipeline.store.fingerprints import fingerprint_line
from tests.support.toy_stages import STAGES

NAMES = [f"{stage.name}.txt" for stage in STAGES]


@pytest.fixture
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in code_stamp.FOLDERS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "part.py").write_text("x = 1\n")
    monkeypatch.setattr(code_stamp, "ROOT", tmp_path)
    return tmp_path


def edit(sources: Path, folder: Path) -> None:
    """Edit a source in place; its size and time stay."""
    path = sources / "hydro" / "part.py"
    stamp = path.stat().st_mtime_ns
    path.write_text("x = 2\n")
    os.utime(path, ns=(stamp, stamp))


CHANGES = {
    "source edited": edit,
    "source added": lambda sources, folder: (sources / "stages" / "more.yaml").touch(),
    "source removed": lambda sources, folder: (sources / "stages" / "part.py").unlink(),
    "hash lost": lambda sources, folder: (folder / "cut.txt").unlink(),
    "hash altered": lambda sources, folder: (folder / "cut.txt").write_text("cut 0\n"),
    "stamp damaged": lambda sources, folder: (folder / code_stamp.FILE).write_text("{"),
}


def test_second_look_hashes_nothing(
    sources: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / ".code"
    runner.write_code_files(STAGES, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert set(before) == {code_stamp.FILE, *NAMES}
    monkeypatch.setattr(runner, "fingerprint_line", lambda *_: pytest.fail("hashed again"))
    runner.write_code_files(STAGES, folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert not code_stamp.unchanged(folder, ["other.txt"])


def test_a_source_that_stages_share_is_hashed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: Counter[Path] = Counter()

    def counted(path: Path) -> str:
        counts[path] += 1
        return hash_file(path)

    monkeypatch.setattr(runner, "hash_file", counted)
    runner.write_code_files(STAGES, tmp_path)
    assert len(counts) > len(STAGES)
    assert set(counts.values()) == {1}
    lines = {stage.name: (tmp_path / f"{stage.name}.txt").read_text() for stage in STAGES}
    assert lines == {stage.name: fingerprint_line(stage) for stage in STAGES}


@pytest.mark.parametrize("change", CHANGES)
def test_any_change_is_noticed(sources: Path, tmp_path: Path, change: str) -> None:
    folder = tmp_path / ".code"
    runner.write_code_files(STAGES, folder)
    original = (folder / "cut.txt").read_bytes()
    assert code_stamp.unchanged(folder)
    CHANGES[change](sources, folder)
    assert not code_stamp.unchanged(folder)
    runner.write_code_files(STAGES, folder)
    assert code_stamp.unchanged(folder)
    assert (folder / "cut.txt").read_bytes() == original
