"""Every constant of a vehicle with a viscous truth as arrays, for the compiled loop of
hydro/dynamics/compiled.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from auvid.hydro.arrays import VELOCITIES, Array
from auvid.hydro.dynamics.simulation.physical_viscous import PhysicalViscous
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, MODULI, PROPULSION
from auvid.hydro.dynamics.viscous.models import IdentifiedModel

FACTORS = (*VELOCITIES, *MODULI, "V", "Vv", "Vw", PROPULSION, "one")
_ONE = FACTORS.index("one")
WIDTH = 8
"""Numbers that the compiled loop holds in one register: 512 bits of float64, or so many
registers of a smaller machine.
"""


class Tables(NamedTuple):
    """Constants of a plant.

    All arrays are flat. `restoring`: W - B, and r_G W - r_B B. `fins` (6, 2, 4):
    dimensional coefficients of delta and of delta^2 at u = 1 m/s. `propeller` (7,): (1
    - w_f) / D, rho D^4 times K_T, rho D^5 times K_Q. `factors` (terms, 3) and
    `coefficients` (6, terms): xi and K of a viscous model. `strips` (2, strips) and
    `surfaces` (11, surfaces): those of `PhysicalViscous` with a column each. Terms,
    strips and surfaces are filled up to whole registers with what has no effect;
    `counts` are those that mean something. `physical`: which of the two acts; `body`,
    `axial`, `asymmetry`: as there. `lag_s`: time constant of the viscous force, or 0.
    """

    mass: Array
    inverse: Array
    restoring: Array
    fins: Array
    propeller: Array
    factors: NDArray[np.int64]
    coefficients: Array
    strips: Array
    surfaces: Array
    counts: tuple[int, int, int]
    physical: bool
    body: Array
    axial: Array
    asymmetry: Array
    lag_s: float
    minimum_speed: float


def plant_tables(
    vehicle: Vehicle,
    truth: PhysicalViscous | IdentifiedModel,
    *,
    lag_s: float,
    minimum_speed: float,
) -> Tables:
    """The tables of a vehicle with this viscous truth; what the vehicle does not have
    is zero.
    """
    fins = np.zeros((6, 2, 4))
    if vehicle.fins is not None:
        scale = (
            0.5
            * vehicle.water_density
            * vehicle.fins.length_m ** np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
        )
        fins[:, 0], fins[:, 1] = (
            scale[:, None] * vehicle.fins.linear,
            scale[:, None] * vehicle.fins.quadratic,
        )
    propeller = np.zeros(7)
    if vehicle.propeller is not None:
        drive, rho = vehicle.propeller, vehicle.water_density
        propeller[0] = (1.0 - drive.wake_fraction) / drive.diameter_m
        propeller[1:4], propeller[4:] = (
            rho * drive.diameter_m**4 * drive.thrust,
            rho * drive.diameter_m**5 * drive.torque,
        )
    terms, matrix = (
        (truth.terms, truth.matrix)
        if isinstance(truth, IdentifiedModel)
        else ((), np.zeros((6, 0)))
    )
    physical = truth if isinstance(truth, PhysicalViscous) else _NO_PHYSICS
    return Tables(
        mass=vehicle.mass_matrix.flatten(),
        inverse=vehicle.mass_matrix_inverse.flatten(),
        restoring=np.concatenate(
            [
                [vehicle.weight - vehicle.buoyancy],
                vehicle.r_G * vehicle.weight - vehicle.r_B * vehicle.buoyancy,
            ]
        ),
        fins=fins.ravel(),
        propeller=propeller,
        factors=np.array(
            [_factor_row(term) for term in terms] + [[_ONE] * 3] * (-len(terms) % WIDTH),
            dtype=np.int64,
        ).ravel(),
        coefficients=_columns(matrix.T),
        strips=_columns(physical.strips),
        surfaces=_columns(physical.surfaces),
        counts=(len(terms), len(physical.strips), len(physical.surfaces)),
        physical=isinstance(truth, PhysicalViscous),
        body=np.array(physical.body),
        axial=np.array(physical.axial),
        asymmetry=np.array(physical.asymmetry),
        lag_s=float(lag_s),
        minimum_speed=float(minimum_speed),
    )


_NO_PHYSICS = PhysicalViscous(
    np.zeros((0, 2)), np.zeros((0, 11)), np.zeros(3), np.zeros(2), np.zeros(6)
)


def _columns(rows: Array) -> Array:
    return np.pad(rows, ((0, -len(rows) % WIDTH), (0, 0))).T.flatten()


def _factor_row(term: str) -> list[int]:
    found = [FACTORS.index(factor) for factor in BASIS_TERMS[term].factors]
    return found + [_ONE] * (3 - len(found))
