"""A seeded sample of the damage that `make fuzz` tries in full, on the small log of
every reader; and all cases that failed once.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from auvid.stages.base import RawFile
from auvid.stages.ingest.registry import READERS, reader_of
from tests.faults import fuzz
from tests.faults.fuzz import closing_words
from tests.support import damage_cases
from tests.support.damage_cases import (
    FOLDER,
    MEAN_SHARE,
    count,
    damaged,
    failures,
    ingest_fault,
    keep,
    replay,
)
from tests.support.recovery import judge
from tests.support.small_logs import BINARY, NAMES, short_log, small_log

SAMPLES = {"flip": 80, "cut": 40, "mutation": 60}
RELEASE_SAMPLES = {"flip": 200, "cut": 100, "mutation": 160}
MUTATIONS = 20_000
INGEST_EVERY = 10
FAILED_ONCE = sorted(FOLDER.glob("*.json"))


@pytest.mark.parametrize("name", NAMES)
def test_small_logs_are_whole(name: str) -> None:
    source = small_log(name)
    assert source.log.status == "complete"
    assert 19_000 < len(source.data) <= 20_000
    assert reader_of(RawFile(name, np.frombuffer(source.data, np.uint8))).name == name
    result = judge(source, *damaged(source, "cut", len(source.data)))
    assert (result.expected, result.lost, result.invented, result.faults) == (
        source.places.first.size,
        0,
        0,
        [],
    )
    assert result.expected > 100


@pytest.mark.parametrize("name", BINARY)
def test_short_logs_have_every_type_of_the_small_one(name: str) -> None:
    short, small = short_log(name), small_log(name)
    assert short.log.status == "complete"
    assert len(short.data) < 5_000
    assert set(short.log.messages) >= set(small.log.messages)


def test_a_failed_case_of_a_short_log_is_tried_on_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(damage_cases, "FOLDER", tmp_path)
    source = short_log("tlog")
    data, kept = damaged(source, "flip", 800)
    assert replay(keep(source, "flip", 800, data, kept, ["a fault"])) == []


def test_a_campaign_cut_short_says_what_it_leaves() -> None:
    assert closing_words(30, 12).startswith(
        "PARTIAL: 30 of 42 cases tried, 12 left; memory was not"
    )
    assert closing_words(42, 0) == "all 42 cases tried, memory checked"


def test_the_record_goes_on_when_loops_are_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzz, "ROOT", tmp_path)
    folder = tmp_path / fuzz.CODE[0]
    (folder / "__pycache__").mkdir(parents=True)
    (folder / "reader.py").write_text("READ = 1")
    names = [fuzz.record_file(full_length=False)]
    (folder / "__pycache__" / "reader.loop-1.py311.nbi").write_bytes(b"machine code")
    names.append(fuzz.record_file(full_length=False))
    (folder / "reader.py").write_text("READ = 2")
    names.append(fuzz.record_file(full_length=False))
    assert names[0] == names[1] != names[2]


def test_every_reader_has_a_small_log() -> None:
    assert {reader.name for reader in READERS} == set(NAMES)


@pytest.mark.parametrize("kind", SAMPLES)
@pytest.mark.parametrize("name", NAMES)
def test_damage_costs_what_it_touches_and_nothing_else(name: str, kind: str) -> None:
    damage(name, kind, SAMPLES[kind])


@pytest.mark.release
@pytest.mark.parametrize("kind", RELEASE_SAMPLES)
@pytest.mark.parametrize("name", NAMES)
def test_more_damage_costs_what_it_touches_and_nothing_else(name: str, kind: str) -> None:
    damage(name, kind, RELEASE_SAMPLES[kind])


def damage(name: str, kind: str, samples: int) -> None:
    """No crash, wrong account, wrong value or invented record; 99.9 % of the whole
    records on average, at worst 99 % or all but two.
    """
    source = small_log(name)
    total = count(source, kind, MUTATIONS)
    numbers = (
        np.random.default_rng(2026).choice(total, size=min(samples, total), replace=False)
        if total
        else []
    )
    shares = []
    for index, number in enumerate(numbers):
        data, kept = damaged(source, kind, int(number))
        result = judge(source, data, kept)
        assert failures(source, result) == [], f"{name} {kind} {number}"
        if index % INGEST_EVERY == 0:
            assert ingest_fault(source, data) is None, f"{name} {kind} {number}"
        if result.expected and not result.refused:
            shares.append(result.lost / result.expected)
    assert not shares or np.mean(shares) <= MEAN_SHARE


@pytest.mark.parametrize("path", FAILED_ONCE, ids=lambda path: path.stem)
def test_what_failed_once_does_not_fail_again(path: object) -> None:
    assert replay(FOLDER / str(path)) == []


def test_a_judgement_sees_what_is_missing_and_what_is_not_of_the_source() -> None:
    """The judge itself: a reader that reads another log loses every record, and one
    that shifts its values is found out.
    """
    source = small_log("tlog")
    other = judge(source, small_log("dataflash").data, damaged(source, "cut", len(source.data))[1])
    assert other.lost == other.expected > 400
    values = small_log("dataflash")
    place = int(values.log.messages["IMU"].offset[5]) + 20
    data, kept = damaged(values, "flip", 8 * place)
    assert judge(values, data, kept).faults == []
    assert judge(values, data, damaged(values, "cut", len(data))[1]).faults == [
        "values of IMU.GyrZ"
    ]
