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
from auvid.hydro.axis_figures import CONSTANT, FORCE, AxisEquation, AxisForces, Inertia, as_forces
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.hydro.identification.axes.single_axis import SURGE_LAG_S
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, WEAK
from auvid.hydro.partial_model import apparent_inertia, unit_in, with_inertia_shares
from auvid.stages.columns import AXIS_UNITS
from auvid.stages.few_axes import mean_by_errors
from auvid.stages.fit_axes.fitted import AxisFits, CommandForces

UnitChoice = Literal["pull", "mass"]


@dataclass(frozen=True)
class ScaledAxes:
    """Terms of each axis as forces, their inertia, what gave newtons, unit of mass.

    unit_of_mass: axis whose apparent inertia is 1; None for kg.
    """

    forces: Mapping[str, AxisForces]
    inertias: Mapping[str, Inertia]
    unit_of_mass: str | None
    scale: ScaleSource | None


def scaled(fits: AxisFits, vehicle: Vehicle, *, by: UnitChoice) -> ScaledAxes:
    """Return the axes as forces.

    In newtons: m = 1 / c. By a pull P on axis A: m = P_i / c_i with P_i = P f_i / f_A where
    the layout ties the full commands of axes together (f: full_thrust), else m_A m_i / m_A
    by the ratio of the vehicle file. By mass: m of the vehicle file. Without either the
    apparent inertia of the first axis, by the ratios of the vehicle file, is 1.
    """
    equations = {item.axis: item.equation for item in fits.fitted}
    vehicle = fitted_vehicle(fits, vehicle)
    shares = {axis: error / share for axis, (share, error) in fits.inertia_shares.items()}
    inertias = axis_inertias(equations, fits.commands, vehicle, by=by, shares=shares)
    forces = {axis: as_forces(item, inertias[axis]) for axis, item in equations.items()}
    first = next(iter(equations))
    pulled = fits.commands.pulled(equations)
    scale, unit = None, None
    if fits.normalised and by == "pull" and pulled is not None:
        scale = ScaleSource(
            axis=pulled,  # type: ignore[arg-type]
            source="bollard pull",
            value=fits.full_force[pulled],
            relative_sd=vehicle.spreads.get("thrust", 0.0),
        )
    elif fits.normalised and by == "mass":
        scale = ScaleSource(
            axis=first,  # type: ignore[arg-type]
            source="mass",
            value=apparent_inertia(vehicle, first),
            relative_sd=inertia_error(vehicle, first),
        )
    elif fits.normalised:
        unit = first
    return ScaledAxes(forces, inertias, unit, scale)


