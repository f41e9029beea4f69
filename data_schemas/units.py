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

NEUTRAL_US = 1500.0
"""Pulse of a thruster at rest [us]."""
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


SYMBOLS = {
    "1": (0, 0, 0),
    "rad": (0, 0, 0),
    "kg": (1, 0, 0),
    "m": (0, 1, 0),
    "s": (0, 0, 1),
    "N": (1, 1, -2),
    "Pa": (1, -1, -2),
}
"""Powers of kg, m and s of coherent units: products of them convert by a factor of 1."""
SCALED = {
    "deg": (math.pi / 180.0, "rad"),
    "deg/s": (math.pi / 180.0, "rad/s"),
    "mm": (1e-3, "m"),
    "cm": (1e-2, "m"),
    "cm/s": (1e-2, "m/s"),
    "mm/s": (1e-3, "m/s"),
    "mrad/s": (1e-3, "rad/s"),
    "mbar": (1e2, "Pa"),
    "mV": (1e-3, "V"),
}
"""Units of most logs in coherent ones."""
NO_UNITS = frozenset({"degheading", "deglatitude", "deglongitude"})
"""Texts of DataFlash logs that say more than a unit: pint does not read them."""
TIMES_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
"""Units of times of most logs in microseconds."""
FACTOR = r"(1|rad|kg|m|s|N|Pa)(?:\^([1-9]))?"
PRODUCT = re.compile(rf"{FACTOR}(?:[*/]{FACTOR})*")


def _powers(unit: str) -> tuple[int, int, int] | None:
    """Return the powers of kg, m and s of a product of `SYMBOLS`; None of other texts.

    >>> _powers("N*s^2/m^2"), _powers("rad/s"), _powers("mm")
    ((1, -1, 0), (0, 0, -1), None)
    """
    if not PRODUCT.fullmatch(unit):
        return None
    powers = [0, 0, 0]
    for sign, symbol, power in re.findall(f"([*/]?){FACTOR}", unit):
        times = int(power or 1) * (-1 if sign == "/" else 1)
        powers = [own + times * part for own, part in zip(powers, SYMBOLS[symbol], strict=True)]
    return powers[0], powers[1], powers[2]


@cache
def _registry() -> pint.UnitRegistry[float]:
    import pint  # half a second to import, and most units need no conversion

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def convertible(unit: str, target: str) -> bool:
    """Return whether values in `unit` can be expressed in `target`.

    rad/s and 1/s count as the same, as in SI. Neither the unit itself, times of logs nor
    products of SI symbols are looked up: loading pint's registry takes half a second.
    """
    if unit == target or (unit in TIMES_US and target in TIMES_US):
        return True
    if unit in NO_UNITS:
        return False
    if target == "1/s" and unit.strip() in TURNS:
        return True
    _, coherent = SCALED.get(unit, (1.0, unit))
    if coherent == target:
        return True
    if (own := _powers(coherent)) is not None and (other := _powers(target)) is not None:
        return own == other
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
    if unit in TIMES_US and target in TIMES_US:
        return TIMES_US[unit] / TIMES_US[target], 0.0
    if not convertible(unit, target):
        raise SchemaError("unit cannot be converted", value=unit, allowed=f"a unit of {target}")
    scale, coherent = SCALED.get(unit, (1.0, unit))
    if coherent == target or (_powers(coherent) is not None and _powers(target) is not None):
        return scale, 0.0
    quantity = _registry().Quantity
    zero = float(quantity(0.0, unit).to(target).magnitude)
    one = float(quantity(1.0, unit).to(target).magnitude)
    return one - zero, zero
