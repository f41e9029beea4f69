"""Evaluator of a vehicle class of PythonVehicleSimulator: its dynamics and its main loop.

Read from cybergalactic/PythonVehicleSimulator c717e07: vehicles/remus100.py (method
dynamics, forward Euler, nu changed in place), lib/mainLoop.py:61-100 (simulate) and
lib/gnc.py (attitudeEuler). Frames FRD and NED.
"""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np

from tests.support.targets.frames import Array, Body, rotation, skew

PUSH = 1e3
"""Force in N and N m by which the inverse of the inertia is measured."""


def Tzyx(phi: float, theta: float) -> Array:
    """Return Euler rates from body rates: Fossen (2.41)."""
    sf, cf, ct, tt = np.sin(phi), np.cos(phi), np.cos(theta), np.tan(theta)
    return np.array([[1, sf * tt, cf * tt], [0, cf, -sf], [0, sf / ct, cf / ct]])


def attitudeEuler(eta: Array, nu: Array, sampleTime: float) -> Array:
    """Return the pose one step on: lib/gnc.py:121-134."""
    eta[:3], eta[3:] = (
        eta[:3] + sampleTime * rotation(eta[3:]) @ nu[:3],
        eta[3:] + sampleTime * Tzyx(eta[3], eta[4]) @ nu[3:],
    )
    return eta


def m2c(M: Array, nu: Array) -> Array:
    """Return C(nu) (6, 6): Fossen (3.46), of the symmetric part of M: lib/gnc.py:139-160."""
    a = 0.5 * (M + M.T) @ nu
    s1, s2 = skew(a[:3]), skew(a[3:])
    return np.block([[np.zeros((3, 3)), -s1], [-s1, -s2]])


def gvect(W: float, B: float, theta: float, phi: float, r_bg: Array, r_bb: Array) -> Array:
    """Return the restoring vector g(eta) (6,): Fossen (4.6), lib/gnc.py:342-372."""
    lower = rotation(np.array([phi, theta, 0.0]))[2]
    moment = np.cross(r_bg, W * lower) - np.cross(r_bb, B * lower)
    return -np.hstack([(W - B) * lower, moment])


def library() -> dict[str, ModuleType]:
    """Return stand-ins of the modules that a vehicle file of the package imports."""
    gnc = ModuleType("python_vehicle_simulator.lib.gnc")
    h = {"Smtrx": skew, "Tzyx": Tzyx, "attitudeEuler": attitudeEuler, "m2c": m2c, "gvect": gvect}
    h["Rzyx"] = lambda phi, theta, psi: rotation(np.array([phi, theta, psi], float))
    h["Hmtrx"] = lambda r: np.block(
        [[np.eye(3), skew(np.asarray(r)).T], [np.zeros((3, 3)), np.eye(3)]]
    )
    gnc.__dict__.update(h)
    package, lib = (
        ModuleType("python_vehicle_simulator"),
        ModuleType("python_vehicle_simulator.lib"),
    )
    return {m.__name__: m for m in (package, lib, gnc)}


def vehicle(folder: Path, name: str) -> object:
    """Return an instance of the class NAME of folder/NAME.py."""
    spec = importlib.util.spec_from_file_location(f"pvs_{name}", folder / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    before = {key: sys.modules.get(key) for key in library()}
    sys.modules.update(library())
    try:
        spec.loader.exec_module(module)
    finally:
        for key, value in before.items():
            if value is None:
                del sys.modules[key]
            else:
                sys.modules[key] = value
    return getattr(module, name)()


def step(craft: object, eta: Array, nu: Array, u: Array, sample: float = 1.0) -> Array:
    """Return nu one step of forward Euler on, actual and commanded input both u."""
    result = craft.dynamics(eta.copy(), nu.copy(), u.copy(), u.copy(), sample)  # type: ignore[attr-defined]
    return np.asarray(result[0], float)


def load(folder: Path, name: str) -> Body:
    """Return the body of folder/NAME.py; its inputs are the six forces."""
    craft = vehicle(folder, name)
    rest, inputs = np.zeros(6), PUSH * np.vstack([np.zeros(6), np.eye(6)])
    rates = np.array([step(craft, rest, rest, u) for u in inputs])
    inertia = np.linalg.inv((rates[1:] - rates[0]).T / PUSH)

    def force(nu: Array, eta: Array) -> Array:
        none = np.zeros(6)
        rate = np.array([step(craft, e, v, none) - v for v, e in zip(nu, eta, strict=True)])
        return rate @ inertia.T

    return Body(inertia, force)


def simulate(craft: object, steps: int, sample: float, nu: Array, u: Array) -> Array:
    """Return eta, nu, input and actual input after each step: lib/mainLoop.py:61-100.

    The velocity moves first, by the vehicle; the pose then moves with the new velocity.
    """
    eta, actual, rows = np.zeros(6), np.zeros(len(u)), []
    for _ in range(steps):
        rows.append(np.hstack([eta, nu, u, actual]))
        nu, actual = craft.dynamics(eta, nu, actual, u, sample)  # type: ignore[attr-defined]
        eta = attitudeEuler(eta, nu, sample)
    return np.array(rows)
