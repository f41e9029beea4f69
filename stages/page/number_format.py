"""Numbers, units, symbols and foreign strings as page and recording print them."""

from __future__ import annotations

import re
import unicodedata
from typing import Any

from markupsafe import Markup, escape

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
HIDDEN = {"Cc", "Cf", "Co", "Cs"}
POWER = re.compile(r"\^(-?\d+)")
SYMBOL = re.compile(r"(?<![A-Za-z0-9_])([XYZKMNI])_((?:[uvwpqrxyz]|dot|\|)+)(?![A-Za-z0-9_])")
NUMERIC = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")
DOT = "\u0307"


def visible(value: Any) -> Any:
    """Return strings with control and direction characters shown as signs.

    Unpaired surrogates too, so that none of them can act.
    """
    if not isinstance(value, str) or isinstance(value, Markup):
        return value
    return "".join(
        _escaped_character(c) if unicodedata.category(c) in HIDDEN and c not in "\n\t" else c
        for c in value
    )


def _escaped_character(character: str) -> str:
    code = ord(character)
    return chr(0x2400 + code) if code < 0x20 else "\ufffd"


def symbols(words: str) -> Markup:
    """Return text escaped, with coefficients as printed.

    `X_udot`, `Y_v|v|`, `I_z` get their indices as such.
    """
    escaped = str(escape(visible(words)))
    return Markup(
        SYMBOL.sub(lambda match: f"{match[1]}<sub>{match[2].replace('dot', DOT)}</sub>", escaped)
    )


def printed_unit(unit: str) -> str:
    """A unit as engineers print it: kg*m^2 -> kg m², 1/s^2 -> 1/s²."""
    return POWER.sub(lambda match: match[1].translate(RAISED), unit).replace("*", " ")


def is_numeric(words: str) -> bool:
    """Return whether a text is a number with digits of its author's choice."""
    return NUMERIC.fullmatch(words) is not None


def term(name: str) -> str:
    """Return a basis term as printed: `v*|v|` -> v|v|, `u*u` -> u².

    `(u*v)*(eta-1)` -> uv(η−1).
    """
    factors = name.replace("(eta-1)", "η").replace("(", "").replace(")", "").split("*")
    if len(factors) >= 2 and factors[0] == factors[1]:
        factors[:2] = [f"{factors[0]}²"]
    return "".join("(η−1)" if factor == "η" else factor for factor in factors)


def number(value: float) -> str:
    """A number to four figures, integers whole, with a true minus sign."""
    if isinstance(value, int) or (value == int(value) and abs(value) < 1e6):
        words = f"{int(value)}"
    elif abs(value) >= 1000:
        words = f"{value:.0f}" if abs(value) < 1e6 else f"{value:.3e}"
    else:
        words = f"{value:.4g}"
    return printed_number(words)


def printed_number(words: str) -> str:
    """Return a number's text with a true minus sign and its power of ten.

    `-1.2e-05` -> −1.2×10⁻⁵.
    """
    mantissa, _, power = words.partition("e")
    tail = f"×10{str(int(power)).translate(RAISED)}" if power else ""
    return mantissa.replace("-", "−") + tail
