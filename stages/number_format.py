"""Numbers, units, symbols and foreign strings as page and terminal print them."""

from __future__ import annotations

import math
import re
import unicodedata
from functools import lru_cache
from typing import Any

from markupsafe import Markup, escape

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
HIDDEN = {"Cc", "Cf", "Co", "Cs"}
POWER = re.compile(r"\^(-?\d+)")
SYMBOL = re.compile(r"(?<![A-Za-z0-9_])([XYZKMNI])_((?:[uvwpqrxyzV]|dot|\||0)+)(?![A-Za-z0-9_])")
WING = re.compile(r"(?<![A-Za-z0-9_])(?:C_([DL])(\d?)(_alpha)?|alpha(?:_(0))?)(?![A-Za-z0-9_])")
NUMERIC = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")
BETWEEN_WORDS = re.compile(r"(?<=[a-z]{3})_(?=[a-z]{3})|(?<=\bas)_")
"""No mark of an index, which follows one letter: X_udot."""
DOT = "\u0307"

SIMULATED_PERCENT = 30.0
"""Held-out fit from which on an axis is good for simulation; a constant has 0. Below, its
coefficients are weak at best, whatever their errors.
"""
CONTROL_PERCENT = 50.0
"""Held-out fit from which on it is good for the design of a controller."""
LEAST_FIT = -100.0
"""Fit [%] below which a simulated motion has nothing to do with the measured one."""


def significant(value: float | None, digits: int = 3, *, sign: str = "", empty: str = "-") -> str:
    """Return a number to some significant digits, without an exponent below a million.

    `sign="+"` marks a gain.

    >>> significant(0.017321), significant(0.5, sign="+"), significant(12345.6)
    ('0.0173', '+0.5', '12346')
    """
    if value is None:
        return empty
    plain = 10.0**digits <= abs(value) < 1e6
    return f"{value:{sign}.0f}" if plain else f"{value:{sign}.{digits}g}"


def fixed(value: float | None, places: int, *, empty: str = "-") -> str:
    """Return a number to some decimals, to whole tens or hundreds below none.

    >>> fixed(-0.4512, 2), fixed(1234.5, -1)
    ('-0.45', '1230')
    """
    return empty if value is None else f"{round(value, places):.{max(0, places)}f}"


def as_printed(value: float | None, *, places: int = 4, empty: str = "-") -> str:
    """Return a number to the decimals of a printed table, tiny ones by their size.

    >>> as_printed(-27.9347), as_printed(1.2e-5), as_printed(3.9251, places=2)
    ('-27.9347', '1.2e-05', '3.93')
    """
    if value is None:
        return empty
    large = value == 0.0 or abs(value) >= 10.0 ** (1 - places)
    return f"{value:.{places}f}" if large else f"{value:.2g}"


def percent(share: float | None, digits: int = 3, *, sign: str = "", empty: str = "-") -> str:
    """Return a share in percent: `0.5 %`."""
    return empty if share is None else f"{significant(100.0 * share, digits, sign=sign)} %"


def fit_in_percent(percent: float | None) -> str:
    """Return the fit [%] of a motion; none below that of twice the error of the mean.

    What misses a bound of use is not rounded up to it.

    >>> fit_in_percent(61.4), fit_in_percent(-1506369.0), fit_in_percent(float("nan"))
    ('61 %', 'below -100 %', 'not judged')
    >>> fit_in_percent(29.7), fit_in_percent(49.97), fit_in_percent(30.0)
    ('29.7 %', '49.9 %', '30 %')
    """
    if percent is None or not math.isfinite(percent):
        return "not judged"
    if any(bound - 0.5 <= percent < bound for bound in (SIMULATED_PERCENT, CONTROL_PERCENT)):
        return f"{math.floor(10.0 * percent) / 10.0:.1f} %"
    return f"{percent:.0f} %" if percent >= LEAST_FIT else f"below {LEAST_FIT:.0f} %"


def with_unit(words: str, unit: str) -> str:
    """Return a number's text with its unit; a ratio has none."""
    return words if unit in ("", "1") else f"{words} {unit}"


def places_of_error(error: float, value: float = 0.0) -> int:
    """Return the decimals that show an error to two figures (GUM 7.2.6).

    No more than give a value six figures.

    >>> places_of_error(0.9), places_of_error(0.0123), places_of_error(412.0)
    (2, 3, -1)
    >>> places_of_error(1e-9, 34.0)
    4
    """
    places = 1 - math.floor(math.log10(error))
    return min(places, 5 - math.floor(math.log10(abs(value)))) if value else places


