"""A model of some axes only, or in a unit of mass of its own."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from auvid.data_schemas.documents.model import Quantity, Unit
from auvid.data_schemas.records.model_file import DynamicsFigures
from auvid.hydro.arrays import AXES, VELOCITIES, Array, Mask, read_only
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, FORCE_AXES

FROM_SHELF, FROM_BENCH = "from the shelf", "from a bench"
"""Verdicts of coefficients that fill an axis which the logs do not give."""


def apparent_inertia(vehicle: Vehicle, axis: str) -> float:
    """Return M of an axis, rigid body and added mass [kg, kg m^2]."""
    place = AXES.index(axis)
    return float(vehicle.mass_matrix[place, place])


def in_unit_of_mass(vehicle: Vehicle, axis: str) -> Vehicle:
    """Return the vehicle with the apparent inertia of an axis as unit of mass.

    All masses and inertias are shares of it, and forces too: M nu_dot = tau stays what it
    is when both are divided by one number. Actuators are gone, since nobody knows their
    newtons.
    """
    unit = apparent_inertia(vehicle, axis)
    return replace(
        vehicle,
        mass_kg=vehicle.mass_kg / unit,
        displaced_mass_kg=vehicle.displaced_mass_kg / unit,
        inertia=read_only(vehicle.inertia / unit),
        added_mass=read_only(vehicle.added_mass / unit),
        thrusters=None,
        fins=None,
        propeller=None,
    )


def with_inertia_shares(vehicle: Vehicle, shares: Mapping[str, float]) -> Vehicle:
    """Return the vehicle whose inertia of axes is these times that of its file.

    M_A,ii - (share - 1) M_ii: the rigid body stays.
    """
    added = vehicle.added_mass.copy()
    for axis, share in shares.items():
        place = AXES.index(axis)
        added[place, place] -= (share - 1.0) * apparent_inertia(vehicle, axis)
    return replace(vehicle, added_mass=read_only(added))


def with_righting_moment(vehicle: Vehicle, moment: float, unit_of_mass: str | None) -> Vehicle:
    """Return the vehicle with the centre of buoyancy that a righting moment asks for.

    z_B = (z_G W - k) / B, with k = z_G W - z_B B (Fossen 2011, 4.6) [N m], of a model
    without newtons k times the apparent inertia that is its unit of mass.
    """
    scale = 1.0 if unit_of_mass is None else apparent_inertia(vehicle, unit_of_mass)
    place = vehicle.r_B.copy()
    place[2] = (vehicle.r_G[2] * vehicle.weight - scale * moment) / vehicle.buoyancy
    body = vehicle.document.rigid_body
    length = Unit("m", (3,))
    centre = length.read(
        Quantity(value=place.tolist(), unit="m", source="righting moment of these logs")
    )
    document = vehicle.document.model_copy(
        update={"rigid_body": body.model_copy(update={"centre_of_buoyancy": centre})}
    )
    return replace(vehicle, r_B=read_only(place), document=document)


def with_displaced_mass(vehicle: Vehicle, mass_kg: float) -> Vehicle:
    """Return the vehicle with the mass of displaced water that its logs give."""
    quantity = Quantity(value=mass_kg, unit="kg", source="trim of these logs")
    body = vehicle.document.rigid_body.model_copy(
        update={"displaced_mass": Unit("kg").read(quantity)}
    )
    document = vehicle.document.model_copy(update={"rigid_body": body})
    return replace(vehicle, displaced_mass_kg=mass_kg, document=document)


def figures_in_unit(figures: DynamicsFigures, axis: str) -> DynamicsFigures:
    """Return dynamics of a model file with the inertia of an axis as unit of mass."""
    unit = figures.mass[AXES.index(axis)][AXES.index(axis)]

    def share(rows: list[list[float]]) -> list[list[float]]:
        return [[value / unit for value in row] for row in rows]

    return figures.model_copy(
        update={
            "mass_kg": figures.mass_kg / unit,
            "inertia_kg_m2": share(figures.inertia_kg_m2),
            "rigid_body": share(figures.rigid_body),
            "added_mass": share(figures.added_mass),
            "mass": share(figures.mass),
            "weight_N": figures.weight_N / unit,
            "buoyancy_N": figures.buoyancy_N / unit,
            "thrusters": [],
            "thrust_curve": None,
            "fins": None,
            "propeller": None,
        }
    )


def unit_in(axis: str, term: str, unit_of_mass: str) -> str:
    """Return the unit of a coefficient where an apparent inertia is the unit of mass.

    >>> unit_in("X", "u", "X"), unit_in("X", "u*|u|", "X"), unit_in("N", "r", "X")
    ('1/s', '1/m', 'm^2/s')
    >>> unit_in("Z", "constant", "Z"), unit_in("N", "r*|r|", "N")
    ('m/s^2', '1')
    """
    # N is kg m/s^2 and N m is kg m^2/s^2; the unit of mass takes the kg, or the kg m^2.
    metres = (1 if axis in FORCE_AXES else 2) - (0 if unit_of_mass in FORCE_AXES else 2)
    seconds = -2
    for factor in BASIS_TERMS[term].factors if term in BASIS_TERMS else ():
        place = VELOCITIES.index(factor.strip("|"))
        metres -= 1 if place < 3 else 0
        seconds += 1
    return _unit({"m": metres, "s": seconds})


def _unit(powers: dict[str, int]) -> str:
    above = [_power(name, n) for name, n in powers.items() if n > 0]
    below = [_power(name, -n) for name, n in powers.items() if n < 0]
    divisor = f"({' '.join(below)})" if len(below) > 1 else "".join(below)
    return f"{' '.join(above) or '1'}{f'/{divisor}' if divisor else ''}"


def _power(name: str, count: int) -> str:
    return name if count == 1 else f"{name}^{count}"


def block_inverse(mass: Array, axes: Collection[str]) -> Array:
    """Return the inverse of M over some axes, 0 elsewhere (6, 6).

    The accelerations of the others are 0: their velocities are held.
    """
    places = [AXES.index(axis) for axis in AXES if axis in axes]
    inverse = np.zeros((6, 6))
    inverse[np.ix_(places, places)] = np.linalg.inv(mass[np.ix_(places, places)])
    return inverse


def uncoupled(vehicle: Vehicle, axes: Collection[str]) -> Vehicle:
    """Return the vehicle without inertia that couples some axes with the others.

    So a force on an axis whose velocity is held moves none of `axes`.
    """
    own = np.array([axis in axes for axis in AXES])
    across = own[:, None] != own[None, :]
    added = np.where(across, vehicle.rigid_body_mass, vehicle.added_mass)
    return replace(vehicle, added_mass=read_only(added))


def imposed(axes: Collection[str]) -> Mask:
    """Return the states [nu, eta] (12,) that a model of `axes` does not simulate.

    Velocities of the other axes, and the angles of other rotations.
    """
    lacking = np.array([axis not in axes for axis in AXES])
    return np.concatenate([lacking, np.zeros(3, dtype=bool), lacking[3:]])
