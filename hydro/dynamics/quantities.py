"""Quantities of a vehicle document as numbers.

They are converted to SI and checked for shape; the assumed ones are remembered.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.units import convertible, factor_and_offset
from auvid.hydro.arrays import Array, read_only


class Quantities:
    """Quantities {value, unit, source, assumed} under one key of a document.

    `assumed` collects a sentence for each assumed number.
    """

    def __init__(
        self, section: Mapping[str, Any], path: str = "", assumed: list[str] | None = None
    ) -> None:
        self._section = section
        self._path = path
        self.assumed: list[str] = [] if assumed is None else assumed

    def __contains__(self, key: str) -> bool:
        return self._section.get(key) is not None

    def part(self, key: str) -> Quantities:
        """The mapping under `key`; empty if it is missing."""
        section = self._section.get(key) or {}
        if not isinstance(section, Mapping):
            raise CampaignError(
                "not a mapping of keys to values", field=self.where(key), value=section
            )
        return Quantities(section, self.where(key), self.assumed)

    def where(self, key: str) -> str:
        """The key's place in the document."""
        return f"{self._path}.{key}" if self._path else key

    def plain(self, key: str, default: Any = None) -> Any:
        """The value of a key that is no quantity."""
        value = self._section.get(key)
        return default if value is None else value

    def array(self, key: str, unit: str, *, shape: tuple[int, ...], default: Any = None) -> Array:
        """Return the quantity in `unit` as a read-only array.

        A length of -1 in `shape` may be any. Raises `CampaignError` naming the key.
        """
        if key not in self:
            if default is None:
                raise CampaignError(
                    "missing quantity",
                    field=self.where(key),
                    remedy=f"Give {{value, unit: {unit}, source}}.",
                )
            return read_only(default)
        quantity = self._section[key]
        if not isinstance(quantity, Mapping) or "value" not in quantity or "unit" not in quantity:
            raise CampaignError(
                "not a quantity",
                field=self.where(key),
                value=quantity,
                remedy=f"Give {{value, unit: {unit}, source}}.",
            )
        try:
            value = np.array(quantity["value"], dtype=np.float64)
        except (TypeError, ValueError):
            raise CampaignError(
                "not numbers", field=f"{self.where(key)}.value", value=quantity["value"]
            ) from None
        fits = value.ndim == len(shape) and all(
            want in (-1, have) for want, have in zip(shape, value.shape, strict=True)
        )
        if not fits:
            raise CampaignError(
                "wrong shape", field=f"{self.where(key)}.value", value=value.shape, allowed=shape
            )
        if not np.all(np.isfinite(value)):
            raise CampaignError(
                "not finite", field=f"{self.where(key)}.value", value=quantity["value"]
            )
        if not convertible(str(quantity["unit"]), unit):
            raise CampaignError(
                "wrong unit",
                field=f"{self.where(key)}.unit",
                value=quantity["unit"],
                allowed=f"a unit of {unit}",
            )
        factor, offset = factor_and_offset(str(quantity["unit"]), unit)
        if quantity.get("assumed"):
            self.assumed.append(
                f"{self.where(key)} = {quantity['value']} {quantity['unit']}"
                f" ({str(quantity.get('source', '')).strip()})"
            )
        return read_only(value * factor + offset)

    def number(self, key: str, unit: str, *, default: float | None = None) -> float:
        """A single quantity in `unit`."""
        return float(self.array(key, unit, shape=(), default=default))
