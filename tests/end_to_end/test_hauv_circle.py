"""The circle of the H-AUV: its committed logs give the model card on which campaign
hauv_redesign designs, and that card is the truth.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.control.plants import card_coefficients
from auvid.hydro.dynamics.hybrid_vehicle import hybrid_vehicle
from tests.support.motions import shipped_vehicle

ROOT = Path(__file__).parents[2]
CARD = ROOT / "campaigns/hauv_redesign/prestero.json"
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
    committed_run: Callable[[str], Path],
) -> None:
    """Each coefficient to 1 % of its standard error: what another processor's rounding
    moves grows with what the data leave open. Terms that are not excited have no value.
    """
    file = "runs/hauv_circle/synthesise/model_card/prestero.json"
    card_of_run = json.loads((committed_run("hauv_circle") / file).read_text(encoding="utf-8"))
    kept = json.loads(CARD.read_text(encoding="utf-8"))
    for axis, part in kept["axes"].items():
        assert card_of_run["axes"][axis]["excitation"] == part["excitation"], axis
        for new, old in zip(card_of_run["axes"][axis]["terms"], part["terms"], strict=True):
            assert (new["term"], new["verdict"]) == (old["term"], old["verdict"]), axis
            if old["value"] is None:
                assert new["value"] is None
                continue
            assert abs(new["value"] - old["value"]) < 0.01 * old["standard_error"], new["term"]
            assert new["standard_error"] == pytest.approx(old["standard_error"], rel=0.01)


def test_card_of_the_redesign_has_the_coefficients_that_carry_the_motion() -> None:
    card = ModelCard.model_validate_json(CARD.read_bytes())
    coefficients, _ = card_coefficients(card)
    true = hybrid_vehicle(shipped_vehicle("hauv"), "as_simulated")
    for axis, (term, share) in LARGEST.items():
        flown = float(np.asarray(true.viscous)["XYZKMN".index(axis), true.terms.index(term)])
        assert coefficients[axis][term] == pytest.approx(flown, rel=share), (axis, term)
