"""Outputs joined otherwise: what cancels explains nothing."""

from __future__ import annotations

import numpy as np

from auvid.hydro.identification.checks.outputs.joined_outputs import WindowMotion, _AxisProducts


def test_outputs_whose_pushes_cancel_explain_nothing() -> None:
    """Two outputs that act alike, joined against each other, push by rounding alone."""
    rng = np.random.default_rng(4)
    push = rng.normal(size=400)
    impulse = np.column_stack([push, push * (1.0 + 1e-15)])
    change = (2.0 * push + rng.normal(size=400))[:, None]
    motion = WindowMotion(change, [rng.normal(size=(400, 1))])
    products = _AxisProducts.of(motion, impulse)
    assert products.shares(np.array([[1.0, -1.0]])) == 0.0
    assert products.shares(np.array([[-1.0, 1.0]])) == 0.0
    assert products.shares(np.array([[1.0, 1.0]])) > 0.7
