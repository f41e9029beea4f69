"""Unit texts that a user writes: those of the field are read, hostile ones end at once."""

from __future__ import annotations

import pytest

from auvid.data_schemas.units import convertible


@pytest.mark.parametrize(
    ("unit", "target"),
    [("m/s**2", "m/s^2"), ("kg m²", "kg m^2"), ("m** 2 / s", "m^2/s"), ("m^-1", "1/m")],
)
def test_powers_of_the_field_are_read(unit: str, target: str) -> None:
    assert convertible(unit, target)


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    "unit",
    [
        "9**9**9**9 m",
        "m*9^9 ^9^9",
        "m*9**(9**9)",
        "m*((9**99)**99)**99",
        "m*9⁹⁹⁹⁹⁹",
        "m*9⁹**99",
        "m*9**9e9",
        "m*9**9_999",
        "m**99999999999",
        "m" * 61,
    ],
)
def test_powers_that_would_not_end_are_refused(unit: str) -> None:
    assert not convertible(unit, "m")