def fitted_vehicle(fits: AxisFits, vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with the ratios of inertia that its fits give."""
    shares = {axis: share for axis, (share, _) in fits.inertia_shares.items()}
    return with_inertia_shares(vehicle, shares)


def pull_of(axis: str, pulled: str, commands: CommandForces) -> float | None:
    """Return the force of a full command: measured, or tied to axis `pulled`.

    None where neither gives it.
    """
    if axis in commands.full_force:
        return commands.full_force[axis]
    ties = commands.full_thrust
    if ties.get(axis) and ties.get(pulled):
        return commands.full_force[pulled] * ties[axis] / ties[pulled]
    return None


def axis_inertias(
    equations: Mapping[str, AxisEquation],
    commands: CommandForces,
    vehicle: Vehicle,
    *,
    by: UnitChoice,
    shares: Mapping[str, float],
) -> dict[str, Inertia]:
    """Return the apparent inertia of each axis, as `scaled` has it.

    shares: axis -> relative error of its ratio of inertia, where the vehicle has fitted ones.
    """
    if not commands.normalised:
        return dict.fromkeys(equations, Inertia(1.0, 1))
    if by == "pull" and commands.pulled(equations) is not None:
        return {axis: _by_pull(axis, equations, commands, vehicle, shares) for axis in equations}
    in_file = {axis: apparent_inertia(vehicle, axis) for axis in equations}
    if by == "mass":
        first = next(iter(equations))
        errors = {
            axis: float(np.hypot(inertia_error(vehicle, first), shares[axis]))
            if axis in shares
            else inertia_error(vehicle, axis)
            for axis in equations
        }
        return {axis: Inertia(mass, 0, errors[axis]) for axis, mass in in_file.items()}
    unit = in_file[next(iter(equations))]
    return {axis: Inertia(m / unit, 0, shares.get(axis, 0.0)) for axis, m in in_file.items()}


def _by_pull(
    axis: str,
    equations: Mapping[str, AxisEquation],
    commands: CommandForces,
    vehicle: Vehicle,
    shares: Mapping[str, float],
) -> Inertia:
    """Return the inertia of an axis by its pull, the layout, or a ratio.

    A fitted ratio has its own error, that of the file the one that its spreads give it.
    """
    relative_sd = vehicle.spreads.get("thrust", 0.0)
    pulled = commands.pulled(equations)
    assert pulled is not None
    pull = pull_of(axis, pulled, commands)
    if pull is not None:
        return Inertia(pull, 1, relative_sd)
    pull = commands.full_force[pulled]
    equation = equations[pulled]
    gain = equation.value(FORCE)
    mass = pull / gain * apparent_inertia(vehicle, axis) / apparent_inertia(vehicle, pulled)
    own, ratio = equation.error(FORCE) / gain, ratio_error(vehicle, axis, pulled)
    if axis in shares or pulled in shares:
        ratio = float(np.hypot(shares.get(axis, 0.0), shares.get(pulled, 0.0)))
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


def righting_and_surge(fits: AxisFits, scaled: ScaledAxes) -> dict[str, object]:
    """Return the righting moment and the force of surge on heave, where they are.

    k = -e m of roll or pitch, m its inertia, x' = ... + e sin(angle); of two the mean by
    their errors. Heave: F = (e m) X behind its lag, where X counts in newtons or in the
    shares of the file. The error of m, 1 / c or a pull's, is in both intervals.
    """
    out: dict[str, object] = {}
    moments = []
    for item in fits.fitted:
        if item.righting is not None:
            value, error = _as_force(item.righting, scaled.inertias[item.axis])
            if value + NORMAL_95 * error < 0.0:
                moments.append((item.axis, -value, error))
    if moments:
        value, error = mean_by_errors([item[1:] for item in moments])
        unit = unit_of(moments[0][0], CONSTANT, scaled)
        out["righting"] = {
            "axes": [axis for axis, _, _ in moments],
            "value": value,
            "unit": unit,
            "interval_95": interval_95(value, error),
        }
    for item in fits.fitted:
        if item.surge is not None:
            # The force ahead counts as X of the file; a command of surge is its gain less.
            ahead = scaled.forces.get("X")
            gain, gain_error = 1.0, 0.0
            if fits.normalised:
                if ahead is None:
                    continue  # nothing in the file turns a command of surge into a force
                place = ahead.names.index(FORCE)
                gain = float(ahead.values[place])
                gain_error = float(np.sqrt(max(ahead.covariance[place, place], 0.0)))
            force, error = _as_force(item.surge, scaled.inertias[item.axis])
            value = force / gain
            low, high = interval_95(value, float(np.hypot(error, value * gain_error)) / gain)
            out["cross_forces"] = [
                {
                    "axis": item.axis,
                    "of": "X",
                    "value": value,
                    "lag_s": SURGE_LAG_S,
                    "interval_95": [low, high],
                    "verdict": IDENTIFIED if item.predicts and low * high > 0.0 else WEAK,
                }
            ]
    return out


def _as_force(pair: AxisEquation, inertia: Inertia) -> tuple[float, float]:
    """Return the term beside c as a force, and its standard error."""
    forces = as_forces(pair, inertia)
    place = 1 - forces.names.index(FORCE)
    return float(forces.values[place]), float(np.sqrt(forces.covariance[place, place]))


def unit_of(axis: str, term: str, scaled: ScaledAxes) -> str:
    """Return the unit of a term of an axis as a force."""
    if scaled.unit_of_mass is not None:
        return unit_in(axis, term, scaled.unit_of_mass)
    return AXIS_UNITS[axis] if term == CONSTANT else coefficient_unit(axis, term)


def interval_95(value: float, error: float) -> list[float]:
    """Return the ends of the 95 % interval of a value with a standard error."""
    return [value - NORMAL_95 * error, value + NORMAL_95 * error]
