"""Evaluator of the Python target: NAME.py with force(nu, eta) and derivative(nu, eta, tau)."""

import importlib.util
from pathlib import Path

import numpy as np

from tests.support.targets.frames import Array, Body

PUSH = 1e3
"""Force in N and N m by which the inverse of the inertia is measured."""


def load(folder: Path, name: str) -> Body:
    """Return the body of folder/NAME.py."""
    spec = importlib.util.spec_from_file_location(f"exported_{name}", folder / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    rest = np.zeros(6)
    still = np.asarray(module.derivative(rest, rest, rest))
    pushed = [np.asarray(module.derivative(rest, rest, PUSH * row)) for row in np.eye(6)]
    inertia = np.linalg.inv((np.array(pushed) - still).T / PUSH)

    def force(nu: Array, eta: Array) -> Array:
        return np.array([module.force(v, e) for v, e in zip(nu, eta, strict=True)], float)

    return Body(inertia, force)
