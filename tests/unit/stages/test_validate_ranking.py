"""The ranking of models: merits axis by axis, the model to take, and what for."""

from __future__ import annotations

import math
from typing import Any

import pytest

from auvid.data_schemas.records.likelihood import LikelihoodFit
from auvid.data_schemas.records.models import ModelCard, MotionCheck, RankingRecord, SteadyRange
from auvid.stages.form_evidence import pushing_axes, reference_model
from auvid.stages.model_file.contents import use_entry
from auvid.stages.model_use import (
    damping_verdict,
    form_words,
    growth_words,
    recommendation,
    usable_for,
    use_words,
)
from auvid.stages.validate.presentation import form_blocks
from auvid.stages.validate.ranking import (
    free_run_ratios,
    rank,
    resting_velocities,
)
from tests.support.example_run import AXES, ExampleRun, example_run, with_own_damping

NAMES = (
    *(f"{name}_rms_m_s" for name in "uvw"),
    *(f"{name}_rms_rad_s" for name in "pqr"),
    *(f"{name}_rms_rad" for name in ("phi", "theta", "psi")),
)
ALWAYS = (0.1,) * 9


@pytest.fixture
def run() -> ExampleRun:
    return example_run({"train": 4.0, "check": 2.0})


def rows(
    model: str, errors: tuple[float, ...], lost: int = 0, *, rest: float = 0.4
) -> list[dict[str, Any]]:
    head = {"segment": "check", "as_measured": "", "horizon_s": 10.0, "starts": 4}
    return [
        {**head, "model": model, "diverged": lost, **dict(zip(NAMES, errors, strict=True))},
        {**head, "model": "persistence", "diverged": 0, **dict.fromkeys(NAMES, 0.2)},
        {**head, "model": "rest", "diverged": 0, **dict.fromkeys(NAMES, rest)},
    ]


def ranked(run: ExampleRun, free_run: list[dict[str, Any]] | None = None) -> RankingRecord:
    return rank(run.cards, run.errors, free_run or [], {})


def set_sse(run: ExampleRun, errors: dict[str, float]) -> None:
    for row in run.errors:
        if row["use"] == "training" and row["model"] in errors:
            row["sse"] = errors[row["model"]]


def test_runs_are_held_against_the_better_of_no_change_and_no_motion() -> None:
    """No change errs .2: a vehicle that is guessed to stand still by .1 is the better guess."""
    for rest, ratio in ((0.4, 0.75), (0.1, 1.5)):
        _, ratios = free_run_ratios(rows("good", (0.15,) * 9, rest=rest))
        assert ratios["good"] == pytest.approx(dict.fromkeys(("all", *AXES), ratio))


def test_a_rotation_is_of_use_only_with_its_angle() -> None:
    """Roll rate is better than no change, but roll angle is worse."""
    horizon, ratios = free_run_ratios(rows("good", (0.1, 0.1, 0.3, 0.1, 0.1, 0.1, 0.3, 0.1, 0.1)))
    assert horizon == 10.0
    assert ratios["good"]["K"] == pytest.approx(1.5)
    better = [axis for axis in AXES if ratios["good"][axis] < 1.0]
    assert better == ["X", "Y", "M", "N"]


def test_the_bic_counts_samples_as_the_blocks_of_its_card_do(run: ExampleRun) -> None:
    """A term more for two per cent less error: worth it where each sample counts as one."""
    for name, card in run.cards.items():
        better = name == "fossen"
        axes = {**card.axes, "X": card.axes["X"].model_copy(update={"rank": 3 + better})}
        run.cards[name] = card.model_copy(update={"axes": axes})
        for item in run.errors:
            if (item["model"], item["axis"], item["use"]) == (name, "X", "training"):
                item["sse"], item["samples"] = 980.0 if better else 1000.0, 2000
    worth = {m.name: m.axes["X"].bic for m in ranked(run).models}
    assert worth["fossen"] == 0.0
    for name, card in run.cards.items():
        part = card.axes["X"].model_copy(update={"samples_per_one": 100.0})
        run.cards[name] = card.model_copy(update={"axes": {**card.axes, "X": part}})
    by_blocks = {m.name: m.axes["X"].bic for m in ranked(run).models}
    assert by_blocks["fossen"] == pytest.approx(math.log(20.0) + 20.0 * math.log(0.98))


