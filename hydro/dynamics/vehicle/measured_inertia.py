"""Moments of inertia from a pendulum in the place of those of a vehicle document."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from auvid.hydro.dynamics.quantities import Quantities

INERTIAS = ("I_x", "I_y", "I_z")


def with_measured_inertia(vehicle: Mapping[str, Any], inertia: Mapping[str, Any]) -> dict[str, Any]:
    """The vehicle document with the axes that document `inertia` holds (schema
    `inertia`), in kg m^2.

    Measured is about the centre of gravity; the vehicle's matrix is about the body
    origin, so m (|r_G|^2 - r_G,i^2) is added. Products of inertia, and axes that were
    not swung, stay. Raises `CampaignError` for a number that is missing or has a wrong
    unit or shape.
    """
    body = Quantities(vehicle).part("rigid_body")
    arm = body.array("centre_of_gravity", "m", shape=(3,))
    matrix = body.array("inertia", "kg*m^2", shape=(3, 3)).tolist()
    read = Quantities(inertia)
    measured = [name for name in INERTIAS if name in read]
    for index, name in enumerate(INERTIAS):
        if name in measured:
            matrix[index][index] = read.number(name, "kg*m^2") + body.number("mass", "kg") * float(
                arm @ arm - arm[index] ** 2
            )
    out = copy.deepcopy(dict(vehicle))
    old = out["rigid_body"]["inertia"]
    source = f"{', '.join(measured)}: {inertia['source']}"
    if len(measured) < len(INERTIAS):
        source += f"; the rest: {old['source']}"
    out["rigid_body"]["inertia"] = {**old, "value": matrix, "unit": "kg*m^2", "source": source}
    if len(measured) == len(INERTIAS):
        out["rigid_body"]["inertia"].pop("assumed", None)
    return out
