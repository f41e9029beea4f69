"""The buoyancy engine of a hybrid glider. Equations of Al Makdah 2016.

The mass it can take, and where the centre of gravity then is (3.11)-(3.12).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array


@dataclass(frozen=True)
class BuoyancyEngine:
    """Masses [kg] of the vehicle empty, neutral and full.

    x_G moves with the mass by a slope [m/kg] (3.12).
    """

    low_kg: float
    neutral_kg: float
    high_kg: float
    x_G_m_per_kg: float

    def x_G(self, mass_kg: ArrayLike) -> Array:
        """x_G = 0.02 (m - m_neutral) (3.12): masses (...) [kg] -> (...) [m]."""
        return np.asarray(
            self.x_G_m_per_kg * (np.asarray(mass_kg, dtype=np.float64) - self.neutral_kg)
        )

    def glide_mass(self, pitch_rad: ArrayLike, *, epsilon_rad: float) -> Array:
        """Return the mass (...) [kg] of a glide at a pitch (...) [rad] (3.11).

        Heavy to dive (pitch < 0), light to float up.

        m = m_neutral - dm tanh(pitch / epsilon) with dm the stroke to that side (1 kg
        in the thesis); `epsilon_rad` sets how fast it changes over. Raises
        `CampaignError` unless epsilon > 0.
        """
        if epsilon_rad <= 0.0:
            raise CampaignError(
                "the change-over of the glide needs a positive angle",
                field="epsilon",
                value=epsilon_rad,
            )
        share = -np.tanh(np.asarray(pitch_rad, dtype=np.float64) / epsilon_rad)
        stroke = np.where(
            share > 0.0, self.high_kg - self.neutral_kg, self.neutral_kg - self.low_kg
        )
        return np.asarray(self.neutral_kg + stroke * share)

    def check(self, mass_kg: ArrayLike, *, field: str = "mass") -> Array:
        """Return the masses; raise `CampaignError` where the engine cannot."""
        mass = np.asarray(mass_kg, dtype=np.float64)
        outside = ~((mass >= self.low_kg) & (mass <= self.high_kg))
        if outside.any():
            raise CampaignError(
                "the mass is outside the range of the buoyancy engine",
                field=field,
                value=float(mass[outside].flat[0]),
                allowed=f"{self.low_kg:g} (empty) to {self.high_kg:g} kg (full)",
            )
        return mass
