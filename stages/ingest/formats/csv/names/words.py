"""The words of a column's name, whole or run together, and the unit that ends them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from functools import cache

from auvid.stages.ingest.formats.csv.names.lexicon import (
    ALIASES,
    AXES,
    FIN_LETTERS,
    LETTERS,
    NO_MEASUREMENT,
    PHRASES,
    QUANTITIES,
    SHORT_OUTPUTS,
    SOURCES,
    WORLD,
)
from auvid.stages.ingest.formats.csv.names.unit_words import (
    CASED,
    UNIT_TEXTS,
    UNITS,
    unit_of_text,
    units_at_end,
)

WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
BRACKET = re.compile(r"\s*[\[({]([^\[\](){}]*)[\])}]\s*$")
INDEX = re.compile(r"(?<=\w)[\[({]([0-9])[\])}]\s*$")
"""`gyro[1]` is the second of several, `gain [1]` has no unit."""
LEVEL = re.compile(r"(?<=\w)[/.:](?=\w)|^/")
"""What parts the levels of a name: a topic, a message, a field."""
SHORTEST = 3
"""Letters of a word that stands within another."""
PAIRS = re.compile(r"[vawgp][xyz]|q[wxyz]")
BEHIND = re.compile(
    r"(?:(?<=[\s_])|^)(" + "|".join(re.escape(text) for text in UNIT_TEXTS if "/" in text) + r")$"
)
"""A unit with a stroke, which is no level."""

QUANTITY_OF: dict[str, str] = {
    word: quantity for quantity, words in QUANTITIES.items() for word in words.split()
}

Reading = tuple[tuple[str, ...], str]
"""Words of a name before its unit, and that unit or ''."""


@cache
def vocabulary() -> frozenset[str]:
    """Return every word that means something in a name."""
    words = {*QUANTITY_OF, *AXES, *FIN_LETTERS, *LETTERS, *SHORT_OUTPUTS, *ALIASES}
    words |= {*SOURCES, *NO_MEASUREMENT, *WORLD}
    words |= {word for phrase in (*PHRASES, *UNITS) for word in phrase}
    return frozenset(words)


def plain_words(text: str) -> list[str]:
    """Return the words of a text in small letters, without accents, none run together.

    >>> plain_words("accélérationX"), plain_words("xgyro"), plain_words("IMU2_GyrX")
    (['acceleration', 'x'], ['x', 'gyro'], ['imu', '2', 'gyr', 'x'])
    """
    flat = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    flat = CASED.sub(lambda match: match[0].lower(), flat)
    parts = [part for word in WORDS.findall(flat) for part in _parted(word.lower())]
    return [ALIASES.get(word, word) for word in parts]


@cache
def _parted(word: str) -> tuple[str, ...]:
    """Return the words that run together in one: rollrate, xacc, vx."""
    if word in vocabulary() or word.isdigit():
        return (word,)
    if PAIRS.fullmatch(word):
        return tuple(word)
    for axis in "xyz":
        if word.startswith(axis) and (rest := _run_together(word[1:])):
            return (axis, *rest)
        if word.endswith(axis) and (rest := _run_together(word[:-1])):
            return (*rest, axis)
    return _run_together(word) or (word,)


def _run_together(word: str) -> tuple[str, ...]:
    """Return words of the vocabulary that make up one; empty where none do."""
    if len(word) < SHORTEST:
        return ()
    if word in vocabulary():
        return (word,)
    for size in range(len(word) - SHORTEST, SHORTEST - 1, -1):
        if word[:size] in vocabulary() and (rest := _run_together(word[size:])):
            return (word[:size], *rest)
    return ()


def readings(name: str) -> list[Reading]:
    """Return words and unit of a name for each unit that may end it; the longest first.

    The last is that without a unit at its end. Words of upper levels that mean nothing are
    those of topics, and left out.
    """
    index = INDEX.search(name)
    if index:
        return [((*words, index[1]), unit) for words, unit in readings(name[: index.start()])]
    units: tuple[str, ...] = ()
    bracket = BRACKET.search(name) or BEHIND.search(name)
    if bracket:
        units = unit_of_text(bracket[1], plain_words(bracket[1]))
        name = name[: bracket.start()] if units and bracket.start() else name
    words = _words_of_levels(name)
    if not units and len(words) == 1 and words[0] in QUANTITY_OF:
        units = UNITS.get(words, ())  # millivolt, rpm
    if units:
        return [(words, unit) for unit in units]
    behind = len(words)
    while behind > 1 and words[behind - 1] in SOURCES:
        behind -= 1  # depth_m_filtered
    before_sources = units_at_end(words[:behind]) if behind < len(words) else []
    return [*units_at_end(words), *before_sources, (words, "")]


def _words_of_levels(name: str) -> tuple[str, ...]:
    *upper, last = [plain_words(level) for level in LEVEL.split(name) if level] or [[]]
    if upper and all(len(word) == 1 for word in last):  # an axis: what it is stands above
        last = [*upper.pop(), *last]
    words = [word for level in upper for word in _meaningful(level)]
    return (*words, *last)


def _meaningful(level: Sequence[str]) -> list[str]:
    """Return the words of an upper level that mean something.

    A number counts behind an actuator: thrusters/0/input, not behind a vehicle. A
    `status` there is a topic.
    """
    return [
        word
        for word, before in zip(level, ("", *level), strict=False)
        if word != "status"
        and (QUANTITY_OF.get(before) == "output" if word.isdigit() else word in vocabulary())
    ]
