"""The page: arranged sections, escaped strings, one file without network, the same
bytes every time.
"""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup

from auvid.stages.number_format import number, printed_unit, symbols, term, visible
from auvid.stages.page.html import (
    PLOTTED_SAMPLES,
    Chapter,
    anchor,
    arrange,
    cells,
    drawn_share,
    heat,
    lead,
    plotted_samples,
    thinned,
    without_quoted,
)
from auvid.stages.presentation import panel, plot, remark, section, series, table, text
from auvid.stages.report import Params, fewer_samples, run
from tests.support.example_run import ExampleRun, example_run

HOSTILE = '<script>alert("x")</script><img src=x onerror=alert(1)>\x1b[31mred\x07\u202egnp.exe</td>'


@pytest.fixture(scope="module")
def page() -> str:
    return run(example_run({"train": 6.0, "check": 3.0}).inputs(), Params()).report_html.decode()


def titles(chapters: tuple[Chapter, ...]) -> list[tuple[str, list[str]]]:
    return [(chapter.title, [part.label for part in chapter.parts]) for chapter in chapters]


class Tags(HTMLParser):
    """Start tags, ids and links of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def values(self, name: str) -> list[str]:
        return [value or "" for key, value in self.attributes if key == name]


def test_sections_stand_by_order_and_share_a_heading_per_stage() -> None:
    sections = {
        "late": section("Provenance", [], order=1000),
        "fuse/train": section("State of train (kinematic)", [], order=30),
        "ingest/dive": section("Log dive", [], order=10),
        "fuse/check": section("State of check (kinematic)", [], order=30),
    }
    assert titles(arrange(sections)) == [
        ("Log dive", [""]),
        ("State (kinematic)", ["train", "check"]),
        ("Provenance", [""]),
    ]


def test_sections_with_titles_of_their_own_keep_them() -> None:
    sections = {"rlse/a": section("Surge", [], order=5), "rlse/b": section("Heave", [], order=5)}
    assert titles(arrange(sections)) == [("Surge", [""]), ("Heave", [""])]


def test_a_finding_that_the_answer_quotes_stands_there_alone() -> None:
    blocks = [remark("C_D 0.2.", "finding"), remark("It dives.", "finding"), text("C_D 0.2.")]
    left = without_quoted({"glide": section("Glides", blocks, order=1)}, "At 22 deg: C_D 0.2.")
    assert left["glide"]["blocks"] == blocks[1:]
    (left_out,) = without_quoted({"a": section("A", blocks[:1], order=1)}, "c_D 0.2. So.").values()
    assert left_out["blocks"] == []


def test_anchors_of_different_names_differ() -> None:
    names = [
        ("fuse", "a b"),
        ("fuse", "a-b"),
        ("fuse", "a", "b"),
        ("fuse", "a_b"),
        ("fuse", "ä"),
        ("fuse", "train.1"),
    ]
    assert len({anchor(*name) for name in names}) == len(names)
    assert all(re.fullmatch(r"[A-Za-z0-9_-]+", anchor(*name)) for name in names)


def test_control_and_direction_characters_are_shown_not_sent() -> None:
    assert visible("a\x1b[31m\u202e\x7fb\tc") == "a␛[31m\ufffd\ufffdb\tc"


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (3, "3"),
        (2148990, "2148990"),
        (-2.0, "−2"),
        (0.123456, "0.1235"),
        (12345.6, "12346"),
        (2.5e9, "2.500×10⁹"),
        (1234567.8, "1.235×10⁶"),
        (-1.2e-7, "−1.2×10⁻⁷"),
    ],
)
def test_numbers(value: float, words: str) -> None:
    assert number(value) == words


def test_numbers_of_one_column_have_the_same_decimals() -> None:
    block = table("t", ["model", "J"], [["a", 0.62], ["b", 12.0], ["c", None]])
    assert [row[1].text for row in cells(block)] == ["0.62", "12.00", "–"]


def test_rows_with_units_of_their_own_show_two_figures_of_their_interval() -> None:
    """A column of unlike units has no decimals of its own."""
    heads = ["figure", "value", "± 95 % by noise", "unit"]
    rows = [
        ["inertia", 132.8, 33.33, "kg"],
        ["C_D0", 0.155, 0.002347, "1"],
        ["lag", 0.05, 0.0, "s"],
    ]
    printed = [[cell.text for cell in row[1:3]] for row in cells(table("T", heads, rows))]
    assert printed == [["133", "33"], ["0.1550", "0.0023"], ["0.05", "0"]]


def test_column_of_very_different_sizes_keeps_its_figures() -> None:
    block = table("t", ["J"], [[1e-5], [1234.6]])
    assert [row[0].text for row in cells(block)] == ["1×10⁻⁵", "1235"]


@pytest.mark.parametrize(
    ("ratio", "kind"),
    [(0.0, "h0"), (0.3, "h1"), (0.5, "h2"), (0.99, "h3"), (1.0, "h4"), (None, "")],
)
def test_heat(ratio: float | None, kind: str) -> None:
    assert heat(ratio) == kind


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("u*u", "u²"),
        ("v*|v|", "v|v|"),
        ("(u*v)*(eta-1)", "uv(η−1)"),
        ("r", "r"),
        ("constant", "constant"),
    ],
)
def test_terms(name: str, words: str) -> None:
    assert term(name) == words


def test_verdict_and_model_cells_are_marked() -> None:
    row = cells(table("t", ["model", "verdict", "x"], [["Linear", "inseparable from u, v", True]]))[
        0
    ]
    assert row[0].swatch == "--ink-linear"
    assert row[1].kind == "verdict fair"
    assert row[2].text == "yes"


def hostile_run() -> ExampleRun:
    hostile = example_run({"train": 4.0, "check": 2.0})
    hostile.campaign["title"] = hostile.campaign["notes"] = HOSTILE
    hostile.vehicle = replace(hostile.vehicle, title=HOSTILE)
    dive = hostile.logs["dive"]
    file = dive.files[0].model_copy(update={"name": HOSTILE})
    hostile.logs["dive"] = dive.model_copy(
        update={"notes": [HOSTILE], "files": [file, *dive.files[1:]]}
    )
    hostile.cards["linear"] = hostile.cards["linear"].model_copy(update={"title": HOSTILE})
    hostile.sections[f"evil/{HOSTILE}"] = section(
        HOSTILE,
        [
            text(HOSTILE),
            remark(HOSTILE, "warning"),
            table(HOSTILE, [(HOSTILE, HOSTILE)], [[HOSTILE]], note=HOSTILE),
        ],
        order=2,
        look_for=HOSTILE,
    )
    hostile.sections["evil/equation"] = section(
        "e",
        [{"kind": "equation", "latex": HOSTILE, "meaning": HOSTILE}, {"kind": HOSTILE}],
        order=3,
    )
    lines = [{"name": HOSTILE, "role": HOSTILE, "x": [0, 1], "y": [0, 1]}]
    axes = [{"label": HOSTILE, "unit": HOSTILE, "series": lines}]
    hostile.sections["evil/plot"] = section(
        "p",
        [
            {
                "kind": "plot",
                "title": HOSTILE,
                "x": {"label": HOSTILE, "unit": HOSTILE},
                "panels": axes,
                "group": HOSTILE,
                "look_for": HOSTILE,
            }
        ],
        order=4,
    )
    return hostile


def test_hostile_strings_stay_text() -> None:
    page = run(hostile_run().inputs(), Params()).report_html.decode()
    tags = Tags(page)
    assert tags.tags.count("script") == 1
    assert "img" not in tags.tags
    assert not [name for name, _ in tags.attributes if name.startswith("on")]
    assert "&lt;script&gt;" in page
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f\u202e]", page)


@pytest.mark.parametrize(
    ("shifts", "verdict"),
    [({}, "identified"), ({"thrust": 4.0}, "identified"), ({"thrust": 4.0}, "weak")],
)
def test_the_table_of_coefficients_names_intervals_by_noise_alone(
    shifts: dict[str, float], verdict: str
) -> None:
    example = example_run({"train": 4.0, "check": 2.0})
    update = {"value": -90.0, "standard_error": 3.0, "verdict": "identified"}
    for name, card in example.cards.items():
        part = card.axes["X"]
        items = [item.model_copy(update=update) for item in part.terms]
        items[0] = items[0].model_copy(update={"assumed_shifts": shifts, "verdict": verdict})
        axes = {**card.axes, "X": part.model_copy(update={"terms": items})}
        example.cards[name] = card.model_copy(update={"axes": axes})
    page = run(example.inputs(), Params()).report_html.decode()
    together = "by noise and assumed values of the vehicle together"
    moved = bool(shifts) and verdict == "identified"
    assert (together in page, "± is 95 %, by noise alone." in page) == (moved, not moved)
    assert (" (noise alone)</td>" in page) == moved


def test_page_allows_its_own_script_only(page: str) -> None:
    script = re.search(r"<script>(.*)</script>", page, re.DOTALL)
    assert script is not None
    digest = base64.b64encode(hashlib.sha256(script.group(1).encode()).digest()).decode()
    assert (
        f"script-src &#39;sha256-{digest}&#39;" in page or f"script-src 'sha256-{digest}'" in page
    )
    assert "default-src 'none'" in page


def test_page_refers_to_nothing_outside_itself(page: str) -> None:
    tags = Tags(page)
    ids = tags.values("id")
    assert len(ids) == len(set(ids))
    for link in tags.values("href"):
        assert link == "data:," or link.removeprefix("#") in ids
    assert tags.values("src") == []
    assert "url(" not in page
    assert "@import" not in page


def test_report_is_the_same_every_time() -> None:
    first, second = (
        run(example_run({"train": 4.0, "check": 2.0}).inputs(), Params()).report_html
        for _ in range(2)
    )
    assert first == second


def test_plots_of_several_logs_zoom_apart() -> None:
    example = example_run({"train": 4.0, "check": 2.0})
    example.logs["second"] = example.logs["dive"].model_copy(update={"log": "second"})
    example.segments["check"] = example.segments["check"].model_copy(update={"log": "second"})
    groups = set(Tags(run(example.inputs(), Params()).report_html.decode()).values("data-group"))
    assert {"dive time", "second time"} <= groups


def test_campaign_without_models_still_has_a_page(tmp_path: Path) -> None:
    example = example_run({"train": 4.0})
    example.cards, example.errors, example.sections, example.views = {}, [], {}, {}
    out = run(example.inputs(), Params())
    assert b"No model was identified" in out.report_html
    out.recording(str(tmp_path / "recording.rrd"))
    assert (tmp_path / "recording.rrd").read_bytes().startswith(b"RRF")


def test_long_text_is_folded_after_its_first_sentence() -> None:
    assert lead("Short. Text.") == ("Short. Text.", "")
    assert lead(f"First sentence. {'more ' * 50}") == ("First sentence.", "more " * 50)
    assert lead("x" * 300) == ("x" * 300, "")


def test_numbers_printed_by_a_stage_keep_their_digits_and_are_sorted_as_numbers() -> None:
    block = table(
        "T",
        ["quantity", "ours", "id"],
        [["X_udot", "-13.3967", "a1"], ["Z_w", "1.20e-05", "7"], ["K", "", ""]],
    )
    rows = cells(block)
    assert [row[1].text for row in rows] == ["−13.3967", "1.20×10⁻⁵", "–"]
    assert [row[1].sort for row in rows] == [-13.3967, 1.2e-05, None]
    assert rows[0][0].text == "X<sub>u\u0307</sub>"
    assert rows[1][2].text == "7"
    assert rows[1][2].kind == "", "a column in which something is no number keeps its texts"


def test_symbols_are_typeset_and_nothing_else_is_let_through() -> None:
    assert (
        symbols("m - Y_vdot, Y_v|v|, I_z")
        == "m - Y<sub>v\u0307</sub>, Y<sub>v|v|</sub>, I<sub>z</sub>"
    )
    assert symbols("K_vV, N_u|v|") == "K<sub>vV</sub>, N<sub>u|v|</sub>"
    assert (
        symbols("C_D1 (alpha - alpha_0)^2, C_L_alpha, C_n")
        == "C<sub>D1</sub> (α - α<sub>0</sub>)², C<sub>Lα</sub>, C_n"
    )
    assert (
        symbols("X_prop and MAX_uv stay, <b>X_u</b>")
        == "X_prop and MAX_uv stay, &lt;b&gt;X<sub>u</sub>&lt;/b&gt;"
    )
    assert symbols(Markup("<i>X_u</i>")) == "<i>X<sub>u</sub></i>"
    assert symbols("<i>X_u</i>") == "&lt;i&gt;X<sub>u</sub>&lt;/i&gt;", "an equal text of markup"


def test_units_are_printed_as_engineers_do() -> None:
    assert [printed_unit(unit) for unit in ("kg*m^2", "1/s^2", "N", "m^-1")] == [
        "kg m²",
        "1/s²",
        "N",
        "m⁻¹",
    ]


def test_many_parts_fold_and_say_their_warnings() -> None:
    few = {
        f"ingest/log{n}": section(f"Health of log log{n}", [remark("lost", "warning")], order=90)
        for n in range(3)
    }
    many = {
        f"ingest/log{n}": section(f"Health of log log{n}", [remark("lost", "warning")], order=90)
        for n in range(12)
    }
    assert not arrange(few)[0].folds
    chapter = arrange(many)[0]
    assert chapter.folds
    assert not any(part.open for part in chapter.parts)
    assert chapter.parts[0].warnings == 1


def test_sections_that_name_one_chapter_come_under_it() -> None:
    named = {
        f"rlse/{leg}": section(f"{way} of leg {leg}", [], order=20, chapter="Single channels")
        for leg, way in (("a", "Surge"), ("b", "Sway"))
    }
    assert [(item.title, [part.label for part in item.parts]) for item in arrange(named)] == [
        ("Single channels", ["Surge of leg a", "Sway of leg b"])
    ]


@pytest.mark.parametrize(("legs", "most"), [(2, 2_000), (400, 300)])
def test_plots_of_many_legs_share_the_samples_of_the_page(legs: int, most: int) -> None:
    t_s = np.linspace(0.0, 60.0, 1_000)
    picture = plot("u", [panel("u", "m/s", [series("u", t_s, np.sin(t_s), "estimate")])])
    sections = {f"fuse/{leg}": section("State", [picture], order=1) for leg in range(legs)}
    (block,) = sections["fuse/0"]["blocks"]
    share = PLOTTED_SAMPLES / plotted_samples(sections.values())
    (line,) = thinned(block, share)["panels"][0]["series"]
    assert len(line["x"]) <= most
    assert max(line["y"]) == pytest.approx(1.0, abs=1e-3)
    assert (thinned(block, share) is block) is (legs == 2)
    kept = [fewer_samples(item, drawn_share(sections.values())) for item in sections.values()]
    assert plotted_samples(kept) == legs * len(line["x"])
