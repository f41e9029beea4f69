"""The language of `auvid fleet find`."""

from __future__ import annotations

import pytest

from auvid.data_schemas.errors import UsageError
from auvid.pipeline.commands.fleet.queries.expression import parse

FIELDS = ("state", "surge", "ratio", "vehicle", "start_utc", "log", "file", "model")
ROW = {
    "state": "done",
    "surge": "not excited",
    "ratio": 0.3,
    "vehicle": "bluerov2",
    "start_utc": "2026-01-07T10:00:00Z",
    "log": "a b",
    "file": "/disk/00000012.BIN",
    "model": "7",
    "X_u": -20.0,
    "X_u verdict": "weak",
    "Y_v": None,
}


@pytest.mark.parametrize(
    ("expression", "holds"),
    [
        ("state = done", True),
        ("state != done", False),
        ("J/J0 < .5 and ratio >= 0.3", True),
        ("surge = not excited and state = done", True),
        ("surge = 'not excited'", True),
        ("not state = refused", True),
        ("not not state = done", True),
        ("state = refused or (state = done and J/J0 < 1)", True),
        ("state = refused and state = done or state = done", True),
        ("state = refused and (state = done or state = done)", False),
        ("X_u < -10", True),
        ("X_u = weak", True),
        ("Y_v < 0", False),
        ("Y_v > 0", False),
        ("N_r = identified", False),
        ("vehicle ~ rov", True),
        ("start > 2026-01-01", True),
        ("ratio = done", False),
        ("state < 3", False),
        ("state > 3", False),
        ("start ~ 2026", True),
        ("start > 2026", True),
        ("start > 2027", False),
        ("file ~ 00000012", True),
        ("model = 7", True),
        ("model != 7", False),
        ("X_u ~ 20", True),
    ],
)
def test_an_expression_holds_or_not(expression: str, holds: bool) -> None:
    assert parse(expression, FIELDS)(ROW) is holds


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        ("", "a name is missing"),
        ("surg = identified", "Did you mean 'surge'"),
        ("__import__('os')", "no such field"),
        ("state", "a comparison is missing"),
        ("state done", "no comparison"),
        ("state =", "a value is missing"),
        ("state = = done", "a value is missing"),
        ("(state = done", "a bracket is not closed"),
        ("state = done)", "or the end is missing"),
        ("state = 'done", "cannot be read"),
        ("state ! done", "cannot be read"),
        ("(" * 200 + "state = done" + ")" * 200, "too many brackets"),
    ],
)
def test_what_the_language_has_not_is_refused(expression: str, words: str) -> None:
    with pytest.raises(UsageError, match=words.replace("(", r"\(")):
        parse(expression, FIELDS)


def test_a_coefficient_that_no_log_has_is_refused_with_the_nearest() -> None:
    with pytest.raises(UsageError, match=r"no log has this coefficient") as fault:
        parse("X_uu < 0", FIELDS, ["X_u|u|", "N_r"])
    assert "X_u|u|" in str(fault.value)
    assert parse("X_u|u| < 0", FIELDS, ["X_u|u|", "N_r"])({"X_u|u|": -3.0})
