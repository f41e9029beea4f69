"""Evaluator of an MSS function: NAME.m run by GNU Octave, state by state.

The form of the toolbox's vehicle functions, cybergalactic/MSS 736a3d1
CRAFT/AUV/models/remus100.m: xdot = f(x, input) with x = [nu; eta] in FRD and NED, SI, and
xdot = [nu_dot; J(eta) nu] (its lines 10-23 and 255-258).
"""

import shutil
import subprocess
import weakref
from pathlib import Path

import numpy as np

from tests.support.targets.frames import Array, Body

OCTAVE = shutil.which("octave-cli") or shutil.which("octave")

PUSH = 1e3
"""Force in N and N m by which the inverse of the inertia is measured."""


def close(process: subprocess.Popen[str]) -> None:
    """End a process and close its pipes."""
    process.kill()
    process.communicate()


class Session:
    """One Octave process that evaluates NAME(x, tau) for the states it is handed."""

    def __init__(self, folder: Path, name: str) -> None:
        assert OCTAVE is not None
        loop = (
            f"addpath('{folder}'); while true, n = fscanf(stdin, '%d', 1);"
            "if isempty(n), exit(0); end;"
            "a = reshape(fscanf(stdin, '%g', 18 * n), 18, n); y = zeros(12, n);"
            f"for k = 1:n, y(:, k) = {name}(a(1:12, k), a(13:18, k)); end;"
            "printf('%.17g\\n', y); fflush(stdout); end"
        )
        command = [OCTAVE, "--quiet", "--no-gui", "--no-init-file", "--eval", loop]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
        weakref.finalize(self, close, self._process)

    def __call__(self, states: Array, tau: Array) -> Array:
        """Return xdot (n, 12) for states [nu eta] (n, 12) and forces (n, 6)."""
        table = np.hstack([states, np.broadcast_to(tau, (len(states), 6))])
        words = "\n".join(f"{x:.17g}" for x in table.ravel())
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(f"{len(table)}\n{words}\n")
        process.stdin.flush()
        lines = [process.stdout.readline() for _ in range(12 * len(table))]
        if not lines[-1]:
            raise RuntimeError(process.stderr.read())
        return np.array(lines, float).reshape(len(table), 12)


def load(folder: Path, name: str) -> Body:
    """Return the body that folder/NAME.m moves."""
    rest = np.zeros((7, 12))
    session = Session(folder, name)
    rates = session(rest, np.vstack([np.zeros(6), PUSH * np.eye(6)]))[:, :6]
    inertia = np.linalg.inv((rates[1:] - rates[0]).T / PUSH)

    def force(nu: Array, eta: Array) -> Array:
        states = np.hstack([nu, eta])
        return session(states, np.zeros_like(nu))[:, :6] @ inertia.T

    return Body(inertia, force)
