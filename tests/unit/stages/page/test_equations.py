"""LaTeX to MathML: what the thesis's equations need, and input that nobody should have
written.
"""

from __future__ import annotations

from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from auvid.stages.page.equations import mathml


def letters(latex: str) -> str:
    """The visible characters of a formula."""
    return "".join(ElementTree.fromstring(mathml(latex)).itertext())


@pytest.mark.parametrize(
    ("latex", "markup"),
    [
        (r"X_{u|u|}", "<msub><mi>X</mi><mrow><mi>u</mi>"),
        (r"\bar\tau", "<mover><mi>τ</mi>"),
        (r"\dot\nu", "<mi>ν</mi><mo"),
        (r"u^2", "<msup><mi>u</mi><mn>2</mn></msup>"),
        (r"\sigma_i^2", "<msubsup><mi>σ</mi><mi>i</mi><mn>2</mn></msubsup>"),
        (r"\frac{1}{6n_k}", "<mfrac><mrow><mn>1</mn></mrow>"),
        (r"\sqrt{x}", "<msqrt><mrow><mi>x</mi></mrow></msqrt>"),
        (r"\mathrm{diag}(\nu)", "<mo>diag</mo>"),
        (r"\text{in water}", "<mtext>in\xa0water</mtext>"),
        (r"a &= b \\ c &= d", '<mtd columnalign="right"><mi>a</mi></mtd>'),
        (
            r"\begin{bmatrix} a & b \\ c & d \end{bmatrix}",
            '<mtable class="matrix"><mtr><mtd><mi>a</mi></mtd>',
        ),
    ],
)
def test_construct(latex: str, markup: str) -> None:
    assert markup in mathml(latex)


def test_every_letter_of_the_residual_equation_is_shown_in_order() -> None:
    assert (
        letters(r"\bar\tau = M\dot\nu + C(\nu)\nu - \tau_G(\eta) - \tau_U(\nu, u)")
        == "τ¯=Mν˙+C(ν)ν−τG(η)−τU(ν,u)"
    )


def test_unknown_command_is_shown_as_written() -> None:
    assert r"\wibble" in letters(r"x + \wibble")


def test_formula_that_holds_markup_stays_text() -> None:
    page = mathml('<script>alert(1)</script>" onload="x')
    assert "<script" not in page
    assert ElementTree.fromstring(page).attrib["alttext"] == '<script>alert(1)</script>" onload="x'


def test_deep_nesting_is_shown_as_source() -> None:
    latex = "{" * 20_000
    assert letters(latex) == latex


@given(st.text(alphabet=r"\{}[]()_^&|'ax1 " + "\t", max_size=40) | st.text(max_size=20))
def test_any_text_gives_well_formed_markup(latex: str) -> None:
    clean = "".join(c for c in latex if c.isprintable())
    assert ElementTree.fromstring(mathml(clean)).tag == "math"


@given(
    st.lists(
        st.sampled_from(
            [
                r"\left(",
                r"\right)",
                r"\begin{a}",
                r"\end{a}",
                r"\frac",
                r"\dot",
                "{",
                "}",
                "_",
                "^",
                "&",
                r"\\",
                "x",
            ]
        ),
        max_size=25,
    )
)
def test_unbalanced_commands_give_well_formed_markup(parts: list[str]) -> None:
    assert ElementTree.fromstring(mathml(" ".join(parts))).tag == "math"
