"""Evaluator of an MSS function: NAME.m run by GNU Octave, state by state.

The form of the toolbox's vehicle functions, cybergalactic/MSS 736a3d1
CRAFT/AUV/models/remus100.m: xdot = f(x, input) with x = [nu; eta] in FRD and NED, SI, and
xdot = [nu_dot; J(eta) nu] (its lines 1-35 and last statement).
"""

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from tests.support.targets.frames import Array, Body

OCTAVE = shutil.which("octave-cli") or shutil.which("octave")

PUSH = 1e3
"""Force in N and N m by which the inverse of the inertia is measured."""


def evaluate(folder: Path, name: str, states: Array, tau: Array) -> Array:
    """Return xdot (n, 12) of NAME(x, tau) for states [nu eta] (n, 12) and forces (n, 6)."""
    assert OCTAVE is not None
    with tempfile.TemporaryDirectory() as work:
        np.savetxt(f"{work}/x.txt", np.hstack([states, tau]), fmt="%.17g")
        script = (
            f"addpath('{folder}'); a = load('-ascii', '{work}/x.txt');"
            f"f = fopen('{work}/y.txt', 'w');"
            "for k = 1:rows(a)"
            f"  fprintf(f, '%.17g ', {name}(a(k, 1:12)', a(k, 13:18)')); fprintf(f, '\\n');"
            "end; fclose(f);"
        )
        command = [OCTAVE, "--quiet", "--no-gui", "--no-init-file", "--eval", script]
        subprocess.run(command, check=True, capture_output=True, text=True)
        return np.loadtxt(f"{work}/y.txt", ndmin=2)


def load(folder: Path, name: str) -> Body:
    """Return the body that folder/NAME.m moves."""
    rest = np.zeros((7, 12))
    rates = evaluate(folder, name, rest, np.vstack([np.zeros(6), PUSH * np.eye(6)]))[:, :6]
    inertia = np.linalg.inv((rates[1:] - rates[0]).T / PUSH)

    def force(nu: Array, eta: Array) -> Array:
        states = np.hstack([nu, eta])
        return evaluate(folder, name, states, np.zeros_like(nu))[:, :6] @ inertia.T

    return Body(inertia, force)
