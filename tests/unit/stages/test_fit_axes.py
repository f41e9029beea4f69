"""Fitted axes as cards, model files and figures: in newtons, in shares, filled."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import auvid
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.model_file import ModelFile
from auvid.data_schemas.records.models import ModelCard
from auvid.export.writing import prepare
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.single_axis import surge_input
from auvid.hydro.identification.regression.assumed_figures import INERTIA_RATIO, total_error
from auvid.hydro.model_file import vehicle_of
from auvid.hydro.partial_model import apparent_inertia
from auvid.pipeline.campaigns.vehicle_files import load_published, shelf_files
from auvid.stages.columns import TOO_COARSE
from auvid.stages.fit_axes.card import lacking_axis, model_card, ranking
from auvid.stages.fit_axes.coupling import fitted_together
from auvid.stages.fit_axes.filling import FillSources, filled_axes
from auvid.stages.fit_axes.fitted import (
    AxisFits,
    FittedAxis,
    HeldOutFit,
    Lacking,
    LackingVerdict,
)
from auvid.stages.fit_axes.fitting import dives_apart, fit_all, shared_lag, unlike_validation
from auvid.stages.fit_axes.flight import FitOptions, LegData
from auvid.stages.fit_axes.presentation import fit_section, together_words
from auvid.stages.fit_axes.scaling import scaled
from auvid.stages.model_file.contents import model_document, use_entry
from auvid.stages.report.summary.axes_summary import summarise_axes
from tests.support.axis_twin import FULL, TRUTH, leg
from tests.support.constrained import drawn_as_printed
from tests.support.motions import shipped_vehicle as vehicle

PROVENANCE: dict[str, Any] = {"logs": {}, "vehicle": "0", "stages": {}, "packages": {}}
FREE = FitOptions(given_inertia=(), lag_s=0.08, fit_lag=False)


@cache
def fits(normalised: bool) -> AxisFits:
    """Return the fits of two legs and of a validation leg."""
    legs = {
        "one": leg(normalised=normalised),
        "two": leg(normalised=normalised, seed=2),
        "check": leg(normalised=normalised, seed=3, use="validation"),
    }
    return fit_all(legs, vehicle("bluerov2_heavy"), FREE)


def card_of(fitted: AxisFits, body: Vehicle, fill: dict[str, str] | None = None) -> ModelCard:
    forces = scaled(fitted, body, by="pull")
    sets = {key: load_published(path, named_in="a test") for key, path in shelf_files().items()}
    filled = filled_axes(
        fill or {},
        FillSources(sets, {}),
        fitted=[item.axis for item in fitted.fitted],
        vehicle=body,
        unit_of_mass=forces.unit_of_mass,
    )
    return model_card(fitted, forces, filled, body)


def file_of(card: ModelCard, fitted: AxisFits, body: Vehicle) -> ModelFile:
    ranked = ranking(card, fitted)
    return model_document(
        card,
        body,
        use=use_entry(ranked, ranked.models[0], card),
        merit=ranked.models[0],
        free_runs=[],
        title="twin",
        provenance=PROVENANCE,
        minimum_speed_m_s=0.05,
    )


def values(card: ModelCard, axis: str) -> dict[str, float]:
    return {item.term: item.value or 0.0 for item in card.axes[axis].terms}


def test_axes_in_newtons_have_the_damping_and_inertia_of_the_truth() -> None:
    body, fitted = vehicle("bluerov2_heavy"), fits(False)
    card = card_of(fitted, body)
    for axis, (linear, quadratic, inertia) in TRUTH.items():
        x = {"Z": "w", "N": "r"}[axis]
        damping = values(card, axis)
        assert damping[x] == pytest.approx(linear, rel=0.02)
        assert damping[f"{x}*|{x}|"] == pytest.approx(quadratic, rel=0.02)
        item = next(item for item in card.inertia if item.name[0] == axis)
        assert item.value == pytest.approx(inertia, rel=0.01)
    assert drawn_as_printed(card) >= 2 * len(TRUTH)
    assert "thrust" in card.axes["Z"].terms[0].assumed_shifts
    percent = {item.axis: item.held_out_percent for item in fitted.fitted}
    assert min(filter(None, percent.values())) > 90.0
    assert any("validation leg check" in part.what for part in fitted.fitted[0].held_out)
    assert all(item.whole_legs["check"] > 85.0 for item in fitted.fitted)


def test_drag_at_one_speed_is_surer_than_its_parts_and_stands_first() -> None:
    body, fitted = vehicle("bluerov2_heavy"), fits(False)
    card = card_of(fitted, body)
    assert card.partial is not None
    assert [item.axis for item in card.partial.total_drag] == ["Z", "N"]
    for item in card.partial.total_drag:
        linear, quadratic, _ = TRUTH[item.axis]
        assert item.value == pytest.approx(-linear - quadratic * item.speed, rel=0.01)
        assert item.assumed_shifts["thrust"] == pytest.approx(body.spreads["thrust"] * item.value)
        low, high = item.interval_95
        own = NORMAL_95 * np.array(
            [(term.standard_error or 0.0) / abs(term.value or 1.0) for term in
             card.axes[item.axis].terms if term.term != "constant"]
        )  # fmt: skip
        assert NORMAL_95 * item.standard_error / item.value < 0.5 * own.min()
        error = total_error(item.standard_error, item.assumed_shifts)
        assert np.log(high / low) / 2.0 == pytest.approx(NORMAL_95 * error / item.value)
    figures = summarise_axes(card, ranking(card, fitted), {}, {}, body, {}).figures
    yaw = [item for item in figures if item.part == "yaw"]
    assert [figures[0].quantity, yaw[0].quantity] == [
        item.words for item in card.partial.total_drag
    ]
    assert "noise alone ±" in yaw[0].note
    (readme,) = [
        text
        for name, text in prepare(file_of(card, fitted, body), "json").files.items()
        if name.startswith("README")
    ]
    assert f"Yaw {yaw[0].quantity}: {card.partial.total_drag[1].value:.3g} N m s/rad" in readme
    assert not card_of(fits(True), body).partial.total_drag  # type: ignore[union-attr]


def test_a_time_constant_at_a_speed_is_surer_than_the_parts_of_its_drag() -> None:
    body, fitted = vehicle("bluerov2_heavy"), fits(True)
    weak = [
        replace(
            item,
            equation=replace(item.equation, verdicts=dict.fromkeys(item.equation.names, "weak")),
        )
        for item in fitted.fitted
    ]
    trading = replace(fitted, fitted=tuple(weak))
    card = card_of(trading, body)
    assert card.partial is not None
    verdicts = {
        (item.axis, item.quantity.split(" 0.")[0]): item.verdict
        for item in card.partial.without_newtons
    }
    for axis, rate in (("Z", "w"), ("N", "r")):
        assert verdicts[axis, f"{axis}_{rate}/M"] == "weak"
        assert verdicts[axis, "time constant from rest"] == "weak"
        assert verdicts[axis, "time constant at"] == "identified"
    usable = ranking(card, trading).usable
    assert usable is not None
    assert usable.control == ["Z", "N"]
    wide = [
        replace(
            item,
            quantities=tuple(
                replace(own, low=own.value / 1.7, high=own.value * 1.7) for own in item.quantities
            ),
        )
        for item in weak
    ]
    other = card_of(replace(fitted, fitted=tuple(wide)), body)
    assert other.partial is not None
    assert {item.verdict for item in other.partial.without_newtons} == {"weak"}


def test_damping_in_newtons_is_no_surer_than_the_inertia_in_it() -> None:
    """N_r / M is known to a part of a thousand, and M to its half: N_r was called identified."""
    body, fitted = vehicle("bluerov2_heavy"), fits(False)
    unsure = []
    for item in fitted.fitted:
        equation = item.equation
        place = equation.names.index("force")
        covariance = equation.covariance.copy()
        covariance[place, place] += (0.5 * equation.value("force")) ** 2
        unsure.append(replace(item, equation=replace(equation, covariance=covariance)))
    before, card = card_of(fitted, body), card_of(replace(fitted, fitted=tuple(unsure)), body)
    for axis, linear in (("Z", "w"), ("N", "r")):
        sure, other = (
            next(item for item in cards.axes[axis].terms if item.term == linear)
            for cards in (before, card)
        )
        assert (sure.verdict, other.verdict) == ("identified", "weak")
        assert abs(other.value or 0.0) < NORMAL_95 * (other.standard_error or 0.0) * 1.1


def test_the_whole_constant_force_scales_with_the_thrust() -> None:
    body = vehicle("bluerov2_heavy")
    light = replace(body, displaced_mass_kg=body.displaced_mass_kg + 1.0)
    card = card_of(fits(False), light)
    constant = next(item for item in card.axes["Z"].terms if item.term == "constant")
    measured = values(card, "Z")["constant"] + light.weight - light.buoyancy
    expected = light.spreads["thrust"] * abs(measured)
    assert constant.assumed_shifts["thrust"] == pytest.approx(expected)


def test_a_thrust_curve_that_gives_too_much_is_in_the_errors_of_inertia_and_damping() -> None:
    body, twin = vehicle("bluerov2_heavy"), leg()
    force = {axis: 1.1 * values for axis, values in twin.record.force.items()}
    legs = {"one": replace(twin, record=replace(twin.record, force=force))}
    card = card_of(fit_all(legs, body, replace(FREE, axes=("N",))), body)
    linear, _, inertia = TRUTH["N"]
    entries = [(card.inertia[0], inertia), (card.axes["N"].terms[0], linear)]
    for item, truth in entries:
        assert item.verdict == "identified"
        assert item.standard_error is not None
        assert item.value is not None
        off = abs(item.value - truth)
        assert off > NORMAL_95 * item.standard_error
        assert off < NORMAL_95 * total_error(item.standard_error, item.assumed_shifts)


def test_what_is_lacking_has_its_reason() -> None:
    lacking = {item.axis: item.verdict for item in fits(False).lacking}
    assert lacking == {
        "X": "not observable",
        "Y": "not observable",
        "K": "not commanded",
        "M": "not commanded",
    }


def test_fixes_that_are_too_coarse_are_why_surge_is_lacking() -> None:
    """A remedy that asks for fixes where there are some would mislead."""
    coarse = f"position fixes (usbl.csv): noise 0.5 m, 70% of what is there: {TOO_COARSE}. Surge"
    dive = leg(normalised=True)
    noted = replace(dive, windows=dive.windows.model_copy(update={"notes": [coarse]}))
    fitted = fit_all({"one": noted}, vehicle("bluerov2_heavy"), FitOptions(axes=("X",)))
    surge = fitted.lacking[0]
    assert surge.words.endswith(f"noise 0.5 m, 70% of what is there: {TOO_COARSE}")
    assert "finer" in lacking_axis(surge).remedy
    assert "finer" not in lacking_axis(fits(False).lacking[0]).remedy


def test_a_run_that_is_lost_has_words_in_place_of_a_fit_in_percent() -> None:
    lost = HeldOutFit("leg two", -1506369.0, 3, -1506369.0)
    one, *others = fits(False).fitted
    item = replace(
        one, held_out=(lost, HeldOutFit("even windows", float("nan"), 2)), training_percent=-5e5
    )
    fitted = replace(fits(False), fitted=(item, *others))
    card = card_of(fitted, vehicle("bluerov2_heavy"))
    printed = str(fit_section(fitted, card))
    assert "leg two below -100 %; even windows not judged" in printed
    assert "1506369" not in printed
    assert "500000" not in printed


@pytest.mark.parametrize(
    ("axis", "verdict", "word"),
    [
        ("Y", "not observable", "DVL"),
        ("Y", "not predicted", "marker frame turned"),
        ("Y", "not predicted", "another neutral of a command, or markers at another place"),
        ("N", "not excited", "Drive"),
        ("M", "not predicted", "Tilt"),
        ("K", "not commanded", "Tilt"),
        ("Y", "not commanded", "where no thruster acts"),
        ("X", "wrong sign", "directions"),
    ],
)
def test_a_sensor_is_asked_for_only_where_it_is_missing(
    axis: str, verdict: LackingVerdict, word: str
) -> None:
    assert word in lacking_axis(Lacking(axis, verdict, "")).remedy


def test_the_file_simulates_what_was_fitted() -> None:
    """A step of 20 N down settles where damping balances it."""
    body = vehicle("bluerov2_heavy")
    model = auvid.Model(file_of(card_of(fits(False), body), fits(False), body))
    assert model.axes == ("Z", "N")
    assert model.recommended
    assert "heave and yaw only" in model.use
    time = np.arange(0.0, 30.0, 0.02)
    motion = model.simulate(time, [0, 0, 20.0, 0, 0, 0])
    linear, quadratic, _ = TRUTH["Z"]
    speed = motion["w_m_s"].iloc[-1]
    # Net weight of the vehicle file is in d, which the twin does not have.
    assert -linear * speed - quadratic * speed**2 == pytest.approx(20.0, rel=0.05)


def test_without_newtons_nothing_is_in_newtons() -> None:
    body, fitted = vehicle("bluerov2_heavy"), fits(True)
    card = card_of(fitted, body)
    part = card.partial
    assert part is not None
    assert part.unit_of_mass == "Z"
    assert card.inertia == []
    # Yaw counts in the inertia of heave, by a ratio that nobody measured.
    yaw, heave = card.axes["N"].terms[0], card.axes["Z"].terms[0]
    assert yaw.assumed_shifts[INERTIA_RATIO] > 0.3 * abs(yaw.value or 0.0)
    assert INERTIA_RATIO not in heave.assumed_shifts
    filed = {item.symbol: item for item in file_of(card, fitted, body).coefficients}
    assert filed["N_r"].interval_95_total is not None
    assert filed["N_r"].interval_95 is not None
    assert np.ptp(filed["N_r"].interval_95_total) > 2.0 * np.ptp(filed["N_r"].interval_95)
    assert "yaw ±" in str(fit_section(fitted, card))
    units = [item.unit for axis in card.axes.values() for item in axis.terms]
    units += [item.unit for item in part.without_newtons] + [item.unit for item in part.gains]
    assert not any("N" in unit or "kg" in unit for unit in units)
    words = str(fit_section(fitted, card))
    assert " N s" not in words
    assert " kg" not in words
    linear, _, inertia = TRUTH["Z"]
    assert values(card, "Z")["w"] == pytest.approx(linear / inertia, rel=0.02)
    steady = next(item for item in part.without_newtons if "steady" in item.quantity)
    force = -TRUTH["Z"][0] * steady.value - TRUTH["Z"][1] * steady.value**2
    assert force == pytest.approx(FULL["Z"], rel=0.02)


def test_commands_determine_gains_drag_and_time_constants_to_two_percent() -> None:
    """At the RMS speed of the legs; other seeds and noise: benchmarks/commands_twin."""
    gains = {}
    for item in fits(True).fitted:
        a, b, gains[item.axis] = item.equation.values[:3]
        linear, quadratic, inertia = TRUTH[item.axis]
        v = item.rate_rms
        assert (a + b * v) * inertia == pytest.approx(linear + quadratic * v, rel=0.02)
        assert (a + 2 * b * v) * inertia == pytest.approx(linear + 2 * quadratic * v, rel=0.02)
    truth = {axis: FULL[axis] / TRUTH[axis][2] for axis in "ZN"}
    assert gains["N"] / gains["Z"] == pytest.approx(truth["N"] / truth["Z"], rel=0.02)


@pytest.mark.parametrize(("sign", "axis"), [(-1.0, "Z"), (-1.0, "N")])
def test_a_force_of_the_wrong_sign_is_named(sign: float, axis: str) -> None:
    """With the inertia given, the fit cannot turn the force round by itself."""
    right = leg()
    force = {**right.record.force, axis: sign * right.record.force[axis]}
    wrong = replace(right, record=replace(right.record, force=force))
    options = replace(FREE, given_inertia=("Z", "N"), axes=(axis,))
    fitted = fit_all({"one": wrong}, vehicle("bluerov2_heavy"), options)
    lacking = {item.axis: item for item in fitted.lacking}
    assert lacking[axis].verdict == "wrong sign"
    assert "another clock than the motion, or the sign of the command" in lacking[axis].words
    assert lacking["Z" if axis == "N" else "N"].verdict == "left out"
    assert "stages.fit_axes.axes" in lacking["Z" if axis == "N" else "N"].words


@pytest.mark.parametrize("tied", [False, True])
def test_one_bollard_pull_turns_all_into_newtons(tied: bool) -> None:
    """Coefficients as with newtons to 1 %, and the error of the pull in the intervals."""
    body = replace(vehicle("bluerov2_heavy"), spreads={"thrust": 0.1})
    pulled = replace(
        fits(True),
        full_force={"Z": FULL["Z"]},
        full_thrust={"Z": FULL["Z"], "N": FULL["N"]} if tied else {},
    )
    card, truth = card_of(pulled, body), card_of(fits(False), body)
    for axis in "ZN" if tied else "Z":
        for term, value in values(truth, axis).items():
            if term != "constant":
                assert values(card, axis)[term] == pytest.approx(value, rel=0.01)
    heave = card.axes["Z"].terms[0]
    assert heave.standard_error is not None
    assert heave.standard_error > 0.1 * abs(heave.value or 0.0)
    assert heave.unit == "N s/m"
    unstated = card_of(pulled, replace(body, spreads={})).axes["Z"].terms[0]
    assert 0.05 * abs(heave.value or 0.0) < (unstated.standard_error or 0.0) < heave.standard_error
    assert card.partial is not None
    assert card.partial.scale is not None
    assert card.partial.scale.value == FULL["Z"]
    vehicle_of(file_of(card, pulled, body))  # dynamics follow from vehicle and inertia
    # The mass of the file does it, too: as far as that is the truth, and with its error.
    weighed = scaled(pulled, body, by="mass", inertia_sd=0.3)
    assert weighed.scale is not None
    assert 0.1 < weighed.scale.relative_sd < 0.3  # mass and added mass are assumed
    ratio = apparent_inertia(body, "Z") / TRUTH["Z"][2]
    for axis in "ZN" if tied else "Z":
        own = scaled(fits(False), body, by="pull").forces[axis]
        expected = ratio * np.append(own.values[:2], own.inertia)
        weighed_here = np.append(weighed.forces[axis].values[:2], weighed.forces[axis].inertia)
        assert weighed_here == pytest.approx(expected, rel=0.02)
    if not tied:
        assert weighed.inertias["N"].relative_sd > 0.15


def test_a_normalised_file_moves_as_the_one_in_newtons() -> None:
    body = vehicle("bluerov2_heavy")
    time = np.arange(0.0, 20.0, 0.02)
    command = np.where(time > 5.0, 0.3, -0.2)
    tau = np.zeros((len(time), 6))
    tau[:, 2] = FULL["Z"] * command
    one = auvid.Model(file_of(card_of(fits(False), body), fits(False), body)).simulate(time, tau)
    other = auvid.Model(file_of(card_of(fits(True), body), fits(True), body)).simulate(
        time, commands={"Z": command}
    )
    np.testing.assert_allclose(other["w_m_s"], one["w_m_s"], atol=0.01)


def test_axes_from_the_shelf_are_marked() -> None:
    body, fitted = vehicle("bluerov2_heavy"), fits(False)
    card = card_of(fitted, body, {"surge": "bluerov2_wu_2018", "heave": "bluerov2_wu_2018"})
    surge = card.axes["X"].terms
    assert {item.verdict for item in surge} == {"from the shelf"}
    assert all("bluerov2_wu_2018" in (item.source or "") for item in surge)
    assert {item.verdict for item in card.axes["Z"].terms} != {"from the shelf"}  # the logs' own
    file = file_of(card, fitted, body)
    assert auvid.Model(file).axes == ("X", "Z", "N")
    entry = next(item for item in file.coefficients if item.axis == "X")
    assert not entry.determined
    assert entry.source is not None
    assert "surge from elsewhere" in file.use.sentence


def test_a_filled_axis_without_newtons_keeps_damping_over_inertia() -> None:
    body = vehicle("bluerov2_heavy")
    card = card_of(fits(True), body, {"surge": "bluerov2_wu_2018"})
    other = load_published(shelf_files()["bluerov2_wu_2018"], named_in="a test")
    term = card.axes["X"].terms[0]
    published = other.published[f"X_{term.term.replace('*', '')}"].value
    ratio = apparent_inertia(body, "X") / apparent_inertia(body, "Z")
    assert term.value == pytest.approx(published / apparent_inertia(other, "X") * ratio)


def test_a_source_without_the_axis_is_refused() -> None:
    body = vehicle("bluerov2_heavy")
    bare = replace(body, published={})
    with pytest.raises(CampaignError, match="has no damping in sway"):
        filled_axes(
            {"sway": "bare"}, FillSources({"bare": bare}, {}), fitted=(), vehicle=body,
            unit_of_mass=None,
        )  # fmt: skip


def test_what_does_not_predict_is_weak_and_for_nothing() -> None:
    body = vehicle("bluerov2_heavy")
    bad = tuple(
        replace(item, held_out=(HeldOutFit("even windows", 12.0, 3),))
        for item in fits(False).fitted
    )
    fitted = replace(fits(False), fitted=bad)
    card = card_of(fitted, body)
    assert "identified" not in {t.verdict for axis in card.axes.values() for t in axis.terms}
    assert ranking(card, fitted).choice is None
    file = file_of(card, fitted, body)
    assert not file.use.recommended
    assert "use it for nothing" in file.use.sentence


def test_a_force_of_the_wrong_sign_gives_no_axis() -> None:
    """1 / c has no value where c is at its bound of 0."""
    right = leg(seconds=40.0)
    turned = {axis: -force for axis, force in right.record.force.items()}
    wrong = LegData(replace(right.record, force=turned), right.windows)
    fitted = fit_all({"one": wrong}, vehicle("bluerov2_heavy"), FREE)
    assert not fitted.fitted
    assert "the way that its force pushes" in {i.axis: i.words for i in fitted.lacking}["N"]


def test_newtons_and_full_commands_are_not_pooled() -> None:
    legs = {"one": leg(seconds=40.0), "two": leg(seconds=40.0, seed=2, normalised=True)}
    with pytest.raises(DataError, match=r"some legs have forces in newtons.*full commands in two"):
        fit_all(legs, vehicle("bluerov2_heavy"), FREE)


def test_full_commands_that_differ_between_legs_tie_no_axes() -> None:
    one, two = (leg(seconds=40.0, seed=seed, normalised=True) for seed in (1, 2))
    tied = replace(one, windows=one.windows.model_copy(update={"full_thrust": {"Z": 2, "N": 1}}))
    options = replace(FREE, axes=("N",))
    assert fit_all({"one": tied}, vehicle("bluerov2_heavy"), options).full_thrust
    assert not fit_all({"one": tied, "two": two}, vehicle("bluerov2_heavy"), options).full_thrust


def test_the_surge_term_flies_validation_legs_too() -> None:
    legs = {"one": leg(seconds=40.0), "check": leg(seconds=40.0, seed=3, use="validation")}
    options = replace(FREE, axes=("Z",), surge_in_heave=True)
    (heave,) = fit_all(legs, vehicle("bluerov2_heavy"), options).fitted
    assert heave.whole_legs["check"] > 60.0


def test_a_force_that_follows_surge_is_in_heave_where_that_flies_better() -> None:
    """A quarter of the force ahead pushes down; where none does, none is fitted."""
    twin, random = leg(seconds=40.0), np.random.default_rng(7)
    ahead = np.repeat(random.uniform(-60.0, 60.0, 21), 40)[: twin.record.t_s.size]
    pushed = replace(twin.record, force={**twin.record.force, "X": ahead})
    down = pushed.force["Z"] - 0.25 * surge_input(pushed)
    follows = replace(pushed, force={**pushed.force, "Z": down})
    options, body = replace(FREE, axes=("Z",)), vehicle("bluerov2_heavy")
    plain, taken = (
        fit_all({"one": replace(twin, record=record)}, body, options).fitted[0]
        for record in (pushed, follows)
    )
    assert plain.surge is None
    assert taken.surge is not None
    assert taken.surge.value("surge") / taken.surge.value("force") == pytest.approx(0.25, abs=0.05)
    assert any("surge_in_heave" in note for note in taken.notes)


@pytest.mark.parametrize("first", ["depth", "velocity"])
def test_legs_with_and_without_a_velocity_log_are_judged_by_what_each_has(first: str) -> None:
    one, two = leg(seconds=40.0), leg(seconds=40.0, seed=2)
    assert two.record.depth_m is not None
    w = np.gradient(two.record.depth_m, two.record.t_s)
    record = replace(two.record, rate={**two.record.rate, "w": w}, depth_m=None)
    legs = {"depth": one, "velocity": LegData(record, two.windows)}
    ordered = {key: legs[key] for key in sorted(legs, reverse=first == "velocity")}
    (heave,) = fit_all(ordered, vehicle("bluerov2_heavy"), replace(FREE, axes=("Z",))).fitted
    assert heave.per_leg["depth"][0] > 80.0
    assert np.isfinite(heave.per_leg["velocity"][0])


def test_held_out_windows_without_motion_judge_nothing() -> None:
    item = fits(False).fitted[0]
    still = HeldOutFit("even windows", float("nan"), 3)
    both = replace(item, held_out=(still, HeldOutFit("odd windows", 90.0, 3)))
    assert both.held_out_percent == 90.0
    assert replace(item, held_out=(still,)).held_out_percent is None


def test_axes_that_are_never_fitted_together_have_no_coriolis_force() -> None:
    """Nobody judged it."""
    body, separate = vehicle("bluerov2_heavy"), fits(False)
    never = replace(FREE, together="never")
    _, together = fitted_together(separate.fitted, {}, body, never, separate.commands)
    assert together is not None
    fitted = replace(separate, together=together)
    document = file_of(card_of(fitted, body), fitted, body)
    assert document.partial is not None
    assert document.partial.together is not None
    assert not document.partial.together.chosen
    assert "no Coriolis force" in together_words(together)


def test_an_axis_that_tells_no_lag_has_that_of_the_others() -> None:
    """Depth with waves of 5 cm leaves heave its lag; yaw shows .08 s, as the thrusters have."""
    quiet = leg(seconds=80.0)
    waves = 0.05 * np.random.default_rng(4).standard_normal(len(quiet.record.t_s))
    assert quiet.record.depth_m is not None
    rough = replace(quiet, record=replace(quiet.record, depth_m=quiet.record.depth_m + waves))
    fitted = fit_all({"one": rough}, vehicle("bluerov2_heavy"), FitOptions(lag_s=0.02))
    heave, yaw = fitted.fitted
    assert yaw.lag_verdict == "identified"
    assert yaw.lag_s == pytest.approx(0.08, abs=0.01)
    assert heave.lag_verdict == "assumed"
    assert heave.lag_s == yaw.lag_s
    assert any("the lag is that of yaw" in note for note in heave.notes)
    assert shared_lag([heave, replace(yaw, lag_verdict="assumed")], 0.05) is None
    assert shared_lag([yaw], 0.05) is None


def test_a_late_depth_makes_no_late_thrusters() -> None:
    """Depth shows .3 s, of which half is the barometer's: yaw is not known to have it all."""
    late, assumed = {"lag_verdict": "identified"}, {"lag_verdict": "assumed"}
    heave, yaw = fits(False).fitted
    heave, yaw = replace(heave, lag_s=0.30, lag_error_s=0.02, **late), replace(yaw, **assumed)
    shared = shared_lag([heave, yaw], 0.05)
    assert shared is not None
    assert shared[0] - 0.15 == pytest.approx(0.0, abs=shared[1])
    assert shared[1] > 0.05  # what no inertia is determined beside
    by_log = replace(heave, measured_by="velocity log")
    assert shared_lag([by_log, yaw], 0.05) == pytest.approx((0.30, 0.02))


