"""From fitted equations to forces: newtons where something gives them, else shares.

A normalised fit has no newtons. One pull at the bollard, or the mass of the vehicle file
where the user says that it is measured, turns all of it into newtons.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from auvid.data_schemas.records.partial import ScaleSource
from auvid.hydro.arrays import AXES, VELOCITIES
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
PULL_SD = 0.05
"""Relative deviation of a bollard pull of which the vehicle file gives no spread."""


@dataclass(frozen=True)
class ScaledAxes:
    """Terms of each axis as forces, their inertia, what gave newtons, unit of mass.

    unit_of_mass: axis whose apparent inertia is 1; None for kg. ratio_sd: axis -> relative
    error of its inertia in that unit, of the vehicle file.
    """

    forces: Mapping[str, AxisForces]
    inertias: Mapping[str, Inertia]
    unit_of_mass: str | None
    scale: ScaleSource | None
    ratio_sd: Mapping[str, float] = field(default_factory=dict)


def scaled(
    fits: AxisFits, vehicle: Vehicle, *, by: UnitChoice, inertia_sd: float = 0.0
) -> ScaledAxes:
    """Return the axes as forces.

    In newtons: m = 1 / c. By a pull P on axis A: m = P_i / c_i with P_i = P f_i / f_A where
    the layout ties the full commands of axes together (f: full_thrust), else m_A m_i / m_A
    by the ratio of the vehicle file. By mass: m_A of the vehicle file on the first axis, others by
    fitted ratios or the layout, else of the file. Without either the
    apparent inertia of the first axis, by the ratios of the vehicle file, is 1.
    inertia_sd: relative deviation of mass, added mass and moments of inertia that are assumed
    and of which the vehicle file gives no spread.
    """
    equations = {item.axis: item.equation for item in fits.fitted}
    vehicle = fitted_vehicle(fits, vehicle)
    shares = {axis: error / share for axis, (share, error) in fits.inertia_shares.items()}
    inertias = axis_inertias(
        equations, fits.commands, vehicle, by=by, shares=shares, inertia_sd=inertia_sd
    )
    forces = {axis: as_forces(item, inertias[axis]) for axis, item in equations.items()}
    first = next(iter(equations))
    pulled = fits.commands.pulled(equations)
    scale, unit, ratio_sd = None, None, {}
    if fits.normalised and by == "pull" and pulled is not None:
        scale = ScaleSource(
            axis=pulled,  # type: ignore[arg-type]
            source="bollard pull",
            value=fits.full_force[pulled],
            relative_sd=vehicle.spreads.get("thrust", PULL_SD),
        )
    elif fits.normalised and by == "mass":
        scale = ScaleSource(
            axis=first,  # type: ignore[arg-type]
            source="mass",
            value=apparent_inertia(vehicle, first),
            relative_sd=inertia_error(vehicle, first, inertia_sd),
        )
    elif fits.normalised:
        unit = first
        ratio_sd = {
            axis: ratio_error(vehicle, axis, first, inertia_sd)
            for axis in equations
            if axis not in shares and axis != first
        }
    return ScaledAxes(forces, inertias, unit, scale, ratio_sd)


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
    inertia_sd: float = 0.0,
) -> dict[str, Inertia]:
    """Return the apparent inertia of each axis, as `scaled` has it.

    shares: axis -> relative error of its ratio of inertia, where the vehicle has fitted ones.
    """
    if not commands.normalised:
        return dict.fromkeys(equations, Inertia(1.0, 1))
    if by == "pull" and commands.pulled(equations) is not None:
        return {
            axis: _by_pull(axis, equations, commands, vehicle, shares, inertia_sd)
            for axis in equations
        }
    in_file = {axis: apparent_inertia(vehicle, axis) for axis in equations}
    if by == "mass":
        return {
            axis: _by_mass(axis, equations, commands, vehicle, shares, inertia_sd)
            for axis in equations
        }
    unit = in_file[next(iter(equations))]
    return {axis: Inertia(m / unit, 0, shares.get(axis, 0.0)) for axis, m in in_file.items()}


def _by_pull(
    axis: str,
    equations: Mapping[str, AxisEquation],
    commands: CommandForces,
    vehicle: Vehicle,
    shares: Mapping[str, float],
    inertia_sd: float,
) -> Inertia:
    """Return the inertia of an axis by its pull, the layout, or a ratio.

    A fitted ratio has its own error, that of the file the one that its spreads give it.
    """
    relative_sd = vehicle.spreads.get("thrust", PULL_SD)
    pulled = commands.pulled(equations)
    assert pulled is not None
    pull = pull_of(axis, pulled, commands)
    if pull is not None:
        return Inertia(pull, 1, relative_sd)
    pull = commands.full_force[pulled]
    equation = equations[pulled]
    gain = equation.value(FORCE)
    mass = pull / gain * apparent_inertia(vehicle, axis) / apparent_inertia(vehicle, pulled)
    own, ratio = equation.error(FORCE) / gain, ratio_error(vehicle, axis, pulled, inertia_sd)
    if axis in shares or pulled in shares:
        ratio = float(np.hypot(shares.get(axis, 0.0), shares.get(pulled, 0.0)))
    return Inertia(mass, 0, float((relative_sd**2 + own**2 + ratio**2) ** 0.5))


def _by_mass(
    axis: str,
    equations: Mapping[str, AxisEquation],
    commands: CommandForces,
    vehicle: Vehicle,
    shares: Mapping[str, float],
    inertia_sd: float,
) -> Inertia:
    """Return the inertia of an axis by that of the first in the vehicle file.

    By a fitted ratio, or m_A c_A f_i / (f_A c_i) where the layout ties full commands
    together (f: full_thrust); else that of the file.
    """
    first, ties = next(iter(equations)), commands.full_thrust
    error, mass = inertia_error(vehicle, first, inertia_sd), apparent_inertia(vehicle, axis)
    if axis in shares:
        return Inertia(mass, 0, float(np.hypot(error, shares[axis])))
    if axis != first and ties.get(axis) and ties.get(first):
        gain = equations[first].value(FORCE)
        force = apparent_inertia(vehicle, first) * gain * ties[axis] / ties[first]
        own = equations[first].error(FORCE) / gain
        return Inertia(force, 1, float(np.hypot(error, own)))
    return Inertia(mass, 0, inertia_error(vehicle, axis, inertia_sd))


def inertia_error(vehicle: Vehicle, axis: str, inertia_sd: float = 0.0) -> float:
    """Return the relative error of an apparent inertia by the spreads of its parts."""
    return float(np.linalg.norm(list(_inertia_parts(vehicle, axis, inertia_sd).values())))


def ratio_error(vehicle: Vehicle, axis: str, other: str, inertia_sd: float = 0.0) -> float:
    """Return the relative error of M_axis / M_other: the mass is in both.

    d ln(M_i / M_j) = sum of d ln M_i - d ln M_j over mass, inertia and added mass.
    """
    one, two = (_inertia_parts(vehicle, item, inertia_sd) for item in (axis, other))
    errors = [one.get(name, 0.0) - two.get(name, 0.0) for name in {*one, *two}]
    return float(np.linalg.norm(errors))


def _inertia_parts(vehicle: Vehicle, axis: str, inertia_sd: float) -> dict[str, float]:
    """Return shares of M of an axis that one deviation of each figure changes.

    inertia_sd: of figures that are assumed and have no spread.
    """
    place, total = AXES.index(axis), apparent_inertia(vehicle, axis)
    spreads = vehicle.spreads

    def sd(figure: str, entry: str) -> float:
        guess = any(item.startswith(f"{entry} ") for item in vehicle.assumed)
        return spreads.get(figure, inertia_sd if guess else 0.0)

    added = abs(float(vehicle.added_mass[place, place]))
    parts = {
        f"added mass {axis}": sd("added_mass", f"added_mass.{axis}_{VELOCITIES[place]}dot") * added
    }
    if place < 3:
        parts["mass"] = sd("mass", "rigid_body.mass")
    else:
        own = float(vehicle.rigid_body_mass[place, place])
        parts[f"inertia {axis}"] = sd("inertia", "rigid_body.inertia") * own
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
