"""Unit texts, read by pint.

SI inside: these functions are called once, where data enter.
"""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING

from auvid.data_schemas.errors import SchemaError

if TYPE_CHECKING:
    import pint

TURNS = {
    "rpm": 1.0 / 60.0,
    "rev/min": 1.0 / 60.0,
    "1/min": 1.0 / 60.0,
    "rps": 1.0,
    "rev/s": 1.0,
    "Hz": 1.0,
    "1/s": 1.0,
}
"""Units of a propeller's speed in revolutions per second; pint counts a revolution as 2
pi.
"""


LONGEST = 60
RAISED = r"(?:\*\*|\^)"
POWER = re.compile(rf"{RAISED}\s*[-+]?(\d{{1,2}})(?:\.\d+)?(?![\w.]|\s*{RAISED})")
SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")


def _harmless(unit: str) -> bool:
    """Return whether a unit text is short and its powers are plain numbers below 100.

    pint works powers out: those of 9**9**9**9 would take for ever.
    """
    plain = re.sub("[⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda run: f"^{run[0].translate(SUPERSCRIPTS)} ", unit)
    powers = [max(int(power), 1) for power in POWER.findall(plain)]
    every = len(powers) == len(re.findall(RAISED, plain))
    return len(unit) <= LONGEST and every and math.prod(powers) < 100


@cache
def _registry() -> pint.UnitRegistry[float]:
    import pint  # half a second to import, and most units need no conversion

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def convertible(unit: str, target: str) -> bool:
    """Return whether values in `unit` can be expressed in `target`.

    rad/s and 1/s count as the same, as in SI. The unit itself is not looked up: loading
    pint's registry takes a second.
    """
    if unit == target:
        return True
    if not _harmless(unit):
        return False
    try:
        return bool(_registry().Unit(unit).is_compatible_with(_registry().Unit(target)))
    except Exception:
        return False


@cache
def factor_and_offset(unit: str, target: str) -> tuple[float, float]:
    """(factor, offset) with value_in_target = factor * value_in_unit + offset.

    For the target 1/s a turn counts as 1, not 2 pi: 60 rpm are 1/s. Raises
    `SchemaError` for a unit that does not fit.
    """
    if target == "1/s" and unit.strip() in TURNS:
        return TURNS[unit.strip()], 0.0
    if unit == target:
        return 1.0, 0.0
    if not convertible(unit, target):
        raise SchemaError("unit cannot be converted", value=unit, allowed=f"a unit of {target}")
    quantity = _registry().Quantity
    zero = float(quantity(0.0, unit).to(target).magnitude)
    one = float(quantity(1.0, unit).to(target).magnitude)
    return one - zero, zero
