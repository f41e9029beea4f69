"""The arm of markers from motion: recovered, not observable without turning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import VELOCITIES, Array
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.signals.pose.marker_arm import TurningLeg, at_origin, marker_arm
from tests.support.axis_legs import axis_leg

INERTIA = np.array([18.0, 20.0, 30.0, 0.45, 0.4, 0.6])
TRUTH = {"u": (-0.6, -4.0, 2.0, 0.0), "v": (-0.5, -5.0, 2.0, 0.0), "r": (-1.2, -1.0, 5.0, 0.0)}
ARM = np.array([0.15, -0.08, 0.0])


def turning(record: AxisRecord, arm: Array) -> TurningLeg:
    """Return the motion of a point at `arm` from the origin."""
    nu = np.column_stack([record.rate[name] for name in VELOCITIES])
    leg = TurningLeg(0.1, nu, np.column_stack([record.force[axis] for axis in "XYZ"]))
    return at_origin(leg, -arm)


def legs(arm: Array, idle: tuple[str, ...] = ()) -> list[TurningLeg]:
    moved = [
        axis_leg(seed, TRUTH, seconds=60.0, step_s=0.1, inertia=INERTIA, idle=idle)
        for seed in (1, 2)
    ]
    return [turning(record, arm) for record in moved]


def test_the_arm_is_that_of_the_markers() -> None:
    """Within 3 standard errors, and 5 mm."""
    result = marker_arm(legs(ARM), np.diag(INERTIA))
    error = np.abs(result.departure - ARM)[:2]
    assert np.all(error < 0.005)
    assert np.all(error < 3.0 * result.standard_error[:2])
    assert np.isinf(result.standard_error[2])


def test_markers_at_their_place_depart_by_nothing() -> None:
    result = marker_arm(legs(np.zeros(3)), np.diag(INERTIA))
    assert np.all(np.abs(result.departure[:2]) < 0.005)


def test_a_vehicle_that_does_not_turn_says_nothing_of_the_arm() -> None:
    one = legs(ARM)[0]
    straight = one.nu.copy()
    straight[:, 3:] = 1e-4 * np.random.default_rng(0).standard_normal((len(straight), 3))
    result = marker_arm([replace(one, nu=straight)], np.diag(INERTIA))
    assert np.all(result.standard_error > 0.02)


def test_mass_that_couples_sway_and_yaw_is_no_arm() -> None:
    """A body with M_26 = m x_G turns about another point than the origin."""
    coupled = np.diag(INERTIA)
    coupled[1, 5] = coupled[5, 1] = 0.1 * INERTIA[1]
    result = marker_arm(legs(np.zeros(3)), coupled)
    assert abs(result.departure[0] - 0.1) < 0.01
