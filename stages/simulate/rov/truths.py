"""Truths of an ROV's twin as a campaign names them: physics, coefficients, refits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.documents.twin import TruthEntry
from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.simulation.rov.dive import fly_dive
from auvid.hydro.dynamics.simulation.rov.orders import SCATTER, random_numbers
from auvid.hydro.dynamics.simulation.rov.tether import Tether
from auvid.hydro.dynamics.simulation.rov.truth import RovTruth, physical_truth, truth_of_model
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.models import IdentifiedModel, without_propeller_terms
from auvid.hydro.identification.regression.least_squares import TriangularFactor
from auvid.stages.simulate.flights import checked_coefficients, form_named, model_of_factor

SPREAD = np.array([0.15, 0.15, 0.12, 0.3, 0.3, 0.3])
"""Standard deviation of u v w [m/s] and p q r [rad/s] about the motion of the dives,
where a model is refitted."""
EVERY_S = 0.1
"""Between samples of the motion to which a model is refitted."""


def truth_of_twin(
    truth: TruthEntry, plan: DivePlanDocument, vehicle: Vehicle
) -> tuple[RovTruth, list[str]]:
    """Return a truth (part `truth` of schema `twin`) in the plan's water, and notes.

    Raises `CampaignError` for coefficients of unknown axes or terms, an unknown model,
    or a vehicle without thrusters.
    """
    name = truth.name
    if truth.kind == "physics":
        return in_plan(physical_truth(vehicle), plan), []
    if truth.kind == "refit":
        model, notes = refit_hull(name, plan, vehicle)
        return in_plan(truth_of_model(vehicle, model), plan), notes
    coefficients = checked_coefficients(truth.coefficients, file=truth.source)
    return in_plan(truth_of_model(vehicle, IdentifiedModel(name, coefficients)), plan), []


def in_plan(truth: RovTruth, plan: DivePlanDocument) -> RovTruth:
    """Return a truth with the lag, the current and, of physics, the body of a plan."""
    truth = replace(
        truth,
        loss=replace(truth.loss, lag_s=plan.body.thrust_lag_s),
        current_m_s=np.array(plan.water.current_m_s),
    )
    if isinstance(truth.hull, IdentifiedModel):
        return truth
    entry = plan.body.tether
    tether = None
    if entry is not None:
        north, east = entry.anchor_m
        tether = Tether(anchor_m=(north, east), length_m=entry.length_m, carried=entry.carried)
    return replace(truth, net_buoyancy_N=plan.body.net_buoyancy_N, tether=tether)


def refit_hull(
    name: str, plan: DivePlanDocument, vehicle: Vehicle
) -> tuple[IdentifiedModel, list[str]]:
    """Return a model fitted to the drag of the frame over all legs of a plan.

    The legs are flown without unsteady force. The force is sampled around the motion of
    the dives (`SPREAD`, seeded), so that motions which the legs hardly have keep their
    damping. Where columns are inseparable, one coefficient of each group carries the
    force and the others are 0.
    """
    model = without_propeller_terms(form_named(name))
    truth = in_plan(physical_truth(vehicle), plan)
    calm = plan.model_copy(update={"water": plan.water.model_copy(update={"unsteady": None})})
    factor = TriangularFactor.empty(model.distinct_terms)
    for leg in calm.legs:
        dive = fly_dive(truth, calm, leg, seed=0)
        if dive.stop is not None:
            raise DataError(f"the physical truth cannot dive leg '{leg.id}': {dive.stop}")
        motion = dive.motion(np.arange(dive.start_s, dive.end_s, EVERY_S))
        random = random_numbers(0, leg.id, SCATTER)
        nu = motion.nu + SPREAD * random.standard_normal(motion.nu.shape)
        factor = factor.update(basis_rows(nu.T, None, model.distinct_terms), _hull(truth, nu))
    refitted, ratios = model_of_factor(name, model, factor)
    return refitted, [
        f"refitted to the drag of the frame, J/J0 over the legs: {ratios}",
        "This truth has the mass, the buoyancy and the thrust of the vehicle file, and no tether.",
    ]


def _hull(truth: RovTruth, nu: Array) -> Array:
    """Return the force on the hull (m, 6) at velocities through the water (m, 6)."""
    count = len(truth.thrusters.outputs)
    state = np.zeros((len(nu), 12 + count))
    state[:, :6] = nu
    return truth.rate(state, np.zeros((len(nu), count)), np.zeros((len(nu), 6)))[1]
