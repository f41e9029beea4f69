"""The first screen says which model to take and what is missing, and never praises what
validation does not bear out.
"""

from __future__ import annotations

import numpy as np
import pytest

from auvid.data_schemas.tables import make_table
from auvid.stages.page.first_screen import Summary
from auvid.stages.presentation import remark
from auvid.stages.report.summary.model_summary import summarise
from tests.support.example_run import AXES, MODELS, ExampleRun, example_run, example_vehicle


@pytest.fixture
def run() -> ExampleRun:
    return example_run({"train": 4.0, "check": 2.0})


def summary_of(run: ExampleRun) -> Summary:
    return summarise(
        run.cards,
        run.error_table() if run.errors else None,
        run.segments,
        run.logs,
        run.sections,
        run.vehicle.document,
    )


def set_ratio(run: ExampleRun, use: str, ratios: dict[str, float], axis: str = "all") -> None:
    for row in run.errors:
        if row["use"] == use and row["axis"] == axis and row["model"] in ratios:
            row["ratio"] = ratios[row["model"]]
            row["rms"] = 4.0 * row["ratio"]


def test_smallest_error_wins_when_it_is_alone(run: ExampleRun) -> None:
    set_ratio(run, "validation", {"coe": 0.2})
    assert summary_of(run).recommended == "coe"
    assert summary_of(run).headline.startswith("Coe: use it to predict forces")


def test_fewest_terms_win_among_equals(run: ExampleRun) -> None:
    set_ratio(run, "validation", {"mcfarland": 0.400, "fossen": 0.415})
    found = summary_of(run)
    assert found.recommended == "fossen"
    assert "McFarland & Whitcomb has a smaller error (0.40) with 216 terms" in found.explanation


def test_no_model_is_taken_when_none_beats_no_force(run: ExampleRun) -> None:
    set_ratio(run, "validation", dict.fromkeys(MODELS, 1.3))
    found = summary_of(run)
    assert found.recommended is None
    assert found.level == "poor"
    assert found.headline == "Use none of these models"


def test_axis_that_fails_is_named_beside_the_model_to_take(run: ExampleRun) -> None:
    set_ratio(run, "validation", {"coe": 0.2})
    for axis in AXES:
        set_ratio(run, "validation", {"coe": 1.7 if axis == "N" else 0.2}, axis)
    found = summary_of(run)
    assert found.level == "fair"
    assert "It does not hold in yaw (N)" in found.explanation


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
    found = summary_of(run)
    assert found.judged_on == "training"
    assert found.level == "poor"
    assert "nothing judges it" in found.headline
    assert any("no validation leg" in words for words in found.missing)


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
        "6 are weak (the interval reaches zero or nearly), 6 are not excited and 6 cannot be told"
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


@pytest.mark.parametrize(("diverged", "said"), [(0, False), (3, True)])
def test_model_that_cannot_be_simulated_is_said(run: ExampleRun, diverged: int, said: bool) -> None:
    set_ratio(run, "validation", {"coe": 0.2})
    rows = {
        "segment": ["check"] * 2,
        "model": ["coe"] * 2,
        "horizon_s": [5.0, 10.0],
        "starts": [7, 6],
        "diverged": [diverged, diverged],
    }
    rows["first_divergence_s"] = [0.54 if diverged else np.nan] * 2
    names = [
        f"{axis}_rms_{unit}" for axes, unit in (("uvw", "m_s"), ("pqr", "rad_s")) for axis in axes
    ]
    table = make_table(
        "free_run",
        {
            **rows,
            **{
                name: [0.1, 0.2] for name in (*names, "phi_rms_rad", "theta_rms_rad", "psi_rms_rad")
            },
        },
    )
    missing = summarise(
        run.cards,
        run.error_table(),
        run.segments,
        run.logs,
        run.sections,
        run.vehicle.document,
        table,
    ).missing
    words = (
        "Simulated by itself from measured states, Coe leaves all bounds in 3 of 6 runs of 10 s,"
        " the first after 0.5 s"
    )
    assert any(item.startswith(words) for item in missing) is said


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
    totals = [model.total.validation for model in summary_of(run).models]
    assert totals == sorted(total for total in totals if total is not None)