def test_depth_tells_of_a_lag_beside_a_yaw_that_hardly_tells_it() -> None:
    """Of 32 dives yaw inertia came out nearer so (decision 0134)."""
    heave, yaw = fits(False).fitted
    heave = replace(heave, lag_verdict="assumed", lag_told_s=(0.2, 0.04))
    yaw = replace(yaw, lag_verdict="weak", lag_s=0.09, lag_error_s=0.07, lag_told_s=(0.12, 0.1))
    late = 0.04**2 + 0.1**2
    expected = (0.05 / 0.1**2 + 0.2 / late) / (0.1**-2 + late**-1)
    shared = shared_lag([heave, yaw], 0.05)
    assert shared == pytest.approx((expected, (0.1**-2 + late**-1) ** -0.5))
    assert shared_lag([replace(heave, lag_told_s=None), yaw], 0.05) is None
    noisy = leg(seconds=40.0)
    noise = 0.3 * np.random.default_rng(3).standard_normal(len(noisy.record.t_s))
    rate = {**noisy.record.rate, "r": noisy.record.rate["r"] + noise}
    noisy = replace(noisy, record=replace(noisy.record, rate=rate))
    heave, yaw = fit_all({"one": noisy}, vehicle("bluerov2_heavy"), FitOptions()).fitted
    by_depth, own = shared_lag([heave, yaw], 0.05), yaw.lag_told_s
    assert by_depth is not None
    assert own is not None
    weights = by_depth[1] ** -2.0, own[1] ** -2.0
    assert yaw.lag_s == pytest.approx(np.average([by_depth[0], own[0]], weights=weights))
    assert any("the assumed lag is between that of heave" in words for words in yaw.notes)