def test_with_one_leg_the_bic_chooses_and_the_record_says_so(run: ExampleRun) -> None:
    set_sse(run, dict.fromkeys(run.cards, 900.0) | {"prestero": 100.0})
    record = ranked(run)
    assert record.choice == "prestero"
    assert record.legs_left_out == 0
    assert "one training leg leaves none to leave out" in record.rule
    merit = {model.name: model.axes["all"] for model in record.models}
    assert merit["prestero"].bic == 0.0
    assert merit["coe"].bic > 100.0
    assert merit["coe"].left_out is None


def test_left_out_legs_choose_where_there_are_some(run: ExampleRun) -> None:
    for name, card in run.cards.items():
        error = 0.2 if name == "coe" else 0.4
        held_out = {leg: dict.fromkeys(("all", *AXES), error) for leg in ("one", "two", "three")}
        run.cards[name] = card.model_copy(update={"held_out": held_out})
    set_sse(run, {"prestero": 1.0})
    record = ranked(run)
    assert record.choice == "coe"
    assert record.legs_left_out == 3
    assert next(m for m in record.models if m.name == "coe").axes["X"].left_out == pytest.approx(
        0.2
    )
    assert record.simulate_with is None
    assert "to simulate with" not in record.rule
    flown = rows("coe", (0.3,) * 9) + rows("prestero", (0.1,) * 9)[:1]
    words = "; Prestero is the one to simulate with: its free runs err 0.50 times"
    other = ranked(run, flown)
    assert words in other.rule
    merit = next(m for m in other.models if m.name == "coe")
    _, headline, _ = recommendation(other, merit, judged=True)
    assert headline.startswith("Coe: use it to predict forces")
    assert ", and Prestero to simulate" in headline
    assert [use_entry(other, merit, run.cards[name]).sentence for name in ("coe", "prestero")] == [
        headline,
        f"Prestero: {use_words(usable_for(merit, run.cards['prestero']), flown=True)}; take coe to"
        " predict forces",
    ]
    near = rows("coe", (0.15,) * 9) + rows("prestero", (0.1,) * 9)[:1]
    assert "to simulate with" not in ranked(run, near).rule


@pytest.mark.parametrize(
    ("force", "motion", "agree", "choice", "words"),
    [
        (0.2, 0.05, None, "coe_filter_error", "replaces it: sound, and nearer"),
        (0.4, 0.05, None, "coe", "does not replace it: force error on the validation legs 0.40"),
        (0.2, 0.15, None, "coe", "does not replace it: free runs on the validation legs 0.75 for"),
        (0.4, 0.15, True, "coe_filter_error", "replaces it: its windows agree"),
        (0.4, 0.15, False, "coe", "does not replace it: force error on the validation legs 0.40"),
    ],
)
def test_a_fit_to_the_sensors_is_judged_by_validation_where_one_leg_trains(
    run: ExampleRun, force: float, motion: float, agree: bool | None, choice: str, words: str
) -> None:
    """One whose windows agree has nothing left to explain, and is taken for its intervals."""
    name = "coe_filter_error"
    run.cards[name] = refined(run.cards["coe"], name, agree)
    set_sse(run, {"coe": 1.0})
    own = [row for row in run.errors if row["model"] == "coe"]
    run.errors += [{**row, "model": name, "sse": 500.0} for row in own]
    for row in run.errors:
        if row["use"] == "validation" and row["model"] in ("coe", name):
            row["ratio"] = force if row["model"] == name else 0.3
    record = ranked(run, [*rows("coe", ALWAYS), *rows(name, (motion,) * 9)[:1]])
    assert record.choice == choice
    assert words in record.rule


