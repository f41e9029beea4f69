"""Model files that lack axes, or have the apparent inertia of an axis as unit of mass."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.records.model_file import PARTIAL_FORMAT, ModelFile
from auvid.hydro.arrays import AXES
from auvid.hydro.model_file import vehicle_of
from auvid.hydro.partial_model import apparent_inertia, figures_in_unit, unit_in
from tests.support.model_files import DAMPED, model_file

REMEDY = "Log a velocity (DVL)."


def partial_file(axes: Sequence[str] = ("Z", "N"), unit_of_mass: str | None = None) -> ModelFile:
    """Return the damped model with some axes only; lags of .1 s, gains where normalised."""
    full = model_file({axis: DAMPED[axis] for axis in axes})
    document: dict[str, Any] = full.model_dump(exclude_unset=True)
    scale = 1.0 if unit_of_mass is None else 1.0 / apparent_inertia(vehicle_of(full), unit_of_mass)
    if unit_of_mass is not None:
        document["dynamics"] = figures_in_unit(full.dynamics, unit_of_mass).model_dump()
        for item in document["coefficients"]:
            item |= {"value": scale * item["value"], "predictor": scale * item["predictor"]}
            item |= {"unit": unit_in(item["axis"], item["term"], unit_of_mass)}
    fitted = {"source": "fitted", "name": "this campaign", "held_out_percent": 70.0}
    lacking = {"verdict": "not observable", "words": "nothing measures it", "remedy": REMEDY}
    gain = {"output": None, "unit": "m/s^2", "interval_95": None, "verdict": "identified"}
    document |= {
        "format": PARTIAL_FORMAT,
        "validity": {key: document["validity"][key] for key in ("w", "r")},
        "partial": {
            "unit_of_mass": unit_of_mass,
            "axes": {axis: {**fitted, "lag_s": 0.1, "lag_verdict": "assumed"} for axis in axes},
            "lacking": {axis: lacking for axis in AXES if axis not in axes},
            "without_newtons": [],
            "gains": []
            if unit_of_mass is None
            else [{**gain, "axis": axis, "value": 40.0 * scale} for axis in axes],
        },
    }
    return parse(ModelFile, document)
