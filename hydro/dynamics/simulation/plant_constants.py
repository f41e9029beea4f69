"""Constants of a vehicle with a viscous truth as arrays, for the compiled loop."""

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
"""What the terms of a viscous model are products of, in the order of the loop."""


WIDTH = 8
"""Strips, surfaces and terms are a multiple of this, so that they fill registers."""


class Tables(NamedTuple):
    """Constants of a plant; what the vehicle does not have is zero or empty.

    All arrays are flat. `restoring` (4,): W - B, and r_G W - r_B B. `fins` (6, 8) and
    `propeller` (2, 3): coefficients of `fin_terms` and `propeller_terms`;
    `inflow_per_u`: (1 - w_f) / D. `factors` (terms, 3): places in FACTORS;
    `coefficients` (6, terms): K of a viscous model. `strips` (2, s), `surfaces` (11,
    k), `body`, `axial`, `asymmetry`: those of `PhysicalViscous`, a column each, in force
    where `physical` is true. `lag_s`: time constant of the viscous force, or 0. Terms,
    strips and surfaces are filled up to multiples of WIDTH with what has no effect;
    `counts` are their numbers.
    """

    mass: Array
    inverse: Array
    restoring: Array
    fins: Array
    propeller: Array
    inflow_per_u: float
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
    """Return the tables of a vehicle with this viscous truth."""
    fins, propeller = vehicle.fins, vehicle.propeller
    model = truth if isinstance(truth, IdentifiedModel) else IdentifiedModel("none", {})
    physical = truth if isinstance(truth, PhysicalViscous) else _NO_PHYSICS
    factors = [
        [FACTORS.index(factor) for factor in (*BASIS_TERMS[term].factors, "one", "one")[:3]]
        for term in model.terms
    ]
    factors += [[0, 0, 0]] * (-len(factors) % WIDTH)
    strips, surfaces = padded(physical.strips.T), padded(physical.surfaces.T)
    rho, moment = (
        vehicle.water_density,
        vehicle.r_G * vehicle.weight - vehicle.r_B * vehicle.buoyancy,
    )
    # Flatten makes one type of array of all, so that the loop is compiled once.
    return Tables(
        mass=vehicle.mass_matrix.flatten(),
        inverse=vehicle.mass_matrix_inverse.flatten(),
        restoring=np.array([vehicle.weight - vehicle.buoyancy, *moment]),
        fins=np.zeros(48) if fins is None else fins.coefficients(rho).flatten(),
        propeller=np.zeros(6) if propeller is None else propeller.coefficients(rho).flatten(),
        inflow_per_u=0.0 if propeller is None else propeller.inflow_per_u,
        factors=np.array(factors, dtype=np.int64).flatten(),
        coefficients=padded(model.matrix).flatten(),
        strips=strips.flatten(),
        surfaces=surfaces.flatten(),
        counts=(len(factors), strips.shape[1], surfaces.shape[1]),
        physical=isinstance(truth, PhysicalViscous),
        body=physical.body.flatten(),
        axial=physical.axial.flatten(),
        asymmetry=physical.asymmetry.flatten(),
        lag_s=float(lag_s),
        minimum_speed=float(minimum_speed),
    )


def padded(columns: Array) -> Array:
    """Return tables (..., r, c) with zeros up to a multiple of WIDTH columns."""
    missing = -columns.shape[-1] % WIDTH
    return np.concatenate([columns, np.zeros((*columns.shape[:-1], missing))], axis=-1)


_NO_PHYSICS = PhysicalViscous(
    np.zeros((0, 2)), np.zeros((0, 11)), np.zeros(3), np.zeros(2), np.zeros(6)
)
