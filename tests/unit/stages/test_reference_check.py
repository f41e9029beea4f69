"""One check: what is met, by how much it is missed, and its text and JSON."""

from __future__ import annotations

from dataclasses import replace

import pytest

from auvid.stages.reference_check import (
    JUDGED,
    MOVED,
    ReferenceCheck,
    Tolerance,
    check_rows,
    count_bounds,
    count_met,
)


def near(value: float | None, reference: float | None, **limits: float) -> ReferenceCheck:
    return ReferenceCheck("J", value, "N", reference=reference, tolerance=Tolerance(**limits))


def test_larger_of_relative_and_absolute_counts() -> None:
    tolerance = Tolerance(relative=0.01, absolute=0.0005)
    assert [tolerance.allowed(value) for value in (1.0, -1.0, 0.01)] == [0.01, 0.01, 0.0005]


@pytest.mark.parametrize(
    ("value", "reference", "relative", "met"),
    [
        (None, 1.0, 0.1, False),
        (1.0, None, 0.1, False),
        (None, None, 0.0, True),
        (1.0 + 1e-9, 1.0, 1e-6, True),
        (1e-30, 0.0, 1e-6, False),
        (1.01, 1.0, 0.01, True),
        (1.0101, 1.0, 0.01, False),
    ],
)
def test_near_a_reference(
    value: float | None, reference: float | None, relative: float, met: bool
) -> None:
    assert near(value, reference, relative=relative).met is met


def test_change_in_standard_errors_and_status() -> None:
    check = ReferenceCheck(
        "X u",
        -4.0,
        "N s/m",
        reference=-3.0,
        tolerance=Tolerance(relative=1e-6),
        standard_error=0.4,
        reference_error=0.3,
        status="identified",
        required_status="weak",
    )
    assert check.standard_errors == pytest.approx(2.0)
    assert replace(check, value=None).standard_errors is None
    assert check.cells["status"] == "weak -> identified"
    assert check.cells["measured"] == "-4.00 ± 0.78"
    same = replace(check, value=-3.0)
    assert same.met is False, "another verdict is a change too"
    assert replace(same, status="weak").met is True


def test_bounds_and_accepted_misses() -> None:
    check = ReferenceCheck("RMS", 1.0, "m/s", least=0.5, low=0.6, high=0.9)
    assert (check.met, check.failed, check.verdict) == (False, True, "missed")
    assert check.shortfall == "0.5 to 1 m/s, required 0.6 to 0.9"
    accepted = replace(check, accepted_reason="known")
    assert (accepted.failed, accepted.cells["reason"]) == (False, "known")
    assert replace(check, low=None, high=None).met is None
    assert (
        count_met([check, replace(check, low=0.5, high=1.0), ReferenceCheck("m", 1.0)]) == "1 of 2"
    )


def test_only_bounds_that_could_be_missed_count_as_tests() -> None:
    test = ReferenceCheck("J", 1.0, high=2.0)
    assert count_bounds([test, replace(test, high=0.5), ReferenceCheck("m", 1.0)]) == "1 of 2 met"
    holds = replace(test, evidence="construction")
    assert (
        count_bounds([holds, holds])
        == "0 of 2 test the method (0 met), 2 hold by construction (2 met)"
    )
    assert holds.cells["shows"] == "holds by construction"


def test_rows_leave_empty_columns_out() -> None:
    cell = near(2.5, 2.0, relative=0.005)
    assert check_rows(("use", "model"), [(("training", "linear"), cell)], MOVED) == (
        ["use", "model", "quantity", "reference", "measured", "unit", "change", "tolerance",
         "times tolerance"],
        [["training", "linear", "J", "2", "2.5", "N", "+0.5 (+25 %)", "0.01", "50.0"]],
    )  # fmt: skip
    bound = ReferenceCheck("RMS", 0.0173, high=0.02)
    assert check_rows((), [((), bound)], JUDGED) == (
        ["quantity", "measured", "required", "verdict"],
        [["RMS", "0.0173", "at most 0.02", "met"]],
    )


def test_json_holds_number_reference_and_distance() -> None:
    document = near(2.5, 2.0, relative=0.005).document
    assert document["tolerance"]["relative"] == 0.005
    assert {name: document[name] for name in ("value", "reference", "change", "verdict")} == {
        "value": 2.5,
        "reference": 2.0,
        "change": 0.5,
        "verdict": "missed",
    }
    assert document["times_tolerance"] == pytest.approx(50.0)
