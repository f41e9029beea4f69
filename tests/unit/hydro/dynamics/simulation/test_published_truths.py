"""The eight published coefficient sets as the truth of a twin: all of them fly or stop
in words, and their own force is what acts.

All are unstable in open loop at 1 to 2 m/s, and five leave the bounds under the
autopilot within a minute of straight running.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.tables import column, matrix
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.basis import eta_ratio
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.pipeline.campaigns.twin import load_truth
from auvid.pipeline.campaigns.vehicle_files import published_coefficients, read_coefficients
from auvid.stages import simulate
from auvid.stages.columns import VELOCITY, force_columns

VEHICLE_FILE = Path(__file__).parents[5] / "vehicles/vt690.yaml"
VT690 = vehicle_from_document(read_yaml(VEHICLE_FILE.read_text(encoding="utf-8")))
PUBLISHED = published_coefficients(VEHICLE_FILE)


def fly(name: str, duration_s: float, *, settle_s: float = 2) -> simulate.Outputs:
    leg = {
        "id": "run",
        "rpm": 2350,
        "manoeuvre": "straight",
        "duration_s": duration_s,
        "use": "training",
    }
    plan: dict[str, Any] = {"title": "One leg", "settle_s": settle_s, "sensors": {}, "legs": [leg]}
    truth = load_truth(name, vehicle_file=VEHICLE_FILE, folder=VEHICLE_FILE.parent, file=None)
    twin = {
        "plan": plan,
        "truth": truth,
        "seed": 1,
        "format": "csv",
        "accelerometer": "specific_force",
    }
    return simulate.run(simulate.Inputs(VT690, parse(TwinDocument, twin)), simulate.Params())


def test_there_are_eight() -> None:
    assert len(PUBLISHED) == 8


@pytest.mark.parametrize("name", PUBLISHED)
def test_force_that_acts_is_that_of_the_published_model(name: str) -> None:
    flight = fly(name, 3.0)
    truth, (leg,) = flight.truth["run"], flight.simulation["legs"]
    assert flight.logs
    nu, n = matrix(truth, VELOCITY), column(truth, "propeller_rev_s")
    assert VT690.propeller is not None
    ratio = eta_ratio(level_speed(VT690.propeller, n), nu)
    force = IdentifiedModel(name, read_coefficients(PUBLISHED[name])).force(nu, ratio)
    size = np.max(np.abs(force))
    assert size > 1.0
    assert np.max(np.abs(matrix(truth, force_columns("viscous")) - force)) < 1e-9 * size
    assert (
        leg["end_s"] == pytest.approx(float(column(truth, "t_s")[-1]), abs=0.03)
        or leg["stopped"] is None
    )


STOPS = {
    "fossen": "speed above 8 m/s at ",
    "linear": "above 0 m of depth at ",
    "mcfarland": "angular rate above 8 rad/s at ",
    "pitch_yaw": "speed above 8 m/s at ",
    "uncoupled": "speed above 8 m/s at ",
}
"""Those that do not hold a straight run of 60 s at 2350 rpm, and why they stop."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_straight_run_is_held_or_stops_in_words(name: str) -> None:
    """What stops says when, in which state and why, and what it flew of the leg is
    kept.
    """
    flight = fly(name, 60.0)
    (leg,) = flight.simulation["legs"]
    if name not in STOPS:
        assert leg["stopped"] is None
        assert leg["end_s"] == pytest.approx(leg["start_s"] + 60.0)
        return
    assert leg["stopped"].startswith(STOPS[name])
    assert " s; last state: u " in leg["stopped"]
    assert leg["end_s"] < leg["start_s"] + 60.0
    assert leg["end_s"] == pytest.approx(float(column(flight.truth["run"], "t_s")[-1]), abs=0.03)
    assert np.isfinite(matrix(flight.truth["run"], VELOCITY)).all()


def test_no_leg_reached_is_said_with_time_state_and_reason() -> None:
    with pytest.raises(
        DataError, match=r"the twin reached no leg: run: speed above 8 m/s at .* s; last state: u "
    ):
        fly("uncoupled", 60.0, settle_s=20)
