"""Forces of the ROV's twin: drag of the frame, tether, thrust; array and number alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.rov.open_frame import heavy_frame
from auvid.hydro.dynamics.simulation.rov.tether import Tether, tether_components
from auvid.hydro.dynamics.simulation.rov.thrust import ThrustLoss, delivered_components
from auvid.hydro.dynamics.viscous.basis import basis, basis_term_names, needs_propeller_speed

DENSITY = 1025.0
FRAME = heavy_frame(DENSITY)
RANDOM = np.random.default_rng(3)
NU = RANDOM.normal(size=(400, 6)) * [0.5, 0.4, 0.3, 0.5, 0.5, 0.6]
LEVEL = tuple(tuple(row) for row in np.eye(3))
STILL = (0.0,) * 6


def test_the_frame_takes_energy_out_of_every_motion() -> None:
    power = np.sum(FRAME.force(NU) * NU, axis=1)
    assert np.all(power < 0.0)


def test_the_frame_at_rest_feels_no_force() -> None:
    assert np.array_equal(FRAME.force(np.zeros(6)), np.zeros(6))


@pytest.mark.parametrize(
    ("axis", "low", "high"), [(0, 60.0, 110.0), (1, 60.0, 120.0), (2, 80.0, 220.0)]
)
def test_drag_is_of_the_size_of_published_models(axis: int, low: float, high: float) -> None:
    """Quadratic damping [N s^2/m^2] at 1 m/s, both ways, differs by direction."""
    nu = np.zeros((2, 6))
    nu[:, axis] = 1.0, -1.0
    drag = np.abs(FRAME.force(nu)[:, axis])
    assert np.all((drag > low) & (drag < high))
    if axis != 1:
        assert abs(drag[0] - drag[1]) > 0.05 * drag[0]


def test_drag_turns_with_the_velocity_of_its_points() -> None:
    """A yaw rate beside sway moves the sway force: no sum of forces of one velocity."""
    sway, turn = np.array([0, 0.4, 0, 0, 0, 0.0]), np.array([0, 0, 0, 0, 0, 0.8])
    together = FRAME.force(sway + turn)
    sum_of_two = FRAME.force(sway) + FRAME.force(turn)
    assert abs(together[1] - sum_of_two[1]) > 0.5


def test_the_drag_is_in_the_span_of_no_basis() -> None:
    terms = [term for term in basis_term_names() if not needs_propeller_speed(term)]
    columns, force = basis(NU, None, terms), FRAME.force(NU)
    left = force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0]
    rms = np.sqrt(np.mean(left**2, axis=0) / np.mean(force**2, axis=0))
    assert np.all(rms[:3] > 1e-3)


def test_a_slack_tether_only_drags_and_lifts() -> None:
    tether = Tether(length_m=30.0, lift_N_m=0.0).row(DENSITY)
    place = (0.0, 0.0, 8.0)
    rest = np.array(tether_components(tether, LEVEL, place, STILL, (0.0,) * 3))
    assert np.linalg.norm(rest[:3]) < 0.1  # what rounding leaves at 22 m of slack
    moving = np.array(tether_components(tether, LEVEL, place, (0.5, 0, 0, 0, 0, 0), (0.0,) * 3))
    expected = 0.5 * DENSITY * 1.2 * 0.0076 * 0.3 * 7.9 * 0.5**2
    assert moving[0] - rest[0] == pytest.approx(-expected, rel=1e-12)


def test_a_taut_tether_pulls_towards_its_anchor() -> None:
    """30 m out on 20 m of tether: 10 m times the stiffness, along the tether."""
    tether = Tether(attachment_m=(0, 0, 0), length_m=20.0, lift_N_m=0.0, softness_m=1e-3)
    place = (18.0, 24.0, 1e-9)
    pull = np.array(tether_components(tether.row(DENSITY), LEVEL, place, STILL, (0.0,) * 3))
    assert pull[:2] == pytest.approx([-0.6 * 120.0, -0.8 * 120.0], rel=1e-6)
    turned = rotation_body_to_ned([0.0, 0.0, np.pi / 2.0])
    rows = tuple(tuple(row) for row in turned)
    body = np.array(tether_components(tether.row(DENSITY), rows, place, STILL, (0.0,) * 3))
    assert turned @ body[:3] == pytest.approx(pull[:3], abs=1e-9)


def test_the_moment_of_the_tether_is_that_of_its_attachment() -> None:
    tether = Tether(length_m=5.0)
    force = np.array(
        tether_components(tether.row(DENSITY), LEVEL, (3.0, 1.0, 9.0), tuple(NU[0]), (0.1, 0, 0))
    )
    assert force[3:] == pytest.approx(np.cross(tether.attachment_m, force[:3]), rel=1e-12)


def test_inflow_takes_thrust_and_the_hull_its_share() -> None:
    row, axis, place = ThrustLoss().row(DENSITY), (1.0, 0.0, 0.0), (0.0, 0.2, 0.0)
    still = [float(delivered_components(row, f, axis, place, STILL)) for f in (20.0, -20.0)]
    assert still == pytest.approx([20.0 * 0.96, -20.0 * 0.90])
    ahead = float(delivered_components(row, 20.0, axis, place, (0.5, 0, 0, 0, 0, 0)))
    astern = float(delivered_components(row, 20.0, axis, place, (-0.5, 0, 0, 0, 0, 0)))
    assert ahead < still[0] < astern
    # Turning moves the disc: at y = 0.2 m a yaw rate of -1 rad/s is 0.2 m/s ahead.
    turning = float(delivered_components(row, 20.0, axis, place, (0, 0, 0, 0, 0, -1.0)))
    moving = float(delivered_components(row, 20.0, axis, place, (0.2, 0, 0, 0, 0, 0)))
    assert turning == pytest.approx(moving, rel=1e-12)


def test_thrusters_without_losses_deliver_their_bollard_thrust() -> None:
    row = replace(ThrustLoss(), along=1.0, against=1.0, advance=0.0).row(DENSITY)
    f = np.linspace(-40.0, 50.0, 19)
    nu = tuple(np.full(f.size, value) for value in NU[0])
    assert delivered_components(row, f, (0.7, 0.7, 0.0), (0.1, 0.1, 0.0), nu) == pytest.approx(f)
