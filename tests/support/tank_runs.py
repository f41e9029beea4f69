"""Runs of a vehicle in a tank: commands and motion capture, as CSV files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned

GAIN, DAMPING = np.array([0.9, 0.8, 0.6, 2.5]), np.array([1.2, 1.5, 1.8, 2.0])
"""Acceleration at full command and damping over mass of surge, sway, heave and yaw."""
COMMANDS = {"cmd0": 3, "cmd1": 2, "cmd2": 0, "cmd3": 1}
"""Column of a run -> axis (surge, sway, heave, yaw)."""


def tank_run(seed: int, *, duration_s: float = 60.0, step_s: float = 0.1) -> dict[str, Array]:
    """Return a run: t_s, position, angles, body velocities and commands cmd0 to cmd3.

    nu' = GAIN command - DAMPING nu in surge, sway, heave and yaw; roll and pitch hardly
    move. Axes forward, right, down; the position is that of the body origin.
    """
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, duration_s, step_s)
    steps = int(np.ceil(duration_s / 2.0)) + 1
    command = np.repeat(rng.uniform(-0.7, 0.7, (steps, 4)), round(2.0 / step_s), axis=0)[: t_s.size]
    nu, place = np.zeros((t_s.size, 4)), np.zeros((t_s.size, 4))
    small = 0.02 * np.column_stack([np.sin(0.9 * t_s), np.cos(0.7 * t_s)])
    decay = np.exp(-DAMPING * step_s)
    for row in range(1, t_s.size):
        nu[row] = decay * nu[row - 1] + (1.0 - decay) * GAIN / DAMPING * command[row - 1]
        mean = 0.5 * (nu[row] + nu[row - 1])
        turn = rotation_body_to_ned(
            np.append(small[row], place[row - 1, 3] + 0.5 * step_s * mean[3])
        )
        place[row, :3] = place[row - 1, :3] + step_s * turn @ mean[:3]
        place[row, 3] = place[row - 1, 3] + step_s * mean[3]
    yaw = (place[:, 3] + np.pi) % (2.0 * np.pi) - np.pi
    return {
        "t_s": t_s,
        **dict(zip(("x_m", "y_m", "z_m"), place[:, :3].T, strict=True)),
        "roll_rad": small[:, 0],
        "pitch_rad": small[:, 1],
        "yaw_rad": yaw,
        **dict(zip(("u_mps", "v_mps", "w_mps"), nu[:, :3].T, strict=True)),
        "r_radps": nu[:, 3],
        **{name: command[:, axis] for name, axis in COMMANDS.items()},
    }


def noisy(run: dict[str, Array], seed: int, sd: float = 2e-3) -> dict[str, Array]:
    """Return a run with white noise on everything measured."""
    rng = np.random.default_rng(seed)
    return {
        name: values
        if name == "t_s" or name.startswith("cmd")
        else values + rng.normal(0.0, sd, values.size)
        for name, values in run.items()
    }


def write_csv(path: Path, columns: dict[str, Array]) -> Path:
    """Write columns as a CSV file and return its path."""
    table = np.column_stack(list(columns.values()))
    lines = [",".join(f"{value:.7g}" for value in row) for row in table]
    path.write_text("\n".join([",".join(columns), *lines]) + "\n")
    return path
