"""The model file of a set of published coefficients, which no data of ours speak of."""

from __future__ import annotations

from typing import cast

import numpy as np

from auvid.data_schemas.documents.model import in_schema_units
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.model_file import (
    AS_PUBLISHED,
    FORMAT,
    PUBLISHED,
    CoefficientEntry,
    Factor,
    ModelFile,
    OriginEntry,
    UseEntry,
)
from auvid.data_schemas.records.partial import Axis
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, coefficient_unit
from auvid.hydro.dynamics.viscous.coefficients import viscous_terms
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.model_file import dynamics_of, frames

MOTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
MINIMUM_SPEED_M_S = 0.05
"""Lower bound of U in eta = u_c(n) / U, the default of the stage `model_file`."""


def published_model(vehicle: Vehicle, *, vehicle_hash: str, version: str) -> ModelFile:
    """Return the model file of a vehicle with its published damping.

    Each coefficient is printed as its source has it, with the verdict `published`.
    vehicle_hash: of its document; version: of auvid. Raises `DataError` for a vehicle that
    publishes no damping.
    """
    terms = viscous_terms(vehicle.published.values())
    if not terms:
        raise DataError(
            "the vehicle file publishes no damping, so it is no model",
            field="published",
            value=vehicle.name,
            remedy="Write coefficients such as X_u, X_u|u| under `published`.",
        )
    document = vehicle.document
    return ModelFile(
        format=FORMAT,
        kind="auvid model",
        auvid=version,
        name=vehicle.name,
        title=vehicle.title,
        source=document.source,
        method=AS_PUBLISHED,
        use=UseEntry(
            recommended=False,
            sentence="published, fitted to no log of yours; it has no"
            f" {', no '.join(missing_parts(vehicle))}",
            rule="a published set: auvid score CAMPAIGN --with its name judges it on a dive",
            axes=None,
        ),
        frames=frames(document.origin),
        dynamics=dynamics_of(
            vehicle, np.zeros((6, 6)), lag_s=0.0, minimum_speed_m_s=MINIMUM_SPEED_M_S
        ),
        coefficients=[
            _coefficient(axis, term, value)
            for axis, row in terms.items()
            for term, value in row.items()
        ],
        covariance={},
        combinations={},
        fitted_inertia=[],
        fitted_lag=None,
        limits=[],
        prior=None,
        validity={},
        validation=None,
        assumed=list(vehicle.assumed),
        vehicle=in_schema_units(document),
        origin=OriginEntry(
            campaign="none", logs={}, vehicle_hash=vehicle_hash, code={}, parameters={}, packages={}
        ),
    ).sealed()


def missing_parts(vehicle: Vehicle) -> list[str]:
    """Return what a published set has not, in words."""
    terms = viscous_terms(vehicle.published.values())
    still = [
        motion
        for axis, speed, motion in zip(AXES, VELOCITIES, MOTIONS, strict=True)
        if not any(speed in BASIS_TERMS[term].factors for term in terms.get(axis, {}))
    ]
    acting = (vehicle.thrusters, vehicle.fins, vehicle.propeller)
    return [
        "intervals",
        "range of validity",
        *([f"damping in {', '.join(still)}"] if still else []),
        *(["actuators"] if all(part is None for part in acting) else []),
    ]


def _coefficient(axis: str, term: str, value: float) -> CoefficientEntry:
    return CoefficientEntry(
        symbol=str(Unknown(axis, term)),
        axis=cast(Axis, axis),
        term=term,
        factors=cast(list[Factor], list(BASIS_TERMS[term].factors)),
        unit=coefficient_unit(axis, term),
        determined=False,
        value=value,
        predictor=value,
        verdict=PUBLISHED,
        standard_error=None,
        interval_95=None,
        interval_95_assumed=None,
        assumed_shifts={},
        inseparable_from=[],
        turns_without=[],
    )