def test_the_lag_of_a_rate_counts_before_that_of_depth() -> None:
    """What a tilted hull climbs is in depth: of twins its lag came out a third short."""
    late, both = {"lag_verdict": "identified"}, []
    for lag_s, error_s in ((0.16, 0.005), (0.24, 0.03)):
        item = fits(False).fitted[len(both)]
        both.append(replace(item, lag_s=lag_s, lag_error_s=error_s, **late))
    heave, yaw = both
    assert (heave.measured_by, yaw.measured_by) == ("depth", "gyro")
    assert shared_lag([heave, yaw], 0.05) == pytest.approx((0.24, 0.03))
    assert shared_lag([replace(heave, measured_by="velocity log"), yaw], 0.05) is None


def left_out(**percent: float) -> FittedAxis:
    """Return heave of the made-up dive, flown to these percentages where it was not fitted."""
    heave = next(item for item in fits(False).fitted if item.axis == "Z")
    held_out = tuple(HeldOutFit(what.replace("_", " "), own, 5) for what, own in percent.items())
    return replace(heave, held_out=held_out)


def test_a_validation_dive_that_moves_unlike_the_training_legs_is_named() -> None:
    unlike = left_out(even_windows=70.0, odd_windows=63.0, validation_leg_check=30.0)
    (words,) = unlike_validation(unlike)
    assert "validation leg check is flown to 30 %" in words
    assert "63 % and more" in words
    assert not unlike_validation(left_out(odd_windows=63.0, validation_leg_check=40.0))
    assert not unlike_validation(left_out(odd_windows=20.0, validation_leg_check=5.0))


def test_dives_that_are_each_flown_but_not_by_the_other_are_to_be_parted() -> None:
    lost = left_out(even_windows=9.0, odd_windows=44.0, leg_one=29.0, leg_two=-144.0)
    assert "one dive does not tell the other. Give each dive a campaign" in dives_apart(lost)
    words = "Heave: the dives differ by more than chance in drag (largest over smallest 3.2): mean"
    assert "more than chance in drag (largest over smallest 3.2). Give" in dives_apart(
        replace(lost, warnings=(words,))
    )
    assert not dives_apart(left_out(even_windows=-5.0, odd_windows=44.0, leg_two=-144.0))


def test_a_vehicle_that_creeps_has_linear_drag_alone() -> None:
    options = replace(FREE, axes=("Z",), linear_drag=("Z",))
    legs = {"one": leg(seconds=40.0)}
    (heave,) = fit_all(legs, vehicle("bluerov2_heavy"), options).fitted
    both = next(item for item in fits(False).fitted if item.axis == "Z")
    assert heave.equation.value("w*|w|") == 0.0 > both.equation.value("w*|w|")
    assert heave.equation.value("w") < both.equation.value("w") < 0.0
