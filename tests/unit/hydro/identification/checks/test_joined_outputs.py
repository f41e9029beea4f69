"""Outputs joined otherwise: what cancels explains nothing."""

from __future__ import annotations

import numpy as np

from auvid.hydro.dynamics.actuators.commands import frame_thrusters
from auvid.hydro.identification.checks.outputs.joined_outputs import AxisProducts, WindowMotion
from auvid.hydro.identification.checks.outputs.motor_directions import motor_directions
from auvid.hydro.identification.checks.outputs.turned_outputs import turned_outputs


def test_outputs_whose_pushes_cancel_explain_nothing() -> None:
    """Two outputs that act alike, joined against each other, push by rounding alone."""
    rng = np.random.default_rng(4)
    push = rng.normal(size=400)
    impulse = np.column_stack([push, push * (1.0 + 1e-15)])
    change = (2.0 * push + rng.normal(size=400))[:, None]
    motion = WindowMotion(change, [rng.normal(size=(400, 1))])
    products = AxisProducts.of(motion, impulse)
    assert products.shares(np.array([[1.0, -1.0]])) == 0.0
    assert products.shares(np.array([[-1.0, 1.0]])) == 0.0
    assert products.shares(np.array([[1.0, 1.0]])) > 0.7


def test_directions_that_nobody_wrote_down_are_those_that_the_motion_has() -> None:
    """Four level thrusters driven by three sticks, two that lift; and none of noise."""
    rng = np.random.default_rng(5)
    effect = np.array(
        [[-1.0, -1.0, 1.0, 1.0, 0, 0], [1.0, -1.0, 1.0, -1.0, 0, 0], [0, 0, 0, 0, 1.0, 1.0],
         [0.2, -0.2, -0.2, 0.2, 0, 0]]
    )  # fmt: skip
    truth = np.array([1.0, 1.0, -1.0, 1.0, -1.0, -1.0])
    mix = np.sign(np.where(effect == 0.0, 0.0, effect)) * truth
    pulses = rng.normal(size=(300, 4)) @ mix
    ahead = np.where(pulses > 0.0, pulses, 0.8 * pulses)  # less astern
    impulses = ahead, np.where(pulses < 0.0, -pulses, -0.8 * pulses)
    own = np.where(truth > 0.0, *impulses)
    changes = own @ effect.T * [0.1, 0.1, 0.1, 2.0]
    noisy = changes + 0.5 * changes.std(axis=0) * rng.normal(size=changes.shape)
    drag = [rng.normal(size=(300, 2))] * 4
    directions = motor_directions([WindowMotion(noisy, drag)], impulses, effect)
    assert directions is not None
    assert directions.tolist() == truth.tolist()
    still = WindowMotion(rng.normal(size=noisy.shape), drag)
    assert motor_directions([still], impulses, effect) is None


def test_sway_that_answers_yaw_is_no_exchange() -> None:
    """An exchange would explain sway better and yaw not at all."""
    rng = np.random.default_rng(1)
    allocation = frame_thrusters("vectored").allocation[[0, 1, 5]]
    commands = rng.normal(size=(300, 3)) * [0.2, 0.3, 0.3]
    changes = commands + 0.1 * rng.normal(size=commands.shape)
    changes[:, 1] += 2.0 * commands[:, 2] - 0.7 * commands[:, 1]
    motion = WindowMotion(changes, [np.zeros((300, 0))] * 3)
    impulse = commands @ allocation
    assert (
        turned_outputs([motion], impulse, allocation, np.ones(6), equally=10.0, worse=3.0) is None
    )
    other = turned_outputs([motion], impulse, allocation, np.ones(6), equally=10.0, worse=1e9)
    assert other is not None
    assert other.best.exchanged
