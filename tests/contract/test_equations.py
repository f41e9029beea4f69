"""docs/equations.md is what the docstrings say, and names every equation that we have."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest

from tests.support.tools import ROOT, load_tool

EQUATIONS = load_tool("equations")
IMPLEMENTED = {
    "McCarter": "2.5 2.7 2.11 2.13-2.15 2.18 2.20 2.23 2.36-2.41 2.44-2.45 2.53 2.56 2.57 2.60 2.62"
    " 2.77-2.81 2.84-2.92 3.12 4.4 4.11 4.14-4.20 4.22-4.27 C.8-C.12",
    "Alberti": "18 25 26 30 39 41 44 45 48-52 54-66 70 71",
    "Al Makdah": "2.36 2.38-2.50 2.52-2.64 2.66-2.89 3.1 3.5 3.10-3.13 3.17 3.19 3.22-3.25 5.3-5.9",
}
"""What the product implements; a number that leaves the docstrings is missed here."""


@cache
def index() -> Any:
    return EQUATIONS.equation_index(ROOT)


def numbers(thesis: str, text: str) -> list[str]:
    docstring = ", ".join(f"({part})" for part in text.replace("-", ")-(").split())
    return [str(equation) for equation, _ in EQUATIONS.equations_in(docstring, thesis)]


def test_the_page_is_what_the_docstrings_give() -> None:
    assert (ROOT / EQUATIONS.PAGE).read_text(encoding="utf-8") == EQUATIONS.page(index()), (
        "docs/equations.md is out of date: run make declarations"
    )


@pytest.mark.parametrize("thesis", IMPLEMENTED)
def test_every_implemented_equation_is_named_by_a_docstring(thesis: str) -> None:
    named = {str(equation) for equation in index() if equation.thesis == thesis}
    assert [item for item in numbers(thesis, IMPLEMENTED[thesis]) if item not in named] == []


@pytest.mark.parametrize(
    ("text", "thesis", "expected"),
    [
        ("tau_G (2.44): (..., 6) -> (..., 6) [N, N m].", "McCarter", ["(2.44)"]),
        ("Errors (2.84)-(2.86), (2.88).", "McCarter", ["(2.84)", "(2.85)", "(2.86)", "(2.88)"]),
        ("Thrust by Alberti 2015 (59).", "McCarter", ["(59)"]),
        ("Position (Al Makdah 3.24, corrected sign) of (6, 6).", "McCarter", ["(3.24)"]),
        ("From x(0) and c (2, 3), state (12).", "McCarter", []),
        ("Period (54)-\n    (55) [s], matrix (6, 6).", "Alberti", ["(54)", "(55)"]),
    ],
)
def test_numbers_are_read_from_docstrings(text: str, thesis: str, expected: list[str]) -> None:
    assert [str(equation) for equation, _ in EQUATIONS.equations_in(text, thesis)] == expected


@pytest.mark.parametrize(
    ("text", "thesis", "message"),
    [
        ("Force (2.44).", None, "no thesis"),
        ("Force (2.95).", "McCarter", "no equation"),
        ("Force (72).", "Alberti", "no equation"),
        ("Force (4.1).", "Al Makdah", "no equation"),
    ],
)
def test_a_number_of_no_thesis_is_refused(text: str, thesis: str | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        list(EQUATIONS.equations_in(text, thesis))
