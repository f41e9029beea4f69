"""Constants of a vehicle with a viscous truth as arrays, for the compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    factors = factor_places(model.terms)
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
        factors=factors,
        coefficients=padded(model.matrix).flatten(),
        strips=strips.flatten(),
        surfaces=surfaces.flatten(),
        counts=(len(factors) // 3, strips.shape[1], surfaces.shape[1]),
        physical=isinstance(truth, PhysicalViscous),
        body=physical.body.flatten(),
        axial=physical.axial.flatten(),
        asymmetry=physical.asymmetry.flatten(),
        lag_s=float(lag_s),
        minimum_speed=float(minimum_speed),
    )


class Members(NamedTuple):
    """What may differ from vehicle to vehicle of a plant: one row for all, or one each.

    mass and inverse (k, 36), restoring (k, 4), coefficients (k, 6 terms) as in `Tables`;
    r_G (k, 3): where a force field acts.
    """

    mass: Array
    inverse: Array
    restoring: Array
    coefficients: Array
    r_G: Array


def term_tables(vehicle: Vehicle, terms: Sequence[str], *, minimum_speed: float) -> Tables:
    """Return the tables of a vehicle; `Members` bring the coefficients of the terms."""
    tables = plant_tables(
        vehicle, IdentifiedModel("none", {}), lag_s=0.0, minimum_speed=minimum_speed
    )
    factors = factor_places(terms)
    return tables._replace(factors=factors, counts=(len(factors) // 3, 0, 0))


def member_rows(
    mass_matrix: Array, weight: ArrayLike, buoyancy: float, r_G: Array, r_B: Array, viscous: Array
) -> Members:
    """Return the rows of vehicles.

    M (..., 6, 6), weight (...) [N], r_G (..., 3), and `viscous` (k, 6 terms) from
    `coefficient_rows`.
    """
    heavy = np.asarray(weight, dtype=np.float64)[..., None]
    restoring = np.concatenate([heavy - buoyancy, r_G * heavy - r_B * buoyancy], axis=-1)
    return Members(
        mass=np.array(mass_matrix).reshape(-1, 36),
        inverse=np.asarray(np.linalg.inv(mass_matrix), dtype=np.float64).reshape(-1, 36),
        restoring=restoring.reshape(-1, 4),
        coefficients=viscous,
        r_G=np.array(r_G).reshape(-1, 3),
    )


def coefficient_rows(viscous: Array) -> Array:
    """Return K (..., 6, terms) filled up, a row (6 terms) a vehicle."""
    filled = padded(viscous)
    return filled.reshape(-1, 6 * filled.shape[-1])


def factor_places(terms: Sequence[str]) -> NDArray[np.int64]:
    """Return the places in FACTORS of the factors of terms, three each, filled up."""
    places = [
        [FACTORS.index(factor) for factor in (*BASIS_TERMS[term].factors, "one", "one")[:3]]
        for term in terms
    ]
    places += [[0, 0, 0]] * (-len(places) % WIDTH)
    return np.array(places, dtype=np.int64).flatten()


def padded(columns: Array) -> Array:
    """Return tables (..., r, c) with zeros up to a multiple of WIDTH columns."""
    missing = -columns.shape[-1] % WIDTH
    return np.concatenate([columns, np.zeros((*columns.shape[:-1], missing))], axis=-1)


_NO_PHYSICS = PhysicalViscous(
    np.zeros((0, 2)), np.zeros((0, 11)), np.zeros(3), np.zeros(2), np.zeros(6)
)
