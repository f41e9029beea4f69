"""Plans of dives: read from their document, and what they are in a manifest."""

from __future__ import annotations

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.errors import CampaignError
from auvid.hydro.dynamics.simulation.rov.truth import checked_thrusters
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.simulate.plans import Entries, leg_entry, log_entry

DIVE_CSV_PARTS = ("imu", "attitude", "dvl", "depth", "outputs", "battery")


def dive_plan(document: object, vehicle: Vehicle, *, file: object = None) -> DivePlanDocument:
    """Return the checked plan; `CampaignError` for a vehicle that cannot dive it."""
    plan = parse(DivePlanDocument, document, file=file)
    try:
        checked_thrusters(vehicle)
    except CampaignError as found:
        raise CampaignError(found.message, file=file, field="kind", value=vehicle.name) from None
    return plan


def dive_entries(document: object, *, format: str) -> Entries:
    """Return logs and legs of a manifest for the logs of the twin, one log per leg."""
    plan = parse(DivePlanDocument, document)
    return (
        [log_entry(leg.id, format, DIVE_CSV_PARTS) for leg in plan.legs],
        [leg_entry(leg.id, plan.margin_s, leg.duration_s, leg.use) for leg in plan.legs],
    )
