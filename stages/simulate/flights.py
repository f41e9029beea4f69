"""Fly the legs of a plan, and fit models to the motion.

The truth is physical, of given coefficients, or a model refitted to the physics.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.documents.twin import TruthEntry
from auvid.data_schemas.errors import CampaignError, DataError, PipelineError, nearest, raise_faults
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.control.autopilots import StepAutopilot, fin_mixing
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.simulation.physical_viscous import physical_viscous
from auvid.hydro.dynamics.simulation.rov.orders import random_numbers
from auvid.hydro.dynamics.simulation.simulation import (
    Flight,
    Motion,
    SimulatedVehicle,
    StopLimits,
    gauss_markov,
    motion_at,
    simulate_autopilot,
)
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, basis_rows, eta_ratio
from auvid.hydro.dynamics.viscous.models import MODELS, IdentifiedModel, ViscousModel
from auvid.hydro.dynamics.viscous.structures import diagonal, lift_and_drag, symmetric
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.stages.simulate.plans import Leg, Plan

FORCE, IMU, VELOCITY, DEPTH, SCATTER = range(5)
"""Numbers of the streams of random numbers of a leg."""
REFERENCE_SPEED_M_S = 2.0
DEEPER_M = 50.0
SPREAD = np.array([0.05, 0.05, 0.05, 0.3, 0.05, 0.05])
"""Standard deviation of u v w [m/s] and p q r [rad/s] about the flown motion, where a
model is refitted.
"""


FORMS: Mapping[str, ViscousModel] = {
    model.name: model
    for model in (
        *MODELS,
        diagonal(),
        diagonal(quadratic=True),
        symmetric(),
        symmetric(quadratic=True),
        lift_and_drag(),
    )
}
"""The forms that a truth can be refitted in, by name."""


def form_named(name: str) -> ViscousModel:
    """Return the form of this name. Raises `CampaignError` for an unknown one."""
    if name not in FORMS:
        remedy = nearest(name, FORMS)
        raise CampaignError("no such model", value=name, allowed=tuple(FORMS), remedy=remedy)
    return FORMS[name]


@dataclass(frozen=True)
class FlownLeg:
    """A leg as flown.

    Times count from the start of its log, which lies `offset_s` after the start of the
    flight.

    `start_s` to `end_s` is the leg, cut where the flight stopped; `log_end_s` is the
    last moment that the log can hold.
    """

    leg: Leg
    simulated: SimulatedVehicle
    flight: Flight
    offset_s: float
    start_s: float
    end_s: float
    log_end_s: float

    @property
    def reached(self) -> bool:
        """Return whether the flight lasted into the leg."""
        return self.end_s - self.start_s >= 1.0

    def motion(self, t_s: Array) -> Motion:
        """Return the motion at times (n,) from the start of the log."""
        return motion_at(self.simulated, self.flight, t_s + self.offset_s)


def fly_leg(plan: Plan, leg: Leg, simulated: SimulatedVehicle, *, seed: int) -> FlownLeg:
    """Settle at the leg's propeller speed, fly the leg and the margin of the log.

    The unsteady force grows with the square of the level speed and acts from the start
    of the settling. Raises `DataError` where the truth needs a level speed that the
    vehicle's table does not have.
    """
    vehicle = simulated.vehicle
    assert vehicle.propeller is not None
    ticks = round((plan.settle_s + leg.duration_s + plan.margin_s) / plan.tick_s) + 1
    t_s = np.arange(ticks, dtype=np.float64) * plan.tick_s - plan.settle_s
    cruise = float(level_speed(vehicle.propeller, leg.rev_s))
    force = np.zeros((ticks, 6))
    if plan.unsteady is not None:
        sd = plan.unsteady.sd * (cruise / REFERENCE_SPEED_M_S) ** 2
        random = random_numbers(seed, leg.id, FORCE)
        force = gauss_markov(
            random,
            sd=sd,
            correlation_s=plan.unsteady.correlation_s,
            step_s=plan.tick_s,
            samples=ticks,
        )
    depth = plan.depth_m + leg.depth_m(t_s)
    pilot = StepAutopilot(
        fin_mixing(vehicle),
        leg.yaw_rad(t_s),
        depth,
        plan.tick_s,
        plan.fin_limit_rad,
        plan.fin_rate_rad_s,
    )
    start = simulated.start(
        [0.0, 0.0, plan.depth_m, 0.0, 0.0, 0.0], [cruise, 0.0, 0.0, 0.0, 0.0, 0.0], leg.rev_s
    )
    flight = simulate_autopilot(
        simulated,
        pilot,
        start,
        propeller_rev_s=np.full(ticks, leg.rev_s),
        force=force,
        tick_s=plan.tick_s,
        steps_per_tick=plan.steps_per_tick,
        limits=StopLimits(deepest_m=float(depth.max()) + DEEPER_M),
    )
    offset = plan.settle_s - plan.margin_s
    last = float(flight.t_s[-1]) - offset
    return FlownLeg(
        leg,
        simulated,
        flight,
        offset,
        plan.margin_s,
        min(plan.margin_s + leg.duration_s, last),
        last,
    )


def truth_force(
    truth: TruthEntry, plan: Plan, vehicle: Vehicle
) -> tuple[SimulatedVehicle, list[str]]:
    """Return the vehicle of a truth of schema `twin`, and sentences about it.

    Raises `CampaignError` for coefficients of unknown axes or terms, or an unknown
    model.
    """
    name = truth.name
    if truth.kind == "physics":
        return SimulatedVehicle(vehicle, physical_viscous(vehicle), plan.viscous_lag_s), []
    if truth.kind == "refit":
        model, notes = refit(name, plan, vehicle)
        return SimulatedVehicle(vehicle, model, plan.viscous_lag_s), notes
    coefficients = checked_coefficients(truth.coefficients, file=truth.source)
    return SimulatedVehicle(vehicle, IdentifiedModel(name, coefficients), plan.viscous_lag_s), []


def checked_coefficients(
    coefficients: Mapping[str, Mapping[str, float]], *, file: object
) -> Mapping[str, Mapping[str, float]]:
    """Return the coefficients if every axis, term and value is valid.

    Axes and terms must exist, values be finite; else `CampaignError`, all faults
    together.
    """
    faults: list[PipelineError] = []
    if not any(coefficients.values()):
        faults.append(CampaignError("no coefficients", file=file))
    for axis, terms in coefficients.items():
        if axis not in AXES:
            faults.append(CampaignError("unknown axis", file=file, value=axis, allowed=AXES))
        for term, value in terms.items():
            if term not in BASIS_TERMS:
                faults.append(
                    CampaignError(
                        "unknown term",
                        file=file,
                        field=axis,
                        value=term,
                        remedy=nearest(term, BASIS_TERMS),
                    )
                )
            if not np.isfinite(value):
                faults.append(
                    CampaignError(
                        "not a finite coefficient", file=file, field=f"{axis}.{term}", value=value
                    )
                )
    raise_faults(faults, file=file)
    return coefficients


def refit(name: str, plan: Plan, vehicle: Vehicle) -> tuple[IdentifiedModel, list[str]]:
    """Return a model fitted to the physical truth over all legs of a plan.

    Flown without unsteady force: a truth in the span of that model.

    The force is sampled around the flown velocities (`SPREAD`, seeded), so that motions
    which the legs hardly have, roll above all, keep their damping and the model stays
    flyable. Where columns are inseparable on these legs, one coefficient of each group
    carries the force and the others are 0.
    """
    assert vehicle.propeller is not None
    model = form_named(name)
    simulated = SimulatedVehicle(vehicle, physical_viscous(vehicle))
    factor = TriangularFactor.empty(model.distinct_terms)
    for leg in plan.legs:
        flight = fly_leg(_steady(plan), leg, simulated, seed=0).flight
        if flight.stop is not None:
            raise DataError(f"the physical truth cannot fly leg '{leg.id}': {flight.stop}")
        nu = flight.state[:: plan.steps_per_tick, :6]
        nu = nu[round(plan.settle_s / plan.tick_s) :]
        nu = nu + SPREAD * random_numbers(0, leg.id, SCATTER).standard_normal(nu.shape)
        ratio = eta_ratio(level_speed(vehicle.propeller, np.full(len(nu), leg.rev_s)), nu)
        factor = factor.update(
            basis_rows(nu.T, ratio, model.distinct_terms), simulated.viscous_force(nu, ratio)
        )
    refitted, ratios = model_of_factor(name, model, factor)
    return refitted, [f"refitted to the flow physics, J/J0 over the legs: {ratios}"]


def model_of_factor(
    name: str, model: ViscousModel, factor: TriangularFactor
) -> tuple[IdentifiedModel, str]:
    """Return the least-squares fit of a model, and its J/J0 by axis in words."""
    coefficients, ratios = {}, []
    for axis, terms in model.terms.items():
        if terms:
            fit = solve_axis(factor, axis, terms)
            coefficients[axis] = {
                term: float(value)
                for term, value in zip(terms, fit.solution, strict=True)
                if value != 0.0
            }
            ratios.append(f"{axis} {fit.rms / fit.j0:.3f}" if fit.j0 > 0.0 else f"{axis} -")
    return IdentifiedModel(name, coefficients), ", ".join(ratios)


def _steady(plan: Plan) -> Plan:
    return replace(plan, unsteady=None, viscous_lag_s=0.0)
