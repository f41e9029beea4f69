"""The language of `auvid fleet find`: comparisons joined by and, or, not, brackets.

    surge = identified and J/J0 < .5
    vehicle = bluerov2 and (X_u < -20 or X_u = weak) and not state = refused

A name is a column of table `runs`, or a coefficient of the recommended model as `X_u`
or `X_u|u|`: compared with a number it is the value, with words the verdict. Nothing is
evaluated but what stands here.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from auvid.data_schemas.errors import UsageError, nearest

TOKEN = re.compile(
    r"\s*(?:(?P<operator><=|>=|!=|==|[=<>~()])|\"(?P<double>[^\"]*)\"|'(?P<single>[^']*)'"
    r"|(?P<word>[^\s=<>!~()\"']+))"
)
COEFFICIENT = re.compile(r"[XYZKMN]_.+")
ALIASES = {"J/J0": "ratio", "id": "log", "start": "start_utc", "duration": "duration_s"}
OPERATORS: Mapping[str, Callable[[Any, Any], bool]] = {
    "=": operator.eq,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "~": lambda text, part: str(part) in str(text),
}
ORDERS = (operator.lt, operator.le, operator.gt, operator.ge)
"""Between a word and a number they say nothing, between a day and a year they do."""
DEEPEST = 50
EXAMPLE = "surge = identified and J/J0 < .5"
Row = Mapping[str, Any]
Test = Callable[[Row], bool]


@dataclass(frozen=True)
class Token:
    """A word, an operator or a quoted text, and where it stands."""

    text: str
    kind: str
    at: int


def parse(expression: str, fields: Collection[str], coefficients: Collection[str] = ()) -> Test:
    """Return the test of a row. Raises `UsageError` for what the language has not.

    fields: columns of table `runs`. coefficients: those that the logs have; where there
    are any, another one is refused. What a row does not have is neither equal nor
    unequal to anything.

    >>> parse("surge = identified and J/J0 < .5", ["surge", "ratio"])(
    ...     {"surge": "identified", "ratio": 0.3})
    True
    """
    reader = _Reader(expression, tuple(fields), tuple(coefficients))
    test = reader.either(0)
    reader.end()
    return test


class _Reader:
    """Reads an expression from the left: or binds less than and, and less than not."""

    def __init__(
        self, expression: str, fields: tuple[str, ...], coefficients: tuple[str, ...]
    ) -> None:
        self.expression, self.fields, self.place = expression, fields, 0
        self.coefficients = coefficients
        self.tokens = list(_tokens(expression))

    def either(self, depth: int) -> Test:
        tests = [self.both(depth)]
        while self._take("or"):
            tests.append(self.both(depth))
        return tests[0] if len(tests) == 1 else lambda row: any(test(row) for test in tests)

    def both(self, depth: int) -> Test:
        tests = [self.single(depth)]
        while self._take("and"):
            tests.append(self.single(depth))
        return tests[0] if len(tests) == 1 else lambda row: all(test(row) for test in tests)

    def single(self, depth: int) -> Test:
        if depth > DEEPEST:
            raise self._fault("too many brackets")
        if self._take("not"):
            inner = self.single(depth + 1)
            return lambda row: not inner(row)
        if self._take("("):
            inner = self.either(depth + 1)
            if not self._take(")"):
                raise self._fault("a bracket is not closed")
            return inner
        return self._comparison()

    def end(self) -> None:
        if self.place < len(self.tokens):
            raise self._fault("and, or, or the end is missing here")

    def _comparison(self) -> Test:
        token = self._next("a name is missing")
        field = self._field(token)
        sign = self._next("a comparison is missing")
        if sign.kind != "operator" or sign.text not in OPERATORS:
            raise self._fault("no comparison", sign.text, tuple(OPERATORS))
        text, number = self._value()
        compare = OPERATORS[sign.text]
        if COEFFICIENT.fullmatch(field):
            part = f"{field} verdict" if number is None else field
            return lambda row: _holds(compare, row.get(part), text, number)
        return lambda row: _holds(compare, row.get(field), text, number)

    def _field(self, token: Token) -> str:
        name = ALIASES.get(token.text, token.text)
        if name in self.fields or name in self.coefficients:
            return name
        if COEFFICIENT.fullmatch(name):
            if not self.coefficients:
                return name
            raise UsageError(
                "no log has this coefficient",
                field=self.expression,
                value=token.text,
                allowed=self.coefficients,
                remedy=nearest(token.text, self.coefficients),
            )
        raise UsageError(
            "no such field",
            field=self.expression,
            value=token.text,
            allowed=f"{', '.join((*ALIASES, *self.fields))}, or a coefficient as X_u, N_r|r|",
            remedy=nearest(token.text, (*ALIASES, *self.fields)),
        )

    def _value(self) -> tuple[str, float | None]:
        """Return the words up to the next joint, and the number where they are one."""
        token = self._next("a value is missing")
        if token.kind == "text":
            return token.text, None
        if token.kind == "operator":
            raise self._fault("a value is missing", token.text)
        words = [token.text]
        while self.place < len(self.tokens):
            token = self.tokens[self.place]
            if token.kind != "word" or token.text in ("and", "or"):
                break
            words.append(token.text)
            self.place += 1
        text = " ".join(words)
        try:
            return text, float(text)
        except ValueError:
            return text, None

    def _take(self, text: str) -> bool:
        token = self.tokens[self.place] if self.place < len(self.tokens) else None
        if token is None or token.kind == "text" or token.text != text:
            return False
        self.place += 1
        return True

    def _next(self, words: str) -> Token:
        if self.place >= len(self.tokens):
            raise self._fault(words)
        self.place += 1
        return self.tokens[self.place - 1]

    def _fault(
        self, words: str, value: object = None, allowed: tuple[str, ...] | None = None
    ) -> UsageError:
        at = self.tokens[self.place].at if self.place < len(self.tokens) else None
        rest = "at its end" if at is None else f"before '{self.expression[at:]}'"
        return UsageError(
            f"{words} {rest}",
            field=self.expression,
            value=value,
            allowed=allowed,
            remedy=f'As: "{EXAMPLE}".',
        )


def _tokens(expression: str) -> Iterator[Token]:
    place = 0
    while expression[place:].strip():
        match = TOKEN.match(expression, place)
        if match is None:
            raise UsageError(
                "cannot be read", field=expression, value=expression[place:].strip()[:20]
            )
        kind = "operator" if match["operator"] else "word" if match["word"] else "text"
        text = next(part for part in match.groups() if part is not None)
        yield Token(text, kind, match.end() - len(match[0].lstrip()))
        place = match.end()


def _holds(compare: Callable[[Any, Any], bool], cell: Any, text: str, number: float | None) -> bool:
    """Return whether a cell compares so; to a text (a name, a day) digits are text."""
    if cell is None or cell == "":
        return compare is operator.eq and text == ""
    if isinstance(cell, bool):
        cell = "yes" if cell else "no"
    if isinstance(cell, str) and number is not None and compare in ORDERS:
        return cell[0].isdigit() and bool(compare(cell, text))
    if isinstance(cell, str) or compare is OPERATORS["~"]:
        return bool(compare(cell, text))
    return number is not None and bool(compare(cell, number))
