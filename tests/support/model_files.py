"""Model files of made-up coefficients on vehicles of the project."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from auvid.data_schemas.documents.model import in_schema_units, parse
from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.records.model_file import ModelFile
from auvid.data_schemas.records.models import UsableFor, VelocityRange
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, coefficient_unit
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.model_file import dynamics_of, frames
from tests.support.motions import vehicle_document

Terms = Mapping[str, Mapping[str, float]]
RANGES = {name: (-0.6, 0.8) if name in "uvw" else (-0.5, 0.4) for name in VELOCITIES}
DAMPED: Terms = {
    axis: {speed: -3.0 - i, f"{speed}*|{speed}|": -20.0 + i}
    for i, (axis, speed) in enumerate(zip(AXES, VELOCITIES, strict=True))
}
"""Damping of each axis by its own velocity."""
ALL_USES = UsableFor(forces=list(AXES), simulation=[], control=[], speeds={})
NO_USE = UsableFor(forces=[], simulation=[], control=[], speeds={})


def every_term(seed: int = 3, *, propeller: bool = False) -> Terms:
    """Return all basis terms on all axes, drawn evenly, with a constant force."""
    random = np.random.default_rng(seed)
    names = [name for name, term in BASIS_TERMS.items() if propeller or "eta-1" not in term.factors]
    return {
        axis: {**{name: float(random.uniform(-3, 3)) for name in names}, "constant": 0.7}
        for axis in AXES
    }


def model_file(
    terms: Terms = DAMPED,
    *,
    vehicle: str = "bluerov2_heavy",
    moved: Mapping[str, Any] | None = None,
    use: UsableFor | None = ALL_USES,
    error: float = 0.5,
    lag_s: float = 0.0,
) -> ModelFile:
    """Return a model file; moved: what else the vehicle's rigid_body says.

    error: standard error of each coefficient, as a share of it.
    """
    document = dict(vehicle_document(vehicle))
    document["rigid_body"] = {**document["rigid_body"], **(moved or {})}
    parsed = parse(VehicleDocument, document)
    coefficients = [
        {
            "symbol": str(Unknown(axis, term)),
            "axis": axis,
            "term": term,
            "factors": list(BASIS_TERMS[term].factors) if term in BASIS_TERMS else [],
            "unit": coefficient_unit(axis, term),
            "determined": True,
            "value": value,
            "predictor": value,
            "verdict": "identified",
            "standard_error": abs(error * value),
            "interval_95": None,
            "interval_95_assumed": None,
            "assumed_shifts": {},
            "inseparable_from": [],
            "turns_without": [],
        }
        for axis, row in terms.items()
        for term, value in row.items()
    ]
    return ModelFile.model_validate(
        {
            "format": 1,
            "kind": "auvid model",
            "auvid": "0",
            "name": "made",
            "title": "Made up",
            "source": "this test",
            "method": "least squares",
            "use": {"recommended": True, "sentence": "Made up: use it", "rule": "", "axes": use},
            "frames": frames("the origin"),
            "dynamics": dynamics_of(
                vehicle_from_document(parsed),
                np.zeros((6, 6)),
                lag_s=lag_s,
                minimum_speed_m_s=0.05,
            ),
            "coefficients": coefficients,
            "covariance": {
                axis: {
                    "terms": list(row),
                    "lower": [
                        [0.0] * i + [(error * value) ** 2] for i, value in enumerate(row.values())
                    ],
                }
                for axis, row in terms.items()
            },
            "combinations": {},
            "fitted_inertia": [],
            "fitted_lag": None,
            "limits": [],
            "prior": None,
            "validity": {
                name: VelocityRange(rms=0.2, low=low, high=high, threshold=0.03)
                for name, (low, high) in RANGES.items()
            },
            "validation": None,
            "assumed": [],
            "vehicle": in_schema_units(parsed),
            "origin": {
                "campaign": "a test",
                "logs": {},
                "vehicle_hash": "0",
                "code": {},
                "parameters": {},
                "packages": {},
            },
        }
    )
