"""Unit texts that a user writes: those of the field are read, hostile ones end at once."""

from __future__ import annotations

import pytest

from auvid.data_schemas import units
from auvid.data_schemas.errors import SchemaError
from auvid.data_schemas.units import (
    NO_UNITS,
    SCALED,
    TIMES_US,
    TURNS,
    _powers,
    _registry,
    convertible,
    factor_and_offset,
)


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


COHERENT = [
    "1", "rad", "1/rad", "kg", "kg*m^2", "kg/m", "N", "N*s^2/m^2", "N*m*s", "kg*m^2/s", "kg*m/s",
    "N*m*s^2", "N*s/m", "m/s^2", "rad/s", "1/s", "Pa", "1/Pa", "N/m^2", "kg/m^3", "m/kg",
]  # fmt: skip


@pytest.mark.parametrize("unit", [*COHERENT, *SCALED])
def test_products_of_si_symbols_are_read_as_pint_reads_them(unit: str) -> None:
    pint = _registry()
    for target in (*COHERENT, "V"):
        expected = pint.Unit(unit).is_compatible_with(pint.Unit(target))
        assert convertible(unit, target) == expected
        if expected:
            one = pint.Quantity(1.0, unit).to(target).magnitude
            assert factor_and_offset(unit, target) == (pytest.approx(one, rel=1e-15), 0.0)
        else:
            with pytest.raises(SchemaError):
                factor_and_offset(unit, target)


@pytest.mark.parametrize("unit", TIMES_US)
def test_times_are_read_as_pint_reads_them(unit: str) -> None:
    pint = _registry()
    for target in TIMES_US:
        one = pint.Quantity(1.0, unit).to(target).magnitude
        assert convertible(unit, target)
        assert factor_and_offset(unit, target) == (pytest.approx(one, rel=1e-15), 0.0)
    assert not convertible(unit, "m")


def test_texts_that_are_no_units_are_none_to_pint() -> None:
    assert not any(text in _registry() for text in NO_UNITS)


def test_units_of_most_logs_load_no_registry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(units, "_registry", lambda: pytest.fail("pint is loaded"))
    factor_and_offset.cache_clear()
    assert [factor_and_offset(unit, "us")[0] for unit in TIMES_US] == [1e6, 1e3, 1.0, 1e-3]
    for unit, (factor, target) in SCALED.items():
        assert factor_and_offset(unit, target) == (factor, 0.0)
    assert not any(convertible(text, "rad") for text in NO_UNITS)
    assert all(convertible(unit, "1/s") for unit in TURNS)


@pytest.mark.parametrize(
    "unit", ["", "mm", "kgm", "m s", "m^10", "m^2^2", "/s", "m//s", "m*", "s^0"]
)
def test_other_texts_are_left_to_pint(unit: str) -> None:
    assert _powers(unit) is None
