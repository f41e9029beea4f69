"""A leg that is too long for the memory that is left is named before it is begun."""

from __future__ import annotations

import ctypes
import resource
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from auvid.pipeline.campaigns.campaign import Campaign, load_campaign
from auvid.pipeline.execution import memory
from auvid.pipeline.execution.task import Task, execute
from auvid.stages.registry import KINDS

VEHICLES = {"rov": Path(__file__).resolve().parents[4] / "vehicles" / "bluerov2_heavy.yaml"}
MANIFEST = """kind: identification
vehicle: rov
logs:
  - {id: one, file: one.csv}
legs:
  - {id: train, log: one, end_s: 600, use: training}
  - {id: survey, log: one, start_s: 600, use: validation}
"""
LENGTHS_S = {"one": 22_200.0}  # survey: 6 h


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    (tmp_path / "campaign.yaml").write_text(MANIFEST)
    return load_campaign(tmp_path, kinds=KINDS, vehicles=VEHICLES)


def test_a_leg_of_hours_is_refused_with_the_length_that_fits(campaign: Campaign) -> None:
    assert memory.shortage(campaign, LENGTHS_S, 50.0, 1, 3e9) is None
    fault = memory.shortage(campaign, LENGTHS_S, 50.0, 1, 1.2e9)
    assert fault is not None
    words = str(fault)
    assert "leg 'survey' is too long" in words
    assert "21600 s at 50 Hz take about 1.7 GB" in words
    assert "found '1.2 GB left'" in words
    assert "legs of at most 13187 s" in words
    assert memory.shortage(campaign, LENGTHS_S, 25.0, 1, 1.2e9) is None


@pytest.mark.parametrize(
    ("length_s", "legs", "measured"),
    [(600.0, 1, 473e6), (3600.0, 1, 664e6), (7200.0, 1, 712e6), (600.0, 7, 461e6)],
)
def test_what_a_leg_takes_is_reckoned_a_little_above_what_was_measured(
    length_s: float, legs: int, measured: float
) -> None:
    """Peaks of a process from log to report at 50 Hz (decisions 0122, 0129)."""
    assert measured < memory.needed_bytes([50.0 * length_s], legs) < 1.3 * measured


def test_more_legs_take_more_memory() -> None:
    """Check_installation: 327 MB for 36 legs and 389 for 144 (decision 0129)."""
    more = memory.needed_bytes([30_000.0], 144) - memory.needed_bytes([30_000.0], 36)
    assert 62e6 < more < 1.3 * 62e6


def test_legs_side_by_side_count_together(campaign: Campaign) -> None:
    assert memory.shortage(campaign, LENGTHS_S, 50.0, 1, 1.9e9) is None
    fault = memory.shortage(campaign, LENGTHS_S, 50.0, 2, 1.9e9)
    assert fault is not None
    assert "with 1 more beside it" in str(fault)
    assert "--jobs 1" in str(fault)


def test_memory_left_is_that_of_the_machine_or_of_its_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("MEMORY_INFO", "LIMIT", "USED", "DETAIL"):
        monkeypatch.setattr(memory, name, tmp_path / name)
    assert memory.available_bytes() is None
    (tmp_path / "MEMORY_INFO").write_text("MemTotal: 900 kB\nMemAvailable:   500 kB\n")
    assert memory.available_bytes() == 512_000
    (tmp_path / "USED").write_text("100000\n")
    (tmp_path / "LIMIT").write_text("max\n")
    assert memory.available_bytes() == 512_000
    (tmp_path / "LIMIT").write_text("300000\n")
    (tmp_path / "DETAIL").write_text("anon 40000\ninactive_file 0\n")
    assert memory.available_bytes() == 200_000
    (tmp_path / "DETAIL").write_text("anon 40000\ninactive_file 60000\n")
    assert memory.available_bytes() == 260_000, "files that nobody reads are given up"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc is Linux's")
def test_a_limit_of_the_process_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As `ulimit -v` sets it: what it leaves above the addresses that are in use."""
    for name in ("MEMORY_INFO", "LIMIT", "USED", "DETAIL", "OWN_PAGES"):
        monkeypatch.setattr(memory, name, tmp_path / name)
    (tmp_path / "MEMORY_INFO").write_text("MemAvailable:   90000000 kB\n")
    (tmp_path / "OWN_PAGES").write_text("1000 200 100 1 0 300 0\n")
    in_use = 1000 * resource.getpagesize()
    monkeypatch.setattr(resource, "getrlimit", lambda _: (in_use + 7_000_000, -1))
    assert memory.available_bytes() == 7_000_000


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the resident size is Linux's")
def test_what_is_freed_goes_back_to_the_system() -> None:
    """Freed blocks of 64 kB stay on the heap of glibc while one above them is in use."""

    def resident_bytes() -> float:
        rows = Path("/proc/self/status").read_text().splitlines()
        return 1024.0 * next(int(row.split()[1]) for row in rows if row.startswith("VmRSS"))

    blocks = [np.ones(8192) for _ in range(2000)]
    kept = blocks[-1]
    before = resident_bytes()
    del blocks
    memory.give_back()
    assert resident_bytes() < before - 80e6
    assert kept[0] == 1.0


def test_threads_of_a_task_share_one_heap_of_glibc(monkeypatch: pytest.MonkeyPatch) -> None:
    options: list[tuple[int, int]] = []
    library = SimpleNamespace(mallopt=lambda *option: options.append(option))
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    outcome = execute(cast(Task, SimpleNamespace(item="leg")))
    assert outcome.item == "leg"
    assert options == [(-8, 1)]  # M_ARENA_MAX of malloc.h
