"""A run killed, torn or refused at file operations chosen over the whole run: nothing is
lost, nothing half-written counts, and the words name the disk.

`python -m tests.faults.disk_faults` tries every fault at every operation.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def campaign(*options: str) -> dict[str, object]:
    """Return the result of the campaign, run by a program of one thread, which may fork."""
    command = [sys.executable, "-m", "tests.faults.disk_faults", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    result: dict[str, object] = json.loads(done.stdout)
    return result


@pytest.mark.parametrize(
    "options",
    [
        ("--every", "31"),
        pytest.param(("--every", "3"), marks=[pytest.mark.release, pytest.mark.timeout(1800)]),
        pytest.param(
            ("--example", "--every", "60"),
            marks=[pytest.mark.release, pytest.mark.timeout(1800)],
        ),
    ],
    ids=["sample", "every third", "example"],
)
def test_no_fault_of_the_disk_costs_a_result(options: tuple[str, ...]) -> None:
    problem = campaign(*options)
    assert problem["wrong"] == []
    assert int(str(problem["tried"])) >= 10
    assert int(str(problem["places"])) > 300
