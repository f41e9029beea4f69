"""An equation that is wrong by one per cent moves a golden figure, and the stage that
uses it is named.

`python -m tests.faults.equation_faults` tries every equation on results under runs/.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.faults.equation_faults import (
    CIRCLE,
    DIVE,
    FAULTS,
    THAUS,
    TWIN,
    VT690,
    EquationFault,
    function_of,
    wrong_code,
)
from tests.support.campaign_runs import ROOT

FEW = ("Munk moment left out", "thrust curve")


def moved(runs: Path, *only: str) -> dict[str, str]:
    """What moves under the faults of these names or campaigns, by name."""
    options = [word for name in only for word in ("--only", name)]
    command = [sys.executable, "-m", "tests.faults.equation_faults", "--runs", str(runs), *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line.split(" | ") for line in done.stdout.splitlines()]
    return {name: words for name, _, words in rows}


def test_a_wrong_equation_moves_a_figure_of_the_stage_that_uses_it(
    committed_run: Callable[[str], Path],
) -> None:
    figures = moved(committed_run(DIVE) / "runs", *FEW)
    assert set(figures) == set(FEW)
    assert all(words.startswith("stage residual (residual: ") for words in figures.values()), (
        figures
    )


@pytest.mark.release
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", [DIVE, CIRCLE, THAUS, TWIN, VT690])
def test_no_equation_of_a_campaign_is_wrong_unnoticed(
    committed_run: Callable[[str], Path], name: str
) -> None:
    names = {fault.name for fault in FAULTS if fault.campaign == name}
    assert set(moved(committed_run(name) / "runs", name)) == names


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_every_fault_finds_its_equation(fault: EquationFault) -> None:
    function = function_of(fault.target)
    code = wrong_code(function, fault.old, fault.new)
    assert code.co_name == function.__name__
    assert (
        code.co_consts != function.__code__.co_consts or code.co_code != function.__code__.co_code
    )
