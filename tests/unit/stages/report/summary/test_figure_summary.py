"""The first screen of campaigns without models: figures with intervals and verdicts."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from auvid.data_schemas.records.logs import FileInfo, LogInfo
from auvid.stages.page.first_screen import CoefficientRow
from auvid.stages.page.html import render
from auvid.stages.presentation import remark, section
from auvid.stages.report.summary.figure_summary import summarise_results


def row(quantity: str, value: float | None, **more: Any) -> dict[str, Any]:
    return {"quantity": quantity, "value": value, "unit": "kg", **more}


RESULTS = {
    "rlse/surge": {
        "title": "Surge, varying steps",
        "rows": [
            row(
                "m - X_udot",
                206.4321,
                standard_error=1.3,
                low=203.9,
                high=209.0,
                verdict="identified",
                headline=True,
            ),
            row("samples", 800.0),
        ],
    },
    "rlse/sway": {
        "title": "Sway, one step",
        "rows": [row("m - Y_vdot", None, verdict="not persistently exciting", headline=True)],
    },
}
VEHICLE: dict[str, Any] = {"title": "THAUS"}
FILE = FileInfo.model_construct()
LOGS = {"tank": LogInfo.model_construct(status="damaged", files=[FILE, FILE])}


def test_undetermined_figures_are_named_with_their_reason() -> None:
    summary = summarise_results(RESULTS, LOGS, {}, VEHICLE)
    assert summary.level == "fair"
    assert summary.headline == "Mass with added mass of surge determined: 1 of 2 values"
    assert "Not persistently exciting: m - Y_vdot (Sway, one step)." in summary.missing
    assert "Log tank is damaged." in summary.missing
    assert [item.quantity for item in summary.figures] == ["m - X_udot", "m - Y_vdot"]
    assert summary.figures[0].value == "206.4 kg"
    assert summary.figures[0].interval == "203.9 to 209.0"
    assert summary.figures[1].value == "not determined"


def test_without_verdicts_what_a_stage_finds_is_the_headline() -> None:
    results = {"control": {"title": "Control", "rows": [row("rms", 0.2, headline=True)]}}
    sections = {"control": section("Control", [remark("It stays.", "finding")], order=1)}
    summary = summarise_results(results, {}, sections, VEHICLE)
    assert summary.headline == "It stays"
    assert "It stays" not in summary.explanation
    assert summarise_results(results, {}, {}, VEHICLE).headline == "Rms: 0.2 kg"
    several = {"control": {"title": "Control", "rows": [row("rms", 0.2), row("peak", 0.4)]}}
    assert summarise_results(several, {}, {}, VEHICLE).headline == "2 values found"


@pytest.mark.parametrize(
    ("part", "names", "words"),
    [
        ("Pendulums", ("I_x", "surge: X_udot", "surge: X_u|u|", "sway: Y_vdot", "sway: Y_v"),
         "Inertia, added mass and damping of surge and sway"),
        ("heave of leg dive", ("Z_w|w| in commands", "constant force in commands"),
         "Damping and constant force of heave"),
        ("glider, referred to S", ("C_D", "C_L", "trim"), "Drag, lift and trim"),
        ("Pendulums", ("I_x", "Y_vdot", "X_u"), "Inertia, added mass of sway, damping of surge"),
        ("surge of leg one", ("m - X_udot", "X_udot"), "Added mass of surge"),
        ("Pendulums", tuple(f"{axis}_u" for axis in "XYZKMN"), "Damping of all axes"),
        ("Bollard pull", ("force at 1900 us",), ""),
    ],
)  # fmt: skip
def test_the_headline_names_what_was_determined(
    part: str, names: tuple[str, ...], words: str
) -> None:
    rows = [row(name, 1.0, verdict="identified") for name in names]
    headline = summarise_results({"a": {"title": part, "rows": rows}}, {}, {}, VEHICLE).headline
    count = f"{len(names)} of {len(names)} value{'s' * (len(names) > 1)}"
    assert headline == (f"{words} determined: {count}" if words else f"{count} determined")


def test_headlines_are_judged_and_bounds_stand_apart() -> None:
    """A second damping model that is weak, or a value of C_n, does not make the answer
    doubtful.
    """
    rows = [
        *RESULTS["rlse/surge"]["rows"],
        row("X_u (linear)", -1.0, verdict="weak"),
        row("C_n", 0.1, verdict="persistently exciting"),
    ]
    note = "largest error 0.4 % (X_udot)"
    bounds = {
        "title": "Printed",
        "rows": [row("Table 4: bounds met of 8", 8.0, verdict="met", headline=True, note=note)],
    }
    summary = summarise_results(
        {"rlse/surge": {"title": "Surge", "rows": rows}, "check_published": bounds}, {}, {}, VEHICLE
    )
    assert summary.level == "good"
    assert [item.quantity for item in summary.figures] == ["m - X_udot"]
    assert summary.bounds == ("Table 4: 8 of 8 bounds met, largest error 0.4 % (X_udot)",)
    assert (
        summary.headline
        == "Mass with added mass of surge determined: 1 of 1 value; every bound on printed values"
        " is met"
    )
    assert summary.explanation == "Surge: m - X_udot 206.4 kg (203.9 to 209.0)."
    only = summarise_results({"check_published": bounds}, {}, {}, VEHICLE)
    assert (only.level, only.headline) == ("good", "Every bound on printed values is met")
    of_twin = {**bounds, "rows": [{**bounds["rows"][0], "reference": "true values"}]}
    twin = summarise_results({"check_published": of_twin}, {}, {}, VEHICLE)
    assert (twin.headline, twin.bounds_on) == ("Every bound on true values is met", "true values")
    missed = {
        "check_published": {
            "title": "Printed",
            "rows": [row("Table 4", 7.0, verdict="missed", headline=True)],
        }
    }
    failed = summarise_results(missed, {}, {}, VEHICLE)
    assert "A bound is missed: Table 4: missed." in failed.missing
    assert (failed.level, failed.headline) == ("poor", "0 of 1 bounds on printed values met")


def test_a_missed_bound_is_one_alert_with_its_figures() -> None:
    """Not one alert that counts the bounds of a table and another that says which."""
    words = "Table 4, X_udot: -13.1 kg, required at most -13.2"
    sections = {"check_published": section("Printed", [remark(words, "warning")], order=2)}
    title = "Table 4, has no printed value: bounds met of 9"
    missed = row(title, 8.0, verdict="missed", headline=True, evidence="unprinted")
    results = {"check_published": {"title": "Printed", "rows": [missed]}}
    summary = summarise_results(results, {}, sections, VEHICLE)
    alert = f"A bound that has no printed value is missed: {words}."
    assert [item for item in summary.alerts if "Table 4" in item] == [alert]
    assert summary.alerts[0].level == "fair"


def test_bounds_that_cannot_fail_are_not_headlined() -> None:
    rows = [
        row("Table 4: bounds met of 8", 8.0, verdict="met", headline=True, evidence="method"),
        row("Table 5, holds by construction: bounds met of 49", 49.0, verdict="met", headline=True)
        | {"evidence": "construction"},
    ]
    summary = summarise_results({"check_published": {"title": "P", "rows": rows}}, {}, {}, VEHICLE)
    assert summary.headline == "All 8 bounds that test the method are met"
    assert summary.bounds[1] == "Table 5: 49 of 49 bounds that hold by construction met"
    (fact,) = [fact for fact in summary.facts if "bounds" in fact.label]
    assert (fact.label, fact.value, fact.note) == (
        "bounds that test the method",
        "8 of 8",
        "49 hold by construction",
    )
    headlined = summarise_results(
        {"check_published": {"title": "P", "rows": rows[1:]}}, {}, {}, VEHICLE
    )
    assert headlined.headline == "No bound on printed values tests the method"


def test_all_determined_and_no_warning_is_good() -> None:
    only = {"rlse/surge": RESULTS["rlse/surge"]}
    assert summarise_results(only, {}, {}, VEHICLE).level == "good"
    warned = {"rlse/surge": section("Surge", [remark("the bias drifts", "warning")], order=10)}
    summary = summarise_results(only, {}, warned, VEHICLE)
    assert (summary.level, summary.warnings) == ("fair", ("the bias drifts",))


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (1.3, "206.4 kg"),
        (0.013, "206.432 kg"),
        (1e-7, "206.432 kg"),
        (40.0, "206 kg"),
        (None, "206.4 kg"),
    ],
)
def test_digits_follow_the_standard_error(error: float | None, words: str) -> None:
    one = {"x": {"title": "T", "rows": [row("q", 206.4321, standard_error=error)]}}
    assert summarise_results(one, {}, {}, VEHICLE).figures[0].value == words


def test_a_narrow_interval_is_given_as_its_width() -> None:
    exact = row("I_x", 1.7428, standard_error=1e-8, low=1.74279998, high=1.74280002)
    summary = summarise_results(
        {"x": {"title": "T", "rows": [exact | {"unit": "kg*m^2"}]}}, {}, {}, VEHICLE
    ).figures[0]
    assert (summary.value, summary.interval) == ("1.74280 kg m²", "± 2×10⁻⁸")


def test_page_shows_the_figures_escaped() -> None:
    hostile = {"x": {"title": "<script>", "rows": [row("<b>", 1.0)]}}
    page = render("T", "S", "", summarise_results(hostile, {}, {}, VEHICLE), {}).decode()
    assert "&lt;b&gt;" in page
    assert "<b>" not in page.split("<figure", 1)[1].split("</figure>")[0]


@pytest.mark.parametrize(
    ("low", "note", "log", "count"),
    [
        (-16.0, "quadratic", "dive", 1),
        (-8.0, "quadratic", "dive", 0),
        (-16.0, "linear", "dive", 0),
        (-16.0, "quadratic", "another", 0),
    ],
)
def test_legs_of_one_log_that_exclude_each_other_are_named(
    low: float, note: str, log: str, count: int
) -> None:
    """Not where the intervals meet, the models differ, or the legs are of other logs."""
    common = {"verdict": "identified", "headline": True, "note": "quadratic"}
    results = {
        "rlse/dive": {
            "title": "heave of leg dive",
            "rows": [row("Z_w|w|", -13.0, low=-15.0, high=-11.0, **common)],
        },
        "rlse/descent": {
            "title": "heave of leg descent",
            "rows": [row("Z_w|w|", -27.0, low=-37.0, high=low, **{**common, "note": note})],
        },
    }
    log_of = {"dive": "dive", "descent": log}
    summary = summarise_results(results, {}, {}, VEHICLE, log_of)
    assert summary.headline.endswith("2 of 2 values; the legs disagree") == bool(count)
    missing = summary.missing
    alerts = [
        words for words in missing if words.startswith("The legs disagree on Z_w|w| of heave")
    ]
    assert len(alerts) == count


@pytest.mark.parametrize(("count", "kept_back"), [(10, 0), (30, 22)])
def test_a_long_table_shows_its_first_rows_before_the_alerts(count: int, kept_back: int) -> None:
    rows = [row(f"X_{number}", 1.0, verdict="identified") for number in range(count)]
    bounds = [row(f"Table {number}", 7.0, verdict="missed") for number in range(5)]
    summary = summarise_results({"a": {"title": "A", "rows": rows + bounds}}, {}, {}, VEHICLE)
    page = render("T", "", "", summary, {}).decode()
    table = page[page.index('id="found"') : page.index("</table>")]
    assert table.count('<tr class="rest"><th scope="row">') == kept_back
    assert ("show all 30" in table) is (kept_back > 0)
    assert page.index('id="found"') < page.index('id="alerts"') < page.index('id="bounds"')


def test_flights_are_summed_up_by_the_least_and_the_largest_in_words() -> None:
    rows = [
        row(f"rms cross-track, helix, {name}", value, headline=True)
        for name, value in (("undisturbed", 4.5731e-5), ("side_force", 0.24754), ("late", 0.1))
    ]
    sections = {"control": section("Control", [remark("half stay.", "finding")], order=1)}
    summary = summarise_results({"control": {"title": "C", "rows": rows}}, {}, sections, VEHICLE)
    assert summary.headline == "Half stay"
    assert summary.explanation == (
        "RMS cross-track: 4.573×10⁻⁵ kg (helix, undisturbed) to 0.2475 kg (helix, side force)."
    )
    assert [item.quantity for item in summary.figures][1] == "RMS cross-track, helix, side force"


def test_coefficients_that_are_not_identified_wait_behind_the_figures_that_are_shown() -> None:
    weak = CoefficientRow("Z_w", "heave damping", "N s/m", "weak", -9.0, -58.0, 40.0)
    results = {"axes": {"title": "Heave", "rows": [row("Z_w/M", -0.07, verdict="weak")]}}
    summary = replace(summarise_results(results, {}, {}, VEHICLE), coefficients=(weak,))
    page = render("Dive", "", "", summary, {}).decode()
    assert "No coefficient is identified" in page
    assert re.search(r'<tr class="rest"><th scope="row" data-v="Z_w">', page)
    without_figures = render("Dive", "", "", replace(summary, figures=()), {}).decode()
    assert re.search(r'<tr><th scope="row" data-v="Z_w">', without_figures)


def test_coefficients_over_another_inertia_wait_behind_the_figures_of_their_own() -> None:
    row_of_sway = CoefficientRow("Y_v", "sway damping", "1/s", "identified", -1.18, -1.66, -0.7)
    results = {"axes": {"title": "Sway", "rows": [row("Y_v/M", -0.97, verdict="identified")]}}
    summary = summarise_results(results, {}, {}, VEHICLE)
    summary = replace(summary, coefficients=(row_of_sway,), counted_in="surge")
    folded = "<details[^>]*><summary>As the model file has them: all over the inertia of surge"
    assert re.search(folded, render("Dive", "", "", summary, {}).decode())
    in_newtons = render("Dive", "", "", replace(summary, counted_in=""), {}).decode()
    assert not re.search(folded, in_newtons)
    assert "What was identified" in in_newtons