@pytest.mark.parametrize(
    ("agree", "own_error", "choice"),
    [
        (None, 0.2, "coe_filter_error"),
        (None, 0.41, "coe"),
        (False, 0.41, "coe"),
        (True, 0.41, "coe_filter_error"),
    ],
)
def test_a_fit_to_the_sensors_competes_on_left_out_legs(
    run: ExampleRun, agree: bool | None, own_error: float, choice: str
) -> None:
    run.cards["coe_filter_error"] = refined(run.cards["coe"], "coe_filter_error", agree)
    own = [row for row in run.errors if row["model"] == "coe"]
    run.errors += [{**row, "model": "coe_filter_error"} for row in own]
    set_sse(run, {"coe": 1.0, "coe_filter_error": 1.0})
    for name, card in run.cards.items():
        error = {"coe_filter_error": own_error, "coe": 0.4}.get(name, 0.6)
        held_out = {leg: dict.fromkeys(("all", *AXES), error) for leg in ("one", "two")}
        run.cards[name] = card.model_copy(update={"held_out": held_out})
    assert ranked(run).choice == choice


@pytest.mark.parametrize(
    ("agree", "sse", "choice"),
    [(True, 0.1, "prestero_output_error"), (False, 0.1, "coe"), (True, 9.0, "coe")],
)
def test_a_form_that_misses_nothing_stands_before_a_simpler_one(
    run: ExampleRun, agree: bool, sse: float, choice: str
) -> None:
    """Left-out legs cannot tell them apart; where the force speaks for it, sensors decide."""
    name = "prestero_output_error"
    run.cards[name] = refined(run.cards["prestero"], name, agree)
    run.errors += [{**row, "model": name} for row in run.errors if row["model"] == "prestero"]
    set_sse(run, {"coe": 1.0, "prestero": sse, name: sse})
    for other, card in run.cards.items():
        error = 0.4 if other == "coe" else 0.5 if other.startswith("prestero") else 0.6
        held_out = {leg: dict.fromkeys(("all", *AXES), error) for leg in ("one", "two")}
        run.cards[other] = card.model_copy(update={"held_out": held_out})
    record = ranked(run)
    assert record.choice == choice
    assert ("misses nothing that the sensors show" in record.rule) == (choice == name)


def refined(card: ModelCard, name: str, agree: bool | None) -> ModelCard:
    fit = LikelihoodFit.model_construct(
        started_from=card.name, lag=None, force_time_s=None, windows_agree=agree
    )
    return card.model_copy(update={"name": name, "likelihood": fit})


def test_a_model_of_which_runs_are_lost_stands_back(run: ExampleRun) -> None:
    set_sse(run, {"prestero": 1.0, "coe": 2.0})
    lost = ranked(run, [*rows("prestero", ALWAYS, lost=2), *rows("coe", ALWAYS)[:1]])
    assert lost.choice == "coe"
    by_name = {model.name: model for model in lost.models}
    assert by_name["prestero"].faults == ["2 of 4 free runs are lost"]
    assert lost.usable is not None
    assert lost.usable.simulation == ["X", "Y", "N"], (
        "nothing damps roll and pitch, nothing excites the damping of heave"
    )


