"""Models of which the training legs choose the terms, with legs of a known sparse truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.viscous.symmetry import allows
from auvid.stages import synthesise
from auvid.stages.base import collection
from auvid.stages.synthesise import chosen_terms
from auvid.stages.synthesise.presentation import SPARSE_WORDS
from tests.support.motions import residual_table, rich_motion, segment_document, shipped_vehicle

DAMPING = {
    "X": {"u": -30.0, "u*|u|": -60.0},
    "Y": {"v": -80.0, "u*r": 25.0},
    "Z": {"w": -90.0, "u": 12.0},
    "K": {"p": -6.0},
    "M": {"q": -8.0, "w": 9.0},
    "N": {"r": -9.0, "v": 7.0},
}


def force_of(nu: Array, seed: int, noise: float) -> Array:
    """Force (n, 6) of the truth with noise that lasts half a second."""
    names = dict(zip("uvwpqr", nu.T, strict=True))
    names |= {"u*|u|": names["u"] * np.abs(names["u"]), "u*r": names["u"] * names["r"]}
    force = np.column_stack([sum(c * names[t] for t, c in DAMPING[axis].items()) for axis in AXES])
    white = np.random.default_rng(seed).normal(size=force.shape)
    kernel = np.ones(25) / 5.0
    coloured = np.column_stack([np.convolve(column, kernel, mode="same") for column in white.T])
    return np.asarray(force + noise * coloured)


def cards_of(seeds: tuple[int, ...], noise: float = 1.0, **params: Any) -> dict[str, ModelCard]:
    """Cards of models fitted to legs of these seeds."""
    motions = {f"leg{seed}": rich_motion(12.0, seed=seed, ahead=False).nu for seed in seeds}
    tables = {
        name: residual_table(nu, force_of(nu, seed, noise), None)
        for seed, (name, nu) in zip(seeds, motions.items(), strict=True)
    }
    segments = {name: segment_document(name, "training") for name in tables}
    inputs = synthesise.Inputs(
        collection(tables), collection(segments), shipped_vehicle("bluerov2_heavy")
    )
    out = synthesise.run(inputs, synthesise.Params(**params))
    for card in out.model_card.values():
        check_document(card, "model_card")
    words = " ".join(str(block) for block in out.section["blocks"])
    assert all(SPARSE_WORDS in words for name in out.model_card if name == "sparse")
    return dict(out.model_card)


def terms_of(card: ModelCard) -> set[str]:
    return {f"{axis} {item.term}" for axis, part in card.axes.items() for item in part.terms}


TRUE = {f"{axis} {term}" for axis, row in DAMPING.items() for term in row}


def test_legs_switch_couplings_off_and_say_why() -> None:
    cards = cards_of((1, 2, 3, 4), models=("symmetric_quadratic", "symmetric_quadratic_reduced"))
    full, reduced = cards.values()
    gone = terms_of(full) - terms_of(reduced)
    assert gone == set(reduced.switched_off)
    assert len(gone) >= 5
    assert not gone & TRUE
    assert all("leg" in why for why in reduced.switched_off.values())
    assert {f"{axis} {own}" for axis, own in zip(AXES, "uvwpqr", strict=True)} <= terms_of(reduced)
    assert reduced.method == "within limits"
    assert set(reduced.held_out) == {"leg1", "leg2", "leg3", "leg4"}


def test_a_reduced_form_identifies_nothing_that_the_whole_one_does_not() -> None:
    """The choice of terms was made on the same data: its intervals do not know of it."""
    both = cards_of((1, 2), noise=12.0, models=("linear", "linear_reduced"))
    full, reduced = (
        {
            f"{axis} {item.term}"
            for axis, part in card.axes.items()
            for item in part.terms
            if item.verdict == "identified"
        }
        for card in both.values()
    )
    assert reduced <= full
    assert reduced
    # The same where nobody asked for the whole form.
    unasked = cards_of((1, 2), noise=12.0, models=("linear_reduced",))
    assert list(unasked) == ["linear_reduced"]
    assert unasked["linear_reduced"] == both["linear_reduced"]


def test_a_leg_is_held_out_of_the_choice_too(monkeypatch: pytest.MonkeyPatch) -> None:
    judged: list[int] = []
    switch_off = chosen_terms.switch_off

    def counting(legs: Any, *args: Any, **kwargs: Any) -> Any:
        judged.append(len(legs))
        return switch_off(legs, *args, **kwargs)

    monkeypatch.setattr(chosen_terms, "switch_off", counting)
    cards_of((1, 2, 3), models=("symmetric_reduced",))
    assert judged == [3, 2, 2, 2]


@pytest.mark.parametrize("seeds", [(1,), (1, 2, 3)])
def test_sparse_terms_are_those_of_the_truth_and_none_is_identified(seeds: tuple[int, ...]) -> None:
    card = cards_of(seeds, noise=0.3, models=("sparse",), trim=True)["sparse"]
    terms = {name for name in terms_of(card) if not name.endswith("constant")}
    assert terms >= TRUE
    assert len(terms) <= len(TRUE) + 6
    assert all(allows(*name.split(" "), ["port_starboard"]) for name in terms)
    assert not any(
        item.verdict == "identified" for part in card.axes.values() for item in part.terms
    )


def test_planes_of_symmetry_leave_couplings_out() -> None:
    planes = ("port_starboard", "fore_aft", "top_bottom")
    cards = cards_of((1,), models=("symmetric", "sparse"), symmetry=planes)
    assert terms_of(cards["symmetric"]) == {"X u", "Y v", "Z w", "K p", "M q", "N r"}
    assert not terms_of(cards["sparse"]) & {"Z u", "M w", "N v"}


def test_names_of_models_whose_terms_are_chosen() -> None:
    own = {"mine": {"X": ["u", "v", "w"], "N": ["r", "v"]}}
    cards = cards_of((1, 2), models=("mine_reduced",), structures=own)
    assert list(cards) == ["mine", "mine_reduced"]
    assert cards["mine_reduced"].switched_off.keys() >= {"X v", "X w"}
    with pytest.raises(
        CampaignError, match=r"unknown model.*'symetric_reduced'.*symmetric_reduced"
    ):
        cards_of((1,), models=("symetric_reduced",))
    with pytest.raises(CampaignError, match=r"name of a known model.*'sparse'"):
        cards_of((1,), structures={"sparse": {"X": ["u"]}})
