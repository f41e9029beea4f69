"""The agreement program: the licensed logs, whole and damaged, agree with the other
libraries; a reader that is wrong is found out.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from tests.support import agreement
from tests.support.mutate import mutations

DATA = Path(__file__).parents[1] / "data"
LOGS = (
    "bluerov2_ugps_small/small.BIN",
    "bluerov2_ugps_small/small.tlog",
    "px4_ulog/sample_appended_multiple.ulg",
)
# Damage behind the definitions: pymavlink dies of damaged units, pyulog of damaged
# formats.
PROTECTED = {"small.BIN": 60_000, "small.tlog": 0, "sample_appended_multiple.ulg": 200_000}


@pytest.mark.parametrize("name", LOGS)
def test_whole_logs_agree(name: str) -> None:
    result = agreement.compare(DATA / name, name)
    assert result is not None
    assert (result.missing, result.differing, result.status) == ([], [], "complete")
    assert result.ours >= result.theirs > 5000
    assert result.columns > 300


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", LOGS[:2])
def test_nothing_is_missing_of_damaged_logs(name: str, seed: int, tmp_path: Path) -> None:
    path = tmp_path / Path(name).name
    data, _ = mutations(
        (DATA / name).read_bytes(),
        seed,
        ("flips", "overwrite", "removal", "zeros", "hostile"),
        PROTECTED[path.name],
    )
    path.write_bytes(data)
    result = agreement.compare(path, path.name)
    assert result is not None
    assert (result.missing, result.differing) == ([], [])
    assert "fails" not in result.note
    assert result.status == "damaged"
    assert result.theirs > 1000


def test_a_ulog_cut_off_agrees(tmp_path: Path) -> None:
    path = tmp_path / "cut.ulg"
    path.write_bytes((DATA / LOGS[2]).read_bytes()[:300_000])
    result = agreement.compare(path, path.name)
    assert result is not None
    assert result.status == "truncated"
    assert result.agrees
    assert result.theirs > 1000


def test_a_missing_record_and_a_wrong_value_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    read = type(DATAFLASH).read

    def wrong(self: Any, file: RawFile, topics: frozenset[str] | None = None) -> DecodedLog:
        log = read(self, file, topics)
        imu, attitude = log.messages["IMU"], log.messages["ATT"]
        cut = replace(
            imu,
            columns={name: column[1:] for name, column in imu.columns.items()},
            offset=imu.offset[1:],
        )
        turned = replace(
            attitude,
            columns={
                **attitude.columns,
                "Roll": np.asarray(attitude.columns["Roll"], np.float64) + 0.01,
            },
        )
        return replace(log, messages={**log.messages, "IMU": cut, "ATT": turned})

    monkeypatch.setattr(type(DATAFLASH), "read", wrong)
    result = agreement.compare(DATA / LOGS[0], "small.BIN")
    assert result is not None
    assert not result.agrees
    assert len(result.missing) == 1
    assert result.missing[0].startswith("IMU at byte")
    assert result.differing == ["ATT.Roll"]


def test_files_without_another_library_are_left_out() -> None:
    assert agreement.compare(DATA / "px4_ulog" / "SOURCE.md", "SOURCE.md") is None
