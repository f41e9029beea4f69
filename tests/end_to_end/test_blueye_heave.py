"""A real dive from commands and depth, one sample a second: damping from steady speeds,
no mass, and every loss is said.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path


def test_dive(committed_run: Callable[[str], Path]) -> None:
    leg = committed_run("blueye_heave") / "runs/blueye_heave/rlse/descent"
    results = json.loads((leg / "results.json").read_text(encoding="utf-8"))
    figures = {row["quantity"]: row for row in results["rows"]}
    headline = {name: row for name, row in figures.items() if row["headline"]}
    # A whole command holds about 0.28 m/s on this dive, with a net weight: Z_w|w| of
    # the order of -1 / 0.28^2.
    assert headline["Z_w|w| in commands"]["verdict"] == "identified"
    assert -17.0 < headline["Z_w|w| in commands"]["value"] < -10.0
    assert set(headline) == {"Z_w|w| in commands", "constant force in commands"}
    section = json.loads((leg / "section.json").read_text(encoding="utf-8"))
    remarks = " ".join(block["text"] for block in section["blocks"] if block["kind"] == "remark")
    assert "faster than it was sampled" in remarks
    assert "without a unit of force" in remarks
