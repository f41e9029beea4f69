"""Names of the flight modes of ArduSub by number (ArduSub/mode.h)."""

from __future__ import annotations

SUB_MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    7: "CIRCLE",
    9: "SURFACE",
    16: "POSHOLD",
    19: "MANUAL",
    20: "MOTOR_DETECT",
    21: "SURFTRAK",
}


def sub_mode(number: int | str) -> str:
    """The name of a mode; the number as text where it is unknown, a text as it is."""
    return number if isinstance(number, str) else SUB_MODES.get(number, str(number))