@pytest.mark.parametrize("verdict", ["identified", "from the prior"])
def test_roll_and_pitch_are_simulated_with_known_damping_and_no_tipping(
    run: ExampleRun, verdict: str
) -> None:
    set_sse(run, {"coe": 1.0})
    for row in run.errors:
        if row["model"] == "coe" and row["use"] == "validation":
            row["ratio"] = 0.3
    run.cards["coe"] = with_own_damping(run.cards["coe"], verdict, "YZKMN")
    usable = ranked(run, rows("coe", ALWAYS)).usable
    assert usable is not None
    assert usable.simulation == list(AXES)
    assert usable.under_attitude_hold == []
    record = rank(
        run.cards,
        run.errors,
        rows("coe", ALWAYS),
        {},
        check=lambda names: dict.fromkeys(names, tipping("Y")),
    )
    assert record.choice == "coe"
    assert record.usable is not None
    assert record.usable.simulation == ["X", "Z", "N"], "it tips over in sway"
    assert record.usable.under_attitude_hold == ["Y"]
    assert use_words(record.usable, flown=True) == (
        "use it to predict forces and to simulate surge, heave and yaw, under attitude hold sway,"
        " not roll and pitch"
    )
    expected = ["X", "Z", "N"] if verdict == "identified" else ["X"]
    assert record.usable.control == expected, "it tips over in sway"


def tipping(axis: str) -> MotionCheck:
    """Return a check in which the thrusters tip the vehicle over along an axis."""
    return motion(tips_in={axis: "roll"})


def motion(
    *, tips_in: dict[str, str] | None = None, grows_on: dict[str, str] | None = None, lost: int = 0
) -> MotionCheck:
    """Return a check of four drives, with what tips over and grows by the driven axis."""
    tips, grows = tips_in or {}, grows_on or {}
    ranges = [
        SteadyRange.model_construct(
            axis=name,
            drive="thrusters",
            tips_in=tips.get(name, ""),
            grows_on=grows.get(name, ""),
            growth_1_s=0.3 if name in grows else -0.1,
        )
        for name in "XYZN"
    ]
    return MotionCheck.model_construct(ranges=ranges, decays_lost=lost)


@pytest.mark.parametrize(
    ("check", "control", "kept"),
    [
        (motion(), ["X", "Y", "Z", "N"], ""),
        (motion(grows_on={"X": "Z"}), ["X", "Y", "N"], "heave, which another controller has"),
        (motion(grows_on={"X": "K"}), ["X", "Y", "Z", "N"], "roll, which attitude hold has"),
        (motion(grows_on={"N": "N"}), ["X", "Y", "Z"], ""),
        (motion(lost=1), [], ""),
    ],
)
def test_no_controller_for_an_axis_that_is_unstable_by_itself(
    run: ExampleRun, check: MotionCheck, control: list[str], kept: str
) -> None:
    """Heave that grows at speeds of surge has none; after a lost decay none has."""
    set_sse(run, {"coe": 1.0})
    for row in run.errors:
        if row["model"] == "coe" and row["use"] == "validation":
            row["ratio"] = 0.3
    run.cards["coe"] = with_own_damping(run.cards["coe"], "identified", "YZN")
    record = rank(
        run.cards,
        run.errors,
        rows("coe", ALWAYS),
        {},
        check=lambda names: dict.fromkeys(names, check),
    )
    assert record.usable is not None
    assert record.usable.simulation == ["X", "Y", "Z", "N"]
    assert record.usable.control == control
    words = growth_words(record.models[0], control)
    assert kept in words
    assert bool(kept) is bool(words)


def test_free_runs_that_tip_over_are_a_fault(run: ExampleRun) -> None:
    """They stay within all bounds of velocity, so none of them is lost."""
    set_sse(run, {"prestero": 1.0, "coe": 2.0})
    rolled = (*ALWAYS[:6], 1.2, *ALWAYS[7:])
    record = ranked(run, [*rows("prestero", rolled), *rows("coe", ALWAYS)[:1]])
    assert record.choice == "coe"
    faults = {model.name: model.faults for model in record.models}
    assert faults["prestero"] == ["free runs tip over (error 69 degrees)"]
    assert faults["coe"] == []


def test_nothing_is_chosen_where_no_model_beats_no_force(run: ExampleRun) -> None:
    for row in run.errors:
        if row["axis"] == "all":
            row["ratio"] = 1.2
    record = ranked(run)
    assert record.choice is None
    assert record.usable is None


