"""The circle of the H-AUV: its committed logs give the model card on which campaign
hauv_redesign designs, and that card is the truth.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from auvid.hydro.control.plants import card_coefficients
from auvid.hydro.dynamics.hybrid_vehicle import hybrid_vehicle
from auvid.pipeline import cli

ROOT = Path(__file__).parents[2]
LARGEST = {
    "X": ("u*|u|", 0.02),
    "Y": ("u*v", 0.2),
    "Z": ("u*q", 0.15),
    "M": ("u*q", 0.15),
    "N": ("u*r", 0.1),
}
"""Coefficients that carry the motion, and how far the estimate may be from the vehicle
that was flown: measured 0.3 to 15 %.
"""


def test_card_of_the_redesign_is_what_the_chain_finds_in_the_logs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(ROOT / "campaigns/hauv_circle", tmp_path / "campaigns/hauv_circle")
    (tmp_path / "params.yaml").write_text("campaigns: [hauv_circle]\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(
        cli.app, ["run", "hauv_circle", "--until", "synthesise"], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    made = json.loads(
        (tmp_path / "runs/hauv_circle/synthesise/model_card/prestero.json").read_text(
            encoding="utf-8"
        )
    )
    kept = json.loads((ROOT / "campaigns/hauv_redesign/prestero.json").read_text(encoding="utf-8"))
    for axis, found in made["solution"].items():
        assert found == pytest.approx(kept["solution"][axis], rel=1e-3, abs=1e-6), axis


def test_card_of_the_redesign_has_the_coefficients_that_carry_the_motion() -> None:
    card = json.loads((ROOT / "campaigns/hauv_redesign/prestero.json").read_text(encoding="utf-8"))
    found, _ = card_coefficients(card)
    true = hybrid_vehicle(
        yaml.safe_load((ROOT / "vehicles/hauv.yaml").read_text(encoding="utf-8")), "as_simulated"
    )
    for axis, (term, share) in LARGEST.items():
        flown = float(np.asarray(true.viscous)["XYZKMN".index(axis), true.terms.index(term)])
        assert found[axis][term] == pytest.approx(flown, rel=share), (axis, term)
