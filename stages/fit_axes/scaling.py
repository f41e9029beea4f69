"""From fitted equations to forces: newtons where something gives them, else shares.

A normalised fit has no newtons. One pull at the bollard, or the mass of the vehicle file
where the user says that it is measured, turns all of it into newtons.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auvid.data_schemas.records.partial import ScaleSource
from auvid.hydro.arrays import AXES
from auvid.hydro.axis_figures import FORCE, AxisForces, Inertia, as_forces
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.partial_model import apparent_inertia
from auvid.stages.fit_axes.fitted import AxisFits, FittedAxis

UnitChoice = Literal["pull", "mass"]


@dataclass(frozen=True)
class ScaledAxes:
    """Terms of each axis as forces, what gave the newtons, and the unit of mass.

    unit_of_mass: axis whose apparent inertia is 1; None for kg.
    """

    forces: Mapping[str, AxisForces]
    unit_of_mass: str | None
    scale: ScaleSource | None


def scaled(fits: AxisFits, vehicle: Vehicle, *, by: UnitChoice) -> ScaledAxes:
    """Return the axes as forces.

    In newtons: m = 1 / c. By a pull P on axis A: m = P_i / c_i with P_i = P f_i / f_A where
    the layout ties the full commands of axes together (f: full_thrust), else m_A m_i / m_A
    by the ratio of the vehicle file. By mass: m of the vehicle file. Without either the
    apparent inertia of the first axis, by the ratios of the vehicle file, is 1.
    """
    by_axis = {item.axis: item for item in fits.fitted}
    if not fits.normalised:
        inertias = dict.fromkeys(by_axis, Inertia(1.0, 1))
        return ScaledAxes(_forces(by_axis, inertias), None, None)
    pulled = [axis for axis in fits.full_force if axis in by_axis]
    file_inertia = {axis: apparent_inertia(vehicle, axis) for axis in AXES}
    if by == "pull" and pulled:
        source = _pull_source(pulled[0], fits, vehicle)
        inertias = {
            axis: _by_pull(axis, by_axis, fits, vehicle, source.relative_sd) for axis in by_axis
        }
        return ScaledAxes(_forces(by_axis, inertias), None, source)
    if by == "mass":
        axis = next(iter(by_axis))
        spread = inertia_error(vehicle, axis)
        inertias = {
            name: Inertia(file_inertia[name], 0, inertia_error(vehicle, name)) for name in by_axis
        }
        scale = ScaleSource.model_validate(
            {"axis": axis, "source": "mass", "value": file_inertia[axis], "relative_sd": spread}
        )
        return ScaledAxes(_forces(by_axis, inertias), None, scale)
    unit = next(iter(by_axis))
    inertias = {axis: Inertia(file_inertia[axis] / file_inertia[unit], 0) for axis in by_axis}
    return ScaledAxes(_forces(by_axis, inertias), unit, None)


def _pull_source(axis: str, fits: AxisFits, vehicle: Vehicle) -> ScaleSource:
    return ScaleSource.model_validate(
        {
            "axis": axis,
            "source": "bollard pull",
            "value": fits.full_force[axis],
            "relative_sd": vehicle.spreads.get("thrust", 0.0),
        }
    )


def _by_pull(
    axis: str,
    by_axis: Mapping[str, FittedAxis],
    fits: AxisFits,
    vehicle: Vehicle,
    relative_sd: float,
) -> Inertia:
    """Return the inertia of an axis by its pull, the layout, or the file's ratio.

    The ratio has the error that the spreads of the vehicle file give it.
    """
    if axis in fits.full_force:
        return Inertia(fits.full_force[axis], 1, relative_sd)
    pulled = next(item for item in fits.full_force if item in by_axis)
    pull, ties = fits.full_force[pulled], fits.full_thrust
    if ties.get(axis) and ties.get(pulled):
        return Inertia(pull * ties[axis] / ties[pulled], 1, relative_sd)
    equation = by_axis[pulled].equation
    gain = equation.value(FORCE)
    mass = pull / gain * apparent_inertia(vehicle, axis) / apparent_inertia(vehicle, pulled)
    own, ratio = equation.error(FORCE) / gain, ratio_error(vehicle, axis, pulled)
    return Inertia(mass, 0, float((relative_sd**2 + own**2 + ratio**2) ** 0.5))


def inertia_error(vehicle: Vehicle, axis: str) -> float:
    """Return the relative error of an apparent inertia by the spreads of its parts."""
    return float(np.linalg.norm(list(_inertia_parts(vehicle, axis).values())))


def ratio_error(vehicle: Vehicle, axis: str, other: str) -> float:
    """Return the relative error of M_axis / M_other: the mass is in both.

    d ln(M_i / M_j) = sum of d ln M_i - d ln M_j over mass, inertia and added mass.
    """
    one, two = _inertia_parts(vehicle, axis), _inertia_parts(vehicle, other)
    errors = [one.get(name, 0.0) - two.get(name, 0.0) for name in {*one, *two}]
    return float(np.linalg.norm(errors))


def _inertia_parts(vehicle: Vehicle, axis: str) -> dict[str, float]:
    """Return shares of M of an axis that one deviation of each figure changes."""
    place, total = AXES.index(axis), apparent_inertia(vehicle, axis)
    spreads = vehicle.spreads
    added = abs(float(vehicle.added_mass[place, place]))
    parts = {f"added mass {axis}": spreads.get("added_mass", 0.0) * added}
    if place < 3:
        parts["mass"] = spreads.get("mass", 0.0)
    else:
        own = float(vehicle.rigid_body_mass[place, place])
        parts[f"inertia {axis}"] = spreads.get("inertia", 0.0) * own
    return {name: value / total for name, value in parts.items()}


def _forces(
    by_axis: Mapping[str, FittedAxis], inertias: Mapping[str, Inertia]
) -> dict[str, AxisForces]:
    return {axis: as_forces(item.equation, inertias[axis]) for axis, item in by_axis.items()}