def estimate(value: float | None, half_width: float | None, *, empty: str = "-") -> str:
    """Return a number and the half width of its interval to the figures of the latter.

    >>> estimate(-13.512, 0.196), estimate(34.0, None)
    ('-13.51 ± 0.20', '34')
    """
    if value is None or not half_width or not math.isfinite(half_width):
        return significant(value, 5, empty=empty)
    places = places_of_error(half_width)
    return f"{fixed(value, places)} ± {fixed(half_width, places)}"


def interval(value: float, half_width: float) -> str:
    """Return the ends of an interval as those who add up `estimate` get them.

    >>> interval(14.55, 6.44), interval(-75.6, 40.6)
    ('8.2 to 21.0', '-117 to -35')
    """
    places = places_of_error(half_width)
    middle, half = round(value, places), round(half_width, places)
    return f"{fixed(middle - half, places)} to {fixed(middle + half, places)}"


def part_of(half_width: float, part: float) -> str:
    """Return what a part adds to a half width, to the figures of the latter.

    One figure at least, so that no part is printed as zero.

    >>> part_of(23.2, 22.9), part_of(23.2, 3.6), part_of(23.2, 0.26)
    ('± 23', '± 4', '± 0.3')
    """
    words = fixed(part, places_of_error(half_width))
    return f"± {significant(part, 1) if part and not float(words) else words}"


def in_words(name: str) -> str:
    """Return the name of a figure for people.

    >>> in_words("rms cross-track, helix, side_force"), in_words("m - X_udot")
    ('RMS cross-track, helix, side force', 'm - X_udot')
    """
    return BETWEEN_WORDS.sub(" ", name.replace("rms ", "RMS "))


def true_minus(words: str) -> str:
    """Hyphens before numbers as minus signs; dates and names keep theirs."""
    return re.sub(r"(?<![\w.])-(?=\d)", "−", words)


def visible(value: Any) -> Any:
    """Return strings with control and direction characters shown as signs.

    Unpaired surrogates too, so that none of them can act.
    """
    if not isinstance(value, str) or isinstance(value, Markup) or value.isprintable():
        return value
    return value.translate(_VISIBLE)


class _VisibleForms(dict[int, int | str]):
    """What stands for a character: looked up once for each there is."""

    def __missing__(self, code: int) -> int | str:
        hides = unicodedata.category(chr(code)) in HIDDEN and chr(code) not in "\n\t"
        sign = chr(0x2400 + code) if code < 0x20 else "\ufffd"
        self[code] = sign if hides else code
        return self[code]


_VISIBLE = _VisibleForms()


@lru_cache(maxsize=4096, typed=True)  # text that is escaped already is another text
def symbols(words: str) -> Markup:
    """Return text escaped, with coefficients as printed.

    `X_udot`, `Y_v|v|`, `I_z` and a glider's `C_D0`, `C_L_alpha`, `alpha_0` get their
    indices as such.
    """
    escaped = WING.sub(_wing, str(escape(visible(words))).replace(")^2", ")²"))
    return Markup(
        SYMBOL.sub(lambda match: f"{match[1]}<sub>{match[2].replace('dot', DOT)}</sub>", escaped)
    )


def _wing(match: re.Match[str]) -> str:
    if match[1]:
        return f"C<sub>{match[1]}{match[2]}{'α' if match[3] else ''}</sub>"
    return f"α<sub>{match[4]}</sub>" if match[4] else "α"


def printed_unit(unit: str) -> str:
    """Return a unit as engineers print it: kg*m^2 -> kg m², 1/s^2 -> 1/s²."""
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
    """Return a number to four figures, integers whole, with a true minus sign."""
    if isinstance(value, int):
        return printed_number(f"{value}")
    return printed_number(f"{value:.3e}" if abs(value) >= 1e6 else significant(value, 4))


def printed_number(words: str) -> str:
    """Return a number's text with a true minus sign and its power of ten.

    `-1.2e-05` -> −1.2×10⁻⁵.
    """
    mantissa, _, power = words.partition("e")
    tail = f"×10{str(int(power)).translate(RAISED)}" if power else ""
    return mantissa.replace("-", "−") + tail
