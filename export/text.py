"""Numbers and names as text of the targets' languages: every number in full."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import UsageError

OCTAVE_WORDS = {
    "break", "case", "catch", "classdef", "continue", "do", "else", "elseif", "end",
    "end_try_catch", "end_unwind_protect", "endfor", "endfunction", "endif", "endparfor",
    "endswitch", "endwhile", "enumeration", "events", "for", "function", "global", "if",
    "methods", "otherwise", "parfor", "persistent", "properties", "return", "spmd",
    "switch", "try", "until", "unwind_protect", "unwind_protect_cleanup", "while",
}  # fmt: skip
LONGEST_NAME = 63
"""Characters that MATLAB reads of a name (namelengthmax)."""


def number(value: float) -> str:
    """Return a number so that it reads back as the same one; -0.0 is 0.0.

    >>> number(0.1), number(-0.0), number(1e-7)
    ('0.1', '0.0', '1e-07')
    """
    return repr(float(value) + 0.0)


def numbers(values: ArrayLike, between: str = " ") -> str:
    """Return numbers in full, in one line."""
    return between.join(number(value) for value in np.asarray(values, dtype=np.float64).ravel())


def python_rows(matrix: ArrayLike) -> str:
    """Return a matrix as a tuple of tuples of Python, a row per line."""
    rows = [f"    ({numbers(row, ', ')}),\n" for row in np.asarray(matrix)]
    return f"(\n{''.join(rows)})"


def python_tuple(values: ArrayLike) -> str:
    """Return numbers as a tuple of Python."""
    row = np.asarray(values, dtype=np.float64).ravel()
    return f"({numbers(row, ', ')}{',' if len(row) == 1 else ''})"


def octave_matrix(matrix: ArrayLike, indent: str = "  ") -> str:
    """Return a matrix in Octave and MATLAB, a row per line."""
    rows = np.atleast_2d(np.asarray(matrix, dtype=np.float64))
    return f"[ ...\n{indent}" + f"; ...\n{indent}".join(numbers(row) for row in rows) + "]"


def xml_comment(lines: Iterable[str]) -> str:
    """Return lines as one comment of XML, in which no two hyphens may follow."""
    inside = "\n  ".join(re.sub("-(?=-)", "- ", line) for line in lines)
    return f"<!--\n  {inside}\n-->\n"


def one_line(text: str) -> str:
    """Return text with every run of blanks and line breaks as one blank.

    >>> one_line("A vehicle\\n  of ours")
    'A vehicle of ours'
    """
    return " ".join(text.split())


def commented(lines: Iterable[str], mark: str) -> str:
    """Return lines as comment lines that begin with a mark."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines)


def docstring(text: str) -> str:
    """Return text without what would end or escape a docstring of Python."""
    return text.replace("\\", "/").replace('"""', "'''")


def identifier(name: str) -> str:
    """Return a name that Python, Octave, MATLAB and XML take.

    Raises `UsageError` that says what is wrong, with the nearest good name.
    """
    plain = re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) and len(name) <= LONGEST_NAME
    if plain and not keyword.iskeyword(name) and name not in OCTAVE_WORDS:
        return name
    better = sanitised(name)
    raise UsageError(
        "not a name that can be written into the file",
        field="name",
        value=name,
        allowed=f"letters, digits and _, a letter first, at most {LONGEST_NAME},"
        " no word of the language",
        remedy=f"Take for example {better}.",
    )


def sanitised(name: str) -> str:
    """Return the nearest name that is an identifier.

    >>> sanitised("BlueROV2 (heavy)"), sanitised("4th"), sanitised("end")
    ('BlueROV2_heavy', 'model_4th', 'end_model')
    """
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
    if not plain or not plain[0].isalpha():
        plain = f"model_{plain}".rstrip("_")
    if keyword.iskeyword(plain) or plain in OCTAVE_WORDS:
        plain = f"{plain}_model"
    return plain[:LONGEST_NAME]


def product(value: float, factors: Sequence[str]) -> str:
    """Return value * factors in the words that Python, Octave and MATLAB share.

    >>> product(-2.5, ["v", "|r|"]), product(0.1, ["u", "u", "eta-1"]), product(3.0, [])
    ('-2.5*v*abs(r)', '0.1*u*u*excess', '3.0')
    """
    words = [number(value)]
    for name in factors:
        words.append("excess" if name == "eta-1" else re.sub(r"\|(\w)\|", r"abs(\1)", name))
    return "*".join(words)
