"""Names of flight modes by number (ArduSub/mode.h). Other vehicles of the family number theirs differently and keep the number."""

from __future__ import annotations

SUBMARINE = 12  # MAV_TYPE_SUBMARINE
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


def mode_name(number: int | str, *, vehicle_type: int = SUBMARINE) -> str:
    """The name of a mode; the number as text where it is unknown or the vehicle is no submarine, a text as it is."""
    if isinstance(number, str):
        return number
    return SUB_MODES.get(number, str(number)) if vehicle_type == SUBMARINE else str(number)
