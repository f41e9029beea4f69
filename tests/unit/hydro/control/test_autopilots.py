"""The autopilots of the twin: mixing, limits, and whether they hold what they are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.control.autopilots import StepAutopilot, fin_mixing
from auvid.hydro.dynamics.actuators.fins import fin_force
from auvid.hydro.dynamics.simulation.physical_viscous import physical_viscous
from auvid.hydro.dynamics.simulation.simulation import Flight, SimulatedVehicle, simulate_autopilot
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document

ROOT = Path(__file__).parents[4]
VT690 = vehicle_from_document(read_yaml((ROOT / "vehicles/vt690.yaml").read_text(encoding="utf-8")))
LIMIT, RATE, TICK = np.radians(25.0), np.radians(60.0), 0.02


def flown(yaw_deg: float, deeper_m: float, seconds: float = 40.0) -> Flight:
    """Level running at 2133 rpm, then a step in heading and depth at 15 s."""
    ticks = round(seconds / TICK) + 1
    later = np.arange(ticks) * TICK >= 15.0
    pilot = StepAutopilot(
        fin_mixing(VT690),
        np.where(later, np.radians(yaw_deg), 0.0),
        5.0 + deeper_m * later,
        TICK,
        LIMIT,
        RATE,
    )
    plant = SimulatedVehicle(VT690, physical_viscous(VT690))
    start = plant.start([0.0, 0.0, 5.0, 0.0, 0.0, 0.0], [1.7, 0.0, 0.0, 0.0, 0.0, 0.0])
    inputs = {
        "propeller_rev_s": np.full(ticks, 2133 / 60),
        "force": np.zeros((ticks, 6)),
        "tick_s": TICK,
        "steps_per_tick": 2,
    }
    return simulate_autopilot(plant, pilot, start, **inputs)  # type: ignore[arg-type]


def test_elevator_gives_pitch_and_rudder_yaw() -> None:
    """Moments of the linear coefficients: only M for the elevator, only N for the
    rudder, both positive; the largest deflection is 1.
    """
    assert VT690.fins is not None
    mixing = fin_mixing(VT690)
    assert np.allclose(np.abs(mixing).max(axis=0), 1.0)
    moments = VT690.fins.linear[4:6] @ mixing
    assert np.allclose(moments - np.diag(np.diag(moments)), 0.0, atol=1e-15)
    assert (np.diag(moments) > 0.0).all()
    nu = np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert fin_force(VT690.fins, nu, 0.05 * mixing[:, 1], water_density=1000.0)[5] > 0.5


def test_a_vehicle_without_fins_is_refused() -> None:
    rov = vehicle_from_document(
        read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text(encoding="utf-8"))
    )
    with pytest.raises(CampaignError, match="steers by fins"):
        fin_mixing(rov)


@pytest.mark.parametrize(
    ("yaw_deg", "deeper_m"), [(15.0, 0.0), (-15.0, 0.0), (0.0, 1.5), (0.0, -1.0)]
)
def test_steps_are_reached(yaw_deg: float, deeper_m: float) -> None:
    """Within 2 degrees and 0.1 m, 25 s after the step; and level running holds 0.1 m
    and 1 degree 14 s after the start.
    """
    flight = flown(yaw_deg, deeper_m)
    assert flight.stop is None
    before, after = flight.state[1400], flight.state[-1]
    assert before[8] == pytest.approx(5.0, abs=0.1)
    assert np.degrees(before[11]) == pytest.approx(0.0, abs=1.0)
    assert after[8] == pytest.approx(5.0 + deeper_m, abs=0.1)
    assert np.degrees(after[11]) == pytest.approx(yaw_deg, abs=2.0)


def test_fins_stay_within_their_limits() -> None:
    """A step of 120 degrees asks for more than the fins have: they stay within
    deflection and rate.
    """
    fins = flown(120.0, 0.0, seconds=25.0).actuation.fins_rad
    assert np.abs(fins).max() == pytest.approx(LIMIT, rel=1e-3)
    assert np.abs(np.diff(fins, axis=0)).max() <= RATE * TICK * (1.0 + 1e-12)


def test_heading_goes_the_short_way() -> None:
    """At 170 degrees told to hold -170: a turn of 20 degrees to starboard."""
    pilot = StepAutopilot(
        fin_mixing(VT690), np.full(1, np.radians(-170.0)), np.full(1, 5.0), TICK, LIMIT, RATE
    )
    state = np.zeros(12)
    state[[8, 11]] = 5.0, np.radians(170.0)
    fins = pilot(0, state, np.zeros(4))
    assert fins @ fin_mixing(VT690)[:, 1] > 0.0
