"""Unit texts, read by pint. SI inside: these functions are called once, where data enter."""

from __future__ import annotations

from functools import cache

import pint

from data_schemas.errors import SchemaError


@cache
def _registry() -> pint.UnitRegistry[float]:
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def convertible(unit: str, target: str) -> bool:
    """Whether values in `unit` can be expressed in `target` (rad/s and 1/s count as the same, as in SI)."""
    try:
        return bool(_registry().Unit(unit).is_compatible_with(_registry().Unit(target)))
    except Exception:
        return False


@cache
def factor_and_offset(unit: str, target: str) -> tuple[float, float]:
    """(factor, offset) with value_in_target = factor * value_in_unit + offset. Raises `SchemaError` for a unit that does not fit."""
    if not convertible(unit, target):
        raise SchemaError("unit cannot be converted", value=unit, allowed=f"a unit of {target}")
    quantity = _registry().Quantity
    zero = float(quantity(0.0, unit).to(target).magnitude)
    one = float(quantity(1.0, unit).to(target).magnitude)
    return one - zero, zero
