"""Quantities of a vehicle by dimension, and the checks that several parts share."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from auvid.data_schemas.documents.model import Faults, Model, Quantity, Unit, fault, meanings
from auvid.data_schemas.errors import PipelineError

KilogramMetres = Annotated[Quantity, Unit("kg*m")]
KilogramSquareMetres = Annotated[Quantity, Unit("kg*m^2")]
Lengths = Annotated[Quantity, Unit("m", (-1,))]
Vector = Annotated[Quantity, Unit("m", (3,))]
Angles = Annotated[Quantity, Unit("rad", (3,))]
Polynomial = Annotated[Quantity, Unit("1", (3,))]
FinCoefficients = Annotated[Quantity, Unit("1", (6, 4))]
PositiveNewtons = Annotated[Quantity, Unit("N", positive=True)]
PositiveNewtonMetres = Annotated[Quantity, Unit("N*m", positive=True)]
PositiveSquareMetres = Annotated[Quantity, Unit("m^2", positive=True)]


def require(model: Model, *keys: str) -> None:
    """Raise the missing keys of a part that needs them in this case."""
    words = meanings(type(model))
    Faults(
        *(
            fault("missing quantity", key, remedy=words.get(key))
            for key in keys
            if getattr(model, key) is None
        )
    ).raise_any()


def ascending(points: Quantity, values: Quantity, at: str) -> None:
    """Raise unless points ascend, two or more, with one value each."""
    x, y = points.array, values.array
    if len(x) < 2 or len(x) != len(y) or np.any(np.diff(x) <= 0.0):
        message = "a table needs two or more ascending points with one value each"
        raise Faults(fault(message, at, x.tolist()))


def wrong_shape(at: str, quantity: Quantity, allowed: tuple[int, ...]) -> PipelineError:
    """Return the fault of an array that does not fit the others."""
    shape = quantity.array.shape
    return fault("wrong shape", f"{at}.value", shape, allowed=allowed)