def test_damping_that_gives_energy_is_a_fault(run: ExampleRun) -> None:
    coe = run.cards["coe"]
    pushing = {"K": {"p": 2.9, "constant": -5.0}, "N": {"r": -4.0, "r*|r|": 3.0}}
    card = coe.model_copy(update={"predictor": pushing})
    assert pushing_axes(card) == ["K"], "at .5 rad/s yaw still loses energy"
    run.cards["coe"] = card
    by_name = {model.name: model for model in ranked(run).models}
    assert by_name["coe"].faults == ["K damping gives energy"]


@pytest.mark.parametrize(("slowest", "pushing"), [(0.7, []), (-0.7, ["Y"])])
def test_lift_ahead_damps_as_drag_does(run: ExampleRun, slowest: float, pushing: list[str]) -> None:
    """Y = 53 v|v| - 63 u v - 9 u takes energy out of sway at .7 m/s ahead, at rest it gives."""
    coe = run.cards["coe"]
    spans = {"u": {"low": slowest, "high": 2.0}, "v": {"low": -0.2, "high": 0.2}}
    conditions = coe.conditions | {
        name: coe.conditions[name].model_copy(update=span) for name, span in spans.items()
    }
    sway = {"v*|v|": 53.0, "u*v": -63.0, "u": -9.0}
    card = coe.model_copy(update={"predictor": {"Y": sway}, "conditions": conditions})
    assert pushing_axes(card) == pushing


def test_an_axis_counts_where_its_force_beats_the_mean_force_and_none(run: ExampleRun) -> None:
    """Surge errs more than its force, sway no less than the mean force, heave less than both."""
    ratios = {"X": 1.2, "Y": 0.58, "Z": 0.5}
    for row in run.errors:
        if row["use"] == "validation" and row["axis"] in ratios:
            row["ratio"] = ratios[row["axis"]]
    record = rank(run.cards, run.errors, rows("coe", ALWAYS), {}, constant={"Y": 0.6, "Z": 0.6})
    model = next(item for item in record.models if item.name == "coe")
    usable = usable_for(model, run.cards["coe"], record.constant)
    assert not {"X", "Y"} & {*usable.forces, *usable.simulation}
    assert "Z" in usable.forces
    assert "Z" not in usable.simulation, "nothing excites its damping"
    assert "in heave" in use_words(usable, flown=True)
    weak = usable_for(model, with_own_damping(run.cards["coe"], "weak", "Z"), record.constant)
    assert "Z" in weak.simulation


@pytest.mark.parametrize(
    ("term", "slowest", "verdict"),
    [
        ("u*p", 0.7, "identified"),
        ("u*p", -0.7, ""),
        ("p*|u|", -0.7, "identified"),
        ("u*|p|", 0.7, ""),
        ("p*|p|", -0.7, "identified"),
    ],
)
def test_damping_that_grows_with_the_speed_ahead_is_damping(
    run: ExampleRun, term: str, slowest: float, verdict: str
) -> None:
    """Fins of a torpedo damp roll by u p; of a vehicle that goes astern this is none."""
    card = with_own_damping(run.cards["coe"], "identified", "K")
    (item,) = (item for item in card.axes["K"].terms if item.term == "p")
    terms = [item.model_copy(update={"term": term})]
    surge = card.conditions["u"].model_copy(update={"low": slowest})
    card = card.model_copy(
        update={
            "axes": card.axes | {"K": card.axes["K"].model_copy(update={"terms": terms})},
            "conditions": card.conditions | {"u": surge},
        }
    )
    assert damping_verdict(card, "K") == verdict


def test_control_needs_damping_from_the_data_and_a_small_error(run: ExampleRun) -> None:
    for row in run.errors:
        if row["model"] == "coe" and row["use"] == "validation":
            row["ratio"] = 0.7 if row["axis"] == "Y" else 0.3
    set_sse(run, {"coe": 1.0})
    record = ranked(run, rows("coe", ALWAYS))
    assert record.choice == "coe"
    assert record.usable is not None
    # Of the made-up coefficients u alone is identified, and it is damping in surge alone.
    assert record.usable.control == ["X"]
    assert record.usable.forces == list(AXES)


