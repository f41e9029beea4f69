"""The first screen says which model to take and what is missing, and never praises what
validation does not bear out.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from auvid.data_schemas.records.likelihood import LagFit
from auvid.data_schemas.records.models import (
    DiveCurrent,
    MotionCheck,
    SteadyRange,
    VelocityRange,
)
from auvid.stages.base import collection
from auvid.stages.page.first_screen import Alert, Summary
from auvid.stages.page.html import anchor
from auvid.stages.presentation import remark
from auvid.stages.report import finding_alerts
from auvid.stages.report.summary.model_summary import NO_RANKING, summarise
from tests.support.example_run import (
    AXES,
    MODELS,
    ExampleRun,
    example_run,
    example_vehicle,
    with_own_damping,
)
from tests.support.sound_log import sound


@pytest.fixture
def run() -> ExampleRun:
    return example_run({"train": 4.0, "check": 2.0})


def summary_of(run: ExampleRun, choice: str | None = "coe") -> Summary:
    """The first screen where validate has chosen this model."""
    return summarise(
        run.cards,
        run.ranking(choice) if run.errors else NO_RANKING,
        run.segments,
        run.logs,
        run.sections,
        run.vehicle,
        {},
    )


def set_ratio(run: ExampleRun, use: str, ratios: dict[str, float], axis: str = "all") -> None:
    for row in run.errors:
        if row["use"] == use and row["axis"] == axis and row["model"] in ratios:
            row["ratio"] = ratios[row["model"]]
            row["rms"] = 4.0 * row["ratio"]


def test_the_chosen_model_is_named_with_its_use_and_the_rule(run: ExampleRun) -> None:
    set_ratio(run, "validation", {"coe": 0.2})
    first_screen = summary_of(run)
    assert first_screen.recommended == "coe"
    assert first_screen.headline.startswith("Coe: use it to predict forces")
    assert first_screen.rule.startswith("Chosen as the one of least BIC (no simpler model")
    assert [use.label for use in first_screen.uses] == [
        "Forces",
        "Simulation",
        "Control design",
        "Within",
        "Coefficients",
    ]
    assert "no free run" in first_screen.uses[1].reason
    assert first_screen.uses[-1].reason.startswith("force of another form in ")
    flows = DiveCurrent(value_m_s=[0.2, -0.1], sd_m_s=[0.01, 0.02], clear=True)
    run.cards["coe"] = run.cards["coe"].model_copy(
        update={"currents": {"dive": flows, "other": flows.model_copy(update={"clear": False})}}
    )
    water = next(use.reason for use in summary_of(run).uses if use.label == "Water")
    assert "current, 0.200 ± 0.020 m/s to the north, −0.100 ± 0.039 m/s to the east in" in water
    assert "other" not in water


def test_a_model_of_smaller_error_is_named_with_what_speaks_against_it(run: ExampleRun) -> None:
    set_ratio(run, "validation", {"mcfarland": 0.370, "fossen": 0.415})
    run.free_run = free_runs("mcfarland", lost=3)
    first_screen = summary_of(run, "fossen")
    assert (
        "McFarland & Whitcomb has a smaller error (0.37) with 216 terms, but 3 of 6 free runs are"
        " lost." in first_screen.explanation
    )
    set_ratio(run, "validation", {"mcfarland": 0.400, "fossen": 0.415})
    assert "smaller" not in summary_of(run, "fossen").explanation, "by 4 % it is as good"


def test_no_model_is_taken_when_none_beats_no_force(run: ExampleRun) -> None:
    for use in ("training", "validation"):
        set_ratio(run, use, dict.fromkeys(MODELS, 1.3))
    first_screen = summary_of(run, run.ranking().choice)
    assert first_screen.recommended is None
    assert first_screen.uses == ()
    assert first_screen.level == "poor"
    assert first_screen.headline == "Use none of these models"


def test_axis_that_fails_is_named_beside_the_model_to_take(run: ExampleRun) -> None:
    set_ratio(run, "validation", {"coe": 0.2})
    for axis in AXES:
        set_ratio(run, "validation", {"coe": 1.7 if axis == "N" else 0.2}, axis)
    first_screen = summary_of(run)
    assert first_screen.level == "fair"
    assert "it does not hold in yaw (N)" in first_screen.uses[0].reason
    assert first_screen.uses[0].axes == "surge, sway, heave, roll and pitch"


def test_good_only_when_small_everywhere(run: ExampleRun) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2}, axis)
    assert summary_of(run).level == "good"
    assert summary_of(run).headline == "Coe: use it to predict forces"


def test_axis_on_which_every_model_fails_is_missing(run: ExampleRun) -> None:
    set_ratio(run, "validation", dict.fromkeys(MODELS, 2.0), "K")
    assert any(words.startswith("No model predicts roll (K)") for words in summary_of(run).missing)


def test_overfit_is_said(run: ExampleRun) -> None:
    set_ratio(run, "validation", {"coe": 0.5})
    set_ratio(run, "training", {"coe": 0.1})
    assert (
        "Coe fits the training legs 5.0 times better than it predicts the validation legs."
        in summary_of(run).missing
    )


def test_without_validation_nothing_is_claimed(run: ExampleRun) -> None:
    run.errors = [row for row in run.errors if row["use"] == "training"]
    first_screen = summary_of(run)
    assert first_screen.judged_on == "training"
    assert first_screen.level == "poor"
    assert "nothing judges it" in first_screen.headline
    assert any("no validation leg" in words for words in first_screen.missing)


def test_without_error_table_the_page_says_so(run: ExampleRun) -> None:
    run.errors = []
    assert summary_of(run).headline == "No model was identified"


def test_missing_names_assumed_figures_axes_coefficients_and_logs(run: ExampleRun) -> None:
    run.vehicle = example_vehicle(
        rigid_body__inertia=[[0.26, 0, 0], [0, 0.23, 0], [0, 0, 0.37]],
        rigid_body__centre_of_gravity=[0, 0, -0.01],
        rigid_body__displaced_mass=13.5,
        actuators__thrusters__thrust_curve__force=[1.0] * 25,
    )
    text = "\n".join(summary_of(run).missing)
    assert "do not excite roll (K) and pitch (M): damping there is not determined" in text
    assert "hardly excite yaw (N)" in text
    assert (
        "6 are weak (size or sign is not sure), 6 are not excited and 6 cannot be told"
        " apart" in text
    )
    assert "5 figures assumed, not measured" in text
    assert "rigid body: mass 13.5 kg, displaced mass 13.5 kg" in text
    assert "inertia diag(0.26, 0.23, 0.37) kg m²" in text
    assert "centre of gravity [0, 0, −0.01] m" in text
    assert "; thrust curve: force." in text
    assert run.vehicle.document.sensors.dvl is not None
    assert "dvl" not in text, "its arm and lag are measured here"
    assert "Log dive is truncated: 0.4 s are lost." in text


def test_assumed_lag_of_the_velocity_log_is_named(run: ExampleRun) -> None:
    run.vehicle = example_vehicle(sensors__dvl__lag=0.15)
    text = "\n".join(summary_of(run).missing)
    assert "2 figures assumed, not measured" in text
    assert "dvl: lag 0.15 s" in text


@pytest.mark.parametrize(
    ("lost", "error", "axes", "words"),
    [
        (0, 0.1, "surge, sway, heave, yaw, roll and pitch", "all 6 free runs hold"),
        (3, 0.1, "no axis", "3 of 6 free runs leave all bounds"),
        (0, 0.9, "no axis", "they are no better than no change or no motion"),
    ],
)
def test_simulation_is_promised_only_where_free_runs_hold_and_help(
    run: ExampleRun, lost: int, error: float, axes: str, words: str
) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2}, axis)
    run.cards["coe"] = with_own_damping(run.cards["coe"], "from the prior", "ZKM")
    run.free_run = free_runs("coe", lost=lost, error=error)
    first_screen = summary_of(run)
    (use,) = (use for use in first_screen.uses if use.label == "Simulation")
    assert use.axes == ("all axes" if "surge" in axes else axes)
    assert words in use.reason
    assert ("not to simulate" in first_screen.headline) is (axes == "no axis")


def test_headline_uses_and_rule_name_one_model_to_simulate_with(run: ExampleRun) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2, "prestero": 0.4}, axis)
    for name, card in run.cards.items():
        held_out = {leg: dict.fromkeys(("all", *AXES), 0.2) for leg in ("one", "two", "three")}
        run.cards[name] = card.model_copy(update={"held_out": held_out if name == "coe" else {}})
    run.free_run = free_runs("coe", lost=0, error=0.9) + free_runs("prestero", lost=0)[:1]
    first_screen = summary_of(run)
    title = run.cards["prestero"].title
    assert first_screen.headline == f"Coe: use it to predict forces, and {title} to simulate"
    (use,) = (use for use in first_screen.uses if use.label == "Simulation")
    assert (use.axes, use.reason.startswith(f"take {title}: as a whole")) == ("", True)
    assert f"{title} is the one to simulate with" in first_screen.rule


def test_an_axis_whose_damping_nothing_excites_is_not_simulated(run: ExampleRun) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2}, axis)
    run.cards["coe"] = with_own_damping(run.cards["coe"], "from the prior", "KM")
    run.free_run = free_runs("coe", lost=0, error=0.1)
    (use,) = (use for use in summary_of(run).uses if use.label == "Simulation")
    assert use.axes == "surge, sway, roll, pitch and yaw"
    assert use.reason.endswith("not in heave (heave: damping not excited)")


def test_fast_turns_are_printed_without_an_exponent(run: ExampleRun) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2}, axis)
    card = run.cards["coe"]
    fast = card.conditions["r"].model_copy(update={"low": -1.73, "high": 1.83})
    run.cards["coe"] = card.model_copy(update={"conditions": card.conditions | {"r": fast}})
    (use,) = (use for use in summary_of(run).uses if use.label == "Within")
    assert "r −99 to 105 deg/s" in use.reason


def test_tilts_whose_damping_is_unknown_are_not_blamed_on_their_free_runs(
    run: ExampleRun,
) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2}, axis)
    run.cards["coe"] = with_own_damping(run.cards["coe"], "from the prior", "ZM")
    run.free_run = free_runs("coe", lost=0, error=0.1)
    (use,) = (use for use in summary_of(run).uses if use.label == "Simulation")
    assert use.axes == "surge, sway, heave and yaw"
    assert "but not in" not in use.reason
    assert "; not in roll and pitch, as damping of roll is not from the data" in use.reason


def test_an_axis_whose_own_drive_upsets_it_is_not_blamed_on_its_free_runs(
    run: ExampleRun,
) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2}, axis)
    run.cards["coe"] = with_own_damping(run.cards["coe"], "identified", "XYZKMN")
    run.free_run = free_runs("coe", lost=0, error=0.1)
    along_surge = SteadyRange.model_construct(
        axis="X", drive="thrusters", tips_in="unstable", growth_1_s=0.2, grows_on="Z"
    )
    motion = MotionCheck.model_construct(
        ranges=[along_surge], verdict="unstable", words="", remedies=[], decays_lost=0
    )
    ranking = run.ranking("coe")
    assert ranking.usable is not None
    ranking = ranking.model_copy(
        update={
            "models": [item.model_copy(update={"motion": motion}) for item in ranking.models],
            "usable": ranking.usable.model_copy(update={"simulation": ["Y", "Z", "N"]}),
        }
    )
    uses = summarise(run.cards, ranking, run.segments, run.logs, run.sections, run.vehicle, {}).uses
    (use,) = (use for use in uses if use.label == "Simulation")
    assert "but not in" not in use.reason
    assert "its own drive upsets it: not in surge, roll and pitch" in use.reason
    (use,) = (use for use in uses if use.label == "Control design")
    assert "by itself the model is unstable in heave" in use.reason


def test_the_lag_of_the_actuators_is_said_with_its_interval_and_what_it_moved(
    run: ExampleRun,
) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2}, axis)
    card = with_own_damping(run.cards["coe"], "identified", "XYZKMN")
    value = next(item.value for item in card.axes["Y"].terms if item.term == "v")
    assert value is not None
    lag = LagFit(value_s=0.14, standard_error_s=0.03, verdict="identified")
    moved = {"Y": {"v": value / 4.0}, "X": {"u": 0.001}}
    run.cards["coe"] = card.model_copy(update={"lag": lag, "moved_by_lag": moved})
    (use,) = (use for use in summary_of(run).uses if use.label == "Actuators")
    words = "their force follows the record 0.140 ± 0.059 s late, as the data show; it moved Y_v by"
    assert use.reason.startswith(words)
    assert use.reason.index("Y_v") < use.reason.index("X_u"), "the most moved first"
    tied = lag.model_copy(update={"verdict": "inseparable"})
    run.cards["coe"] = card.model_copy(update={"lag": tied})
    (use,) = (use for use in summary_of(run).uses if use.label == "Actuators")
    assert "not separable from the lag of the velocity log" in use.reason
    stated = lag.model_copy(update={"standard_error_s": None, "verdict": "stated"})
    run.cards["coe"] = card.model_copy(update={"lag": stated})
    (use,) = (use for use in summary_of(run).uses if use.label == "Actuators")
    assert use.reason == "their force follows the record 0.14 s late, as the vehicle file states"


@pytest.mark.parametrize(("column", "warned"), [("p_rms_rad_s", True), ("v_rms_m_s", False)])
def test_a_model_that_does_not_hold_roll_is_said_to_tip_over(
    run: ExampleRun, column: str, warned: bool
) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2}, axis)
    run.cards["coe"] = with_own_damping(run.cards["coe"], "from the prior", "KM")
    run.free_run = free_runs("coe", lost=0)
    run.free_run[0][column] = 0.9
    (use,) = (use for use in summary_of(run).uses if use.label == "Simulation")
    assert use.axes != "all axes"
    assert ("may tip over" in use.reason) is warned


@pytest.mark.parametrize(
    ("column", "axes", "words"),
    [
        ("phi_rms_rad", "no axis", "in roll its free runs err 3.0 times as much as the guess of"),
        ("v_rms_m_s", "surge, heave, roll, pitch and yaw", "damping identified"),
    ],
)
def test_no_controller_is_designed_on_a_model_that_loses_its_tilts(
    run: ExampleRun, column: str, axes: str, words: str
) -> None:
    for axis in ("all", *AXES):
        set_ratio(run, "validation", {"coe": 0.2}, axis)
    run.cards["coe"] = with_own_damping(run.cards["coe"], "identified", "XYZKMN")
    run.free_run = free_runs("coe", lost=0)
    run.free_run[0][column] = 1.5
    (use,) = (use for use in summary_of(run).uses if use.label == "Control design")
    assert (use.axes, words in use.reason) == (axes, True)


def free_runs(model: str, *, lost: int, error: float = 0.1) -> list[dict[str, object]]:
    """Rows of free runs of a model, and of guesses with an error of .5."""
    names = [f"{v}_rms_{'m_s' if v in 'uvw' else 'rad_s'}" for v in "uvwpqr"]
    names += [f"{angle}_rms_rad" for angle in ("phi", "theta", "psi")]
    head = {"segment": "check", "as_measured": "", "horizon_s": 10.0, "starts": 6}
    return [
        {**head, "model": model, "diverged": lost, **dict.fromkeys(names, error)},
        {**head, "model": "persistence", "diverged": 0, **dict.fromkeys(names, 0.5)},
        {**head, "model": "rest", "diverged": 0, **dict.fromkeys(names, 0.5)},
    ]


def test_the_flown_range_gives_each_velocity_its_unit(run: ExampleRun) -> None:
    ranges = dict.fromkeys((*"uvwpqr", "eta-1"), VelocityRange(rms=0.5, low=-1.0, high=1.0))
    run.cards["coe"] = run.cards["coe"].model_copy(update={"conditions": ranges})
    (use,) = (use for use in summary_of(run).uses if use.label == "Within")
    assert use.reason.startswith("u −1 to 1 m/s, v −1 to 1 m/s")
    assert "r −57 to 57 deg/s, (η−1) −1 to 1: the range of the training legs" in use.reason


def test_a_leg_that_a_simpler_model_predicts_better_is_named(run: ExampleRun) -> None:
    """Only where it is clearly better, and sound."""
    set_ratio(run, "validation", {"coe": 0.2})
    errors = {"coe": (0.19, 0.04), "fossen": (0.14, 0.3), "linear": (0.05, 0.01)}
    for name, (one, two) in errors.items():
        held_out = {"depth": {"all": one}, "yaw": {"all": two}}
        run.cards[name] = run.cards[name].model_copy(update={"held_out": held_out})
    words = [words for words in summary_of(run).missing if str(words).startswith("Left out")]
    (words,) = words
    assert "leg depth is predicted better by Fossen (12 terms, J/J0 0.14)" in str(words)
    for name, value in (("coe", 0.19), ("fossen", 0.14)):
        held_out = {"depth": {"all": value}, "yaw": {"all": value + 0.01}}
        run.cards[name] = run.cards[name].model_copy(update={"held_out": held_out})
    (words,) = [words for words in summary_of(run).missing if str(words).startswith("Left out")]
    both = "legs depth and yaw are predicted better by Fossen (12 terms, J/J0 0.14 and 0.15)"
    assert both in str(words)


def test_facts_count_seconds_and_identified_coefficients(run: ExampleRun) -> None:
    facts = {fact.label: fact.value for fact in summary_of(run).facts}
    assert facts["training"] == "4 s"
    assert facts["validation"] == "2 s"
    assert facts["logs complete"] == "0 of 1"
    assert facts["coefficients identified"] == "6 of 24"


def test_warnings_are_those_of_the_sections_once_each(run: ExampleRun) -> None:
    run.sections["extra"] = run.sections["ingest/dive"]
    for axis in AXES:
        set_ratio(run, "validation", dict.fromkeys(MODELS, 0.5), axis)
    assert summary_of(run).warnings == ("The velocity stream has a gap of 0.41 s at 77 s.",)


def test_note_on_the_model_to_take_is_on_the_first_screen(run: ExampleRun) -> None:
    set_ratio(run, "validation", {"coe": 0.2})
    words = [
        f"{title} predicts no better than a constant force alone in Z (0.86 against 0.72)."
        for title in ("Coe", "Linear")
    ]
    run.sections["validate"]["blocks"] += [remark(item, "note") for item in words]
    assert words[0] in summary_of(run).missing
    assert words[1] not in summary_of(run).missing


def test_models_stand_best_first(run: ExampleRun) -> None:
    totals = [model.axes["all"].validation for model in summary_of(run).models]
    assert totals == sorted(total for total in totals if total is not None)


def test_a_finding_that_two_logs_share_leads_to_the_log_that_it_names() -> None:
    log = sound()
    del log.streams["velocity"]
    health = {name: log.health() for name in ("dive_1", "dive_10")}
    inputs = example_run({"train": 4.0}).inputs()
    both = finding_alerts(replace(inputs, health=collection(health)))
    (alert,) = [words for words in both if "stream velocity" in words]
    assert alert.startswith("log 'dive_1' and 1 other: ")
    assert alert.place == anchor("ingest", "dive_1")
    one = finding_alerts(replace(inputs, health=collection({"dive_10": health["dive_10"]})))
    (of_one_log,) = [words for words in one if "stream velocity" in words]
    assert not of_one_log.startswith("log ")
    assert of_one_log.place == anchor("ingest", "dive_10")


def test_a_warning_that_a_finding_repeats_stands_once(run: ExampleRun) -> None:
    first_screen = replace(
        summary_of(run),
        log_findings=(Alert("95 % of the samples of depth cannot be used. (most_rejected)"),),
        warnings=(Alert("95 % of the samples of depth cannot be used."), Alert("Another one.")),
        missing=(),
    )
    assert first_screen.further_warnings == ("Another one.",)
    assert len(first_screen.alerts) == 2
