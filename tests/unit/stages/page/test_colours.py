"""Colours stand out, stay apart, and are the same wherever a name occurs."""

from __future__ import annotations

import itertools
import re

import pytest

from auvid.stages.page.colours import (
    AXIS_INKS,
    COMPONENTS,
    MODELS,
    PAPER,
    ROLES,
    SCREEN,
    ink,
    inks_of,
    is_model,
    key,
)
from auvid.stages.page.html import _text, inks

LEAST_LINE = 3.0  # WCAG 2.1, 1.4.11
LEAST_TEXT = 4.5  # WCAG 2.1, 1.4.3
EVERY = {**AXIS_INKS, **ROLES, **COMPONENTS, **MODELS}


def contrast(first: str, second: str) -> float:
    """Return the contrast ratio of two sRGB colours `#rrggbb`, 1 to 21.

    WCAG 2.1, relative luminance.
    """
    low, high = sorted((_luminance(first), _luminance(second)))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: str) -> float:
    parts = [int(colour[start : start + 2], 16) / 255 for start in (1, 3, 5)]
    red, green, blue = (
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_contrast_of_black_on_white_is_21() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)


@pytest.mark.parametrize("name", EVERY)
def test_line_stands_out_on_paper_and_on_screen(name: str) -> None:
    assert contrast(EVERY[name].light, PAPER) >= LEAST_LINE
    assert contrast(EVERY[name].dark, SCREEN) >= LEAST_LINE


def test_no_two_models_look_the_same() -> None:
    names = [name for name in MODELS if name != "mcfarland_whitcomb"]
    for one, other in itertools.combinations(names, 2):
        assert (MODELS[one].light, MODELS[one].dash) != (MODELS[other].light, MODELS[other].dash), (
            one,
            other,
        )


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("Gertler & Hagen", "gertler_hagen"),
        ("McFarland & Whitcomb", "mcfarland"),
        ("X", "x"),
        ("surge", "u"),
    ],
)
def test_name_as_printed_and_name_in_code_have_one_colour(one: str, other: str) -> None:
    assert ink(one) == ink(other)


def test_unknown_name_has_a_colour_that_depends_on_the_name_alone() -> None:
    assert ink("a new model") == ink("A new model")
    assert not is_model("a new model")


def test_key_of_a_name_without_letters_is_empty() -> None:
    assert key("<>") == ""


@pytest.mark.parametrize("theme", [":root {", ":root[data-theme=dark] {"])
def test_text_stands_out_on_every_ground_of_the_page(theme: str) -> None:
    block = _text("templates/style.css").split(theme, 1)[1].split("}", 1)[0]
    colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", block))
    pairs = [
        ("ink", ground)
        for ground in ("paper", "faint", "good", "fair", "poor", "h0", "h1", "h2", "h3", "h4")
    ]
    pairs += [(text, "paper") for text in ("soft", "link", "good-ink", "fair-ink", "poor-ink")] + [
        ("soft", "faint")
    ]
    for text, ground in pairs:
        assert contrast(colours[text], colours[ground]) >= LEAST_TEXT, (text, ground)


def test_style_sheet_names_every_colour_in_both_themes() -> None:
    sheet = inks(inks_of(["a new model"]))
    assert sheet.count("--ink-linear:") == 3
    assert sheet.count("--ink-a_new_model:") == 3


def test_names_without_a_colour_of_their_own_get_different_ones_on_page_and_in_recording() -> None:
    names = [f"flight {number}" for number in range(13)] + ["measured", "linear", "desired"]
    colours = inks_of(names)
    assert (
        len({(item.light, item.dash) for name, item in colours.items() if name != "linear"}) == 15
    )
    assert len({colours[key(name)].rgb for name in names[:13]}) == 13
    assert colours["linear"] == MODELS["linear"]
    assert inks_of(reversed(names)) == colours, "whichever comes first"