def test_velocities_whose_damping_rests_on_prior_or_bound_are_named(run: ExampleRun) -> None:
    assert resting_velocities(run.cards) == "", "no model within limits"
    card = run.cards["coe"]
    axes = {
        axis: part.model_copy(
            update={
                "terms": [
                    item.model_copy(update={"verdict": "from the prior"})
                    if (axis, item.term) in (("Y", "v"), ("Z", "v"))
                    else item
                    for item in part.terms
                ]
            }
        )
        for axis, part in card.axes.items()
    }
    run.cards["coe"] = card.model_copy(update={"method": "within limits", "axes": axes})
    assert resting_velocities(run.cards) == "v"
    assert reference_model(run.cards) == "coe"


def with_axis_fits(run: ExampleRun, fits: dict[str, tuple[float, int]]) -> None:
    """Give models an error of surge and so many numbers an axis, of 2000 samples."""
    for name, (sse, numbers) in fits.items():
        card = run.cards[name]
        axes = {a: part.model_copy(update={"rank": numbers}) for a, part in card.axes.items()}
        run.cards[name] = card.model_copy(update={"axes": axes})
        for item in run.errors:
            if (item["model"], item["use"]) == (name, "training"):
                item["sse"], item["samples"] = sse if item["axis"] == "X" else 1000.0, 2000


def test_a_model_is_of_another_form_where_one_fits_clearly_better(run: ExampleRun) -> None:
    """Fossen errs less with as many terms; McFarland errs least, but with ten times more."""
    run.cards = {name: run.cards[name] for name in ("linear", "fossen", "mcfarland", "coe")}
    run.errors = [item for item in run.errors if item["model"] in run.cards]
    fits = {
        "linear": (1000.0, 6),
        "fossen": (900.0, 6),
        "mcfarland": (890.0, 60),
        "coe": (901.0, 6),
    }
    with_axis_fits(run, fits)
    merits = {item.name: item for item in ranked(run).models}
    better = {name: merit.axes["X"].better_form for name, merit in merits.items()}
    assert better == {"linear": "fossen", "fossen": None, "mcfarland": None, "coe": None}
    titles = {name: merit.title for name, merit in merits.items()}
    words = form_words(merits["linear"], titles)
    assert words.startswith("force of another form in surge (Fossen fits better)")
    assert "not for the vehicle" in words
    assert form_words(merits["fossen"], titles) == ""
    (block,) = form_blocks(list(merits.values()))
    assert block["text"] == f"Linear: {words}."
    run.cards["linear"].axes["X"].lacking.append("u*|u|")
    linear = next(item for item in ranked(run).models if item.name == "linear")
    words = form_words(linear, titles)
    assert words.startswith("force of another form in surge (lacks X_u|u|): there")


def test_a_fit_to_the_sensors_has_the_form_of_the_model_it_started_from(run: ExampleRun) -> None:
    run.cards = {name: run.cards[name] for name in ("linear", "fossen")}
    with_axis_fits(run, {"linear": (1000.0, 6), "fossen": (900.0, 6)})
    for name in ("linear", "fossen"):
        fit = LikelihoodFit.model_construct(started_from=name)
        refined = f"{name}_filter_error"
        card = run.cards[name].model_copy(update={"name": refined, "likelihood": fit})
        run.cards[refined] = card
        run.errors += [
            {**item, "model": refined, "sse": 1500.0}
            for item in run.errors
            if item["model"] == name
        ]
    merits = {item.name: item.axes["X"].better_form for item in ranked(run).models}
    assert merits["linear_filter_error"] == "fossen"
    assert merits["fossen_filter_error"] is None
