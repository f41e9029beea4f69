"""Evaluator of MuJoCo: NAME.xml in the simulator, driven by NAME_forces.py.

google-deepmind/mujoco a725507, doc/XMLreference.rst (freejoint) and doc/overview.rst
("Floating objects"): of a free joint, qpos is position and unit quaternion (w first), qvel
is the velocity of the body frame's origin in world axes and the turn rate in body axes;
qacc is the derivative of qvel. Body axes are FLU where gravity points along -z of the
world, FRD where it points along +z.
"""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np

from tests.support.targets.frames import FLIP, Array, Body, cross, rotation

PUSH = 1e3
"""Force in N and N m by which the inverse of the inertia is measured."""


def quaternion(turn: Array) -> Array:
    """Return the unit quaternion, w first, of a rotation matrix (3, 3): Shepperd's method."""
    m = turn
    diagonal = np.array([np.trace(m), m[0, 0], m[1, 1], m[2, 2]])
    k = int(diagonal.argmax())
    w = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    if k == 0:
        q = np.hstack([1 + diagonal[0], w])
    else:
        i, j, l = k - 1, k % 3, (k + 1) % 3
        q = np.zeros(4)
        q[0] = w[i]
        q[1 + i] = 1 + m[i, i] - m[j, j] - m[l, l]
        q[1 + j] = m[j, i] + m[i, j]
        q[1 + l] = m[l, i] + m[i, l]
    return q / np.linalg.norm(q)


def forces_module(folder: Path, name: str) -> ModuleType:
    """Return the module folder/NAME_forces.py."""
    path = folder / f"{name}_forces.py"
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def load(folder: Path, name: str) -> Body:
    """Return the body that MuJoCo moves for folder/NAME.xml with NAME_forces.install()."""
    text = (folder / f"{name}.xml").read_text()
    return Scene(text, forces_module(folder, name).install).body()


class Scene:
    """A MuJoCo model with one free body; `install` sets the callback of its forces."""

    def __init__(self, text: str, install: Callable[[], None]) -> None:
        import mujoco

        self._mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self._install = install
        self._flip = np.eye(3) if self.model.opt.gravity[2] > 0 else FLIP

    def acceleration(self, nu: Array, eta: Array, tau: Array) -> Array:
        """Return nu_dot (6,) of one state under a force, all in FRD and NED."""
        data, flip = self.data, self._flip
        turn = flip @ rotation(eta[3:]) @ flip
        v, w = flip @ nu[:3], flip @ nu[3:]
        self._mujoco.mj_resetData(self.model, data)
        data.qpos[:] = np.hstack([flip @ eta[:3], quaternion(turn)])
        data.qvel[:] = np.hstack([turn @ v, w])
        data.qfrc_applied[:] = np.hstack([turn @ flip @ tau[:3], flip @ tau[3:]])
        self._install()
        try:
            self._mujoco.mj_forward(self.model, data)
        finally:
            self._mujoco.set_mjcb_passive(None)
        linear = turn.T @ data.qacc[:3] - cross(w, v)
        return np.hstack([flip @ linear, flip @ data.qacc[3:6]])

    def body(self) -> Body:
        """Return the body that MuJoCo moves."""
        rest = np.zeros(6)
        still = self.acceleration(rest, rest, rest)
        pushed = [self.acceleration(rest, rest, PUSH * row) for row in np.eye(6)]
        inertia = np.linalg.inv((np.array(pushed) - still).T / PUSH)

        def force(nu: Array, eta: Array) -> Array:
            rows = [self.acceleration(v, e, rest) for v, e in zip(nu, eta, strict=True)]
            return np.array(rows) @ inertia.T

        return Body(inertia, force)
