"""Types of quantities that several documents hold, by dimension."""

from __future__ import annotations

from typing import Annotated

from auvid.data_schemas.documents.model import Quantity, Unit

Ratio = Annotated[Quantity, Unit("1")]
Kilograms = Annotated[Quantity, Unit("kg")]
Metres = Annotated[Quantity, Unit("m")]
Seconds = Annotated[Quantity, Unit("s")]
PositiveMetres = Annotated[Quantity, Unit("m", positive=True)]
PositiveRatio = Annotated[Quantity, Unit("1", positive=True)]
PositiveKilograms = Annotated[Quantity, Unit("kg", positive=True)]
