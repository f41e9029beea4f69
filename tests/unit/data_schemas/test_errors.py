"""What an error message shows of a value: never more than a line, whatever the value is."""

from __future__ import annotations

import time

import pytest

from auvid.data_schemas.errors import LONGEST_VALUE, PipelineError, as_text


@pytest.mark.parametrize("value", [3.5, "north", ["u", "v"], {"unit": "m", "value": 1}, -7, b"x"])
def test_short_values_are_shown_in_full(value: object) -> None:
    assert as_text(value) == repr(value)


def test_nested_repetition_is_cut_without_being_built() -> None:
    value: object = "l" * 10
    for _ in range(12):
        value = [value] * 10
    start = time.process_time()
    assert len(str(PipelineError("wrong type", value=value))) < LONGEST_VALUE + 50
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize(
    "value", ["x" * 10_000, 10**400, 1 << 40_000, {"k" * 999: "v" * 999}], ids=range(4)
)
def test_long_values_are_cut(value: object) -> None:
    assert len(as_text(value)) <= LONGEST_VALUE
